"""Tests of `doctor`: report of the machine and its problems."""

from __future__ import annotations

import json

import jax
import pytest
from typer.testing import CliRunner

from colift.cli import doctor
from colift.cli.app import app
from colift.codegen import build
from colift.runtime import cache


def test_working_machine_has_no_problem():
    found = doctor.run_diagnostics()
    assert found["problems"] == []
    assert found["packages"]["jax"] == jax.__version__
    assert found["self_test"].startswith("native code agrees with JAX within")
    assert found["caches"]["native"]["files"] >= 0
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.stdout.splitlines()] == [
        *("python", "packages", "compiler", "jax", "native", "gpu", "self-test")
    ]
    assert json.loads(CliRunner().invoke(app, ["doctor", "--json"]).stdout)["packages"] == found["packages"]


def test_missing_compiler_and_cache_give_status_1(monkeypatch: pytest.MonkeyPatch):
    def unwritable(name: str) -> None:
        raise cache.CacheUnavailable(f"{name}: Permission denied")

    monkeypatch.setattr(build, "compiler", lambda: None)
    monkeypatch.setattr(cache, "cache_directory", unwritable)
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 1
    assert "problem: no C compiler was found" in result.stdout
    assert "problem: compiled code cannot be stored: jax: Permission denied" in result.stdout
    assert "compiler   none" in result.stdout


def test_wrong_native_code_is_a_problem(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(doctor.codegen, "compile", lambda f: lambda A: f(A) * 1.001)
    found = doctor.run_diagnostics()
    assert found["self_test"] == "failed"
    assert "native code differs from JAX by 0.001" in found["problems"][0]
