"""What flies: the leader's wrench on SE(3), and how each agent realizes its contact forces."""

from __future__ import annotations

from jaxtyping import Array, Float

from colift.math.pytree import pytree


@pytree
class AgentSetpoint:
    """What one agent is asked for."""

    lam: Float[Array, "*agents arms 3"]  # N, commanded contact forces on the payload, world
    lam_dot: Float[Array, "*agents arms 3"]  # N/s, their rate, for the attitude's feed-forward
    yaw: Float[Array, "*agents"]  # rad
    nominal_posture: Float[Array, "*agents n_r"]  # joints of the posture task


@pytree
class AttitudeSetpoint:
    """The attitude that an agent is to have, and how it turns."""

    R: Float[Array, "*agents 3 3"]  # its third axis along the thrust
    omega: Float[Array, "*agents 3"]  # rad/s, in its own frame
    omega_dot: Float[Array, "*agents 3"] | None = None  # rad/s^2, in its own frame; None where it is neglected
