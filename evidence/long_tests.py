"""Results of the tests with mark `long`, which `./dev test` omits: numbers of passed and failed tests per file."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from evidence import ROOT, collect

RUNS = ("src", "tests", "evidence", "benchmarks")  # in child processes


def files() -> list[str]:
    """Return test files, relative to the project, that contain the mark `long`."""
    marked = (path for path in (ROOT / "tests").rglob("test_*.py") if "pytest.mark.long" in path.read_text())
    return sorted(path.relative_to(ROOT).as_posix() for path in marked)


def run(file: str) -> dict[str, Any]:
    """Return the results of a file's long tests in a child process."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "-m", "long", f"--junitxml={report}", file]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):  # 1: some failed
            raise SystemExit(f"{file}: pytest ended with {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        cases = list(ET.parse(report).getroot().iter("testcase"))
    outcome = {case.get("name", ""): {child.tag for child in case} for case in cases}
    return {
        "passed": sum(not tags & {"failure", "error", "skipped"} for tags in outcome.values()),
        "skipped": sorted(name for name, tags in outcome.items() if "skipped" in tags),
        "failed": sorted(name for name, tags in outcome.items() if tags & {"failure", "error"}),
        "duration_s": round(sum(float(case.get("time", 0)) for case in cases), 1),
    }


def main() -> bool:
    """Print the results of each file; no test may fail."""
    found = collect("long_tests", files(), run)
    for file in files():
        each = found[file]
        print(
            f"{file}: {each['passed']} passed in {each['duration_s']:.0f} s"
            + "".join(f", FAILED {x}" for x in each["failed"])
        )
    return not any(each["failed"] for each in found.values())


if __name__ == "__main__":
    main()
