"""Motion of one agent with its tips on the payload, and posture control of redundant joints.

An agent with n arms and n_r joints is redundant if `n_r > 3 n - 3`: tips and attitude do not determine its joints.
The posture control returns these joints to the nominal posture. Joint motion with fixed tips moves the center of mass,
so the posture control tilts the thrust accordingly.

In this module `B` is the Jacobian of the tip positions relative to the center of mass, `J` includes the motion of the
center of mass, and `H` is the inertia matrix of the joints.

See Also:
    docs/decisions/0055-posture-control-of-redundant-joints: alternatives and measured results.
    docs/decisions/0052-stability-limits-of-residual-compensation: joints that are not controlled.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import linalg, so3
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentState, GeneralizedForce, PayloadState
from colift.onboard.control.attitude import attitude_from_thrust
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand, Gains, point_acceleration

# Inverse weights of the center of mass in `_closest_motion`, by base axis, relative to 1 rad^2 of a joint: m^2.
INVERSE_WEIGHTS_NONREDUNDANT = np.ones(3)
"""Inverse weights [m^2] for an agent without redundant joints, where they have no effect."""
INVERSE_WEIGHTS_THRUST = np.array([1e-4, 1e-4, 1e2])
"""Inverse weights [m^2] for a redundant agent, whose thrust changes in size at once, but in direction by rotation."""
INVERSE_WEIGHTS_POSTURE = np.full(3, 1e2)
"""Inverse weights [m^2] for a posture motion, which the center of mass follows."""
MOBILITY_REGULARIZATION = 1e-12
"""Regularization of `B H^-1 B^T` relative to its trace, for tips that joints cannot move in all directions."""
POSTURE_DAMPING = 0.8
"""Damping ratio of the posture control. Delay of the loop increases the effective damping, so it stays below 1."""


def is_redundant(agent: AerialManipulator) -> bool:
    """Return whether tips and attitude leave joints undetermined, `n_r > 3 n - 3`."""
    return agent.tree.joints > 3 * agent.tree.arms - 3


def has_uncontrolled_joints(agent: AerialManipulator) -> bool:
    """Return whether joints can move with tips and center of mass at rest, `n_r > 3 n`."""
    return agent.tree.joints > 3 * agent.tree.arms


def motion_with_tip_constraint(
    agent: AerialManipulator,
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    p: aerial_manipulator.CentroidalModel,
    kappa: Float[Array, "arms 3"],
    R: Float[Array, "3 3"],
    omega_dot: Float[Array, "3"],
    free: Float[Array, "motion"],
) -> Float[Array, "motion"]:
    """Compute the accelerations of center of mass and joints that keep the tips on the payload.

    `R^T x_dd + B xi_dot + kappa = R^T (a + R_L (alpha x c + w x (w x c)))` with `xi = (omega, r_dot)`. The solution
    closest to `free` is taken where it is not unique.

    Args:
        agent: Nominal parameters of one agent.
        payload: Estimated state of the payload.
        acceleration_cmd: Payload acceleration that the tips follow.
        p: Centroidal model of the agent.
        kappa: Velocity-dependent tip accelerations [m/s^2, body frame].
        R: Attitude of the agent, body to world.
        omega_dot: Angular acceleration of the agent [rad/s^2, body frame].
        free: Desired `(R^T x_dd, r_dd)` [m/s^2 body frame, rad/s^2 or m/s^2].

    Returns:
        `(R^T x_dd, r_dd)`, in the units of `free`.
    """
    contact = point_acceleration(payload, acceleration_cmd, agent.contact_position)
    target = contact @ R - kappa - (p.J_tip[:, :, :3] * omega_dot[None, None]).sum(2)
    return _closest_motion(p, _inverse_weights(agent), free[:, None], target.reshape(-1, 1))[:, 0]


def tip_motion(
    agent: AerialManipulator, p: aerial_manipulator.CentroidalModel, tips: Float[Array, "arms 3"]
) -> Float[Array, "motion"]:
    """Compute the acceleration of center of mass and joints that accelerates the tips, with the attitude fixed.

    Args:
        agent: Nominal parameters of one agent.
        p: Centroidal model of the agent.
        tips: Accelerations of the tips [m/s^2, body frame].

    Returns:
        `(R^T x_dd, r_dd)` of least weighted norm [m/s^2 body frame, rad/s^2 or m/s^2].
    """
    zero = jnp.zeros((3 + agent.tree.joints, 1))
    return _closest_motion(p, _inverse_weights(agent), zero, tips.reshape(-1, 1))[:, 0]


def bound_directions(
    agent: AerialManipulator, p: aerial_manipulator.CentroidalModel, R: Float[Array, "3 3"]
) -> Float[Array, "3 3"]:
    """Compute the part of the tips' mean acceleration across the thrust that the center of mass has to follow.

    Let a uniform acceleration s of the tips cause the acceleration `W s` of the center of mass, with the attitude fixed
    and the weights of `motion_with_tip_constraint`. The result is `D = P R W R^T P` with `P = I - b_3 b_3^T`. An
    eigenvalue is 1 in a direction in which no joint moves the tips (a bound direction), and about 0 in a direction in
    which joints do. All directions across the thrust of a nonredundant agent are bound.

    Args:
        agent: Nominal parameters of one agent.
        p: Centroidal model of the agent.
        R: Attitude of the agent, body to world.

    Returns:
        Symmetric matrix D, world frame.
    """
    if not is_redundant(agent):
        return jnp.eye(3) - R[:, 2, None] * R[None, :, 2]
    uniform = jnp.tile(jnp.eye(3), (agent.tree.arms, 1))
    W = _closest_motion(p, INVERSE_WEIGHTS_THRUST, jnp.zeros((3 + agent.tree.joints, 3)), uniform)[:2, :2]
    return R[:, :2] @ W @ R[:, :2].T


def uncontrolled_joint_acceleration(
    agent: AerialManipulator, p: aerial_manipulator.CentroidalModel, f_r: Float[Array, "n_r"]
) -> Float[Array, "n_r"]:
    """Compute the part of the acceleration by joint torques that moves neither tips nor center of mass.

    `z = H^-1 (f_r - B^T (B H^-1 B^T)^-1 B H^-1 f_r)`, so that `B z = 0`. Only light links move this way, and the
    posture control returns them with a small stiffness `H k^2`. An error of the learned joint torques would therefore
    deflect them by radians, so these torques are not compensated. Joints with parallel axes move a tip in a plane
    only; `B H^-1 B^T` is regularized for the remaining direction.

    Args:
        agent: Nominal parameters of one agent.
        p: Centroidal model of the agent.
        f_r: Predicted residual joint torques or forces [N m or N].

    Returns:
        Joint acceleration z [rad/s^2 or m/s^2].
    """
    B, H = p.J_tip[:, :, 3:].reshape(3 * agent.tree.arms, -1), p.M_bar[3:, 3:]
    accelerations = linalg.solve(H, jnp.concatenate([B.T, f_r[:, None]], axis=1))
    by_tips, by_torque = accelerations[:, :-1], accelerations[:, -1]
    A = B @ by_tips
    A = A + MOBILITY_REGULARIZATION * jnp.trace(A) * jnp.eye(len(A))  # a planar arm moves its tip in a plane
    return by_torque - by_tips @ linalg.solve(A, (B @ by_torque)[:, None])[:, 0]


def rotation_about_tips(agent: AerialManipulator, p: aerial_manipulator.CentroidalModel) -> Float[Array, "motion 3"]:
    """Compute the motion of center of mass and joints per rotation of an agent with fixed tips.

    Args:
        agent: Nominal parameters of one agent.
        p: Centroidal model of the agent.

    Returns:
        Derivative of `(R^T x, r)` with respect to the rotation vector of the base [m/rad, and rad or m per rad].
    """
    return _closest_motion(
        p, _inverse_weights(agent), jnp.zeros((3 + agent.tree.joints, 3)), -p.J_tip[:, :, :3].reshape(-1, 3)
    )


def posture_tilt_jacobian(agent: AerialManipulator, p: aerial_manipulator.CentroidalModel) -> Float[Array, "n_r 3"]:
    """Compute the joint motion per rotation of an agent with fixed tips and least motion of its center of mass.

    Args:
        agent: Nominal parameters of one agent.
        p: Centroidal model of the agent.

    Returns:
        Derivative of the joint positions with respect to the rotation vector of the base [rad or m per rad].
    """
    return rotation_about_tips(agent, p)[3:]


def posture_control(
    agent: AerialManipulator,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    a_contact: Float[Array, "3"],
    setpoint: AgentSetpoint,
    f_hat: GeneralizedForce,
    p: aerial_manipulator.CentroidalModel,
    attitude: AttitudeSetpoint,
) -> tuple[AttitudeSetpoint, Float[Array, "motion"]]:
    """Tilt the attitude setpoint for the posture control, and compute the desired motion of a redundant agent.

    The joint law is `r_dd = -k^2 e - 2 d k e_dot` with `e = r - r_nominal - r_tilt` and the damping ratio `d`. The
    joints `r_tilt` hold the center of mass in place while the agent is off its attitude setpoint. With fixed tips this
    motion accelerates the center of mass by `x_dd`. The attitude is tilted for the force `f + m x_dd` and its rate.
    The joints move only as far as the present thrust allows, so the contact forces stay as commanded.

    The error `r - r_nominal` without `r_tilt` is not controlled directly: the pendulum motion about the tips would be a
    zero in the right half plane.

    Args:
        agent: Nominal parameters of one agent.
        gains: Feedback gains.
        gravity: Gravitational acceleration [m/s^2, world].
        q: Estimated state of the agent.
        a_contact: Commanded mean acceleration of the contacts [m/s^2, world].
        setpoint: Contact forces, heading and nominal posture.
        f_hat: Predicted residual of the agent.
        p: Centroidal model of the agent.
        attitude: Attitude setpoint without the posture control.

    Returns:
        The tilted attitude setpoint, and the desired `(R^T x_dd, r_dd)` [m/s^2 body frame, rad/s^2 or m/s^2].
    """
    k, m = gains.posture_bandwidth, p.mass
    error = jnp.stack([so3.e_R(q.R, attitude.R), so3.e_omega(q.R, q.omega, attitude.R, attitude.omega)], axis=1)
    zero = jnp.zeros((3 + agent.tree.joints, 2))
    tilt = posture_tilt_jacobian(agent, p) @ error
    e, e_dot = q.r - setpoint.nominal_posture - tilt[:, 0], q.r_dot - tilt[:, 1]
    r_dd = -(k**2) * e - 2 * POSTURE_DAMPING * k * e_dot
    a = q.R.T @ a_contact
    without_thrust = q.R.T @ (gravity + (f_hat.f_x - setpoint.lam.sum(0)) / m)  # acceleration by the other forces
    x_dd = jnp.concatenate([without_thrust[:2], a[2:]])
    fixed = jnp.zeros((3 * agent.tree.arms, 1))
    e_dd = _closest_motion(p, INVERSE_WEIGHTS_THRUST, jnp.concatenate([x_dd - a, r_dd])[:, None], fixed)[3:, 0]
    posture = zero.at[3:].set(jnp.stack([r_dd, -(k**2) * e_dot - 2 * POSTURE_DAMPING * k * e_dd], axis=1))
    tilting_force = m * q.R @ _closest_motion(p, INVERSE_WEIGHTS_POSTURE, posture, jnp.tile(fixed, (1, 2)))[:3]
    thrust = (m * (a_contact - gravity) + setpoint.lam.sum(0) - f_hat.f_x) @ attitude.R[:, 2]
    f = thrust * attitude.R[:, 2]
    f_dot = thrust * attitude.R @ so3.cross(attitude.omega, jnp.asarray(aerial_manipulator.E3))
    R, R_dot = jax.jvp(
        lambda f: attitude_from_thrust(f, setpoint.yaw), (f + tilting_force[:, 0],), (f_dot + tilting_force[:, 1],)
    )
    return dataclasses.replace(attitude, R=R, omega=so3.vee(R.T @ R_dot)), jnp.concatenate([x_dd, r_dd])


def _inverse_weights(agent: AerialManipulator) -> np.ndarray:
    """Return the inverse weights of the center of mass while the tips follow the payload."""
    return INVERSE_WEIGHTS_THRUST if is_redundant(agent) else INVERSE_WEIGHTS_NONREDUNDANT


def _closest_motion(
    p: aerial_manipulator.CentroidalModel,
    inverse_weights: np.ndarray,
    free: Float[Array, "motion k"],
    tips: Float[Array, "forces k"],
) -> Float[Array, "motion k"]:
    """Compute the motion `(R^T x, r)` closest to `free` that moves the tips by `tips` (weighted least squares).

    `y = free + S J^T (J S J^T)^-1 (tips - J free)` with S the diagonal matrix of the inverse weights, 1 for joints.

    Returns:
        The motion y, in the units of `free`.
    """
    n, joints = p.J_tip.shape[0], free.shape[0] - 3
    J = jnp.concatenate([jnp.tile(jnp.eye(3), (n, 1)), p.J_tip[:, :, 3:].reshape(3 * n, joints)], axis=1)
    S_JT = np.concatenate([inverse_weights, np.ones(joints)])[:, None] * J.T
    return free + S_JT @ linalg.solve(J @ S_JT, tips - J @ free)
