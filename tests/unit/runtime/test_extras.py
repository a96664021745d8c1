"""Commands that install optional dependencies."""

import sys
import tomllib
from pathlib import Path

from colift.runtime import extras

ROOT = Path(__file__).parents[3]


def test_the_command_names_the_running_python(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "my env" / "bin" / "python"))
    assert extras.install_command("mcap") == "'my env/bin/python' -m pip install 'colift[mcap]'"
    monkeypatch.setattr(sys, "executable", "/anywhere/bin/python")
    assert extras.install_command("gym") == "/anywhere/bin/python -m pip install 'colift[gym]'"


def test_messages_name_extras_that_exist():
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = {
        line.split("install_command('")[1].split("'")[0]
        for path in (ROOT / "src").rglob("*.py")
        for line in path.read_text().splitlines()
        if "install_command('" in line
    }
    assert named == set(known)
