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
from colift.closed_loop.signals import DERIVED_SIGNALS, StepRecord, _admittance, model_inputs
from colift.closed_loop.simulator import LoopConfig, LoopState, _watched, reset, rollout
from colift.models import grasp
from colift.models.state import State
from colift.onboard.learning import confidence_bounds, model_update, prediction_uncertainty, residual_model
from colift.onboard.learning.online_learner import (
    IdentificationOptions,
    ModelUpdate,
    OnlineLearner,
    OnlineUpdateOptions,
    RidgeOptions,
)
from colift.onboard.learning.prediction_uncertainty import LabelBiasModel, ModelInterval, PredictionUncertainty
from colift.runtime import signals


@dataclasses.dataclass(frozen=True)
class Experiment:
    """One run: who flies where, how long, and when it learns."""

    world: Any  # a `world.World`
    controller: Any  # a `fly.Pilot`; one that learns is a `fly.LeaderFollower`
    agent_names: tuple[str, ...]  # their names, in team order
    termination_limits: termination.TerminationLimits
    dt: float  # s, the clock's tick
    initial_state: State  # on the manifold
    duration: float  # s
    update_times: tuple[float, ...]  # t_k, s, at which hyperparameters are fitted
    fit_options: model_update.FitOptions | None  # None: hyperparameters as stated by the oracle before any data
    identification: IdentificationOptions | RidgeOptions | None  # what learns instead of GPs
    bound_assumptions: confidence_bounds.BoundAssumptions  # what the radii along the run rest on
    label_biases: LabelBiasModel  # what data sheets state of constant errors
    seed: int
    online_updates: OnlineUpdateOptions | None = None  # between and after those
    fit_latency: float | None = 0.0  # s that a fit takes until what it learned flies; None: as long as it takes here

    @property
    def loop_config(self) -> LoopConfig:
        """What its ticks need, before anything is learned."""
        return LoopConfig(
            world=self.world,
            controller=self.controller,
            termination_limits=self.termination_limits,
            dt=jnp.asarray(self.dt),
        )


@dataclasses.dataclass(frozen=True)
class FlightResult:
    """A run as it was flown."""

    records: StepRecord  # NumPy arrays
    uncertainty: PredictionUncertainty
    updates: tuple[ModelUpdate, ...]
    termination_reason: str  # empty if the run is complete; else what failed, where and when
    model_intervals: tuple[ModelInterval, ...]  # its oracles, from the first tick on
    wall_time: dict[str, float]  # s, by stage
    learning_warnings: tuple[str, ...] = ()  # sentences: fits that failed, came too late or were not begun, and why

    @property
    def model(self) -> residual_model.ResidualModel:
        """The last one."""
        return self.model_intervals[-1].model

    @property
    def bands(self) -> confidence_bounds.ConfidenceBands:
        """Of that oracle."""
        return self.model_intervals[-1].bands


CHUNK_DURATION = 0.5  # s of flight between two reports of progress, and between two looks at the status
UNCERTAINTY_PERIOD = 0.02  # s, at most the control period


def ticks_per_chunk(experiment: Experiment) -> int:
    """How many ticks are flown, and how much noise is drawn, at once."""
    return max(1, round(CHUNK_DURATION / experiment.dt))


def run_experiment(
    experiment: Experiment,
    progress: Callable[[float], None] = lambda _t: None,
    seen: Callable[[StepRecord], None] = lambda _rows: None,
) -> FlightResult:
    """Fly a plan: chunks of ticks on the device, fits on the host at each update time.

    Stops at the tick at which something is no longer finite, a grasp is near singular or another of the world's limits
    is exceeded; what was flown until then is returned, with the reason in words. `progress` hears the time reached, s;
    `seen` is handed the rows of each chunk as it ends.
    """
    dt, setup = experiment.dt, experiment.loop_config
    room, ticks = ticks_per_chunk(experiment), round(experiment.duration / dt)
    school, due = (
        OnlineLearner(experiment.fit_options, experiment.identification, experiment.online_updates),
        _times(experiment),
    )
    key = jax.random.fold_in(jax.random.key(experiment.seed), 2)
    model, updates, flown, coming = experiment.controller.residual_model, [], [], None
    busy: list[float] = []  # s, when something was to be learned while what was learned before was not ready
    wall = {"simulation": 0.0, "fit": 0.0}
    held = [
        ModelInterval(
            start_tick=0, model=model, bands=confidence_bounds.confidence_bands(model, experiment.bound_assumptions, 1)
        )
    ]
    loop = reset(setup, experiment.initial_state)
    done, stopped = 0, ""
    progress(0.0)
    while done < ticks and not stopped:
        signals.raise_if_interrupted()
        first = done - done % room  # noise is drawn in whole chunks of the run, wherever an update cuts them
        stops = [k for k in (*due, ticks, *([coming[0]] if coming else [])) if k > done]
        until = min(first + room, *stops)
        began = time.perf_counter()
        noise = _draw(experiment.world, jax.random.fold_in(key, first), room)
        if done > first:
            noise = jax.tree.map(lambda x, used=done - first: jnp.roll(x, -used, axis=0), noise)
        loop, rows = rollout(setup, loop, noise, jnp.asarray(until - done))
        last = int(loop.tick)
        rows = jax.tree.map(lambda x, n=last - done: np.asarray(x)[:n], rows)
        flown.append(rows)
        if int(loop.termination):
            stopped = _why(experiment, rows, loop)
        done = last
        wall["simulation"] += time.perf_counter() - began
        seen(rows)
        began = time.perf_counter()
        requested = done in due and done < ticks
        while not stopped:
            if coming and coming[0] <= done:
                _, model, update = coming
                coming = None
                setup = dataclasses.replace(
                    setup, controller=dataclasses.replace(experiment.controller, residual_model=model)
                )
                bands = confidence_bounds.confidence_bands(model, experiment.bound_assumptions, len(updates) + 1)
                held.append(
                    ModelInterval(
                        start_tick=done, model=model, bands=bands, mean_uncertainties=update.mean_uncertainties
                    )
                )
                updates.append(dataclasses.replace(update, activation_time=done * dt))
            elif requested and coming is None:
                requested = False
                learned, update = school.update(model, loop.controller.recorder, done * dt, fit=due[done])
                taken = time.perf_counter() - began if experiment.fit_latency is None else experiment.fit_latency
                coming = done + round(taken / dt), learned, update
            else:
                break
        if requested and not stopped:
            busy.append(done * dt)
        wall["fit"] += time.perf_counter() - began
        progress(done * dt)
    rows, began = jax.tree.map(lambda *x: np.concatenate(x), *flown), time.perf_counter()
    sigma = _deviations(experiment, held, rows)
    return FlightResult(
        records=rows,
        uncertainty=sigma,
        updates=tuple(updates),
        termination_reason=stopped,
        model_intervals=tuple(held),
        wall_time=wall | {"radii": time.perf_counter() - began},
        learning_warnings=_unused(updates, busy, None if coming is None else coming[2]),
    )


def _unused(updates: Sequence[ModelUpdate], busy: Sequence[float], coming: ModelUpdate | None) -> tuple[str, ...]:
    """What was to be learned and did not fly, in sentences: fits that failed, were not begun or are still to come."""
    said = [update.error_message for update in updates if update.error_message]
    if busy:
        times = ", ".join(f"{t:.3f}" for t in busy)
        said.append(
            f"nothing was learned at t = {times} s: what was learned before was not ready (learning.fit_latency)"
        )
    if coming is not None:
        said.append(f"what was learned at t = {coming.t:.3f} s was not ready when the flight ended")
    return tuple(said)


_draw = jax.jit(lambda world, key, ticks: world.sample_noise(key, ticks), static_argnums=2)


def _times(experiment: Experiment) -> dict[int, bool]:
    """The ticks at which something is learned, in order, and whether hyperparameters are fitted there."""
    fits = {round(t / experiment.dt) for t in experiment.update_times if t < experiment.duration}
    renewals = () if experiment.online_updates is None else experiment.online_updates.times
    others = {round(t / experiment.dt) for t in renewals if t < experiment.duration}
    return {tick: tick in fits for tick in sorted(fits | others)}


def _deviations(experiment: Experiment, held: Sequence[ModelInterval], rows: StepRecord) -> PredictionUncertainty:
    """Deviations and radii at the true states of a flight, every so many ticks."""
    every = max(1, round(UNCERTAINTY_PERIOD / experiment.dt))
    seldom = jax.tree.map(lambda x: x[::every], rows)
    x, agents = model_inputs(experiment.world.team, seldom)
    a = seldom.a_L - np.concatenate([np.asarray(experiment.controller.team.gravity), np.zeros(3)])
    x = np.concatenate([x, a], axis=1)
    return prediction_uncertainty.evaluate_along(
        experiment.controller.team, held, every, experiment.label_biases, np.asarray(seldom.t), x, agents
    )


def _why(experiment: Experiment, rows: StepRecord, loop: LoopState) -> str:
    """What ended a run: a signal not finite, causes first; an agent and its arms near singular; or another limit."""
    t, cause, allowed = rows.t[-1], termination.TerminationCause(int(loop.termination)), experiment.termination_limits
    if cause == termination.TerminationCause.NOT_FINITE:
        signals = [field.name for field in dataclasses.fields(rows) if getattr(rows, field.name) is not None]
        for signal in sorted(signals, key=DERIVED_SIGNALS.__contains__):
            if not np.isfinite(getattr(rows, signal)[-1]).all():
                return f"signal {signal} is not finite at t = {t:.3f} s"
        return f"the state is not finite after t = {t:.3f} s"
    if cause == termination.TerminationCause.SINGULAR_GRASP:
        weak = int(np.argmin(rows.min_delassus_singular_value[-1] / np.asarray(allowed.min_delassus)))
        value, arms = (
            rows.min_delassus_singular_value[-1, weak],
            grasp.describe_redundant_arms(_admittance(experiment.world.team, np.asarray(rows.r)[-1], weak)),
        )
        return (
            f"the grasp of agent {experiment.agent_names[weak]} is near singular at t = {t:.3f} s: "
            f"{value:.3g} < {float(allowed.min_delassus[weak]):.3g} 1/kg (limits.grip); {arms}"
        )
    held = jnp.concatenate(loop.saturated_ticks).astype(float) * experiment.dt
    context = _watched(jax.tree.map(lambda x: jnp.asarray(x[-1]), rows), jnp.asarray(True), held)
    return termination.format_cause(cause, allowed, jax.tree.map(np.asarray, context), float(t), experiment.agent_names)
