"""What is known of the paper's study, and of one with weaker rotors, before they are flown."""

from __future__ import annotations

import pytest

from colift.analysis import feasibility, stability
from colift.scenario import experiment
from tests.support import paper_flights as paper


def test_what_is_known_before_a_flight_is_the_slowest_mode(monkeypatch):
    """What is known before a flight is the slowest mode and how much thrust is left."""
    plan = {"C1": paper.plan("C1")}
    linearize, found = stability.equilibrium_and_jacobian, []

    def once(*arguments):
        """The linearization takes seconds, and rotors with other limits have the same."""
        if not found:
            found.append(linearize(*arguments))
        return found[0]

    monkeypatch.setattr(stability, "equilibrium_and_jacobian", once)
    ahead = feasibility.assess_feasibility(paper.SETTINGS, plan)
    assert ahead.warnings == ()
    assert ahead.summary["slowest_mode"]["stable"]
    assert ahead.summary["slowest_mode"]["rad_s"][0] < 0
    margins = ahead.summary["margins"]
    assert 0.004 <= margins["delay_s"] <= 0.05
    assert margins["gain"][0] < 0.8 < 1.2 < margins["gain"][1]
    assert margins["says"].startswith("delay margin ")
    assert list(ahead.hover_thrust) == ["front", "rear"]
    narrow = feasibility.assess_feasibility(
        paper.lighter(30.0), {"C1": experiment.make_experiment(paper.lighter(30.0), "C1")}
    )
    assert [warning.partition(" N of ")[2] for warning in narrow.warnings] == [
        "30 N to hover: the margin of 5.5% is below termination.hover_thrust_margin = 0.1",
        "30 N to hover: the margin of 7.1% is below termination.hover_thrust_margin = 0.1",
    ]
    assert [warning.partition(" needs ")[0] for warning in narrow.warnings] == ["front", "rear"]


@pytest.mark.long
def test_a_loop_that_is_unstable_at_rest_is_a_warning_before():
    """A loop that is unstable at rest is a warning before the flight."""
    ahead = feasibility.assess_feasibility(
        paper.SETTINGS, {"C1": paper.with_gains(paper.plan("C1"), agent_k_omega=paper.number(1e3))}
    )
    (warning,) = ahead.warnings
    assert warning.startswith("the loop is unstable at equilibrium: slowest mode +")
    assert ahead.summary["slowest_mode"]["stable"] is False
    assert ahead.summary["margins"] is None
