"""Feasibility of a scenario before simulation: verdict of the preflight check, modes, margins and hover thrust."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from colift.analysis import preflight, reference_checks, stability
from colift.analysis.findings import Level, PreflightReport
from colift.closed_loop import flight
from colift.scenario import Scenario, team, termination


@dataclasses.dataclass(frozen=True)
class FeasibilityReport:
    """Results of the feasibility assessment of a scenario."""

    check: PreflightReport  # findings of the preflight check, without advice that requires further linearizations
    modes: stability.Modes | None  # of the first case at equilibrium; None if no equilibrium was found
    margins: stability.Margins | None  # of the first case; None if the loop has no equilibrium or is unstable
    hover_thrust: Mapping[str, float]  # N, thrust of each agent in hover on the reference
    warnings: tuple[str, ...]  # sentences

    @property
    def summary(self) -> dict[str, Any]:
        """Entries of `summary.json`."""
        modes = self.modes
        mode = (
            None
            if modes is None
            else {
                "stable": modes.stable,
                "eigenvalue_radps": list(modes.slowest_eigenvalue),
                "description": modes.describe_slowest(),
            }
        )
        margins = None
        if self.margins is not None:
            margins = {
                "delay_margin_s": self.margins.delay_margin,
                "gain_margin": list(self.margins.gain_margin),
                "description": self.margins.describe(),
            }
        hover, warnings = dict(self.hover_thrust), list(self.warnings)
        check = {
            "verdict": self.check.verdict.value,
            "failed": list(self.check.subjects(Level.failed)),
            "weak": list(self.check.subjects(Level.weak)),
        }
        return {
            "check": check,
            "slowest_mode": mode,
            "stability_margins": margins,
            "hover_thrust_N": hover,
            "warnings": warnings,
        }


def assess_feasibility(
    settings: Scenario,
    experiments: Mapping[str, flight.Experiment],
    thrust_margin: float = termination.HOVER_THRUST_MARGIN,
) -> FeasibilityReport:
    """Check the sampled loop of the first experiment at equilibrium, the thrust in hover, and the reference.

    Args:
        settings: Scenario.
        experiments: Experiments by case; the first one is linearized.
        thrust_margin: Share of an agent's largest thrust below which a remaining thrust in hover causes a warning.

    Returns:
        Verdict, modes, margins, hover thrust and warnings.
    """
    case, first = next(iter(experiments.items()))
    report, loop = preflight.check_experiment(settings, first, case, thrust_margin=thrust_margin, search=False)
    modes, margins = (None, None) if loop is None else (loop.modes, loop.margins)
    warnings = [finding.message for finding in report.findings if finding.subject == "equilibrium"]
    if modes is not None and not modes.stable:
        warnings.append(f"the loop is unstable at equilibrium: slowest mode {modes.describe_slowest()}")
    if loop is not None and loop.unknown_margins:
        warnings.append(loop.unknown_margins)
    names, truth = team.agent_names(settings), first.world.team
    hover = termination.true_hover_thrust(settings, truth, first.controller, first.world.disturbances)
    available = np.concatenate([group.thrust_max for group in truth.agent_groups])
    for name, required, maximum in zip(names, hover, available, strict=True):
        if maximum - required < thrust_margin * maximum:
            warnings.append(
                f"{name} needs {required:.4g} N of {maximum:.4g} N to hover: the margin of "
                f"{1 - required / maximum:.1%} is below {thrust_margin:.0%}"
            )
    if (found := reference_checks.check_reference(settings, truth)) is not None:
        warnings += found.warnings
    thrust = dict(zip(names, hover.tolist(), strict=True))
    return FeasibilityReport(report, modes, margins, hover_thrust=thrust, warnings=tuple(warnings))
