"""Orderly termination after Ctrl-C, SIGTERM or SIGHUP.

Python raises KeyboardInterrupt at an arbitrary point of the main thread. Within a callback that ignores exceptions,
such as JAX's callback of the garbage collector, it is lost and the run continues. Within a compiler it is delayed by
minutes. Here a separate thread receives the signal and sets a flag. Long computations call `raise_if_interrupted` at
points where they may end. If none is reached within `GRACE_PERIOD`, the process is terminated.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Generator

GRACE_PERIOD = 5.0
"""Time [s] from the first signal to forced termination, for computations that check the flag rarely."""
ACTION_PERIOD = 2.0
"""Time [s] for which each function of `on_exit` delays the termination; a file system may not respond."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
"""Signals that request termination; a terminal that is closed sends SIGHUP."""

_received: list[int] = []  # the first signal
_exit_actions: list[Callable[[], None]] = []


class Interrupted(BaseException):
    """Request to terminate the process. It is no Exception, so error handlers do not catch it."""


def raise_if_interrupted() -> None:
    """Raise Interrupted if termination was requested; without `handle_signals` this never occurs.

    Raises:
        Interrupted: If a signal was received.
    """
    if _received:
        raise Interrupted


def is_interrupted() -> bool:
    """Return whether termination was requested."""
    return bool(_received)


@contextlib.contextmanager
def on_exit(action: Callable[[], None]) -> Generator[None]:
    """Call a function when the block ends, also if the process is terminated by force within the block.

    Args:
        action: Function without arguments. It may be called twice, also by another thread. If the process is terminated
            by force, it has `ACTION_PERIOD`.

    Yields:
        Nothing.
    """
    _exit_actions.append(action)
    try:
        yield
    finally:
        _exit_actions.remove(action)
        action()


@contextlib.contextmanager
def handle_signals() -> Generator[None]:
    """Terminate the process in an orderly way after Ctrl-C, SIGTERM or SIGHUP within the block.

    The process ends where `raise_if_interrupted` is called, after `GRACE_PERIOD` at the latest, or at once after a
    second signal. Its exit status is 128 plus the number of the signal. A signal that the process ignores, for example
    under `nohup`, stays ignored. Outside the main thread, which alone may handle signals, the block has no effect.

    Yields:
        Nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    receiver, sender = socket.socketpair()
    sender.setblocking(False)  # Python writes the signal number to it when a signal arrives
    watcher = threading.Thread(target=_watch, args=(receiver,), daemon=True)
    watcher.start()
    previous = {number: signal.getsignal(number) for number in SIGNALS}
    wakeup = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    try:
        for number, handler in previous.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, lambda *_: None)  # the thread handles the signal; this keeps the process running
        yield
    except BaseException:
        if not _received:
            raise
    finally:
        if _received:
            _terminate(_received[0])
        for number, handler in previous.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(wakeup)
        sender.close()
        watcher.join()
        receiver.close()
        _received.clear()


def _watch(receiver: socket.socket) -> None:
    """Wait for a signal; then terminate the process after the grace period or a second signal, or if the block ends."""
    first = _next_signal(receiver)
    if first is None:
        return
    _received.append(first)
    receiver.settimeout(GRACE_PERIOD)
    with contextlib.suppress(TimeoutError):
        if _next_signal(receiver) is None:
            return
    with contextlib.suppress(OSError):  # not through Python's buffers, because the main thread may hold their locks
        reset_line = b"\r\x1b[K\x1b[?25h" if os.isatty(2) else b""
        os.write(2, reset_line + b"terminated before the current step was complete; all written files are complete\n")
    _terminate(first)


def _next_signal(receiver: socket.socket) -> int | None:
    """Return the next signal of `SIGNALS`; None after the end of the block."""
    while number := receiver.recv(1):
        if number[0] in SIGNALS:
            return number[0]
    return None


def _run_action(action: Callable[[], object]) -> None:
    """Call a function of `on_exit`; its errors must not prevent the termination."""
    with contextlib.suppress(Exception):
        action()


def _terminate(number: int) -> None:
    """Terminate the process at once; other threads, such as compilers, would keep it running for minutes."""
    for action in reversed(_exit_actions):  # the innermost block first
        thread = threading.Thread(target=_run_action, args=(action,), daemon=True)
        try:
            thread.start()
        except RuntimeError:  # no further thread can be started
            _run_action(action)
        else:
            thread.join(ACTION_PERIOD)
    if threading.current_thread() is threading.main_thread():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
    os._exit(128 + number)
