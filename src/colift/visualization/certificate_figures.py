"""How tight the radii of a certificate are: figure 6, and Corollary 1 as a figure."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from colift.certification.assumptions import status_label
from colift.certification.certificate import Certificate
from colift.visualization import style

TITLE = 130  # characters of a title's line on a page's width


def plot_certificate(found: Certificate, slack: Mapping[str, float], folder: str | Path, run: str) -> list[Path]:
    """Write figure 6 as PDF and PNG: the radius and the observed error of position, and where the slack comes from.

    Titles say what the radii assume and, in red, which errors exceed one; each file names the run in its metadata.
    Raises OSError where the folder cannot be written.
    """
    with style.style_context():
        figure = Figure(figsize=(style.PAGE, 2.9))
        left, right = figure.subplots(1, 2, width_ratios=(1, 0.9))
        best = found.radii.get("recovery", found.radii["energy"])
        _errors_and_radii(left, found, "recovery" if "recovery" in found.radii else "energy")
        _reasoning(right, slack)
        if above := ", ".join(dict.fromkeys(SYMBOLS[each.error] for each in found.exceeded)):
            left.set_title(f"observed above a radius: {above}", fontsize=8, color="red")
        if best.assumptions:
            figure.suptitle(textwrap.fill(f"assumed: {', '.join(best.assumptions)}", TITLE), fontsize=8)
        return style.save_figure(figure, Path(folder) / "figure_6_certificate", run)


SYMBOLS = {"e_p": "$e_p$", "e_v": "$e_v$", "e_R": "$e_R$", "e_omega": r"$e_\omega$"}


def _errors_and_radii(ax: Axes, found: Certificate, bound: str) -> None:
    """Position error over time under its radii by one bound, where there are any."""
    best = found.radii[bound]
    blue, red, says = (
        style.LINE_STYLES["C3"].color,
        style.LINE_STYLES["C2"].color,
        f"by {bound}, {status_label(best.assumptions)}",
    )
    if np.isfinite(found.bound).all():
        ax.plot(found.t, 1e3 * found.bound, color=red, label=f"radius for this run {says}")
    if np.isfinite(best.a_priori["e_p"]):
        label = f"radius for any run {says}"
        ax.axhline(1e3 * best.a_priori["e_p"], color=red, linewidth=0.8, dashes=(1.5, 1.5), label=label)
    ax.plot(found.t, 1e3 * found.e_p, color=blue, label=r"observed $\Vert e_p\Vert$")
    label = "greatest with nothing unknown (floor)"
    ax.axhline(1e3 * found.nominal_error["e_p"], color="0.5", linewidth=0.8, dashes=(4, 2), label=label)
    ax.set(xlabel="time [s]", ylabel="position error [mm]", xlim=(found.t[0], found.t[-1]), ylim=(0, None))
    ax.set_ylim(top=1.45 * ax.get_ylim()[1])  # room for the legend
    ax.legend(loc="upper left")


def _reasoning(ax: Axes, slack: Mapping[str, float]) -> None:
    """Radii of e_p under ever better reasoning, where there are any, down to what was observed."""
    causes = [name for name, radius in slack.items() if np.isfinite(radius)]
    sizes = [1e3 * slack[name] for name in causes]
    place = np.arange(len(causes))[::-1]
    colors = {"observed": style.LINE_STYLES["C3"].color, "floor: nothing unknown": "0.6"}
    ax.barh(place, sizes, color=[colors.get(name, style.LINE_STYLES["C2"].color) for name in causes], height=0.6)
    ax.set_xscale("log")
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_yticks(place, causes)
    ax.set(xlabel=r"greatest $\Vert e_p\Vert$ [mm]", xlim=(0.5 * min(sizes), 100 * max(sizes)))
    ax.grid(axis="y", visible=False)
    for y, size in zip(place, sizes, strict=True):
        ax.text(size * 1.2, y, f"{size:.3g}" if size < 1e4 else f"{size / 1e3:.3g} m", va="center", fontsize=7)


def plot_bound_vs_data(
    n: Sequence[float],
    radii: Mapping[str, Sequence[float]],
    floor: Sequence[float],
    parts: Mapping[str, Sequence[float]],
    path: str | Path,
) -> list[Path]:
    """Write Corollary 1 as PDF and PNG: ultimate errors, m, against the number of data n, and the floor beneath.

    `parts`, each over its first value, shows what a radius is made of: beta, the greatest deviation, their product.
    """
    colors, marks = ("#DDAA33", "#BB5566", "#004488"), ("s", "o", "^")
    with style.style_context():
        figure = Figure(figsize=(style.PAGE, 2.6))
        left, right = figure.subplots(1, 2)
        for (name, radius), color, mark in zip(radii.items(), colors, marks, strict=False):
            left.plot(n, 1e3 * np.asarray(radius), color=color, marker=mark, markersize=3.5, label=name)
        left.plot(n, 1e3 * np.asarray(floor), color="0.5", linewidth=0.8, dashes=(4, 2), label="floor: nothing unknown")
        left.set(ylabel=r"ultimate $\Vert e_p\Vert$ [mm]")
        for (name, part), color, mark in zip(parts.items(), colors, marks, strict=False):
            right.plot(n, np.asarray(part) / part[0], color=color, marker=mark, markersize=3.5, label=name)
        right.set(ylabel="relative to the fewest data")
        for ax in (left, right):
            ax.set(xscale="log", yscale="log", xlabel="data points of each body")
            ax.set_xticks(n, [f"{each:g}" for each in n])
            ax.minorticks_off()
            ax.legend()
        return style.save_figure(figure, Path(path))
