"""Verdicts of `check` for newly drawn teams of `init`, compared with flights of C1 and C3.

Each team has two to five agents of 0.03 to 30 kg with arms of 0 to 3 joints, and a bar, plate or box
(`tests.support.user_teams.drawn_team`). Its gains are those that `init` writes. The seeds are not used for tuning or
tests.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import colift
from colift.analysis import preflight
from colift.scenario import Scenario
from evidence import collect
from evidence.targets import Target, report
from tests.support import user_teams

TEAMS = 50
SEEDS = range(60_000, 60_000 + TEAMS)
DURATION_SHARE = 14 / 24
"""Simulated share of the duration of a scenario; learning ends after half of the duration."""


def compute_item(item: str) -> dict[str, Any]:
    """Return the verdict of the preflight check of a team, and the metrics of C1 and C3."""
    with tempfile.TemporaryDirectory() as folder:
        settings = user_teams.drawn_team(int(item), Path(folder))
    report = preflight.run_preflight(settings, search=False)
    levels = {finding.subject: finding.level.value for finding in report.findings}
    agent_type = next(iter(settings.agent_types.values()))
    team = {"agents": len(settings.agents), "joints": len(agent_type.joints), "base_kg": agent_type.base.mass_kg}
    flights = {case: simulate_case(settings, case) for case in ("C1", "C3")}
    return {"team": team, "verdict": report.verdict.value, "levels": levels, **flights}


def simulate_case(settings: Scenario, case: str) -> dict[str, Any]:
    """Return whether a case completes its flight, and its errors in the second half; the reason if it is refused."""
    duration = DURATION_SHARE * settings.duration_s
    try:
        metrics = colift.run_experiment(colift.make_experiment(settings, case), duration=duration).metrics
    except colift.ScenarioError as error:
        return {"termination_reason": str(error), "e_p_rms_m": None, "e_R_rms": None}
    return {key: metrics[key] for key in ("termination_reason", "e_p_rms_m", "e_R_rms")}


def completed(found: dict[str, Any]) -> bool:
    """Return whether C1 and C3 complete their flights."""
    return not any(found[case]["termination_reason"] for case in ("C1", "C3"))


def as_predicted(found: dict[str, Any]) -> bool:
    """Return whether C1 and C3 complete their flights, and the position error is smaller in C3."""
    return completed(found) and found["C3"]["e_p_rms_m"] < found["C1"]["e_p_rms_m"]


def targets(found: dict[str, Any]) -> list[Target]:
    """Return targets of the verdicts and of the gains of `init`."""
    sound = [each for each in found.values() if each["verdict"] == "sound"]
    accepted = [each for each in found.values() if each["verdict"] != "unsound"]
    return [
        Target(
            "share of sound teams that complete C1 and C3 with a smaller error in C3",
            sum(map(as_predicted, sound)) / max(len(sound), 1),
            least=0.95,
            note=f"{len(sound)} of {len(found)} teams are sound",
        ),
        Target(
            "share of sound and weak teams that complete C1 and C3 with a smaller error in C3",
            sum(map(as_predicted, accepted)) / max(len(accepted), 1),
            least=0.95,
            note=f"{len(accepted)} of {len(found)} teams are sound or weak",
        ),
        Target(
            "share of all teams that complete C1 with the gains of init",
            sum(not each["C1"]["termination_reason"] for each in found.values()) / max(len(found), 1),
            least=0.9,
            note=f"{len(found)} teams",
        ),
    ]


def main() -> bool:
    """Print the targets and return whether all are met."""
    return report(targets(collect("verdicts", map(str, SEEDS), compute_item)))
