"""Flights as pictures and films, drawn from the log by matplotlib: no browser, no GPU (decision 0033).

Seen along one direction without perspective, so that lengths across it are to scale; far faces first, near ones over
them.
"""

from __future__ import annotations

import dataclasses
import io
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import animation
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

CAMERA_DIRECTION = np.array([0.75, -1.5, 0.62]) / np.linalg.norm([0.75, -1.5, 0.62])  # towards the eye, as in the page
RIGHT = np.cross([0.0, 0.0, 1.0], CAMERA_DIRECTION) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], CAMERA_DIRECTION))
UP = np.cross(CAMERA_DIRECTION, RIGHT)
LIGHT_DIRECTION = np.array([0.3, -0.4, 0.86])
FOLLOW_DISTANCE = 12.0  # sizes of the team: on longer paths the view follows the payload
FOLLOW_MARGIN = 1.15  # sizes of the team, from the payload to the edge of a view that follows it
GRID = 1.0  # m
COLORS = {"thrust": "#228833", "contact": "#111111", "disturbance": "#0099CC"}  # of arrows
REFERENCE, FRAME, ARM = "#33393F", "#3D444C", "#8A939D"
STILLS, FILMS = (".png", ".pdf", ".svg"), (".gif", ".mp4")
PANEL_INCHES = 3.6  # of a case's panel in a picture or film
DOTS = 110  # an inch of a film
FRAME_RATE = {".gif": 20, ".mp4": 30}  # frames; a GIF counts in hundredths of a second
PALETTE = 48  # colours of a GIF
PATCHES = 6  # along an edge of a box: what is nearer than one of them is drawn over it


@dataclasses.dataclass(frozen=True)
class RenderData:
    """What pictures of one case are drawn from."""

    case: str
    title: str
    t: np.ndarray  # s, of the drawn rows
    signals: Mapping[str, np.ndarray]  # `scene.frames` and the position error, e_p
    shape: Mapping[str, Any]  # `scene.shape`
    N_per_m: Mapping[str, float]  # of each kind of arrow
    ground: float  # m

    def row_at(self, t: float) -> int:
        """The drawn row that is nearest to a time; the last one of a flight that has ended."""
        return int(np.argmin(np.abs(self.t - t)))


def render_data(ds: xr.Dataset, title: str = "") -> RenderData:
    """What pictures of a flight are drawn from; raises ValueError for a log that does not hold its scenario."""
    told = poses.scenario_of_log(ds)
    team, _ = team_module.team(told)
    shape, tracks = scene.team_geometry(team, told), scene.frames(ds, team)
    moving = {"": tracks}
    return RenderData(
        case=str(ds.attrs["case"]),
        title=title,
        t=ds.time.values[scene.frame_rows(ds)],
        signals=tracks | {"e_p": scene.plot_signals(ds)["e_p"]},
        shape=shape,
        N_per_m=scene.arrow_scales(moving, shape["size_m"]),
        ground=scene.ground_height(moving),
    )


def arrow_scale_label(seen: RenderData) -> str:
    """How many newtons a metre of arrow is."""
    return "a metre of arrow: " + ", ".join(f"{kind} {x:g} N" for kind, x in seen.N_per_m.items())


# Files ----------------------------------------------------------------------------------------------------------------


def render_image(seen: Sequence[RenderData], t: float, file: Path) -> None:
    """Write a picture of some cases beside each other at a time, s, as PNG, PDF or SVG.

    Raises ValueError for another kind of file or a time outside of the flights, OSError where it cannot be written.
    """
    if file.suffix not in STILLS:
        raise ValueError(f"{file}: must end in {', '.join(STILLS)}")
    _within(seen, t)
    with style.style_context():
        figure, axes = _panels(seen)
        _frame(axes, _alike(seen), t)
        state = io.BytesIO()
        figure.savefig(state, format=file.suffix[1:], dpi=200)
    atomic_write.write_atomic(file, state.getvalue())


def render_video(
    seen: Sequence[RenderData], file: Path, speed: float = 1.0, dots: float = DOTS, start: float = 0.0
) -> None:
    """Write the flights of some cases beside each other as GIF or, by ffmpeg, as MP4; `speed` times as fast as flown.

    dots: an inch, of 3.6 a case. start: s, where it begins. Raises ValueError for another kind of file, or where there
    is no ffmpeg for an MP4; OSError where it cannot be written.
    """
    if file.suffix not in FILMS:
        raise ValueError(f"{file}: must end in {' or '.join(FILMS)}")
    if file.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError(f"{file}: there is no ffmpeg to write it with; a .gif needs none")
    _within(seen, start)
    end, rate = max(float(each.t[-1]) for each in seen), FRAME_RATE[file.suffix]
    times = np.arange(start, end + 1e-9, speed / rate)
    with style.style_context():
        figure, axes = _panels(seen)
        figure.set_dpi(dots)
        drawn = _drawn(axes, _alike(seen), times)
        content = _gif(figure, drawn, rate) if file.suffix == ".gif" else _mp4(figure, drawn, rate)
    atomic_write.write_atomic(file, content)


def _within(seen: Sequence[RenderData], t: float) -> None:
    end = max(float(each.t[-1]) for each in seen)
    if not 0 <= t <= end + 0.5 / scene.MAX_FRAME_RATE:
        raise ValueError(f"time {t:g} s: must be from 0 to {end:.6g} s, where the flight ends")


def _drawn(axes: Sequence[Axes], seen: Sequence[RenderData], times: np.ndarray) -> Iterator[None]:
    """Draws one time after the other."""
    for t in times:
        signals.raise_if_interrupted()
        _frame(axes, seen, float(t))
        yield


def _gif(figure: Figure, drawn: Iterator[None], rate: int) -> bytes:
    """All frames in the colours of a few of them, so that what stands still costs nothing."""
    canvas = FigureCanvasAgg(figure)
    frames = []
    for _ in drawn:
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy()))
    few = frames[:: max(1, len(frames) // 4)]
    strip = Image.new("RGB", (few[0].width, few[0].height * len(few)))
    for k, each in enumerate(few):
        strip.paste(each, (0, k * each.height))
    palette = strip.quantize(PALETTE, dither=Image.Dither.NONE)
    first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in frames)
    state = io.BytesIO()
    first.save(state, "GIF", save_all=True, append_images=others, duration=1000 // rate, loop=0, optimize=True)
    return state.getvalue()


def _mp4(figure: Figure, drawn: Iterator[None], rate: int) -> bytes:
    writer = animation.FFMpegWriter(fps=rate, extra_args=["-pix_fmt", "yuv420p"])  # which every player takes
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        FigureCanvasAgg(figure)
        with writer.saving(figure, str(path), figure.dpi):
            for _ in drawn:
                writer.grab_frame()
        return path.read_bytes()


def _panels(seen: Sequence[RenderData]) -> tuple[Figure, list[Axes]]:
    """A figure with a panel a case, to the edge."""
    figure = Figure(figsize=(PANEL_INCHES * len(seen), PANEL_INCHES))
    figure.set_layout_engine("none")
    n = len(seen)
    return figure, [figure.add_axes((k / n, 0.0, 1 / n, 1.0)) for k in range(n)]


def _alike(seen: Sequence[RenderData]) -> list[RenderData]:
    """The cases with arrows of one scale, the most newtons a metre, over the lowest ground."""
    scales = {kind: max(each.N_per_m[kind] for each in seen) for kind in seen[0].N_per_m}
    ground = min(each.ground for each in seen)
    return [dataclasses.replace(each, N_per_m=scales, ground=ground) for each in seen]


def _frame(axes: Sequence[Axes], seen: Sequence[RenderData], t: float) -> None:
    """All panels at a time, each with case, time and error."""
    around = None if _far(seen) else _box_around(seen)
    for ax, each in zip(axes, seen, strict=True):
        k = each.row_at(t)
        ax.clear()
        draw(ax, each, k, around=around)
        ax.text(0.03, 0.97, each.title, transform=ax.transAxes, va="top", fontsize=9, weight="bold")
        ended = f", ended at {each.t[-1]:.2f} s" if t > each.t[-1] + 1 / scene.MAX_FRAME_RATE else ""
        said = f"{t:5.2f} s{ended}\nposition error {1e3 * float(each.signals['e_p'][k, 0]):.0f} mm"
        ax.text(0.03, 0.03, said, transform=ax.transAxes, va="bottom", fontsize=8)


# The drawing ----------------------------------------------------------------------------------------------------------


def draw(
    ax: Axes,
    seen: RenderData,
    k: int,
    around: np.ndarray | None = None,
    close: bool = False,
    whole_path: bool = False,
    names: bool = False,
) -> None:
    """Draw the k-th of a case's drawn rows into axes, which show nothing else, the same length across as up.

    around: corners of what is to be seen, m, else, with `close`, the team, with `whole_path` the flight, without both
    whichever is fit to see it move. names: agents and contacts are written beside them.
    """
    tracks, size = seen.signals, seen.shape["size_m"]
    whole = whole_path or not (close or _far([seen]))
    if around is not None:
        corners = around
    elif close:
        corners = _points(seen, k)
    else:
        corners = _box_around([seen]) if whole else _about(tracks["p"][k], size)
    ground = _ground_lines(corners, seen.ground)
    ax.add_collection(LineCollection(list(ground), colors="#D3D8DD", linewidths=0.6, zorder=1))
    for points, color, width in (
        (tracks["p_d"], REFERENCE, 0.8),
        (tracks["p"][: k + 1], style.style_of(seen.case).color, 1.6),
        (np.array([tracks["p"][k], [*tracks["p"][k][:2], seen.ground]]), "#9AA3AC", 0.5),
    ):
        ax.add_line(Line2D(*_across(points).T, color=color, linewidth=width, zorder=2))
    faces = sorted(_team(seen, k), key=lambda face: face[0])
    ax.add_collection(
        PolyCollection(
            [face[1] for face in faces],
            facecolors=[face[2] for face in faces],
            edgecolors=[face[2] for face in faces],
            linewidths=0.3,
            zorder=3,
        )
    )
    for start, end in _wanted(seen, k):
        ax.add_line(Line2D(*_across(np.array([start, end])).T, color=REFERENCE, lw=0.7, dashes=(3, 2), zorder=4))
    if names:
        _write_names(ax, seen, k)
    low, high = _across(corners).min(axis=0), _across(corners).max(axis=0)
    middle, half = (low + high) / 2, 0.52 * (high - low)
    box = ax.get_window_extent()
    half = np.maximum(half, half[::-1] * np.array([box.width / box.height, box.height / box.width]))
    ax.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    ax.axis("off")


Face = tuple[float, np.ndarray, tuple[float, ...]]  # how near, corners across the view (n, 2), colour


def _across(points: np.ndarray) -> np.ndarray:
    """Where points of the world are seen: m to the right, m up."""
    return np.stack([points @ RIGHT, points @ UP], axis=-1)


def _far(seen: Sequence[RenderData]) -> bool:
    path = np.concatenate([each.signals["p_d"] for each in seen])
    return bool(np.linalg.norm(np.ptp(path, axis=0)) > FOLLOW_DISTANCE * seen[0].shape["size_m"])


def _box_around(seen: Sequence[RenderData]) -> np.ndarray:
    """Points about all that moves, and the ground below it where that is not far."""
    size, ground = seen[0].shape["size_m"], seen[0].ground
    points = [each.signals[name].reshape(-1, 3) for each in seen for name in ("p", "p_d", "base", "nodes")]
    held = np.concatenate(points)
    low, high = held.min(axis=0), held.max(axis=0)
    shape = seen[0].shape
    reach = [np.linalg.norm(at) + one["rotor_radius_m"] for one in shape["agents"] for at in one["rotors_m"]]
    margin = 0.12 * size + max([float(np.linalg.norm(shape["payload"]["half_m"])), *reach])
    held = np.concatenate([held - margin, held + margin, [held[held[:, 2].argmax()] + [0, 0, 0.6 * size]]])
    if low[2] - ground < np.linalg.norm(high - low):
        held = np.concatenate([held, [[*(low[:2] + high[:2]) / 2, ground]]])
    return held


def _points(seen: RenderData, k: int) -> np.ndarray:
    """What a view of the team alone must hold: bodies, contacts and the tips of the arrows of thrust."""
    tracks, payload = {name: x[k] for name, x in seen.signals.items()}, seen.shape["payload"]
    half, margin = np.array(payload["half_m"]), 0.12 * seen.shape["size_m"]
    box = tracks["p"] + _corners(-half, half) @ (_rotation(tracks["q"]) @ _rotation(np.array(payload["axes_wxyz"]))).T
    tips = [base + force / seen.N_per_m[kind] for kind, base, force in _forces(seen, tracks) if kind == "thrust"]
    held = np.concatenate([box, tracks["nodes"], tips])
    return np.concatenate([held - margin, held + margin])


def _about(p: np.ndarray, size: float) -> np.ndarray:
    return _corners(p - FOLLOW_MARGIN * size * np.array([1, 1, 0.5]), p + FOLLOW_MARGIN * size * np.ones(3))


def _corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    pick = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    return np.where(pick, high, low)


def _ground_lines(corners: np.ndarray, height: float) -> Iterator[np.ndarray]:
    """A grid on the ground, some metres beyond what is seen."""
    low, high = np.floor(corners.min(axis=0) / GRID) - 3, np.ceil(corners.max(axis=0) / GRID) + 3
    for axis in (0, 1):
        for at in np.arange(low[axis], high[axis] + 1):
            ends = np.array([[*low[:2], height / GRID], [*high[:2], height / GRID]])
            ends[:, axis] = at
            yield _across(GRID * ends)


def _team(seen: RenderData, k: int) -> Iterator[Face]:
    """Every face of bodies and arrows at one row."""
    shape, tracks = seen.shape, {name: x[k] for name, x in seen.signals.items()}
    thick = 0.014 * shape["size_m"]
    R = _rotation(tracks["q"])
    own = style.style_of(seen.case).color
    axes = R @ _rotation(np.array(shape["payload"]["axes_wxyz"]))
    yield from _box(tracks["p"], axes, np.array(shape["payload"]["half_m"]), own)
    for contact in shape["contacts"]:
        at, on = (tracks["p"] + R @ np.array(contact[name]) for name in ("at_m", "on_box_m"))
        if np.linalg.norm(at - on) > scene.MIN_LINK_LENGTH:
            yield _rod(on, at, thick, own)
    for j, agent in enumerate(shape["agents"]):
        yield from _vehicle(agent, tracks["base"][j], _rotation(tracks["base_q"][j]), thick, j)
    nodes = tracks["nodes"]
    for start, end in shape["links"]:
        yield _rod(nodes[start], nodes[end], thick, ARM)
    for kind, node in zip(shape["nodes"], nodes, strict=True):
        if kind != "base":
            yield _ball(node, 1.5 * thick, own if kind == "tip" else ARM)
    for kind, start, force in _forces(seen, tracks):
        yield from _arrow(start, force / seen.N_per_m[kind], 0.8 * thick, COLORS[kind], kind == "disturbance")


def _vehicle(agent: Mapping[str, Any], at: np.ndarray, R: np.ndarray, thick: float, j: int) -> Iterator[Face]:
    """A base: its hub in the agent's colour, and rotors on booms, which are schematic."""
    hub = np.array([0.25, 0.25, 0.15]) * agent["span_m"]
    yield from _box(at, R, hub, style.AGENT_COLORS[j % len(style.AGENT_COLORS)])
    for rotor in agent["rotors_m"]:
        middle = at + R @ np.array(rotor)
        yield _rod(at, middle, 0.7 * thick, FRAME)
        yield _disc(middle, R, agent["rotor_radius_m"])


def _forces(seen: RenderData, tracks: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Kind, foot and force of every arrow, in the world."""
    for base, q, u in zip(tracks["base"], tracks["base_q"], tracks["u"], strict=True):
        yield "thrust", base, u * _rotation(q)[:, 2]
    for contact, lam in zip(seen.shape["contacts"], tracks["lam"], strict=True):
        yield "contact", tracks["nodes"][contact["node"]], lam
    yield "disturbance", tracks["p"], tracks["disturbance"]


def _box(center: np.ndarray, R: np.ndarray, half: np.ndarray, color: str) -> Iterator[Face]:
    """The faces of a box that are seen, in patches, lighter towards the sun."""
    for axis in range(3):
        sign = 1.0 if R[:, axis] @ CAMERA_DIRECTION > 0 else -1.0
        out = sign * R[:, axis]
        one, other = (half[(axis + n) % 3] * R[:, (axis + n) % 3] / PATCHES for n in (1, 2))
        light = 0.72 + 0.28 * max(0.0, float(out @ LIGHT_DIRECTION))
        paint = tuple(light * c for c in to_rgb(color))
        for a, b in np.ndindex(PATCHES, PATCHES):
            middle = center + half[axis] * out + (2 * a + 1 - PATCHES) * one + (2 * b + 1 - PATCHES) * other
            corners = np.array([middle + one + other, middle + one - other, middle - one - other, middle - one + other])
            yield float(middle @ CAMERA_DIRECTION), _across(corners), paint


def _rod(start: np.ndarray, end: np.ndarray, radius: float, color: str) -> Face:
    a, b = _across(start), _across(end)
    along = b - a
    side = radius * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    return (
        float((start + end) @ CAMERA_DIRECTION / 2),
        np.array([a + side, b + side, b - side, a - side]),
        to_rgb(color),
    )


CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 24)), np.sin(np.linspace(0, 2 * np.pi, 24))], axis=-1)


def _disc(center: np.ndarray, R: np.ndarray, radius: float) -> Face:
    rim = center + radius * CIRCLE @ R[:, :2].T
    return float(center @ CAMERA_DIRECTION), _across(rim), (*to_rgb(FRAME), 0.25)


def _ball(center: np.ndarray, radius: float, color: str) -> Face:
    return float(center @ CAMERA_DIRECTION) + radius, _across(center) + radius * CIRCLE, to_rgb(color)


def _arrow(start: np.ndarray, along: np.ndarray, radius: float, color: str, over: bool) -> Iterator[Face]:
    """A shaft and a head; `over` everything that would hide it."""
    length = float(np.linalg.norm(along))
    if length < scene.MIN_LINK_LENGTH:
        return
    head = min(7 * radius, length)
    neck, tip = start + (1 - head / length) * along, start + along
    a, b = _across(neck), _across(tip)
    side = 0.4 * head * np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.hypot(*(b - a))), 1e-9)
    depth, shaft, paint = _rod(start, neck, radius, color)
    near = np.inf if over else depth + 2 * radius
    yield near, shaft, paint
    yield near, np.array([a + side, b, a - side]), paint


def _wanted(seen: RenderData, k: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The edges of the payload's box where it should be."""
    shape, tracks = seen.shape["payload"], seen.signals
    half = np.array(shape["half_m"])
    R = _rotation(tracks["q_d"][k]) @ _rotation(np.array(shape["axes_wxyz"]))
    corners = _corners(-half, half)
    for a in corners:
        for b in corners:
            if (a < b).sum() == 1 and (a == b).sum() == 2:
                yield tracks["p_d"][k] + R @ a, tracks["p_d"][k] + R @ b


def _write_names(ax: Axes, seen: RenderData, k: int) -> None:
    """Agents above their thrust's tip, contacts beside their tips."""
    tracks = {name: x[k] for name, x in seen.signals.items()}
    for j, agent in enumerate(seen.shape["agents"]):
        tip = tracks["base"][j] + tracks["u"][j] / seen.N_per_m["thrust"] * _rotation(tracks["base_q"][j])[:, 2]
        x, y = _across(tip)
        ax.annotate(agent["name"], (x, y), (0, 3), textcoords="offset points", ha="center", fontsize=8, zorder=5)
    for contact in seen.shape["contacts"]:
        x, y = _across(tracks["nodes"][contact["node"]])
        name = contact["name"].split("/")[1]
        ax.annotate(name, (x, y), (0, -4), textcoords="offset points", ha="center", va="top", fontsize=6.5, zorder=5)


def _rotation(q: np.ndarray) -> np.ndarray:
    """The matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
