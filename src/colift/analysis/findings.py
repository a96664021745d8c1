"""Findings of the preflight check, their levels, and the verdict that follows from them.

See Also:
    colift.analysis.preflight: the checks.
    docs/own_team: the table of findings with their limits.
"""

from __future__ import annotations

import dataclasses
import enum
from typing import Any

SUBJECT_WIDTH = 16
"""Characters of the longest subject in a report."""


class Level(enum.StrEnum):
    """Result of one check."""

    passed = "passed"
    weak = "weak"  # the scenario can be simulated; a margin is small
    failed = "failed"


class Verdict(enum.StrEnum):
    """Result of all checks of a scenario."""

    sound = "sound"  # every check passed
    weak = "weak"  # no check failed, at least one is weak
    unsound = "unsound"  # at least one check failed


@dataclasses.dataclass(frozen=True)
class Finding:
    """Result of one check."""

    subject: str  # what was checked
    message: str  # one sentence with values and units
    values: dict[str, Any]  # the values by name, with units in the names
    advice: tuple[str, ...] = ()  # proposed changes; empty if the check passed
    level: Level = Level.passed  # result of the check

    def format_lines(self) -> list[str]:
        """Format the finding for the terminal: one line, with advice below."""
        advice = (f"{'':{SUBJECT_WIDTH}}  advice: {text}" for text in self.advice)
        return [f"{self.subject:{SUBJECT_WIDTH}}  {self.message}", *advice]


def failure(subject: str, message: str, values: dict[str, Any], *advice: str) -> Finding:
    """Return the finding of a failed check."""
    return Finding(subject, message, values, advice, Level.failed)


@dataclasses.dataclass(frozen=True)
class PreflightReport:
    """All findings of a scenario; few if the team cannot be built or has no equilibrium."""

    scenario: str  # name of the scenario
    findings: tuple[Finding, ...]  # in the order of the checks

    @property
    def verdict(self) -> Verdict:
        """Verdict: `unsound` if a check failed, otherwise `weak` if a check is weak, otherwise `sound`."""
        levels = {finding.level for finding in self.findings}
        if Level.failed in levels:
            return Verdict.unsound
        return Verdict.weak if Level.weak in levels else Verdict.sound

    @property
    def passed(self) -> bool:
        """True if no check failed."""
        return self.verdict is not Verdict.unsound

    @property
    def summary(self) -> dict[str, Any]:
        """Verdict and findings as printed by `check --json`; a key of `checks` is the subject of a finding."""
        checks = {
            finding.subject.replace(" ", "_"): {
                "passed": finding.level is not Level.failed,
                "level": finding.level.value,
                "message": finding.message,
                "advice": list(finding.advice),
                **finding.values,
            }
            for finding in self.findings
        }
        return {"scenario": self.scenario, "verdict": self.verdict.value, "passed": self.passed, "checks": checks}

    def subjects(self, level: Level) -> tuple[str, ...]:
        """Return the subjects of the findings of a level."""
        return tuple(finding.subject for finding in self.findings if finding.level is level)

    def format_verdict(self) -> str:
        """Format the verdict with the failed and the weak checks in one line."""
        groups = [
            f"{level.value}: {', '.join(subjects)}"
            for level in (Level.failed, Level.weak)
            if (subjects := self.subjects(level))
        ]
        reasons = f" ({'; '.join(groups)})" if groups else ""
        return f"{self.scenario}: {self.verdict.value}{reasons}"

    def format_report(self) -> list[str]:
        """Format the findings for the terminal: one line each, advice below, the verdict last."""
        return [*(line for finding in self.findings for line in finding.format_lines()), self.format_verdict()]
