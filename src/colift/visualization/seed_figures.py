"""Figure of the metrics of all cases over several seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from colift.visualization import style
from colift.visualization.axes import case_label

METRICS = {  # axis label and scale factor of each metric
    "e_p_rms_m": (r"$\|e_p\|$, RMS [mm]", 1e3),
    "e_R_rms": (r"$\|e_R\|$, RMS [$10^{-3}$]", 1e3),
    "delta_W_force_rms_N": (r"$\|\Delta F\|$, RMS [N]", 1.0),
    "delta_W_moment_rms_Nm": (r"$\|\Delta \tau\|$, RMS [N m]", 1.0),
}


def plot_seed_spread(
    summaries: Sequence[Mapping[str, Mapping[str, float]]], descriptions: Mapping[str, str], path: str | Path
) -> list[Path]:
    """Write the metrics of each case as PDF and PNG, with a marker for each seed and a line at the median.

    A file that cannot be written raises `OSError`.

    Args:
        summaries: For each seed the metrics of its cases.
        descriptions: Description of each case.
        path: Path of the files without suffix.

    Returns:
        Paths of the PDF and the PNG file.
    """
    with style.style_context():
        return style.save_figure(_plot_spread(summaries, descriptions), Path(path))


def _plot_spread(summaries: Sequence[Mapping[str, Mapping[str, float]]], descriptions: Mapping[str, str]) -> Figure:
    """Plot one panel per metric with one row per case."""
    cases = list(summaries[0])
    figure = Figure(figsize=(style.PAGE_WIDTH, 0.8 + 0.2 * len(cases)))
    axes = figure.subplots(1, len(METRICS), sharey=True)
    for ax, (metric, (label, scale)) in zip(axes, METRICS.items(), strict=True):
        for row, case in enumerate(cases):
            values, line = [scale * seed[case][metric] for seed in summaries], style.style_of(case)
            ax.plot(values, np.full(len(values), row), line.marker, color=line.color, alpha=0.7, markersize=4)
            ax.plot([np.median(values)] * 2, [row - 0.35, row + 0.35], color="black", linewidth=0.8)
        ax.set(xscale="log", xlabel=label, ylim=(len(cases) - 0.5, -0.5), xmargin=0.08)
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
        ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_yticks(range(len(cases)), [case_label(case, descriptions) for case in cases])
    median = Line2D([], [], color="black", linewidth=0.8, linestyle="none", marker="|", markersize=8)
    seed = Line2D([], [], color="0.5", linestyle="none", marker="o", markersize=4)
    figure.legend([seed, median], ["one seed", "median"], loc="outside lower center", ncols=2)
    return figure
