"""Teams with redundant joints or two arms per agent: errors of C1 to `adaptive` over seeds, with and without sensor
bias. A constant bias of tip force sensors is a moment of the payload that C2 learns and the agents do not
compensate. Psi therefore need not decrease from C1 to C2; e_p must.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop.flight import run_experiment
from colift.scenario import experiment
from evidence import collect

TEAMS = ("seven", "beam", "trio", "uneven")
CASES = ("C1", "C2", "C3", "adaptive")
SEEDS = (0, 1, 2)
UNBIASED = "sensors.tip_force_bias_N=0"


def simulate_item(item: str) -> dict[str, Any]:
    """Return for each case RMS e_p and mean Psi over the second half, or the reason of an early end."""
    team, seed, *changes = item.split()
    found = {}
    for case, case_experiment in experiment.make_experiments(
        scenario.load_scenario(team, [f"seed={seed}", *changes]), CASES
    ).items():
        flight = run_experiment(case_experiment)
        half = metrics.second_half(flight.records)
        errors = {"e_p_rms_m": metrics.rms_norm(half.e_p), "Psi_mean": float(np.mean(half.Psi))}
        found[case] = {"termination_reason": flight.termination_reason} | ({} if flight.termination_reason else errors)
    return found


def main() -> bool:
    """All flights must be complete; e_p must decrease from case to case, with sensor bias from C1 to C2 as well."""
    items = [f"{team} {rest}" for team in TEAMS for rest in (*map(str, SEEDS), f"0 {UNBIASED}")]
    flown, good = collect("redundant", items, simulate_item), True
    for item in items:
        found = flown[item]
        if stopped := {case: each["termination_reason"] for case, each in found.items() if each["termination_reason"]}:
            print(f"{item}: {stopped}")
            good = False
            continue
        e_p, Psi = ([found[case][name] for case in CASES] for name in ("e_p_rms_m", "Psi_mean"))
        falls = all(a > b for a, b in itertools.pairwise(e_p[1:] if UNBIASED in item else e_p))
        good &= falls
        print(
            f"{item:40} e_p {', '.join(f'{1e3 * x:.1f}' for x in e_p)} mm, "
            f"Psi {', '.join(f'{1e6 * x:.2g}' for x in Psi)} 1e-6{'' if falls else ': NOT in order'}"
        )
    return good


if __name__ == "__main__":
    main()
