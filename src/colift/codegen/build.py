"""Compilation of C source with the host's compiler, and the cache of the libraries.

A library is cached under a key of the source's origin, the compiler, the flags and the processor. It is verified before
it is loaded. If the cache directory is not writable, each process compiles into a temporary directory of its own.

See Also:
    docs/decisions/0019-verify-cached-artifacts.md: the reasons for the verification.
"""

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

from colift.runtime import bounded_read, cache

FLAGS = ("-std=gnu11", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC",
         "-fvisibility=hidden", "-w")  # fmt: skip
OPTIMIZED_FLAGS = ("-O2",)
# For the parts of long functions: -O1 takes a third of the time of -O2. Dead stores are not searched for, because
# another part reads every value that is stored.
QUICK_FLAGS = ("-O1", "-fno-tree-dse", "-fno-dse")
MAX_LIBRARIES = 256  # in the cache; about 3 MB for a simulation, 0.1 MB for most functions
MAX_LIBRARY_BYTES = 2**30  # largest library that is loaded from the cache

log = logging.getLogger(__name__)


class CompilerError(RuntimeError):
    """The host's C compiler does not work, or it rejects the emitted source."""


class LibraryUnavailable(RuntimeError):
    """The host cannot run native code: no C compiler is installed, or no library can be loaded."""


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """Find the C compiler: `$CC`, which may contain options (`ccache gcc -m64`), else `cc`, `gcc` or `clang`.

    Returns:
        The command with its options, or None if no compiler is installed.

    Raises:
        CompilerError: If `$CC` contains an unclosed quotation.
    """
    try:
        custom = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise CompilerError(f"$CC is {os.environ['CC']!r}: {error}") from None
    found = ((shutil.which(words[0]), *words[1:]) for words in ([custom] if custom else [["cc"], ["gcc"], ["clang"]]))
    return next(((path, *words) for path, *words in found if path), None)


def require_compiler() -> tuple[str, ...]:
    """Return the compiler's command.

    Returns:
        The command with its options.

    Raises:
        LibraryUnavailable: If no C compiler is installed.
    """
    command = compiler()
    if command is None:
        raise LibraryUnavailable("no C compiler (cc, gcc, clang or $CC) found")
    return command


def _run(command: list[str]) -> str:
    """Run a command of the compiler and return its output; raise `CompilerError` with its error output."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    except OSError as error:
        raise CompilerError(f"{shlex.join(command)}: cannot be run: {error.strerror}") from None
    if done.returncode:
        raise CompilerError(f"{shlex.join(command)}: exit status {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout


@functools.cache
def build_environment() -> str:
    """Describe what compiled code depends on besides its source: compiler, flags, processor, header of XLA.

    Returns:
        One item per line; the second line is the first line of the compiler's version.

    Raises:
        CompilerError: If the compiler does not print a version.
    """
    command = [*require_compiler(), "--version"]
    version = _run(command)
    if not version.strip():
        raise CompilerError(f"{shlex.join(command)}: prints no version, which the names of cached libraries require")
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
    """Return the processor's model and instruction sets as reported by the operating system."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text().split("\n\n")[0].splitlines() if file.exists() else []
    kept = (line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part")))
    return tuple(kept) or (platform.processor(),)


def available_cores() -> int:
    """Return the number of processors available to this process; on macOS, the number of all processors."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def lanes() -> int:
    """Return the number of samples per vector: 8 with AVX-512, else 4, which may span two registers."""
    return 8 if any("avx512f" in line for line in processor()) else 4


def key(*parts: str) -> str:
    """Return the name under which a library is cached: a hash of the given texts and the build environment."""
    return hashlib.sha256("\0".join([*parts, build_environment()]).encode()).hexdigest()[:32]


def library(name: str, source: Callable[[], str]) -> ctypes.CDLL:
    """Load a library from the cache, or compile it and store it there.

    If the cache is not usable, the library is stored in a temporary directory of this process; one warning reports
    this. A failing compiler raises `CompilerError` with its error output.

    Args:
        name: The `key` of the texts that determine the source.
        source: Returns the C source; called only if the library is not cached.

    Returns:
        The loaded library.

    Raises:
        LibraryUnavailable: If the library can be loaded from neither directory.
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
    raise LibraryUnavailable(f"no native library can be loaded ({'; '.join(lost)})")


@functools.cache
def _process_folder() -> Path:
    """Create a directory that is removed when the process ends; raise `LibraryUnavailable` if that fails."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="colift-"))
    except OSError as error:
        raise LibraryUnavailable(f"no temporary folder ({error.strerror})") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def _warn_uncached(reason: str) -> None:
    """Warn once per reason that libraries are not cached."""
    log.warning("native code cannot be cached (%s): each process compiles every function again", reason)


def _file_name(name: str, library: bytes) -> str:
    """Return the file name of a library.

    The name contains a hash of the key and the content. A truncated, altered or renamed file therefore does not match
    its name, and two different libraries never share a name.
    """
    return f"{name}-{hashlib.sha256(name.encode() + library).hexdigest()[:32]}.so"


def _load(folder: Path, name: str) -> ctypes.CDLL | None:
    """Load the library of a key; None if no valid file exists. A file that does not match its name is removed."""
    for path in folder.glob(f"{name}-*.so"):
        with contextlib.suppress(OSError):  # another process may remove the file; the library may not load
            if path.name != _file_name(name, bounded_read.read_bytes(path, MAX_LIBRARY_BYTES)):
                path.unlink()
                continue
            with contextlib.suppress(OSError):  # the cache may be read-only
                os.utime(path)  # time of last use, for `_evict`
            return ctypes.CDLL(str(path))
    return None


def _compile(source: str) -> bytes:
    """Compile C source to a shared library; long sources are compiled in pieces, in parallel."""
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
    """Write a library atomically, load it and remove old ones; raise `CacheUnavailable` if that fails."""
    temporary = folder / f"{name}-{secrets.token_hex(8)}.new"
    try:
        temporary.write_bytes(library)
        loaded = ctypes.CDLL(str(temporary.replace(folder / _file_name(name, library))))
        _evict(folder)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        reason = error.strerror or str(error).rsplit(": ", 1)[-1]  # a loader error is "name: reason"
        raise cache.CacheUnavailable(f"{folder}: {reason}") from None
    return loaded


def _evict(folder: Path) -> None:
    """Remove all but the most recently used files; libraries that are loaded stay usable."""
    used = {}
    for path in folder.iterdir():
        with contextlib.suppress(OSError):  # removed by another process
            used[path] = path.stat().st_mtime
    for old in sorted(used, key=used.__getitem__)[:-MAX_LIBRARIES]:
        with contextlib.suppress(OSError):
            old.unlink()
