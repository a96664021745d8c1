"""Legal names for names of other formats: an escape sequence replaces each illegal character.

URDF and ROS permit any character in a name, for example `drone/arm`; names of a scenario are a letter or `_`, then
letters, digits, `-` and `_`. A character outside of this set becomes `-`, its code point in hexadecimal, and `-`:
`drone/arm` is `drone-2f-arm`; `-` is replaced as well in such a name. The mapping is reversible, and legal names
without an escape sequence are unchanged.
"""

from __future__ import annotations

import re

from colift.scenario.errors import format_value
from colift.scenario.schema.base import NAME

ESCAPE = re.compile(r"-([0-9a-f]{1,6})-")  # escape sequence of an illegal character
RESERVED = ("base", "payload", "agents")  # names with a meaning of their own in a scenario
MAX_LENGTH = 100  # characters


def legal_name(original: str) -> str:
    """Map a name of another format to a legal name.

    Args:
        original: Name in the other format; not empty.

    Returns:
        Legal name; the same one if the name is legal already.

    Raises:
        ValueError: If the name is empty, or if the result exceeds 100 characters.

    Example:
        >>> legal_name("drone/arm"), legal_name("1st"), legal_name("elbow")
        ('drone-2f-arm', '_-31-st', 'elbow')
    """
    if not original:
        raise ValueError("a name must not be empty")
    if re.fullmatch(NAME, original) and original not in RESERVED and not ESCAPE.search(original):
        pieces = [original]
    else:
        pieces = [c if re.fullmatch(r"[A-Za-z0-9_]", c) else _escaped(c) for c in original]
        first_is_legal = re.fullmatch(r"[A-Za-z_]", original[0]) and original not in RESERVED
        if not first_is_legal or (original[0] == "_" and pieces[1].startswith("-")):  # see the mark below
            pieces[0] = _escaped(original[0])
    name = "".join(pieces)
    name = f"_{name}" if name.startswith("-") else name  # a mark, because no legal name starts with `-`
    if len(name) > MAX_LENGTH or not re.fullmatch(NAME, name):
        raise ValueError(
            f"name {format_value(original)} needs more than {MAX_LENGTH} characters: rename it in the file"
        )
    return name


def _escaped(character: str) -> str:
    """Return the escape sequence of a character."""
    return f"-{ord(character):x}-"


def original_name(legal: str) -> str:
    """Return the name that `legal_name` maps to a legal name.

    Args:
        legal: Legal name.

    Returns:
        Name in the other format.

    Example:
        >>> original_name("drone-2f-arm")
        'drone/arm'
    """
    text = legal[1:] if legal.startswith("_-") and ESCAPE.match(legal, 1) else legal
    return ESCAPE.sub(lambda found: chr(int(found[1], 16)) if int(found[1], 16) <= 0x10FFFF else found[0], text)


def find_name(name: str, originals: list[str]) -> str | None:
    """Find a name by its original or by its legal form.

    Args:
        name: Name to find.
        originals: Names of the other format.

    Returns:
        The original name; None if there is none.
    """
    if name in originals:
        return name
    return next((original for original in originals if original and _mapped(original) == name), None)


def _mapped(name: str) -> str | None:
    """Return the legal form of a name, or None if it has none."""
    try:
        return legal_name(name)
    except ValueError:
        return None
