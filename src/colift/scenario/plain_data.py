"""Entries of plain data, valid or not: settings of a scenario before validation."""

from __future__ import annotations

import math
from typing import Any

MAX_ENTRIES = 100  # entries of a list such as agents, joints, sources; compilation takes minutes for fewer entries


def part(data: Any, *location: int | str) -> Any:
    """Return the value at a location, or None.

    Args:
        data: Plain data.
        location: Keys and indices.
    """
    for key in location:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def items(data: Any, *location: int | str) -> list[Any]:
    """Return the entries of a list; empty if there is none or if it is too long.

    Args:
        data: Plain data.
        location: Keys and indices.
    """
    found = part(data, *location)
    return list(found) if isinstance(found, list | tuple) and len(found) <= MAX_ENTRIES else []


def named(data: Any, *location: int | str) -> dict[str, Any]:
    """Return the entries of a mapping; empty if there is none or if it is too long.

    Args:
        data: Plain data.
        location: Keys and indices.
    """
    found = part(data, *location)
    return found if isinstance(found, dict) and len(found) <= MAX_ENTRIES else {}


def names(entries: list[Any]) -> list[str]:
    """Return the names of entries that have one.

    Args:
        entries: Entries of a list.
    """
    return [name for item in entries if isinstance(name := part(item, "name"), str)]


def number(data: Any, *location: int | str) -> float:
    """Return the number at a location; NaN, for which every comparison is false, if there is no usable number.

    Args:
        data: Plain data.
        location: Keys and indices.
    """
    found = part(data, *location)
    fits = isinstance(found, int | float) and not isinstance(found, bool) and abs(found) <= 1e100
    return float(found) if fits else math.nan
