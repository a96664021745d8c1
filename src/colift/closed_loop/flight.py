"""Closes the loop: truth, sensors, flight software, log; and the updates of the learned models at times t_k."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift.closed_loop import termination
from colift.closed_loop.signals import EFFECTS, Row, _admittance, inputs
from colift.closed_loop.simulator import Loop, Setup, _watched, advance, start
from colift.models import grasp
from colift.models.state import State
from colift.onboard.learning import confidence_bounds, model_update, prediction_uncertainty, residual_model
from colift.onboard.learning.online_learner import Identify, Regress, Renewals, School, Update
from colift.onboard.learning.prediction_uncertainty import Biases, Held, Sigma
from colift.runtime import signals


@dataclasses.dataclass(frozen=True)
class Plan:
    """One run: who flies where, how long, and when it learns."""

    world: Any  # a `world.World`
    pilot: Any  # a `fly.Pilot`; one that learns is a `fly.LeaderFollower`
    agents: tuple[str, ...]  # their names, in team order
    termination: termination.Limits
    dt: float  # s, the clock's tick
    z: State  # on the manifold
    duration: float  # s
    updates: tuple[float, ...]  # t_k, s, at which hyperparameters are fitted
    training: model_update.Training | None  # None: hyperparameters as stated by the oracle before any data
    identify: Identify | Regress | None  # what learns instead of GPs
    stated: confidence_bounds.Stated  # what the radii along the run rest on
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
    def oracle(self) -> residual_model.Oracle:
        """The last one."""
        return self.held[-1].oracle

    @property
    def bands(self) -> confidence_bounds.Bands:
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
    held = [Held(first=0, oracle=oracle, bands=confidence_bounds.bands(oracle, plan.stated, 1))]
    loop = start(setup, plan.z)
    done, stopped = 0, ""
    progress(0.0)
    while done < ticks and not stopped:
        signals.check()
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
                bands = confidence_bounds.bands(oracle, plan.stated, len(updates) + 1)
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
    return prediction_uncertainty.along(plan.pilot.team, held, every, plan.biases, np.asarray(seldom.t), x, agents)


def _why(plan: Plan, rows: Row, loop: Loop) -> str:
    """What ended a run: a signal not finite, causes first; an agent and its arms near singular; or another limit."""
    t, cause, allowed = rows.t[-1], termination.Cause(int(loop.ended)), plan.limits
    if cause == termination.Cause.NOT_FINITE:
        signals = [field.name for field in dataclasses.fields(rows) if getattr(rows, field.name) is not None]
        for signal in sorted(signals, key=EFFECTS.__contains__):
            if not np.isfinite(getattr(rows, signal)[-1]).all():
                return f"signal {signal} is not finite at t = {t:.3f} s"
        return f"the state is not finite after t = {t:.3f} s"
    if cause == termination.Cause.GRIP:
        weak = int(np.argmin(rows.singular[-1] / np.asarray(allowed.grip)))
        value, arms = rows.singular[-1, weak], grasp.opposed(_admittance(plan.world.team, np.asarray(rows.r)[-1], weak))
        return (
            f"the grasp of agent {plan.agents[weak]} is near singular at t = {t:.3f} s: "
            f"{value:.3g} < {float(allowed.grip[weak]):.3g} 1/kg (limits.grip); {arms}"
        )
    held = jnp.concatenate(loop.saturated).astype(float) * plan.dt
    now = _watched(jax.tree.map(lambda x: jnp.asarray(x[-1]), rows), jnp.asarray(True), held)
    return termination.sentence(cause, allowed, jax.tree.map(np.asarray, now), float(t), plan.agents)
