"""Rule on the number of entries at the top of the package."""

from __future__ import annotations

from collections.abc import Iterator

from checks.limits import MAX_PACKAGE_ENTRIES, PACKAGE
from checks.repository import Problem, Repository

RULE = "package-entries"

NOT_COUNTED = frozenset({"__init__.py", "__main__.py", "__pycache__", "py.typed"})


def package_entries(repository: Repository) -> Iterator[Problem]:
    """Reject too many files and folders at the top of the package; data folders count."""
    top = repository.root / PACKAGE
    if not top.is_dir():
        return
    entries = sorted(path.name for path in top.iterdir() if path.name not in NOT_COUNTED)
    if len(entries) > MAX_PACKAGE_ENTRIES:
        message = (
            f"{len(entries)} entries at the top of the package (limit {MAX_PACKAGE_ENTRIES}); "
            f"move modules into the folder of their topic: {', '.join(entries)}"
        )
        yield Problem(PACKAGE, 1, RULE, message)
