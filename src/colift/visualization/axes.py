"""Elements that the figures of a study share: axes, shaded spans, markers, legends, labels and decimated signals."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import AutoMinorLocator, LogLocator, MaxNLocator, NullFormatter
from scipy.ndimage import uniform_filter1d

from colift.closed_loop import log
from colift.visualization import style
from colift.visualization.style import Color, Dashes

SMOOTHING_WINDOW = 0.2  # s, window of moving averages of noisy signals; labels and legends state it
SAMPLE_PERIOD = 0.01  # s, time between drawn points
COLUMNS = 4  # cases side by side in the width of a page
TITLE_WIDTH = 30  # characters in a line of a column title
GREY = "#444444"  # color of legend entries that apply to all cases
MAX_DECADES = 4
"""Decades of a logarithmic axis below the largest value."""
QUADRATIC_DECADES = 8
"""Decades for a quadratic function of an error, such as the attitude error function."""
SMALLEST_VALUE = 1e-6
"""Lower limit of a logarithmic axis, in the unit of the axis; smaller values are numerical zeros."""
MAX_OMITTED_SHARE = 0.005
"""Share of the drawn values that may lie below a logarithmic axis, such as those near zero crossings of a norm."""
TRUE_VALUE_STYLE: dict[str, Any] = {"color": "#88DDCC", "linewidth": 2.2, "solid_capstyle": "butt"}
"""Line style of true values in all figures; estimates are drawn above it in the color of the case."""
HANDLE_CHARACTERS = 8  # width of a legend handle and its margins
LEGEND_LINE, LEGEND_MARGIN = 0.125, 0.07  # in, height of a line of a legend inside of axes, and its margins
ACTIVE_SHADE = "0.92"  # grey level of the span in which internal forces act

Cases = Mapping[str, xr.Dataset]  # log of each case


# Axes -----------------------------------------------------------------------------------------------------------------


def log_scale(ax: Axes, decades: int = MAX_DECADES, smallest: float = SMALLEST_VALUE) -> None:
    """Make the y axis logarithmic, with ticks at decades, or at 1, 2 and 5 if it spans less than two decades.

    The axis omits the smallest values, a share of `MAX_OMITTED_SHARE` of all lines. It also ends at a number of decades
    below the largest value or at a smallest value, which a note then states. A line that falls below the axis ends at
    its lower edge.

    Args:
        ax: Axes to change, with all lines; axes that share the y axis change too.
        decades: Number of decades below the largest value.
        smallest: Lower limit of the axis, in its unit.
    """
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    if len(values := _drawn_values(ax)):
        usual = 0.7 * float(np.quantile(values, MAX_OMITTED_SHARE))
        floor = max(10.0**-decades * float(values.max()), smallest)
        low, high = max(low, usual, floor), max(high, 10 * floor)
        ax.set_ylim(low, high)
        if floor > usual:
            note = f"below {low:.2g}: not shown"
            ax.text(0.995, 0.02, note, transform=ax.transAxes, ha="right", va="bottom", fontsize=6, color=GREY)
    narrow = high < 100 * low
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,), numticks=20))
    ax.yaxis.set_minor_locator(LogLocator(subs=range(2, 10), numticks=20))
    ax.yaxis.set_minor_formatter(NullFormatter())
    if low > 5e-4 and high < 1e4:  # outside this range powers of ten are easier to read
        ax.yaxis.set_major_formatter("{x:g}")


def _drawn_values(ax: Axes) -> np.ndarray:
    """Return the positive finite values of all lines in data coordinates, of axes that share the y axis."""
    panels = ax.get_shared_y_axes().get_siblings(ax)
    lines = [line for panel in panels for line in panel.lines if line.get_transform() == panel.transData]
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in lines] or [np.zeros(0)])
    return values[np.isfinite(values) & (values > 0)]


def time_axis(ax: Axes, cases: Cases) -> None:
    """Set up the time axis from 0 to the end of the longest flight, which is one period after its last tick.

    Args:
        ax: Axes to change.
        cases: Log of each case. If no log has a second tick, the axis ends at 1 s.
    """
    ax.set_xlabel("time [s]")
    ax.set_xlim(0, max(float(ds.time[-1]) + sample_period(ds.time) for ds in cases.values()) or 1.0)
    ax.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    ax.xaxis.set_minor_locator(AutoMinorLocator())


def draw_update_lines(axes: Sequence[Axes], cases: Cases) -> None:
    """Draw vertical lines at the update times `t_k` and a dashed line at `T_end`, with labels above the first axes.

    The lines are those of the cases whose learning ends. If learning continues in all cases, all update times are drawn
    without labels. Times after the end of the longest flight are omitted.

    Args:
        axes: Axes to draw into.
        cases: Log of each case.
    """
    last = max(float(ds.time[-1]) for ds in cases.values())
    updates = [(times, end) for times, end in map(log.update_times, cases.values()) if times]
    ending = [(times, end) for times, end in updates if end is not None]
    times = sorted({t for times, _ in ending or updates for t in times if t <= last})
    end = ending[0][1] if ending else None
    for ax in axes:
        for t in set(times) - {end}:
            ax.axvline(t, color="0.75", linewidth=0.6, zorder=1)
    if end is None:
        return
    marks = {t: f"t_{{{k + 1}}}" for k, t in enumerate(times)}
    if end <= last:
        marks[end] = rf"{marks[end]} = T_\mathrm{{end}}" if end in marks else r"T_\mathrm{end}"
        for ax in axes:
            ax.axvline(end, color="0.35", linewidth=0.8, linestyle=(0, (3, 2)), zorder=1)
    for t, text in marks.items():
        axes[0].annotate(
            f"${text}$",
            (t, 1),
            xycoords=("data", "axes fraction"),
            xytext=(-4, 1.5),
            textcoords="offset points",
            ha="left",  # the long label at T_end then does not overlap the last update
            va="bottom",
            fontsize=7,
        )


def shade_span(ax: Axes, t: np.ndarray, active: np.ndarray) -> None:
    """Shade the span from the first to the last active time.

    Args:
        ax: Axes to draw into.
        t: Times [s].
        active: True where internal forces act.
    """
    if active.any():
        ax.axvspan(t[active][0], t[active][-1], color=ACTIVE_SHADE, linewidth=0, zorder=0)


def active_patch() -> Patch:
    """Return the legend handle of a shaded span."""
    return Patch(color=ACTIVE_SHADE, linewidth=0)


def shade_all(ax: Axes, t: np.ndarray, active: np.ndarray) -> None:
    """Shade all active spans.

    Args:
        ax: Axes to draw into.
        t: Times [s].
        active: True where a condition holds.
    """
    ax.fill_between(
        t, 0, 1, where=active, transform=ax.get_xaxis_transform(), color=ACTIVE_SHADE, linewidth=0, zorder=0
    )


def legend_columns(labels: Sequence[str], characters: int) -> int:
    """Return the number of columns of a legend, from 1 to `COLUMNS`.

    Args:
        labels: Labels of the entries.
        characters: Number of characters in a line.

    Returns:
        The largest number of columns in which all labels fit.
    """
    fitting = characters // (max(map(len, labels)) + HANDLE_CHARACTERS)
    return min(COLUMNS, len(labels), max(1, fitting))


def legend_inside(ax: Axes, handles: Sequence[Artist], labels: Sequence[str], columns: int) -> None:
    """Add a legend at the upper edge of logarithmic axes, above all lines.

    Args:
        ax: Axes with a logarithmic y axis; its upper limit is raised.
        handles: Handles of the entries.
        labels: Labels of the entries.
        columns: Number of columns.
    """
    panels = len(ax.figure.axes)
    height = ax.figure.bbox.height / ax.figure.dpi / panels - 0.25
    share = (LEGEND_LINE * -(-len(labels) // columns) + LEGEND_MARGIN) / height
    low, high = ax.get_ylim()
    ax.set_ylim(low, low * (high / low) ** (1 / (1 - share)))
    ax.legend(
        handles,
        labels,
        loc="upper center",
        ncols=columns,
        fontsize=6.5,
        handlelength=2.2,
        columnspacing=0.9,
        labelspacing=0.25,
        borderaxespad=0.3,
        frameon=True,  # vertical lines do not cross the text
        facecolor="white",
        edgecolor="none",
        framealpha=1.0,
    )


# Labels and line styles -----------------------------------------------------------------------------------------------


def case_label(name: str, descriptions: Mapping[str, str]) -> str:
    """Return the label of a case in legends and titles.

    Args:
        name: Case id.
        descriptions: Description of each case, for cases without an entry in `style.CASE_LABELS`.

    Returns:
        The label, for example `C1 no learning`.
    """
    if name in style.CASE_LABELS:
        return style.CASE_LABELS[name]
    return f"{name}: {descriptions[name].split(':')[0]}" if name in descriptions else name


def title(name: str, ds: xr.Dataset, descriptions: Mapping[str, str]) -> str:
    """Return the title of a column: the label of the case and, for an incomplete flight, the time at which it stopped.

    Args:
        name: Case id.
        ds: Log of the case.
        descriptions: Description of each case.

    Returns:
        The title in lines of at most `TITLE_WIDTH` characters.
    """
    early = "" if ds.attrs["complete"] else f"\n(stopped at {float(ds.time[-1]):.1f} s)"
    return textwrap.fill(case_label(name, descriptions), TITLE_WIDTH) + early


def body_style(name: str, k: int, n: int) -> tuple[Color, Dashes]:
    """Return color and dash pattern of a body.

    Args:
        name: Case id.
        k: Index of the body.
        n: Number of bodies.

    Returns:
        Color and dash pattern.
    """
    return style.tint(style.style_of(name).color, k, n), style.DASH_PATTERNS[k % len(style.DASH_PATTERNS)]


def agent_legend(cases: Cases) -> list[tuple[Artist, str]]:
    """Return legend handles and labels of the agents; none if there is only one agent.

    Args:
        cases: Log of each case.

    Returns:
        Pairs of handle and agent name.
    """
    agents = next(iter(cases.values())).agent.values.tolist()
    styles = [
        (style.tint(GREY, k, len(agents)), style.DASH_PATTERNS[k % len(style.DASH_PATTERNS)])
        for k in range(len(agents))
    ]
    return [
        (Line2D([], [], color=color, linestyle=dashes, linewidth=1.3), agent)
        for (color, dashes), agent in zip(styles, agents, strict=True)
        if len(agents) > 1
    ]


# Signals --------------------------------------------------------------------------------------------------------------


def sample_period(t: xr.DataArray) -> float:
    """Return the time between two rows of a log [s], or 0 if there is only one row."""
    return float(t[1] - t[0]) if len(t) > 1 else 0.0


def samples(ds: xr.Dataset, period: float) -> int:
    """Return the number of ticks in a span of time, at least 1.

    Args:
        ds: Log.
        period: Length of the span [s].

    Returns:
        The number of ticks.
    """
    tick = sample_period(ds.time)
    return max(1, round(period / tick)) if tick else 1


def norm(x: xr.DataArray) -> np.ndarray:
    """Return the norm of a vector signal at each time."""
    return np.linalg.norm(x.values, axis=1)


def rms(ds: xr.Dataset, x: np.ndarray) -> np.ndarray:
    """Compute the RMS over a window of `SMOOTHING_WINDOW` around each tick; unlike a low-pass it retains all power.

    Args:
        ds: Log, for the control period.
        x: Signal at all ticks.

    Returns:
        The RMS, in the unit of the signal.
    """
    return np.sqrt(uniform_filter1d(x**2, samples(ds, SMOOTHING_WINDOW)))


def decimate(ds: xr.Dataset, x: xr.DataArray | np.ndarray) -> np.ndarray:
    """Return a signal at the drawn points, which are `SAMPLE_PERIOD` apart.

    Args:
        ds: Log, for the control period.
        x: Signal at all ticks.

    Returns:
        Every n-th value.
    """
    return np.asarray(x)[:: samples(ds, SAMPLE_PERIOD)]
