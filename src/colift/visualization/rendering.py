"""Images and videos of logged flights, drawn by matplotlib without a browser or a GPU.

The projection is orthographic: lengths perpendicular to the viewing direction are to scale. Faces are drawn from the
farthest to the nearest (painter's algorithm). Decision record 0033 states the reasons.
"""

from __future__ import annotations

import dataclasses
import io
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib import animation, patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from colift.analysis import poses
from colift.runtime import atomic_write, signals
from colift.scenario import team as team_module
from colift.visualization import scene, style

CAMERA_DIRECTION = np.array([0.75, -1.5, 0.62]) / np.linalg.norm(
    [0.75, -1.5, 0.62]
)  # towards the camera, as in the playback page
CAMERA_RIGHT = np.cross([0.0, 0.0, 1.0], CAMERA_DIRECTION) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], CAMERA_DIRECTION))
CAMERA_UP = np.cross(CAMERA_DIRECTION, CAMERA_RIGHT)
LIGHT_DIRECTION = np.array([0.3, -0.4, 0.86])
FOLLOW_DISTANCE = 12.0  # team sizes; on longer paths the view follows the payload
FOLLOW_MARGIN = 1.15  # team sizes, from the payload to the edge of a view that follows it
GROUND_SHARE = 0.15  # of the size of the flight, height up to which a view of the whole flight includes the ground
VIEW_ROWS = 40  # rows of a flight whose bodies determine the view of the whole flight
HALO: list[patheffects.AbstractPathEffect] = [
    patheffects.withStroke(linewidth=2.2, foreground="white")
]  # around names, which may lie on bodies and arrows
GRID_SPACING = 1.0  # m, line spacing of the ground grid
COLORS = {"thrust": "#228833", "contact": "#111111", "disturbance": "#0099CC"}  # of force arrows
REFERENCE, FRAME, ARM = "#33393F", "#3D444C", "#8A939D"
IMAGE_SUFFIXES, VIDEO_SUFFIXES = (".png", ".pdf", ".svg"), (".gif", ".mp4")
PANEL_INCHES = 3.6  # in, width of the panel of one case
PANEL_STEP = 0.2  # in, its height is a multiple of this, which gives an even number of pixels, as videos require
PANEL_RATIOS = (0.55, 1.1)  # limits of its height over its width
TEXT_RATIO = 0.2  # height of title and readings over its width
VIDEO_DPI = 110
FRAME_RATE = {".gif": 20, ".mp4": 30}  # 1/s; the frame duration of a GIF is a multiple of 0.01 s
PALETTE = 48  # number of colors of a GIF
PATCHES_PER_EDGE = 6  # patches along an edge of a box; the depth order is determined per patch


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
    """

    case: str
    title: str
    t: np.ndarray
    signals: Mapping[str, np.ndarray]
    shape: Mapping[str, Any]
    arrow_scales: Mapping[str, float]
    ground: float

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


# Files ----------------------------------------------------------------------------------------------------------------


def render_image(data: Sequence[RenderData], t: float, file: Path) -> None:
    """Write an image of one or more cases side by side at one time.

    A file that cannot be written raises `OSError`.

    Args:
        data: Drawing data of each case.
        t: Time [s].
        file: Path of the file; the suffix `.png`, `.pdf` or `.svg` determines the format.

    Raises:
        ValueError: If the suffix is not supported, or if the time is outside the flights.

    Example:
        >>> render_image([render_data(log.load("out/paper/C3.nc"))], 12.0, Path("team.png"))  # doctest: +SKIP
    """
    if file.suffix not in IMAGE_SUFFIXES:
        raise ValueError(f"{file}: the file name must end in {', '.join(IMAGE_SUFFIXES)}")
    _check_time(data, t)
    with style.style_context():
        figure, axes = _make_panels(data)
        _draw_frame(axes, _with_common_scale(data), t)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=file.suffix[1:], dpi=200)
    atomic_write.write_atomic(file, buffer.getvalue())


def render_video(
    data: Sequence[RenderData], file: Path, speed: float = 1.0, dpi: float = VIDEO_DPI, start: float = 0.0
) -> None:
    """Write a video of one or more cases side by side.

    A file that cannot be written raises `OSError`.

    Args:
        data: Drawing data of each case.
        file: Path of the file; the suffix `.gif` or `.mp4` determines the format. MP4 requires ffmpeg.
        speed: Playback speed relative to real time.
        dpi: Resolution [1/in]; the panel of one case has a width of 3.6 in.
        start: Time of the first frame [s].

    Raises:
        ValueError: If the suffix is not supported, if ffmpeg is not installed, or if the start is outside the flights.
    """
    if file.suffix not in VIDEO_SUFFIXES:
        raise ValueError(f"{file}: the file name must end in {' or '.join(VIDEO_SUFFIXES)}")
    if file.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError(f"{file}: MP4 requires ffmpeg, which is not installed; GIF does not require it")
    _check_time(data, start)
    end, rate = max(float(case.t[-1]) for case in data), FRAME_RATE[file.suffix]
    times = np.arange(start, end + 1e-9, speed / rate)
    with style.style_context():
        figure, axes = _make_panels(data)
        figure.set_dpi(dpi)
        frames = _draw_frames(axes, _with_common_scale(data), times)
        content = _gif(figure, frames, rate) if file.suffix == ".gif" else _mp4(figure, frames, rate)
    atomic_write.write_atomic(file, content)


def _check_time(data: Sequence[RenderData], t: float) -> None:
    """Raise ValueError if a time is outside the flights."""
    end = max(float(case.t[-1]) for case in data)
    if not 0 <= t <= end + 0.5 / scene.MAX_FRAME_RATE:
        raise ValueError(f"time {t:g} s: must be from 0 to {end:.6g} s, the end of the flight")


def _draw_frames(axes: Sequence[Axes], data: Sequence[RenderData], times: np.ndarray) -> Iterator[None]:
    """Draw one time after the other."""
    for t in times:
        signals.raise_if_interrupted()
        _draw_frame(axes, data, float(t))
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
    swatch = few[0].height // 6
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


def _make_panels(data: Sequence[RenderData]) -> tuple[Figure, list[Axes]]:
    """Make a figure with one panel per case and no margins; the height follows from the view of the flight."""
    low, high = (limit(_project(_view_corners(data, 0)), axis=0) for limit in (np.min, np.max))
    ratio = float(np.clip((high - low)[1] / (high - low)[0] + TEXT_RATIO, *PANEL_RATIOS))
    height = PANEL_STEP * round(PANEL_INCHES * ratio / PANEL_STEP)
    figure = Figure(figsize=(PANEL_INCHES * len(data), height))
    figure.set_layout_engine("none")
    n = len(data)
    return figure, [figure.add_axes((k / n, 0.0, 1 / n, 1.0)) for k in range(n)]


def _with_common_scale(data: Sequence[RenderData]) -> list[RenderData]:
    """Return the cases with common arrow scales, the largest of each kind, and the lowest ground."""
    scales = {kind: max(case.arrow_scales[kind] for case in data) for kind in data[0].arrow_scales}
    ground = min(case.ground for case in data)
    return [dataclasses.replace(case, arrow_scales=scales, ground=ground) for case in data]


def _draw_frame(axes: Sequence[Axes], data: Sequence[RenderData], t: float) -> None:
    """Draw all panels at one time, each with title, time and position error."""
    corners = None if _path_is_long(data) else _flight_corners(data)
    for ax, case in zip(axes, data, strict=True):
        k = case.row_at(t)
        ax.clear()
        draw(ax, case, k, view_corners=corners)
        ax.text(0.03, 0.97, case.title, transform=ax.transAxes, va="top", fontsize=9, weight="bold")
        ended = f", ended at {case.t[-1]:.2f} s" if t > case.t[-1] + 1 / scene.MAX_FRAME_RATE else ""
        text = f"{t:5.2f} s{ended}\nposition error {1e3 * float(case.signals['e_p'][k, 0]):.0f} mm"
        ax.text(0.03, 0.03, text, transform=ax.transAxes, va="bottom", fontsize=8)


# Drawing --------------------------------------------------------------------------------------------------------------


def draw(
    ax: Axes,
    data: RenderData,
    k: int,
    view_corners: np.ndarray | None = None,
    close: bool = False,
    whole_path: bool = False,
    names: bool = False,
    values: bool = False,
) -> None:
    """Draw one row of a flight into empty axes with equal scales in both directions.

    Args:
        ax: Axes to draw into.
        data: Drawing data of the case.
        k: Index of the drawn row.
        view_corners: Points that the view contains, world frame [m]; they override `close` and `whole_path`.
        close: True if the view contains the team only.
        whole_path: True if the view contains the whole flight. If neither is set, the length of the path decides.
        names: True if the names of agents and contacts are written.
        values: True if thrusts and contact forces [N] are written below the names.
    """
    tracks, size = data.signals, data.shape["size_m"]
    whole = whole_path or not (close or _path_is_long([data]))
    if view_corners is not None:
        corners = view_corners
    elif close:
        corners = _team_corners(data, k)
    else:
        corners = _flight_corners([data]) if whole else _follow_corners(tracks["p"][k], size)
    ground = _ground_lines(corners, data.ground)
    ax.add_collection(LineCollection(list(ground), colors="#D3D8DD", linewidths=0.6, zorder=1))
    for points, color, width in (
        (tracks["p_d"], REFERENCE, 0.8),
        (tracks["p"][: k + 1], style.style_of(data.case).color, 1.6),
        (np.array([tracks["p"][k], [*tracks["p"][k][:2], data.ground]]), "#9AA3AC", 0.5),
    ):
        ax.add_line(Line2D(*_project(points).T, color=color, linewidth=width, zorder=2))
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
        ax.add_line(Line2D(*_project(np.array([start, end])).T, color=REFERENCE, lw=0.7, dashes=(3, 2), zorder=4))
    if names:
        _write_names(ax, data, k, values)
    low, high = _project(corners).min(axis=0), _project(corners).max(axis=0)
    middle, half = (low + high) / 2, 0.52 * (high - low)
    box = ax.get_window_extent()
    half = np.maximum(half, half[::-1] * np.array([box.width / box.height, box.height / box.width]))
    ax.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    ax.axis("off")


Face = tuple[float, np.ndarray, tuple[float, ...]]  # depth towards the camera, projected corners (n, 2), color


def _project(points: np.ndarray) -> np.ndarray:
    """Project points of the world onto the image plane: right and up [m]."""
    return np.stack([points @ CAMERA_RIGHT, points @ CAMERA_UP], axis=-1)


def _path_is_long(data: Sequence[RenderData]) -> bool:
    """Return whether the reference path is too long for a view of the whole flight."""
    path = np.concatenate([case.signals["p_d"] for case in data])
    return bool(np.linalg.norm(np.ptp(path, axis=0)) > FOLLOW_DISTANCE * data[0].shape["size_m"])


def _view_corners(data: Sequence[RenderData], k: int) -> np.ndarray:
    """Return points that the view of the flight contains, or that of the row k if the path is long."""
    if _path_is_long(data):
        return _follow_corners(data[0].signals["p"][k], data[0].shape["size_m"])
    return _flight_corners(data)


def _flight_corners(data: Sequence[RenderData]) -> np.ndarray:
    """Return points around all bodies during the flights, including the ground if it is near."""
    ground, points = data[0].ground, [case.signals["p_d"] for case in data]
    for case in data:
        rows = range(0, len(case.t), max(1, len(case.t) // VIEW_ROWS))
        points += [_team_corners(case, k) for k in (*rows, len(case.t) - 1)]
    corners = np.concatenate(points)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if low[2] - ground < GROUND_SHARE * np.linalg.norm(high - low):
        corners = np.concatenate([corners, [[*(low[:2] + high[:2]) / 2, ground]]])
    return corners


def _team_corners(data: RenderData, k: int) -> np.ndarray:
    """Return points around the team at one row: payload, nodes, rotors and the tips of the force arrows."""
    tracks, payload = {name: x[k] for name, x in data.signals.items()}, data.shape["payload"]
    half, margin = np.array(payload["half_m"]), 0.05 * data.shape["size_m"]
    box = tracks["p"] + _corners(-half, half) @ (_rotation(tracks["q"]) @ _rotation(np.array(payload["axes_wxyz"]))).T
    tips = [start + force / data.arrow_scales[kind] for kind, start, force in _forces(data, tracks)]
    rims = [
        base + _rotation(q) @ np.array(rotor) + sign * agent["rotor_radius_m"] * along
        for agent, base, q in zip(data.shape["agents"], tracks["base"], tracks["base_q"], strict=True)
        for rotor in agent["rotors_m"]
        for sign in (-1, 1)
        for along in (CAMERA_RIGHT, CAMERA_UP)
    ]
    points = np.concatenate([box, tracks["nodes"], tips, rims])
    return np.concatenate([points + sign * margin * along for sign in (-1, 1) for along in (CAMERA_RIGHT, CAMERA_UP)])


def _follow_corners(p: np.ndarray, size: float) -> np.ndarray:
    """Return the corners of a view that follows the payload at p [m]; `size` is that of the team [m]."""
    return _corners(p - FOLLOW_MARGIN * size * np.array([1, 1, 0.5]), p + FOLLOW_MARGIN * size * np.ones(3))


def _corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the eight corners of an axis-aligned box."""
    pick = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    return np.where(pick, high, low)


def _ground_lines(corners: np.ndarray, height: float) -> Iterator[np.ndarray]:
    """Return the projected lines of a ground grid that extends beyond the view."""
    low, high = np.floor(corners.min(axis=0) / GRID_SPACING) - 3, np.ceil(corners.max(axis=0) / GRID_SPACING) + 3
    for axis in (0, 1):
        for offset in np.arange(low[axis], high[axis] + 1):
            ends = np.array([[*low[:2], height / GRID_SPACING], [*high[:2], height / GRID_SPACING]])
            ends[:, axis] = offset
            yield _project(GRID_SPACING * ends)


def _team_faces(data: RenderData, k: int) -> Iterator[Face]:
    """Return all faces of bodies and arrows at one row."""
    shape, tracks = data.shape, {name: x[k] for name, x in data.signals.items()}
    line_width = 0.014 * shape["size_m"]
    R = _rotation(tracks["q"])
    case_color = style.style_of(data.case).color
    axes = R @ _rotation(np.array(shape["payload"]["axes_wxyz"]))
    yield from _box(tracks["p"], axes, np.array(shape["payload"]["half_m"]), case_color)
    for contact in shape["contacts"]:
        tip, on_box = (tracks["p"] + R @ np.array(contact[name]) for name in ("at_m", "on_box_m"))
        if np.linalg.norm(tip - on_box) > scene.MIN_LINK_LENGTH:
            yield _rod(on_box, tip, line_width, case_color)
    for j, agent in enumerate(shape["agents"]):
        yield from _vehicle_faces(agent, tracks["base"][j], _rotation(tracks["base_q"][j]), line_width, j)
    nodes = tracks["nodes"]
    for start, end in shape["links"]:
        yield _rod(nodes[start], nodes[end], line_width, ARM)
    for kind, node in zip(shape["nodes"], nodes, strict=True):
        if kind != "base":
            yield _ball(node, 1.5 * line_width, case_color if kind == "tip" else ARM)
    for kind, start, force in _forces(data, tracks):
        yield from _arrow(start, force / data.arrow_scales[kind], 0.8 * line_width, COLORS[kind], kind == "disturbance")


def _vehicle_faces(
    agent: Mapping[str, Any], position: np.ndarray, R: np.ndarray, line_width: float, j: int
) -> Iterator[Face]:
    """Return the faces of a base: a hub in the color of the agent, and schematic rotors on booms."""
    hub = np.array([0.25, 0.25, 0.15]) * agent["span_m"]
    yield from _box(position, R, hub, style.AGENT_COLORS[j % len(style.AGENT_COLORS)])
    for rotor in agent["rotors_m"]:
        middle = position + R @ np.array(rotor)
        yield _rod(position, middle, 0.7 * line_width, FRAME)
        yield _disc(middle, R, agent["rotor_radius_m"])


def _forces(data: RenderData, tracks: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Return kind, point of application [m] and force [N] of each arrow, world frame."""
    for base, q, u in zip(tracks["base"], tracks["base_q"], tracks["u"], strict=True):
        yield "thrust", base, u * _rotation(q)[:, 2]
    for contact, lam in zip(data.shape["contacts"], tracks["lam"], strict=True):
        yield "contact", tracks["nodes"][contact["node"]], lam
    yield "disturbance", tracks["p"], tracks["disturbance"]


def _box(center: np.ndarray, R: np.ndarray, half: np.ndarray, color: str) -> Iterator[Face]:
    """Return the visible faces of a box in patches; faces towards the light are lighter."""
    for axis in range(3):
        sign = 1.0 if R[:, axis] @ CAMERA_DIRECTION > 0 else -1.0
        normal = sign * R[:, axis]
        first, second = (half[(axis + n) % 3] * R[:, (axis + n) % 3] / PATCHES_PER_EDGE for n in (1, 2))
        light = 0.72 + 0.28 * max(0.0, float(normal @ LIGHT_DIRECTION))
        paint = tuple(light * c for c in to_rgb(color))
        for a, b in np.ndindex(PATCHES_PER_EDGE, PATCHES_PER_EDGE):
            middle = (
                center
                + half[axis] * normal
                + (2 * a + 1 - PATCHES_PER_EDGE) * first
                + (2 * b + 1 - PATCHES_PER_EDGE) * second
            )
            corners = np.array(
                [middle + first + second, middle + first - second, middle - first - second, middle - first + second]
            )
            yield float(middle @ CAMERA_DIRECTION), _project(corners), paint


def _rod(start: np.ndarray, end: np.ndarray, radius: float, color: str) -> Face:
    """Return a rod as a rectangle in the image plane."""
    a, b = _project(start), _project(end)
    along = b - a
    side = radius * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    return (
        float((start + end) @ CAMERA_DIRECTION / 2),
        np.array([a + side, b + side, b - side, a - side]),
        to_rgb(color),
    )


UNIT_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 24)), np.sin(np.linspace(0, 2 * np.pi, 24))], axis=-1)


def _disc(center: np.ndarray, R: np.ndarray, radius: float) -> Face:
    """Return the disc of a rotor."""
    rim = center + radius * UNIT_CIRCLE @ R[:, :2].T
    return float(center @ CAMERA_DIRECTION), _project(rim), (*to_rgb(FRAME), 0.25)


def _ball(center: np.ndarray, radius: float, color: str) -> Face:
    """Return a ball as a circle in the image plane."""
    return float(center @ CAMERA_DIRECTION) + radius, _project(center) + radius * UNIT_CIRCLE, to_rgb(color)


def _arrow(start: np.ndarray, along: np.ndarray, radius: float, color: str, on_top: bool) -> Iterator[Face]:
    """Return shaft and head of an arrow; `on_top` draws it over all other faces."""
    length = float(np.linalg.norm(along))
    if length < scene.MIN_LINK_LENGTH:
        return
    head = min(7 * radius, length)
    head_start, tip = start + (1 - head / length) * along, start + along
    a, b = _project(head_start), _project(tip)
    side = 0.4 * head * np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.hypot(*(b - a))), 1e-9)
    depth, shaft, paint = _rod(start, head_start, radius, color)
    near = np.inf if on_top else depth + 2 * radius
    yield near, shaft, paint
    yield near, np.array([a + side, b, a - side]), paint


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
        _write(ax, name, tip, 3, "bottom", 8)
    for contact, force in zip(data.shape["contacts"], np.linalg.norm(tracks["lam"], axis=1), strict=True):
        name = contact["name"].split("/")[1]
        text = f"{name}\n{force:.3g} N" if values else name
        _write(ax, text, tracks["nodes"][contact["node"]], -5, "top", 7)


def _write(ax: Axes, text: str, position: np.ndarray, offset: int, side: Literal["top", "bottom"], size: int) -> None:
    """Write a text above or below a point of the world; the offset is in points."""
    x, y = _project(position)
    written = ax.annotate(
        text, (x, y), (0, offset), textcoords="offset points", ha="center", va=side, fontsize=size, zorder=5
    )
    written.set(path_effects=HALO, linespacing=1.0)


def _rotation(q: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
