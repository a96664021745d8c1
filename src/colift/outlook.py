"""What is known of a scenario before it is flown: its slowest mode, and the thrust that hovering leaves."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from colift import modes, simulate
from colift.scenario import Settings, limits, roster, starts


@dataclasses.dataclass(frozen=True)
class Outlook:
    """What is known of a scenario before it is flown."""

    modes: modes.Modes | None  # of the first case, at rest; None where it finds no rest
    hover: Mapping[str, float]  # N, thrust that each agent needs to hover on the reference
    warnings: tuple[str, ...]  # sentences

    @property
    def summary(self) -> dict[str, Any]:
        """As `summary.json` has it."""
        found = self.modes
        mode = None if found is None else {"stable": found.stable, "says": found.slowest(), "rad_s": list(found.rate)}
        return {"slowest_mode": mode, "hover_thrust_N": dict(self.hover), "warnings": list(self.warnings)}


def outlook(settings: Settings, ready: Mapping[str, simulate.Plan]) -> Outlook:
    """How the loop of the first plan behaves at rest, sampled as it flies, and how much thrust hovering leaves."""
    first, warnings, found = next(iter(ready.values())), [], None
    try:
        found = modes.at_rest(first, starts.at_rest(settings, first.world.team))
        if not found.stable:
            warnings.append(f"unstable at rest on the reference: slowest mode {found.slowest()}")
    except ValueError as error:
        warnings.append(str(error))
    names, truth = roster.agent_names(settings), first.world.team
    hover = limits.hover(settings, truth, first.pilot, first.world.sources)
    have = np.concatenate([group.thrust_max for group in truth.groups])
    margin = settings.limits.thrust_margin
    for name, need, most in zip(names, hover, have, strict=True):
        if most - need < margin * most:
            warnings.append(
                f"hovering takes {need:.4g} N of the {most:.4g} N of {name}; "
                f"what is left, {1 - need / most:.1%}, is below limits.thrust_margin = {margin:g}"
            )
    return Outlook(modes=found, hover=dict(zip(names, hover.tolist(), strict=True)), warnings=tuple(warnings))
