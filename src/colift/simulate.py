"""Closes the loop: truth, sensors, flight software, log; and the updates of the learned models at times t_k."""

from __future__ import annotations

import dataclasses
import functools
import logging
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from colift import balance, band, deviation, dynamics, fly, grasp, innovation, interrupt, learn, limits, native, so3
from colift.deviation import Biases, Held, Sigma
from colift.model import Agent, AgentForce, AgentInput, AgentState, Clock, Inputs, Residual, State, Team, Wrench
from colift.pytree import pytree
from colift.school import Identify, Regress, Renewals, School, Update
from colift.world import Truth

Scalar = Float[Array, ""]

log = logging.getLogger(__name__)


@pytree
class Loop:
    """The state of world and pilot between ticks."""

    world: Any
    memory: Any
    tick: Int[Array, ""]
    saturated: tuple[Int[Array, "agents"], ...]  # ticks that each thrust has been at its limit without a break
    ended: Int[Array, ""]  # the `limits.Cause`, 0 while the flight goes on


@pytree
class Setup:
    """Who flies where: what a tick needs beside the state of the loop."""

    world: Any  # a `world.World`
    pilot: Any  # a `fly.Pilot`
    limits: limits.Limits
    dt: Scalar  # s, the clock's tick


@pytree
class Row:
    """What the log keeps of one tick; agents, joints and contacts of all groups in a row."""

    t: Float[Array, "*time"]
    p: Float[Array, "*time 3"]
    v: Float[Array, "*time 3"]
    R_L: Float[Array, "*time 3 3"]
    omega_L: Float[Array, "*time 3"]
    a_L: Float[Array, "*time 6"]
    p_d: Float[Array, "*time 3"]
    e_p: Float[Array, "*time 3"]
    e_v: Float[Array, "*time 3"]
    e_R: Float[Array, "*time 3"]
    e_omega: Float[Array, "*time 3"]
    Psi: Float[Array, "*time"]
    R: Float[Array, "*time agents 3 3"]
    x: Float[Array, "*time agents 3"]
    omega: Float[Array, "*time agents 3"]
    x_dot: Float[Array, "*time agents 3"]
    r: Float[Array, "*time joints"]
    r_dot: Float[Array, "*time joints"]
    u: Float[Array, "*time agents"]
    tau: Float[Array, "*time agents 3"]
    tau_r: Float[Array, "*time joints"]
    saturated: Bool[Array, "*time agents"]
    lam: Float[Array, "*time contacts 3"]
    lam_cmd: Float[Array, "*time contacts 3"]
    lam_hat: Float[Array, "*time contacts 3"]
    R_L_hat: Float[Array, "*time 3 3"]
    W_d: Float[Array, "*time 6"]
    delta_W: Float[Array, "*time 6"]
    eta: Float[Array, "*time eta"]
    f_L: Float[Array, "*time 6"]
    f_L_hat: Float[Array, "*time 6"]
    f_x: Float[Array, "*time agents 3"]
    f_w: Float[Array, "*time agents 3"]
    f_r: Float[Array, "*time joints"]
    f_x_hat: Float[Array, "*time agents 3"]
    f_w_hat: Float[Array, "*time agents 3"]
    f_r_hat: Float[Array, "*time joints"]
    Phi: Float[Array, "*time"]
    Phi_dot: Float[Array, "*time"]
    singular: Float[Array, "*time agents"]
    # of pilots that listen to labels
    r_L: Float[Array, "*time 6"] | None = None
    r_x: Float[Array, "*time agents 3"] | None = None
    trust_L: Float[Array, "*time 6"] | None = None
    trust_x: Float[Array, "*time agents 3"] | None = None
    late_L: Float[Array, "*time 6"] | None = None
    late_x: Float[Array, "*time agents 3"] | None = None
    left_L: Float[Array, "*time 6"] | None = None
    left_x: Float[Array, "*time agents 3"] | None = None
    fresh: Float[Array, "*time"] | None = None
    comes: Float[Array, "*time"] | None = None


def residual(nominal: Team, z: State, a: dynamics.Acceleration, lam: tuple, inputs: Inputs) -> Residual:
    """What the nominal equations leave over when the truth accelerates by `a`: the labels without any error.

    It is `f_uk` itself where the parameters are right, and holds the mass and inertia mismatch where they are not.
    """
    q, g = z.payload, nominal.gravity
    W = grasp.wrench(grasp.contacts(nominal), q.R, grasp.join(lam))
    known = balance.payload(nominal.payload, a.payload[:3] - g, a.payload[3:], q.omega)
    agents = tuple(
        jax.vmap(_agent_residual, in_axes=(0, 0, 0, 0, 0, None))(group, state, acc, part, u, g)
        for group, state, acc, part, u in zip(nominal.groups, z.agents, a.agents, lam, inputs, strict=True)
    )
    return Residual(agents=agents, payload=Wrench(F=known.F - W.F, tau=known.tau - W.tau))


def _agent_residual(
    agent: Agent,
    q: AgentState,
    a: dynamics.AgentAcceleration,
    lam: Float[Array, "arms 3"],
    u: AgentInput,
    gravity: Float[Array, "3"],
) -> AgentForce:
    force, Q, thrust = balance.agent(agent, q, a.v_dot - gravity, a.xi_dot, lam)
    Q = Q - jnp.concatenate([u.tau, u.tau_r]) - u.u * thrust
    return AgentForce(f_x=force - u.u * q.R[:, 2], f_w=Q[:3], f_r=Q[3:])


def start(setup: Setup, z: State) -> Loop:
    """The loop before its first tick: the team at z, held by the command of a noise-free tick at rest."""
    return _program(_start, setup, z)(setup, z)


def _start(setup: Setup, z: State) -> Loop:
    command, memory = setup.pilot.begin(setup.world.rest(z), Clock(t=jnp.zeros(()), dt=setup.dt))
    return Loop(
        world=setup.world.begin(z, command),
        memory=memory,
        tick=jnp.zeros((), int),
        saturated=tuple(jnp.zeros(size, int) for size in setup.world.team.sizes),
        ended=jnp.zeros((), int),
    )


def tick(setup: Setup, loop: Loop, noise: Any) -> tuple[Loop, Row]:
    """Measure, fly, step, log: one control period with the commands held."""
    world, dt = setup.world, setup.dt
    clock = Clock(t=loop.tick.astype(dt.dtype) * dt, dt=dt)
    m, state = world.sense(loop.world, clock, noise)
    command, memory, decided = setup.pilot.tick(loop.memory, m, clock)
    state, truth = world.step(state, command, clock)
    row = _row(world.team, setup.pilot.team, clock.t, truth, decided)
    saturated = tuple(jnp.where(now, past + 1, 0) for past, now in zip(loop.saturated, decided.saturated, strict=True))
    watched = _watched(row, _finite(state.z) & _finite(row), jnp.concatenate(saturated).astype(dt.dtype) * dt)
    loop = Loop(
        world=state,
        memory=memory,
        tick=loop.tick + 1,
        saturated=saturated,
        ended=jnp.where(loop.ended > 0, loop.ended, limits.exceeded(setup.limits, watched)),
    )
    return loop, row


def _watched(row: Row, finite: Bool[Array, ""], saturated: Float[Array, "agents"]) -> limits.Watched:
    """What may end the flight: the row of one tick, and for how long each thrust has been at its limit, s."""
    return limits.Watched(
        finite=finite,
        grip=row.singular,
        distance=jnp.sqrt((row.e_p * row.e_p).sum()),
        heights=jnp.concatenate([row.p[2:], row.x[:, 2]]),
        attitude=jnp.arccos(jnp.clip(1 - row.Psi, -1.0, 1.0)),
        tilt=jnp.arccos(jnp.clip(row.R[:, 2, 2], -1.0, 1.0)),
        saturated=saturated,
    )


def _finite(tree: object) -> Bool[Array, ""]:
    return jnp.stack([jnp.isfinite(x).all() for x in jax.tree.leaves(tree)]).all()


def _row(team: Team, nominal: Team, t: Scalar, truth: Truth, decided: fly.Telemetry) -> Row:
    z, a, inputs = truth.z, truth.a, truth.inputs
    q, d = z.payload, decided.d
    force = grasp.join(truth.lam)
    # the mismatch at the attitude the allocator used, so that delta_W = G e_lam holds exactly
    W = grasp.wrench(grasp.contacts(nominal), decided.q_hat.payload.R, force)
    f = residual(nominal, z, a, truth.lam, inputs)
    f_hat = decided.f_hat
    vec = lambda W: jnp.concatenate([W.F, W.tau])  # noqa: E731
    agents = lambda parts: jnp.concatenate(list(parts))  # noqa: E731
    joints = lambda parts: jnp.concatenate([x.reshape(-1) for x in parts])  # noqa: E731
    return Row(
        t=t,
        p=q.p,
        v=q.v,
        R_L=q.R,
        omega_L=q.omega,
        a_L=a.payload,
        p_d=d.p,
        e_p=q.p - d.p,
        e_v=q.v - d.v,
        e_R=so3.e_R(q.R, d.R),
        e_omega=so3.e_omega(q.R, q.omega, d.R, d.omega),
        Psi=so3.Psi(q.R, d.R),
        R=agents(s.R for s in z.agents),
        x=agents(s.x for s in z.agents),
        omega=agents(s.omega for s in z.agents),
        x_dot=agents(s.v for s in z.agents),
        r=joints(s.r for s in z.agents),
        r_dot=joints(s.r_dot for s in z.agents),
        u=agents(u.u for u in inputs),
        tau=agents(u.tau for u in inputs),
        tau_r=joints(u.tau_r for u in inputs),
        saturated=agents(decided.saturated),
        lam=force,
        lam_cmd=decided.lam_cmd,
        lam_hat=grasp.join(decided.q_hat.lam),
        R_L_hat=decided.q_hat.payload.R,
        W_d=vec(decided.W_d),
        delta_W=vec(W) - vec(decided.W_d),
        eta=decided.eta,
        f_L=vec(f.payload),
        f_L_hat=vec(f_hat.payload),
        f_x=agents(x.f_x for x in f.agents),
        f_w=agents(x.f_w for x in f.agents),
        f_r=joints(x.f_r for x in f.agents),
        f_x_hat=agents(x.f_x for x in f_hat.agents),
        f_w_hat=agents(x.f_w for x in f_hat.agents),
        f_r_hat=joints(x.f_r for x in f_hat.agents),
        Phi=jnp.abs(grasp.Phi(team, z)).max(),
        Phi_dot=jnp.abs(grasp.Phi_dot(team, z)).max(),
        singular=dynamics.grip(team, z),
        **({} if (news := decided.news) is None else _news(news)),
    )


def _news(news: innovation.News) -> dict[str, Array]:
    def parts(of: Residual) -> tuple[Array, Array]:
        return jnp.concatenate([of.payload.F, of.payload.tau]), jnp.concatenate([agent.f_x for agent in of.agents])

    told = {"r": news.r, "trust": news.trust, "late": news.late, "left": news.left}
    split = {f"{name}_{body}": x for name, of in told.items() for body, x in zip("Lx", parts(of), strict=True)}
    return split | {"fresh": news.fresh, "comes": news.comes}


def advance(setup: Setup, loop: Loop, noise: Any, ticks: Int[Array, ""]) -> tuple[Loop, Row]:
    """Up to `ticks` ticks, at most as many as there is noise; stops after the tick that met a limit.

    In native code where there is a C compiler, by JAX where there is none or a part calls what has no native code.
    The number of ticks is data, not shape: intervals of any length share one compiled program.
    """
    return program(setup, loop, noise, ticks)(setup, loop, noise, ticks)


def program(*like: Any) -> Callable[..., tuple[Loop, Row]]:
    """What `advance` runs for arguments like these: many short calls need not look it up each time."""
    return _program(_advance, *like)


def _program(f: Callable[..., Any], *like: Any) -> Callable[..., Any]:
    leaves, structure = jax.tree.flatten(like)
    return _compiled(f, structure, tuple(map(jax.typeof, leaves)))


@functools.cache
def _compiled(f: Callable[..., Any], structure: Any, like: tuple[Any, ...]) -> Callable[..., Any]:
    compiled = jax.jit(native.compile(f))
    try:
        compiled.lower(*jax.tree.unflatten(structure, like))
    except native.UnsupportedPrimitive as error:
        log.info("flown by JAX, a few times slower: %s", error)
        return jax.jit(f)
    return compiled


def _advance(setup: Setup, loop: Loop, noise: Any, ticks: Int[Array, ""]) -> tuple[Loop, Row]:
    room, now = jax.tree.leaves(noise)[0].shape[0], lambda i: jax.tree.map(lambda x: x[i], noise)
    one = jax.jit(tick)  # traced once, for its row's shapes and for the loop
    shape = jax.eval_shape(one, setup, loop, jax.eval_shape(now, 0))[1]
    rows = jax.tree.map(lambda s: jnp.zeros((room, *s.shape), s.dtype), shape)

    def body(carry: tuple[Loop, Row, Int[Array, ""]]) -> tuple[Loop, Row, Int[Array, ""]]:
        loop, rows, i = carry
        loop, row = one(setup, loop, now(i))
        return loop, jax.tree.map(lambda buffer, x: buffer.at[i].set(x), rows, row), i + 1

    def go_on(carry: tuple[Loop, Row, Int[Array, ""]]) -> Bool[Array, ""]:
        return (carry[2] < jnp.minimum(ticks, room)) & (carry[0].ended == 0)

    loop, rows, _ = jax.lax.while_loop(go_on, body, (loop, rows, jnp.zeros((), int)))
    return loop, rows


@dataclasses.dataclass(frozen=True)
class Plan:
    """One run: who flies where, how long, and when it learns."""

    world: Any  # a `world.World`
    pilot: Any  # a `fly.Pilot`; one that learns is a `fly.LeaderFollower`
    agents: tuple[str, ...]  # their names, in team order
    limits: limits.Limits
    dt: float  # s, the clock's tick
    z: State  # on the manifold
    duration: float  # s
    updates: tuple[float, ...]  # t_k, s, at which hyperparameters are fitted
    training: learn.Training | None  # None: hyperparameters as stated by the oracle before any data
    identify: Identify | Regress | None  # what learns instead of GPs
    stated: band.Stated  # what the radii along the run rest on
    biases: Biases  # what data sheets state of constant errors
    seed: int
    renewals: Renewals | None = None  # between and after those
    latency: float | None = 0.0  # s that a fit takes until what it learned flies; None: as long as it takes here

    @property
    def setup(self) -> Setup:
        """What its ticks need, before anything is learned."""
        return Setup(world=self.world, pilot=self.pilot, limits=self.limits, dt=jnp.asarray(self.dt))


@dataclasses.dataclass(frozen=True)
class Flight:
    """A run as it was flown."""

    rows: Row  # NumPy arrays
    sigma: Sigma
    updates: tuple[Update, ...]
    stopped: str  # empty if the run is complete; else what failed, where and when
    held: tuple[Held, ...]  # its oracles, from the first tick on
    wall: dict[str, float]  # s, by stage
    unused: tuple[str, ...] = ()  # sentences: fits that failed, came too late or were not begun, and why

    @property
    def oracle(self) -> learn.Oracle:
        """The last one."""
        return self.held[-1].oracle

    @property
    def bands(self) -> band.Bands:
        """Of that oracle."""
        return self.held[-1].bands


CHUNK = 0.5  # s of flight between two reports of progress, and between two looks at the status
SIGMA_EVERY = 0.02  # s, at most the control period


def chunk(plan: Plan) -> int:
    """How many ticks are flown, and how much noise is drawn, at once."""
    return max(1, round(CHUNK / plan.dt))


def fly_plan(
    plan: Plan,
    progress: Callable[[float], None] = lambda _t: None,
    seen: Callable[[Row], None] = lambda _rows: None,
) -> Flight:
    """Fly a plan: chunks of ticks on the device, fits on the host at each update time.

    Stops at the tick at which something is no longer finite, a grasp is near singular or another of the world's limits
    is exceeded; what was flown until then is returned, with the reason in words. `progress` hears the time reached, s;
    `seen` is handed the rows of each chunk as it ends.
    """
    dt, setup = plan.dt, plan.setup
    room, ticks = chunk(plan), round(plan.duration / dt)
    school, due = School(plan.training, plan.identify, plan.renewals), _times(plan)
    key = jax.random.fold_in(jax.random.key(plan.seed), 2)
    oracle, updates, flown, coming = plan.pilot.oracle, [], [], None
    busy: list[float] = []  # s, when something was to be learned while what was learned before was not ready
    wall = {"simulation": 0.0, "fit": 0.0}
    held = [Held(first=0, oracle=oracle, bands=band.bands(oracle, plan.stated, 1))]
    loop = start(setup, plan.z)
    done, stopped = 0, ""
    progress(0.0)
    while done < ticks and not stopped:
        interrupt.check()
        first = done - done % room  # noise is drawn in whole chunks of the run, wherever an update cuts them
        stops = [k for k in (*due, ticks, *([coming[0]] if coming else [])) if k > done]
        until = min(first + room, *stops)
        began = time.perf_counter()
        noise = _draw(plan.world, jax.random.fold_in(key, first), room)
        if done > first:
            noise = jax.tree.map(lambda x, used=done - first: jnp.roll(x, -used, axis=0), noise)
        loop, rows = advance(setup, loop, noise, jnp.asarray(until - done))
        last = int(loop.tick)
        rows = jax.tree.map(lambda x, n=last - done: np.asarray(x)[:n], rows)
        flown.append(rows)
        if int(loop.ended):
            stopped = _why(plan, rows, loop)
        done = last
        wall["simulation"] += time.perf_counter() - began
        seen(rows)
        began = time.perf_counter()
        asked = done in due and done < ticks
        while not stopped:
            if coming and coming[0] <= done:
                _, oracle, update = coming
                coming = None
                setup = dataclasses.replace(setup, pilot=dataclasses.replace(plan.pilot, oracle=oracle))
                bands = band.bands(oracle, plan.stated, len(updates) + 1)
                held.append(Held(first=done, oracle=oracle, bands=bands, doubts=update.doubts))
                updates.append(dataclasses.replace(update, ready=done * dt))
            elif asked and coming is None:
                asked = False
                learned, update = school.teach(oracle, loop.memory.recorder, done * dt, fit=due[done])
                taken = time.perf_counter() - began if plan.latency is None else plan.latency
                coming = done + round(taken / dt), learned, update
            else:
                break
        if asked and not stopped:
            busy.append(done * dt)
        wall["fit"] += time.perf_counter() - began
        progress(done * dt)
    rows, began = jax.tree.map(lambda *x: np.concatenate(x), *flown), time.perf_counter()
    sigma = _deviations(plan, held, rows)
    return Flight(
        rows=rows,
        sigma=sigma,
        updates=tuple(updates),
        stopped=stopped,
        held=tuple(held),
        wall=wall | {"radii": time.perf_counter() - began},
        unused=_unused(updates, busy, None if coming is None else coming[2]),
    )


def _unused(updates: Sequence[Update], busy: Sequence[float], coming: Update | None) -> tuple[str, ...]:
    """What was to be learned and did not fly, in sentences: fits that failed, were not begun or are still to come."""
    said = [update.failed for update in updates if update.failed]
    if busy:
        times = ", ".join(f"{t:.3f}" for t in busy)
        said.append(
            f"nothing was learned at t = {times} s: what was learned before was not ready (learning.fit_latency)"
        )
    if coming is not None:
        said.append(f"what was learned at t = {coming.t:.3f} s was not ready when the flight ended")
    return tuple(said)


_draw = jax.jit(lambda world, key, ticks: world.draw(key, ticks), static_argnums=2)


def _times(plan: Plan) -> dict[int, bool]:
    """The ticks at which something is learned, in order, and whether hyperparameters are fitted there."""
    fits = {round(t / plan.dt) for t in plan.updates if t < plan.duration}
    renewals = () if plan.renewals is None else plan.renewals.times
    others = {round(t / plan.dt) for t in renewals if t < plan.duration}
    return {tick: tick in fits for tick in sorted(fits | others)}


def _deviations(plan: Plan, held: Sequence[Held], rows: Row) -> Sigma:
    """Deviations and radii at the true states of a flight, every so many ticks."""
    every = max(1, round(SIGMA_EVERY / plan.dt))
    seldom = jax.tree.map(lambda x: x[::every], rows)
    x, agents = inputs(plan.world.team, seldom)
    a = seldom.a_L - np.concatenate([np.asarray(plan.pilot.team.gravity), np.zeros(3)])
    x = np.concatenate([x, a], axis=1)
    return deviation.along(plan.pilot.team, held, every, plan.biases, np.asarray(seldom.t), x, agents)


def inputs(team: Team, rows: Row) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """The learned maps' inputs at the true states of a flight: `(time, 18)`, and `(time, agents, inputs)` by group."""
    time = len(rows.t)
    agents, first, joint = [], 0, 0
    for size, group in zip(team.sizes, team.groups, strict=True):
        one, many = slice(first, first + size), slice(joint, joint + size * group.tree.joints)
        r, r_dot = (a[:, many].reshape(time, size, -1) for a in (rows.r, rows.r_dot))
        R, x, omega, v = (a[:, one] for a in (rows.R, rows.x, rows.omega, rows.x_dot))
        agents.append(np.concatenate([R.reshape(time, size, 9), x, r, omega, v, r_dot], axis=2))
        first, joint = one.stop, many.stop
    payload = np.concatenate([rows.p, rows.v, rows.R_L.reshape(time, 9), rows.omega_L], axis=1)
    return payload, tuple(agents)


EFFECTS = ("a_L", "lam", "delta_W", "f_L", "f_x", "f_w", "f_r")  # what follows from everything else in a tick


def _why(plan: Plan, rows: Row, loop: Loop) -> str:
    """What ended a run: a signal not finite, causes first; an agent and its arms near singular; or another limit."""
    t, cause, allowed = rows.t[-1], limits.Cause(int(loop.ended)), plan.limits
    if cause == limits.Cause.NOT_FINITE:
        signals = [field.name for field in dataclasses.fields(rows) if getattr(rows, field.name) is not None]
        for signal in sorted(signals, key=EFFECTS.__contains__):
            if not np.isfinite(getattr(rows, signal)[-1]).all():
                return f"signal {signal} is not finite at t = {t:.3f} s"
        return f"the state is not finite after t = {t:.3f} s"
    if cause == limits.Cause.GRIP:
        weak = int(np.argmin(rows.singular[-1] / np.asarray(allowed.grip)))
        value, arms = rows.singular[-1, weak], grasp.opposed(_admittance(plan.world.team, np.asarray(rows.r)[-1], weak))
        return (
            f"the grasp of agent {plan.agents[weak]} is near singular at t = {t:.3f} s: "
            f"{value:.3g} < {float(allowed.grip[weak]):.3g} 1/kg (limits.grip); {arms}"
        )
    held = jnp.concatenate(loop.saturated).astype(float) * plan.dt
    now = _watched(jax.tree.map(lambda x: jnp.asarray(x[-1]), rows), jnp.asarray(True), held)
    return limits.sentence(cause, allowed, jax.tree.map(np.asarray, now), float(t), plan.agents)


def _admittance(team: Team, r: np.ndarray, agent: int) -> np.ndarray:
    """Of one agent, counted through the groups, as are the joints of all agents in r."""
    for size, group in zip(team.sizes, team.groups, strict=True):
        joints = group.tree.joints
        if agent < size:
            own = jnp.asarray(r[agent * joints : (agent + 1) * joints])
            return np.asarray(grasp.admittance(jax.tree.map(lambda x, j=agent: x[j], group), own))
        agent, r = agent - size, r[size * joints :]
    raise IndexError(f"agent {agent} beyond the team")
