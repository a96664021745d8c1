"""Shipped scenarios without their schema."""

from __future__ import annotations

from colift import scenario


def test_descriptions_are_those_of_the_loaded_scenarios():
    for name in scenario.shipped_names():
        assert scenario.shipped_description(name) == scenario.load_scenario(name).description
