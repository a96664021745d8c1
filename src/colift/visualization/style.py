"""How figures look: one colour, dash pattern and mark a case, one style, one way to a file.

No state of a user's matplotlib is touched.
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

COLUMN, PAGE = 3.5, 7.16  # in, width of one column of the journal, and of two

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
    "pdf.fonttype": 42,  # TrueType: text stays text, as journals ask
    "ps.fonttype": 42,
}

Dashes = Literal["-"] | tuple[int, tuple[int | float, ...]]
Color = tuple[float, float, float]


class LineStyle(NamedTuple):
    """How a case is drawn in every figure: told apart by any colour vision, and in black and white."""

    color: str
    dashes: Dashes
    marker: str
    is_baseline: bool = False  # of learning: shown where cases are compared, not where one is looked into


LONG: Dashes = (0, (5, 1.5))
SHORT: Dashes = (0, (2.5, 1))
DOTS: Dashes = (0, (1, 1.2))
MIXED: Dashes = (0, (5, 1.2, 1, 1.2))

# Paul Tol's schemes: high contrast for the paper's cases, whose lightness differs too; bright and muted for others
LINE_STYLES = {
    "C1": LineStyle("#DDAA33", "-", "s"),
    "C2": LineStyle("#BB5566", LONG, "o"),
    "C3": LineStyle("#004488", "-", "^"),
    "C4": LineStyle("#000000", MIXED, "D"),
    "I": LineStyle("#117733", SHORT, "v", is_baseline=True),
    "DOB": LineStyle("#33BBEE", LONG, "<", is_baseline=True),
    "P": LineStyle("#AA4499", MIXED, ">", is_baseline=True),
    "O": LineStyle("#777777", DOTS, "p", is_baseline=True),
    "F": LineStyle("#EE7733", DOTS, "P", is_baseline=True),
    "R": LineStyle("#44AA99", MIXED, "X", is_baseline=True),
    "H": LineStyle("#882255", LONG, "h", is_baseline=True),
}
FALLBACK_STYLES = (  # of which a case without a look of its own has one, the same in every figure
    LineStyle("#999933", LONG, "*"),
    LineStyle("#6699CC", SHORT, "d"),
    LineStyle("#661100", MIXED, "8"),
    LineStyle("#0077BB", DOTS, "H"),
)
AGENTS = ("#228833", "#AA3377", "#997700", "#0099BB", "#774411", "#555555")
DASH_PATTERNS: tuple[Dashes, ...] = (
    "-",
    LONG,
    DOTS,
    MIXED,
    SHORT,
    (0, (8, 1.5, 1, 1.5, 1, 1.5)),
)  # of one body's parts


def style_of(case: str) -> LineStyle:
    """The look of a case."""
    return LINE_STYLES.get(case) or FALLBACK_STYLES[zlib.crc32(case.encode()) % len(FALLBACK_STYLES)]


def tint(color: str, k: int, n: int) -> Color:
    """The k-th of n tints of a colour, from itself towards white."""
    white = 0.7 * k / n
    red, green, blue = (white + (1 - white) * c for c in to_rgb(color))
    return red, green, blue


@contextlib.contextmanager
def style_context() -> Generator[None]:
    """Figures in the block look as this module says, whatever a user has set."""
    with matplotlib.style.context(["default", STYLE]):
        yield


def save_figure(figure: Figure, path: Path, run: str | None = None) -> list[Path]:
    """Write a figure as PDF and as PNG (300 dpi) beside each other, each with the run in its metadata; the files.

    Rendered in memory, then written whole or not at all; the same figure gives the same bytes. Raises OSError where
    they cannot be written.
    """
    files = []
    told = {"Keywords": run} if run else {}
    for kind in ("pdf", "png"):
        state = io.BytesIO()
        dateless = {"CreationDate": None} if kind == "pdf" else {}
        figure.savefig(state, format=kind, metadata=told | dateless)
        figure.set_layout_engine("none")  # the first layout holds for both
        files.append(path.with_name(f"{path.name}.{kind}"))
        atomic_write.write_atomic(files[-1], state.getvalue())
    return files
