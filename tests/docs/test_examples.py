"""Tests of the values that examples print; test_documentation.py tests that all examples run."""

from __future__ import annotations

import importlib
import re

import numpy as np
import pytest

from colift.models.state import zero_residual
from tests.support.pinocchio_team import PinocchioTeam

own_team = importlib.import_module("examples.02_own_team")


def test_own_team_example_prints_pinocchio_forces(capsys: pytest.CaptureFixture[str]) -> None:
    own_team.main()
    head, first, *rest = capsys.readouterr().out.splitlines()
    team = own_team.build()
    z = own_team.start(team)
    expected = PinocchioTeam(team).solve_kkt(z, own_team.inputs(team), zero_residual(team))
    printed = np.array([float(x) for x in re.findall(r"-?\d+\.\d+", first)[1:]])
    np.testing.assert_allclose(printed, expected.lam.ravel(), atol=1e-3)
    assert len(rest) == 4
    assert head.split()[2:5] == ["rear", "arm", "1"]
