"""Tests of figures 3 and 5: every standard deviation and every bound is drawn with its true error."""

import numpy as np
import pytest

from colift.closed_loop import log
from colift.visualization import uncertainty_figures
from tests.support import random_logs as flights
from tests.support.study_logs import CASES, TOLD

pytestmark = pytest.mark.usefixtures("style")


def error_norms(ds, names):
    """Return norms over force and moment of the payload's signals and of f_x, f_w and f_r of the agents."""
    load, f_x, f_w, f_r = names
    found = [[np.linalg.norm(load[:, :3], axis=1)], [np.linalg.norm(load[:, 3:], axis=1)], [], []]
    for agent in ds.agent.values:
        joints = [joint for joint in f_r.joint.values if joint.startswith(f"{agent}/")]
        found[2].append(np.linalg.norm(f_x.sel(agent=agent), axis=1))
        found[3].append(
            np.sqrt(((f_w.sel(agent=agent) ** 2).sum("axis") + (f_r.sel(joint=joints) ** 2).sum("joint")).values)
        )
    return found


def errors(ds):
    at = np.searchsorted(ds.time, ds.time_sigma)
    pairs = [(ds[f], ds[f"{f}_hat"]) for f in ("f_x", "f_w")]
    pairs.insert(0, (log.stack_parts(ds, "f_L"), log.stack_parts(ds, "f_L_hat")))
    pairs.append((log.all_joints(ds, "f_r"), log.all_joints(ds, "f_r_hat")))
    return error_norms(ds, [(exact - predicted)[at] for exact, predicted in pairs])


def test_figure_3_draws_errors_and_std(cases):
    """Figure 3 draws every error with its standard deviation, for forces and moments separately."""
    figure = uncertainty_figures.plot_predictive_std({name: cases[name] for name in CASES}, TOLD)
    panels = np.array(figure.axes).reshape(4, 3)
    assert [ax.get_ylabel().split("[")[1] for ax in panels[:, 0]] == ["N]", "N m]", "N]", "N m]"]
    for k, name in enumerate(CASES):
        ds = cases[name]
        torque = np.hypot(ds.sigma_f_w, ds.label_bias_std_f_w)
        joint = np.hypot(log.all_joints(ds, "sigma_f_r"), log.all_joints(ds, "label_bias_std_f_r"))
        payload = log.stack_parts(ds, "predictive_std_f_L")
        sigmas, true = error_norms(ds, [payload, ds.predictive_std_f_x, torque, joint]), errors(ds)
        for ax, sigma, error in zip(panels[:, k], sigmas, true, strict=True):
            assert len(ax.lines) == 2 * len(sigma)
            for n, (expected, flown) in enumerate(zip(sigma, error, strict=True)):
                deviation, drawn = ax.lines[2 * n : 2 * n + 2]
                np.testing.assert_allclose(deviation.get_ydata(), expected, rtol=1e-14)
                np.testing.assert_allclose(drawn.get_ydata(), flown, rtol=1e-7)  # a window is one point here
                assert deviation.get_linewidth() > 2 * drawn.get_linewidth()
                assert deviation.get_linestyle() == drawn.get_linestyle()
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend[2:] == list(cases["C1"].agent.values)


def test_figure_3_draws_the_rms_error(cases):
    """Figure 3 draws the RMS of the error over the window that its legend states."""
    ds = flights.dataset(np.random.default_rng(5), flights.PAPER._replace(time=500))  # radii each 10 ms
    line = uncertainty_figures.plot_predictive_std({"C3": ds}, TOLD).axes[0].lines[1]
    (error,) = errors(ds)[0]
    for i in range(15, 85, 7):
        assert line.get_ydata()[i] == pytest.approx(np.sqrt((error[i - 10 : i + 10] ** 2).mean()), rel=1e-12)


def test_figure_5_draws_bounds_and_true_errors(cases):
    """Figure 5 draws every bound with the true error of its body."""
    panels = np.array(uncertainty_figures.plot_error_radius({name: cases[name] for name in CASES}, TOLD).axes).reshape(
        4, 3
    )
    for k, name in enumerate(CASES):
        ds = cases[name]
        payload = [[ds.rho_bar_L_force.values], [ds.rho_bar_L_moment.values]]
        agents = [list(radius.values.T) for radius in (ds.rho_bar_j_force, ds.rho_bar_j_moment)]
        for ax, radii, true in zip(panels[:, k], payload + agents, errors(ds), strict=True):
            lines = [line for line in ax.lines if line.get_color() != "red"]
            bounds, drawn = lines[::2], lines[1::2]
            assert len({line.get_linestyle() for line in bounds}) == min(len(bounds), 2)
            for bound, error, radius, expected in zip(bounds, drawn, radii, true, strict=True):
                np.testing.assert_array_equal(bound.get_xdata(), ds.time_sigma)
                np.testing.assert_array_equal(bound.get_ydata(), radius)
                np.testing.assert_allclose(error.get_ydata(), expected, rtol=1e-14)
                assert bound.get_linewidth() > 2 * error.get_linewidth()


def test_figure_5_marks_missing_and_exceeded_bounds(cases):
    """Figure 5 marks missing bounds, and errors that exceed their bound."""
    ds = cases["C3"].copy(deep=True)
    ds.rho_bar_L_force[:] = 1e3
    ds.rho_bar_L_force[10:20] = np.inf
    ds.rho_bar_L_force[30:40] = 1e-9
    ax = uncertainty_figures.plot_error_radius({"C3": ds}, TOLD).axes[0]
    t = ds.time_sigma.values
    (red,) = [line for line in ax.lines if line.get_color() == "red"]
    np.testing.assert_array_equal(red.get_xdata(), t[30:40])
    (hatched,) = ax.collections
    assert hatched.get_hatch()
    across = hatched.get_paths()[0].vertices[:, 0]
    assert (across.min(), across.max()) == (t[10], t[19])
    assert np.isnan(ax.lines[0].get_ydata()[10:20]).all()
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert legend[2:] == [*cases["C3"].agent.values, "no finite bound", "error above bound"]


def test_figure_5_names_its_assumptions(cases):
    title = uncertainty_figures.plot_error_radius({"C3": cases["C3"]}, TOLD).get_suptitle()
    assert "assumed: RKHS norm, bounded noise energy" in title
    met = cases["C3"].assign_attrs(bound_assumptions="")
    assert "all assumptions met" in uncertainty_figures.plot_error_radius({"C3": met}, TOLD).get_suptitle()
