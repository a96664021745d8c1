"""Files written whole or not at all: the one way in which this package puts results on a disk."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from colift import interrupt


def write(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all: to a temporary name in the same folder, to the disk, then renamed.

    Its mode is what the umask gives a new file. Raises OSError, with the path and the reason in one line; then `path`
    is as it was before. Nothing is written once the process is asked to end.
    """
    interrupt.check()
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            with temporary.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):  # the first failure is the one to tell
                temporary.unlink()
            raise
    except OSError as error:
        raise OSError(error.errno, f"cannot write {path}: {error.strerror}") from error
