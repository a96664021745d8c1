"""Flights of a short `certified` scenario with their certificates, shared by several test modules."""

from __future__ import annotations

import functools

from colift import scenario
from colift.scenario import Scenario
from colift.workflows import certification
from tests.support import small_team as light

NAMES = ("energy", "srinivas", "recovery")
LAST = 4.0  # s, the last update


def of_light_team(updates: tuple[float, ...], duration_s: float) -> Scenario:
    """The shipped scenario, shorter and on a smaller path, with the smallest team, which compiles faster."""
    certified, team = scenario.load_scenario("certified").model_dump(), light.settings().model_dump()
    certified |= {name: team[name] for name in ("agent_types", "agents")} | {"duration_s": duration_s}
    certified["learning"] |= {"update_times_s": updates, "end_s": updates[-1], "max_samples": 12}
    certified["random_residual"] |= {"min_variation": 0.0}
    certified["reference"] |= {"amplitude_m": (0.5, 0.4, 0.2), "ramp_time_s": 2.0}
    return Scenario.model_validate(certified)


def short() -> Scenario:
    """Scenario of 9 s with updates at 2 s and 4 s."""
    return of_light_team((2.0, LAST), 9.0)


@functools.cache
def made() -> certification.CertificationResult:
    """Return the flight, its nominal trajectory and its certificate."""
    return certification.certify(short(), names=NAMES)


@functools.cache
def late() -> certification.CertificationResult:
    """Like `made`, with the only update half a second before the evaluation begins."""
    return certification.certify(of_light_team((LAST,), LAST + 1), made().equilibrium_linearization, ("energy",))
