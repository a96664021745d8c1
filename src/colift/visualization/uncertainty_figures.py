"""Figures 3 and 5: uncertainty and error bounds of the predicted residuals, with the true prediction errors.

Rows are bodies and their force or moment, columns are cases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.ndimage import uniform_filter1d

from colift.analysis import conclusions
from colift.closed_loop import log
from colift.visualization import axes, style

INFINITE_MARKER: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.6", "hatch": "//////", "linewidth": 0}
EXCEEDED_MARKER: dict[str, Any] = {"color": "red", "marker": "|", "markersize": 4, "linestyle": "none"}


class FigureRow(NamedTuple):
    """Content of one row of figures 3 and 5.

    Attributes:
        label: Axis label.
        unit: Unit of the row.
        of_agents: True for the agents, False for the payload.
        moment: True for the moment, False for the force.
    """

    label: str
    unit: str
    of_agents: bool
    moment: bool


ROWS = (
    FigureRow("payload force", "N", of_agents=False, moment=False),
    FigureRow("payload moment", "N m", of_agents=False, moment=True),
    FigureRow("agents' force", "N", of_agents=True, moment=False),
    FigureRow("agents' moment", "N m", of_agents=True, moment=True),
)


def plot_predictive_std(cases: axes.Cases, descriptions: Mapping[str, str]) -> Figure:
    """Plot figure 3: predictive standard deviations of `f_L` and `f_j` with the true errors `|f - f_hat|`.

    The standard deviation of a calibrated prediction equals the RMS of its error. The figure therefore shows the RMS of
    the error over a window. The standard deviation is `log.predictive_std`; it includes the stated label bias.

    Args:
        cases: Log of each case.
        descriptions: Description of each case.

    Returns:
        The figure, with separate rows for force and moment.
    """

    def plot_panel(ax: Axes, name: str, ds: xr.Dataset, row: FigureRow) -> None:
        deviations, errors = _predictive_std(ds, row), _errors(ds, row)
        for k, (sigma, error) in enumerate(zip(deviations, errors, strict=True)):
            color, dashes = axes.body_style(name, k, len(deviations))
            ax.plot(ds.time_sigma, sigma, color=color, linestyle=dashes, linewidth=2.0, alpha=0.55)
            window = max(1, round(axes.SMOOTHING_WINDOW / max(axes.sample_period(ds.time_sigma), axes.SAMPLE_PERIOD)))
            ax.plot(
                ds.time_sigma,
                np.sqrt(uniform_filter1d(error**2, window)),
                color=color,
                linestyle=dashes,
                linewidth=0.9,
            )

    handles: list[tuple[Artist, str]] = [
        (Line2D([], [], color=axes.GREY, linewidth=2.0, alpha=0.55), "predictive standard deviation"),
        (Line2D([], [], color=axes.GREY, linewidth=0.9), rf"error $\|f - \hat f\|$, {axes.SMOOTHING_WINDOW:g} s RMS"),
    ]
    return _plot_by_body(cases, descriptions, plot_panel, handles)


def plot_error_radius(cases: axes.Cases, descriptions: Mapping[str, str]) -> Figure:
    """Plot figure 5: error bounds `rho_bar_L`, `rho_bar_j` with the true errors `|f - f_hat|`.

    Panels are hatched where a bound is infinite, that is, where data contradict the stated RKHS norm or label errors.
    Red markers on the time axis show errors above their bound.

    Args:
        cases: Log of each case.
        descriptions: Description of each case.

    Returns:
        The figure, with separate rows for force and moment.
    """
    used_markers = {"unbounded": False, "exceeded": False}

    def plot_panel(ax: Axes, name: str, ds: xr.Dataset, row: FigureRow) -> None:
        t, radii = ds.time_sigma.values, _radii(ds, row)
        across = ax.get_xaxis_transform()
        for k, (radius, error) in enumerate(zip(radii, _errors(ds, row), strict=True)):
            color, dashes = axes.body_style(name, k, len(radii))
            finite, over = np.isfinite(radius), error > radius
            ax.plot(t, np.where(finite, radius, np.nan), color=color, linestyle=dashes, linewidth=1.6)
            ax.plot(t, error, color=color, linestyle=dashes, linewidth=0.6)
            if not finite.all():
                used_markers["unbounded"] = True
                ax.fill_between(t, 0, 1, where=~finite, transform=across, **INFINITE_MARKER)
            if over.any():
                used_markers["exceeded"] = True
                ax.plot(t[over], np.full(over.sum(), 0.02), transform=across, **EXCEEDED_MARKER)

    handles: list[tuple[Artist, str]] = [
        (Line2D([], [], color=axes.GREY, linewidth=1.6), r"error bound $\bar\rho$"),
        (Line2D([], [], color=axes.GREY, linewidth=0.6), r"error $\|f - \hat f\|$"),
    ]
    figure = _plot_by_body(cases, descriptions, plot_panel, handles, lambda: _marker_legend(used_markers))
    attrs = next(iter(cases.values())).attrs
    assumptions = conclusions.list_assumptions([str(attrs["bound_assumptions"])])
    status = f"assumed: {assumptions}" if assumptions else "all assumptions met"
    figure.suptitle(
        f"{attrs['rho_bound'].replace('_', ' ')} bound, confidence {attrs['rho_confidence']:g}; {status}",
        fontsize=8,
    )
    return figure


def _marker_legend(used_markers: Mapping[str, bool]) -> list[tuple[Artist, str]]:
    """Return legend entries of the markers that figure 5 contains."""
    entries: dict[str, tuple[Artist, str]] = {
        "unbounded": (Patch(**INFINITE_MARKER), "no finite bound"),
        "exceeded": (Line2D([], [], **EXCEEDED_MARKER), "error above bound"),
    }
    return [entry for kind, entry in entries.items() if used_markers[kind]]


def _plot_by_body(
    cases: axes.Cases,
    descriptions: Mapping[str, str],
    plot_panel: Callable[[Axes, str, xr.Dataset, FigureRow], None],
    handles: list[tuple[Artist, str]],
    extra_handles: Callable[[], list[tuple[Artist, str]]] = list,
) -> Figure:
    """Plot a figure with a row per item of `ROWS`, a column per case and a legend; `extra_handles` is called last."""
    figure = Figure(figsize=(style.PAGE_WIDTH * max(1, len(cases) / axes.COLUMNS), 5.4))
    grid = figure.subplots(len(ROWS), len(cases), sharex=True, sharey="row", squeeze=False)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        for ax, row in zip(column, ROWS, strict=True):
            plot_panel(ax, name, ds, row)
        column[0].set_title(axes.title(name, ds, descriptions))
        axes.time_axis(column[-1], cases)
    for panels, row in zip(grid, ROWS, strict=True):
        axes.log_scale(panels[0])
        panels[0].set_ylabel(f"{row.label} [{row.unit}]")
    for ax in grid.flat:
        ax.minorticks_off()  # the layout of minor ticks dominates the run time
    figure.align_ylabels(grid[:, 0])
    handles += axes.agent_legend(cases) + extra_handles()
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=min(6, len(handles)))
    return figure


def _errors(ds: xr.Dataset, row: FigureRow) -> list[np.ndarray]:
    """Compute `|f - f_hat|` of each body of a row at the times of the error bounds."""
    sampled = ds.sel(time=ds.time_sigma.values, method="nearest")
    payload = (log.stack_parts(sampled, "f_L") - log.stack_parts(sampled, "f_L_hat")).values
    force, torque = ((sampled[f] - sampled[f"{f}_hat"]).values for f in ("f_x", "f_w"))
    joint = (log.all_joints(sampled, "f_r") - log.all_joints(sampled, "f_r_hat")).values
    return _norms(ds, row, payload, force, torque, joint)


def _predictive_std(ds: xr.Dataset, row: FigureRow) -> list[np.ndarray]:
    """Compute the norm of the predictive standard deviations of each body of a row."""
    torque = np.hypot(ds.sigma_f_w.values, ds.label_bias_std_f_w.values)
    joint = np.hypot(log.all_joints(ds, "sigma_f_r").values, log.all_joints(ds, "label_bias_std_f_r").values)
    payload = log.stack_parts(ds, "predictive_std_f_L").values
    return _norms(ds, row, payload, ds.predictive_std_f_x.values, torque, joint)


def _norms(
    ds: xr.Dataset, row: FigureRow, payload: np.ndarray, force: np.ndarray, torque: np.ndarray, joint: np.ndarray
) -> list[np.ndarray]:
    """Compute norms over the outputs of a row by body: half a payload wrench, an agent's `f_x` or `(f_omega, f_r)`."""
    if not row.of_agents:
        return [np.linalg.norm(payload[:, 3:] if row.moment else payload[:, :3], axis=1)]
    agents = ds.agent.values
    if not row.moment:
        return [np.linalg.norm(force[:, j], axis=1) for j in range(len(agents))]
    owner = np.array([str(name).split("/")[0] for name in log.all_joints(ds, "r").joint.values])
    return [
        np.linalg.norm(np.hstack([torque[:, j], joint[:, owner == agent]]), axis=1) for j, agent in enumerate(agents)
    ]


def _radii(ds: xr.Dataset, row: FigureRow) -> list[np.ndarray]:
    """Return the error bound of each body of a row."""
    name = f"rho_bar_{'j' if row.of_agents else 'L'}_{'moment' if row.moment else 'force'}"
    return list(np.atleast_2d(ds[name].values.T))
