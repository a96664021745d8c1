"""Tests of images and videos: positions equal the log, and other programs can read the files."""

from __future__ import annotations

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
from colift.visualization import rendering
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
    frame = np.stack([rendering.CAMERA_RIGHT, rendering.CAMERA_UP, rendering.CAMERA_DIRECTION])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(frame) == pytest.approx(1)
    assert rendering.CAMERA_RIGHT[2] == 0  # the horizon is level
    assert rendering.CAMERA_UP[2] > 0.5


@pytest.mark.parametrize("k", [0, 20])
def test_bodies_are_drawn_at_their_logged_positions(seen, k):
    (ax,) = drawn(seen[0], k).axes
    (bodies,) = [each for each in ax.collections if isinstance(each, PolyCollection)]
    middles = np.array([path.vertices[:-1].mean(axis=0) for path in bodies.get_paths()])
    tracks, shape = seen[0].signals, seen[0].shape
    tips = tracks["nodes"][k][[node == "tip" for node in shape["nodes"]]]
    for tip in tips:
        at = [tip @ rendering.CAMERA_RIGHT, tip @ rendering.CAMERA_UP]
        assert np.linalg.norm(middles - at, axis=1).min() < 1e-3
    reference, flown, _ = ax.lines[:3]
    np.testing.assert_allclose(
        np.transpose(reference.get_data()), tracks["p_d"] @ np.stack([rendering.CAMERA_RIGHT, rendering.CAMERA_UP]).T
    )
    assert len(flown.get_xdata()) == k + 1
    assert flown.get_xdata()[-1] == pytest.approx(tracks["p"][k] @ rendering.CAMERA_RIGHT)


def test_near_bodies_cover_far_ones(seen):
    near = np.array([face[0] for face in sorted(rendering._team_faces(seen[0], 0), key=lambda face: face[0])])
    assert (near[1:] >= near[:-1]).all()
    center, half = np.zeros(3), np.array([1.0, 0.5, 0.2])
    faces = list(rendering._box(center, np.eye(3), half, "#808080"))
    assert len(faces) == 3 * rendering.PATCHES_PER_EDGE**2
    # the three hidden faces are not drawn
    area = sum(abs(np.linalg.det(np.diff(x, axis=0)[:2])) for _, x, _ in faces)
    whole = 4 * np.abs(rendering.CAMERA_DIRECTION) @ [half[1] * half[2], half[0] * half[2], half[0] * half[1]]
    assert area == pytest.approx(whole)  # of the shadow of a box along the view


@pytest.mark.parametrize("how", [{}, {"close": True}, {"whole_path": True}])
def test_team_is_within_the_image(seen, how):
    (ax,) = drawn(seen[0], 0, **how).axes
    # the farthest object is the shadow, which may be outside the image
    corners = np.concatenate([at for near, at, _ in rendering._team_faces(seen[0], 0) if np.isfinite(near)])
    for (low, high), x in zip((ax.get_xlim(), ax.get_ylim()), corners.T, strict=True):
        assert low <= x.min() < x.max() <= high
    assert ax.get_ylim()[1] - ax.get_ylim()[0] == pytest.approx(ax.get_xlim()[1] - ax.get_xlim()[0])  # a square one


def test_view_follows_a_long_path(seen):
    far = rendering.dataclasses.replace(seen[0], signals=seen[0].signals | {"p_d": 100.0 * seen[0].signals["p_d"]})
    for k in (0, 30):
        (ax,) = drawn(far, k).axes
        x = float(far.signals["p"][k] @ rendering.CAMERA_RIGHT)
        assert np.mean(ax.get_xlim()) == pytest.approx(x)
        assert np.ptp(ax.get_xlim()) < 4 * far.shape["size_m"]


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
    rendering.render_video(seen, tmp_path / "film.gif", speed=3.0, dpi=60.0, start=0.3)
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
