"""Evaluation of frozen residual models on held-out reference trajectories."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp

from colift.closed_loop import flight
from colift.onboard.learning import residual_model
from colift.scenario import Scenario, ScenarioError, experiment, schema

TRAJECTORY_VARIANTS = {
    "backwards": "the same curve in the opposite direction",
    "larger": "1.2 times the amplitude",
    "moved": "offset by 0.3 m in x",
}


def held_out_scenarios(settings: Scenario) -> dict[str, Scenario]:
    """Return the scenario with each of the references of `TRAJECTORY_VARIANTS`.

    Args:
        settings: Scenario with a Lissajous reference.

    Returns:
        Scenario by variant.

    Raises:
        ScenarioError: If the reference is not a Lissajous curve.
    """
    reference = settings.reference
    if not isinstance(reference, schema.Lissajous):
        raise ScenarioError(
            f"{settings.name}: reference.kind = {reference.kind}: held-out trajectories need a lissajous curve"
        )
    x, y, z = reference.center_m
    changes = {
        # sin(-w t + phase) = sin(w t + 180 deg - phase)
        "backwards": {"phase_deg": tuple(180 - phase for phase in reference.phase_deg)},
        "larger": {"amplitude_m": tuple(1.2 * a for a in reference.amplitude_m)},
        "moved": {"center_m": (x + 0.3, y, z)},
    }
    return {
        name: settings.model_copy(update={"reference": reference.model_copy(update=changes[name])})
        for name in TRAJECTORY_VARIANTS
    }


def held_out_experiments(settings: Scenario, cases: Sequence[str]) -> dict[str, dict[str, flight.Experiment]]:
    """Return the experiments of some cases on each held-out reference.

    Errors are raised as by `held_out_scenarios` and `make_experiments`.

    Args:
        settings: Scenario with a Lissajous reference.
        cases: Identifiers of the cases.

    Returns:
        Experiment by variant and case.
    """
    return {name: experiment.make_experiments(other, cases) for name, other in held_out_scenarios(settings).items()}


def freeze_model(experiment: flight.Experiment, model: residual_model.ResidualModel) -> flight.Experiment:
    """Return an experiment with a fixed residual model from its start and without online learning.

    A controller with a residual corrector still uses the labels.

    Args:
        experiment: Experiment.
        model: Residual model.

    Returns:
        Experiment without model updates.
    """
    no = jnp.asarray(False)
    recorder = dataclasses.replace(experiment.controller.recorder, payload=no, agents=no)
    controller = dataclasses.replace(experiment.controller, residual_model=model, recorder=recorder)
    return dataclasses.replace(
        experiment, controller=controller, update_times=(), identification=None, online_updates=None
    )


def titles(cases: Mapping[str, str]) -> dict[str, str]:
    """Return title and description of the run of each case on each held-out reference.

    Args:
        cases: Descriptions by case.

    Returns:
        Descriptions by title.
    """
    return {
        f"{case}, {name}": f"{case}'s residual model, {what}"
        for case in cases
        for name, what in TRAJECTORY_VARIANTS.items()
    }
