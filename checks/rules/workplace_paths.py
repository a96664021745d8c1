"""Rule on paths of one particular machine."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from checks.repository import Problem, Repository

RULE = "workplace-paths"

_PATH = re.compile(
    r"(?<![\w./~$}*-])/(?:work(?=/)|tmp(?=/)(?!/tmp\w{8}\b))|(?<![\w/])shared/(?=[A-Z]{4,}\.(?:csv|md)\b)"
)
_MARK = re.compile(r"checks:\s*allow\b")
_BINARY = frozenset(
    [".gif", ".h5", ".jpg", ".mp4", ".nc", ".npz", ".pdf", ".png", ".webp", ".woff2", ".xz", ".zip", ".gz"]
)


def workplace_paths(repository: Repository) -> Iterator[Problem]:
    """Reject absolute paths of a development machine in all text files outside tests/.

    A line that contains an exception comment is not read. Names made by Python's `tempfile` in recorded output are
    accepted.
    """
    for path in repository.files():
        name = repository.name(path)
        if name.startswith("tests/") or path.suffix in _BINARY:
            continue
        for number, line in enumerate(_text(path).splitlines(), start=1):
            for match in _PATH.finditer(line):
                if not _MARK.search(line):
                    start = line[match.start() : match.start() + 30].split()[0]
                    message = f"path of one machine: '{start}'; use a path relative to the repository or a placeholder"
                    yield Problem(name, number, RULE, message)
                    break


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return ""
