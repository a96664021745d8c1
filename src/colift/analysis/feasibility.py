"""What is known of a scenario before it is flown: its slowest mode, margins, and the thrust that hovering leaves."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from colift.analysis import stability
from colift.closed_loop import flight
from colift.scenario import Scenario, initial_states, team, termination


@dataclasses.dataclass(frozen=True)
class FeasibilityReport:
    """What is known of a scenario before it is flown."""

    modes: stability.Modes | None  # of the first case, at rest; None where it finds no rest
    margins: stability.Margins | None  # of the same; None where there are no modes, or they are unstable
    hover_thrust: Mapping[str, float]  # N, thrust that each agent needs to hover on the reference
    warnings: tuple[str, ...]  # sentences

    @property
    def summary(self) -> dict[str, Any]:
        """As `summary.json` has it."""
        found = self.modes
        mode = (
            None
            if found is None
            else {"stable": found.stable, "says": found.describe_slowest(), "rad_s": list(found.slowest_eigenvalue)}
        )
        margins = None
        if self.margins is not None:
            margins = {
                "delay_s": self.margins.delay_margin,
                "gain": list(self.margins.gain_margin),
                "says": self.margins.describe(),
            }
        hover, warnings = dict(self.hover_thrust), list(self.warnings)
        return {"slowest_mode": mode, "margins": margins, "hover_thrust_N": hover, "warnings": warnings}


def assess_feasibility(settings: Scenario, ready: Mapping[str, flight.Experiment]) -> FeasibilityReport:
    """How the loop of the first plan behaves at rest, sampled as it flies, and how much thrust hovering leaves."""
    first, warnings, found, margins = next(iter(ready.values())), [], None, None
    try:
        x, M = stability.equilibrium_and_jacobian(first, initial_states.equilibrium_state(settings, first.world.team))
        found = stability.compute_modes(x, M, first.dt)
        if found.stable:
            margins = stability.stability_margins(x, M, first.dt)
        else:
            warnings.append(f"unstable at rest on the reference: slowest mode {found.describe_slowest()}")
    except ValueError as error:
        warnings.append(str(error))
    names, truth = team.agent_names(settings), first.world.team
    hover = termination.true_hover_thrust(settings, truth, first.controller, first.world.disturbances)
    have = np.concatenate([group.thrust_max for group in truth.agent_groups])
    margin = settings.termination.hover_thrust_margin
    for name, need, most in zip(names, hover, have, strict=True):
        if most - need < margin * most:
            warnings.append(
                f"hovering takes {need:.4g} N of the {most:.4g} N of {name}; "
                f"what is left, {1 - need / most:.1%}, is below termination.hover_thrust_margin = {margin:g}"
            )
    thrust = dict(zip(names, hover.tolist(), strict=True))
    return FeasibilityReport(modes=found, margins=margins, hover_thrust=thrust, warnings=tuple(warnings))
