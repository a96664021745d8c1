"""Teams of three vehicles with nine payloads: gains of `init`, advice of `check`, and flights of C1.

A user writes the scenario of a vehicle with `init --urdf` and replaces the payload and the contacts
(`tests.support.user_teams.user_team`). If `check` finds the team unsound, its first advice is applied, at most twice.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import colift
from colift.analysis import preflight
from colift.analysis.findings import Level
from evidence import collect
from evidence.targets import Target, report
from tests.support import user_teams

ITEMS = [f"{name} {kind} {size}" for name in user_teams.VEHICLES for kind, size in user_teams.PAYLOADS]
MAX_CHANGES = 2


def compute_item(item: str) -> dict[str, Any]:
    """Return the verdict of a team, the options that were typed, and the end and errors of C1."""
    name, kind, size = item.split()
    with tempfile.TemporaryDirectory() as folder:
        settings = user_teams.user_team(name, kind, size, Path(folder))
    typed: list[str] = []
    report = preflight.run_preflight(settings, search=False)
    first = report.verdict.value
    while not report.passed and len(typed) < MAX_CHANGES:
        report = preflight.run_preflight(settings)
        advice = [
            text
            for finding in report.findings
            if finding.level is not Level.passed
            for text in finding.advice
            if "--set" in text
        ]
        if not advice:
            break
        typed.append(advice[0])
        settings = user_teams.with_options(settings, user_teams.options_in(advice[0]))
        report = preflight.run_preflight(settings, search=False)
    metrics = colift.run_experiment(colift.make_experiment(settings, "C1")).metrics
    flight = {key: metrics[key] for key in ("termination_reason", "e_p_rms_m", "e_R_rms")}
    levels = {finding.subject: finding.level.value for finding in report.findings}
    return {"first_verdict": first, "typed": typed, "verdict": report.verdict.value, "levels": levels, "C1": flight}


def targets(found: dict[str, Any]) -> list[Target]:
    """Return targets of the flights."""
    flown = [each for each in found.values() if not each["C1"]["termination_reason"]]
    return [
        Target(
            "teams that complete C1 as written or after the advice of check",
            len(flown),
            least=25,
            note=f"{len(found)} teams, {sum(bool(each['typed']) for each in flown)} of them after advice",
        )
    ]


def main() -> bool:
    """Print the targets and return whether all are met."""
    return report(targets(collect("payloads", ITEMS, compute_item)))
