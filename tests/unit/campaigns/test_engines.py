"""Engines of campaigns: jobs of submitit, packages that are missing, and a driver without JAX."""

from __future__ import annotations

import builtins
import functools
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from colift.campaigns import engines
from tests.support import campaigns

LIGHT = """
import sys
from pathlib import Path
from colift.campaigns import driver, spec

campaign = spec.load_campaign(Path(sys.argv[1]))
assert driver.plan_flights(campaign)
print([name for name in ("jax", "matplotlib", "xarray") if name in sys.modules])
"""


@pytest.mark.skipif(importlib.util.find_spec("submitit") is None, reason="the extra campaign is not installed")
def test_jobs_of_submitit_yield_the_same_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The jobs are processes of this computer instead of SLURM's."""
    monkeypatch.setenv("PYTHONPATH", ":".join(filter(None, sys.path)))
    path = campaigns.write(tmp_path)
    engine = engines.SlurmEngine("none", tmp_path / "jobs", campaigns.quick_rows, cluster="local")
    found = campaigns.run(path, tmp_path / "out", engine)
    assert found.missing == found.lost == 0
    campaigns.run(path, tmp_path / "other", campaigns.InlineEngine(campaigns.quick_rows))
    assert campaigns.numbers(path, tmp_path / "out") == campaigns.numbers(path, tmp_path / "other")


@pytest.mark.parametrize("package", ["distributed", "submitit"])
def test_missing_package_gives_one_line(package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    found = builtins.__import__

    def missing(name: str, *arguments: object) -> object:
        if name.partition(".")[0] == package:
            raise ModuleNotFoundError(f"No module named {name!r}", name=package)
        return found(name, *arguments)

    dask, slurm = (
        functools.partial(engines.DaskEngine, "tcp://localhost:1"),
        lambda: engines.SlurmEngine("none", tmp_path),
    )
    start = dask if package == "distributed" else slurm
    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(OSError, match=rf"^.* requires? {package}: .* -m pip install 'colift\[campaign\]'$"):
        start()


def test_driver_loads_no_jax(tmp_path: Path):
    """JAX and the figures need 150 MB, which only the processes that simulate require."""
    command = [sys.executable, "-c", LIGHT, str(campaigns.write(tmp_path))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.stdout, done.returncode) == ("[]\n", 0), done.stderr
