"""Every example runs, and what it prints is right."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from colift.model import no_force
from examples import mixed_team
from tests.pinocchio_team import PinocchioTeam

EXAMPLES = sorted({*(Path(__file__).parents[1] / "examples").glob("*.py")} - {Path(mixed_team.__file__)})


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out


def test_the_mixed_team_prints_the_forces_that_pinocchio_finds(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(mixed_team.__file__, run_name="__main__")
    head, first, *rest = capsys.readouterr().out.splitlines()
    team = mixed_team.build()
    z = mixed_team.start(team)
    expected = PinocchioTeam(team).accelerate(z, mixed_team.inputs(team), no_force(team))
    printed = np.array([float(x) for x in re.findall(r"-?\d+\.\d+", first)[1:]])
    np.testing.assert_allclose(printed, expected.lam.ravel(), atol=1e-3)
    assert len(rest) == 4
    assert head.split()[2:5] == ["rear", "arm", "1"]
