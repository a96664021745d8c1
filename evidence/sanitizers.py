"""The exported controller runs under AddressSanitizer and UndefinedBehaviorSanitizer without a report.

`colift export c` writes the controller of a flight and the measurements of the flight. A program runs the controller on
them and prints all commands. It is built twice: as it is, and with `-fsanitize=address,undefined`. The commands must be
equal bit for bit, and no sanitizer may report.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from typer.testing import CliRunner

from colift.cli.app import app
from evidence import collect

RUNS = ("src",)  # commands import their modules when they run
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g")
FLAGS = ("-std=c99", "-Wall", "-Wextra")
PROGRAM = "sanitizers.c"


class Controller(NamedTuple):
    """Controller that is exported: scenario, case, settings of the flight [s], and ticks to replay."""

    scenario: str
    case: str
    duration: float
    ticks: int


CONTROLLERS = {
    "paper C1": Controller("paper", "C1", 6.0, 3000),
    "paper C3": Controller("paper", "C3", 6.0, 3000),
    "trio C3": Controller("trio", "C3", 6.0, 3000),
}


def run_controller(item: str) -> dict[str, Any]:
    """Return the outputs of both programs, and the reports of the sanitizers.

    Args:
        item: One of `CONTROLLERS`.
    """
    one = CONTROLLERS[item]
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "c"
        words = ["export", "c", one.scenario, "--case", one.case, "--duration", f"{one.duration:g}"]
        done = CliRunner().invoke(app, [*words, "--ticks", str(one.ticks), "--out", str(folder)])
        if done.exit_code:
            raise RuntimeError(done.output)
        plain, checked = (_commands(folder, flags) for flags in (("-O2",), ("-O1", *SANITIZERS)))
        size = sum(path.stat().st_size for path in folder.glob("*.[ch]"))
    reports = re.findall(r"(?m)^.*(?:runtime error|ERROR: \w+Sanitizer).*$", checked.stderr.decode())
    return {
        "source_bytes": size,
        "ticks": one.ticks,
        "status": [plain.returncode, checked.returncode],
        "reports": reports[:20],
        "output_bytes": len(checked.stdout),
        "output_sha256": hashlib.sha256(checked.stdout).hexdigest(),
        "equal_outputs": plain.stdout == checked.stdout,
    }


def _commands(folder: Path, flags: tuple[str, ...]) -> subprocess.CompletedProcess[bytes]:
    """Build the controller with a program that prints all commands, and run it on the flight."""
    program = folder / "commands"
    files = [str(folder / "colift.c"), str(folder / "learned.c"), str(Path(__file__).with_name(PROGRAM))]
    subprocess.run(["cc", *FLAGS, *flags, "-I", str(folder), "-o", str(program), *files, "-lm"], check=True)
    return subprocess.run(
        [str(program), str(folder / "flight.bin")],
        capture_output=True,
        check=False,
        env={"ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"},
    )


def main() -> bool:
    """Replay all controllers; no sanitizer may report, and the outputs must be equal."""
    found = collect("sanitizers", CONTROLLERS, run_controller)
    holds = True
    for item, one in found.items():
        good = not one["reports"] and one["equal_outputs"] and one["output_bytes"] > 0 and one["status"] == [0, 0]
        holds &= good
        print(
            f"{item}: {one['ticks']} ticks, {len(one['reports'])} reports, {'equal' if good else 'DIFFERENT'} outputs"
        )
        for report in one["reports"]:
            print(f"  {report}")
    return holds


if __name__ == "__main__":
    main()
