"""Damaged summaries, certificates and logs: every command that opens them ends with status 2 and one line.

The results of a short study with a certificate are copied and one file is damaged. Each command of the command line
that opens results then runs on the copy, in this process.
"""

from __future__ import annotations

import functools
import io
import shutil
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from colift.cli.app import app
from evidence import collect
from tests.support import small_team
from tests.support.damages import DAMAGES

RUNS = ("src",)  # commands import their modules when they run
FILES = ("summary.json", "certificate.json", "C3.nc")
READERS = {
    "playback": ("C3.nc",),
    "playback --image": ("C3.nc",),
    "playback --video": ("C3.nc",),
    "report": FILES,
    "compare": ("summary.json", "C3.nc"),
    "browse": ("summary.json",),  # a damaged run is a row of the page
    "export csv": ("C3.nc",),
    "export mcap": ("C3.nc",),
    "study": ("summary.json", "C3.nc"),
    "migrate": FILES,
}
"""Commands, and the files that each of them opens."""
STUDY_DAMAGES = ("empty file", "truncated before the end", "missing variable", "missing entry")


@functools.cache
def _results() -> tempfile.TemporaryDirectory[str]:
    """Return a folder with a scenario, results of C1 and C3, and a certificate."""
    work = tempfile.TemporaryDirectory()
    learning = {"update_times_s": (0.2,), "start_s": 0.05, "end_s": 0.2, "max_samples": 8}
    scenario = small_team.write(
        Path(work.name) / "small.yaml",
        duration_s=0.4,
        learning=small_team.SAMPLE.learning.model_copy(update=learning),
    )
    out = str(Path(work.name) / "whole")
    for command in (["study", str(scenario), "--case", "C1,C3"], ["certify", str(scenario)]):
        done = CliRunner().invoke(app, [*command, "--out", out, "-q"])
        assert done.exit_code == 0, done.output
    return work


def _command(name: str, work: Path, out: Path, file: str) -> list[str]:
    """Return the arguments of a command on the folder of damaged results."""
    media = {"playback --image": out.parent / "image.png", "playback --video": out.parent / "video.gif"}
    if name in media:
        return [*name.split(), str(media[name]), str(out)]
    if name == "compare":
        return [name, str(work / "whole"), str(out), "--out", str(out.parent / "comparison")]
    if name == "browse":
        return [name, str(out.parent)]
    if name == "study":
        return [name, str(work / "small.yaml"), "--case", "C2", "--out", str(out), "-q"]
    return [name, str(out / file)] if name == "migrate" else [*name.split(), str(out)]


def _applies(name: str, file: str, damage: str) -> bool:
    """Return whether a command opens a file; a study only for some damages, since it prepares its flights first."""
    return file in READERS[name] and (name != "study" or damage in STUDY_DAMAGES)


def run_commands(item: str) -> dict[str, Any]:
    """Return status and message of each command on results with one damaged file, and the faults.

    Args:
        item: File and damage.
    """
    file, _, damage = item.partition(": ")
    work = Path(_results().name)
    answers, faults = {}, []
    for name in READERS:
        if not _applies(name, file, damage):
            continue
        with tempfile.TemporaryDirectory() as place:
            out = Path(place) / "runs" / "out"
            shutil.copytree(work / "whole", out)
            DAMAGES[damage].apply(out / file)
            before = sorted(path.name for path in out.iterdir())
            done = CliRunner().invoke(app, _command(name, work, out, file))
            page = out.parent / "index.html"
            listed = page.exists() and "damaged: " in page.read_text()
            answers[name] = {"status": done.exit_code, "message": done.stderr.replace(place, "").strip()[-300:]}
            certain = DAMAGES[damage].certain and name != "browse"
            faults += [f"{name}: {each}" for each in _faults(done, certain, file)]
            if name == "browse" and DAMAGES[damage].certain and not listed:
                faults.append(f"{name}: lists no damaged run")
            if done.exit_code and sorted(path.name for path in out.iterdir()) != before:
                faults.append(f"{name}: the files of the folder have changed")
    return {"answers": answers, "faults": faults}


def _faults(done: Any, certain: bool, file: str) -> Iterator[str]:
    """Yield the faults of the exit status and the message of a command."""
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        trace = io.StringIO()
        traceback.print_exception(done.exception, file=trace)
        yield f"ends with a traceback: {trace.getvalue()[-800:]}"
    elif done.exit_code not in (0, 2):
        yield f"status {done.exit_code}"
    elif done.exit_code == 2 and (done.stderr.count("\n") != 1 or file not in done.stderr):
        yield f"the message is not one line with the name of the file: {done.stderr[-500:]}"
    if certain and done.exit_code != 2:
        yield "does not refuse the file"


def main() -> bool:
    """Run all commands on all damaged files; each must end with one line."""
    items = [
        f"{file}: {name}" for file in FILES for name, damage in DAMAGES.items() if Path(file).suffix in damage.suffixes
    ]
    found = collect("damage", items, run_commands)
    runs = sum(len(found[item]["answers"]) for item in items)
    faults = [f"{item}: {fault}" for item in items for fault in found[item]["faults"]]
    print(f"{len(items)} damaged files, {runs} commands, {len(faults)} faults")
    for fault in faults:
        print(fault)
    return not faults


if __name__ == "__main__":
    main()
