"""Tests of the feasibility report of the paper's study, and of one with weaker rotors."""

from __future__ import annotations

import pytest

from colift.analysis import feasibility, stability
from colift.scenario import experiment
from tests.support import paper_flights as paper


def test_report_has_slowest_mode_and_thrust_margin(monkeypatch):
    """The report states the slowest mode and the remaining thrust."""
    c1 = {"C1": paper.paper_experiment("C1")}
    linearize, found = stability.equilibrium_and_jacobian, []

    def linearize_once(*arguments):
        """The linearization takes seconds, and rotors with other limits have the same."""
        if not found:
            found.append(linearize(*arguments))
        return found[0]

    monkeypatch.setattr(stability, "equilibrium_and_jacobian", linearize_once)
    ahead = feasibility.assess_feasibility(paper.SETTINGS, c1)
    assert ahead.warnings == ()
    assert ahead.summary["check"]["failed"] == []
    assert ahead.check.format_verdict().startswith(f"paper: {ahead.summary['check']['verdict']}")
    assert ahead.summary["slowest_mode"]["stable"]
    assert ahead.summary["slowest_mode"]["eigenvalue_radps"][0] < 0
    margins = ahead.summary["stability_margins"]
    assert 0.004 <= margins["delay_margin_s"] <= 0.05
    assert margins["gain_margin"][0] < 0.8 < 1.2 < margins["gain_margin"][1]
    assert margins["description"].startswith("delay margin ")
    assert list(ahead.hover_thrust) == ["front", "rear"]
    narrow = feasibility.assess_feasibility(
        paper.with_weaker_rotors(30.0), {"C1": experiment.make_experiment(paper.with_weaker_rotors(30.0), "C1")}
    )
    assert [warning.partition(" N of ")[2] for warning in narrow.warnings] == [
        "30 N to hover: the margin of 5.5% is below 10%",
        "30 N to hover: the margin of 7.1% is below 10%",
    ]
    assert [warning.partition(" needs ")[0] for warning in narrow.warnings] == ["front", "rear"]


@pytest.mark.long
def test_unstable_equilibrium_gives_a_warning():
    """A loop that is unstable at equilibrium gives a warning before the simulation."""
    ahead = feasibility.assess_feasibility(
        paper.SETTINGS, {"C1": paper.with_gains(paper.paper_experiment("C1"), agent_k_omega=paper.number(1e3))}
    )
    (warning,) = ahead.warnings
    assert warning.startswith("the loop is unstable at equilibrium: slowest mode +")
    assert ahead.summary["slowest_mode"]["stable"] is False
    assert ahead.summary["stability_margins"] is None
