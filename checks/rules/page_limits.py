"""Rule on the length of pages with a size limit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from checks.limits import (
    MAX_DECISION_RECORDS,
    MAX_GLOSSARY_TERMS,
    MAX_LEARNING_WORDS,
    MAX_README_NUMBERS,
    MAX_README_WORDS,
)
from checks.markdown import Kind, Page
from checks.prose import numbers, words
from checks.repository import Problem, Repository

RULE = "page-limits"


def page_limits(repository: Repository) -> Iterator[Problem]:
    """Reject too long a README, learning page or glossary, and too many decision records.

    Words are counted in all prose, headings, lists and tables; inline code and inline mathematics count as one word
    each. Code blocks, images, badges, link targets, display mathematics and comments do not count. Numbers are counted
    in the same text, tables included; `checks.prose.numbers` defines a number. Terms of the glossary are the rows of
    its tables without the heading row, terms of definition lists, entries of `{glossary}` directives and headings of
    level 3.
    """
    yield from _page(repository, "README.md", MAX_README_WORDS, MAX_README_NUMBERS)
    yield from _page(repository, "docs/learning.md", MAX_LEARNING_WORDS, None)
    for path in repository.files("docs/glossary.md"):
        terms = glossary_terms(repository.page(path))
        if terms > MAX_GLOSSARY_TERMS:
            message = (
                f"{terms} terms (limit {MAX_GLOSSARY_TERMS}); keep terms of this project, remove terms of textbooks"
            )
            yield Problem(repository.name(path), 1, RULE, message)
    records = [path for path in repository.files("docs/decisions", ".md") if _is_record(path)]
    if len(records) > MAX_DECISION_RECORDS:
        message = (
            f"{len(records)} records (limit {MAX_DECISION_RECORDS}); merge superseded records into their successors"
        )
        yield Problem("docs/decisions", 1, RULE, message)


def glossary_terms(page: Page) -> int:
    """Count the terms of a glossary page; `page_limits` states the counting rule."""
    rows = 0
    terms = 0
    previous_row = 0
    for block in page.blocks:
        if block.kind is Kind.TABLE:
            rows += 1 if previous_row and block.line - previous_row <= 2 else 0
            previous_row = block.line
        terms += block.kind is Kind.TERM or (block.kind is Kind.HEADING and block.level == 3)
    return rows + terms + _directive_terms(page.lines)


def _directive_terms(lines: list[str]) -> int:
    """Count lines of `{glossary}` directives without indentation."""
    count, inside = 0, False
    for line in lines:
        if line.lstrip().startswith(("```", ":::")):
            inside = "{glossary}" in line
        elif inside and line.strip() and not line[0].isspace() and not line.startswith(":"):
            count += 1
    return count


def _page(repository: Repository, name: str, max_words: int, max_numbers: int | None) -> Iterator[Problem]:
    for path in repository.files(name):
        prose = repository.page(path).prose()
        count = len(words(prose))
        if count > max_words:
            yield Problem(name, 1, RULE, f"{count} words (limit {max_words}); move details to a page of their own")
        found = numbers(prose)
        if max_numbers is not None and len(found) > max_numbers:
            message = f"{len(found)} numbers outside code (limit {max_numbers}); move results to docs/results: "
            yield Problem(name, 1, RULE, message + ", ".join(found))


def _is_record(path: Path) -> bool:
    return path.stem.lower() not in ("index", "readme", "template")
