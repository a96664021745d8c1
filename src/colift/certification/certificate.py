"""Certificate of a simulated run: ultimate bounds of the tracking errors (Theorem 1) and the observed errors.

The closed loop is linearized along the nominal trajectory and driven by the prediction error `f~ = f - mean`. A priori
bounds hold for every run in the tube, a posteriori bounds for the path of the simulated run.

See Also:
    docs/certificate.md: Theorem, derivation and assumptions.
    colift.certification.a_priori: A priori analysis.
    colift.certification.nominal_run: Nominal trajectory and time window.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from colift.certification import a_priori, assumptions, linearized_trajectory, nominal_run, reachability
from colift.certification.a_priori import APrioriAnalysis
from colift.certification.body_models import body_models
from colift.certification.linearized_trajectory import LinearizedTrajectory
from colift.certification.nominal_run import ERRORS, EvaluationGrid
from colift.certification.reachability import BodyModel
from colift.closed_loop import linearization, signals
from colift.closed_loop.flight import Experiment, FlightResult
from colift.gp import error_bounds
from colift.onboard.learning import confidence_bounds

Matrix = NDArray[np.float64]
Progress = Callable[[str], None]

BOUNDS = (*confidence_bounds.ONLINE_BOUNDS, "recovery")  # bounds of the prediction error


@dataclasses.dataclass(frozen=True)
class UltimateBounds:
    """Ultimate bounds of the errors under one bound of the prediction error; infinite where none exists.

    Attributes:
        a_posteriori: Bounds for the path of the run, by error [m, m/s, 1, rad/s].
        a_priori: Bounds for every run in the tube (Theorem 1), by error.
        assumptions: Names of the assumptions that are not shown; certified if empty.
    """

    a_posteriori: Mapping[str, float]
    a_priori: Mapping[str, float]
    assumptions: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Violation:
    """Observed error above an ultimate bound, which shows that an assumption does not hold.

    Attributes:
        error: Name of the error.
        prediction_bound: Bound of the prediction error, such as "energy".
        kind: "a_priori" or "a_posteriori".
        observed: Observed error [m, m/s, 1 or rad/s].
        ultimate_bound: Ultimate bound in the same unit.
    """

    error: str
    prediction_bound: str
    kind: str
    observed: float
    ultimate_bound: float


@dataclasses.dataclass(frozen=True)
class ErrorInterval:
    """Intervals of the components of e_p, e_v, e_R and e_omega, `(times, 12)`.

    Attributes:
        lower: Lower ends [m, m/s, 1, rad/s].
        upper: Upper ends [m, m/s, 1, rad/s].
    """

    lower: Matrix
    upper: Matrix

    def num_outside(self, errors: Matrix) -> int:
        """Count the error components outside their interval over all times.

        Args:
            errors: Error components, `(times, 12)`.

        Returns:
            Number of components.
        """
        return int((~((self.lower <= errors) & (errors <= self.upper))).sum())


@dataclasses.dataclass(frozen=True)
class Certificate:
    """Result of `certify`; errors in m, m/s, 1 and rad/s.

    Attributes:
        window: First and last time at which errors count as ultimate [s].
        observed: Largest observed errors.
        nominal_error: Largest errors of the nominal trajectory.
        disturbance_response: Largest `|e - e_nominal|`, the effect of the residuals.
        linearization_error: Largest part of it that is not of first order; empty for noisy sensors.
        noise_response: Largest effect of sensor noise on a component of each error.
        ultimate_bounds: Ultimate bounds by bound of the prediction error.
        unavailable_bounds: Requested bounds that do not exist, with the reason.
        a_priori: A priori analysis.
        t: Times of `errors`, `intervals` and `bound` [s].
        errors: Observed error components, `(times, 12)`.
        intervals: Error intervals of the best bound: "a_posteriori" for the path of the run, "a_priori" for every run
            in the tube.
        bound: A posteriori bound of e_p by the tightest method, `(times,)` [m].
        worst_time: Time at which `bound` is largest [s].
        worst_direction: Direction of the largest bound, a unit vector `(3,)`; NaN if the bound is infinite.
    """

    window: tuple[float, float]
    observed: Mapping[str, float]
    nominal_error: Mapping[str, float]
    disturbance_response: Mapping[str, float]
    linearization_error: Mapping[str, float]
    noise_response: Mapping[str, float]
    ultimate_bounds: Mapping[str, UltimateBounds]
    unavailable_bounds: Mapping[str, str]
    a_priori: APrioriAnalysis
    t: Matrix
    errors: Matrix
    intervals: Mapping[str, ErrorInterval]
    bound: Matrix
    worst_time: float
    worst_direction: Matrix

    @property
    def e_p(self) -> Matrix:
        """Observed position error, `(times,)` [m]."""
        return np.linalg.norm(self.errors[:, :3], axis=1)

    @property
    def violations(self) -> tuple[Violation, ...]:
        """Observed errors above an ultimate bound."""
        return tuple(
            Violation(error, name, kind, self.observed[error], bound)
            for name, bounds in self.ultimate_bounds.items()
            for kind, each in (("a_priori", bounds.a_priori), ("a_posteriori", bounds.a_posteriori))
            for error, bound in each.items()
            if self.observed[error] > bound
        )


def certify(
    experiment: Experiment,
    flight: FlightResult,
    loop: LinearizedTrajectory,
    names: Sequence[str] = BOUNDS,
    progress: Progress = lambda _message: None,
    a_priori_analysis: APrioriAnalysis | None = None,
) -> Certificate:
    """Compute ultimate bounds of the errors of a run.

    A ValueError is also raised if a part is not supported, or the effect of noise is not of first order.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run.
        loop: Closed loop linearized along the nominal trajectory; see `nominal_run.nominal_trajectory`.
        names: Bounds of the prediction error out of `BOUNDS`; the energy bound is always included.
        progress: Function called with a description of each step.
        a_priori_analysis: A priori analysis of another run with the same nominal trajectory, to reuse its bounds.

    Returns:
        Certificate of the run.

    Raises:
        ValueError: If the run ends too early after the last update.

    Example:
        >>> loop = nominal_run.nominal_trajectory(experiment, flight, schedule)
        >>> certify(experiment, flight, loop).ultimate_bounds["energy"].a_priori["e_p"]
    """
    nominal_run.check_supported(experiment)
    grid = nominal_run.evaluation_grid(experiment, flight, loop)
    if len(grid.nodes) < 2:
        left = flight.records.t[-1] - flight.updates[-1].activation_time
        raise ValueError(f"no certificate: the flight ends {left:.3g} s after the last update: increase duration_s")
    with threadpool_limits(1):  # the matrices are small
        L = linearized_trajectory.adjoint_weights(loop, loop.output_rows(*ERRORS), grid.nodes)
        a_priori_analysis = a_priori_analysis or a_priori.analyze_a_priori(
            experiment, flight, loop, grid, L, names, progress
        )
        bodies = body_models(experiment, flight, flight.records, loop.nodes, "energy")
        names = [name for name in a_priori_analysis.reachable_deviation if name in (*names, "energy")]
        run, unavailable = a_priori.reachable_deviations(
            experiment, flight, bodies, flight.records, loop, L, names, "run", progress
        )
    nominal, observed_components = (
        nominal_run.error_components(loop.records),
        nominal_run.error_components(flight.records),
    )
    center, errors = (each[loop.nodes][grid.nodes] for each in (nominal, observed_components))
    intervals = _error_intervals(center, a_priori_analysis, run)
    best = intervals.get("recovery", intervals["energy"])
    corner = _corner(best["a_posteriori"])[:, :3]
    sizes = np.linalg.norm(corner, axis=1)
    worst = int(np.argmax(sizes))
    direction = corner[worst] / sizes[worst] if np.isfinite(sizes[worst]) else np.full(3, np.nan)
    t = np.asarray(flight.records.t, dtype=float)
    return Certificate(
        window=(float(t[grid.window][0]), float(t[grid.window][-1])),
        observed=_norms(observed_components[grid.window]),
        nominal_error=_norms(nominal[grid.window]),
        disturbance_response=_norms((observed_components - nominal)[grid.window]),
        linearization_error={}
        if assumptions.has_sensor_noise(experiment.world.sensors)
        else _norms(errors - center - _first_order_response(bodies, flight, loop, L)),
        noise_response={
            error: float(a_priori_analysis.noise[:, 3 * i : 3 * i + 3].max()) for i, error in enumerate(ERRORS)
        },
        ultimate_bounds=_ultimate_bounds(experiment, grid, a_priori_analysis, intervals),
        unavailable_bounds={**a_priori_analysis.unavailable_bounds, **unavailable},
        a_priori=a_priori_analysis,
        t=loop.t[grid.nodes],
        errors=errors,
        intervals=best,
        bound=sizes,
        worst_time=float(loop.t[grid.nodes][worst]),
        worst_direction=direction,
    )


def max_error(records: signals.StepRecord, window: tuple[float, float]) -> tuple[float, Matrix, float]:
    """Find the largest position error in a time window.

    Args:
        records: Records of a run.
        window: First and last time [s].

    Returns:
        Time [s], direction as a unit vector, and magnitude [m].
    """
    t = np.asarray(records.t, dtype=float)
    late = (t >= window[0]) & (t <= window[1])
    e_p = np.asarray(records.e_p, dtype=float)[late]
    sizes = np.linalg.norm(e_p, axis=1)
    k = int(np.argmax(sizes))
    return float(t[late][k]), e_p[k] / sizes[k], float(sizes[k])


def _error_intervals(
    center: Matrix, a_priori_analysis: APrioriAnalysis, run: Mapping[str, Matrix]
) -> dict[str, dict[str, ErrorInterval]]:
    """Return the error intervals of each bound, a priori and a posteriori."""
    margin = {
        "a_posteriori": a_priori_analysis.noise,
        "a_priori": a_priori_analysis.noise + a_priori_analysis.path_deviation,
    }
    return {
        name: {
            key: _interval(center, reached + margin[key])
            for key, reached in (("a_priori", a_priori_analysis.reachable_deviation[name]), ("a_posteriori", along_run))
        }
        for name, along_run in run.items()
    }


def _ultimate_bounds(
    experiment: Experiment,
    grid: EvaluationGrid,
    a_priori_analysis: APrioriAnalysis,
    intervals: Mapping[str, Mapping[str, ErrorInterval]],
) -> dict[str, UltimateBounds]:
    """Return the ultimate bounds and their assumptions for each bound of the prediction error."""
    satisfied = experiment.bound_assumptions.satisfied
    tube_assumptions = error_bounds.unsatisfied("recover", satisfied)  # the tube weighs labels individually
    always = (
        *(() if a_priori_analysis.tube else ("S_X",)),
        *assumptions.certificate_assumptions(
            experiment, may_saturate=a_priori_analysis.may_saturate, full_period=grid.full_period
        ),
    )
    return {
        name: UltimateBounds(
            a_posteriori=_max_norms(each["a_posteriori"]),
            a_priori=_max_norms(each["a_priori"]),
            assumptions=(
                *confidence_bounds.describe_assumptions(
                    error_bounds.unsatisfied("recover" if name == "recovery" else name, satisfied) | tube_assumptions
                ),
                *always,
            ),
        )
        for name, each in intervals.items()
    }


def _interval(center: Matrix, deviation: Matrix) -> ErrorInterval:
    """Return the intervals around a center with the deviations of each component and of its negative."""
    return ErrorInterval(lower=center - deviation[1], upper=center + deviation[0])


def _corner(interval: ErrorInterval) -> Matrix:
    """Return the end of largest magnitude of each interval, `(times, 12)`."""
    return np.where(np.abs(interval.upper) >= np.abs(interval.lower), interval.upper, interval.lower)


def _max_norms(interval: ErrorInterval) -> dict[str, float]:
    """Return the ultimate bounds of the four errors: the largest norm of the farthest corner over time."""
    return _norms(_corner(interval))


def _norms(errors: Matrix) -> dict[str, float]:
    """Return the largest norm over time of each of the four errors from their components, `(times, 12)`."""
    sizes = {error: np.linalg.norm(errors[:, 3 * i : 3 * i + 3], axis=1).max() for i, error in enumerate(ERRORS)}
    return {error: float(size) if np.isfinite(size) else float("inf") for error, size in sizes.items()}


def _first_order_response(
    bodies: Sequence[BodyModel], flight: FlightResult, loop: LinearizedTrajectory, L: Matrix
) -> Matrix:
    """Compute `sum_k L_k f~(q(t_k))`, the effect of f~ along the run on the errors to first order, `(times, 12)`."""
    joints = [body.columns.stop - body.columns.start - 6 for body in bodies[1:]]
    f = linearization.group_by_body(
        joints,
        *(
            np.asarray(getattr(flight.records, name), dtype=float)[loop.nodes]
            for name in linearization.RESIDUAL_SIGNALS
        ),
    )
    off = [part - reachability.mean(body.model, body.x) for part, body in zip(f, bodies, strict=True)]
    return np.einsum("trki,ki->tr", L, np.concatenate(off, axis=1))
