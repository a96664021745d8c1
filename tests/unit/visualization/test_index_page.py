"""Tests of the index of runs: rows, links, escaped text, order and filter in a browser."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from colift.cli.app import app
from colift.runtime import run_directory
from tests.support import browser
from tests.support.summaries import metrics, written

STRANGE = "x&y <img src=x onerror=alert(1)> #1?"


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Folder with three runs and a damaged one."""
    for name, cases in {
        "b": {"C1": metrics(e_p_rms_m=0.3), "C3": metrics(e_p_rms_m=0.002)},
        "a": {"C1": metrics(e_p_rms_m=0.01, complete=False)},
        STRANGE: {"C1": metrics(e_p_rms_m=0.1)},
    }.items():
        (tmp_path / name).mkdir()
        written(tmp_path / name, cases)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "summary.json").write_text("{")
    (tmp_path / STRANGE / "report.html").write_text("<p>report")
    return tmp_path


def browsed(out: Path) -> str:
    result = CliRunner().invoke(app, ["browse", str(out)], catch_exceptions=False)
    expected = f"the index of 4 runs, 1 of them damaged is {out / 'index.html'}\n"
    assert (result.exit_code, result.stdout) == (0, expected), result.stderr
    return (out / "index.html").read_text()


def test_index_has_a_row_for_each_run(out):
    text = browsed(out)
    assert run_directory.read_run_id(out / "index.html")
    rows = re.findall(r"<tr><td.*", text)
    assert len(rows) == 4
    assert "C1 <span" in rows[0]
    assert "ended early" in rows[0]
    assert '<td data-sort="2">C1<br>C3</td><td class="number" data-sort="0.002">300.0<br>2.0</td>' in rows[1]
    assert "damaged: summary.json:1: not JSON" in rows[2]
    assert browsed(out) == text  # the page replaces itself


def test_index_escapes_names_and_permits_one_script(out):
    text = browsed(out)
    assert "<img" not in text
    assert "script-src 'sha256-" in text
    assert "unsafe-inline" not in text.split("style-src")[0]
    assert not re.search(r"https?:", text)


def test_foreign_index_is_kept(out):
    (out / "index.html").write_text("mine")
    result = CliRunner().invoke(app, ["browse", str(out)])
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "which colift did not write" in result.stderr
    assert (out / "index.html").read_text() == "mine"


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_folder_without_runs_gives_one_line_and_status_2(tmp_path, name):
    (tmp_path / "empty").mkdir()
    result = CliRunner().invoke(app, ["browse", str(tmp_path / name)])
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert not (tmp_path / "empty" / "index.html").exists()


@pytest.mark.skipif(browser.FOUND is None, reason="there is no Chromium")
def test_browser_sorts_filters_and_follows_links(out, tmp_path_factory):
    browsed(out)
    shown = "[...document.querySelectorAll('tbody tr')].filter((row) => !row.hidden)"
    names = f"{shown}.map((row) => row.cells[0].dataset.sort)"
    with browser.page(tmp_path_factory.mktemp("profile")) as page:
        for width, dark in ((1280, False), (400, True)):
            page.open(out / "index.html", width, dark=dark, ready="true")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert page.evaluate(browser.CONTRAST) > 4.5
        assert page.evaluate(names) == ["a", "b", "broken", STRANGE]
        click = "document.querySelectorAll('thead button')[2].click()"  # e_p; the damaged run remains last
        for expected in (["b", "a", STRANGE, "broken"], [STRANGE, "a", "b", "broken"]):
            page.evaluate(click)
            assert page.evaluate(names) == expected
        page.evaluate("filter.value = 'damaged json'; filter.dispatchEvent(new Event('input'))")
        assert page.evaluate(names) == ["broken"]
        assert page.errors == []
        assert [address for address in page.requests if address.startswith("http")] == []
        page.visit(page.evaluate("document.querySelector('td a').href"), ready="true")
        assert page.evaluate("document.body.textContent") == "report"
