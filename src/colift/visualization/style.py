"""Matplotlib style of all figures, line styles and labels of the cases, and output of figures to files.

The module does not change the matplotlib settings of the user: `style_context` restores them.
"""

from __future__ import annotations

import contextlib
import io
import zlib
from collections.abc import Generator
from pathlib import Path
from typing import Literal, NamedTuple

import matplotlib.style
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from colift.runtime import atomic_write

COLUMN_WIDTH, PAGE_WIDTH = 3.5, 7.16  # in, width of one and of two columns of the journal

NOTEBOOK_DPI = 110

STYLE = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
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
    "lines.markersize": 3.5,
    "lines.solid_joinstyle": "round",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.4,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "legend.columnspacing": 1.2,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # TrueType, as journals require: text remains text
    "ps.fonttype": 42,
}

Dashes = Literal["-"] | tuple[int, tuple[int | float, ...]]
Color = tuple[float, float, float]


class LineStyle(NamedTuple):
    """Line style of a case in all figures.

    Any two styles differ for all kinds of color vision and in black and white.

    Attributes:
        color: Color as a hexadecimal string.
        dashes: Dash pattern, in the form that matplotlib's `linestyle` accepts.
        marker: Matplotlib marker.
        is_baseline: True for a baseline. Baselines appear in comparisons, not in figures with one column per case.
    """

    color: str
    dashes: Dashes
    marker: str
    is_baseline: bool = False


LONG_DASHES: Dashes = (0, (5, 1.5))
SHORT_DASHES: Dashes = (0, (2.5, 1))
DOTS: Dashes = (0, (1, 1.2))
DASH_DOT: Dashes = (0, (5, 1.2, 1, 1.2))

# Color schemes of Paul Tol: high contrast for the cases of the paper, which also differ in lightness; bright and muted
# for the others.
LINE_STYLES = {
    "C1": LineStyle("#DDAA33", "-", "s"),
    "C2": LineStyle("#BB5566", LONG_DASHES, "o"),
    "C3": LineStyle("#004488", "-", "^"),
    "adaptive": LineStyle("#000000", DASH_DOT, "D"),
    "integral": LineStyle("#117733", SHORT_DASHES, "v", is_baseline=True),
    "disturbance_observer": LineStyle("#33BBEE", LONG_DASHES, "<", is_baseline=True),
    "parametric": LineStyle("#AA4499", DASH_DOT, ">", is_baseline=True),
    "true_residual": LineStyle("#777777", DOTS, "p", is_baseline=True),
    "label_feedback": LineStyle("#EE7733", DOTS, "P", is_baseline=True),
    "regression": LineStyle("#44AA99", DASH_DOT, "X", is_baseline=True),
    "gp_label_feedback": LineStyle("#882255", LONG_DASHES, "h", is_baseline=True),
}
CASE_LABELS = {
    "C1": "C1 no learning",
    "C2": "C2 payload learning",
    "C3": "C3 payload and agent learning",
    "adaptive": "adaptive",
    "integral": "integral action",
    "disturbance_observer": "disturbance observer",
    "parametric": "parametric",
    "regression": "regression",
    "label_feedback": "label feedback",
    "gp_label_feedback": "GP with label feedback",
    "true_residual": "true residual",
}
"""Label of each case in legends and titles."""
FALLBACK_STYLES = (  # for cases without an entry in LINE_STYLES; a case has the same style in all figures
    LineStyle("#999933", LONG_DASHES, "*"),
    LineStyle("#6699CC", SHORT_DASHES, "d"),
    LineStyle("#661100", DASH_DOT, "8"),
    LineStyle("#0077BB", DOTS, "H"),
)
AGENT_COLORS = ("#7755AA", "#997700", "#774411", "#5588AA", "#AA7799", "#555555")
DASH_PATTERNS: tuple[Dashes, ...] = (
    "-",
    LONG_DASHES,
    DOTS,
    DASH_DOT,
    SHORT_DASHES,
    (0, (8, 1.5, 1, 1.5, 1, 1.5)),
)  # for the parts of one body


class NotebookFigure(Figure):
    """Figure that a notebook shows as the value of a cell; `pyplot` is not required."""

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=NOTEBOOK_DPI)
        return buffer.getvalue()


def style_of(case: str) -> LineStyle:
    """Return the line style of a case; a case without an entry in `LINE_STYLES` obtains a fixed fallback style.

    Args:
        case: Case id.

    Returns:
        The line style.
    """
    return LINE_STYLES.get(case) or FALLBACK_STYLES[zlib.crc32(case.encode()) % len(FALLBACK_STYLES)]


def tint(color: str, k: int, n: int) -> Color:
    """Return the k-th of n tints of a color.

    Args:
        color: Color in any form that matplotlib accepts.
        k: Index of the tint; 0 is the color itself, higher indices are closer to white.
        n: Number of tints.

    Returns:
        Red, green and blue in [0, 1].
    """
    white = 0.7 * k / n
    red, green, blue = (white + (1 - white) * c for c in to_rgb(color))
    return red, green, blue


@contextlib.contextmanager
def style_context() -> Generator[None]:
    """Apply the style of this module within a `with` block, independent of the user's matplotlib settings.

    Yields:
        Nothing. The settings of the user are restored at the end of the block.
    """
    with matplotlib.style.context(["default", STYLE]):
        yield


def save_figure(figure: Figure, path: Path, run: str | None = None) -> list[Path]:
    """Write a figure as PDF and as PNG (300 dpi).

    The figure is rendered in memory, then written atomically. Equal figures give equal bytes. A file that
    cannot be written raises `OSError`.

    Args:
        figure: Figure to write.
        path: Path of the files without suffix.
        run: Run id for the metadata of both files.

    Returns:
        Paths of the PDF and the PNG file.
    """
    files = []
    keywords = {"Keywords": run} if run else {}
    for suffix in ("pdf", "png"):
        buffer = io.BytesIO()
        date = {"CreationDate": None} if suffix == "pdf" else {}  # a date would change the bytes
        figure.savefig(buffer, format=suffix, metadata=keywords | date)
        figure.set_layout_engine("none")  # the PNG has the layout of the PDF
        files.append(path.with_name(f"{path.name}.{suffix}"))
        atomic_write.write_atomic(files[-1], buffer.getvalue())
    return files
