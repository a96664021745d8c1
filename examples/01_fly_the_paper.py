"""The paper's study in Python: load a scenario, plan its cases, fly them, and compare what is left of the errors.

Run it with `python examples/01_fly_the_paper.py`; a scenario and settings of it that are to be others may follow, as
`examples/plate.yaml duration_s=10`.
"""

from __future__ import annotations

import sys

import colift


def main(scenario: str = "paper", *changes: str) -> None:
    """Fly C1, C2 and C3 from the same start under the same unknown forces and noise."""
    settings = colift.payload(scenario, changes)
    for case in ("C1", "C2", "C3"):
        plan = colift.make_experiment(settings, case)
        flight = colift.run_experiment(plan)
        found = colift.summary(flight, plan.world.team, plan.controller.team)
        print(
            f"{case}: {flight.records.t[-1]:.1f} s, {len(flight.updates)} updates, {flight.termination_reason or 'complete'}; ",
            end="",
        )
        print(f"position {1e3 * found['e_p_rms_m']:.1f} mm, attitude {1e3 * found['e_R_rms']:.1f} mrad off (RMS)")


if __name__ == "__main__":
    main(*sys.argv[1:])
