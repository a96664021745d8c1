"""Certification of a scenario: run under C3, nominal trajectory, certificate, adversarial test and results file."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from colift.analysis import result_files
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
from colift.closed_loop.flight import Experiment, FlightResult, ModelInterval, run_experiment
from colift.runtime import atomic_write
from colift.runtime.run_directory import RunDirectory
from colift.scenario import Scenario, experiment, initial_states

UNITS = {"e_p": "m", "e_v": "m/s", "e_R": "1", "e_omega": "rad/s"}
"""Unit of each error in `certificate.json`."""


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
        >>> result.certificate.ultimate_bounds["energy"].a_priori["e_p"]
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
    schedule: list[ModelInterval] = []
    flight = run_experiment(c3_experiment, on_model=schedule.append)
    progress("nominal trajectory and linearization of the closed loop along it")
    loop = nominal_run.nominal_trajectory(c3_experiment, flight, schedule)
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
    """Write `certificate.json` and figure 6.

    Bounds that do not exist are null. `unproven_assumptions` lists the assumptions of a bound that are not shown, and
    `status` is their summary. `violations` lists the observed errors above a bound, first of the run, then of the
    adversarial test. Errors have the units in `units`. An OSError is raised if the directory is not writable.

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
    breakdown = conservatism.conservatism_breakdown(
        result.experiment, result.flight, result.nominal_linearization, layer, found
    )
    summary = _summarize(settings, result, adversarial, out.run_id, layer, breakdown)
    certificate_figures.plot_certificate(found, breakdown, out.path, out.run_id)
    return atomic_write.write_json_atomic(summary, out.path / "certificate.json")


def _summarize(
    settings: Scenario,
    result: CertificationResult,
    adversarial: CertificationResult | None,
    run_id: str,
    layer: agent_iss.AgentIss,
    breakdown: dict[str, float],
) -> dict[str, Any]:
    """Collect the content of `certificate.json`."""
    found = result.certificate
    return {
        "schema": result_files.SCHEMA,
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "settings_digest": settings.digest,
        "run": run_id,
        "window_s": list(found.window),
        "confidence": settings.certificate.confidence,
        "units": UNITS,
        "violations": _violations(found, "simulation")
        + (_violations(adversarial.certificate, "adversarial_test") if adversarial else []),
        "observed": dict(found.observed),
        "nominal_error": dict(found.nominal_error),
        "disturbance_response": dict(found.disturbance_response),
        "linearization_error": dict(found.linearization_error),
        "noise_response": dict(found.noise_response),
        "num_components_outside": {kind: each.num_outside(found.errors) for kind, each in found.intervals.items()},
        "ultimate_bounds": _summarize_bounds(found),
        "unavailable_bounds": dict(found.unavailable_bounds),
        "tube_failure": found.a_priori.tube_failure,
        "tube": None
        if found.a_priori.tube is None
        else {
            "residual_deviation": found.a_priori.tube.residual_deviation.max(0).tolist(),
            "contraction": found.a_priori.tube.contraction,
        },
        "agent_iss": {
            "alpha_N_Nm": layer.alpha.tolist(),
            "gamma_1ps": layer.gamma,
            "kappa": layer.kappa.tolist(),
            "vartheta_N_Nm": layer.vartheta.tolist(),
            "static_gain": layer.static.tolist(),
        },
        "conservatism_m": breakdown,
        "adversarial_test": None
        if adversarial is None
        else {
            "observed": dict(adversarial.certificate.observed),
            "a_posteriori": dict(_best(adversarial.certificate).a_posteriori),
            "bound_over_observed": _best(adversarial.certificate).a_posteriori["e_p"]
            / adversarial.certificate.observed["e_p"],
        },
    }


def _summarize_bounds(found: certificate.Certificate) -> dict[str, Any]:
    """Collect the ultimate bounds with their ratio to the observed errors and their assumptions."""
    kinds = lambda bounds: {"a_posteriori": bounds.a_posteriori, "a_priori": bounds.a_priori}  # noqa: E731
    return {
        name: {
            **{kind: dict(each) for kind, each in kinds(bounds).items()},
            "bound_over_observed": {
                kind: {error: bound / found.observed[error] for error, bound in each.items()}
                for kind, each in kinds(bounds).items()
            },
            "unproven_assumptions": list(bounds.assumptions),
            "status": assumptions.status_label(bounds.assumptions),
        }
        for name, bounds in found.ultimate_bounds.items()
    }


def _violations(found: certificate.Certificate, run: str) -> list[dict[str, Any]]:
    """Return the violations of a certificate with the name of the run."""
    return [{"run": run, **dataclasses.asdict(each)} for each in found.violations]


def _best(found: certificate.Certificate) -> certificate.UltimateBounds:
    """Return the ultimate bounds of optimal recovery, or of the energy bound."""
    return found.ultimate_bounds.get("recovery", found.ultimate_bounds["energy"])
