"""Replay of residual correctors over recorded flights of `adaptive`, scored by their forecasts.

Each item is a flight in the random environment of one sample of `evidence react`, with another key of the random
numbers; some items have no tip force sensors. The flight records labels before their filter and predictions of the
residual model. Each corrector is then computed for these signals, so that correctors are compared on equal labels
without a flight.

A forecast for the time h ahead is the sum of the forces of payload and agents, ``f_hat(t + h) + d + h v``. Its error
passes the position loop, ``e'' + K_v e' + K_p e = error / mass``, and the score is the RMS position error after the
changes. The prediction of the model is taken from the recorded flight. Where the model is replaced between t and
t + h, the step of its prediction is removed, because the correction of that period removes it too.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import cont2discrete, lfilter

from colift.analysis import metrics
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.math.pytree import pytree, static
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, zero_residual
from colift.onboard.learning import residual_correction
from colift.onboard.learning.kalman_correction import KalmanState, LabelNoise, ResidualKalmanFilter
from colift.scenario import Scenario, experiment
from evidence import collect, react
from evidence.targets import Target, report

KEY = 7119  # of the random numbers; not that of `evidence react`
SAMPLES = 60
SAMPLES_WITHOUT_TIPS = 10
WITHOUT_TIPS = "without tip force sensors"
HORIZONS = (0.0, 0.03, 0.06, 0.1)  # s
REPRODUCED_N = 0.02  # largest RMS difference between recorded and replayed correction

Corrector = residual_correction.ResidualCorrector


def scale_std(given: ResidualKalmanFilter, factor: float) -> ResidualKalmanFilter:
    """Return a filter with another standard deviation of the error."""
    return dataclasses.replace(given, std=jax.tree.map(lambda std: factor * std, given.std))


def with_field(name: str, value: float) -> Callable[[ResidualKalmanFilter], Corrector]:
    """Return the map to a filter with another value of a field."""
    return lambda given: dataclasses.replace(given, **{name: jnp.array(value)})


Observation, Correction = residual_correction.ResidualObservation, residual_correction.ResidualCorrection


@pytree
class ChangedCorrector:
    """Filter with changed observations or a changed correction.

    Attributes:
        corrector: Filter.
        change_observation: Change of the observation before the filter.
        change_correction: Change of the correction, which may depend on the next filter state.
    """

    corrector: ResidualKalmanFilter
    change_observation: Callable[[Observation], Observation] = static(default=lambda observation: observation)
    change_correction: Callable[[Correction, KalmanState], Correction] = static(
        default=lambda correction, _: correction
    )

    def init(self, team: Team) -> KalmanState:
        """Return the state of the filter."""
        return self.corrector.init(team)

    def update(
        self, state: KalmanState, observation: Observation, clock: ControlClock
    ) -> tuple[Correction, KalmanState]:
        """Advance the filter by one control period."""
        correction, state = self.corrector.update(state, self.change_observation(observation), clock)
        return self.change_correction(correction, state), state


def without_model(observation: Observation) -> Observation:
    """Return the observation with a prediction of zero."""
    return dataclasses.replace(observation, prediction=jax.tree.map(jnp.zeros_like, observation.prediction))


def without_updates(observation: Observation) -> Observation:
    """Return the observation with a constant index of the model, so that the error has no offset at an update."""
    return dataclasses.replace(observation, update_index=jnp.zeros_like(observation.update_index))


def without_rate(correction: Correction, _state: KalmanState) -> Correction:
    """Return the correction with a rate of zero."""
    return dataclasses.replace(correction, rate=jax.tree.map(jnp.zeros_like, correction.rate))


def without_weight(correction: Correction, state: KalmanState) -> Correction:
    """Return the correction with the whole error and its rate, also when labels stop."""
    error, rate = (residual_correction.unflatten(x, correction.label) for x in (state.d, state.v))
    return dataclasses.replace(correction, error=error, rate=rate)


@pytree
class WhiteNoiseFilter(ResidualKalmanFilter):
    """Filter that treats all label noise as white, with the Allan variance over one label."""

    def _noise_variances(self, noise: LabelNoise, dt: Any) -> tuple[Any, Any]:
        """Return the variances of white and of differenced label noise; the latter is zero."""
        return jnp.maximum(noise.allan_1, self.min_noise_variance(dt)), jnp.zeros_like(noise.allan_1)


def white_noise_filter(given: ResidualKalmanFilter) -> Corrector:
    """Return the filter with white label noise and equal constants."""
    return WhiteNoiseFilter(**{field.name: getattr(given, field.name) for field in dataclasses.fields(given)})


REFERENCE = "filter"
CORRECTORS: Mapping[str, Callable[[ResidualKalmanFilter], Corrector]] = {
    REFERENCE: lambda given: given,
    "half the deviations": lambda given: scale_std(given, 0.5),
    "twice the deviations": lambda given: scale_std(given, 2.0),
    "without model": lambda given: ChangedCorrector(corrector=given, change_observation=without_model),
    "without rate": lambda given: ChangedCorrector(corrector=given, change_correction=without_rate),
    "without weight": lambda given: ChangedCorrector(corrector=given, change_correction=without_weight),
    "without bumpless transfer": lambda given: ChangedCorrector(corrector=given, change_observation=without_updates),
    "white label noise": white_noise_filter,
    "max_bandwidth 1000 Hz": with_field("max_bandwidth", 1000.0),
    "max_bandwidth 5 Hz": with_field("max_bandwidth", 5.0),
    "max_bandwidth 20 Hz": with_field("max_bandwidth", 20.0),
    "averaging_time 0.5 s": with_field("averaging_time", 0.5),
    "averaging_time 2 s": with_field("averaging_time", 2.0),
    "noise_averaging 2 s": with_field("noise_averaging_time", 2.0),
    "noise_averaging 10 s": with_field("noise_averaging_time", 10.0),
    "decay_rate 0.5 1/s": with_field("decay_rate", 0.5),
    "decay_rate 2 1/s": with_field("decay_rate", 2.0),
}


def simulate_item(item: str) -> dict[str, Any]:
    """Return for each corrector the RMS position error [m] by horizon, and the error of reproduction [N]."""
    sample, _, rest = item.partition(" ")
    settings, _ = react.draw(int(sample), KEY)
    if rest == WITHOUT_TIPS:
        settings = Scenario.model_validate(settings.model_dump() | {"contact_forces": {"kind": "least_squares"}})
    plan = experiment.make_experiment(settings, "adaptive")
    given = plan.controller.residual_corrector
    assert isinstance(given, ResidualKalmanFilter)
    flight = run_experiment(plan)
    rows, observations = flight.records, recorded_observations(plan, flight)
    late = rows.t >= react.EVALUATION_START
    scores, reproduced = {}, None
    for name, make in CORRECTORS.items():
        found = replay(make(given), plan, observations)
        scores[name] = {str(h): position_error(plan, flight, found, h, late) for h in HORIZONS}
        if name == REFERENCE:
            reproduced = metrics.rms_norm(np.asarray(found.error.payload.F) - np.asarray(rows.correction_L)[:, :3])
    return {
        "e_p_rms_m": metrics.rms_norm(rows.e_p[late]) if late.any() else None,
        "termination_reason": flight.termination_reason,
        "reproduction_rms_N": reproduced,
        "forecast_e_p_rms_m": scores,
    }


def recorded_observations(plan: Experiment, flight: FlightResult) -> residual_correction.ResidualObservation:
    """Return the observations of a flight.

    Moments and joint torques of agents are not logged and count as zero. The payload has a label in every period.
    """
    team, rows, ticks_of_updates = plan.controller.team, flight.records, update_ticks(plan, flight)
    valid = np.asarray(rows.label_valid)
    ticks, dt = len(rows.t), float(plan.dt)
    interval, since = np.zeros(ticks), 0.0
    for k in range(ticks):
        interval[k] = since = since + dt
        since *= 1 - valid[k]
    steps = np.isin(np.arange(ticks), ticks_of_updates).cumsum()
    label = logged_forces(team, rows.label_L, rows.label_x)
    by_output = jax.vmap(functools.partial(residual_correction.by_output, team))
    return residual_correction.ResidualObservation(
        label=label,
        prediction=logged_forces(team, rows.model_prediction_L, rows.model_prediction_x),
        update_index=jnp.asarray(steps),
        label_valid=by_output(jnp.ones(ticks), jnp.asarray(valid)),
        interval=by_output(jnp.full(ticks, dt), jnp.asarray(interval)),
    )


def update_ticks(plan: Experiment, flight: FlightResult) -> np.ndarray:
    """Return the ticks at which the flight replaced its model."""
    indices = [int(plan.controller.residual_model.update_index), *(update.update_index for update in flight.updates)]
    ticks = [round(update.activation_time / plan.dt) for update in flight.updates]
    return np.array(ticks, dtype=int)[np.diff(indices) != 0]


def logged_forces(team: Team, L: Any, x: Any) -> ResidualForces:
    """Return residual forces of all ticks from logged payload wrenches and agent forces."""
    zero = zero_residual(team)
    L, x, first, groups = jnp.asarray(L), jnp.asarray(x), 0, []
    spread = lambda leaf: jnp.zeros((len(L), *leaf.shape))  # noqa: E731
    for group in zero.agents:
        size = len(group.f_x)
        groups.append(dataclasses.replace(jax.tree.map(spread, group), f_x=x[:, first : first + size]))
        first += size
    payload = dataclasses.replace(zero.payload, F=L[:, :3], tau=L[:, 3:])
    return ResidualForces(payload=payload, agents=tuple(groups))


def replay(
    corrector: Corrector, plan: Experiment, observations: residual_correction.ResidualObservation
) -> residual_correction.ResidualCorrection:
    """Return the corrections of a corrector for recorded observations."""
    return _scan(corrector, corrector.init(plan.controller.team), observations, plan.dt)


@jax.jit
def _scan(corrector: Corrector, start: Any, observations: residual_correction.ResidualObservation, dt: Any) -> Any:
    """Return the corrections of all ticks."""

    def step(state: Any, observation: residual_correction.ResidualObservation) -> tuple[Any, Any]:
        correction, state = corrector.update(state, observation, ControlClock(t=jnp.zeros(()), dt=dt))
        return state, correction

    return jax.lax.scan(step, start, observations)[1]


def total_force(forces: ResidualForces) -> np.ndarray:
    """Return the sum of the forces of payload and agents in each tick [N]."""
    return np.asarray(forces.payload.F + sum(group.f_x.sum(1) for group in forces.agents))


def position_error(
    plan: Experiment,
    flight: FlightResult,
    correction: residual_correction.ResidualCorrection,
    horizon: float,
    evaluated: np.ndarray,
) -> float | None:
    """Return the RMS position error that the errors of the forecasts cause [m]."""
    if not evaluated.any():
        return None
    dt, team = float(plan.dt), plan.controller.team
    n = round(horizon / dt)
    rows, replaced = flight.records, update_ticks(plan, flight)
    at = np.arange(len(rows.t) - n)
    model = correction.prediction
    steps = jax.tree.map(lambda x: _steps(np.asarray(x), replaced), model)
    forecast = jax.tree.map(
        lambda f, jump, d, v: f[at + n] - jump[at + n] + jump[at] + d[at] + horizon * v[at],
        *(model, steps, correction.error, correction.rate),
    )
    true = np.asarray(rows.f_L)[:, :3] + np.asarray(rows.f_x).sum(1)
    error = (total_force(forecast) - true[at + n]) / total_mass(team)
    gains = plan.controller.payload_controller.gains  # ty: ignore[missing-attribute]
    out = [
        _second_order(error[:, i], float(gains.K_p[i, i]), float(gains.K_v[i, i]), dt) for i in range(error.shape[1])
    ]
    return metrics.rms_norm(np.stack(out, axis=1)[evaluated[n:]])


def total_mass(team: Team) -> float:
    """Return the nominal mass of payload and agents [kg]."""
    return float(team.payload.mass + sum(group.mass.sum() for group in team.agent_groups))


def _steps(x: np.ndarray, ticks: np.ndarray) -> np.ndarray:
    """Return the sum of the steps of a signal at the given ticks, up to each tick."""
    step = np.zeros_like(x)
    step[ticks[ticks > 0]] = x[ticks[ticks > 0]] - x[ticks[ticks > 0] - 1]
    return step.cumsum(0)


def _second_order(u: np.ndarray, k_p: float, k_v: float, dt: float) -> np.ndarray:
    """Return the response of ``e'' + k_v e' + k_p e = u``."""
    numerator, denominator, _ = cont2discrete(([1.0], [1.0, k_v, k_p]), dt)
    return lfilter(numerator[0], denominator, u)


def main() -> bool:
    """Print the geometric means of the scores relative to the filter of `adaptive` and return whether replays agree."""
    with_tips = [str(k) for k in range(SAMPLES)]
    without = [f"{k} {WITHOUT_TIPS}" for k in range(SAMPLES_WITHOUT_TIPS)]
    found = collect("replay", [*with_tips, *without], simulate_item)
    for items in (with_tips, without):
        flown = [found[item] for item in items if not found[item]["termination_reason"]]
        print(f"{len(flown)} flights, {items[0].partition(' ')[2] or 'with tip force sensors'}")
        print(f"{'forecast':28}" + "".join(f"{h:>9} s" for h in HORIZONS))
        for name in CORRECTORS:
            of = [ratios((_score(one, name, h), _score(one, REFERENCE, h)) for one in flown) for h in HORIZONS]
            print(f"{name:28}" + "".join(f"{mean:11.3f}" for mean, _, _ in of))
    worst = max(one["reproduction_rms_N"] for one in found.values())
    return report([Target("difference of recorded and replayed correction [N]", worst, most=REPRODUCED_N)])


def ratios(pairs: Iterable[tuple[float, float]]) -> tuple[float, float, float]:
    """Return geometric mean, 90 % quantile and greatest ratio of pairs of changed and reference errors."""
    x = np.array([changed / reference for changed, reference in pairs])
    return float(np.exp(np.log(x).mean())), float(np.quantile(x, 0.9)), float(x.max())


def _score(one: dict[str, Any], name: str, horizon: float) -> float:
    return one["forecast_e_p_rms_m"][name][str(horizon)]
