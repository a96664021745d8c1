"""Result folder of one run, to which one process at a time writes, and which is replaced by one rename.

Every result file contains the identifier of its run: as an attribute of a NetCDF file, an entry of a JSON file, a
keyword of a figure, or a column or line of a table. It is the same string in all files, so a text search finds it.

A command writes to a hidden folder beside the results, which first receives the earlier files of the same run. At the
end of the command the two folders are exchanged. A reader, also after a crash, finds all earlier or all new results.

See Also:
    docs/decisions/0018-keep-one-run-per-directory: reasons.
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import errno
import fcntl
import hashlib
import json
import os
import re
import secrets
import shutil
import socket
import sys
import time
from collections.abc import Generator, Iterable, Sequence
from pathlib import Path
from typing import Any

from colift.runtime import bounded_read, signals

LOCK_SUFFIX = ".colift.lock"
"""Suffix of the hidden lock file beside a run directory."""
MAX_LOCK_BYTES = 2**12
"""Largest lock file [bytes]; those of colift have 200."""
RUN_ID_PATTERN = re.compile(rb"colift-run-([0-9a-f]{12})")
"""Identifier of a run as it appears in files."""
SUMMARY_FILE = "summary.json"


@dataclasses.dataclass(frozen=True)
class RunDirectory:
    """Folder that is locked for the files of one run.

    Attributes:
        path: Hidden folder to which the files are written.
        target: Folder that contains the files after the command, as it was given.
        run_id: Identifier of the run.
        replaced: Description of the earlier results that are removed; None if there are none.
    """

    path: Path
    target: Path
    run_id: str
    replaced: str | None = None


def run_id(version: str, digest: str) -> str:
    """Return the identifier of a run; it depends on the version and on all settings, including the seed.

    Args:
        version: Version of the package.
        digest: Digest of the settings.
    """
    return f"colift-run-{hashlib.sha256(f'{version} {digest}'.encode()).hexdigest()[:12]}"


@contextlib.contextmanager
def stage_run_directory(
    target: Path,
    run_id: str,
    patterns: Sequence[str],
    *,
    replace: bool = False,
    keep_on_interrupt: bool = False,
) -> Generator[RunDirectory]:
    """Lock a folder for this process, and replace it by one rename when the block ends without an error.

    The block writes to the hidden folder `RunDirectory.path`. It contains the files of the target that belong to the
    same run, and all files that colift did not write. If the block raises, the target stays as it was. A lock of a
    process that has ended is removed. A lock of another computer is respected, because its process cannot be checked.
    Raises BlockingIOError, an OSError, if another process writes to the folder.

    Args:
        target: Folder of the results.
        run_id: Identifier of the run.
        patterns: Names of the files that the run may write or replace, with `*` as a wildcard.
        replace: Whether to remove all earlier results.
        keep_on_interrupt: Whether the files are also valid results if the block raises `signals.Interrupted`. They
            replace no results of another run, which are removed by complete results only.

    Yields:
        The locked folder.

    Raises:
        OSError: If the folder cannot be written, if it contains results of another run and `replace` is false, or if a
            file with one of the names was not written by colift.
        Interrupted: If the block raises it.
    """
    given, target = target, _resolve_target(target)
    staging = target.parent / f".{target.name}.{os.getpid()}.new"
    with contextlib.ExitStack() as stack:
        _lock(target.parent / f".{target.name}{LOCK_SUFFIX}", target, stack)
        _recover(target)
        stack.callback(shutil.rmtree, staging, ignore_errors=True)
        replaced = _check_contents(target, run_id, patterns, replace)
        _copy_contents(target, staging, patterns if replaced else ())
        try:
            yield RunDirectory(staging, given, run_id, replaced)
        except signals.Interrupted:
            if keep_on_interrupt and replaced is None:
                _publish(staging, target)
            raise
        _publish(staging, target)


@contextlib.contextmanager
def lock_directory(target: Path) -> Generator[Path]:
    """Lock a folder to which files are added one by one; create it if it does not exist.

    Raises BlockingIOError, an OSError, if another process writes to the folder. A lock of a process that has ended is
    removed.

    Args:
        target: Folder.

    Yields:
        Absolute path of the folder.

    Raises:
        OSError: If the folder cannot be written.
    """
    resolved = _resolve_target(target)
    with contextlib.ExitStack() as stack:
        _lock(resolved.parent / f".{resolved.name}{LOCK_SUFFIX}", target, stack)
        try:
            resolved.mkdir(exist_ok=True)
        except OSError as error:
            raise OSError(error.errno, f"cannot write to {target}: {error.strerror}") from None
        yield resolved


def written_files(folder: RunDirectory, patterns: Sequence[str]) -> list[str]:
    """Return the names of the files that the command has written until now.

    Args:
        folder: Folder of the command.
        patterns: Names of files, with `*` as a wildcard.
    """
    files = [(file, folder.target / file.name) for file in list_files(folder.path, patterns)]
    return [file.name for file, earlier in files if not (earlier.exists() and earlier.samefile(file))]


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
    found = RUN_ID_PATTERN.search(bounded_read.read_bytes(file, bounded_read.MAX_LOG_BYTES))
    return None if found is None else found.group().decode()


def refuse_foreign_files(files: Iterable[Path]) -> None:
    """Raise OSError if one of the files exists and contains no identifier of a run, so colift did not write it.

    Args:
        files: Files to be replaced.

    Raises:
        OSError: If there is such a file.
    """
    for file in files:
        if file.exists() and read_run_id(file) is None:
            raise OSError(f"{file.parent} contains {file.name}, which colift did not write: move it")


# The exchange of folders ----------------------------------------------------------------------------------------------


def _resolve_target(path: Path) -> Path:
    """Return the absolute path of the target folder, and create its parents."""
    try:
        target = path.resolve()
        if target.exists() and not target.is_dir():
            raise OSError(f"cannot write to {path}: it is a file, not a folder")
        if os.path.ismount(target):
            raise OSError(f"cannot write to {path}: it is the root of a file system; choose a folder below it")
        if not target.name or Path.cwd().is_relative_to(target):
            raise OSError(f"cannot write to {path}: it contains the current folder; choose a folder below it")
        target.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise OSError(f"cannot write to {path}: a part of the path is a file, not a folder") from None
    except OSError as error:
        raise (
            error if error.errno is None else OSError(error.errno, f"cannot write to {path}: {error.strerror}")
        ) from None
    return target


def _recover(target: Path) -> None:
    """Remove hidden folders of killed processes; restore the target if a process was killed between two renames."""
    previous = _previous(target)
    if previous.exists() and not target.exists():
        previous.rename(target)
    # a glob would also match the folders of a target `NAME.5`, which another process may be writing
    staged = re.compile(rf"\.{re.escape(target.name)}\.[0-9]+\.new")
    for leftover in (previous, *(path for path in target.parent.iterdir() if staged.fullmatch(path.name))):
        shutil.rmtree(leftover, ignore_errors=True)


def _previous(target: Path) -> Path:
    """Return the name of the replaced folder on file systems that cannot exchange two folders by one rename."""
    return target.parent / f".{target.name}.previous"


def _check_contents(target: Path, run_id: str, patterns: Sequence[str], replace: bool) -> str | None:
    """Return a description of the earlier results to remove; None if there are none."""
    files = {file: read_run_id(file) for file in list_files(target, patterns)}
    if foreign := [file.name for file, run in files.items() if run is None]:
        raise OSError(
            f"{target} contains {', '.join(foreign)}, which colift did not write: move it, or choose another --out"
        )
    others = sorted({run for run in files.values() if run not in (None, run_id)})
    if not others and not (replace and files):
        return None
    described = _describe(target, others)
    if not replace:
        raise OSError(f"{target} contains {described}: choose another --out, or remove these results by --replace")
    return described


def _describe(target: Path, runs: Sequence[str | None]) -> str:
    """Describe the results in a folder; without runs, they belong to the run itself."""
    try:
        found = bounded_read.read_json(target / SUMMARY_FILE)
        details = f"{found['scenario']}, seed {found['seed']}, colift {found['version']}"
    except (OSError, ValueError, KeyError, TypeError):
        details = ", ".join(map(str, runs)) or "no readable summary"
    return f"{'results of another run' if runs else 'earlier results of this run'} ({details})"


def _copy_contents(target: Path, staging: Path, excluded: Sequence[str]) -> None:
    """Create the hidden folder with links to the contents of the target, except the excluded names.

    Results are written to new files and renamed, so a link never changes the file of the target.
    """
    skipped = {file.name for file in list_files(target, excluded)}
    try:
        staging.mkdir()
        for entry in sorted(target.iterdir()) if target.exists() else ():
            if entry.name in skipped or re.fullmatch(r"\..*\.[0-9]+\.part", entry.name):
                continue
            if entry.is_dir() and not entry.is_symlink():
                shutil.copytree(entry, staging / entry.name, symlinks=True, copy_function=_link)
            else:
                _link(entry, staging / entry.name)
        if target.exists():
            shutil.copystat(target, staging)
    except OSError as error:
        raise OSError(error.errno, f"cannot write to {target}: {error.strerror or error}") from None


def _link(source: str | Path, link: str | Path) -> None:
    """Create a hard link; copy the file on file systems without hard links."""
    try:
        os.link(source, link, follow_symlinks=False)
    except OSError:
        shutil.copy2(source, link, follow_symlinks=False)


def _publish(staging: Path, target: Path) -> None:
    """Exchange the hidden folder with the target, durably."""
    try:
        _sync(staging)
        if not target.exists() or not any(target.iterdir()):
            staging.rename(target)
        elif not _exchange(staging, target):
            previous = _previous(target)
            target.rename(previous)
            try:
                staging.rename(target)
            except OSError:
                previous.rename(target)
                raise
            shutil.rmtree(previous, ignore_errors=True)
        _sync(target.parent)
    except OSError as error:
        raise OSError(error.errno, f"cannot write to {target}: {error.strerror or error}") from None


def _exchange(first: Path, second: Path) -> bool:
    """Exchange two folders by one rename; return False if the system or the file system does not support it."""
    libc = ctypes.CDLL(None, use_errno=True)
    a, b = os.fsencode(first), os.fsencode(second)
    at_cwd = ctypes.c_int(-100)
    if sys.platform == "linux" and hasattr(libc, "renameat2"):
        status = libc.renameat2(at_cwd, a, at_cwd, b, ctypes.c_uint(2))  # RENAME_EXCHANGE
    elif sys.platform == "darwin" and hasattr(libc, "renamex_np"):
        status = libc.renamex_np(a, b, ctypes.c_uint(2))  # RENAME_SWAP
    else:
        return False
    if status == 0:
        return True
    number = ctypes.get_errno()
    if number in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
        return False
    raise OSError(number, os.strerror(number))


def _sync(path: Path) -> None:
    """Write the entries of a folder to the disk, if its file system supports this."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


# The lock -------------------------------------------------------------------------------------------------------------


_held: set[bytes] = set()
"""Contents of the lock files that this process holds or creates."""


def _lock(lock: Path, target: Path, stack: contextlib.ExitStack) -> None:
    """Create the lock file with the owner's identity; O_EXCL admits one process, also over NFS."""
    owner = {
        "host": socket.gethostname(),
        "pid": os.getpid(),
        "began": _start_time(os.getpid()),
        "since": int(time.time()),
    }
    content = json.dumps({**owner, "claim": secrets.token_hex(8)}).encode()  # one process may lock several times
    stack.enter_context(signals.on_exit(lambda: _release(lock, content)))
    _held.add(content)  # before the file exists: another thread that reads it must find its owner
    while True:
        try:
            with lock.open("xb", buffering=0) as file:
                file.write(content)
            return
        except FileExistsError:
            _remove_stale_lock(lock, target)
        except OSError as error:
            with contextlib.suppress(OSError):  # the first error is reported
                lock.unlink()
            raise OSError(error.errno, f"cannot write to {target}: {error.strerror}") from None


def _release(lock: Path, content: bytes) -> None:
    """Remove the lock file if it has this content."""
    _held.discard(content)
    with contextlib.suppress(OSError):  # the results are complete; the next command removes the lock
        if bounded_read.read_bytes(lock, MAX_LOCK_BYTES) == content:
            lock.unlink()


def _remove_stale_lock(lock: Path, target: Path) -> None:
    """Remove a lock whose process has ended, or which this process could not remove.

    One process at a time executes this, so a stale lock cannot be replaced by a new one before it is removed.

    Raises:
        BlockingIOError: If the process runs, or is on another computer.
    """
    with _exclusive(lock.parent):
        found = _read_lock(lock)
        if found is None:
            return
        content, owner = found
        if owner is not None:
            is_local = owner["host"] == socket.gethostname()
            is_released = owner["pid"] == os.getpid() and content not in _held
            if not is_local or (not is_released and _is_running(owner["pid"], owner["began"])):
                since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(owner["since"]))
                process = f"process {owner['pid']} on {owner['host']} has been writing to it since {since}"
                remedy = "" if is_local else f"; if that process has ended, remove {lock}"
                raise BlockingIOError(f"{target} is in use: {process}; wait, or choose another --out{remedy}")
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
    """Return content and owner of a lock file; no owner if it stays invalid for a second, None if there is no file.

    Raises:
        OSError: If colift did not create the file, because it is a link, a folder, a pipe, a device or too large.
    """
    content = b""
    for _ in range(20):
        try:
            if lock.is_symlink():  # a link without a target would never become readable
                raise OSError(errno.ELOOP, "a link, not a lock file of colift: remove it", str(lock))
            content = bounded_read.read_bytes(lock, MAX_LOCK_BYTES)
        except FileNotFoundError:
            return None
        if (owner := _parse_owner(content)) is not None:
            return content, owner
        time.sleep(0.05)  # created, but not yet written
    return content, None


def _parse_owner(content: bytes) -> dict[str, Any] | None:
    """Return the owner that a lock file names; None if the content is incomplete or damaged."""
    try:
        found = json.loads(content)
        kinds = {"host": str, "pid": int, "began": str, "since": float}
        owner: dict[str, Any] = {key: kind(found[key]) for key, kind in kinds.items()}
        time.localtime(owner["since"])  # a time that the message can state
    except (ValueError, TypeError, KeyError, OverflowError, OSError, RecursionError):
        return None
    return owner if owner["host"].isprintable() and owner["pid"] > 0 else None


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
        state, *after = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return ""
    return "ended" if state in "ZX" else after[18]
