"""Panels of a study's figures: their axes, spans and marks, the signals drawn in them, and what they are called."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import AutoMinorLocator, LogLocator, MaxNLocator, NullFormatter
from scipy.ndimage import uniform_filter1d

from colift.closed_loop import log
from colift.visualization import style
from colift.visualization.style import Color, Dashes

SMOOTHING_WINDOW = 0.2  # s, over which noisy signals are averaged for the eye; labels and legends say so
STEP = 0.01  # s, between drawn points
COLUMNS = 4  # cases beside each other on a page's width
WIDE = 30  # letters of a title above one
GREY = "#444444"  # of legends that hold for every case
ACTIVE = "0.92"  # grey of the span in which internal forces act

Cases = Mapping[str, xr.Dataset]


# Axes -----------------------------------------------------------------------------------------------------------------


def log_scale(ax: Axes) -> None:
    """A logarithmic axis with a mark at every decade, or at 1, 2 and 5 where it spans less than two."""
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    narrow = high < 100 * low
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,), numticks=20))
    ax.yaxis.set_minor_locator(LogLocator(subs=range(2, 10), numticks=20))
    ax.yaxis.set_minor_formatter(NullFormatter())
    if low > 5e-4 and high < 1e4:  # else powers of ten are read more easily
        ax.yaxis.set_major_formatter("{x:g}")


def time_axis(ax: Axes, cases: Cases) -> None:
    """From 0 to the end of the longest flight: one period after its last tick; to 1 s where none has a second tick."""
    ax.set_xlabel("time [s]")
    ax.set_xlim(0, max(float(ds.time[-1]) + sample_period(ds.time) for ds in cases.values()) or 1.0)
    ax.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    ax.xaxis.set_minor_locator(AutoMinorLocator())


def draw_update_lines(axes: Sequence[Axes], cases: Cases) -> None:
    """Light lines at the update times t_k, with their names, and a dashed one at T_end.

    Of cases whose learning ends there; where every one goes on, light lines alone.
    """
    each = [(times, end) for times, end in map(log.update_times, cases.values()) if times]
    ending = [(times, end) for times, end in each if end is not None]
    times = sorted({t for times, _ in ending or each for t in times})
    end = ending[0][1] if ending else None
    for ax in axes:
        for t in set(times) - {end}:
            ax.axvline(t, color="0.75", linewidth=0.6, zorder=1)
    if end is None:
        return
    for ax in axes:
        ax.axvline(end, color="0.35", linewidth=0.8, linestyle=(0, (3, 2)), zorder=1)
    marks = {t: f"t_{{{k + 1}}}" for k, t in enumerate(times)}
    marks[end] = rf"{marks[end]} = T_\mathrm{{end}}" if end in marks else r"T_\mathrm{end}"
    for t, text in marks.items():
        axes[0].annotate(
            f"${text}$",
            (t, 1),
            xycoords=("data", "axes fraction"),
            xytext=(-4, 1.5),
            textcoords="offset points",
            ha="left",  # the long one at T_end then keeps clear of the last update
            va="bottom",
            fontsize=7,
        )


def shade_span(ax: Axes, t: np.ndarray, active: np.ndarray) -> None:
    """Shade the span in which internal forces act."""
    if active.any():
        ax.axvspan(t[active][0], t[active][-1], color=ACTIVE, linewidth=0, zorder=0)


def shade_all(ax: Axes, t: np.ndarray, active: np.ndarray) -> None:
    """Shade every span in which something holds."""
    ax.fill_between(t, 0, 1, where=active, transform=ax.get_xaxis_transform(), color=ACTIVE, linewidth=0, zorder=0)


# Names and strokes ----------------------------------------------------------------------------------------------------


def case_label(name: str, told: Mapping[str, str]) -> str:
    """The name of a case and what it is."""
    return f"{name}: {told[name].split(':')[0]}" if name in told else name


def title(name: str, ds: xr.Dataset, told: Mapping[str, str]) -> str:
    """Of a column: the case, and when it stopped if it stopped early."""
    early = "" if ds.attrs["complete"] else f"\n(stopped at {float(ds.time[-1]):.1f} s)"
    return textwrap.fill(case_label(name, told), WIDE) + early


def body_style(name: str, k: int, n: int) -> tuple[Color, Dashes]:
    """Colour and stroke of the k-th of n bodies of a case."""
    return style.tint(style.style_of(name).color, k, n), style.DASH_PATTERNS[k % len(style.DASH_PATTERNS)]


def agent_legend(cases: Cases) -> list[tuple[Artist, str]]:
    """Which agent has which stroke, where there are several."""
    agents = next(iter(cases.values())).agent.values.tolist()
    strokes = [
        (style.tint(GREY, k, len(agents)), style.DASH_PATTERNS[k % len(style.DASH_PATTERNS)])
        for k in range(len(agents))
    ]
    return [
        (Line2D([], [], color=color, linestyle=dashes, linewidth=1.3), agent)
        for (color, dashes), agent in zip(strokes, agents, strict=True)
        if len(agents) > 1
    ]


# Signals --------------------------------------------------------------------------------------------------------------


def sample_period(t: xr.DataArray) -> float:
    """Time between two rows of the log, s; 0 where there is only one."""
    return float(t[1] - t[0]) if len(t) > 1 else 0.0


def samples(ds: xr.Dataset, seconds: float) -> int:
    """Ticks in a span of time, at least one."""
    tick = sample_period(ds.time)
    return max(1, round(seconds / tick)) if tick else 1


def norm(x: xr.DataArray) -> np.ndarray:
    """`(time,)` norm of a vector over time."""
    return np.linalg.norm(x.values, axis=1)


def rms(ds: xr.Dataset, x: np.ndarray) -> np.ndarray:
    """RMS over a window around each tick: unlike a low-pass it hides no power."""
    return np.sqrt(uniform_filter1d(x**2, samples(ds, SMOOTHING_WINDOW)))


def decimate(ds: xr.Dataset, x: xr.DataArray | np.ndarray) -> np.ndarray:
    """A signal at the points that are drawn, `STEP` apart."""
    return np.asarray(x)[:: samples(ds, STEP)]
