"""Mean functions of residual models, linear in identified parameters.

A mean function is added to the prediction of the Gaussian processes. `BasisMean` is a linear combination of stated
basis functions. `DragThrustMean` models the drag of all bodies and the thrust bias of the agents.

See Also:
    colift.onboard.learning.identification: the inertial mean of the payload.
    docs/learning: the semiparametric model.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.pytree import pytree


@runtime_checkable
class MeanFunction(Protocol):
    """Protocol of the mean functions of a residual model.

    Implementations: ``BasisMean`` and ``DragThrustMean``.
    """

    def payload_mean(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """Return the mean force [N, world frame] and moment [N m, payload frame] at a payload input."""
        ...

    def agent_means(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """Return the means of ``f_x`` [N], ``f_w`` [N m] and ``f_r`` [N m or N] of a group at its agent inputs."""
        ...


@pytree
class BasisMean:
    """Linear combination of the basis functions of `basis`, with weights for each output.

    Attributes:
        payload: Weights of the payload outputs.
        agents: Weights of the agent outputs, by group.
    """

    payload: Float[Array, "functions 6"]
    agents: tuple[Float[Array, "_agents _functions _outputs"], ...]

    def payload_mean(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """Return ``phi(x)^T W`` of the payload."""
        return payload_basis_functions(x) @ self.payload

    def agent_means(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """Return ``phi(x)^T W`` of the agents of a group."""
        weights = self.agents[group]
        return (agent_basis_functions(x, weights.shape[2] - 6)[:, :, None] * weights).sum(1)


@pytree
class DragThrustMean:
    """Linear drag of payload and agents, and thrust bias of the agents.

    The payload force is ``-c v`` and acts at the lever ``b`` from the payload's origin. The agent force is
    ``-c v + k R e_3``.

    Attributes:
        payload: Drag coefficient ``c`` [N s/m] and ``c b`` [N s], payload frame.
        agents: Drag coefficient ``c`` [N s/m] and thrust bias ``k`` [N] of every agent, by group.
    """

    payload: Float[Array, "4"]
    agents: tuple[Float[Array, "_agents 2"], ...]

    def payload_mean(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """Return the force ``-c v`` and the moment ``b x R^T (-c v)``."""
        v, R = x[3:6], x[6:15].reshape(3, 3)
        return jnp.concatenate([-self.payload[0] * v, -so3.cross(self.payload[1:], R.T @ v)])

    def agent_means(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """Return the force ``-c v + k R e_3``; all moments are zero."""
        n_r, (c, k) = (x.shape[1] - 18) // 2, self.agents[group].T
        v, thrust_axis = x[:, 15 + n_r : 18 + n_r], x[:, jnp.array([2, 5, 8])]
        return jnp.concatenate([k[:, None] * thrust_axis - c[:, None] * v, jnp.zeros((len(x), 3 + n_r))], axis=1)


def zero_drag_thrust(sizes: Sequence[int]) -> DragThrustMean:
    """Return a mean function with zero parameters.

    Args:
        sizes: Number of agents of each group.

    Returns:
        The mean function before the first update.
    """
    return DragThrustMean(payload=jnp.zeros(4), agents=tuple(jnp.zeros((size, 2)) for size in sizes))


def basis(p: Float[Array, "*batch 3"], v: Float[Array, "*batch 3"], other: Float[Array, "*batch rest"]) -> Array:
    """Evaluate the basis functions ``1, p, p p^T, v, |v| v, rest``.

    They represent wind and springs to second order in space, linear and quadratic drag, and linear terms of the body's
    other coordinates.

    Args:
        p: Positions [m], world frame.
        v: Velocities [m/s], world frame.
        other: Other coordinates of the body.

    Returns:
        Values of all basis functions on the last axis.
    """
    one = jnp.ones_like(p[..., :1])
    pairs = [p[..., i : i + 1] * p[..., i:] for i in range(3)]
    speed = jnp.sqrt((v * v).sum(-1, keepdims=True) + 1e-12)  # differentiable at rest
    return jnp.concatenate([one, p, *pairs, v, speed * v, other], axis=-1)


def payload_basis_functions(x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch functions"]:
    """Evaluate `basis` at payload inputs, with ``vec(R), omega`` as other coordinates.

    Args:
        x: Payload inputs in the order of `colift.models.state.flatten_payload_state`.

    Returns:
        Values of the basis functions.
    """
    return basis(x[..., :3], x[..., 3:6], x[..., 6:18])


def agent_basis_functions(x: Float[Array, "*batch inputs"], joints: int) -> Float[Array, "*batch functions"]:
    """Evaluate `basis` at agent inputs, with ``vec(R), r, omega, r_dot`` as other coordinates.

    Args:
        x: Agent inputs in the order of `colift.models.state.flatten_agent_state`.
        joints: Number of joints of the agent.

    Returns:
        Values of the basis functions.
    """
    v = 15 + joints
    other = [x[..., :9], x[..., 12:v], x[..., v + 3 :]]
    return basis(x[..., 9:12], x[..., v : v + 3], jnp.concatenate(other, axis=-1))
