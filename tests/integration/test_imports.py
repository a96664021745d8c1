"""Imports of the package."""

from __future__ import annotations

import subprocess
import sys

IMPORT_ALL = """
import importlib, pkgutil
from jax._src import xla_bridge
import colift

for module in pkgutil.walk_packages(colift.__path__, "colift."):
    try:
        importlib.import_module(module.name)
    except ImportError:  # an optional dependency
        continue
    assert not xla_bridge.backends_are_initialized(), module.name
"""


def test_imports_initialize_no_jax_backend() -> None:
    """A program can choose the platform after its imports, and can fork: JAX has no threads yet."""
    result = subprocess.run([sys.executable, "-c", IMPORT_ALL], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
