"""Targets of the evidence: metric, limit, and whether it is met. Evidence modules print them and pages show them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class Target(NamedTuple):
    """One target: `measured` must be at most `most`, or at least `least` if `most` is None."""

    description: str
    measured: float
    most: float | None = None
    least: float | None = None
    unit: str = ""
    note: str = ""  # spread of the values, and number of flights

    @property
    def met(self) -> bool:
        """Return whether the measured value is within the stated limits."""
        above = self.least is None or self.measured >= self.least
        return bool(above and (self.most is None or self.measured <= self.most))

    def __str__(self) -> str:
        unit, note = f" {self.unit}" * bool(self.unit), f" ({self.note})" * bool(self.note)
        return f"{self.description}: {self.measured:.3g}{unit}, {self.limit}{note}{'' if self.met else '; missed'}"

    @property
    def limit(self) -> str:
        """Return the limits as text."""
        limits = (("at least", self.least), ("at most", self.most))
        unit = f" {self.unit}" * bool(self.unit)
        return ", ".join(f"{word} {value:g}{unit}" for word, value in limits if value is not None)


def report(targets: Iterable[Target]) -> bool:
    """Print targets, one on a line, and return whether all are met."""
    targets = list(targets)
    for target in targets:
        print(target)
    return all(target.met for target in targets)


def missed(targets: Iterable[Target]) -> str:
    """Return the names of the targets that are not met, or that all are."""
    names = ", ".join(target.description for target in targets if not target.met)
    return f"missed: {names}" if names else "all targets"
