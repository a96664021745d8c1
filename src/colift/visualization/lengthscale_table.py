"""Table of learned length-scales, which indicate the relevance of each feature for each output."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from colift.runtime import atomic_write

BodyLengthscales = tuple[Sequence[str], Sequence[str], np.ndarray, np.ndarray, np.ndarray]
"""Length-scales of one body: names of features and outputs, then three arrays of outputs by features.

The arrays are the length-scales in standard deviations of the feature, and the masks of values at their lower and upper
bound.
"""


def write_lengthscale_table(bodies: Mapping[str, BodyLengthscales], path: str | Path, run: str) -> list[Path]:
    """Write the learned length-scales as CSV, one per row, and as Markdown, one table per body.

    Each row of the CSV file and the introduction of the Markdown file contain the run id.
    A file that cannot be written raises `OSError`.

    Args:
        bodies: Length-scales by body name.
        path: Path of the files without suffix.
        run: Run id.

    Returns:
        Paths of the CSV and the Markdown file.
    """
    rows = [("body", "output", "feature", "lengthscale_in_std", "at_bound", "run")]
    pages = [
        "# Learned length-scales\n\n"
        "Length-scales in standard deviations of the feature over the data. Values far above 1 indicate that the\n"
        "output does not depend on the feature. `>` marks a value at its upper bound, `<` one at its lower bound.\n"
        f"Run: {run}.\n"
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
    """Format the table of one body. Features are rows because there are fewer outputs than features."""
    sign = {"upper": "> ", "lower": "< ", "": ""}
    lines = [f"## {body}\n", f"| feature | {' | '.join(outputs)} |", "|---|" + "---:|" * len(outputs)]
    for j, feature in enumerate(features):
        cells = [f"{sign[marks[i, j]]}{lengthscales[i, j]:.3g}" for i in range(len(outputs))]
        name = feature.replace("|", r"\|")  # an unescaped bar ends the cell
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
