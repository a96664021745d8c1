"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.pytree import pytree


class MeanFunction(Protocol):
    """What an oracle says beside its GPs, linear in parameters that were identified."""

    def payload_mean(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """Force, N (world), and moment, N m (payload frame), at a payload sample."""
        ...

    def agent_means(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """`f_x`, N, `f_w` and `f_r`, N m, of the agents of a group at their samples."""
        ...


@pytree
class BasisMean:
    """Weights of `basis`, of every output."""

    payload: Float[Array, "functions 6"]
    agents: tuple[Float[Array, "_agents _functions _outputs"], ...]  # by group

    def payload_mean(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """`phi W`."""
        return payload_basis_functions(x) @ self.payload

    def agent_means(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """`phi W`."""
        weights = self.agents[group]
        return (agent_basis_functions(x, weights.shape[2] - 6)[:, :, None] * weights).sum(1)


@pytree
class DragThrustMean:
    """Drag of bodies, and what rotors lack of thrust: `-c v`, with the payload's lever b, and `k R e_3` of agents."""

    payload: Float[Array, "4"]  # c, N s/m, and c b, N s
    agents: tuple[Float[Array, "_agents 2"], ...]  # c, N s/m, and k, N

    def payload_mean(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """`-c v` and `b x R^T (-c v)`."""
        v, R = x[3:6], x[6:15].reshape(3, 3)
        return jnp.concatenate([-self.payload[0] * v, -so3.cross(self.payload[1:], R.T @ v)])

    def agent_means(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """`-c v + k R e_3`; no moments."""
        n_r, (c, k) = (x.shape[1] - 18) // 2, self.agents[group].T
        v, up = x[:, 15 + n_r : 18 + n_r], x[:, jnp.array([2, 5, 8])]
        return jnp.concatenate([k[:, None] * up - c[:, None] * v, jnp.zeros((len(x), 3 + n_r))], axis=1)


def zero_drag_thrust(sizes: Sequence[int]) -> DragThrustMean:
    """Before anything is known of groups of so many agents."""
    return DragThrustMean(payload=jnp.zeros(4), agents=tuple(jnp.zeros((size, 2)) for size in sizes))


def basis(p: Float[Array, "*batch 3"], v: Float[Array, "*batch 3"], rest: Float[Array, "*batch rest"]) -> Array:
    """`1, p, p p^T, v, |v| v, rest`: wind and springs to second order in space, drag, and a body's own coordinates."""
    one = jnp.ones_like(p[..., :1])
    pairs = [p[..., i : i + 1] * p[..., i:] for i in range(3)]
    speed = jnp.sqrt((v * v).sum(-1, keepdims=True) + 1e-12)  # smooth at rest
    return jnp.concatenate([one, p, *pairs, v, speed * v, rest], axis=-1)


def payload_basis_functions(x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch functions"]:
    """`basis` of a payload sample, with `vec(R), omega`."""
    return basis(x[..., :3], x[..., 3:6], x[..., 6:18])


def agent_basis_functions(x: Float[Array, "*batch inputs"], joints: int) -> Float[Array, "*batch functions"]:
    """`basis` of an agent's sample, with `vec(R), r, omega, r_dot`."""
    v = 15 + joints
    rest = [x[..., :9], x[..., 12:v], x[..., v + 3 :]]
    return basis(x[..., 9:12], x[..., v : v + 3], jnp.concatenate(rest, axis=-1))
