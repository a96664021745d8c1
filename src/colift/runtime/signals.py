"""A request to end, by Ctrl-C or SIGTERM: the work reads it where it may end, and is ended where it does not in time.

Python's own KeyboardInterrupt is raised wherever the main thread happens to be. In a callback that drops exceptions,
such as JAX's of every garbage collection, it is lost and the run goes on; in a compiler it waits for minutes. Here
the signal reaches a thread of its own, which sets a flag. The work calls `check` where it may end.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Generator

GRACE_PERIOD = 5.0  # s, for the work to come to a `check`, which a compiler or a long fit may not
SIGNALS = (signal.SIGINT, signal.SIGTERM)

_asked: list[int] = []  # the first signal
_acts: list[Callable[[], None]] = []


class Interrupted(BaseException):
    """The process is asked to end. Not an Exception: what handles errors must not keep a run alive."""


def raise_if_interrupted() -> None:
    """Raise Interrupted if the process is asked to end; without a command line that heeds signals it never is."""
    if _asked:
        raise Interrupted


@contextlib.contextmanager
def on_exit(act: Callable[[], None]) -> Generator[None]:
    """Do `act` when the block ends, however it ends: also where the process is ended by force within it.

    Then another thread may do it too, so twice must be as good as once.
    """
    _acts.append(act)
    try:
        yield
    finally:
        _acts.remove(act)
        act()


@contextlib.contextmanager
def handle_signals() -> Generator[None]:
    """Within the block, Ctrl-C and SIGTERM ask the work to end; the process then ends with 128 + the signal's number.

    It ends where the work calls `check`, after `GRACE` at the latest, and at once at a second signal. A signal that
    the process ignores, as under `nohup` or in a script's background, stays ignored. Off the main thread, which alone
    may take signals, nothing is done.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)  # Python writes to it where the signal arrives
    watcher = threading.Thread(target=_watch, args=(ours,), daemon=True)
    watcher.start()
    before = {number: signal.getsignal(number) for number in SIGNALS}
    wakeup = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, lambda *_: None)  # the watcher is told; this only lets the process live
        yield
    except BaseException:
        if not _asked:
            raise
    finally:
        if _asked:
            _end(_asked[0])
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(wakeup)
        theirs.close()
        watcher.join()
        ours.close()
        _asked.clear()


def _watch(told: socket.socket) -> None:
    """Wait for a signal, then for a second one, for the end of the time there is, or for the block to end."""
    first = _next(told)
    if first is None:
        return
    _asked.append(first)
    told.settimeout(GRACE_PERIOD)
    with contextlib.suppress(TimeoutError):
        if _next(told) is None:
            return
    with contextlib.suppress(OSError):  # past Python's buffers, whose locks the work may hold
        shown = b"\r\x1b[K\x1b[?25h" if os.isatty(2) else b""
        os.write(2, shown + b"interrupted in the middle of a step; files that were written are whole\n")
    _end(first)


def _next(told: socket.socket) -> int | None:
    """The next of the signals heeded; None where no more will come."""
    while number := told.recv(1):
        if number[0] in SIGNALS:
            return number[0]
    return None


def _end(number: int) -> None:
    """The process ends here: threads that compile or fly would keep it alive for minutes."""
    for act in reversed(_acts):
        with contextlib.suppress(Exception):
            act()
    if threading.current_thread() is threading.main_thread():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
    os._exit(128 + number)
