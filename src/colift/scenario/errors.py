"""Errors of scenarios: location in the data and message."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any

Location = tuple[int | str, ...]
ErrorMessage = tuple[Location, str]

MAX_VALUE_LENGTH = 60  # characters of a value that a message repeats
MAX_LISTED_NAMES = 30  # names that a message lists


class ScenarioError(ValueError):
    """Scenario that cannot be used; the message contains one line per error."""


def unknown_name_message(name: Any, allowed: Iterable[str], kind: str) -> str:
    """Return the message `NAME is not WHAT (a, b); did you mean a?`."""
    allowed = list(allowed)
    listed = ", ".join(allowed[:MAX_LISTED_NAMES]) + f", and {len(allowed) - MAX_LISTED_NAMES} more" * (
        len(allowed) > MAX_LISTED_NAMES
    )
    return f"{format_value(name)} is not {kind} ({listed or 'there are none'}){suggestion(name, allowed)}"


def suggestion(name: Any, allowed: Iterable[str]) -> str:
    """Return `; did you mean 'a'?`, or an empty text if no allowed name is similar."""
    text = str(name) if isinstance(name, str) else ""
    close = difflib.get_close_matches(text, allowed, n=1, cutoff=0.5) if len(text) <= MAX_VALUE_LENGTH else []
    return f"; did you mean {close[0]!r}?" if close else ""


def format_value(value: Any) -> str:
    """Format a value for a message: a list by its size, any other value as written, shortened."""
    if isinstance(value, list | tuple):
        return f"{len(value)} value{'s' * (len(value) != 1)}"
    if isinstance(value, dict):
        return "settings by name"
    if value is None:
        return "nothing"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, int) and value.bit_length() > 4 * MAX_VALUE_LENGTH:
        return f"a whole number of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= MAX_VALUE_LENGTH else f"{text[:MAX_VALUE_LENGTH]}..."
