"""Tests of compiler and cache: only matching libraries are loaded, and each failure gives one message."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import codegen
from colift.codegen import build
from colift.math import so3

X = jnp.asarray([0.3, -0.2, 0.7])


@pytest.fixture(autouse=True)
def new_process(monkeypatch, tmp_path):
    """Emulate a new process with an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    caches = (
        codegen._target,
        codegen._warn_fallback,
        build._warn_uncached,
        build._process_folder,
        build.compiler,
        build.build_environment,
    )
    for f in caches:
        f.cache_clear()
    yield
    for f in caches:
        f.cache_clear()


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "cache" / "colift" / "native"


@pytest.fixture
def compilations(monkeypatch):
    """Commands of the compiler in their order."""
    runs = []
    real = subprocess.run
    monkeypatch.setattr(
        subprocess, "run", lambda command, **kw: ("-o" in command and runs.append(command)) or real(command, **kw)
    )
    return runs


@pytest.fixture
def cache_is_a_file(tmp_path):
    """Replace the cache folder by a file, which not even a superuser can write to."""
    (tmp_path / "cache").write_text("")


def library_source(number: int) -> tuple[str, Callable[[], str]]:
    """Return key and source of a library whose function returns a number."""
    source = f'#include <math.h>\n__attribute__((visibility("default"))) int colift_native(void) {{ return {number}; }}'
    return build.key(source), lambda: source


def call_library(number: int) -> int:
    """Return the value of that library, compiled or cached."""
    return build.library(*library_source(number)).colift_native()


# what is kept


def test_compiled_code_is_cached(folder, compilations):
    jax.jit(codegen.compile(lambda x: so3.exp(x) * 3))(X)
    assert len(compilations) == 1
    assert [path.suffix for path in folder.iterdir()] == [".so"]
    codegen._target.cache_clear()
    jax.jit(codegen.compile(lambda x: so3.exp(x) * 3))(X)
    assert len(compilations) == 1


def damages() -> list[bytes]:
    """Damaged versions of library 1: truncated, empty, other bytes, one bit flipped, another function's library."""
    rng = np.random.default_rng(0)
    whole = build._compile(library_source(1)[1]())
    cut = [whole[:n] for n in (0, 100, 4096, len(whole) - 1, *rng.integers(len(whole), size=4).tolist())]
    turned = [bytearray(whole) for _ in range(4)]
    for library in turned:
        library[rng.integers(len(whole))] ^= 1 << rng.integers(8).item()
    return [*cut, *map(bytes, turned), rng.bytes(len(whole)), whole + b"x", build._compile(library_source(2)[1]())]


def test_damaged_libraries_are_compiled_again(tmp_path, monkeypatch, compilations):
    """Each in a separate cache, since a process loads a file of one name once."""
    key, source = library_source(1)
    name = build._file_name(key, build._compile(source()))
    for k, damage in enumerate(damages()):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / str(k)))
        cache = tmp_path / str(k) / "colift" / "native"
        cache.mkdir(parents=True)
        (cache / name).write_bytes(damage)
        compilations.clear()
        assert call_library(1) == 1
        assert len(compilations) == 1
        assert [path.name for path in cache.iterdir()] == [name]
        assert (cache / name).read_bytes() != damage
        assert call_library(1) == 1
        assert len(compilations) == 1


def test_renamed_library_is_not_loaded(folder):
    assert call_library(1) == 1
    (path,) = folder.iterdir()
    path.rename(folder / path.name.replace(library_source(1)[0], library_source(2)[0]))
    assert call_library(2) == 2


def test_a_pipe_in_place_of_a_library_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "key-0.so")
    assert build._load(tmp_path, "key") is None


def test_cache_evicts_least_recently_used(folder, monkeypatch):
    monkeypatch.setattr(build, "MAX_LIBRARIES", 2)
    first = build.library(*library_source(1))
    (path,) = folder.iterdir()
    (folder / "left by a killed process.new").touch()
    for old in folder.iterdir():
        os.utime(old, (0, 0))
    assert call_library(1) == 1  # used: the newest again
    assert call_library(2) == 2
    kept = set(folder.iterdir())
    assert len(kept) == 2
    assert path in kept
    os.utime(path, (0, 0))
    assert call_library(3) == 3
    assert path not in set(folder.iterdir())
    assert first.colift_native() == 1  # loaded already
    assert call_library(1) == 1


CHILD = """
from colift.codegen import build
build.MAX_LIBRARIES = 1
for k in [0, 1, 2] * 8:
    source = f'__attribute__((visibility("default"))) int colift_native(void) {{ return {k}; }}'
    assert build.library(build.key(source), lambda: source).colift_native() == k
"""


def test_processes_may_build_and_evict_concurrently(folder):
    children = [subprocess.Popen([sys.executable, "-c", CHILD], stderr=subprocess.PIPE, text=True) for _ in range(3)]
    outputs = [child.communicate(timeout=300)[1] for child in children]
    assert [child.returncode for child in children] == [0, 0, 0], outputs
    assert {path.suffix for path in folder.iterdir()} == {".so"}


# where it cannot be kept


def warnings(caplog) -> list[str]:
    return [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING]


def test_without_cache_each_process_compiles(cache_is_a_file, compilations, caplog):
    """Without a cache each process compiles, with one warning."""
    assert [call_library(1), call_library(2), call_library(1)] == [1, 2, 1]
    assert len(compilations) == 2
    (line,) = warnings(caplog)
    assert "native code cannot be cached (" in line
    assert "Not a directory" in line


def test_read_only_cache_is_read(folder, compilations, monkeypatch, caplog):
    assert call_library(1) == 1

    def refuse(self, *_, **__):
        raise PermissionError(13, "Permission denied", str(self))

    for change in ("write_bytes", "unlink", "replace"):
        monkeypatch.setattr(Path, change, refuse)
    monkeypatch.setattr(os, "utime", refuse)
    assert call_library(1) == 1
    assert len(compilations) == 1
    assert warnings(caplog) == []


def fallback_warning(caplog) -> str:
    """Return the one warning while JAX computes the results."""
    for f, args in ((so3.exp, (X,)), (lambda x: so3.log(so3.exp(x)), (X,))):
        np.testing.assert_allclose(jax.jit(codegen.compile(f))(*args), f(*args), atol=1e-14)
    (line,) = warnings(caplog)
    return line


def test_missing_compiler_falls_back_to_jax(monkeypatch, caplog):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert fallback_warning(caplog).startswith(
        "no C compiler (cc, gcc, clang or $CC) found: native code runs on JAX instead"
    )


def test_unloadable_library_falls_back_to_jax(folder, monkeypatch, caplog):
    """If no library can be loaded, JAX computes the results, with one warning."""

    def refuse(path):
        raise OSError(f"{path}: failed to map segment from shared object")

    monkeypatch.setattr(build.ctypes, "CDLL", refuse)
    assert f"({folder}: failed to map segment from shared object; " in fallback_warning(caplog)


def test_missing_folder_falls_back_to_jax(cache_is_a_file, monkeypatch, caplog):
    def refuse(**_):
        raise FileNotFoundError(2, "No usable temporary directory found")

    monkeypatch.setattr(build.tempfile, "mkdtemp", refuse)
    assert fallback_warning(caplog).startswith(
        "no temporary folder (No usable temporary directory found): native code runs on"
    )


# the compiler


@pytest.fixture
def cc(tmp_path, monkeypatch):
    """Set `$CC` to a script."""

    def script(text: str) -> None:
        path = tmp_path / "my cc"
        path.write_text(text)
        path.chmod(0o755)
        monkeypatch.setenv("CC", f"'{path}' -m64")

    return script


def test_compiler_variable_may_contain_options(monkeypatch, compilations):
    plain = build.build_environment()
    for f in (build.compiler, build.build_environment):
        f.cache_clear()
    monkeypatch.setenv("CC", "env LC_ALL=C cc -O1")
    assert call_library(1) == 1
    assert compilations[0][0].endswith("/env")
    assert compilations[0][1:4] == ["LC_ALL=C", "cc", "-O1"]
    assert build.build_environment() != plain


@pytest.mark.parametrize(
    ("text", "outputs"),
    [
        ("#!/bin/sh\necho broken >&2; exit 3", r"my cc' -m64 --version: exit status 3: broken"),
        ("#!/bin/sh\nexit 0", "my cc' -m64 --version: prints no version"),
        ("#!/bin/sh\necho 1.0", r"my cc' -m64 .*: exit status 0, but no library was written"),
        ("no script", r"my cc' -m64 --version: cannot be run: Exec format error"),
        ("#!/no/such/shell\n", r"my cc' -m64 --version: cannot be run: No such file"),
    ],
)
def test_broken_compiler_gives_one_error(text, outputs, cc, folder):
    cc(text)
    with pytest.raises(build.CompilerError, match=outputs):
        jax.jit(codegen.compile(so3.exp))(X)
    assert not folder.exists() or list(folder.iterdir()) == []


def test_unclosed_quotation_is_reported(monkeypatch):
    monkeypatch.setenv("CC", "'cc")
    with pytest.raises(build.CompilerError, match=r"\$CC is \"'cc\": No closing quotation"):
        build.compiler()


def test_output_of_failing_compiler_is_reported(folder, monkeypatch):
    monkeypatch.setattr(build, "FLAGS", ("--no-such-flag",))
    with pytest.raises(build.CompilerError, match="no-such-flag"):
        jax.jit(codegen.compile(lambda x: so3.exp(x) * 4))(X)
    assert list(folder.iterdir()) == []


def test_number_of_cores_without_affinity(monkeypatch):
    assert build.available_cores() >= 1
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert build.available_cores() == os.cpu_count()
