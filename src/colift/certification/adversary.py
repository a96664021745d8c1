"""The worst unknown that norm and data allow: what no certificate from the same assumptions can be below."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from colift import gp
from colift.certification import linearized_trajectory, reachability
from colift.certification.certificate import body_models
from colift.certification.linearized_trajectory import LinearizedTrajectory
from colift.certification.reachability import BodyModel, Matrix
from colift.closed_loop import signals
from colift.closed_loop.flight import Experiment, FlightResult
from colift.gp import optimal_recovery
from colift.onboard.learning import residual_model

NODE_STRIDE = 4  # nodes between samples of the path in the functional that the adversary makes great


def error_functional(loop: LinearizedTrajectory, error: str, t: float, direction: Matrix) -> Matrix:
    """`direction . e(t)` as a functional of the unknown, (nodes, inputs)."""
    at = int(np.argmin(np.abs(loop.t - t)))
    return np.einsum(
        "tmki,m->ki", linearized_trajectory.adjoint_weights(loop, loop.output_rows(error), [at]), direction
    )


def worst_case_residual(
    experiment: Experiment, flight: FlightResult, nodes: NDArray[np.intp], rows: signals.StepRecord, L: Matrix
) -> residual_model.ResidualModel:
    """Unknown forces that keep norm and data, and make `sum_k L_k f~(t_k)` great along the path of `rows`.

    Of all consistent functions, each output takes one that makes its part greatest; L: (nodes, inputs). To be flown by
    `certificate.under`. Raises as `gp.recovery.recover`.
    """
    end = int(np.flatnonzero(L.any(1)).max(initial=0)) + 1
    starts = np.arange(0, end, NODE_STRIDE)
    L, path = np.add.reduceat(L[:end], starts), nodes[np.minimum(starts + NODE_STRIDE // 2, end - 1)]
    models = [_extreme(body, L) for body in body_models(experiment, flight, rows, path, "energy")]
    groups, first = [], 1
    for size in experiment.controller.team.sizes:
        groups.append(jax.tree.map(lambda *leaf: jnp.stack(leaf), *models[first : first + size]))
        first += size
    return residual_model.ResidualModel(payload=models[0], agents=tuple(groups), inertial_parameters=jnp.zeros(10))


def _extreme(body: BodyModel, L: Matrix) -> gp.GPPosterior:
    """For each output the consistent function of greatest contribution, as a posterior mean; L: (path, inputs)."""
    n, x = int(body.model.num_points), body.x
    X, Y = np.asarray(body.model.X)[:n], np.asarray(body.model.Y)[:n]
    weights = np.empty((len(body.beta), n + len(x)))
    for i in range(len(body.beta)):
        allowed = optimal_recovery.feasible_set(X, Y, body.model.hyper, i, body.norm, float(body.label_error[i]))
        w = L[:, body.columns.start + i]
        C = reachability.correlation(body.model, i, x, x)
        best = optimal_recovery.maximize_functional(
            allowed, allowed.correlations(x) @ w, float(w @ C @ w), float(np.abs(w).sum())
        )
        weights[i] = np.concatenate([best.weights[:-1], best.weights[-1] * w])
    hyper = dataclasses.replace(body.model.hyper, noise_variance=1e-3 * body.model.hyper.signal_variance)
    return gp.from_expansion(hyper, np.concatenate([X, x]), weights)
