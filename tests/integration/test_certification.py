"""Tests of the output of `certify`: file, table, figure, and report of exceeded bounds."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import runpy
from pathlib import Path
from typing import Any

import matplotlib.text
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from colift.analysis import result_files
from colift.certification import agent_iss, certificate
from colift.cli import app, common
from colift.cli import certify as certify_commands
from colift.runtime import run_directory
from colift.visualization import style
from colift.workflows import certification, study
from tests.support.certified_flights import NAMES, made, short


def exceeded() -> certification.CertificationResult:
    """Certificate of the flight with its energy bound only and with observed errors above that bound."""
    of = made()
    energy = of.certificate.ultimate_bounds["energy"]
    observed = {error: 3 * radius for error, radius in energy.a_priori.items()}
    return dataclasses.replace(
        of, certificate=dataclasses.replace(of.certificate, ultimate_bounds={"energy": energy}, observed=observed)
    )


LAYER = agent_iss.AgentIss(np.ones(2), 1.0, np.ones((2, 4)), np.ones(2), np.ones((2, 4)))


def table_of(printed: str) -> list[list[str]]:
    """Return the rows of bounds in printed text, split into cells."""
    return [line.split() for line in printed.splitlines() if line.split()[:1] and line.split()[0] in NAMES]


@pytest.fixture
def save(tmp_path, monkeypatch):
    """Function that saves a certificate of a scenario with a neutral name and short gains of the agent layer."""
    monkeypatch.setattr(agent_iss, "agent_iss_constants", lambda _loop, _floor: LAYER)
    settings = short().model_copy(update={"name": "short"})

    def saved(
        all_of: certification.CertificationResult, against: certification.CertificationResult | None = None
    ) -> dict[str, Any]:
        with study.open_run_directory(settings, tmp_path) as out:
            return certification.save_certificate(settings, all_of, against, out)

    return saved


@pytest.fixture
def drawn(monkeypatch) -> list[str]:
    """All visible texts of the figures that are saved."""
    texts: list[str] = []

    def save(figure, path, run):
        figure.canvas.draw()
        texts.extend(text.get_text() for text in figure.findobj(matplotlib.text.Text) if text.get_visible())
        return [path]

    monkeypatch.setattr(style, "save_figure", save)
    return texts


def test_certificate_is_saved_and_printed(tmp_path, capsys, save):
    saved_values = save(made(), made())
    assert {run_directory.read_run_id(path) for path in tmp_path.iterdir()} == {saved_values["run"]}
    assert json.loads((tmp_path / "certificate.json").read_text()) == saved_values
    assert {path.name for path in tmp_path.iterdir()} == {
        "certificate.json",
        "figure_6_certificate.pdf",
        "figure_6_certificate.png",
        "figure_6_certificate_column.pdf",
        "figure_6_certificate_column.png",
    }
    found = made().certificate
    for name, radii in found.ultimate_bounds.items():
        for error in certificate.ERRORS:
            ratio = radii.a_posteriori[error] / found.observed[error]
            assert saved_values["ultimate_bounds"][name]["bound_over_observed"]["a_posteriori"][error] == (
                ratio if np.isfinite(ratio) else None
            )
    best = saved_values["ultimate_bounds"]["recovery"]["bound_over_observed"]["a_posteriori"]
    assert saved_values["adversarial_test"]["bound_over_observed"] == best["e_p"]
    assert saved_values["violations"] == []
    assert set(saved_values["units"]) == set(certificate.ERRORS) == set(saved_values["nominal_error"])
    assert result_files.load_certificate(tmp_path / "certificate.json") == saved_values
    certify_commands.print_certificate(saved_values, tmp_path)
    printed, message = capsys.readouterr()
    assert message == ""
    for bound in NAMES:
        assert bound in printed
    assert f"{1e3 * found.observed['e_p']:.3g}" in printed


def test_assumptions_are_in_table_json_and_figure(tmp_path, capsys, save, drawn):
    """Unproven assumptions are named in table, JSON and figure, and none of them contains the word certified."""
    saved_values = save(made(), made())
    text = "first order, less than a period"
    for radii in saved_values["ultimate_bounds"].values():
        assert ", ".join(radii["unproven_assumptions"]) == text
        assert radii["status"] == "assumed"
    certify_commands.print_certificate(saved_values, tmp_path)
    printed = capsys.readouterr().out
    assert f"assumed: {text}" in printed
    assert [(row[0], row[1], row[-1]) for row in table_of(printed)] == [
        (name, run, "assumed") for name in ("energy", "srinivas", "recovery") for run in ("any", "this")
    ]
    shown = "\n".join(drawn)
    assert f"assumed: {text}" in shown.replace("\n", " ")
    assert "bound for this run (recovery, assumed)" in shown
    for where in (json.dumps(saved_values), printed, shown):
        assert "certified" not in where


def test_exceeded_bound_is_reported_first_with_status_1(tmp_path, monkeypatch, save, drawn):
    """An error above its bound is reported in the first line, and the exit status is 1."""
    del save  # the fixture replaces the constants of the agent layer
    results = [made(), exceeded()]
    monkeypatch.setattr(certification, "certify", lambda *_, **__: results.pop())
    result = CliRunner().invoke(app.app, ["certify", "certified", "--out", str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 1
    found = exceeded().certificate
    observed, radius = 1e3 * found.observed["e_p"], 1e3 * found.ultimate_bounds["energy"].a_priori["e_p"]
    first = f"e_p of this run exceeds its bound: observed {observed:.4g} mm, bound {radius:.4g} mm (energy, any run), "
    message = [line for line in result.output.splitlines() if not line.startswith("certifying certified")]  # progress
    assert message[0].startswith(first)
    red = [line for line in result.stderr.splitlines() if line in message]
    assert len(red) == len({each.error for each in found.violations})
    assert message[: len(red)] == red
    assert [(row[0], row[1], row[-1]) for row in table_of(result.stdout)] == [
        ("energy", "any", "exceeded"),
        ("energy", "this", "exceeded"),
    ]
    saved_values = json.loads((tmp_path / "certificate.json").read_text())
    assert saved_values["violations"] == [
        {"run": "simulation", **dataclasses.asdict(each)} for each in found.violations
    ]
    assert any(text.startswith("observed error above its bound: $e_p$") for text in drawn)
    result = CliRunner().invoke(app.app, ["certify", "certified", "--out", str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0
    assert all(line.startswith("certifying certified") for line in result.stderr.splitlines())


def test_example_prints_bounds_and_fails_if_exceeded(monkeypatch, capsys):
    """The example prints the bounds of its flight and fails if one is exceeded."""
    example = str(Path(__file__).parents[2] / "examples" / "08_certify_a_flight.py")
    results = [exceeded(), made()]
    monkeypatch.setattr(certification, "certify", lambda *_, **__: results.pop())
    runpy.run_path(example, run_name="__main__")
    message = capsys.readouterr().out
    radius, seen = (
        made().certificate.ultimate_bounds["recovery"].a_posteriori["e_p"],
        made().certificate.observed["e_p"],
    )
    assert f"recovery,     e_p: at most {radius:.3g}, observed {seen:.3g}" in message
    with pytest.raises(SystemExit, match=r"above their bound: .*e_p"):
        runpy.run_path(example, run_name="__main__")


def test_exceeded_bound_is_printed_in_red(tmp_path, monkeypatch, save):
    terminal = Console(file=io.StringIO(), force_terminal=True, color_system="standard", width=200)
    monkeypatch.setattr(common, "error_console", terminal)
    certify_commands.print_certificate(save(exceeded()), tmp_path)
    lines = terminal.file.getvalue().splitlines()
    assert len(lines) == len({each.error for each in exceeded().certificate.violations})
    assert all(line.startswith("\x1b[31m") for line in lines)


def test_adversarial_run_above_its_bound_is_exceeded(tmp_path, capsys, save):
    """A bound that the adversarial run exceeds is reported like that of the certified run."""
    observed = {error: 1e3 * size for error, size in made().certificate.observed.items()}
    exceeding = dataclasses.replace(made().certificate, observed=observed)
    saved_values = save(made(), dataclasses.replace(made(), certificate=exceeding))
    assert {each["run"] for each in saved_values["violations"]} == {"adversarial_test"}
    certify_commands.print_certificate(saved_values, tmp_path)
    printed, message = capsys.readouterr()
    assert message.startswith("e_p of the adversarial run exceeds its bound: observed ")
    assert " exceeded" not in printed


def test_unavailable_bounds_have_no_row(tmp_path, capsys, save, drawn):
    """Without a tube the table has no row for any run; with contradictory data it has no row and states the reason."""
    all_of = made()
    radii = {
        name: dataclasses.replace(
            each, a_priori=dict.fromkeys(each.a_priori, np.inf), assumptions=("S_X", *each.assumptions)
        )
        for name, each in all_of.certificate.ultimate_bounds.items()
    }
    a_priori = dataclasses.replace(all_of.certificate.a_priori, tube=None, tube_failure="it feeds itself")
    without_tube = dataclasses.replace(all_of.certificate, ultimate_bounds=radii, a_priori=a_priori)
    certify_commands.print_certificate(save(dataclasses.replace(all_of, certificate=without_tube)), tmp_path)
    printed = capsys.readouterr().out
    assert [row[1] for row in table_of(printed)] == ["this"] * len(NAMES)
    assert not re.search(r"\bany\b(?! run: it feeds)", printed)
    assert "no bound for any run: it feeds itself" in printed
    assert "assumed: S_X, first order" in printed
    assert not [text for text in drawn if "bound for any" in text]
    drawn.clear()
    small = dataclasses.replace(
        all_of.experiment, bound_assumptions=dataclasses.replace(all_of.experiment.bound_assumptions, rkhs_norm=0.05)
    )
    nothing = certificate.certify(small, all_of.flight, all_of.nominal_linearization, ("energy", "recovery"))
    saved_values = save(dataclasses.replace(all_of, experiment=small, certificate=nothing))
    assert saved_values["violations"] == []
    certify_commands.print_certificate(saved_values, tmp_path)
    printed = capsys.readouterr().out
    assert table_of(printed) == []
    assert not re.search("none|assumed|nan|inf", printed)
    assert "no bound: the data contradict the stated norm and label errors" in printed
    assert not [text for text in drawn if "bound for" in text]
