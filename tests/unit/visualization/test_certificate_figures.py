"""Test of the figure of Corollary 1; test_certification.py tests figure 6."""

from matplotlib.figure import Figure

from colift.visualization import certificate_figures


def test_values_on_a_log_axis_are_points_with_units():
    """A bar starts at zero, which a logarithmic axis does not contain."""
    ax = Figure().add_subplot()
    certificate_figures._plot_conservatism(
        ax, {"energy": 3.2, "recovery": 0.012, "none": float("inf"), "observed": 4e-3}
    )
    assert not ax.patches
    assert [line.get_xdata()[0] for line in ax.lines] == [3200.0, 12.0, 4.0]
    assert [text.get_text() for text in ax.texts] == ["3.2 m", "12 mm", "4 mm"]


def test_shrinkage_figure_is_written_as_pdf_and_png(tmp_path):
    n, falling = [5.0, 9.0, 17.0], [3e-2, 2e-3, 1e-3]
    parts = {"beta": [2.0, 1.8, 1.7], "sigma": [0.2, 0.02, 0.01]}
    files = certificate_figures.plot_bound_vs_data(
        n, {"bound": falling, "observed": [1e-3] * 3}, [5e-4] * 3, parts, tmp_path / "shrinkage"
    )
    assert [path.name for path in files] == ["shrinkage.pdf", "shrinkage.png"]
    assert all(path.stat().st_size > 5000 for path in files)
