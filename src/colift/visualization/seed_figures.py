"""Figures of merit over several seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from colift.visualization import style
from colift.visualization.axes import case_label

METRICS = {  # axis label by the name of a figure of merit, and its scale
    "e_p_rms_m": (r"$\|e_p\|$, RMS [mm]", 1e3),
    "e_R_rms": (r"$\|e_R\|$, RMS [$10^{-3}$]", 1e3),
    "delta_W_force_rms_N": (r"$\|\Delta F\|$, RMS [N]", 1.0),
    "delta_W_moment_rms_Nm": (r"$\|\Delta \tau\|$, RMS [N m]", 1.0),
}


def plot_seed_spread(
    found: Sequence[Mapping[str, Mapping[str, float]]], told: Mapping[str, str], path: str | Path
) -> list[Path]:
    """Write figures of merit by case, a mark for each seed and a line at the median, as PDF and PNG; the files.

    found: for each seed the summaries of its cases. Raises OSError where they cannot be written.
    """
    with style.style_context():
        return style.save_figure(_spread(found, told), Path(path))


def _spread(found: Sequence[Mapping[str, Mapping[str, float]]], told: Mapping[str, str]) -> Figure:
    cases = list(found[0])
    figure = Figure(figsize=(style.PAGE, 0.6 + 0.2 * len(cases)))
    axes = figure.subplots(1, len(METRICS), sharey=True)
    for ax, (merit, (label, scale)) in zip(axes, METRICS.items(), strict=True):
        for row, case in enumerate(cases):
            values, shown = [scale * seed[case][merit] for seed in found], style.style_of(case)
            ax.plot(values, np.full(len(values), row), shown.marker, color=shown.color, alpha=0.7, markersize=4)
            ax.plot([np.median(values)] * 2, [row - 0.35, row + 0.35], color="black", linewidth=0.8)
        ax.set(xscale="log", xlabel=label, ylim=(len(cases) - 0.5, -0.5))
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
        ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_yticks(range(len(cases)), [case_label(case, told) for case in cases])
    return figure
