"""Simulated flights: rollouts of the closed loop with model updates at the times `t_k`.

Control periods run in chunks on the device. Model updates run on the host between two rollouts, and each new model
becomes active after the stated fit latency.

See Also:
    colift.closed_loop.simulator: one control period, and rollouts.
    colift.onboard.learning.online_learner: the model updates.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Generic, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np

from colift.closed_loop import termination
from colift.closed_loop.record_file import RecordFile
from colift.closed_loop.signals import DERIVED_SIGNALS, StepRecord, delassus_matrix, model_inputs
from colift.closed_loop.simulator import LoopConfig, LoopState, WorldT, monitored_values, reset, rollout
from colift.models import grasp
from colift.models.state import State
from colift.onboard.controller import LeaderFollowerController
from colift.onboard.estimation.contact_forces import ResidualPriorEstimator
from colift.onboard.learning import confidence_bounds, model_update, residual_model, semiparametric
from colift.onboard.learning.online_learner import (
    IdentificationOptions,
    ModelUpdate,
    OnlineLearner,
    OnlineUpdateOptions,
    RidgeOptions,
)
from colift.onboard.learning.prediction_uncertainty import LabelBiasModel, PredictionUncertainty, UncertaintyAlongRun
from colift.runtime import signals
from colift.simulation.world import World


@runtime_checkable
class Calibration(Protocol):
    """Calibration of a controller before a flight."""

    def calibrated(self, controller: LeaderFollowerController) -> LeaderFollowerController:
        """Return the calibrated controller; repeated calls do not repeat the computation."""
        ...


@dataclasses.dataclass(frozen=True)
class Experiment(Generic[WorldT]):
    """Complete definition of one simulated flight.

    Any `World` may be used; without a parameter the type has the `SimulatedWorld` of `make_experiment`.

    Attributes:
        world: Simulated world.
        controller: Onboard controller with its initial residual model.
        agent_names: Agent names in team order.
        contact_names: Contact names in team order.
        termination_limits: Limits whose violation ends the flight.
        dt: Control period [s].
        initial_state: Initial state on the constraint manifold.
        duration: Duration of the flight [s].
        update_times: Times `t_k` at which hyperparameters are fitted [s].
        fit_options: Options of the fits; None keeps the initial hyperparameters.
        identification: Options of the method that replaces Gaussian processes, if any.
        bound_assumptions: Assumptions of the error bounds along the flight.
        label_biases: Constant sensor errors according to the data sheets.
        seed: Seed of the sensor noise.
        online_updates: Options of the periodic updates, if any.
        fit_latency: Time between an update and the activation of its model [s]; None: the computation time on this
            machine.
        calibration: Calibration of the controller before the flight; None without one.
    """

    world: WorldT
    controller: LeaderFollowerController
    agent_names: tuple[str, ...]
    contact_names: tuple[str, ...]
    termination_limits: termination.TerminationLimits
    dt: float
    initial_state: State
    duration: float
    update_times: tuple[float, ...]
    fit_options: model_update.FitOptions | None
    identification: IdentificationOptions | RidgeOptions | None
    bound_assumptions: confidence_bounds.BoundAssumptions
    label_biases: LabelBiasModel
    seed: int
    online_updates: OnlineUpdateOptions | None = None
    fit_latency: float | None = 0.0
    calibration: Calibration | None = None

    @property
    def loop_config(self) -> LoopConfig[WorldT, LeaderFollowerController]:
        """Constant data of the closed loop before the first model update."""
        return LoopConfig(
            world=self.world,
            controller=self.controller,
            termination_limits=self.termination_limits,
            dt=jnp.asarray(self.dt),
        )

    def calibrated(self) -> Experiment[WorldT]:
        """Return the experiment with the calibrated controller; the experiment itself without a calibration."""
        if self.calibration is None:
            return self
        return dataclasses.replace(self, controller=self.calibration.calibrated(self.controller), calibration=None)


@dataclasses.dataclass(frozen=True)
class ModelInterval:
    """Residual model with its error bounds, in use from one tick until the next interval.

    Attributes:
        start_tick: Index of the first control period.
        model: Residual model.
        bands: Error bounds of the model.
        mean_uncertainties: Mean uncertainties of the model, by body.
    """

    start_tick: int
    model: residual_model.ResidualModel
    bands: confidence_bounds.ConfidenceBands
    mean_uncertainties: semiparametric.MeanUncertainties = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class FlightResult:
    """Records of a simulated flight, its last residual model and the uncertainty of all models.

    Attributes:
        records: Records of all ticks as NumPy arrays, which are read from a temporary file on access.
        uncertainty: Standard deviations and error bounds along the flight, at a lower rate.
        updates: Model updates in the order of their activation.
        termination_reason: Violated limit, body and time; empty if the flight is complete.
        model: Residual model at the end of the flight.
        bands: Error bounds of this model.
        wall_time: Computation time by stage [s].
        learning_warnings: Sentences on updates that failed, were omitted or were not finished.
    """

    records: StepRecord
    uncertainty: PredictionUncertainty
    updates: tuple[ModelUpdate, ...]
    termination_reason: str
    model: residual_model.ResidualModel
    bands: confidence_bounds.ConfidenceBands
    wall_time: dict[str, float]
    learning_warnings: tuple[str, ...] = ()


CHUNK_DURATION = 0.5  # s, simulated time between two reports of progress
UNCERTAINTY_PERIOD = 0.1  # s, between two evaluations of the uncertainty; at least one control period


def ticks_per_chunk(experiment: Experiment[World]) -> int:
    """Return the number of control periods in one chunk, for which the noise is drawn at once."""
    return max(1, round(CHUNK_DURATION / experiment.dt))


def run_experiment(
    experiment: Experiment[World],
    progress: Callable[[float], None] = lambda _t: None,
    on_chunk: Callable[[StepRecord], None] = lambda _rows: None,
    on_model: Callable[[ModelInterval], None] = lambda _interval: None,
    record_path: Path | None = None,
) -> FlightResult:
    """Simulate a flight with its model updates.

    The flight ends at the first tick at which a value is not finite or a termination limit is violated. The records
    until then are returned together with the reason.

    Args:
        experiment: Definition of the flight.
        progress: Function called with the simulated time [s] after each chunk.
        on_chunk: Function called with the records of each chunk.
        on_model: Function called with each residual model when it comes into use; the flight keeps the last one only.
        record_path: File for the records, for `record_file.read_records` if the process is killed; None for a temporary
            file without name.

    Returns:
        The records, the last residual model and the uncertainty along the flight.

    Example:
        ::

            scenario = colift.load_scenario("paper")
            flight = run_experiment(colift.make_experiment(scenario, "C1"))
            print(np.linalg.norm(flight.records.e_p[-1]))
    """
    experiment = experiment.calibrated()
    dt, setup = experiment.dt, experiment.loop_config
    chunk_ticks, ticks = ticks_per_chunk(experiment), round(experiment.duration / dt)
    model_updates, uncertainty = _ModelUpdates(experiment, on_model), _Uncertainty(experiment)
    key = jax.random.fold_in(jax.random.key(experiment.seed), 2)
    wall_time = {"simulation": 0.0, "fit": 0.0, "error_bounds": 0.0}
    loop = reset(setup, experiment.initial_state)
    done, termination_reason = 0, ""
    progress(0.0)
    with contextlib.closing(RecordFile(ticks, record_path)) as file:
        while done < ticks and not termination_reason:
            signals.raise_if_interrupted()
            chunk_start = done - done % chunk_ticks  # noise is drawn for whole chunks, so that updates do not change it
            chunk_end = min(chunk_start + chunk_ticks, ticks, *model_updates.event_ticks(done))
            start_time = time.perf_counter()
            noise = draw_noise(experiment.world, jax.random.fold_in(key, chunk_start), chunk_ticks)
            if done > chunk_start:
                noise = jax.tree.map(lambda x, offset=done - chunk_start: jnp.roll(x, -offset, axis=0), noise)
            loop, rows = rollout(setup, loop, noise, jnp.asarray(chunk_end - done))
            end_tick = int(loop.tick)
            rows = jax.tree.map(lambda x, n=end_tick - done: np.asarray(x)[:n], rows)
            file.append(rows)
            if int(loop.termination):
                termination_reason = _termination_reason(experiment, rows, loop)
            uncertainty.add(done, rows)
            done = end_tick
            wall_time["simulation"] += time.perf_counter() - start_time
            on_chunk(rows)
            start_time, interval = time.perf_counter(), model_updates.interval
            changed = not termination_reason and model_updates.run(done, done < ticks, loop)
            wall_time["fit"] += time.perf_counter() - start_time
            if changed:
                start_time = time.perf_counter()
                uncertainty.evaluate(interval)
                wall_time["error_bounds"] += time.perf_counter() - start_time
                controller = dataclasses.replace(experiment.controller, residual_model=model_updates.interval.model)
                setup = dataclasses.replace(setup, controller=controller)
            progress(done * dt)
        records = file.read()
    start_time = time.perf_counter()
    uncertainty.evaluate(model_updates.interval)
    found = uncertainty.result()
    wall_time["error_bounds"] += time.perf_counter() - start_time
    return FlightResult(
        records=records,
        uncertainty=found,
        updates=tuple(model_updates.activated),
        termination_reason=termination_reason,
        model=model_updates.interval.model,
        bands=model_updates.interval.bands,
        wall_time=wall_time,
        learning_warnings=model_updates.warnings(),
    )


class _ModelUpdates:
    """Schedule of the model updates of one flight, the model in use and the update that is not yet active."""

    def __init__(self, experiment: Experiment[World], on_model: Callable[[ModelInterval], None]) -> None:
        """Start with the initial residual model of the controller."""
        self.experiment, self.on_model = experiment, on_model
        self.learner = OnlineLearner(experiment.fit_options, experiment.identification, experiment.online_updates)
        self.due = _update_ticks(experiment)
        self.pending: tuple[int, residual_model.ResidualModel, ModelUpdate] | None = None
        self.activated: list[ModelUpdate] = []
        self.omitted: list[float] = []  # s, update times at which the previous update was not finished
        self.interval = self._begin(0, experiment.controller.residual_model)

    def event_ticks(self, done: int) -> list[int]:
        """Return the ticks after `done` at which an update is due or becomes active."""
        return [k for k in (*self.due, *([self.pending[0]] if self.pending else [])) if k > done]

    def run(self, done: int, continues: bool, loop: LoopState) -> bool:
        """Perform the update that is due at a tick, and activate the pending one.

        Args:
            done: Number of simulated ticks.
            continues: Whether the flight continues; no update is started at its end.
            loop: Loop state, which contains the recorded samples.

        Returns:
            Whether another model is in use.
        """
        start_time, dt = time.perf_counter(), self.experiment.dt
        is_due, changed = done in self.due and continues, False
        while True:
            if self.pending and self.pending[0] <= done:
                (_, model, update), self.pending = self.pending, None
                self.interval = self._begin(done, model)
                self.activated.append(dataclasses.replace(update, activation_time=done * dt))
                changed = True
            elif is_due and self.pending is None:
                is_due = False
                before, samples = self.interval.model, loop.controller.recorder
                model, update = self.learner.update(before, samples, done * dt, fit=self.due[done])
                latency = self.experiment.fit_latency
                latency = time.perf_counter() - start_time if latency is None else latency
                self.pending = done + round(latency / dt), model, update
            else:
                break
        if is_due:
            self.omitted.append(done * dt)
        return changed

    def _begin(self, done: int, model: residual_model.ResidualModel) -> ModelInterval:
        """Return the interval of a model that is in use from this tick on.

        The learner starts no update before the model of the previous one is in use, so its mean uncertainties are those
        of this model.
        """
        assumptions, index = self.experiment.bound_assumptions, len(self.activated) + 1
        bands = confidence_bounds.confidence_bands(model, assumptions, index)
        interval = ModelInterval(
            start_tick=done, model=model, bands=bands, mean_uncertainties=self.learner.mean_uncertainties
        )
        self.on_model(interval)
        return interval

    def warnings(self) -> tuple[str, ...]:
        """Describe updates that failed, were omitted or were not finished, one sentence each."""
        found = [update.error_message for update in self.activated if update.error_message]
        if self.omitted:
            times = ", ".join(f"{t:.3f}" for t in self.omitted)
            found.append(
                f"no model update at t = {times} s: the previous update was not finished (learning.fit_latency)"
            )
        if self.pending is not None:
            t = self.pending[2].t
            found.append(f"the model update of t = {t:.3f} s was not finished when the flight ended")
        return tuple(found)


draw_noise = jax.jit(lambda world, key, ticks: world.sample_noise(key, ticks), static_argnums=2)


def _update_ticks(experiment: Experiment[World]) -> dict[int, bool]:
    """Return the ticks of all updates in ascending order, and whether hyperparameters are fitted there."""
    fits = {round(t / experiment.dt) for t in experiment.update_times if t < experiment.duration}
    online_times = () if experiment.online_updates is None else experiment.online_updates.times
    online = {round(t / experiment.dt) for t in online_times if t < experiment.duration}
    return {tick: tick in fits for tick in sorted(fits | online)}


class _Uncertainty:
    """Standard deviations and error bounds at the true states of a flight, at a lower rate."""

    def __init__(self, experiment: Experiment[World]) -> None:
        """Start without states."""
        self.experiment = experiment
        self.stride = max(1, round(UNCERTAINTY_PERIOD / experiment.dt))
        self.along = UncertaintyAlongRun(experiment.controller.team, experiment.label_biases)
        self.mismatch_std: list[np.ndarray] = []  # of the estimated wrench mismatch

    def add(self, first_tick: int, rows: StepRecord) -> None:
        """Add the states of the records from a tick on."""
        sparse = jax.tree.map(lambda x: x[-first_tick % self.stride :: self.stride].copy(), rows)
        x, agents = model_inputs(self.experiment.world.team, sparse)
        gravity = np.concatenate([np.asarray(self.experiment.controller.team.gravity), np.zeros(3)])
        self.along.add(sparse.t, np.concatenate([x, sparse.a_L - gravity], axis=1), agents)
        if sparse.delta_W_std is not None:
            self.mismatch_std.append(sparse.delta_W_std)

    def evaluate(self, interval: ModelInterval) -> None:
        """Evaluate the states since the last call, at which the model of an interval was in use."""
        self.along.evaluate(interval.model, interval.bands, interval.mean_uncertainties)

    def result(self) -> PredictionUncertainty:
        """Return standard deviations and error bounds at all states."""
        found, forces = self.along.result(), getattr(self.experiment.controller.estimator, "contact_forces", None)
        if not isinstance(forces, ResidualPriorEstimator):
            return found
        # Labels contain the errors of the prior besides the biases of accelerometers. ``A P A^T <= S`` bounds the
        # errors of the agents; those of the payload have the covariance ``G P G^T`` of the mismatch.
        stds = (np.sqrt(np.diag(np.linalg.inv(information))) for information in forces.agent_information)
        return dataclasses.replace(
            found,
            payload_label_bias=np.hypot(found.payload_label_bias, np.concatenate(self.mismatch_std)),
            agent_label_bias=tuple(np.hypot(x, std) for x, std in zip(found.agent_label_bias, stds, strict=True)),
        )


def _termination_reason(experiment: Experiment[World], rows: StepRecord, loop: LoopState) -> str:
    """Describe the reason for the end of a flight.

    A signal that is not finite is named first, in the order of cause and effect. Otherwise the message contains the
    singular grasp or the violated limit of the motion.

    Args:
        experiment: Definition of the flight.
        rows: Records of the last chunk.
        loop: Loop state at the end.

    Returns:
        A sentence with value, time and limit.
    """
    t, cause, limits = rows.t[-1], termination.TerminationCause(int(loop.termination)), experiment.termination_limits
    if cause == termination.TerminationCause.NOT_FINITE:
        names = [field.name for field in dataclasses.fields(rows) if getattr(rows, field.name) is not None]
        for name in sorted(names, key=DERIVED_SIGNALS.__contains__):
            if not np.isfinite(getattr(rows, name)[-1]).all():
                return f"signal {name} is not finite at t = {t:.3f} s"
        return f"the state is not finite after t = {t:.3f} s"
    if cause == termination.TerminationCause.SINGULAR_GRASP:
        most_singular = int(np.argmin(rows.min_delassus_singular_value[-1] / np.asarray(limits.min_delassus)))
        value, arms = (
            rows.min_delassus_singular_value[-1, most_singular],
            grasp.describe_redundant_arms(
                delassus_matrix(experiment.world.team, np.asarray(rows.r)[-1], most_singular)
            ),
        )
        return (
            f"the grasp of agent {experiment.agent_names[most_singular]} is near singular at t = {t:.3f} s: "
            f"{value:.3g} < {float(limits.min_delassus[most_singular]):.3g} 1/kg (limit min_delassus); {arms}"
        )
    if cause >= termination.TerminationCause.SLIP:
        assert limits.contacts is not None
        forces = np.asarray(rows.lam[-1] @ rows.R_L[-1])
        moments = None if rows.contact_moment is None else np.asarray(rows.contact_moment[-1])
        names = experiment.contact_names
        return termination.format_contact_cause(cause, limits.contacts, forces, float(t), names, moments)
    saturated = jnp.concatenate(loop.saturated_ticks).astype(float) * experiment.dt
    values = monitored_values(jax.tree.map(lambda x: jnp.asarray(x[-1]), rows), jnp.asarray(True), saturated)
    return termination.format_cause(cause, limits, jax.tree.map(np.asarray, values), float(t), experiment.agent_names)
