"""Images and videos of logged flights, drawn by matplotlib without a browser or a GPU.

The projection is orthographic: lengths perpendicular to the viewing direction are to scale. Faces are drawn from the
farthest to the nearest (painter's algorithm). Decision record 0033 states the reasons.
"""

from __future__ import annotations

import dataclasses
import io
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib import animation, patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from colift.analysis import poses
from colift.runtime import atomic_write, signals
from colift.scenario import team as team_module
from colift.visualization import scene, solids, style
from colift.visualization.camera import MIN_SLOPE, OBLIQUE, Camera

MIN_TEAM_SHARE = 0.4
"""Smallest height of the team over that of a frame; a view of the whole flight in which it is lower is not used."""
FRAME_MARGIN = 0.06  # of the size of a view that follows the payload, on each side
TITLE_SHARE = 0.06  # of the height of a view that follows the payload, for the title
GROUND_SHARE = 0.15  # of the size of the flight, height up to which a view of the whole flight includes the ground
VIEW_ROWS = 40  # rows of a flight whose bodies determine the view of the whole flight
TEXT_OUTLINE: list[patheffects.AbstractPathEffect] = [
    patheffects.withStroke(linewidth=2.2, foreground="white")
]  # around names, which may lie on bodies and arrows
GRID_SPACING = 1.0  # m, line spacing of the ground grid
COLORS = {"thrust": "#228833", "contact": "#EE3377", "disturbance": "#0099CC"}  # of force arrows
REFERENCE, FRAME, ARM = "#33393F", "#3D444C", "#8A939D"
IMAGE_SUFFIXES, VIDEO_SUFFIXES = (".png", ".pdf", ".svg"), (".gif", ".mp4")
PANEL_INCHES = 3.6  # in, width of the panel of one case
PANEL_STEP = 0.2  # in, its height is a multiple of this, which gives an even number of pixels, as videos require
PANEL_RATIOS = (0.55, 1.1)  # limits of its height over its width
TEXT_RATIO = 0.2  # height of title and readings over its width
VIDEO_DPI, IMAGE_DPI = 110.0, 200.0
FRAME_RATE = {".gif": 20, ".mp4": 30}  # 1/s; the frame duration of a GIF is a multiple of 0.01 s
PALETTE = 64  # number of colors of a GIF
SIZE_LIMITS = (64, 8192)
"""Smallest and largest width and height of a file [px]."""


@dataclasses.dataclass(frozen=True)
class RenderData:
    """Data of one case from which images are drawn.

    Attributes:
        case: Case id.
        title: Title of the panel.
        t: Times of the drawn rows [s].
        signals: Signals of `scene.frames`, and the position error `e_p` [m].
        shape: Geometry of `scene.team_geometry`.
        arrow_scales: Force per arrow length of each kind of arrow [N/m].
        ground: Height of the ground, world frame [m].
        camera: Camera of all images.
    """

    case: str
    title: str
    t: np.ndarray
    signals: Mapping[str, np.ndarray]
    shape: Mapping[str, Any]
    arrow_scales: Mapping[str, float]
    ground: float
    camera: Camera = OBLIQUE

    def sampled_rows(self) -> list[int]:
        """Return some drawn rows from the first to the last, for the extent of the flight."""
        return [*range(0, len(self.t), max(1, len(self.t) // VIEW_ROWS)), len(self.t) - 1]

    def row_at(self, t: float) -> int:
        """Return the drawn row nearest to a time [s]; after the end of the flight this is the last row."""
        return int(np.argmin(np.abs(self.t - t)))


def render_data(ds: xr.Dataset, title: str = "") -> RenderData:
    """Extract the drawing data of a flight from its log.

    A log without a valid scenario raises `ValueError`.

    Args:
        ds: Log.
        title: Title of the panel.

    Returns:
        The data of all drawn rows.
    """
    settings = poses.scenario_of_log(ds)
    team, _ = team_module.team(settings)
    shape, tracks = scene.team_geometry(team, settings), scene.frames(ds, team)
    tracks_by_case = {"": tracks}
    return RenderData(
        case=str(ds.attrs["case"]),
        title=title,
        t=ds.time.values[scene.frame_rows(ds)],
        signals=tracks | {"e_p": scene.plot_signals(ds)["e_p"]},
        shape=shape,
        arrow_scales=scene.arrow_scales(tracks_by_case, shape["size_m"]),
        ground=scene.ground_height(tracks_by_case),
    )


@dataclasses.dataclass(frozen=True)
class Framing:
    """Size, view and time span of an image or a video.

    Attributes:
        size: Width and height of the file [px]; None: a height that follows from the content.
        follow: True: the view follows the payload. False: it contains the whole flight. None: it contains the whole
            flight if the height of the team is at least `MIN_TEAM_SHARE` of the frame.
        start: Time of the first frame [s].
        end: Time of the last frame [s]; None: the end of the flight.
    """

    size: tuple[int, int] | None = None
    follow: bool | None = None
    start: float = 0.0
    end: float | None = None


# Files ----------------------------------------------------------------------------------------------------------------


def render_image(data: Sequence[RenderData], t: float, file: Path, framing: Framing = Framing()) -> None:
    """Write an image of one or more cases side by side at one time.

    A file that cannot be written raises `OSError`.

    Args:
        data: Drawing data of each case.
        t: Time [s].
        file: Path of the file; the suffix `.png`, `.pdf` or `.svg` determines the format.
        framing: Size and view.

    Raises:
        ValueError: If suffix or size is not supported, or if the time is outside the flights.

    Example:
        >>> render_image([render_data(log.load("out/paper/C3.nc"))], 12.0, Path("team.png"))  # doctest: +SKIP
    """
    if file.suffix not in IMAGE_SUFFIXES:
        raise ValueError(f"{file}: the file name must end in {', '.join(IMAGE_SUFFIXES)}")
    _check_time(data, t)
    with style.style_context():
        figure, frames = _make_frames(data, framing, IMAGE_DPI)
        frames.draw(t)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=file.suffix[1:], dpi=figure.dpi)
    atomic_write.write_atomic(file, buffer.getvalue())


def render_video(
    data: Sequence[RenderData],
    file: Path,
    speed: float = 1.0,
    dpi: float = VIDEO_DPI,
    framing: Framing = Framing(),
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> None:
    """Write a video of one or more cases side by side.

    A file that cannot be written raises `OSError`.

    Args:
        data: Drawing data of each case.
        file: Path of the file; the suffix `.gif` or `.mp4` determines the format. MP4 requires ffmpeg.
        speed: Playback speed relative to real time.
        dpi: Resolution [1/in], if no size is given; the panel of one case has a width of 3.6 in.
        framing: Size, view and time span.
        progress: Function called with the number of drawn frames and that of all frames.

    Raises:
        ValueError: If suffix or size is not supported, if ffmpeg is not installed, or if a time is outside the flights.
    """
    if file.suffix not in VIDEO_SUFFIXES:
        raise ValueError(f"{file}: the file name must end in {' or '.join(VIDEO_SUFFIXES)}")
    if file.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError(f"{file}: MP4 requires ffmpeg, which is not installed; GIF does not require it")
    end = max(float(case.t[-1]) for case in data) if framing.end is None else framing.end
    for t in (framing.start, end):
        _check_time(data, t)
    if end < framing.start:
        raise ValueError(f"time {end:g} s: must not be before the start at {framing.start:g} s")
    if framing.size and file.suffix == ".mp4" and any(side % 2 for side in framing.size):
        raise ValueError("size: width and height of an MP4 must be even")
    rate = FRAME_RATE[file.suffix]
    times = np.arange(framing.start, end + 1e-9, speed / rate)
    with style.style_context():
        figure, frames = _make_frames(data, framing, dpi)
        drawn = _draw_frames(frames, times, progress)
        content = _gif(figure, drawn, rate) if file.suffix == ".gif" else _mp4(figure, drawn, rate)
    atomic_write.write_atomic(file, content)


def _check_time(data: Sequence[RenderData], t: float) -> None:
    """Raise ValueError if a time is outside the flights."""
    end = max(float(case.t[-1]) for case in data)
    if not 0 <= t <= end + 0.5 / scene.MAX_FRAME_RATE:
        raise ValueError(f"time {t:g} s: must be from 0 to {end:.6g} s, the end of the flight")


def _draw_frames(frames: _Frames, times: np.ndarray, progress: Callable[[int, int], None]) -> Iterator[None]:
    """Draw one time after the other."""
    for k, t in enumerate(times):
        signals.raise_if_interrupted()
        progress(k, len(times))
        frames.draw(float(t))
        yield


def _gif(figure: Figure, drawn: Iterator[None], rate: int) -> bytes:
    """Encode all frames with a palette of a few of them, so that static areas do not change between frames.

    A strip with the colours of arrows and agents is added, because thin lines have too few pixels to obtain a colour.
    """
    canvas = FigureCanvasAgg(figure)
    frames = []
    for _ in drawn:
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy()))
    few = frames[:: max(1, len(frames) // 4)]
    swatch = few[0].height // 3
    strip = Image.new("RGB", (few[0].width, few[0].height * len(few) + swatch), "white")
    for k, each in enumerate(few):
        strip.paste(each, (0, k * each.height))
    colors = (*COLORS.values(), *style.AGENT_COLORS[:2])
    for k, color in enumerate(colors):
        strip.paste(color, (k * swatch, few[0].height * len(few), (k + 1) * swatch, strip.height))
    palette = strip.quantize(PALETTE, dither=Image.Dither.NONE)
    first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in frames)
    buffer = io.BytesIO()
    first.save(buffer, "GIF", save_all=True, append_images=others, duration=1000 // rate, loop=0, optimize=True)
    return buffer.getvalue()


def _mp4(figure: Figure, drawn: Iterator[None], rate: int) -> bytes:
    """Encode all frames by ffmpeg."""
    writer = animation.FFMpegWriter(
        fps=rate, extra_args=["-pix_fmt", "yuv420p"]
    )  # the pixel format that all players support
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        FigureCanvasAgg(figure)
        with writer.saving(figure, str(path), figure.dpi):
            for _ in drawn:
                writer.grab_frame()
        return path.read_bytes()


@dataclasses.dataclass(frozen=True)
class _Frames:
    """Panels of all cases, and the part of the image plane that they show.

    Attributes:
        axes: Panel of each case.
        data: Drawing data of each case.
        low: Lower left corner of the view [m]; relative to the payload if the view follows it.
        high: Upper right corner of the view [m].
        follows: True if the view follows the payload.
    """

    axes: Sequence[Axes]
    data: Sequence[RenderData]
    low: np.ndarray
    high: np.ndarray
    follows: bool

    def draw(self, t: float) -> None:
        """Draw all panels at one time, each with title, time and position error."""
        for ax, case in zip(self.axes, self.data, strict=True):
            k = case.row_at(t)
            ax.clear()
            center = case.signals["p"][k] if self.follows else np.zeros(3)
            view = np.stack([self.low, self.high]) @ np.stack([case.camera.right, case.camera.up])
            draw(ax, case, k, view_corners=center + view)
            title = ax.text(0.03, 0.97, case.title, transform=ax.transAxes, va="top", fontsize=9, weight="bold")
            ended = f", ended at {case.t[-1]:.2f} s" if t > case.t[-1] + 1 / scene.MAX_FRAME_RATE else ""
            text = f"{t:5.2f} s{ended}\nposition error {1e3 * float(case.signals['e_p'][k, 0]):.0f} mm"
            values = ax.text(0.03, 0.03, text, transform=ax.transAxes, va="bottom", fontsize=8)
            for written in (title, values):
                written.set(path_effects=TEXT_OUTLINE, zorder=6)


def _make_frames(data: Sequence[RenderData], framing: Framing, dpi: float) -> tuple[Figure, _Frames]:
    """Make a figure with one panel per case and no margins, and choose the view.

    Args:
        data: Drawing data of each case.
        framing: Size and view.
        dpi: Resolution [1/in], if no size is given.

    Raises:
        ValueError: If the size is not supported.
    """
    n, data = len(data), _with_common_scale(data)
    size = framing.size
    if size is not None and not all(SIZE_LIMITS[0] <= side <= SIZE_LIMITS[1] for side in size):
        raise ValueError(
            f"size {size[0]}x{size[1]}: width and height must be from {SIZE_LIMITS[0]} to {SIZE_LIMITS[1]}"
        )
    ratio = None if size is None else size[1] / (size[0] / n)
    low, high, follows = _view(data, framing.follow, ratio)
    if size is None:
        ratio = float(np.clip((high - low)[1] / (high - low)[0], *PANEL_RATIOS))
        width, height = PANEL_INCHES * n, PANEL_STEP * round(PANEL_INCHES * ratio / PANEL_STEP)
    else:
        width, height = PANEL_INCHES * n, PANEL_INCHES * n * size[1] / size[0]
        dpi = size[0] / width
    figure = Figure(figsize=(width, height), dpi=dpi)
    figure.set_layout_engine("none")
    axes = [figure.add_axes((k / n, 0.0, 1 / n, 1.0)) for k in range(n)]
    return figure, _Frames(axes, data, low, high, follows)


def _view(data: Sequence[RenderData], follow: bool | None, ratio: float | None) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return the part of the image plane that all frames show, and whether it is relative to the payload.

    Args:
        data: Drawing data of each case.
        follow: See `Framing.follow`.
        ratio: Height over width of a panel; None if it follows from the content.
    """
    camera = data[0].camera
    points = camera.project(_flight_corners(data))
    low, high = points.min(axis=0), points.max(axis=0)
    rows = [(case, k) for case in data for k in case.sampled_rows()]
    bodies = [camera.project(_body_corners(case, k) - case.signals["p"][k]) for case, k in rows]
    team_height = float(np.median([np.ptp(each[:, 1]) for each in bodies]))
    if follow is None:
        wide = (high - low)[0] * (PANEL_RATIOS[0] if ratio is None else ratio)
        follow = team_height < MIN_TEAM_SHARE * (1 + TEXT_RATIO) * max((high - low)[1], wide)
    if not follow:
        low, high = low, high + np.array([0.0, TEXT_RATIO * (high - low)[1]])
        return low, high, False
    around = np.concatenate([camera.project(_team_corners(case, k) - case.signals["p"][k]) for case, k in rows])
    low, high = around.min(axis=0), around.max(axis=0)
    margin = FRAME_MARGIN * (high - low)
    low, high = low - margin, high + margin + np.array([0.0, TITLE_SHARE * (high - low)[1]])
    excess = (high - low)[1] - team_height / (MIN_TEAM_SHARE * 1.1)
    if excess > 0:  # the tips of long arrows are outside of the view
        middle = np.concatenate(bodies)[:, 1]
        share = np.array([low[1] - middle.min(), high[1] - middle.max()])
        low, high = low - [0.0, excess * share[0] / np.ptp(share)], high - [0.0, excess * share[1] / np.ptp(share)]
    return low, high, True


def _with_common_scale(data: Sequence[RenderData]) -> list[RenderData]:
    """Return the cases with common arrow scales, the largest of each kind, and the lowest ground."""
    scales = {kind: max(case.arrow_scales[kind] for case in data) for kind in data[0].arrow_scales}
    ground = min(case.ground for case in data)
    return [dataclasses.replace(case, arrow_scales=scales, ground=ground) for case in data]


# Drawing --------------------------------------------------------------------------------------------------------------


def draw(
    ax: Axes,
    data: RenderData,
    k: int,
    view_corners: np.ndarray | None = None,
    close: bool = False,
    names: bool = False,
    values: bool = False,
) -> None:
    """Draw one row of a flight into empty axes with equal scales in both directions.

    Args:
        ax: Axes to draw into.
        data: Drawing data of the case.
        k: Index of the drawn row.
        view_corners: Points that the view contains, world frame [m]; they override `close`.
        close: True if the view contains the team only; otherwise it contains the whole flight.
        names: True if the names of agents and contacts are written.
        values: True if thrusts and contact forces [N] are written below the names.
    """
    tracks, camera = data.signals, data.camera
    corners = view_corners
    if corners is None:
        corners = _team_corners(data, k) if close else _flight_corners([data])
    ground = _ground_lines(camera, corners, data.ground)
    ax.add_collection(LineCollection(list(ground), colors="#D3D8DD", linewidths=0.6, zorder=1))
    for points, color, width in (
        (tracks["p_d"], REFERENCE, 0.8),
        (tracks["p"][: k + 1], style.style_of(data.case).color, 1.6),
        (np.array([tracks["p"][k], [*tracks["p"][k][:2], data.ground]]), "#9AA3AC", 0.5),
    ):
        ax.add_line(Line2D(*camera.project(points).T, color=color, linewidth=width, zorder=2))
    faces = sorted(_team_faces(data, k), key=lambda face: face[0])
    ax.add_collection(
        PolyCollection(
            [face[1] for face in faces],
            facecolors=[face[2] for face in faces],
            edgecolors=[face[2] for face in faces],
            linewidths=0.8,  # covers the seams between patches
            zorder=3,
        )
    )
    for start, end in _reference_edges(data, k):
        ax.add_line(Line2D(*camera.project(np.array([start, end])).T, color=REFERENCE, lw=0.7, dashes=(3, 2), zorder=4))
    if names:
        _write_names(ax, data, k, values)
    low, high = camera.project(corners).min(axis=0), camera.project(corners).max(axis=0)
    middle, half = (low + high) / 2, 0.52 * (high - low)
    box = ax.get_window_extent()
    half = np.maximum(half, half[::-1] * np.array([box.width / box.height, box.height / box.width]))
    ax.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    ax.axis("off")


def _flight_corners(data: Sequence[RenderData]) -> np.ndarray:
    """Return points around all bodies during the flights, including the ground if it is near."""
    ground, points = data[0].ground, [case.signals["p_d"] for case in data]
    for case in data:
        points += [_team_corners(case, k) for k in case.sampled_rows()]
    corners = np.concatenate(points)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if low[2] - ground < GROUND_SHARE * np.linalg.norm(high - low):
        corners = np.concatenate([corners, [[*(low[:2] + high[:2]) / 2, ground]]])
    return corners


def _team_corners(data: RenderData, k: int) -> np.ndarray:
    """Return points around the team at one row: its bodies and the tips of the force arrows."""
    tracks, margin = {name: x[k] for name, x in data.signals.items()}, 0.05 * data.shape["size_m"]
    tips = [start + force / data.arrow_scales[kind] for kind, start, force in _forces(data, tracks)]
    points = np.concatenate([_body_corners(data, k), tips])
    sides = (data.camera.right, data.camera.up)
    return np.concatenate([points + sign * margin * along for sign in (-1, 1) for along in sides])


def _body_corners(data: RenderData, k: int) -> np.ndarray:
    """Return points around the bodies of the team at one row: payload, nodes and rotors."""
    tracks, payload = {name: x[k] for name, x in data.signals.items()}, data.shape["payload"]
    half = np.array(payload["half_m"])
    box = tracks["p"] + _corners(-half, half) @ (_rotation(tracks["q"]) @ _rotation(np.array(payload["axes_wxyz"]))).T
    rims = [
        base + _rotation(q) @ np.array(rotor) + sign * agent["rotor_radius_m"] * along
        for agent, base, q in zip(data.shape["agents"], tracks["base"], tracks["base_q"], strict=True)
        for rotor in agent["rotors_m"]
        for sign in (-1, 1)
        for along in (data.camera.right, data.camera.up)
    ]
    return np.concatenate([box, tracks["nodes"], rims])


def _corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the eight corners of an axis-aligned box."""
    pick = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    return np.where(pick, high, low)


def _ground_lines(camera: Camera, corners: np.ndarray, height: float) -> Iterator[np.ndarray]:
    """Return the projected lines of a ground grid that extends beyond the view; one line if the view is horizontal."""
    if abs(camera.direction[2]) < MIN_SLOPE:
        reach = 3 * np.ptp(corners, axis=0).max() * camera.right
        level = np.array([*corners.mean(axis=0)[:2], height])
        yield camera.project(np.stack([level - reach, level + reach]))
        return
    x, y = (lambda at: (at.min(axis=0), at.max(axis=0)))(camera.project(corners))
    frame = np.array([[a, b] for a in (x[0], y[0]) for b in (x[1], y[1])]) @ np.stack([camera.right, camera.up])
    below = camera.on_plane(frame, height)[:, :2]
    margin = np.ptp(below, axis=0).max()
    low, high = (below.min(axis=0) - margin) / GRID_SPACING, (below.max(axis=0) + margin) / GRID_SPACING
    for axis in (0, 1):
        for offset in np.arange(np.floor(low[axis]), np.ceil(high[axis]) + 1):
            ends = np.array([[*low, height / GRID_SPACING], [*high, height / GRID_SPACING]])
            ends[:, axis] = offset
            yield camera.project(GRID_SPACING * ends)


def _team_faces(data: RenderData, k: int) -> Iterator[solids.Face]:
    """Return all faces of bodies and arrows at one row."""
    shape, tracks, camera = data.shape, {name: x[k] for name, x in data.signals.items()}, data.camera
    line_width = 0.014 * shape["size_m"]
    R = _rotation(tracks["q"])
    case_color = style.style_of(data.case).color
    axes = R @ _rotation(np.array(shape["payload"]["axes_wxyz"]))
    yield from solids.box(camera, tracks["p"], axes, np.array(shape["payload"]["half_m"]), case_color)
    for contact in shape["contacts"]:
        tip, on_box = (tracks["p"] + R @ np.array(contact[name]) for name in ("at_m", "on_box_m"))
        if np.linalg.norm(tip - on_box) > scene.MIN_LINK_LENGTH:
            yield solids.rod(camera, on_box, tip, line_width, case_color)
    for j, agent in enumerate(shape["agents"]):
        yield from _vehicle_faces(camera, agent, tracks["base"][j], _rotation(tracks["base_q"][j]), line_width, j)
    nodes = tracks["nodes"]
    for start, end in shape["links"]:
        yield solids.rod(camera, nodes[start], nodes[end], line_width, ARM)
    for kind, node in zip(shape["nodes"], nodes, strict=True):
        if kind != "base":
            yield solids.ball(camera, node, 1.5 * line_width, case_color if kind == "tip" else ARM)
    for kind, start, force in _forces(data, tracks):
        yield from solids.arrow(
            camera, start, force / data.arrow_scales[kind], 0.8 * line_width, COLORS[kind], kind == "disturbance"
        )


def _vehicle_faces(
    camera: Camera, agent: Mapping[str, Any], position: np.ndarray, R: np.ndarray, line_width: float, j: int
) -> Iterator[solids.Face]:
    """Return the faces of a base: a hub in the color of the agent, and schematic rotors on booms."""
    hub = np.array([0.25, 0.25, 0.15]) * agent["span_m"]
    yield from solids.box(camera, position, R, hub, style.AGENT_COLORS[j % len(style.AGENT_COLORS)])
    for rotor in agent["rotors_m"]:
        middle = position + R @ np.array(rotor)
        yield solids.rod(camera, position, middle, 0.7 * line_width, FRAME)
        yield solids.disc(camera, middle, R, agent["rotor_radius_m"], FRAME)


def _forces(data: RenderData, tracks: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Return kind, point of application [m] and force [N] of each arrow, world frame."""
    for base, q, u in zip(tracks["base"], tracks["base_q"], tracks["u"], strict=True):
        yield "thrust", base, u * _rotation(q)[:, 2]
    for contact, lam in zip(data.shape["contacts"], tracks["lam"], strict=True):
        yield "contact", tracks["nodes"][contact["node"]], lam
    yield "disturbance", tracks["p"], tracks["disturbance"]


def _reference_edges(data: RenderData, k: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Return the edges of the payload's box at the reference pose, world frame [m]."""
    shape, tracks = data.shape["payload"], data.signals
    half = np.array(shape["half_m"])
    R = _rotation(tracks["q_d"][k]) @ _rotation(np.array(shape["axes_wxyz"]))
    corners = _corners(-half, half)
    for a in corners:
        for b in corners:
            if (a < b).sum() == 1 and (a == b).sum() == 2:
                yield tracks["p_d"][k] + R @ a, tracks["p_d"][k] + R @ b


def _write_names(ax: Axes, data: RenderData, k: int, values: bool) -> None:
    """Write the names of agents at their thrust arrows and the names of contacts below the arm tips."""
    tracks = {name: x[k] for name, x in data.signals.items()}
    for j, agent in enumerate(data.shape["agents"]):
        tip = tracks["base"][j] + tracks["u"][j] / data.arrow_scales["thrust"] * _rotation(tracks["base_q"][j])[:, 2]
        name = f"{agent['name']}\n{tracks['u'][j]:.3g} N" if values else agent["name"]
        _write(ax, name, data.camera.project(tip), 3, "bottom", 8)
    for contact, force in zip(data.shape["contacts"], np.linalg.norm(tracks["lam"], axis=1), strict=True):
        name = contact["name"].split("/")[1]
        text = f"{name}\n{force:.3g} N" if values else name
        _write(ax, text, data.camera.project(tracks["nodes"][contact["node"]]), -5, "top", 7)


def _write(ax: Axes, text: str, position: np.ndarray, offset: int, side: Literal["top", "bottom"], size: int) -> None:
    """Write a text above or below a point of the image plane; the offset is in points."""
    written = ax.annotate(
        text,
        (position[0], position[1]),
        (0, offset),
        textcoords="offset points",
        ha="center",
        va=side,
        fontsize=size,
        zorder=5,
    )
    written.set(path_effects=TEXT_OUTLINE, linespacing=1.0)


def _rotation(q: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
