"""Rule on public identifiers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath

from checks import word_lists
from checks.python_source import Identifier
from checks.repository import Problem, Repository

RULE = "banned-names"


def banned_names(repository: Repository) -> Iterator[Problem]:
    """Reject public identifiers in src/ that are on the list checks/banned_names.txt."""
    packages: set[PurePosixPath] = set()
    for path, source in repository.sources("src"):
        modules = [*_new_packages(PurePosixPath(path), packages), *_module(PurePosixPath(path))]
        for identifier in (*modules, *source.identifiers):
            for entry in word_lists.banned_names():
                if entry.matches(identifier.kind, identifier.name):
                    lines = range(identifier.line, identifier.line + 1)
                    if not source.allows(lines, RULE, identifier.name, entry.word):
                        yield Problem(path, identifier.line, RULE, _message(identifier, entry))
                    break


def _message(identifier: Identifier, entry: word_lists.BannedName) -> str:
    owner = f" of {identifier.owner}" if identifier.owner else ""
    word = "" if entry.whole or identifier.name == entry.word else f" contains '{entry.word}', which"
    return f"{identifier.kind} '{identifier.name}'{owner}{word} is not a term of the field; use {entry.suggestion}"


def _module(path: PurePosixPath) -> Iterator[Identifier]:
    if not path.stem.startswith("_"):
        yield Identifier("module", path.stem, "", 1)


def _new_packages(path: PurePosixPath, known: set[PurePosixPath]) -> Iterator[Identifier]:
    for folder in path.parents:
        if folder not in known and folder.name not in ("", "src"):
            known.add(folder)
            yield Identifier("module", folder.name, "", 1)
