"""Tests of figures: they draw the logged values, every axis has its unit, nothing is hidden or cut off."""

import itertools
import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from colift.visualization import axes, contact_force_figures, study_figures, style, uncertainty_figures
from tests.support import random_logs as flights
from tests.support.study_logs import CASES, RIVALS, TOLD

COMPARED = {
    "figure_1_tracking": lambda cases: study_figures.plot_tracking_error(cases, TOLD),
    "figure_2_mismatch": lambda cases: study_figures.plot_wrench_mismatch(cases, TOLD),
}
LOOKED_INTO = {
    "figure_3_deviation": lambda cases: uncertainty_figures.plot_predictive_std(cases, TOLD),
    "figure_4_forces": lambda cases: study_figures.plot_contact_forces(cases, TOLD),
    "figure_5_rho_bar": lambda cases: uncertainty_figures.plot_error_radius(cases, TOLD),
}
FIGURES = COMPARED | LOOKED_INTO


pytestmark = pytest.mark.usefixtures("style")


def cases_of(draw, cases):
    """Return the cases that `write_figures` draws in a figure."""
    return cases if draw in COMPARED.values() else {name: cases[name] for name in CASES if name in cases}


def curves_of(ax, name):
    """Return the curves of an axes object in the color of a case."""
    return [line for line in ax.lines if line.get_color() == style.style_of(name).color]


def terminate(ds, ticks):
    """Return a flight that ended early with a last step that is not finite."""
    early = ds.isel(time=slice(ticks), time_sigma=slice(-(-ticks // 5))).copy(deep=True)
    early.e_p[-1], early.lam[-1] = np.nan, np.nan
    early.delta_W_force[-1] = early.delta_W_moment[-1] = np.inf
    return early.assign_attrs(complete=0, termination_reason="signal e_p is not finite")


@pytest.fixture(scope="module")
def folder(cases, tmp_path_factory):
    """Folder of figures drawn in the style of the library."""
    folder = tmp_path_factory.mktemp("figures")
    with mpl.style.context("default"):
        files = study_figures.write_figures(cases, TOLD, folder)
    assert sorted(files) == sorted(folder.iterdir())
    return folder


def test_figures_are_written_as_pdf_and_png(folder):
    columns = ("figure_1_tracking_column", "figure_2_mismatch_column")
    names = ("figure_0_team", *FIGURES, "figure_8_contact_forces", "figure_9_limits", *columns)
    assert {file.name for file in folder.iterdir()} == {f"{name}.{kind}" for name in names for kind in ("pdf", "png")}
    for file in folder.iterdir():
        if file.suffix == ".png":
            with Image.open(file) as image:
                assert image.info["Keywords"] == flights.RUN
                assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
                width = style.COLUMN_WIDTH if file.stem in columns else style.PAGE_WIDTH
                assert image.width == pytest.approx(300 * width, abs=1)
                assert image.convert("L").getextrema()[1] == 255
                assert image.convert("L").getextrema()[0] < 40
        else:
            content = file.read_bytes()
            assert content.startswith(b"%PDF")
            assert flights.RUN.encode() in content
            assert b"/FontFile2" in content  # TrueType
            assert b"/Type3" not in content


@pytest.mark.long
def test_figures_are_reproducible_for_any_user_style(cases, folder, tmp_path):
    """Equal data give equal bytes, whatever style a user has set."""
    with mpl.rc_context({"font.size": 20, "lines.linewidth": 5, "axes.facecolor": "red", "savefig.dpi": 50}):
        before = dict(mpl.rcParams)
        study_figures.write_figures(cases, TOLD, tmp_path)
        assert dict(mpl.rcParams) == before
    for file in folder.iterdir():
        assert file.read_bytes() == (tmp_path / file.name).read_bytes(), file.name


@pytest.mark.parametrize("draw", FIGURES.values(), ids=FIGURES)
def test_every_axis_has_a_unit(cases, draw):
    figure = draw(cases_of(draw, cases))
    for ax in figure.axes:
        grid = ax.get_subplotspec()
        if grid.is_first_col():
            assert ax.get_ylabel().rstrip().endswith(("]", "RMS)"))
            assert "[" in ax.get_ylabel()
        assert (ax.get_xlabel() == "time [s]") == grid.is_last_row()


@pytest.mark.parametrize("draw", FIGURES.values(), ids=FIGURES)
@pytest.mark.parametrize("stopped", [False, True])
def test_figures_are_complete_and_legends_hide_nothing(cases, draw, stopped):
    chosen = dict(cases_of(draw, cases))
    if stopped:
        chosen |= {"C2": terminate(chosen["C2"], 123), "C3": terminate(chosen["C3"], 1)}
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


def linear(color):
    return np.array(to_rgb(color)) ** 2.2


def test_cases_are_distinguishable_in_grayscale():
    """Cases differ in grayscale and for color-blind readers."""
    looks = list(style.LINE_STYLES.values())
    assert len({each.marker for each in looks}) == len(looks)
    assert len({each.marker for each in (*looks, *style.FALLBACK_STYLES)}) == len(looks) + len(style.FALLBACK_STYLES)
    lightness = sorted(
        116 * (linear(style.style_of(name).color) @ [0.2126, 0.7152, 0.0722]) ** (1 / 3) - 16 for name in CASES
    )
    assert np.diff(lightness).min() > 15  # CIE L*
    assert lightness[-1] < 80  # visible on white
    # Vienot, Brettel, Mollon (1999): color perception without long or middle cones, in linear RGB
    lms = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
    matrices = {
        "L": [[0, 2.02344, -2.52581], [0, 1, 0], [0, 0, 1]],
        "M": [[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]],
    }
    for without in matrices.values():
        seen = {
            each: np.clip(np.linalg.solve(lms, np.array(without) @ lms @ linear(style.LINE_STYLES[each].color)), 0, 1)
            for each in style.LINE_STYLES
        }
        for one, other in itertools.combinations(style.LINE_STYLES, 2):
            apart = np.linalg.norm(seen[one] ** (1 / 2.2) - seen[other] ** (1 / 2.2))
            same_stroke = style.LINE_STYLES[one].dashes == style.LINE_STYLES[other].dashes
            assert apart > (0.15 if same_stroke else 0), (one, other)


def test_user_case_has_one_style():
    """A user-defined case has the same style in every figure."""
    assert style.style_of("mine") == style.style_of("mine")
    assert style.style_of("mine") in style.FALLBACK_STYLES
    assert not style.style_of("mine").is_baseline


def test_page_uses_the_colors_of_the_figures():
    source = (Path(__file__).parents[3] / "playback" / "src" / "look.js").read_text()
    table = dict(re.findall(r'^  (\w+): \["(#\w{6})"', source, re.MULTILINE))
    assert table == {name: each.color.lower() for name, each in style.LINE_STYLES.items()}
    agents = re.search(r"AGENTS = \[(.*?)\n\];", source, re.DOTALL)
    assert agents
    assert re.findall(r'\["(#\w{6})"', agents[1]) == [color.lower() for color in style.AGENT_COLORS]


@pytest.mark.parametrize("name", [*CASES, *RIVALS])
def test_figure_1_draws_the_errors_of_every_case(cases, name):
    ds = cases[name]
    top, bottom = study_figures.plot_tracking_error(cases, TOLD).axes
    ((line,), (below,)) = curves_of(top, name), curves_of(bottom, name)
    np.testing.assert_array_equal(line.get_xdata(), ds.time)
    np.testing.assert_allclose(line.get_ydata(), np.sqrt((ds.e_p**2).sum("axis")), rtol=1e-14)
    np.testing.assert_array_equal(below.get_ydata(), ds.Psi)
    assert {top.get_yscale(), bottom.get_yscale()} == {"log"}


def test_numerical_zeros_do_not_widen_a_log_axis():
    ds = flights.dataset(np.random.default_rng(5), flights.PAPER._replace(time=300))
    ds.Psi[:] = np.where(np.arange(300) % 100 < 50, 1e-21, 1e-3)
    ds.e_p[:] = 1e-2
    ds.e_p[100] = 1e-9  # a zero crossing
    position, attitude = study_figures.plot_tracking_error({"C3": ds}, TOLD).axes
    assert 1e-3 < position.get_ylim()[0] < 1.7e-2 < position.get_ylim()[1]
    assert attitude.get_ylim()[0] == pytest.approx(1e-3 * 10.0**-axes.QUADRATIC_DECADES)
    assert [text.get_text() for text in attitude.texts] == ["below 1e-11: not shown"]
    assert not any("not shown" in text.get_text() for text in position.texts)


def test_fast_logs_are_decimated_to_10_ms(cases):
    ds = flights.dataset(np.random.default_rng(5), flights.PAPER._replace(time=300))
    (line,) = curves_of(study_figures.plot_tracking_error({"C3": ds}, TOLD).axes[0], "C3")
    np.testing.assert_allclose(np.diff(line.get_xdata()), 0.01)
    np.testing.assert_allclose(line.get_ydata(), np.linalg.norm(ds.e_p, axis=1)[::5], rtol=1e-14)


def test_figure_2_draws_the_rms_mismatch(cases):
    """Figure 2 draws the RMS of the mismatch over the window that its label states."""
    ds = flights.dataset(np.random.default_rng(5), flights.PAPER._replace(time=500))
    figure = study_figures.plot_wrench_mismatch({"C3": ds}, TOLD)
    for ax, part in zip(figure.axes, (ds.delta_W_force, ds.delta_W_moment), strict=True):
        assert f"({axes.SMOOTHING_WINDOW} s RMS)" in ax.get_ylabel()
        (line,) = curves_of(ax, "C3")
        power = (part**2).sum("axis").values
        for t, y in list(zip(line.get_xdata(), line.get_ydata(), strict=True))[15:-15:7]:
            near = np.abs(ds.time.values - t + 0.001) < axes.SMOOTHING_WINDOW / 2  # 100 ticks about t
            assert near.sum() == 100
            assert y == pytest.approx(np.sqrt(power[near].mean()), rel=1e-12)


def test_figure_4_draws_estimates_and_truth_of_every_contact(cases):
    figure = LOOKED_INTO["figure_4_forces"]({name: cases[name] for name in CASES})
    panels = np.array(figure.axes).reshape(3, 3)
    for (i, agent), (k, name) in itertools.product(enumerate(cases["C1"].agent.values), enumerate(CASES)):
        ds, ax = cases[name], panels[i, k]
        below = [line for line in ax.lines if line.get_color() == axes.TRUE_VALUE_STYLE["color"]]
        above = [line for line in ax.lines if line.get_color() != axes.TRUE_VALUE_STYLE["color"]]
        assert max(line.get_zorder() for line in below) < min(line.get_zorder() for line in above)
        assert min(line.get_linewidth() for line in below) > 2 * max(line.get_linewidth() for line in above)
        truths, means = [line.get_ydata() for line in below], [line.get_ydata() for line in above]
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


def test_legends_have_no_missing_entries(cases):
    small_errors = cases["C3"].copy(deep=True)
    for name in ("rho_bar_L_force", "rho_bar_L_moment", "rho_bar_j_force", "rho_bar_j_moment"):
        small_errors[name][:] = 1e3
    small_errors.eta[:] = 0
    texts_of_legends = [
        text.get_text()
        for text in uncertainty_figures.plot_error_radius({"C3": small_errors}, TOLD).legends[0].get_texts()
    ]
    assert texts_of_legends[2:] == list(small_errors.agent.values)
    forces = study_figures.plot_contact_forces({"C3": small_errors}, TOLD)
    assert len(forces.axes) == 2  # no row without internal forces
    assert not [text for text in forces.legends[0].get_texts() if "eta" in text.get_text()]


def test_figure_7_draws_corrections_and_change_points(cases, tmp_path):
    """Figure 7 draws label, model, corrected model and interval, the end of labels and change points."""
    rng, ds = np.random.default_rng(4), cases["C3"]
    weight = np.where((ds.time > 5) & (ds.time < 7), 0.0, 1.0)
    attributes = {"update_times_s": [2.5, 4.5], "num_samples_payload": [20, 30], "num_samples_agents": [44, 60]}
    with_labels = ds.assign(
        label_L_force=(ds.p.dims, rng.normal(size=ds.p.shape) * [1, 1, 3]),
        correction_L_force=(ds.p.dims, rng.normal(size=ds.p.shape)),
        correction_std_L_force=(ds.p.dims, rng.uniform(0.1, 1, size=ds.p.shape)),
        model_prediction_L_force=(ds.p.dims, rng.normal(size=ds.p.shape)),
        correction_x=(ds.f_x.dims, rng.normal(size=ds.f_x.shape)),
        correction_weight_x=(ds.f_x.dims, weight[:, None, None] * np.array([1, 0.8, 0.9]) * np.ones(ds.f_x.shape)),
    ).assign_attrs(**attributes, change_points="2.5 s: payload; 4.5 s: payload, front")
    figure = study_figures.plot_online_correction({"C3": with_labels}, TOLD)
    error, payload, agents, used, points = figure.axes
    np.testing.assert_allclose(used.lines[0].get_ydata(), 0.9 * weight, rtol=1e-14)
    assert payload.get_ylabel() == "payload:\nforce z [N]", "the component that varies most"
    label, model, corrected = (line.get_ydata() for line in payload.lines[:3])
    np.testing.assert_array_equal(label, with_labels.label_L_force[:, 2])
    np.testing.assert_array_equal(model, with_labels.model_prediction_L_force[:, 2])
    np.testing.assert_allclose(corrected - model, with_labels.correction_L_force[:, 2], rtol=1e-12)
    band = payload.collections[0].get_paths()[0].vertices[1 : len(corrected) + 1, 1]
    np.testing.assert_allclose(band, corrected - 1.96 * with_labels.correction_std_L_force[:, 2], rtol=1e-12)
    for line, name in zip(agents.lines, with_labels.agent.values, strict=False):
        np.testing.assert_allclose(
            line.get_ydata(), np.linalg.norm(with_labels.correction_x.sel(agent=name), axis=1), rtol=1e-14
        )
    for ax in figure.axes:
        assert [
            line.get_xdata()[0] for line in ax.lines if line.get_color() == study_figures.CHANGE_POINT_STYLE["color"]
        ] == [
            2.5,
            4.5,
        ]
        shaded = ax.collections[-1]
        x = shaded.get_paths()[0].vertices[:, 0]
        assert (x.min(), x.max()) == pytest.approx((5, 7), abs=0.06)
    np.testing.assert_array_equal(points.lines[0].get_ydata(), [0, 20, 30, 30])
    np.testing.assert_array_equal(points.lines[1].get_ydata(), np.array([0, 44, 60, 60]) / ds.sizes["agent"])
    assert error.get_yscale() == "log"
    names = {path.stem for path in study_figures.write_figures({"C3": with_labels, "C1": cases["C1"]}, TOLD, tmp_path)}
    assert "figure_7_reaction" in names
    explained = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {
        "samples, one agent",
        "correction weight below 0.5",
        "change point",
    } <= explained
    small_errors = with_labels.assign(correction_weight_x=with_labels.correction_weight_x * 0 + 1)
    small_errors.attrs |= {
        "change_points": "",
        "num_samples_agents": 2 * np.array(with_labels.attrs["num_samples_payload"]),
    }
    explained = {
        text.get_text()
        for text in study_figures.plot_online_correction({"C3": small_errors}, TOLD).legends[0].get_texts()
    }
    always = {"label", "model", "model and correction", "95 % interval"}
    assert explained == {*small_errors.agent.values, *always}, "legend entry without a curve"


def test_flights_of_one_step_are_drawn(cases):
    short = {name: terminate(cases[name], 1) for name in CASES}
    for draw in FIGURES.values():
        assert draw(short).axes[-1].get_xlim() == (0, 1)


def test_without_internal_forces_no_window_is_shaded(cases):
    without_internal = cases["C3"].isel(eta_index=slice(0))
    for ax in study_figures.plot_contact_forces({"C3": without_internal}, TOLD).axes:
        assert not ax.patches


def test_teams_of_unlike_agents_have_a_row_each():
    ds = flights.dataset(np.random.default_rng(5), flights.MIXED)
    figure = study_figures.plot_contact_forces({"C1": ds, "C3": ds}, TOLD)
    panels = np.array(figure.axes).reshape(-1, 2)
    assert [len(ax.collections) for ax in panels[:, 0]] == [2, 2, 1, 3, 0]  # of each agent, and of eta


@pytest.mark.parametrize("draw", COMPARED.values(), ids=COMPARED)
def test_updates_and_the_end_of_learning_are_marked(cases, draw):
    figure = draw(cases_of(draw, cases))
    for ax in figure.axes:
        marks = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 2]
        assert sorted(marks) == [2.5, 4.5, 6.5, 8.5, 10.0]
    texts = {text.xy[0]: text.get_text() for text in figure.axes[0].texts}
    assert texts[2.5] == "$t_{1}$"
    assert "t_{5}" in texts[10.0]
    assert "end" in texts[10.0]


def test_continued_learning_has_no_end_marker(cases):
    on = cases["C3"].assign_attrs(update_times_s=[2.5, 6.0, 12.0])
    marks = lambda figure: [ln.get_xdata()[0] for ln in figure.axes[0].lines if len(ln.get_xdata()) == 2]  # noqa: E731
    beside = study_figures.plot_tracking_error({"C2": cases["C2"], "adaptive": on}, TOLD)
    assert sorted(marks(beside)) == [2.5, 4.5, 6.5, 8.5, 10.0]
    alone = study_figures.plot_tracking_error({"adaptive": on}, TOLD)
    assert sorted(marks(alone)) == [2.5, 6.0, 12.0]
    assert not alone.axes[0].texts


def test_an_end_of_learning_after_the_flight_is_not_drawn(cases):
    """The label of a time outside of the axis would leave the figure without room for its axes."""
    short = {"C3": cases["C3"].assign_attrs(T_end_s=100.0)}
    figure = study_figures.plot_tracking_error(short, TOLD)
    assert not any("end" in text.get_text() for text in figure.axes[0].texts)
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_terminated_flight_ends_in_a_cross(cases):
    """A terminated flight ends in a cross at its last finite value."""
    chosen = {"C1": cases["C1"], "C3": terminate(cases["C3"], 123)}
    top, _ = study_figures.plot_tracking_error(chosen, TOLD).axes
    line, cross = curves_of(top, "C3")
    assert cross.get_marker() == "x"
    assert cross.get_xdata() == pytest.approx([cases["C3"].time[121].item()])
    assert cross.get_ydata() == pytest.approx([np.linalg.norm(cases["C3"].e_p[121])])
    assert len(line.get_xdata()) == 123
    labels = [text.get_text() for text in top.figure.legends[0].get_texts()]
    assert labels[-1] == "stopped early"
    titles = [ax.get_title() for ax in study_figures.plot_contact_forces(chosen, TOLD).axes[:2]]
    assert titles == ["C1 no learning", "C3 payload and agent learning\n(stopped at 6.1 s)"]


def test_baselines_are_omitted_beside_other_cases(cases, tmp_path, monkeypatch):
    """Baselines are drawn if alone, and omitted beside other cases in figures of single cases."""
    drawn = {}
    plots = {
        "team": "plot_team",
        "tracking": "plot_tracking_error",
        "mismatch": "plot_wrench_mismatch",
        "deviation": "plot_predictive_std",
        "contact_forces": "plot_contact_forces",
        "rho_bar": "plot_error_radius",
        "force_parts": "plot_contact_force_parts",
    }
    for name, function in plots.items():
        modules = (study_figures, uncertainty_figures, contact_force_figures)
        where = next(module for module in modules if hasattr(module, function))
        monkeypatch.setattr(
            where, function, lambda cases, *_, name=name, **_k: drawn.update({name: list(cases)}) or Figure()
        )
    monkeypatch.setattr(study_figures, "save_figure", lambda *_: [])
    study_figures.write_figures({"true_residual": cases["true_residual"]}, TOLD, tmp_path)
    assert set(map(tuple, drawn.values())) == {("true_residual",)}
    study_figures.write_figures(
        {"C1": cases["C1"], "true_residual": cases["true_residual"], "mine": cases["C3"]}, TOLD, tmp_path
    )
    assert {name: len(names) for name, names in drawn.items() if name in ("team", "tracking", "mismatch")} == {
        "team": 3,
        "tracking": 3,
        "mismatch": 3,
    }
    assert {tuple(drawn[name]) for name in ("deviation", "contact_forces", "rho_bar", "force_parts")} == {
        ("C1", "mine")
    }
    with pytest.raises(ValueError, match="no cases"):
        study_figures.write_figures({}, TOLD, tmp_path)


def test_the_team_is_drawn_with_its_names(cases):
    near, far = study_figures.plot_team(cases).axes
    assert [text.get_text() for text in near.texts] == ["front", "rear", "left", "right", "left", "right"]
    assert not far.texts
    key = [text.get_text() for text in study_figures.plot_team(cases).legends[0].get_texts()]
    assert [text.split(",")[0] for text in key[:3]] == ["thrust", "contact force on the payload", "disturbance force"]


def test_unwritable_folder_gives_one_line(cases, tmp_path):
    with pytest.raises(OSError, match=r"cannot write .*figure_0_team") as caught:
        study_figures.write_figures(cases, TOLD, tmp_path / "missing")
    assert "\n" not in str(caught.value)
