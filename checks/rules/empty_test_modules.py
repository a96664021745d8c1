"""Rule on test modules without tests."""

from __future__ import annotations

from collections.abc import Iterator

from checks.repository import Problem, Repository

RULE = "empty-test-modules"


def empty_test_modules(repository: Repository) -> Iterator[Problem]:
    """Reject files tests/**/test_*.py without a test: an empty file passes all tests."""
    for path, source in repository.sources("tests"):
        is_module = path.rpartition("/")[2].startswith("test_")
        if is_module and not any(node.name.startswith("test") for node in source.functions):
            yield Problem(path, 1, RULE, "no function of this module is a test; add one or delete the file")
