"""Certification of a scenario: run under C3, nominal trajectory, certificate, adversarial test and results file."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from colift.certification import (
    adversary,
    agent_iss,
    assumptions,
    certificate,
    conservatism,
    linearized_trajectory,
    nominal_run,
)
from colift.closed_loop import linearization
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.runtime import atomic_write, run_directory
from colift.runtime.run_directory import RunDirectory
from colift.scenario import Scenario, experiment, initial_states
from colift.workflows import study


@dataclasses.dataclass(frozen=True)
class CertificationResult:
    """Simulated run under C3 with its certificate.

    Attributes:
        experiment: Experiment of the run.
        flight: Simulated run.
        nominal_linearization: Closed loop linearized along the nominal trajectory.
        equilibrium_linearization: Closed loop linearized at rest.
        certificate: Certificate of the run.
    """

    experiment: Experiment
    flight: FlightResult
    nominal_linearization: linearized_trajectory.LinearizedTrajectory
    equilibrium_linearization: linearization.LinearizedLoop
    certificate: certificate.Certificate


def certify(
    settings: Scenario,
    linear: linearization.LinearizedLoop | None = None,
    names: Sequence[str] = certificate.BOUNDS,
    progress: Callable[[str], None] = lambda _message: None,
) -> CertificationResult:
    """Simulate a scenario under C3 with its nominal trajectory, and compute its certificate.

    A ScenarioError is raised as by `make_experiment`. A ValueError is also raised if a part is not supported or a run
    ends early.

    Args:
        settings: Scenario.
        linear: Closed loop linearized at rest, if known from another seed with the same team and gains.
        names: Bounds of the prediction error.
        progress: Function called with a description of each step.

    Returns:
        The run with its certificate.

    Raises:
        ValueError: If the closed loop is unstable at rest.

    Example:
        >>> result = certify(scenario.load_scenario("certified"))
        >>> result.certificate.radii["energy"].a_priori["e_p"]
    """
    c3_experiment = experiment.make_experiment(settings, "C3")
    nominal_run.check_supported(c3_experiment)
    if linear is None:
        progress("linearization of the closed loop at rest")
        linear = linearization.linearize(
            c3_experiment.controller, initial_states.equilibrium_state(settings, c3_experiment.controller.team)
        )
    growth_rate = float(np.linalg.eigvals(linear.A).real.max())
    if growth_rate >= 0:
        raise ValueError(
            f"no certificate: the closed loop is unstable at rest: a mode has the rate {growth_rate:+.3g} 1/s"
        )
    progress("simulation")
    flight = run_experiment(c3_experiment)
    progress("nominal trajectory and linearization of the closed loop along it")
    loop = nominal_run.nominal_trajectory(c3_experiment, flight)
    found = certificate.certify(c3_experiment, flight, loop, names, progress)
    return CertificationResult(
        experiment=c3_experiment,
        flight=flight,
        nominal_linearization=loop,
        equilibrium_linearization=linear,
        certificate=found,
    )


def run_adversarial_test(
    result: CertificationResult, rounds: int = 3, progress: Callable[[str], None] = lambda _message: None
) -> CertificationResult:
    """Recompute the certificate for the run under the worst residuals that norm and data allow.

    The first residual maximizes e_p at the time and in the direction of its largest bound. In each further round it
    maximizes e_p where the previous run was largest, along the path of this run. The run with the largest e_p is used.
    A failure after the first round ends the search.

    Args:
        result: Run with its certificate.
        rounds: Maximum number of rounds.
        progress: Function called with a description of each step.

    Returns:
        The worst run with its certificate.

    Raises:
        ValueError: If the first round fails.
    """
    found, largest, worst = result.certificate, -np.inf, result.flight.records
    time, direction, records = found.worst_time, found.worst_direction, worst
    for k in range(rounds):
        progress(f"adversarial test, round {k + 1}")
        e_p = adversary.error_functional(result.nominal_linearization, "e_p", time, direction)
        try:
            residual = adversary.worst_case_residual(
                result.experiment, result.flight, result.nominal_linearization.nodes, records, e_p
            )
            records, _ = linearized_trajectory.simulate_nominal(
                nominal_run.nominal_experiment(result.experiment, residual), result.nominal_linearization.model_schedule
            )
        except (ValueError, RuntimeError) as error:
            if k:
                break
            raise ValueError(f"no adversarial test: {error}") from None
        time, direction, size = certificate.max_error(records, found.window)
        largest, worst = (size, records) if size > largest else (largest, worst)
    flight = dataclasses.replace(result.flight, records=worst)
    found = certificate.certify(
        result.experiment,
        flight,
        result.nominal_linearization,
        ("energy", "recovery"),
        a_priori_analysis=found.a_priori,
    )
    return dataclasses.replace(result, flight=flight, certificate=found)


def save_certificate(
    settings: Scenario,
    result: CertificationResult,
    adversarial: CertificationResult | None,
    out: RunDirectory,
    progress: Callable[[str], None] = lambda _message: None,
) -> dict[str, Any]:
    """Write `certificate.json` and figure 6, and remove an earlier certificate and the study of another run.

    Bounds that do not exist are null. `assumed` lists the assumptions of a bound that are not shown, and `status` is
    their summary. `exceeded` lists the observed errors above a bound, first of the run, then of the adversarial test.
    An OSError is raised if the directory is not writable.

    Args:
        settings: Scenario.
        result: Run with its certificate.
        adversarial: Result of the adversarial test, if any.
        out: Directory of the results.
        progress: Function called with a description of each step.

    Returns:
        Content of the file.
    """
    from colift.visualization import certificate_figures

    found = result.certificate
    progress("input-to-state stability of the agents")
    layer = agent_iss.agent_iss_constants(
        result.equilibrium_linearization,
        conservatism.nominal_mismatch(result.experiment, result.flight, result.nominal_linearization),
    )
    slack = conservatism.conservatism_breakdown(
        result.experiment, result.flight, result.nominal_linearization, layer, found
    )
    summary = _summarize(settings, result, adversarial, out.run_id, layer, slack)
    run_directory.remove_stale_files(out, study.CERTIFICATE_FILES, study.STUDY_FILES)
    certificate_figures.plot_certificate(found, slack, out.path, out.run_id)
    return atomic_write.write_json_atomic(summary, out.path / "certificate.json")


def _summarize(
    settings: Scenario,
    result: CertificationResult,
    adversarial: CertificationResult | None,
    run_id: str,
    layer: agent_iss.AgentIss,
    slack: dict[str, float],
) -> dict[str, Any]:
    """Collect the content of `certificate.json`."""
    found = result.certificate
    return {
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "settings": settings.digest,
        "run": run_id,
        "window_s": list(found.window),
        "confidence": settings.certificate.confidence,
        "exceeded": _exceeded(found) + (_exceeded(adversarial.certificate, "adversary") if adversarial else []),
        "observed": dict(found.observed),
        "floor": dict(found.nominal_error),
        "unknown": dict(found.disturbance_response),
        "beyond_first_order": dict(found.linearization_error),
        "noise": dict(found.noise),
        "components_left": {of: span.num_outside(found.errors) for of, span in found.intervals.items()},
        "radii": _summarize_radii(found),
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
        if adversarial is None
        else {
            "observed": dict(adversarial.certificate.observed),
            "radius": dict(_best(adversarial.certificate).a_posteriori),
            "radius_over_adversary": _best(adversarial.certificate).a_posteriori["e_p"]
            / adversarial.certificate.observed["e_p"],
        },
    }


def _summarize_radii(found: certificate.Certificate) -> dict[str, Any]:
    """Collect the ultimate bounds with their ratio to the observed errors and their assumptions."""
    kinds = lambda bounds: {"run": bounds.a_posteriori, "tube": bounds.a_priori}  # noqa: E731
    return {
        name: {
            **{kind: dict(radii) for kind, radii in kinds(bounds).items()},
            "tightness": {
                kind: {error: radius / found.observed[error] for error, radius in radii.items()}
                for kind, radii in kinds(bounds).items()
            },
            "assumed": list(bounds.assumptions),
            "status": assumptions.status_label(bounds.assumptions),
        }
        for name, bounds in found.radii.items()
    }


def _exceeded(found: certificate.Certificate, flight: str = "this") -> list[dict[str, Any]]:
    """Return the violations of a certificate with the name of the run."""
    return [{"flight": flight, **dataclasses.asdict(each)} for each in found.exceeded]


def _best(found: certificate.Certificate) -> certificate.UltimateBounds:
    """Return the ultimate bounds of optimal recovery, or of the energy bound."""
    return found.radii.get("recovery", found.radii["energy"])
