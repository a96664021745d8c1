"""Words, numbers and sentences of plain text."""

from __future__ import annotations

import re
from collections.abc import Iterator

PLACEHOLDER = "Xcode"
"""Word that stands for inline code or inline mathematics; it counts as one word."""

_ABBREVIATIONS = frozenset(
    [
        "al",
        "approx",
        "app",
        "cf",
        "ch",
        "dr",
        "e.g",
        "ed",
        "eds",
        "eq",
        "eqs",
        "etc",
        "fig",
        "figs",
        "i.e",
        "incl",
        "max",
        "min",
        "mr",
        "ms",
        "no",
        "nos",
        "p",
        "pp",
        "prop",
        "resp",
        "sec",
        "st",
        "thm",
        "vol",
        "vs",
        "w.r.t",
    ]
)
_SENTENCE_END = re.compile(r"[.!?][\"'”’)\]*_]*(?=\s+[\"'“‘(\[*_]*[A-Za-z0-9`])")
_DATE = r"\d{4}-\d{2}-\d{2}"
_NUMERAL = re.compile(rf"(?<![\w.])(?<![A-Za-z]-)(?:{_DATE}|\d+(?:[.,]\d+)*)(?![dD]\b)")
_NAMES_WITH_NUMBERS = re.compile(r"\b(?:ROS|MAVLink|Python|Apache|BSD|Theorem|Lemma|Assumption) \d+(?!\.?\d)")


def words(text: str) -> list[str]:
    """Split text into words; a word contains at least one letter or digit."""
    return [token for token in text.split() if any(character.isalnum() for character in token)]


def numbers(text: str) -> list[str]:
    """List the numerals of a text.

    A numeral starts with a digit that follows no letter, so `C3`, `PX4` and `CF-1.11` contain none. A decimal number, a
    version such as `0.2.0` and a date such as `2025-01-31` each count once. The parts of a range count separately.
    Names such as "ROS 2" and dimensions such as "3D" do not count.
    """
    return _NUMERAL.findall(_NAMES_WITH_NUMBERS.sub(PLACEHOLDER, text))


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """Split a paragraph into sentences.

    A sentence ends at a period, exclamation mark or question mark before white space and a letter, a digit or code.
    Abbreviations such as "e.g." and "Eq." and single initials do not end a sentence.

    Args:
        text: One paragraph, list item or quotation.

    Yields:
        The offset of the first character in `text`, and the sentence.
    """
    start = 0
    for match in _SENTENCE_END.finditer(text):
        if _is_abbreviation(text[start : match.start()]):
            continue
        yield _stripped(text, start, match.end())
        start = match.end()
    if text[start:].strip():
        yield _stripped(text, start, len(text))


def _is_abbreviation(before: str) -> bool:
    last = before.split()[-1].lstrip("(\"'[*_") if before.split() else ""
    return last.lower() in _ABBREVIATIONS or (len(last) == 1 and last.isalpha() and last.isupper())


def _stripped(text: str, start: int, end: int) -> tuple[int, str]:
    piece = text[start:end]
    return start + len(piece) - len(piece.lstrip()), piece.strip()
