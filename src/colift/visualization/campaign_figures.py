"""Figure of the comparison of the cases of a campaign."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from colift.visualization import style


def plot_comparison(errors_m: pd.DataFrame, path: str | Path) -> list[Path]:
    """Write the distributions of the position error and of its ratio to the first case as PDF and PNG.

    A file that cannot be written raises `OSError`.

    Args:
        errors_m: RMS position error [m] by sample (rows) and case (columns); NaN for a flight that ended early.
        path: Path of the files without suffix.

    Returns:
        Paths of the PDF and the PNG file.
    """
    with style.style_context():
        return style.save_figure(_plot(errors_m), Path(path))


def _plot(errors_m: pd.DataFrame) -> Figure:
    """Plot one panel for the errors and one for the ratios."""
    figure = Figure(figsize=(style.PAGE_WIDTH, 2.2))
    left, right = figure.subplots(1, 2, sharey=True)
    reference = errors_m.columns[0]
    for case in errors_m.columns:
        _plot_distribution(left, 1e3 * errors_m[case], str(case))
        if case != reference:
            _plot_distribution(right, errors_m[case] / errors_m[reference], str(case))
    for ax in (left, right):
        _set_log_axis(ax)
    left.set(xlabel=r"$\|e_p\|$, RMS [mm]", ylabel="fraction of the flights", ylim=(0, 1))
    right.set_visible(len(errors_m.columns) > 1)
    right.set(xlabel=rf"ratio to {reference}")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=len(errors_m.columns))
    return figure


def _set_log_axis(ax: Axes) -> None:
    """Set a logarithmic axis with labels at 1, 2 and 5, or at powers of ten over more than two decades."""
    ax.set_xscale("log")
    if not any(np.isfinite(line.get_xdata()).any() for line in ax.lines):
        ax.set_xlim(0.1, 10.0)  # all flights ended early
    low, high = ax.get_xlim()
    ax.xaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda x, _position: f"{x:g}"))
    ax.xaxis.set_minor_formatter(ticker.NullFormatter())


def _plot_distribution(ax: Axes, values: pd.Series, case: str) -> None:
    """Plot an empirical distribution; flights that ended early count as infinite."""
    finite = np.sort(values[np.isfinite(values)].to_numpy(dtype=float))
    fractions = np.arange(len(finite) + 1) / max(len(values), 1)
    finite = np.concatenate([finite[:1], finite]) if len(finite) else np.full(1, np.nan)
    ax.plot(finite, fractions, color=style.style_of(case).color, drawstyle="steps-post", label=case)
