"""Rule on words in prose."""

from __future__ import annotations

import re
from collections.abc import Iterator

from checks import word_lists
from checks.limits import PROSE_CODE_FOLDERS, PROSE_PAGES, PROSE_YAML_FOLDERS
from checks.python_source import prose_of
from checks.repository import Problem, Repository

RULE = "banned-words"
_YAML_PROSE = re.compile(r"(?:^|\s)#\s*(?P<comment>.*)$|^description:\s*(?P<description>.*)$", re.MULTILINE)


def banned_words(repository: Repository) -> Iterator[Problem]:
    """Reject words of checks/banned_words.txt in docstrings, comments, help strings, Markdown pages and YAML files."""
    for folder in PROSE_CODE_FOLDERS:
        yield from _in_code(repository, folder)
    for folder in PROSE_YAML_FOLDERS:
        yield from _in_yaml(repository, folder)
    for path in repository.files("docs", ".md"):
        yield from _in_page(repository, repository.name(path))
    for name in PROSE_PAGES:
        yield from _in_page(repository, name)


def _in_code(repository: Repository, folder: str) -> Iterator[Problem]:
    for path, source in repository.sources(folder):
        for text in sorted((*source.docstrings, *source.comments, *source.help_strings), key=lambda text: text.line):
            for offset, word, suggestion in _matches(prose := prose_of(text)):
                line = text.line + prose.count("\n", 0, offset)
                if not source.allows(range(text.line, text.last_line + 1), RULE, word):
                    yield Problem(path, min(line, text.last_line), RULE, _message(word, suggestion, text.kind))


def _in_yaml(repository: Repository, folder: str) -> Iterator[Problem]:
    """Check comments and descriptions of scenario files."""
    for path in repository.files(folder, ".yaml"):
        text = path.read_text(encoding="utf-8")
        for line in _YAML_PROSE.finditer(text):
            kind = "comment" if line["comment"] is not None else "description"
            for offset, word, suggestion in _matches(line[kind]):
                number = text.count("\n", 0, line.start(kind) + offset) + 1
                yield Problem(repository.name(path), number, RULE, _message(word, suggestion, kind))


def _in_page(repository: Repository, name: str) -> Iterator[Problem]:
    for path in repository.files(name):
        for block in repository.page(path).blocks:
            for offset, word, suggestion in _matches(block.text):
                if not block.allowed & {RULE, word.lower()}:
                    yield Problem(name, block.line_at(offset), RULE, _message(word, suggestion, block.kind.value))


def _matches(text: str) -> Iterator[tuple[int, str, str]]:
    """Yield offset, word and suggestion of each match; of overlapping ones only the first entry of the list."""
    taken: list[range] = []
    for entry in word_lists.banned_words():
        for match in entry.pattern.finditer(text):
            if not any(match.start() < span.stop and span.start < match.end() for span in taken):
                taken.append(range(*match.span()))
                yield match.start(), " ".join(match.group().split()), entry.suggestion


def _message(word: str, suggestion: str, place: str) -> str:
    return f"'{word}' in a {place}; write {suggestion}"
