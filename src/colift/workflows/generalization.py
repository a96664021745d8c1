"""Whether what was learned holds where it was not: maps of the end of learning, frozen, on paths that none has seen."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp

from colift.closed_loop import flight
from colift.onboard.learning import residual_model
from colift.scenario import Scenario, ScenarioError, experiment, schema

TRAJECTORY_VARIANTS = {
    "backwards": "the same curve the other way round",
    "larger": "1.2 times as large",
    "moved": "0.3 m off in x",
}


def heldout_scenarios(settings: Scenario) -> dict[str, Scenario]:
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
    return {
        name: settings.model_copy(update={"reference": given.model_copy(update=changes[name])})
        for name in TRAJECTORY_VARIANTS
    }


def heldout_experiments(settings: Scenario, cases: Sequence[str]) -> dict[str, dict[str, flight.Experiment]]:
    """By path, the plans of cases. Raises as `paths` and `study.plans`."""
    return {name: experiment.make_experiments(other, cases) for name, other in heldout_scenarios(settings).items()}


def freeze_model(experiment: flight.Experiment, model: residual_model.ResidualModel) -> flight.Experiment:
    """The plan with an oracle from its start, that learns no more; a pilot that listens to labels still does."""
    off = jnp.asarray(False)
    recorder = dataclasses.replace(experiment.controller.recorder, payload=off, agents=off)
    controller = dataclasses.replace(experiment.controller, residual_model=model, recorder=recorder)
    return dataclasses.replace(
        experiment, controller=controller, update_times=(), identification=None, online_updates=None
    )


def titles(cases: Mapping[str, str]) -> dict[str, str]:
    """What a flight of a case on a path is called, and what it is."""
    return {f"{case}, {name}": f"{case}'s map, {what}" for case in cases for name, what in TRAJECTORY_VARIANTS.items()}
