"""Tests of the figure of contact-force components."""

from __future__ import annotations

import numpy as np
import pytest

from colift.analysis import contact_forces
from colift.visualization import axes, contact_force_figures
from tests.support.study_logs import CASES, TOLD

pytestmark = pytest.mark.usefixtures("style")


def test_figure_8_draws_both_parts_of_the_last_case(cases):
    """Each panel contains truth and estimate of the external and of the internal part of one component."""
    figure = contact_force_figures.plot_contact_force_parts({name: cases[name] for name in CASES}, TOLD)
    ds = cases["C3"]
    c = contact_force_figures.contact_points_of_log(ds)
    truth, estimate = contact_forces.split_logged_forces(ds, c)
    panels = np.array(figure.axes).reshape(4, 3)
    for (i, k), ax in np.ndenumerate(panels):
        lines = [line.get_ydata() for line in ax.lines]
        assert len(lines) == 4
        for part, drawn, mean in zip(("external", "internal"), lines[::2], lines[1::2], strict=True):
            np.testing.assert_allclose(drawn, getattr(truth, part)[:, i, k], rtol=1e-12)
            x = getattr(estimate, part)[:, i, k]  # four ticks of 50 ms are the window
            np.testing.assert_allclose(mean[2:-2], [x[n - 2 : n + 2].mean() for n in range(2, 398)], rtol=1e-9)
        (window,) = ax.patches
        assert window.get_x() == pytest.approx(8)
    assert [ax.get_ylabel() for ax in panels[:, 0]] == [
        f"{name.replace('/', chr(10))}\nforce [N]" for name in ds.contact.values
    ]
    assert figure.get_suptitle() == "C3 payload and agent learning"
    assert f"({axes.SMOOTHING_WINDOW:g} s mean)" in figure.legends[0].get_texts()[1].get_text()


def test_legend_and_panels_are_within_the_page(cases):
    stopped = cases["C3"].isel(time=slice(1), time_sigma=slice(1)).assign_attrs(complete=0)
    for chosen in (cases["C3"], stopped):
        figure = contact_force_figures.plot_contact_force_parts({"C3": chosen}, TOLD)
        figure.draw_without_rendering()
        box, page = figure.legends[0].get_window_extent(), figure.bbox
        assert page.x0 <= box.x0 < box.x1 <= page.x1
        assert not any(box.overlaps(ax.get_tightbbox()) for ax in figure.axes)
