"""Theorem 1 computed for a flight: ultimate radii beside observed errors, and where the slack comes from.

The twin is the same flight, under the same oracles from the same times on, in a world that obeys the last one's means:
what is left there is the floor, without any unknown. The loop linearized along the twin (`certify.variation`) leads to
the run, driven by `f~ = f - mean` from the start on. Derivations and what is assumed: `docs/certificate.md`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from math import gcd, lcm
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from colift.certification import assumptions, linearized_trajectory, reachability, translation_bound, tube
from colift.certification.agent_iss import AgentIss
from colift.certification.linearized_trajectory import LinearizedTrajectory
from colift.certification.reachability import BodyModel
from colift.certification.tube import Tube
from colift.closed_loop import linearization, signals
from colift.closed_loop.flight import Experiment, FlightResult
from colift.gp import SquaredExponential, error_bounds
from colift.onboard import controller
from colift.onboard.control import agent_controllers, allocators, payload_controllers
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import confidence_bounds, features, residual_model, residual_predictors
from colift.simulation import actuators, contact_dynamics, sensors
from colift.simulation.world import SimulatedWorld
from colift.trajectories import lissajous

Matrix = NDArray[np.float64]
Progress = Callable[[str], None]

ERRORS = ("e_p", "e_v", "e_R", "e_omega")
BOUNDS = (*confidence_bounds.ONLINE_BOUNDS, "recovery")
MAX_RECOVERY_POINTS = 160  # data points of a body up to which optimal recovery is tried
TUBE_PERIOD = 0.2  # s between the times at which the tube is taken
MAX_NOISE_NONLINEARITY = 2.0  # times what noise adds to first order, at which that says too little of it
BLOCK = 16  # of those times at once


@dataclasses.dataclass(frozen=True)
class UltimateBounds:
    """Ultimate radii under one bound, by error; infinite where there is none."""

    a_posteriori: Mapping[str, float]  # for the run's own path, known once flown
    a_priori: Mapping[str, float]  # for every run in the tube, known before: those of Theorem 1
    assumptions: tuple[str, ...]  # what they rest on and is not shown, by name; with none, certified


@dataclasses.dataclass(frozen=True)
class Violation:
    """An observed error above a radius: whatever was assumed, not all of it holds."""

    error: str
    bound: str
    kind: str  # "tube" or "run"
    observed: float
    radius: float


@dataclasses.dataclass(frozen=True)
class ErrorInterval:
    """Between what each component of the errors stays, `(times, 12)`: of e_p, e_v, e_R, e_omega."""

    lower: Matrix
    upper: Matrix

    def num_outside(self, errors: Matrix) -> int:
        """How many components, over all times, are beyond."""
        return int((~((self.lower <= errors) & (errors <= self.upper))).sum())


@dataclasses.dataclass(frozen=True)
class APrioriAnalysis:
    """What is known before the flight, of every run that norm, labels and noise allow; errors in ERRORS' order."""

    noise: Matrix  # (times, 12), what the sensors' noise adds to a component of an error, at most
    reachable_deviation: Mapping[
        str, Matrix
    ]  # by bound, (2, times, 12): what f~ along the twin's path adds, see `_reached`
    unavailable_bounds: Mapping[str, str]  # bounds that were asked for and have none, and why
    tube: Tube | None
    tube_failure: str  # why there is none; empty if there is one
    path_deviation: Matrix  # (times, 12), what f~ of another path than the twin's adds; infinite without a tube
    may_saturate: bool  # some run's thrust may be cut off


@dataclasses.dataclass(frozen=True)
class Certificate:
    """What `certify` found; errors in m, m/s, 1 and rad/s."""

    window: tuple[float, float]  # s, over which ultimate errors are taken
    observed: Mapping[str, float]
    nominal_error: Mapping[str, float]  # the twin's
    disturbance_response: Mapping[str, float]  # the greatest |e - e_twin|: what the unknown forces brought about
    linearization_error: Mapping[
        str, float
    ]  # the greatest of it that is not of first order; empty where sensors are noisy
    noise: Mapping[str, float]  # what is added to every component of an error for the sensors' noise, at most
    radii: Mapping[str, UltimateBounds]  # by bound
    unavailable_bounds: Mapping[str, str]  # bounds that were asked for and have none, and why
    a_priori: APrioriAnalysis
    t: Matrix  # s
    errors: Matrix  # (times, 12) observed
    intervals: Mapping[str, ErrorInterval]  # of the best bound, for the run's own path and for every run in the tube
    bound: Matrix  # (times,) of e_p by the best bound, on the run's own path
    worst_time: float  # s, where that bound is greatest
    worst_direction: Matrix  # (3,) and towards where, a unit vector; nan where it is infinite

    @property
    def e_p(self) -> Matrix:
        """Observed, (times,)."""
        return np.linalg.norm(self.errors[:, :3], axis=1)

    @property
    def exceeded(self) -> tuple[Violation, ...]:
        """Every observed error that is above a radius."""
        return tuple(
            Violation(error, bound, of, self.observed[error], radius)
            for bound, radii in self.radii.items()
            for of, each in (("tube", radii.a_priori), ("run", radii.a_posteriori))
            for error, radius in each.items()
            if self.observed[error] > radius
        )


def nominal_experiment(experiment: Experiment, truth: residual_model.ResidualModel) -> Experiment:
    """The plan in a world whose unknown forces are an oracle's means, on the nominal plant; nothing is recorded."""
    no = jnp.asarray(False)
    recorder = dataclasses.replace(experiment.controller.recorder, payload=no, agents=no)
    none = tuple(() for _ in experiment.world.disturbances.agents)
    rest = jax.tree.map(jnp.zeros_like, experiment.world.disturbances.joints)
    smooth = tuple(dataclasses.replace(f, speed=jnp.ones_like(f.speed)) for f in rest)
    sources = dataclasses.replace(
        experiment.world.disturbances,
        payload=(),
        agents=none,
        joints=smooth,
        state_functions=(residual_model.ResidualFunction(model=truth),),
    )
    return dataclasses.replace(
        experiment,
        world=dataclasses.replace(experiment.world, team=experiment.controller.team, disturbances=sources),
        controller=dataclasses.replace(experiment.controller, recorder=recorder),
        update_times=(),
    )


def nominal_trajectory(experiment: Experiment, flight: FlightResult) -> LinearizedTrajectory:
    """The twin of a flight that learned, and the loop along it. Raises ValueError for one that has none."""
    check_supported(experiment)
    if flight.termination_reason:
        raise ValueError(f"no certificate: the flight stopped: {flight.termination_reason}")
    if not flight.updates:
        raise ValueError("no certificate: the flight never learned")
    try:
        return linearized_trajectory.linearize_along(
            nominal_experiment(experiment, flight.model),
            flight.model_intervals,
            noisy=assumptions.has_sensor_noise(experiment.world.sensors),
        )
    except linearized_trajectory.TerminatedEarly as error:
        raise ValueError(f"no certificate: {error}") from None


def certify(
    experiment: Experiment,
    flight: FlightResult,
    loop: LinearizedTrajectory,
    names: Sequence[str] = BOUNDS,
    progress: Progress = lambda _what: None,
    before: APrioriAnalysis | None = None,
) -> Certificate:
    """The certificate of a flight under some of `BOUNDS`, the energy bound always among them; loop: of its `twin`.

    before: where it is known from another run of this twin; no bounds but its own are taken then.
    Raises ValueError for parts it knows nothing of (`refuse`), a flight that was too short, or noise that moves the
    loop otherwise than to first order.
    """
    check_supported(experiment)
    grid = evaluation_grid(experiment, flight, loop)
    if len(grid.nodes) < 2:
        left = flight.records.t[-1] - flight.updates[-1].activation_time
        raise ValueError(f"no certificate: only {left:.3g} s were flown after the last update; lengthen the flight")
    with threadpool_limits(1):  # the matrices are small
        L = linearized_trajectory.adjoint_weights(loop, loop.output_rows(*ERRORS), grid.nodes)
        before = before or _before(experiment, flight, loop, grid, L, names, progress)
        held = body_models(experiment, flight, flight.records, loop.nodes, "energy")
        names = [name for name in before.reachable_deviation if name in (*names, "energy")]
        run, left_out = _reached(experiment, flight, held, flight.records, loop, L, names, "run", progress)
    left_out = {**before.unavailable_bounds, **left_out}
    more = {"run": before.noise, "tube": before.noise + before.path_deviation}
    twin, flown = _errors(loop.records), _errors(flight.records)
    center, errors = (each[loop.nodes][grid.nodes] for each in (twin, flown))
    spans = {
        name: {
            key: _span(center, reached + more[key])
            for key, reached in (("tube", before.reachable_deviation[name]), ("run", mine))
        }
        for name, mine in run.items()
    }
    met, tube_needs = (
        experiment.bound_assumptions.satisfied,
        error_bounds.unsatisfied("recover", experiment.bound_assumptions.satisfied),
    )  # the tube weighs labels one by one
    always = (
        *(() if before.tube else ("S_X",)),
        *assumptions.certificate_assumptions(experiment, limited=before.may_saturate, whole=grid.full_period),
    )
    radii = {
        name: UltimateBounds(
            a_posteriori=_radii(each["run"]),
            a_priori=_radii(each["tube"]),
            assumptions=(
                *confidence_bounds.describe_assumptions(
                    error_bounds.unsatisfied("recover" if name == "recovery" else name, met) | tube_needs
                ),
                *always,
            ),
        )
        for name, each in spans.items()
    }
    best = spans.get("recovery", spans["energy"])
    corner = _corner(best["run"])[:, :3]
    sizes = np.linalg.norm(corner, axis=1)
    worst = int(np.argmax(sizes))
    direction = corner[worst] / sizes[worst] if np.isfinite(sizes[worst]) else np.full(3, np.nan)
    t = _np(flight.records.t)
    return Certificate(
        window=(float(t[grid.window][0]), float(t[grid.window][-1])),
        observed=_norms(flown[grid.window]),
        nominal_error=_norms(twin[grid.window]),
        disturbance_response=_norms((flown - twin)[grid.window]),
        linearization_error={}
        if assumptions.has_sensor_noise(experiment.world.sensors)
        else _norms(errors - center - _first(held, flight, loop, L)),
        noise={error: float(before.noise[:, 3 * i : 3 * i + 3].max()) for i, error in enumerate(ERRORS)},
        radii=radii,
        unavailable_bounds=left_out,
        a_priori=before,
        t=loop.t[grid.nodes],
        errors=errors,
        intervals=best,
        bound=sizes,
        worst_time=float(loop.t[grid.nodes][worst]),
        worst_direction=direction,
    )


def _before(
    experiment: Experiment,
    flight: FlightResult,
    loop: LinearizedTrajectory,
    grid: EvaluationGrid,
    L: Matrix,
    names: Sequence[str],
    progress: Progress,
) -> APrioriAnalysis:
    noise = _quantile(experiment, grid) * linearized_trajectory.noise_std(loop, loop.output_rows(*ERRORS))[grid.nodes]
    _still(experiment, flight, loop, grid, noise)
    held = body_models(experiment, flight, loop.records, loop.nodes, "energy")
    found, why = _tube(loop, held, progress)
    reached, left_out = _reached(experiment, flight, held, loop.records, loop, L, names, "tube", progress)
    return APrioriAnalysis(
        noise=noise,
        reachable_deviation=reached,
        unavailable_bounds=left_out,
        tube=found,
        tube_failure=why,
        path_deviation=found.deviation(L) if found else np.full(noise.shape, np.inf),
        may_saturate=_limited(experiment, loop, held, found),
    )


# -- the path --------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class EvaluationGrid:
    """When errors are ultimate."""

    nodes: NDArray[np.intp]  # nodes of the twin
    window: slice  # ticks
    full_period: bool  # the reference goes round once


def check_supported(experiment: Experiment) -> None:
    """Raise ValueError for parts of a plan that a certificate does not hold for, all by name.

    Its equations are those of the paper's leader, the frozen oracles, our allocations, realization and plant; actuators
    and sensors with a memory are not in them.
    """
    onboard_controller, world = experiment.controller, experiment.world
    model = getattr(onboard_controller, "residual_model", None)
    known = {
        "pilot": (onboard_controller, (controller.LeaderFollowerController,)),
        "leader": (getattr(onboard_controller, "payload_controller", None), (payload_controllers.GeometricTracking,)),
        "features": (getattr(model, "features", None), (features.DefaultFeatures,)),
        "kernel": (model and model.payload.hyper.kernel, (SquaredExponential,)),
        "predictor": (getattr(onboard_controller, "predictor", None), (residual_predictors.LearnedResidual,)),
        "allocator": (getattr(onboard_controller, "allocator", None), (allocators.LinearAllocator,)),
        "realizer": (
            getattr(onboard_controller, "agent_controller", None),
            (agent_controllers.ThrustVectoringController,),
        ),
        "estimator": (getattr(onboard_controller, "estimator", None), (state_estimator.ComplementaryFilter,)),
        "world": (world, (SimulatedWorld,)),
        "plant": (getattr(world, "plant", None), (contact_dynamics.RigidContactPlant,)),
        "actuators": (getattr(world, "actuators", None), (actuators.IdealActuators,)),
        "mass in flight:": (getattr(world, "mass_step", None), (type(None),)),
        **{
            f"sensor {k}": (one, (sensors.CalibrationRig,)) for k, one in enumerate(getattr(world, "sensor_models", ()))
        },
    }
    other = [f"{name} {type(part).__name__}" for name, (part, ours) in known.items() if type(part) not in ours]
    if other:
        raise ValueError(f"no certificate: its equations do not hold for {', '.join(other)}")


def evaluation_grid(experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory) -> EvaluationGrid:
    """Errors are ultimate in the last round of the reference, else in the second half of what follows the last update.

    Half a round after the update has to pass before.
    """
    ticks, last = len(flight.records.t), round(flight.updates[-1].activation_time / experiment.dt)
    round_s = _round(experiment.controller.reference)
    first = ticks if round_s is None else ticks - round(round_s / experiment.dt)
    whole = round_s is not None and first - last >= round(round_s / experiment.dt) // 2
    first = first if whole else (last + ticks) // 2
    return EvaluationGrid(nodes=np.flatnonzero(loop.nodes >= first), window=slice(first, None), full_period=whole)


def _round(path: Any) -> float | None:
    """The time after which a reference is where it was, s; None where it has none that is known."""
    if not isinstance(path, lissajous.Lissajous):
        return None
    pairs = (path.amplitude, path.period), (path.rotation_amplitude, path.rotation_period)
    moving = [float(T) for size, period in pairs for T in np.asarray(period)[np.asarray(size) != 0]]
    periods = [Fraction(T).limit_denominator(1000) for T in moving]
    together = lcm(*(T.numerator for T in periods))
    return together / gcd(*(T.denominator for T in periods)) if periods else None


def body_models(
    experiment: Experiment, flight: FlightResult, rows: signals.StepRecord, path: NDArray[np.intp], bound: str
) -> tuple[BodyModel, ...]:
    """Every body's unknown along a path, under a bound, after the flight's last update."""
    stated = dataclasses.replace(experiment.bound_assumptions, bound=bound)
    held = confidence_bounds.confidence_bands(flight.model, stated, len(flight.updates))
    x, agents = signals.model_inputs(experiment.world.team, jax.tree.map(lambda a: a[path], rows))
    columns = linearization.body_columns(experiment.controller.team)
    residual_model, eps = flight.model, stated
    first = residual_model.features.payload(jnp.asarray(x))
    out = [
        BodyModel(
            columns[0],
            residual_model.payload,
            held.bound_posterior.payload,
            _np(held.payload_beta),
            eps.rkhs_norm,
            eps.payload,
            _np(first),
        )
    ]
    for group, other, beta, e, each in zip(
        residual_model.agents, held.bound_posterior.agents, held.agent_beta, eps.agents, agents, strict=True
    ):
        for j in range(len(group.num_points)):
            one, companion = (jax.tree.map(lambda leaf, j=j: leaf[j], model) for model in (group, other))
            out.append(BodyModel(columns[len(out)], one, companion, _np(beta[j]), eps.rkhs_norm, e[j], each[:, j]))
    return tuple(out)


def _np(x: Any) -> Matrix:
    return np.asarray(x, dtype=float)


# -- what can be reached ----------------------------------------------------------------------------------------------


def _reached(
    experiment: Experiment,
    flight: FlightResult,
    held: Sequence[BodyModel],
    rows: signals.StepRecord,
    loop: LinearizedTrajectory,
    L: Matrix,
    names: Sequence[str],
    key: str,
    progress: Progress,
) -> tuple[dict[str, Matrix], dict[str, str]]:
    """By bound, `(2, times, 12)`: what f~ along a path adds to each component of the errors and to its negative.

    held: the bodies along it under the energy bound; key: what the path is called. Second, why a bound is left out.
    """
    progress(f"bands along the {key}'s path")
    each = [reachability.functional_bound(body.beta, *reachability.band_bound(body, L)) for body in held]
    out, other = {"energy": _total(each)}, None
    for name in [name for name in confidence_bounds.ONLINE_BOUNDS if name in names and name != "energy"]:
        along = body_models(experiment, flight, rows, loop.nodes, name)
        # the bounds for random noise share their companions: only beta differs
        other = other or [reachability.band_bound(body, L) for body in along]
        out[name] = _total(
            reachability.functional_bound(body.beta, *one) for body, one in zip(along, other, strict=True)
        )
    if "recovery" in names:
        try:
            out["recovery"] = _recovered(held, each, L, key, progress)
        except (ValueError, RuntimeError) as error:
            return out, {"recovery": str(error)}
    return out, {}


def _total(each: Iterable[Matrix]) -> Matrix:
    """Of all bodies' outputs."""
    return np.sum([one.sum(-1) for one in each], axis=0)


def _recovered(held: Sequence[BodyModel], each: Sequence[Matrix], L: Matrix, key: str, progress: Progress) -> Matrix:
    """`(2, times, 12)` by optimal recovery, from each body's bounds by the energy band.

    Raises ValueError for more data than it can take in a few minutes, or data that contradict what is stated;
    RuntimeError as `gp.recovery.recover`.
    """
    n = max(int(body.model.num_points) for body in held)
    if n > MAX_RECOVERY_POINTS:
        raise ValueError(f"a body has {n} data points; that would take long beyond {MAX_RECOVERY_POINTS}")
    if not all(np.isfinite(banded).all() for banded in each):
        raise ValueError("the data contradict the stated norm and label errors")

    def recovered(body: BodyModel, banded: Matrix) -> Matrix:
        progress(f"optimal recovery along the {key}'s path, outputs {body.columns.start} to {body.columns.stop - 1}")
        return reachability.recovery_bound(body, L, banded)

    return _total(recovered(*both) for both in zip(held, each, strict=True))


@dataclasses.dataclass(frozen=True)
class TubeGains:
    """What the tube is solved with, at some of the twin's nodes."""

    nodes: NDArray[np.intp]  # (times,), nodes
    M: Matrix  # (times, inputs, times, inputs), of cells that end at these
    direct_term: Matrix  # (times, inputs)

    def cell_index(self, nodes: int) -> NDArray[np.intp]:
        """The cell that each of so many nodes is in."""
        return np.minimum(np.searchsorted(self.nodes, np.arange(nodes)), len(self.nodes) - 1)


def tube_gains(
    loop: LinearizedTrajectory, held: Sequence[BodyModel], progress: Progress = lambda _what: None
) -> TubeGains:
    """`M` and `own` of `tube.solve` along the twin, for bodies held to its path.

    Raises ValueError where the data contradict norm and label errors.
    """
    at = _seldom(loop)
    cells, many = np.r_[0, at[:-1] + 1], loop.bodies[-1].stop
    M, own = np.zeros((len(at), many, len(at), many)), np.empty((len(at), many))
    for some in np.array_split(np.arange(len(at)), max(1, len(at) // BLOCK)):
        progress(f"the tube, until {loop.t[at[some[-1]]]:.3g} s")
        L = _moved(loop, held, at[some])
        for body, by, (P, c) in zip(held, L, tube.ellipsoids(held, L), strict=True):
            for i in range(len(body.beta)):
                S, g = tube.gradient_bounds(body, i, body.x[at[some]], P.sum(0))
                of = body.columns.start + i
                M[some, of, : some[-1] + 1] = np.add.reduceat(
                    tube.feedback_matrix(S, g, by), cells[: some[-1] + 1], axis=1
                )
                own[some, of] = tube.direct_term(S, g, P, c)
    return TubeGains(at, M, own)


def _tube(loop: LinearizedTrajectory, held: Sequence[BodyModel], progress: Progress) -> tuple[Tube | None, str]:
    if not all(np.isfinite(body.beta).all() for body in held):
        return None, "the data contradict the stated norm and label errors"
    try:
        of = tube_gains(loop, held, progress)
        difference, contraction = tube.solve_tube(of.M, of.direct_term)
    except ValueError as error:
        return None, str(error)
    return Tube(difference[of.cell_index(len(loop.nodes))], contraction), ""


def _moved(loop: LinearizedTrajectory, held: Sequence[BodyModel], nodes: NDArray[np.intp]) -> list[Matrix]:
    """What f~ until the last of some nodes of the twin adds to what the models of each body see at these."""
    names = ["payload", *(f"agent {j}" for j in range(len(held) - 1))]
    L = linearized_trajectory.adjoint_weights(loop, loop.output_rows(*names), nodes)[:, :, : nodes[-1] + 1]
    ends = np.cumsum([loop.output_rows(name).size for name in names])
    payload, *agents = np.split(L, ends[:-1], axis=1)
    return [tube.feature_jacobian(held[0].x[nodes], payload), *agents]


def _rho(held: Sequence[BodyModel]) -> Matrix:
    return np.concatenate([reachability.max_error(body).max(0) for body in held])


def _seldom(loop: LinearizedTrajectory) -> NDArray[np.intp]:
    """Nodes at which the tube is taken: some time apart, and the last."""
    return np.unique([*np.searchsorted(loop.t, np.arange(TUBE_PERIOD, loop.t[-1], TUBE_PERIOD)), len(loop.t) - 1])


def _limited(experiment: Experiment, loop: LinearizedTrajectory, held: Sequence[BodyModel], found: Tube | None) -> bool:
    """Whether a thrust of some run in the tube may be cut off: the twin's, and what f~ and noise add at most."""
    if found is None:
        return True
    at, u = _seldom(loop), _np(loop.records.u)
    L, most = (
        linearized_trajectory.adjoint_weights(loop, loop.output_rows("u"), at),
        np.concatenate([reachability.max_error(body) for body in held], axis=1),
    )
    moved = (np.einsum("trki,ki->tr", np.abs(L), most) + found.deviation(L)).max(0)
    moved = moved + _sigmas(experiment, u.size) * linearized_trajectory.noise_std(loop, loop.output_rows("u")).max(0)
    most = np.concatenate([np.asarray(group.thrust_max) for group in experiment.controller.team.agent_groups])
    return bool(((u - moved < 0) | (u + moved > most)).any())


def _still(
    experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory, grid: EvaluationGrid, noise: Matrix
) -> None:
    """Raise ValueError where the twin, flown with noise and nothing unknown, goes far beyond what noise adds to it.

    Noise of joint rates accelerates by its square, so that its mean is a force: no covariance sees that.
    """
    if not assumptions.has_sensor_noise(experiment.world.sensors):
        return
    try:
        rows, _ = linearized_trajectory.simulate_nominal(
            nominal_experiment(experiment, flight.model), flight.model_intervals, seed=0
        )
    except linearized_trajectory.TerminatedEarly as error:
        raise ValueError(f"no certificate: with noise alone {error}") from None
    off = np.abs(_errors(rows) - _errors(loop.records))[loop.nodes][grid.nodes]
    if (off > MAX_NOISE_NONLINEARITY * noise).any():
        i = int(np.argmax((off / noise).max(0)))
        raise ValueError(
            f"no certificate: noise of sensors alone moves {ERRORS[i // 3]} by {off[:, i].max():.3g}, where to first "
            f"order it is {noise[:, i].max():.3g} at most: filter joint rates more (control.joint_filter_Hz), or lower "
            "the noise (sensors)"
        )


def _quantile(experiment: Experiment, grid: EvaluationGrid) -> float:
    """Deviations beyond which no component of an error goes in the window but by 1 - confidence."""
    ticks = len(range(*grid.window.indices(round(experiment.duration / experiment.dt))))
    return _sigmas(experiment, 3 * len(ERRORS) * ticks)


def _sigmas(experiment: Experiment, many: int) -> float:
    """Deviations beyond which none of so many normal variables goes but by 1 - confidence: the union bound."""
    return float(norm.isf((1 - experiment.bound_assumptions.confidence) / (2 * many)))


# -- radii -----------------------------------------------------------------------------------------------------------


def _errors(rows: signals.StepRecord) -> Matrix:
    return np.concatenate([_np(getattr(rows, error)) for error in ERRORS], axis=1)


def _span(center: Matrix, reached: Matrix) -> ErrorInterval:
    return ErrorInterval(lower=center - reached[1], upper=center + reached[0])


def _corner(span: ErrorInterval) -> Matrix:
    """The farthest point of a span at each time, (times, 12)."""
    return np.where(np.abs(span.upper) >= np.abs(span.lower), span.upper, span.lower)


def _radii(span: ErrorInterval) -> dict[str, float]:
    """Ultimate radii of the four errors: of the farthest corner at any time."""
    return _norms(_corner(span))


def _norms(errors: Matrix) -> dict[str, float]:
    """The greatest norm of each of the four errors; errors: (times, 12)."""
    sizes = {error: np.linalg.norm(errors[:, 3 * i : 3 * i + 3], axis=1).max() for i, error in enumerate(ERRORS)}
    return {error: float(size) if np.isfinite(size) else float("inf") for error, size in sizes.items()}


def max_error(rows: signals.StepRecord, window: tuple[float, float]) -> tuple[float, Matrix, float]:
    """When in a window e_p is greatest, s, towards where, a unit vector, and how great, m."""
    t = _np(rows.t)
    late = (t >= window[0]) & (t <= window[1])
    e_p = _np(rows.e_p)[late]
    sizes = np.linalg.norm(e_p, axis=1)
    k = int(np.argmax(sizes))
    return float(t[late][k]), e_p[k] / sizes[k], float(sizes[k])


def _first(held: Sequence[BodyModel], flight: FlightResult, loop: LinearizedTrajectory, L: Matrix) -> Matrix:
    """`sum_k L_k f~(q(t_k))`, (times, 12): what f~ along the flight adds to its twin's errors, to first order."""
    joints = [body.columns.stop - body.columns.start - 6 for body in held[1:]]
    f = linearization.group_by_body(
        joints, *(_np(getattr(flight.records, name))[loop.nodes] for name in linearization.RESIDUAL_SIGNALS)
    )
    off = [part - reachability.mean(body.model, body.x) for part, body in zip(f, held, strict=True)]
    return np.einsum("trki,ki->tr", L, np.concatenate(off, axis=1))


# -- where the slack is ----------------------------------------------------------------------------------------------


def nominal_mismatch(experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory) -> Matrix:
    """`sup |delta_W|` of the twin, N and N m: what is left of the mismatch without unknown forces."""
    window = evaluation_grid(experiment, flight, loop).window
    return np.linalg.norm(loop.records.delta_W[window].reshape(-1, 2, 3), axis=2).max(0)


def conservatism_breakdown(
    experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory, layer: AgentIss, found: Certificate
) -> dict[str, float]:
    """Radii of e_p, m, under ever better reasoning; each ratio of neighbours is the slack of one cause."""
    grid = evaluation_grid(experiment, flight, loop)
    L = linearized_trajectory.adjoint_weights(loop, loop.output_rows("e_p"), grid.nodes)
    gains, floor = (
        experiment.controller.payload_controller.gains,
        found.nominal_error["e_p"] + 3**0.5 * found.noise["e_p"],
    )
    unit = translation_bound.ultimate_bound(np.asarray(gains.K_p), np.asarray(gains.K_v), 1.0).e_p.bound

    def pointwise(bound: str) -> Matrix:
        return _rho(body_models(experiment, flight, loop.records, loop.nodes, bound))

    def added(rho: Matrix) -> float:
        """`(rho_L + sum kappa rho) / m_L`, the paper's way, through the translation's own gain."""
        sizes = [float(np.linalg.norm(rho[columns])) for columns in loop.bodies]
        force = np.linalg.norm(rho[:3]) + layer.kappa[0] @ sizes
        return float(unit * force / float(experiment.controller.team.payload.mass) + floor)

    rho = pointwise("energy")
    together = float(np.linalg.norm(np.abs(L).sum(2) @ rho, axis=1).max()) if np.isfinite(rho).all() else float("inf")
    out = {
        "the paper's beta, mismatch and error added": added(pointwise("srinivas")),
        "energy bound, mismatch and error added": added(rho),
        "energy bound, one loop for both": together + floor,
    }
    for name in ("energy", "recovery"):
        for key, where in (("tube", "any run"), ("run", "this run")):
            if name in found.radii:
                out[f"{name}, one functional, {where}"] = getattr(found.radii[name], key)["e_p"]
    return out | {"observed": found.observed["e_p"], "floor: nothing unknown": found.nominal_error["e_p"]}
