"""The page that plays flights: what it shows is what was logged, and a browser shows it without a network."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from PIL import Image
from typer.testing import CliRunner

from colift import scenario
from colift.cli.app import app
from colift.closed_loop import log
from colift.runtime import run_directory
from colift.scenario import experiment, team
from colift.visualization import playback, scene
from colift.workflows import study
from tests.support import browser
from tests.support import playback_logs as played
from tests.support import random_logs as flights
from tests.support import small_team as light
from tests.support.playback_logs import CASES, random_log

ROOT = Path(__file__).parents[3]
needs_browser = pytest.mark.skipif(browser.FOUND is None, reason="there is no Chromium")


@pytest.fixture(scope="module")
def told() -> scenario.Scenario:
    return played.told()


@pytest.fixture(scope="module")
def flown() -> dict[str, xr.Dataset]:
    return played.flown()


@pytest.fixture(scope="module")
def made(flown: dict[str, xr.Dataset], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of these flights."""
    out = tmp_path_factory.mktemp("flown")
    for case, ds in flown.items():
        log.save(ds, out / f"{case}.nc")
    return playback.write(out, CASES)


def embedded(text: str) -> dict[str, Any]:
    """What a page holds, its tracks as arrays."""
    found = re.search(r'<script type="application/json" id="flights">(.*?)</script>', text, re.DOTALL)
    assert found
    written = json.loads(found[1])
    for case in written["cases"]:
        for name, packed in case["tracks"].items():
            numbers = np.frombuffer(base64.b64decode(packed["float32"]), dtype="<f4")
            case["tracks"][name] = numbers.reshape(packed["shape"])
    return written


# The page -------------------------------------------------------------------------------------------------------------


def test_the_page_holds_the_frames_and_names_the_run(made, flown, told):
    text = made.read_text()
    assert run_directory.read_run_id(made) == flights.RUN
    written = embedded(text)
    assert (written["scenario"], written["seed"], written["run"]) == (told.name, told.seed, flights.RUN)
    truth, _ = team.team(told)
    for case, ds in flown.items():
        (found,) = [each for each in written["cases"] if each["name"] == case]
        for name, track in (scene.frames(ds, truth) | scene.plot_signals(ds)).items():
            np.testing.assert_array_equal(found["tracks"][name], track.astype("<f4"), err_msg=name)
        assert found["t"] == pytest.approx(ds.time.values[scene.frame_rows(ds)], abs=1e-6)
        assert found["marks"]["updates"] == pytest.approx(np.atleast_1d(ds.attrs["update_times_s"]))
    shape = written["shape"]
    assert [contact["name"] for contact in shape["contacts"]] == list(team.contact_names(told))
    assert [agent["name"] for agent in shape["agents"]] == list(light.NAMES)
    assert {len(agent["rotors_m"]) for agent in shape["agents"]} == {4}
    assert shape["links"] == [[0, 1], [2, 3], [4, 5]]  # the hooks


def test_links_follow_the_arms_of_the_paper_s_team():
    shape = embedded(playback.build_page({"C1": random_log()}, CASES))["shape"]
    # base 0, waist 1, left 2, right 3, tips 4 and 5; the waist sits at the base's origin
    assert shape["links"][:4] == [[1, 2], [1, 3], [2, 4], [3, 5]]
    assert [contact["node"] for contact in shape["contacts"]] == [4, 5, 10, 11]
    assert [contact["agent"] for contact in shape["contacts"]] == [0, 0, 1, 1]
    for contact in shape["contacts"]:
        assert np.all(np.abs(contact["on_box_m"]) <= np.array(shape["payload"]["half_m"]).max() + 1e-12)


def test_the_longest_arrows_fit_the_team():
    written = embedded(playback.build_page({"C1": random_log(flights.PAPER._replace(time=1000))}, CASES))
    size = written["shape"]["size_m"]
    forces = {"contact": "lam", "disturbance": "disturbance", "thrust": "u"}
    for kind, track in forces.items():
        values = written["cases"][0]["tracks"][track]
        most = np.quantile(np.linalg.norm(values, axis=-1) if kind != "thrust" else np.abs(values), 0.99)
        scale = written["arrows"][kind]["N_per_m"]
        assert 0.3 * size < most / scale <= 0.9 * size * (1 + 1e-6)
        assert f"{scale:.0e}"[0] in "125"


def test_twenty_seconds_of_three_cases_take_two_megabytes():
    """Twenty seconds of three cases take two megabytes at most."""
    ds = random_log(flights.PAPER._replace(time=10_000))
    assert len(playback.build_page(dict.fromkeys(("C1", "C2", "C3"), ds), experiment.PAPER_CASES)) < 2e6


def test_a_page_asks_for_nothing_and_no_name_ends_it_early():
    odd = "</script><img src=x>"
    text = playback.build_page({"C1": random_log()}, {"C1": odd})
    assert embedded(text)["cases"][0]["label"] == odd
    assert "<img" not in text
    assert "default-src 'none'" in text
    assert not re.search(r"(?:src|href)=[\"'](?!data:)", text.split("<script")[0])
    assert text.lower().count("</script") == text.lower().count("<script") == 2


@pytest.mark.parametrize(
    ("scenario_json", "answer"),
    [
        (
            None,
            "the log C1 of run colift-run-0123456789ab contains no scenario; "
            "it was written by an earlier version of colift",
        ),
        ('{"name": 1}', r"cannot read the scenario in the log \(name: must be text, got 1\): run colift study again"),
    ],
)
def test_a_log_without_a_scenario_is_refused(scenario_json, answer):
    ds = random_log()
    ds.attrs |= {"scenario_json": scenario_json}
    ds.attrs = {name: value for name, value in ds.attrs.items() if value is not None}
    with pytest.raises(ValueError, match=answer) as refused:
        playback.build_page({"C1": ds}, CASES)
    assert "\n" not in str(refused.value)


def test_a_folder_without_flights_of_one_run_is_one_line(tmp_path):
    """A folder without flights of one run is one line and status 2."""
    log.save(random_log(), tmp_path / "C1.nc")
    log.save(random_log().assign_attrs(run="colift-run-ba9876543210"), tmp_path / "C3.nc")
    (tmp_path / "empty").mkdir()
    for out, answer in ((tmp_path, "contains logs of 2 runs"), (tmp_path / "empty", "contains no log (C1.nc, ")):
        said = CliRunner().invoke(app, ["playback", str(out)])
        assert (said.exit_code, said.stderr.count("\n")) == (2, 1)
        assert f"{out} {answer}" in said.stderr
        assert not (out / "view.html").exists()


def test_the_command_says_where_the_page_is_and_opens_it_only(tmp_path, monkeypatch):
    """The command says where the page is and opens it only if asked."""
    log.save(random_log(), tmp_path / "C1.nc")
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or len(opened) == 1)
    said = CliRunner().invoke(app, ["playback", str(tmp_path)])
    assert (said.exit_code, said.stdout) == (0, f"the flights are in {tmp_path / 'view.html'}\n")
    assert opened == []
    said = CliRunner().invoke(app, ["playback", str(tmp_path), "--open"])
    assert (said.exit_code, opened) == (0, [(tmp_path / "view.html").as_uri()])
    said = CliRunner().invoke(app, ["playback", str(tmp_path), "--open"])
    assert (said.exit_code, said.stderr) == (2, "no browser was found to open the page\n")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["C1.nc", "view.html"]
    (tmp_path / "view.html").write_text("of someone else")
    said = CliRunner().invoke(app, ["playback", str(tmp_path)])
    assert said.exit_code == 2
    assert "contains view.html, which colift did not write" in said.stderr
    assert (tmp_path / "view.html").read_text() == "of someone else"


def test_the_next_study_removes_the_page(made):
    assert made in run_directory.list_files(made.parent, study.STUDY_FILES)


# The bundle -----------------------------------------------------------------------------------------------------------

SOURCES = ROOT / "playback"
BUNDLE = ROOT / "src" / "colift" / "visualization" / "playback.js"
LOCK = json.loads((SOURCES / "package-lock.json").read_text())


def installed() -> bool:
    """Whether the modules that the lock names are there."""
    names = ("esbuild", "three", "uplot")
    files = [SOURCES / "node_modules" / name / "package.json" for name in names]
    return all(
        file.is_file()
        and json.loads(file.read_text())["version"] == LOCK["packages"][f"node_modules/{name}"]["version"]
        for name, file in zip(names, files, strict=True)
    )


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no Node")
@pytest.mark.skipif(not installed(), reason="`npm ci` was not run in playback")
def test_the_bundle_is_what_its_sources_build_byte_for_byte(tmp_path):
    subprocess.run(["node", "build.js", str(tmp_path / "playback.js")], cwd=SOURCES, check=True, timeout=120)
    assert (tmp_path / "playback.js").read_bytes() == BUNDLE.read_bytes()


def test_the_bundle_keeps_the_licences_of_what_it_contains():
    text, notices = BUNDLE.read_text(), (ROOT / "THIRD_PARTY.md").read_text()
    assert text.count("Permission is hereby granted, free of charge") == 2
    for name, holder in {"three": "three.js authors", "uplot": "Leon Sorokin"}.items():
        assert re.search(rf"Copyright .*{re.escape(holder)}", text)
        assert re.search(rf"Copyright .*{re.escape(holder)}", notices)
        assert LOCK["packages"][f"node_modules/{name}"]["license"] == "MIT"


def test_the_lock_of_the_bundle_pins_and_hashes_everything():
    """The lock of the bundle pins and hashes everything and names no registry."""
    for name, package in LOCK["packages"].items():
        if name:
            assert package["integrity"].startswith("sha512-")
            assert "resolved" not in package


# In a browser ---------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def opened(tmp_path_factory: pytest.TempPathFactory, *flags: str) -> Iterator[browser.Page]:
    with browser.page(tmp_path_factory.mktemp("profile"), *flags) as page:
        yield page


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Page]:
    """A browser for the tests of this module."""
    with opened(tmp_path_factory) as page:
        yield page


@pytest.fixture
def page(window: browser.Page, made: Path) -> Iterator[browser.Page]:
    """The page in it, which asked for nothing and complained of nothing when the test is over."""
    window.requests.clear()
    window.open(made)
    yield window
    assert window.complaints == []
    assert set(window.requests) == {made.as_uri()}


def part(page: browser.Page, selector: str) -> Image.Image:
    """The picture of one element."""
    box = page.evaluate(
        f"(({{left, top, right, bottom}}) => [left, top, right, bottom])"
        f"(document.querySelector('{selector}').getBoundingClientRect())"
    )
    return Image.open(io.BytesIO(page.picture())).convert("RGB").crop([round(x) for x in box])


def differ(one: Image.Image, other: Image.Image) -> int:
    """How many pixels do."""
    return int((np.asarray(one, dtype=int) != np.asarray(other)).any(axis=-1).sum())


@needs_browser
def test_it_renders(page):
    colours = part(page, "#stage").getcolors(1 << 20)
    assert len(colours) > 200
    assert max(count for count, _ in colours) < 0.9 * sum(count for count, _ in colours)
    assert page.evaluate("document.querySelectorAll('.uplot canvas').length") == 4
    labels = page.evaluate("[...document.querySelectorAll('.label')].map((each) => each.textContent)")
    assert labels == ["x", "y", "z", *light.NAMES]
    legend = page.evaluate("document.querySelector('#legend').textContent")
    assert all(f"{name}" in legend for name in playback.ARROWS.values())
    assert legend.count("N per m") == 3


@needs_browser
@pytest.mark.parametrize("case", CASES)
def test_seek_moves_the_payload_by_what_the_log_says(page, flown, case):
    ds = flown[case]
    page.evaluate(f"document.querySelectorAll('.chip')[{list(CASES).index(case)}].click()")
    at = scene.frame_rows(ds)
    for k in (*at[:: len(at) // 5], at[-1]):
        t = float(ds.time[k])
        page.evaluate(f"seek({t!r})")
        state = page.evaluate("state()")
        assert (state["case"], state["t"]) == (case, pytest.approx(t, abs=1e-6))
        np.testing.assert_allclose(state["p"], ds.p.values[k], atol=1e-6)
    for k in range(at[3], at[4]):
        page.evaluate(f"seek({float(ds.time[k])!r})")
        np.testing.assert_allclose(page.evaluate("state().p"), ds.p.values[k], atol=1e-3)


@needs_browser
def test_a_seek_is_seen(page):
    before = part(page, "#stage")
    page.evaluate("seek(1.2)")
    page.settle()
    assert differ(before, part(page, "#stage")) > 500
    assert page.evaluate("document.querySelector('#clock').textContent") == "1.20 s"
    assert page.evaluate("document.querySelector('#mode').textContent") == "C3: learning ended, 1 of 1 updates"
    page.evaluate("seek(-3)")
    assert page.evaluate("state().t") == 0


@needs_browser
def test_the_keyboard_plays_steps_and_follows(page):
    page.press("ArrowRight")
    page.press("ArrowRight")
    page.press("ArrowLeft")
    assert page.evaluate("state().t") == pytest.approx(1 / 30)
    page.press(" ")
    assert page.evaluate("state().playing")
    page.wait("state().t > 0.1")
    page.press(" ")
    assert not page.evaluate("state().playing")
    page.press("f")
    assert page.evaluate("state().follow")
    page.press("f")
    assert not page.evaluate("state().follow")
    page.evaluate("seek(1.49)")
    page.press(" ")
    page.wait("!state().playing")  # at the end
    page.press(" ")
    page.wait("state().t < 1")  # from the start again
    page.press(" ")


@needs_browser
def test_faster_is_faster_and_a_button_that_was_pressed(page):
    """Faster is faster and a button that was pressed does not take the space."""
    page.evaluate("document.querySelector('#speed').value = 0.1, document.querySelector('#speed').onchange()")
    assert page.evaluate("state().speed") == 0.1
    box = page.evaluate("(({x, y}) => [x, y])(document.querySelector('#play').getBoundingClientRect())")
    page.click(box[0] + 9, box[1] + 9)
    assert page.evaluate("state().playing")
    page.press(" ")
    assert not page.evaluate("state().playing")


@needs_browser
def test_cases_are_chosen_and_others_are_ghosts(page):
    page.evaluate("seek(1.4)")
    assert page.evaluate("state().case") == "C3"
    page.settle()
    with_ghost = part(page, "#stage")
    page.evaluate("document.querySelector('#ghosts').click()")
    page.settle()
    assert not page.evaluate("state().ghosts")
    assert differ(with_ghost, part(page, "#stage")) > 50
    page.evaluate("document.querySelector('.chip').click()")
    assert page.evaluate("state().case") == "C1"
    assert page.evaluate("document.querySelector('#mode').textContent") == "C1: no learned model"


@needs_browser
def test_arrows_are_left_out_one_kind_at_a_time(page):
    for kind in playback.ARROWS:
        before = part(page, "#stage")
        page.evaluate(f"document.querySelector('#legend .{kind} input').click()")
        page.settle()
        assert differ(before, part(page, "#stage")) > 30, kind


@needs_browser
def test_pointing_at_a_plot_goes_there(page):
    left, top, wide, tall = page.evaluate(
        "(({x, y, width, height}) => [x, y, width, height])(document.querySelector('.u-over').getBoundingClientRect())"
    )
    page.click(left + 0.6 * wide, top + 0.5 * tall)
    assert page.evaluate("state().t") == pytest.approx(0.6 * 1.5, abs=0.02)


@needs_browser
@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize("dark", [False, True])
def test_it_fits_a_window_and_a_phone_light_and_dark(page, made, width, dark):
    page.open(made, width, dark=dark)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    for place in ("header", "#stage"):
        assert (sum(part(page, place).resize((1, 1)).getpixel((0, 0))) < 384) == dark
    beyond = page.evaluate(
        "[...document.querySelectorAll('button, select, input, canvas, h2')]"
        ".filter((each) => each.getBoundingClientRect().right > innerWidth + 0.5).length"
    )
    assert beyond == 0


@needs_browser
def test_a_flight_that_stopped_says_so_and_stays_where_it_ended(window, flown, tmp_path):
    early = flown["C1"].isel(time=slice(0, 300), time_sigma=slice(0, 20)).copy(deep=True)
    early.x[-1] = np.nan
    early.attrs |= {"termination_reason": "a made-up reason", "complete": 0}
    log.save(early, tmp_path / "C1.nc")
    log.save(flown["C3"], tmp_path / "C3.nc")
    window.open(playback.write(tmp_path, CASES))
    window.evaluate("document.querySelector('.chip').click(), seek(1.3)")
    told = window.evaluate("document.querySelector('#mode').textContent")
    assert told == f"C1: stopped at {float(early.time[-2]):.2f} s: a made-up reason"
    np.testing.assert_allclose(window.evaluate("state().p"), early.p.values[-2], atol=1e-6)
    assert window.complaints == []


@needs_browser
def test_without_webgl_the_plots_are_there(made, tmp_path_factory):
    with opened(tmp_path_factory, "--disable-3d-apis") as blind:
        blind.open(made)
        assert blind.evaluate("document.querySelector('#blind').textContent").startswith(
            "the 3D view is not available:"
        )
        blind.evaluate("seek(1.0)")
        assert blind.evaluate("document.querySelector('#clock').textContent") == "1.00 s"
        assert blind.evaluate("document.querySelectorAll('.uplot canvas').length") == 4
