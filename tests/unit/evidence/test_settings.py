"""Tests that all settings written by the evidence modules are accepted."""

from __future__ import annotations

import itertools

import pytest

from colift import scenario
from evidence import baselines, changes, generalization, react, redundant


@pytest.mark.parametrize("world", changes.ENVIRONMENTS)
def test_settings_of_changes(world):
    """The scenario of each environment accepts its changes."""
    name, made, _ = changes.ENVIRONMENTS[world]
    made = made(0) if callable(made) else made
    scenario.load_scenario(name, [changes.PREVIEW_SETTING, *made, "seed=0"])


def test_settings_of_random_environments():
    """Samples with and without lost labels, and with each delay."""
    drawn = [react.draw(sample)[1] for sample in range(12)]
    assert {one["label_failure_time_s"] is None for one in drawn} == {True, False}


@pytest.mark.parametrize("condition", generalization.CONDITIONS)
def test_settings_of_conditions(condition):
    """Each condition in which frozen models are simulated."""
    generalization.settings(condition, 0)


def test_settings_of_baselines_and_redundant_teams():
    """The grids of the baselines, and teams without a force sensor bias."""
    for point in itertools.chain.from_iterable(baselines.GRID.values()):
        scenario.load_scenario("paper", baselines.overrides(point))
    for team in redundant.TEAMS:
        scenario.load_scenario(team, [redundant.UNBIASED])
