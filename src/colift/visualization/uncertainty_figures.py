"""Figures 3 and 5: what is said of the unknown forces, and how far off it is, bodies by row, cases by column."""

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

from colift.visualization import axes, style

INFINITE_MARKER: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.6", "hatch": "//////", "linewidth": 0}
EXCEEDED: dict[str, Any] = {"color": "red", "marker": "|", "markersize": 4, "linestyle": "none"}


class FigureRow(NamedTuple):
    """What one row of figures 3 and 5 shows: of which bodies, and what of them."""

    label: str
    unit: str
    of_agents: bool
    moment: bool


PARTS = (
    FigureRow("payload force", "N", of_agents=False, moment=False),
    FigureRow("payload moment", "N m", of_agents=False, moment=True),
    FigureRow("agents' force", "N", of_agents=True, moment=False),
    FigureRow("agents' moment", "N m", of_agents=True, moment=True),
)


def plot_predictive_std(cases: axes.Cases, told: Mapping[str, str]) -> Figure:
    """Figure 3: predictive deviations of `f_L` and `f_j`, and the true errors `|f - f_hat|` that they stand for.

    Force and moment apart. A deviation, `log.predictive`, is the RMS that an error has if it is honest, so errors are
    RMS over a window too; to `|Sigma^(1/2)|` of the posterior it adds what sensors are constantly off as stated.
    """

    def one(ax: Axes, name: str, ds: xr.Dataset, part: FigureRow) -> None:
        expected, errors = _deviations(ds, part), _errors(ds, part)
        for k, (sigma, error) in enumerate(zip(expected, errors, strict=True)):
            color, dashes = axes.body_style(name, k, len(expected))
            ax.plot(ds.time_sigma, sigma, color=color, linestyle=dashes, linewidth=2.0, alpha=0.55)
            window = max(1, round(axes.SMOOTHING_WINDOW / max(axes.sample_period(ds.time_sigma), axes.STEP)))
            ax.plot(
                ds.time_sigma,
                np.sqrt(uniform_filter1d(error**2, window)),
                color=color,
                linestyle=dashes,
                linewidth=0.9,
            )

    handles: list[tuple[Artist, str]] = [
        (Line2D([], [], color=axes.GREY, linewidth=2.0, alpha=0.55), "predictive deviation"),
        (Line2D([], [], color=axes.GREY, linewidth=0.9), rf"error $\|f - \hat f\|$, {axes.SMOOTHING_WINDOW:g} s RMS"),
    ]
    return _by_body(cases, told, one, handles)


def plot_error_radius(cases: axes.Cases, told: Mapping[str, str]) -> Figure:
    """Figure 5: radii `rho_bar_L`, `rho_bar_j` over the true errors `|f - f_hat|`.

    Hatched where a radius is infinite: the data contradict the norm and the label errors that it rests on. A red mark
    on the time axis where an error exceeds its radius.
    """
    seen = {"unbounded": False, "exceeded": False}

    def one(ax: Axes, name: str, ds: xr.Dataset, part: FigureRow) -> None:
        t, radii = ds.time_sigma.values, _radii(ds, part)
        across = ax.get_xaxis_transform()
        for k, (radius, error) in enumerate(zip(radii, _errors(ds, part), strict=True)):
            color, dashes = axes.body_style(name, k, len(radii))
            finite, over = np.isfinite(radius), error > radius
            ax.plot(t, np.where(finite, radius, np.nan), color=color, linestyle=dashes, linewidth=1.6)
            ax.plot(t, error, color=color, linestyle=dashes, linewidth=0.6)
            if not finite.all():
                seen["unbounded"] = True
                ax.fill_between(t, 0, 1, where=~finite, transform=across, **INFINITE_MARKER)
            if over.any():
                seen["exceeded"] = True
                ax.plot(t[over], np.full(over.sum(), 0.02), transform=across, **EXCEEDED)

    handles: list[tuple[Artist, str]] = [
        (Line2D([], [], color=axes.GREY, linewidth=1.6), r"radius $\bar\rho$"),
        (Line2D([], [], color=axes.GREY, linewidth=0.6), r"error $\|f - \hat f\|$"),
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
        "unbounded": (Patch(**INFINITE_MARKER), "no finite radius"),
        "exceeded": (Line2D([], [], **EXCEEDED), "error above radius"),
    }
    return [mark for kind, mark in marks.items() if seen[kind]]


def _by_body(
    cases: axes.Cases,
    told: Mapping[str, str],
    one: Callable[[Axes, str, xr.Dataset, FigureRow], None],
    handles: list[tuple[Artist, str]],
    more: Callable[[], list[tuple[Artist, str]]] = list,
) -> Figure:
    """A figure with a row for each part and a column for each case; below, what lines mean, and which agent has which.

    `more`: what there is to explain beside `handles`, asked once all is drawn.
    """
    figure = Figure(figsize=(style.PAGE * max(1, len(cases) / axes.COLUMNS), 5.4))
    grid = figure.subplots(len(PARTS), len(cases), sharex=True, sharey="row", squeeze=False)
    for column, (name, ds) in zip(grid.T, cases.items(), strict=True):
        for ax, part in zip(column, PARTS, strict=True):
            one(ax, name, ds, part)
        column[0].set_title(axes.title(name, ds, told))
        axes.time_axis(column[-1], cases)
    for row, part in zip(grid, PARTS, strict=True):
        axes.log_scale(row[0])
        row[0].set_ylabel(f"{part.label} [{part.unit}]")
    for ax in grid.flat:
        ax.minorticks_off()  # on twelve panels they take longer to lay out than all else
    figure.align_ylabels(grid[:, 0])
    handles += axes.agent_legend(cases) + more()
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=min(6, len(handles)))
    return figure


def _errors(ds: xr.Dataset, part: FigureRow) -> list[np.ndarray]:
    """`|f - f_hat|` of a part of each of its bodies, at the times of the radii."""
    at = ds.sel(time=ds.time_sigma.values, method="nearest")
    load = (at.f_L - at.f_L_hat).values
    force, torque, joint = ((at[f] - at[f"{f}_hat"]).values for f in ("f_x", "f_w", "f_r"))
    return _norms(ds, part, load, force, torque, joint)


def _deviations(ds: xr.Dataset, part: FigureRow) -> list[np.ndarray]:
    """Norms of the predictive deviations of a part of each of its bodies."""
    moments = (np.hypot(ds[f"sigma_{f}"].values, ds[f"bias_{f}"].values) for f in ("f_w", "f_r"))
    return _norms(ds, part, ds.deviation_f_L.values, ds.deviation_f_x.values, *moments)


def _norms(
    ds: xr.Dataset, part: FigureRow, load: np.ndarray, force: np.ndarray, torque: np.ndarray, joint: np.ndarray
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


def _radii(ds: xr.Dataset, part: FigureRow) -> list[np.ndarray]:
    name = f"rho_bar_{'j' if part.of_agents else 'L'}_{'moment' if part.moment else 'force'}"
    return list(np.atleast_2d(ds[name].values.T))
