"""Figure of limits and faults: errors, largest contact force, rotor effectiveness, and the limits that act."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import maximum_filter1d

from colift.analysis import poses
from colift.visualization import axes as axes_module
from colift.visualization.style import PAGE_WIDTH, style_of

LIMITS = {
    "thrust limit": ("thrust_limited", "thrust_saturated"),
    "tilt limit": ("tilt_limited",),
    "friction limit": ("friction_limited",),
    "force limit": ("force_limited",),
}
"""Rows of the lowest panel: label, and the signals of which at least one is active."""
SLACKS = {
    "roll, pitch slack": "slack_roll_pitch",
    "yaw slack": "slack_yaw",
    "z slack": "slack_z",
    "x, y slack": "slack_xy",
}
"""Further rows of that panel: commanded force, or moment over its lever, that is not achieved [N]."""
SLACK_THRESHOLD = 0.1
"""Slack from which a row is active [N]; smaller values are residuals of the solver."""
ROW_LABELS = (r"$\|e_p\|$ [m]", "attitude\nerror [deg]", "largest contact\nforce [N]", "effective-\nness [1]")


def shows_limits(ds: xr.Dataset) -> bool:
    """Return whether a log is of an allocation with limits, or of a flight with faults.

    A log without a valid scenario raises `ValueError`.

    Args:
        ds: Log.

    Returns:
        True if `plot_limits` has something to show.
    """
    return "slack_z" in ds or bool(poses.scenario_of_log(ds).faults)


def plot_limits(cases: axes_module.Cases, descriptions: Mapping[str, str]) -> Figure:
    """Plot figure 9: errors, largest contact force, estimated rotor effectiveness, and active limits.

    Vertical bands show the faults. In the lowest panel a bar shows when a limit of at least one agent or contact acts,
    or when a part of the commanded acceleration is not achieved.

    Args:
        cases: Log of each case.
        descriptions: Description of each case.

    Returns:
        The figure, with cases as columns.
    """
    effectiveness = any("effectiveness" in ds for ds in cases.values())
    labels = ROW_LABELS[: 4 if effectiveness else 3]
    num_bars = max(len(_active_limits(ds)) for ds in cases.values())
    heights = [2.0] * len(labels) + [0.3 + 0.24 * num_bars]
    figure = Figure(figsize=(PAGE_WIDTH * max(1, len(cases) / axes_module.COLUMNS), 0.8 + 0.5 * sum(heights)))
    grid = figure.subplots(len(heights), len(cases), sharex=True, sharey="row", squeeze=False, height_ratios=heights)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        signals = [axes_module.norm(ds.e_p), _attitude_error(ds), np.linalg.norm(ds.lam.values, axis=-1).max(1)]
        for ax, y in zip(column, signals, strict=False):
            ax.plot(*(axes_module.decimate(ds, x) for x in (ds.time, y)), color=style_of(name).color)
        if effectiveness:
            _plot_effectiveness(column[3], name, ds)
        _plot_limits(column[-1], name, ds)
        for ax in column:
            _shade_faults(ax, ds)
        column[0].set_title(axes_module.title(name, ds, descriptions))
        axes_module.time_axis(column[-1], cases)
    for row in grid[:3]:
        axes_module.log_scale(row[0])
    for ax, label in zip(grid[:, 0], labels, strict=False):
        ax.set_ylabel(label)
    figure.align_ylabels(grid[:, 0])
    handles = [*axes_module.agent_legend(cases)] if effectiveness else []
    if any(poses.scenario_of_log(ds).faults for ds in cases.values()):
        handles.append((axes_module.active_patch(), "fault"))
    if handles:
        figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=len(handles))
    return figure


def _attitude_error(ds: xr.Dataset) -> np.ndarray:
    """Return the angle between payload attitude and reference [deg]."""
    return np.rad2deg(np.arccos(np.clip(1 - ds.Psi.values, -1.0, 1.0)))


def _plot_effectiveness(ax: Axes, name: str, ds: xr.Dataset) -> None:
    """Plot the rotor effectiveness that the controller compensates."""
    if "effectiveness" not in ds:
        return
    agents = ds.agent.values.tolist()
    for k, agent in enumerate(agents):
        color, dashes = axes_module.body_style(name, k, len(agents))
        t, y = (axes_module.decimate(ds, x) for x in (ds.time, ds.effectiveness.sel(agent=agent)))
        ax.plot(t, y, color=color, linestyle=dashes)
    ax.set_ylim(0, 1.1)


def _active_limits(ds: xr.Dataset) -> dict[str, np.ndarray]:
    """Return when each limit and each slack of a log acts, by label."""
    ticks = ds.sizes["time"]
    limits = {
        label: np.any([ds[signal].values.reshape(ticks, -1).any(1) for signal in signals if signal in ds], axis=0)
        for label, signals in LIMITS.items()
        if any(signal in ds for signal in signals)
    }
    return limits | {label: ds[signal].values > SLACK_THRESHOLD for label, signal in SLACKS.items() if signal in ds}


def _plot_limits(ax: Axes, name: str, ds: xr.Dataset) -> None:
    """Plot one bar for each limit and each slack, where it acts."""
    rows = _active_limits(ds)
    window = axes_module.samples(ds, 2 * axes_module.SAMPLE_PERIOD)  # so that an active period is not skipped
    for k, active in enumerate(rows.values()):
        drawn = maximum_filter1d(active, window)
        ax.fill_between(ds.time, k - 0.35, k + 0.35, where=drawn, color=style_of(name).color, linewidth=0)
    ax.set_yticks(range(len(rows)), list(rows))
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)


def _shade_faults(ax: Axes, ds: xr.Dataset) -> None:
    """Shade the intervals of the faults."""
    for fault in poses.scenario_of_log(ds).faults:
        end = min(fault.last_time, float(ds.time[-1]))
        ax.axvspan(fault.start_s, end, color=axes_module.ACTIVE_SHADE, linewidth=0, zorder=0)
