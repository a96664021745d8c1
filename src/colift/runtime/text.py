"""Values from files as text in messages."""

from __future__ import annotations


def is_encodable(text: str) -> bool:
    """Return whether a text has no lone surrogates, which no file can contain.

    Args:
        text: Text.
    """
    return not any("\ud800" <= character <= "\udfff" for character in text)


def shorten(value: object, limit: int) -> str:
    """Return the representation of a value in one line of limited length.

    Args:
        value: Value.
        limit: Largest number of characters before an ellipsis.
    """
    if isinstance(value, int) and value.bit_length() > 4 * limit:  # Python does not convert huge numbers
        return f"a whole number of {value.bit_length()} bits"
    line = " ".join(repr(value).split())
    return line if len(line) <= limit else f"{line[:limit]}..."
