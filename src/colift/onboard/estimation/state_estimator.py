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
from colift.math.filters import (
    SecondOrderLowPassState,
    initial_smoothing_factor,
    irregular_smoothing_factor,
    smoothing_factor,
    steady_state,
    update,
)
from colift.math.pytree import pytree
from colift.models import aerial_manipulator, grasp, inverse_dynamics
from colift.models.measurement import AgentReading, Measurement
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import (
    AgentInput,
    AgentState,
    ControlClock,
    PayloadState,
    flatten_agent_state,
    flatten_payload_state,
)

Scalar = Float[Array, ""]


@pytree
class FilterBandwidths:
    """Corner frequencies of the on-board filters."""

    complementary: Scalar  # Hz, how fast measured poses and velocities pull the inertial prediction
    imu_bias: Scalar  # Hz, how fast constant errors of gyroscopes and accelerometers are learned from what that misses
    joint: Scalar  # Hz, second order, joint positions and their rates
    label: Scalar  # Hz, second order, labels and the inputs paired with them
    tip_force: Scalar  # Hz, first order: the bandwidth the tip sensors are known to have

    def label_delay(self) -> Scalar:
        """Of labels, s: `1 / (pi label) + 1 / (2 pi tip_force)`."""
        return (1 / self.label + 1 / (2 * self.tip_force)) / jnp.pi


@pytree
class NavState:
    """Pose and velocity of a body's sensor origin, as fused."""

    R: Float[Array, "*agents 3 3"]
    x: Float[Array, "*agents 3"]  # m
    v: Float[Array, "*agents 3"]  # m/s


@pytree
class ImuBias:
    """Constant errors of a body's gyroscope and accelerometer, as believed."""

    omega: Float[Array, "*agents 3"]  # rad/s, body frame
    a: Float[Array, "*agents 3"]  # m/s^2, body frame


def zero_bias(*agents: int) -> ImuBias:
    """None known yet."""
    return ImuBias(omega=jnp.zeros((*agents, 3)), a=jnp.zeros((*agents, 3)))


def complementary_update(
    past: tuple[NavState, ImuBias],
    measured: NavState,
    omega: so3.Vector,
    a: so3.Vector,
    gravity: so3.Vector,
    filters: FilterBandwidths,
    initialized: Scalar,
    dt: Scalar,
) -> tuple[NavState, ImuBias, so3.Vector, so3.Vector]:
    """One body: `R = R_- exp(omega dt) exp(b e)`, `v = v_- + a dt + b (..)`, `x = x_- + v dt + b (..)`.

    `e` is the skew part of what the prediction misses; `omega` and `a`, the specific force in the body frame, are what
    is measured less its bias, and are returned. Biases follow what is missed: `b_omega' = -k e`,
    `b_a' = -k R^T (v_measured - v)`, k the product of the corners of fusion and bias, rad^2/s^2.
    """
    was, bias = past
    omega, felt = omega - bias.omega, a - bias.a
    b = initial_smoothing_factor(initialized, smoothing_factor(filters.complementary, dt))
    acceleration = was.R @ felt + gravity
    R = was.R @ so3.exp(omega * dt)
    v = was.v + acceleration * dt
    x = was.x + was.v * dt + acceleration * (dt * dt / 2)
    e, e_v = so3.vee(R.T @ measured.R), measured.v - v
    k = initialized * dt * (2 * jnp.pi) ** 2 * filters.complementary * filters.imu_bias
    learned = ImuBias(omega=bias.omega - k * e, a=bias.a - k * (R.T @ e_v))
    return NavState(R=R @ so3.exp(b * e), x=x + b * (measured.x - x), v=v + b * e_v), learned, omega, felt


@pytree
class AgentFilterState:
    """What the estimator keeps of a group between ticks."""

    base: NavState
    bias: ImuBias
    joint: SecondOrderLowPassState
    momenta: Float[Array, "*agents xi"]  # (mu, nu) of the last tick
    com_velocity_offset: Float[Array, "*agents 3"]  # m/s, v - v_0 of the last tick
    modelled_force: Float[
        Array, "*agents label"
    ]  # label without contact forces, behind the copy of the tips' bandwidth
    label: SecondOrderLowPassState
    inputs: SecondOrderLowPassState  # the inputs of the learned map, behind the labels' filter


@pytree
class EstimatorState:
    """What the estimator keeps between ticks."""

    agents: tuple[AgentFilterState, ...]
    payload: NavState
    bias: ImuBias
    omega: Float[Array, "3"]  # rad/s, of the payload in the last tick
    modelled_wrench: Float[Array, "6"]
    label: SecondOrderLowPassState
    inputs: SecondOrderLowPassState
    time_since_label: Scalar  # s since the last label
    initialized: Float[Array, ""]  # 0 before the first tick, 1 after


@pytree
class TrainingSample:
    """Inputs of the learned maps with their labels, of one tick."""

    payload: tuple[Float[Array, "24"], Float[Array, "6"]]
    agents: tuple[tuple[Float[Array, "agents inputs"], Float[Array, "agents outputs"]], ...]
    valid: Float[Array, ""]  # 1 where the tips have spoken lately, 0 where they are silent and labels stand still
    sample_interval: Float[Array, ""]  # s since the label before


@pytree
class StateEstimate:
    """What the flying software believes after one tick."""

    agents: tuple[AgentState, ...]
    payload: PayloadState
    a_L: Float[Array, "6"]  # (v_dot world, raw difference of omega), m/s^2 and rad/s^2
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, lam_hat, world
    sample: TrainingSample | None = None  # what can be learned from now; None where an estimator gives no labels


@pytree
class ComplementaryFilter:
    """The estimator that comes with colift: a complementary filter, and labels by the nominal equations."""

    filters: FilterBandwidths
    max_reading_age: Scalar  # s, how old a reading of the tips may be for a label

    def init(self, team: Team, first: Measurement) -> EstimatorState:
        """The memory at the first measurement, as if the team had stood there for ever."""
        return _begin(team, first)

    def update(
        self,
        team: Team,
        state: EstimatorState,
        measurement: Measurement,
        applied: tuple[AgentInput, ...],
        clock: ControlClock,
    ) -> tuple[StateEstimate, EstimatorState]:
        """One tick: states, `lam_hat` and the filtered labels, given the inputs applied since the last tick."""
        age = measurement.age_s.get("agents.lam", jnp.zeros(()))
        fresh = (age <= self.max_reading_age + 1e-9).astype(float)
        return _observe(team, self.filters, state, measurement, applied, fresh, clock.dt)


def _begin(team: Team, first: Measurement) -> EstimatorState:
    agents = []
    for size, group, m in zip(team.sizes, team.agent_groups, first.agents, strict=True):
        xi = 3 + group.tree.joints
        agents.append(
            AgentFilterState(
                base=NavState(R=m.R, x=m.x, v=m.v),
                bias=zero_bias(size),
                joint=steady_state(m.r),
                momenta=jnp.zeros((size, xi)),
                com_velocity_offset=jnp.zeros((size, 3)),
                modelled_force=jnp.zeros((size, 3 + xi)),
                label=steady_state(jnp.zeros((size, 3 + xi))),
                inputs=steady_state(jnp.zeros((size, 18 + 2 * group.tree.joints))),
            )
        )
    zero = jnp.zeros(6)
    q = first.payload
    return EstimatorState(
        agents=tuple(agents),
        payload=NavState(R=q.R, x=q.p, v=q.v),
        bias=zero_bias(),
        omega=jnp.zeros(3),
        modelled_wrench=zero,
        label=steady_state(zero),
        inputs=steady_state(jnp.zeros(24)),
        time_since_label=jnp.zeros(()),
        initialized=jnp.zeros(()),
    )


def _observe(
    team: Team,
    filters: FilterBandwidths,
    filter_state: EstimatorState,
    measurement: Measurement,
    applied: tuple[AgentInput, ...],
    fresh: Scalar,
    dt: Scalar,
) -> tuple[StateEstimate, EstimatorState]:
    q = measurement.payload
    agents, states, forces = [], [], []
    at, past = NavState(R=q.R, x=q.p, v=q.v), (filter_state.payload, filter_state.bias)
    fused, bias, omega, a = complementary_update(
        past, at, q.omega, q.a, team.gravity, filters, filter_state.initialized, dt
    )
    load = PayloadState(R=fused.R, p=fused.x, omega=omega, v=fused.v)
    waited = filter_state.time_since_label + dt
    b = fresh * irregular_smoothing_factor(
        smoothing_factor(filters.label, dt), waited / dt
    )  # labels stand still where the tips are silent
    observe_agent = jax.vmap(_observe_agent, in_axes=(0, None, 0, 0, 0, None, None, None, None))
    for group, past, reading, u in zip(
        team.agent_groups, filter_state.agents, measurement.agents, applied, strict=True
    ):
        state, lam, context = observe_agent(
            group, filters, past, reading, u, team.gravity, filter_state.initialized, b, dt
        )
        agents.append(context)
        states.append(state)
        forces.append(lam)
    # nothing to difference on the first tick
    omega_dot = filter_state.initialized * (omega - filter_state.omega) / dt
    felt = load.R @ a
    known, contact = _payload_label(team, load, felt, omega_dot, tuple(forces))
    known = filter_state.modelled_wrench + initial_smoothing_factor(
        filter_state.initialized, smoothing_factor(filters.tip_force, dt)
    ) * (known - filter_state.modelled_wrench)
    context = EstimatorState(
        agents=tuple(agents),
        payload=fused,
        bias=bias,
        omega=omega,
        modelled_wrench=known,
        label=_pass(filter_state.label, known - contact, b, filter_state.initialized),
        inputs=_pass(
            filter_state.inputs,
            flatten_payload_state(load, jnp.concatenate([felt, omega_dot])),
            b,
            filter_state.initialized,
        ),
        time_since_label=(1 - fresh) * waited,
        initialized=jnp.ones(()),
    )
    a_L = jnp.concatenate([felt + team.gravity, omega_dot])
    labelled = TrainingSample(
        payload=(context.inputs.stage2, context.label.stage2),
        agents=tuple((past.inputs.stage2, past.label.stage2) for past in context.agents),
        valid=fresh,
        sample_interval=waited,
    )
    return StateEstimate(agents=tuple(states), payload=load, a_L=a_L, lam=tuple(forces), sample=labelled), context


def _pass(
    state: SecondOrderLowPassState, x: Float[Array, "*shape"], b: Scalar, initialized: Scalar
) -> SecondOrderLowPassState:
    """Through the labels' filter with the blend b; it begins at its first sample."""
    settled = jax.tree.map(lambda past, context: context + initialized * (past - context), state, steady_state(x))
    return update(settled, x, b)


def _payload_label(
    team: Team,
    q: PayloadState,
    felt: Float[Array, "3"],
    omega_dot: Float[Array, "3"],
    lam: tuple[Float[Array, "agents arms 3"], ...],
) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
    """`(m_L v_dot - f_g, J w_dot + w x J w)` and `G lam_hat`; the label is their difference (learning section)."""
    known = inverse_dynamics.payload_inverse_dynamics(team.payload, felt, omega_dot, q.omega)
    W = grasp.payload_wrench(grasp.contact_points(team), q.R, grasp.stack_contacts(lam))
    return jnp.concatenate([known.F, known.tau]), jnp.concatenate([W.F, W.tau])


def _observe_agent(
    agent: AerialManipulator,
    filters: FilterBandwidths,
    past: AgentFilterState,
    m: AgentReading,
    u: AgentInput,
    gravity: Float[Array, "3"],
    initialized: Scalar,
    b_label: Scalar,
    dt: Scalar,
) -> tuple[AgentState, Float[Array, "arms 3"], AgentFilterState]:
    """State, contact forces and the label of Eq. learning_output_components for one agent."""
    at = NavState(R=m.R, x=m.x, v=m.v)
    base, bias, omega, felt = complementary_update(
        (past.base, past.bias), at, m.omega, m.a, gravity, filters, initialized, dt
    )
    b = smoothing_factor(filters.joint, dt)
    joint = update(past.joint, m.r, b)
    # the rate of `outer` that its own recursion implies: no second difference
    r_dot = (joint.stage1 - joint.stage2) * b / ((1 - b) * dt)
    r = 2 * joint.stage1 - joint.stage2  # a joint that turns steadily is where it is, not where it was
    g = aerial_manipulator.forward_kinematics(agent, r)
    p = aerial_manipulator.centroidal_model(agent, g)
    xi = jnp.concatenate([omega, r_dot])
    carried = -(base.R @ (p.J_base @ xi))
    q = AgentState(R=base.R, x=base.x + base.R @ p.com_from_base, r=r, omega=omega, v=base.v + carried, r_dot=r_dot)
    lam_base = jnp.einsum("bij,bj->bi", g.rotation[jnp.array(agent.tree.tip_bodies)], m.lam)
    lam = lam_base @ base.R.T
    momenta = p.M_bar @ xi
    # the same tick on both ends of each difference; nothing to difference on the first
    momenta_dot = initialized * (momenta - past.momenta) / dt
    carried_dot = initialized * (carried - past.com_velocity_offset) / dt
    drift = aerial_manipulator.momentum_drift(agent, r, xi)
    force = p.mass * (base.R @ felt + carried_dot) - u.u * base.R[:, 2]
    moment = momenta_dot - drift - jnp.concatenate([u.tau, u.tau_r]) - u.u * p.J_base[2]
    known = past.modelled_force + initial_smoothing_factor(initialized, smoothing_factor(filters.tip_force, dt)) * (
        jnp.concatenate([force, moment]) - past.modelled_force
    )
    contact = jnp.concatenate([lam.sum(0), (p.J_tip * lam_base[:, :, None]).sum((0, 1))])
    context = AgentFilterState(
        base=base,
        bias=bias,
        joint=joint,
        momenta=momenta,
        com_velocity_offset=carried,
        modelled_force=known,
        label=_pass(past.label, known + contact, b_label, initialized),
        inputs=_pass(past.inputs, flatten_agent_state(q), b_label, initialized),
    )
    return q, lam, context
