"""Feasibility of a scenario before simulation: slowest mode, stability margins and hover thrust."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from colift.analysis import reference_checks, stability
from colift.closed_loop import flight
from colift.scenario import Scenario, initial_states, team, termination


@dataclasses.dataclass(frozen=True)
class FeasibilityReport:
    """Results of the feasibility assessment of a scenario."""

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
        return {"slowest_mode": mode, "stability_margins": margins, "hover_thrust_N": hover, "warnings": warnings}


def assess_feasibility(
    settings: Scenario,
    experiments: Mapping[str, flight.Experiment],
    thrust_margin: float = termination.HOVER_THRUST_MARGIN,
) -> FeasibilityReport:
    """Assess the sampled loop of the first experiment at equilibrium, the thrust in hover, and the reference.

    Args:
        settings: Scenario.
        experiments: Experiments by case; the first one is linearized.
        thrust_margin: Share of an agent's largest thrust below which a remaining thrust in hover causes a warning.

    Returns:
        Modes, margins, hover thrust and warnings.
    """
    first, warnings, modes, margins = next(iter(experiments.values())), [], None, None
    try:
        x, M = stability.equilibrium_and_jacobian(first, initial_states.equilibrium_state(settings, first.world.team))
        modes = stability.compute_modes(x, M, first.dt)
        if modes.stable:
            margins = stability.stability_margins(x, M, first.dt)
        else:
            warnings.append(f"the loop is unstable at equilibrium: slowest mode {modes.describe_slowest()}")
    except ValueError as error:
        warnings.append(str(error))
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
    return FeasibilityReport(modes=modes, margins=margins, hover_thrust=thrust, warnings=tuple(warnings))
