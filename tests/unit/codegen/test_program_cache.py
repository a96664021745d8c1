"""Tests of the cache of compiled JAX programs: entries are verified, replaced when damaged, and written atomically."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from colift.codegen import program_cache

PROGRAMS = "import colift.codegen, jax; " + "; ".join(f"print(jax.jit(lambda x: x * {k}.5)(2.0))" for k in (1, 2, 3))
HITS = "jax.monitoring.register_event_listener(lambda event, **_: print(event.split('/')[-1])); "
DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "truncated": lambda b: b[: len(b) // 2],
    "empty": lambda b: b"",
    "zero bytes": lambda b: bytes(len(b)),
    "zero bytes at the end": lambda b: b[:-9] + bytes(9),
    "flipped bit": lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 64]) + b[len(b) // 2 + 1 :],
    "flipped bit in the digest": lambda b: bytes([b[0] ^ 1]) + b[1:],
    "bytes appended": lambda b: b + b"x",
}


def run_process(code: str, cache: Path) -> tuple[list[str], str]:
    """Run code in a new process with a cache; return its output and messages, without those on machine types."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_", "XDG_"))}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=300,
        env=kept | {"XDG_CACHE_HOME": str(cache)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), "\n".join(line for line in done.stderr.splitlines() if "cpu_aot_loader" not in line)


def test_damaged_programs_are_compiled_again_without_a_message(tmp_path):
    """JAX alone would print two lines for each of them at each start, or end the process."""
    expected = ["3.0", "5.0", "7.0"]
    assert run_process(PROGRAMS, tmp_path) == (expected, "")
    entries = sorted((tmp_path / "colift" / "jax").iterdir())
    assert len(entries) >= 3
    assert {path.suffix for path in entries} == {".program"}
    whole = {path: path.read_bytes() for path in entries}
    for k, path in enumerate(entries):
        path.write_bytes(list(DAMAGES.values())[k % len(DAMAGES)](whole[path]))
    assert run_process(PROGRAMS, tmp_path) == (expected, "")
    printed, _ = run_process(PROGRAMS.replace("print", HITS + "print", 1), tmp_path)
    assert printed.count("cache_hits") >= 3
    assert "cache_misses" not in printed


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_removed(tmp_path, damage):
    cache = program_cache.VerifiedCache(str(tmp_path))
    assert cache.get("key") is None
    cache.put("key", b"program" * 100)
    assert cache.get("key") == b"program" * 100
    (path,) = tmp_path.iterdir()
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert cache.get("key") is None
    assert list(tmp_path.iterdir()) == []


def test_an_entry_of_another_key_is_not_used(tmp_path):
    cache = program_cache.VerifiedCache(str(tmp_path))
    cache.put("first", b"program")
    (tmp_path / "first.program").rename(tmp_path / "second.program")
    assert cache.get("second") is None


def test_a_pipe_in_place_of_an_entry_is_replaced(tmp_path):
    cache = program_cache.VerifiedCache(str(tmp_path))
    os.mkfifo(tmp_path / "key.program")
    assert cache.get("key") is None
    cache.put("key", b"program")
    assert cache.get("key") == b"program"


def test_an_entry_that_cannot_be_written_is_omitted(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    cache = program_cache.VerifiedCache(str(tmp_path))
    cache.put("key", b"program")
    assert cache.get("key") is None
    assert list(tmp_path.iterdir()) == []
