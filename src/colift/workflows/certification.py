"""A scenario certified: its flight under C3, the twin, the certificate, its challenge, and the file of it all."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from colift.certification import adversary, agent_iss, assumptions, certificate, linearized_trajectory
from colift.closed_loop import linearization
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.runtime import atomic_write, run_directory
from colift.runtime.run_directory import RunDirectory
from colift.scenario import Scenario, experiment, initial_states
from colift.workflows import study


@dataclasses.dataclass(frozen=True)
class CertificationResult:
    """A flight under C3 with its certificate, and what explains it."""

    plan: Experiment
    flight: FlightResult
    nominal_linearization: linearized_trajectory.LinearizedTrajectory  # along the twin
    equilibrium_linearization: linearization.LinearizedLoop  # around rest
    certificate: certificate.Certificate


def certify(
    settings: Scenario,
    linear: linearization.LinearizedLoop | None = None,
    names: Sequence[str] = certificate.BOUNDS,
    progress: Callable[[str], None] = lambda _what: None,
) -> CertificationResult:
    """Fly a scenario under C3 and its twin, and bound the flight's errors under some bounds of the prediction error.

    linear: the response of this team and these gains, where it is known from another seed.
    Raises ScenarioError as `study.plans` does, ValueError where there is no certificate.
    """
    ready = experiment.make_experiment(settings, "C3")
    certificate.check_supported(ready)
    if linear is None:
        progress("the loop's response")
        linear = linearization.linearize(
            ready.controller, initial_states.equilibrium_state(settings, ready.controller.team)
        )
    pace = float(np.linalg.eigvals(linear.A).real.max())
    if pace >= 0:
        raise ValueError(f"no certificate: the loop is unstable at rest, a mode has rate {pace:+.3g} 1/s")
    progress("flight")
    flight = run_experiment(ready)
    progress("its twin, whose world obeys the learned means, and the loop along it")
    loop = certificate.nominal_trajectory(ready, flight)
    found = certificate.certify(ready, flight, loop, names, progress)
    return CertificationResult(
        plan=ready, flight=flight, nominal_linearization=loop, equilibrium_linearization=linear, certificate=found
    )


def test_with_adversary(
    made: CertificationResult, rounds: int = 3, progress: Callable[[str], None] = lambda _what: None
) -> CertificationResult:
    """The certificate against the worst unknown forces that norm and data allow, recomputed on the run they produce.

    They are worst first where and towards where the span of e_p reaches farthest, which is a corner that no single
    unknown need reach; in each round after that where the run before was farthest, along its path. The run that was
    farthest counts, of those before one that fails. Raises as `certify`, ValueError where the first fails.
    """
    found, far, worst = made.certificate, -np.inf, made.flight.records
    when, direction, rows = found.worst_time, found.worst_direction, worst
    for k in range(rounds):
        progress(f"adversary, round {k + 1}")
        e_p = adversary.error_functional(made.nominal_linearization, "e_p", when, direction)
        try:
            unknown = adversary.worst_case_residual(made.plan, made.flight, made.nominal_linearization.nodes, rows, e_p)
            rows, _ = linearized_trajectory.simulate_nominal(
                certificate.nominal_experiment(made.plan, unknown), made.nominal_linearization.model_schedule
            )
        except (ValueError, RuntimeError) as error:
            if k:
                break
            raise ValueError(f"no adversary: {error}") from None
        when, direction, size = certificate.max_error(rows, found.window)
        far, worst = (size, rows) if size > far else (far, worst)
    flight = dataclasses.replace(made.flight, records=worst)
    found = certificate.certify(
        made.plan, flight, made.nominal_linearization, ("energy", "recovery"), before=found.a_priori
    )
    return dataclasses.replace(made, flight=flight, certificate=found)


def save_certificate(
    settings: Scenario,
    made: CertificationResult,
    against: CertificationResult | None,
    out: RunDirectory,
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
    layer = agent_iss.agent_iss_constants(
        made.equilibrium_linearization, certificate.nominal_mismatch(made.plan, made.flight, made.nominal_linearization)
    )
    slack = certificate.conservatism_breakdown(made.plan, made.flight, made.nominal_linearization, layer, found)
    summary: dict[str, Any] = {
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "settings": settings.digest,
        "run": out.run_id,
        "window_s": list(found.window),
        "confidence": settings.certificate.confidence,
        "exceeded": _exceeded(found) + (_exceeded(against.certificate, "adversary") if against else []),
        "observed": dict(found.observed),
        "floor": dict(found.nominal_error),
        "unknown": dict(found.disturbance_response),
        "beyond_first_order": dict(found.linearization_error),
        "noise": dict(found.noise),
        "components_left": {of: span.num_outside(found.errors) for of, span in found.intervals.items()},
        "radii": {
            name: {
                "run": dict(radii.a_posteriori),
                "tube": dict(radii.a_priori),
                "tightness": {
                    where: {error: radius / found.observed[error] for error, radius in getattr(radii, where).items()}
                    for where in ("run", "tube")
                },
                "assumed": list(radii.assumptions),
                "status": assumptions.status_label(radii.assumptions),
            }
            for name, radii in found.radii.items()
        },
        "left_out": dict(found.unavailable_bounds),
        "no_tube": found.a_priori.tube_failure,
        "tube": None
        if found.a_priori.tube is None
        else {
            "difference": found.a_priori.tube.residual_deviation.max(0).tolist(),
            "contraction": found.a_priori.tube.contraction,
        },
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
            "radius": dict(_best(against.certificate).a_posteriori),
            "radius_over_adversary": _best(against.certificate).a_posteriori["e_p"]
            / against.certificate.observed["e_p"],
        },
    }
    run_directory.remove_stale_files(out, study.CERTIFICATE_FILES, study.STUDY_FILES)
    certificate_figures.plot_certificate(found, slack, out.path, out.run_id)
    return atomic_write.write_json_atomic(summary, out.path / "certificate.json")


def _exceeded(found: certificate.Certificate, flight: str = "this") -> list[dict[str, Any]]:
    return [{"flight": flight, **dataclasses.asdict(each)} for each in found.exceeded]


def _best(found: certificate.Certificate) -> certificate.UltimateBounds:
    return found.radii.get("recovery", found.radii["energy"])
