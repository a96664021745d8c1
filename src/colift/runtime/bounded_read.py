"""Reading of files with a limit on their size; special files such as pipes and devices are refused."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import stat
from collections.abc import Generator
from pathlib import Path
from typing import Any

MAX_LOG_BYTES = 2**33
"""Largest log of a flight [bytes]."""
MAX_TEXT_BYTES = 2**24
"""Largest text file: scenario, robot description or JSON [bytes]."""
MAX_TABLE_BYTES = 2**28
"""Largest table of poses [bytes]."""


@contextlib.contextmanager
def open_regular(path: str | Path) -> Generator[int]:
    """Open a regular file for reading within the block.

    Args:
        path: File.

    Yields:
        The descriptor.

    Raises:
        OSError: If the file cannot be read, or is not a regular file.
    """
    # without O_NONBLOCK, opening a pipe without a writer would never return
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | getattr(os, "O_CLOEXEC", 0))
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, "a folder, not a file", str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "a pipe, socket or device, not a regular file", str(path))
        yield descriptor
    finally:
        os.close(descriptor)


def read_bytes(path: str | Path, limit: int) -> bytes:
    """Read a regular file of limited size.

    Args:
        path: File.
        limit: Largest size [bytes].

    Returns:
        The content.

    Raises:
        OSError: If the file cannot be read, is not a regular file, or is larger than the limit.
    """
    with open_regular(path) as descriptor, os.fdopen(descriptor, "rb", closefd=False) as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise OSError(errno.EFBIG, f"larger than {limit / 2**20:.3g} MiB, the largest size that is read", str(path))
    return content


def read_text(path: str | Path, limit: int = MAX_TEXT_BYTES) -> str:
    """Read a regular UTF-8 file of limited size, with or without a byte order mark.

    OSError is raised as by `read_bytes`.

    Args:
        path: File.
        limit: Largest size [bytes].

    Returns:
        The text.

    Raises:
        ValueError: If the file is not UTF-8 text.
    """
    content = read_bytes(path, limit)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ValueError(f"{path}:{line}: not UTF-8 text (byte {error.start})") from None


def read_json(path: str | Path, limit: int = MAX_TEXT_BYTES) -> dict[str, Any]:
    """Read a JSON file that contains an object.

    OSError is raised as by `read_bytes`.

    Args:
        path: File.
        limit: Largest size [bytes].

    Returns:
        The object.

    Raises:
        ValueError: If the file is not UTF-8 text or not strict JSON, or if it contains no object.
    """
    text = read_text(path, limit)
    try:
        value = json.loads(text, parse_constant=_refuse_constant)
        json.dumps(value, ensure_ascii=False).encode()  # a lone surrogate is not text
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}:{error.lineno}: not JSON ({error.msg})") from None
    except RecursionError:
        raise ValueError(f"{path}: cannot be read: its JSON is nested too deeply") from None
    except UnicodeEncodeError:
        raise ValueError(
            f"{path}: cannot be read: a text contains a lone surrogate, which is not a character"
        ) from None
    except ValueError as error:  # NaN, or a number of more than 4300 digits
        raise ValueError(f"{path}: not JSON ({error})") from None
    if not isinstance(value, dict):
        raise ValueError(f"{path}: must contain a JSON object")
    return value


def _refuse_constant(name: str) -> float:
    """Raise ValueError for NaN and Infinity, which strict JSON does not contain."""
    raise ValueError(f"{name} is not a number")
