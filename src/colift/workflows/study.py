"""The flights of a study and what is written of them: logs, figures, tables, a summary."""

from __future__ import annotations

import platform
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from colift.analysis import metrics
from colift.analysis.feasibility import FeasibilityReport
from colift.certification import assumptions
from colift.closed_loop import log
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.onboard.learning import features, model_update
from colift.runtime import atomic_write, run_directory
from colift.runtime.run_directory import RunDirectory
from colift.scenario import Scenario, priors, team
from colift.scenario.experiment import ALL_CASES
from colift.workflows import generalization

STUDY_FILES = (  # every file that a study may leave, and what `colift playback`, `report` and `export` make of them
    *(f"{case}.{kind}" for case in ALL_CASES for kind in ("nc", "csv", "mcap")),
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
CERTIFICATE_FILES = (
    "certificate.json",
    "falsification.json",
    "figure_6_certificate.pdf",
    "figure_6_certificate.png",
)


def open_run_directory(settings: Scenario, out: Path) -> AbstractContextManager[RunDirectory]:
    """The folder for the results of a scenario, this process's alone within the block; raises as `folder.claim`."""
    return run_directory.lock_run_directory(
        out, run_directory.run_id(version("colift"), settings.digest), STUDY_FILES + CERTIFICATE_FILES
    )


def run_study(
    settings: Scenario,
    out: RunDirectory,
    ready: Mapping[str, Experiment],
    preview: FeasibilityReport,
    progress: Callable[[str, float], None] = lambda _case, _t: None,
    heldout: Mapping[str, Mapping[str, Experiment]] = MappingProxyType({}),
) -> dict[str, Any]:
    """Fly the plans of `study.plans`, write a NetCDF file each, figures, tables and `summary.json`; return the summary.

    ahead: their `outlook.outlook`, which the summary repeats. unseen: `heldout.plans`, flown with the map that each
    case ended with; of them the summary has the RMS position errors over the second half. Replaces an earlier study,
    and the certificate of another run, before the first flight. Raises OSError where `out` cannot be written.
    """
    from colift.visualization import lengthscale_table, study_figures

    run_directory.remove_stale_files(out, STUDY_FILES, CERTIFICATE_FILES)
    summary: dict[str, Any] = {
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "settings": settings.digest,
        "plant": settings.physics.kind,
        "run": out.run_id,
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("jax", "jaxlib", "numpy")},
        **preview.summary,
        "limits": _limits(settings, next(iter(ready.values()))),
        "cases": {},
        **({"heldout": {}} if heldout else {}),
    }
    data, fits = {}, {}
    first = next(iter(ready.values()))
    for case, flying in ready.items():
        flight = run_experiment(flying, lambda t, case=case: progress(case, t))
        began = time.perf_counter()
        data[case] = flight_dataset(settings, case, flight, flying, out.run_id)
        log.save(data[case], out.path / f"{case}.nc")
        found = metrics.summary(flight, flying.world.team, flying.controller.team)
        found["wall_s"] = {**flight.wall_time, "output": time.perf_counter() - began}
        summary["cases"][case] = found
        if flight.updates:
            fits[case] = flight.updates[-1].fits
        for path, experiments in heldout.items():
            told = f"{case}, {path}"
            there = generalization.freeze_model(experiments[case], flight.model)
            other = run_experiment(there, lambda t, told=told: progress(told, t))
            error = None if other.termination_reason else metrics.rms_norm(metrics.second_half(other.records).e_p)
            summary["heldout"].setdefault(case, {})[path] = {"e_p_rms_m": error, "stopped": other.termination_reason}
    summary["bound"] = _rests_on(first)
    summary["residual"] = summary["cases"][list(ready)[-1]]["residual"]
    began = time.perf_counter()
    study_figures.write_figures(data, ALL_CASES, out.path)
    for case, learned in fits.items():
        if learned:
            lengthscale_table.write_lengthscale_table(
                _lengthscales(settings, learned), out.path / f"lengthscales_{case}", out.run_id
            )
    summary["wall_s"] = {"figures": time.perf_counter() - began}
    return atomic_write.write_json_atomic(summary, out.path / "summary.json")


def flight_dataset(settings: Scenario, case: str, flight: FlightResult, flown: Experiment, run: str = "") -> xr.Dataset:
    """A flight as labelled signals, `ds.lam.sel(contact="front/left")`, with what identifies it; `log.save` writes it.

    run: the name of the run whose results it joins (`folder.run_name`), none for a flight in Python.
    """
    contacts = team.contact_names(settings)
    joints, rests_on = team.joint_names(settings), _rests_on(flown)
    attrs = {
        "scenario": settings.name,
        "case": case,
        "seed": settings.seed,
        "version": version("colift"),
        "settings": settings.digest,
        "scenario_json": settings.model_dump_json(exclude_none=True),  # a log is shown by the team that it is of
        "run": run,
        "complete": int(not flight.termination_reason),
        "stopped": flight.termination_reason,
        "update_times_s": [update.t for update in flight.updates],
        "update_ready_s": [update.activation_time for update in flight.updates],
        "unused": "; ".join(flight.learning_warnings),
        "update_points_payload": [update.num_samples["payload"] for update in flight.updates],
        "update_points_agents": [update.num_samples["agents"] for update in flight.updates],
        "world_changed": _when(settings, ((update.t, update.change_points) for update in flight.updates)),
        "fitted_anew": _when(settings, ((update.t, update.refitted) for update in flight.updates)),
        "T_end_s": settings.learning.end_s,
        **{f"limit_{name}": value for name, value in _limits(settings, flown).items() if value is not None},
        **{f"rho_{name}": value for name, value in rests_on.items()},
        "rho_assumed": ", ".join(rests_on["assumed"]),  # lists of words are not for every reader of NetCDF
    }
    return log.dataset(
        flight.records,
        agents=flown.agent_names,
        joints=joints,
        contacts=contacts,
        attrs=attrs,
        sigma=flight.uncertainty,
    )


def _when(settings: Scenario, of: Iterable[tuple[float, Sequence[features.BodyKey]]]) -> str:
    """At which times for whom, in words."""
    return "; ".join(f"{t:g} s: {', '.join(_body_name(settings, body) for body in who)}" for t, who in of if who)


def _limits(settings: Scenario, experiment: Experiment) -> dict[str, Any]:
    """The limits as stated, and what the share of the start's grip is for every agent."""
    return settings.termination.model_dump() | {
        "grip_1pkg": np.asarray(experiment.termination_limits.min_delassus).tolist()
    }


def _rests_on(flown: Experiment) -> dict[str, Any]:
    """What the radii along the run rest on; `assumed` names what of it is not shown."""
    stated = flown.bound_assumptions
    return {
        "bound": stated.bound,
        "confidence": stated.confidence,
        "norm": stated.rkhs_norm,
        "label_error_payload": stated.payload.tolist(),
        "label_error_agents": np.concatenate([eps.ravel() for eps in stated.agents]).tolist(),
        "assumed": list(assumptions.radius_assumptions(flown)),
    }


def _body_name(settings: Scenario, body: features.BodyKey) -> str:
    return body if isinstance(body, str) else team.group_agents(settings)[body[0]][body[1]].name


def _lengthscales(settings: Scenario, fits: model_update.Fits) -> dict[str, Any]:
    """The last fits by body name, with the names of their features and outputs."""
    out, seen = {}, priors.features(settings)
    for body, fit in fits.items():
        if isinstance(body, str):
            name, features, joints = body, seen.payload_names(), []
        else:
            group, j = body
            agent = team.group_agents(settings)[group][j]
            moved = settings.agent_types[agent.type].joints
            name, features, joints = agent.name, seen.agent_names(len(moved)), [m.name for m in moved]
        outputs = ["F_x", "F_y", "F_z", "tau_x", "tau_y", "tau_z", *(f"tau_{joint}" for joint in joints)]
        out[name] = (features, outputs, fit.lengthscales, fit.at_lower, fit.at_upper)
    return out
