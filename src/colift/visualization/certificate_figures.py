"""Figures of certificates: error bounds and observed errors (figure 6), and bounds against the number of data.

The second figure illustrates Corollary 1 of the paper: more data never increase the certified error.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from colift.analysis import conclusions
from colift.certification.assumptions import status_label
from colift.certification.certificate import Certificate
from colift.visualization import style
from colift.visualization.axes import log_scale

TITLE_CHARACTERS = 130  # in a line of a title of page width
LAYOUTS = (("", style.PAGE_WIDTH, (1, 2), TITLE_CHARACTERS), ("_column", style.COLUMN_WIDTH, (2, 1), 62))
"""Versions of figure 6: suffix of the file, width [in], rows and columns, and characters in a line of the title."""
BOUND_WIDTH, ERROR_WIDTH = 2.0, 0.9
"""Line widths of bounds and of errors, in the color of the case, as in figures 3 and 5 [points]."""
SERIES_STYLES = ((style.DASH_PATTERNS[0], "s"), (style.DASH_PATTERNS[1], "o"), (style.DASH_PATTERNS[2], "D"))
"""Dash pattern and marker of several bounds or factors."""


def plot_certificate(
    certificate: Certificate, conservatism: Mapping[str, float], folder: str | Path, run: str
) -> list[Path]:
    """Write figure 6 as PDF and PNG: certified and observed position error, and the sources of conservatism.

    A second version has the width of one column, with the panels below each other. The figure
    title lists the unproven assumptions. A red title lists the errors that exceed a bound.
    A folder that cannot be written raises `OSError`.

    Args:
        certificate: Certificate of a flight.
        conservatism: Bounds of the position error under successively stronger arguments [m], by name.
        folder: Folder of the files.
        run: Run id for the metadata of the files.

    Returns:
        Paths of the PDF and PNG files.
    """
    files = []
    with style.style_context():
        for suffix, width, shape, title in LAYOUTS:
            rows, columns = shape
            figure = Figure(figsize=(width, 2.9 if rows == 1 else 4.6))
            panels = figure.subplots(rows, columns, width_ratios=(1, 0.9)[:columns])
            _fill_certificate(figure, panels.tolist(), certificate, conservatism, title)
            files += style.save_figure(figure, Path(folder) / f"figure_6_certificate{suffix}", run)
    return files


def _fill_certificate(
    figure: Figure, panels: Sequence[Axes], certificate: Certificate, conservatism: Mapping[str, float], title: int
) -> None:
    """Plot both panels of figure 6 and its titles with lines of `title` characters."""
    first, second = panels
    best = certificate.ultimate_bounds.get("recovery", certificate.ultimate_bounds["energy"])
    name = "recovery" if "recovery" in certificate.ultimate_bounds else "energy"
    _plot_errors_and_bounds(first, certificate, name, single_column=title < TITLE_CHARACTERS)
    _plot_conservatism(second, conservatism)
    if above := ", ".join(dict.fromkeys(ERROR_SYMBOLS[each.error] for each in certificate.violations)):
        first.set_title(f"observed error above its bound: {above}", fontsize=8, color="red")
    if best.assumptions:
        figure.suptitle(textwrap.fill(f"assumed: {conclusions.list_assumptions(best.assumptions)}", title), fontsize=8)


ERROR_SYMBOLS = {"e_p": "$e_p$", "e_v": "$e_v$", "e_R": "$e_R$", "e_omega": r"$e_\omega$"}
"""Symbol of each error in titles."""


def _plot_errors_and_bounds(ax: Axes, certificate: Certificate, bound: str, single_column: bool) -> None:
    """Plot the position error over time with its finite a posteriori and a priori bounds of one kind."""
    best = certificate.ultimate_bounds[bound]
    color, source = style.LINE_STYLES["C3"].color, f"({bound}, {status_label(best.assumptions)})"
    t = certificate.t
    if np.isfinite(certificate.bound).all():
        ax.plot(t, 1e3 * certificate.bound, color=color, linewidth=BOUND_WIDTH, label=f"bound for this run {source}")
    if np.isfinite(best.a_priori["e_p"]):
        label = f"bound for any run {source}"
        ax.axhline(1e3 * best.a_priori["e_p"], color=color, linewidth=BOUND_WIDTH, dashes=(1, 1), label=label)
    ax.plot(t, 1e3 * certificate.e_p, color=color, linewidth=ERROR_WIDTH, label=r"observed $\Vert e_p\Vert$")
    label = "maximum nominal error"
    ax.axhline(1e3 * certificate.nominal_error["e_p"], color="0.5", linewidth=0.8, dashes=(4, 2), label=label)
    ax.set(xlabel="time [s]", ylabel="position error [mm]", xlim=(t[0], t[-1]), ylim=(0, None))
    ax.set_ylim(top=(1.6 if single_column else 1.45) * ax.get_ylim()[1])  # room for the legend
    ax.legend(loc="upper left", fontsize=6.5 if single_column else None, labelspacing=0.3 if single_column else None)


def _plot_conservatism(ax: Axes, conservatism: Mapping[str, float]) -> None:
    """Plot the finite bounds of e_p under successively stronger arguments, down to the observed error.

    The axis is logarithmic and has no zero, so that each value is a point and not a bar.
    """
    names = [name for name, bound in conservatism.items() if np.isfinite(bound)]
    sizes = [1e3 * conservatism[name] for name in names]
    rows = np.arange(len(names))[::-1]
    color = style.LINE_STYLES["C3"].color
    looks = {"observed": (color, "^"), "nominal error": ("0.5", "s")}
    for y, name, size in zip(rows, names, sizes, strict=True):
        paint, marker = looks.get(name, (color, "o"))
        face = paint if name in looks else "white"  # bounds are hollow
        ax.plot(size, y, marker, color=paint, markersize=4.5, markerfacecolor=face, markeredgewidth=1.2)
        text = f"{size:.3g} mm" if size < 1e3 else f"{size / 1e3:.3g} m" if size < 1e6 else f"{size / 1e6:.3g} km"
        ax.annotate(text, (size, y), (6, 0), textcoords="offset points", va="center", fontsize=7)
    ax.set_xscale("log")
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_yticks(rows, names)
    room = (max(sizes) / min(sizes)) ** 0.3  # for the text beside the largest value
    ax.set(xlabel=r"maximum $\Vert e_p\Vert$ [mm]", xlim=(0.4 * min(sizes), 3 * room * max(sizes)))


def plot_bound_vs_data(
    n: Sequence[float],
    bounds: Mapping[str, Sequence[float]],
    nominal_error: Sequence[float],
    parts: Mapping[str, Sequence[float]],
    path: str | Path,
) -> list[Path]:
    """Write ultimate errors and bounds against the number of data as PDF and PNG (Corollary 1 of the paper).

    A file that cannot be written raises `OSError`.

    Args:
        n: Number of data points of each body.
        bounds: Ultimate bounds and observed errors [m], by label.
        nominal_error: Nominal error [m].
        parts: Factors of a bound, by label; each curve is divided by its first value.
        path: Path of the files without suffix.

    Returns:
        Paths of the PDF and the PNG file.
    """
    color = style.LINE_STYLES["C3"].color
    with style.style_context():
        figure = Figure(figsize=(style.PAGE_WIDTH, 2.6))
        left, right = figure.subplots(1, 2)
        for k, (name, bound) in enumerate(bounds.items()):
            observed = name == "observed"
            dashes, marker = ("-", "^") if observed else SERIES_STYLES[k % len(SERIES_STYLES)]
            paint = color if observed else style.tint(color, k, len(bounds))
            width = ERROR_WIDTH if observed else BOUND_WIDTH
            kind = {"color": paint, "linestyle": dashes, "linewidth": width, "marker": marker, "markersize": 3.5}
            left.plot(n, 1e3 * np.asarray(bound), **kind, label=name)
        error = 1e3 * np.asarray(nominal_error)
        left.plot(n, error, color="0.5", linewidth=0.8, dashes=(4, 2), label="nominal error")
        left.set(ylabel=r"ultimate $\Vert e_p\Vert$ [mm]")
        for k, (name, part) in enumerate(parts.items()):
            dashes, marker = SERIES_STYLES[k % len(SERIES_STYLES)]
            kind = {"color": style.tint("0.1", k, len(parts)), "linestyle": dashes, "marker": marker, "markersize": 3.5}
            right.plot(n, np.asarray(part) / part[0], **kind, label=name)
        right.set(ylabel="relative to the smallest data set")
        for ax in (left, right):
            ax.set(xscale="log", xlabel="data points per body")
            log_scale(ax)
            ax.set_xticks(n, [f"{each:g}" for each in n])
            ax.xaxis.set_minor_locator(NullLocator())
            ax.legend()
        return style.save_figure(figure, Path(path))
