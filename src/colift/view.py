"""Figures of a study: the team, figures 1 to 4 of the paper, the radii of figure 5, and the reaction of figure 7."""

from __future__ import annotations

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
from matplotlib.ticker import AutoMinorLocator, LogLocator, MaxNLocator, NullFormatter
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from colift import look, picture
from colift.look import Color, Dashes

WINDOW = 0.2  # s, over which noisy signals are averaged for the eye; labels and legends say so
STEP = 0.01  # s, between drawn points
MARKS = 9  # on a line, so that it is told from others in black and white
COLUMNS = 4  # cases beside each other on a page's width
BAND = 0.3  # opacity of the range of a noisy signal
GREY = "#444444"  # of legends that hold for every case
ACTIVE = "0.92"  # grey of the span in which internal forces act
TRUTH: dict[str, Any] = {"color": "0.72", "linewidth": 2.8, "solid_capstyle": "butt"}
UNBOUNDED: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.6", "hatch": "//////", "linewidth": 0}
EXCEEDED: dict[str, Any] = {"color": "red", "marker": "|", "markersize": 4, "linestyle": "none"}
CHANGED: dict[str, Any] = {"color": "#CC3311", "linewidth": 1.0, "linestyle": (0, (4, 2))}
STOPPED: dict[str, Any] = {"marker": "x", "markersize": 6, "linestyle": "none", "clip_on": False}

Cases = Mapping[str, xr.Dataset]


def figures(cases: Cases, told: Mapping[str, str], folder: str | Path) -> list[Path]:
    """Write the figures of some cases, each as PDF and as PNG (300 dpi); return the files. `told`: what the cases are.

    Figures 1 and 2 show every case; those that have a column for each leave out rivals of learning where there are
    other cases; figure 7 shows those that listen to labels. A case that stopped early ends in a cross. Each file names
    the run in its metadata.
    Raises ValueError where there are no cases or a log does not hold its scenario, OSError where the folder cannot be
    written.
    """
    if not cases:
        raise ValueError("no cases to draw figures of")
    looked_into = {name: ds for name, ds in cases.items() if not look.of(name).rival} or cases
    drawn: dict[str, Callable[[], Figure]] = {
        "figure_0_team": lambda: team(cases),
        "figure_1_tracking": lambda: tracking(cases, told),
        "figure_2_mismatch": lambda: mismatch(cases, told),
        "figure_3_deviation": lambda: deviation(looked_into, told),
        "figure_4_forces": lambda: contact_forces(looked_into, told),
        "figure_5_rho_bar": lambda: rho_bar(looked_into, told),
    }
    if listening := {name: ds for name, ds in cases.items() if "r_L" in ds and "world_changed" in ds.attrs}:
        drawn["figure_7_reaction"] = lambda: reaction(listening, told)
    files, run = [], next(iter(cases.values())).attrs["run"]
    with look.style():
        for name, draw in drawn.items():
            files += look.save(draw(), Path(folder) / name, run)
    return files


def team(cases: Cases) -> Figure:
    """The team at its start with its names, and the whole path with it to scale."""
    figure = Figure(figsize=(look.PAGE, 3.3))
    near, far = figure.subplots(1, 2)
    ds = next(iter(cases.values()))
    seen = picture.sketch(ds)
    picture.draw(near, seen, 0, close=True, names=True)
    near.set_title("the team at its start")
    picture.draw(far, seen, 0, whole_path=True)
    far.set_title("the whole path")
    figure.supxlabel(f"grid {picture.GRID:g} m; {picture.key(seen)}", fontsize=8)
    return figure


def tracking(cases: Cases, told: Mapping[str, str]) -> Figure:
    """Figure 1: position error norm `|e_p|` and attitude error function `Psi`."""
    lines = {name: (ds.time.values, (_norm(ds.e_p), ds.Psi.values)) for name, ds in cases.items()}
    return _compared(cases, told, lines, [r"$\|e_p\|$ [m]", r"$\Psi$ [–]"])


def mismatch(cases: Cases, told: Mapping[str, str]) -> Figure:
    """Figure 2: wrench mismatch `delta_W`, force and moment apart, RMS over a window."""
    lines = {
        name: (ds.time.values, [_rms(ds, _norm(part)) for part in (ds.delta_W[:, :3], ds.delta_W[:, 3:])])
        for name, ds in cases.items()
    }
    labels = [r"$\|\Delta F\|$ [N]", r"$\|\Delta \tau\|$ [N m]"]
    return _compared(cases, told, lines, [f"{label}\n({WINDOW:g} s RMS)" for label in labels])


Lines = Mapping[str, tuple[np.ndarray, Sequence[np.ndarray]]]  # times and a signal a panel, by case


def _compared(cases: Cases, told: Mapping[str, str], lines: Lines, labels: Sequence[str]) -> Figure:
    """Panels below each other in which all cases are compared, and their names beside them."""
    figure = Figure(figsize=(look.PAGE, 3.6))
    axes = list(figure.subplots(len(labels), 1, sharex=True))
    for k, (name, ds) in enumerate(cases.items()):
        t, signals = lines[name]
        for ax, y in zip(axes, signals, strict=True):
            _line(ax, name, ds, t, y, k / len(cases))
    for ax, label in zip(axes, labels, strict=True):
        _log_scale(ax)
        ax.set_ylabel(label)
    _time_axis(axes[-1], cases)
    _mark_updates(axes, cases)
    handles, names = axes[0].get_legend_handles_labels()
    names = [_called(name, told) for name in names]
    if not all(ds.attrs["complete"] for ds in cases.values()):
        handles.append(Line2D([], [], **STOPPED, color="black"))
        names.append("stopped early")
    figure.legend(handles, names, loc="outside right upper")
    figure.align_ylabels(axes)
    return figure


def _called(name: str, told: Mapping[str, str]) -> str:
    """The name of a case and what it is."""
    return f"{name}: {told[name].split(':')[0]}" if name in told else name


def _line(ax: Axes, name: str, ds: xr.Dataset, t: np.ndarray, y: np.ndarray, shift: float) -> None:
    """A case's signal, with marks that those of other cases, at other shifts of 0 to 1, do not cover."""
    shown, every = look.of(name), _samples(ds, STEP)
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


# Bodies by row, cases by column ---------------------------------------------------------------------------------------


class Part(NamedTuple):
    """What one row of figures 3 and 5 shows: of which bodies, and what of them."""

    label: str
    unit: str
    of_agents: bool
    moment: bool


PARTS = (
    Part("payload force", "N", of_agents=False, moment=False),
    Part("payload moment", "N m", of_agents=False, moment=True),
    Part("agents' force", "N", of_agents=True, moment=False),
    Part("agents' moment", "N m", of_agents=True, moment=True),
)


def deviation(cases: Cases, told: Mapping[str, str]) -> Figure:
    """Figure 3: predictive deviations of `f_L` and `f_j`, and the true errors `|f - f_hat|` that they stand for.

    Force and moment apart. A deviation, `log.predictive`, is the RMS that an error has if it is honest, so errors are
    RMS over a window too; to `|Sigma^(1/2)|` of the posterior it adds what sensors are constantly off as stated.
    """

    def one(ax: Axes, name: str, ds: xr.Dataset, part: Part) -> None:
        expected, errors = _deviations(ds, part), _errors(ds, part)
        for k, (sigma, error) in enumerate(zip(expected, errors, strict=True)):
            color, dashes = _body(name, k, len(expected))
            ax.plot(ds.time_sigma, sigma, color=color, linestyle=dashes, linewidth=2.0, alpha=0.55)
            window = max(1, round(WINDOW / max(_period(ds.time_sigma), STEP)))
            ax.plot(
                ds.time_sigma,
                np.sqrt(uniform_filter1d(error**2, window)),
                color=color,
                linestyle=dashes,
                linewidth=0.9,
            )

    handles: list[tuple[Artist, str]] = [
        (Line2D([], [], color=GREY, linewidth=2.0, alpha=0.55), "predictive deviation"),
        (Line2D([], [], color=GREY, linewidth=0.9), rf"error $\|f - \hat f\|$, {WINDOW:g} s RMS"),
    ]
    return _by_body(cases, told, one, handles)


def rho_bar(cases: Cases, told: Mapping[str, str]) -> Figure:
    """Figure 5: radii `rho_bar_L`, `rho_bar_j` over the true errors `|f - f_hat|`.

    Hatched where a radius is infinite: the data contradict the norm and the label errors that it rests on. A red mark
    on the time axis where an error exceeds its radius.
    """
    seen = {"unbounded": False, "exceeded": False}

    def one(ax: Axes, name: str, ds: xr.Dataset, part: Part) -> None:
        t, radii = ds.time_sigma.values, _radii(ds, part)
        across = ax.get_xaxis_transform()
        for k, (radius, error) in enumerate(zip(radii, _errors(ds, part), strict=True)):
            color, dashes = _body(name, k, len(radii))
            finite, over = np.isfinite(radius), error > radius
            ax.plot(t, np.where(finite, radius, np.nan), color=color, linestyle=dashes, linewidth=1.6)
            ax.plot(t, error, color=color, linestyle=dashes, linewidth=0.6)
            if not finite.all():
                seen["unbounded"] = True
                ax.fill_between(t, 0, 1, where=~finite, transform=across, **UNBOUNDED)
            if over.any():
                seen["exceeded"] = True
                ax.plot(t[over], np.full(over.sum(), 0.02), transform=across, **EXCEEDED)

    handles: list[tuple[Artist, str]] = [
        (Line2D([], [], color=GREY, linewidth=1.6), r"radius $\bar\rho$"),
        (Line2D([], [], color=GREY, linewidth=0.6), r"error $\|f - \hat f\|$"),
    ]
    figure = _by_body(cases, told, one, handles, lambda: _marked(seen))
    attrs = next(iter(cases.values())).attrs
    status = f"assumed: {attrs['rho_assumed']}" if attrs["rho_assumed"] else "all assumptions met"
    figure.suptitle(
        f"{attrs['rho_bound'].replace('_', ' ')} bound, confidence {attrs['rho_confidence']:g}; {status}",
        fontsize=8,
    )
    return figure


def _marked(seen: Mapping[str, bool]) -> list[tuple[Artist, str]]:
    """What the marks of figure 5 mean, of those that it has."""
    marks: dict[str, tuple[Artist, str]] = {
        "unbounded": (Patch(**UNBOUNDED), "no finite radius"),
        "exceeded": (Line2D([], [], **EXCEEDED), "error above radius"),
    }
    return [mark for kind, mark in marks.items() if seen[kind]]


def _by_body(
    cases: Cases,
    told: Mapping[str, str],
    one: Callable[[Axes, str, xr.Dataset, Part], None],
    handles: list[tuple[Artist, str]],
    more: Callable[[], list[tuple[Artist, str]]] = list,
) -> Figure:
    """A figure with a row for each part and a column for each case; below, what lines mean, and which agent has which.

    `more`: what there is to explain beside `handles`, asked once all is drawn.
    """
    figure = Figure(figsize=(look.PAGE * max(1, len(cases) / COLUMNS), 5.4))
    grid = figure.subplots(len(PARTS), len(cases), sharex=True, sharey="row", squeeze=False)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        for ax, part in zip(column, PARTS, strict=True):
            one(ax, name, ds, part)
        column[0].set_title(_title(name, ds, told))
        _time_axis(column[-1], cases)
    for row, part in zip(grid, PARTS, strict=True):
        _log_scale(row[0])
        row[0].set_ylabel(f"{part.label} [{part.unit}]")
    for ax in grid.flat:
        ax.minorticks_off()  # on twelve panels they take longer to lay out than all else
    figure.align_ylabels(grid[:, 0])
    handles += _agents(cases) + more()
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=min(6, len(handles)))
    return figure


def _agents(cases: Cases) -> list[tuple[Artist, str]]:
    """Which agent has which stroke, where there are several."""
    agents = next(iter(cases.values())).agent.values.tolist()
    strokes = [(look.tint(GREY, k, len(agents)), look.STROKES[k % len(look.STROKES)]) for k in range(len(agents))]
    return [
        (Line2D([], [], color=color, linestyle=dashes, linewidth=1.3), agent)
        for (color, dashes), agent in zip(strokes, agents, strict=True)
        if len(agents) > 1
    ]


def _title(name: str, ds: xr.Dataset, told: Mapping[str, str]) -> str:
    early = "" if ds.attrs["complete"] else f"\n(stopped at {float(ds.time[-1]):.1f} s)"
    return _called(name, told) + early


def _body(name: str, k: int, n: int) -> tuple[Color, Dashes]:
    """Colour and stroke of the k-th of n bodies of a case."""
    return look.tint(look.of(name).color, k, n), look.STROKES[k % len(look.STROKES)]


def _errors(ds: xr.Dataset, part: Part) -> list[np.ndarray]:
    """`|f - f_hat|` of a part of each of its bodies, at the times of the radii."""
    at = ds.sel(time=ds.time_sigma.values, method="nearest")
    load = (at.f_L - at.f_L_hat).values
    force, torque, joint = ((at[f] - at[f"{f}_hat"]).values for f in ("f_x", "f_w", "f_r"))
    return _norms(ds, part, load, force, torque, joint)


def _deviations(ds: xr.Dataset, part: Part) -> list[np.ndarray]:
    """Norms of the predictive deviations of a part of each of its bodies."""
    moments = (np.hypot(ds[f"sigma_{f}"].values, ds[f"bias_{f}"].values) for f in ("f_w", "f_r"))
    return _norms(ds, part, ds.deviation_f_L.values, ds.deviation_f_x.values, *moments)


def _norms(
    ds: xr.Dataset, part: Part, load: np.ndarray, force: np.ndarray, torque: np.ndarray, joint: np.ndarray
) -> list[np.ndarray]:
    """Norms over the outputs of a part, by body: of the payload's six, or of an agent's `f_x` or `(f_omega, f_r)`."""
    if not part.of_agents:
        return [np.linalg.norm(load[:, 3:] if part.moment else load[:, :3], axis=1)]
    agents = ds.agent.values
    if not part.moment:
        return [np.linalg.norm(force[:, j], axis=1) for j in range(len(agents))]
    owner = np.array([str(name).split("/")[0] for name in ds.joint.values])
    return [
        np.linalg.norm(np.hstack([torque[:, j], joint[:, owner == agent]]), axis=1) for j, agent in enumerate(agents)
    ]


def _radii(ds: xr.Dataset, part: Part) -> list[np.ndarray]:
    name = f"rho_bar_{'j' if part.of_agents else 'L'}_{'moment' if part.moment else 'force'}"
    return list(np.atleast_2d(ds[name].values.T))


# Contact forces -------------------------------------------------------------------------------------------------------


def contact_forces(cases: Cases, told: Mapping[str, str]) -> Figure:
    """Figure 4: norms of the estimated contact forces, agents by row, cases by column; below, `|eta|` if it acts."""
    first = next(iter(cases.values()))
    agents = [name for name in first.agent.values.tolist() if _contacts_of(first, name)]
    internal = any((_norm(ds.eta) > 0).any() for ds in cases.values())
    rows = [2] * len(agents) + [1] * internal
    figure = Figure(figsize=(look.PAGE * max(1, len(cases) / COLUMNS), 0.8 + 0.55 * sum(rows)))
    grid = figure.subplots(len(rows), len(cases), sharex=True, sharey="row", squeeze=False, height_ratios=rows)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        for ax, agent in zip(column, agents, strict=False):
            _contacts(ax, name, ds, _contacts_of(ds, agent))
        eta = _norm(ds.eta)
        if internal:
            column[-1].plot(_thin(ds, ds.time), _thin(ds, eta), color=look.of(name).color)
        column[0].set_title(_title(name, ds, told))
        _time_axis(column[-1], cases)
        for ax in column:
            _shade(ax, ds.time.values, eta > 0)
    for ax, agent in zip(grid[:, 0], agents, strict=False):
        ax.set_ylabel(f"{agent}\n" + r"$\|\hat\lambda_{j,b}\|$ [N]")
    if internal:
        grid[-1, 0].set_ylabel(r"$\|\eta\|$ [N]")
    figure.align_ylabels(grid[:, 0])
    _explain(figure, first, internal)
    return figure


def _contacts_of(ds: xr.Dataset, agent: str) -> list[str]:
    return [name for name in ds.contact.values if name.split("/")[0] == agent]


def _contacts(ax: Axes, name: str, ds: xr.Dataset, contacts: Sequence[str]) -> None:
    """One agent's contacts: the truth, beneath; the range of the raw estimate; its mean over a window, on top."""
    t = _thin(ds, ds.time)
    n = _samples(ds, WINDOW)
    for k, contact in enumerate(contacts):
        color, dashes = _body(name, k, len(contacts))
        estimate, truth = (_norm(x.sel(contact=contact)) for x in (ds.lam_hat, ds.lam))
        low, high = (limit(estimate, n)[:: max(1, n // 2)] for limit in (minimum_filter1d, maximum_filter1d))
        ax.fill_between(ds.time[:: max(1, n // 2)], low, high, color=color, alpha=BAND, linewidth=0)
        ax.plot(t, _thin(ds, truth), **TRUTH, zorder=1.5)
        ax.plot(t, _thin(ds, uniform_filter1d(estimate, n)), color=color, linestyle=dashes, linewidth=1.0)


def _explain(figure: Figure, ds: xr.Dataset, internal: bool) -> None:
    """The legend of figure 4, in grey: it holds for every column."""
    arms: dict[int, dict[str, None]] = {}
    for agent in ds.agent.values:
        for k, contact in enumerate(_contacts_of(ds, agent)):
            arms.setdefault(k, {})[contact.split("/")[1]] = None
    strokes = [(look.tint(GREY, k, len(arms)), look.STROKES[k % len(look.STROKES)]) for k in arms]
    handles: list[Artist] = [Line2D([], [], color=color, linestyle=dashes) for color, dashes in strokes]
    labels = [f"{' or '.join(names)}, {WINDOW:g} s mean" for names in arms.values()]
    handles += [Patch(color=GREY, alpha=BAND, linewidth=0), Line2D([], [], **TRUTH)]
    labels += [f"range in {WINDOW:g} s", "truth"]
    if internal:
        handles.append(Patch(color=ACTIVE, linewidth=0))
        labels.append(r"$\eta$ active")
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


# Memory and reflex ----------------------------------------------------------------------------------------------------


def reaction(cases: Cases, told: Mapping[str, str]) -> Figure:
    """Figure 7: of cases that listen, the error, what labels say beyond the map, and how many points the map has.

    Shaded where labels have stopped and what they said has faded; a red line where the world was found to have changed.
    """
    figure = Figure(figsize=(look.PAGE * max(1, len(cases) / COLUMNS), 5.0))
    grid = figure.subplots(4, len(cases), sharex=True, sharey="row", squeeze=False)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        t, agents = _thin(ds, ds.time), ds.agent.values.tolist()
        column[0].plot(t, _thin(ds, _rms(ds, _norm(ds.e_p))), color=look.of(name).color)
        column[1].plot(t, _thin(ds, _norm(ds.r_L[:, :3])), color=look.of(name).color, linewidth=0.9)
        for k, agent in enumerate(agents):
            color, dashes = _body(name, k, len(agents))
            r = _norm(ds.r_x.sel(agent=agent))
            column[2].plot(t, _thin(ds, r), color=color, linestyle=dashes, linewidth=0.9, label=agent)
        _points(column[3], name, ds)
        for ax in column:
            _shade_all(ax, ds.time.values, ds.fresh.values < 0.5)
            for said in filter(None, str(ds.attrs["world_changed"]).split("; ")):
                ax.axvline(float(said.split(" s:")[0]), **CHANGED)
        column[0].set_title(_title(name, ds, told))
        _time_axis(column[-1], cases)
    _log_scale(grid[0, 0])
    grid[3, 0].set_ylim(bottom=0)
    labels = [
        r"$\|e_p\|$ [m]" + f"\n({WINDOW:g} s RMS)",
        "payload:\n" + r"label $-$ map [N]",
        "agents:\n" + r"label $-$ map [N]",
        "points",
    ]
    for row, label in zip(grid, labels, strict=True):
        row[0].set_ylabel(label)
    figure.align_ylabels(grid[:, 0])
    handles: list[tuple[Artist, str]] = [
        *_agents(cases),
        (Line2D([], [], color=GREY, drawstyle="steps-post"), "payload's points"),
        (Line2D([], [], color=GREY, linestyle=look.DOTS), "an agent's points"),
        (Patch(color=ACTIVE, linewidth=0), "the correction has faded"),
        (Line2D([], [], **CHANGED), "the world has changed"),
    ]
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=min(6, len(handles)))
    return figure


def _points(ax: Axes, name: str, ds: xr.Dataset) -> None:
    """Samples that the map of the payload, and of an agent, rests on, from update to update."""
    times = [0.0, *np.atleast_1d(ds.attrs["update_times_s"]), float(ds.time[-1])]
    for of, among, dashes in (("payload", 1, "-"), ("agents", ds.sizes["agent"], look.DOTS)):
        n = np.atleast_1d(ds.attrs[f"update_points_{of}"]) / among
        counts = [0.0, *n, n[-1] if len(n) else 0.0]
        ax.step(times, counts, where="post", color=look.of(name).color, linestyle=dashes)


def _shade_all(ax: Axes, t: np.ndarray, active: np.ndarray) -> None:
    """Shade every span in which something holds."""
    ax.fill_between(t, 0, 1, where=active, transform=ax.get_xaxis_transform(), color=ACTIVE, linewidth=0, zorder=0)


# Several seeds --------------------------------------------------------------------------------------------------------

MERITS = {  # axis label by the name of a figure of merit, and its scale
    "e_p_rms_m": (r"$\|e_p\|$, RMS [mm]", 1e3),
    "e_R_rms": (r"$\|e_R\|$, RMS [$10^{-3}$]", 1e3),
    "delta_W_force_rms_N": (r"$\|\Delta F\|$, RMS [N]", 1.0),
    "delta_W_moment_rms_Nm": (r"$\|\Delta \tau\|$, RMS [N m]", 1.0),
}


def spread(found: Sequence[Mapping[str, Mapping[str, float]]], told: Mapping[str, str], path: str | Path) -> list[Path]:
    """Write figures of merit by case, a mark for each seed and a line at the median, as PDF and PNG; the files.

    found: for each seed the summaries of its cases. Raises OSError where they cannot be written.
    """
    with look.style():
        return look.save(_spread(found, told), Path(path))


def _spread(found: Sequence[Mapping[str, Mapping[str, float]]], told: Mapping[str, str]) -> Figure:
    cases = list(found[0])
    figure = Figure(figsize=(look.PAGE, 0.6 + 0.2 * len(cases)))
    axes = figure.subplots(1, len(MERITS), sharey=True)
    for ax, (merit, (label, scale)) in zip(axes, MERITS.items(), strict=True):
        for row, case in enumerate(cases):
            values, shown = [scale * seed[case][merit] for seed in found], look.of(case)
            ax.plot(values, np.full(len(values), row), shown.marker, color=shown.color, alpha=0.7, markersize=4)
            ax.plot([np.median(values)] * 2, [row - 0.35, row + 0.35], color="black", linewidth=0.8)
        ax.set(xscale="log", xlabel=label, ylim=(len(cases) - 0.5, -0.5))
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_yticks(range(len(cases)), [_called(case, told) for case in cases])
    return figure


# Axes and signals -----------------------------------------------------------------------------------------------------


def _log_scale(ax: Axes) -> None:
    """A logarithmic axis with a mark at every decade, or at 1, 2 and 5 where it spans less than two."""
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    narrow = high < 100 * low
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,), numticks=20))
    ax.yaxis.set_minor_locator(LogLocator(subs=range(2, 10), numticks=20))
    ax.yaxis.set_minor_formatter(NullFormatter())
    if low > 5e-4 and high < 1e4:  # else powers of ten are read more easily
        ax.yaxis.set_major_formatter("{x:g}")


def _time_axis(ax: Axes, cases: Cases) -> None:
    """From 0 to the end of the longest flight: one period after its last tick; to 1 s where none has a second tick."""
    ax.set_xlabel("time [s]")
    ax.set_xlim(0, max(float(ds.time[-1]) + _period(ds.time) for ds in cases.values()) or 1.0)
    ax.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    ax.xaxis.set_minor_locator(AutoMinorLocator())


def _period(t: xr.DataArray) -> float:
    """Time between two rows of the log, s; 0 where there is only one."""
    return float(t[1] - t[0]) if len(t) > 1 else 0.0


def _mark_updates(axes: Sequence[Axes], cases: Cases) -> None:
    """Light lines at the update times t_k, with their names until T_end, and a dashed one there."""
    times = sorted({float(t) for ds in cases.values() for t in np.atleast_1d(ds.attrs["update_times_s"])})
    if not times:
        return
    end = float(next(iter(cases.values())).attrs["T_end_s"])
    for ax in axes:
        for t in set(times) - {end}:
            ax.axvline(t, color="0.75", linewidth=0.6, zorder=1)
        ax.axvline(end, color="0.35", linewidth=0.8, linestyle=(0, (3, 2)), zorder=1)
    marks = {t: f"t_{{{k + 1}}}" for k, t in enumerate(times) if t <= end}
    marks[end] = rf"{marks[end]} = T_\mathrm{{end}}" if end in marks else r"T_\mathrm{end}"
    for t, text in marks.items():
        axes[0].annotate(
            f"${text}$",
            (t, 1),
            xycoords=("data", "axes fraction"),
            xytext=(-4, 1.5),
            textcoords="offset points",
            ha="left",  # the long one at T_end then keeps clear of the last update
            va="bottom",
            fontsize=7,
        )


def _shade(ax: Axes, t: np.ndarray, active: np.ndarray) -> None:
    """Shade the span in which internal forces act."""
    if active.any():
        ax.axvspan(t[active][0], t[active][-1], color=ACTIVE, linewidth=0, zorder=0)


def _norm(x: xr.DataArray) -> np.ndarray:
    return np.linalg.norm(x.values, axis=1)


def _samples(ds: xr.Dataset, seconds: float) -> int:
    """Ticks in a span of time, at least one."""
    period = _period(ds.time)
    return max(1, round(seconds / period)) if period else 1


def _rms(ds: xr.Dataset, x: np.ndarray) -> np.ndarray:
    """RMS over a window around each tick: unlike a low-pass it hides no power."""
    return np.sqrt(uniform_filter1d(x**2, _samples(ds, WINDOW)))


def _thin(ds: xr.Dataset, x: xr.DataArray | np.ndarray) -> np.ndarray:
    return np.asarray(x)[:: _samples(ds, STEP)]
