"""State estimation and residual labels from measurements.

Pose and velocity of every body come from a complementary filter (`colift.onboard.estimation.nav_filter`). Gyroscope and
accelerometer predict them; the measured pose and velocity correct the prediction at a low bandwidth. This removes noise
without delay. For a payload without these sensors, the equations of motion replace them
(`colift.onboard.estimation.payload_filter`).

A label is the residual of the nominal equations. Momenta are differenced over one control period, all terms are summed
without filtering, and the sum passes one filter. All terms therefore have the same delay. The inputs of the learned
models pass the same filter. Tip force sensors have a known bandwidth; the other terms pass a copy of this filter.

See Also:
    docs/learning: equations of the labels and their delay.
    docs/decisions/0007-sum-label-terms-before-filtering: reasons and measured results.
"""

from __future__ import annotations

import dataclasses
import functools

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
from colift.math.pytree import pytree, static
from colift.models import aerial_manipulator, inverse_dynamics
from colift.models.measurement import AgentReading, Measurement, PayloadReading
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import (
    AgentInput,
    AgentState,
    ControlClock,
    PayloadState,
    ResidualForces,
    TeamInputs,
    flatten_agent_state,
    flatten_payload_state,
)
from colift.onboard.estimation import contact_forces, nav_filter, tip_readings
from colift.onboard.estimation.contact_forces import (
    AgentBalance,
    ContactForceEstimator,
    PayloadBalance,
    TeamBalance,
    TipSensors,
)
from colift.onboard.estimation.nav_filter import FilterBandwidths, ImuBias, NavState, ReadingClock
from colift.onboard.estimation.payload_filter import PayloadFilter, PayloadFilterState, contact_wrench
from colift.onboard.estimation.tip_readings import TipReadings

Scalar = Float[Array, ""]


def encoder_share(agent: AerialManipulator, g: aerial_manipulator.ForwardKinematics) -> Float[Array, "n_r n_r"]:
    """Compute the part of the joint velocities that the encoders determine, `I - G B` (`joint_rates`).

    Args:
        agent: Nominal parameters of one agent.
        g: Forward kinematics at the joint positions.

    Returns:
        Matrix from encoder rates to estimated rates; nearly the projection to motions that do not move the tips.
    """
    if not agent.tree.joints:
        return jnp.zeros((0, 0))
    B = _tip_jacobian(agent, g)
    return jnp.eye(agent.tree.joints) - _rate_gain(B) @ B


def _rate_gain(B: Float[Array, "tips n_r"]) -> Float[Array, "n_r tips"]:
    """Return `G = (B^T B + s^2 I)^-1 B^T`, nearly the pseudoinverse of B, with `s = contact_forces.MIN_LEVER`."""
    return contact_forces.regularized_pseudoinverse(B, contact_forces.MIN_LEVER)


def _tip_jacobian(agent: AerialManipulator, g: aerial_manipulator.ForwardKinematics) -> Float[Array, "tips n_r"]:
    """Return the derivatives of the tip positions with respect to the joints, base frame, tip by tip."""
    return g.J_point[-agent.tree.arms :].transpose(0, 2, 1).reshape(3 * agent.tree.arms, -1)


def joint_rates(
    agent: AerialManipulator,
    g: aerial_manipulator.ForwardKinematics,
    base: NavState,
    omega: Float[Array, "3"],
    payload: PayloadState,
    encoder_rate: Float[Array, "n_r"],
) -> Float[Array, "n_r"]:
    """Compute the joint velocities with which the tips move with the payload.

    The tips have the velocities `v_L + R_L (w_L x c)`. Relative to the base these are `B r_dot`, hence

        r_dot = r_dot_e + G (R^T (v_L + R_L (w_L x c) - v) - w x rho - B r_dot_e)

    with the rate `r_dot_e` of the encoders, which determines motions that do not move the tips, and
    `G = (B^T B + s^2 I)^-1 B^T`, `s = contact_forces.MIN_LEVER`. Terms of the dynamics are quadratic in the
    rates, so that the variance of a rate adds to their mean. Differenced encoder readings have a large variance.
    Rows of open contacts are zero.

    Args:
        agent: Nominal parameters of one agent.
        g: Forward kinematics at the joint positions.
        base: Estimated pose and velocity of the base.
        omega: Estimated angular velocity of the base [rad/s, body frame].
        payload: Estimated state of the payload.
        encoder_rate: Filtered rates of the encoders [rad/s or m/s].

    Returns:
        Joint velocities [rad/s or m/s].
    """
    if not agent.tree.joints:
        return encoder_rate
    contact = payload.v[None] + so3.cross(payload.omega[None], agent.contact_position) @ payload.R.T
    tip = (contact - base.v[None]) @ base.R - so3.cross(omega[None], g.points[-agent.tree.arms :])
    B = _tip_jacobian(agent, g)
    if agent.closed_contacts is not None:
        tip, B = agent.closed_contacts[:, None] * tip, jnp.repeat(agent.closed_contacts, 3)[:, None] * B
    return encoder_rate + _rate_gain(B) @ (tip.reshape(-1) - B @ encoder_rate)


@pytree
class AgentFilterState:
    """Filter state of one agent, or of a group of agents, between control periods."""

    base: NavState  # of the base origin; with the history of a late reading as the first axis after the agents
    bias: ImuBias  # of the base sensors
    r: Float[Array, "*agents n_r"]  # rad or m, estimated joint positions
    r_dot: Float[Array, "*agents n_r"]  # rad/s or m/s, estimated joint velocities
    encoder: SecondOrderLowPassState  # rad or m, filter of the measured joint positions
    momenta: Float[Array, "*agents xi"]  # (mu, nu) of the previous control period, base frame
    com_velocity_offset: Float[Array, "*agents 3"]  # m/s, center of mass minus base origin, previous period, world
    modelled_force: Float[
        Array, "*agents label"
    ]  # label without contact forces, after the copy of the tip force filter
    label: SecondOrderLowPassState  # N and N m, label filter
    inputs: SecondOrderLowPassState  # inputs of the learned model, after the label filter


@pytree
class EstimatorState:
    """State of the estimator between control periods."""

    agents: tuple[AgentFilterState, ...]  # by group
    payload: NavState  # of the payload's center of mass; with the history of a late reading as the first axis
    bias: ImuBias  # of the payload's sensors
    clocks: tuple[ReadingClock, ReadingClock] | None  # of payload and agents; None if readings are never held or late
    omega: Float[Array, "3"]  # rad/s, of the payload in the previous control period, payload frame
    modelled_wrench: Float[Array, "6"]  # N and N m, label without contact forces, after the tip force filter
    label: SecondOrderLowPassState  # N and N m, label filter of the payload
    inputs: SecondOrderLowPassState  # inputs of the payload's learned model, after the label filter
    contact_forces: tuple[SecondOrderLowPassState, ...]  # N, world, label filter of estimates, by group; () with tips
    time_since_label: Scalar  # s, since the last valid label
    initialized: Float[Array, ""]  # 0 before the first control period, 1 afterwards
    tips: TipReadings | None = None  # None if failures of tip force sensors are not detected
    payload_filter: PayloadFilterState | None = None  # None if the payload has gyroscope and accelerometer


@pytree
class TrainingSample:
    """Inputs of the learned models with their labels, in one control period.

    Samples for training require tip readings or a prior of the residuals. Without both, the payload's label depends on
    the prediction of the agents' residuals. The filtered inputs and labels are then held, and `valid` is 0. The
    payload's label before the filter exists in every period.
    """

    payload: tuple[Float[Array, "24"], Float[Array, "6"]]  # input; label, N world and N m payload frame
    agents: tuple[tuple[Float[Array, "agents inputs"], Float[Array, "agents outputs"]], ...]  # the same, by group
    unfiltered: tuple[Float[Array, "6"], tuple[Float[Array, "agents outputs"], ...]]  # labels before the label filter
    valid: Float[Array, ""]  # 1 if all labels of agents exist, and the sample is for training
    sample_interval: Float[Array, ""]  # s, since the previous period with valid = 1


@pytree
class StateEstimate:
    """State estimate of one control period."""

    agents: tuple[AgentState, ...]  # by group
    payload: PayloadState  # estimated payload state
    a_L: Float[Array, "6"]  # payload acceleration, m/s^2 world and rad/s^2 payload frame; the latter is not filtered
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, contact forces on the payload, world, by group: as measured, or
    # from the equations of motion, averaged over the time constant of the label filter
    lam_covariance: Float[Array, "components components"] | None = None  # N^2, world, contacts in team order; None for
    # measured contact forces
    sample: TrainingSample | None = None  # None if the estimator computes no labels


@pytree
class ComplementaryFilter:
    """Default estimator: a complementary filter per body, contact forces, and labels by the nominal equations.

    Implements the protocol ``Estimator``.

    Attributes:
        filters: Corner frequencies of all filters.
        contact_forces: Estimator of the contact forces.
        pose_delay: Largest delay of readings of poses and velocities, in control periods; None if all of them are new
            in every control period.
        detects_tip_failures: Whether tip readings that stay unchanged or are wrong count as old; requires readings with
            noise.
        payload_filter: Filter of a payload without gyroscope and accelerometer; None if the payload has them.
    """

    filters: FilterBandwidths
    contact_forces: ContactForceEstimator = dataclasses.field(default_factory=TipSensors)
    pose_delay: int | None = static(default=None)
    detects_tip_failures: bool = static(default=False)
    payload_filter: PayloadFilter | None = None

    def init(self, team: Team, measurement: Measurement) -> EstimatorState:
        """Return the steady state at the first measurement, with zero labels; see `Estimator`."""
        state = _initial_state(team, measurement, self.pose_delay)
        averaged = isinstance(self.contact_forces, contact_forces.ResidualPriorEstimator)
        return dataclasses.replace(
            state,
            tips=tip_readings.initial(measurement) if self.detects_tip_failures else None,
            contact_forces=tuple(steady_state(jnp.zeros(m.lam.shape)) for m in measurement.agents if averaged),
            payload_filter=self.payload_filter and self.payload_filter.init(team),
        )

    def update(
        self,
        team: Team,
        state: EstimatorState,
        measurement: Measurement,
        applied: TeamInputs,
        f_hat: ResidualForces,
        clock: ControlClock,
    ) -> tuple[StateEstimate, EstimatorState]:
        """Compute states, contact forces and filtered labels of one control period; see `Estimator`."""
        return _update(team, self, state, measurement, applied, f_hat, clock.dt)


def _initial_state(team: Team, measurement: Measurement, pose_delay: int | None) -> EstimatorState:
    """Return the steady state of all filters at a measurement."""
    start = lambda nav: nav if pose_delay is None else nav_filter.initial_history(nav, pose_delay + 1)  # noqa: E731
    agents = []
    for size, group, m in zip(team.sizes, team.agent_groups, measurement.agents, strict=True):
        xi = 3 + group.tree.joints
        agents.append(
            AgentFilterState(
                base=start(NavState(R=m.R, x=m.x, v=m.v)),
                bias=nav_filter.zero_bias(size),
                r=m.r,
                r_dot=jnp.zeros_like(m.r),
                encoder=steady_state(m.r),
                momenta=jnp.zeros((size, xi)),
                com_velocity_offset=jnp.zeros((size, 3)),
                modelled_force=jnp.zeros((size, 3 + xi)),
                label=steady_state(jnp.zeros((size, 3 + xi))),
                inputs=steady_state(jnp.zeros((size, 18 + 2 * group.tree.joints))),
            )
        )
    zero = jnp.zeros(6)
    q = measurement.payload
    return EstimatorState(
        agents=tuple(agents),
        payload=start(NavState(R=q.R, x=q.p, v=q.v)),
        bias=nav_filter.zero_bias(),
        clocks=None if pose_delay is None else (nav_filter.initial_clock(), nav_filter.initial_clock()),
        omega=jnp.zeros(3),
        modelled_wrench=zero,
        label=steady_state(zero),
        inputs=steady_state(jnp.zeros(24)),
        contact_forces=(),
        time_since_label=jnp.zeros(()),
        initialized=jnp.zeros(()),
    )


def _update(
    team: Team,
    estimator: ComplementaryFilter,
    state: EstimatorState,
    measurement: Measurement,
    applied: TeamInputs,
    f_hat: ResidualForces,
    dt: Scalar,
) -> tuple[StateEstimate, EstimatorState]:
    """Advance all filters by one control period."""
    filters = estimator.filters
    clocks = None if state.clocks is None else _advance_clocks(state.clocks, measurement, dt)
    payload, balance, a, payload_state = _update_payload(
        team, estimator, dataclasses.replace(state, clocks=clocks), measurement, dt
    )
    # Without gyroscope, the payload's angular velocity has more noise than the encoder rates. The variance of joint
    # rates adds to the mean of the terms that are quadratic in them.
    closed = estimator.payload_filter is None and not isinstance(estimator.contact_forces, contact_forces.FreeFlight)
    found = _update_agents(team, filters, state, payload, measurement, applied, clocks and clocks[1], dt, closed)
    balances, tips = _team_balance(state, measurement, balance, tuple(each for _, each, _ in found), f_hat, dt)
    forces = estimator.contact_forces.estimate(team, balances)
    interval = state.time_since_label + dt
    # In periods without labels the filters of labels and inputs hold their values.
    b = forces.valid * irregular_smoothing_factor(smoothing_factor(filters.label, dt), interval / dt)
    filter_labels = jax.vmap(_filter_agent_label, in_axes=(0, 0, 0, 0, None, None))
    filtered_agents = (
        filter_labels(agent_state, of_agents, *each, b, state.initialized)
        for (_, of_agents, agent_state), *each in zip(found, forces.base_frame, forces.for_moment_labels(), strict=True)
    )
    labels, agents, lam = zip(*filtered_agents, strict=True)
    payload_label = contact_forces.without_tip_moments(balances, balance.y - contact_wrench(team, payload.R, lam))
    averaged, filtered = _average(state, lam, b)
    inputs, motion = flatten_payload_state(payload, a), payload_state.payload_filter
    if estimator.payload_filter is not None and motion is not None:
        motion = dataclasses.replace(motion, wrench=contact_wrench(team, payload.R, averaged))
        poses = clocks and clocks[0]
        inputs, motion = estimator.payload_filter.delay_inputs(motion, inputs, state.initialized, dt, poses)
    next_state = dataclasses.replace(
        payload_state,
        agents=agents,
        contact_forces=filtered,
        label=_filter_label(state.label, payload_label, b, state.initialized),
        inputs=_filter_label(state.inputs, inputs, b, state.initialized),
        time_since_label=(1 - forces.valid) * interval,
        initialized=jnp.ones(()),
        tips=tips,
        payload_filter=motion,
    )
    sample = TrainingSample(
        payload=(next_state.inputs.stage2, next_state.label.stage2),
        agents=tuple((agent.inputs.stage2, agent.label.stage2) for agent in agents),
        unfiltered=(payload_label, labels),
        valid=forces.valid,
        sample_interval=interval,
    )
    return StateEstimate(
        agents=tuple(q for q, _, _ in found),
        payload=payload,
        a_L=jnp.concatenate([a[:3] + team.gravity, a[3:]]),
        lam=averaged,
        lam_covariance=forces.covariance,
        sample=sample,
    ), next_state


def _team_balance(
    state: EstimatorState,
    measurement: Measurement,
    payload: PayloadBalance,
    agents: tuple[AgentBalance, ...],
    f_hat: ResidualForces,
    dt: Scalar,
) -> tuple[TeamBalance, TipReadings | None]:
    """Return the equations of motion with the age of the tip readings, and the data of the detection of failures."""
    age = measurement.measurement_age_s.get("agents.lam", jnp.zeros(()))
    balances = TeamBalance(agents=agents, payload=payload, reading_age=age, f_hat=f_hat)
    if state.tips is None:
        return balances, None
    filtered = state.label.stage2, tuple(agent.label.stage2 for agent in state.agents)
    have_labels = (state.time_since_label <= 0) & (state.initialized > 0)
    return tip_readings.update(state.tips, measurement, balances, filtered, have_labels, dt)


def _update_agents(
    team: Team,
    filters: FilterBandwidths,
    state: EstimatorState,
    payload: PayloadState,
    measurement: Measurement,
    applied: TeamInputs,
    clock: ReadingClock | None,
    dt: Scalar,
    contacts_closed: bool,
) -> list[tuple[AgentState, AgentBalance, AgentFilterState]]:
    """Return the results of `_update_agent` by group."""
    update_group = jax.vmap(
        functools.partial(_update_agent, contacts_closed=contacts_closed),
        in_axes=(0, None, None, 0, 0, 0, None, None, None, None),
    )
    return [
        update_group(group, filters, payload, agents, readings, inputs, team.gravity, state.initialized, dt, clock)
        for group, agents, readings, inputs in zip(
            team.agent_groups, state.agents, measurement.agents, applied, strict=True
        )
    ]


def _update_payload(
    team: Team, estimator: ComplementaryFilter, state: EstimatorState, measurement: Measurement, dt: Scalar
) -> tuple[PayloadState, PayloadBalance, Float[Array, "6"], EstimatorState]:
    """Compute state and equations of motion of the payload, and its filter state with the label filters unchanged.

    Args:
        team: Nominal parameters.
        estimator: Filters.
        state: State of the previous control period, with the clocks of this one.
        measurement: Readings of this control period.
        dt: Control period [s].

    Returns:
        State, equations of motion, ``v_dot - a_g`` [m/s^2, world] with ``w_dot`` [rad/s^2, payload frame], and filter
        state.
    """
    q, clock, filters = measurement.payload, state.clocks and state.clocks[0], estimator.filters
    if estimator.payload_filter is not None:
        return _update_payload_without_imu(team, estimator.payload_filter, state, q, dt)
    fused, bias, omega, a = nav_filter.update(
        *((state.payload, state.bias), NavState(R=q.R, x=q.p, v=q.v), q.omega, q.a, team.gravity, filters),
        *(state.initialized, dt, clock),
    )
    nav = nav_filter.newest(fused, clock)
    payload = PayloadState(R=nav.R, p=nav.x, omega=omega, v=nav.v)
    # The first control period has no difference.
    omega_dot = state.initialized * (omega - state.omega) / dt
    specific_force = payload.R @ a
    required = inverse_dynamics.payload_inverse_dynamics(team.payload, specific_force, omega_dot, omega)
    tip_factor = initial_smoothing_factor(state.initialized, smoothing_factor(filters.tip_force, dt))
    modelled = state.modelled_wrench + tip_factor * (
        jnp.concatenate([required.F, required.tau]) - state.modelled_wrench
    )
    next_state = dataclasses.replace(state, payload=fused, bias=bias, omega=omega, modelled_wrench=modelled)
    acceleration = jnp.concatenate([specific_force, omega_dot])
    return payload, PayloadBalance(R=payload.R, y=modelled), acceleration, next_state


def _update_payload_without_imu(
    team: Team, payload_filter: PayloadFilter, state: EstimatorState, q: PayloadReading, dt: Scalar
) -> tuple[PayloadState, PayloadBalance, Float[Array, "6"], EstimatorState]:
    """Return the results of `_update_payload` from the poses of a payload without gyroscope and accelerometer."""
    previous, clock = state.payload_filter, state.clocks and state.clocks[0]
    assert previous is not None  # for the type checker
    measured = NavState(R=q.R, x=q.p, v=q.v)
    motion, current = payload_filter.update(team, (state.payload, previous), measured, state.initialized, dt, clock)
    nav = nav_filter.newest(motion.nav, clock)
    payload = PayloadState(R=nav.R, p=nav.x, omega=motion.omega, v=nav.v)
    balance = PayloadBalance(R=nav.R, y=current.wrench + current.residual)
    acceleration = jnp.concatenate([motion.specific_force, motion.omega_dot])
    next_state = dataclasses.replace(state, payload=motion.nav, omega=motion.omega, payload_filter=current)
    return payload, balance, acceleration, next_state


def _average(
    state: EstimatorState, lam: tuple[Float[Array, "_agents _arms 3"], ...], b: Scalar
) -> tuple[tuple[Float[Array, "_agents _arms 3"], ...], tuple[SecondOrderLowPassState, ...]]:
    """Return averages ``2 s_1 - s_2`` of estimated contact forces, and the label filter with the stages s_1 and s_2.

    Ramps have no lag (Brown 1963). Readings of tip force sensors are returned unchanged.
    """
    if not state.contact_forces:
        return lam, ()
    filtered = tuple(
        _filter_label(previous, each, b, state.initialized)
        for previous, each in zip(state.contact_forces, lam, strict=True)
    )
    return tuple(2 * each.stage1 - each.stage2 for each in filtered), filtered


def _advance_clocks(
    clocks: tuple[ReadingClock, ReadingClock], measurement: Measurement, dt: Scalar
) -> tuple[ReadingClock, ReadingClock]:
    """Return the clocks of payload and agents in this control period."""
    ages = measurement.measurement_age_s
    payload, agents = (
        nav_filter.advance_clock(clock, nav_filter.CHANNELS[body], ages, dt)
        for clock, body in zip(clocks, ("payload", "agents"), strict=True)
    )
    return payload, agents


def _filter_label(
    state: SecondOrderLowPassState, x: Float[Array, "*shape"], b: Scalar, initialized: Scalar
) -> SecondOrderLowPassState:
    """Advance the label filter with the smoothing factor b; the first sample sets its steady state."""
    start = jax.tree.map(lambda old, new: new + initialized * (old - new), state, steady_state(x))
    return update(start, x, b)


def _update_agent(
    agent: AerialManipulator,
    filters: FilterBandwidths,
    payload: PayloadState,
    state: AgentFilterState,
    m: AgentReading,
    u: AgentInput,
    gravity: Float[Array, "3"],
    initialized: Scalar,
    dt: Scalar,
    clock: ReadingClock | None,
    *,
    contacts_closed: bool,
) -> tuple[AgentState, AgentBalance, AgentFilterState]:
    """Compute state and equations of motion of one agent, and its filter state with the label filters unchanged."""
    measured = NavState(R=m.R, x=m.x, v=m.v)
    fused, bias, omega, specific_force = nav_filter.update(
        (state.base, state.bias), measured, m.omega, m.a, gravity, filters, initialized, dt, clock
    )
    base = nav_filter.newest(fused, clock)
    b = smoothing_factor(filters.joint, dt)
    encoder = update(state.encoder, m.r, b)
    predicted = state.r + dt * state.r_dot
    r = predicted + initial_smoothing_factor(initialized, smoothing_factor(filters.complementary, dt)) * (
        m.r - predicted
    )
    g = aerial_manipulator.forward_kinematics(agent, r)
    # The rate of stage 2 follows from its own recursion; no second difference is needed.
    r_dot = (encoder.stage1 - encoder.stage2) * b / ((1 - b) * dt)
    if contacts_closed:
        r_dot = joint_rates(agent, g, base, omega, payload, r_dot)
    p = aerial_manipulator.centroidal_model(agent, g)
    xi = jnp.concatenate([omega, r_dot])
    velocity_offset = -(base.R @ (p.J_base @ xi))
    x, v = base.x + base.R @ p.com_from_base, base.v + velocity_offset
    q = AgentState(R=base.R, x=x, r=r, omega=omega, v=v, r_dot=r_dot)
    momenta = p.M_bar @ xi
    # Both differences span the same control period; the first period has none.
    momenta_dot = initialized * (momenta - state.momenta) / dt
    velocity_offset_dot = initialized * (velocity_offset - state.com_velocity_offset) / dt
    drift = aerial_manipulator.momentum_drift(agent, r, xi)
    force = p.mass * (base.R @ specific_force + velocity_offset_dot) - u.u * base.R[:, 2]
    moment = momenta_dot - drift - jnp.concatenate([u.tau, u.tau_r]) - u.u * p.J_base[2]
    modelled = state.modelled_force + initial_smoothing_factor(initialized, smoothing_factor(filters.tip_force, dt)) * (
        jnp.concatenate([force, moment]) - state.modelled_force
    )
    lam = m.lam if agent.closed_contacts is None else agent.closed_contacts[:, None] * m.lam
    tips = g.rotation[jnp.array(agent.tree.tip_bodies)]
    balance = AgentBalance(
        R=base.R, y=modelled, J_tip=p.J_tip, measured=jnp.einsum("bij,bj->bi", tips, lam), x=flatten_agent_state(q)
    )
    if m.moment is not None:
        closed = agent.closed_contacts
        reading = m.moment if closed is None else closed[:, None] * m.moment
        moments = jnp.einsum("bij,bj->bi", tips, reading)
        load = inverse_dynamics.contact_moment_load(agent, p, moments)
        balance = dataclasses.replace(balance, y=modelled.at[3:].add(load), moment=moments.sum(0))
    filtered = dataclasses.replace(state, base=fused, bias=bias, r=r, r_dot=r_dot, encoder=encoder)
    next_state = dataclasses.replace(
        filtered, momenta=momenta, com_velocity_offset=velocity_offset, modelled_force=modelled
    )
    return q, balance, next_state


def _filter_agent_label(
    state: AgentFilterState,
    balance: AgentBalance,
    lam_base: Float[Array, "arms 3"],
    lam_moments: Float[Array, "arms 3"],
    b: Scalar,
    initialized: Scalar,
) -> tuple[Float[Array, "outputs"], AgentFilterState, Float[Array, "arms 3"]]:
    """Compute the label of one agent (Eq. learning_output_components), and advance its filter.

    Args:
        state: Filter state of the previous control period.
        balance: Equations of motion of the agent.
        lam_base: Contact forces [N, base frame].
        lam_moments: Contact forces for the labels of moments [N, base frame].
        b: Smoothing factor of the label filter.
        initialized: 0 in the first control period, 1 afterwards.

    Returns:
        Label before the filter, filter state, and contact forces [N, world].
    """
    lam = lam_base @ balance.R.T
    moments = (balance.J_tip * lam_moments[:, :, None]).sum((0, 1))
    label = balance.y + jnp.concatenate([lam.sum(0), moments])
    filtered = dataclasses.replace(
        state,
        label=_filter_label(state.label, label, b, initialized),
        inputs=_filter_label(state.inputs, balance.x, b, initialized),
    )
    return label, filtered, lam
