"""Residual models and error bounds of all bodies along a path."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from colift.certification.reachability import BodyModel
from colift.closed_loop import linearization, signals
from colift.closed_loop.flight import Experiment, FlightResult
from colift.onboard.learning import confidence_bounds


def body_models(
    experiment: Experiment, flight: FlightResult, records: signals.StepRecord, path: NDArray[np.intp], bound: str
) -> tuple[BodyModel, ...]:
    """Return the residual of every body along a path, under a bound, after the last update of the run.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run with its final residual model.
        records: Records whose states form the path.
        path: Ticks of the path.
        bound: Name of the error bound, one of `confidence_bounds.ONLINE_BOUNDS`.

    Returns:
        The payload, then each agent.
    """
    stated = dataclasses.replace(experiment.bound_assumptions, bound=bound)
    bands = confidence_bounds.confidence_bands(flight.model, stated, len(flight.updates))
    x, agents = signals.model_inputs(experiment.world.team, jax.tree.map(lambda a: a[path], records))
    columns = linearization.body_columns(experiment.controller.team)
    residual_model, eps = flight.model, stated
    payload_inputs = residual_model.features.payload(jnp.asarray(x))
    out = [
        BodyModel(
            columns[0],
            residual_model.payload,
            bands.bound_posterior.payload,
            np.asarray(bands.payload_beta, dtype=float),
            eps.rkhs_norm,
            eps.payload,
            np.asarray(payload_inputs, dtype=float),
        )
    ]
    for group, other, beta, e, each in zip(
        residual_model.agents, bands.bound_posterior.agents, bands.agent_beta, eps.agents, agents, strict=True
    ):
        for j in range(len(group.num_points)):
            model_of_body, companion = (jax.tree.map(lambda leaf, j=j: leaf[j], model) for model in (group, other))
            out.append(
                BodyModel(
                    columns[len(out)],
                    model_of_body,
                    companion,
                    np.asarray(beta[j], dtype=float),
                    eps.rkhs_norm,
                    e[j],
                    each[:, j],
                )
            )
    return tuple(out)
