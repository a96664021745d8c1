"""Rule on the length of modules and functions."""

from __future__ import annotations

from collections.abc import Iterator

from checks.limits import MAX_FUNCTION_LINES, MAX_MODULE_LINES
from checks.repository import Problem, Repository

RULE = "code-size"


def code_size(repository: Repository) -> Iterator[Problem]:
    """Reject modules and functions in src/ with too many code lines.

    A code line is neither blank nor only a comment or docstring. A function includes its signature and nested
    functions, but not its decorators.
    """
    for path, source in repository.sources("src"):
        size = len(source.code_lines)
        if size > MAX_MODULE_LINES and not source.allows(range(1, 2), RULE):
            message = f"module of {size} code lines (limit {MAX_MODULE_LINES}); split it by topic"
            yield Problem(path, 1, RULE, message)
        for node in sorted(source.functions, key=lambda node: node.lineno):
            size = sum(node.lineno <= line <= (node.end_lineno or node.lineno) for line in source.code_lines)
            if size > MAX_FUNCTION_LINES and not source.allows(range(node.lineno, node.lineno + 1), RULE):
                message = (
                    f"function '{node.name}' of {size} code lines (limit {MAX_FUNCTION_LINES}); extract named steps"
                )
                yield Problem(path, node.lineno, RULE, message)
