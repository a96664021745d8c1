"""Worst-case residuals within norm and data: a lower bound of every certificate from the same assumptions."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from colift import gp
from colift.certification import linearized_trajectory, reachability
from colift.certification.body_models import body_models
from colift.certification.linearized_trajectory import LinearizedTrajectory
from colift.certification.reachability import BodyModel, Matrix
from colift.closed_loop import signals
from colift.closed_loop.flight import Experiment, FlightResult
from colift.gp import optimal_recovery
from colift.onboard.learning import residual_model

NODE_STRIDE = 4  # nodes between the points of the path in the functional that is maximized


def error_functional(loop: LinearizedTrajectory, error: str, t: float, direction: Matrix) -> Matrix:
    """Return `direction . e(t)` as a linear functional of the residual.

    Args:
        loop: Closed loop linearized along the nominal trajectory.
        error: Name of the error: e_p, e_v, e_R or e_omega.
        t: Time [s]; the nearest node is used.
        direction: Direction in the space of the error, `(3,)`.

    Returns:
        Weights of the residual at each node, `(nodes, inputs)`.
    """
    at = int(np.argmin(np.abs(loop.t - t)))
    return np.einsum(
        "tmki,m->ki", linearized_trajectory.adjoint_weights(loop, loop.output_rows(error), [at]), direction
    )


def worst_case_residual(
    experiment: Experiment, flight: FlightResult, nodes: NDArray[np.intp], records: signals.StepRecord, L: Matrix
) -> residual_model.ResidualModel:
    """Compute a residual that is consistent with norm and data and maximizes `sum_k L_k f~(t_k)` along a path.

    Each output takes the consistent function that maximizes its part. `nominal_experiment` puts the result into a
    world. Errors are raised as by `optimal_recovery.maximize_functional`.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run with its final residual model.
        nodes: Ticks of the path.
        records: Records whose states form the path.
        L: Weights of the functional, `(nodes, inputs)`.

    Returns:
        Residual as the mean of a residual model [N, N m].
    """
    end = int(np.flatnonzero(L.any(1)).max(initial=0)) + 1
    starts = np.arange(0, end, NODE_STRIDE)
    L, path = np.add.reduceat(L[:end], starts), nodes[np.minimum(starts + NODE_STRIDE // 2, end - 1)]
    models = [_maximize_body(body, L) for body in body_models(experiment, flight, records, path, "energy")]
    groups, first = [], 1
    for size in experiment.controller.team.sizes:
        groups.append(jax.tree.map(lambda *leaf: jnp.stack(leaf), *models[first : first + size]))
        first += size
    return residual_model.ResidualModel(payload=models[0], agents=tuple(groups), inertial_parameters=jnp.zeros(10))


def _maximize_body(body: BodyModel, L: Matrix) -> gp.GPPosterior:
    """Return each output's consistent function of largest contribution as a posterior mean; L is `(path, inputs)`."""
    n, x = int(body.model.num_points), body.x
    X, Y = np.asarray(body.model.X)[:n], np.asarray(body.model.Y)[:n]
    weights = np.empty((len(body.beta), n + len(x)))
    for i in range(len(body.beta)):
        feasible = optimal_recovery.feasible_set(X, Y, body.model.hyper, i, body.norm, float(body.label_error[i]))
        w = L[:, body.columns.start + i]
        C = reachability.correlation(body.model, i, x, x)
        best = optimal_recovery.maximize_functional(
            feasible, feasible.correlations(x) @ w, float(w @ C @ w), float(np.abs(w).sum())
        )
        weights[i] = np.concatenate([best.weights[:-1], best.weights[-1] * w])
    hyper = dataclasses.replace(body.model.hyper, noise_variance=1e-3 * body.model.hyper.signal_variance)
    return gp.from_expansion(hyper, np.concatenate([X, x]), weights)
