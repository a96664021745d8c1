"""The table of learned length-scales: which features matter to which output."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from colift.runtime import atomic_write

BodyLengthscales = tuple[Sequence[str], Sequence[str], np.ndarray, np.ndarray, np.ndarray]
"""Of one body: names of features and outputs; length-scales `(outputs, features)`, in standard deviations of the
feature; which of them are at their lower bound; which at their upper one."""


def write_lengthscale_table(bodies: Mapping[str, BodyLengthscales], path: str | Path, run: str) -> list[Path]:
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
        atomic_write.write_atomic(file, content.encode())
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
