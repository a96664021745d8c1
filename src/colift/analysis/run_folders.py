"""Folders of runs: search below a folder, and reading of their summaries without their logs."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from colift.analysis import result_files
from colift.runtime import run_directory

MAX_FOLDERS = 100_000
"""Largest number of folders that a search visits."""
MAX_REASON = 300
"""Largest number of characters of a reason."""
CERTIFICATE_FILE = "certificate.json"


@dataclasses.dataclass(frozen=True)
class CaseErrors:
    """Result of one case.

    Attributes:
        case: Case id.
        complete: True if the flight did not end early.
        position_error: RMS position error over the second half [m]; NaN if there is none.
        attitude_error: RMS attitude error over the second half [1]; NaN if there is none.
    """

    case: str
    complete: bool
    position_error: float
    attitude_error: float


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """Folder with the results of one run.

    Attributes:
        path: Folder.
        damage: Reason for which the results cannot be used, in one line; empty if there is none.
        scenario: Name of the scenario.
        seed: Seed of the run.
        run: Identifier of the run.
        cases: Results of the cases; empty for a certificate.
        modified: Time at which the summary was written [s since 1970]; None for damaged results.
    """

    path: Path
    damage: str = ""
    scenario: str = ""
    seed: int | None = None
    run: str = ""
    cases: tuple[CaseErrors, ...] = ()
    modified: float | None = None


def find_runs(folder: Path, cases: Iterable[str]) -> list[RunFolder]:
    """Find all runs in a folder and below it.

    Hidden folders and links to folders are omitted.

    Args:
        folder: Folder to search.
        cases: Names of the cases whose logs identify a folder without summary.

    Returns:
        The runs in the order of their paths; damaged ones have a reason.

    Raises:
        OSError: If the folder cannot be read, or if it contains too many folders.
    """
    names = {f"{case}.nc" for case in cases}
    return [read_run(path, names) for path, files in _walk(folder) if _is_run(files, names)]


def read_run(path: Path, logs: Iterable[str] = ()) -> RunFolder:
    """Read the summary of a folder; a reason replaces its content if it cannot be used.

    Args:
        path: Folder.
        logs: Names of the files that are logs.
    """
    summary, certificate = path / run_directory.SUMMARY_FILE, path / CERTIFICATE_FILE
    try:
        if os.path.lexists(summary):
            return _read_summary(path, result_files.load_summary(summary), summary.stat().st_mtime)
        if any(os.path.lexists(path / name) for name in logs):
            return RunFolder(path, f"contains logs, but no {summary.name}: its study did not end")
        found = result_files.load_certificate(certificate)
        return RunFolder(path, "", *_identity(found), modified=certificate.stat().st_mtime)
    except KeyError as error:
        return RunFolder(path, f"{summary.name} is damaged: no entry {error}")
    except (TypeError, AttributeError, OverflowError) as error:
        return RunFolder(path, _one_line(f"{summary.name} is damaged: {error}"))
    except (OSError, ValueError) as error:
        message = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        return RunFolder(path, _one_line(message.replace(f"{path}{os.sep}", "")))


def _walk(folder: Path) -> Iterator[tuple[Path, set[str]]]:
    """Yield each folder below a folder with the names of its files."""

    def refuse(error: OSError) -> None:
        if error.filename is None or Path(error.filename) == folder:
            raise error

    for number, (path, folders, files) in enumerate(os.walk(folder, onerror=refuse)):
        if number >= MAX_FOLDERS:
            raise OSError(f"{folder} contains more than {MAX_FOLDERS} folders: choose a smaller folder")
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield Path(path), set(files)


def _is_run(files: set[str], logs: set[str]) -> bool:
    """Return whether files belong to a run."""
    return bool(files & (logs | {run_directory.SUMMARY_FILE, CERTIFICATE_FILE}))


def _read_summary(path: Path, summary: dict[str, Any], modified: float) -> RunFolder:
    """Return the run of a summary; an entry with a wrong type raises TypeError."""
    cases = tuple(
        CaseErrors(str(case), bool(found["complete"]), _number(found["e_p_rms_m"]), _number(found["e_R_rms"]))
        for case, found in summary["cases"].items()
    )
    return RunFolder(path, "", *_identity(summary), cases=cases, modified=modified)


def _identity(content: dict[str, Any]) -> tuple[str, int, str]:
    """Return scenario, seed and run of a result file."""
    seed = content["seed"]
    if not isinstance(seed, int):
        raise TypeError(f"seed is {seed!r}, not an integer")
    return str(content["scenario"]), seed, str(content.get("run", ""))


def _number(value: Any) -> float:
    """Return a number of a summary; NaN for null."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise TypeError(f"{value!r} is not a number")
    return math.nan if value is None else float(value)


def _one_line(text: str) -> str:
    """Return a text in one line of limited length."""
    line = " ".join(text.split())
    return line if len(line) <= MAX_REASON else f"{line[:MAX_REASON]}…"
