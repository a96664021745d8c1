"""Flights of a short `certified` scenario with their certificates, which several test modules look at."""

from __future__ import annotations

import functools

from colift import certification, scenario
from colift.scenario import Settings

NAMES = ("energy", "srinivas", "recovery")
LAST = 6.0  # s, the last update


def short() -> Settings:
    """The shipped scenario with updates at 3 s and 6 s of 15 s."""
    given = scenario.load("certified").model_dump()
    given["learning"] |= {"update_times_s": (3.0, LAST), "end_s": LAST, "capacity": 12}
    given["drawn"] |= {"centers": 12}
    return Settings.model_validate(given | {"duration_s": 15.0})


@functools.cache
def made() -> certification.Certified:
    """The flight, its twin and its certificate."""
    return certification.certify(short(), names=NAMES)


@functools.cache
def late() -> certification.Certified:
    """Nothing is learned until half a second before errors count: a deviation at the update is far from gone."""
    given = scenario.load("certified").model_dump()
    given["learning"] |= {"update_times_s": (8.0,), "end_s": 8.0, "capacity": 12}
    given["drawn"] |= {"centers": 12}
    return certification.certify(Settings.model_validate(given | {"duration_s": 9.0}), made().linear, ("energy",))
