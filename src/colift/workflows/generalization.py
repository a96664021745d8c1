"""Whether what was learned holds where it was not: maps of the end of learning, frozen, on paths that none has seen."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp

from colift.closed_loop import flight
from colift.onboard.learning import residual_model
from colift.scenario import ScenarioError, Settings, experiment, schema

PATHS = {
    "backwards": "the same curve the other way round",
    "larger": "1.2 times as large",
    "moved": "0.3 m off in x",
}


def paths(settings: Settings) -> dict[str, Settings]:
    """The scenario on each of `PATHS`. Raises ScenarioError for a reference that is no Lissajous curve."""
    given = settings.reference
    if not isinstance(given, schema.Lissajous):
        raise ScenarioError(
            f"{settings.name}: reference.kind = {given.kind}: held-out paths are made of a lissajous curve"
        )
    x, y, z = given.center_m
    changes = {
        # sin(-w t + phase) = sin(w t + 180 deg - phase)
        "backwards": {"phase_deg": tuple(180 - phase for phase in given.phase_deg)},
        "larger": {"amplitude_m": tuple(1.2 * a for a in given.amplitude_m)},
        "moved": {"center_m": (x + 0.3, y, z)},
    }
    return {name: settings.model_copy(update={"reference": given.model_copy(update=changes[name])}) for name in PATHS}


def plans(settings: Settings, cases: Sequence[str]) -> dict[str, dict[str, flight.Plan]]:
    """By path, the plans of cases. Raises as `paths` and `study.plans`."""
    return {name: experiment.plans(other, cases) for name, other in paths(settings).items()}


def frozen(plan: flight.Plan, oracle: residual_model.Oracle) -> flight.Plan:
    """The plan with an oracle from its start, that learns no more; a pilot that listens to labels still does."""
    off = jnp.asarray(False)
    recorder = dataclasses.replace(plan.pilot.recorder, payload=off, agents=off)
    pilot = dataclasses.replace(plan.pilot, oracle=oracle, recorder=recorder)
    return dataclasses.replace(plan, pilot=pilot, updates=(), identify=None, renewals=None)


def titles(cases: Mapping[str, str]) -> dict[str, str]:
    """What a flight of a case on a path is called, and what it is."""
    return {f"{case}, {name}": f"{case}'s map, {what}" for case in cases for name, what in PATHS.items()}
