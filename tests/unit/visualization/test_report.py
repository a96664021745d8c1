"""Tests of the report: warnings first, all files of the folder, no network requests."""

from __future__ import annotations

import html
import json
import os
import re
from pathlib import Path

import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from typer.testing import CliRunner

from colift import scenario
from colift.cli.app import app
from colift.closed_loop import log
from colift.runtime import run_directory
from colift.visualization import report
from colift.workflows import study
from tests.support import browser
from tests.support import playback_logs as played
from tests.support import random_logs as flights
from tests.support.summaries import SUMMARY, metrics, written

FIGURE = "figure_1_tracking.png"


def replaced_by_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Folder of a study with two short flights and one figure."""
    for case, ds in played.two_case_logs().items():
        log.save(ds, tmp_path / f"{case}.nc")
    named = PngInfo()
    named.add_text("Keywords", flights.RUN)
    Image.new("RGB", (8, 8), "red").save(tmp_path / FIGURE, pnginfo=named)
    written(tmp_path, {case: metrics() for case in played.CASES})
    return tmp_path


def made(out: Path) -> str:
    result = CliRunner().invoke(app, ["report", str(out)], catch_exceptions=False)
    assert (result.exit_code, result.stdout) == (0, f"the report is {out / 'report.html'}\n"), result.stderr
    return (out / "report.html").read_text()


def test_report_contents(out):
    """A report contains run, table, figures, playback and settings."""
    text = made(out)
    assert html.escape(SUMMARY["command"]) in text
    assert run_directory.read_run_id(out / "report.html") == flights.RUN
    assert "jax 0.10.1" in text
    assert "No warnings: all cases are complete and within their limits." in text
    titles = re.findall(r"<h2>(.*?)</h2>", text)
    assert titles == ["Warnings", "Run", "Second half of the run", "Figures", "Playback", "Settings"]
    assert "<dt>e_p [mm]</dt><dd>RMS norm of the position error</dd>" in text
    assert "<td>C3</td><td>1.2</td>" in text  # mm
    assert text.count("<img ") == 1
    assert "Figure 1. Position error" in text
    inside = re.search(r'srcdoc="(.*?)"', text, re.DOTALL)
    assert inside
    assert 'id="flights"' in html.unescape(inside[1])
    settings = re.search(r"<pre>(.*?)</pre>", text, re.DOTALL)
    assert settings
    assert scenario.parse(html.unescape(settings[1]), "report") == played.short_flight()
    assert (out / "report.html") in run_directory.list_files(out, study.STUDY_FILES)  # the next study removes it


def test_report_makes_no_request_and_escapes_names(out):
    """A report makes no network request and escapes the name of the scenario."""
    written(out, {"C1": metrics()}, command="</td><script>alert(1)</script>")
    text = made(out)
    assert "<script>" not in text
    assert "default-src 'none'" in text
    assert not re.search(r"""(?:src|href)=["']?(?!["']?data:)\w""", re.sub(r'srcdoc=".*?"', "", text, flags=re.DOTALL))


def test_report_begins_with_its_conclusion(out):
    """A report begins with completed cases, errors with ratios and the number of warnings."""
    written(out, {"C1": metrics(e_p_rms_m=0.3), "C3": metrics(e_p_rms_m=0.006)}, warnings=["slow"])
    text = made(out)
    found = re.search(r'<p id="conclusion">(.*?)</p>', text)
    assert found
    assert found[1] == (
        "C1 and C3 completed the flight. The RMS position error in the second half is 300 mm in C1 and 6 mm in C3 "
        "(0.02 of C1). There is 1 warning."
    )
    assert text.index('<p id="conclusion">') < text.index("<h2>")


def test_contact_forces_are_listed_with_their_bias(out):
    numbers = {"peak_N": 5.11, "mean_N": 4.5, "internal_peak_N": 1.07, "internal_mean_N": 0.43, "error_rms_N": 0.2}
    written(out, {"C1": metrics(contact_forces={"a/left": numbers | {"bias_N": [0.1, -0.07, None]}}), "C3": metrics()})
    cells = ("a/left", "5.11", "4.50", "1.07", "0.43", "0.10", "-0.07", "none", "0.20", "none")
    row = "".join(f"<td>{cell}</td>" for cell in cells[1:])
    assert f'<tr><td>C1</td><td class="text">a/left</td>{row}</tr>' in made(out)


def test_combinations_that_rest_on_a_prior_are_listed(out):
    numbers = {"peak_N": 5.11, "mean_N": 4.5, "internal_peak_N": 1.07, "internal_mean_N": 0.43, "error_rms_N": 0.2}
    forces = {"a/left": numbers | {"bias_N": [0.1, -0.07, 0.0], "std_N": 0.31}}
    part = {"std": 0.44, "error_rms": 0.26}
    prior = {"unknowns": 36, "combinations": 12, "force": part, "moment": part}
    written(out, {"C1": metrics(contact_forces=forces, contact_force_prior=prior)})
    text = made(out)
    assert "have 36 unknowns" in text
    assert "leave 12 combinations" in text
    assert '<td class="text">net force [N]</td><td>0.44</td><td>0.26</td>' in text


def test_warnings_come_first(out):
    """Warnings come first, beginning with those that invalidate a result."""
    broken = {"violation_rate": {"force": 0.25, "moment": 0.0}}
    fallen = metrics(
        complete=False, termination_reason="beyond limits", saturated_ticks=7, warnings=["the step is too long"]
    )
    fallen["error_bound"] = {"payload": broken, "agents": []}
    written(
        out,
        {"C1": metrics(), "C3": fallen},
        warnings=["unstable at rest"],
        error_bound_assumptions={"unproven_assumptions": ["norm"]},
    )
    text = made(out)
    listed = re.search(r'<ul id="warnings">(.*?)</ul>', text, re.DOTALL)
    assert listed
    assert re.findall(r"<li( class=bad)?>(.*?)</li>", listed[1]) == [
        (" class=bad", "C3 is incomplete: beyond limits"),
        ("", "unstable at rest"),
        ("", "C3: the step is too long"),
        ("", "C3: thrust reached its limit at 7 ticks (sum over the agents)"),
        ("", "C3: a prediction error exceeds its bound (figure 5) 25.0% of the time"),
        ("", "the error bounds of figure 5 require unproven assumptions: norm"),
    ]


def test_only_the_certificate_of_the_run_is_included(out):
    """A certificate of the same run is included, and one of another run is not."""
    errors = ("e_p", "e_v", "e_R", "e_omega")
    bounds = {"a_posteriori": dict.fromkeys(errors, 2e-3), "a_priori": dict.fromkeys(errors)}
    bounds |= {"bound_over_observed": {kind: dict.fromkeys(errors, 1.5) for kind in bounds}}
    certified = {
        "schema": 2,
        "scenario": "sample",
        "seed": 1,
        "run": flights.RUN,
        "window_s": [0.5, 1.5],
        "violations": [
            {"run": "simulation", "error": "e_p", "prediction_bound": "energy", "kind": "a_posteriori"}
            | {"observed": 3e-3, "ultimate_bound": 2e-3}
        ],
        "observed": dict.fromkeys(errors, 3e-3),
        "nominal_error": dict.fromkeys(errors, 1e-3),
        "linearization_error": dict.fromkeys(errors, 1e-5),
        "ultimate_bounds": {"energy": bounds | {"unproven_assumptions": ["first order"], "status": "assumed"}},
        "unavailable_bounds": {},
        "tube_failure": "contraction 2",
    }
    (out / "certificate.json").write_text(json.dumps(certified | {"run": "colift-run-ba9876543210"}))
    assert "Certificate" not in made(out)
    for damaged, reason in (
        ("", "certificate.json:1: not JSON"),
        (json.dumps({key: x for key, x in certified.items() if key != "window_s"}), "is damaged: no entry 'window_s'"),
    ):
        (out / "certificate.json").write_text(damaged)
        result = CliRunner().invoke(app, ["report", str(out)])
        assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
        assert reason in result.stderr
    (out / "certificate.json").write_text(json.dumps(certified))
    text = made(out)
    assert "certificate: e_p is above a bound of energy: observed 0.003, bound 0.002" in text
    assert "the certificate requires unproven assumptions: first order" in text
    assert "<td>energy</td><td>this</td><td>2</td>" in text
    assert "assumed: first order" in text


def test_differences_are_listed_as_overrides():
    """Differences to the shipped scenario are listed as `--set` accepts them."""
    assert report.setting_differences(scenario.load_scenario("paper")) == []
    changed = ("payload.mass_kg=2", "agents.0.yaw_deg=30", "control.preview_step_s=0.03")
    found = report.setting_differences(scenario.load_scenario("paper", changed))
    assert {(where, here) for where, _, here in found} == {
        ("payload.mass_kg", "2.0"),
        ("agents.0.yaw_deg", "30.0"),
        ("control.preview_step_s", "0.03"),
    }
    again = scenario.load_scenario("paper", [f"{where}={here}" for where, _, here in found])
    assert again == scenario.load_scenario("paper", changed)
    assert {where: there for where, there, _ in found}["control.preview_step_s"] == "absent"
    assert report.setting_differences(played.short_flight()) is None  # not shipped


@pytest.mark.parametrize(
    ("spoil", "answer"),
    [
        (lambda out: (out / "summary.json").unlink(), "contains no summary.json; colift study writes it"),
        (lambda out: replaced_by_pipe(out / "summary.json"), "summary.json: a pipe, socket or device, not a regular"),
        (lambda out: replaced_by_pipe(out / FIGURE), f"{FIGURE}: a pipe, socket or device, not a regular file"),
        (lambda out: (out / FIGURE).write_bytes(b""), f"contains {FIGURE}, which colift did not write: move it"),
        (lambda out: (out / FIGURE).write_bytes((out / FIGURE).read_bytes()[:-9]), f"{FIGURE} is damaged: not a comp"),
        (lambda out: [(out / f"{case}.nc").unlink() for case in played.CASES], "contains no log"),
        (
            lambda out: written(out, {}, run="colift-run-ba9876543210"),
            "contains flights of colift-run-0123456789ab and a",
        ),
    ],
)
def test_folder_without_study_gives_one_line_and_status_2(out, spoil, answer):
    spoil(out)
    result = CliRunner().invoke(app, ["report", str(out)])
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert answer in result.stderr
    assert not (out / "report.html").exists()


@pytest.mark.skipif(browser.FOUND is None, reason="there is no Chromium")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (400, True)])
def test_browser_shows_the_report_and_plays(out, width, dark, tmp_path_factory):
    """A browser shows the report without a network and plays its flights."""
    made(out)
    with browser.page(tmp_path_factory.mktemp("profile")) as page:
        page.open(out / "report.html", width, dark=dark, ready="document.querySelector('iframe').contentWindow.state")
        assert page.evaluate("document.documentElement.scrollWidth") <= width  # a scroll bar may take some
        assert page.evaluate(browser.CONTRAST) > 4.5
        inside = "document.querySelector('iframe').contentWindow"
        page.evaluate(f"{inside}.seek(1.0)")
        assert page.evaluate(f"{inside}.document.querySelector('#clock').textContent") == "1.00 s"
        assert page.evaluate(f"{inside}.document.querySelectorAll('.uplot canvas').length") == 4
        assert page.evaluate("document.querySelector('img').naturalWidth") == 8
        assert page.errors == []
        assert {address.split(":")[0] for address in page.requests} <= {"file", "data"}
        assert [address for address in page.requests if address.startswith("file")] == [(out / "report.html").as_uri()]
