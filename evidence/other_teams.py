"""`evidence react` on other teams: `seven` and three agents of `colift init`, which no scenario ships.

The samples are drawn as those of `evidence react`, with another key. The mass step is scaled with the payload's mass,
and the noise is that of the team's scenario times the drawn factor.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from colift import scenario
from colift.scenario import Scenario, experiment, template
from evidence import collect, react
from evidence.targets import Target, report

SAMPLES = 10  # of each team
KEY = 9119  # of the random numbers
TEAMS = ("seven", "init")
CASES = ("C3", "label_feedback", "adaptive", "true_residual")
RATIO_WITHIN = 1.15  # as in `evidence react`


def team_scenario(team: str) -> Scenario:
    """Return the scenario of a team, without the changes of a sample."""
    if team == "init":
        return scenario.parse(template.scenario_template("new", 3, 1), "new.yaml")
    return scenario.load_scenario(team)


def draw(team: str, sample: int) -> tuple[Scenario, dict[str, Any]]:
    """Return the scenario of a team with the changes of a sample, and the random parameters of the sample."""
    drawn, parameters = react.draw(sample, KEY)
    changes, base = drawn.model_dump(), team_scenario(team)
    data = base.model_dump()
    turned = next(source["direction_change"] for source in changes["disturbances"] if source["kind"] == "wind")
    for source in data["disturbances"]:
        if source["kind"] == "wind":
            source["direction_change"] = turned
    paper_mass = scenario.load_scenario("paper").payload.mass_kg
    step = changes["payload_mass_step"]
    data["payload_mass_step"] = step | {"mass_kg": step["mass_kg"] * base.payload.mass_kg / paper_mass}
    data["reference"]["departure"] = changes["reference"]["departure"]
    data["actuators"], data["nominal"]["actuators"] = changes["actuators"], changes["nominal"]["actuators"]
    data["sensors"] |= react.scaled_noise(data["sensors"], parameters["noise_scale"])
    data["sensors"]["models"] = [{**model, "rate_Hz": base.control_Hz} for model in changes["sensors"]["models"]]
    data["control"]["preview_step_s"] = changes["control"]["preview_step_s"]
    data["seed"] = changes["seed"]
    return Scenario.model_validate(data), parameters


def simulate_item(item: str) -> dict[str, Any]:
    """Return for each case of a sample of a team the RMS position error after the changes [m] and other metrics."""
    team, sample = item.split()
    settings, parameters = draw(team, int(sample))
    experiments = experiment.make_experiments(settings, CASES)
    return {"sample": parameters, **{case: react.simulate_case(plan) for case, plan in experiments.items()}}


def items(team: str) -> list[str]:
    """Return the items of a team."""
    return [f"{team} {sample}" for sample in range(SAMPLES)]


def main() -> bool:
    """Print the targets of each team; return whether all are met."""
    # teams alternate, so that a part of the computation has both
    alternating = [item for pair in zip(*map(items, TEAMS), strict=True) for item in pair]
    found = collect("other_teams", alternating, simulate_item)
    met = [report(targets(team, found)) for team in TEAMS]
    return all(met)


def targets(team: str, found_of: dict[str, Any]) -> list[Target]:
    """Return the targets of `adaptive` for the samples of a team."""
    flights = [found_of[item] for item in items(team)]
    lost = sum(bool(f["adaptive"]["termination_reason"]) for f in flights)
    ratios = {
        "the smaller of C3 and label_feedback": ("C3", "label_feedback"),
        "true_residual with labels": ("true_residual",),
    }
    found = []
    for name, cases in ratios.items():
        limit, least = (RATIO_WITHIN, 100.0) if len(cases) > 1 else (2.5, 90.0)
        compared = [f for f in flights if len(cases) > 1 or f["sample"]["label_failure_time_s"] is None]
        reference = [min(react.error(f, case) for case in cases) for f in compared]
        values = [react.error(f, "adaptive") / e for f, e in zip(compared, reference, strict=True) if np.isfinite(e)]
        count, note = react.share(values, limit)
        description = f"{team}: e_p of adaptive over {name}, at most {limit:g}"
        found.append(Target(description, 100 * count / len(values), least=least, unit="% of flights", note=note))
    return [Target(f"{team}: flights of adaptive that end early", lost, most=0), *found]


if __name__ == "__main__":
    main()
