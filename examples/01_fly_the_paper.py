"""Run the paper's study in Python: load a scenario, make its experiments, simulate them, and compare the errors.

Run it with `python examples/01_fly_the_paper.py`. A scenario and settings to override may follow, as in
`python examples/01_fly_the_paper.py examples/plate.yaml duration_s=10`.
"""

from __future__ import annotations

import sys

import colift


def main(scenario: str = "paper", *overrides: str) -> None:
    """Simulate C1, C2 and C3 from the same initial state, under the same disturbances and noise."""
    settings = colift.load_scenario(scenario, overrides)
    for case in ("C1", "C2", "C3"):
        flight = colift.run_experiment(colift.make_experiment(settings, case))
        end = flight.termination_reason or "complete"
        print(f"{case}: {flight.records.t[-1]:.1f} s, {len(flight.updates)} model updates, {end}; ", end="")
        found = flight.metrics
        print(f"RMS position error {1e3 * found['e_p_rms_m']:.1f} mm, attitude {1e3 * found['e_R_rms']:.1f} mrad")


if __name__ == "__main__":
    main(*sys.argv[1:])
