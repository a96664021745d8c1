"""Ridge regression of the residual on stated basis functions.

This is the residual model of the case `regression`. Its predictions are linear in weights that do not change between
updates.

See Also:
    colift.onboard.learning.mean_functions: the basis functions.
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
    """Fit the weights of a `BasisMean` to the recorded samples, on the host.

    The weights of every output minimize ``|y - Phi w|^2 + ridge |w|^2``. Recursive least squares with the same prior
    give the same weights.

    Args:
        model: Residual model whose mean function is replaced.
        recorder_state: Recorded samples.
        ridge: Regularization of the weights of forces, and of the weights of moments and joint torques.

    Returns:
        The residual model with the fitted mean function.
    """

    def weights(phi: Array, data: gp.Dataset) -> np.ndarray:
        A, Y = np.asarray(phi)[: int(data.n)], np.asarray(data.Y)[: int(data.n)]
        blocks = ((ridge[0], Y[:, :3]), (ridge[1], Y[:, 3:]))
        return np.hstack([np.linalg.solve(A.T @ A + c * np.eye(A.shape[1]), A.T @ y) for c, y in blocks])

    groups = []
    for data in recorder_state.agents:
        phi = agent_basis_functions(data.X, data.Y.shape[2] - 6)
        agents = [weights(phi[j], jax.tree.map(lambda x, j=j: x[j], data)) for j in range(len(data.n))]
        groups.append(jnp.asarray(np.stack(agents)))
    linear = BasisMean(
        payload=jnp.asarray(weights(payload_basis_functions(recorder_state.payload.X), recorder_state.payload)),
        agents=tuple(groups),
    )
    return dataclasses.replace(model, mean_function=linear, update_index=model.update_index + 1)
