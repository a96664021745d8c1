"""Tests of the compilation cache: its folder, and computation without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from colift.runtime import cache

RUN = (
    "import colift, jax; print(jax.jit(lambda x: x * 3.0 + 1.0)(2.0), jax.config.{}); assert jax.config.jax_enable_x64"
)
FOLDER, LEAST = "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs"


def run_process(code: str, *flags: str, **environment: str) -> tuple[str, str]:
    """Run code in a new process and return its output and messages."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_", "XDG_"))}
    done = subprocess.run(
        [sys.executable, *flags, "-c", code], capture_output=True, text=True, timeout=300, env=kept | environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr.strip()


def test_cache_folder_follows_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    assert cache.cache_directory("x") == tmp_path / "own" / "colift" / "x"
    assert cache.cache_directory("x").is_dir()
    monkeypatch.setenv("HOME", str(tmp_path))
    for not_absolute in ("", "here"):
        monkeypatch.setenv("XDG_CACHE_HOME", not_absolute)
        assert cache.cache_directory("y") == tmp_path / ".cache" / "colift" / "y"


def test_uncreatable_folder_is_named(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(cache.CacheUnavailable, match=r"file/colift/x: Not a directory"):
        cache.cache_directory("x")


def no_home() -> Path:
    raise RuntimeError("Could not determine home directory.")


def test_missing_home_folder_is_reported(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", no_home)
    with pytest.raises(cache.CacheUnavailable, match="no home folder"):
        cache.cache_directory("x")


def test_unwritable_cache_gives_one_warning(tmp_path):
    (tmp_path / "file").touch()
    printed, messages = run_process(RUN.format(FOLDER), "-W", "error", XDG_CACHE_HOME=str(tmp_path / "file"))
    assert printed == "7.0 None"
    assert len(messages.splitlines()) == 1
    assert "cannot be kept" in messages


def test_read_only_cache_is_read(tmp_path):
    """`access` is replaced, since a superuser may write anywhere."""
    run_process(RUN.format(FOLDER), XDG_CACHE_HOME=str(tmp_path))
    before = sorted(tmp_path.rglob("*"))
    read = "import os; os.access = lambda *_, **__: False; import jax, logging; "
    read += "jax.monitoring.register_event_listener(lambda event, **_: print(event.split('/')[-1])); "
    printed, messages = run_process(read + RUN.format(LEAST), "-W", "error", XDG_CACHE_HOME=str(tmp_path))
    assert "cache_hits" in printed
    assert printed.endswith("7.0 inf")
    ours = [line for line in messages.splitlines() if "cpu_aot_loader.cc" not in line]  # that is jaxlib 0.10.1's
    assert len(ours) == 1
    run_process(read + RUN.format(LEAST).replace("3.0", "5.0"), XDG_CACHE_HOME=str(tmp_path))
    assert sorted(tmp_path.rglob("*")) == before
