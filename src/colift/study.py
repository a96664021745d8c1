"""The paper's study: the same flight under C1, C2, C3 and, where asked, under rivals of learning."""

from __future__ import annotations

import dataclasses
import json
import platform
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from colift import analyse, balance, disk, disturbance, fly, folder, gp, learn, log, modes, response, school, simulate
from colift.certify import adversary, assumed, certificate, interface
from colift.control import Command
from colift.folder import Folder
from colift.model import Residual, State, Team, Wrench, no_force
from colift.pytree import pytree
from colift.scenario import (
    ScenarioError,
    Settings,
    assumptions,
    disturbances,
    draws,
    limits,
    pilots,
    priors,
    roster,
    starts,
    worlds,
)
from colift.world import Simulated

Scalar = Float[Array, ""]

CASES = {
    "C1": "no learning",
    "C2": "payload learning",
    "C3": "payload and agent learning",
}
BEYOND = {"C4": "C3 that goes on learning, and reacts"}
BASELINES = {
    "I": "C1 with integral action",
    "DOB": "C1 with a wrench observer",
    "P": "parametric identification only",
    "O": "residuals known exactly",
    "F": "filtered labels, no memory",
    "R": "regression on a stated basis",
    "H": "C3 and filtered labels",
}
ALL = CASES | BEYOND | BASELINES
FLOWN = (  # every file that a study may leave, and what `colift view`, `report` and `export` make of them
    *(f"{case}.{kind}" for case in ALL for kind in ("nc", "csv", "mcap")),
    *(
        "figure_[0-57]_*.pdf",
        "figure_[0-57]_*.png",
        "lengthscales_*.csv",
        "lengthscales_*.md",
        "summary.json",
        "view.html",
        "report.html",
    ),
)
CERTIFIED = ("certificate.json", "figure_6_certificate.pdf", "figure_6_certificate.png")


def plan(settings: Settings, case: str) -> simulate.Plan:
    """One case of a scenario, ready to fly; raises as `plans` does."""
    return plans(settings, (case,))[case]


def plans(settings: Settings, cases: Sequence[str]) -> dict[str, simulate.Plan]:
    """Cases of a scenario, ready to fly from the same start under the same disturbances and noise.

    Raises ScenarioError for a grasp, an allocation or a start that cannot be, for a team that cannot hover and for O
    where a law remembers; KeyError for an unknown case.
    """
    for case in cases:
        if case not in ALL:
            raise KeyError(f"case {case!r}: one of {', '.join(ALL)}")
    truth, nominal = roster.team(settings)
    given, z = settings.learning, starts.start(settings, truth)
    drawn, error, sources = draws.drawn(settings, truth, z), no_force(truth), disturbances.disturbances(settings)
    if drawn is not None:
        function, deviation = drawn
        sources = dataclasses.replace(sources, functions=(learn.Function(oracle=function),))
        error = jax.tree.map(lambda f: given.rig_error * f, deviation)
    pilot = pilots.pilot(settings, nominal)
    limits.hover(settings, truth, pilot, sources)
    c1 = simulate.Plan(
        world=worlds.world(settings, truth, z, sources, error),
        pilot=pilot,
        agents=roster.agent_names(settings),
        limits=limits.bounds(settings, truth, z),
        dt=1 / settings.control_Hz,
        z=z,
        duration=settings.duration_s,
        updates=(),
        training=priors.training(settings, nominal),
        identify=None,
        stated=assumptions.stated(settings, nominal, error),
        seed=settings.seed,
        latency=None if given.fit_latency == "measured" else given.fit_latency,
    )
    return {case: _as(case, c1, settings) for case in cases}


def _as(case: str, c1: simulate.Plan, settings: Settings) -> simulate.Plan:
    """C1 with what another case has in its place or in addition."""
    rival, given = settings.baselines, settings.learning
    learns, agents = case in ("C2", "C3", "P", "R", "H", "C4"), case in ("C3", "R", "H", "C4")
    pilot = c1.pilot
    recorder = dataclasses.replace(pilot.recorder, payload=jnp.asarray(learns), agents=jnp.asarray(agents))
    pilot = dataclasses.replace(pilot, recorder=recorder)
    match case:
        case "I":
            K_i, k_i = jnp.asarray(rival.K_i), jnp.asarray(rival.k_i)
            pilot = dataclasses.replace(pilot, leader=fly.Integral(leader=pilot.leader, K_i=K_i, k_i=k_i))
        case "DOB":
            observer = fly.Observed(predictor=pilot.predictor, bandwidth=jnp.asarray(rival.observer_Hz))
            pilot = dataclasses.replace(pilot, predictor=observer)
        case "O":
            if remembering := disturbance.remembering(c1.world.sources):
                raise ScenarioError(
                    f"{settings.name}: case O knows residuals as functions of state and time; "
                    f"these laws remember what was before: {', '.join(remembering)}"
                )
            pilot = pilots.ahead(settings, pilot)
            truly = Truly(world=c1.world, nominal=pilot.team)
            pilot = dataclasses.replace(pilot, predictor=fly.Known(function=truly))
        case "R":
            pilot = pilots.ahead(settings, pilot)
            nothing = pilot.recorder.begin(pilot.team, pilot.oracle)
            pilot = dataclasses.replace(pilot, oracle=learn.regress(pilot.oracle, nothing, rival.ridge))
        case "F" | "H" | "C4":
            pilot = pilots.listening(settings, pilots.ahead(settings, pilot), held=case != "C4")
    prior = np.array([rival.mass_kg, *[rival.first_moment_kgm] * 3, *[rival.inertia_kgm2] * 6])
    noise = np.array([given.payload.force_noise_N] * 3 + [given.payload.moment_noise_Nm] * 3)
    parameters = school.Identify(noise=noise, prior=prior)
    made = dataclasses.replace(
        c1,
        pilot=pilot,
        updates=given.update_times_s if learns else (),
        identify={"P": parameters, "R": school.Regress(ridge=rival.ridge)}.get(case),
    )
    return _going_on(made, settings, parameters) if case == "C4" else made


def _going_on(plan: simulate.Plan, settings: Settings, payload: school.Identify) -> simulate.Plan:
    """The plan with learning that does not end: the newest samples, renewed every so often, what is wrong forgotten."""
    given = settings.innovation
    first = settings.learning.update_times_s[0]
    times = np.arange(first, settings.duration_s, given.renew_s)[1:]
    recorder = dataclasses.replace(plan.pilot.recorder, end=jnp.asarray(np.inf), policy=gp.first_in_first_out)
    return dataclasses.replace(
        plan,
        pilot=dataclasses.replace(plan.pilot, recorder=recorder),
        renewals=school.Renewals(
            times=tuple(times.tolist()), surprise=given.surprise, enough=given.enough, payload=payload
        ),
    )


@pytree
class Truly:
    """The unknown forces of a world as a function: its sources, which remember nothing, and its payload's mass."""

    world: Simulated
    nominal: Team

    def __call__(self, z: State, to: Command, t: Scalar) -> Residual:
        """What the nominal equations leave over at the state z, for a payload that accelerates so, at time t, s."""
        f = self.world.unknown(z, t, disturbance.begin(self.world.sources, self.world.team))
        g = self.nominal.gravity
        W, N = (
            balance.payload(team.payload, to.a - g, to.alpha, z.payload.omega)
            for team in (self.world.at(t), self.nominal)
        )
        W = Wrench(F=f.payload.F + N.F - W.F, tau=f.payload.tau + N.tau - W.tau)
        return dataclasses.replace(f, payload=W)


@dataclasses.dataclass(frozen=True)
class Outlook:
    """What is known of a scenario before it is flown."""

    modes: modes.Modes | None  # of the first case, at rest; None where it finds no rest
    hover: Mapping[str, float]  # N, thrust that each agent needs to hover on the reference
    warnings: tuple[str, ...]  # sentences

    @property
    def summary(self) -> dict[str, Any]:
        """As `summary.json` has it."""
        found = self.modes
        mode = None if found is None else {"stable": found.stable, "says": found.slowest(), "rad_s": list(found.rate)}
        return {"slowest_mode": mode, "hover_thrust_N": dict(self.hover), "warnings": list(self.warnings)}


def outlook(settings: Settings, ready: Mapping[str, simulate.Plan]) -> Outlook:
    """How the loop of the first plan behaves at rest, sampled as it flies, and how much thrust hovering leaves."""
    first, warnings, found = next(iter(ready.values())), [], None
    try:
        found = modes.at_rest(first, starts.at_rest(settings, first.world.team))
        if not found.stable:
            warnings.append(f"unstable at rest on the reference: slowest mode {found.slowest()}")
    except ValueError as error:
        warnings.append(str(error))
    names, truth = roster.agent_names(settings), first.world.team
    hover = limits.hover(settings, truth, first.pilot, first.world.sources)
    have = np.concatenate([group.thrust_max for group in truth.groups])
    margin = settings.limits.thrust_margin
    for name, need, most in zip(names, hover, have, strict=True):
        if most - need < margin * most:
            warnings.append(
                f"hovering takes {need:.4g} N of the {most:.4g} N of {name}; "
                f"what is left, {1 - need / most:.1%}, is below limits.thrust_margin = {margin:g}"
            )
    return Outlook(modes=found, hover=dict(zip(names, hover.tolist(), strict=True)), warnings=tuple(warnings))


@dataclasses.dataclass(frozen=True)
class Certified:
    """A flight under C3 with its certificate, and what explains it."""

    plan: simulate.Plan
    flight: simulate.Flight
    twin: simulate.Flight
    linear: response.Response
    certificate: certificate.Certificate


def certify(
    settings: Settings,
    linear: response.Response | None = None,
    names: Sequence[str] = certificate.BOUNDS,
    progress: Callable[[str], None] = lambda _what: None,
) -> Certified:
    """Fly a scenario under C3 and its twin, and bound the flight's errors under some bounds of the prediction error.

    linear: the response of this team and these gains, where it is known from another seed.
    Raises ScenarioError as `plans` does, ValueError where there is no certificate.
    """
    ready = plan(settings, "C3")
    certificate.refuse(ready)
    if linear is None:
        progress("the loop's response")
        linear = response.linearize(ready.pilot, starts.at_rest(settings, ready.pilot.team))
    progress("flight")
    flight = simulate.fly_plan(ready)
    progress("its twin, whose world obeys the learned means")
    twin = simulate.fly_plan(certificate.twin(ready, flight.oracle))
    found = certificate.certify(ready, flight, twin, linear, names, progress)
    return Certified(plan=ready, flight=flight, twin=twin, linear=linear, certificate=found)


def challenge(made: Certified, rounds: int = 2, progress: Callable[[str], None] = lambda _what: None) -> Certified:
    """The certificate against the worst unknown forces that norm and data allow, recomputed on the run they produce.

    Each round makes them worst along the path of the round before. Raises as `certify`.
    """
    current = made
    for k in range(rounds):
        progress(f"adversary, round {k + 1}")
        unknown = adversary.adversary(made.plan, made.flight, made.linear, current.certificate, current.flight.rows)
        flown = simulate.fly_plan(certificate.under(made.plan, made.flight.oracle, unknown))
        flight = dataclasses.replace(made.flight, rows=flown.rows, stopped=flown.stopped)
        found = certificate.certify(made.plan, flight, made.twin, made.linear, ("energy", "recovery"))
        current = dataclasses.replace(made, flight=flight, certificate=found)
    return current


def save_certificate(
    settings: Settings,
    made: Certified,
    against: Certified | None,
    out: Folder,
    progress: Callable[[str], None] = lambda _what: None,
) -> dict[str, Any]:
    """Write `certificate.json` and figure 6; return what the file holds. Radii that do not exist are null.

    `assumed` of a bound names what its radii rest on and is not shown (`certify.assumed`), `status` is the word for
    them. `exceeded` lists the observed errors above a radius: of this flight, then of the adversary's.
    Replaces an earlier certificate, and the study of another run. Raises OSError where `out` cannot be written.
    """
    from colift import tightness

    found = made.certificate
    progress("the agents' interface")
    floor = certificate.vartheta(made.plan, made.flight, made.twin)
    layer = interface.interface(made.linear, floor)
    slack = certificate.slack(made.plan, made.flight, made.twin, made.linear, layer, found)
    summary: dict[str, Any] = {
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "settings": settings.digest,
        "run": out.run,
        "window_s": list(found.window),
        "confidence": settings.certificate.confidence,
        "exceeded": _exceeded(found) + (_exceeded(against.certificate, "adversary") if against else []),
        "observed": dict(found.observed),
        "floor": dict(found.floor),
        "unknown": dict(found.unknown),
        "transient": found.transient,
        "radii": {
            name: {
                "run": dict(radii.run),
                "tube": dict(radii.tube),
                "tightness": {
                    where: {error: radius / found.observed[error] for error, radius in getattr(radii, where).items()}
                    for where in ("run", "tube")
                },
                "assumed": list(radii.assumed),
                "status": assumed.word(radii.assumed),
            }
            for name, radii in found.radii.items()
        },
        "left_out": dict(found.left_out),
        "no_tube": found.no_tube,
        "tube": None
        if found.tube is None
        else {"distance": found.tube.distance.tolist(), "contraction": found.tube.contraction},
        "interface": {
            "alpha_N_Nm": layer.alpha.tolist(),
            "gamma_1_s": layer.gamma,
            "kappa_N_Nm": layer.kappa.tolist(),
            "vartheta_N_Nm": layer.vartheta.tolist(),
            "static_N_Nm": layer.static.tolist(),
        },
        "slack_m": slack,
        "adversary": None
        if against is None
        else {
            "observed": dict(against.certificate.observed),
            "radius": dict(_best(against.certificate).run),
            "radius_over_adversary": _best(against.certificate).run["e_p"] / against.certificate.observed["e_p"],
        },
    }
    folder.clear(out, CERTIFIED, FLOWN)
    tightness.certificate(found, slack, out.path, out.run)
    write_json(summary, out.path / "certificate.json")
    return _finite(summary)


def _exceeded(found: certificate.Certificate, flight: str = "this") -> list[dict[str, Any]]:
    return [{"flight": flight, **dataclasses.asdict(each)} for each in found.exceeded]


def _best(found: certificate.Certificate) -> certificate.Radii:
    return found.radii.get("recovery", found.radii["energy"])


def claim(settings: Settings, out: Path) -> AbstractContextManager[Folder]:
    """The folder for the results of a scenario, this process's alone within the block; raises as `folder.claim`."""
    return folder.claim(out, folder.run_name(version("colift"), settings.digest), FLOWN + CERTIFIED)


def run(
    settings: Settings,
    out: Folder,
    ready: Mapping[str, simulate.Plan],
    ahead: Outlook,
    progress: Callable[[str, float], None] = lambda _case, _t: None,
) -> dict[str, Any]:
    """Fly the plans of `plans`, write a NetCDF file each, figures, tables and `summary.json`; return the summary.

    ahead: their `outlook`, which the summary repeats. Replaces an earlier study, and the certificate of another run,
    before the first flight. Raises OSError where `out` cannot be written.
    """
    from colift import lengthscales, view  # matplotlib takes a second to import, which the flights need not wait for

    folder.clear(out, FLOWN, CERTIFIED)
    summary: dict[str, Any] = {
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "settings": settings.digest,
        "plant": settings.plant.kind,
        "run": out.run,
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("jax", "jaxlib", "numpy")},
        **ahead.summary,
        "limits": _limits(settings, next(iter(ready.values()))),
        "cases": {},
    }
    data, fits = {}, {}
    first = next(iter(ready.values()))
    for case, flying in ready.items():
        flight = simulate.fly_plan(flying, lambda t, case=case: progress(case, t))
        began = time.perf_counter()
        data[case] = dataset(settings, case, flight, flying, out.run)
        log.save(data[case], out.path / f"{case}.nc")
        found = analyse.summary(flight, flying.world.team, flying.pilot.team)
        found["wall_s"] = {**flight.wall, "output": time.perf_counter() - began}
        summary["cases"][case] = found
        if flight.updates:
            fits[case] = flight.updates[-1].fits
    summary["bound"] = _rests_on(first)
    summary["residual"] = summary["cases"][list(ready)[-1]]["residual"]
    began = time.perf_counter()
    view.figures(data, ALL, out.path)
    for case, learned in fits.items():
        if learned:
            lengthscales.table(_lengthscales(settings, learned), out.path / f"lengthscales_{case}", out.run)
    summary["wall_s"] = {"figures": time.perf_counter() - began}
    write_json(summary, out.path / "summary.json")
    return _finite(summary)


def dataset(settings: Settings, case: str, flight: simulate.Flight, flown: simulate.Plan, run: str = "") -> xr.Dataset:
    """A flight as labelled signals, `ds.lam.sel(contact="front/left")`, with what identifies it; `log.save` writes it.

    run: the name of the run whose results it joins (`folder.run_name`), none for a flight in Python.
    """
    contacts = roster.contact_names(settings)
    joints, rests_on = roster.joint_names(settings), _rests_on(flown)
    attrs = {
        "scenario": settings.name,
        "case": case,
        "seed": settings.seed,
        "version": version("colift"),
        "settings": settings.digest,
        "scenario_json": settings.model_dump_json(exclude_none=True),  # a log is shown by the team that it is of
        "run": run,
        "complete": int(not flight.stopped),
        "stopped": flight.stopped,
        "update_times_s": [update.t for update in flight.updates],
        "update_points_payload": [update.n["payload"] for update in flight.updates],
        "update_points_agents": [update.n["agents"] for update in flight.updates],
        "world_changed": "; ".join(
            f"{update.t:g} s: {', '.join(_body_name(settings, body) for body in update.changed)}"
            for update in flight.updates
            if update.changed
        ),
        "T_end_s": settings.learning.end_s,
        **{f"limit_{name}": value for name, value in _limits(settings, flown).items() if value is not None},
        **{f"rho_{name}": value for name, value in rests_on.items()},
        "rho_assumed": ", ".join(rests_on["assumed"]),  # lists of words are not for every reader of NetCDF
    }
    return log.dataset(
        flight.rows,
        agents=flown.agents,
        joints=joints,
        contacts=contacts,
        attrs=attrs,
        sigma=flight.sigma,
    )


def _limits(settings: Settings, plan: simulate.Plan) -> dict[str, Any]:
    """The limits as stated, and what the share of the start's grip is for every agent."""
    return settings.limits.model_dump() | {"grip_1pkg": np.asarray(plan.limits.grip).tolist()}


def _rests_on(flown: simulate.Plan) -> dict[str, Any]:
    """What the radii along the run rest on; `assumed` names what of it is not shown."""
    stated = flown.stated
    return {
        "bound": stated.bound,
        "confidence": stated.confidence,
        "norm": stated.norm,
        "label_error_payload": stated.payload.tolist(),
        "label_error_agents": np.concatenate([eps.ravel() for eps in stated.agents]).tolist(),
        "assumed": list(assumed.of_radii(flown)),
    }


def _body_name(settings: Settings, body: learn.Body) -> str:
    return body if isinstance(body, str) else roster.groups(settings)[body[0]][body[1]].name


def _lengthscales(settings: Settings, fits: learn.Fits) -> dict[str, Any]:
    """The last fits by body name, with the names of their features and outputs."""
    out, seen = {}, priors.features(settings)
    for body, fit in fits.items():
        if isinstance(body, str):
            name, features, joints = body, seen.payload_names(), []
        else:
            group, j = body
            agent = roster.groups(settings)[group][j]
            moved = settings.agent_types[agent.type].joints
            name, features, joints = agent.name, seen.agent_names(len(moved)), [m.name for m in moved]
        outputs = ["F_x", "F_y", "F_z", "tau_x", "tau_y", "tau_z", *(f"tau_{joint}" for joint in joints)]
        out[name] = (features, outputs, fit.lengthscales, fit.at_lower, fit.at_upper)
    return out


def write_json(value: Any, path: Path) -> None:
    """Write strict JSON, whole or not at all; what is not finite becomes null."""
    disk.write(path, (json.dumps(_finite(value), indent=2, allow_nan=False) + "\n").encode())


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
