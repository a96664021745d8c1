"""Tests of images and videos: positions equal the log, and other programs can read the files."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image
from typer.testing import CliRunner

from colift.cli.app import app
from colift.closed_loop import log
from colift.visualization import camera, rendering, solids
from tests.support import playback_logs as played
from tests.support import random_logs as flights


@pytest.fixture(scope="module")
def seen() -> list[rendering.RenderData]:
    return [rendering.render_data(ds, f"{case}: {played.CASES[case]}") for case, ds in played.two_case_logs().items()]


def drawn(sketch: rendering.RenderData, k: int, **how: bool) -> Figure:
    figure = Figure(figsize=(4, 4))
    rendering.draw(figure.add_axes((0, 0, 1, 1)), sketch, k, **how)
    return figure


def test_view_is_an_upright_orthographic_projection():
    for view in camera.VIEWS.values():
        frame = np.stack([view.right, view.up, view.direction])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(frame) == pytest.approx(1)
        assert view.right[2] == 0  # the horizon is level
    assert camera.OBLIQUE.up[2] > 0.5
    np.testing.assert_allclose(camera.VIEWS["top"].right, [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(camera.VIEWS["front"].direction, [1, 0, 0], atol=1e-15)


def test_view_of_two_angles():
    """Azimuth 90 and elevation 30 degrees: the camera is on the side of the positive y axis."""
    view = camera.parse_view("90,30")
    np.testing.assert_allclose(view.direction, [0, np.sqrt(3) / 2, 0.5], atol=1e-15)
    point = np.array([0.3, 0.2, 1.1])
    on_ground = view.on_plane(point, 0.0)
    assert on_ground[2] == pytest.approx(0)
    np.testing.assert_allclose(view.project(on_ground), view.project(point))
    for text in ("left", "1,91", "1", "nan,0"):
        with pytest.raises(ValueError, match=f"view {text}: must be oblique"):
            camera.parse_view(text)
    with pytest.raises(ValueError, match="horizontal"):
        camera.VIEWS["front"].on_plane(point, 0.0)


@pytest.mark.parametrize("k", [0, 20])
def test_bodies_are_drawn_at_their_logged_positions(seen, k):
    (ax,) = drawn(seen[0], k).axes
    (bodies,) = [each for each in ax.collections if isinstance(each, PolyCollection)]
    middles = np.array([path.vertices[:-1].mean(axis=0) for path in bodies.get_paths()])
    tracks, shape = seen[0].signals, seen[0].shape
    tips = tracks["nodes"][k][[node == "tip" for node in shape["nodes"]]]
    for tip in tips:
        at = camera.OBLIQUE.project(tip)
        assert np.linalg.norm(middles - at, axis=1).min() < 1e-3
    reference, flown, _ = ax.lines[:3]
    np.testing.assert_allclose(np.transpose(reference.get_data()), camera.OBLIQUE.project(tracks["p_d"]))
    assert len(flown.get_xdata()) == k + 1
    assert flown.get_xdata()[-1] == pytest.approx(tracks["p"][k] @ camera.OBLIQUE.right)


def test_near_bodies_cover_far_ones(seen):
    near = np.array([face[0] for face in sorted(rendering._team_faces(seen[0], 0), key=lambda face: face[0])])
    assert (near[1:] >= near[:-1]).all()
    center, half = np.zeros(3), np.array([1.0, 0.5, 0.2])
    faces = list(solids.box(camera.OBLIQUE, center, np.eye(3), half, "#808080"))
    assert len(faces) == 3 * solids.PATCHES_PER_EDGE**2
    # the three hidden faces are not drawn
    area = sum(abs(np.linalg.det(np.diff(x, axis=0)[:2])) for _, x, _ in faces)
    whole = 4 * np.abs(camera.OBLIQUE.direction) @ [half[1] * half[2], half[0] * half[2], half[0] * half[1]]
    assert area == pytest.approx(whole)  # of the shadow of a box along the view


@pytest.mark.parametrize("how", [{}, {"close": True}])
def test_team_is_within_the_image(seen, how):
    (ax,) = drawn(seen[0], 0, **how).axes
    # the farthest object is the shadow, which may be outside the image
    corners = np.concatenate([at for near, at, _ in rendering._team_faces(seen[0], 0) if np.isfinite(near)])
    for (low, high), x in zip((ax.get_xlim(), ax.get_ylim()), corners.T, strict=True):
        assert low <= x.min() < x.max() <= high
    assert ax.get_ylim()[1] - ax.get_ylim()[0] == pytest.approx(ax.get_xlim()[1] - ax.get_xlim()[0])  # a square one


def team_share(frames: rendering._Frames, t: float) -> float:
    """Return the height of the bodies over that of the frame."""
    frames.draw(t)
    (case,), (ax,) = frames.data, frames.axes
    return float(
        np.ptp(case.camera.project(rendering._body_corners(case, case.row_at(t)))[:, 1]) / np.ptp(ax.get_ylim())
    )


@pytest.mark.parametrize("view", camera.VIEWS)
def test_team_fills_two_fifths_of_the_height(seen, view):
    """Also on a path that is long compared with the team, from each side, in each format."""
    far = dataclasses.replace(
        seen[0], signals=seen[0].signals | {"p_d": 100.0 * seen[0].signals["p_d"]}, camera=camera.VIEWS[view]
    )
    for size in (None, (640, 400)):
        _, frames = rendering._make_frames([far], rendering.Framing(size), 100.0)
        shares = [team_share(frames, t) for t in (0.0, 0.7, 1.4)]
        assert frames.follows
        assert np.median(shares) >= rendering.MIN_TEAM_SHARE
        assert max(shares) < 1
    _, whole = rendering._make_frames([far], rendering.Framing(follow=False), 100.0)
    assert team_share(whole, 0.0) < 0.2


def test_following_view_has_the_payload_at_one_place(seen):
    _, frames = rendering._make_frames(seen[:1], rendering.Framing(follow=True), 100.0)
    places = []
    for t in (0.0, 1.4):
        frames.draw(t)
        p = camera.OBLIQUE.project(seen[0].signals["p"][seen[0].row_at(t)])
        places.append(frames.axes[0].transData.transform(p))
    np.testing.assert_allclose(places[0], places[1], atol=1e-6)


@pytest.mark.parametrize("kind", rendering.IMAGE_SUFFIXES)
def test_image_shows_time_and_cases(seen, kind, tmp_path):
    rendering.render_image(seen, 1.0, tmp_path / f"at{kind}")
    content = (tmp_path / f"at{kind}").read_bytes()
    assert content[:5].strip() in (b"\x89PNG", b"%PDF-", b"<?xml")
    if kind == ".png":
        with Image.open(tmp_path / "at.png") as image:
            width, height = image.size
            assert width == 1440
            assert height % 40 == 0  # of 0.2 in at 200 dpi
            assert 0.55 <= height / 720 <= 1.1
            assert len(image.convert("RGB").getcolors(1 << 20)) > 100


def test_gif_changes_and_has_the_flight_duration(seen, tmp_path):
    rendering.render_video(seen, tmp_path / "film.gif", speed=3.0, dpi=60.0, framing=rendering.Framing(start=0.3))
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 8  # 1.2 s at triple speed, 20 frames per second: 0.3, 0.45 .. 1.35
        assert film.info["duration"] == 50
        assert film.info["loop"] == 0
        first = np.asarray(film.convert("RGB"), dtype=int)
        film.seek(7)
        assert (np.asarray(film.convert("RGB")) != first).any(axis=-1).mean() > 0.002


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="there is no ffmpeg")
def test_mp4_is_valid(seen, tmp_path):
    rendering.render_video(seen[:1], tmp_path / "film.mp4", speed=5.0, dpi=50.0)
    result = subprocess.run(
        ["ffprobe", "-v", "error", "-show_entries", "stream=codec_name,pix_fmt,nb_frames", "-of", "csv", "film.mp4"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.strip() == "stream,h264,yuv420p,9"


def test_rendering_errors_give_one_line(seen, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _name: None)
    for draw, answer in (
        (
            lambda: rendering.render_image(seen, 0.0, tmp_path / "a.bmp"),
            r"a\.bmp: the file name must end in \.png, \.pdf, \.svg",
        ),
        (lambda: rendering.render_image(seen, 99.0, tmp_path / "a.png"), r"time 99 s: must be from 0 to 1\.498 s"),
        (lambda: rendering.render_video(seen, tmp_path / "a.png"), r"a\.png: the file name must end in \.gif or \.mp4"),
        (lambda: rendering.render_video(seen, tmp_path / "a.mp4"), r"a\.mp4: MP4 requires ffmpeg"),
        (
            lambda: rendering.render_video(seen, tmp_path / "a.gif", framing=rendering.Framing(start=1.0, end=0.5)),
            r"time 0\.5 s: must not be before the start at 1 s",
        ),
        (
            lambda: rendering.render_image(seen, 0.0, tmp_path / "a.png", rendering.Framing(size=(10, 99999))),
            r"size 10x99999: width and height must be from 64 to 8192",
        ),
    ):
        with pytest.raises(ValueError, match=answer):
            draw()
    assert not list(tmp_path.iterdir())


def test_command_draws_the_requested_cases(tmp_path):
    for case, ds in played.two_case_logs().items():
        log.save(ds, tmp_path / f"{case}.nc")
    result = CliRunner().invoke(
        app,
        ["playback", str(tmp_path), "--image", str(tmp_path / "a.png"), "--at", "1", "--case", "C1", "--case", "C3"],
    )
    assert (result.exit_code, result.stdout) == (0, f"C1, C3: {tmp_path / 'a.png'}\n")
    film = tmp_path / "part.gif"
    options = ("--size", "320x200", "--view", "side", "--from", "0.5", "--to", "0.6", "--follow", "--case", "C1")
    result = CliRunner().invoke(app, ["playback", str(tmp_path), "--video", str(film), *options])
    assert (result.exit_code, result.stdout) == (0, f"C1: {film}\n")
    with Image.open(film) as opened:
        assert opened.size == (320, 200)
        assert opened.n_frames == 3  # 0.5, 0.55 and 0.6 s
    for option, value in (("--size", "9by9"), ("--view", "left")):
        result = CliRunner().invoke(app, ["playback", str(tmp_path), "--image", str(film), option, value])
        assert result.exit_code == 2
        assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "playback.html").exists()
    result = CliRunner().invoke(app, ["playback", str(tmp_path), "--video", str(tmp_path / "a.gif"), "--case", "C2"])
    assert (result.exit_code, result.stderr) == (2, f"{tmp_path} holds C1, C3, not C2: choose by --case\n")
    result = CliRunner().invoke(app, ["playback", str(tmp_path), "--image", "a.png", "--case", "C9"])
    assert result.exit_code == 2
    assert "--case C9: must be one of C1" in result.stderr


def test_failed_flight_is_drawn_until_its_end():
    ds = played.random_log(flights.PAPER._replace(time=400))
    ds.x[200:] = np.nan
    sketch = rendering.render_data(ds)
    assert sketch.t[-1] <= ds.time.values[199]
    assert drawn(sketch, sketch.row_at(9.0)).axes
