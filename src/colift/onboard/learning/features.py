"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree

PAYLOAD_FEATURES = (
    *("p_x", "p_y", "p_z", "v_x", "v_y", "v_z"),
    *(f"R_{i}{j}" for i in "xyz" for j in "xyz"),
    *("omega_x", "omega_y", "omega_z", "|v|", "|omega|"),
)


def agent_feature_names(joints: int) -> tuple[str, ...]:
    """Names of the agent's features, in order."""
    return (
        *(f"R_{i}{j}" for i in "xyz" for j in "xyz"),
        *("x_x", "x_y", "x_z"),
        *(f"r_{k + 1}" for k in range(joints)),
        *("omega_x", "omega_y", "omega_z", "v_x", "v_y", "v_z"),
        *(f"r_dot_{k + 1}" for k in range(joints)),
    )


def payload_features(x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 20"]:
    """`p, v, vec(R), omega, |v|, |omega|` of a payload sample (docs/errata.md, row 9)."""
    v, omega = x[..., 3:6], x[..., 15:18]
    speeds = [jnp.sqrt((a * a).sum(-1, keepdims=True) + 1e-12) for a in (v, omega)]  # smooth at rest
    return jnp.concatenate([x[..., :18], *speeds], axis=-1)


@runtime_checkable
class Features(Protocol):
    """What GPs see of a sample; a kernel of them is a kernel of the sample."""

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch features"]:
        """Of a payload sample `p, v, vec(R), omega, ...`."""
        ...

    def agent(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch features"]:
        """Of an agent's sample `vec(R), x, r, omega, v, r_dot`."""
        ...

    def payload_names(self) -> tuple[str, ...]:
        """Of the payload's, in order; one that begins with `omega`, `|omega|` or `r_dot` is a rate."""
        ...

    def agent_names(self, joints: int) -> tuple[str, ...]:
        """Of an agent's with so many joints."""
        ...


@pytree
class DefaultFeatures:
    """The paper's features: the payload's sample with its speeds, an agent's sample as it is."""

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 20"]:
        """`payload_features`."""
        return payload_features(x)

    def agent(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch inputs"]:
        """The sample."""
        return x

    def payload_names(self) -> tuple[str, ...]:
        """`PAYLOAD_FEATURES`."""
        return PAYLOAD_FEATURES

    def agent_names(self, joints: int) -> tuple[str, ...]:
        """`agent_feature_names`."""
        return agent_feature_names(joints)


BodyKey = tuple[int, int] | str
"""The payload, as "payload", or (group, agent)."""


def compute_features(seen: Features, body: BodyKey, x: np.ndarray) -> np.ndarray:
    """What GPs of a body see of its samples (host)."""
    return np.asarray(seen.payload(jnp.asarray(x)) if isinstance(body, str) else seen.agent(jnp.asarray(x)))
