"""Setpoints of the agent controllers."""

from __future__ import annotations

from jaxtyping import Array, Float

from colift.math.pytree import pytree


@pytree
class AgentSetpoint:
    """Setpoint of one agent, or of a group of agents on a leading axis."""

    lam: Float[Array, "*agents arms 3"]  # N, commanded contact forces on the payload, world
    lam_dot: Float[Array, "*agents arms 3"]  # N/s, their rate, feedforward of the attitude, world
    yaw: Float[Array, "*agents"]  # rad, heading of the first body axis, world
    nominal_posture: Float[Array, "*agents n_r"]  # rad or m, joint positions of the posture control


@pytree
class AttitudeSetpoint:
    """Desired attitude of an agent and its derivatives."""

    f: Float[Array, "*agents 3"]  # N, desired thrust vector, world
    R: Float[Array, "*agents 3 3"]  # body to world, third axis along the desired thrust
    omega: Float[Array, "*agents 3"]  # rad/s, desired body frame
    omega_dot: Float[Array, "*agents 3"] | None = None  # rad/s^2, desired body frame; None where it is neglected
