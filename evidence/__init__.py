"""Proofs that take longer than a test: each writes one dated JSON file under `evidence/results`, and can be resumed.

A proof is a module here with `main()`. It keeps what it has computed in its result file, item by item, and skips
what is there already, as long as the file was made by the same version of the package's source.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import colift
from colift.native import build

RESULTS = Path(__file__).parent / "results"


def source() -> str:
    """Twelve digits that change with any line of the package: results of another source are computed afresh."""
    digest = hashlib.sha256()
    folder = Path(colift.__file__).parent
    for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.yaml")]):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def machine() -> str:
    """The processor and how many of its cores this process may use."""
    names = [line.split(":", 1)[1].strip() for line in _cpuinfo() if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {build.cores()} cores"


def _cpuinfo() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def collect(name: str, items: Iterable[str], compute: Callable[[str], Any]) -> dict[str, Any]:
    """Compute every item that `name`'s result file lacks, saving after each; the whole table.

    The file says when, on which machine, with which command and from which source it was made.
    """
    path = RESULTS / f"{name}.json"
    made = {"command": f"./dev evidence {name}", "machine": machine(), "source": source()}
    found: dict[str, Any] = {}
    if path.exists():
        before = json.loads(path.read_text())
        if before["source"] == made["source"]:
            found = before["items"]
    for item in items:
        if item not in found:
            print(f"{name}: {item}", flush=True)
            found[item] = compute(item)
            save(path, {**made, "date": dt.date.today().isoformat(), "items": found})
    return found


def save(path: Path, value: Any) -> None:
    """Write JSON under a temporary name, then rename."""
    path.parent.mkdir(exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n")
    temporary.replace(path)
