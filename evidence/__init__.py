"""Proofs that take longer than a test: each writes one dated JSON file under `evidence/results`, and can be resumed.

A proof is a module here with `main()`. It keeps what it has computed in its result file, item by item. The file names
the commit that it was computed at and the files that it rests on, each with git's digest. Once one of these files is
another, and only then, a run computes afresh; `./dev evidence status` says which results are behind, and by what. A
Python file whose docstrings, comments or layout alone have changed is the same.
"""

from __future__ import annotations

import ast
import datetime as dt
import hashlib
import json
import platform
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from colift import disk
from colift.native import build

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "evidence" / "results"
PACKAGES = {"colift": "src/colift", "evidence": "evidence", "tests": "tests", "benchmarks": "benchmarks"}
SCENARIOS = "src/colift/scenarios"


def rests_on(proof: Path, root: Path = ROOT) -> dict[str, str]:
    """The project's files behind a proof or a benchmark, relative to the root, and git's digest of each.

    The module itself, what it imports, what that imports, and so on; data files that one of them names and that lie
    beside it; scenarios that the proof names; the folders in its `RUNS`, if it starts programs of theirs. An import
    inside a function is not followed: those are for figures.
    """
    record = root / "evidence" / "__init__.py"  # how results are kept changes none
    found, left = set(), {proof}
    while left:
        path = left.pop()
        found.add(path)
        tree = ast.parse(path.read_text())
        found |= {beside for word in _words(tree) if (beside := path.parent / word).is_file()}
        left |= set(_imported(tree, root)) - found - {record}
    tree = ast.parse(proof.read_text())
    found |= {path for path in (root / SCENARIOS).glob("*.yaml") if path.stem in _words(tree)}
    found |= {path for folder in _runs(tree) for path in (root / folder).rglob("*") if path.suffix in SOURCE}
    found.discard(record)
    return {path.relative_to(root).as_posix(): _digest(path) for path in sorted(found)}


def _words(tree: ast.AST) -> set[str]:
    """Strings of a module that may be the name of a file or of a scenario."""
    nodes = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return {value for value in nodes if isinstance(value, str) and value and set(value) <= NAME}


def _runs(tree: ast.Module) -> tuple[str, ...]:
    """The folders in a module's `RUNS`, none if it has no such line."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["RUNS"]:
            return ast.literal_eval(node.value)
    return ()


SOURCE = {".py", ".yaml", ".h"}
NAME = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-")


def _imported(tree: ast.Module, root: Path) -> Iterator[Path]:
    """Files of the modules that a module imports at its top, and of the packages that hold them."""
    for node in tree.body:
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            parts = name.split(".")
            yield from filter(None, (_file(parts[:n], root) for n in range(1, len(parts) + 1)))


def _file(parts: list[str], root: Path) -> Path | None:
    if parts[0] not in PACKAGES:
        return None
    at = root.joinpath(PACKAGES[parts[0]], *parts[1:])
    return next(filter(Path.is_file, (at / "__init__.py", at.with_suffix(".py"))), None)


def _digest(path: Path) -> str:
    """What git calls the content of a file: `git hash-object`."""
    content = path.read_bytes()
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def head() -> str | None:
    """The commit that is checked out; None outside of a repository."""
    said = _git("rev-parse", "HEAD")
    return said.strip() if said else None


def uncommitted(files: Iterable[str]) -> list[str]:
    """Those of the files that differ from the last commit; none outside of a repository."""
    said = _git("status", "--porcelain", "--untracked-files=all", "--", *files)
    return [line[3:] for line in (said or "").splitlines()]


def _git(*words: str) -> str | None:
    """What git says in the project's folder, or None where there is no git or no repository."""
    try:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (subprocess.CalledProcessError, FileNotFoundError):
        return None


def machine() -> str:
    """The processor and how many of its cores this process may use."""
    names = [line.split(":", 1)[1].strip() for line in _cpuinfo() if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {build.cores()} cores"


def _cpuinfo() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def behind(name: str) -> list[str]:
    """The files that are no longer those a result was computed from; empty for one that holds today."""
    then, now = stored(name).get("files", {}), rests_on(ROOT / "evidence" / f"{name}.py")
    changed = (path for path in then | now if then.get(path) != now.get(path))
    return sorted(path for path in changed if not (path in then and path in now and _same_code(then[path], path)))


def _same_code(digest: str, path: str) -> bool:
    """Whether a Python file does what the one of git's digest did: its code is the same, whatever it says of it."""
    before = _git("cat-file", "blob", digest) if path.endswith(".py") else None
    return before is not None and _code(before) == _code((ROOT / path).read_text())


def _code(text: str) -> str:
    """A module without its docstrings, comments and layout."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]
    return ast.dump(tree)


def stored(name: str) -> dict[str, Any]:
    """What a result file holds."""
    return json.loads((RESULTS / f"{name}.json").read_text())


def collect(name: str, items: Iterable[str], compute: Callable[[str], Any]) -> dict[str, Any]:
    """Compute every item that `name`'s result file lacks, saving after each; the whole table.

    Raises SystemExit where a file that the proof rests on is not committed: nobody could repeat the result.
    """
    path = RESULTS / f"{name}.json"
    found = stored(name)["items"] if path.exists() and not behind(name) else {}
    left = [item for item in items if item not in found]
    if left:
        files = rests_on(ROOT / "evidence" / f"{name}.py")
        if changed := uncommitted(files):
            raise SystemExit(f"{name}: a result names the commit it can be repeated from; commit {', '.join(changed)}")
        made = {"command": f"./dev evidence {name}", "machine": machine(), "commit": head()}
    for item in left:
        print(f"{name}: {item}", flush=True)
        found[item] = compute(item)
        save(path, {**made, "date": dt.date.today().isoformat(), "files": files, "items": found})
    return found


def save(path: Path, value: Any) -> None:
    """Write JSON, whole or not at all."""
    path.parent.mkdir(exist_ok=True)
    disk.write(path, (json.dumps(value, indent=1, allow_nan=False) + "\n").encode())
