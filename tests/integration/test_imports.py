"""Imports of the package."""

from __future__ import annotations

import subprocess
import sys

IMPORT_ALL = """
import importlib, pkgutil
from jax._src import xla_bridge
import colift

def fail(name):
    raise


for module in pkgutil.walk_packages(colift.__path__, "colift.", fail):
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError as error:
        if error.name.partition(".")[0] == "colift":
            raise
        continue  # an optional dependency
    assert not xla_bridge.backends_are_initialized(), module.name
"""


def test_imports_initialize_no_jax_backend() -> None:
    """A program can choose the platform after its imports, and can fork: JAX has no threads yet."""
    result = subprocess.run([sys.executable, "-c", IMPORT_ALL], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
