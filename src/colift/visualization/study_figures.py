"""Figures of a study: the team, figures 1, 2 and 4 of the paper, the reaction of figure 7, and the writing of all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from colift.visualization import axes as axes_module
from colift.visualization import rendering, uncertainty_figures
from colift.visualization.style import DASH_PATTERNS, DOTS, PAGE, save_figure, style_context, style_of, tint

MARKS = 9  # on a line, so that it is told from others in black and white
BAND = 0.3  # opacity of the range of a noisy signal
TRUE_ERROR_STYLE: dict[str, Any] = {"color": "0.72", "linewidth": 2.8, "solid_capstyle": "butt"}
CHANGE_POINT_STYLE: dict[str, Any] = {"color": "#CC3311", "linewidth": 1.0, "linestyle": (0, (4, 2))}
REFIT_STYLE: dict[str, Any] = {"color": "#0077BB", "linewidth": 1.0, "linestyle": (0, (1, 1.5))}
EVENTS = {
    "world_changed": (CHANGE_POINT_STYLE, "the world has changed"),
    "fitted_anew": (REFIT_STYLE, "a misfit is fitted anew"),
}
STOPPED: dict[str, Any] = {"marker": "x", "markersize": 6, "linestyle": "none", "clip_on": False}


def write_figures(cases: axes_module.Cases, told: Mapping[str, str], folder: str | Path) -> list[Path]:
    """Write the figures of some cases, each as PDF and as PNG (300 dpi); return the files. `told`: what the cases are.

    Figures 1 and 2 show every case; those that have a column for each leave out rivals of learning where there are
    other cases; figure 7 shows those that listen to labels. A case that stopped early ends in a cross. Each file names
    the run in its metadata.
    Raises ValueError where there are no cases or a log does not hold its scenario, OSError where the folder cannot be
    written.
    """
    if not cases:
        raise ValueError("no cases to draw figures of")
    looked_into = {name: ds for name, ds in cases.items() if not style_of(name).is_baseline} or cases
    drawn: dict[str, Callable[[], Figure]] = {
        "figure_0_team": lambda: plot_team(cases),
        "figure_1_tracking": lambda: plot_tracking_error(cases, told),
        "figure_2_mismatch": lambda: plot_wrench_mismatch(cases, told),
        "figure_3_deviation": lambda: uncertainty_figures.plot_predictive_std(looked_into, told),
        "figure_4_forces": lambda: plot_contact_forces(looked_into, told),
        "figure_5_rho_bar": lambda: uncertainty_figures.plot_error_radius(looked_into, told),
    }
    if listening := {name: ds for name, ds in cases.items() if "r_L" in ds and "world_changed" in ds.attrs}:
        drawn["figure_7_reaction"] = lambda: plot_online_correction(listening, told)
    files, run = [], next(iter(cases.values())).attrs["run"]
    with style_context():
        for name, draw in drawn.items():
            files += save_figure(draw(), Path(folder) / name, run)
    return files


def plot_team(cases: axes_module.Cases) -> Figure:
    """The team at its start with its names, and the whole path with it to scale."""
    figure = Figure(figsize=(PAGE, 3.3))
    near, far = figure.subplots(1, 2)
    ds = next(iter(cases.values()))
    seen = rendering.render_data(ds)
    rendering.draw(near, seen, 0, close=True, names=True)
    near.set_title("the team at its start")
    rendering.draw(far, seen, 0, whole_path=True)
    far.set_title("the whole path")
    figure.supxlabel(f"grid {rendering.GRID:g} m; {rendering.arrow_scale_label(seen)}", fontsize=8)
    return figure


def plot_tracking_error(cases: axes_module.Cases, told: Mapping[str, str]) -> Figure:
    """Figure 1: position error norm `|e_p|` and attitude error function `Psi`."""
    lines = {name: (ds.time.values, (axes_module.norm(ds.e_p), ds.Psi.values)) for name, ds in cases.items()}
    return _compared(cases, told, lines, [r"$\|e_p\|$ [m]", r"$\Psi$ [–]"])


def plot_wrench_mismatch(cases: axes_module.Cases, told: Mapping[str, str]) -> Figure:
    """Figure 2: wrench mismatch `delta_W`, force and moment apart, RMS over a window."""
    lines = {
        name: (
            ds.time.values,
            [axes_module.rms(ds, axes_module.norm(part)) for part in (ds.delta_W[:, :3], ds.delta_W[:, 3:])],
        )
        for name, ds in cases.items()
    }
    labels = [r"$\|\Delta F\|$ [N]", r"$\|\Delta \tau\|$ [N m]"]
    return _compared(cases, told, lines, [f"{label}\n({axes_module.SMOOTHING_WINDOW:g} s RMS)" for label in labels])


Lines = Mapping[str, tuple[np.ndarray, Sequence[np.ndarray]]]  # times and a signal a panel, by case


def _compared(cases: axes_module.Cases, told: Mapping[str, str], lines: Lines, labels: Sequence[str]) -> Figure:
    """Panels below each other in which all cases are compared, and their names beside them."""
    figure = Figure(figsize=(PAGE, 3.6))
    axes = list(figure.subplots(len(labels), 1, sharex=True))
    for k, (name, ds) in enumerate(cases.items()):
        t, signals = lines[name]
        for ax, y in zip(axes, signals, strict=True):
            _line(ax, name, ds, t, y, k / len(cases))
    for ax, label in zip(axes, labels, strict=True):
        axes_module.log_scale(ax)
        ax.set_ylabel(label)
    axes_module.time_axis(axes[-1], cases)
    axes_module.draw_update_lines(axes, cases)
    handles, names = axes[0].get_legend_handles_labels()
    names = [axes_module.case_label(name, told) for name in names]
    if not all(ds.attrs["complete"] for ds in cases.values()):
        handles.append(Line2D([], [], **STOPPED, color="black"))
        names.append("stopped early")
    figure.legend(handles, names, loc="outside right upper")
    figure.align_ylabels(axes)
    return figure


def _line(ax: Axes, name: str, ds: xr.Dataset, t: np.ndarray, y: np.ndarray, shift: float) -> None:
    """A case's signal, with marks that those of other cases, at other shifts of 0 to 1, do not cover."""
    shown, every = style_of(name), axes_module.samples(ds, axes_module.STEP)
    t, y = t[::every], y[::every]
    apart = max(1, len(t) // MARKS)
    ax.plot(
        *(t, y),
        color=shown.color,
        linestyle=shown.dashes,
        marker=shown.marker,
        markevery=(int(shift * apart), apart),
        label=name,
    )
    finite = np.flatnonzero(np.isfinite(y))
    if not ds.attrs["complete"] and finite.size:
        ax.plot(t[finite[-1]], y[finite[-1]], **STOPPED, color=shown.color)


# Contact forces -------------------------------------------------------------------------------------------------------


def plot_contact_forces(cases: axes_module.Cases, told: Mapping[str, str]) -> Figure:
    """Figure 4: norms of the estimated contact forces, agents by row, cases by column; below, `|eta|` if it acts."""
    first = next(iter(cases.values()))
    agents = [name for name in first.agent.values.tolist() if _contacts_of(first, name)]
    internal = any((axes_module.norm(ds.eta) > 0).any() for ds in cases.values())
    rows = [2] * len(agents) + [1] * internal
    figure = Figure(figsize=(PAGE * max(1, len(cases) / axes_module.COLUMNS), 0.8 + 0.55 * sum(rows)))
    grid = figure.subplots(len(rows), len(cases), sharex=True, sharey="row", squeeze=False, height_ratios=rows)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        for ax, agent in zip(column, agents, strict=False):
            _contacts(ax, name, ds, _contacts_of(ds, agent))
        eta = axes_module.norm(ds.eta)
        if internal:
            column[-1].plot(
                axes_module.decimate(ds, ds.time), axes_module.decimate(ds, eta), color=style_of(name).color
            )
        column[0].set_title(axes_module.title(name, ds, told))
        axes_module.time_axis(column[-1], cases)
        for ax in column:
            axes_module.shade_span(ax, ds.time.values, eta > 0)
    for ax, agent in zip(grid[:, 0], agents, strict=False):
        ax.set_ylabel(f"{agent}\n" + r"$\|\hat\lambda_{j,b}\|$ [N]")
    if internal:
        grid[-1, 0].set_ylabel(r"$\|\eta\|$ [N]")
    figure.align_ylabels(grid[:, 0])
    _explain(figure, first, internal)
    return figure


def _contacts_of(ds: xr.Dataset, agent: str) -> list[str]:
    return [name for name in ds.contact_position.values if name.split("/")[0] == agent]


def _contacts(ax: Axes, name: str, ds: xr.Dataset, contacts: Sequence[str]) -> None:
    """One agent's contacts: the truth, beneath; the range of the raw estimate; its mean over a window, on top."""
    t = axes_module.decimate(ds, ds.time)
    n = axes_module.samples(ds, axes_module.SMOOTHING_WINDOW)
    for k, contact in enumerate(contacts):
        color, dashes = axes_module.body_style(name, k, len(contacts))
        estimate, truth = (axes_module.norm(x.sel(contact=contact)) for x in (ds.lam_hat, ds.lam))
        low, high = (limit(estimate, n)[:: max(1, n // 2)] for limit in (minimum_filter1d, maximum_filter1d))
        ax.fill_between(ds.time[:: max(1, n // 2)], low, high, color=color, alpha=BAND, linewidth=0)
        ax.plot(t, axes_module.decimate(ds, truth), **TRUE_ERROR_STYLE, zorder=1.5)
        ax.plot(
            t, axes_module.decimate(ds, uniform_filter1d(estimate, n)), color=color, linestyle=dashes, linewidth=1.0
        )


def _explain(figure: Figure, ds: xr.Dataset, internal: bool) -> None:
    """The legend of figure 4, in grey: it holds for every column."""
    arms: dict[int, dict[str, None]] = {}
    for agent in ds.agent.values:
        for k, contact in enumerate(_contacts_of(ds, agent)):
            arms.setdefault(k, {})[contact.split("/")[1]] = None
    strokes = [(tint(axes_module.GREY, k, len(arms)), DASH_PATTERNS[k % len(DASH_PATTERNS)]) for k in arms]
    handles: list[Artist] = [Line2D([], [], color=color, linestyle=dashes) for color, dashes in strokes]
    labels = [f"{' or '.join(names)}, {axes_module.SMOOTHING_WINDOW:g} s mean" for names in arms.values()]
    handles += [Patch(color=axes_module.GREY, alpha=BAND, linewidth=0), Line2D([], [], **TRUE_ERROR_STYLE)]
    labels += [f"range in {axes_module.SMOOTHING_WINDOW:g} s", "truth"]
    if internal:
        handles.append(Patch(color=axes_module.ACTIVE, linewidth=0))
        labels.append(r"$\eta$ active")
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


# Memory and reflex ----------------------------------------------------------------------------------------------------


def plot_online_correction(cases: axes_module.Cases, told: Mapping[str, str]) -> Figure:
    """Figure 7: of cases that listen, the error, what labels say beyond the map, how much of either is used, points.

    What is used of the payload's map is that of its changes, the mean over force and moment. Shaded where labels have
    stopped and what they said has faded; a red line where the world was found to have changed.
    """
    figure = Figure(figsize=(PAGE * max(1, len(cases) / axes_module.COLUMNS), 6.0))
    grid = figure.subplots(5, len(cases), sharex=True, sharey="row", squeeze=False)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        t, agents = axes_module.decimate(ds, ds.time), ds.agent.values.tolist()
        column[0].plot(
            t, axes_module.decimate(ds, axes_module.rms(ds, axes_module.norm(ds.e_p))), color=style_of(name).color
        )
        column[1].plot(
            t,
            axes_module.decimate(ds, axes_module.norm(ds.innovation_L[:, :3])),
            color=style_of(name).color,
            linewidth=0.9,
        )
        for k, agent in enumerate(agents):
            color, dashes = axes_module.body_style(name, k, len(agents))
            r = axes_module.norm(ds.innovation_x.sel(agent=agent))
            column[2].plot(t, axes_module.decimate(ds, r), color=color, linestyle=dashes, linewidth=0.9, label=agent)
        column[3].plot(
            t, axes_module.decimate(ds, ds.model_gain_L.mean("wrench")), color=style_of(name).color, linewidth=0.9
        )
        column[3].plot(t, axes_module.decimate(ds, ds.correction_weight), color=style_of(name).color, linestyle=DOTS)
        _points(column[4], name, ds)
        for ax in column:
            axes_module.shade_all(ax, ds.time.values, ds.correction_weight.values < 0.5)
            for event, (style, _) in EVENTS.items():
                for said in filter(None, str(ds.attrs.get(event, "")).split("; ")):
                    ax.axvline(float(said.split(" s:")[0]), **style)
        column[0].set_title(axes_module.title(name, ds, told))
        axes_module.time_axis(column[-1], cases)
    axes_module.log_scale(grid[0, 0])
    grid[3, 0].set_ylim(-0.05, 1.05)
    grid[4, 0].set_ylim(bottom=0)
    labels = [
        r"$\|e_p\|$ [m]" + f"\n({axes_module.SMOOTHING_WINDOW:g} s RMS)",
        "payload:\n" + r"label $-$ map [N]",
        "agents:\n" + r"label $-$ map [N]",
        "used [1]",
        "points of a body",
    ]
    for row, label in zip(grid, labels, strict=True):
        row[0].set_ylabel(label)
    figure.align_ylabels(grid[:, 0])
    handles = axes_module.agent_legend(cases)
    handles.append((Line2D([], [], color=axes_module.GREY), "used of the payload's map"))
    handles.append((Line2D([], [], color=axes_module.GREY, linestyle=DOTS), "used of the correction"))
    if any(len(_counts(ds)) > 1 for ds in cases.values()):
        handles.append((Line2D([], [], color=axes_module.GREY), "payload's points"))
        handles.append((Line2D([], [], color=axes_module.GREY, linestyle=DOTS), "an agent's points"))
    if any((ds.correction_weight.values < 0.5).any() for ds in cases.values()):
        handles.append((Patch(color=axes_module.ACTIVE, linewidth=0), "the correction has faded"))
    for event, (style, what) in EVENTS.items():
        if any(ds.attrs.get(event) for ds in cases.values()):
            handles.append((Line2D([], [], **style), what))
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=min(4, len(handles)))
    return figure


def _points(ax: Axes, name: str, ds: xr.Dataset) -> None:
    """Samples that the map of the payload, and of an agent if it has others, rests on, from update to update."""
    times = [0.0, *np.atleast_1d(ds.attrs["update_times_s"]), float(ds.time[-1])]
    for counts, dashes in zip(_counts(ds), ("-", DOTS), strict=False):
        ax.step(times, counts, where="post", color=style_of(name).color, linestyle=dashes)


def _counts(ds: xr.Dataset) -> list[np.ndarray]:
    """Of the payload, and of an agent on average where that is not the same."""
    each = [np.atleast_1d(ds.attrs[f"update_points_{of}"]) for of in ("payload", "agents")]
    load, agent = (
        np.concatenate([[0.0], n, n[-1:] if len(n) else [0.0]]) for n in (each[0], each[1] / ds.sizes["agent"])
    )
    return [load] if np.array_equal(load, agent) else [load, agent]
