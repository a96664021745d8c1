"""Random teams with bound directions: stability near the former threshold, verdicts of `check`, and flights.

Each team draws one or two arms with up to three joints, planar or not, with a lever of 0.05 to 0.5 m. Its attitude gain
is 0.3 to 3 times `u l / I`, at which torques for the commanded contact forces would leave the attitude no stiffness.
The seeds are not used for any tuning or test.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import colift
from colift.analysis import preflight, stability
from colift.scenario import Scenario, experiment
from evidence import collect
from evidence.targets import Target, report
from tests.support import planar_teams

TEAMS = 200
SEEDS = range(40_000, 40_000 + TEAMS)
FACTORS = (0.8, 1.2)  # attitude gains relative to u l / I
DURATION = 12.0  # s


def compute_item(item: str) -> dict[str, Any]:
    """Return modes around the threshold, the verdict of the preflight check, and the metrics of C1 and C3 of a team."""
    settings = planar_teams.random_team(int(item))
    critical = planar_teams.critical_gain(settings)
    report = preflight.run_preflight(settings)
    levels = {finding.subject: str(finding.level) for finding in report.findings}
    modes = {} if critical is None else {str(x): growth_rate(settings, x * critical) for x in FACTORS}
    flights = {case: simulate_case(settings, case) for case in ("C1", "C3")}
    ratio = None if critical is None else settings.control.agent_k_R / critical
    return {"gain_ratio": ratio, "verdict": str(report.verdict), "levels": levels, "growth_rate_1ps": modes, **flights}


def growth_rate(settings: Scenario, agent_k_R: float) -> float:
    """Return the growth rate of the slowest mode with another attitude gain and the same damping ratio [1/s]."""
    gains = {"agent_k_R": agent_k_R, "agent_k_omega": planar_teams.DAMPING * float(np.sqrt(agent_k_R))}
    changed = settings.model_copy(update={"control": settings.control.model_copy(update=gains)})
    case_experiment = experiment.make_experiment(changed, "C1")
    modes = stability.modes_at_equilibrium(case_experiment, case_experiment.initial_state)
    return float(modes.eigenvalues[0].real)


def simulate_case(settings: Scenario, case: str) -> dict[str, Any]:
    """Return whether a case completes its flight, and its errors in the second half."""
    metrics = colift.run_experiment(colift.make_experiment(settings, case), duration=DURATION).metrics
    return {key: metrics[key] for key in ("termination_reason", "e_p_rms_m", "e_R_rms")}


def targets(found: dict[str, Any]) -> list[Target]:
    """Return targets: no change of stability at the threshold, and verdicts that predict the flights."""
    rates = [list(each["growth_rate_1ps"].values()) for each in found.values() if each["growth_rate_1ps"]]
    ended = [each for each in found.values() if each["C1"]["termination_reason"]]
    sound = [each for each in found.values() if each["verdict"] == "sound"]
    completed = [each for each in sound if not any(each[case]["termination_reason"] for case in ("C1", "C3"))]
    better = [each for each in completed if each["C3"]["e_p_rms_m"] < each["C1"]["e_p_rms_m"]]
    flown = [each for each in found.values() if not each["C1"]["termination_reason"]]
    return [
        Target(
            "teams that are unstable at 0.8 and stable at 1.2 times u l / I",
            sum(low > 0 > high for low, high in rates),
            most=0,
            note=f"{len(rates)} teams",
        ),
        Target(
            "teams with the verdict sound that do not complete C1", sum(x["verdict"] == "sound" for x in ended), most=0
        ),
        Target(
            "share of sound teams that complete C1 and C3 with a smaller error in C3",
            len(better) / max(len(sound), 1),
            least=0.95,
            note=f"{len(sound)} of {len(found)} teams are sound",
        ),
        Target(
            "share of teams with a complete C1 whose yaw gain is reported",
            sum(x["levels"].get("yaw gain", "passed") != "passed" for x in flown) / max(len(flown), 1),
            most=0.05,
            note=f"{sum(x['verdict'] == 'unsound' for x in flown)} of {len(flown)} are unsound by another check",
        ),
    ]


def main() -> bool:
    """Print the targets and return whether all are met."""
    return report(targets(collect("realization", map(str, SEEDS), compute_item)))
