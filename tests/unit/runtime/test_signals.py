"""Tests of interruption: signals end the work at its check points, or after a grace period."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time

import pytest

from colift.runtime import signals

BEGIN = """
import gc, os, signal, sys, threading, time
from colift.runtime import signals
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in a shell's background
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored under nohup
def ask(number=signal.SIGINT):
    os.kill(os.getpid(), number)
def work():
    while True:
        signals.raise_if_interrupted()
        time.sleep(0.005)
"""


def run_to_end(code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process to its end."""
    return subprocess.run(
        [sys.executable, "-c", BEGIN + code], capture_output=True, text=True, check=False, timeout=100
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_work_ends_at_a_check_point_and_cleans_up(number: signal.Signals):
    done = run_to_end(f"""
with signals.handle_signals(), signals.on_exit(lambda: print("cleared")):
    ask({number})
    work()
print("went on")
""")
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "cleared\n", "")


def test_signal_during_garbage_collection_is_not_lost():
    """Python's default handler would raise KeyboardInterrupt in a callback, where it is discarded."""
    done = run_to_end("""
def collected(phase, info):
    if phase == "start" and not asked:
        asked.append(True)
        ask()
        time.sleep(0.01)
asked = []
gc.callbacks.append(collected)
with signals.handle_signals():
    gc.collect()
    work()
""")
    assert (done.returncode, done.stderr) == (130, "")


BUSY = """
class Cleared:
    def __call__(self):
        os.write(1, b"cleared\\n")
def deaf():
    while True:
        try:
            signals.raise_if_interrupted()
            time.sleep(0.01)
        except BaseException:
            pass  # without check points, as a compiler
"""


def test_work_without_check_points_ends_after_grace_period():
    done = run_to_end(
        BUSY
        + """
signals.GRACE_PERIOD = 0.2
with signals.handle_signals(), signals.on_exit(Cleared()):
    ask()
    deaf()
"""
    )
    assert (done.returncode, done.stdout) == (130, "cleared\n")
    assert done.stderr == "terminated before the current step was complete; all written files are complete\n"


def test_second_signal_ends_immediately():
    done = run_to_end(
        BUSY
        + """
signals.GRACE_PERIOD = 1000.0
with signals.handle_signals(), signals.on_exit(Cleared()):
    threading.Timer(0.3, ask).start()
    threading.Timer(0.6, ask).start()
    deaf()
"""
    )
    assert (done.returncode, done.stdout) == (130, "cleared\n")


def test_an_exit_action_without_end_does_not_keep_the_process():
    done = run_to_end(
        BUSY
        + """
signals.ACTION_PERIOD = 0.2
with signals.handle_signals(), signals.on_exit(lambda: time.sleep(90)):
    threading.Timer(0.3, ask).start()
    threading.Timer(0.6, ask).start()
    deaf()
"""
    )
    assert done.returncode == 130


def test_status_after_request_is_130():
    """Other errors after the request, for example of a compiler that the same Ctrl-C ends, do not change the status."""
    for how in ("raise OSError('the compiler was killed')", "sys.exit(0)", "pass"):
        done = run_to_end(f"""
with signals.handle_signals():
    ask()
    while not signals._received:
        time.sleep(0.001)
    {how}
""")
        assert (done.returncode, done.stdout, done.stderr) == (130, "", ""), how


def test_other_and_ignored_signals_have_no_effect():
    done = run_to_end("""
signal.signal(signal.SIGTERM, signal.SIG_IGN)
signal.signal(signal.SIGUSR1, lambda *_: None)
with signals.handle_signals():
    for number in (signal.SIGTERM, signal.SIGUSR1):
        ask(number)
        time.sleep(0.1)
        signals.raise_if_interrupted()
assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
print("went on")
""")
    assert (done.returncode, done.stdout, done.stderr) == (0, "went on\n", "")


def test_handlers_are_restored_and_errors_propagate(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(signals, "SIGNALS", (signal.SIGTERM, signal.SIGUSR1))  # SIGINT may be ignored
    before = [signal.getsignal(number) for number in signals.SIGNALS]
    threads = threading.active_count()
    with signals.handle_signals():
        assert signal.getsignal(signal.SIGTERM) is not before[0]
    with pytest.raises(ValueError, match="as it was"), signals.handle_signals():
        raise ValueError("as it was")
    assert [signal.getsignal(number) for number in signals.SIGNALS] == before
    assert threading.active_count() == threads
    assert signal.set_wakeup_fd(-1) == -1
    signals.raise_if_interrupted()


def test_no_handlers_outside_the_main_thread():
    before, seen = signal.getsignal(signal.SIGTERM), []

    def elsewhere() -> None:
        with signals.handle_signals():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [before]


def test_check_without_handlers_returns_immediately():
    began = time.monotonic()
    signals.raise_if_interrupted()
    assert time.monotonic() - began < 1
