"""`python -m evidence [NAME ...]`: run or resume all proofs, or those named; `status` says which results are behind."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import evidence


def proofs() -> list[str]:
    """The names of all proofs."""
    return sorted(m.name for m in pkgutil.iter_modules(evidence.__path__) if m.name != "__main__")


TOLD = 5  # changed files that are named


def status() -> None:
    """Print, for each proof, when its result was made, and which files have changed since, its own first."""
    for name in proofs():
        if not (evidence.RESULTS / f"{name}.json").exists():
            print(f"{name:<12} no result yet")
            continue
        made, changed = evidence.stored(name), evidence.behind(name)
        at = f"{made['date']} at {(made.get('commit') or 'no commit')[:10]}"
        changed.sort(key=lambda path: not path.startswith("evidence/"))
        more = f" and {len(changed) - TOLD} more" * (len(changed) > TOLD)
        since = f"since then changed: {', '.join(changed[:TOLD])}{more}" if changed else "nothing changed since"
        print(f"{name:<12} {at}: {since}")


def main(names: list[str]) -> int:
    """Run the proofs; the status is 1 if one of them does not hold, 2 for a name that does not exist."""
    if names == ["status"]:
        status()
        return 0
    unknown = [name for name in names if name not in proofs()]
    if unknown:
        print(f"no proof {', '.join(unknown)}; there are {', '.join(proofs())}, and status", file=sys.stderr)
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
