"""Files written whole or not at all: the one way in which this package puts results on a disk."""

from __future__ import annotations

import contextlib
import json
import math
import os
from pathlib import Path
from typing import Any

from colift.runtime import signals


def write_atomic(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all: to a temporary name in the same folder, to the disk, then renamed.

    Its mode is what the umask gives a new file. Raises OSError, with the path and the reason in one line; then `path`
    is as it was before. Nothing is written once the process is asked to end.
    """
    signals.raise_if_interrupted()
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


def write_json_atomic(value: Any, path: Path) -> Any:
    """Write strict JSON as `write` does; what is not finite becomes null. What the file holds; raises as `write`."""
    held = _finite(value)
    write_atomic(path, (json.dumps(held, indent=2, allow_nan=False) + "\n").encode())
    return held


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
