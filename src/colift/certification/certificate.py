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
from colift.certification.agent_iss import Interface
from colift.certification.linearized_trajectory import Variation
from colift.certification.reachability import Body
from colift.certification.tube import Tube
from colift.closed_loop import linearization, signals
from colift.closed_loop.flight import Flight, Plan
from colift.gp import SquaredExponential, error_bounds
from colift.onboard import controller
from colift.onboard.control import agent_controllers, allocators, payload_controllers
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import confidence_bounds, features, residual_model, residual_predictors
from colift.simulation import actuators, contact_dynamics, sensors
from colift.simulation.world import Simulated
from colift.trajectories import lissajous

Matrix = NDArray[np.float64]
Progress = Callable[[str], None]

ERRORS = ("e_p", "e_v", "e_R", "e_omega")
BOUNDS = (*confidence_bounds.ALONG, "recovery")
POINTS = 160  # data points of a body up to which optimal recovery is tried
SELDOM = 0.2  # s between the times at which the tube is taken
BEYOND = 2.0  # times what noise adds to first order, at which that says too little of it
BLOCK = 16  # of those times at once


@dataclasses.dataclass(frozen=True)
class Radii:
    """Ultimate radii under one bound, by error; infinite where there is none."""

    run: Mapping[str, float]  # for the run's own path, known once flown
    tube: Mapping[str, float]  # for every run in the tube, known before: those of Theorem 1
    assumptions: tuple[str, ...]  # what they rest on and is not shown, by name; with none, certified


@dataclasses.dataclass(frozen=True)
class Exceeded:
    """An observed error above a radius: whatever was assumed, not all of it holds."""

    error: str
    bound: str
    of: str  # "tube" or "run"
    observed: float
    radius: float


@dataclasses.dataclass(frozen=True)
class Span:
    """Between what each component of the errors stays, `(times, 12)`: of e_p, e_v, e_R, e_omega."""

    lower: Matrix
    upper: Matrix

    def left(self, errors: Matrix) -> int:
        """How many components, over all times, are beyond."""
        return int((~((self.lower <= errors) & (errors <= self.upper))).sum())


@dataclasses.dataclass(frozen=True)
class Before:
    """What is known before the flight, of every run that norm, labels and noise allow; errors in ERRORS' order."""

    noise: Matrix  # (times, 12), what the sensors' noise adds to a component of an error, at most
    reached: Mapping[str, Matrix]  # by bound, (2, times, 12): what f~ along the twin's path adds, see `_reached`
    left_out: Mapping[str, str]  # bounds that were asked for and have none, and why
    tube: Tube | None
    no_tube: str  # why there is none; empty if there is one
    extra: Matrix  # (times, 12), what f~ of another path than the twin's adds; infinite without a tube
    limited: bool  # some run's thrust may be cut off


@dataclasses.dataclass(frozen=True)
class Certificate:
    """What `certify` found; errors in m, m/s, 1 and rad/s."""

    window: tuple[float, float]  # s, over which ultimate errors are taken
    observed: Mapping[str, float]
    floor: Mapping[str, float]  # the twin's
    unknown: Mapping[str, float]  # the greatest |e - e_twin|: what the unknown forces brought about
    beyond: Mapping[str, float]  # the greatest of it that is not of first order; empty where sensors are noisy
    noise: Mapping[str, float]  # what is added to every component of an error for the sensors' noise, at most
    radii: Mapping[str, Radii]  # by bound
    left_out: Mapping[str, str]  # bounds that were asked for and have none, and why
    before: Before
    t: Matrix  # s
    errors: Matrix  # (times, 12) observed
    spans: Mapping[str, Span]  # of the best bound, for the run's own path and for every run in the tube
    bound: Matrix  # (times,) of e_p by the best bound, on the run's own path
    when: float  # s, where that bound is greatest
    direction: Matrix  # (3,) and towards where, a unit vector; nan where it is infinite

    @property
    def e_p(self) -> Matrix:
        """Observed, (times,)."""
        return np.linalg.norm(self.errors[:, :3], axis=1)

    @property
    def exceeded(self) -> tuple[Exceeded, ...]:
        """Every observed error that is above a radius."""
        return tuple(
            Exceeded(error, bound, of, self.observed[error], radius)
            for bound, radii in self.radii.items()
            for of, each in (("tube", radii.tube), ("run", radii.run))
            for error, radius in each.items()
            if self.observed[error] > radius
        )


def under(plan: Plan, truth: residual_model.Oracle) -> Plan:
    """The plan in a world whose unknown forces are an oracle's means, on the nominal plant; nothing is recorded."""
    no = jnp.asarray(False)
    recorder = dataclasses.replace(plan.pilot.recorder, payload=no, agents=no)
    none = tuple(() for _ in plan.world.sources.agents)
    rest = jax.tree.map(jnp.zeros_like, plan.world.sources.joints)
    smooth = tuple(dataclasses.replace(f, speed=jnp.ones_like(f.speed)) for f in rest)
    sources = dataclasses.replace(
        plan.world.sources, payload=(), agents=none, joints=smooth, functions=(residual_model.Function(oracle=truth),)
    )
    return dataclasses.replace(
        plan,
        world=dataclasses.replace(plan.world, team=plan.pilot.team, sources=sources),
        pilot=dataclasses.replace(plan.pilot, recorder=recorder),
        updates=(),
    )


def twin(plan: Plan, flight: Flight) -> Variation:
    """The twin of a flight that learned, and the loop along it. Raises ValueError for one that has none."""
    refuse(plan)
    if flight.stopped:
        raise ValueError(f"no certificate: the flight stopped: {flight.stopped}")
    if not flight.updates:
        raise ValueError("no certificate: the flight never learned")
    try:
        return linearized_trajectory.along(
            under(plan, flight.oracle), flight.held, noisy=assumptions.noisy(plan.world.sensors)
        )
    except linearized_trajectory.Ended as error:
        raise ValueError(f"no certificate: {error}") from None


def certify(
    plan: Plan,
    flight: Flight,
    loop: Variation,
    names: Sequence[str] = BOUNDS,
    progress: Progress = lambda _what: None,
    before: Before | None = None,
) -> Certificate:
    """The certificate of a flight under some of `BOUNDS`, the energy bound always among them; loop: of its `twin`.

    before: where it is known from another run of this twin; no bounds but its own are taken then.
    Raises ValueError for parts it knows nothing of (`refuse`), a flight that was too short, or noise that moves the
    loop otherwise than to first order.
    """
    refuse(plan)
    grid = grid_of(plan, flight, loop)
    if len(grid.at) < 2:
        left = flight.rows.t[-1] - flight.updates[-1].ready
        raise ValueError(f"no certificate: only {left:.3g} s were flown after the last update; lengthen the flight")
    with threadpool_limits(1):  # the matrices are small
        L = linearized_trajectory.weights(loop, loop.of(*ERRORS), grid.at)
        before = before or _before(plan, flight, loop, grid, L, names, progress)
        held = bodies(plan, flight, flight.rows, loop.nodes, "energy")
        names = [name for name in before.reached if name in (*names, "energy")]
        run, left_out = _reached(plan, flight, held, flight.rows, loop, L, names, "run", progress)
    left_out = {**before.left_out, **left_out}
    more = {"run": before.noise, "tube": before.noise + before.extra}
    twin, flown = _errors(loop.rows), _errors(flight.rows)
    center, errors = (each[loop.nodes][grid.at] for each in (twin, flown))
    spans = {
        name: {
            key: _span(center, reached + more[key]) for key, reached in (("tube", before.reached[name]), ("run", mine))
        }
        for name, mine in run.items()
    }
    met, tube_needs = (
        plan.stated.met,
        error_bounds.unmet("recover", plan.stated.met),
    )  # the tube weighs labels one by one
    always = (
        *(() if before.tube else ("S_X",)),
        *assumptions.of_certificate(plan, limited=before.limited, whole=grid.whole),
    )
    radii = {
        name: Radii(
            run=_radii(each["run"]),
            tube=_radii(each["tube"]),
            assumed=(
                *confidence_bounds.names(
                    error_bounds.unmet("recover" if name == "recovery" else name, met) | tube_needs
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
    t = _np(flight.rows.t)
    return Certificate(
        window=(float(t[grid.window][0]), float(t[grid.window][-1])),
        observed=_norms(flown[grid.window]),
        floor=_norms(twin[grid.window]),
        unknown=_norms((flown - twin)[grid.window]),
        beyond={} if assumptions.noisy(plan.world.sensors) else _norms(errors - center - _first(held, flight, loop, L)),
        noise={error: float(before.noise[:, 3 * i : 3 * i + 3].max()) for i, error in enumerate(ERRORS)},
        radii=radii,
        left_out=left_out,
        before=before,
        t=loop.t[grid.at],
        errors=errors,
        spans=best,
        bound=sizes,
        when=float(loop.t[grid.at][worst]),
        direction=direction,
    )


def _before(
    plan: Plan,
    flight: Flight,
    loop: Variation,
    grid: Grid,
    L: Matrix,
    names: Sequence[str],
    progress: Progress,
) -> Before:
    noise = _quantile(plan, grid) * linearized_trajectory.deviations(loop, loop.of(*ERRORS))[grid.at]
    _still(plan, flight, loop, grid, noise)
    held = bodies(plan, flight, loop.rows, loop.nodes, "energy")
    found, why = _tube(loop, held, progress)
    reached, left_out = _reached(plan, flight, held, loop.rows, loop, L, names, "tube", progress)
    return Before(
        noise=noise,
        reached=reached,
        left_out=left_out,
        tube=found,
        no_tube=why,
        extra=found.reached(L) if found else np.full(noise.shape, np.inf),
        limited=_limited(plan, loop, held, found),
    )


# -- the path --------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Grid:
    """When errors are ultimate."""

    at: NDArray[np.intp]  # nodes of the twin
    window: slice  # ticks
    whole: bool  # the reference goes round once


def refuse(plan: Plan) -> None:
    """Raise ValueError for parts of a plan that a certificate does not hold for, all by name.

    Its equations are those of the paper's leader, the frozen oracles, our allocations, realization and plant; actuators
    and sensors with a memory are not in them.
    """
    pilot, world = plan.pilot, plan.world
    oracle = getattr(pilot, "oracle", None)
    known = {
        "pilot": (pilot, (controller.LeaderFollower,)),
        "leader": (getattr(pilot, "leader", None), (payload_controllers.Geometric,)),
        "features": (getattr(oracle, "features", None), (features.Plain,)),
        "kernel": (oracle and oracle.payload.hyper.kernel, (SquaredExponential,)),
        "predictor": (getattr(pilot, "predictor", None), (residual_predictors.Learned,)),
        "allocator": (getattr(pilot, "allocator", None), (allocators.Linear,)),
        "realizer": (getattr(pilot, "realizer", None), (agent_controllers.Aligned,)),
        "estimator": (getattr(pilot, "estimator", None), (state_estimator.Estimator,)),
        "world": (world, (Simulated,)),
        "plant": (getattr(world, "plant", None), (contact_dynamics.Rigid,)),
        "actuators": (getattr(world, "actuators", None), (actuators.Ideal,)),
        "mass in flight:": (getattr(world, "added", None), (type(None),)),
        **{f"sensor {k}": (one, (sensors.Rig,)) for k, one in enumerate(getattr(world, "extra", ()))},
    }
    other = [f"{name} {type(part).__name__}" for name, (part, ours) in known.items() if type(part) not in ours]
    if other:
        raise ValueError(f"no certificate: its equations do not hold for {', '.join(other)}")


def grid_of(plan: Plan, flight: Flight, loop: Variation) -> Grid:
    """Errors are ultimate in the last round of the reference, else in the second half of what follows the last update.

    Half a round after the update has to pass before.
    """
    ticks, last = len(flight.rows.t), round(flight.updates[-1].ready / plan.dt)
    round_s = _round(plan.pilot.path)
    first = ticks if round_s is None else ticks - round(round_s / plan.dt)
    whole = round_s is not None and first - last >= round(round_s / plan.dt) // 2
    first = first if whole else (last + ticks) // 2
    return Grid(at=np.flatnonzero(loop.nodes >= first), window=slice(first, None), whole=whole)


def _round(path: Any) -> float | None:
    """The time after which a reference is where it was, s; None where it has none that is known."""
    if not isinstance(path, lissajous.Lissajous):
        return None
    pairs = (path.amplitude, path.period), (path.swing, path.swing_period)
    moving = [float(T) for size, period in pairs for T in np.asarray(period)[np.asarray(size) != 0]]
    periods = [Fraction(T).limit_denominator(1000) for T in moving]
    together = lcm(*(T.numerator for T in periods))
    return together / gcd(*(T.denominator for T in periods)) if periods else None


def bodies(plan: Plan, flight: Flight, rows: signals.Row, path: NDArray[np.intp], bound: str) -> tuple[Body, ...]:
    """Every body's unknown along a path, under a bound, after the flight's last update."""
    stated = dataclasses.replace(plan.stated, bound=bound)
    held = confidence_bounds.bands(flight.oracle, stated, len(flight.updates))
    x, agents = signals.inputs(plan.world.team, jax.tree.map(lambda a: a[path], rows))
    columns = linearization.bodies(plan.pilot.team)
    oracle, eps = flight.oracle, stated
    first = oracle.features.payload(jnp.asarray(x))
    out = [
        Body(columns[0], oracle.payload, held.companion.payload, _np(held.payload), eps.norm, eps.payload, _np(first))
    ]
    for group, other, beta, e, each in zip(
        oracle.agents, held.companion.agents, held.agents, eps.agents, agents, strict=True
    ):
        for j in range(len(group.n)):
            one, companion = (jax.tree.map(lambda leaf, j=j: leaf[j], model) for model in (group, other))
            out.append(Body(columns[len(out)], one, companion, _np(beta[j]), eps.norm, e[j], each[:, j]))
    return tuple(out)


def _np(x: Any) -> Matrix:
    return np.asarray(x, dtype=float)


# -- what can be reached ----------------------------------------------------------------------------------------------


def _reached(
    plan: Plan,
    flight: Flight,
    held: Sequence[Body],
    rows: signals.Row,
    loop: Variation,
    L: Matrix,
    names: Sequence[str],
    key: str,
    progress: Progress,
) -> tuple[dict[str, Matrix], dict[str, str]]:
    """By bound, `(2, times, 12)`: what f~ along a path adds to each component of the errors and to its negative.

    held: the bodies along it under the energy bound; key: what the path is called. Second, why a bound is left out.
    """
    progress(f"bands along the {key}'s path")
    each = [reachability.bound(body.beta, *reachability.by_band(body, L)) for body in held]
    out, other = {"energy": _total(each)}, None
    for name in [name for name in confidence_bounds.ALONG if name in names and name != "energy"]:
        along = bodies(plan, flight, rows, loop.nodes, name)
        # the bounds for random noise share their companions: only beta differs
        other = other or [reachability.by_band(body, L) for body in along]
        out[name] = _total(reachability.bound(body.beta, *one) for body, one in zip(along, other, strict=True))
    if "recovery" in names:
        try:
            out["recovery"] = _recovered(held, each, L, key, progress)
        except (ValueError, RuntimeError) as error:
            return out, {"recovery": str(error)}
    return out, {}


def _total(each: Iterable[Matrix]) -> Matrix:
    """Of all bodies' outputs."""
    return np.sum([one.sum(-1) for one in each], axis=0)


def _recovered(held: Sequence[Body], each: Sequence[Matrix], L: Matrix, key: str, progress: Progress) -> Matrix:
    """`(2, times, 12)` by optimal recovery, from each body's bounds by the energy band.

    Raises ValueError for more data than it can take in a few minutes, or data that contradict what is stated;
    RuntimeError as `gp.recovery.recover`.
    """
    n = max(int(body.model.n) for body in held)
    if n > POINTS:
        raise ValueError(f"a body has {n} data points; that would take long beyond {POINTS}")
    if not all(np.isfinite(banded).all() for banded in each):
        raise ValueError("the data contradict the stated norm and label errors")

    def recovered(body: Body, banded: Matrix) -> Matrix:
        progress(f"optimal recovery along the {key}'s path, outputs {body.columns.start} to {body.columns.stop - 1}")
        return reachability.by_recovery(body, L, banded)

    return _total(recovered(*both) for both in zip(held, each, strict=True))


@dataclasses.dataclass(frozen=True)
class Gains:
    """What the tube is solved with, at some of the twin's nodes."""

    at: NDArray[np.intp]  # (times,), nodes
    M: Matrix  # (times, inputs, times, inputs), of cells that end at these
    own: Matrix  # (times, inputs)

    def of_nodes(self, nodes: int) -> NDArray[np.intp]:
        """The cell that each of so many nodes is in."""
        return np.minimum(np.searchsorted(self.at, np.arange(nodes)), len(self.at) - 1)


def gains(loop: Variation, held: Sequence[Body], progress: Progress = lambda _what: None) -> Gains:
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
                S, g = tube.slopes(body, i, body.x[at[some]], P.sum(0))
                of = body.columns.start + i
                M[some, of, : some[-1] + 1] = np.add.reduceat(tube.feeding(S, g, by), cells[: some[-1] + 1], axis=1)
                own[some, of] = tube.own(S, g, P, c)
    return Gains(at, M, own)


def _tube(loop: Variation, held: Sequence[Body], progress: Progress) -> tuple[Tube | None, str]:
    if not all(np.isfinite(body.beta).all() for body in held):
        return None, "the data contradict the stated norm and label errors"
    try:
        of = gains(loop, held, progress)
        difference, contraction = tube.solve(of.M, of.own)
    except ValueError as error:
        return None, str(error)
    return Tube(difference[of.of_nodes(len(loop.nodes))], contraction), ""


def _moved(loop: Variation, held: Sequence[Body], nodes: NDArray[np.intp]) -> list[Matrix]:
    """What f~ until the last of some nodes of the twin adds to what the models of each body see at these."""
    names = ["payload", *(f"agent {j}" for j in range(len(held) - 1))]
    L = linearized_trajectory.weights(loop, loop.of(*names), nodes)[:, :, : nodes[-1] + 1]
    ends = np.cumsum([loop.of(name).size for name in names])
    payload, *agents = np.split(L, ends[:-1], axis=1)
    return [tube.seen(held[0].x[nodes], payload), *agents]


def _rho(held: Sequence[Body]) -> Matrix:
    return np.concatenate([reachability.greatest(body).max(0) for body in held])


def _seldom(loop: Variation) -> NDArray[np.intp]:
    """Nodes at which the tube is taken: some time apart, and the last."""
    return np.unique([*np.searchsorted(loop.t, np.arange(SELDOM, loop.t[-1], SELDOM)), len(loop.t) - 1])


def _limited(plan: Plan, loop: Variation, held: Sequence[Body], found: Tube | None) -> bool:
    """Whether a thrust of some run in the tube may be cut off: the twin's, and what f~ and noise add at most."""
    if found is None:
        return True
    at, u = _seldom(loop), _np(loop.rows.u)
    L, most = (
        linearized_trajectory.weights(loop, loop.of("u"), at),
        np.concatenate([reachability.greatest(body) for body in held], axis=1),
    )
    moved = (np.einsum("trki,ki->tr", np.abs(L), most) + found.reached(L)).max(0)
    moved = moved + _sigmas(plan, u.size) * linearized_trajectory.deviations(loop, loop.of("u")).max(0)
    most = np.concatenate([np.asarray(group.thrust_max) for group in plan.pilot.team.groups])
    return bool(((u - moved < 0) | (u + moved > most)).any())


def _still(plan: Plan, flight: Flight, loop: Variation, grid: Grid, noise: Matrix) -> None:
    """Raise ValueError where the twin, flown with noise and nothing unknown, goes far beyond what noise adds to it.

    Noise of joint rates accelerates by its square, so that its mean is a force: no covariance sees that.
    """
    if not assumptions.noisy(plan.world.sensors):
        return
    try:
        rows, _ = linearized_trajectory.flown(under(plan, flight.oracle), flight.held, seed=0)
    except linearized_trajectory.Ended as error:
        raise ValueError(f"no certificate: with noise alone {error}") from None
    off = np.abs(_errors(rows) - _errors(loop.rows))[loop.nodes][grid.at]
    if (off > BEYOND * noise).any():
        i = int(np.argmax((off / noise).max(0)))
        raise ValueError(
            f"no certificate: noise of sensors alone moves {ERRORS[i // 3]} by {off[:, i].max():.3g}, where to first "
            f"order it is {noise[:, i].max():.3g} at most: filter joint rates more (control.joint_filter_Hz), or lower "
            "the noise (sensors)"
        )


def _quantile(plan: Plan, grid: Grid) -> float:
    """Deviations beyond which no component of an error goes in the window but by 1 - confidence."""
    ticks = len(range(*grid.window.indices(round(plan.duration / plan.dt))))
    return _sigmas(plan, 3 * len(ERRORS) * ticks)


def _sigmas(plan: Plan, many: int) -> float:
    """Deviations beyond which none of so many normal variables goes but by 1 - confidence: the union bound."""
    return float(norm.isf((1 - plan.stated.confidence) / (2 * many)))


# -- radii -----------------------------------------------------------------------------------------------------------


def _errors(rows: signals.Row) -> Matrix:
    return np.concatenate([_np(getattr(rows, error)) for error in ERRORS], axis=1)


def _span(center: Matrix, reached: Matrix) -> Span:
    return Span(lower=center - reached[1], upper=center + reached[0])


def _corner(span: Span) -> Matrix:
    """The farthest point of a span at each time, (times, 12)."""
    return np.where(np.abs(span.upper) >= np.abs(span.lower), span.upper, span.lower)


def _radii(span: Span) -> dict[str, float]:
    """Ultimate radii of the four errors: of the farthest corner at any time."""
    return _norms(_corner(span))


def _norms(errors: Matrix) -> dict[str, float]:
    """The greatest norm of each of the four errors; errors: (times, 12)."""
    sizes = {error: np.linalg.norm(errors[:, 3 * i : 3 * i + 3], axis=1).max() for i, error in enumerate(ERRORS)}
    return {error: float(size) if np.isfinite(size) else float("inf") for error, size in sizes.items()}


def farthest(rows: signals.Row, window: tuple[float, float]) -> tuple[float, Matrix, float]:
    """When in a window e_p is greatest, s, towards where, a unit vector, and how great, m."""
    t = _np(rows.t)
    late = (t >= window[0]) & (t <= window[1])
    e_p = _np(rows.e_p)[late]
    sizes = np.linalg.norm(e_p, axis=1)
    k = int(np.argmax(sizes))
    return float(t[late][k]), e_p[k] / sizes[k], float(sizes[k])


def _first(held: Sequence[Body], flight: Flight, loop: Variation, L: Matrix) -> Matrix:
    """`sum_k L_k f~(q(t_k))`, (times, 12): what f~ along the flight adds to its twin's errors, to first order."""
    joints = [body.columns.stop - body.columns.start - 6 for body in held[1:]]
    f = linearization.by_body(joints, *(_np(getattr(flight.rows, name))[loop.nodes] for name in linearization.PARTS))
    off = [part - reachability.mean(body.model, body.x) for part, body in zip(f, held, strict=True)]
    return np.einsum("trki,ki->tr", L, np.concatenate(off, axis=1))


# -- where the slack is ----------------------------------------------------------------------------------------------


def vartheta(plan: Plan, flight: Flight, loop: Variation) -> Matrix:
    """`sup |delta_W|` of the twin, N and N m: what is left of the mismatch without unknown forces."""
    window = grid_of(plan, flight, loop).window
    return np.linalg.norm(loop.rows.delta_W[window].reshape(-1, 2, 3), axis=2).max(0)


def slack(plan: Plan, flight: Flight, loop: Variation, layer: Interface, found: Certificate) -> dict[str, float]:
    """Radii of e_p, m, under ever better reasoning; each ratio of neighbours is the slack of one cause."""
    grid = grid_of(plan, flight, loop)
    L = linearized_trajectory.weights(loop, loop.of("e_p"), grid.at)
    gains, floor = plan.pilot.leader.gains, found.floor["e_p"] + 3**0.5 * found.noise["e_p"]
    unit = translation_bound.ultimate(np.asarray(gains.K_p), np.asarray(gains.K_v), 1.0).e_p.bound

    def pointwise(bound: str) -> Matrix:
        return _rho(bodies(plan, flight, loop.rows, loop.nodes, bound))

    def added(rho: Matrix) -> float:
        """`(rho_L + sum kappa rho) / m_L`, the paper's way, through the translation's own gain."""
        sizes = [float(np.linalg.norm(rho[columns])) for columns in loop.bodies]
        force = np.linalg.norm(rho[:3]) + layer.kappa[0] @ sizes
        return float(unit * force / float(plan.pilot.team.payload.mass) + floor)

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
    return out | {"observed": found.observed["e_p"], "floor: nothing unknown": found.floor["e_p"]}
