"""Benchmarks against other libraries, as ratios within one run:

`python -m benchmarks [NAME ...]`, or `./dev bench`. A benchmark is a module with `run(seconds)`, which prints its
measurements and returns an `Outcome`. Contenders alternate, so that the load of the machine affects all alike. A ratio
is the median over rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

NAMES = (
    "one_team",
    "work_precision",
    "batch",
    "simulators",
    "growth",
    "cold_start",
    "gpu",
    "roofline",
    "gp",
    "flight",
    "limits",
    "study",
    "parts",
)


@dataclass(frozen=True)
class Outcome:
    """Result of one benchmark: figures, targets (a sentence with the figure, and whether it is met), and omitted
    measurements with the reason.
    """

    figures: dict[str, Any]
    targets: dict[str, bool] = field(default_factory=dict)
    omitted: tuple[str, ...] = ()


def rounds(
    contenders: dict[str, tuple[Callable[[], object], int]],
    seconds: float,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, np.ndarray]:
    """Return the seconds per unit of each contender (a function, and its number of units) in alternating rounds.

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
    """Return each contender's time over that of a reference: the median over rounds."""
    return {name: float(np.median(t / times[to])) for name, t in times.items()}


def microseconds(times: dict[str, np.ndarray]) -> dict[str, float]:
    """Return the median of each contender [us]."""
    return {name: float(np.median(t)) * 1e6 for name, t in times.items()}


def table(title: str, unit: str, times: dict[str, np.ndarray], to: str) -> None:
    """Print microseconds and ratios, one line per contender."""
    found = ratios(times, to)
    print(title)
    for name, value in microseconds(times).items():
        print(f"  {name:<28} {value:>9.3g} us {unit} {found[name]:>8.3g}x")
