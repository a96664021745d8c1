"""Readers of the two word lists beside this module."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_FOLDER = Path(__file__).parent
_KINDS = ("module", "class", "function", "field", "parameter", "constant")
_NAME_ENTRY = re.compile(r"(?:(?P<kinds>[a-z,]+):)?(?P<whole>=?)(?P<word>[A-Za-z_][A-Za-z0-9_]*)")
_NAME_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


@dataclass(frozen=True)
class BannedName:
    """One entry of `banned_names.txt`; its header documents the format.

    Attributes:
        word: The identifier, or one word of it in lower case.
        whole: Whether the entire identifier must be equal to `word`.
        kinds: Kinds of identifiers to which the entry applies.
        suggestion: Replacement.
    """

    word: str
    whole: bool
    kinds: frozenset[str]
    suggestion: str

    def matches(self, kind: str, name: str) -> bool:
        """Return whether an identifier of a kind is covered."""
        return kind in self.kinds and (name == self.word if self.whole else self.word in name_words(name))


@dataclass(frozen=True)
class BannedWord:
    """One entry of `banned_words.txt`.

    Attributes:
        pattern: Regular expression of the words, with their boundaries.
        suggestion: Replacement.
    """

    pattern: re.Pattern[str]
    suggestion: str


@cache
def name_words(name: str) -> frozenset[str]:
    """Split an identifier at underscores and changes of case.

    Example:
        >>> sorted(name_words("ResidualModel_of"))
        ['model', 'of', 'residual']
    """
    return frozenset(word.lower() for word in _NAME_WORD.findall(name))


@cache
def banned_names() -> tuple[BannedName, ...]:
    """Read `banned_names.txt`.

    Raises:
        ValueError: If a line does not have the documented form.
    """
    entries = []
    for place, entry, suggestion in _entries(_FOLDER / "banned_names.txt"):
        match = _NAME_ENTRY.fullmatch(entry)
        kinds = match["kinds"].split(",") if match and match["kinds"] else list(_KINDS)
        if not match or not set(kinds) <= set(_KINDS):
            raise ValueError(f"{place}: expected [KIND[,KIND]:][=]NAME -> SUGGESTION; kinds are {', '.join(_KINDS)}")
        word = match["word"] if match["whole"] else match["word"].lower()
        entries.append(BannedName(word, bool(match["whole"]), frozenset(kinds), suggestion))
    return tuple(entries)


@cache
def banned_words() -> tuple[BannedWord, ...]:
    """Read `banned_words.txt`.

    Raises:
        ValueError: If a line does not have the documented form.
    """
    entries = []
    for place, entry, suggestion in _entries(_FOLDER / "banned_words.txt"):
        words = entry.replace(" ", r"\s+")
        try:
            pattern = re.compile(rf"(?<![\w-])(?:{words})(?![\w-])", re.IGNORECASE)
        except re.error as error:
            raise ValueError(f"{place}: not a regular expression: {error}") from None
        entries.append(BannedWord(pattern, suggestion))
    return tuple(entries)


def _entries(path: Path) -> Iterator[tuple[str, str, str]]:
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if line.strip() and not line.startswith("#"):
            entry, arrow, suggestion = line.partition(" -> ")
            if not arrow or not suggestion.strip():
                raise ValueError(f"{path.name}:{number}: expected ENTRY -> SUGGESTION")
            yield f"{path.name}:{number}", entry.strip(), suggestion.strip()
