"""The equations of motion, backwards: what must act on payload and agents for them to accelerate in a certain way.

Labels, commands and the residuals of a log are all read off here: known forces on one side, the rest on the other.
"""

from __future__ import annotations

from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import apply
from colift.models import aerial_manipulator
from colift.models.parameters import Agent, Payload
from colift.models.state import AgentState, Wrench


def payload(load: Payload, specific: Float[Array, "3"], alpha: Float[Array, "3"], omega: Float[Array, "3"]) -> Wrench:
    """`F = m_L (v_dot - a_g)`, `tau = J_L w_dot + w x J_L w` (Eq. dae_payload): all that acts besides gravity.

    specific: `v_dot - a_g`, m/s^2, world; alpha: `w_dot`, rad/s^2, and omega, rad/s, payload frame.
    """
    J = load.inertia
    return Wrench(F=load.mass * specific, tau=apply(J, alpha) + so3.cross(omega, apply(J, omega)))


def agent(
    agent: Agent,
    q: AgentState,
    specific: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
) -> tuple[Float[Array, "3"], Float[Array, "xi"], Float[Array, "xi"]]:
    """`m (v_dot - a_g) + sum lam`, world, and `M_bar xi_dot + h + sum B_b^T R^T lam_b` (Eq. dae_agent_*).

    Thrust and torques give `u R e_3` and `u B_0^T e_3 + (tau, tau_r)` of it, the unknown the rest; third, `B_0^T e_3`.
    specific: `v_dot - a_g`, m/s^2, world; lam: N, on the payload, world.
    """
    g = aerial_manipulator.geometry(agent, q.r)
    p = aerial_manipulator.reduce(agent, g)
    h, _ = aerial_manipulator.bias(agent, g, p, q.omega, q.r_dot)
    return forces(p, h, q, specific, xi_dot, lam)


def forces(
    p: aerial_manipulator.Reduced,
    h: Float[Array, "xi"],
    q: AgentState,
    specific: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
) -> tuple[Float[Array, "3"], Float[Array, "xi"], Float[Array, "xi"]]:
    """As `agent`, where the reduced model p and the bias h are known already."""
    pull = (lam @ q.R).reshape(-1) @ p.tip.reshape(3 * lam.shape[0], -1)
    return p.mass * specific + lam.sum(0), p.M_bar @ xi_dot + h + pull, p.base[2]
