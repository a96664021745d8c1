"""Result folder of one run, to which one process at a time writes.

Every result file contains the identifier of its run: as an attribute of a NetCDF file, an entry of a JSON file, a
keyword of a figure, or a column or line of a table. It is the same string in all files, so a text search finds it.

See Also:
    docs/decisions/0018-keep-one-run-per-directory: reasons.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import json
import os
import re
import secrets
import socket
import tempfile
import time
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from colift.runtime import signals

LOCK_FILE = ".colift.lock"
"""Name of the lock file in a run directory."""
RUN_ID_PATTERN = re.compile(rb"colift-run-([0-9a-f]{12})")
"""Identifier of a run as it appears in files."""


@dataclasses.dataclass(frozen=True)
class RunDirectory:
    """Folder that is locked for the files of one run.

    Attributes:
        path: The folder.
        run_id: Identifier of the run.
    """

    path: Path
    run_id: str


def run_id(version: str, digest: str) -> str:
    """Return the identifier of a run; it depends on the version and on all settings, including the seed.

    Args:
        version: Version of the package.
        digest: Digest of the settings.
    """
    return f"colift-run-{hashlib.sha256(f'{version} {digest}'.encode()).hexdigest()[:12]}"


@contextlib.contextmanager
def lock_run_directory(path: Path, run_id: str, patterns: Sequence[str]) -> Generator[RunDirectory]:
    """Create a folder and lock it for this process; the lock is removed when the block ends.

    A lock of a process that has ended is removed. A lock of another computer is respected, because its process cannot
    be checked. Raises BlockingIOError, an OSError, if another process writes to the folder.

    Args:
        path: Folder.
        run_id: Identifier of the run.
        patterns: Names of the files that the run may write or replace, with `*` as a wildcard.

    Yields:
        The locked folder.

    Raises:
        OSError: If the folder cannot be written, or if a file with one of the names was not written by colift.
    """
    _create_directory(path)
    with contextlib.ExitStack() as stack:
        _lock(path / LOCK_FILE, stack)
        _remove_partial_files(path)
        foreign = [file.name for file in list_files(path, patterns) if read_run_id(file) is None]
        if foreign:
            raise OSError(
                f"{path} contains {', '.join(foreign)}, which colift did not write: move it, or choose another --out"
            )
        yield RunDirectory(path, run_id)


def list_files(path: Path, patterns: Sequence[str]) -> list[Path]:
    """List the files of a folder that match one of the patterns.

    Args:
        path: Folder.
        patterns: Names of files, with `*` as a wildcard.

    Returns:
        The files in alphabetical order.
    """
    return sorted({file for pattern in patterns for file in path.glob(pattern)})


def read_run_id(file: Path) -> str | None:
    """Return the identifier of the run that a file contains; None if it contains none.

    Args:
        file: Result file of any format.
    """
    found = RUN_ID_PATTERN.search(file.read_bytes())
    return None if found is None else found.group().decode()


def stale_files(directory: RunDirectory, patterns: Sequence[str]) -> list[Path]:
    """List the matching files that belong to another run than the directory.

    Args:
        directory: Locked folder.
        patterns: Names of files, with `*` as a wildcard.

    Returns:
        The files in alphabetical order; files without an identifier are not listed.
    """
    return [file for file in list_files(directory.path, patterns) if read_run_id(file) not in (None, directory.run_id)]


def remove_stale_files(directory: RunDirectory, patterns: Sequence[str], other_patterns: Sequence[str]) -> None:
    """Remove files of earlier runs.

    Args:
        directory: Locked folder.
        patterns: Names of files that are removed whatever their run, with `*` as a wildcard.
        other_patterns: Names of files that are removed only if they belong to another run.
    """
    for file in list_files(directory.path, patterns) + stale_files(directory, other_patterns):
        file.unlink(missing_ok=True)


def _create_directory(path: Path) -> None:
    """Create the folder and check that it can be written, so that errors occur before the simulation."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except FileExistsError:
        raise OSError(f"cannot write to {path}: it is a file, not a folder") from None
    except OSError as error:
        raise OSError(error.errno, f"cannot write to {path}: {error.strerror or error}") from None


def _remove_partial_files(path: Path) -> None:
    """Remove partial files of killed processes; under the lock no other process writes files."""
    for part in path.glob(".*.[0-9]*.part"):
        part.unlink(missing_ok=True)


# The lock -------------------------------------------------------------------------------------------------------------


def _lock(lock: Path, stack: contextlib.ExitStack) -> None:
    """Create the lock file with the owner's identity; O_EXCL admits one process, also over NFS."""
    owner = {
        "host": socket.gethostname(),
        "pid": os.getpid(),
        "began": _start_time(os.getpid()),
        "since": int(time.time()),
    }
    content = json.dumps({**owner, "claim": secrets.token_hex(8)}).encode()  # one process may lock several times
    stack.enter_context(signals.on_exit(lambda: _release(lock, content)))
    while True:
        try:
            with lock.open("xb", buffering=0) as file:
                file.write(content)
            return
        except FileExistsError:
            _remove_stale_lock(lock)
        except OSError as error:
            lock.unlink(missing_ok=True)
            raise OSError(error.errno, f"cannot write {lock}: {error.strerror}") from None


def _release(lock: Path, content: bytes) -> None:
    """Remove the lock file if it has this content."""
    with contextlib.suppress(FileNotFoundError):
        if lock.read_bytes() == content:
            lock.unlink()


def _remove_stale_lock(lock: Path) -> None:
    """Remove a lock whose process has ended.

    One process at a time executes this, so a stale lock cannot be replaced by a new one before it is removed.

    Raises:
        BlockingIOError: If the process runs, or is on another computer.
    """
    with _exclusive(lock.parent):
        found = _read_lock(lock)
        if found is None:
            return
        _, owner = found
        if owner is not None:
            is_local = owner["host"] == socket.gethostname()
            if not is_local or _is_running(owner["pid"], owner["began"]):
                since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(owner["since"]))
                process = f"process {owner['pid']} on {owner['host']} has been writing to it since {since}"
                remedy = "" if is_local else f"; if that process has ended, remove {lock}"
                raise BlockingIOError(f"{lock.parent} is in use: {process}; wait, or choose another --out{remedy}")
        lock.unlink(missing_ok=True)


@contextlib.contextmanager
def _exclusive(path: Path) -> Generator[None]:
    """Admit one process of this computer at a time to the block, if the file system supports such locks."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _read_lock(lock: Path) -> tuple[bytes, dict[str, Any] | None] | None:
    """Return content and owner of a lock file; no owner if it stays invalid for a second, None if there is no file."""
    content = b""
    for _ in range(20):
        try:
            content = lock.read_bytes()
            owner = json.loads(content)
            kinds = {"host": str, "pid": int, "began": str, "since": float}
            return content, {key: kind(owner[key]) for key, kind in kinds.items()}
        except FileNotFoundError:
            return None
        except (ValueError, TypeError, KeyError):  # created, but not yet written
            time.sleep(0.05)
    return content, None


def _is_running(pid: int, began: str) -> bool:
    """Return whether the process runs on this computer; its start time excludes a later process of the same number."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # process of another user
        pass
    return _start_time(pid) == began


def _start_time(pid: int) -> str:
    """Return the start time of a process in kernel ticks; empty if unavailable, `ended` for a zombie process."""
    try:
        state, *after = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "ended" if state in "ZX" else after[18]
