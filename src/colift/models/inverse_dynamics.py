"""Inverse dynamics: forces on payload and agents for given accelerations.

Labels, commands and the residuals of a log are differences between these forces and the known ones.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matvec
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Payload
from colift.models.state import AgentState, Wrench


def payload_inverse_dynamics(
    payload_model: Payload, specific_force: Float[Array, "3"], alpha: Float[Array, "3"], omega: Float[Array, "3"]
) -> Wrench:
    """Compute the wrench of all forces on the payload except gravity (Eq. dae_payload).

    `F = m_L (v_dot - a_g)`, `tau = J_L w_dot + w x J_L w`.

    Args:
        payload_model: Parameters of the payload.
        specific_force: `v_dot - a_g`, world frame [m/s^2].
        alpha: Angular acceleration `w_dot`, payload frame [rad/s^2].
        omega: Angular velocity `w`, payload frame [rad/s].

    Returns:
        The wrench [N, N m].
    """
    J = payload_model.inertia
    return Wrench(F=payload_model.mass * specific_force, tau=matvec(J, alpha) + so3.cross(omega, matvec(J, omega)))


def agent_inverse_dynamics(
    agent: AerialManipulator,
    q: AgentState,
    specific_force: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
) -> tuple[Float[Array, "3"], Float[Array, "xi"], Float[Array, "xi"]]:
    """Compute the generalized forces of inputs and residual on an agent (Eq. dae_agent_*).

    The forces are `m (v_dot - a_g) + sum lam_b` on the center of mass and
    `M_bar xi_dot + h + sum B_b^T R^T lam_b` on `(mu, nu)`. The inputs contribute `u R e_3` and
    `u B_0^T e_3 + (tau, tau_r)`; the remainder is the residual.

    Args:
        agent: Parameters of the agent.
        q: State of the agent.
        specific_force: `v_dot - a_g` of the center of mass, world frame [m/s^2].
        xi_dot: `(w_dot, r_ddot)`, body frame [rad/s^2, m/s^2].
        lam: Contact forces on the payload, world frame [N].

    Returns:
        The force on the center of mass, world frame [N]; the force on `(mu, nu)` [N m, N]; and `B_0^T e_3`, the
        direction of the thrust in `(mu, nu)` [m].
    """
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    p = aerial_manipulator.centroidal_model(agent, g)
    h, _ = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
    return agent_inverse_dynamics_reduced(p, h, q, specific_force, xi_dot, lam)


def contact_moment_load(
    agent: AerialManipulator, p: aerial_manipulator.CentroidalModel, moments: Float[Array, "arms 3"]
) -> Float[Array, "xi"]:
    """Compute the generalized force on `(mu, nu)` that balances contact moments on the payload, `sum W_b^T m_b`.

    `W_b` is the angular velocity of tip body b per xi.

    Args:
        agent: Parameters of the agent.
        p: Model of the agent at its joint positions.
        moments: Contact moments on the payload, base frame [N m].

    Returns:
        The generalized force [N m, N].
    """
    return (p.J_angular[np.array(agent.tree.tip_bodies)] * moments[:, :, None]).sum((0, 1))


def agent_inverse_dynamics_reduced(
    p: aerial_manipulator.CentroidalModel,
    h: Float[Array, "xi"],
    q: AgentState,
    specific_force: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
) -> tuple[Float[Array, "3"], Float[Array, "xi"], Float[Array, "xi"]]:
    """Compute `agent_inverse_dynamics` from an evaluated model.

    Args:
        p: Model of the agent at its joint positions.
        h: Bias forces on `(mu, nu)` [N m, N].
        q: State of the agent.
        specific_force: `v_dot - a_g` of the center of mass, world frame [m/s^2].
        xi_dot: `(w_dot, r_ddot)`, body frame [rad/s^2, m/s^2].
        lam: Contact forces on the payload, world frame [N].

    Returns:
        The results of `agent_inverse_dynamics`.
    """
    contact = (lam @ q.R).reshape(-1) @ p.J_tip.reshape(3 * lam.shape[0], -1)
    return p.mass * specific_force + lam.sum(0), p.M_bar @ xi_dot + h + contact, p.J_base[2]
