"""Effect of changes of the environment on the cases: the tables of docs/learning.md, second by second.

Flights with actuator lag, and flights outdoors, have eleven seeds; flights through jets have three; all others have
one, because `evidence orderings` simulates nominal conditions with eleven. The gusts of `outdoors` are equal for all
seeds, those of `gusts` differ. Case `label_feedback` is simulated with its default lead time, and with the best lead
time in nominal conditions (`evidence baselines`).
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop.flight import run_experiment
from colift.scenario import controllers, experiment
from evidence import collect, orderings
from evidence.targets import Target, missed, report

SENSOR_FAILURE = "sensors.models=[{{kind: intermittent, channels: [agents.lam], rate_Hz: 500, failure_time_s: {}}}]"
WIND_TURN = "disturbances.{}.direction_change={{change_deg: 180, start_s: 13}}"
WIND = (WIND_TURN.format("load_wind"), WIND_TURN.format("agent_wind"))
PREVIEW_SETTING = "control.preview_step_s=0.03"
MOTORS = (
    "actuators={kind: motors, bandwidth_Hz: 8, delay_s: 0.006}",
    "nominal.actuators={bandwidth_Hz: 8, delay_s: 0.006}",
)
LAPS = (  # of 24 s, longer than the budget of samples covers
    "reference.period_s=24",
    "duration_s=80",
    "learning.end_s=30",
    "learning.update_times_s=[6, 12, 18, 24, 30]",
)
INTO_JETS = (  # the loop lies beside the jets until 14 s, among them from 17 s on
    "reference.center_m=[-3, 0, 2]",
    "reference.departure={offset_m: [3, 0, 0], start_s: 14, ramp_time_s: 3}",
    "duration_s=60",
)


def gusts(seed: int) -> tuple[str, ...]:
    """Return the gusts of `outdoors` with periods 0.5 to 2 times as long and random phases."""
    rng = np.random.default_rng((2027, seed))
    wind = next(of for of in scenario.load_scenario("outdoors").disturbances if of.name == "load_wind")
    waves = [
        gust.model_dump() | {"period_s": gust.period_s * 2 ** rng.uniform(-1, 1), "phase_deg": rng.uniform(-180, 180)}
        for gust in wind.gusts
    ]
    return tuple(f"disturbances.{name}.gusts={json.dumps(waves)}" for name in ("load_wind", "agent_wind"))


Overrides = tuple[str, ...] | Callable[[int], tuple[str, ...]]  # or a function of the seed
ENVIRONMENTS: dict[str, tuple[str, Overrides, float]] = {  # scenario, overrides, start of the evaluation [s]
    "home": ("paper", (), 10.0),
    "wind": ("paper", WIND, 14.0),
    "mass": ("payload_added", (), 16.0),
    "path": ("path_leaves", (), 11.0),
    "lost": ("labels_lost", (), 13.0),
    "wind lost": ("paper", (*WIND, SENSOR_FAILURE.format(16)), 17.0),
    "mass lost": ("payload_added", (SENSOR_FAILURE.format(17),), 17.0),
    "outdoors": ("outdoors", (), 14.0),
    "gusts": ("outdoors", gusts, 14.0),
    "jets": ("jets", (), 10.0),
    "motors": ("paper", MOTORS, 10.0),
    "laps": ("paper", LAPS, 54.0),
    "laps lost": ("paper", (*LAPS, SENSOR_FAILURE.format(55)), 56.0),
    "into jets": ("jets", INTO_JETS, 35.0),
}
UNCHANGED = ("home", "motors")
CASES = (
    "C1",
    "C3",
    "regression",
    "label_feedback",
    "label_feedback tuned_lead",
    "gp_label_feedback",
    "adaptive",
    "true_residual",
)
LEAD = 0.04  # s, of `label_feedback led`
SEEDS = {"motors": range(11), "outdoors": range(11), "gusts": range(11), "jets": range(3)}  # 0 alone elsewhere


def simulate_item(item: str) -> dict[str, Any]:
    """Return e_p per second and after the change [m], contact forces above 20 Hz [N], and warnings."""
    world, case, seed = item.split(": ")
    name, changes, evaluation_start = ENVIRONMENTS[world]
    case, *lead = case.split()
    overrides = changes(int(seed)) if callable(changes) else changes
    plan = experiment.make_experiment(scenario.load_scenario(name, [PREVIEW_SETTING, *overrides, f"seed={seed}"]), case)
    if lead:
        plan = dataclasses.replace(plan, controller=controllers.with_lead_time(plan.controller, LEAD))
    flight = run_experiment(plan)
    rows = flight.records
    seconds = range(int(rows.t[-1]) + 1)
    errors_by_second = [metrics.rms_norm(rows.e_p[(rows.t >= k) & (rows.t < k + 1)]) for k in seconds]
    return {
        "e_p_rms_m": metrics.rms_norm(rows.e_p[rows.t >= evaluation_start]) if rows.t[-1] > evaluation_start else None,
        "e_p_rms_by_second_m": errors_by_second,
        "delta_W_rms_N": metrics.rms_norm(rows.delta_W[rows.t >= evaluation_start][:, :3])
        if rows.t[-1] > evaluation_start
        else None,
        "contact_force_hf_rms_N": metrics.high_frequency_rms(metrics.second_half(rows)),
        "termination_reason": flight.termination_reason,
        "change_point_times_s": [update.t for update in flight.updates if update.change_points],
    }


def main() -> bool:
    """Print the tables and judge the targets.

    Case `adaptive` must complete every flight, with at most twice the smaller error of C3 and `label_feedback`. In
    unchanged worlds its error must be close to that of `true_residual`.
    """
    items = [f"{w}: {case}: {seed}" for w in ENVIRONMENTS for seed in SEEDS.get(w, (0,)) for case in CASES]
    found = collect("changes", items, simulate_item)
    print(f"{'e_p [mm]':12}" + "".join(f"{case:>16}" for case in CASES))
    for world in ENVIRONMENTS:
        e = errors(found, world)
        print(f"{world:12}" + "".join(f"{_median_and_range(list(e[case])):>16}" for case in CASES))
    all_targets = targets(found)
    holds = report(all_targets)
    print(missed(all_targets))
    return holds


def errors(found: dict[str, Any], world: str) -> dict[str, np.ndarray]:
    """Return position errors [m] of each case in an environment over its seeds; infinite if a flight ended early."""
    seeds = SEEDS.get(world, (0,))
    return {case: np.array([_error(found[f"{world}: {case}: {seed}"]) for seed in seeds]) for case in CASES}


def targets(found: dict[str, Any]) -> list[Target]:
    """Return targets in all environments, then those of unchanged environments."""
    all_targets = []
    for world in ENVIRONMENTS:
        e = errors(found, world)
        worst = (e["adaptive"] / np.minimum(e["C3"], e["label_feedback"])).max()
        all_targets.append(
            Target(
                f"{world}: e_p of adaptive over the smaller of C3 and label_feedback, largest", float(worst), most=2.0
            )
        )
    for world in UNCHANGED:
        e, seeds = errors(found, world), SEEDS.get(world, (0,))
        W = {case: np.array([found[f"{world}: {case}: {seed}"]["delta_W_rms_N"] for seed in seeds]) for case in CASES}
        all_targets += [
            one._replace(description=f"{world}: {one.description}") for one in orderings.adaptive_targets(e, W)
        ]
    return all_targets


def _error(flight_values: dict[str, Any]) -> float:
    return (
        np.inf
        if flight_values["termination_reason"] or flight_values["e_p_rms_m"] is None
        else flight_values["e_p_rms_m"]
    )


def _median_and_range(errors: list[float]) -> str:
    """Format median and range [mm]; a single value is printed alone."""
    x = 1e3 * np.array(errors)
    if not np.isfinite(x).all():
        return f"{(~np.isfinite(x)).sum()} ended"
    return f"{x[0]:.1f}" if len(x) == 1 else f"{np.median(x):.1f} ({x.min():.1f}-{x.max():.1f})"


if __name__ == "__main__":
    main()
