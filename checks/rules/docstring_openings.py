"""Rule on the first word of docstrings."""

from __future__ import annotations

import re
from collections.abc import Iterator

from checks.repository import Problem, Repository

RULE = "docstring-openings"

OPENINGS = frozenset(["what", "which", "whether", "of", "as", "how", "where", "when", "those", "that", "who", "until"])


def docstring_openings(repository: Repository) -> Iterator[Problem]:
    """Reject docstrings in src/ that begin with a relative or interrogative word."""
    for path, source in repository.sources("src"):
        for text in sorted(source.docstrings, key=lambda text: text.line):
            first = re.match(r"\W*([A-Za-z]+)", text.text)
            allowed = source.allows(range(text.line, text.last_line + 1), RULE)
            if first and first[1].lower() in OPENINGS and not allowed:
                message = f"docstring begins with '{first[1]}'; begin with a verb ('Compute ...') or a noun phrase"
                yield Problem(path, text.line, RULE, message)
