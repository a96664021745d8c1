"""Input features of the Gaussian processes of payload and agents.

Data sets store the filtered inputs without features. A change of the features therefore needs no new data. A features
object maps the input of the payload or of an agent to the input of its Gaussian process (GP).

See Also:
    colift.models.state.flatten_payload_state, colift.models.state.flatten_agent_state: the inputs and their order.
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
"""Names of the paper's payload features, in order."""


def agent_feature_names(joints: int) -> tuple[str, ...]:
    """Return the names of the agent features, in order.

    Args:
        joints: Number of joints of the agent.

    Returns:
        One name for each component of the agent input.
    """
    return (
        *(f"R_{i}{j}" for i in "xyz" for j in "xyz"),
        *("x_x", "x_y", "x_z"),
        *(f"r_{k + 1}" for k in range(joints)),
        *("omega_x", "omega_y", "omega_z", "v_x", "v_y", "v_z"),
        *(f"r_dot_{k + 1}" for k in range(joints)),
    )


def payload_features(x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 20"]:
    """Compute the paper's payload features ``p, v, vec(R), omega, |v|, |omega|`` (docs/errata.md, row 9).

    Args:
        x: Payload inputs in the order of `colift.models.state.flatten_payload_state` [m, m/s, rad/s].

    Returns:
        Features in the order of `PAYLOAD_FEATURES`.
    """
    v, omega = x[..., 3:6], x[..., 15:18]
    speeds = [jnp.sqrt((a * a).sum(-1, keepdims=True) + 1e-12) for a in (v, omega)]  # differentiable at rest
    return jnp.concatenate([x[..., :18], *speeds], axis=-1)


@runtime_checkable
class Features(Protocol):
    """Protocol of the maps from inputs to GP features.

    A kernel of the features is also a kernel of the inputs, so every map gives a valid GP.
    """

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch features"]:
        """Compute the features of payload inputs ``p, v, vec(R), omega, ...``."""
        ...

    def agent(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch features"]:
        """Compute the features of agent inputs ``vec(R), x, r, omega, v, r_dot``."""
        ...

    def payload_names(self) -> tuple[str, ...]:
        """Return the names of the payload features, in order.

        A name that begins with ``omega``, ``|omega|`` or ``r_dot`` marks a rate.
        """
        ...

    def agent_names(self, joints: int) -> tuple[str, ...]:
        """Return the names of the features of an agent with the given number of joints, in order."""
        ...


@pytree
class DefaultFeatures:
    """Features of the paper: payload inputs with both speeds, agent inputs without change."""

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 20"]:
        """Return `payload_features` of the inputs."""
        return payload_features(x)

    def agent(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch inputs"]:
        """Return the inputs."""
        return x

    def payload_names(self) -> tuple[str, ...]:
        """Return `PAYLOAD_FEATURES`."""
        return PAYLOAD_FEATURES

    def agent_names(self, joints: int) -> tuple[str, ...]:
        """Return `agent_feature_names`."""
        return agent_feature_names(joints)


BATCH_ROWS = 128
"""Row multiple to which sample arrays are padded on the host, so that few shapes have to be compiled."""

BodyKey = tuple[int, int] | str
"""Key of a body: ``"payload"``, or ``(group, agent)``."""


def compute_features(features: Features, body: BodyKey, x: np.ndarray) -> np.ndarray:
    """Compute the GP features of the samples of one body, on the host.

    Args:
        features: Feature maps.
        body: Key of the body.
        x: Inputs of the body, samples first.

    Returns:
        Features, samples first.
    """
    padded = jnp.asarray(pad_rows(x))
    return np.asarray(features.payload(padded) if isinstance(body, str) else features.agent(padded))[: len(x)]


def pad_rows(x: np.ndarray, multiple: int = BATCH_ROWS) -> np.ndarray:
    """Repeat the first row of an array until its number of rows is a multiple.

    Args:
        x: Samples, first axis; an array without samples is unchanged.
        multiple: Multiple.

    Returns:
        The padded array, which begins with the samples.
    """
    return np.concatenate([x, np.repeat(x[:1], -len(x) % multiple, 0)])
