"""Test of the table of length-scales: all numbers are present, and those at a bound are marked."""

import csv
import itertools

import numpy as np
import pytest

from colift.visualization import lengthscale_table
from tests.support import random_logs as flights


def learned(rng, features, outputs):
    """Length-scales of a generated body, some at their bounds."""
    scales = rng.uniform(0.05, 30, (len(outputs), len(features)))
    at_lower, at_upper = scales < 5, scales > 25
    return features, outputs, scales, at_lower, at_upper


def test_table_has_all_numbers_and_marks_bounds(tmp_path):
    """The table contains every length-scale and marks the bounds."""
    rng = np.random.default_rng(11)
    bodies = {
        "payload": learned(rng, ("p_x", "|v|", "omega_z"), ("F_x", "tau_z")),
        "front": learned(rng, ("R_xx", "r_1"), ("F_x", "F_y", "tau_waist")),
    }
    files = lengthscale_table.write_lengthscale_table(bodies, tmp_path / "lengthscales_C3", flights.RUN)
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
