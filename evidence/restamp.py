"""`./dev evidence restamp [NAME ...]`: verify by one recomputed item that a result still follows from the code.

For each result that is older than its code, one stored item is computed again by the item function of its evidence
module, in a process of its own, and compared with what is stored under today's names (`evidence/renamed.json`):

- equal: the result is stamped with today's files and commit; its items are stored under today's names;
- different: the result stays stale, and the first difference is recorded and printed;
- longer than the limit, or not computable here: the result is not changed.

A stamp keeps the date, the machine and the commit of the computation (`computed`), and states which item was replayed
(`replayed`). Only this item is verified; the other items are assumed to follow from the same code.

Two numbers are equal where all their bits are; `--within REL` allows a relative difference, which the stamp then
states. Two kinds of field are exempt:

- `UNCOMPARED`: wall-clock times and what depends on them, memory, versions of other software, and numbers of tests;
- `MESSAGES`: messages. Only their presence is compared.

Each outcome is written atomically as soon as it is known. The next run continues from there: up-to-date results are
skipped, and a replay is not repeated for the same code unless `--again` is given.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime as dt
import hashlib
import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import evidence

LIMIT_S = 600.0
UNCOMPARED = {
    *("wall_time_s", "cpu_time_s", "colift_cpu_time_s", "cpu_time_over_colift", "computation_time_s"),
    *("exit_time_s", "signal_time_s", "duration_s", "step_time_median_us", "step_time_p999_us"),
    "killed",  # processes that ran when they were killed at random times
    "passed_tests",  # the number of tests grows
    *("largest_process_MB", "versions", "compiler", "drake_version"),
}
MESSAGES = {
    *("report", "message", "last_message", "termination_reason", "warnings", "failures", "skipped", "killed_by"),
}
ITEMS = {  # the item that is replayed, where it is not the first that is stored: cheap, and of much of the code
    "certified": "101",
    "changes": "home: adaptive: 0",
    "engines": "C3",
    "file_faults": "tune",
    "generalization": "place: home: 0",
    "limits": "trio C1 301",
    "plant": "energy, reference, 0",
    "react": "10",
    "rivals": "calibration 0",
    "starts": "3 x 1",
}
NONE = "absent"
SMALL = 1e-6  # in SI units


class Difference(NamedTuple):
    """One value that differs: its key, and the stored and computed values."""

    key: str
    old: Any
    new: Any

    def __str__(self) -> str:
        return f"{self.key}: stored {_short(self.old)}, computed {_short(self.new)}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def differences(old: Any, new: Any, at: str = "") -> Iterator[Difference]:
    """Yield the values in which two items differ, in stored order.

    Args:
        old: The stored item, under today's names.
        new: The computed item.
        at: The key of both items, which begins the keys of the differences.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(key for key in new if key not in old)]:
            where, a, b = f"{at}.{key}".lstrip("."), old.get(key, NONE), new.get(key, NONE)
            if key in UNCOMPARED:
                continue
            if key in MESSAGES and key in old and key in new:
                if bool(a) != bool(b):
                    yield Difference(where, a, b)
                continue
            yield from differences(a, b, where)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from differences(a, b, f"{at}[{k}]")
    elif old != new or (type(old) is not type(new) and not _numbers(old, new)):
        yield Difference(at or "value", old, new)


def _numbers(*values: Any) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def relative(found: list[Difference]) -> float | None:
    """Return the largest relative difference of numbers; None where something else differs.

    Numbers below `SMALL` are compared relative to it: a residual of 1e-13 is a rounding error in all its digits.
    """
    if not all(_numbers(one.old, one.new) for one in found):
        return None
    return max((abs(one.old - one.new) / max(abs(one.old), abs(one.new), SMALL) for one in found), default=0.0)


def code(files: Mapping[str, str]) -> str:
    """Return one digest of all files behind a result."""
    return hashlib.sha256(json.dumps(sorted(files.items())).encode()).hexdigest()[:16]


class Unreplayed(Exception):
    """Signal that an item could not be computed, with the reason."""


def computed(name: str, item: str, limit_s: float) -> tuple[Any, float]:
    """Return an item of a result, computed again in a child process, and its duration [s].

    Raises:
        Unreplayed: If it takes longer than the limit or ends with an error.
    """
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "item.json"
        command = [sys.executable, "-m", "evidence.restamp", name, item, str(out)]
        streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        # in a separate session, so that child processes of the item end with it
        with subprocess.Popen(command, cwd=evidence.ROOT, start_new_session=True, **streams) as run:
            try:
                _, errors = run.communicate(timeout=limit_s)
            except BaseException as end:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(run.pid, signal.SIGKILL)
                if isinstance(end, subprocess.TimeoutExpired):
                    raise Unreplayed(f"takes longer than {limit_s:g} s") from None
                raise
        if not out.exists():
            lines = [line for line in errors.splitlines() if line.strip()]
            raise Unreplayed(f"ends with status {run.returncode}: {lines[-1] if lines else 'no message'}")
        return json.loads(out.read_text()), time.monotonic() - began


def restamp(
    name: str, item: str | None = None, limit_s: float = LIMIT_S, again: bool = False, within: float = 0.0
) -> tuple[bool, str]:
    """Compute one item of a result again, and stamp the result if the item is equal.

    Args:
        name: The result.
        item: The item; see `ITEMS` for the default.
        limit_s: The longest time that the replay may take [s].
        again: Whether to repeat a replay that was different for the same code.
        within: The relative difference up to which numbers count as equal.

    Returns:
        Whether the result holds for today's code, and a line that states what was found.
    """
    if not (evidence.RESULTS / f"{name}.json").exists():
        return False, "no result"
    if not evidence.changed_files(name):
        return True, "nothing changed since"
    record, files = evidence.stored(name), evidence.files_behind(evidence.ROOT / "evidence" / f"{name}.py")
    if changed := evidence.uncommitted(files):
        return False, f"not changed: not committed: {', '.join(changed[:3])}"
    before = record.get("replayed", {})
    if before.get("code") == code(files) and not again and item in (None, before["item"]):
        return False, f"stale, as replayed on {before['date']}: {Difference(*before['difference'])}"
    item = item or ITEMS.get(name, next(iter(record["items"])))
    if item not in record["items"]:
        return False, f"not changed: no item {item!r} is stored"
    try:
        value, seconds = computed(name, item, limit_s)
    except Unreplayed as reason:
        return False, f"not changed: item {item!r} {reason}"
    all_differences = list(differences(record["items"][item], value))
    found = all_differences if (size := relative(all_differences)) is None or size > within else []
    replayed = {
        "item": item,
        "date": dt.date.today().isoformat(),
        "machine": evidence.machine(),
        "code": code(files),
        "equal": not found,
        "relative_difference": size,
        "difference": list(found[0]) if found else None,
    }
    path = evidence.RESULTS / f"{name}.json"
    if found:
        evidence.save(path, json.loads(path.read_text()) | {"replayed": replayed})
        spread = "" if size is None else f", relative differences up to {size:.1e}"
        return False, f"stale: item {item!r} differs in {len(found)} values{spread}; first {found[0]}"
    origin = record.get("computed") or {key: record[key] for key in ("commit", "date")}
    stamp = {"commit": evidence.head(), "files": files, "computed": origin, "replayed": replayed}
    evidence.save(path, record | stamp | {"items": record["items"]})
    equal = f"equal to {size:.1e}" if all_differences else "equal"
    return True, f"stamped: item {item!r} is {equal}, replayed in {seconds:.0f} s"


def main(arguments: list[str], names: list[str]) -> int:
    """Restamp results, one line each; the status is 1 if one of them stays outdated, 2 for an unknown name."""
    parser = argparse.ArgumentParser(prog="evidence restamp", description="replay one item of each stale result")
    parser.add_argument("names", nargs="*", metavar="NAME", help="results; all where none is named")
    parser.add_argument("--item", help="the stored item to replay, for one NAME")
    parser.add_argument("--limit", type=float, default=LIMIT_S, help="longest replay [s]")
    parser.add_argument("--again", action="store_true", help="repeat replays that were different for the same code")
    parser.add_argument("--within", type=float, default=0.0, metavar="REL", help="relative difference that is equal")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.names if name not in names]:
        parser.error(f"no result {', '.join(unknown)}; there are {', '.join(names)}")
    if options.item and len(options.names) != 1:
        parser.error("--item needs one NAME")
    good = True
    for name in options.names or names:
        holds, line = restamp(name, options.item, options.limit, options.again, options.within)
        print(f"{name:<14} {line}", flush=True)
        good &= holds
    return 0 if good else 1


def replay(name: str, item: str, out: Path) -> None:
    """Compute one item of an evidence module and write it as JSON."""
    evidence.only_item = item
    try:
        importlib.import_module(f"evidence.{name}").main()
    except evidence.Replayed as done:
        evidence.save(out, done.value)
    else:
        raise SystemExit(f"{name} ended without item {item!r}")


if __name__ == "__main__":
    replay(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
