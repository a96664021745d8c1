"""Scenarios of `colift init` without changes: result of the preflight check, and the order C1 > C2 > C3."""

from __future__ import annotations

from typing import Any

from colift import scenario
from colift.analysis import metrics, preflight
from colift.closed_loop.flight import run_experiment
from colift.scenario import experiment, template
from evidence import collect

TEAMS = ((2, 2), (3, 2), (3, 1), (4, 1), (6, 0), (3, 0))  # agents, arms of each


def simulate_item(item: str) -> dict[str, Any]:
    """Return the result of the preflight check, and the RMS position error [m] of each case over the second half."""
    agents, arms = map(int, item.split(" x "))
    settings = scenario.parse(template.scenario_template("team", agents, arms), "team.yaml")
    found = preflight.run_preflight(settings)
    errors = {}
    for case in ("C1", "C2", "C3"):
        case_experiment = experiment.make_experiment(settings, case)
        flight = run_experiment(case_experiment)
        errors[case] = (
            None
            if flight.termination_reason
            else metrics.summary(flight, case_experiment.world.team, case_experiment.controller.team)["e_p_rms_m"]
        )
    return {"passed": found.passed, "report": found.format_report(), "e_p_rms_m": errors}


def main() -> bool:
    """Return whether every team passes the check, completes its flights and reduces its error with each model."""
    items = [f"{agents} x {arms}" for agents, arms in TEAMS]
    found, good = collect("starts", items, simulate_item), True
    for item in items:
        errors = found[item]["e_p_rms_m"]
        ended = [errors[case] for case in ("C1", "C2", "C3") if errors[case] is not None]
        falls = len(ended) == 3 and ended[0] > ended[1] > ended[2]
        good &= falls and found[item]["passed"]
        output = ", ".join(f"{case} {'stopped' if e is None else f'{1e3 * e:.1f} mm'}" for case, e in errors.items())
        print(
            f"{item:6} {'passed' if found[item]['passed'] else 'FAILED'}, {output}{'' if falls else ': NOT in order'}"
        )
    return good


if __name__ == "__main__":
    main()
