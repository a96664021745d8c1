"""The host's C compiler, and the cache of what it made."""

from __future__ import annotations

import atexit
import concurrent.futures
import contextlib
import ctypes
import functools
import hashlib
import logging
import os
import platform
import re
import secrets
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import jax.ffi

from colift.runtime import cache

FLAGS = ("-std=gnu11", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC",
         "-fvisibility=hidden", "-w")  # fmt: skip
OPTIMIZED_FLAGS = ("-O2",)
# of parts of long functions: a third of the time to compile; all that they store is needed
QUICK_FLAGS = ("-O1", "-fno-tree-dse", "-fno-dse")
MAX_LIBRARIES = 256  # libraries in the cache: of a flight some 3 MB, of most functions 0.1

log = logging.getLogger(__name__)


class CompilerError(RuntimeError):
    """The host's C compiler does not statement_count, or refused what was emitted."""


class Unavailable(RuntimeError):
    """This host cannot run native code: it has no C compiler, or lets no library be loaded."""


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """The C compiler's command: `$CC`, which may hold words (`ccache gcc -m64`), else `cc`, `gcc` or `clang`; None
    if there is none. Raises `CompilerError` for a `$CC` with an open quotation.
    """
    try:
        wanted = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise CompilerError(f"$CC is {os.environ['CC']!r}: {error}") from None
    found = ((shutil.which(words[0]), *words[1:]) for words in ([wanted] if wanted else [["cc"], ["gcc"], ["clang"]]))
    return next(((path, *words) for path, *words in found if path), None)


def require_compiler() -> tuple[str, ...]:
    """The compiler's command; raises `Unavailable` if there is none."""
    command = compiler()
    if command is None:
        raise Unavailable("no C compiler (cc, gcc, clang or $CC) found")
    return command


def _run(command: list[str]) -> str:
    """What a command of the compiler prints; raises `CompilerError` with its own words."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    except OSError as error:
        raise CompilerError(f"{shlex.join(command)}: cannot be run: {error.strerror}") from None
    if done.returncode:
        raise CompilerError(f"{shlex.join(command)}: exit status {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout


@functools.cache
def build_environment() -> str:
    """What compiled code depends on beside its source: compiler, flags, processor, XLA's interface."""
    command = [*require_compiler(), "--version"]
    version = _run(command)
    if not version.strip():
        raise CompilerError(f"{shlex.join(command)}: says nothing, so that its libraries have no name to be kept under")
    header = (Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h").read_text()
    return "\n".join(
        [
            shlex.join(require_compiler()),
            version,
            " ".join([*FLAGS, *OPTIMIZED_FLAGS, *QUICK_FLAGS]),
            platform.machine(),
            *processor(),
            header,
        ]
    )


@functools.cache
def processor() -> tuple[str, ...]:
    """What the operating system says of the processor's kind and instructions."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text().split("\n\n")[0].splitlines() if file.exists() else []
    kept = (line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part")))
    return tuple(kept) or (platform.processor(),)


def available_cores() -> int:
    """How many processors this process may use; where the system does not say (macOS), how many there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def lanes() -> int:
    """How many samples to put side by side: a vector register of doubles, or two short ones."""
    return 8 if any("avx512f" in line for line in processor()) else 4


def key(*parts: str) -> str:
    """The name under which code made of some text is kept on this machine."""
    return hashlib.sha256("\0".join([*parts, build_environment()]).encode()).hexdigest()[:32]


def library(name: str, source: Callable[[], str]) -> ctypes.CDLL:
    """What C source compiles to, or the cache has; where that cannot be written, from this process's own folder.

    `name` is the `key` of what the source is made of; it is made only where it is needed. Raises `CompilerError` with
    the compiler's own words, and `Unavailable` where the library can be loaded from neither folder.
    """
    folders = (lambda: cache.cache_directory("native")), _process_folder
    for folder in folders:
        with contextlib.suppress(cache.CacheUnavailable):
            if (found := _load(folder(), name)) is not None:
                return found
    made = _compile(source())
    lost = []
    for folder in folders:
        try:
            found = _store(folder(), name, made)
        except cache.CacheUnavailable as error:
            lost.append(str(error))
            continue
        if lost:
            _warn_uncached(*lost)
        return found
    raise Unavailable(f"no native library can be loaded ({'; '.join(lost)})")


@functools.cache
def _process_folder() -> Path:
    """A folder that goes when the process ends; raises `Unavailable` where none can be made."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="colift-"))
    except OSError as error:
        raise Unavailable(f"no temporary folder ({error.strerror})") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def _warn_uncached(why: str) -> None:
    log.warning("native code cannot be kept (%s): each process compiles its own, seconds a function", why)


def _file_name(name: str, library: bytes) -> str:
    """A library's file name. It holds a digest of the library and what it was made of, so a file that is cut short,
    altered, or another function's is not what its name says; and one name is never two libraries.
    """
    return f"{name}-{hashlib.sha256(name.encode() + library).hexdigest()[:32]}.so"


def _load(folder: Path, name: str) -> ctypes.CDLL | None:
    """The library of some key, None if there is none that can be loaded; what is not what it says is removed."""
    for path in folder.glob(f"{name}-*.so"):
        with contextlib.suppress(OSError):  # another process may remove it at any time; it can be loaded or not
            if path.name != _file_name(name, path.read_bytes()):
                path.unlink()
                continue
            with contextlib.suppress(OSError):  # a cache that is only read
                os.utime(path)  # when it was last used
            return ctypes.CDLL(str(path))
    return None


def _compile(source: str) -> bytes:
    """What the compiler makes of C source."""
    with tempfile.TemporaryDirectory(dir=_process_folder()) as folder:
        code, out = Path(folder) / "native.c", Path(folder) / "native.so"
        code.write_text(source)
        files, pieces = [str(code)], re.search(r"^#define PIECES (\d+)\n#define WHOLE (\d+)$", source, re.MULTILINE)
        include = ["-I", jax.ffi.include_dir()]
        if pieces and int(pieces[1]) > 1:
            files = [str(Path(folder) / f"{k}.o") for k in range(int(pieces[1]))]
            levels = [OPTIMIZED_FLAGS if k < int(pieces[2]) else QUICK_FLAGS for k in range(len(files))]
            commands = [
                [*require_compiler(), *FLAGS, *levels[k], *include, "-c", f"-DPIECE={k}", str(code), "-o", file]
                for k, file in enumerate(files)
            ]
            with concurrent.futures.ThreadPoolExecutor(available_cores()) as pool:
                list(pool.map(_run, commands))
        command = [
            *require_compiler(),
            *FLAGS,
            *OPTIMIZED_FLAGS,
            "-shared",
            *include,
            *files,
            "-o",
            str(out),
            "-lm",
            "-lpthread",
        ]
        _run(command)
        made = out.read_bytes() if out.exists() else b""
    if not made:
        raise CompilerError(f"{shlex.join(command)}: exit status 0, but no library was written")
    return made


def _store(folder: Path, name: str, library: bytes) -> ctypes.CDLL:
    """Put a library into a folder, whole or not at all, load it, and forget old ones; raises `Unwritable`."""
    temporary = folder / f"{name}-{secrets.token_hex(8)}.new"
    try:
        temporary.write_bytes(library)
        loaded = ctypes.CDLL(str(temporary.replace(folder / _file_name(name, library))))
        _evict(folder)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        why = error.strerror or str(error).rsplit(": ", 1)[-1]  # of a library that is not loaded: its name, then why
        raise cache.CacheUnavailable(f"{folder}: {why}") from None
    return loaded


def _evict(folder: Path) -> None:
    """Remove all but the files used last, those of killed processes too; what a process has loaded stays usable."""
    used = {}
    for path in folder.iterdir():
        with contextlib.suppress(OSError):  # removed by another process
            used[path] = path.stat().st_mtime
    for old in sorted(used, key=used.__getitem__)[:-MAX_LIBRARIES]:
        with contextlib.suppress(OSError):
            old.unlink()
