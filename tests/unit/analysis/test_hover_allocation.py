"""Tests of the check that the limits of the allocation permit hover."""

from __future__ import annotations

from colift.analysis import hover_allocation, preflight
from colift.analysis.findings import Level
from colift.scenario import Scenario, experiment, initial_states, schema
from colift.scenario.schema.shared import ContactLimits
from tests.support import small_team as light


def limited(**limits: float) -> Scenario:
    """Return the small team with limits of its allocation."""
    contact = ContactLimits(**limits)
    return light.settings(allocation=schema.ConstrainedAllocation(kind="constrained", contact=contact))


def findings(settings: Scenario) -> list:
    """Return the findings of the check at rest."""
    plan = experiment.make_experiment(settings, "C1")
    state = initial_states.equilibrium_state(settings, plan.world.team)
    return list(hover_allocation.check_allocation(settings, plan.controller, state))


def test_limits_that_permit_hover_have_no_finding():
    share = 9.81 * float(experiment.make_experiment(limited(), "C1").controller.team.payload.mass) / 3
    assert not findings(light.settings())
    assert not findings(limited())
    assert not findings(limited(max_force_N=1.1 * share))
    (found,) = findings(limited(max_force_N=0.9 * share))
    assert found.level is Level.failed


def test_active_limits_and_their_settings_are_named():
    """Contacts that bear almost nothing: the payload falls, and the check ends before the linearization."""
    report = preflight.run_preflight(limited(max_force_N=1e-3))
    found = report.findings[-1]
    assert (found.subject, found.level) == ("allocation", Level.failed)
    assert found.values["acceleration_mps2"][2] < -5
    assert "contact force (n0/hook, n1/hook, n2/hook)" in found.message
    assert "allocation.contact.max_force_N" in found.advice[0]
