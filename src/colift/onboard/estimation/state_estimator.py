"""From measurements to states, contact forces and labels, with past samples only.

Pose and velocity of every body come from a complementary filter: gyroscope and accelerometer carry the last
estimate to now, the measured pose and velocity pull it slowly. It takes the noise out without a delay.

A label is what the nominal equations leave over. Momenta are differenced over one tick, every term is summed
raw, and the sum goes through one filter: so all terms see the same delay, and the inputs of the learned maps are
delayed by the same filter. The tips report through a known bandwidth; the other terms pass through a copy of it.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.filters import LowPass, after, blend, from_the_first, settle, smooth
from colift.math.pytree import pytree
from colift.models import aerial_manipulator, grasp, inverse_dynamics
from colift.models.measurement import AgentReading, Measurement
from colift.models.parameters import Agent, Team
from colift.models.state import AgentInput, AgentState, Clock, PayloadState, flat_agent, flat_payload

Scalar = Float[Array, ""]


@pytree
class Filters:
    """Corner frequencies of the on-board filters."""

    fusion: Scalar  # Hz, how fast measured poses and velocities pull the inertial prediction
    bias: Scalar  # Hz, how fast constant errors of gyroscopes and accelerometers are learned from what that misses
    joint: Scalar  # Hz, second order, joint positions and their rates
    label: Scalar  # Hz, second order, labels and the inputs paired with them
    tip_force: Scalar  # Hz, first order: the bandwidth the tip sensors are known to have

    def delay(self) -> Scalar:
        """Of labels, s: `1 / (pi label) + 1 / (2 pi tip_force)`."""
        return (1 / self.label + 1 / (2 * self.tip_force)) / jnp.pi


@pytree
class Pose:
    """Pose and velocity of a body's sensor origin, as fused."""

    R: Float[Array, "*agents 3 3"]
    x: Float[Array, "*agents 3"]  # m
    v: Float[Array, "*agents 3"]  # m/s


@pytree
class Biases:
    """Constant errors of a body's gyroscope and accelerometer, as believed."""

    omega: Float[Array, "*agents 3"]  # rad/s, body frame
    a: Float[Array, "*agents 3"]  # m/s^2, body frame


def no_bias(*agents: int) -> Biases:
    """None known yet."""
    return Biases(omega=jnp.zeros((*agents, 3)), a=jnp.zeros((*agents, 3)))


def fuse(
    past: tuple[Pose, Biases],
    measured: Pose,
    omega: so3.Vector,
    a: so3.Vector,
    gravity: so3.Vector,
    filters: Filters,
    warm: Scalar,
    dt: Scalar,
) -> tuple[Pose, Biases, so3.Vector, so3.Vector]:
    """One body: `R = R_- exp(omega dt) exp(b e)`, `v = v_- + a dt + b (..)`, `x = x_- + v dt + b (..)`.

    `e` is the skew part of what the prediction misses; `omega` and `a`, the specific force in the body frame, are what
    is measured less its bias, and are returned. Biases follow what is missed: `b_omega' = -k e`,
    `b_a' = -k R^T (v_measured - v)`, k the product of the corners of fusion and bias, rad^2/s^2.
    """
    was, bias = past
    omega, felt = omega - bias.omega, a - bias.a
    b = from_the_first(warm, blend(filters.fusion, dt))
    acceleration = was.R @ felt + gravity
    R = was.R @ so3.exp(omega * dt)
    v = was.v + acceleration * dt
    x = was.x + was.v * dt + acceleration * (dt * dt / 2)
    e, e_v = so3.vee(R.T @ measured.R), measured.v - v
    k = warm * dt * (2 * jnp.pi) ** 2 * filters.fusion * filters.bias
    learned = Biases(omega=bias.omega - k * e, a=bias.a - k * (R.T @ e_v))
    return Pose(R=R @ so3.exp(b * e), x=x + b * (measured.x - x), v=v + b * e_v), learned, omega, felt


@pytree
class AgentMemory:
    """What the estimator keeps of a group between ticks."""

    base: Pose
    bias: Biases
    joint: LowPass
    momenta: Float[Array, "*agents xi"]  # (mu, nu) of the last tick
    carried: Float[Array, "*agents 3"]  # m/s, v - v_0 of the last tick
    known: Float[Array, "*agents label"]  # label without contact forces, behind the copy of the tips' bandwidth
    label: LowPass
    state: LowPass  # the inputs of the learned map, behind the labels' filter


@pytree
class Memory:
    """What the estimator keeps between ticks."""

    agents: tuple[AgentMemory, ...]
    load: Pose
    bias: Biases
    omega: Float[Array, "3"]  # rad/s, of the payload in the last tick
    known: Float[Array, "6"]
    label: LowPass
    state: LowPass
    silent: Scalar  # s since the last label
    warm: Float[Array, ""]  # 0 before the first tick, 1 after


@pytree
class Labelled:
    """Inputs of the learned maps with their labels, of one tick."""

    payload: tuple[Float[Array, "24"], Float[Array, "6"]]
    agents: tuple[tuple[Float[Array, "agents inputs"], Float[Array, "agents outputs"]], ...]
    fresh: Float[Array, ""]  # 1 where the tips have spoken lately, 0 where they are silent and labels stand still
    waited: Float[Array, ""]  # s since the label before


@pytree
class Estimate:
    """What the flying software believes after one tick."""

    agents: tuple[AgentState, ...]
    payload: PayloadState
    a_L: Float[Array, "6"]  # (v_dot world, raw difference of omega), m/s^2 and rad/s^2
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, lam_hat, world
    labelled: Labelled | None = None  # what can be learned from now; None where an estimator gives no labels


@pytree
class Estimator:
    """The estimator that comes with colift: a complementary filter, and labels by the nominal equations."""

    filters: Filters
    patience: Scalar  # s, how old a reading of the tips may be for a label

    def begin(self, team: Team, first: Measurement) -> Memory:
        """The memory at the first measurement, as if the team had stood there for ever."""
        return _begin(team, first)

    def observe(
        self, team: Team, memory: Memory, m: Measurement, applied: tuple[AgentInput, ...], clock: Clock
    ) -> tuple[Estimate, Memory]:
        """One tick: states, `lam_hat` and the filtered labels, given the inputs applied since the last tick."""
        age = m.age_s.get("agents.lam", jnp.zeros(()))
        fresh = (age <= self.patience + 1e-9).astype(float)
        return _observe(team, self.filters, memory, m, applied, fresh, clock.dt)


def _begin(team: Team, first: Measurement) -> Memory:
    agents = []
    for size, group, m in zip(team.sizes, team.groups, first.agents, strict=True):
        xi = 3 + group.tree.joints
        agents.append(
            AgentMemory(
                base=Pose(R=m.R, x=m.x, v=m.v),
                bias=no_bias(size),
                joint=settle(m.r),
                momenta=jnp.zeros((size, xi)),
                carried=jnp.zeros((size, 3)),
                known=jnp.zeros((size, 3 + xi)),
                label=settle(jnp.zeros((size, 3 + xi))),
                state=settle(jnp.zeros((size, 18 + 2 * group.tree.joints))),
            )
        )
    zero = jnp.zeros(6)
    q = first.payload
    return Memory(
        agents=tuple(agents),
        load=Pose(R=q.R, x=q.p, v=q.v),
        bias=no_bias(),
        omega=jnp.zeros(3),
        known=zero,
        label=settle(zero),
        state=settle(jnp.zeros(24)),
        silent=jnp.zeros(()),
        warm=jnp.zeros(()),
    )


def _observe(
    team: Team,
    filters: Filters,
    memory: Memory,
    m: Measurement,
    applied: tuple[AgentInput, ...],
    fresh: Scalar,
    dt: Scalar,
) -> tuple[Estimate, Memory]:
    q = m.payload
    agents, states, forces = [], [], []
    at, past = Pose(R=q.R, x=q.p, v=q.v), (memory.load, memory.bias)
    fused, bias, omega, a = fuse(past, at, q.omega, q.a, team.gravity, filters, memory.warm, dt)
    load = PayloadState(R=fused.R, p=fused.x, omega=omega, v=fused.v)
    waited = memory.silent + dt
    b = fresh * after(blend(filters.label, dt), waited / dt)  # labels stand still where the tips are silent
    observe_agent = jax.vmap(_observe_agent, in_axes=(0, None, 0, 0, 0, None, None, None, None))
    for group, past, reading, u in zip(team.groups, memory.agents, m.agents, applied, strict=True):
        state, lam, now = observe_agent(group, filters, past, reading, u, team.gravity, memory.warm, b, dt)
        agents.append(now)
        states.append(state)
        forces.append(lam)
    # nothing to difference on the first tick
    omega_dot = memory.warm * (omega - memory.omega) / dt
    felt = load.R @ a
    known, contact = _payload_label(team, load, felt, omega_dot, tuple(forces))
    known = memory.known + from_the_first(memory.warm, blend(filters.tip_force, dt)) * (known - memory.known)
    now = Memory(
        agents=tuple(agents),
        load=fused,
        bias=bias,
        omega=omega,
        known=known,
        label=_pass(memory.label, known - contact, b, memory.warm),
        state=_pass(memory.state, flat_payload(load, jnp.concatenate([felt, omega_dot])), b, memory.warm),
        silent=(1 - fresh) * waited,
        warm=jnp.ones(()),
    )
    a_L = jnp.concatenate([felt + team.gravity, omega_dot])
    labelled = Labelled(
        payload=(now.state.outer, now.label.outer),
        agents=tuple((past.state.outer, past.label.outer) for past in now.agents),
        fresh=fresh,
        waited=waited,
    )
    return Estimate(agents=tuple(states), payload=load, a_L=a_L, lam=tuple(forces), labelled=labelled), now


def _pass(memory: LowPass, x: Float[Array, "*shape"], b: Scalar, warm: Scalar) -> LowPass:
    """Through the labels' filter with the blend b; it begins at its first sample."""
    settled = jax.tree.map(lambda past, now: now + warm * (past - now), memory, settle(x))
    return smooth(settled, x, b)


def _payload_label(
    team: Team,
    q: PayloadState,
    felt: Float[Array, "3"],
    omega_dot: Float[Array, "3"],
    lam: tuple[Float[Array, "agents arms 3"], ...],
) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
    """`(m_L v_dot - f_g, J w_dot + w x J w)` and `G lam_hat`; the label is their difference (learning section)."""
    known = inverse_dynamics.payload(team.payload, felt, omega_dot, q.omega)
    W = grasp.wrench(grasp.contacts(team), q.R, grasp.join(lam))
    return jnp.concatenate([known.F, known.tau]), jnp.concatenate([W.F, W.tau])


def _observe_agent(
    agent: Agent,
    filters: Filters,
    past: AgentMemory,
    m: AgentReading,
    u: AgentInput,
    gravity: Float[Array, "3"],
    warm: Scalar,
    b_label: Scalar,
    dt: Scalar,
) -> tuple[AgentState, Float[Array, "arms 3"], AgentMemory]:
    """State, contact forces and the label of Eq. learning_output_components for one agent."""
    at = Pose(R=m.R, x=m.x, v=m.v)
    base, bias, omega, felt = fuse((past.base, past.bias), at, m.omega, m.a, gravity, filters, warm, dt)
    b = blend(filters.joint, dt)
    joint = smooth(past.joint, m.r, b)
    # the rate of `outer` that its own recursion implies: no second difference
    r_dot = (joint.inner - joint.outer) * b / ((1 - b) * dt)
    r = 2 * joint.inner - joint.outer  # a joint that turns steadily is where it is, not where it was
    g = aerial_manipulator.geometry(agent, r)
    p = aerial_manipulator.reduce(agent, g)
    xi = jnp.concatenate([omega, r_dot])
    carried = -(base.R @ (p.base @ xi))
    q = AgentState(R=base.R, x=base.x + base.R @ p.s, r=r, omega=omega, v=base.v + carried, r_dot=r_dot)
    lam_base = jnp.einsum("bij,bj->bi", g.rotation[jnp.array(agent.tree.tips)], m.lam)
    lam = lam_base @ base.R.T
    momenta = p.M_bar @ xi
    # the same tick on both ends of each difference; nothing to difference on the first
    momenta_dot = warm * (momenta - past.momenta) / dt
    carried_dot = warm * (carried - past.carried) / dt
    drift = aerial_manipulator.momentum_drift(agent, r, xi)
    force = p.mass * (base.R @ felt + carried_dot) - u.u * base.R[:, 2]
    moment = momenta_dot - drift - jnp.concatenate([u.tau, u.tau_r]) - u.u * p.base[2]
    known = past.known + from_the_first(warm, blend(filters.tip_force, dt)) * (
        jnp.concatenate([force, moment]) - past.known
    )
    contact = jnp.concatenate([lam.sum(0), (p.tip * lam_base[:, :, None]).sum((0, 1))])
    now = AgentMemory(
        base=base,
        bias=bias,
        joint=joint,
        momenta=momenta,
        carried=carried,
        known=known,
        label=_pass(past.label, known + contact, b_label, warm),
        state=_pass(past.state, flat_agent(q), b_label, warm),
    )
    return q, lam, now
