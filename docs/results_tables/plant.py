"""Tables of the plant, other engines, rounding, machines, software tests and generated code."""

from __future__ import annotations

import contextlib
from itertools import product
from typing import Any

import numpy as np

from results_tables import CASES, Cell, MissingResult, items, limits, markdown, number, table

PLANT = {
    "agreement": (
        "forces and accelerations against Pinocchio, relative error",
        "1e-9 where the condition is at most 1e6",
    ),
    "energy": ("energy drift over peak kinetic energy, 10 s at 1 ms", "1e-8"),
    "momentum": ("momentum drift, 10 s at 1 ms", "1e-8"),
    "order": ("convergence order of state and contact force", "4 and at least 3"),
    "residual": ("constraint residuals over 60 s", "1e-10"),
    "gradient": ("gradients against finite differences, relative error", "1e-6"),
}
APART = {
    "position_m": ("position [um]", 1e6),
    "attitude_deg": ("attitude [1e-3 deg]", 1e3),
    "relative_force_rms": ("contact force, RMS [%]", 100.0),
    "relative_force_peak": ("contact force, peak [%]", 100.0),
}


@table("plant")
def plant_targets() -> str:
    """Targets of the plant and the largest deviation of each."""
    summary = items("plant")["summary"]
    values = summary["table"]
    energies = [row["worst"] for name, row in values.items() if name.startswith("energy, ")]
    worst = {
        "agreement": values["agreement"]["worst"],
        "energy": max(energies),
        "momentum": values["momentum"]["worst"],
        "order": f"{number(values['order_of_state']['worst'])} and {number(values['order_of_force']['worst'])}",
        "residual": values["residual"]["worst"],
        "gradient": max(row["worst"] for name, row in values.items() if name.startswith("gradient")),
    }
    rows = [(PLANT[key][0], worst[key], PLANT[key][1], met) for key, met in summary["met"].items()]
    return markdown(("target", "largest", "limit", "met"), rows)


@table("plant")
def plant_distributions() -> str:
    """All quantities of the plant: number of values, median and worst."""
    rows = [
        (name, row.get("count"), row["median"], row["worst"])
        for name, row in items("plant")["summary"]["table"].items()
    ]
    return markdown(("quantity", "n", "median", "worst"), rows)


@table("engines")
def mujoco() -> str:
    """The study with MuJoCo as the plant: position errors of both, and the largest distances of the runs."""
    rows: list[tuple[Any, ...]] = []
    for case in limits("engines")["CASES"]:
        one = items("engines")[case]
        e = one["e_p_rms_m"]
        apart = [scale * one["differences"][key] for key, (_, scale) in APART.items()]
        rows.append((f"`{case}`", CASES[case], 1e3 * e["colift"], 1e3 * e["mujoco"], *apart))
    header = ("case", "meaning", "position error, colift [mm]", "position error, MuJoCo [mm]")
    return markdown((*header, *(f"difference: {name}" for name, _ in APART.values())), rows)


@table("engines+drake")
def engine_targets() -> str:
    """Targets of the comparison with MuJoCo and Drake, C1."""
    asked = limits("engines")["TARGETS"]
    judged = {"MuJoCo": items("engines")["C1"]["differences"], "Drake": items("drake")["C1"]["extrapolated"]}
    rows: list[tuple[Any, ...]] = []
    for engine, apart in judged.items():
        for key, (name, scale) in APART.items():
            rows.append(
                (
                    f"{engine}: {name}",
                    scale * apart[key],
                    f"at most {number(scale * asked[key])}",
                    apart[key] <= asked[key],
                )
            )
    e = [items("engines")[case]["e_p_rms_m"]["mujoco"] for case in ("C1", "C2", "C3")]
    rows.append(
        (
            "MuJoCo: position error falls from C1 to C2 to C3",
            " > ".join(number(1e3 * x) for x in e) + " mm",
            "-",
            e[0] > e[1] > e[2],
        )
    )
    return markdown(("target", "measured", "limit", "met"), rows)


@table("drake")
def drake_steps() -> str:
    """Differences of C1 between colift and Drake by Drake's step, and extrapolated to a step of zero."""
    one = items("drake")["C1"]
    rows = [
        (step, *(scale * row[key] for key, (_, scale) in APART.items()))
        for step, row in (*one["differences"].items(), ("extrapolated", one["extrapolated"]))
    ]
    return markdown(("step of Drake", *(name for name, _ in APART.values())), rows)


@table("rounding")
def rounding_spread() -> str:
    """Relative spread of metrics over linear algebra kernels and instruction sets."""
    asked, found = limits("rounding"), items("rounding")
    rows = []
    for seed, case, name in product(asked["SEEDS"], asked["CASES"], asked["FIGURES"]):
        of = [one for item, one in found.items() if item.split()[0] == str(seed)]
        values = np.array([one[case][name] for one in of])
        spread = float(np.ptp(values) / np.median(values))
        rows.append(
            (
                f"`{case}` ({CASES[case]})",
                seed,
                f"`{name}`",
                len(values),
                spread,
                f"at most {asked['LIMIT']}",
                spread <= asked["LIMIT"],
            )
        )
    return markdown(("case", "seed", "metric", "settings", "relative spread", "limit", "met"), rows)


@table("machines")
def machine_runs() -> str:
    """The numerical tests with other linear algebra kernels and instruction sets."""
    most = limits("machines")["WORKER_MB"]
    rows = []
    for setting, one in items("machines").items():
        met = bool(one["status"] == 0 and one["largest_process_MB"] <= most)
        rows.append(
            (
                setting,
                one.get("passed", 0),
                len(one["failures"]),
                one["wall_time_s"],
                one["largest_process_MB"],
                f"at most {most}",
                met,
            )
        )
    header = (
        "OpenBLAS kernels, XLA instructions",
        "passed",
        "failed",
        "time [s]",
        "largest process [MB]",
        "limit",
        "met",
    )
    return markdown(header, rows)


@table("long_tests+mutants+interrupts")
def software_tests() -> str:
    """Long tests, mutation tests and interrupted runs."""
    rows: list[tuple[Cell, ...]] = []
    with contextlib.suppress(MissingResult):
        long = items("long_tests").values()
        failed = sum(len(one["failed"]) for one in long)
        rows.append(("long tests that fail", failed, sum(one["passed"] for one in long) + failed, failed == 0))
    with contextlib.suppress(MissingResult):
        lives = sum(one["survived"] for one in items("mutants").values())
        rows.append(("mutants that no test detects", lives, len(items("mutants")), lives == 0))
    with contextlib.suppress(MissingResult):
        wrong = sum(bool(one["failures"]) for one in items("interrupts").values())
        what = "interrupted runs that end late or leave broken files"
        rows.append((what, wrong, len(items("interrupts")), wrong == 0))
    if not rows:
        raise MissingResult("long_tests mutants interrupts")
    return markdown(("quantity", "measured", "n", "met (0 is required)"), rows)


# Generated code -------------------------------------------------------------------------------------------------------


@table("onboard")
def code_targets() -> str:
    """The control step as C on each target: difference from Python, time of a step, memory."""
    asked = limits("onboard")
    rows = []
    for target, one in items("onboard").items():
        single, contracted = "single" in target, "contracted" in target
        limit = None if contracted else asked["SINGLE"] if single else asked["EXACT"]
        difference = one["max_relative_difference"]
        emulated = not target.startswith("x86")
        times = (None, None) if emulated else (one["step_time_median_us"], one["step_time_p999_us"])
        sizes = [one[f"{part}_bytes"] / 1e3 for part in ("code", "state", "model")]
        met = None if limit is None else bool(difference <= limit)
        rows.append((target, int(one["steps"]), difference, number(limit) if limit else None, met, *times, *sizes))
    header = (
        "target",
        "steps",
        "largest relative difference from Python",
        "limit",
        "met",
        "step, median [us]",
        "step, 99.9 % [us]",
    )
    return markdown((*header, "code [kB]", "memory [kB]", "learned data [kB]"), rows)


@table("onboard")
def time_targets() -> str:
    """Targets of the time of a step with AVX2."""
    one, asked = items("onboard")["x86-64, AVX2"], limits("onboard")
    rows = [
        (f"time of a step, {name} [us]", one[key], f"at most {number(asked[most])}", one[key] <= asked[most])
        for name, key, most in (
            ("median", "step_time_median_us", "MEDIAN_US"),
            ("99.9 %", "step_time_p999_us", "P999_US"),
        )
    ]
    return markdown(("target", "measured", "limit", "met"), rows)
