"""A request to end ends the process: where the work looks, and where it does not."""

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
def ask(number=signal.SIGINT):
    os.kill(os.getpid(), number)
def work():
    while True:
        signals.raise_if_interrupted()
        time.sleep(0.005)
"""


def ended(code: str) -> subprocess.CompletedProcess[str]:
    """A process that runs some code, to its end."""
    return subprocess.run(
        [sys.executable, "-c", BEGIN + code], capture_output=True, text=True, check=False, timeout=100
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_work_ends_where_it_looks_and_is_cleared_up(number: signal.Signals):
    done = ended(f"""
with signals.handle_signals(), signals.on_exit(lambda: print("cleared")):
    ask({number})
    work()
print("went on")
""")
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "cleared\n", "")


def test_an_exception_dropped_in_a_garbage_collection_drops():
    """As JAX's callback does, where Python's own handler raises KeyboardInterrupt, and the run goes on."""
    done = ended("""
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
            pass  # as deaf as a compiler
"""


def test_work_that_does_not_look_is_ended_after_the_grace():
    done = ended(
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


def test_a_second_signal_ends_at_once():
    done = ended(
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


def test_whatever_ends_the_work_after_the_request_the_status():
    """A compiler that the same Ctrl-C kills fails, and its failure is not the news."""
    for how in ("raise OSError('the compiler was killed')", "sys.exit(0)", "pass"):
        done = ended(f"""
with signals.handle_signals():
    ask()
    while not signals._received:
        time.sleep(0.001)
    {how}
""")
        assert (done.returncode, done.stdout, done.stderr) == (130, "", ""), how


def test_other_signals_and_ignored_ones_ask_for_nothing():
    done = ended("""
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


def test_handlers_are_restored_and_errors_pass(monkeypatch: pytest.MonkeyPatch):
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


def test_off_the_main_thread_no_signal_is_taken():
    before, seen = signal.getsignal(signal.SIGTERM), []

    def elsewhere() -> None:
        with signals.handle_signals():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [before]


def test_without_a_command_line_there_is_nothing_to_heed():
    began = time.monotonic()
    signals.raise_if_interrupted()
    assert time.monotonic() - began < 1
