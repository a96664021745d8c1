"""`python -m evidence [NAME ...]`: computes or resumes all results, or those named; also `status` and `restamp`."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import evidence
from evidence import dependencies, restamp, status


def proofs() -> list[str]:
    """The names of all proofs."""
    return sorted(m.name for m in pkgutil.iter_modules(evidence.__path__) if m.name not in dependencies.TOOLS)


def main(names: list[str]) -> int:
    """Run the proofs; the status is 1 if one of them does not hold, 2 for a name that does not exist."""
    if names[:1] == ["status"]:
        return status.main(names[1:], proofs())
    if names[:1] == ["restamp"]:
        return restamp.main(names[1:], proofs())
    unknown = [name for name in names if name not in proofs()]
    if unknown:
        print(f"no proof {', '.join(unknown)}; there are {', '.join(proofs())}, status and restamp", file=sys.stderr)
        return 2
    held = [(name, importlib.import_module(f"evidence.{name}").main()) for name in names or proofs()]
    for name, holds in held:
        print(f"{name}: {'holds' if holds else 'DOES NOT HOLD'}")
    return 0 if all(holds for _, holds in held) else 1


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("interrupted; the next run goes on from here", file=sys.stderr)
        sys.exit(130)
