"""Bit-equality of results before and after the renaming to standard terms: flights, exported C code, a certificate.

Both versions run on this machine with the installed packages, from the history of the repository. Each item compares
both outputs after a mapping of old names to new ones. A difference of a single bit is reported.
"""

from __future__ import annotations

import functools
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from colift.closed_loop import log
from evidence import ROOT, collect

BEFORE = "444a949"
"""Last commit before the renaming."""
AFTER = "a0e1cb3"
"""Commit with all renamed parts, before the control law changed."""
CASES = {
    "C1": "C1",
    "C2": "C2",
    "C3": "C3",
    "adaptive": "C4",
    "label_feedback": "F",
    "gp_label_feedback": "H",
    "true_residual": "O",
}
"""Cases whose flights are compared, and their identifiers before."""


def items() -> list[str]:
    """Return the items: one for each flight, one for the C code, one for the certificate."""
    return [*(f"flight {case}" for case in CASES), "c code", "certificate"]


@functools.cache
def outputs() -> tuple[Path, Path]:
    """Run both versions once.

    Returns:
        Folders of the results of both versions.
    """
    folder = Path(tempfile.mkdtemp(prefix="colift-renaming-"))
    old, new = folder / "old", folder / "new"
    chosen = {
        old: ["--cases", ",".join(CASES.values())],
        new: [word for case in CASES for word in ("--case", case)],
    }
    for commit, out in ((BEFORE, old), (AFTER, new)):
        subprocess.run(["git", "worktree", "add", "--detach", str(folder / commit), commit], cwd=ROOT, check=True)
        try:
            source = folder / commit / "src"
            run_version(source, ["study", "paper", *chosen[out], "--quiet", "--out", str(out / "study")])
            run_version(source, ["export", "c", "paper", "--out", str(out / "c")])
            run_version(source, ["certify", "certified", "--quiet", "--out", str(out / "certificate")])
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(folder / commit)], cwd=ROOT, check=False)
    return old, new


def run_version(source: Path, arguments: list[str]) -> None:
    """Run one command of one version.

    Args:
        source: Folder that holds the package of this version.
        arguments: Command and options.
    """
    env = {**os.environ, "PYTHONPATH": str(source)}
    subprocess.run([sys.executable, "-m", "colift", *arguments], env=env, check=True, cwd=source.parent)


def compare(item: str) -> dict[str, Any]:
    """Compare what both versions wrote for one item.

    Args:
        item: Name of the item, as in `items`.

    Returns:
        Number of compared values and the names of those that differ.
    """
    old, new = outputs()
    if item == "c code":
        return compare_code(old / "c", new / "c")
    if item == "certificate":
        return compare_certificates(old / "certificate" / "certificate.json", new / "certificate" / "certificate.json")
    case = item.removeprefix("flight ")
    return compare_flights(log.load(old / "study" / f"{CASES[case]}.nc"), log.load(new / "study" / f"{case}.nc"))


def compare_flights(old: xr.Dataset, new: xr.Dataset) -> dict[str, Any]:
    """Compare two logs bit by bit; `log.load` has upgraded the variables of the old one.

    Variables that only the new log has are not compared; they are listed. A variable that only the old log has is a
    difference.
    """
    both = sorted(str(name) for name in set(old.data_vars) & set(new.data_vars))
    lost = sorted(str(name) for name in set(old.data_vars) - set(new.data_vars))
    return {
        "variables": len(both),
        "bytes": int(sum(new[name].nbytes for name in both)),
        "not_compared": sorted(str(name) for name in set(new.data_vars) - set(old.data_vars)),
        "differ": lost + [name for name in both if old[name].values.tobytes() != new[name].values.tobytes()],
    }


def compare_code(old: Path, new: Path) -> dict[str, Any]:
    """Compare the exported C code without comments, identifiers mapped, and the recorded flight byte by byte."""
    old_numbers, new_numbers = (numbers_and_operators(path / "colift.c") for path in (old, new))
    differ = [] if old_numbers == new_numbers else ["colift.c"]
    if (old / "flight.bin").read_bytes() != (new / "flight.bin").read_bytes():
        differ.append("flight.bin")
    return {"tokens": len(new_numbers), "differ": differ}


def numbers_and_operators(path: Path) -> list[str]:
    """Return the tokens of a C file with every identifier replaced by the number of its first appearance."""
    text = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    seen: dict[str, str] = {}
    tokens = re.findall(r"[A-Za-z_]\w*|0x[0-9a-fA-F.p+-]+|[\d.]+(?:[eEp][+-]?\d+)?|\S", text)
    return [seen.setdefault(t, f"name{len(seen)}") if t[0].isalpha() or t[0] == "_" else t for t in tokens]


def compare_certificates(old: Path, new: Path) -> dict[str, Any]:
    """Compare all numbers of two certificates, in the order in which they appear."""
    old_numbers, new_numbers = (sorted(numbers(json.loads(path.read_text(encoding="utf-8")))) for path in (old, new))
    same = len(old_numbers) == len(new_numbers) and np.array_equal(old_numbers, new_numbers, equal_nan=True)
    return {"numbers": len(new_numbers), "differ": [] if same else ["certificate.json"]}


def numbers(value: Any, name: str = "") -> list[float]:
    """Return all numbers in nested data, except computation times and the schema."""
    if isinstance(value, dict):
        return [
            x for key, entry in value.items() if key not in ("wall_s", "cpu_s", "schema") for x in numbers(entry, key)
        ]
    if isinstance(value, list):
        return [x for entry in value for x in numbers(entry, name)]
    return [float(value)] if isinstance(value, int | float) and not isinstance(value, bool) else []


def main() -> bool:
    """Compare all items; each must be equal to the last bit."""
    found = collect("renaming", items(), compare)
    for item, result in found.items():
        verdict = "equal" if not result["differ"] else f"differs: {', '.join(result['differ'])}"
        new = ", ".join(result.get("not_compared", ()))
        print(f"{item:<28} {verdict}{'; not compared, only in the new log: ' + new if new else ''}")
    return not any(result["differ"] for result in found.values())


if __name__ == "__main__":
    main()
