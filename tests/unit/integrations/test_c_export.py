"""The pilot's tick as C: the commands of Python, from code that needs nothing but the math library."""

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
from colift.scenario import experiment
from tests.support import small_team as light

TICKS = 500
STRICT = ("-std=c99", "-pedantic", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Wvla", "-Wno-psabi", "-Werror")

if build.compiler() is None:
    pytest.skip("no C compiler", allow_module_level=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """C3 of the smallest team with what it learned in two seconds, and what followed."""
    path = tmp_path_factory.mktemp("c")
    learning = light.SAMPLE.learning.model_copy(update={"update_times_s": [2.0]})
    plan = experiment.make_experiment(light.settings(learning=learning, sensors={}), "C3")
    flown = flight.run_experiment(dataclasses.replace(plan, duration=2.1))
    assert int(flown.model.payload.num_points) > 10
    c_export.export_c(plan, flown.model, TICKS, path, "light, C3")
    return path


def built(folder: Path, *flags: str) -> Path:
    """The replay, compiled with the least that a compiler is asked for."""
    (command, *_) = build.require_compiler()
    program = folder / "-".join(["replay", *flags])
    sources = [folder / name for name in ("colift.c", "learned.c", "replay.c")]
    done = subprocess.run(
        [command, *STRICT, *flags, "-o", program, *sources, "-lm"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[:2000]
    return program


def replayed(program: Path, flight: Path) -> dict[str, float]:
    done = subprocess.run([program, flight], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {name: float(value) for name, value in (line.split() for line in done.stdout.splitlines())}


@pytest.fixture(scope="module")
def program(folder: Path) -> Path:
    return built(folder)


def test_commands_of_a_replayed_flight_are_python_s(folder: Path, program: Path):
    found = replayed(program, folder / "flight.bin")
    assert found["steps"] == TICKS
    assert found["max_relative_difference"] < 1e-12


def test_a_compiler_without_vectors_takes_one_number_at_a_time(folder: Path):
    found = replayed(built(folder, "-DONE_LANE"), folder / "flight.bin")
    assert found["max_relative_difference"] < 1e-12


@pytest.mark.parametrize("lanes", [(), ("-DONE_LANE",)])
def test_in_single_precision_they_are_so_to_its_rounding(lanes: tuple[str, ...], folder: Path):
    found = replayed(built(folder, "-DCOLIFT_FLOAT32", *lanes), folder / "flight.bin")
    assert 1e-9 < found["max_relative_difference"] < 1e-3


def test_another_flight_is_not_this_one(folder: Path, program: Path, tmp_path: Path):
    """So a replay can fail."""
    rows = np.fromfile(folder / "flight.bin").reshape(TICKS + 1, -1)
    rows[:, 5] += 1e-6
    rows.tofile(tmp_path / "moved.bin")
    assert replayed(program, tmp_path / "moved.bin")["max_relative_difference"] > 1e-9
    (tmp_path / "short.bin").write_bytes(b"12345678")
    done = subprocess.run([program, tmp_path / "short.bin"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (
        2,
        f"{tmp_path / 'short.bin'}: not a recorded flight of this controller\n",
    )
    assert subprocess.run([program], capture_output=True, check=False).returncode == 2


def test_the_code_allocates_nothing_has_no_threads_and_no_state(folder: Path):
    """The code allocates nothing has no threads and no state of its own."""
    code = (folder / "colift.c").read_text()
    assert set(re.findall(r"#include <(.*)>", code)) == {"math.h", "stdint.h", "string.h"}
    assert not re.search(r"\b(?:malloc|calloc|free|allocate|aligned_alloc|pthread\w*|_Thread_local)\b", code)
    kept = set(re.findall(r"^static (?!inline|const|void)[^(\n]*;", code, re.MULTILINE))
    assert kept == {"static int integer_overflow;"}


def test_members_are_the_paths_of_the_pytrees_with_units(folder: Path):
    header = (folder / "colift.h").read_text()
    assert "  colift_real payload_p[3]; /* m */" in header
    assert "  colift_real agents_0_lam[9]; /* N, frame of the tip, 3 x 1 x 3 */" in header
    assert "  colift_real agents_0_u[3]; /* N */" in header
    assert "tau_r" not in header.partition("colift_command;")[0].rpartition("typedef")[2], "no joints, no member"


def test_what_was_learned_is_a_block_of_its_own(folder: Path):
    """Another block behind the pointer: what was learned is in no other file, and nothing learned is zero."""
    learned = (folder / "learned.c").read_text()
    assert learned.count("const colift_model colift_trained_model = {") == 1
    (alpha,) = re.findall(r"\.payload_alpha = \{(.*?)\}", learned)
    assert max(abs(float(x)) for x in alpha.split(", ")) > 0
    assert re.search(r"\.payload_X = \{", learned)
    assert "payload_W" not in learned, "a mean needs no factor"


@pytest.mark.long
def test_a_replay_is_the_flight_that_native_code_flies():
    plan = experiment.make_experiment(light.settings(), "C1")
    _, flown = c_export.replay(plan, plan.controller.residual_model, 50)
    setup = plan.loop_config
    noise = plan.world.sample_noise(jax.random.key(plan.seed), 50)
    _, rows = simulator.rollout(setup, simulator.reset(setup, plan.initial_state), noise, jax.numpy.asarray(50))
    np.testing.assert_allclose(np.asarray(flown.command[0].u), rows.u, atol=1e-9)
    assert isinstance(plan.controller.residual_model, residual_model.ResidualModel)


def test_on_the_command_line_an_unknown_case_is_one_line(tmp_path: Path):
    """On the command line an unknown case is one line and status 2."""
    result = CliRunner().invoke(app, ["export", "c", "paper", "--case", "C9", "--out", str(tmp_path / "c")])
    assert result.exit_code == 2
    assert result.stderr == f"--case C9: must be one of {', '.join(experiment.ALL_CASES)}\n"
    assert not (tmp_path / "c").exists()


@pytest.mark.long
@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake")
def test_cmake_builds_it(folder: Path, tmp_path: Path):
    subprocess.run(["cmake", "-S", folder, "-B", tmp_path], check=True, capture_output=True)
    subprocess.run(["cmake", "--build", tmp_path], check=True, capture_output=True)
    assert replayed(tmp_path / "replay", folder / "flight.bin")["max_relative_difference"] < 1e-12
