"""Simulated flights: rollouts of the closed loop with model updates at the times `t_k`.

Control periods run in chunks on the device. Model updates run on the host between two rollouts, and each new model
becomes active after the stated fit latency.

See Also:
    colift.closed_loop.simulator: one control period, and rollouts.
    colift.closed_loop.batch: several flights in one program.
    colift.onboard.learning.online_learner: the model updates.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, Protocol, runtime_checkable

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
from colift.onboard.learning import compact_model, confidence_bounds, model_update, residual_model, semiparametric
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
class CompactInterval:
    """Model interval without the factors of its Gaussian processes, which each access computes again.

    Attributes:
        start_tick: Index of the first control period.
        compact_model: Residual model.
        compact_posterior: Companion posteriors of the error bounds.
        payload_beta: Factors of the error bounds of the payload.
        agent_beta: Factors of the error bounds of the agents, by group.
        mean_uncertainties: Mean uncertainties of the model, by body.
    """

    start_tick: int
    compact_model: compact_model.CompactModel
    compact_posterior: compact_model.CompactModel
    payload_beta: jax.Array
    agent_beta: tuple[jax.Array, ...]
    mean_uncertainties: semiparametric.MeanUncertainties

    @property
    def model(self) -> residual_model.ResidualModel:
        """Residual model."""
        return self.compact_model.restored()

    @property
    def bands(self) -> confidence_bounds.ConfidenceBands:
        """Error bounds of the model."""
        return confidence_bounds.ConfidenceBands(
            bound_posterior=self.compact_posterior.restored(),
            payload_beta=self.payload_beta,
            agent_beta=self.agent_beta,
        )


def compact_interval(interval: ModelInterval) -> ModelInterval | CompactInterval:
    """Return a model interval without factors, or the interval itself if they cannot be computed from the data.

    Args:
        interval: Interval of a flight without online updates, whose noise is not correlated.
    """
    model, bands = compact_model.compact(interval.model), interval.bands
    posterior = compact_model.compact(bands.bound_posterior) if model is not None else None
    if model is None or posterior is None:
        return interval
    return CompactInterval(
        start_tick=interval.start_tick,
        compact_model=model,
        compact_posterior=posterior,
        payload_beta=bands.payload_beta,
        agent_beta=bands.agent_beta,
        mean_uncertainties=interval.mean_uncertainties,
    )


@dataclasses.dataclass(frozen=True)
class FlightResult:
    """Records of a simulated flight, its last residual model and the uncertainty of all models.

    Attributes:
        records: Records of all ticks as NumPy arrays, which are read from a temporary file on access.
        uncertainty: Standard deviations and error bounds along the flight, at a lower rate.
        updates: Model updates in the order of their activation.
        termination_reason: Violated limit, body and time; empty if the flight is complete.
        interval: Residual model at the end of the flight with its error bounds.
        wall_time: Computation time by stage [s].
        learning_warnings: Sentences on updates that failed, were omitted or were not finished.
    """

    records: StepRecord
    uncertainty: PredictionUncertainty
    updates: tuple[ModelUpdate, ...]
    termination_reason: str
    interval: ModelInterval | CompactInterval
    wall_time: dict[str, float]
    learning_warnings: tuple[str, ...] = ()

    @property
    def model(self) -> residual_model.ResidualModel:
        """Residual model at the end of the flight; each access may compute its factors again."""
        return self.interval.model

    @property
    def bands(self) -> confidence_bounds.ConfidenceBands:
        """Error bounds of this model; each access may compute their factors again."""
        return self.interval.bands


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
    with contextlib.closing(SimulatedFlight(experiment, on_model, record_path)) as flight:
        setup = flight.setup
        loop = reset(setup, flight.experiment.initial_state)
        progress(0.0)
        while flight.continues:
            signals.raise_if_interrupted()
            start_time = time.perf_counter()
            noise, ticks = flight.next_chunk()
            loop, rows = rollout(setup, loop, noise, jnp.asarray(ticks))
            rows = flight.add_records(loop, rows)
            flight.wall_time["simulation"] += time.perf_counter() - start_time
            on_chunk(rows)
            if flight.update_model(loop):
                setup = flight.setup
            progress(flight.time)
        return flight.result()


class SimulatedFlight:
    """Flight in progress: draws the noise of its next control periods, stores their records and updates its model.

    Example:
        ::

            while flight.continues:
                noise, ticks = flight.next_chunk()
                loop, rows = rollout(flight.setup, loop, noise, jnp.asarray(ticks))
                flight.add_records(loop, rows)
                flight.update_model(loop)
            found = flight.result()
    """

    def __init__(
        self,
        experiment: Experiment[World],
        on_model: Callable[[ModelInterval], None] = lambda _interval: None,
        record_path: Path | None = None,
        keep_factors: bool = True,
    ) -> None:
        """Start at the first control period.

        Args:
            experiment: Definition of the flight.
            on_model: As in `run_experiment`.
            record_path: As in `run_experiment`.
            keep_factors: Whether the factors of the model stay in memory between two updates.

        Raises:
            OSError: If the file of the records cannot be created.
        """
        self.experiment = experiment = experiment.calibrated()
        self.wall_time = {"simulation": 0.0, "fit": 0.0, "error_bounds": 0.0}
        self.termination_reason = ""
        self._ticks, self._done = round(experiment.duration / experiment.dt), 0
        self._updates = _ModelUpdates(experiment, on_model, keep_factors)
        self._uncertainty = _Uncertainty(experiment)
        self._key = jax.random.fold_in(jax.random.key(experiment.seed), 2)
        self._file = RecordFile(self._ticks, record_path)

    @property
    def continues(self) -> bool:
        """True while control periods are left."""
        return self._done < self._ticks and not self.termination_reason

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._done * self.experiment.dt

    @property
    def setup(self) -> LoopConfig[World, LeaderFollowerController]:
        """Constant data of the closed loop with the model in use."""
        controller = dataclasses.replace(self.experiment.controller, residual_model=self._updates.interval.model)
        return dataclasses.replace(self.experiment.loop_config, controller=controller)

    def next_chunk(self) -> tuple[Any, int]:
        """Return the noise of the next control periods and their number.

        Noise is drawn for whole chunks, so that updates do not change it.
        """
        size = ticks_per_chunk(self.experiment)
        start = self._done - self._done % size
        end = min(start + size, self._ticks, *self._updates.event_ticks(self._done))
        noise = draw_noise(self.experiment.world, jax.random.fold_in(self._key, start), size)
        if self._done > start:
            noise = jax.tree.map(lambda x, offset=self._done - start: jnp.roll(x, -offset, axis=0), noise)
        return noise, end - self._done

    def add_records(self, loop: LoopState, rows: StepRecord) -> StepRecord:
        """Store the records of the last chunk.

        Args:
            loop: Loop state after the chunk.
            rows: Records of the chunk, of any capacity.

        Returns:
            The records of the simulated control periods as NumPy arrays.
        """
        end = int(loop.tick)
        rows = jax.tree.map(lambda x, n=end - self._done: np.asarray(x)[:n], rows)
        self._file.append(rows)
        if int(loop.termination):
            self.termination_reason = _termination_reason(self.experiment, rows, loop)
        self._uncertainty.add(self._done, rows)
        self._done = end
        return rows

    def update_model(self, loop: LoopState) -> bool:
        """Perform the model updates that are due after the last chunk.

        Args:
            loop: Loop state after the chunk.

        Returns:
            Whether another model is in use.
        """
        start_time = time.perf_counter()
        ended = None
        if not self.termination_reason:
            ended = self._updates.run(self._done, self._done < self._ticks, loop)
        self.wall_time["fit"] += time.perf_counter() - start_time
        if ended is None:
            return False
        start_time = time.perf_counter()
        self._uncertainty.evaluate(ended)
        self.wall_time["error_bounds"] += time.perf_counter() - start_time
        return True

    def result(self) -> FlightResult:
        """Return the records, the last residual model and the uncertainty along the flight."""
        records, start_time = self._file.read(), time.perf_counter()
        self._uncertainty.evaluate(self._updates.interval)
        found = self._uncertainty.result()
        self.wall_time["error_bounds"] += time.perf_counter() - start_time
        return FlightResult(
            records=records,
            uncertainty=found,
            updates=tuple(self._updates.activated),
            termination_reason=self.termination_reason,
            interval=self._updates.compacted(),
            wall_time=self.wall_time,
            learning_warnings=self._updates.warnings(),
        )

    def close(self) -> None:
        """Close the file of the records; those of `result` stay valid."""
        self._file.close()


class _ModelUpdates:
    """Schedule of the model updates of one flight, the model in use and the update that is not yet active."""

    def __init__(
        self, experiment: Experiment[World], on_model: Callable[[ModelInterval], None], keep_factors: bool
    ) -> None:
        """Start with the initial residual model of the controller."""
        self.experiment, self.on_model, self.keep_factors = experiment, on_model, keep_factors
        self.learner = OnlineLearner(experiment.fit_options, experiment.identification, experiment.online_updates)
        self.due = _update_ticks(experiment)
        self.pending: tuple[int, residual_model.ResidualModel, ModelUpdate] | None = None
        self.activated: list[ModelUpdate] = []
        self.omitted: list[float] = []  # s, update times at which the previous update was not finished
        self._begin(0, experiment.controller.residual_model)

    @property
    def interval(self) -> ModelInterval:
        """The model in use with its error bounds."""
        kept = self._interval
        if isinstance(kept, ModelInterval):
            return kept
        return ModelInterval(kept.start_tick, kept.model, kept.bands, kept.mean_uncertainties)

    def compacted(self) -> ModelInterval | CompactInterval:
        """Return the model in use with its error bounds, without factors if the data determine them."""
        if not isinstance(self._interval, ModelInterval) or self.experiment.online_updates is not None:
            return self._interval
        return compact_interval(self._interval)

    def event_ticks(self, done: int) -> list[int]:
        """Return the ticks after `done` at which an update is due or becomes active."""
        return [k for k in (*self.due, *([self.pending[0]] if self.pending else [])) if k > done]

    def run(self, done: int, continues: bool, loop: LoopState) -> ModelInterval | None:
        """Perform the update that is due at a tick, and activate the pending one.

        Args:
            done: Number of simulated ticks.
            continues: Whether the flight continues; no update is started at its end.
            loop: Loop state, which contains the recorded samples.

        Returns:
            The interval that ended; None if the same model stays in use.
        """
        start_time, dt = time.perf_counter(), self.experiment.dt
        is_due, ended = done in self.due and continues, None
        if not is_due and not (self.pending and self.pending[0] <= done):
            return None
        before = self.interval
        while True:
            if self.pending and self.pending[0] <= done:
                (_, model, update), self.pending = self.pending, None
                ended = before
                self._begin(done, model)
                self.activated.append(dataclasses.replace(update, activation_time=done * dt))
            elif is_due and self.pending is None:
                is_due = False
                in_use = self._interval.model if ended else before.model
                samples = jax.tree.map(jnp.asarray, loop.controller.recorder)  # NumPy arrays in a batch
                model, update = self.learner.update(in_use, samples, done * dt, fit=self.due[done])
                latency = self.experiment.fit_latency
                latency = time.perf_counter() - start_time if latency is None else latency
                self.pending = done + round(latency / dt), model, update
            else:
                break
        if is_due:
            self.omitted.append(done * dt)
        return ended

    def _begin(self, done: int, model: residual_model.ResidualModel) -> None:
        """Begin the interval of a model that is in use from this tick on.

        The learner starts no update before the model of the previous one is in use, so its mean uncertainties are those
        of this model.
        """
        assumptions, index = self.experiment.bound_assumptions, len(self.activated) + 1
        bands = confidence_bounds.confidence_bands(model, assumptions, index)
        self._interval: ModelInterval | CompactInterval = ModelInterval(
            start_tick=done, model=model, bands=bands, mean_uncertainties=self.learner.mean_uncertainties
        )
        self.on_model(self._interval)
        if not self.keep_factors:
            self._interval = self.compacted()

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
