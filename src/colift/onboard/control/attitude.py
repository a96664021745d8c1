"""Attitude setpoint of an agent from its commanded thrust direction and heading."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.models.parameters import AerialManipulator
from colift.models.state import GeneralizedForce
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand


def attitude_from_thrust(f: Float[Array, "3"], yaw: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Compute the attitude whose third axis is along a thrust and whose first axis has a given heading.

    Args:
        f: Thrust vector, not zero [N, world].
        yaw: Heading of the first axis [rad, world].

    Returns:
        Attitude, body to world.
    """
    b3 = f / jnp.sqrt((f * f).sum())
    b2 = so3.cross(b3, jnp.stack([jnp.cos(yaw), jnp.sin(yaw), jnp.zeros_like(yaw)]))
    b2 = b2 / jnp.sqrt((b2 * b2).sum())
    return jnp.stack([so3.cross(b2, b3), b2, b3], axis=1)


def thrust_attitude_setpoint(
    agent: AerialManipulator,
    gravity: Float[Array, "3"],
    acceleration_cmd: AccelerationCommand,
    setpoint: AgentSetpoint,
    f_hat: GeneralizedForce,
) -> AttitudeSetpoint:
    """Compute the attitude setpoint of the paper.

    The third axis is along `f_dir = m (a_cmd - a_g) + sum lam - f_hat_x`. Its angular velocity follows from `jerk` and
    `lam_dot`. The rate of `f_hat` and the angular acceleration are neglected.

    Args:
        agent: Nominal parameters of one agent.
        gravity: Gravitational acceleration [m/s^2, world].
        acceleration_cmd: Commanded payload acceleration.
        setpoint: Contact forces and heading of the agent.
        f_hat: Predicted residual of the agent.

    Returns:
        Attitude and angular velocity.
    """
    m = agent.mass.sum()
    f, f_dot = (
        m * (acceleration_cmd.a - gravity) + setpoint.lam.sum(0) - f_hat.f_x,
        m * acceleration_cmd.jerk + setpoint.lam_dot.sum(0),
    )
    R, R_dot = jax.jvp(lambda f: attitude_from_thrust(f, setpoint.yaw), (f,), (f_dot,))
    return AttitudeSetpoint(R=R, omega=so3.vee(R.T @ R_dot))


def attitude_trajectory(f: Float[Array, "3 3"], yaw: Float[Array, ""]) -> AttitudeSetpoint:
    """Compute the attitude and its derivatives for a thrust vector with known derivatives.

    Along `f(s) = f_0 + f_1 s + f_2 s^2 / 2` at s = 0: `omega = vee(R^T R')`, `omega_dot = vee(R'^T R' + R^T R'')`.

    Args:
        f: Rows: thrust vector and its first and second time derivative [N, N/s, N/s^2, world].
        yaw: Constant heading of the first axis [rad, world].

    Returns:
        Attitude, angular velocity and angular acceleration.
    """
    one = jnp.ones(())

    def rate(s: Float[Array, ""]) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
        return jax.jvp(lambda s: attitude_from_thrust(f[0] + s * (f[1] + s * f[2] / 2), yaw), (s,), (one,))

    (R, R_1), (_, R_2) = jax.jvp(rate, (jnp.zeros(()),), (one,))
    return AttitudeSetpoint(R=R, omega=so3.vee(R.T @ R_1), omega_dot=so3.vee(R_1.T @ R_1 + R.T @ R_2))
