"""Fixtures of the tests of the language check: small generated repositories."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from checks.repository import Problem, Repository
from checks.rules import RULES

Run = Callable[[str, Mapping[str, str]], list[Problem]]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Return a function that writes files and lists the problems of one rule."""

    def run_rule(rule: str, files: Mapping[str, str]) -> list[Problem]:
        for name, text in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        (check,) = [entry.check for entry in RULES if entry.name == rule]
        return list(check(Repository(tmp_path)))

    return run_rule
