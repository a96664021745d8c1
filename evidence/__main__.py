"""`python -m evidence [NAME ...] [--jobs N]`: compute or resume results; also `status` and `restamp`."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import evidence
from evidence import dependencies, restamp, status


def module_names() -> list[str]:
    """Return the names of all evidence modules."""
    return sorted(m.name for m in pkgutil.iter_modules(evidence.__path__) if m.name not in dependencies.TOOLS)


def main(arguments: list[str]) -> int:
    """Compute the results; the status is 1 if one misses its targets, 2 for an unknown name."""
    if arguments[:1] == ["status"]:
        return status.main(arguments[1:], module_names())
    if arguments[:1] == ["restamp"]:
        return restamp.main(arguments[1:], module_names())
    if "--jobs" in arguments:
        at = arguments.index("--jobs")
        given = "".join(arguments[at + 1 : at + 2])
        if not given.isdecimal() or int(given) < 1:
            print(f"--jobs: must be a positive number of processes, got {given!r}", file=sys.stderr)
            return 2
        evidence.processes, arguments = int(given), arguments[:at] + arguments[at + 2 :]
    unknown = [name for name in arguments if name not in module_names()]
    if unknown:
        print(
            f"no result {', '.join(unknown)}; there are {', '.join(module_names())}, status and restamp",
            file=sys.stderr,
        )
        return 2
    held = [(name, importlib.import_module(f"evidence.{name}").main()) for name in arguments or module_names()]
    for name, holds in held:
        print(f"{name}: {'holds' if holds else 'DOES NOT HOLD'}")
    return 0 if all(holds for _, holds in held) else 1


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("interrupted; the next run resumes", file=sys.stderr)
        sys.exit(130)
