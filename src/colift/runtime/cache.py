"""Where what is compiled is kept: JAX's programs and native libraries, in the user's cache folder."""

from __future__ import annotations

import os
from pathlib import Path


class CacheUnavailable(OSError):
    """What is made cannot be kept: no process finds what another one made."""


def cache_directory(name: str) -> Path:
    """`$XDG_CACHE_HOME/colift/NAME`, by default under `~/.cache`, made if it is not there.

    Raises `Unwritable` where there is no home, or the folder cannot be made. A relative `$XDG_CACHE_HOME` is
    ignored, as its specification says.
    """
    root = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        path = (root if root.is_absolute() else Path.home() / ".cache") / "colift" / name
    except RuntimeError:  # neither $HOME, nor a user whom the system knows
        raise CacheUnavailable("there is no home folder; $XDG_CACHE_HOME would name another") from None
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CacheUnavailable(f"{path}: {error.strerror}") from None
    return path
