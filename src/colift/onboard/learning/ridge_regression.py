"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift import gp
from colift.onboard.learning.mean_functions import BasisMean, agent_basis_functions, payload_basis_functions
from colift.onboard.learning.recorder import RecorderState
from colift.onboard.learning.residual_model import ResidualModel


def fit_ridge(model: ResidualModel, recorder_state: RecorderState, ridge: tuple[float, float]) -> ResidualModel:
    """The oracle with the weights that minimize `|Y - phi W|^2 + ridge |W|^2`, output by output (host).

    What recursive least squares come to when they are frozen now. ridge: of forces, and of moments and joints.
    """

    def weights(phi: Array, data: gp.Dataset) -> np.ndarray:
        A, Y = np.asarray(phi)[: int(data.n)], np.asarray(data.Y)[: int(data.n)]
        each = ((ridge[0], Y[:, :3]), (ridge[1], Y[:, 3:]))
        return np.hstack([np.linalg.solve(A.T @ A + c * np.eye(A.shape[1]), A.T @ y) for c, y in each])

    groups = []
    for data in recorder_state.agents:
        phi = agent_basis_functions(data.X, data.Y.shape[2] - 6)
        each = [weights(phi[j], jax.tree.map(lambda x, j=j: x[j], data)) for j in range(len(data.n))]
        groups.append(jnp.asarray(np.stack(each)))
    linear = BasisMean(
        payload=jnp.asarray(weights(payload_basis_functions(recorder_state.payload.X), recorder_state.payload)),
        agents=tuple(groups),
    )
    return dataclasses.replace(model, mean_function=linear, update_index=model.update_index + 1)
