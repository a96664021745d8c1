"""Figures of a study: team, tracking error, wrench mismatch, contact forces and residual correction.

`write_figures` also writes the figures of `uncertainty_figures`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from colift.closed_loop import log_signals
from colift.visualization import axes as axes_module
from colift.visualization import contact_force_figures, limit_figures, rendering, team_figure, uncertainty_figures
from colift.visualization.style import (
    COLUMN_WIDTH,
    DASH_PATTERNS,
    DOTS,
    PAGE_WIDTH,
    LineStyle,
    NotebookFigure,
    save_figure,
    style_context,
    style_of,
    tint,
)

LEGEND_CHARACTERS, COLUMN_CHARACTERS = 150, 70  # in one line of a legend of page width and of column width
PAPER_CASES = ("C1", "C2", "C3")  # a caption explains them; the legend of a single column contains their names only
MARKERS = 9  # per line, so that lines differ in black and white
RANGE_OPACITY = 0.3  # opacity of the range of a noisy signal
CHANGE_POINT_STYLE: dict[str, Any] = {"color": "#CC3311", "linewidth": 1.0, "linestyle": (0, (4, 2))}
LABEL_STYLE: dict[str, Any] = {"color": axes_module.GREY, "linewidth": 0.5, "alpha": 0.6}
COVERAGE_FACTOR = 1.96  # of standard deviations, for 95 % of normal errors
TERMINATION_MARKER: dict[str, Any] = {"marker": "x", "markersize": 6, "linestyle": "none", "clip_on": False}


def write_figures(cases: axes_module.Cases, descriptions: Mapping[str, str], folder: str | Path) -> list[Path]:
    """Write all figures of a study as PDF and PNG (300 dpi).

    Figures 1 and 2 show all cases; they have a second version with the width of one column. Figures with one column per
    case omit the baselines if there are other cases. Figure 7 shows the cases with residual correction, figure 8 the
    last case that is not a baseline, and figure 9 the cases with an allocation within limits or with faults. The line
    of a case that stopped early ends in a cross. The metadata of each file contain the run id. A folder that cannot be
    written raises `OSError`.

    Args:
        cases: Log of each case.
        descriptions: Description of each case.
        folder: Folder of the files.

    Returns:
        Paths of the files.

    Raises:
        ValueError: If there are no cases, or if a log contains no valid scenario.

    Example:
        >>> run_id, logs = log.load_flights(Path("out/paper"), ALL_CASES)  # doctest: +SKIP
        >>> write_figures(logs, ALL_CASES, "figures")  # doctest: +SKIP
    """
    if not cases:
        raise ValueError("there are no cases: figures require at least one log")
    in_columns = {name: ds for name, ds in cases.items() if not style_of(name).is_baseline} or cases
    plots: dict[str, Callable[[], Figure]] = {
        "figure_0_team": lambda: plot_team(cases),
        "figure_1_tracking": lambda: plot_tracking_error(cases, descriptions),
        "figure_1_tracking_column": lambda: plot_tracking_error(cases, descriptions, single_column=True),
        "figure_2_mismatch": lambda: plot_wrench_mismatch(cases, descriptions),
        "figure_2_mismatch_column": lambda: plot_wrench_mismatch(cases, descriptions, single_column=True),
        "figure_3_deviation": lambda: uncertainty_figures.plot_predictive_std(in_columns, descriptions),
        "figure_4_forces": lambda: plot_contact_forces(in_columns, descriptions),
        "figure_5_rho_bar": lambda: uncertainty_figures.plot_error_radius(in_columns, descriptions),
    }
    if corrected := {
        name: ds for name, ds in cases.items() if "correction_std_L_force" in ds and "change_points" in ds.attrs
    }:
        plots["figure_7_reaction"] = lambda: plot_online_correction(corrected, descriptions)
    plots["figure_8_contact_forces"] = lambda: contact_force_figures.plot_contact_force_parts(in_columns, descriptions)
    if limited := {name: ds for name, ds in in_columns.items() if limit_figures.shows_limits(ds)}:
        plots["figure_9_limits"] = lambda: limit_figures.plot_limits(limited, descriptions)
    files, run = [], next(iter(cases.values())).attrs["run"]
    with style_context():
        for name, plot in plots.items():
            files += save_figure(plot(), Path(folder) / name, run)
    return files


def plot_team(cases: axes_module.Cases) -> Figure:
    """Plot the team at its initial state with the names of agents and contacts, and the whole path at scale.

    Args:
        cases: Log of each case; the figure shows the first.

    Returns:
        The figure.
    """
    return team_figure.plot_team(rendering.render_data(next(iter(cases.values()))))


class Panel(NamedTuple):
    """Panel of a figure that compares all cases.

    Attributes:
        label: Label of the logarithmic y axis.
        decades: Largest number of decades of the axis.
    """

    label: str
    decades: int = axes_module.MAX_DECADES


TRACKING_PANELS = (
    Panel(r"$\|e_p\|$ [m]"),
    Panel(r"$\Psi$ [–]", axes_module.QUADRATIC_DECADES),
)
MISMATCH_PANELS = tuple(
    Panel(f"{label}\n({axes_module.SMOOTHING_WINDOW:g} s RMS)")
    for label in (r"$\|\Delta F\|$ [N]", r"$\|\Delta \tau\|$ [N m]")
)


def plot_tracking_error(
    cases: axes_module.Cases,
    descriptions: Mapping[str, str],
    styles: Mapping[str, LineStyle] | None = None,
    single_column: bool = False,
) -> Figure:
    """Plot figure 1: norm of the position error `|e_p|` and attitude error function `Psi`.

    Args:
        cases: Log of each case.
        descriptions: Description of each case.
        styles: Line style of each case; default: `style_of`.
        single_column: Whether the figure has the width of one column, with the legend inside.

    Returns:
        The figure.
    """
    lines = {name: (ds.time.values, (axes_module.norm(ds.e_p), ds.Psi.values)) for name, ds in cases.items()}
    return _plot_comparison(cases, descriptions, lines, TRACKING_PANELS, styles, single_column)


def plot_wrench_mismatch(
    cases: axes_module.Cases, descriptions: Mapping[str, str], single_column: bool = False
) -> Figure:
    """Plot figure 2: norms of the wrench mismatch, force `|Delta F|` and moment `|Delta tau|`, as moving RMS.

    Args:
        cases: Log of each case.
        descriptions: Description of each case.
        single_column: Whether the figure has the width of one column, with the legend inside.

    Returns:
        The figure.
    """
    lines = {
        name: (
            ds.time.values,
            [axes_module.rms(ds, axes_module.norm(part)) for part in (ds.delta_W_force, ds.delta_W_moment)],
        )
        for name, ds in cases.items()
    }
    return _plot_comparison(cases, descriptions, lines, MISMATCH_PANELS, single_column=single_column)


Lines = Mapping[str, tuple[np.ndarray, Sequence[np.ndarray]]]  # by case: times, and one signal per panel


def _plot_comparison(
    cases: axes_module.Cases,
    descriptions: Mapping[str, str],
    lines: Lines,
    panels: Sequence[Panel],
    styles: Mapping[str, LineStyle] | None = None,
    single_column: bool = False,
) -> Figure:
    """Plot all cases in panels below each other, with the legend below them, or inside in a single column."""
    legend = [
        name if single_column and name in PAPER_CASES else axes_module.case_label(name, descriptions) for name in cases
    ]
    columns = axes_module.legend_columns(legend, COLUMN_CHARACTERS if single_column else LEGEND_CHARACTERS)
    size = (COLUMN_WIDTH, 3.4) if single_column else (PAGE_WIDTH, 3.6 + 0.16 * math.ceil(len(cases) / columns))
    figure = NotebookFigure(figsize=size)
    axes = list(figure.subplots(len(panels), 1, sharex=True))
    for k, (name, ds) in enumerate(cases.items()):
        t, signals = lines[name]
        for ax, y in zip(axes, signals, strict=True):
            _plot_line(ax, name, (styles or {}).get(name, style_of(name)), ds, t, y, k / len(cases))
    for ax, panel in zip(axes, panels, strict=True):
        axes_module.log_scale(ax, panel.decades, 10.0 ** (-1.5 * panel.decades))
        ax.set_ylabel(panel.label)
    axes_module.time_axis(axes[-1], cases)
    axes_module.draw_update_lines(axes, cases)
    handles, _ = axes[0].get_legend_handles_labels()
    if not all(ds.attrs["complete"] for ds in cases.values()):
        handles.append(Line2D([], [], **TERMINATION_MARKER, color="black"))
        legend.append("stopped early")
    if single_column:
        axes_module.legend_inside(axes[0], handles, legend, columns)
    else:
        figure.legend(handles, legend, loc="outside lower center", ncols=columns)
    figure.align_ylabels(axes)
    return figure


def _plot_line(
    ax: Axes, name: str, line: LineStyle, ds: xr.Dataset, t: np.ndarray, y: np.ndarray, shift: float
) -> None:
    """Plot a signal of a case; `shift` in [0, 1) displaces the markers, so that markers of two cases do not overlap."""
    every = axes_module.samples(ds, axes_module.SAMPLE_PERIOD)
    t, y = t[::every], y[::every]
    spacing = max(1, len(t) // MARKERS)
    ax.plot(
        *(t, y),
        color=line.color,
        linestyle=line.dashes,
        marker=line.marker,
        markevery=(int(shift * spacing), spacing),
        label=name,
    )
    finite = np.flatnonzero(np.isfinite(y))
    if not ds.attrs["complete"] and finite.size:
        ax.plot(t[finite[-1]], y[finite[-1]], **TERMINATION_MARKER, color=line.color)


# Contact forces -------------------------------------------------------------------------------------------------------


def plot_contact_forces(cases: axes_module.Cases, descriptions: Mapping[str, str]) -> Figure:
    """Plot figure 4: norms of the estimated contact forces and, if internal forces act, `|eta|` in the last row.

    Args:
        cases: Log of each case.
        descriptions: Description of each case.

    Returns:
        The figure, with agents as rows and cases as columns.
    """
    first = next(iter(cases.values()))
    agents = [name for name in first.agent.values.tolist() if _contacts_of(first, name)]
    internal = any((axes_module.norm(ds.eta) > 0).any() for ds in cases.values())
    rows = [2] * len(agents) + [1] * internal
    figure = Figure(figsize=(PAGE_WIDTH * max(1, len(cases) / axes_module.COLUMNS), 0.8 + 0.55 * sum(rows)))
    grid = figure.subplots(len(rows), len(cases), sharex=True, sharey="row", squeeze=False, height_ratios=rows)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        for ax, agent in zip(column, agents, strict=False):
            _plot_contacts(ax, name, ds, _contacts_of(ds, agent))
        eta = axes_module.norm(ds.eta)
        if internal:
            column[-1].plot(
                axes_module.decimate(ds, ds.time), axes_module.decimate(ds, eta), color=style_of(name).color
            )
        column[0].set_title(axes_module.title(name, ds, descriptions))
        axes_module.time_axis(column[-1], cases)
        for ax in column:
            axes_module.shade_span(ax, ds.time.values, eta > 0)
    for ax, agent in zip(grid[:, 0], agents, strict=False):
        ax.set_ylabel(f"{agent}\n" + r"$\|\hat\lambda_{j,b}\|$ [N]")
    if internal:
        grid[-1, 0].set_ylabel(r"$\|\eta\|$ [N]")
    figure.align_ylabels(grid[:, 0])
    _add_force_legend(figure, first, internal)
    return figure


def _contacts_of(ds: xr.Dataset, agent: str) -> list[str]:
    """Return the contact names of an agent."""
    return [name for name in ds.contact.values if name.split("/")[0] == agent]


def _plot_contacts(ax: Axes, name: str, ds: xr.Dataset, contacts: Sequence[str]) -> None:
    """Plot the contact forces of one agent: true value, range of the estimate, and moving average of the estimate."""
    t = axes_module.decimate(ds, ds.time)
    n = axes_module.samples(ds, axes_module.SMOOTHING_WINDOW)
    for k, contact in enumerate(contacts):
        color, dashes = axes_module.body_style(name, k, len(contacts))
        estimate, truth = (axes_module.norm(x.sel(contact=contact)) for x in (ds.lam_hat, ds.lam))
        low, high = (limit(estimate, n)[:: max(1, n // 2)] for limit in (minimum_filter1d, maximum_filter1d))
        ax.fill_between(ds.time[:: max(1, n // 2)], low, high, color=color, alpha=RANGE_OPACITY, linewidth=0)
        ax.plot(t, axes_module.decimate(ds, truth), **axes_module.TRUE_VALUE_STYLE, zorder=1.5)
        ax.plot(
            t, axes_module.decimate(ds, uniform_filter1d(estimate, n)), color=color, linestyle=dashes, linewidth=1.0
        )


def _add_force_legend(figure: Figure, ds: xr.Dataset, internal: bool) -> None:
    """Add the legend of figure 4, in grey because it applies to all columns."""
    arms: dict[int, dict[str, None]] = {}
    for agent in ds.agent.values:
        for k, contact in enumerate(_contacts_of(ds, agent)):
            arms.setdefault(k, {})[contact.split("/")[1]] = None
    styles = [(tint(axes_module.GREY, k, len(arms)), DASH_PATTERNS[k % len(DASH_PATTERNS)]) for k in arms]
    handles: list[Artist] = [Line2D([], [], color=color, linestyle=dashes) for color, dashes in styles]
    labels = [f"{' or '.join(names)}, {axes_module.SMOOTHING_WINDOW:g} s mean" for names in arms.values()]
    handles += [
        Patch(color=axes_module.GREY, alpha=RANGE_OPACITY, linewidth=0),
        Line2D([], [], **axes_module.TRUE_VALUE_STYLE),
    ]
    labels += [f"range in {axes_module.SMOOTHING_WINDOW:g} s", "true value"]
    if internal:
        handles.append(axes_module.active_patch())
        labels.append(r"$\eta$ active")
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


# Online correction ----------------------------------------------------------------------------------------------------


def plot_online_correction(cases: axes_module.Cases, descriptions: Mapping[str, str]) -> Figure:
    """Plot figure 7: position error, corrected payload force, corrections of agents, weight, and number of samples.

    Of the payload force, the component that varies most is shown: label, model, and model with correction and
    95 % interval. The correction weight is that of the agents' forces, averaged over agents and axes. Spans in which it
    is below 0.5 are shaded: the agents have no labels. Vertical lines mark change points.

    Args:
        cases: Logs of cases with residual correction.
        descriptions: Description of each case.

    Returns:
        The figure, with cases as columns.
    """
    figure = Figure(figsize=(PAGE_WIDTH * max(1, len(cases) / axes_module.COLUMNS), 6.0))
    grid = figure.subplots(5, len(cases), sharex=True, sharey="row", squeeze=False)
    shown = _varying_component(cases)
    weights = {name: ds.correction_weight_x.mean(("agent", "axis")) for name, ds in cases.items()}
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        t, agents = axes_module.decimate(ds, ds.time), ds.agent.values.tolist()
        color = style_of(name).color
        column[0].plot(t, axes_module.decimate(ds, axes_module.rms(ds, axes_module.norm(ds.e_p))), color=color)
        _plot_corrected_force(column[1], name, ds, shown)
        for k, agent in enumerate(agents):
            agent_color, dashes = axes_module.body_style(name, k, len(agents))
            size = axes_module.decimate(ds, axes_module.norm(ds.correction_x.sel(agent=agent)))
            column[2].plot(t, size, color=agent_color, linestyle=dashes, linewidth=0.9, label=agent)
        column[3].plot(t, axes_module.decimate(ds, weights[name]), color=color, linewidth=0.9)
        _plot_num_samples(column[4], name, ds)
        for ax in column:
            axes_module.shade_all(ax, ds.time.values, weights[name].values < 0.5)
            for entry in filter(None, str(ds.attrs.get("change_points", "")).split("; ")):
                ax.axvline(float(entry.split(" s:")[0]), **CHANGE_POINT_STYLE)
        column[0].set_title(axes_module.title(name, ds, descriptions))
        axes_module.time_axis(column[-1], cases)
    axes_module.log_scale(grid[0, 0])
    grid[3, 0].set_ylim(-0.05, 1.05)
    grid[4, 0].set_ylim(bottom=0)
    labels = [
        r"$\|e_p\|$ [m]" + f"\n({axes_module.SMOOTHING_WINDOW:g} s RMS)",
        "payload:\n" + f"force {shown} [N]",
        "agents:\n" + "correction [N]",
        "agents:\nweight [1]",
        "samples per body",
    ]
    for row, label in zip(grid, labels, strict=True):
        row[0].set_ylabel(label)
    figure.align_ylabels(grid[:, 0])
    figure.legend(*zip(*_correction_legend(cases, weights), strict=True), loc="outside lower center", ncols=4)
    return figure


def _varying_component(cases: axes_module.Cases) -> str:
    """Return the axis along which the labels of the payload force vary most."""
    variances = [ds.label_L_force.var("time").values for ds in cases.values()]
    return log_signals.AXES[int(np.argmax(np.sum(variances, axis=0)))]


def _plot_corrected_force(ax: Axes, name: str, ds: xr.Dataset, axis: str) -> None:
    """Plot one component of the payload force: label, model, and model with correction and 95 % interval."""
    label, model, correction, std = (
        axes_module.decimate(ds, ds[variable].sel(axis=axis))
        for variable in ("label_L_force", "model_prediction_L_force", "correction_L_force", "correction_std_L_force")
    )
    t, color, corrected = axes_module.decimate(ds, ds.time), style_of(name).color, model + correction
    ax.plot(t, label, **LABEL_STYLE)
    band = COVERAGE_FACTOR * std
    ax.fill_between(t, corrected - band, corrected + band, color=color, alpha=RANGE_OPACITY, linewidth=0)
    ax.plot(t, model, color=color, linestyle=DOTS, linewidth=0.9)
    ax.plot(t, corrected, color=color, linewidth=0.9)


def _correction_legend(cases: axes_module.Cases, weights: Mapping[str, xr.DataArray]) -> list[tuple[Artist, str]]:
    """Return the legend entries of figure 7."""
    handles = axes_module.agent_legend(cases)
    handles.append((Line2D([], [], **LABEL_STYLE), "label"))
    handles.append((Line2D([], [], color=axes_module.GREY, linestyle=DOTS), "model"))
    handles.append((Line2D([], [], color=axes_module.GREY), "model and correction"))
    handles.append((Patch(color=axes_module.GREY, alpha=RANGE_OPACITY, linewidth=0), "95 % interval"))
    if any(len(_num_samples(ds)) > 1 for ds in cases.values()):
        handles.append((Line2D([], [], color=axes_module.GREY), "samples, payload"))
        handles.append((Line2D([], [], color=axes_module.GREY, linestyle=DOTS), "samples, one agent"))
    if any((weight.values < 0.5).any() for weight in weights.values()):
        handles.append((axes_module.active_patch(), "correction weight below 0.5"))
    if any(ds.attrs.get("change_points") for ds in cases.values()):
        handles.append((Line2D([], [], **CHANGE_POINT_STYLE), "change point"))
    return handles


def _plot_num_samples(ax: Axes, name: str, ds: xr.Dataset) -> None:
    """Plot the number of samples of the payload model and, if it differs, of the model of one agent."""
    times = [0.0, *np.atleast_1d(ds.attrs["update_times_s"]), float(ds.time[-1])]
    for counts, dashes in zip(_num_samples(ds), ("-", DOTS), strict=False):
        ax.step(times, counts, where="post", color=style_of(name).color, linestyle=dashes)


def _num_samples(ds: xr.Dataset) -> list[np.ndarray]:
    """Return the number of samples of the payload after each update and, if it differs, the mean over the agents."""
    each = [np.atleast_1d(ds.attrs[f"num_samples_{of}"]) for of in ("payload", "agents")]
    payload, agent = (
        np.concatenate([[0.0], n, n[-1:] if len(n) else [0.0]]) for n in (each[0], each[1] / ds.sizes["agent"])
    )
    return [payload] if np.array_equal(payload, agent) else [payload, agent]
