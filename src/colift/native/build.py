"""The host's C compiler, and the cache of what it made."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

import jax.ffi

FLAGS = ("-std=gnu11", "-O2", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared",
         "-fvisibility=hidden", "-w")  # fmt: skip
KEPT = 64  # libraries in the cache, 0.1 to 0.5 MB each


class CompilerError(RuntimeError):
    """The host's C compiler refused what was emitted."""


@functools.cache
def compiler() -> str | None:
    """Path of the C compiler: `$CC`, else `cc`, `gcc` or `clang`; None if there is none."""
    names = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    return next((path for path in map(shutil.which, names) if path), None)


def _needed() -> str:
    path = compiler()
    if path is None:
        raise CompilerError("no C compiler (cc, gcc, clang or $CC) found")
    return path


@functools.cache
def machine() -> str:
    """What compiled code depends on beside its source: compiler, flags, processor, XLA's interface."""
    version = subprocess.run([_needed(), "--version"], capture_output=True, text=True, check=True).stdout
    header = (Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h").read_text()
    return "\n".join([version, " ".join(FLAGS), platform.machine(), *processor(), header])


@functools.cache
def processor() -> tuple[str, ...]:
    """What the operating system says of the processor's kind and instructions."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text().split("\n\n")[0].splitlines() if file.exists() else []
    kept = (line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part")))
    return tuple(kept) or (platform.processor(),)


def _forget(folder: Path) -> None:
    """Remove all but the libraries used last; one that a process has loaded stays usable to it."""
    used = {path: path.stat().st_mtime for path in folder.glob("*.so") if path.exists()}
    for old in sorted(used, key=used.__getitem__)[:-KEPT]:
        old.unlink(missing_ok=True)


def lanes() -> int:
    """How many samples to put side by side: a vector register of doubles, or two short ones."""
    return 8 if any("avx512f" in line for line in processor()) else 4


def cache_folder() -> Path:
    """`$XDG_CACHE_HOME/colift/native`, by default under `~/.cache`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "colift" / "native"


def key(*parts: str) -> str:
    """The name under which code made of some text is kept on this machine."""
    return hashlib.sha256("\0".join([*parts, machine()]).encode()).hexdigest()[:32]


def library(name: str, source: str) -> ctypes.CDLL:
    """Compile C source, or take it from the cache; raises `CompilerError` with the compiler's own words."""
    path = cache_folder() / f"{name}.so"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            code, out = Path(folder) / "native.c", Path(folder) / "native.so"
            code.write_text(source)
            command = [_needed(), *FLAGS, "-I", jax.ffi.include_dir(), str(code), "-o", str(out), "-lm", "-lpthread"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise CompilerError(f"{' '.join(command)}: exit status {done.returncode}: {done.stderr[-2000:]}")
            out.replace(path)  # atomic: another process sees all of it or nothing
        _forget(path.parent)
    with contextlib.suppress(PermissionError):  # a cache that is only read
        os.utime(path)  # when it was last used
    return ctypes.CDLL(str(path))
