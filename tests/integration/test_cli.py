"""Tests of the command line: arguments, output and exit status."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import click
import jax
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from colift import codegen, scenario
from colift.cli import common
from colift.cli.app import app
from colift.closed_loop import log
from colift.models import urdf
from colift.runtime import run_directory
from colift.scenario import experiment, team
from colift.scenario.cases import ALL_CASES
from colift.visualization import study_figures
from colift.workflows import study
from tests.support import random_logs as flights
from tests.support import small_team as light

PROMISED = {
    *(
        "e_p_rms_m",
        "e_v_rms_mps",
        "e_R_rms",
        "e_omega_rms_radps",
        "Psi_mean",
        "delta_W_rms",
        "e_lam_rms_N",
        "sigma_L_mean",
    ),
    *(
        "sigma_A_mean",
        "lam_max_N",
        "contact_force_hf_rms_N",
        "thrust_min_N",
        "thrust_max_N",
        "Phi_max_m",
        "Phi_dot_max_mps",
    ),
    *("wrench_consistency_max", "eta_max_N", "num_samples", "update_times_s", "wall_time_s"),
}
FIGURES = ("tracking", "mismatch", "deviation", "forces", "rho_bar")


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    return result.exit_code, result.stderr


@pytest.fixture(autouse=True)
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Suppress the figures of studies; fixture `flown` has drawn them before."""
    monkeypatch.setattr(study_figures, "write_figures", lambda *_: [])


def test_unknown_scenario_gives_one_line_and_status_2():
    status, message = invoke("study", "papr")
    assert status == 2
    assert message.count("\n") == 1
    assert "papr" in message
    assert "paper" in message


def test_list_and_print_config_have_json_output():
    listed = CliRunner().invoke(app, ["list", "--json"])
    assert list(json.loads(listed.stdout)) == scenario.shipped_names()
    shown = CliRunner().invoke(app, ["print-config", "paper", "--set", "payload.mass_kg=2", "--json"])
    assert json.loads(shown.stdout)["payload"]["mass_kg"] == 2


def test_settings_complete_by_path_and_entry_name():
    """Settings complete by their paths, and entries of lists by their names."""
    ctx = typer.Context(click.Command("run"))
    for name, found in (("paper", ["payload.mass_kg="]), (None, ["payload.mass_kg="]), ("papr", [])):
        ctx.params = {"name": name}
        assert common.complete_setting(ctx, "payload.m") == found
    paths = common.setting_paths(scenario.load_scenario("paper").model_dump(mode="json"))
    assert "disturbances.load_wind.mean_wind_mps" in paths
    assert all(
        scenario.load_scenario("paper", [f"{path}={value}"])
        for path, value in (("agents.rear.yaw_deg", 3), ("seed", 1))
    )


def test_duration_shortens_learning_with_a_warning(capsys: pytest.CaptureFixture[str]):
    """A run that is shorter than the learning phase shortens it; a run without any update prints a warning."""
    short = common.load_settings("paper", (), 5.0)
    assert (short.duration_s, short.learning.end_s, short.learning.update_times_s) == (5.0, 5.0, (2.0, 4.0))
    assert common.load_settings("paper", (), 12.0).learning == scenario.load_scenario("paper").learning
    assert common.load_settings("paper", ["learning.end_s=4", "learning.update_times_s=[2]"], 4.5).learning.end_s == 4
    longer = common.load_settings("paper", ["learning.end_s=25", "learning.update_times_s=[2, 24]"], 30.0)
    assert longer.learning.update_times_s == (2.0, 24.0)
    capsys.readouterr()
    assert common.load_settings("paper", (), 1.5).learning.end_s == 1.5
    assert "nothing is learned in 1.5 s: the first update is at 2 s" in capsys.readouterr().err
    with pytest.raises(scenario.ScenarioError) as refused:
        common.load_settings("paper", (), -1.0)
    assert str(refused.value).count("\n") == 0


def test_empty_list_of_cases_is_refused():
    assert invoke("study", "paper", "--case", "")[0] == 2


def test_unreadable_file_gives_one_line_and_status_2(tmp_path: Path):
    status, message = invoke("study", str(tmp_path / "none.yaml"))
    assert (status, message.count("\n")) == (2, 1)
    assert "none.yaml" in message


@pytest.mark.parametrize(
    ("original", "replacement", "answer"),
    [
        ("seed: 0", "seed: !!bool foo", "broken.yaml:8: seed: tags are not used in a scenario, got '!!bool'"),
        ("seed: 0", f"seed: {2**63}", "broken.yaml:8: seed: must be from 0 to 9223372036854775807"),
        ("name: paper", 'name: "\\ud800"', "broken.yaml:4: name: holds characters that are not text"),
        (
            "max_samples: 256",
            "max_samples: 9999",
            "learning.max_samples: the 24 outputs of the models would take 19.2 GB",
        ),
        ("duration_s: 20", "duration_s: 99999", "duration_s [s]: the log of this team at 500 Hz would take"),
        ("name: paper", "a: &a [*a]\nname: paper", "broken.yaml:4: is nested more than 20 deep"),
    ],
)
def test_invalid_file_gives_one_line_and_status_2(original: str, replacement: str, answer: str, tmp_path: Path):
    text = (Path(scenario.__file__).parent / "library" / "paper.yaml").read_text()
    assert original in text
    path = tmp_path / "broken.yaml"
    path.write_text(text.replace(original, replacement, 1))
    status, message = invoke("study", str(path), "--out", str(tmp_path / "out"))
    assert (status, message.count("\n")) == (2, 1)
    assert answer in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["study", "certify"])
@pytest.mark.parametrize("seed", ["-1", str(2**63), "1" * 31, "x"])
def test_seed_out_of_range_is_refused_with_status_2(command: str, seed: str, tmp_path: Path):
    status, message = invoke(command, "paper", "--seed", seed, "--out", str(tmp_path / "out"))
    assert status == 2
    assert "--seed" in message
    assert not (tmp_path / "out").exists()


def test_unwritable_folder_is_refused_before_simulation(tmp_path: Path):
    """A folder that cannot be written gives one line and status 2 before the simulation."""
    (tmp_path / "file").write_text("in the way")
    status, message = invoke("study", "paper", "--out", str(tmp_path / "file" / "out"))
    assert (status, message.count("\n")) == (2, 1)
    assert "cannot write to" in message
    status, message = invoke("study", "paper", "--out", str(tmp_path / "file"))
    assert (status, message) == (2, f"cannot write to {tmp_path / 'file'}: it is a file, not a folder\n")


def test_folder_in_use_by_another_process_is_refused(tmp_path: Path):
    """A folder to which another process writes is refused before the simulation."""
    with study.open_run_directory(scenario.load_scenario("paper"), tmp_path):
        for command in ("study", "certify"):
            status, message = invoke(command, "paper", "--out", str(tmp_path))
            assert (status, message.count("\n")) == (2, 1)
            assert f"{tmp_path} is in use: process {os.getpid()} on " in message


def test_foreign_file_in_folder_is_refused(tmp_path: Path):
    """A folder with a file of the same name from another program is refused before the simulation."""
    (tmp_path / "C1.nc").write_text("mine")
    status, message = invoke("study", "paper", "--out", str(tmp_path))
    assert (status, message.count("\n")) == (2, 1)
    assert "contains C1.nc, which colift did not write" in message
    assert [file.name for file in tmp_path.iterdir()] == ["C1.nc"]


def test_invalid_scenario_keeps_earlier_results(tmp_path: Path):
    """An invalid scenario leaves the files of earlier runs in place."""
    (tmp_path / "C1.nc").write_text(run_directory.run_id("0.1.0", "another"))
    status, _ = invoke("study", "papr", "--out", str(tmp_path))
    assert status == 2
    assert [file.name for file in tmp_path.iterdir()] == ["C1.nc"]


def test_allocation_without_internal_force_is_refused(tmp_path: Path):
    """Internal forces are refused, with the reason, if the allocation has none."""
    text = (Path(scenario.__file__).parent / "library" / "paper.yaml").read_text()
    split = "  kind: leader_follower\n  leader_contacts: [front/left, front/right, rear/left]"
    path = tmp_path / "split.yaml"
    path.write_text(text.replace("  kind: least_squares", split))
    status, message = invoke("study", str(path), "--out", str(tmp_path / "out"))
    assert status == 2
    assert "this allocation has no internal force" in message


def test_compiler_error_is_printed_with_status_2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The message of a failing compiler is printed without a traceback, with status 2."""

    def plans(settings: scenario.Scenario, cases: object) -> None:
        raise codegen.CompilerError("cc --version:\nexit status 1")

    monkeypatch.setattr(experiment, "make_experiments", plans)
    status, message = invoke("study", "paper", "--out", str(tmp_path))
    assert (status, message.splitlines()[1:]) == (2, ["cc --version:", "exit status 1"])


@pytest.mark.parametrize(("options", "flown"), [((), "rigid"), (("--engine", "mujoco"), "mujoco")])
def test_engine_option_replaces_that_of_the_scenario(options, flown, tmp_path, monkeypatch: pytest.MonkeyPatch):
    def plans(settings: scenario.Scenario, cases: object) -> None:
        raise scenario.ScenarioError(f"by {settings.physics.kind}")

    monkeypatch.setattr(experiment, "make_experiments", plans)
    status, message = invoke("study", "paper", *options, "--out", str(tmp_path))
    assert (status, message.splitlines()[-1]) == (2, f"by {flown}")


@pytest.mark.parametrize("command", [("study",), ("certify",), ("export", "c"), ("export", "mjcf"), ("export", "urdf")])
def test_overrides_are_validated_like_the_file(command: tuple[str, ...], tmp_path: Path):
    status, message = invoke(*command, "paper", "--set", "payload.mass_kg=x", "--out", str(tmp_path / "out"))
    assert (status, message) == (2, "--set payload.mass_kg [kg]: must be a number, got 'x'\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [("study",), ("certify",), ("export", "c")])
def test_duration_before_end_of_learning_is_reported(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def plans(settings: scenario.Scenario, *_: object) -> None:
        raise scenario.ScenarioError(f"until {settings.learning.end_s:g} s")

    monkeypatch.setattr(experiment, "make_experiment", plans)
    monkeypatch.setattr(experiment, "make_experiments", plans)
    status, message = invoke(*command, "paper", "--duration", "5", "--out", str(tmp_path / "out"))
    first, *_, last = message.splitlines()
    assert (status, first) == (2, "warning: learning ends with the run, at 5 s (learning.end_s is 10)")
    assert last == "until 5 s"
    assert invoke(*command, "paper", "--duration", "0.01")[1].startswith("--duration [s]: must be from 0.1 to")


@pytest.mark.parametrize(("kind", "holds"), [("csv", b"time [s],p x [m]"), ("mcap", b"/payload/pose")])
def test_exported_flights_are_written_beside_their_logs(kind: str, holds: bytes, tmp_path: Path):
    """Exported flights are written beside their logs; a second export replaces them."""
    settings = scenario.load_scenario("paper").model_dump_json(exclude_none=True)
    log.save(flights.dataset(np.random.default_rng(1), scenario_json=settings), tmp_path / "C2.nc")
    for _ in range(2):
        result = CliRunner().invoke(app, ["export", kind, str(tmp_path)], catch_exceptions=False)
        assert (result.exit_code, result.output) == (0, f"C2.{kind}: in {tmp_path}\n")
    original = tmp_path / f"C2.{kind}"
    assert holds in original.read_bytes()
    assert run_directory.read_run_id(original) == flights.RUN
    assert run_directory.list_files(tmp_path, study.STUDY_FILES) == sorted([tmp_path / "C2.nc", original])


@pytest.mark.parametrize("kind", ["csv", "mcap"])
def test_folder_without_logs_is_refused(kind: str, tmp_path: Path):
    status, message = invoke("export", kind, str(tmp_path))
    assert (status, message.count("\n")) == (2, 1)
    assert "contains no log" in message


def test_foreign_file_is_not_replaced(tmp_path: Path):
    log.save(flights.dataset(np.random.default_rng(1)), tmp_path / "C1.nc")
    (tmp_path / "C1.csv").write_text("mine")
    status, message = invoke("export", "csv", str(tmp_path))
    assert status == 2
    assert "contains C1.csv, which colift did not write" in message
    assert (tmp_path / "C1.csv").read_text() == "mine"


def test_each_agent_type_is_exported_as_urdf(tmp_path: Path):
    out = tmp_path / "made"
    result = CliRunner().invoke(app, ["export", "urdf", "paper", "--out", str(out)], catch_exceptions=False)
    settings = scenario.load_scenario("paper")
    files = sorted(f"{kind}.urdf" for kind in settings.agent_types)
    assert (result.exit_code, result.output) == (0, f"{', '.join(files)} of paper: in {out}\n")
    assert sorted(path.name for path in out.iterdir()) == files
    (kind,) = settings.agent_types.values()
    robot = urdf.load_urdf(out / files[0])
    assert [joint.name for joint in robot.joints] == [joint.name for joint in kind.joints]
    assert {f"{arm.name}_tip" for arm in kind.arms} < set(robot.links)
    back = urdf.make_agent(
        robot, [f"{arm.name}_tip" for arm in kind.arms], settings.agents[0].contact_positions_m, kind.thrust_max_N
    )
    for found, expected in zip(*map(jax.tree.leaves, (back, team.agent_models(settings).popitem()[1])), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-15)


def test_scenarios_are_listed():
    result = CliRunner().invoke(app, ["list"])
    assert result.exit_code == 0
    # lines of a description that is wrapped are indented
    names = [line.split()[0] for line in result.output.splitlines() if not line.startswith(" ")]
    assert names == scenario.shipped_names()


def test_shipped_scenario_is_printed_as_its_file():
    result = CliRunner().invoke(app, ["print-config", "paper"])
    assert result.exit_code == 0
    assert result.output == scenario.shipped_text("paper")


def test_changed_scenario_is_printed_with_all_settings(tmp_path: Path):
    """A scenario with overrides, or one from a file, is printed with every setting."""
    result = CliRunner().invoke(app, ["print-config", "paper", "--set", "payload.mass_kg=2"])
    assert result.exit_code == 0
    assert scenario.parse(result.output, "shown") == scenario.load_scenario("paper", ("payload.mass_kg=2",))
    of_file = CliRunner().invoke(app, ["print-config", str(light.write(tmp_path / "light.yaml"))])
    assert scenario.parse(of_file.output, "shown") == light.settings()
    assert "tip_force_bandwidth_Hz: 50.0" in of_file.output
    assert invoke("print-config", "papr")[0] == 2


SHORT = light.SAMPLE.learning.model_copy(update={"update_times_s": (1, 2), "end_s": 2})


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a short study of the smallest team with five cases, read from a file, with another seed."""
    folder = tmp_path_factory.mktemp("study")
    path = light.write(folder / "short.yaml", duration_s=3, learning=SHORT)
    status, message = invoke(
        "study",
        str(path),
        "--case",
        "C1,C2,C3",
        "--case",
        "Disturbance_Observer,PARAMETRIC",
        "--seed",
        "7",
        "--out",
        str(folder / "out"),
    )
    assert status == 0, message
    return folder / "out"


def test_study_writes_all_files(flown: Path):
    """A study writes all documented files and leaves no temporary file."""
    files = {path.name for path in flown.iterdir()}
    figures = {f"figure_{i}_{name}" for i, name in enumerate(FIGURES, 1)} | {"figure_8_contact_forces"}
    assert files >= {
        "summary.json",
        *(f"{case}.nc" for case in ("C1", "C2", "C3", "disturbance_observer", "parametric")),
    }
    assert files >= {f"{name}.{kind}" for name in figures for kind in ("pdf", "png")}
    assert files >= {f"lengthscales_{case}.{kind}" for case in ("C2", "C3") for kind in ("md", "csv")}
    assert not [name for name in files if name.startswith(".")]


def test_every_file_contains_the_run_id(flown: Path):
    assert set(flown.iterdir()) == set(run_directory.list_files(flown, study.STUDY_FILES))
    run = json.loads((flown / "summary.json").read_text())["run"]
    settings = scenario.load_scenario(str(flown.parent / "short.yaml"))
    with study.open_run_directory(settings.model_copy(update={"seed": 7}), flown) as out:
        assert out.run_id == run
    with pytest.raises(OSError, match="contains results of another run"), study.open_run_directory(settings, flown):
        pass
    assert {run_directory.read_run_id(file) for file in flown.iterdir()} == {run}


def test_summary_contains_all_documented_keys(flown: Path):
    summary = json.loads((flown / "summary.json").read_text())
    assert summary["seed"] == 7
    for found in summary["cases"].values():  # one contact has the largest force of the team
        peaks = [each["peak_N"] for each in found["contact_forces"].values()]
        assert max(peaks) == pytest.approx(found["lam_max_N"])
    assert {"version", "scenario", "residual"} <= set(summary)
    assert list(summary["cases"]) == ["C1", "C2", "C3", "disturbance_observer", "parametric"]
    for case, found in summary["cases"].items():
        assert set(found) >= PROMISED
        assert {"simulation", "fit", "output"} <= set(found["wall_time_s"])
        assert found["complete"]
        assert found["Phi_max_m"] <= 1e-10
        assert found["Phi_dot_max_mps"] <= 1e-10
        assert found["wrench_consistency_max"] <= 1e-9
        assert found["num_samples"]["payload"] == (38 if case in ("C2", "C3", "parametric") else 0)
        assert found["num_samples"]["agents"] == (3 * 38 if case == "C3" else 0)
        assert found["warnings"] == []
    assert summary["slowest_mode"]["stable"]
    assert summary["check"]["verdict"] in ("sound", "weak")
    assert summary["check"]["failed"] == []
    assert set(summary["hover_thrust_N"]) == set(light.NAMES)
    assert len(summary["termination_limits"]["min_delassus_singular_value_1pkg"]) == 3
    assert summary["cases"]["C3"]["update_times_s"] == [1, 2]
    unproven = summary["error_bound_assumptions"]["unproven_assumptions"]
    assert unproven == ["rkhs norm", "bounded noise energy", "sensor noise", "sampled estimator"]
    for found in summary["cases"].values():
        bodies = [found["error_bound"]["payload"], *found["error_bound"]["agents"]]
        assert [len(body["beta"]) for body in bodies] == [6, 6, 6, 6]
        assert all(0 <= share <= 1 for body in bodies for share in body["violation_rate"].values())


def test_signals_have_labels_and_units(flown: Path):
    flight = log.load(flown / "C3.nc")
    assert flight.attrs["case"] == "C3"
    assert flight.attrs["bound_assumptions"] == "rkhs norm, bounded noise energy, sensor noise, sampled estimator"
    assert (
        log.load(flown / "disturbance_observer.nc").attrs["bound_assumptions"]
        == f"{flight.attrs['bound_assumptions']}, posterior mean"
    )
    assert (flight.attrs["rho_bound"], flight.attrs["rho_rkhs_norm"]) == ("energy", 3)
    assert len(flight.attrs["rho_label_error_agents"]) == 18
    assert flight.attrs["limit_max_position_error_m"] == 3
    assert 0.001 < flight.attrs["limit_min_delassus_singular_value_1pkg"].max() < 0.01
    assert all("units" in flight[name].attrs for name in flight.data_vars)
    assert list(flight.contact.values) == [f"{name}/hook" for name in light.NAMES]


# Failed runs, and fast commands ---------------------------------------------------------------------------------------


def test_study_can_be_played_back(flown: Path, tmp_path: Path):
    for case in ("C1", "parametric"):
        shutil.copy(flown / f"{case}.nc", tmp_path)
    status, message = invoke("playback", str(tmp_path))
    assert (status, message) == (0, "")
    assert run_directory.read_run_id(tmp_path / "playback.html") == run_directory.read_run_id(flown / "C1.nc")
    assert log.load(flown / "C1.nc").attrs["scenario_json"].startswith('{"name":"sample"')


def test_a_second_study_keeps_the_cases_of_the_first(flown: Path, tmp_path: Path):
    """A study of a further case adds it to logs, figures and summary; pages of the first study are removed."""
    out, path = tmp_path / "out", flown.parent / "short.yaml"
    shutil.copytree(flown, out)
    (out / "report.html").write_text(json.loads((out / "summary.json").read_text())["run"])
    first = json.loads((out / "summary.json").read_text())
    status, said = invoke("study", str(path), "--case", "integral", "--seed", "7", "--out", str(out), "-q")
    assert status == 0
    assert all(line.startswith(("warning: C3: ", "warning: parametric: ")) for line in said.splitlines()), said
    second = json.loads((out / "summary.json").read_text())
    assert list(second["cases"]) == ["C1", "C2", "C3", "integral", "disturbance_observer", "parametric"]
    assert {case: second["cases"][case] for case in first["cases"]} == first["cases"]
    assert (out / "C1.nc").read_bytes() == (flown / "C1.nc").read_bytes()
    assert not (out / "report.html").exists()
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    status, said = invoke("study", str(path), "--case", "C1", "--seed", "8", "--out", str(out))
    assert (status, said.count("\n")) == (2, 1)
    assert "contains results of another run (sample, seed 7, colift " in said
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before
    (out / "summary.json").write_text(f'{{"run": "{first["run"]}"')
    status, said = invoke("study", str(path), "--case", "C1", "--seed", "7", "--out", str(out), "-q")
    assert (status, said.count("\n")) == (2, 1)
    assert f"{out / 'summary.json'}: the earlier study is damaged" in said


@pytest.mark.parametrize(
    ("options", "folder"),
    [
        ({}, "paper"),
        ({"seed": 3, "duration": 5.0}, "paper-seed3-5s"),
        ({"overrides": ["payload.mass_kg=2", "control.K_p=[1, 2, 3]"]}, "paper-payload.mass_kg=2-control.K_p=_1_2_3_"),
        ({"suffix": "-C1", "engine": common.Engine.MUJOCO}, "paper-C1-mujoco"),
    ],
)
def test_default_folder_contains_the_changes(options: dict, folder: str):
    assert common.results_folder(None, **options)(scenario.load_scenario("paper")) == Path("out") / folder
    assert common.results_folder(Path("mine"), **options)(scenario.load_scenario("paper")) == Path("mine")


def test_default_folder_shortens_many_changes():
    first, second = ([f"payload.mass_kg={1 + k / 100 + n}" for k in range(9)] for n in range(2))
    paper = scenario.load_scenario("paper")
    names = {common.results_folder(None, overrides)(paper).name for overrides in (first, second)}
    assert len(names) == 2
    assert all(len(name) < 40 for name in names)


def test_a_run_that_fails_is_saved_marked_incomplete_and_status(tmp_path: Path):
    """A run that fails is saved marked incomplete and status 1."""
    wild = light.SAMPLE.control.model_copy(update={"agent_k_omega": 2e3})
    path, out = light.write(tmp_path / "wild.yaml", control=wild), tmp_path / "out"
    out.mkdir()
    for name in ("integral.nc", "figure_6_certificate.pdf", "notes"):
        (out / name).write_text(f"of another run: {run_directory.run_id('0.1.0', 'another')}")
    status, message = invoke("study", str(path), "--out", str(out), "--replace")
    assert status == 1
    assert f"{out} contains results of another run" in message
    assert set(out.iterdir()) - set(run_directory.list_files(out, study.STUDY_FILES)) == {out / "notes"}
    assert not (out / "integral.nc").exists()
    summary = json.loads((out / "summary.json").read_text())
    assert "warning: the loop is unstable at equilibrium" in message.partition("C1")[0]
    for case in ("C1", "C2", "C3"):
        found = summary["cases"][case]
        assert not found["complete"]
        assert "beyond termination." in found["termination_reason"]
        assert "t = 0.0" in found["termination_reason"]
        assert f"{case} is incomplete: {found['termination_reason']}" in message
        flight = log.load(out / f"{case}.nc")
        assert flight.attrs["complete"] == 0
        assert flight.attrs["termination_reason"] == found["termination_reason"]
        assert 1 <= flight.sizes["time"] < 20


def test_quiet_run_prints_its_summary_as_json(tmp_path: Path, monkeypatch):
    """One case is simulated without progress output, and its summary is printed as JSON."""
    monkeypatch.chdir(tmp_path)
    learning = light.SAMPLE.learning.model_copy(update={"update_times_s": (0.5,), "end_s": 0.6, "start_s": 0.1})
    light.write(tmp_path / "short.yaml", duration_s=1.0, learning=learning)
    done = CliRunner().invoke(app, ["run", "short.yaml", "--case", "c1", "--quiet", "--json"], catch_exceptions=False)
    assert (done.exit_code, done.stderr) == (0, "")
    summary = json.loads(done.stdout)
    assert list(summary["cases"]) == ["C1"]
    assert summary == json.loads((tmp_path / "out" / "sample-C1" / "summary.json").read_text())
    assert log.load(tmp_path / "out" / "sample-C1" / "C1.nc").attrs["complete"] == 1
    arguments = ["study", "short.yaml", "--case", "C1", "--held-out", "--out", "held"]
    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0
    assert "simulating sample" in done.stderr.splitlines()
    found = json.loads((tmp_path / "held" / "summary.json").read_text())["held_out"]
    assert list(found) == ["C1"]
    assert list(found["C1"]) == ["backwards", "larger", "moved"]
    assert all(each["e_p_rms_m"] > 0 and each["termination_reason"] == "" for each in found["C1"].values())
    title = done.stdout.index("final model, frozen")
    assert f"{1e3 * found['C1']['moved']['e_p_rms_m']:.1f}" in done.stdout[title:]
    status, message = invoke("run", "short.yaml", "--case", "C9")
    assert (status, message) == (2, f"--case C9: must be one of {', '.join(ALL_CASES)}\n")


@pytest.mark.parametrize(
    ("words", "shown", "scenario_module"),
    [(["study", "--help"], "--baselines", "colift.scenario"), (["list"], "certified", "colift.scenario.schema")],
    ids=["help", "list"],
)
def test_help_and_list_do_not_import_heavy_packages(words: list[str], shown: str, scenario_module: str):
    code = (
        "import sys; from typer.testing import CliRunner; from colift.cli.app import app\n"
        f"done = CliRunner().invoke(app, {words})\n"
        f"assert done.exit_code == 0 and {shown!r} in done.output, done.output\n"
        f"heavy = ('matplotlib', 'numpy', 'scipy', 'xarray', {scenario_module!r}, 'colift.simulation')\n"
        "print(*(m for m in heavy if m in sys.modules))"
    )
    environment = os.environ | {"COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""


def complete(*words: str) -> list[str]:
    """Return the completions that a shell offers for the last word."""
    environment = {"COMP_WORDS": " ".join(("colift", *words)), "COMP_CWORD": str(len(words))}
    environment["_COLIFT_COMPLETE"] = "complete_bash"
    return CliRunner().invoke(app, [], prog_name="colift", env=environment).stdout.split()


def test_commands_scenarios_and_cases_complete_in_a_shell():
    assert complete("repo") == ["report"]
    assert complete("study", "pa") == [name for name in scenario.shipped_names() if name.startswith("pa")] != []
    assert complete("run", "paper", "--case", "C") == ["C1", "C2", "C3"]
    assert complete("playback", "out", "--case", "d") == ["disturbance_observer"]
    message = CliRunner().invoke(app, [], prog_name="colift", env={"_COLIFT_COMPLETE": "source_bash"})
    assert "complete -o default -F _colift_completion colift" in message.stdout
    assert "--install-completion" in CliRunner().invoke(app, ["--help"], env={"COLUMNS": "100"}).stdout


# Printed output -------------------------------------------------------------------------------------------------------


SHOW = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in a shell's background
from pathlib import Path
from colift.cli import app as command, common, study, tables
numbers = {metric.key: 1.0 for metric in tables.STUDY_METRICS}
numbers |= {"complete": True, "termination_reason": "", "warnings": []}
summary = {"scenario": "ladung \\u03bb", "seed": 1, "cases": {"C1": numbers}}
@command.app.command()
def table() -> None:
    with common.guard_output("; the results are in out"):
        study.print_study(summary, Path("out"))
command.main()
"""


def show(*arguments: str, **changed: object) -> subprocess.CompletedProcess[bytes]:
    """Run the command line in a child process with a command that only prints the table."""
    environment = {**os.environ, "COLUMNS": "120", **changed.pop("env", {})}  # ty: ignore
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "check": False, "timeout": 120} | changed
    return subprocess.run([sys.executable, "-c", SHOW, *(arguments or ("table",))], env=environment, **options)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8", "ascii:strict"])
def test_table_is_printed_in_any_encoding(encoding: str):
    """The table is printed in any encoding of the standard output."""
    done = show(env={"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"})
    assert (done.returncode, done.stderr) == (0, b"")
    message = done.stdout.decode(encoding.split(":")[0])
    assert "results in out" in message
    assert ("e_λ" if encoding == "utf-8" else "e_lam") in message


def test_table_is_printed_in_c_locale():
    done = show(env={"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"})
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"e_lam" in done.stdout


def test_ctrl_c_during_startup_has_no_traceback(tmp_path: Path):
    """Ctrl-C before the command line is parsed ends the process with one line and without a traceback."""
    (tmp_path / "typer.py").write_text("import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)\n")
    done = show(env={"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])})
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"interrupted\n")


def test_closed_pipe_is_no_failure():
    """A closed pipe, as of `colift study paper | head -1`, gives status 0."""
    reader, writer = os.pipe()
    os.close(reader)
    done = show(stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
@pytest.mark.parametrize("argument", ["table", "--help", "list"])
def test_output_to_full_disk_gives_one_line_and_status_1(argument: str):
    with Path("/dev/full").open("w") as full:
        done = show(argument, stdout=full)
    assert done.returncode == 1
    lost = "; the results are in out" if argument == "table" else ""
    assert done.stderr.decode() == f"cannot print: No space left on device{lost}\n"


def test_closed_standard_output_is_no_failure():
    closed = ["sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-c", SHOW, "table"]
    done = subprocess.run(closed, capture_output=True, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (0, b"")
