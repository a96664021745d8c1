"""Study of a scenario: simulation of all cases, and output of logs, figures, tables and summary."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from colift.analysis import contact_forces, joint_limits, learning_benefit, metrics, result_checks, result_files
from colift.analysis.feasibility import FeasibilityReport
from colift.certification import assumptions
from colift.closed_loop import log
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.models import grasp
from colift.onboard.learning import features, model_update
from colift.runtime import atomic_write, run_directory
from colift.runtime.run_directory import RunDirectory
from colift.scenario import Scenario, priors, team
from colift.scenario.cases import ALL_CASES
from colift.workflows import generalization

# output files of a study, and of `colift playback`, `report` and `export` for its logs
STUDY_FILES = (
    *(f"{case}.{kind}" for case in ALL_CASES for kind in ("nc", "csv", "mcap")),
    *(
        "figure_[0-5789]_*.pdf",
        "figure_[0-5789]_*.png",
        "lengthscales_*.csv",
        "lengthscales_*.md",
        run_directory.SUMMARY_FILE,
        "playback.html",
        "view.html",  # the name of playback.html before 0.2.0
        "report.html",
    ),
)
CERTIFICATE_FILES = (
    "certificate.json",
    "falsification.json",
    "figure_6_*.pdf",
    "figure_6_*.png",
)


# pages that show all cases of a study; a study with further cases removes them
PAGES = ("playback.html", "view.html", "report.html")


def open_run_directory(
    settings: Scenario, out: Path, replace: bool = False, keep_on_interrupt: bool = False
) -> AbstractContextManager[RunDirectory]:
    """Lock the directory for the results of a scenario; errors are raised as by `run_directory.stage_run_directory`.

    Args:
        settings: Scenario.
        out: Directory.
        replace: Whether to remove all earlier results.
        keep_on_interrupt: Whether the files are also valid results after a request to end.

    Returns:
        Context manager in which this process owns the directory.
    """
    return run_directory.stage_run_directory(
        out,
        run_directory.run_id(version("colift"), settings.digest),
        STUDY_FILES + CERTIFICATE_FILES,
        replace=replace,
        keep_on_interrupt=keep_on_interrupt,
    )


def run_study(
    settings: Scenario,
    out: RunDirectory,
    experiments: Mapping[str, Experiment],
    preview: FeasibilityReport,
    progress: Callable[[str, float], None] = lambda _case, _t: None,
    held_out: Mapping[str, Mapping[str, Experiment]] = MappingProxyType({}),
) -> dict[str, Any]:
    """Simulate the cases of a study, and write a NetCDF file for each, figures, tables and `summary.json`.

    Cases of the same run that the directory contains are kept, and are part of figures and summary. For held-out
    references, the final model of each case is used, and the summary contains the RMS position error over the second
    half. An OSError is raised if the directory is not writable.

    Args:
        settings: Scenario.
        out: Directory of the results.
        experiments: Experiments by case.
        preview: Feasibility report of the experiments, which the summary repeats.
        progress: Function called with case and simulated time [s].
        held_out: Experiments on held-out references, by variant and case.

    Returns:
        Content of `summary.json`.
    """
    from colift.visualization import lengthscale_table, study_figures

    earlier, earlier_data = _read_earlier_study(out, experiments)
    summary = _summary_header(settings, out.run_id, experiments, preview)
    if held_out:
        summary["held_out"] = {}
    data, fits = {}, {}
    first = next(iter(experiments.values()))
    for case, experiment in experiments.items():
        records = out.path / f"{case}.rows"  # remains if the process is killed
        flight = run_experiment(experiment, lambda t, case=case: progress(case, t), record_path=records)
        start = time.perf_counter()
        data[case] = flight_dataset(settings, case, flight, experiment, out.run_id)
        log.save(data[case], out.path / f"{case}.nc")
        records.unlink(missing_ok=True)
        found = flight_metrics(settings, flight, experiment, data[case])
        found["wall_time_s"] = {**flight.wall_time, "output": time.perf_counter() - start}
        summary["cases"][case] = found
        if flight.updates:
            fits[case] = flight.updates[-1].fits
        for path, variants in held_out.items():
            title = f"{case}, {path}"
            frozen = generalization.freeze_model(variants[case], flight.model)
            held_out_flight = run_experiment(frozen, lambda t, title=title: progress(title, t))
            summary["held_out"].setdefault(case, {})[path] = _held_out_summary(held_out_flight)
    summary["error_bound_assumptions"] = _bound_assumptions(first)
    summary["residual"] = summary["cases"][list(experiments)[-1]]["residual"]
    _merge_summaries(summary, earlier)
    summary["comparison_warnings"] = [
        f"{case}: {text}" for case, text in learning_benefit.comparison_warnings(settings, summary["cases"])
    ]
    data = {case: (earlier_data | data)[case] for case in summary["cases"]}
    for page in PAGES:
        (out.path / page).unlink(missing_ok=True)
    start = time.perf_counter()
    study_figures.write_figures(data, ALL_CASES, out.path)
    for case, learned in fits.items():
        if learned:
            lengthscale_table.write_lengthscale_table(
                _lengthscales(settings, learned), out.path / f"lengthscales_{case}", out.run_id
            )
    summary["wall_time_s"] = {"figures": time.perf_counter() - start}
    return atomic_write.write_json_atomic(summary, out.path / run_directory.SUMMARY_FILE)


def flight_metrics(settings: Scenario, flight: FlightResult, experiment: Experiment, ds: xr.Dataset) -> dict[str, Any]:
    """Compute the metrics of a flight, with statistics of its contact forces and warnings about joint limits.

    Args:
        settings: Scenario.
        flight: Result of the flight.
        experiment: Experiment of the flight.
        ds: Log of the flight.

    Returns:
        Values by name, as in `summary.json`. The entry `contact_forces` is empty if the log has no contact forces.
    """
    found = metrics.summary(flight, experiment.world.team, experiment.controller.team)
    points = np.asarray(grasp.contact_points(experiment.world.team))
    has_forces = "lam" in ds and "lam_hat" in ds
    found["contact_forces"] = contact_forces.contact_force_statistics(ds, points) if has_forces else {}
    if "lam_std" in ds:
        found["contact_force_prior"] = contact_forces.prior_statistics(ds)
    signals = (np.asarray(getattr(flight.records, name)) for name in ("t", "r", "r_dot", "tau_r"))
    found["warnings"] += joint_limits.flight_violations(settings, *signals)
    return found


def _read_earlier_study(out: RunDirectory, repeated: Collection[str]) -> tuple[dict[str, Any], dict[str, xr.Dataset]]:
    """Return summary and logs of an earlier study of the same run, without the logs of repeated cases."""
    path = out.path / run_directory.SUMMARY_FILE
    if not os.path.lexists(path):
        return {}, {}
    shown = out.target / path.name
    try:
        earlier = result_files.load_summary(path)
        kept = [case for case in earlier["cases"] if case not in repeated]
        for case in kept:
            result_checks.refuse_incomplete_case(case, earlier["cases"][case])
        return earlier, {case: log.load(out.path / f"{case}.nc") for case in kept}
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = str(error).replace(str(out.path), str(out.target))
        raise OSError(f"{shown}: the earlier study is damaged ({reason}); remove it by --replace") from None


def _merge_summaries(summary: dict[str, Any], earlier: Mapping[str, Any]) -> None:
    """Add the cases of an earlier study of the same run to a summary."""
    for key in ("cases", "held_out"):
        merged = earlier.get(key, {}) | summary.get(key, {})
        if merged or key in summary:
            summary[key] = {case: merged[case] for case in ALL_CASES if case in merged}


def _summary_header(
    settings: Scenario, run_id: str, experiments: Mapping[str, Experiment], preview: FeasibilityReport
) -> dict[str, Any]:
    """Return the entries of the summary that are known before the first run."""
    return {
        "schema": result_files.SCHEMA,
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "settings_digest": settings.digest,
        "plant": settings.physics.kind,
        "run": run_id,
        "command": command_line(sys.argv),
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("jax", "jaxlib", "numpy")},
        **preview.summary,
        "termination_limits": _limits(settings, next(iter(experiments.values()))),
        "cases": {},
    }


def command_line(arguments: Sequence[str]) -> str:
    """Return the command of this process as it can be typed; `python -m colift` becomes `colift`.

    Args:
        arguments: Arguments of the process, with the path of the program first.
    """
    program = Path(arguments[0]).name
    return shlex.join(["colift" if program == "__main__.py" else program, *arguments[1:]])


def _held_out_summary(flight: FlightResult) -> dict[str, Any]:
    """Return the RMS position error [m] over the second half of a run, None if it stopped early, and the reason."""
    error = None if flight.termination_reason else metrics.rms_norm(metrics.second_half(flight.records).e_p)
    return {"e_p_rms_m": error, "termination_reason": flight.termination_reason}


def flight_dataset(
    settings: Scenario, case: str, flight: FlightResult, experiment: Experiment, run: str = ""
) -> xr.Dataset:
    """Convert a run to labeled signals with identifying attributes, e.g. `ds.lam.sel(contact="front/left")`.

    Args:
        settings: Scenario.
        case: Identifier of the case.
        flight: Simulated run.
        experiment: Experiment of the run.
        run: Identifier of the results directory's run; empty outside of a study.

    Returns:
        Data set for `log.save`.
    """
    contacts = team.contact_names(settings)
    joints, stated = team.joint_names(settings), _bound_assumptions(experiment)
    attrs = {
        "scenario": settings.name,
        "case": case,
        "seed": settings.seed,
        "version": version("colift"),
        "settings_digest": settings.digest,
        "scenario_json": settings.model_dump_json(exclude_none=True),  # defines the team for playback
        "run": run,
        "complete": int(not flight.termination_reason),
        "termination_reason": flight.termination_reason,
        "update_times_s": [update.t for update in flight.updates],
        "update_activation_s": [update.activation_time for update in flight.updates],
        "learning_warnings": "; ".join(flight.learning_warnings),
        "num_samples_payload": [update.num_samples["payload"] for update in flight.updates],
        "num_samples_agents": [update.num_samples["agents"] for update in flight.updates],
        "change_points": _describe_events(settings, ((update.t, update.change_points) for update in flight.updates)),
        "T_end_s": settings.learning.end_s,
        **{f"limit_{name}": value for name, value in _limits(settings, experiment).items() if value is not None},
        **{f"rho_{name}": value for name, value in stated.items() if name != "unproven_assumptions"},
        "bound_assumptions": ", ".join(
            stated["unproven_assumptions"]
        ),  # some readers of NetCDF do not support lists of strings
    }
    return log.dataset(
        flight.records,
        team=experiment.world.team,
        agents=experiment.agent_names,
        joints=joints,
        contacts=contacts,
        attrs=attrs,
        sigma=flight.uncertainty,
    )


def _describe_events(settings: Scenario, events: Iterable[tuple[float, Sequence[features.BodyKey]]]) -> str:
    """Describe the times and bodies of model update events."""
    return "; ".join(
        f"{t:g} s: {', '.join(_body_name(settings, body) for body in bodies)}" for t, bodies in events if bodies
    )


def _limits(settings: Scenario, experiment: Experiment) -> dict[str, Any]:
    """Return the termination limits of the settings and the absolute grasp limit of each agent."""
    return settings.termination.model_dump() | {
        "min_delassus_singular_value_1pkg": np.asarray(experiment.termination_limits.min_delassus).tolist()
    }


def _bound_assumptions(experiment: Experiment) -> dict[str, Any]:
    """Return the assumptions of the error bounds along the run; `unproven_assumptions` lists those without proof."""
    stated = experiment.bound_assumptions
    return {
        "bound": stated.bound,
        "confidence": stated.confidence,
        "rkhs_norm": stated.rkhs_norm,
        "label_error_payload": stated.payload.tolist(),
        "label_error_agents": np.concatenate([eps.ravel() for eps in stated.agents]).tolist(),
        "unproven_assumptions": list(assumptions.logged_bound_assumptions(experiment)),
    }


def _body_name(settings: Scenario, body: features.BodyKey) -> str:
    """Return the name of a body."""
    return body if isinstance(body, str) else team.group_agents(settings)[body[0]][body[1]].name


def _lengthscales(settings: Scenario, fits: model_update.Fits) -> dict[str, Any]:
    """Return the last fits by body name, with the names of features and outputs."""
    out, feature_map = {}, priors.features(settings)
    for body, fit in fits.items():
        if isinstance(body, str):
            name, features, joints = body, feature_map.payload_names(), []
        else:
            group, j = body
            agent = team.group_agents(settings)[group][j]
            joint_settings = settings.agent_types[agent.type].joints
            name, features, joints = (
                agent.name,
                feature_map.agent_names(len(joint_settings)),
                [m.name for m in joint_settings],
            )
        outputs = ["F_x", "F_y", "F_z", "tau_x", "tau_y", "tau_z", *(f"tau_{joint}" for joint in joints)]
        out[name] = (features, outputs, fit.lengthscales, fit.at_lower, fit.at_upper)
    return out
