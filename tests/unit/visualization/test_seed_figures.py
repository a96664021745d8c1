"""Test of figures of metrics over seeds."""

from __future__ import annotations

import numpy as np

from colift.visualization import seed_figures
from tests.support.study_logs import TOLD


def test_seed_figure_has_markers_and_a_median_line(tmp_path):
    """The figure has a marker for each seed and a line at the median."""
    merits = dict.fromkeys(seed_figures.METRICS, 0.0)
    found = [
        {case: dict.fromkeys(merits, 0.001 * (k + 1)) for case in ("C1", "true_residual", "mine")} for k in range(5)
    ]
    files = seed_figures.plot_seed_spread(found, TOLD, tmp_path / "seeds")
    assert [file.name for file in files] == ["seeds.pdf", "seeds.png"]
    figure = seed_figures._plot_spread(found, TOLD)
    for ax in figure.axes:
        marks, medians = ax.lines[::2], ax.lines[1::2]
        assert [len(line.get_xdata()) for line in marks] == [5, 5, 5]
        assert all(
            line.get_xdata()[0] == np.median(mark.get_xdata()) for line, mark in zip(medians, marks, strict=True)
        )
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == [
        "C1 no learning",
        "true residual",
        "mine",
    ]
