"""Tests of the page and the figure that compare runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from colift.analysis import comparison
from colift.cli.app import app
from colift.closed_loop import log
from colift.runtime import run_directory
from colift.visualization import comparison_page
from tests.support import browser
from tests.support import playback_logs as played
from tests.support.summaries import metrics, written


@pytest.fixture
def folders(tmp_path: Path) -> list[Path]:
    """Two runs with two cases each; one name contains characters of HTML and of formulas."""
    found = [tmp_path / name for name in ("first", "_<b>$x$")]
    for k, folder in enumerate(found):
        folder.mkdir()
        for case in ("C1", "C3"):
            ds = played.random_log().assign_attrs(case=case)
            ds.e_p[:] = 0.1 * (1 + k)
            log.save(ds, folder / f"{case}.nc")
        written(folder, {case: metrics(e_p_rms_m=0.1 * (1 + k)) for case in ("C1", "C3")})
    return found


def test_compare_writes_page_and_figure(folders, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")
    result = CliRunner().invoke(app, ["compare", *map(str, folders)], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    out = tmp_path / "out" / "paper-comparison"
    assert sorted(file.name for file in out.iterdir()) == [
        "comparison.html",
        "figure_comparison.pdf",
        "figure_comparison.png",
    ]
    assert len({run_directory.read_run_id(file) for file in out.iterdir()}) == 1
    text = (out / "comparison.html").read_text()
    assert "<td>200.0<br>×2.00</td>" in text
    assert "<b>" not in text
    assert "<script" not in text
    assert "The RMS position error of C3 is 100 mm in first and 200 mm in _&lt;b&gt;$x$ (ratio 2.00)." in text
    assert "200.0 (2.00)" in result.stdout
    assert "Ratios refer to the same case of first." in result.stdout


@pytest.mark.parametrize("cases", [("C1", "C3"), ("C3",)])
def test_figure_draws_each_case_of_each_run(folders, cases):
    runs = comparison.load_runs(folders, cases)
    figure = comparison_page.plot_comparison(runs)
    drawn = [line for line in figure.axes[0].lines if len(line.get_xdata()) == runs[0].flights["C3"].sizes["time"] // 5]
    assert len(drawn) == 2 * len(cases)
    looks = {(line.get_color(), line.get_linestyle(), line.get_marker()) for line in drawn}
    assert len({str(look) for look in looks}) >= len(cases)
    np.testing.assert_allclose(drawn[-1].get_ydata(), 0.2 * np.sqrt(3))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [f"{name}: {case}" for name in ("first", r"./_<b>\$x\$") for case in cases]


def test_foreign_files_and_folders_are_refused_in_one_line(folders, tmp_path):
    out = tmp_path / "mine"
    out.mkdir()
    (out / "comparison.html").write_text("mine")
    command = ["compare", *map(str, folders), "--out", str(out)]
    result = CliRunner().invoke(app, command)
    assert (result.exit_code, len(messages(result.stderr))) == (2, 1)
    assert list(out.iterdir()) == [out / "comparison.html"]
    result = CliRunner().invoke(app, ["compare", str(folders[0]), str(tmp_path), str(tmp_path / "none")])
    assert (result.exit_code, len(messages(result.stderr))) == (2, 2)


def messages(text: str) -> list[str]:
    """Return the lines without those of progress, which a slow machine prints after 10 s."""
    return [line for line in text.splitlines() if not line.endswith(" elapsed")]


@pytest.mark.skipif(browser.FOUND is None, reason="there is no Chromium")
def test_browser_shows_the_page_on_a_phone_in_the_dark(folders, tmp_path, tmp_path_factory):
    result = CliRunner().invoke(app, ["compare", *map(str, folders), "--out", str(tmp_path / "c"), "--case", "c3"])
    assert result.exit_code == 0, result.stderr
    with browser.page(tmp_path_factory.mktemp("profile")) as page:
        page.open(tmp_path / "c" / "comparison.html", 400, dark=True, ready="document.querySelector('img').complete")
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        assert page.evaluate(browser.CONTRAST) > 4.5
        assert page.evaluate("document.querySelector('img').naturalWidth") > 2000
        assert page.errors == []
        assert {address.split(":")[0] for address in page.requests} <= {"file", "data"}
