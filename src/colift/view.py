"""Figures 1 to 4 of the paper, the radii of figure 5, and the table of learned length-scales.

No state of a user's matplotlib is touched.
"""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.style
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import AutoMinorLocator, LogLocator, MaxNLocator, NullFormatter, NullLocator
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from colift import disk
from colift.certify.assumed import word
from colift.certify.certificate import Certificate

COLUMN, PAGE = 3.5, 7.16  # in, width of one column of the journal, and of two
TITLE = 130  # characters of a title's line on a page's width
WINDOW = 0.2  # s, over which noisy signals are averaged for the eye; the axis label says so
STEP = 0.01  # s, between drawn points
BAND = 0.3  # opacity of the range of a noisy signal
ACTIVE = "0.92"  # grey of the span in which internal forces act
TRUTH: dict[str, Any] = {"color": "black", "linewidth": 0.6, "dashes": (3, 2.5)}
UNBOUNDED: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.6", "hatch": "//////", "linewidth": 0}
EXCEEDED: dict[str, Any] = {"color": "red", "marker": "|", "markersize": 4, "linestyle": "none"}
STOPPED: dict[str, Any] = {"marker": "x", "linestyle": "none", "clip_on": False}

STYLE = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "lines.linewidth": 1.0,
    "lines.solid_joinstyle": "round",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.4,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.0,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # TrueType: text stays text, as journals ask
    "ps.fonttype": 42,
}


class Look(NamedTuple):
    """How a case is drawn in every figure."""

    color: str
    label: str
    dashes: str | tuple[int, tuple[float, ...]] = "-"


# Paul Tol's high-contrast scheme: told apart by any colour vision, and in grey
LOOKS = {
    "C1": Look("#DDAA33", "C1: no learning"),
    "C2": Look("#BB5566", "C2: payload"),
    "C3": Look("#004488", "C3: payload and agents"),
}
RIVALS = {
    "I": Look("#117733", "I: integral", (0, (4, 1.2))),
    "DOB": Look("#33BBEE", "DOB: observer", (0, (4, 1.2))),
    "P": Look("#AA4499", "P: parametric", (0, (1.2, 1))),
    "O": Look("#777777", "O: exact residuals", (0, (1.2, 1))),
}


def figures(cases: Mapping[str, xr.Dataset], folder: str | Path) -> list[Path]:
    """Write the paper's four figures of some cases and the radii, each as PDF and as PNG (300 dpi); return the files.

    Figure 1 shows every case, the others only those of the paper. A case that stopped early ends in a cross. Each file
    names the run in its metadata, as the cases do.
    Raises ValueError for a case that has no look, OSError where the folder cannot be written.
    """
    unknown = [name for name in cases if name not in LOOKS | RIVALS]
    if unknown or not set(cases) & set(LOOKS):
        raise ValueError(f"cases {list(cases)}: some of {', '.join(LOOKS)}, and beside them {', '.join(RIVALS)}")
    own = {name: cases[name] for name in LOOKS if name in cases}
    rivals = {name: cases[name] for name in RIVALS if name in cases}
    drawn: dict[str, tuple[Callable[[Mapping[str, xr.Dataset]], Figure], Mapping[str, xr.Dataset]]] = {
        "figure_1_tracking": (tracking, own | rivals),
        "figure_2_mismatch": (mismatch, own),
        "figure_3_deviation": (deviation, own),
        "figure_4_forces": (contact_forces, own),
        "figure_5_rho_bar": (rho_bar, own),
    }
    files = []
    with matplotlib.style.context(["default", STYLE]):
        for name, (draw, shown) in drawn.items():
            figure = draw(shown)
            for suffix in ("pdf", "png"):
                files.append(_save(figure, Path(folder) / f"{name}.{suffix}", next(iter(cases.values())).attrs["run"]))
                figure.set_layout_engine("none")  # the first layout holds for both
    return files


def tracking(cases: Mapping[str, xr.Dataset]) -> Figure:
    """Figure 1: position error norm `|e_p|` and attitude error function `Psi`."""
    figure, (top, bottom) = _panels(2, 3.4 + 0.2 * (len(cases) > len(LOOKS)))
    for name, ds in cases.items():
        _line(top, name, ds, ds.time, _norm(ds.e_p))
        _line(bottom, name, ds, ds.time, ds.Psi.values)
    _finish(figure, [top, bottom], [r"$\|e_p\|$ [m]", r"$\Psi$ [–]"], cases)
    return figure


def mismatch(cases: Mapping[str, xr.Dataset]) -> Figure:
    """Figure 2: wrench mismatch `|delta_W|`, its force part, its moment part, and the paper's plain norm of both."""
    figure, axes = _panels(3, 4.2)
    for name, ds in cases.items():
        for ax, part in zip(axes, (ds.delta_W[:, :3], ds.delta_W[:, 3:], ds.delta_W), strict=True):
            _line(ax, name, ds, ds.time, _rms(ds, _norm(part)))
    labels = [r"$\|\Delta F\|$ [N]", r"$\|\Delta \tau\|$ [N m]", r"$\|\Delta W\|$ [N, N m]"]
    _finish(figure, axes, [f"{label}\n({WINDOW:g} s RMS)" for label in labels], cases)
    return figure


def deviation(cases: Mapping[str, xr.Dataset]) -> Figure:
    """Figure 3: predictive deviations `sigma_L` and `sigma_A` along the trajectories, plain norms."""
    figure, axes = _panels(2, 3.3)
    for i, (name, ds) in enumerate(cases.items()):
        for ax, sigma in zip(axes, (ds.sigma_L, ds.sigma_A), strict=True):
            # curves that coincide stay visible: the later, the thinner
            _line(ax, name, ds, ds.time_sigma, sigma.values, width=(2.4, 1.5, 0.9)[i])
    _finish(figure, axes, [r"$\sigma_L$ [N, N m]", r"$\sigma_A$ [N, N m]"], cases)
    return figure


def contact_forces(cases: Mapping[str, xr.Dataset]) -> Figure:
    """Figure 4: norms of the estimated contact forces, agents by row and cases by column; below, `|eta|`."""
    first = next(iter(cases.values()))
    agents = first.agent.values.tolist()
    figure = Figure(figsize=(PAGE, 1.3 + 1.15 * len(agents)))
    grid = figure.subplots(
        len(agents) + 1,
        len(cases),
        sharex=True,
        sharey="row",
        squeeze=False,
        height_ratios=[2] * len(agents) + [1],
    )
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        for ax, agent in zip(column, agents, strict=False):
            _contacts(ax, name, ds, [c for c in ds.contact.values if c.split("/")[0] == agent])
        eta = _norm(ds.eta)
        column[-1].plot(_thin(ds, ds.time), _thin(ds, eta), color=LOOKS[name].color)
        early = "" if ds.attrs["complete"] else f" (stopped at {float(ds.time[-1]):.1f} s)"
        column[0].set_title(LOOKS[name].label + early, fontsize=8)
        _time_axis(column[-1], cases)
        for ax in column:
            _shade(ax, ds.time.values, eta > 0)
    for ax, agent in zip(grid[:, 0], agents, strict=False):
        ax.set_ylabel(f"{agent}\n" + r"$\|\hat\lambda_{j,b}\|$ [N]")
    grid[-1, 0].set_ylabel(r"$\|\eta\|$ [N]")
    figure.align_ylabels(grid[:, 0])
    _explain(figure, first)
    return figure


def _contacts(ax: Axes, name: str, ds: xr.Dataset, contacts: Sequence[str]) -> None:
    """One agent's contacts: mean over a window, range of the raw estimate, and the truth."""
    t = _thin(ds, ds.time)
    n = _samples(ds, WINDOW)
    for k, contact in enumerate(contacts):
        color = _tint(LOOKS[name].color, k, len(contacts))
        estimate, truth = (_norm(x.sel(contact=contact)) for x in (ds.lam_hat, ds.lam))
        low, high = (limit(estimate, n)[:: max(1, n // 2)] for limit in (minimum_filter1d, maximum_filter1d))
        ax.fill_between(ds.time[:: max(1, n // 2)], low, high, color=color, alpha=BAND, linewidth=0)
        ax.plot(t, _thin(ds, uniform_filter1d(estimate, n)), color=color, linewidth=1.6)
        ax.plot(t, _thin(ds, truth), **TRUTH)


Color = tuple[float, float, float]


def _tint(color: str, k: int, n: int) -> Color:
    """The k-th of n tints of a colour, from itself towards white."""
    white = 0.9 * k / n
    red, green, blue = (white + (1 - white) * c for c in to_rgb(color))
    return red, green, blue


def _explain(figure: Figure, ds: xr.Dataset) -> None:
    """The legend of figure 4, in grey: it holds for every column."""
    arms: dict[int, dict[str, None]] = {}
    for agent in ds.agent.values:
        own = [c.split("/")[1] for c in ds.contact.values if c.split("/")[0] == agent]
        for k, arm in enumerate(own):
            arms.setdefault(k, {})[arm] = None
    grey = "#444444"
    handles: list[Artist] = [Line2D([], [], color=_tint(grey, k, len(arms)), linewidth=1.6) for k in arms]
    labels = [f"{' or '.join(names)}, {WINDOW:g} s mean" for names in arms.values()]
    handles += [Patch(color=grey, alpha=BAND, linewidth=0), Line2D([], [], **TRUTH), Patch(color=ACTIVE, linewidth=0)]
    labels += [f"range in {WINDOW:g} s", "truth", r"$\eta$ active"]
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


PARTS = (  # of figure 5: axis label, radius in the log, its unit
    (r"payload force", "rho_bar_L_force", "N"),
    (r"payload moment", "rho_bar_L_moment", "N m"),
    (r"agents' force", "rho_bar_j_force", "N"),
    (r"agents' moment", "rho_bar_j_moment", "N m"),
)


def rho_bar(cases: Mapping[str, xr.Dataset]) -> Figure:
    """Figure 5: radii `rho_bar_L`, `rho_bar_j` over the true errors `|f - f_hat|`, cases by column; agents in tints.

    Hatched where a radius is infinite: the data contradict the norm and the label errors that it rests on. A red mark
    on the time axis where an error exceeds its radius.
    """
    first = next(iter(cases.values()))
    figure = Figure(figsize=(PAGE, 5.2))
    grid = figure.subplots(len(PARTS), len(cases), sharex=True, sharey="row", squeeze=False)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        errors = _errors(ds)
        for ax, (_, radius, _) in zip(column, PARTS, strict=True):
            bodies = np.atleast_2d(ds[radius].values.T)
            for k, (bound, error) in enumerate(zip(bodies, errors[radius], strict=True)):
                _bound(ax, _tint(LOOKS[name].color, k, len(bodies)), ds.time_sigma.values, bound, error)
        early = "" if ds.attrs["complete"] else f" (stopped at {float(ds.time[-1]):.1f} s)"
        column[0].set_title(LOOKS[name].label + early, fontsize=8)
        _time_axis(column[-1], cases)
    for row, (label, _, unit) in zip(grid, PARTS, strict=True):
        _log_scale(row[0])
        row[0].set_ylabel(f"{label} [{unit}]")
    for ax in grid.flat:
        ax.minorticks_off()  # on twelve panels they take longer to lay out than all else
    figure.align_ylabels(grid[:, 0])
    _explain_radii(figure, first)
    return figure


def _errors(ds: xr.Dataset) -> dict[str, np.ndarray]:
    """`|f - f_hat|` of each body by the name of its radius, at the times of the radii."""
    at = ds.sel(time=ds.time_sigma.values, method="nearest")
    load = (at.f_L - at.f_L_hat).values
    force, torque, joint = ((at[f] - at[f"{f}_hat"]).values for f in ("f_x", "f_w", "f_r"))
    owner = [str(name).split("/")[0] for name in ds.joint.values]
    own = [[name == agent for name in owner] for agent in ds.agent.values]
    moment = [np.linalg.norm(np.hstack([torque[:, j], joint[:, mine]]), axis=1) for j, mine in enumerate(own)]
    return {
        "rho_bar_L_force": np.linalg.norm(load[:, :3], axis=1)[None],
        "rho_bar_L_moment": np.linalg.norm(load[:, 3:], axis=1)[None],
        "rho_bar_j_force": np.linalg.norm(force, axis=2).T,
        "rho_bar_j_moment": np.stack(moment),
    }


def _bound(ax: Axes, color: Color, t: np.ndarray, bound: np.ndarray, error: np.ndarray) -> None:
    """One body's radius, thick, over its error, thin; where the radius is infinite or too small is marked."""
    finite = np.isfinite(bound)
    ax.plot(t, np.where(finite, bound, np.nan), color=color, linewidth=1.6)
    ax.plot(t, error, color=color, linewidth=0.6)
    across = ax.get_xaxis_transform()
    if not finite.all():
        ax.fill_between(t, 0, 1, where=~finite, transform=across, **UNBOUNDED)
    over = error > bound
    ax.plot(t[over], np.full(over.sum(), 0.02), transform=across, **EXCEEDED)


def _explain_radii(figure: Figure, ds: xr.Dataset) -> None:
    """The legend of figure 5, in grey, and what the radii rest on."""
    grey = "#444444"
    handles: list[Artist] = [Line2D([], [], color=grey, linewidth=1.6), Line2D([], [], color=grey, linewidth=0.6)]
    handles += [Patch(**UNBOUNDED), Line2D([], [], **EXCEEDED)]
    labels = [r"radius $\bar\rho$", r"error $\|f - \hat f\|$", "no finite radius", "error above radius"]
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    assumed = ds.attrs["rho_assumed"]
    status = f"assumed: {assumed}" if assumed else "all assumptions met"
    figure.suptitle(
        f"{ds.attrs['rho_bound'].replace('_', ' ')} bound, confidence {ds.attrs['rho_confidence']:g}; {status}",
        fontsize=8,
    )


def _panels(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(COLUMN, height))
    return figure, list(figure.subplots(rows, 1, sharex=True))


def _line(ax: Axes, name: str, ds: xr.Dataset, t: xr.DataArray, y: np.ndarray, width: float = 1.0) -> None:
    look, at = (LOOKS | RIVALS)[name], t.values
    every = max(1, round(STEP / (at[1] - at[0]))) if len(at) > 1 else 1
    ax.plot(at[::every], y[::every], color=look.color, linestyle=look.dashes, linewidth=width, label=look.label)
    finite = np.flatnonzero(np.isfinite(y))
    if not ds.attrs["complete"] and finite.size:
        ax.plot(at[finite[-1]], y[finite[-1]], **STOPPED, color=look.color)


def _finish(figure: Figure, axes: Sequence[Axes], labels: Sequence[str], cases: Mapping[str, xr.Dataset]) -> None:
    """Scales, labels, marks of the updates, and a legend above the panels, where it hides nothing."""
    for ax, label in zip(axes, labels, strict=True):
        _log_scale(ax)
        ax.set_ylabel(label)
    _time_axis(axes[-1], cases)
    _mark_updates(axes, cases)
    handles, names = axes[0].get_legend_handles_labels()
    if not all(ds.attrs["complete"] for ds in cases.values()):
        handles.append(Line2D([], [], **STOPPED, color="black"))
        names.append("stopped early")
    figure.legend(handles, names, loc="outside upper center", ncols=3)
    figure.align_ylabels(axes)


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


def _time_axis(ax: Axes, cases: Mapping[str, xr.Dataset]) -> None:
    """From 0 to the end of the longest flight: one period after its last tick; to 1 s where none has a second tick."""
    ax.set_xlabel("time [s]")
    ax.set_xlim(0, max(float(ds.time[-1]) + _period(ds) for ds in cases.values()) or 1.0)
    ax.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    ax.xaxis.set_minor_locator(AutoMinorLocator())


def _period(ds: xr.Dataset) -> float:
    """Time between two rows of the log, s; 0 where there is only one."""
    return float(ds.time[1] - ds.time[0]) if ds.sizes["time"] > 1 else 0.0


def _mark_updates(axes: Sequence[Axes], cases: Mapping[str, xr.Dataset]) -> None:
    """Light lines at the update times t_k, and a dashed one at T_end."""
    times = sorted({float(t) for ds in cases.values() for t in np.atleast_1d(ds.attrs["update_times_s"])})
    if not times:
        return
    end = float(next(iter(cases.values())).attrs["T_end_s"])
    for ax in axes:
        for t in set(times) - {end}:
            ax.axvline(t, color="0.75", linewidth=0.6, zorder=1)
        ax.axvline(end, color="0.35", linewidth=0.8, linestyle=(0, (3, 2)), zorder=1)
    marks = {t: f"t_{{{k + 1}}}" for k, t in enumerate(times)}
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
    period = _period(ds)
    return max(1, round(seconds / period)) if period else 1


def _rms(ds: xr.Dataset, x: np.ndarray) -> np.ndarray:
    """RMS over a window around each tick: unlike a low-pass it hides no power."""
    return np.sqrt(uniform_filter1d(x**2, _samples(ds, WINDOW)))


def _thin(ds: xr.Dataset, x: xr.DataArray | np.ndarray) -> np.ndarray:
    return np.asarray(x)[:: _samples(ds, STEP)]


def certificate(found: Certificate, slack: Mapping[str, float], folder: str | Path, run: str) -> list[Path]:
    """Write figure 6 as PDF and PNG: the radius and the observed error of position, and where the slack comes from.

    Titles say what the radii assume and, in red, which errors exceed one; each file names the run in its metadata.
    Raises OSError where the folder cannot be written.
    """
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(PAGE, 2.9))
        left, right = figure.subplots(1, 2, width_ratios=(1, 0.9))
        best = found.radii.get("recovery", found.radii["energy"])
        _errors_and_radii(left, found, "recovery" if "recovery" in found.radii else "energy")
        _reasoning(right, slack)
        if above := ", ".join(dict.fromkeys(SYMBOLS[each.error] for each in found.exceeded)):
            left.set_title(f"observed above a radius: {above}", fontsize=8, color="red")
        if best.assumed:
            figure.suptitle(textwrap.fill(f"assumed: {', '.join(best.assumed)}", TITLE), fontsize=8)
        return [_save(figure, Path(folder) / f"figure_6_certificate.{kind}", run) for kind in ("pdf", "png")]


SYMBOLS = {"e_p": "$e_p$", "e_v": "$e_v$", "e_R": "$e_R$", "e_omega": r"$e_\omega$"}


def _errors_and_radii(ax: Axes, found: Certificate, bound: str) -> None:
    """Position error over time under its radii by one bound, where there are any."""
    best = found.radii[bound]
    blue, red, says = LOOKS["C3"].color, LOOKS["C2"].color, f"by {bound}, {word(best.assumed)}"
    if np.isfinite(found.bound).all():
        ax.plot(found.t, 1e3 * found.bound, color=red, label=f"radius for this run {says}")
    if np.isfinite(best.tube["e_p"]):
        label = f"radius for any run {says}"
        ax.axhline(1e3 * best.tube["e_p"], color=red, linewidth=0.8, dashes=(1.5, 1.5), label=label)
    ax.plot(found.t, 1e3 * found.e_p, color=blue, label=r"observed $\Vert e_p\Vert$")
    label = "greatest with nothing unknown (floor)"
    ax.axhline(1e3 * found.floor["e_p"], color="0.5", linewidth=0.8, dashes=(4, 2), label=label)
    ax.set(xlabel="time [s]", ylabel="position error [mm]", xlim=(found.t[0], found.t[-1]), ylim=(0, None))
    ax.set_ylim(top=1.45 * ax.get_ylim()[1])  # room for the legend
    ax.legend(loc="upper left")


def _reasoning(ax: Axes, slack: Mapping[str, float]) -> None:
    """Radii of e_p under ever better reasoning, where there are any, down to what was observed."""
    causes = [name for name, radius in slack.items() if np.isfinite(radius)]
    sizes = [1e3 * slack[name] for name in causes]
    place = np.arange(len(causes))[::-1]
    colors = {"observed": LOOKS["C3"].color, "floor: nothing unknown": "0.6"}
    ax.barh(place, sizes, color=[colors.get(name, LOOKS["C2"].color) for name in causes], height=0.6)
    ax.set_xscale("log")
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_yticks(place, causes)
    ax.set(xlabel=r"greatest $\Vert e_p\Vert$ [mm]", xlim=(0.5 * min(sizes), 30 * max(sizes)))
    ax.grid(axis="y", visible=False)
    for y, size in zip(place, sizes, strict=True):
        ax.text(size * 1.2, y, f"{size:.3g}" if size < 1e4 else f"{size / 1e3:.3g} m", va="center", fontsize=7)


def shrinkage(
    n: Sequence[float],
    radii: Mapping[str, Sequence[float]],
    floor: Sequence[float],
    parts: Mapping[str, Sequence[float]],
    path: str | Path,
) -> list[Path]:
    """Write Corollary 1 as PDF and PNG: ultimate errors, m, against the number of data n, and the floor beneath.

    `parts`, each over its first value, shows what a radius is made of: beta, the greatest deviation, their product.
    """
    colors, marks = ("#DDAA33", "#BB5566", "#004488"), ("s", "o", "^")
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(PAGE, 2.6))
        left, right = figure.subplots(1, 2)
        for (name, radius), color, mark in zip(radii.items(), colors, marks, strict=False):
            left.plot(n, 1e3 * np.asarray(radius), color=color, marker=mark, markersize=3.5, label=name)
        left.plot(n, 1e3 * np.asarray(floor), color="0.5", linewidth=0.8, dashes=(4, 2), label="floor: nothing unknown")
        left.set(ylabel=r"ultimate $\Vert e_p\Vert$ [mm]")
        for (name, part), color, mark in zip(parts.items(), colors, marks, strict=False):
            right.plot(n, np.asarray(part) / part[0], color=color, marker=mark, markersize=3.5, label=name)
        right.set(ylabel="relative to the fewest data")
        for ax in (left, right):
            ax.set(xscale="log", yscale="log", xlabel="data points of each body")
            ax.set_xticks(n, [f"{each:g}" for each in n])
            ax.minorticks_off()
            ax.legend()
        return [_save(figure, Path(path).with_suffix(f".{kind}")) for kind in ("pdf", "png")]


def _save(figure: Figure, path: Path, run: str | None = None) -> Path:
    """Render in memory, then write whole or not at all; the same figure gives the same bytes."""
    memory = io.BytesIO()
    told = {"Keywords": run} if run else {}
    dateless = {"CreationDate": None} if path.suffix == ".pdf" else {}
    figure.savefig(memory, format=path.suffix[1:], metadata=told | dateless)
    disk.write(path, memory.getvalue())
    return path


Learned = tuple[Sequence[str], Sequence[str], np.ndarray, np.ndarray, np.ndarray]
"""Of one body: names of features and outputs; length-scales `(outputs, features)`, in standard deviations of the
feature; which of them are at their lower bound; which at their upper one."""


def lengthscale_table(bodies: Mapping[str, Learned], path: str | Path, run: str) -> list[Path]:
    """Write the learned length-scales as `<path>.csv` (a row each) and `<path>.md` (a table a body); return the files.

    Both name the run: each row of the first, the head of the second.

    Raises OSError where they cannot be written.
    """
    rows = [("body", "output", "feature", "lengthscale_in_std", "at_bound", "run")]
    pages = [
        "# Learned length-scales\n\n"
        "In standard deviations of the feature over the data: where it is far above 1, the output shows no dependence\n"
        f"on that feature. `>` marks one at its upper bound, `<` one at its lower bound. Of the run {run}.\n"
    ]
    for body, (features, outputs, lengthscales, at_lower, at_upper) in bodies.items():
        marks = np.where(at_upper, "upper", np.where(at_lower, "lower", ""))
        for i, output in enumerate(outputs):
            for j, feature in enumerate(features):
                rows.append((body, output, feature, f"{lengthscales[i, j]:.6g}", marks[i, j], run))
        pages.append(_page(body, features, outputs, lengthscales, marks))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    files = [Path(f"{path}.csv"), Path(f"{path}.md")]
    for file, content in zip(files, (text.getvalue(), "\n".join(pages)), strict=True):
        disk.write(file, content.encode())
    return files


def _page(
    body: str, features: Sequence[str], outputs: Sequence[str], lengthscales: np.ndarray, marks: np.ndarray
) -> str:
    """One body's table, features by row: the columns are then few."""
    sign = {"upper": "> ", "lower": "< ", "": ""}
    lines = [f"## {body}\n", f"| feature | {' | '.join(outputs)} |", "|---|" + "---:|" * len(outputs)]
    for j, feature in enumerate(features):
        cells = [f"{sign[marks[i, j]]}{lengthscales[i, j]:.3g}" for i in range(len(outputs))]
        name = feature.replace("|", r"\|")  # a bar would end the cell
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
