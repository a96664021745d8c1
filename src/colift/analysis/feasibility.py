"""What is known of a scenario before it is flown: its slowest mode, margins, and the thrust that hovering leaves."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from colift.analysis import stability
from colift.closed_loop import flight
from colift.scenario import Settings, initial_states, team, termination


@dataclasses.dataclass(frozen=True)
class Outlook:
    """What is known of a scenario before it is flown."""

    stability: stability.Modes | None  # of the first case, at rest; None where it finds no rest
    margins: stability.Margins | None  # of the same; None where there are no modes, or they are unstable
    hover: Mapping[str, float]  # N, thrust that each agent needs to hover on the reference
    warnings: tuple[str, ...]  # sentences

    @property
    def summary(self) -> dict[str, Any]:
        """As `summary.json` has it."""
        found = self.modes
        mode = None if found is None else {"stable": found.stable, "says": found.slowest(), "rad_s": list(found.rate)}
        margins = None
        if self.margins is not None:
            margins = {"delay_s": self.margins.delay, "gain": list(self.margins.gain), "says": self.margins.says()}
        hover, warnings = dict(self.hover), list(self.warnings)
        return {"slowest_mode": mode, "margins": margins, "hover_thrust_N": hover, "warnings": warnings}


def outlook(settings: Settings, ready: Mapping[str, flight.Plan]) -> Outlook:
    """How the loop of the first plan behaves at rest, sampled as it flies, and how much thrust hovering leaves."""
    first, warnings, found, margins = next(iter(ready.values())), [], None, None
    try:
        x, M = stability.monodromy(first, initial_states.at_rest(settings, first.world.team))
        found = stability.of(x, M, first.dt)
        if found.stable:
            margins = stability.margins(x, M, first.dt)
        else:
            warnings.append(f"unstable at rest on the reference: slowest mode {found.slowest()}")
    except ValueError as error:
        warnings.append(str(error))
    names, truth = team.agent_names(settings), first.world.team
    hover = termination.hover(settings, truth, first.pilot, first.world.sources)
    have = np.concatenate([group.thrust_max for group in truth.groups])
    margin = settings.limits.thrust_margin
    for name, need, most in zip(names, hover, have, strict=True):
        if most - need < margin * most:
            warnings.append(
                f"hovering takes {need:.4g} N of the {most:.4g} N of {name}; "
                f"what is left, {1 - need / most:.1%}, is below limits.thrust_margin = {margin:g}"
            )
    thrust = dict(zip(names, hover.tolist(), strict=True))
    return Outlook(modes=found, margins=margins, hover=thrust, warnings=tuple(warnings))
