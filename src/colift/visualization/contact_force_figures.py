"""Figure of the contact forces by component: external and internal part, estimate against truth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.ndimage import uniform_filter1d

from colift.analysis import contact_forces, poses
from colift.models import grasp
from colift.scenario import team
from colift.visualization import axes as axes_module
from colift.visualization.style import PAGE_WIDTH

PARTS = ("external", "internal")
"""Parts of the contact forces in the order of their line styles."""
ROW_HEIGHT = 0.85  # in
MAX_HEIGHT = 9.2  # in, of all rows, so that the figure fits a page


def contact_points_of_log(ds: xr.Dataset) -> np.ndarray:
    """Return the true attachment points of a log.

    A log without a valid scenario raises `ValueError`.

    Args:
        ds: Log.

    Returns:
        Points `(contacts, 3)`, payload frame [m].
    """
    truth, _ = team.team(poses.scenario_of_log(ds))
    return np.asarray(grasp.contact_points(truth))


def plot_contact_force_parts(cases: axes_module.Cases, descriptions: Mapping[str, str]) -> Figure:
    """Plot figure 8: components of external and internal contact forces in the payload frame, estimate and truth.

    The external part `G^+ G lam` applies the wrench with the least norm; the internal part is the rest. Estimates are
    moving averages. All panels of a column have one scale.

    Args:
        cases: Log of each case; the figure shows the last.
        descriptions: Description of each case.

    Returns:
        The figure, with contacts as rows and components as columns.
    """
    name, ds = list(cases.items())[-1]
    truth, estimate = contact_forces.split_logged_forces(ds, contact_points_of_log(ds))
    contacts = ds.contact.values.tolist()
    height = min(ROW_HEIGHT * len(contacts), MAX_HEIGHT)
    figure = Figure(figsize=(PAGE_WIDTH, 1.0 + height))
    grid = figure.subplots(len(contacts), 3, sharex=True, sharey="col", squeeze=False)
    for i, contact in enumerate(contacts):
        for k, axis in enumerate("xyz"):
            for n, part in enumerate(PARTS):
                _plot_part(grid[i, k], ds, name, n, *(getattr(x, part)[:, i, k] for x in (truth, estimate)))
            axes_module.shade_span(grid[i, k], ds.time.values, axes_module.norm(ds.eta) > 0)
            if i == 0:
                grid[i, k].set_title(f"${axis}$ component, payload frame")
        grid[i, 0].set_ylabel(contact.replace("/", "\n") + "\nforce [N]")
    for ax in grid[-1]:
        axes_module.time_axis(ax, {name: ds})
    figure.suptitle(axes_module.title(name, ds, descriptions).replace("\n", " "), fontsize=8)
    figure.align_ylabels(grid[:, 0])
    _add_legend(figure, name, bool((axes_module.norm(ds.eta) > 0).any()))
    return figure


def _plot_part(ax: Axes, ds: xr.Dataset, case: str, part: int, truth: np.ndarray, estimate: np.ndarray) -> None:
    """Plot true value and moving average of the estimate of one component; `part` is an index of `PARTS`."""
    t, n = axes_module.decimate(ds, ds.time), axes_module.samples(ds, axes_module.SMOOTHING_WINDOW)
    color, dashes = axes_module.body_style(case, part, len(PARTS))
    ax.plot(t, axes_module.decimate(ds, truth), **axes_module.TRUE_VALUE_STYLE, zorder=1.5)
    ax.plot(t, axes_module.decimate(ds, uniform_filter1d(estimate, n)), color=color, linestyle=dashes, linewidth=0.9)


def _add_legend(figure: Figure, case: str, internal: bool) -> None:
    """Add the legend below all panels."""
    handles: list[Artist] = []
    labels = []
    for k, part in enumerate(PARTS):
        color, dashes = axes_module.body_style(case, k, len(PARTS))
        handles.append(Line2D([], [], color=color, linestyle=dashes, linewidth=0.9))
        labels.append(f"{part}, estimate ({axes_module.SMOOTHING_WINDOW:g} s mean)")
    handles.append(Line2D([], [], **axes_module.TRUE_VALUE_STYLE))
    labels.append("true value")
    if internal:
        handles.append(axes_module.active_patch())
        labels.append(r"$\eta$ active")
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
