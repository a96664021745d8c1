"""A priori analysis: bounds of all runs that norm, labels and noise allow, available before a run.

The deviation of a run from the nominal trajectory has three parts: the effect of the prediction error along a path, the
effect of its difference between run and nominal path (the tube), and the effect of sensor noise.

See Also:
    docs/certificate.md: Derivation, sections "Errors as linear functionals of the residual" and "The tube".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from colift.certification import assumptions, linearized_trajectory, nominal_run, reachability, tube
from colift.certification.body_models import body_models
from colift.certification.linearized_trajectory import LinearizedTrajectory
from colift.certification.nominal_run import ERRORS, EvaluationGrid
from colift.certification.reachability import BodyModel
from colift.certification.tube import Tube
from colift.closed_loop import signals
from colift.closed_loop.flight import Experiment, FlightResult
from colift.onboard.learning import confidence_bounds

Matrix = NDArray[np.float64]
Progress = Callable[[str], None]

MAX_RECOVERY_POINTS = 160  # largest number of data points of a body for optimal recovery
TUBE_PERIOD = 0.2  # time between the evaluations of the tube [s]
MAX_NOISE_NONLINEARITY = 2.0  # largest ratio of simulated and linear effect of noise
BLOCK_SIZE = 16  # evaluations of the tube per block


@dataclasses.dataclass(frozen=True)
class APrioriAnalysis:
    """Bounds that hold for every run that norm, labels and noise allow; errors in the order of `ERRORS`.

    Attributes:
        noise: Largest effect of sensor noise on each error component, `(times, 12)`.
        reachable_deviation: By bound, the effect of f~ along the nominal path, `(2, times, 12)`; see
            `reachable_deviations`.
        unavailable_bounds: Requested bounds that do not exist, with the reason.
        tube: Tube around the nominal trajectory, None if there is none.
        tube_failure: Reason why there is no tube; empty if there is one.
        path_deviation: Effect of the difference of f~ between run and nominal path, `(times, 12)`; infinite without a
            tube.
        may_saturate: True if a thrust of some run may saturate.
    """

    noise: Matrix
    reachable_deviation: Mapping[str, Matrix]
    unavailable_bounds: Mapping[str, str]
    tube: Tube | None
    tube_failure: str
    path_deviation: Matrix
    may_saturate: bool


@dataclasses.dataclass(frozen=True)
class TubeGains:
    """Coefficients of the tube's inequality at some nodes of the nominal trajectory.

    Attributes:
        nodes: Nodes, `(times,)`.
        M: Feedback gains of the cells that end at the nodes, `(times, inputs, times, inputs)`.
        direct_term: Direct terms, `(times, inputs)` [N, N m].
    """

    nodes: NDArray[np.intp]
    M: Matrix
    direct_term: Matrix

    def cell_index(self, nodes: int) -> NDArray[np.intp]:
        """Return the cell of each node.

        Args:
            nodes: Number of nodes.

        Returns:
            `(nodes,)`.
        """
        return np.minimum(np.searchsorted(self.nodes, np.arange(nodes)), len(self.nodes) - 1)


def analyze_a_priori(
    experiment: Experiment,
    flight: FlightResult,
    loop: LinearizedTrajectory,
    grid: EvaluationGrid,
    L: Matrix,
    names: Sequence[str],
    progress: Progress,
) -> APrioriAnalysis:
    """Compute the bounds that hold for every run along the nominal trajectory.

    A ValueError is raised if the effect of noise is not of first order.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run; only its residual models are used.
        loop: Closed loop linearized along the nominal trajectory.
        grid: Times at which errors count as ultimate.
        L: Weights of f~ in the errors, `(times, 12, nodes, inputs)`.
        names: Bounds of the prediction error; the energy bound is always included.
        progress: Function called with a description of each step.

    Returns:
        A priori bounds.
    """
    noise = (
        _noise_quantile(experiment, grid) * linearized_trajectory.noise_std(loop, loop.output_rows(*ERRORS))[grid.nodes]
    )
    _check_noise_linearity(experiment, flight, loop, grid, noise)
    bodies = body_models(experiment, flight, loop.records, loop.nodes, "energy")
    found, reason = _solve_tube(loop, bodies, progress)
    reached, unavailable = reachable_deviations(
        experiment, flight, bodies, loop.records, loop, L, names, "tube", progress
    )
    return APrioriAnalysis(
        noise=noise,
        reachable_deviation=reached,
        unavailable_bounds=unavailable,
        tube=found,
        tube_failure=reason,
        path_deviation=found.deviation(L) if found else np.full(noise.shape, np.inf),
        may_saturate=_may_saturate(experiment, loop, bodies, found),
    )


# Effect of the prediction error along a path --------------------------------------------------------------------------


def reachable_deviations(
    experiment: Experiment,
    flight: FlightResult,
    bodies: Sequence[BodyModel],
    records: signals.StepRecord,
    loop: LinearizedTrajectory,
    L: Matrix,
    names: Sequence[str],
    path_name: str,
    progress: Progress,
) -> tuple[dict[str, Matrix], dict[str, str]]:
    """Bound the effect of f~ along a path on each error component and on its negative.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run with its residual models.
        bodies: Bodies along the path under the energy bound.
        records: Records whose states form the path.
        loop: Closed loop linearized along the nominal trajectory.
        L: Weights of f~ in the errors, `(times, 12, nodes, inputs)`.
        names: Bounds of the prediction error; the energy bound is always included.
        path_name: Name of the path in progress messages.
        progress: Function called with a description of each step.

    Returns:
        By bound, `(2, times, 12)`; and the bounds that do not exist with the reason.
    """
    progress(f"error bounds along the path of the {path_name}")
    each = [reachability.functional_bound(body.beta, *reachability.band_bound(body, L)) for body in bodies]
    out, other = {"energy": _total(each)}, None
    for name in [name for name in confidence_bounds.ONLINE_BOUNDS if name in names and name != "energy"]:
        along = body_models(experiment, flight, records, loop.nodes, name)
        # the bounds for random noise share their posterior and differ in beta only
        other = other or [reachability.band_bound(body, L) for body in along]
        out[name] = _total(
            reachability.functional_bound(body.beta, *one) for body, one in zip(along, other, strict=True)
        )
    if "recovery" in names:
        try:
            out["recovery"] = _recovery_deviation(bodies, each, L, path_name, progress)
        except (ValueError, RuntimeError) as error:
            return out, {"recovery": str(error)}
    return out, {}


def _total(each: Iterable[Matrix]) -> Matrix:
    """Sum over the outputs of all bodies."""
    return np.sum([one.sum(-1) for one in each], axis=0)


def _recovery_deviation(
    bodies: Sequence[BodyModel], each: Sequence[Matrix], L: Matrix, path_name: str, progress: Progress
) -> Matrix:
    """Compute the deviation `(2, times, 12)` by optimal recovery, starting from each body's energy bound.

    Args:
        bodies: Bodies along the path under the energy bound.
        each: Energy bounds of each body, `(2, times, 12, outputs)`.
        L: Weights of f~ in the errors, `(times, 12, nodes, inputs)`.
        path_name: Name of the path in progress messages.
        progress: Function called with a description of each step.

    Returns:
        `(2, times, 12)`.

    Raises:
        ValueError: If a body has more than `MAX_RECOVERY_POINTS` data points, or the data contradict the assumptions.
    """
    n = max(int(body.model.num_points) for body in bodies)
    if n > MAX_RECOVERY_POINTS:
        raise ValueError(f"a body has {n} data points; optimal recovery is limited to {MAX_RECOVERY_POINTS}")
    if not all(np.isfinite(banded).all() for banded in each):
        raise ValueError("the data contradict the stated norm and label errors")

    def recovered(body: BodyModel, banded: Matrix) -> Matrix:
        first, last = body.columns.start, body.columns.stop - 1
        progress(f"optimal recovery along the path of the {path_name}, outputs {first} to {last}")
        return reachability.recovery_bound(body, L, banded)

    return _total(recovered(*both) for both in zip(bodies, each, strict=True))


# Tube -----------------------------------------------------------------------------------------------------------------


def tube_gains(
    loop: LinearizedTrajectory, bodies: Sequence[BodyModel], progress: Progress = lambda _message: None
) -> TubeGains:
    """Compute the coefficients of `tube.solve_tube` along the nominal trajectory.

    A ValueError is raised if the data contradict norm and label errors.

    Args:
        loop: Closed loop linearized along the nominal trajectory.
        bodies: Bodies along the nominal path under the energy bound.
        progress: Function called with a description of each step.

    Returns:
        Feedback gains and direct terms.
    """
    at = _tube_nodes(loop)
    cells, inputs = np.r_[0, at[:-1] + 1], loop.bodies[-1].stop
    M, direct = np.zeros((len(at), inputs, len(at), inputs)), np.empty((len(at), inputs))
    for block in np.array_split(np.arange(len(at)), max(1, len(at) // BLOCK_SIZE)):
        progress(f"tube until {loop.t[at[block[-1]]]:.3g} s")
        L = _feature_weights(loop, bodies, at[block])
        for body, weights, (P, c) in zip(bodies, L, tube.ellipsoids(bodies, L), strict=True):
            for i in range(len(body.beta)):
                S, g = tube.gradient_bounds(body, i, body.x[at[block]], P.sum(0))
                column = body.columns.start + i
                M[block, column, : block[-1] + 1] = np.add.reduceat(
                    tube.feedback_matrix(S, g, weights), cells[: block[-1] + 1], axis=1
                )
                direct[block, column] = tube.direct_term(S, g, P, c)
    return TubeGains(at, M, direct)


def _solve_tube(loop: LinearizedTrajectory, bodies: Sequence[BodyModel], progress: Progress) -> tuple[Tube | None, str]:
    """Return the tube, or None with the reason."""
    if not all(np.isfinite(body.beta).all() for body in bodies):
        return None, "the data contradict the stated norm and label errors"
    try:
        gains = tube_gains(loop, bodies, progress)
        difference, contraction = tube.solve_tube(gains.M, gains.direct_term)
    except ValueError as error:
        return None, str(error)
    return Tube(difference[gains.cell_index(len(loop.nodes))], contraction), ""


def _feature_weights(loop: LinearizedTrajectory, bodies: Sequence[BodyModel], nodes: NDArray[np.intp]) -> list[Matrix]:
    """Return the weights that map f~ until the last node to the model inputs of each body at the nodes."""
    names = ["payload", *(f"agent {j}" for j in range(len(bodies) - 1))]
    L = linearized_trajectory.adjoint_weights(loop, loop.output_rows(*names), nodes)[:, :, : nodes[-1] + 1]
    ends = np.cumsum([loop.output_rows(name).size for name in names])
    payload, *agents = np.split(L, ends[:-1], axis=1)
    return [tube.feature_jacobian(bodies[0].x[nodes], payload), *agents]


def _tube_nodes(loop: LinearizedTrajectory) -> NDArray[np.intp]:
    """Return the nodes at which the tube is evaluated: `TUBE_PERIOD` apart, and the last."""
    return np.unique([*np.searchsorted(loop.t, np.arange(TUBE_PERIOD, loop.t[-1], TUBE_PERIOD)), len(loop.t) - 1])


# Saturation and noise -------------------------------------------------------------------------------------------------


def _may_saturate(
    experiment: Experiment, loop: LinearizedTrajectory, bodies: Sequence[BodyModel], found: Tube | None
) -> bool:
    """Return whether a thrust of some run in the tube may saturate, including the effects of f~ and noise."""
    if found is None:
        return True
    at, u = _tube_nodes(loop), np.asarray(loop.records.u, dtype=float)
    L, error = (
        linearized_trajectory.adjoint_weights(loop, loop.output_rows("u"), at),
        np.concatenate([reachability.max_error(body) for body in bodies], axis=1),
    )
    deviation = (np.einsum("trki,ki->tr", np.abs(L), error) + found.deviation(L)).max(0)
    deviation = deviation + _union_quantile(experiment, u.size) * linearized_trajectory.noise_std(
        loop, loop.output_rows("u")
    ).max(0)
    limit = np.concatenate([np.asarray(group.thrust_max) for group in experiment.controller.team.agent_groups])
    return bool(((u - deviation < 0) | (u + deviation > limit)).any())


def _check_noise_linearity(
    experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory, grid: EvaluationGrid, noise: Matrix
) -> None:
    """Check by a simulation that the effect of noise on the nominal trajectory is of first order.

    Noise of joint rates causes accelerations proportional to its square, whose mean no covariance contains.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run with its residual models.
        loop: Closed loop linearized along the nominal trajectory.
        grid: Times at which errors count as ultimate.
        noise: Largest effect of noise to first order, `(times, 12)`.

    Raises:
        ValueError: If the simulated effect of noise is above `MAX_NOISE_NONLINEARITY` times its bound.
    """
    if not assumptions.has_sensor_noise(experiment.world.sensors):
        return
    try:
        records, _ = linearized_trajectory.simulate_nominal(
            nominal_run.nominal_experiment(experiment, flight.model), loop.model_schedule, seed=0
        )
    except linearized_trajectory.TerminatedEarly as error:
        raise ValueError(f"no certificate: with sensor noise alone {error}") from None
    difference = nominal_run.error_components(records) - nominal_run.error_components(loop.records)
    off = np.abs(difference)[loop.nodes][grid.nodes]
    if (off > MAX_NOISE_NONLINEARITY * noise).any():
        i = int(np.argmax((off / noise).max(0)))
        raise ValueError(
            f"no certificate: sensor noise alone changes {ERRORS[i // 3]} by {off[:, i].max():.3g}; to first order the "
            f"bound is {noise[:, i].max():.3g}: lower control.joint_filter_Hz, or reduce the noise (sensors)"
        )


def _noise_quantile(experiment: Experiment, grid: EvaluationGrid) -> float:
    """Return the quantile, in standard deviations, for all error components and ticks of the window together."""
    ticks = len(range(*grid.window.indices(round(experiment.duration / experiment.dt))))
    return _union_quantile(experiment, 3 * len(ERRORS) * ticks)


def _union_quantile(experiment: Experiment, count: int) -> float:
    """Return the two-sided quantile of several normal variables by the union bound, in standard deviations."""
    return float(norm.isf((1 - experiment.bound_assumptions.confidence) / (2 * count)))
