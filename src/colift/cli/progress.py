"""Progress of long commands on standard error: current step, elapsed time and estimated time left.

A terminal shows one line, which is updated in place. Elsewhere, a plain line is printed at the start and every
`LINE_PERIOD`. A second thread prints the lines, so that a long step does not interrupt them.
"""

from __future__ import annotations

import contextlib
import re
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from types import FrameType
from typing import Protocol, runtime_checkable

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from colift.runtime import signals

LINE_PERIOD = 10.0
"""Time between two plain lines [s]."""
SAMPLE_PERIOD = 0.25
"""Time between two samples of the call stack, and between two updates of a terminal [s]."""
MIN_SHARE = 0.01
"""Completed share from which on the time left is estimated."""
MIN_WORK = 2.0
"""Time without compilation from which on the time left is estimated [s]."""
COMPILER_FILES = re.compile(r"colift/codegen/|jax/_src/(compiler|interpreters/(mlir|partial_eval))\.py$")
"""Files whose functions are on the call stack while a program is traced or compiled."""
Schedule = Sequence[tuple[str, float]]
"""Beginning of the name of each step, and its share of the time; the shares are relative to their sum."""


@runtime_checkable
class Report(Protocol):
    """Function that reports the step that begins, and the completed share of the activity."""

    def __call__(self, step: str, share: float | None = None) -> None:
        """Report a step.

        Args:
            step: Name of the step that begins.
            share: Completed share of the activity, from 0 to 1; None keeps the former one.

        Raises:
            Interrupted: On a request to end the process.
        """


@runtime_checkable
class Display(Report, Protocol):
    """Report whose line can be removed for a while."""

    def paused(self) -> contextlib.AbstractContextManager[None]:
        """Return a context in which standard output may be printed to."""


class ActivityProgress:
    """Step, elapsed time and estimated time left of an activity.

    The time left is `(1 - s) / s` times the time without compilation, where s is the completed share. Compilation
    occurs mostly at the start and would distort the estimate.
    """

    def __init__(
        self,
        activity: str,
        schedule: Schedule = (),
        limit: bool = False,
        tail: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin an activity.

        Args:
            activity: Description of the activity.
            schedule: Steps in their order with their shares of the time.
            limit: True if the share is a lower bound, so that the time left is at most the estimate.
            tail: Estimated time after the share has become 1 [s].
            clock: Function that returns the time [s].
        """
        self._activity, self._clock, self._begin = activity, clock, clock()
        self._step, self._share, self._step_end = "", 0.0, 0.0
        self._worked, self._compile_time, self._sampled_at = 0.0, 0.0, self._begin
        self._compiles, self._qualifier, self._tail = False, "at most" if limit else "about", tail
        total, ends = sum(weight for _, weight in schedule), 0.0
        self._live: Live | None = None
        self._spans: list[tuple[str, float, float]] = []
        for name, weight in schedule:
            self._spans.append((name, ends, ends := ends + weight / total))

    @contextlib.contextmanager
    def show_on(self, live: Live | None) -> Generator[None]:
        """Show the line of a terminal within the block; None shows nothing."""
        with live or contextlib.nullcontext():
            self._live = live
            try:
                yield
            finally:
                self._live = None

    @contextlib.contextmanager
    def paused(self) -> Generator[None]:
        """Remove the line of a terminal within the block, because its library redirects standard output meanwhile."""
        if self._live is None:
            yield
            return
        self._live.stop()
        try:
            yield
        finally:
            self._live.start()

    def __call__(self, step: str, share: float | None = None) -> None:
        """Record the step that begins; see `Report`."""
        signals.raise_if_interrupted()
        for name, start, end in self._spans if share is None else ():
            if step.startswith(name):
                share, self._step_end = start, end
        self._step = step
        if share is not None and share > self._share:
            self._share, self._worked = min(share, 1.0), self._time_without_compilation()

    def sample(self, compiles: bool) -> None:
        """Record whether a program is being compiled, for the time since the previous sample."""
        now = self._clock()
        self._compile_time += (now - self._sampled_at) * compiles
        self._compiles, self._sampled_at = compiles, now

    @property
    def share(self) -> float:
        """Completed share of the activity; 0 while it is not known."""
        return self._share

    @property
    def title(self) -> str:
        """Description of the activity and its step."""
        step = ", ".join(filter(None, (self._step, "compiling" if self._compiles else "")))
        return f"{self._activity}: {step}" if step else self._activity

    @property
    def times(self) -> str:
        """Elapsed time and, if it can be estimated, time left."""
        left = self.time_left()
        note = "" if left is None else f", {self._qualifier} {format_duration(left)} left"
        return f"{format_duration(self._clock() - self._begin)} elapsed{note}"

    def time_left(self) -> float | None:
        """Estimate the time left [s]; None if the share is not known or the estimate has expired."""
        worked = self._time_without_compilation()
        if self._share < MIN_SHARE or self._worked < MIN_WORK:
            return None
        left = self._worked / self._share + self._tail - worked
        after_step = worked * (1 / self._step_end - 1) if self._step_end > self._share else 0.0
        return max(left, after_step) if max(left, after_step) >= 1 else None

    def _time_without_compilation(self) -> float:
        """Return the time since the start without compilation [s]."""
        return self._clock() - self._begin - self._compile_time

    def line(self) -> str:
        """Return activity, step and times as one line of text."""
        return f"{self.title}, {self.times}"


def format_duration(seconds: float) -> str:
    """Return a time as minutes and seconds, or as hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def is_compiling(frame: FrameType | None) -> bool:
    """Return whether a program is traced or compiled by the functions of a call stack.

    Args:
        frame: Innermost frame of the call stack.
    """
    while frame is not None:
        if COMPILER_FILES.search(frame.f_code.co_filename.replace("\\", "/")):
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def show_activity(
    console: Console,
    activity: str,
    schedule: Schedule = (),
    limit: bool = False,
    tail: float = 0.0,
    announce: bool = True,
) -> Generator[ActivityProgress]:
    """Show the progress of an activity on a console within the block.

    Args:
        console: Console for the progress.
        activity: Description of the activity.
        schedule: Steps in their order with their shares of the time.
        limit: True if the time left is at most the estimate.
        tail: Estimated time after the completed share has become 1 [s].
        announce: Whether a plain line is printed at the start.

    Yields:
        The progress, to which steps are reported.
    """
    progress = ActivityProgress(activity, schedule, limit, tail)
    stopped, owner = threading.Event(), threading.get_ident()

    def watch() -> None:
        last_line = time.monotonic()
        while not stopped.wait(SAMPLE_PERIOD):
            progress.sample(is_compiling(sys._current_frames().get(owner)))
            if not console.is_terminal and time.monotonic() - last_line >= LINE_PERIOD:
                last_line = time.monotonic()
                console.print(progress.line(), markup=False)

    watcher = threading.Thread(target=watch, daemon=True)
    if announce and not console.is_terminal:
        console.print(activity, markup=False)
    spinner = Spinner("line")
    live = Live(
        get_renderable=lambda: _terminal_line(progress, spinner, console),
        console=console,
        transient=True,
        refresh_per_second=1 / SAMPLE_PERIOD,
    )
    with progress.show_on(live if console.is_terminal else None):
        watcher.start()
        try:
            yield progress
        finally:
            stopped.set()
            watcher.join()


def _terminal_line(progress: ActivityProgress, spinner: Spinner, console: Console) -> Table:
    """Return spinner, title, bar and times in one line, which is shortened to the width of the terminal."""
    line = Table.grid(padding=(0, 1))
    for _ in range(3):
        line.add_column(no_wrap=True)
    line.add_column(no_wrap=True, overflow="ellipsis")
    width = max(console.width - 50, 10)
    title = Text(progress.title, overflow="ellipsis", no_wrap=True)
    title.truncate(width, overflow="ellipsis")
    bar = ProgressBar(total=1.0, completed=progress.share, width=12) if progress.share else Text("")
    line.add_row(spinner, title, bar, progress.times)
    return line
