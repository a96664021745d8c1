"""Commands that install the optional dependencies of colift."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path


def install_command(extra: str) -> str:
    """Return the command that installs the packages of an extra for the running Python.

    The command is valid for an installed copy from a checkout and for one from an index: pip keeps the installed colift
    and installs the packages that its metadata list.

    Args:
        extra: Name of the extra in `pyproject.toml`, such as `mcap`.

    Returns:
        The command, with the path of the interpreter relative to the working directory if it is below it.
    """
    python = Path(sys.executable)
    if python.is_relative_to(Path.cwd()):
        python = python.relative_to(Path.cwd())
    return f"{shlex.quote(str(python))} -m pip install 'colift[{extra}]'"
