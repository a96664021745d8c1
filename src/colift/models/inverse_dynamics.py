"""The equations of motion, backwards: what must act on payload and agents for them to accelerate in a certain way.

Labels, commands and the residuals of a log are all read off here: known forces on one side, the rest on the other.
"""

from __future__ import annotations

from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matvec
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Payload
from colift.models.state import AgentState, Wrench


def payload_inverse_dynamics(
    payload_model: Payload, specific: Float[Array, "3"], alpha: Float[Array, "3"], omega: Float[Array, "3"]
) -> Wrench:
    """`F = m_L (v_dot - a_g)`, `tau = J_L w_dot + w x J_L w` (Eq. dae_payload): all that acts besides gravity.

    specific: `v_dot - a_g`, m/s^2, world; alpha: `w_dot`, rad/s^2, and omega, rad/s, payload frame.
    """
    J = payload_model.inertia
    return Wrench(F=payload_model.mass * specific, tau=matvec(J, alpha) + so3.cross(omega, matvec(J, omega)))


def agent_inverse_dynamics(
    agent: AerialManipulator,
    q: AgentState,
    specific: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
) -> tuple[Float[Array, "3"], Float[Array, "xi"], Float[Array, "xi"]]:
    """`m (v_dot - a_g) + sum lam`, world, and `M_bar xi_dot + h + sum B_b^T R^T lam_b` (Eq. dae_agent_*).

    Thrust and torques give `u R e_3` and `u B_0^T e_3 + (tau, tau_r)` of it, the unknown the rest; third, `B_0^T e_3`.
    specific: `v_dot - a_g`, m/s^2, world; lam: N, on the payload, world.
    """
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    p = aerial_manipulator.centroidal_model(agent, g)
    h, _ = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
    return agent_inverse_dynamics_reduced(p, h, q, specific, xi_dot, lam)


def agent_inverse_dynamics_reduced(
    p: aerial_manipulator.CentroidalModel,
    h: Float[Array, "xi"],
    q: AgentState,
    specific: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
) -> tuple[Float[Array, "3"], Float[Array, "xi"], Float[Array, "xi"]]:
    """As `agent`, where the reduced model p and the bias h are known already."""
    pull = (lam @ q.R).reshape(-1) @ p.J_tip.reshape(3 * lam.shape[0], -1)
    return p.mass * specific + lam.sum(0), p.M_bar @ xi_dot + h + pull, p.J_base[2]
