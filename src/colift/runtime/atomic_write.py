"""Atomic writes of files: a file is written completely or not at all. All results are written by these functions."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import math
import os
from collections.abc import Generator
from pathlib import Path
from typing import Any

from colift.runtime import signals


def write_atomic(path: str | Path, content: bytes, *, after_interrupt: bool = False, new: bool = False) -> None:
    """Write a file atomically.

    The content is written to a temporary file in the same folder, flushed to the disk, and renamed. The file mode
    follows the umask. After a request to terminate the process nothing is written, unless requested.

    Args:
        path: File.
        content: New content.
        after_interrupt: Whether to write also after a request to terminate the process.
        new: Whether to refuse a file that exists.

    Raises:
        OSError: If the file cannot be written, with path and reason in one line; `path` is then unchanged.
    """
    with open_atomic(path, after_interrupt=after_interrupt, new=new) as file:
        file.write(content)


@contextlib.contextmanager
def open_atomic(path: str | Path, *, after_interrupt: bool = False, new: bool = False) -> Generator[io.BufferedRandom]:
    """Open a file that replaces another one when the block ends without an error; see `write_atomic`.

    Args:
        path: File.
        after_interrupt: Whether to write also after a request to terminate the process.
        new: Whether to refuse a file that exists.

    Yields:
        The temporary file, for writing and reading.

    Raises:
        OSError: If the file cannot be written, with path and reason in one line; `path` is then unchanged.
    """
    if not after_interrupt:
        signals.raise_if_interrupted()
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            with temporary.open("w+b") as file:
                yield file
                if not after_interrupt:
                    signals.raise_if_interrupted()
                file.flush()
                os.fsync(file.fileno())
            if new:
                _rename_new(temporary, path)
            else:
                temporary.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):  # the first error is reported
                temporary.unlink()
            raise
    except OSError as error:
        raise OSError(error.errno, f"cannot write {path}: {error.strerror}") from error


def _rename_new(temporary: Path, path: Path) -> None:
    """Rename a file; raise FileExistsError if the new name exists."""
    try:
        os.link(temporary, path)  # unlike a rename, this replaces no file
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
        temporary.replace(path)
    else:
        temporary.unlink()


def write_json_atomic(value: Any, path: Path) -> Any:
    """Write a value as strict JSON, atomically; numbers that are not finite become null.

    Raises OSError as `write_atomic`.

    Args:
        value: Nested dictionaries and lists of strings, numbers, booleans and None.
        path: File.

    Returns:
        The written value.
    """
    finite = _replace_nonfinite(value)
    write_atomic(path, (json.dumps(finite, indent=2, allow_nan=False) + "\n").encode())
    return finite


def _replace_nonfinite(value: Any) -> Any:
    """Replace numbers that are not finite by None."""
    if isinstance(value, dict):
        return {key: _replace_nonfinite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_replace_nonfinite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
