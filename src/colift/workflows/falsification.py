"""Falsification of a certificate: search for runs whose errors exceed their bounds.

Trials with worst-case residuals are compared with the a priori bounds of the scenario. Trials with a changed scenario
(seed, update times, initial state, reference, noise, rates, thrust limits) are compared with their own certificates.

See Also:
    docs/certificate.md: Section "Falsification".
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Generator, Mapping, Sequence

import numpy as np

from colift import scenario
from colift.certification import adversary, linearized_trajectory, nominal_run
from colift.certification.certificate import ERRORS
from colift.closed_loop import signals
from colift.scenario import Scenario, ScenarioError
from colift.scenario.schema import Lissajous
from colift.workflows import certification
from colift.workflows.certification import CertificationResult

Matrix = np.ndarray
NAMES = ("energy", "recovery")  # bounds of the prediction error
STUDY_NOISE = "paper"  # scenario that defines the sensor noise


@dataclasses.dataclass(frozen=True)
class FalsificationTrial:
    """Result of one trial.

    Attributes:
        name: Kind and number of the trial, such as ``seed:0``.
        overrides: Overrides of the scenario with which `colift certify` repeats the trial; empty for worst-case
            residuals.
        observed_over_bound: Ratio by error; empty if no bound exists. A ratio above one is a violation.
        num_components_outside: Number of error components outside their interval, over all times.
        num_components: Number of evaluated error components.
        message: Reason why no bound exists, or how the run ended early.
    """

    name: str
    overrides: tuple[str, ...]
    observed_over_bound: Mapping[str, float]
    num_components_outside: int
    num_components: int
    message: str

    @property
    def max_ratio(self) -> float:
        """Largest ratio; zero if no bound exists."""
        return max(self.observed_over_bound.values(), default=0.0)

    @property
    def is_violated(self) -> bool:
        """True if a bound or an interval was exceeded."""
        return self.max_ratio > 1 or self.num_components_outside > 0


def trial_names(settings: Scenario, rounds: int) -> list[str]:
    """Return the names of the trials of some rounds: a kind and a number, which determine all random draws.

    Args:
        settings: Scenario.
        rounds: Number of rounds; each contains every kind once.

    Returns:
        Names of the trials.
    """
    return [f"{kind}:{k}" for k in range(rounds) for kind in _kinds(settings)]


def falsify(
    settings: Scenario, names: Sequence[str], progress: Callable[[str], None] = lambda _message: None
) -> Generator[FalsificationTrial]:
    """Run trials against the certificate of a scenario.

    The scenario is certified when the first trial needs it; errors are raised as by `certification.certify`. An unknown
    name raises a ValueError before the first trial.

    Args:
        settings: Scenario.
        names: Names of the trials; see `trial_names`.
        progress: Function called with a description of each step.

    Yields:
        Result of each trial.
    """
    for name in names:
        _split(settings, name)
    result = None
    for name in names:
        progress(name)
        kind, k = _split(settings, name)
        rng = random_generator(settings.seed, kind, k)
        if kind in RESIDUAL_TRIALS:
            result = result or certification.certify(settings, names=NAMES, progress=progress)
            yield _residual_trial(name, result, RESIDUAL_TRIALS[kind](result, k, rng), settings.seed + 1 + k)
        else:
            yield _scenario_trial(name, settings, SCENARIO_TRIALS[kind](settings, k, rng))


def random_generator(seed: int, kind: str, number: int) -> np.random.Generator:
    """Return the generator of a trial's random numbers.

    Args:
        seed: Seed of the scenario.
        kind: Kind of the trial.
        number: Number of the trial.

    Returns:
        Generator, which depends on nothing else.
    """
    return np.random.default_rng((seed, number, *STREAMS[kind].encode()))


def _split(settings: Scenario, name: str) -> tuple[str, int]:
    """Split a trial's name into kind and number; raise ValueError for an unknown name."""
    kind, _, k = name.rpartition(":")
    kinds = _kinds(settings)
    if kind not in kinds or not k.isdecimal():
        raise ValueError(
            f"unknown trial {name}: must be KIND:NUMBER with one of the kinds {', '.join(kinds)}, as in {kinds[0]}:0"
        )
    return kind, int(k)


def _kinds(settings: Scenario) -> tuple[str, ...]:
    """Return the kinds of trials that apply to a scenario."""
    has_period = isinstance(settings.reference, Lissajous)
    return (*RESIDUAL_TRIALS, *(kind for kind in SCENARIO_TRIALS if kind != "reference_speed" or has_period))


# Worst-case residuals: functionals `sum_k L_k f~(t_k)`, maximized within norm and data --------------------------------


def _worst_error(error: str) -> Callable[[CertificationResult, int, np.random.Generator], Matrix]:
    """Return a generator of functionals that maximize one error."""

    def functional(result: CertificationResult, k: int, rng: np.random.Generator) -> Matrix:
        """Return the error at a random time and direction; for k = 0 where its interval is farthest from zero."""
        found, i = result.certificate, 3 * ERRORS.index(error)
        interval = found.intervals["a_priori"]
        lower, upper = (x[:, i : i + 3] for x in (interval.lower, interval.upper))
        corner = np.where(np.abs(upper) >= np.abs(lower), upper, lower)
        at = int(np.argmax(np.linalg.norm(corner, axis=1))) if k == 0 else int(rng.integers(len(found.t)))
        direction = corner[at] if k == 0 and np.isfinite(corner[at]).all() else rng.normal(size=3)
        return adversary.error_functional(
            result.nominal_linearization, error, found.t[at], direction / np.linalg.norm(direction)
        )

    return functional


def _random_functional(result: CertificationResult, _k: int, rng: np.random.Generator) -> Matrix:
    """Draw a random functional, which finds an extreme point of the allowed residuals."""
    return rng.normal(size=(len(result.nominal_linearization.nodes), result.nominal_linearization.bodies[-1].stop))


def _sinusoidal_functional(result: CertificationResult, _k: int, rng: np.random.Generator) -> Matrix:
    """Draw a sinusoidal functional with one frequency and a random phase for each output."""
    frequency, inputs = (
        math.exp(rng.uniform(math.log(0.05), math.log(2.0))),
        result.nominal_linearization.bodies[-1].stop,
    )
    phase = rng.uniform(0, 2 * np.pi, inputs)
    return np.cos(2 * np.pi * frequency * result.nominal_linearization.t[:, None] + phase)


RESIDUAL_TRIALS: dict[str, Callable[[CertificationResult, int, np.random.Generator], Matrix]] = {
    **{f"worst_case_{error}": _worst_error(error) for error in ERRORS},
    "random_functional": _random_functional,
    "sinusoidal_functional": _sinusoidal_functional,
}
"""Functional that the residual of a trial maximizes, by kind."""


def _residual_trial(name: str, result: CertificationResult, L: Matrix, seed: int) -> FalsificationTrial:
    """Simulate residuals that maximize a functional, with new sensor noise, and compare with the a priori bounds."""
    found = result.certificate
    components = found.errors.size
    try:
        forces = adversary.worst_case_residual(
            result.experiment,
            result.flight,
            result.nominal_linearization.nodes,
            result.nominal_linearization.records,
            L,
        )
    except (ValueError, RuntimeError) as error:
        return FalsificationTrial(name, (), {}, 0, components, str(error))
    bounds = found.ultimate_bounds["recovery" if "recovery" in found.ultimate_bounds else "energy"].a_priori
    try:
        records, _ = linearized_trajectory.simulate_nominal(
            nominal_run.nominal_experiment(result.experiment, forces),
            result.nominal_linearization.model_schedule,
            seed=seed,
        )
    except linearized_trajectory.TerminatedEarly as error:
        ended = dict.fromkeys(ERRORS, math.inf) if np.isfinite(list(bounds.values())).all() else {}
        return FalsificationTrial(name, (), ended, 0, components, str(error))
    late = np.asarray(records.t) >= found.window[0] - 1e-9
    ratios = _ratios({error: _max_norm(records, error, late) for error in ERRORS}, bounds)
    errors = np.concatenate([getattr(records, error) for error in ERRORS], axis=1)
    at = np.searchsorted(records.t, found.t - 1e-9)
    outside = found.intervals["a_priori"].num_outside(errors[at]) if ratios else 0
    return FalsificationTrial(name, (), ratios, outside, components, "" if ratios else found.a_priori.tube_failure)


def _max_norm(records: signals.StepRecord, error: str, late: Matrix) -> float:
    """Return the largest norm of an error over selected ticks."""
    return float(np.linalg.norm(getattr(records, error)[late], axis=1).max())


def _ratios(observed: Mapping[str, float], bounds: Mapping[str, float]) -> dict[str, float]:
    """Return observed errors over bounds, by error, for finite bounds."""
    return {error: observed[error] / bound for error, bound in bounds.items() if math.isfinite(bound)}


# Changes of the scenario ----------------------------------------------------------------------------------------------


def _seed(settings: Scenario, k: int, _rng: np.random.Generator) -> list[str]:
    """Change the seed of residuals, sensor noise and label errors."""
    return [f"seed={settings.seed + 1001 + k}"]


def _late_update(settings: Scenario, _k: int, rng: np.random.Generator) -> list[str]:
    """Delay the last update, at most until shortly before the end of the run."""
    *before, last = settings.learning.update_times_s
    since, step = settings.learning.start_s, 1 / settings.learning.sample_Hz
    latest = settings.duration_s - 1.0
    t = since + step * math.floor((last + rng.uniform(0.3, 1) * max(latest - last, 0) - since) / step + 1e-9)
    changes = [f"learning.update_times_s={[*before, max(t, last)]}"]
    end = settings.learning.end_s
    return changes if end is None or end >= t else [*changes, f"learning.end_s={t}"]


def _initial_state(_settings: Scenario, _k: int, rng: np.random.Generator) -> list[str]:
    """Offset initial position, attitude and velocity from the reference."""
    position, attitude, velocity = (size * x / np.linalg.norm(x) for x, size in zip(
        rng.normal(size=(3, 3)), rng.uniform(0.2, 1, 3) * [0.5, 40.0, 0.5], strict=True
    ))  # fmt: skip
    return [
        f"initial_state.{name}={[float(f'{x:.3g}') for x in value]}"
        for name, value in (
            ("position_error_m", position),
            ("attitude_error_deg", attitude),
            ("velocity_mps", velocity),
        )
    ]


def _reference_speed(settings: Scenario, k: int, rng: np.random.Generator) -> list[str]:
    """Scale the period of the reference, alternately faster and slower."""
    factor = rng.uniform(0.7, 0.9) if k % 2 == 0 else rng.uniform(1.2, 1.6)
    reference = settings.reference
    assert isinstance(reference, Lissajous)  # ensured by `_kinds`
    return [f"reference.period_s={[float(f'{factor * T:.3g}') for T in reference.period_s]}"]


def _sensor_noise(_settings: Scenario, k: int, rng: np.random.Generator) -> list[str]:
    """Set the sensor noise of the scenario `paper`, then a multiple of it up to 2."""
    factor = 1.0 if k == 0 else float(rng.uniform(0.3, 2.0))
    noise = scenario.load_scenario(STUDY_NOISE).sensors.model_dump()
    return [
        f"sensors.{name}={value * factor:.4g}"
        for name, value in noise.items()
        if isinstance(value, float) and not name.endswith("Hz")
    ]


RATES = (100.0, 200.0, 400.0, 500.0)  # Hz


def _control_rate(settings: Scenario, k: int, _rng: np.random.Generator) -> list[str]:
    """Change the control rate and reduce filter corners above its Nyquist frequency."""
    hertz = [each for each in RATES if each != settings.control_Hz][k % (len(RATES) - 1)]
    slower = {
        "control.joint_filter_Hz": settings.control.joint_filter_Hz,
        "learning.label_filter_Hz": settings.learning.label_filter_Hz,
    }
    return [
        f"control_Hz={hertz:g}",
        *(f"{name}={hertz / 2:g}" for name, corner in slower.items() if corner > hertz / 2),
    ]


def _thrust_limit(settings: Scenario, _k: int, rng: np.random.Generator) -> list[str]:
    """Reduce the thrust limits."""
    factor = rng.uniform(0.4, 0.8)
    return [
        f"agent_types.{name}.thrust_max_N={factor * kind.thrust_max_N:.3g}"
        for name, kind in settings.agent_types.items()
    ]


SCENARIO_TRIALS: dict[str, Callable[[Scenario, int, np.random.Generator], list[str]]] = {
    "seed": _seed,
    "late_update": _late_update,
    "initial_state": _initial_state,
    "reference_speed": _reference_speed,
    "sensor_noise": _sensor_noise,
    "control_rate": _control_rate,
    "thrust_limit": _thrust_limit,
}
"""Overrides of the scenario of a trial, by kind."""
STREAMS = {
    **{f"worst_case_{error}": f"worst {error}" for error in ERRORS},
    "random_functional": "drawn",
    "sinusoidal_functional": "swinging",
    "seed": "seed",
    "late_update": "late update",
    "initial_state": "start",
    "reference_speed": "path",
    "sensor_noise": "sensors",
    "control_rate": "rate",
    "thrust_limit": "thrust",
}
"""Text in the seed of each kind's random numbers; constant, so that trials of earlier versions can be repeated."""


def _scenario_trial(name: str, settings: Scenario, overrides: Sequence[str]) -> FalsificationTrial:
    """Certify a changed scenario by the energy bound and compare its errors with its own bounds."""
    try:
        found = certification.certify(
            scenario.parse(scenario.to_yaml(settings), settings.name, overrides), names=("energy",)
        ).certificate
    except (ScenarioError, ValueError) as error:
        return FalsificationTrial(name, tuple(overrides), {}, 0, 0, f"rejected: {' '.join(str(error).split())}")
    energy = found.ultimate_bounds["energy"]
    each = [_ratios(found.observed, bounds) for bounds in (energy.a_priori, energy.a_posteriori)]
    ratios = {error: max(ratio[error] for ratio in each if error in ratio) for error in each[1]}
    outside = sum(interval.num_outside(found.errors) for interval in found.intervals.values())
    return FalsificationTrial(name, tuple(overrides), ratios, outside, found.errors.size, found.a_priori.tube_failure)
