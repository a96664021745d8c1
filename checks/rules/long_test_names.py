"""Rule on the names of tests."""

from __future__ import annotations

from collections.abc import Iterator

from checks.limits import MAX_TEST_NAME_LENGTH
from checks.repository import Problem, Repository

RULE = "long-test-names"


def long_test_names(repository: Repository) -> Iterator[Problem]:
    """Reject test functions in tests/ with too long a name."""
    for path, source in repository.sources("tests"):
        for node in sorted(source.functions, key=lambda node: node.lineno):
            length = len(node.name)
            allowed = source.allows(range(node.lineno, node.lineno + 1), RULE)
            if node.name.startswith("test") and length > MAX_TEST_NAME_LENGTH and not allowed:
                message = (
                    f"'{node.name}' has {length} characters (limit {MAX_TEST_NAME_LENGTH}); "
                    "shorten it and state the sentence in the docstring"
                )
                yield Problem(path, node.lineno, RULE, message)
