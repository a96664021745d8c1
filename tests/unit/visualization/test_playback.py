"""Tests of the playback page: it shows the logged values, and works in a browser without a network."""

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
from colift.scenario import team
from colift.scenario.cases import PAPER_CASES
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
    return played.short_flight()


@pytest.fixture(scope="module")
def flown() -> dict[str, xr.Dataset]:
    return played.two_case_logs()


@pytest.fixture(scope="module")
def make_page(flown: dict[str, xr.Dataset], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of these flights."""
    out = tmp_path_factory.mktemp("flown")
    for case, ds in flown.items():
        log.save(ds, out / f"{case}.nc")
    return playback.write(out, CASES)


def embedded_data(text: str) -> dict[str, Any]:
    """Return the data of a page with its tracks as arrays."""
    found = re.search(r'<script type="application/json" id="flights">(.*?)</script>', text, re.DOTALL)
    assert found
    written = json.loads(found[1])
    for case in written["cases"]:
        for name, packed in case["tracks"].items():
            numbers = np.frombuffer(base64.b64decode(packed["float32"]), dtype="<f4")
            case["tracks"][name] = numbers.reshape(packed["shape"])
    return written


# Page -----------------------------------------------------------------------------------------------------------------


def test_page_contains_frames_and_run_id(make_page, flown, told):
    text = make_page.read_text()
    assert run_directory.read_run_id(make_page) == flights.RUN
    written = embedded_data(text)
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


def test_links_are_the_arms_of_the_team():
    shape = embedded_data(playback.build_page({"C1": random_log()}, CASES))["shape"]
    # base 0, waist 1, left 2, right 3, tips 4 and 5; the waist sits at the base's origin
    assert shape["links"][:4] == [[1, 2], [1, 3], [2, 4], [3, 5]]
    assert [contact["node"] for contact in shape["contacts"]] == [4, 5, 10, 11]
    assert [contact["agent"] for contact in shape["contacts"]] == [0, 0, 1, 1]
    for contact in shape["contacts"]:
        assert np.all(np.abs(contact["on_box_m"]) <= np.array(shape["payload"]["half_m"]).max() + 1e-12)


def test_arrow_scale_fits_the_team():
    written = embedded_data(playback.build_page({"C1": random_log(flights.PAPER._replace(time=1000))}, CASES))
    size = written["shape"]["size_m"]
    forces = {"contact": "lam", "disturbance": "disturbance", "thrust": "u"}
    for kind, track in forces.items():
        values = written["cases"][0]["tracks"][track]
        most = np.quantile(np.linalg.norm(values, axis=-1) if kind != "thrust" else np.abs(values), 0.99)
        scale = written["arrows"][kind]["N_per_m"]
        assert 0.3 * size < most / scale <= 0.9 * size * (1 + 1e-6)
        assert f"{scale:.0e}"[0] in "125"


def test_page_size_is_limited():
    """Twenty seconds of three cases have at most two megabytes."""
    ds = random_log(flights.PAPER._replace(time=10_000))
    assert len(playback.build_page(dict.fromkeys(("C1", "C2", "C3"), ds), PAPER_CASES)) < 2e6


def test_page_makes_no_request_and_escapes_names():
    odd = "</script><img src=x>"
    text = playback.build_page({"C1": random_log()}, {"C1": odd})
    assert embedded_data(text)["cases"][0]["label"] == odd
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
def test_log_without_scenario_is_refused(scenario_json, answer):
    ds = random_log()
    ds.attrs |= {"scenario_json": scenario_json}
    ds.attrs = {name: value for name, value in ds.attrs.items() if value is not None}
    with pytest.raises(ValueError, match=answer) as refused:
        playback.build_page({"C1": ds}, CASES)
    assert "\n" not in str(refused.value)


def test_folder_without_flights_gives_one_line(tmp_path):
    """A folder without flights of one run gives one line and status 2."""
    log.save(random_log(), tmp_path / "C1.nc")
    log.save(random_log().assign_attrs(run="colift-run-ba9876543210"), tmp_path / "C3.nc")
    (tmp_path / "empty").mkdir()
    for out, answer in ((tmp_path, "contains logs of 2 runs"), (tmp_path / "empty", "contains no log (C1.nc, ")):
        result = CliRunner().invoke(app, ["playback", str(out)])
        messages = [line for line in result.stderr.splitlines() if not line.endswith(" elapsed")]  # without progress
        assert (result.exit_code, len(messages)) == (2, 1)
        assert f"{out} {answer}" in result.stderr
        assert not (out / "playback.html").exists()


def test_command_prints_the_path_of_the_page(tmp_path, monkeypatch):
    """The command prints the path of the page and opens it only on request."""
    log.save(random_log(), tmp_path / "C1.nc")
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or len(opened) == 1)
    result = CliRunner().invoke(app, ["playback", str(tmp_path)])
    assert (result.exit_code, result.stdout) == (0, f"the flights are in {tmp_path / 'playback.html'}\n")
    assert opened == []
    result = CliRunner().invoke(app, ["playback", str(tmp_path), "--open"])
    assert (result.exit_code, opened) == (0, [(tmp_path / "playback.html").as_uri()])
    result = CliRunner().invoke(app, ["playback", str(tmp_path), "--open"])
    assert (result.exit_code, result.stderr) == (2, "no browser was found to open the page\n")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["C1.nc", "playback.html"]
    (tmp_path / "playback.html").write_text("of someone else")
    result = CliRunner().invoke(app, ["playback", str(tmp_path)])
    assert result.exit_code == 2
    assert "contains playback.html, which colift did not write" in result.stderr
    assert (tmp_path / "playback.html").read_text() == "of someone else"


def test_next_study_removes_the_page(make_page):
    assert make_page in run_directory.list_files(make_page.parent, study.STUDY_FILES)
    assert {"playback.html", "view.html"} <= set(study.STUDY_FILES)  # the second is the name of earlier versions


# Bundle ---------------------------------------------------------------------------------------------------------------

SOURCES = ROOT / "playback"
BUNDLE = ROOT / "src" / "colift" / "visualization" / "playback.js"
LOCK = json.loads((SOURCES / "package-lock.json").read_text())


def installed() -> bool:
    """Return whether the locked JavaScript packages are installed."""
    names = ("esbuild", "three", "uplot")
    files = [SOURCES / "node_modules" / name / "package.json" for name in names]
    return all(
        file.is_file()
        and json.loads(file.read_text())["version"] == LOCK["packages"][f"node_modules/{name}"]["version"]
        for name, file in zip(names, files, strict=True)
    )


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no Node")
@pytest.mark.skipif(not installed(), reason="`npm ci` was not run in playback")
def test_bundle_build_is_reproducible(tmp_path):
    subprocess.run(["node", "build.js", str(tmp_path / "playback.js")], cwd=SOURCES, check=True, timeout=120)
    assert (tmp_path / "playback.js").read_bytes() == BUNDLE.read_bytes()


def test_bundle_contains_its_licenses():
    text, notices = BUNDLE.read_text(), (ROOT / "THIRD_PARTY.md").read_text()
    assert text.count("Permission is hereby granted, free of charge") == 2
    for name, holder in {"three": "three.js authors", "uplot": "Leon Sorokin"}.items():
        assert re.search(rf"Copyright .*{re.escape(holder)}", text)
        assert re.search(rf"Copyright .*{re.escape(holder)}", notices)
        assert LOCK["packages"][f"node_modules/{name}"]["license"] == "MIT"


def test_bundle_lock_has_versions_and_hashes():
    """The lock of the bundle has versions and hashes of all packages and no registry address."""
    for name, package in LOCK["packages"].items():
        if name:
            assert package["integrity"].startswith("sha512-")
            assert "resolved" not in package


# Browser --------------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def opened(tmp_path_factory: pytest.TempPathFactory, *flags: str) -> Iterator[browser.Page]:
    with browser.page(tmp_path_factory.mktemp("profile"), *flags) as page:
        yield page


@pytest.fixture(scope="module")
def browser_window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Page]:
    """Browser for the tests of this module."""
    with opened(tmp_path_factory) as page:
        yield page


@pytest.fixture
def page(browser_window: browser.Page, make_page: Path) -> Iterator[browser.Page]:
    """Page in the browser; at the end it must have made no request and reported no error."""
    browser_window.requests.clear()
    browser_window.open(make_page)
    yield browser_window
    assert browser_window.errors == []
    assert set(browser_window.requests) == {make_page.as_uri()}


def element_picture(page: browser.Page, selector: str) -> Image.Image:
    """Return the picture of one element."""
    box = page.evaluate(
        f"(({{left, top, right, bottom}}) => [left, top, right, bottom])"
        f"(document.querySelector('{selector}').getBoundingClientRect())"
    )
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB").crop([round(x) for x in box])


def differing_pixels(one: Image.Image, other: Image.Image) -> int:
    """Return the number of pixels that differ."""
    return int((np.asarray(one, dtype=int) != np.asarray(other)).any(axis=-1).sum())


@needs_browser
def test_page_renders(page):
    colours = element_picture(page, "#stage").getcolors(1 << 20)
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
def test_seek_moves_the_payload_to_the_logged_position(page, flown, case):
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
def test_seek_changes_the_picture(page):
    before = element_picture(page, "#stage")
    page.evaluate("seek(1.2)")
    page.wait_until_drawn()
    assert differing_pixels(before, element_picture(page, "#stage")) > 500
    assert page.evaluate("document.querySelector('#clock').textContent") == "1.20 s"
    assert page.evaluate("document.querySelector('#mode').textContent") == "C3: learning ended, 1 of 1 updates"
    page.evaluate("seek(-3)")
    assert page.evaluate("state().t") == 0


@needs_browser
def test_keyboard_controls(page):
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
def test_keys_select_cases_and_times(page):
    end = page.evaluate("state().end")
    page.press("End")
    assert page.evaluate("state().t") == pytest.approx(end)
    page.press("%", code="Digit5", shift=True)
    assert page.evaluate("state().t") == pytest.approx(0.5 * end)
    page.press("ArrowLeft", shift=True)
    assert page.evaluate("state().t") == pytest.approx(max(0.5 * end - 1, 0))
    page.press("1")
    assert page.evaluate("state().case") == next(iter(CASES))
    page.press("9")  # there is no such case
    assert page.evaluate("state().case") == next(iter(CASES))
    page.press("Home")
    assert page.evaluate("state().t") == 0


@needs_browser
def test_list_of_keys_opens_and_closes(page):
    page.press("?")
    assert page.evaluate("document.querySelector('#help').open")
    assert "Home, End" in page.evaluate("document.querySelector('#help').textContent")
    page.press("1")
    assert page.evaluate("state().case") == "C3"  # keys have no effect beside the list
    page.press("Escape")
    page.wait("!document.querySelector('#help').open")


@needs_browser
def test_fragment_states_case_time_and_signals(page):
    page.evaluate("location.hash = '#case=C1&t=0.5&signals=position:z,thrust,unknown'")
    page.wait("state().t === 0.5")
    assert page.evaluate("state().case") == "C1"
    assert page.evaluate("[...document.querySelectorAll('section')].map((each) => each.id)") == [
        "plot-position",
        "plot-thrust",
    ]
    page.press("ArrowRight")
    page.wait("location.hash === '#case=C1&t=0.53&signals=position:z,thrust'")
    page.evaluate("location.hash = '#case=C9&t=x'")  # ignored
    page.evaluate("document.querySelector('#signals input').click()")
    page.wait("location.hash === '#case=C1&t=0.53&signals=thrust'")


@needs_browser
def test_components_equal_the_log(page, flown):
    """The readout at a time is the logged component."""
    ds = flown["C3"]
    k = int(scene.frame_rows(ds)[7])
    page.evaluate("location.hash = '#case=C3&t=0&signals=position:y,contact:x,residual:z'")
    page.wait("document.querySelectorAll('section').length === 3")
    page.evaluate(f"seek({float(ds.time[k])!r})")
    read = lambda plot: page.evaluate(  # noqa: E731
        f"[...document.querySelectorAll('#plot-{plot} .curves span')].map((each) => [each.childNodes[1].textContent, "
        "Number(each.childNodes[2].textContent)])"
    )
    found = dict(read("position"))
    assert found["C3"] == pytest.approx(float(ds.p[k, 1] - ds.p_d[k, 1]), rel=6e-3, abs=1e-6)
    assert [value for _, value in read("contact")] == pytest.approx(ds.lam.values[k, :, 0].tolist(), rel=6e-3, abs=1e-6)
    assert dict(read("residual"))["true"] == pytest.approx(float(ds.f_L_force[k, 2]), rel=6e-3, abs=1e-6)


@needs_browser
def test_numerical_zeros_are_not_on_a_log_axis(browser_window, flown, tmp_path):
    ds = flown["C3"].copy(deep=True)
    ds.e_R[:], ds.Psi[:] = 1e-24, 0.0
    (tmp_path / "page.html").write_text(playback.build_page({"C3": ds}, CASES), encoding="utf-8")
    browser_window.open(tmp_path / "page.html")
    title = browser_window.evaluate("document.querySelector('#plot-attitude h2 small').textContent")
    assert title == "below 0.00001 deg: not shown"


@needs_browser
def test_picture_contains_scene_and_plots(page):
    data = page.evaluate("picture()").split(",")[1]
    with Image.open(io.BytesIO(base64.b64decode(data))) as picture:
        assert picture.width > page.evaluate("document.querySelector('#stage').clientWidth") + 400
        assert len(picture.convert("RGB").getcolors(1 << 20)) > 300


@needs_browser
def test_speed_buttons_and_keyboard_focus(page):
    """A higher speed is faster, and the space key does not press a focused button again."""
    page.evaluate("document.querySelector('#speed').value = 0.1, document.querySelector('#speed').onchange()")
    assert page.evaluate("state().speed") == 0.1
    box = page.evaluate("(({x, y}) => [x, y])(document.querySelector('#play').getBoundingClientRect())")
    page.click(box[0] + 9, box[1] + 9)
    assert page.evaluate("state().playing")
    page.press(" ")
    assert not page.evaluate("state().playing")


@needs_browser
def test_selected_case_is_solid_and_others_transparent(page):
    page.evaluate("seek(1.4)")
    assert page.evaluate("state().case") == "C3"
    page.wait_until_drawn()
    with_ghost = element_picture(page, "#stage")
    page.evaluate("document.querySelector('#ghosts').click()")
    page.wait_until_drawn()
    assert not page.evaluate("state().ghosts")
    assert differing_pixels(with_ghost, element_picture(page, "#stage")) > 50
    page.evaluate("document.querySelector('.chip').click()")
    assert page.evaluate("state().case") == "C1"
    assert page.evaluate("document.querySelector('#mode').textContent") == "C1: no learned model"


@needs_browser
def test_arrows_can_be_hidden_by_kind(page):
    for kind in playback.ARROWS:
        before = element_picture(page, "#stage")
        page.evaluate(f"document.querySelector('#legend .{kind} input').click()")
        page.wait_until_drawn()
        assert differing_pixels(before, element_picture(page, "#stage")) > 30, kind


@needs_browser
def test_click_on_a_plot_seeks(page):
    left, top, wide, tall = page.evaluate(
        "(({x, y, width, height}) => [x, y, width, height])(document.querySelector('.u-over').getBoundingClientRect())"
    )
    page.click(left + 0.6 * wide, top + 0.5 * tall)
    assert page.evaluate("state().t") == pytest.approx(0.6 * 1.5, abs=0.02)


@needs_browser
@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize("dark", [False, True])
def test_layout_fits_desktop_and_phone(page, make_page, width, dark):
    page.open(make_page, width, dark=dark)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    for place in ("header", "#stage"):
        assert (sum(element_picture(page, place).resize((1, 1)).getpixel((0, 0))) < 384) == dark
    beyond = page.evaluate(
        "[...document.querySelectorAll('button, select, input, canvas, h2')]"
        ".filter((each) => each.getBoundingClientRect().right > innerWidth + 0.5).length"
    )
    assert beyond == 0


@needs_browser
def test_terminated_flight_stays_at_its_last_frame(browser_window, flown, tmp_path):
    early = flown["C1"].isel(time=slice(0, 300), time_sigma=slice(0, 6)).copy(deep=True)
    early.x[-1] = np.nan
    early.attrs |= {"termination_reason": "a made-up reason", "complete": 0}
    log.save(early, tmp_path / "C1.nc")
    log.save(flown["C3"], tmp_path / "C3.nc")
    browser_window.open(playback.write(tmp_path, CASES))
    browser_window.evaluate("document.querySelector('.chip').click(), seek(1.3)")
    status_text = browser_window.evaluate("document.querySelector('#mode').textContent")
    assert status_text == f"C1: stopped at {float(early.time[-2]):.2f} s: a made-up reason"
    np.testing.assert_allclose(browser_window.evaluate("state().p"), early.p.values[-2], atol=1e-6)
    assert browser_window.errors == []


@needs_browser
def test_plots_work_without_webgl(make_page, tmp_path_factory):
    with opened(tmp_path_factory, "--disable-3d-apis") as without_webgl:
        without_webgl.open(make_page)
        assert without_webgl.evaluate("document.querySelector('#blind').textContent").startswith(
            "the 3D view is not available:"
        )
        without_webgl.evaluate("seek(1.0)")
        assert without_webgl.evaluate("document.querySelector('#clock').textContent") == "1.00 s"
        assert without_webgl.evaluate("document.querySelectorAll('.uplot canvas').length") == 4
