"""A scenario certified: its flight under C3, the twin, the certificate, its challenge, and the file of it all."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from colift.certification import adversary, agent_iss, assumptions, certificate, linearized_trajectory
from colift.closed_loop import linearization
from colift.closed_loop.flight import Flight, Plan, fly_plan
from colift.runtime import atomic_write, run_directory
from colift.runtime.run_directory import Folder
from colift.scenario import Settings, experiment, initial_states
from colift.workflows import study


@dataclasses.dataclass(frozen=True)
class Certified:
    """A flight under C3 with its certificate, and what explains it."""

    plan: Plan
    flight: Flight
    loop: linearized_trajectory.Variation  # along the twin
    linear: linearization.Response  # around rest
    certificate: certificate.Certificate


def certify(
    settings: Settings,
    linear: linearization.Response | None = None,
    names: Sequence[str] = certificate.BOUNDS,
    progress: Callable[[str], None] = lambda _what: None,
) -> Certified:
    """Fly a scenario under C3 and its twin, and bound the flight's errors under some bounds of the prediction error.

    linear: the response of this team and these gains, where it is known from another seed.
    Raises ScenarioError as `study.plans` does, ValueError where there is no certificate.
    """
    ready = experiment.plan(settings, "C3")
    certificate.refuse(ready)
    if linear is None:
        progress("the loop's response")
        linear = linearization.linearize(ready.pilot, initial_states.at_rest(settings, ready.pilot.team))
    pace = float(np.linalg.eigvals(linear.A).real.max())
    if pace >= 0:
        raise ValueError(f"no certificate: the loop is unstable at rest, a mode has rate {pace:+.3g} 1/s")
    progress("flight")
    flight = fly_plan(ready)
    progress("its twin, whose world obeys the learned means, and the loop along it")
    loop = certificate.twin(ready, flight)
    found = certificate.certify(ready, flight, loop, names, progress)
    return Certified(plan=ready, flight=flight, loop=loop, linear=linear, certificate=found)


def challenge(made: Certified, rounds: int = 3, progress: Callable[[str], None] = lambda _what: None) -> Certified:
    """The certificate against the worst unknown forces that norm and data allow, recomputed on the run they produce.

    They are worst first where and towards where the span of e_p reaches farthest, which is a corner that no single
    unknown need reach; in each round after that where the run before was farthest, along its path. The run that was
    farthest counts, of those before one that fails. Raises as `certify`, ValueError where the first fails.
    """
    found, far, worst = made.certificate, -np.inf, made.flight.rows
    when, direction, rows = found.when, found.direction, worst
    for k in range(rounds):
        progress(f"adversary, round {k + 1}")
        e_p = adversary.functional(made.loop, "e_p", when, direction)
        try:
            unknown = adversary.adversary(made.plan, made.flight, made.loop.nodes, rows, e_p)
            rows, _ = linearized_trajectory.flown(certificate.under(made.plan, unknown), made.loop.schedule)
        except (ValueError, RuntimeError) as error:
            if k:
                break
            raise ValueError(f"no adversary: {error}") from None
        when, direction, size = certificate.farthest(rows, found.window)
        far, worst = (size, rows) if size > far else (far, worst)
    flight = dataclasses.replace(made.flight, rows=worst)
    found = certificate.certify(made.plan, flight, made.loop, ("energy", "recovery"), before=found.before)
    return dataclasses.replace(made, flight=flight, certificate=found)


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
    from colift.visualization import certificate_figures

    found = made.certificate
    progress("the agents' interface")
    layer = agent_iss.interface(made.linear, certificate.vartheta(made.plan, made.flight, made.loop))
    slack = certificate.slack(made.plan, made.flight, made.loop, layer, found)
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
        "beyond_first_order": dict(found.beyond),
        "noise": dict(found.noise),
        "components_left": {of: span.left(found.errors) for of, span in found.spans.items()},
        "radii": {
            name: {
                "run": dict(radii.run),
                "tube": dict(radii.tube),
                "tightness": {
                    where: {error: radius / found.observed[error] for error, radius in getattr(radii, where).items()}
                    for where in ("run", "tube")
                },
                "assumed": list(radii.assumed),
                "status": assumptions.word(radii.assumed),
            }
            for name, radii in found.radii.items()
        },
        "left_out": dict(found.left_out),
        "no_tube": found.before.no_tube,
        "tube": None
        if found.before.tube is None
        else {"difference": found.before.tube.difference.max(0).tolist(), "contraction": found.before.tube.contraction},
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
    run_directory.clear(out, study.CERTIFIED, study.FLOWN)
    certificate_figures.certificate(found, slack, out.path, out.run)
    return atomic_write.write_json(summary, out.path / "certificate.json")


def _exceeded(found: certificate.Certificate, flight: str = "this") -> list[dict[str, Any]]:
    return [{"flight": flight, **dataclasses.asdict(each)} for each in found.exceeded]


def _best(found: certificate.Certificate) -> certificate.Radii:
    return found.radii.get("recovery", found.radii["energy"])
