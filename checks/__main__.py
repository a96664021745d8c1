"""Command line: `python -m checks [--only RULE] [--list] [--summary] [--root FOLDER]`."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from checks.repository import Problem, Repository
from checks.rules import RULES, Rule


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the checks.

    Args:
        arguments: Command line without the program; by default that of the process.

    Returns:
        0 if there is no problem, 1 if there are problems, 2 if the checks could not run.
    """
    options = _parser().parse_args(arguments)
    if options.list:
        for rule in RULES:
            print(f"{rule.name:20} {rule.summary}")
        return 0
    rules = [rule for rule in RULES if not options.only or rule.name in options.only]
    repository = Repository(options.root.resolve())
    try:
        problems = [problem for rule in rules for problem in rule.check(repository)]
        if options.summary:
            _print_summary(rules, problems, _exceptions(repository))
        else:
            for problem in sorted(problems):
                print(problem)
    except SyntaxError as error:
        print(f"checks: {error.filename}:{error.lineno}: {error.msg}", file=sys.stderr)
        return 2
    except (OSError, ValueError) as error:
        print(f"checks: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    if problems:
        print(f"checks: {len(problems)} problems", file=sys.stderr)
    return 1 if problems else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m checks", description="Check language and structure of the repository."
    )
    names = [rule.name for rule in RULES]
    parser.add_argument("--only", action="append", choices=names, metavar="RULE", help="run one rule; may be repeated")
    parser.add_argument("--list", action="store_true", help="list the rules and exit")
    parser.add_argument("--summary", action="store_true", help="print the number of problems per rule")
    default = Path(__file__).resolve().parents[1]
    parser.add_argument("--root", type=Path, default=default, help="top folder of the checkout; default: this checkout")
    return parser


def _print_summary(rules: Sequence[Rule], problems: Sequence[Problem], exceptions: int) -> None:
    counts = Counter(problem.rule for problem in problems)
    for rule in rules:
        print(f"{rule.name:20} {counts[rule.name]:6}")
    print(f"{'exceptions in use':20} {exceptions:6}")


def _exceptions(repository: Repository) -> int:
    """Count the exception comments of code and pages."""
    code = sum(repository.source(path).exception_count for path in repository.files(suffix=".py"))
    return code + sum(repository.page(path).exceptions for path in repository.files(suffix=".md"))


if __name__ == "__main__":
    sys.exit(main())
