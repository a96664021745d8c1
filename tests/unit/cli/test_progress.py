"""Tests of the progress display: elapsed time, time left, compilation, and lines without a terminal."""

from __future__ import annotations

import io
import sys
import time

import pytest
from rich.console import Console

from colift.cli import certify, progress, scenario, study
from colift.runtime import signals


class Clock:
    """Clock that a test advances."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_time_left_follows_from_the_completed_share(clock):
    shown = progress.ActivityProgress("simulating paper", clock=clock)
    assert shown.line() == "simulating paper, 0:00 elapsed"
    clock.now = 30.0
    shown("C1, 5.0 of 20 s", 0.25)
    assert shown.line() == "simulating paper: C1, 5.0 of 20 s, 0:30 elapsed, about 1:30 left"
    clock.now = 40.0  # the estimate counts down until the next report
    assert shown.times == "0:40 elapsed, about 1:20 left"
    clock.now = 60.0
    shown("C1, 10.0 of 20 s", 0.5)
    assert shown.times == "1:00 elapsed, about 1:00 left"


def test_compilation_is_named_and_not_extrapolated(clock):
    shown = progress.ActivityProgress("simulating paper", clock=clock)
    clock.now = 60.0
    shown.sample(compiles=True)
    assert shown.line() == "simulating paper: compiling, 1:00 elapsed"
    clock.now = 70.0
    shown.sample(compiles=False)
    shown("C1", 0.5)
    assert shown.line() == "simulating paper: C1, 1:10 elapsed, about 0:10 left"


def test_schedule_gives_the_share_of_each_step(clock):
    shown = progress.ActivityProgress("certifying", (("simulation", 1.0), ("tube", 2.0), ("bounds", 1.0)), clock=clock)
    shown("simulation")
    clock.now = 10.0
    shown("tube until 1 s")
    assert shown.share == 0.25
    assert shown.times == "0:10 elapsed, about 0:30 left"
    clock.now = 20.0
    shown("tube until 2 s")  # the same step
    assert shown.times == "0:20 elapsed, about 0:20 left"
    clock.now = 60.0  # the step is longer than estimated: a quarter of the time follows it
    assert shown.times == "1:00 elapsed, about 0:20 left"
    shown("unknown step")
    assert shown.share == 0.25


def test_share_that_is_a_lower_bound(clock):
    shown = progress.ActivityProgress("tuning", limit=True, clock=clock)
    clock.now = 100.0
    shown("3 of at most 12 linearizations", 0.1)
    assert shown.times == "1:40 elapsed, at most 15:00 left"


def test_time_after_the_last_share(clock):
    """The tail counts down, and afterwards no time left is stated."""
    shown = progress.ActivityProgress("simulating", tail=15.0, clock=clock)
    clock.now = 10.0
    shown("figures", 1.0)
    assert shown.times == "0:10 elapsed, about 0:15 left"
    clock.now = 26.0
    assert shown.times == "0:26 elapsed"


def test_hours_are_shown():
    assert progress.format_duration(3725.4) == "1:02:05"
    assert progress.format_duration(59.6) == "1:00"


def test_lines_without_a_terminal(monkeypatch):
    """A line is printed at the start and then once per period, also while no step is reported."""
    monkeypatch.setattr(progress, "LINE_PERIOD", 0.2)
    monkeypatch.setattr(progress, "SAMPLE_PERIOD", 0.02)
    console = Console(file=io.StringIO(), width=20, soft_wrap=True)
    with progress.show_activity(console, "checking paper") as shown:
        for k in range(20):
            shown(f"step {k}")
        time.sleep(0.7)
    lines = console.file.getvalue().splitlines()
    assert lines[0] == "checking paper"
    assert 1 <= len(lines) - 1 <= 4
    assert set(lines[1:]) <= {"checking paper: step 19, 0:00 elapsed", "checking paper: step 19, 0:01 elapsed"}


def test_terminal_shows_one_line():
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    with progress.show_activity(console, "checking paper") as shown:
        shown("team", 0.5)
        time.sleep(0.6)
    text = console.file.getvalue()
    assert "checking paper: team" in text
    assert "0:00 elapsed" in text
    assert text.count("\n") == 1  # the line is erased at the end


def test_compilation_is_found_on_the_call_stack():
    frame = sys._getframe()
    assert not progress.is_compiling(frame)
    for file, expected in (("/x/jax/_src/compiler.py", True), ("/x/colift/codegen/emit.py", True), ("/x/a.py", False)):
        space = {"sys": sys}
        exec(compile("def own_frame():\n    return sys._getframe()", file, "exec"), space)
        assert progress.is_compiling(space["own_frame"]()) is expected


def test_request_to_end_is_raised_by_a_report(monkeypatch):
    monkeypatch.setattr(signals, "_received", [2])
    with pytest.raises(signals.Interrupted):
        progress.ActivityProgress("checking")("team")


def test_flights_of_a_study_share_its_time():
    steps = []
    report = study.flight_progress(("C1", "C3"), 20.0, lambda step, share=None: steps.append((step, share)))
    for case, t in (("C1", 0.0), ("C1", 10.0), ("C3", 0.0), ("C3", 20.0)):
        report(case, t)
    assert steps == [
        ("C1, 0.0 of 20 s", 0.0),
        ("C1, 10.0 of 20 s", 0.25),
        ("C3, 0.0 of 20 s", 0.5),  # C1 has ended early
        ("C3, error bounds, logs and figures", 1.0),
    ]


def test_trials_of_falsify_share_its_time():
    steps = []
    report = certify.trial_progress(["seed:0", "noise:0"], lambda step, share=None: steps.append((step, share)))
    for step in ("seed:0", "simulation", "noise:0"):
        report(step)
    assert steps == [
        ("trial 1 of 2, seed:0", 0.0),
        ("trial 1 of 2, seed:0: simulation", 0.0),
        ("trial 2 of 2, noise:0", 0.5),
    ]


def test_share_of_a_tuning_step():
    linear = scenario.LINEARIZATION_SHARE
    assert scenario.tuning_share("slowest mode -1 1/s, 30 of at most 60 linearizations") == pytest.approx(linear / 2)
    assert scenario.tuning_share("cost 1, 20 of at most 40 simulations") == pytest.approx(linear + (1 - linear) / 2)
    assert scenario.tuning_share("linearization at equilibrium") is None
