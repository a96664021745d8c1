"""Certificates of flights that differ from `certified`: each bound holds, or the reason for its absence is stated.

Trials of `colift falsify` cover one kind of flight each: other residuals, late updates, large initial errors, faster
and slower paths, the study's noise, other control rates, weaker rotors. Further kinds are residuals that are consistent
with norm and labels and maximize the errors, and other teams in the world of `certified`, with their own payload,
gains, allocation and control rate.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from typing import Any

from colift import scenario
from colift.certification.certificate import ERRORS
from colift.scenario import Scenario
from colift.workflows import falsification
from evidence import collect
from evidence.certified import with_sensor_noise

SEED, ROUNDS = 300, 1  # not used by the scenario or by other evidence modules
NOISE = "paper"  # the scenario whose sensors one kind has, see `colift.workflows.falsification`
TEAMS = ("trio", "uneven", "leader_block", "beam", "seven")


def simulate_item(item: str) -> list[dict[str, Any]]:
    """Return the trials of an item.

    Items are `worst_case K`, all residuals of a round; a kind of flight and K, with `sensor_noise_filtered`
    being `sensor_noise`
    with filters for their noise; or a team and K.
    """
    kind, k = item.rsplit(" ", 1)
    if kind == "worst_case":
        return trial_values(_settings(), [f"{each}:{k}" for each in falsification.RESIDUAL_TRIALS])
    if kind in TEAMS:
        return trial_values(with_team_of(kind), [f"seed:{k}"])
    if kind == "sensor_noise_filtered":
        return trial_values(with_sensor_noise(_settings()), [f"sensor_noise:{k}"])
    return trial_values(_settings(), [f"{kind}:{k}"])


def trial_values(settings: Scenario, names: list[str]) -> list[dict[str, Any]]:
    """Return the stored values of trials; ratios of flights that end early within finite bounds are null."""
    out = []
    for one in falsification.falsify(settings, names):
        ratios = {error: ratio if math.isfinite(ratio) else None for error, ratio in one.observed_over_bound.items()}
        out.append({**dataclasses.asdict(one), "observed_over_bound": ratios, "violated": one.is_violated})
    return out


def with_team_of(name: str) -> Scenario:
    """Return another scenario's team, payload, gains, allocation and rate in the world of `certified`, with its
    filters.
    """
    base, other = _settings(), scenario.load_scenario(name)
    filters = {each: getattr(base.control, each) for each in ("complementary_filter_Hz", "joint_filter_Hz")}
    return base.model_copy(
        update={each: getattr(other, each) for each in ("agent_types", "agents", "payload", "allocation", "control_Hz")}
        | {"name": f"certified_{name}", "control": other.control.model_copy(update=filters)}
    )


def _settings() -> Scenario:
    return scenario.load_scenario("certified").model_copy(update={"seed": SEED})


def main() -> bool:
    """Print the worst trial of each kind and the reasons of missing bounds; no bound may be violated."""
    flights = [
        f"{kind} {k}" for k in range(ROUNDS) for kind in (*falsification.SCENARIO_TRIALS, "sensor_noise_filtered")
    ]
    items = [
        *flights,
        *(f"worst_case {k}" for k in range(ROUNDS)),
        *(f"{name} {k}" for k in range(ROUNDS) for name in TEAMS),
    ]
    found = collect("variants", items, simulate_item)
    of: dict[str, list[dict[str, Any]]] = {}
    for item in items:
        of.setdefault(item.rsplit(" ", 1)[0], []).extend(found[item])
    holds = falsification.STUDY_NOISE == NOISE
    for kind, each in of.items():
        held = [one for one in each if one["observed_over_bound"] and None not in one["observed_over_bound"].values()]
        ratios = [one["observed_over_bound"] for one in held]
        worst = {e: max((each[e] for each in ratios if e in each), default=None) for e in ERRORS}
        output = ", ".join(f"{error} {ratio:.3f}" for error, ratio in worst.items() if ratio is not None)
        broken, left = (
            [one["name"] for one in each if one["violated"]],
            sum(one["num_components_outside"] for one in held),
        )
        print(
            f"{kind:13} {len(held)} of {len(each)} trials have bounds; largest observed error / bound: {output}; "
            f"violated: {broken or 'none'}; components outside their interval: {left}"
        )
        holds &= not broken and all(one["message"] for one in each if one not in held)
        for why, many in Counter(one["message"] for one in each if one["message"]).items():
            print(f"    {many}: {why}")
    return holds


if __name__ == "__main__":
    main()
