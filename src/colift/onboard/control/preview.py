"""Attitude setpoint of an agent with rates from a preview of the reference.

The paper neglects the angular acceleration of the desired attitude and the rate of the predicted residual. With a
preview the control law is evaluated on the reference at five times around the current one. A quartic polynomial through
the commanded thrusts provides both quantities without differentiation of measurements.

See Also:
    docs/decisions/0031-preview-attitude-rates: alternatives and measured results.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentState, GeneralizedForce, PayloadState
from colift.onboard.control.attitude import attitude_trajectory, desired_thrust
from colift.onboard.control.redundancy import motion_with_tip_constraint
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand, point_acceleration

PREVIEW_STEP = 0.03
"""Default interval between two times of the preview [s].

The five times then extend over one time constant of the agents' attitude loop to either side, ``2 * 0.03 s = 0.06 s =
1 / sqrt(k_R)`` with ``k_R = 250 / s^2``. Shorter steps cause rounding errors; longer ones make the quartic inaccurate.
"""
PREVIEW_NODES = np.arange(-2.0, 3.0)
"""Times of the preview relative to the current one, in steps of the preview."""
PREVIEW_BASIS = [
    [[math.perm(k, order) * s ** max(k - order, 0) for k in range(5)] for s in PREVIEW_NODES] for order in range(3)
]
"""Derivatives of order 0 to 2 of the monomials of degree 0 to 4 at the nodes, in steps."""
FINITE_DIFFERENCE_WEIGHTS = np.array(PREVIEW_BASIS) @ np.linalg.inv(np.vander(PREVIEW_NODES, increasing=True))
"""Weights of the node values for value, first and second derivative of their quartic at each node, in steps."""


@pytree
class AgentPreview:
    """Control law evaluated on the reference for one agent; fields but `step` lead with the times of the preview."""

    step: Float[Array, ""]  # s, interval between two times
    payload: PayloadState  # on the reference
    acceleration_cmd: AccelerationCommand  # of the payload
    f: Float[Array, "times 3"]  # N, `attitude.desired_thrust`, world


def preview_attitude_setpoint(
    agent: AerialManipulator,
    gravity: Float[Array, "3"],
    q: AgentState,
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    setpoint: AgentSetpoint,
    f_hat: GeneralizedForce,
    preview: AgentPreview,
) -> AttitudeSetpoint:
    """Compute the attitude setpoint with angular velocity and acceleration from the preview.

    The third axis is along `m (x_dd - a_g) + sum lam - f_hat_x`. The center of mass of a rotating agent does not
    accelerate as its contacts do. The difference `m (x_dd - a_c)` is computed from the attitude without it. A quartic
    through the previewed thrusts provides their rates. They include the rate of `f_hat` and no measurement noise.

    Args:
        agent: Nominal parameters of one agent.
        gravity: Gravitational acceleration [m/s^2, world].
        q: Estimated state of the agent.
        payload: Estimated state of the payload.
        acceleration_cmd: Commanded payload acceleration at the current time.
        setpoint: Contact forces, heading and posture of the agent.
        f_hat: Predicted residual of the agent.
        preview: Control law on the reference around the current time.

    Returns:
        Attitude, angular velocity and angular acceleration.
    """
    m = agent.mass.sum()
    nominal = dataclasses.replace(q, r=setpoint.nominal_posture, r_dot=jnp.zeros_like(q.r_dot))
    g = aerial_manipulator.forward_kinematics(agent, nominal.r)
    p, current = aerial_manipulator.centroidal_model(agent, g), len(PREVIEW_NODES) // 2

    def com_relative_acceleration(
        f: Float[Array, "3 3"], payload: PayloadState, acceleration_cmd: AccelerationCommand
    ) -> Float[Array, "3"]:
        attitude = attitude_trajectory(f, setpoint.yaw)
        assert attitude.omega_dot is not None
        _, kappa = aerial_manipulator.bias_forces(agent, g, p, attitude.omega, nominal.r_dot)
        a_contact = point_acceleration(payload, acceleration_cmd, agent.contact_position).mean(0)
        free = jnp.concatenate([attitude.R.T @ a_contact, jnp.zeros_like(nominal.r)])
        y = motion_with_tip_constraint(agent, payload, acceleration_cmd, p, kappa, attitude.R, attitude.omega_dot, free)
        return attitude.R @ y[:3] - a_contact

    inertial_forces = m * jax.vmap(com_relative_acceleration)(
        _derivatives(preview.f, preview.step), preview.payload, preview.acceleration_cmd
    )
    f = desired_thrust(agent, gravity, payload, acceleration_cmd, setpoint.lam, f_hat.f_x) + inertial_forces[current]
    derivatives = _derivatives(preview.f + inertial_forces, preview.step)
    return attitude_trajectory(derivatives[current].at[0].set(f), setpoint.yaw)


def _derivatives(values: Float[Array, "times 3"], step: Float[Array, ""]) -> Float[Array, "times 3 3"]:
    """Return value, first and second derivative at the nodes of the quartic through values there; step in s."""
    return jnp.stack([jnp.asarray(rate) @ values / step**k for k, rate in enumerate(FINITE_DIFFERENCE_WEIGHTS)], axis=1)
