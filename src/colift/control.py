"""What flies: the leader's wrench on SE(3), and how each agent realizes its contact forces."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
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
    posture: Float[Array, ""]  # 1/s, rate at which joints that contacts leave free return to rest


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


@pytree
class Turn:
    """The attitude that an agent is to have, and how it turns."""

    R: Float[Array, "*agents 3 3"]  # its third axis along the thrust
    omega: Float[Array, "*agents 3"]  # rad/s, in its own frame
    omega_dot: Float[Array, "*agents 3"] | None = None  # rad/s^2, in its own frame; None where it is neglected


def aligned(agent: Agent, gravity: Float[Array, "3"], to: Command, share: Share, f_hat: AgentForce) -> Turn:
    """The paper's: thrust along `f_dir = m (a_cmd - a_g) + sum lam - f_hat_x`, over the heading.

    Its rate is that of `jerk` and `lam_dot`; its acceleration is neglected, and so is the rate of f_hat.
    """
    m = agent.mass.sum()
    f, f_dot = m * (to.a - gravity) + share.lam.sum(0) - f_hat.f_x, m * to.jerk + share.lam_dot.sum(0)
    R, R_dot = jax.jvp(lambda f: attitude(f, share.heading), (f,), (f_dot,))
    return Turn(R=R, omega=so3.vee(R.T @ R_dot))


def turning(f: Float[Array, "3 3"], heading: Float[Array, ""]) -> Turn:
    """Along `f_0 + f_1 s + f_2 s^2 / 2` at s = 0: `omega = vee(R^T R')`, `omega_dot = vee(R'^T R' + R^T R'')`."""
    one = jnp.ones(())

    def rate(s: Float[Array, ""]) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
        return jax.jvp(lambda s: attitude(f[0] + s * (f[1] + s * f[2] / 2), heading), (s,), (one,))

    (R, R_1), (_, R_2) = jax.jvp(rate, (jnp.zeros(()),), (one,))
    return Turn(R=R, omega=so3.vee(R.T @ R_1), omega_dot=so3.vee(R_1.T @ R_1 + R.T @ R_2))


NODES = np.arange(-2.0, 3.0)  # of times around now, in steps
# At the nodes, of the quartic through values there: itself, its rate and its second rate, in steps.
QUARTIC = [[[math.perm(k, order) * s ** max(k - order, 0) for k in range(5)] for s in NODES] for order in range(3)]
RATES = np.array(QUARTIC) @ np.linalg.inv(np.vander(NODES, increasing=True))


@pytree
class Ahead:
    """What one agent is asked for where the law is evaluated on the reference, at `NODES` times the step."""

    step: Float[Array, ""]  # s
    load: PayloadState  # times lead
    to: Command
    f: Float[Array, "times 3"]  # N, `m (a - a_g) + sum lam - f_hat_x`


def anticipated(
    agent: Agent,
    gravity: Float[Array, "3"],
    q: AgentState,
    to: Command,
    share: Share,
    f_hat: AgentForce,
    ahead: Ahead,
) -> Turn:
    """Thrust along `f_dir` with the swing of the agent about its tips, its rates from the reference ahead.

    `f_dir = m (x_dd - a_g) + sum lam - f_hat_x`: where an agent turns, its centre of mass does not accelerate as the
    payload does. f_dir is a quartic through five times around now, as the law asks on the reference, so its rates hold
    that of f_hat and no noise. From the turn without the swing follows the swing, and from that the turn.
    """
    m = agent.mass.sum()
    still = dataclasses.replace(q, r=share.rest, r_dot=jnp.zeros_like(q.r_dot))
    g = ag.geometry(agent, still.r)
    reduced, now = ag.reduce(agent, g), len(NODES) // 2

    def swing(f: Float[Array, "3 3"], load: PayloadState, to: Command) -> Float[Array, "3"]:
        turn = turning(f, share.heading)
        assert turn.omega_dot is not None
        _, kappa = ag.bias(agent, g, reduced, turn.omega, still.r_dot)
        free = jnp.concatenate([turn.R.T @ to.a, jnp.zeros_like(still.r)])
        y = _with_tips(agent, load, to, reduced, kappa, turn.R, turn.omega_dot, free)
        return turn.R @ y[:3] - to.a

    swings = m * jax.vmap(swing)(_rates(ahead.f, ahead.step), ahead.load, ahead.to)
    f = m * (to.a - gravity) + share.lam.sum(0) - f_hat.f_x + swings[now]
    return turning(_rates(ahead.f + swings, ahead.step)[now].at[0].set(f), share.heading)


def _rates(values: Float[Array, "times 3"], step: Float[Array, ""]) -> Float[Array, "times 3 3"]:
    """Of the quartic through values at the nodes: there, its value, rate and second rate; step: s."""
    return jnp.stack([jnp.asarray(rate) @ values / step**k for k, rate in enumerate(RATES)], axis=1)


def realize(
    agent: Agent,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    load: PayloadState,
    to: Command,
    share: Share,
    f_hat: AgentForce,
    turn: Turn,
) -> AgentInput:
    """Thrust and torques that put `lam` on the payload if the thrust is aligned and the payload obeys.

    1. the thrust's direction and the heading are the attitude of `turn`, leaned as the posture asks (`_leaned`);
    2. `omega_dot = -k_R e_R - k_w e_w` towards it, and its own `R^T R_d omega_d_dot - w x R^T R_d omega_d` if known;
    3. `(x_dd, r_dd)` that keep the tips on the payload commanded to accelerate by `(a, alpha)`; joints that move
       neither tips nor the centre of mass give way to f_hat (`_yielding`);
    4. `u = f_des . R e_3` with `f_des = m (x_dd - a_g) + sum lam - f_hat_x`, torques by inverse dynamics.

    The command is not limited here: a limit is the vehicle's, and is reported where it acts.
    """
    g = ag.geometry(agent, q.r)
    p = ag.reduce(agent, g)
    h, kappa = ag.bias(agent, g, p, q.omega, q.r_dot)
    free = jnp.zeros(3 + agent.tree.joints)
    if _beyond_need(agent):
        turn, free = _leaned(agent, gains, gravity, q, to, share, f_hat, p, turn)
    omega_dot = -gains.agent_k_R * so3.e_R(q.R, turn.R)
    omega_dot = omega_dot - gains.agent_k_omega * so3.e_omega(q.R, q.omega, turn.R, turn.omega)
    if turn.omega_dot is not None:
        to_body = q.R.T @ turn.R
        omega_dot = omega_dot + to_body @ turn.omega_dot - so3.cross(q.omega, to_body @ turn.omega)
    y = _with_tips(agent, load, to, p, kappa, q.R, omega_dot, free)
    if _inward(agent):
        y = y.at[3:].add(_yielding(agent, p, f_hat.f_r))
    f_des, Q, thrust = balance.forces(p, h, q, q.R @ y[:3] - gravity, jnp.concatenate([omega_dot, y[3:]]), share.lam)
    u = ((f_des - f_hat.f_x) * q.R[:, 2]).sum()
    Q = Q - u * thrust
    return AgentInput(u=u, tau=Q[:3] - f_hat.f_w, tau_r=Q[3:] - f_hat.f_r)


def _with_tips(
    agent: Agent,
    load: PayloadState,
    to: Command,
    p: ag.Reduced,
    kappa: Float[Array, "arms 3"],
    R: Float[Array, "3 3"],
    omega_dot: Float[Array, "3"],
    free: Float[Array, "motion"],
) -> Float[Array, "motion"]:
    """`(R^T x_dd, r_dd)` of an agent at attitude R that turns by `omega_dot` while its tips follow the payload.

    `R^T x_dd + B xi_dot + kappa = R^T (a + R_L (alpha x c + w x (w x c)))`; what that leaves open is as in `free`.
    """
    c = agent.contact
    carried = so3.cross(to.alpha[None], c) + so3.cross(load.omega[None], so3.cross(load.omega[None], c))
    target = (to.a[None] + carried @ load.R.T) @ R - kappa - (p.tip[:, :, :3] * omega_dot[None, None]).sum(2)
    return _nearest(p, _yields(agent), free[:, None], target.reshape(-1, 1))[:, 0]


# Joints beyond need ---------------------------------------------------------------------------------------------------

# How readily the centre of mass gives way, by axis of the base, where a joint does by 1 rad^2: 1 cm or 10 m squared.
BY_TIPS = np.ones(3)  # of no effect where joints are just enough
BY_THRUST = np.array([1e-4, 1e-4, 1e2])  # the thrust has its size at will, its direction only as the agent turns
BY_JOINTS = np.full(3, 1e2)


def _beyond_need(agent: Agent) -> bool:
    """Whether tips and attitude leave joints free, `n_r > 3 n - 3`."""
    return agent.tree.joints > 3 * agent.tree.arms - 3


def _yields(agent: Agent) -> np.ndarray:
    """How readily an agent's centre of mass gives way as its tips are led."""
    return BY_THRUST if _beyond_need(agent) else BY_TIPS


ROUNDING = 1e-12  # of a tip's mobility, where joints move it no way


def _inward(agent: Agent) -> bool:
    """Whether joints can move with tips and centre of mass at rest, `n_r > 3 n`."""
    return agent.tree.joints > 3 * agent.tree.arms


def _yielding(agent: Agent, p: ag.Reduced, f_r: Float[Array, "n_r"]) -> Float[Array, "n_r"]:
    """How joint torques accelerate joints as far as that moves neither tips nor the centre of mass, rad/s^2.

    `z = H^-1 (f_r - B^T (B H^-1 B^T)^-1 B H^-1 f_r)`, so that `B z = 0`, with H the joints' inertia. Links that weigh
    grams, and nothing else, move so; the posture leads them back by `H k^2`, some mN m a radian. An error of what is
    learned would turn them by radians: they give way to it in place of being held against it. Joints about parallel
    axes move a tip in a plane alone; what cannot move it otherwise is none of B's.
    """
    B, H = p.tip[:, :, 3:].reshape(3 * agent.tree.arms, -1), p.M_bar[3:, 3:]
    moved = linalg.solve(H, jnp.concatenate([B.T, f_r[:, None]], axis=1))
    by_tips, by_torque = moved[:, :-1], moved[:, -1]
    A = B @ by_tips
    A = A + ROUNDING * jnp.trace(A) * jnp.eye(len(A))  # a planar arm moves its tip in a plane
    return by_torque - by_tips @ linalg.solve(A, (B @ by_torque)[:, None])[:, 0]


def folded(agent: Agent, p: ag.Reduced) -> Float[Array, "n_r 3"]:
    """How joints move as the agent turns with its tips held, and as little else of it as can be, rad or m a rad."""
    return _nearest(p, _yields(agent), jnp.zeros((3 + agent.tree.joints, 3)), -p.tip[:, :, :3].reshape(-1, 3))[3:]


def _nearest(
    p: ag.Reduced, yields: np.ndarray, free: Float[Array, "motion k"], tips: Float[Array, "forces k"]
) -> Float[Array, "motion k"]:
    """`y = free + S J^T (J S J^T)^-1 (tips - J free)`: the motion `(R^T x, r)` nearest to `free` that moves tips so."""
    n, joints = p.tip.shape[0], free.shape[0] - 3
    J = jnp.concatenate([jnp.tile(jnp.eye(3), (n, 1)), p.tip[:, :, 3:].reshape(3 * n, joints)], axis=1)
    S_JT = np.concatenate([yields, np.ones(joints)])[:, None] * J.T
    return free + S_JT @ linalg.solve(J @ S_JT, tips - J @ free)


DAMPING = 0.8  # of the posture; what its loop is late by adds to it, and beyond one a joint returns ever more slowly


def _leaned(
    agent: Agent,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    to: Command,
    share: Share,
    f_hat: AgentForce,
    p: ag.Reduced,
    turn: Turn,
) -> tuple[Turn, Float[Array, "motion"]]:
    """The turn with the lean that moves the centre of mass over the tips, and the motion that joints and thrust allow.

    `r_dd = -k^2 e - 2 d k e_dot`, `e = r - rest - r_tilt`, d `DAMPING`: `r_tilt` are the joints that hold the centre of
    mass where it is while the agent is off `turn`. It is what tips and posture make of it that leans, `f + m x_dd`, and
    its rate; joints move as the thrust of this moment moves it, so that contact forces need not. (Led by the joints'
    own errors the loop would have the swing about the tips as a zero in the right half plane.)
    """
    k, m = gains.posture, p.mass
    off = jnp.stack([so3.e_R(q.R, turn.R), so3.e_omega(q.R, q.omega, turn.R, turn.omega)], axis=1)
    still = jnp.zeros((3 + agent.tree.joints, 2))
    tilt = folded(agent, p) @ off
    e, e_dot = q.r - share.rest - tilt[:, 0], q.r_dot - tilt[:, 1]
    r_dd = -(k**2) * e - 2 * DAMPING * k * e_dot
    a = q.R.T @ to.a
    across = q.R.T @ (gravity + (f_hat.f_x - share.lam.sum(0)) / m)  # what forces but the thrust's give
    x_dd = jnp.concatenate([across[:2], a[2:]])
    fixed = jnp.zeros((3 * agent.tree.arms, 1))
    e_dd = _nearest(p, BY_THRUST, jnp.concatenate([x_dd - a, r_dd])[:, None], fixed)[3:, 0]
    asked = still.at[3:].set(jnp.stack([r_dd, -(k**2) * e_dot - 2 * DAMPING * k * e_dd], axis=1))
    lift = m * q.R @ _nearest(p, BY_JOINTS, asked, jnp.tile(fixed, (1, 2)))[:3]
    size = (m * (to.a - gravity) + share.lam.sum(0) - f_hat.f_x) @ turn.R[:, 2]
    f, f_dot = size * turn.R[:, 2], size * turn.R @ so3.cross(turn.omega, jnp.asarray(ag.E3))
    R, R_dot = jax.jvp(lambda f: attitude(f, share.heading), (f + lift[:, 0],), (f_dot + lift[:, 1],))
    return dataclasses.replace(turn, R=R, omega=so3.vee(R.T @ R_dot)), jnp.concatenate([x_dd, r_dd])
