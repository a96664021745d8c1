"""Tables on a terminal: in parts where they are wider, letters by name where they cannot be printed."""

from __future__ import annotations

import math

from rich.console import Console
from rich.table import Column, Table


def cell(value: float | None, scale: float, spec: str) -> str:
    """A number in a table, `none` for what is none or not finite."""
    if value is None or not math.isfinite(value):
        return "none"
    return format(value * scale, spec if abs(value * scale) < 1e5 else ".0e")


ASCII_GREEK = str.maketrans({"Ψ": "Psi", "Δ": "d", "λ": "lam", "σ": "sigma", "ω": "omega"})


def _spelled(text: str, encoding: str) -> str:
    """Greek letters by name where they cannot be printed."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return text.translate(ASCII_GREEK)
    return text


def show(table: Table, lead: int = 1) -> None:
    """Print a table; one wider than the terminal in parts below each other, each with the `lead` first columns."""
    width = Console().width
    parts: list[list[Column]] = []
    for column in table.columns[lead:]:
        if not parts or _width(_part(table, [*table.columns[:lead], *parts[-1], column])) > width:
            parts.append([])
        parts[-1].append(column)
    for k, columns in enumerate(parts):
        part = _part(table, [*table.columns[:lead], *columns])
        part.title = None if k else table.title
        console = Console(width=max(width, _width(part)))
        with console.capture() as shown:  # rich would end the process where the reader has gone
            console.print(part)
        print(shown.get(), end="", flush=True)


def _part(table: Table, columns: list[Column]) -> Table:
    """Some columns of a table, as a table."""
    part = Table(box=table.box, padding=table.padding, pad_edge=table.pad_edge)
    encoding = Console().encoding
    for column in columns:
        part.add_column(_spelled(str(column.header), encoding), justify=column.justify, no_wrap=True)
    for cells in zip(*(column.cells for column in columns), strict=True):
        part.add_row(*cells)
    return part


def _width(table: Table) -> int:
    """How wide a table is where there is room."""
    console = Console(width=10_000)
    return console.measure(table).maximum
