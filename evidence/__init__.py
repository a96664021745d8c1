"""Long-running evidence: each module computes one dated JSON file under `evidence/results` and can be resumed.

A module here has `main()` and stores what it computes item by item. The result file names the command, the machine, the
commit and the files that the result depends on (`evidence.dependencies`), each with git's digest. Items are computed
again only when one of these files has changed. Changes of docstrings, comments and layout of Python files do not count,
and of lock files only the pinned versions do.

    ./dev evidence NAME ...      computes or resumes results; `--jobs N` computes N items at a time
    ./dev evidence status        lists results that are older than their code, and pages that quote them
    ./dev evidence restamp       replays one item of each such result and stamps it where the item is bit-equal
"""

from __future__ import annotations

import concurrent.futures
import datetime as dt
import functools
import importlib.metadata
import json
import multiprocessing
import platform
import re
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from rich.console import Console

from colift.cli import progress
from colift.runtime import atomic_write
from evidence import dependencies

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "evidence" / "results"


def files_behind(module: Path, root: Path = ROOT) -> dict[str, str]:
    """Return the project files behind an evidence module or a benchmark, with their git digests."""
    files = sorted(dependencies.closure(module, root))
    return {path.relative_to(root).as_posix(): _digest(path) for path in files}


def _digest(path: Path) -> str:
    """Return git's digest of a file: `git hash-object`."""
    return dependencies.digest(path.read_bytes())


def head() -> str | None:
    """Return the commit that is checked out; None outside a repository."""
    output = _git("rev-parse", "HEAD")
    return output.strip() if output else None


def uncommitted(files: Iterable[str]) -> list[str]:
    """Return the files that differ from the last commit; none outside a repository."""
    output = _git("status", "--porcelain", "--untracked-files=all", "--", *files)
    return [line[3:] for line in (output or "").splitlines()]


def _git(*words: str) -> str | None:
    """Return the output of git in the project's folder, or None without git or repository."""
    try:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (subprocess.CalledProcessError, FileNotFoundError):
        return None


def machine() -> str:
    """Return the processor and the number of cores that this process may use."""
    from colift.codegen import build  # it imports JAX, which `status` does without

    names = [line.split(":", 1)[1].strip() for line in _cpuinfo() if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {build.available_cores()} cores"


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that determine rounding."""
    packages = {name: importlib.metadata.version(name) for name in ("jax", "numpy", "scipy")}
    return {"python": platform.python_version(), **packages}


def _cpuinfo() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def changed_files(name: str) -> list[str]:
    """Return the files that changed since a result was computed; empty for an up-to-date result.

    Results that do not contain lock files are compared with the locks of their commit.
    """
    record, files_now = _record(name), files_behind(ROOT / "evidence" / f"{name}.py")
    files_then = record.get("files", {})
    locks = {path for path in files_now if path.startswith(dependencies.LOCKS)}
    if locks and not any(path in files_then for path in locks) and record.get("commit"):
        files_then = files_then | {
            path: digest
            for path, digest in _listed(ROOT, record["commit"], dependencies.LOCKS).items()
            if path in locks
        }
    changed = (path for path in files_then | files_now if files_then.get(path) != files_now.get(path))
    return sorted(
        path for path in changed if not (path in files_then and path in files_now and _same(files_then[path], path))
    )


@functools.cache
def _listed(root: Path, commit: str, folder: str) -> dict[str, str]:
    """Return the files below a folder of a commit with their git digests; none if git has no such commit."""
    del root
    lines = (_git("ls-tree", "-r", commit, "--", folder) or "").splitlines()
    return {line.split("\t")[1]: line.split()[2] for line in lines}


def _same(digest: str, path: str) -> bool:
    """Return whether a file has the same meaning as the version with a git digest, see `dependencies.meaning`."""
    before, suffix = _blob(ROOT, digest) if path.endswith((".py", ".txt")) else None, Path(path).suffix
    if before is None:
        return False
    return dependencies.meaning(before, suffix) == dependencies.meaning((ROOT / path).read_text(), suffix)


@functools.cache
def _blob(root: Path, digest: str) -> str | None:
    del root
    return _git("cat-file", "blob", digest)


def _record(name: str) -> dict[str, Any]:
    return json.loads((RESULTS / f"{name}.json").read_text())


def stored(name: str) -> dict[str, Any]:
    """Return the contents of a result file with items under their present names (`evidence/renamed.json`)."""
    record = _record(name)
    return record | {"items": renamed(record["items"], name)}


def renamed(value: Any, name: str = "") -> Any:
    """Return stored items with keys of earlier versions replaced, see `evidence/renamed.json`.

    `keys` maps whole keys, and `values` maps whole texts that are values. In other keys, `phrases` maps parts, and
    `words` maps words (bounded by anything but letters, digits and `_`). `results` has more tables for single results.
    """
    if isinstance(value, dict):
        return {_renamed(key, name): renamed(one, name) for key, one in value.items()}
    if isinstance(value, list):
        return [renamed(one, name) for one in value]
    return _names(name)["values"].get(value, value) if isinstance(value, str) else value


@functools.cache
def _names(name: str) -> dict[str, dict[str, str]]:
    table = json.loads(RENAMED.read_text()) if RENAMED.exists() else {}
    own = table.get("results", {}).get(name, {})
    return {kind: table.get(kind, {}) | own.get(kind, {}) for kind in ("words", "phrases", "keys", "values")}


@functools.cache
def _renamed(key: str, name: str) -> str:
    if key in (keys := _names(name)["keys"]):
        return keys[key]
    for old, new in _names(name)["phrases"].items():
        key = key.replace(old, new)
    return re.sub(r"\w+", lambda word: _names(name)["words"].get(word[0], word[0]), key)


RENAMED = Path(__file__).with_name("renamed.json")


class Replayed(BaseException):
    """Signal that one item of an evidence module was computed, see `evidence.restamp`."""

    def __init__(self, item: str, value: Any) -> None:
        super().__init__(item)
        self.item, self.value = item, value


processes = 1  # by which `collect` computes items, set by `--jobs`
only_item: str | None = None  # the only item that `collect` computes, ignoring stored results


def collect(name: str, items: Iterable[str], compute: Callable[[str], Any]) -> dict[str, Any]:
    """Compute every item that a result file lacks, saving after each, and return all items.

    Raises SystemExit if a file behind the result is not committed, because the result could not be reproduced.
    """
    if only_item is not None:
        if only_item not in (items := list(items)):
            raise LookupError(f"{name} has no item {only_item!r}; there are {', '.join(items[:5])}, ...")
        raise Replayed(only_item, compute(only_item))
    path = RESULTS / f"{name}.json"
    found = stored(name)["items"] if path.exists() and not changed_files(name) else {}
    missing = [item for item in items if item not in found]
    if missing:
        files = files_behind(ROOT / "evidence" / f"{name}.py")
        if changed := uncommitted(files):
            raise SystemExit(f"{name}: a result names the commit it can be repeated from; commit {', '.join(changed)}")
        record = {
            "command": f"./dev evidence {name}",
            "machine": machine(),
            "versions": versions(),
            "commit": head(),
        }
    for item, value in _computed(name, missing, compute):
        found[item] = value
        save(path, {**record, "date": dt.date.today().isoformat(), "files": files, "items": found})
    return found


def _computed(name: str, items: list[str], compute: Callable[[str], Any]) -> Iterator[tuple[str, Any]]:
    """Yield items with their values as they are computed, by `processes` at a time."""
    if not items:
        return
    console = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)
    with progress.show_activity(console, name) as shown:

        def report(item: str, done: int) -> None:
            shown(f"{item} ({done} of {len(items)} computed)", done / len(items))

        if processes == 1 or len(items) < 2:
            for done, item in enumerate(items):
                report(item, done)
                yield item, compute(item)
            return
        with concurrent.futures.ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            running = {pool.submit(compute, item): item for item in items}
            try:
                for done, future in enumerate(concurrent.futures.as_completed(running), start=1):
                    report(running[future], done)
                    yield running[future], future.result()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def save(path: Path, value: Any) -> None:
    """Write JSON atomically."""
    path.parent.mkdir(exist_ok=True)
    atomic_write.write_atomic(path, (json.dumps(value, indent=1, allow_nan=False) + "\n").encode())
