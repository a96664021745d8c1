"""Tuning of the baselines on seeds that the study does not use: a grid for each, mean e_p over the seeds."""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Mapping
from typing import Any

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop.flight import run_experiment
from colift.onboard.learning import residual_predictors
from colift.scenario import controllers, experiment
from evidence import collect

SEEDS = (100, 101, 102)
LEAD = "lead_time"  # s, no setting but a field of the controller (`controllers.with_lead_time`)
GRID: dict[str, list[dict[str, Any]]] = {  # settings of the scenario, and lead times
    "integral": [
        {"baselines.position_integral_gain": K, "baselines.attitude_integral_gain": k}
        for K in (1.0, 1.5, 2.0)
        for k in (10.0, 20.0, 40.0)
    ],
    "disturbance_observer": [
        {"baselines.dob_Hz": (f, m)} for f in (0.2, 0.25, 0.3, 0.35, 0.4) for m in (0.15, 0.3, 0.6, 1.2)
    ],
    "parametric": [
        {
            "baselines.mass_prior_std_kg": m,
            "baselines.first_moment_prior_std_kgm": c,
            "baselines.inertia_prior_std_kgm2": J,
        }
        for m, c, J in ((0.5, 5e-3, 3e-3), (0.5, 1e-4, 1e-4), (0.5, 1e-6, 1e-6), (0.5, 1e-8, 1e-8), (0.1, 1e-6, 1e-6))
    ],
    "label_feedback": [
        {LEAD: s, "learning.label_filter_Hz": f} for f in (5.0, 8.0, 12.0) for s in (0.0, 0.02, 0.04, 0.06)
    ],
    "regression": [
        *({"baselines.ridge_alpha": (r, m)} for r in (0.03, 0.1, 0.3, 1.0) for m in (0.3, 3.0, 10.0, 30.0)),
        *({"baselines.ridge_alpha": (0.1, 10.0), "learning.label_filter_Hz": f} for f in (5.0, 12.0)),
    ],
}


def overrides(point: Mapping[str, Any]) -> list[str]:
    """Return the settings of a point of a grid, without its lead time, as text."""
    return [f"{name}={json.dumps(value)}" for name, value in point.items() if name != LEAD]


def simulate_item(item: str) -> float:
    """Return the mean e_p RMS [m] over the seeds for one setting of one baseline; a failed flight counts as 10 m."""
    case, k = item.split()
    total = 0.0
    for seed in SEEDS:
        point = GRID[case][int(k)]
        settings = scenario.load_scenario("paper", [f"seed={seed}", *overrides(point)])
        plan = experiment.make_experiment(settings, case)
        if LEAD in point:
            plan = dataclasses.replace(plan, controller=controllers.with_lead_time(plan.controller, point[LEAD]))
        flight = run_experiment(plan)
        found = metrics.summary(flight, plan.world.team, plan.controller.team)
        total += 10.0 if flight.termination_reason else found["e_p_rms_m"]
    return total / len(SEEDS)


def main() -> bool:
    """Simulate the grids; the settings of the shipped scenario must be within 5 % of each grid's best."""
    items = [f"{case} {k}" for case, grid in GRID.items() for k in range(len(grid))]
    found = collect("baselines", items, simulate_item)
    shipped = scenario.load_scenario("paper").model_dump()

    def value(name: str) -> Any:
        if name == LEAD:
            return residual_predictors.DEFAULT_LEAD_TIME
        return functools.reduce(lambda section, key: section[key], name.split("."), shipped)

    good = True
    for case, grid in GRID.items():
        scores = [found[f"{case} {k}"] for k in range(len(grid))]
        now = [s for s, point in zip(scores, grid, strict=True) if all(value(name) == v for name, v in point.items())]
        for point, score in zip(grid, scores, strict=True):
            print(f"{case:4} {point}: {score * 1e3:.1f} mm")
        good &= bool(now) and now[0] <= 1.05 * min(scores)
    return good


if __name__ == "__main__":
    main()
