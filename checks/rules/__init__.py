"""All rules, in the order in which they run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from checks.repository import Problem, Repository
from checks.rules.banned_names import banned_names
from checks.rules.banned_words import banned_words
from checks.rules.code_size import code_size
from checks.rules.docstring_openings import docstring_openings
from checks.rules.empty_test_modules import empty_test_modules
from checks.rules.long_test_names import long_test_names
from checks.rules.package_entries import package_entries
from checks.rules.page_limits import page_limits
from checks.rules.sentence_length import sentence_length
from checks.rules.workplace_paths import workplace_paths


@dataclass(frozen=True)
class Rule:
    """One rule.

    Attributes:
        name: Name on the command line and in messages.
        summary: One line for `python -m checks --list`.
        check: Function that yields the problems of a repository.
    """

    name: str
    summary: str
    check: Callable[[Repository], Iterator[Problem]]


RULES = tuple(
    Rule(check.__name__.replace("_", "-"), (check.__doc__ or "").partition("\n")[0], check)
    for check in (
        banned_names,
        banned_words,
        sentence_length,
        docstring_openings,
        code_size,
        package_entries,
        page_limits,
        long_test_names,
        empty_test_modules,
        workplace_paths,
    )
)
