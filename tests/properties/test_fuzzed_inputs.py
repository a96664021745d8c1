"""Tests that every reader reads or refuses mutated inputs; `evidence/fuzz.py` uses more of them."""

from __future__ import annotations

import pytest

from tests.support import fuzz_readers

INPUTS = {"scenario": 10, "override": 10, "migration": 10, "log": 15, "pose_table": 60}
FIRST = 1_000_000  # seeds that the evidence does not use


@pytest.mark.parametrize("name", fuzz_readers.READERS)
def test_mutated_inputs_are_read_or_refused(name, tmp_path):
    if name == "mjcf":
        pytest.importorskip("mujoco")
    found = [fuzz_readers.check(name, FIRST + k, tmp_path) for k in range(INPUTS.get(name, 300))]
    assert [fault for fault in found if fault] == []
    assert "" in found


@pytest.mark.parametrize("name", sorted(fuzz_readers.READERS.keys() - {"override", "scenario", "migration", "log"}))
def test_some_mutated_inputs_are_still_valid(name, tmp_path):
    """If all inputs are refused at once, the harness reaches no code behind the first check."""
    if name == "mjcf":
        pytest.importorskip("mujoco")
    assert any(fuzz_readers.check(name, FIRST + k, tmp_path) is None for k in range(200))
