"""The command line: what a person types, what comes back, and with which status."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from colift import log, scenario
from colift.__main__ import app

PROMISED = {
    *("e_p_rms_m", "e_v_rms", "e_R_rms", "e_omega_rms", "Psi_mean", "delta_W_rms", "e_lam_rms_N", "sigma_L_mean"),
    *("sigma_A_mean", "lam_max_N", "lam_hf_rms_N", "thrust_min_N", "thrust_max_N", "Phi_max_m", "Phi_dot_max"),
    *("wrench_consistency_max", "eta_max_N", "n_data", "updates", "wall_s"),
}
FIGURES = ("tracking", "mismatch", "deviation", "forces", "rho_bar")


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    return result.exit_code, result.stderr


def test_an_unknown_scenario_is_one_line_and_status_2():
    status, said = invoke("study", "papr")
    assert status == 2
    assert said.count("\n") == 1
    assert "papr" in said
    assert "paper" in said


def test_a_file_that_cannot_be_read_is_one_line_and_status_2(tmp_path: Path):
    status, said = invoke("study", str(tmp_path / "none.yaml"))
    assert (status, said.count("\n")) == (2, 1)
    assert "none.yaml" in said


@pytest.mark.parametrize(
    ("written", "instead", "answer"),
    [
        ("seed: 0", "seed: !!bool foo", "broken.yaml:7: seed: tags are not used in a scenario, got '!!bool'"),
        ("seed: 0", f"seed: {2**63}", "broken.yaml:7: seed: must be from 0 to 9223372036854775807"),
        ("name: paper", 'name: "\\ud800"', "broken.yaml:3: name: holds characters that are not text"),
        ("capacity: 256", "capacity: 9999", "learning.capacity: the 24 outputs of the models would take 19.2 GB"),
        ("duration_s: 20", "duration_s: 99999", "duration_s [s]: the log of this team at 500 Hz would take"),
        ("name: paper", "a: &a [*a]\nname: paper", "broken.yaml:3: is nested more than 20 deep"),
    ],
)
def test_a_broken_file_is_one_line_and_status_2(written: str, instead: str, answer: str, tmp_path: Path):
    text = (Path(scenario.__file__).parent.parent / "scenarios" / "paper.yaml").read_text()
    assert written in text
    path = tmp_path / "broken.yaml"
    path.write_text(text.replace(written, instead, 1))
    status, said = invoke("study", str(path), "--out", str(tmp_path / "out"))
    assert (status, said.count("\n")) == (2, 1)
    assert answer in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["study", "certify"])
@pytest.mark.parametrize("seed", ["-1", str(2**63), "1" * 31, "x"])
def test_a_seed_that_no_generator_takes_is_refused_with_status_2(command: str, seed: str, tmp_path: Path):
    status, said = invoke(command, "paper", "--seed", seed, "--out", str(tmp_path / "out"))
    assert status == 2
    assert "--seed" in said
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_one_line_and_status_2_before_any_flight(tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    status, said = invoke("study", "paper", "--out", str(tmp_path / "file" / "out"))
    assert (status, said.count("\n")) == (2, 1)
    assert "cannot write to" in said


def test_internal_forces_that_do_not_exist_are_refused_with_the_reason(tmp_path: Path):
    text = (Path(scenario.__file__).parent.parent / "scenarios" / "paper.yaml").read_text()
    split = "  kind: leader_follower\n  leader_contacts: [front/left, front/right, rear/left]"
    path = tmp_path / "split.yaml"
    path.write_text(text.replace("  kind: balanced", split))
    status, said = invoke("study", str(path), "--out", str(tmp_path / "out"))
    assert status == 2
    assert "no eta exists" in said


def test_scenarios_are_listed():
    result = CliRunner().invoke(app, ["scenarios"])
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.output.splitlines()] == scenario.names()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short study with all rivals, from a file, under another seed."""
    folder = tmp_path_factory.mktemp("study")
    text = (Path(scenario.__file__).parent.parent / "scenarios" / "paper.yaml").read_text()
    short = re.sub(r"duration_s: 20", "duration_s: 3", text)
    short = short.replace("  end_s: 10\n", "  end_s: 2\n")
    short = re.sub(r"update_times_s: .*", "update_times_s: [1, 2]", short)
    (folder / "short.yaml").write_text(re.sub(r"max_iterations: .*", "max_iterations: 5", short))
    status, said = invoke(
        "study", str(folder / "short.yaml"), "--baselines", "--seed", "7", "--out", str(folder / "out")
    )
    assert status == 0, said
    return folder / "out"


def test_a_study_leaves_what_it_promises_and_nothing_half_written(results: Path):
    files = {path.name for path in results.iterdir()}
    figures = {f"figure_{i}_{name}" for i, name in enumerate(FIGURES, 1)}
    assert files >= {"summary.json", *(f"{case}.nc" for case in ("C1", "C2", "C3", "I", "DOB", "P", "O"))}
    assert files >= {f"{name}.{kind}" for name in figures for kind in ("pdf", "png")}
    assert files >= {f"lengthscales_{case}.{kind}" for case in ("C2", "C3") for kind in ("md", "csv")}
    assert not [name for name in files if name.startswith(".")]


def test_the_summary_holds_what_it_promises(results: Path):
    summary = json.loads((results / "summary.json").read_text())
    assert summary["seed"] == 7
    assert {"version", "scenario", "residual"} <= set(summary)
    assert list(summary["cases"]) == ["C1", "C2", "C3", "I", "DOB", "P", "O"]
    for case, found in summary["cases"].items():
        assert set(found) >= PROMISED
        assert {"simulation", "fit", "output"} <= set(found["wall_s"])
        assert found["complete"]
        assert found["Phi_max_m"] <= 1e-10
        assert found["Phi_dot_max"] <= 1e-10
        assert found["wrench_consistency_max"] <= 1e-9
        assert found["n_data"]["payload"] == (43 if case in ("C2", "C3", "P") else 0)
        assert found["n_data"]["agents"] == (86 if case == "C3" else 0)
    assert summary["cases"]["C3"]["updates"] == [1, 2]
    assert summary["bound"]["assumed"] == ["norm", "energy", "sensor noise", "sampled estimator"]
    for found in summary["cases"].values():
        bodies = [found["bound"]["payload"], *found["bound"]["agents"]]
        assert [len(body["beta"]) for body in bodies] == [6, 9, 9]
        assert all(0 <= share <= 1 for body in bodies for share in body["exceeded_share"].values())


def test_signals_are_labelled_and_have_units(results: Path):
    flight = log.load(results / "C3.nc")
    assert flight.attrs["case"] == "C3"
    assert flight.attrs["rho_assumed"] == "norm, energy, sensor noise, sampled estimator"
    assert log.load(results / "DOB.nc").attrs["rho_assumed"] == f"{flight.attrs['rho_assumed']}, posterior mean"
    assert (flight.attrs["rho_bound"], flight.attrs["rho_norm"]) == ("energy", 6)
    assert len(flight.attrs["rho_label_error_agents"]) == 18
    assert all("units" in flight[name].attrs for name in flight.data_vars)
    assert list(flight.contact.values) == ["front/left", "front/right", "rear/left", "rear/right"]


# Flights that do not end, and answers at once -------------------------------------------------------------------------


def test_a_run_that_fails_is_saved_marked_incomplete_and_status_1(tmp_path: Path):
    text = (Path(scenario.__file__).parent.parent / "scenarios" / "paper.yaml").read_text()
    path, out = tmp_path / "wild.yaml", tmp_path / "out"
    path.write_text(text.replace("agent_k_omega: 28", "agent_k_omega: 1.0e+6"))
    status, said = invoke("study", str(path), "--out", str(out))
    assert status == 1
    summary = json.loads((out / "summary.json").read_text())
    for case in ("C1", "C2", "C3"):
        found = summary["cases"][case]
        assert not found["complete"]
        assert "not finite" in found["stopped"]
        assert "t = 0.0" in found["stopped"]
        assert f"{case} is incomplete: {found['stopped']}" in said
        flight = log.load(out / f"{case}.nc")
        assert flight.attrs["complete"] == 0
        assert flight.attrs["stopped"] == found["stopped"]
        assert 1 <= flight.sizes["time"] < 20


def test_help_loads_nothing_that_it_does_not_need():
    code = (
        "import sys; from typer.testing import CliRunner; from colift.__main__ import app\n"
        "done = CliRunner().invoke(app, ['study', '--help'])\n"
        "assert done.exit_code == 0 and '--baselines' in done.output, done.output\n"
        "heavy = ('matplotlib', 'scipy', 'xarray', 'colift.scenario', 'colift.simulate')\n"
        "print(*(m for m in heavy if m in sys.modules))"
    )
    environment = os.environ | {"COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""
