"""A mistake: where it is in the data, and what is said of it."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any

Place = tuple[int | str, ...]
ErrorMessage = tuple[Place, str]

MAX_VALUE_LENGTH = 60  # characters of a value that a message repeats
MAX_LISTED_NAMES = 30  # names that a message lists


class ScenarioError(ValueError):
    """A scenario that cannot be used; the message is for a person, one line a mistake."""


def unknown_name_message(name: Any, known: Iterable[str], what: str) -> str:
    """`is not WHAT (a, b); did you mean a?`"""
    known = list(known)
    listed = ", ".join(known[:MAX_LISTED_NAMES]) + f", and {len(known) - MAX_LISTED_NAMES} more" * (
        len(known) > MAX_LISTED_NAMES
    )
    return f"{format_value(name)} is not {what} ({listed or 'there are none'}){suggestion(name, known)}"


def suggestion(name: Any, known: Iterable[str]) -> str:
    """`; did you mean 'a'?`, or nothing where no known name is close."""
    given = str(name) if isinstance(name, str) else ""
    close = difflib.get_close_matches(given, known, n=1, cutoff=0.5) if len(given) <= MAX_VALUE_LENGTH else []
    return f"; did you mean {close[0]!r}?" if close else ""


def format_value(given: Any) -> str:
    """A value in a message: a list or section by its size, all else as it is written, cut where it is long."""
    if isinstance(given, list | tuple):
        return f"{len(given)} value{'s' * (len(given) != 1)}"
    if isinstance(given, dict):
        return "settings by name"
    if given is None:
        return "nothing"
    if isinstance(given, float) and not math.isfinite(given):
        return str(given)
    if isinstance(given, int) and given.bit_length() > 4 * MAX_VALUE_LENGTH:
        return f"a whole number of {given.bit_length()} bits"
    said = repr(given)
    return said if len(said) <= MAX_VALUE_LENGTH else f"{said[:MAX_VALUE_LENGTH]}..."
