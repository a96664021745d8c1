"""Prose of Markdown pages in the MyST dialect: blocks of text without code, mathematics and link targets."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from checks.prose import PLACEHOLDER

_PROSE_DIRECTIVES = frozenset(
    [
        "admonition",
        "attention",
        "caution",
        "danger",
        "definition",
        "dropdown",
        "error",
        "figure",
        "glossary",
        "grid-item-card",
        "hint",
        "important",
        "lemma",
        "note",
        "proof",
        "proposition",
        "remark",
        "seealso",
        "tab-item",
        "theorem",
        "tip",
        "topic",
        "warning",
    ]
)
_FENCE = re.compile(r"^\s*(?:[-*+]\s+|>\s*)*(?P<mark>`{3,}|~{3,}|:{3,})\s*(?P<info>.*)$")
_HEADING = re.compile(r"^ {0,3}(#{1,6})\s+(.*)$")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d{1,3}[.)])\s+")
_TABLE_RULE = re.compile(r"^\s*\|?\s*:?-+:?\s*(?:\|\s*:?-+:?\s*)+\|?\s*$|^\s*\|\s*:?-+:?\s*\|\s*$")
_TARGET = re.compile(r"^\s*\([\w-]+\)=\s*$|^\s*\[[^\]]+\]:\s+\S|^\s*:[\w-]+:(?:\s|$)")
_ALLOW = re.compile(r"<!--\s*checks:\s*allow\s+(.*?)\s*-->", re.DOTALL)
_BIBLIOGRAPHY = re.compile(r"^(?:bibliography|citation|citing.*|literature|references|sources)$", re.IGNORECASE)

_INLINE: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"(?:\{[\w:+.-]+\})?(`+)(?!`).*?(?<!`)\1(?!`)", re.DOTALL), f" {PLACEHOLDER} "),
    (re.compile(r"(?<![\\$\w])\$(?=\S)[^$]*?(?<=\S)\$(?![\w$])"), f" {PLACEHOLDER} "),
    (re.compile(r"!\[[^\]]*\]\([^)]*\)"), " "),
    (re.compile(r"\[!\[[^\]]*\]\([^)]*\)\s*\]\([^)]*\)"), " "),
    (re.compile(r"\[\s*\]\([^)]*\)"), " "),
    (re.compile(r"\[([^\]]*)\]\([^)]*\)"), r"\1"),
    (re.compile(r"\[([^\]]*)\]\[[^\]]*\]"), r"\1"),
    (re.compile(r"\[\^[^\]]*\]"), " "),
    (re.compile(r"<https?://[^>]*>|https?://[^\s)>]+"), f" {PLACEHOLDER} "),
    (re.compile(r"</?[A-Za-z][^>]*>"), " "),
    (re.compile(r"\{[\w-]+\}(?=[`\s])"), " "),
)


class Kind(Enum):
    """Kinds of blocks."""

    PARAGRAPH = "paragraph"
    HEADING = "heading"
    TABLE = "table"
    TERM = "term"


@dataclass(frozen=True)
class Block:
    """One heading, table row, list item or paragraph.

    Attributes:
        kind: Kind of block.
        line: Number of its first line, from 1.
        text: Prose; inline code and mathematics are replaced by a placeholder, line breaks are kept.
        level: Depth of a heading; 0 otherwise.
        in_bibliography: Whether it belongs to a section of references.
        allowed: Words and rules that an exception comment allows here, in lower case.
    """

    kind: Kind
    line: int
    text: str
    level: int = 0
    in_bibliography: bool = False
    allowed: frozenset[str] = frozenset()

    def line_at(self, offset: int) -> int:
        """Return the line number of a character of the text."""
        return self.line + self.text.count("\n", 0, offset)


class Page:
    """A Markdown page.

    An exception is a comment `<!-- checks: allow WORD -->`. It holds for the lines around it up to the next blank line.
    Several words or rules are separated by commas.

    Attributes:
        lines: Lines of the file.
        blocks: Prose in the order of the page.
        exceptions: Number of exception comments.
    """

    def __init__(self, text: str) -> None:
        """Parse the text of a page."""
        self.lines = text.splitlines()
        self.exceptions = len(_ALLOW.findall(text))
        self.blocks = tuple(_blocks(_without_code(self.lines)))

    def prose(self) -> str:
        """Return all prose, headings and tables included, one block per line."""
        return "\n".join(block.text for block in self.blocks)


def clean(text: str) -> str:
    """Replace inline code and mathematics, link targets and tags; the number of line breaks is kept."""
    for pattern, replacement in _INLINE:
        text = pattern.sub(lambda match, r=replacement: _keep_breaks(match, r), text)
    return text


def _keep_breaks(match: re.Match[str], replacement: str) -> str:
    new = match.expand(replacement)
    return new + "\n" * (match.group().count("\n") - new.count("\n"))


def _without_code(lines: list[str]) -> list[str]:
    """Blank front matter, code, display mathematics and directive options; directives with prose stay."""
    kept: list[str] = []
    fences: list[tuple[str, bool]] = []
    in_math = False
    front_matter = bool(lines) and lines[0].strip() == "---"
    for number, line in enumerate(lines):
        if front_matter:
            kept.append("")
            front_matter = number == 0 or line.strip() != "---"
            continue
        in_code = any(code for _, code in fences)
        fence = _FENCE.match(line)
        if fence and _closes(fence, fences):
            fences.pop()
            kept.append("")
        elif in_code:
            kept.append("")
        elif fence:
            name = re.match(r"\{([\w:-]+)\}", fence["info"])
            code = not name or name[1] not in _PROSE_DIRECTIVES
            fences.append((fence["mark"], code))
            title = fence["info"][name.end() :].strip() if name and not code and name[1] != "figure" else ""
            kept.append(f"###### {title}" if title else "")
        else:
            text, in_math = _without_math(line, in_math)
            kept.append("" if _TARGET.match(text) else text)
    return _without_indented_code(kept)


def _closes(fence: re.Match[str], fences: list[tuple[str, bool]]) -> bool:
    return bool(fences) and not fence["info"] and fence["mark"].startswith(fences[-1][0])


def _without_math(line: str, in_math: bool) -> tuple[str, bool]:
    """Remove display mathematics between pairs of dollar signs."""
    text = ""
    for index, piece in enumerate(line.split("$$")):
        if index:
            in_math = not in_math
        if not in_math:
            text += piece + " "
    return text.rstrip(), in_math


def _without_indented_code(lines: list[str]) -> list[str]:
    """Blank lines indented by four spaces after a blank line, unless a list is open."""
    kept: list[str] = []
    in_list = in_code = False
    previous = ""
    for line in lines:
        indented = line.startswith(("    ", "\t"))
        if line.strip() and not line[0].isspace():
            in_list = bool(_ITEM.match(line)) or (in_list and bool(previous.strip()))
        elif _ITEM.match(line) and not indented:
            in_list = True
        in_code = indented and not in_list and (in_code or not previous.strip())
        kept.append("" if in_code else line)
        if line.strip() or not in_code:
            previous = line
    return kept


def _blocks(lines: list[str]) -> Iterator[Block]:
    bibliography_level = 0
    for first, chunk in _chunks(lines):
        text = "\n".join(chunk)
        allowed = frozenset(
            word.strip().lower() for match in _ALLOW.finditer(text) for word in match[1].split(",") if word.strip()
        )
        text = re.sub(r"<!--.*?-->", lambda match: "\n" * match.group().count("\n"), text, flags=re.DOTALL)
        for offset, kind, level, raw in _pieces(text.split("\n")):
            prose = clean(raw)
            if kind is Kind.HEADING and (not bibliography_level or level <= bibliography_level):
                bibliography_level = level if _BIBLIOGRAPHY.match(prose.strip()) else 0
            if prose.strip():
                yield Block(kind, first + offset, prose, level, bool(bibliography_level), allowed)


def _chunks(lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Split lines at blank lines; comments over several paragraphs stay whole."""
    chunk: list[str] = []
    in_comment = False
    for number, line in enumerate([*lines, ""], start=1):
        in_comment = line.rfind("<!--") > line.rfind("-->") or (in_comment and "-->" not in line)
        if line.strip() or (in_comment and chunk):
            chunk.append(line)
        elif chunk:
            yield number - len(chunk), chunk
            chunk = []
    if chunk:
        yield len(lines) + 2 - len(chunk), chunk


def _pieces(lines: list[str]) -> Iterator[tuple[int, Kind, int, str]]:
    """Split a chunk without blank lines into headings, table rows, list items and paragraphs."""
    is_table = any(_TABLE_RULE.match(line) for line in lines)
    is_definition = len(lines) > 1 and lines[1].lstrip().startswith(": ")
    start, piece = 0, []
    for offset, line in enumerate(lines):
        line = re.sub(r"^\s*(?:>\s?)+", "", line)
        heading = _HEADING.match(line)
        row = is_table and "|" in line
        term = is_definition and offset == 0
        item = _ITEM.match(line) or line.lstrip().startswith(": ")
        if (heading or row or item or term) and piece:
            yield start, Kind.PARAGRAPH, 0, "\n".join(piece)
            piece = []
        if heading:
            yield offset, Kind.HEADING, len(heading[1]), heading[2].rstrip("# ")
        elif row:
            if not _TABLE_RULE.match(line):
                yield offset, Kind.TABLE, 0, line.replace("\\|", " ").replace("|", " | ")
        elif term:
            yield offset, Kind.TERM, 0, line
        else:
            if not piece:
                start = offset
            piece.append(_ITEM.sub("", line, count=1) if item else line)
    if piece:
        yield start, Kind.PARAGRAPH, 0, "\n".join(piece)
