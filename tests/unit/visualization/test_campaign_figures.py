"""Figure of a campaign."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from colift.visualization import campaign_figures


@pytest.mark.parametrize(
    "columns",
    [
        {"C1": [0.3, 0.2, np.nan], "C3": [0.004, 0.006, 0.005]},
        {"C1": [0.3, 0.2, 0.25]},
        {"C1": [0.3, 0.2], "C2": [np.nan, np.nan]},
    ],
)
def test_figure_of_flights_that_ended_early(columns: dict[str, list[float]], tmp_path: Path):
    files = campaign_figures.plot_comparison(pd.DataFrame(columns), tmp_path / "comparison")
    assert [file.suffix for file in files] == [".pdf", ".png"]


def test_distribution_ends_below_one_after_an_early_end():
    """The flight without an error counts as infinite."""
    figure = campaign_figures._plot(pd.DataFrame({"C1": [0.3, 0.2, 0.1, np.nan], "C3": [0.1, 0.1, 0.1, 0.2]}))
    left, right = figure.axes
    heights = {line.get_label(): line.get_ydata()[-1] for line in left.lines}
    assert heights == {"C1": 0.75, "C3": 1.0}
    assert np.allclose(right.lines[0].get_xdata(), [1 / 3, 1 / 3, 1 / 2, 1.0])
