"""Conclusions of studies in plain sentences, from their summaries."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

CONCLUDED_CASES = ("C1", "C2", "C3", "adaptive")
"""Cases whose errors a conclusion states, if the study contains one of them."""


def conclude_study(summary: Mapping[str, Any], warnings: Sequence[tuple[bool, str]]) -> list[str]:
    """State which cases completed, their position errors with ratios, and the number of warnings.

    Args:
        summary: Content of `summary.json`.
        warnings: Severity and text of each warning; the severity is True if the warning invalidates a result.

    Returns:
        Two or three sentences.
    """
    completed = [case for case, found in summary["cases"].items() if found["complete"]]
    errors = {case: summary["cases"][case]["e_p_rms_m"] for case in completed}
    stated = {case: e for case, e in errors.items() if case in CONCLUDED_CASES} or errors
    return [*_completion(list(summary["cases"]), completed), *_errors(stated), _warnings(warnings)]


def format_ratio(value: float | None, reference: float | None) -> str:
    """Format the ratio of two metrics with two digits.

    Args:
        value: Numerator.
        reference: Denominator.

    Returns:
        The ratio; ``none`` if it does not exist.
    """
    if value is None or reference is None or not reference or not math.isfinite(value / reference):
        return "none"
    ratio = value / reference
    return f"{ratio:.2f}" if 0.1 <= abs(ratio) < 100 else f"{ratio:.3g}" if abs(ratio) >= 100 else f"{ratio:.2g}"


def list_assumptions(names: Iterable[str]) -> str:
    """List the names of assumptions, separated by commas, with abbreviations in capital letters."""
    return ", ".join(names).replace("rkhs", "RKHS")


def join_words(words: Sequence[str]) -> str:
    """Join words by commas and ``and``."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _completion(cases: Sequence[str], completed: Sequence[str]) -> list[str]:
    """State which cases completed the flight."""
    failed = [case for case in cases if case not in completed]
    if not failed:
        return [f"{join_words(cases)} completed the flight."]
    ended = f"{join_words(failed)} ended early."
    return [f"{join_words(completed)} completed the flight; {ended}" if completed else ended]


def _errors(errors: Mapping[str, float | None]) -> list[str]:
    """State the RMS position errors and their ratios to the first case."""
    known = {case: e for case, e in errors.items() if e is not None}
    if not known:
        return []
    (first, reference), *others = known.items()
    stated = [f"{_millimeters(reference)} in {first}"]
    stated += [f"{_millimeters(e)} in {case} ({format_ratio(e, reference)} of {first})" for case, e in others]
    return [f"The RMS position error in the second half is {join_words(stated)}."]


def _millimeters(error: float) -> str:
    """Format an error with three digits."""
    return f"{1e3 * error:.3g} mm"


def _warnings(warnings: Sequence[tuple[bool, str]]) -> str:
    """State the number of warnings."""
    if not warnings:
        return "There are no warnings."
    severe = sum(is_severe for is_severe, _ in warnings)
    number = "There is 1 warning" if len(warnings) == 1 else f"There are {len(warnings)} warnings"
    if not severe:
        return f"{number}."
    which = "it" if len(warnings) == 1 else f"{severe} of them"
    return f"{number}; {which} {'invalidates' if severe == 1 else 'invalidate'} a result."
