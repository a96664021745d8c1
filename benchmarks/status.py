"""`./dev bench --status`: whether the stored results are complete, comparable and of the current release.

A result is behind if its machine differs from that of most results, if its release of colift or a locked package is
another one, if the code of the benchmark or of the measurement (`benchmarks/__init__.py`) changed, or if it contains no
figures or was measured with uncommitted files. Other code changes with every commit; the number of files is printed.
"""

from __future__ import annotations

import collections
import json
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

from benchmarks import NAMES

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
MEASUREMENT = "benchmarks/__init__.py"
LIST_OF_NAMES = re.compile(r"^NAMES = \(.*?^\)$", re.MULTILINE | re.DOTALL)


def stored(folder: Path = RESULTS) -> dict[str, dict[str, Any]]:
    """Return the stored results by name."""
    return {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}


def current_versions(root: Path = ROOT) -> dict[str, str]:
    """Return the release of colift and the locked versions of the packages."""
    locked = re.findall(
        r"^([\w.-]+)==([\w.+!-]+)",
        "\n".join(path.read_text() for path in sorted((root / "requirements").glob("*.txt"))),
        re.MULTILINE,
    )
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    return dict(locked) | {project["name"]: project["version"]}


def changed_files(result: dict[str, Any], root: Path = ROOT) -> list[str]:
    """Return the files behind a result that differ from those of its measurement."""
    from evidence import dependencies

    def digest(path: Path) -> str | None:
        return dependencies.digest(path.read_bytes()) if path.is_file() else None

    return [name for name, stored_digest in result["files"].items() if digest(root / name) != stored_digest]


def _is_own(path: str) -> bool:
    """Return whether a file is code of the benchmarks."""
    return path.startswith("benchmarks/")


def _adds_names_only(stored_digest: str, root: Path) -> bool:
    """Return whether the code of the measurement differs from a version in the list of names only.

    A version that git does not have counts as equal.
    """
    from evidence import dependencies

    try:
        command = ["git", "cat-file", "blob", stored_digest]
        before = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (subprocess.CalledProcessError, FileNotFoundError):
        return True
    texts = (LIST_OF_NAMES.sub("", text) for text in (before, (root / MEASUREMENT).read_text()))
    return len({dependencies.meaning(text, ".py") for text in texts}) == 1


def _changed_own_files(result: dict[str, Any], root: Path) -> list[str]:
    """Return the changed files of the benchmark and of the measurement."""
    changed = [path for path in changed_files(result, root) if _is_own(path)]
    exists = (root / MEASUREMENT).is_file()
    if exists and MEASUREMENT in changed and _adds_names_only(result["files"][MEASUREMENT], root):
        changed.remove(MEASUREMENT)
    return changed


def reasons_behind(folder: Path = RESULTS, root: Path = ROOT) -> dict[str, list[str]]:
    """Return for each benchmark why its result is behind; an empty list for a current one."""
    results, versions = stored(folder), current_versions(root)
    machines = collections.Counter(result["machine"] for result in results.values())
    usual = machines.most_common(1)[0][0] if machines else ""
    found: dict[str, list[str]] = {}
    for name in NAMES:
        if name not in results:
            found[name] = ["no result"]
            continue
        result = results[name]
        reasons = [f"machine {result['machine']} instead of {usual}"] if result["machine"] != usual else []
        reasons += [
            f"{package} {version} instead of {versions[package]}"
            for package, version in result["versions"].items()
            if version != "absent" and versions.get(package, version) != version
        ]
        reasons += [f"{path} changed" for path in _changed_own_files(result, root)]
        reasons += [f"measured with uncommitted {path}" for path in result["uncommitted"]]
        reasons += [] if result["figures"] or result["omitted"] else ["no figures"]
        found[name] = reasons
    return found


def main(folder: Path = RESULTS) -> int:
    """Print the state of each result; return 1 if one is behind."""
    results, behind = stored(folder), reasons_behind(folder)
    for name, reasons in behind.items():
        text = "; ".join(reasons) or "current"
        if name in results:
            others = [path for path in changed_files(results[name]) if not _is_own(path)]
            text = f"{results[name]['date']}: {text}; {len(others)} other files changed since"
        print(f"{name:<15} {text}")
    return 1 if any(behind.values()) else 0
