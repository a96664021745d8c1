"""Tests of the settings in which two scenarios differ."""

from __future__ import annotations

from colift.scenario import differences


def test_differences_have_paths_and_both_values():
    first = {"a": {"b": 1, "c": None}, "list": [{"x": 1}, {"x": 2}], "point": [0, 1]}
    second = {"a": {"b": 2, "c": 3}, "list": [{"x": 1}], "point": [0, 2]}
    assert differences.setting_differences(first, second) == [
        ("a.b", "1", "2"),
        ("list.1.x", "2", "absent"),
        ("point", "[0, 1]", "[0, 2]"),
        ("a.c", "absent", "3"),
    ]
    assert differences.setting_differences(first, first) == []
