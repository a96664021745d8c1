"""What flies: the leader's wrench on SE(3), and how each agent realizes its contact forces."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift import agent as ag
from colift import balance, linalg, so3
from colift.model import Agent, AgentForce, AgentInput, AgentState, Payload, PayloadState, Wrench
from colift.pytree import pytree
from colift.reference import Setpoint


@pytree
class Gains:
    """Feedback gains. Rotational ones multiply the inertia, so error dynamics are free of it (errata, row 6)."""

    K_p: Float[Array, "3 3"]  # 1/s^2
    K_v: Float[Array, "3 3"]  # 1/s
    k_R: Float[Array, ""]  # 1/s^2, K_R = k_R J_L
    k_omega: Float[Array, ""]  # 1/s, K_omega = k_omega J_L
    agent_k_R: Float[Array, ""]  # 1/s^2
    agent_k_omega: Float[Array, ""]  # 1/s
    posture: Float[Array, ""]  # 1/s, rate of the posture task where joints are redundant


@pytree
class Command:
    """How the leader wants the payload to accelerate."""

    a: Float[Array, "3"]  # m/s^2, world
    alpha: Float[Array, "3"]  # rad/s^2, payload frame
    jerk: Float[Array, "3"]  # m/s^3, rate of a


def command(gains: Gains, q: PayloadState, a: Float[Array, "3"], d: Setpoint) -> Command:
    """Geometric tracking on SE(3), as accelerations.

    `a_cmd = v_d_dot - K_p e_p - K_v e_v`, `alpha_cmd = -k_R e_R - k_w e_w - (w x R^T R_d w_d - R^T R_d w_d_dot)`.
    `a` is the measured payload acceleration; it shapes only `jerk = j_d - K_p e_v - K_v (a - a_d)`.
    """
    e_v = q.v - d.v
    to_body = q.R.T @ d.R
    carried = so3.cross(q.omega, to_body @ d.omega) - to_body @ d.omega_dot
    turn = gains.k_R * so3.e_R(q.R, d.R) + gains.k_omega * so3.e_omega(q.R, q.omega, d.R, d.omega)
    return Command(
        a=d.a - gains.K_p @ (q.p - d.p) - gains.K_v @ e_v,
        alpha=-turn - carried,
        jerk=d.j - gains.K_p @ e_v - gains.K_v @ (a - d.a),
    )


def wrench(payload: Payload, gravity: Float[Array, "3"], q: PayloadState, to: Command, f_hat: Wrench) -> Wrench:
    """The desired payload wrench (Eq. payload_force_cmd_learning, payload_torque_cmd_learning).

    `F = m_L a_cmd - f_g - f_hat_p`, `tau = J_L alpha_cmd + w x J_L w - f_hat_w`; with `K_R = k_R J_L`,
    `K_omega = k_w J_L` these are the paper's.
    """
    W = balance.payload(payload, to.a - gravity, to.alpha, q.omega)
    return Wrench(F=W.F - f_hat.F, tau=W.tau - f_hat.tau)


def attitude(f: Float[Array, "3"], heading: Float[Array, ""]) -> Float[Array, "3 3"]:
    """The attitude whose third axis is along f and whose first lies over the heading, rad."""
    b3 = f / jnp.sqrt((f * f).sum())
    b2 = so3.cross(b3, jnp.stack([jnp.cos(heading), jnp.sin(heading), jnp.zeros_like(heading)]))
    b2 = b2 / jnp.sqrt((b2 * b2).sum())
    return jnp.stack([so3.cross(b2, b3), b2, b3], axis=1)


@pytree
class Share:
    """What one agent is asked for."""

    lam: Float[Array, "*agents arms 3"]  # N, commanded contact forces on the payload, world
    lam_dot: Float[Array, "*agents arms 3"]  # N/s, their rate, for the attitude's feed-forward
    heading: Float[Array, "*agents"]  # rad
    rest: Float[Array, "*agents n_r"]  # joints of the posture task


def realize(
    agent: Agent,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    load: PayloadState,
    to: Command,
    share: Share,
    f_hat: AgentForce,
) -> AgentInput:
    """Thrust and torques that put `lam` on the payload if the thrust is aligned and the payload obeys.

    1. thrust direction `f_dir = m (a_cmd - a_g) + sum lam - f_hat_x`, which with the heading is `R_d`;
    2. `omega_dot = -k_R e_R - k_w e_w` towards it, its rate from `jerk` and `lam_dot` (its acceleration is neglected);
    3. `(x_dd, r_dd)` that keep the tips on the payload commanded to accelerate by `(a, alpha)`;
    4. `u = f_des . R e_3` with `f_des = m (x_dd - a_g) + sum lam - f_hat_x`, torques by inverse dynamics.

    The command is not limited here: a limit is the vehicle's, and is reported where it acts.
    """
    g = ag.geometry(agent, q.r)
    p = ag.reduce(agent, g)
    h, kappa = ag.bias(agent, g, p, q.omega, q.r_dot)
    xi_dot, x_dd = _motion(agent, gains, gravity, q, load, to, share, f_hat, p, kappa)
    f_des, Q, thrust = balance.forces(p, h, q, x_dd - gravity, xi_dot, share.lam)
    u = ((f_des - f_hat.f_x) * q.R[:, 2]).sum()
    Q = Q - u * thrust
    return AgentInput(u=u, tau=Q[:3] - f_hat.f_w, tau_r=Q[3:] - f_hat.f_r)


def _motion(
    agent: Agent,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    load: PayloadState,
    to: Command,
    share: Share,
    f_hat: AgentForce,
    p: ag.Reduced,
    kappa: Float[Array, "arms 3"],
) -> tuple[Float[Array, "xi"], Float[Array, "3"]]:
    """Steps 1 to 3 of `realize`: `(xi_dot, x_dd)`."""
    f_dir = p.mass * (to.a - gravity) + share.lam.sum(0) - f_hat.f_x
    f_dot = p.mass * to.jerk + share.lam_dot.sum(0)
    R_d, R_d_dot = jax.jvp(lambda f: attitude(f, share.heading), (f_dir,), (f_dot,))
    omega_d = so3.vee(R_d.T @ R_d_dot)
    omega_dot = -gains.agent_k_R * so3.e_R(q.R, R_d) - gains.agent_k_omega * so3.e_omega(q.R, q.omega, R_d, omega_d)
    # tips follow the payload: R^T x_dd + B xi_dot + kappa = R^T (a + R_L (alpha x c + w x (w x c)))
    c = agent.contact
    carried = so3.cross(to.alpha[None], c) + so3.cross(load.omega[None], so3.cross(load.omega[None], c))
    target = (to.a[None] + carried @ load.R.T) @ q.R - kappa - (p.tip[:, :, :3] * omega_dot[None, None]).sum(2)
    n = c.shape[0]
    J = jnp.concatenate([jnp.tile(jnp.eye(3), (n, 1)), p.tip[:, :, 3:].reshape(3 * n, -1)], axis=1)
    posture = -(gains.posture**2) * (q.r - share.rest) - 2 * gains.posture * q.r_dot
    y = jnp.concatenate([jnp.zeros(3), posture])
    y = y + J.T @ linalg.solve(J @ J.T, (target.reshape(-1) - J @ y)[:, None])[:, 0]
    return jnp.concatenate([omega_dot, y[3:]]), q.R @ y[:3]
