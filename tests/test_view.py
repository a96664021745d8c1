"""The figures: what is drawn is what was logged, every axis has its unit, and nothing is hidden or cut off."""

import csv
import itertools

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from colift import view
from tests import flights

LONG = flights.PAPER._replace(time=400, period=0.05)  # 20 s
CASES = ("C1", "C2", "C3")
RIVALS = ("I", "DOB", "P", "O")
FIGURES = {
    "figure_1_tracking": view.tracking,
    "figure_2_mismatch": view.mismatch,
    "figure_3_deviation": view.deviation,
    "figure_4_forces": view.contact_forces,
    "figure_5_rho_bar": view.rho_bar,
}


@pytest.fixture(scope="module")
def cases():
    """The paper's cases and all rivals, made up."""
    rng = np.random.default_rng(3)
    learned = {"update_times_s": [2.5, 4.5, 6.5, 8.5, 10.0], "T_end_s": 10.0}
    unlearned = {"update_times_s": [], "T_end_s": 10.0}
    found = {
        name: flights.dataset(rng, LONG, case=name, **(learned if name in ("C2", "C3", "P") else unlearned))
        for name in (*CASES, *RIVALS)
    }
    for ds in found.values():
        ds.eta[:] = ds.eta * ((ds.time >= 8) & (ds.time <= 14))
    return found


@pytest.fixture(autouse=True)
def style():
    """What `figures` sets around each of them."""
    with mpl.rc_context(view.STYLE):
        yield


def shown(draw, cases):
    """The cases that `figures` hands to a figure."""
    return cases if draw is view.tracking else {name: cases[name] for name in CASES if name in cases}


def curves(ax, name):
    """The curves that a panel draws in the colour of a case."""
    return [line for line in ax.lines if line.get_color() == (view.LOOKS | view.RIVALS)[name].color]


def stop(ds, ticks):
    """A flight that ended early, with a last tick that is not finite."""
    early = ds.isel(time=slice(ticks), time_sigma=slice(-(-ticks // 5))).copy(deep=True)
    early.e_p[-1], early.lam[-1] = np.nan, np.nan
    early.delta_W[-1] = np.inf
    return early.assign_attrs(complete=0, stopped="signal e_p is not finite")


@pytest.fixture(scope="module")
def folder(cases, tmp_path_factory):
    """A folder of figures, drawn in the style of the library."""
    folder = tmp_path_factory.mktemp("figures")
    with mpl.style.context("default"):
        files = view.figures(cases, folder)
    assert sorted(files) == sorted(folder.iterdir())
    return folder


def test_figures_are_written_as_pdf_and_png(folder):
    assert {file.name for file in folder.iterdir()} == {f"{name}.{kind}" for name in FIGURES for kind in ("pdf", "png")}
    for file in folder.iterdir():
        if file.suffix == ".png":
            with Image.open(file) as image:
                assert image.info["Keywords"] == flights.RUN
                assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
                width = 7.16 if "forces" in file.name or "rho" in file.name else 3.5
                assert image.width == pytest.approx(300 * width, abs=1)
                assert image.convert("L").getextrema() == (0, 255)
        else:
            content = file.read_bytes()
            assert content.startswith(b"%PDF")
            assert flights.RUN.encode() in content
            assert b"/FontFile2" in content  # TrueType
            assert b"/Type3" not in content


def test_the_same_data_give_the_same_bytes_whatever_a_user_has_set(cases, folder, tmp_path):
    with mpl.rc_context({"font.size": 20, "lines.linewidth": 5, "axes.facecolor": "red", "savefig.dpi": 50}):
        before = dict(mpl.rcParams)
        view.figures(cases, tmp_path)
        assert dict(mpl.rcParams) == before
    for file in folder.iterdir():
        assert file.read_bytes() == (tmp_path / file.name).read_bytes(), file.name


@pytest.mark.parametrize("draw", FIGURES.values(), ids=FIGURES)
def test_every_axis_has_a_unit(cases, draw):
    figure = draw(shown(draw, cases))
    for ax in figure.axes:
        grid = ax.get_subplotspec()
        if grid.is_first_col():
            assert ax.get_ylabel().rstrip().endswith(("]", "RMS)"))
            assert "[" in ax.get_ylabel()
        assert (ax.get_xlabel() == "time [s]") == grid.is_last_row()


@pytest.mark.parametrize("draw", FIGURES.values(), ids=FIGURES)
@pytest.mark.parametrize("stopped", [False, True])
def test_nothing_is_cut_off_and_no_legend_hides_a_panel(cases, draw, stopped):
    chosen = dict(shown(draw, cases))
    if stopped:
        chosen |= {"C2": stop(chosen["C2"], 123), "C3": stop(chosen["C3"], 1)}
    figure = draw(chosen)
    figure.draw_without_rendering()
    page = figure.bbox
    for legend in figure.legends:
        box = legend.get_window_extent()
        assert page.x0 <= box.x0
        assert box.x1 <= page.x1
        assert page.y0 <= box.y0
        assert box.y1 <= page.y1
        for ax in figure.axes:
            assert not box.overlaps(ax.get_tightbbox())
    for ax in figure.axes:
        box = ax.get_tightbbox()
        assert page.x0 - 1 <= box.x0 < box.x1 <= page.x1 + 1
        assert page.y0 - 1 <= box.y0 < box.y1 <= page.y1 + 1
        for one, other in itertools.combinations([text.get_window_extent() for text in ax.texts], 2):
            assert not one.overlaps(other)  # the marks t_k


def test_cases_look_the_same_in_every_figure_and_are_told_apart_in_grey(cases):
    for draw in FIGURES.values():
        figure = draw(shown(draw, cases))
        single = draw not in (view.contact_forces, view.rho_bar)  # those have a column for each case
        for ax, name in itertools.product(figure.axes[:2] if single else [], CASES):
            assert len(curves(ax, name)) == 1
    linear = [np.array(to_rgb(view.LOOKS[name].color)) ** 2.2 for name in CASES]
    lightness = sorted(116 * (x @ [0.2126, 0.7152, 0.0722]) ** (1 / 3) - 16 for x in linear)  # CIE L*
    assert np.diff(lightness).min() > 15
    assert lightness[-1] < 80  # still seen on white
    looks = [(look.color, look.dashes) for look in (view.LOOKS | view.RIVALS).values()]
    assert len(set(looks)) == len(looks)


@pytest.mark.parametrize("name", [*CASES, *RIVALS])
def test_figure_1_draws_the_errors_of_every_case(cases, name):
    ds = cases[name]
    top, bottom = view.tracking(cases).axes
    ((line,), (below,)) = curves(top, name), curves(bottom, name)
    np.testing.assert_array_equal(line.get_xdata(), ds.time)
    np.testing.assert_allclose(line.get_ydata(), np.sqrt((ds.e_p**2).sum("axis")), rtol=1e-14)
    np.testing.assert_array_equal(below.get_ydata(), ds.Psi)
    assert {top.get_yscale(), bottom.get_yscale()} == {"log"}


def test_fast_logs_are_thinned_to_a_point_each_10_ms(cases):
    ds = flights.dataset(np.random.default_rng(5), flights.PAPER._replace(time=300))
    (line,) = curves(view.tracking({"C3": ds}).axes[0], "C3")
    np.testing.assert_allclose(np.diff(line.get_xdata()), 0.01)
    np.testing.assert_allclose(line.get_ydata(), np.linalg.norm(ds.e_p, axis=1)[::5], rtol=1e-14)


def test_figure_2_draws_the_rms_of_the_mismatch_over_the_window_that_its_label_states(cases):
    ds = flights.dataset(np.random.default_rng(5), flights.PAPER._replace(time=500))
    figure = view.mismatch({"C3": ds})
    parts = (["F_x", "F_y", "F_z"], ["tau_x", "tau_y", "tau_z"], list(ds.wrench.values))
    for ax, part in zip(figure.axes, parts, strict=True):
        assert f"({view.WINDOW} s RMS)" in ax.get_ylabel()
        (line,) = curves(ax, "C3")
        power = (ds.delta_W.sel(wrench=part) ** 2).sum("wrench").values
        for t, y in list(zip(line.get_xdata(), line.get_ydata(), strict=True))[15:-15:7]:
            near = np.abs(ds.time.values - t + 0.001) < view.WINDOW / 2  # 100 ticks about t
            assert near.sum() == 100
            assert y == pytest.approx(np.sqrt(power[near].mean()), rel=1e-12)


def test_figure_3_draws_sigma_so_that_curves_that_coincide_are_all_seen(cases):
    same = dict.fromkeys(CASES, cases["C1"])
    for ax, sigma in zip(view.deviation(same).axes, ("sigma_L", "sigma_A"), strict=True):
        widths = []
        for name in CASES:
            (line,) = curves(ax, name)
            np.testing.assert_array_equal(line.get_xdata(), cases["C1"].time_sigma)
            np.testing.assert_array_equal(line.get_ydata(), cases["C1"][sigma])
            widths.append((line.get_linewidth(), -line.get_zorder()))
        assert widths == sorted(widths, reverse=True)
        assert np.diff([width for width, _ in widths]).max() < -0.4


def test_figure_4_draws_estimates_and_truth_of_every_contact(cases):
    figure = view.contact_forces({name: cases[name] for name in CASES})
    panels = np.array(figure.axes).reshape(3, 3)
    for (i, agent), (k, name) in itertools.product(enumerate(cases["C1"].agent.values), enumerate(CASES)):
        ds, ax = cases[name], panels[i, k]
        truths = [line.get_ydata() for line in ax.lines if line.get_color() == "black"]
        means = [line.get_ydata() for line in ax.lines if line.get_color() != "black"]
        bands = [band.get_paths()[0].vertices for band in ax.collections]
        own = [contact for contact in ds.contact.values if contact.startswith(f"{agent}/")]
        assert len(truths) == len(means) == len(bands) == len(own) == 2
        for contact, truth, mean, band in zip(own, truths, means, bands, strict=True):
            np.testing.assert_allclose(truth, np.linalg.norm(ds.lam.sel(contact=contact), axis=1), rtol=1e-14)
            estimate = np.linalg.norm(ds.lam_hat.sel(contact=contact), axis=1)
            # four ticks of 50 ms are the window
            np.testing.assert_allclose(mean[2:-2], [estimate[i - 2 : i + 2].mean() for i in range(2, 398)], rtol=1e-12)
            assert band[:, 1].min() == pytest.approx(estimate.min())
            assert band[:, 1].max() == pytest.approx(estimate.max())
    for ax, name in zip(panels[2], CASES, strict=True):
        np.testing.assert_allclose(ax.lines[0].get_ydata(), np.linalg.norm(cases[name].eta, axis=1), rtol=1e-14)
    for ax in panels.flat:
        (window,) = ax.patches
        assert (window.get_x(), window.get_x() + window.get_width()) == pytest.approx((8, 14), abs=1e-9)


def test_figure_5_draws_every_radius_over_the_true_error_of_its_body(cases):
    panels = np.array(view.rho_bar({name: cases[name] for name in CASES}).axes).reshape(4, 3)
    agents = cases["C1"].agent.values
    for k, name in enumerate(CASES):
        ds = cases[name]
        at = np.searchsorted(ds.time, ds.time_sigma)
        load = (ds.f_L - ds.f_L_hat)[at]
        f_x, f_w, f_r = ((ds[f] - ds[f"{f}_hat"])[at] for f in ("f_x", "f_w", "f_r"))
        force, moment = [np.linalg.norm(load[:, :3], axis=1)], [np.linalg.norm(load[:, 3:], axis=1)]
        radii = [ds.rho_bar_L_force], [ds.rho_bar_L_moment]
        for agent in agents:
            joints = [joint for joint in ds.joint.values if joint.startswith(f"{agent}/")]
            force.append(np.linalg.norm(f_x.sel(agent=agent), axis=1))
            squares = (f_w.sel(agent=agent) ** 2).sum("axis") + (f_r.sel(joint=joints) ** 2).sum("joint")
            moment.append(np.sqrt(squares.values))
            radii[0].append(ds.rho_bar_j_force.sel(agent=agent))
            radii[1].append(ds.rho_bar_j_moment.sel(agent=agent))
        bodies = [slice(0, 1), slice(0, 1), slice(1, None), slice(1, None)]
        for ax, of, part in zip(panels[:, k], bodies, (0, 1, 0, 1), strict=True):
            lines = [line for line in ax.lines if line.get_color() != "red"]
            bounds, errors = lines[::2], lines[1::2]
            expected = list(zip(radii[part][of], (force, moment)[part][of], strict=True))
            for bound, error, (radius, true) in zip(bounds, errors, expected, strict=True):
                np.testing.assert_array_equal(bound.get_xdata(), ds.time_sigma)
                np.testing.assert_array_equal(bound.get_ydata(), radius)
                np.testing.assert_allclose(error.get_ydata(), true, rtol=1e-14)
                assert bound.get_linewidth() > 2 * error.get_linewidth()


def test_figure_5_shows_where_there_is_no_radius_and_where_the_error_exceeds_it(cases):
    ds = cases["C3"].copy(deep=True)
    ds.rho_bar_L_force[:] = 1e3
    ds.rho_bar_L_force[10:20] = np.inf
    ds.rho_bar_L_force[30:40] = 1e-9
    ax = view.rho_bar({"C3": ds}).axes[0]
    t = ds.time_sigma.values
    (red,) = [line for line in ax.lines if line.get_color() == "red"]
    np.testing.assert_array_equal(red.get_xdata(), t[30:40])
    (hatched,) = ax.collections
    assert hatched.get_hatch()
    across = hatched.get_paths()[0].vertices[:, 0]
    assert (across.min(), across.max()) == (t[10], t[19])
    assert np.isnan(ax.lines[0].get_ydata()[10:20]).all()
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert legend[2:] == ["no finite radius", "error above radius"]


def test_figure_5_says_what_its_radii_rest_on(cases):
    assert "assumed: norm, energy" in view.rho_bar({"C3": cases["C3"]}).get_suptitle()
    met = cases["C3"].assign_attrs(rho_assumed="")
    assert "all assumptions met" in view.rho_bar({"C3": met}).get_suptitle()


def test_flights_of_one_tick_are_drawn(cases):
    short = {name: stop(cases[name], 1) for name in CASES}
    for draw in FIGURES.values():
        assert draw(short).axes[-1].get_xlim() == (0, 1)


def test_without_internal_forces_no_window_is_shaded(cases):
    silent = cases["C3"].isel(eta_index=slice(0))
    for ax in view.contact_forces({"C3": silent}).axes:
        assert not ax.patches


def test_teams_of_unlike_agents_have_a_row_each():
    ds = flights.dataset(np.random.default_rng(5), flights.MIXED)
    figure = view.contact_forces({"C1": ds, "C3": ds})
    panels = np.array(figure.axes).reshape(-1, 2)
    assert [len(ax.collections) for ax in panels[:, 0]] == [2, 2, 1, 3, 0]


@pytest.mark.parametrize("draw", [view.tracking, view.mismatch, view.deviation])
def test_updates_and_the_end_of_learning_are_marked(cases, draw):
    figure = draw(shown(draw, cases))
    for ax in figure.axes:
        marks = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 2]
        assert sorted(marks) == [2.5, 4.5, 6.5, 8.5, 10.0]
    texts = {text.xy[0]: text.get_text() for text in figure.axes[0].texts}
    assert texts[2.5] == "$t_{1}$"
    assert "t_{5}" in texts[10.0]
    assert "end" in texts[10.0]


def test_a_flight_that_stopped_ends_in_a_cross_at_its_last_finite_value(cases):
    chosen = {"C1": cases["C1"], "C3": stop(cases["C3"], 123)}
    top, _ = view.tracking(chosen).axes
    line, cross = curves(top, "C3")
    assert cross.get_marker() == "x"
    assert cross.get_xdata() == pytest.approx([cases["C3"].time[121].item()])
    assert cross.get_ydata() == pytest.approx([np.linalg.norm(cases["C3"].e_p[121])])
    assert len(line.get_xdata()) == 123
    labels = [text.get_text() for text in top.figure.legends[0].get_texts()]
    assert labels[-1] == "stopped early"
    titles = [ax.get_title() for ax in view.contact_forces(chosen).axes[:2]]
    assert titles == ["C1: no learning", "C3: payload and agents (stopped at 6.1 s)"]


def test_cases_without_a_look_are_refused(cases, tmp_path):
    for wrong in ({"C4": cases["C1"]}, {"O": cases["O"]}, {}):
        with pytest.raises(ValueError, match="C1, C2, C3"):
            view.figures(wrong, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_one_line(cases, tmp_path):
    with pytest.raises(OSError, match=r"cannot write .*figure_1_tracking") as caught:
        view.figures(cases, tmp_path / "missing")
    assert "\n" not in str(caught.value)


def learned(rng, features, outputs):
    """Length-scales of a made-up body, some at their bounds."""
    scales = rng.uniform(0.05, 30, (len(outputs), len(features)))
    at_lower, at_upper = scales < 5, scales > 25
    return features, outputs, scales, at_lower, at_upper


def test_the_table_of_lengthscales_holds_every_number_and_marks_the_bounds(tmp_path):
    rng = np.random.default_rng(11)
    bodies = {
        "payload": learned(rng, ("p_x", "|v|", "omega_z"), ("F_x", "tau_z")),
        "front": learned(rng, ("R_xx", "r_1"), ("F_x", "F_y", "tau_waist")),
    }
    files = view.lengthscale_table(bodies, tmp_path / "lengthscales_C3", flights.RUN)
    assert [file.name for file in files] == ["lengthscales_C3.csv", "lengthscales_C3.md"]
    with files[0].open(newline="") as file:
        rows = {(row["body"], row["output"], row["feature"]): row for row in csv.DictReader(file)}
    assert flights.RUN in files[1].read_text()
    sections = files[1].read_text().split("## ")[1:]
    assert len(rows) == 2 * 3 + 3 * 2
    for (body, (features, outputs, scales, at_lower, at_upper)), section in zip(bodies.items(), sections, strict=True):
        title, _, head, _, *lines = section.strip().splitlines()
        assert title == body
        table = [[cell.strip() for cell in line.replace("\\|", "!").strip("|").split("|")] for line in (head, *lines)]
        assert table[0] == ["feature", *outputs]
        for (i, output), (j, feature) in itertools.product(enumerate(outputs), enumerate(features)):
            row = rows[body, output, feature]
            assert float(row["lengthscale_in_std"]) == pytest.approx(scales[i, j], rel=1e-5)
            assert row["run"] == flights.RUN
            assert row["at_bound"] == ("lower" if at_lower[i, j] else "upper" if at_upper[i, j] else "")
            assert table[j + 1][0] == f"`{feature.replace('|', '!')}`"
            mark = "< " if at_lower[i, j] else "> " if at_upper[i, j] else ""
            assert table[j + 1][i + 1] == f"{mark}{scales[i, j]:.3g}"


def test_shrinkage_is_written_twice_and_whole(tmp_path):
    n, falling = [5.0, 9.0, 17.0], [3e-2, 2e-3, 1e-3]
    parts = {"beta": [2.0, 1.8, 1.7], "sigma": [0.2, 0.02, 0.01]}
    files = view.shrinkage(n, {"bound": falling, "observed": [1e-3] * 3}, [5e-4] * 3, parts, tmp_path / "shrinkage")
    assert [path.name for path in files] == ["shrinkage.pdf", "shrinkage.png"]
    assert all(path.stat().st_size > 5000 for path in files)
