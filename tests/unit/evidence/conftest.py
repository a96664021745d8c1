"""A small project with two evidence modules in its own repository."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

import evidence

PROOF = """
import time
from benchmarks.model import scale
from evidence import collect


def compute(item):
    if item == "slow":
        time.sleep(60)
    if item == "broken":
        raise ValueError("not computable")
    return {"adaptive": {"e_p_rms_m": scale(int(item)), "wall_time_s": time.time(), "stopped": ""}, "n": [1, 2]}


def main():
    return bool(collect("proof", ["1", "2", "slow", "broken"], compute))
"""
LAYERED = """
import colift
import pytest
from colift.onboard import law

GAIN = colift.gain
NAME = "sample"
"""
FILES = {
    "README.md": "# Made up\n",
    "benchmarks/__init__.py": "",
    "benchmarks/model.py": "def scale(x):\n    return 2.0 * x / 3\n",
    "evidence/proof.py": PROOF,
    "evidence/layered.py": LAYERED,
    "evidence/renamed.json": '{"words": {"C4": "adaptive"}}\n',
    "requirements/run.txt": "numpy==2.0 \\\n    --hash=sha256:1\n",
    "requirements/test.txt": "numpy==2.0\npytest==9.0\n",
    "requirements/docs.txt": "sphinx==9.0\n",
    "src/colift/__init__.py": "HOME = {'gain': 'models.gains', 'other': '.unused'}\n",
    "src/colift/models/__init__.py": "",
    "src/colift/models/gains.py": "gain = 1\n",
    "src/colift/onboard/__init__.py": "",
    "src/colift/onboard/law.py": "from . import parts\nfrom ..math import so3\n",
    "src/colift/onboard/parts.py": "try:\n    from colift.math import fast\nexcept ImportError:\n    fast = None\n",
    "src/colift/math/__init__.py": "",
    "src/colift/math/so3.py": "",
    "src/colift/math/fast.py": "",
    "src/colift/unused.py": "",
    "src/colift/scenario/library/sample.yaml": "a: 1\n",
    "src/colift/scenario/library/other.yaml": "a: 1\n",
}
AUTHOR = ("-c", "user.name=a", "-c", "user.email=a@b.c")


def commit(root: Path) -> None:
    """Commit all files of the project."""
    subprocess.run(["git", "add", "."], cwd=root, check=True)
    subprocess.run(["git", *AUTHOR, "commit", "-qm", "all"], cwd=root, check=True)


def clear() -> None:
    """Discard the loaded table of renamed keys."""
    evidence._names.cache_clear()
    evidence._renamed.cache_clear()


@pytest.fixture
def project(tmp_path, monkeypatch):
    """Folder of the project; `evidence` uses it, and child processes import its modules."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    for name in ("__init__", "dependencies", "restamp"):
        shutil.copy(Path(evidence.__file__).with_name(f"{name}.py"), tmp_path / "evidence")
    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    monkeypatch.setattr(evidence, "RESULTS", tmp_path / "evidence" / "results")
    monkeypatch.setattr(evidence, "RENAMED", tmp_path / "evidence" / "renamed.json")
    monkeypatch.setattr(evidence.files_behind, "__defaults__", (tmp_path,))
    clear()
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    commit(tmp_path)
    yield tmp_path
    clear()


@pytest.fixture
def change(project):
    """Function that writes and commits another version of a dependency that computes the same."""

    def write() -> None:
        (project / "benchmarks" / "model.py").write_text("def scale(x):\n    return x * 2.0 / 3\n")
        commit(project)

    return write


@pytest.fixture
def store(project):
    """Function that stores a result of `proof` with given items, as computed at the last commit."""

    def save(items: dict) -> None:
        made = {"command": "./dev evidence proof", "machine": "a machine", "commit": evidence.head()}
        files = evidence.files_behind(project / "evidence" / "proof.py")
        evidence.save(evidence.RESULTS / "proof.json", {**made, "date": "2026-01-02", "files": files, "items": items})

    return save
