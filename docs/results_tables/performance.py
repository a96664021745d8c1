"""Tables of the page on performance, generated from `benchmarks/results`."""

from __future__ import annotations

import functools
from typing import Any

from benchmarks import NAMES, status
from results_tables import Cell, MissingResult, markdown, number, table

PARTS = {  # key of the figures, and title
    "feasibility": "feasibility: state at rest, modes, margins",
    "figures": "figures",
    "fits": "fits",
    "error bounds": "error bounds along the flight",
    "imports, logs, planning, analysis": "imports, logs, planning, analysis",
    "control periods": "control periods of three cases",
    "study": "**study**",
}


@functools.cache
def _results() -> dict[str, dict[str, Any]]:
    return status.stored()


def _figures(name: str) -> dict[str, Any]:
    if name not in _results():
        raise MissingResult(name)
    return _results()[name]["figures"]


@table("benchmarks")
def conditions() -> str:
    """Date, commit, machine, load and command of every result with values."""
    rows = [
        (
            f"`{name}`",
            of["date"],
            f"`{of['commit'][:10]}`",
            of["machine"],
            number(of["load_average"], 2),
            f"`./dev bench {of['command'].partition('benchmarks ')[2]}`",
            "; ".join(of["omitted"]) or None,
        )
        for name in NAMES
        if (of := _results().get(name)) and of["figures"]
    ]
    return markdown(("benchmark", "date", "commit", "machine", "load", "command", "omitted"), rows)


@table("benchmarks")
def targets() -> str:
    """All targets, and whether they are met."""
    rows = [
        (f"`{name}`", text, met)
        for name in NAMES
        for text, met in _results().get(name, {"targets": {}})["targets"].items()
    ]
    return markdown(("benchmark", "measured and limit", "met"), rows)


@table("benchmarks")
def one_team() -> str:
    """CPU time of a step of one team."""
    found = _figures("one_team")
    rows = [
        (name, us, found["ratio_to_native"][name], found["contact_gap_m"].get(name))
        for name, us in found["time_per_step_us"].items()
    ]
    return markdown(("one team, one core", "CPU us per step", "time over native", "largest gap [m]"), rows)


@table("benchmarks")
def work_precision() -> str:
    """CPU time at equal errors and at an equal step."""
    found = _figures("work_precision")
    rows: list[tuple[Cell, ...]] = []
    for name, points in found["series"].items():
        one = next(one for one in points if one["step_s"] == 1e-3)
        ratio = found["time_ratio_at_step_of_1_ms"][name]
        rows.append((name, one["error_m"], 1e-3 * one["cpu_us_per_s"], ratio, min(p["error_m"] for p in points)))
    header = ("program", "error at 1 ms [m]", "CPU ms a simulated second", "time over colift", "least error [m]")
    return markdown(header, rows)


@table("benchmarks")
def equal_error() -> str:
    """CPU time of MuJoCo over that of colift at equal errors."""
    found = _figures("work_precision")["time_ratio_at_error"]
    rows = [(error, f"{float(f'{ratio:.2g}'):g}") for error, ratio in found.items()]
    return markdown(("error of the payload position", "CPU time of MuJoCo over colift"), rows)


@table("benchmarks")
def batch() -> str:
    """Time of a step and team in a batch."""
    found = _figures("batch")
    rows = []
    for name, us in found["time_per_step_and_team_us"].items():
        alone = "one thread" in name
        peer = name.startswith("mujoco")
        ratio = found["ratio_with_one_thread"] if alone else found["ratio_to_native"]["mujoco.rollout"]
        rows.append((name if alone else f"{name}, {found['threads']} threads", us, ratio if peer else 1))
    return markdown(("1024 different teams", "us per step and team", "time over native"), rows)


@table("benchmarks")
def simulators() -> str:
    """CPU time of a step of other simulators."""
    found = _figures("simulators")
    rows = [(name, us, found["ratio_to_native"][name]) for name, us in found["time_per_step_us"].items()]
    return markdown(("simulator", "CPU us per step", "time over native"), rows)


@table("benchmarks")
def growth() -> str:
    """Time per step and agent over the number of agents."""
    one, many = (_figures("growth")[key] for key in ("1 at once", "16 at once"))
    rows = [
        (
            n,
            *(
                of[n][key]
                for of in (one, many)
                for key in ("time_per_step_and_agent_us", "ratio_to_4", "compile_time_s")
            ),
        )
        for n in one
    ]
    parts = ("us per step and agent", "ratio to N = 4", "compile [s]")
    return markdown(("N agents", *(f"{name}: {part}" for name in ("one team", "16 teams") for part in parts)), rows)


@table("benchmarks")
def cold_start() -> str:
    """Time of a new process until its first step."""
    rows = [
        (f"{program}, caches {caches}", times["wall_time_s"], times["cpu_time_s"])
        for program, of in _figures("cold_start").items()
        for caches, times in of.items()
    ]
    return markdown(("", "wall clock [s]", "CPU [s]"), rows)


@table("benchmarks")
def flight() -> str:
    """Time of a control period of C3 with frozen models."""
    rows = [
        (name, of["time_per_tick_us"], of["real_time_factor"])
        for name, of in _figures("flight").items()
        if name != "agents"
    ]
    return markdown(("", "us per control period", "times real time"), rows)


@table("benchmarks")
def flight_growth() -> str:
    """Time of a control period over the number of agents."""
    rows = [
        (n, of["time_per_tick_and_agent_us"], of["ratio_to_4"], of["first_call_s"])
        for n, of in _figures("flight")["agents"].items()
    ]
    header = (
        "agents",
        "CPU us per control period and agent",
        "ratio to N = 4",
        "first call with compilation [s]",
    )
    return markdown(header, rows)


@table("benchmarks")
def allocation_limits() -> str:
    """Time of a control period with the allocation within limits."""
    rows = [
        (f"`{case}`", name, of["closed_loop_us"], of["closed_loop_ratio"], of["c_us"], of["c_ratio"])
        for case, kinds in _figures("limits").items()
        for name, of in kinds.items()
    ]
    header = (
        "case",
        "allocation",
        "closed loop [us]",
        "over least squares",
        "controller as C [us]",
        "over least squares",
    )
    return markdown(header, rows)


@table("benchmarks")
def parts() -> str:
    """CPU time of the parts of a study."""
    from benchmarks.parts import LIMITS

    found = _figures("parts")
    rows = [(title, found[key], LIMITS.get(key)) for key, title in PARTS.items()]
    return markdown(("part", "CPU [s]", "target [s]"), rows)


@table("benchmarks")
def gaussian_processes() -> str:
    """Times of the GP core and of its peers."""
    found = _figures("gp")
    groups = {operation: of for operation, of in found.items() if isinstance(of, dict)}
    sized = [
        (operation, n, of) for operation, sizes in groups.items() if "median_ms" not in sizes for n, of in sizes.items()
    ]
    sized += [(operation, None, of) for operation, of in groups.items() if "median_ms" in of]
    rows = [
        (operation, n, name, ms, of["ratio_to_colift"][name], of["time_over_roofline"][name])
        for operation, n, of in sized
        for name, ms in of["median_ms"].items()
    ]
    return markdown(("operation", "N", "", "median [ms]", "time over colift", "time over roofline"), rows)
