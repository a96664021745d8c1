"""Measurements beside peers, as ratios taken in one run: `python -m benchmarks [NAME ...]`, or `./dev bench`.

A benchmark is a module with `run(seconds)`, which prints what it measures and returns an `Outcome`. Contenders take
turns, so that a busy machine slows all alike, and a ratio is the median over rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

NAMES = ("one_team", "batch", "growth", "cold_start", "gpu", "floor", "gp", "flight", "study")


@dataclass(frozen=True)
class Outcome:
    """What one benchmark found: figures, targets (a sentence with the figure in it, and whether it is met), and
    what was not measured and why.
    """

    figures: dict[str, Any]
    targets: dict[str, bool] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def rounds(
    contenders: dict[str, tuple[Callable[[], object], int]],
    seconds: float,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, np.ndarray]:
    """Seconds a piece of each contender (a run, and how many pieces it does), round by round, taking turns.

    Lasts about `seconds` in all, and at least 5 rounds (3 where those would take ten times as long); one run of each
    before that is not counted.
    """
    for run, _ in contenders.values():
        run()
    times: dict[str, list[float]] = {name: [] for name in contenders}
    begin = time.perf_counter()
    while (done := len(next(iter(times.values())))) < 3 or (
        (took := time.perf_counter() - begin) < seconds or (done < 5 and took < 10 * seconds)
    ):
        for name, (run, pieces) in contenders.items():
            start = clock()
            run()
            times[name].append((clock() - start) / pieces)
    return {name: np.array(values) for name, values in times.items()}


def ratios(times: dict[str, np.ndarray], to: str) -> dict[str, float]:
    """Each contender's time over that of one of them: the median over rounds."""
    return {name: float(np.median(t / times[to])) for name, t in times.items()}


def microseconds(times: dict[str, np.ndarray]) -> dict[str, float]:
    """Median of each contender, us."""
    return {name: float(np.median(t)) * 1e6 for name, t in times.items()}


def table(title: str, unit: str, times: dict[str, np.ndarray], to: str) -> None:
    """Print microseconds and ratios, one line a contender."""
    found = ratios(times, to)
    print(title)
    for name, value in microseconds(times).items():
        print(f"  {name:<28} {value:>9.3g} us {unit} {found[name]:>8.3g}x")
