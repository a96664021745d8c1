"""Tests of the exported C controller: it repeats Python's commands and requires only the math library."""

from __future__ import annotations

import dataclasses
import re
import shutil
import subprocess
from pathlib import Path

import jax
import numpy as np
import pytest
from typer.testing import CliRunner

from colift.cli.app import app
from colift.closed_loop import flight, simulator
from colift.codegen import build
from colift.integrations import c_export
from colift.onboard.learning import residual_model
from colift.scenario import experiment, schema
from colift.scenario.cases import ALL_CASES
from tests.support import small_team as light

TICKS = 500
STRICT = ("-std=c99", "-pedantic", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Wvla", "-Wno-psabi", "-Werror")

if build.compiler() is None:
    pytest.skip("no C compiler", allow_module_level=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Exported C3 of the smallest team, with the model of the first two seconds and the steps after them."""
    path = tmp_path_factory.mktemp("c")
    learning = light.SAMPLE.learning.model_copy(update={"update_times_s": [2.0]})
    c3 = experiment.make_experiment(light.settings(learning=learning, sensors={}), "C3")
    flown = flight.run_experiment(dataclasses.replace(c3, duration=2.1))
    assert int(flown.model.payload.num_points) > 10
    c_export.export_c(c3, flown.model, TICKS, path, "light, C3")
    return path


def compile_replay(folder: Path, *flags: str) -> Path:
    """Compile the replay program with few compiler options and return its path."""
    (command, *_) = build.require_compiler()
    program = folder / "-".join(["replay", *flags])
    sources = [folder / name for name in ("colift.c", "learned.c", "replay.c")]
    done = subprocess.run(
        [command, *STRICT, *flags, "-o", program, *sources, "-lm"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[:2000]
    return program


def run_replay(program: Path, flight: Path) -> dict[str, float]:
    done = subprocess.run([program, flight], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {name: float(value) for name, value in (line.split() for line in done.stdout.splitlines())}


@pytest.fixture(scope="module")
def program(folder: Path) -> Path:
    return compile_replay(folder)


def test_replayed_commands_equal_python(folder: Path, program: Path):
    found = run_replay(program, folder / "flight.bin")
    assert found["steps"] == TICKS
    assert found["max_relative_difference"] < 1e-12


@pytest.mark.long
def test_allocation_within_limits_equals_python(tmp_path: Path):
    """The exported code contains the iterations of the cone program, at a thrust limit below the team's need."""
    allocation = schema.ConstrainedAllocation(kind="constrained", tilt_deg=20)
    c1 = experiment.make_experiment(light.settings(allocation=allocation, sensors={}), "C1")
    groups = tuple(
        dataclasses.replace(group, thrust_max=0 * group.thrust_max + 19) for group in c1.controller.team.agent_groups
    )
    team = dataclasses.replace(c1.controller.team, agent_groups=groups)
    c1 = dataclasses.replace(c1, controller=dataclasses.replace(c1.controller, team=team))
    records = flight.run_experiment(dataclasses.replace(c1, duration=0.4)).records
    assert records.thrust_limited is not None
    assert records.thrust_limited.any()
    c_export.export_c(c1, c1.controller.residual_model, 200, tmp_path, "light, C1")
    found = run_replay(compile_replay(tmp_path), tmp_path / "flight.bin")
    assert found["max_relative_difference"] < 1e-9


def test_scalar_code_equals_python(folder: Path):
    found = run_replay(compile_replay(folder, "-DONE_LANE"), folder / "flight.bin")
    assert found["max_relative_difference"] < 1e-12


@pytest.mark.parametrize("lanes", [(), ("-DONE_LANE",)])
def test_single_precision_equals_python_to_rounding(lanes: tuple[str, ...], folder: Path):
    found = run_replay(compile_replay(folder, "-DCOLIFT_FLOAT32", *lanes), folder / "flight.bin")
    assert 1e-9 < found["max_relative_difference"] < 1e-3


def test_replay_detects_another_flight(folder: Path, program: Path, tmp_path: Path):
    """The replay can fail."""
    rows = np.fromfile(folder / "flight.bin").reshape(TICKS + 1, -1)
    rows[:, 5] += 1e-6
    rows.tofile(tmp_path / "moved.bin")
    assert run_replay(program, tmp_path / "moved.bin")["max_relative_difference"] > 1e-9
    (tmp_path / "short.bin").write_bytes(b"12345678")
    done = subprocess.run([program, tmp_path / "short.bin"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (
        2,
        f"{tmp_path / 'short.bin'}: not a recorded flight of this controller\n",
    )
    assert subprocess.run([program], capture_output=True, check=False).returncode == 2


def test_code_has_no_allocation_threads_or_global_state(folder: Path):
    """The code allocates no memory, uses no threads and has no global state."""
    code = (folder / "colift.c").read_text()
    assert set(re.findall(r"#include <(.*)>", code)) == {"math.h", "stdint.h", "string.h"}
    assert not re.search(r"\b(?:malloc|calloc|free|allocate|aligned_alloc|pthread\w*|_Thread_local)\b", code)
    kept = set(re.findall(r"^static (?!inline|const|void)[^(\n]*;", code, re.MULTILINE))
    assert kept == {"static int integer_overflow;"}


def test_struct_members_are_pytree_paths_with_units(folder: Path):
    header = (folder / "colift.h").read_text()
    assert "  colift_real payload_p[3]; /* m */" in header
    assert "  colift_real agents_0_lam[9]; /* N, frame of the tip, 3 x 1 x 3 */" in header
    assert "  colift_real agents_0_u[3]; /* N */" in header
    assert "tau_r" not in header.partition("colift_command;")[0].rpartition("typedef")[2], "no joints, no member"


def test_learned_model_is_a_separate_block(folder: Path):
    """The learned model can be replaced by another block behind the pointer; it is nonzero and in one file only."""
    learned = (folder / "learned.c").read_text()
    assert learned.count("const colift_model colift_trained_model = {") == 1
    (alpha,) = re.findall(r"\.payload_alpha = \{(.*?)\}", learned)
    assert max(abs(float(x)) for x in alpha.split(", ")) > 0
    assert re.search(r"\.payload_X = \{", learned)
    assert "payload_W" not in learned, "the predicted mean needs no Cholesky factor"


@pytest.mark.long
@pytest.mark.parametrize("case", ["adaptive", "label_feedback"])
def test_residual_correctors_are_exported(case: str, tmp_path: Path):
    made = experiment.make_experiment(light.settings(), case)
    c_export.export_c(made, made.controller.residual_model, 50, tmp_path, f"light, {case}")
    found = run_replay(compile_replay(tmp_path), tmp_path / "flight.bin")
    assert found["steps"] == 50
    assert found["max_relative_difference"] < 1e-12


@pytest.mark.long
def test_replay_equals_the_native_simulation():
    c3 = experiment.make_experiment(light.settings(), "C1")
    _, flown = c_export.replay(c3, c3.controller.residual_model, 50)
    setup = c3.loop_config
    noise = c3.world.sample_noise(jax.random.key(c3.seed), 50)
    _, rows = simulator.rollout(setup, simulator.reset(setup, c3.initial_state), noise, jax.numpy.asarray(50))
    np.testing.assert_allclose(np.asarray(flown.command[0].u), rows.u, atol=1e-9)
    assert isinstance(c3.controller.residual_model, residual_model.ResidualModel)


def test_unknown_case_gives_one_line_and_status_2(tmp_path: Path):
    """On the command line an unknown case gives one line and status 2."""
    result = CliRunner().invoke(app, ["export", "c", "paper", "--case", "C9", "--out", str(tmp_path / "c")])
    assert result.exit_code == 2
    assert result.stderr == f"--case C9: must be one of {', '.join(ALL_CASES)}\n"
    assert not (tmp_path / "c").exists()


@pytest.mark.long
@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake")
def test_cmake_builds_the_export(folder: Path, tmp_path: Path):
    subprocess.run(["cmake", "-S", folder, "-B", tmp_path], check=True, capture_output=True)
    subprocess.run(["cmake", "--build", tmp_path], check=True, capture_output=True)
    assert run_replay(tmp_path / "replay", folder / "flight.bin")["max_relative_difference"] < 1e-12
