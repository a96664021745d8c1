"""Attitude setpoint of an agent from its commanded thrust direction and heading."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.models.parameters import AerialManipulator
from colift.models.state import GeneralizedForce, PayloadState
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand, point_acceleration, point_jerk


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


def desired_thrust(
    agent: AerialManipulator,
    gravity: Float[Array, "3"],
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    lam: Float[Array, "arms 3"],
    f_x: Float[Array, "3"],
) -> Float[Array, "3"]:
    """Compute the thrust vector with which an agent follows its contacts and applies its contact forces.

    `f_dir = m (a_c - a_g) + sum lam - f_hat_x`. The paper uses the payload acceleration `a_cmd`; the mean acceleration
    `a_c = a_cmd + R_L (alpha_cmd x c + w x (w x c))` of the contacts adds the rotation of the payload (docs/errata).

    Args:
        agent: Nominal parameters of one agent.
        gravity: Gravitational acceleration [m/s^2, world].
        payload: Estimated state of the payload.
        acceleration_cmd: Commanded payload acceleration.
        lam: Commanded contact forces on the payload [N, world].
        f_x: Predicted residual force on the center of mass [N, world].

    Returns:
        Thrust vector [N, world].
    """
    a = point_acceleration(payload, acceleration_cmd, agent.contact_position).mean(0)
    return agent.mass.sum() * (a - gravity) + lam.sum(0) - f_x


def thrust_attitude_setpoint(
    agent: AerialManipulator,
    gravity: Float[Array, "3"],
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    setpoint: AgentSetpoint,
    f_hat: GeneralizedForce,
) -> AttitudeSetpoint:
    """Compute the attitude setpoint of the paper, for an agent that rotates with the payload.

    The third axis is along `f_dir` (`desired_thrust`). Its angular velocity follows from the commanded jerk of the
    contacts and from `lam_dot`. The rate of `f_hat` and the angular acceleration are neglected.

    Args:
        agent: Nominal parameters of one agent.
        gravity: Gravitational acceleration [m/s^2, world].
        payload: Estimated state of the payload.
        acceleration_cmd: Commanded payload acceleration.
        setpoint: Contact forces and heading of the agent.
        f_hat: Predicted residual of the agent.

    Returns:
        Attitude and angular velocity.
    """
    f = desired_thrust(agent, gravity, payload, acceleration_cmd, setpoint.lam, f_hat.f_x)
    jerk = point_jerk(payload, acceleration_cmd, agent.contact_position).mean(0)
    f_dot = agent.mass.sum() * jerk + setpoint.lam_dot.sum(0)
    R, R_dot = jax.jvp(lambda f: attitude_from_thrust(f, setpoint.yaw), (f,), (f_dot,))
    return AttitudeSetpoint(f=f, R=R, omega=so3.vee(R.T @ R_dot))


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
    return AttitudeSetpoint(f=f[0], R=R, omega=so3.vee(R.T @ R_1), omega_dot=so3.vee(R_1.T @ R_1 + R.T @ R_2))
