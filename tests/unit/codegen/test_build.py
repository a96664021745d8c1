"""The compiler and the cache of the native back end: what is loaded is what was compiled, or one line says why not."""

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
    """An empty cache, and nothing known of this host."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    known = (
        codegen._target,
        codegen._warn_fallback,
        build._warn_uncached,
        build._process_folder,
        build.compiler,
        build.build_environment,
    )
    for f in known:
        f.cache_clear()
    yield
    for f in known:
        f.cache_clear()


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "cache" / "colift" / "native"


@pytest.fixture
def compilations(monkeypatch):
    """The commands that compile, as they are run."""
    runs = []
    real = subprocess.run
    monkeypatch.setattr(
        subprocess, "run", lambda command, **kw: ("-o" in command and runs.append(command)) or real(command, **kw)
    )
    return runs


@pytest.fixture
def file_for_a_cache(tmp_path):
    """Not even a superuser can write there."""
    (tmp_path / "cache").write_text("")


def answer(number: int) -> tuple[str, Callable[[], str]]:
    """The key and source of a library whose function returns a number."""
    source = f'#include <math.h>\n__attribute__((visibility("default"))) int colift_native(void) {{ return {number}; }}'
    return build.key(source), lambda: source


def ask(number: int) -> int:
    """What that library, compiled or kept, returns."""
    return build.library(*answer(number)).colift_native()


# what is kept


def test_compiled_code_is_kept(folder, compilations):
    jax.jit(codegen.compile(lambda x: so3.exp(x) * 3))(X)
    assert len(compilations) == 1
    assert [path.suffix for path in folder.iterdir()] == [".so"]
    codegen._target.cache_clear()
    jax.jit(codegen.compile(lambda x: so3.exp(x) * 3))(X)
    assert len(compilations) == 1


def damages() -> list[bytes]:
    """The library of 1 as it may be found: cut, empty, other bytes, one bit turned, another function's."""
    rng = np.random.default_rng(0)
    whole = build._compile(answer(1)[1]())
    cut = [whole[:n] for n in (0, 100, 4096, len(whole) - 1, *rng.integers(len(whole), size=4).tolist())]
    turned = [bytearray(whole) for _ in range(4)]
    for library in turned:
        library[rng.integers(len(whole))] ^= 1 << rng.integers(8).item()
    return [*cut, *map(bytes, turned), rng.bytes(len(whole)), whole + b"x", build._compile(answer(2)[1]())]


def test_what_is_not_what_its_name_says_is_not_loaded_but_made(tmp_path, monkeypatch, compilations):
    """Each in a cache of its own, as a process loads a file of one name once."""
    key, source = answer(1)
    name = build._file_name(key, build._compile(source()))
    for k, damage in enumerate(damages()):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / str(k)))
        cache = tmp_path / str(k) / "colift" / "native"
        cache.mkdir(parents=True)
        (cache / name).write_bytes(damage)
        compilations.clear()
        assert ask(1) == 1
        assert len(compilations) == 1
        assert [path.name for path in cache.iterdir()] == [name]
        assert (cache / name).read_bytes() != damage
        assert ask(1) == 1
        assert len(compilations) == 1


def test_a_library_renamed_to_another_function_s_is_not_loaded(folder):
    assert ask(1) == 1
    (path,) = folder.iterdir()
    path.rename(folder / path.name.replace(answer(1)[0], answer(2)[0]))
    assert ask(2) == 2


def test_the_cache_keeps_what_was_used_last(folder, monkeypatch):
    monkeypatch.setattr(build, "MAX_LIBRARIES", 2)
    first = build.library(*answer(1))
    (path,) = folder.iterdir()
    (folder / "left by a killed process.new").touch()
    for old in folder.iterdir():
        os.utime(old, (0, 0))
    assert ask(1) == 1  # used: the newest again
    assert ask(2) == 2
    kept = set(folder.iterdir())
    assert len(kept) == 2
    assert path in kept
    os.utime(path, (0, 0))
    assert ask(3) == 3
    assert path not in set(folder.iterdir())
    assert first.colift_native() == 1  # loaded already
    assert ask(1) == 1


CHILD = """
from colift.codegen import build
build.MAX_LIBRARIES = 1
for k in [0, 1, 2] * 8:
    source = f'__attribute__((visibility("default"))) int colift_native(void) {{ return {k}; }}'
    assert build.library(build.key(source), lambda: source).colift_native() == k
"""


def test_processes_may_build_and_forget_the_same_at_once(folder):
    children = [subprocess.Popen([sys.executable, "-c", CHILD], stderr=subprocess.PIPE, text=True) for _ in range(3)]
    said = [child.communicate(timeout=300)[1] for child in children]
    assert [child.returncode for child in children] == [0, 0, 0], said
    assert {path.suffix for path in folder.iterdir()} == {".so"}


# where it cannot be kept


def warnings(caplog) -> list[str]:
    return [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING]


def test_without_a_cache_each_process_compiles_its_own(file_for_a_cache, compilations, caplog):
    """Without a cache each process compiles its own and one line says so."""
    assert [ask(1), ask(2), ask(1)] == [1, 2, 1]
    assert len(compilations) == 2
    (line,) = warnings(caplog)
    assert "native code cannot be cached (" in line
    assert "Not a directory" in line


def test_a_cache_that_is_only_read_is_read(folder, compilations, monkeypatch, caplog):
    assert ask(1) == 1

    def refuse(self, *_, **__):
        raise PermissionError(13, "Permission denied", str(self))

    for change in ("write_bytes", "unlink", "replace"):
        monkeypatch.setattr(Path, change, refuse)
    monkeypatch.setattr(os, "utime", refuse)
    assert ask(1) == 1
    assert len(compilations) == 1
    assert warnings(caplog) == []


def to_jax(caplog) -> str:
    """The one line said while JAX does the work."""
    for f, args in ((so3.exp, (X,)), (lambda x: so3.log(so3.exp(x)), (X,))):
        np.testing.assert_allclose(jax.jit(codegen.compile(f))(*args), f(*args), atol=1e-14)
    (line,) = warnings(caplog)
    return line


def test_without_a_compiler_jax_runs_and_one_line_says_so(monkeypatch, caplog):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert to_jax(caplog).startswith("no C compiler (cc, gcc, clang or $CC) found: native code runs on JAX instead")


def test_where_no_library_can_be_loaded_jax_runs_and_one_line(folder, monkeypatch, caplog):
    """Where no library can be loaded jax runs and one line says so."""

    def refuse(path):
        raise OSError(f"{path}: failed to map segment from shared object")

    monkeypatch.setattr(build.ctypes, "CDLL", refuse)
    assert f"({folder}: failed to map segment from shared object; " in to_jax(caplog)


def test_without_any_folder_jax_runs_and_one_line_says_so(file_for_a_cache, monkeypatch, caplog):
    def refuse(**_):
        raise FileNotFoundError(2, "No usable temporary directory found")

    monkeypatch.setattr(build.tempfile, "mkdtemp", refuse)
    assert to_jax(caplog).startswith("no temporary folder (No usable temporary directory found): native code runs on")


# the compiler


@pytest.fixture
def cc(tmp_path, monkeypatch):
    """Sets `$CC` to a script of its own."""

    def script(text: str) -> None:
        path = tmp_path / "my cc"
        path.write_text(text)
        path.chmod(0o755)
        monkeypatch.setenv("CC", f"'{path}' -m64")

    return script


def test_the_compiler_may_be_words(monkeypatch, compilations):
    plain = build.build_environment()
    for f in (build.compiler, build.build_environment):
        f.cache_clear()
    monkeypatch.setenv("CC", "env LC_ALL=C cc -O1")
    assert ask(1) == 1
    assert compilations[0][0].endswith("/env")
    assert compilations[0][1:4] == ["LC_ALL=C", "cc", "-O1"]
    assert build.build_environment() != plain


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("#!/bin/sh\necho broken >&2; exit 3", r"my cc' -m64 --version: exit status 3: broken"),
        ("#!/bin/sh\nexit 0", "my cc' -m64 --version: prints no version"),
        ("#!/bin/sh\necho 1.0", r"my cc' -m64 .*: exit status 0, but no library was written"),
        ("no script", r"my cc' -m64 --version: cannot be run: Exec format error"),
        ("#!/no/such/shell\n", r"my cc' -m64 --version: cannot be run: No such file"),
    ],
)
def test_a_compiler_that_does_not_work_is_one_error(text, said, cc, folder):
    cc(text)
    with pytest.raises(build.CompilerError, match=said):
        jax.jit(codegen.compile(so3.exp))(X)
    assert not folder.exists() or list(folder.iterdir()) == []


def test_an_open_quotation_is_named(monkeypatch):
    monkeypatch.setenv("CC", "'cc")
    with pytest.raises(build.CompilerError, match=r"\$CC is \"'cc\": No closing quotation"):
        build.compiler()


def test_a_failing_compiler_is_quoted(folder, monkeypatch):
    monkeypatch.setattr(build, "FLAGS", ("--no-such-flag",))
    with pytest.raises(build.CompilerError, match="no-such-flag"):
        jax.jit(codegen.compile(lambda x: so3.exp(x) * 4))(X)
    assert list(folder.iterdir()) == []


def test_cores_where_the_system_does_not_say(monkeypatch):
    assert build.available_cores() >= 1
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert build.available_cores() == os.cpu_count()
