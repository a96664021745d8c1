"""Random URDF trees: `init` refuses one in a sentence that names a part of it, or what it writes loads."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from colift import scenario
from colift.cli.app import app
from tests.unit.models import test_urdf as trees

MAX_CHECK_TIME = 60.0  # s of processor time


def written(seed: int, folder: Path) -> tuple[Path, Result]:
    """The outcome of `init` with a tree of 2 to 24 links, in which names are odd and parts are missing now and then."""
    rng = np.random.default_rng(seed)
    text, _ = trees.random_urdf(rng, int(rng.integers(2, 16)))
    if rng.uniform() < 0.3:
        text = text.replace('"joint ', '"drone/joint:').replace('"a', '"1 a')
    if rng.uniform() < 0.2:
        text = re.sub(r'mass value="[^"]*"', 'mass value="0"', text, count=1)
    if rng.uniform() < 0.2:
        text = re.sub(r'izz="[^"]*"', 'izz="9"', text, count=1)
    if rng.uniform() < 0.2:
        text = text.replace('lower="-1" upper="1"', 'lower="0.4" upper="1"')
    file, made = folder / "vehicle.urdf", folder / "mine.yaml"
    file.write_text(text, encoding="utf-8")
    return made, CliRunner().invoke(app, ["init", str(made), "--urdf", str(file)])


def test_what_init_writes_loads(tmp_path: Path) -> None:
    outcomes = []
    for seed in range(30):
        folder = tmp_path / str(seed)
        folder.mkdir()
        made, done = written(seed, folder)
        outcomes.append(done.exit_code)
        if done.exit_code == 0:
            scenario.load_scenario(made)
        else:
            assert (done.exit_code, done.stderr.count("\n")) == (2, 1), (seed, done.output)
            assert re.search(r"link|joint|tips?\b", done.stderr), (seed, done.stderr)
            assert not made.exists()
    assert {0, 2} == set(outcomes)  # trees of both kinds are among them


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_what_init_writes_is_checked(seed: int, tmp_path: Path) -> None:
    made, done = written(seed, tmp_path)
    if done.exit_code == 0:
        start = time.process_time()
        checked = CliRunner().invoke(app, ["check", str(made), "--quiet"])
        assert checked.exit_code in (0, 1), checked.output
        assert time.process_time() - start < MAX_CHECK_TIME
