"""A mistake: where it is in the data, and what is said of it."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any

Place = tuple[int | str, ...]
Mistake = tuple[Place, str]

LONGEST = 60  # characters of a value that a message repeats
LISTED = 30  # names that a message lists


class ScenarioError(ValueError):
    """A scenario that cannot be used; the message is for a person, one line a mistake."""


def among(name: Any, known: Iterable[str], what: str) -> str:
    """`is not WHAT (a, b); did you mean a?`"""
    known = list(known)
    listed = ", ".join(known[:LISTED]) + f", and {len(known) - LISTED} more" * (len(known) > LISTED)
    return f"{shown(name)} is not {what} ({listed or 'there are none'}){closest(name, known)}"


def closest(name: Any, known: Iterable[str]) -> str:
    """`; did you mean 'a'?`, or nothing where no known name is close."""
    given = str(name) if isinstance(name, str) else ""
    close = difflib.get_close_matches(given, known, n=1, cutoff=0.5) if len(given) <= LONGEST else []
    return f"; did you mean {close[0]!r}?" if close else ""


def shown(given: Any) -> str:
    """A value in a message: a list or section by its size, all else as it is written, cut where it is long."""
    if isinstance(given, list | tuple):
        return f"{len(given)} value{'s' * (len(given) != 1)}"
    if isinstance(given, dict):
        return "settings by name"
    if given is None:
        return "nothing"
    if isinstance(given, float) and not math.isfinite(given):
        return str(given)
    if isinstance(given, int) and given.bit_length() > 4 * LONGEST:
        return f"a whole number of {given.bit_length()} bits"
    said = repr(given)
    return said if len(said) <= LONGEST else f"{said[:LONGEST]}..."
