"""Cache folder of the user for compiled JAX programs and native libraries."""

from __future__ import annotations

import os
from pathlib import Path


class CacheUnavailable(OSError):
    """Error of a cache folder that cannot be created; compiled programs are then not shared between processes."""


def cache_directory(name: str) -> Path:
    """Return a cache folder, and create it if it does not exist.

    The folder is `$XDG_CACHE_HOME/colift/NAME`, by default under `~/.cache`. A relative `$XDG_CACHE_HOME` is ignored,
    as specified by the XDG Base Directory Specification.

    Args:
        name: Name of the folder.

    Returns:
        The folder.

    Raises:
        CacheUnavailable: If there is no home folder, or the folder cannot be created.
    """
    root = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        path = (root if root.is_absolute() else Path.home() / ".cache") / "colift" / name
    except RuntimeError:  # no $HOME and no entry of the user in the system's database
        raise CacheUnavailable("there is no home folder; set $XDG_CACHE_HOME to a folder for caches") from None
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CacheUnavailable(f"{path}: {error.strerror}") from None
    return path
