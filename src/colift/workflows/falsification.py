"""A search for what breaks a certificate: unknown forces and flights chosen to be bad, each flown.

Unknown forces that keep the stated norm and every label are held against the radii for any run of the flight as it is;
other flights (seeds, updates, starts, paths, noise, rates, thrust limits) against those of their own certificates.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Generator, Mapping, Sequence

import numpy as np

from colift import scenario
from colift.certification import adversary, certificate, linearized_trajectory
from colift.certification.certificate import ERRORS
from colift.closed_loop import signals
from colift.scenario import Scenario, ScenarioError
from colift.scenario.schema import Lissajous
from colift.workflows import certification
from colift.workflows.certification import CertificationResult

Matrix = np.ndarray
NAMES = ("energy", "recovery")  # the bounds that the radii for any run are of
STUDY_NOISE = "paper"  # the scenario whose sensors others are given


@dataclasses.dataclass(frozen=True)
class FalsificationTrial:
    """One attempt: observed errors over radii, which hold while these are at most one."""

    name: str
    changes: tuple[str, ...]  # of the scenario: with these `colift certify` repeats it; empty for an unknown force
    ratios: Mapping[str, float]  # by error; empty where there is no radius
    violations: int  # components of errors beyond their span at some time
    num_components: int  # of so many
    message: str  # why there is no radius, or how the flight ended early

    @property
    def max_ratio(self) -> float:
        """The greatest ratio; zero where there is none."""
        return max(self.ratios.values(), default=0.0)

    @property
    def is_violated(self) -> bool:
        """Whether a radius or a span was exceeded."""
        return self.max_ratio > 1 or self.violations > 0


def trial_names(settings: Scenario, rounds: int) -> list[str]:
    """The tries of so many rounds, by name: a kind and a number, from which all that is drawn follows."""
    return [f"{kind} {k}" for k in range(rounds) for kind in (*ADVERSARIAL_DISTURBANCE, *_kinds(settings))]


def falsify(
    settings: Scenario, tries: Sequence[str], progress: Callable[[str], None] = lambda _what: None
) -> Generator[FalsificationTrial]:
    """Certify a scenario, then try. Raises as `certification.certify`, ValueError for a name that is no try."""
    for name in tries:
        _split(settings, name)
    made = None
    for name in tries:
        progress(name)
        kind, k = _split(settings, name)
        rng = np.random.default_rng((settings.seed, k, *kind.encode()))
        if kind in ADVERSARIAL_DISTURBANCE:
            made = made or certification.certify(settings, names=NAMES, progress=progress)
            yield _unknown(name, made, ADVERSARIAL_DISTURBANCE[kind](made, k, rng), settings.seed + 1 + k)
        else:
            yield _flight(name, settings, TRIAL_KINDS[kind](settings, k, rng))


def _split(settings: Scenario, name: str) -> tuple[str, int]:
    kind, _, k = name.rpartition(" ")
    kinds = (*ADVERSARIAL_DISTURBANCE, *_kinds(settings))
    if kind not in kinds or not k.isdecimal():
        raise ValueError(f"{name!r} is no try: must be one of {', '.join(kinds)}, and a number, as in '{kinds[0]} 0'")
    return kind, int(k)


def _kinds(settings: Scenario) -> tuple[str, ...]:
    return tuple(kind for kind in TRIAL_KINDS if kind != "path" or isinstance(settings.reference, Lissajous))


# Unknown forces: functionals `sum_k L_k f~(t_k)` of a path, each made as great as norm and labels allow ---------------


def _extreme(error: str) -> Callable[[CertificationResult, int, np.random.Generator], Matrix]:
    def functional(made: CertificationResult, k: int, rng: np.random.Generator) -> Matrix:
        """The error at some time along some direction; first when and where its span reaches farthest."""
        found, i = made.certificate, 3 * ERRORS.index(error)
        lower, upper = (x[:, i : i + 3] for x in (found.intervals["tube"].lower, found.intervals["tube"].upper))
        corner = np.where(np.abs(upper) >= np.abs(lower), upper, lower)
        at = int(np.argmax(np.linalg.norm(corner, axis=1))) if k == 0 else int(rng.integers(len(found.t)))
        direction = corner[at] if k == 0 and np.isfinite(corner[at]).all() else rng.normal(size=3)
        return adversary.error_functional(
            made.nominal_linearization, error, found.t[at], direction / np.linalg.norm(direction)
        )

    return functional


def _drawn(made: CertificationResult, _k: int, rng: np.random.Generator) -> Matrix:
    """Anywhere: an extreme point of what is allowed, as a random functional finds it."""
    return rng.normal(size=(len(made.nominal_linearization.nodes), made.nominal_linearization.bodies[-1].stop))


def _swinging(made: CertificationResult, _k: int, rng: np.random.Generator) -> Matrix:
    """To and fro with one frequency, every output in a phase of its own."""
    frequency, many = math.exp(rng.uniform(math.log(0.05), math.log(2.0))), made.nominal_linearization.bodies[-1].stop
    phase = rng.uniform(0, 2 * np.pi, many)
    return np.cos(2 * np.pi * frequency * made.nominal_linearization.t[:, None] + phase)


ADVERSARIAL_DISTURBANCE: dict[str, Callable[[CertificationResult, int, np.random.Generator], Matrix]] = {
    **{f"worst {error}": _extreme(error) for error in ERRORS},
    "drawn": _drawn,
    "swinging": _swinging,
}


def _unknown(name: str, made: CertificationResult, L: Matrix, seed: int) -> FalsificationTrial:
    """Forces that make a functional great, flown with noise of their own, against the radii for any run."""
    found = made.certificate
    components = found.errors.size
    try:
        forces = adversary.worst_case_residual(
            made.plan, made.flight, made.nominal_linearization.nodes, made.nominal_linearization.records, L
        )
    except (ValueError, RuntimeError) as error:
        return FalsificationTrial(name, (), {}, 0, components, str(error))
    radii = found.radii["recovery" if "recovery" in found.radii else "energy"].a_priori
    try:
        rows, _ = linearized_trajectory.simulate_nominal(
            certificate.nominal_experiment(made.plan, forces), made.flight.model_intervals, seed=seed
        )
    except linearized_trajectory.TerminatedEarly as error:
        ended = dict.fromkeys(ERRORS, math.inf) if np.isfinite(list(radii.values())).all() else {}
        return FalsificationTrial(name, (), ended, 0, components, str(error))
    late = np.asarray(rows.t) >= found.window[0] - 1e-9
    ratios = _ratios({error: _greatest(rows, error, late) for error in ERRORS}, radii)
    errors = np.concatenate([getattr(rows, error) for error in ERRORS], axis=1)
    at = np.searchsorted(rows.t, found.t - 1e-9)
    left = found.intervals["tube"].num_outside(errors[at]) if ratios else 0
    return FalsificationTrial(name, (), ratios, left, components, "" if ratios else found.a_priori.tube_failure)


def _greatest(rows: signals.StepRecord, error: str, late: Matrix) -> float:
    return float(np.linalg.norm(getattr(rows, error)[late], axis=1).max())


def _ratios(observed: Mapping[str, float], radii: Mapping[str, float]) -> dict[str, float]:
    """By error, where radii are finite."""
    return {error: observed[error] / radius for error, radius in radii.items() if math.isfinite(radius)}


# Other flights: changes of the scenario -------------------------------------------------------------------------------


def _seed(settings: Scenario, k: int, _rng: np.random.Generator) -> list[str]:
    """Other forces where they are drawn, other noise, other labels' errors."""
    return [f"seed={settings.seed + 1001 + k}"]


def _late_update(settings: Scenario, _k: int, rng: np.random.Generator) -> list[str]:
    """The last update later, up to shortly before the end."""
    *before, last = settings.learning.update_times_s
    since, step = settings.learning.start_s, 1 / settings.learning.sample_Hz
    latest = settings.duration_s - 1.0
    t = since + step * math.floor((last + rng.uniform(0.3, 1) * max(latest - last, 0) - since) / step + 1e-9)
    changes = [f"learning.update_times_s={[*before, max(t, last)]}"]
    end = settings.learning.end_s
    return changes if end is None or end >= t else [*changes, f"learning.end_s={t}"]


def _start(_settings: Scenario, _k: int, rng: np.random.Generator) -> list[str]:
    """Far from the reference, turned and moving."""
    off, turned, velocity = (size * x / np.linalg.norm(x) for x, size in zip(
        rng.normal(size=(3, 3)), rng.uniform(0.2, 1, 3) * [0.5, 40.0, 0.5], strict=True
    ))  # fmt: skip
    return [
        f"start.{name}={[float(f'{x:.3g}') for x in value]}"
        for name, value in (("position_error_m", off), ("attitude_error_deg", turned), ("velocity_mps", velocity))
    ]


def _path(settings: Scenario, k: int, rng: np.random.Generator) -> list[str]:
    """Flown faster, slower, faster, ..."""
    factor = rng.uniform(0.7, 0.9) if k % 2 == 0 else rng.uniform(1.2, 1.6)
    path = settings.reference
    assert isinstance(path, Lissajous)  # other paths have no such try
    return [f"reference.period_s={[float(f'{factor * T:.3g}') for T in path.period_s]}"]


def _sensors(_settings: Scenario, k: int, rng: np.random.Generator) -> list[str]:
    """The study's noise, then up to twice as much."""
    factor = 1.0 if k == 0 else float(rng.uniform(0.3, 2.0))
    theirs = scenario.load_scenario(STUDY_NOISE).sensors.model_dump()
    return [
        f"sensors.{name}={value * factor:.4g}"
        for name, value in theirs.items()
        if isinstance(value, float) and not name.endswith("Hz")
    ]


RATES = (100.0, 200.0, 400.0, 500.0)  # Hz


def _rate(settings: Scenario, k: int, _rng: np.random.Generator) -> list[str]:
    """Control at other rates."""
    hertz = [each for each in RATES if each != settings.control_Hz][k % (len(RATES) - 1)]
    slower = {
        "control.joint_filter_Hz": settings.control.joint_filter_Hz,
        "learning.filter_Hz": settings.learning.label_filter_Hz,
    }
    return [
        f"control_Hz={hertz:g}",
        *(f"{name}={hertz / 2:g}" for name, corner in slower.items() if corner > hertz / 2),
    ]


def _thrust(settings: Scenario, _k: int, rng: np.random.Generator) -> list[str]:
    """Weaker rotors."""
    factor = rng.uniform(0.4, 0.8)
    return [
        f"agent_types.{name}.thrust_max_N={factor * kind.thrust_max_N:.3g}"
        for name, kind in settings.agent_types.items()
    ]


TRIAL_KINDS: dict[str, Callable[[Scenario, int, np.random.Generator], list[str]]] = {
    "seed": _seed,
    "late update": _late_update,
    "start": _start,
    "path": _path,
    "sensors": _sensors,
    "rate": _rate,
    "thrust": _thrust,
}


def _flight(name: str, settings: Scenario, changes: Sequence[str]) -> FalsificationTrial:
    """Another flight against its own radii, for any run and for its own, by the energy bound."""
    try:
        found = certification.certify(
            scenario.parse(scenario.to_yaml(settings), settings.name, changes), names=("energy",)
        ).certificate
    except (ScenarioError, ValueError) as error:
        return FalsificationTrial(name, tuple(changes), {}, 0, 0, f"refused: {' '.join(str(error).split())}")
    radii = found.radii["energy"]
    each = [_ratios(found.observed, of) for of in (radii.a_priori, radii.a_posteriori)]
    ratios = {error: max(ratio[error] for ratio in each if error in ratio) for error in each[1]}
    left = sum(span.num_outside(found.errors) for span in found.intervals.values())
    return FalsificationTrial(name, tuple(changes), ratios, left, found.errors.size, found.a_priori.tube_failure)
