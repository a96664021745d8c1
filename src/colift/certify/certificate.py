"""Theorem 1 computed for a flight: ultimate radii beside observed errors, and where the slack comes from.

The flight's oracle is frozen after its last update. Its twin is the same flight with the oracle's own mean as truth:
what is left there is the floor, without any unknown. From the twin's path the loop's response leads to the run's,
driven by `f~ = f - mean`. Derivations and what is assumed: `docs/certificate.md`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from colift import actuator, band, control, dynamics, estimate, fly, learn, response, sensor, simulate
from colift.certify import assumed, reach, rotation, translation, tube
from colift.certify.interface import Interface
from colift.certify.reach import Body
from colift.certify.tube import Tube
from colift.gp import SquaredExponential, bounds
from colift.model import PayloadState
from colift.response import Response
from colift.world import Simulated

Matrix = NDArray[np.float64]
Progress = Callable[[str], None]

ERRORS = ("e_p", "e_v", "e_R", "e_omega")
BOUNDS = (*band.ALONG, "recovery")
STEP = 0.04  # s between samples of the path
POINTS = 160  # data points of a body up to which optimal recovery is tried
EVERY = 8  # conic programs at every so many output samples, which are two steps apart


@dataclasses.dataclass(frozen=True)
class Radii:
    """Ultimate radii under one bound, by error; infinite where there is none."""

    run: Mapping[str, float]  # for the run's own path, known once flown
    tube: Mapping[str, float]  # for every run in the tube, known before: those of Theorem 1
    assumed: tuple[str, ...]  # what they rest on and is not shown, by name; with none, certified


@dataclasses.dataclass(frozen=True)
class Exceeded:
    """An observed error above a radius: whatever was assumed, not all of it holds."""

    error: str
    bound: str
    of: str  # "tube" or "run"
    observed: float
    radius: float


@dataclasses.dataclass(frozen=True)
class Certificate:
    """What `certify` found; errors in m, m/s, 1 and rad/s."""

    window: tuple[float, float]  # s, over which ultimate errors are taken
    transient: float  # what the loop's slowest mode leaves at its start of a deviation at the last update
    observed: Mapping[str, float]
    floor: Mapping[str, float]  # the twin's
    unknown: Mapping[str, float]  # the greatest |e - e_twin|: what the unknown forces brought about
    radii: Mapping[str, Radii]  # by bound
    left_out: Mapping[str, str]  # bounds that were asked for and have none, and why
    tube: Tube | None
    no_tube: str  # why there is none; empty if there is one
    t: Matrix  # s
    e_p: Matrix  # (time,) observed
    bound: Matrix  # (time,) of the best bound, on the run's own path
    when: float  # s, where that bound is greatest
    direction: Matrix  # (3,) and towards where, a unit vector; nan where it is infinite

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


def twin(plan: simulate.Plan, oracle: learn.Oracle) -> simulate.Plan:
    """The flight of a frozen oracle in a world that obeys it: nothing is recorded, nothing is unknown."""
    return under(plan, oracle, oracle)


def under(plan: simulate.Plan, oracle: learn.Oracle, truth: learn.Oracle) -> simulate.Plan:
    """The flight of a frozen oracle where the unknown forces are another's means, on the nominal plant."""
    no = jnp.asarray(False)
    recorder = dataclasses.replace(plan.pilot.recorder, payload=no, agents=no)
    none = tuple(() for _ in plan.world.sources.agents)
    rest = jax.tree.map(jnp.zeros_like, plan.world.sources.joints)
    smooth = tuple(dataclasses.replace(f, speed=jnp.ones_like(f.speed)) for f in rest)
    sources = dataclasses.replace(
        plan.world.sources, payload=(), agents=none, joints=smooth, functions=(learn.Function(oracle=truth),)
    )
    return dataclasses.replace(
        plan,
        world=dataclasses.replace(plan.world, team=plan.pilot.team, sources=sources),
        pilot=dataclasses.replace(plan.pilot, recorder=recorder, oracle=oracle),
        updates=(),
    )


def certify(
    plan: simulate.Plan,
    flight: simulate.Flight,
    of_twin: simulate.Flight,
    linear: Response,
    names: Sequence[str] = BOUNDS,
    progress: Progress = lambda _what: None,
) -> Certificate:
    """The certificate of a flight under some of `BOUNDS`, the energy bound always among them.

    of_twin: the flight of `twin`; linear: the response of the plan's pilot around rest, for an oracle that predicts
    zero.
    Raises ValueError for parts it knows nothing of (`refuse`), a flight or twin that stopped early, or that never
    learned, or a loop that is unstable.
    """
    refuse(plan)
    for name, flown in (("flight", flight), ("twin", of_twin)):
        if flown.stopped:
            raise ValueError(f"no certificate: the {name} stopped: {flown.stopped}")
    if not flight.updates:
        raise ValueError("no certificate: the flight never learned")
    pace = float(np.linalg.eigvals(linear.A).real.max())
    if pace >= 0:
        raise ValueError(f"no certificate: the loop is unstable at rest, a mode has rate {pace:+.3g} 1/s")
    grid = path_of(plan, flight, STEP)
    if len(grid.at) < 2:
        left = flight.rows.t[-1] - flight.updates[-1].t
        raise ValueError(f"no certificate: only {left:.3g} s were flown after the last update; lengthen the flight")
    H = reach.impulse(linear, linear.output(*OF_INTEREST), grid.step, len(grid.path))
    off = _mismatch(plan, of_twin.rows, grid.window)
    with threadpool_limits(1):  # the matrices are small
        paths = {"tube": of_twin.rows, "run": flight.rows}
        energy = {key: bodies(plan, flight, rows, grid.path, "energy") for key, rows in paths.items()}
        found, why = _tube(linear, plan, energy["tube"], grid)
        reached, left_out = _reached(plan, flight, energy, paths, grid, H, names, progress)
    extra = np.abs(H).sum(0) @ found.difference if found else np.full(H.shape[1], np.inf)
    met, tube_needs = plan.stated.met, bounds.unmet("energy", plan.stated.met)  # the tube is the energy bound's
    t = _np(flight.rows.t)
    transient = float(np.exp(pace * (t[grid.window][0] - flight.updates[-1].t)))
    thrusts = [_np(rows.u)[grid.path[0] :] for rows in paths.values()]
    always = (*(() if found else ("S_X",)), *assumed.of_certificate(plan, thrusts, transient))
    radii = {
        name: Radii(
            run=_radii(plan, of_twin.rows, off, grid, each["run"], np.zeros_like(extra)),
            tube=_radii(plan, of_twin.rows, off, grid, each["tube"], extra),
            assumed=(*band.names(bounds.unmet("recover" if name == "recovery" else name, met) | tube_needs), *always),
        )
        for name, each in reached.items()
    }
    best = reached.get("recovery", reached["energy"])["run"]
    corner = _corner(_np(of_twin.rows.e_p)[grid.path][grid.at], best[:, :, :3])
    sizes = np.linalg.norm(corner, axis=1)
    worst = int(np.argmax(sizes))
    direction = corner[worst] / sizes[worst] if np.isfinite(sizes[worst]) else np.full(3, np.nan)
    return Certificate(
        window=(float(t[grid.window][0]), float(t[grid.window][-1])),
        transient=transient,
        observed=_greatest(flight.rows, grid.window),
        floor=_greatest(of_twin.rows, grid.window),
        unknown=_greatest(flight.rows, grid.window, of_twin.rows),
        radii=radii,
        left_out=left_out,
        tube=found,
        no_tube=why,
        t=t[grid.path][grid.at],
        e_p=np.linalg.norm(flight.rows.e_p[grid.path][grid.at], axis=1),
        bound=sizes,
        when=float(t[grid.path][grid.at][worst]),
        direction=direction,
    )


# -- the path --------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Grid:
    """Samples of the path since the last update, and those at which errors are bounded."""

    path: NDArray[np.intp]  # ticks
    at: NDArray[np.intp]  # indices into path
    window: slice  # ticks
    step: float  # s


def refuse(plan: simulate.Plan) -> None:
    """Raise ValueError for parts of a plan that a certificate does not hold for, all by name.

    Its equations are those of the paper's leader, the frozen oracles, our allocations, realization and plant; actuators
    and sensors with a memory are not in them.
    """
    pilot, world = plan.pilot, plan.world
    oracle = getattr(pilot, "oracle", None)
    known = {
        "pilot": (pilot, (fly.LeaderFollower,)),
        "leader": (getattr(pilot, "leader", None), (fly.Geometric,)),
        "features": (getattr(oracle, "features", None), (learn.Plain,)),
        "kernel": (oracle and oracle.payload.hyper.kernel, (SquaredExponential,)),
        "predictor": (getattr(pilot, "predictor", None), (fly.Learned,)),
        "allocator": (getattr(pilot, "allocator", None), (fly.Linear,)),
        "realizer": (getattr(pilot, "realizer", None), (fly.Aligned,)),
        "estimator": (getattr(pilot, "estimator", None), (estimate.Estimator,)),
        "world": (world, (Simulated,)),
        "plant": (getattr(world, "plant", None), (dynamics.Rigid,)),
        "actuators": (getattr(world, "actuators", None), (actuator.Ideal,)),
        **{f"sensor {k}": (one, (sensor.Rig,)) for k, one in enumerate(getattr(world, "extra", ()))},
    }
    other = [f"{name} {type(part).__name__}" for name, (part, ours) in known.items() if type(part) not in ours]
    if other:
        raise ValueError(f"no certificate: its equations do not hold for {', '.join(other)}")


def path_of(plan: simulate.Plan, flight: simulate.Flight, step: float) -> Grid:
    """Samples about `step` s apart. Errors are ultimate in the second half of what follows the last update."""
    dt, last = plan.dt, flight.updates[-1].t
    every = max(1, round(step / dt))
    ticks = len(flight.rows.t)
    path = np.arange(round(last / dt), ticks, every)
    first = (round(last / dt) + ticks) // 2
    return Grid(path=path, at=np.flatnonzero(path >= first)[::2], window=slice(first, None), step=every * dt)


def bodies(
    plan: simulate.Plan, flight: simulate.Flight, rows: simulate.Row, path: NDArray[np.intp], bound: str
) -> tuple[Body, ...]:
    """Every body's unknown along a path, under a bound, after the flight's last update."""
    stated = dataclasses.replace(plan.stated, bound=bound)
    held = band.bands(flight.oracle, stated, len(flight.updates))
    x, agents = simulate.inputs(plan.world.team, jax.tree.map(lambda a: a[path], rows))
    columns = response.bodies(plan.pilot.team)
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

OF_INTEREST = ("e_p", "e_v", "alpha")  # rows of H in this order, three each


def _reached(
    plan: simulate.Plan,
    flight: simulate.Flight,
    energy: Mapping[str, Sequence[Body]],
    paths: Mapping[str, simulate.Row],
    grid: Grid,
    H: Matrix,
    names: Sequence[str],
    progress: Progress,
) -> tuple[dict[str, dict[str, Matrix]], dict[str, str]]:
    """By bound and path, `(2, times, 9)`: what f~ adds to each of `OF_INTEREST` and to its negative, at most.

    Optimal recovery is for e_p alone: the other rows keep the energy bound. Second, why a bound is left out.
    """
    out: dict[str, dict[str, Matrix]] = {name: {} for name in BOUNDS if name in names or name == "energy"}
    left_out: dict[str, str] = {}
    for key, rows in paths.items():
        progress(f"bands along the {key}'s path")
        spans = [reach.by_band(body, H, grid.at) for body in energy[key]]
        each = [reach.bound(body.beta, *span) for body, span in zip(energy[key], spans, strict=True)]
        out["energy"][key] = sum(one.sum(-1) for one in each)
        other = None
        for name in [name for name in out if name not in ("energy", "recovery")]:
            held = bodies(plan, flight, rows, grid.path, name)
            # the bounds for random noise share their companions: only beta differs
            other = other or [reach.by_band(body, H, grid.at) for body in held]
            out[name][key] = sum(reach.bound(body.beta, *span).sum(-1) for body, span in zip(held, other, strict=True))
        if "recovery" in out and not left_out:
            try:
                out["recovery"][key] = _recovered(energy[key], each, grid, H, key, progress)
            except (ValueError, RuntimeError) as error:
                left_out["recovery"] = str(error)
    return {name: reached for name, reached in out.items() if name not in left_out}, left_out


def _recovered(
    held: Sequence[Body], each: Sequence[Matrix], grid: Grid, H: Matrix, key: str, progress: Progress
) -> Matrix:
    """`(2, times, 9)` by optimal recovery, from each body's bounds by the energy band.

    Raises ValueError for more data than the programs can take in a few minutes, or data that contradict what is
    stated; RuntimeError as `gp.recovery.recover`.
    """
    n = max(int(body.model.n) for body in held)
    if n > POINTS:
        raise ValueError(f"a body has {n} data points; its programs would take long beyond {POINTS}")
    if not all(np.isfinite(banded).all() for banded in each):
        raise ValueError("the data contradict the stated norm and label errors")
    total = np.zeros_like(each[0][..., 0])
    for body, banded in zip(held, each, strict=True):
        progress(f"optimal recovery along the {key}'s path, outputs {body.columns.start} to {body.columns.stop - 1}")
        found = banded.copy()
        found[:, :, :3] = reach.by_recovery(body, H[:, :3], grid.at, EVERY, banded[:, :, :3])
        total += found.sum(-1)
    return total


def _tube(linear: Response, plan: simulate.Plan, held: Sequence[Body], grid: Grid) -> tuple[Tube | None, str]:
    if not all(np.isfinite(body.beta).all() for body in held):
        return None, "the data contradict the stated norm and label errors"
    scales = [np.asarray(body.model.hyper.lengthscales).min(0) for body in held]
    gains = np.array(
        [
            np.linalg.norm(
                reach.impulse(linear, np.pad(phi, ((0, 0), (0, linear.B.shape[1]))), grid.step, len(grid.path)), axis=1
            ).sum(0)
            for phi in tube.features(linear, plan.pilot.team, scales)
        ]
    )
    rho = np.concatenate([reach.greatest(body).max(0) for body in held])
    rough = np.concatenate([tube.roughness(body) for body in held])
    try:
        return tube.fixed_point(gains, rho, rough, linear.bodies), ""
    except ValueError as error:
        return None, str(error)


# -- radii -----------------------------------------------------------------------------------------------------------


def _corner(center: Matrix, reached: Matrix) -> Matrix:
    """The farthest `center + e` at each time, for `-reached[1] <= e <= reached[0]` componentwise; (times, 3)."""
    up, down = center + reached[0], center - reached[1]
    return np.where(np.abs(up) >= np.abs(down), up, down)


def _radii(
    plan: simulate.Plan, rows: simulate.Row, off: Matrix, grid: Grid, reached: Matrix, extra: Matrix
) -> dict[str, float]:
    """Ultimate radii of the four errors: translation from its functionals, rotation through `rotation.ultimate`."""
    if not np.isfinite(reached).all() or not np.isfinite(extra).all():
        return dict.fromkeys(ERRORS, float("inf"))
    reached = reached + extra
    at = grid.path[grid.at]
    gains = plan.pilot.leader.gains
    try:
        attitude = rotation.ultimate(float(gains.k_R), float(gains.k_omega), _turning(off, reached))
        e_R, e_omega = attitude.e_R, attitude.e_omega
    except ValueError:
        e_R = e_omega = float("inf")
    return {
        "e_p": float(np.linalg.norm(_corner(_np(rows.e_p)[at], reached[:, :, :3]), axis=1).max()),
        "e_v": float(np.linalg.norm(_corner(_np(rows.e_v)[at], reached[:, :, 3:6]), axis=1).max()),
        "e_R": e_R,
        "e_omega": e_omega,
    }


def _greatest(rows: simulate.Row, window: slice, less: simulate.Row | None = None) -> dict[str, float]:
    """The four errors at their greatest; less those of another flight."""
    each = {name: getattr(rows, name) - (getattr(less, name) if less else 0.0) for name in ERRORS}
    return {name: float(np.linalg.norm(e[window], axis=1).max()) for name, e in each.items()}


def _mismatch(plan: simulate.Plan, rows: simulate.Row, window: slice) -> Matrix:
    """`d` of the attitude's error equation in flight: `alpha - alpha_cmd`, rad/s^2, (ticks, 3)."""

    def commanded(t: Any, p: Any, v: Any, R: Any, omega: Any) -> Any:
        q = PayloadState(p=p, v=v, R=R, omega=omega)
        return control.command(plan.pilot.leader.gains, q, jnp.zeros(3), plan.pilot.path.at(t)).alpha

    args = (jnp.asarray(getattr(rows, name)[window]) for name in ("t", "p", "v", "R_L", "omega_L"))
    return np.asarray(rows.a_L)[window, 3:] - np.asarray(jax.jit(jax.vmap(commanded))(*args))


def _turning(off: Matrix, reached: Matrix) -> float:
    """The greatest `|d|` of the attitude's error equation: the twin's, and what f~ adds to it; rad/s^2."""
    return float(np.linalg.norm(off, axis=1).max() + np.linalg.norm(reached[:, :, 6:].max(0), axis=1).max())


# -- where the slack is ----------------------------------------------------------------------------------------------


def vartheta(plan: simulate.Plan, flight: simulate.Flight, of_twin: simulate.Flight) -> Matrix:
    """`sup |delta_W|` of the twin, N and N m: what is left of the mismatch without unknown forces."""
    window = path_of(plan, flight, STEP).window
    return np.linalg.norm(of_twin.rows.delta_W[window].reshape(-1, 2, 3), axis=2).max(0)


def slack(
    plan: simulate.Plan,
    flight: simulate.Flight,
    of_twin: simulate.Flight,
    linear: Response,
    layer: Interface,
    found: Certificate,
) -> dict[str, float]:
    """Radii of e_p, m, under ever better reasoning; each ratio of neighbours is the slack of one cause."""
    grid = path_of(plan, flight, STEP)
    H = reach.impulse(linear, linear.output("e_p"), grid.step, len(grid.path))
    gains, floor = plan.pilot.leader.gains, found.floor["e_p"]
    unit = translation.ultimate(np.asarray(gains.K_p), np.asarray(gains.K_v), 1.0).e_p.bound

    def pointwise(bound: str) -> Matrix:
        along = bodies(plan, flight, of_twin.rows, grid.path, bound)
        return np.concatenate([reach.greatest(body).max(0) for body in along])

    def added(rho: Matrix) -> float:
        """`(rho_L + sum kappa rho) / m_L`, the paper's way, through the translation's own gain."""
        sizes = [float(np.linalg.norm(rho[columns])) for columns in linear.bodies]
        force = np.linalg.norm(rho[:3]) + layer.kappa[0] @ sizes
        return float(unit * force / float(plan.pilot.team.payload.mass) + floor)

    rho = pointwise("energy")
    together = float(np.linalg.norm(np.abs(H).sum(0) @ rho)) if np.isfinite(rho).all() else float("inf")
    out = {
        "the paper's beta, mismatch and error added": added(pointwise("srinivas")),
        "energy bound, mismatch and error added": added(rho),
        "energy bound, one loop for both": together + floor,
    }
    for name in ("energy", "recovery"):
        for key, where in (("tube", "any run"), ("run", "this run")):
            if name in found.radii:
                out[f"{name}, one functional, {where}"] = getattr(found.radii[name], key)["e_p"]
    return out | {"observed": found.observed["e_p"], "floor: nothing unknown": floor}
