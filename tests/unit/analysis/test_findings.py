"""Tests of levels and verdict."""

from __future__ import annotations

import pytest

from colift.analysis.findings import Finding, Level, PreflightReport, Verdict, failure

GOOD = Finding("mass", "5 kg", {"total_kg": 5.0})
WEAK = Finding("delay margin", "0.008 s", {}, ("a gain",), Level.weak)
BAD = failure("slowest mode", "+1 rad/s", {}, "another gain")


@pytest.mark.parametrize(
    ("findings", "verdict", "line"),
    [
        ((GOOD,), Verdict.sound, "team: sound"),
        ((GOOD, WEAK), Verdict.weak, "team: weak (weak: delay margin)"),
        ((GOOD, WEAK, BAD), Verdict.unsound, "team: unsound (failed: slowest mode; weak: delay margin)"),
    ],
)
def test_verdict_is_that_of_the_worst_finding(findings: tuple[Finding, ...], verdict: Verdict, line: str):
    report = PreflightReport("team", findings)
    assert report.verdict is verdict
    assert report.passed == (verdict is not Verdict.unsound)
    assert report.format_report()[-1] == line
    assert report.summary["verdict"] == verdict.value


def test_summary_has_level_and_advice_of_each_finding():
    checks = PreflightReport("team", (GOOD, WEAK, BAD)).summary["checks"]
    assert checks["mass"] == {"passed": True, "level": "passed", "message": "5 kg", "advice": [], "total_kg": 5.0}
    assert (checks["delay_margin"]["passed"], checks["delay_margin"]["level"]) == (True, "weak")
    assert (checks["slowest_mode"]["passed"], checks["slowest_mode"]["advice"]) == (False, ["another gain"])


def test_lines_of_findings_and_verdict_are_the_report():
    """Findings can be printed one at a time."""
    report = PreflightReport("team", (GOOD, WEAK, BAD))
    lines = [line for finding in report.findings for line in finding.format_lines()]
    assert report.format_report() == [*lines, report.format_verdict()]
    assert lines[1:3] == ["delay margin      0.008 s", "                  advice: a gain"]
