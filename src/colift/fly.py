"""One tick on board: observe, record, predict, lead, allocate, realize. Memory is explicit; nothing sees the truth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift import allocate, control, estimate, grasp, learn, reference, so3
from colift.model import AgentInput, Residual, Team, Wrench
from colift.pytree import pytree
from colift.sensor import Measurement, Sample

Scalar = Float[Array, ""]


@pytree
class Internal:
    """An internal-force input that is switched on for a while."""

    eta: Float[Array, " eta"]  # N, coordinates in the allocation's kernel
    start: Scalar  # s
    end: Scalar  # s
    ramp: Scalar  # s


@pytree
class Recorder:
    """When samples are recorded, and whose."""

    every: Scalar  # s between samples, no less than the label filter's memory
    start: Scalar  # s, once the filters have settled
    end: Scalar  # s, T_end of Assumption dataset
    payload: Bool[Array, ""]
    agents: Bool[Array, ""]
    rig: Bool[Array, ""]  # samples of the calibration rig rather than estimated ones


@pytree
class Baseline:
    """What the rivals of learning do; all zero for the paper's cases."""

    K_i: Scalar  # 1/s^3, integral action on e_p
    k_i: Scalar  # 1/s^3, integral action on e_R
    observer: Scalar  # Hz, bandwidth of the wrench observer


@pytree
class Pilot:
    """Everything the team takes along: nominal parameters, gains, plans, settings."""

    team: Team  # nominal
    gains: control.Gains
    allocation: allocate.Allocation
    path: reference.Lissajous
    internal: Internal
    heading: tuple[Float[Array, "agents"], ...]  # rad
    rest: tuple[Float[Array, "agents n_r"], ...]
    filters: estimate.Filters
    recorder: Recorder
    baseline: Baseline


@pytree
class Memory:
    """What the flying software keeps between ticks."""

    estimator: estimate.Memory
    applied: tuple[AgentInput, ...]  # commands of the last tick, after the thrust limit
    payload_data: learn.Data
    agent_data: tuple[learn.Data, ...]
    integral: Float[Array, "6"]  # (K_i int e_p, k_i int e_R)
    observed: Float[Array, "6"]  # wrench observer's estimate
    W: Wrench  # desired wrench of the last tick
    next_sample: Scalar  # s


@pytree
class Telemetry:
    """What one tick decided, for the log."""

    q_hat: estimate.Estimate
    W_d: Wrench
    lam_cmd: Float[Array, "contacts 3"]
    f_hat: Residual
    eta: Float[Array, " eta"]
    saturated: tuple[Bool[Array, "agents"], ...]


def begin(pilot: Pilot, first: Measurement, capacity: int) -> Memory:
    """The memory before the first tick: empty data sets, the hover command as the one last applied."""
    team = pilot.team
    agents = []
    for size, group in zip(team.sizes, team.groups, strict=True):
        n_r = group.tree.joints
        agents.append(learn.empty(capacity, 18 + 2 * n_r, 6 + n_r, agents=(size,)))
    zero = Wrench(F=jnp.zeros(3), tau=jnp.zeros(3))
    return Memory(
        estimator=estimate.begin(team, first),
        applied=tuple(
            AgentInput(u=jnp.zeros(size), tau=jnp.zeros((size, 3)), tau_r=jnp.zeros((size, group.tree.joints)))
            for size, group in zip(team.sizes, team.groups, strict=True)
        ),
        payload_data=learn.empty(capacity, 24, 6),
        agent_data=tuple(agents),
        integral=jnp.zeros(6),
        observed=jnp.zeros(6),
        W=zero,
        next_sample=pilot.recorder.start,
    )


def tick(
    pilot: Pilot, oracle: learn.Oracle, memory: Memory, m: Measurement, t: Scalar, given: Residual
) -> tuple[tuple[AgentInput, ...], Memory, Telemetry]:
    """One control tick at time t, s: the commands, the next memory, and what was decided.

    `given` is a residual told from outside, zero in flight: the floor of a study feeds the exact one here.
    """
    recorder = pilot.recorder
    q_hat, seen = estimate.observe(pilot.team, pilot.filters, memory.estimator, m, memory.applied)
    due = (t >= memory.next_sample - 1e-9) & (t <= recorder.end + 1e-9)
    payload_data, agent_data = _record(recorder, memory, seen, m.rig, t, due)
    integral = _integrate(pilot, memory.integral, q_hat, reference.at(pilot.path, t))
    observed = _observe_wrench(pilot, memory, q_hat)
    inputs, decided = decide(pilot, oracle, q_hat, t, integral, observed, given)
    memory = Memory(
        estimator=seen,
        applied=inputs,
        payload_data=payload_data,
        agent_data=agent_data,
        integral=integral,
        observed=observed,
        W=decided.W_d,
        next_sample=memory.next_sample + jnp.where(due, recorder.every, 0.0),
    )
    return inputs, memory, decided


def decide(
    pilot: Pilot,
    oracle: learn.Oracle,
    q_hat: estimate.Estimate,
    t: Scalar,
    integral: Float[Array, "6"],
    observed: Float[Array, "6"],
    given: Residual,
) -> tuple[tuple[AgentInput, ...], Telemetry]:
    """The control law without memory: predict, lead, allocate, realize, at an estimated state."""
    team = pilot.team
    to = control.command(pilot.gains, q_hat.payload, q_hat.a_L[:3], reference.at(pilot.path, t), integral)
    f_hat = _predict(oracle, team, q_hat, to, observed, given)
    W = control.wrench(team.payload, team.gravity, q_hat.payload, to, f_hat.payload)
    internal = pilot.internal
    eta = reference.pulse(t, internal.start, internal.end, internal.ramp) * internal.eta
    lam = allocate.apply(pilot.allocation, q_hat.payload.R, W, eta)
    inputs, saturated = _realize(pilot, q_hat, to, lam, f_hat)
    return inputs, Telemetry(q_hat=q_hat, W_d=W, lam_cmd=lam, f_hat=f_hat, eta=eta, saturated=saturated)


def _record(
    recorder: Recorder, memory: Memory, seen: estimate.Memory, rig: Sample, t: Scalar, due: Bool[Array, ""]
) -> tuple[learn.Data, tuple[learn.Data, ...]]:
    """Append the filtered sample and its label, or the calibration rig's, where the case records."""

    def either(of_rig: Array, estimated: Array) -> Array:
        return jnp.where(recorder.rig, of_rig, estimated)

    label, told = estimate.payload_label(seen), rig.f.payload
    x = either(estimate.flat_payload(rig.z.payload, jnp.zeros(6)), seen.state.outer)
    y = either(jnp.concatenate([told.F, told.tau]), jnp.concatenate([label.F, label.tau]))
    payload = learn.record(memory.payload_data, x, y, t, due & recorder.payload)
    agents = []
    each = jax.vmap(learn.record, in_axes=(0, 0, 0, None, None))
    for data, past, z, f in zip(memory.agent_data, seen.agents, rig.z.agents, rig.f.agents, strict=True):
        x = either(jax.vmap(estimate.flat_agent)(z), past.state.outer)
        y = either(jnp.concatenate([f.f_x, f.f_w, f.f_r], axis=1), past.label.outer)
        agents.append(each(data, x, y, t, due & recorder.agents))
    return payload, tuple(agents)


def _integrate(
    pilot: Pilot, integral: Float[Array, "6"], q_hat: estimate.Estimate, d: reference.Setpoint
) -> Float[Array, "6"]:
    """Integral action of the baseline: `K_i e_p`, `k_i e_R` summed over ticks."""
    q = q_hat.payload
    rate = jnp.concatenate([pilot.baseline.K_i * (q.p - d.p), pilot.baseline.k_i * so3.e_R(q.R, d.R)])
    return integral + pilot.filters.dt * rate


def _observe_wrench(pilot: Pilot, memory: Memory, q_hat: estimate.Estimate) -> Float[Array, "6"]:
    """Wrench observer of the baseline: a low-pass of what the last command did not explain.

    `d = m_L (v_dot - a_g) - F_d`, `J w_dot + w x J w - tau_d`: residual and realization error in one.
    """
    team, q = pilot.team, q_hat.payload
    J = team.payload.inertia
    force = team.payload.mass * (q_hat.a_L[:3] - team.gravity) - memory.W.F
    moment = J @ q_hat.a_L[3:] + so3.cross(q.omega, J @ q.omega) - memory.W.tau
    # before the first tick there was no command to explain anything
    b = memory.estimator.warm * estimate.blend(pilot.baseline.observer, pilot.filters.dt)
    return memory.observed + b * (jnp.concatenate([force, moment]) - memory.observed)


def _predict(
    oracle: learn.Oracle,
    team: Team,
    q_hat: estimate.Estimate,
    to: control.Command,
    observed: Float[Array, "6"],
    given: Residual,
) -> Residual:
    """`f_hat`: the frozen oracles at the estimated state, the parametric part at the commanded acceleration."""
    q = q_hat.payload
    still = jnp.zeros(6)
    learned = learn.payload_mean(oracle, estimate.flat_payload(q, still))
    inertial = learn.regressor(q, to.a - team.gravity, to.alpha) @ oracle.theta
    agents = learn.agents_mean(oracle, tuple(jax.vmap(estimate.flat_agent)(s) for s in q_hat.agents))
    return Residual(
        payload=Wrench(
            F=learned.F + inertial[:3] + observed[:3] + given.payload.F,
            tau=learned.tau + inertial[3:] + observed[3:] + given.payload.tau,
        ),
        agents=jax.tree.map(jnp.add, agents, given.agents),
    )


def _realize(
    pilot: Pilot, q_hat: estimate.Estimate, to: control.Command, lam: Float[Array, "contacts 3"], f_hat: Residual
) -> tuple[tuple[AgentInput, ...], tuple[Bool[Array, "agents"], ...]]:
    """Every agent's command, thrust limited to what its rotors give; which thrusts were limited."""
    team = pilot.team
    rate = Wrench(F=team.payload.mass * to.jerk, tau=jnp.zeros(3))
    no_offset = allocate.Allocation(
        inverse=pilot.allocation.inverse,
        kernel=pilot.allocation.kernel,
        offset=jnp.zeros_like(pilot.allocation.offset),
    )
    lam_dot = allocate.apply(no_offset, q_hat.payload.R, rate, jnp.zeros_like(pilot.internal.eta))
    inputs, saturated = [], []
    realize = jax.vmap(control.realize, in_axes=(0, None, None, 0, None, None, 0, 0))
    parts = zip(
        team.groups,
        q_hat.agents,
        grasp.split(team, lam),
        grasp.split(team, lam_dot),
        pilot.heading,
        pilot.rest,
        f_hat.agents,
        strict=True,
    )
    for group, q, force, force_dot, heading, rest, f in parts:
        share = control.Share(lam=force, lam_dot=force_dot, heading=heading, rest=rest)
        asked = realize(group, pilot.gains, team.gravity, q, q_hat.payload, to, share, f)
        u = jnp.clip(asked.u, 0.0, group.thrust_max)
        inputs.append(AgentInput(u=u, tau=asked.tau, tau_r=asked.tau_r))
        saturated.append(u != asked.u)
    return tuple(inputs), tuple(saturated)
