"""The folder of one run's results: it holds the files of one run, and one process at a time writes to it.

Every file names its run in its own way: an attribute of a NetCDF file, an entry of JSON, a keyword of a figure, a
column or a line of a table. The name is the same string in all of them, and is found by looking for it.
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

LOCK = ".colift.lock"
NAME = re.compile(rb"colift-run-([0-9a-f]{12})(?![0-9a-f])")


@dataclasses.dataclass(frozen=True)
class RunDirectory:
    """A folder that this process alone writes to, for the files of one run."""

    path: Path
    run_id: str


def run_id(version: str, digest: str) -> str:
    """The name of a run: it differs when the version does or any setting, the seed among them."""
    return f"colift-run-{hashlib.sha256(f'{version} {digest}'.encode()).hexdigest()[:12]}"


@contextlib.contextmanager
def lock_run_directory(path: Path, run: str, names: Sequence[str]) -> Generator[RunDirectory]:
    """Make a folder and write to it alone, under a lock that is released however the block ends.

    `names`, with `*` for any text, are those of the files that the run may write or replace. A lock whose process has
    ended is taken over; on another computer's it cannot be known. Raises OSError, in one line, where the folder cannot
    be written, where another process writes to it, or where colift did not write a file that has one of the names.
    """
    _prepare(path)
    with contextlib.ExitStack() as held:
        _lock(path / LOCK, held)
        _clear_parts(path)
        foreign = [file.name for file in list_files(path, names) if read_run_id(file) is None]
        if foreign:
            raise OSError(
                f"{path} holds {', '.join(foreign)}, which no run of colift wrote: move it, or choose another --out"
            )
        yield RunDirectory(path, run)


def list_files(path: Path, names: Sequence[str]) -> list[Path]:
    """The files of a folder that have one of the names."""
    return sorted({file for name in names for file in path.glob(name)})


def read_run_id(file: Path) -> str | None:
    """The name of the run that a file states; None if it states none."""
    found = NAME.search(file.read_bytes())
    return None if found is None else found.group().decode()


def stale_files(folder: RunDirectory, names: Sequence[str]) -> list[Path]:
    """The files under the names that are of another run than the folder's."""
    return [file for file in list_files(folder.path, names) if read_run_id(file) not in (None, folder.run_id)]


def remove_stale_files(folder: RunDirectory, names: Sequence[str], others: Sequence[str]) -> None:
    """Remove the files under `names`, of whatever run, and those under `others` that are of another run than this."""
    for file in list_files(folder.path, names) + stale_files(folder, others):
        file.unlink(missing_ok=True)


def _prepare(path: Path) -> None:
    """Make the folder and see that it can be written, now rather than after the flights."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except FileExistsError:
        raise OSError(f"cannot write to {path}: it is a file, not a folder") from None
    except OSError as error:
        raise OSError(error.errno, f"cannot write to {path}: {error.strerror or error}") from None


def _clear_parts(path: Path) -> None:
    """Remove what killed processes left half written: under the lock, nothing else is being written."""
    for part in path.glob(".*.[0-9]*.part"):
        part.unlink(missing_ok=True)


# The lock -------------------------------------------------------------------------------------------------------------


def _lock(lock: Path, held: contextlib.ExitStack) -> None:
    """Make the lock file, which one process can (O_EXCL, over NFS too); it says who holds it."""
    me = {"host": socket.gethostname(), "pid": os.getpid(), "began": _began(os.getpid()), "since": int(time.time())}
    mine = json.dumps({**me, "claim": secrets.token_hex(8)}).encode()  # one process may claim twice
    held.enter_context(signals.on_exit(lambda: _release(lock, mine)))
    while True:
        try:
            with lock.open("xb", buffering=0) as file:
                file.write(mine)
            return
        except FileExistsError:
            _take_over(lock)
        except OSError as error:
            lock.unlink(missing_ok=True)
            raise OSError(error.errno, f"cannot write {lock}: {error.strerror}") from None


def _release(lock: Path, mine: bytes) -> None:
    """Remove the lock if it is this claim's."""
    with contextlib.suppress(FileNotFoundError):
        if lock.read_bytes() == mine:
            lock.unlink()


def _take_over(lock: Path) -> None:
    """Remove a lock whose process has ended; OSError where it has not, or may not have.

    One process at a time: a lock that is stale here cannot have become another's by the time it is removed.
    """
    with _alone(lock.parent):
        found = _read(lock)
        if found is None:
            return
        _, holder = found
        if holder is not None:
            here = holder["host"] == socket.gethostname()
            if not here or _lives(holder["pid"], holder["began"]):
                since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(holder["since"]))
                who = f"process {holder['pid']} on {holder['host']} writes to it since {since}"
                gone = "" if here else f"; if that process has ended, remove {lock}"
                raise BlockingIOError(f"{lock.parent} is in use: {who}; wait, or choose another --out{gone}")
        lock.unlink(missing_ok=True)


@contextlib.contextmanager
def _alone(path: Path) -> Generator[None]:
    """One process of this computer at a time is in the block, as far as the folder's file system knows such locks."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _read(lock: Path) -> tuple[bytes, dict[str, Any] | None] | None:
    """A lock file and who holds it: nobody where it does not say so, though there was time to write it."""
    content = b""
    for _ in range(20):
        try:
            content = lock.read_bytes()
            holder = json.loads(content)
            kinds = {"host": str, "pid": int, "began": str, "since": float}
            return content, {key: kind(holder[key]) for key, kind in kinds.items()}
        except FileNotFoundError:
            return None
        except (ValueError, TypeError, KeyError):  # made but not yet written
            time.sleep(0.05)
    return content, None


def _lives(pid: int, began: str) -> bool:
    """Whether that process runs on this computer, and is no later one under the same number."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        pass
    return _began(pid) == began


def _began(pid: int) -> str:
    """When a process began, in the kernel's ticks since the computer did.

    Empty where the system does not say: the number alone must then tell. `ended` where only its entry is left.
    """
    try:
        state, *after = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "ended" if state in "ZX" else after[18]
