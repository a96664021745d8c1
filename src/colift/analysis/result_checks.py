"""Types of the entries of `summary.json` and `certificate.json`, for files that are damaged.

A path consists of keys; `*` stands for every key of an object or every element of a list. Entries that a file does not
contain are not checked: older files lack some, and the readers report a missing entry by its name.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from colift.analysis.study_metrics import STUDY_METRICS
from colift.runtime import text

MAX_TEXT = 60
"""Largest number of characters of a value in a message."""
TEXT, WHOLE, TRUTH, NUMBER = "a text", "a whole number", "true or false", "a number or null"
TEXT_OR_NULL = "a text or null"

SUMMARY_TYPES: Mapping[str, str] = {
    **dict.fromkeys(("scenario", "version", "settings_digest", "plant", "run", "command", "versions.*"), TEXT),
    **dict.fromkeys(("seed", "schema", "cases.*.saturated_ticks"), WHOLE),
    "cases.*.complete": TRUTH,
    "cases.*.termination_reason": TEXT,
    **dict.fromkeys(("warnings.*", "comparison_warnings.*", "cases.*.warnings.*"), TEXT),
    **{f"cases.*.{metric.key}": NUMBER for metric in STUDY_METRICS},
    "cases.*.error_bound.payload.violation_rate.*": NUMBER,
    "cases.*.error_bound.agents.*.violation_rate.*": NUMBER,
    "cases.*.contact_forces.*.bias_N.*": NUMBER,
    **{
        f"cases.*.contact_forces.*.{name}_N": NUMBER
        for name in ("peak", "mean", "internal_peak", "internal_mean", "error_rms")
    },
    "slowest_mode.description": TEXT,
    "stability_margins.description": TEXT,
    "error_bound_assumptions.unproven_assumptions.*": TEXT,
    "held_out.*.*.e_p_rms_m": NUMBER,
    "held_out.*.*.termination_reason": TEXT,
}
"""Types of the entries of a summary that readers use."""
CERTIFICATE_TYPES: Mapping[str, str] = {
    **dict.fromkeys(("scenario", "version", "settings_digest", "run", "unavailable_bounds.*"), TEXT),
    **dict.fromkeys(("seed", "schema"), WHOLE),
    "window_s.*": NUMBER,
    **{f"{name}.*": NUMBER for name in ("observed", "nominal_error", "linearization_error", "conservatism_m")},
    "tube_failure": TEXT_OR_NULL,
    "ultimate_bounds.*.a_priori.*": NUMBER,
    "ultimate_bounds.*.a_posteriori.*": NUMBER,
    "ultimate_bounds.*.bound_over_observed.*.*": NUMBER,
    "ultimate_bounds.*.status": TEXT,
    "ultimate_bounds.*.unproven_assumptions.*": TEXT,
    **{f"violations.*.{name}": TEXT for name in ("run", "kind", "error", "prediction_bound")},
    **{f"violations.*.{name}": NUMBER for name in ("observed", "ultimate_bound")},
    "adversarial_test.bound_over_observed": NUMBER,
}
"""Types of the entries of a certificate that readers use."""
OPTIONAL = ("slowest_mode", "stability_margins", "adversarial_test")
"""Sections that may be null."""


REQUIRED_OF_CASE = ("complete", "termination_reason", "warnings", "update_times_s")
REQUIRED_OF_CASE += tuple(metric.key for metric in STUDY_METRICS)
"""Entries of a case that a further study of the same run uses."""


def refuse_incomplete_case(case: str, found: Mapping[str, Any]) -> None:
    """Raise ValueError if a case of a summary lacks an entry that a further study uses.

    Args:
        case: Identifier of the case.
        found: Summary of the case.
    """
    for key in REQUIRED_OF_CASE:
        if key not in found:
            raise ValueError(f"{case} has no entry {key!r}")


def find_damage(content: Mapping[str, Any], types: Mapping[str, str]) -> Iterator[str]:
    """Yield the entries of a result file that have a wrong type.

    Args:
        content: Content of the file.
        types: Type of each entry by its path.

    Yields:
        One sentence for each entry.
    """
    for path, kind in types.items():
        yield from _check(content, path.split("."), kind, "")


def _check(value: Any, keys: list[str], kind: str, place: str) -> Iterator[str]:
    """Yield the entries below a value that have a wrong type."""
    if not keys:
        if not _is(value, kind):
            yield f"{place} is {text.shorten(value, MAX_TEXT)}, not {kind}"
        return
    key, *rest = keys
    if value is None and place in OPTIONAL:
        return
    if key == "*" and isinstance(value, list):
        entries = {str(k): entry for k, entry in enumerate(value)}
    elif isinstance(value, dict):
        entries = value if key == "*" else {key: value[key]} if key in value else {}
    else:
        yield f"{place} is {text.shorten(value, MAX_TEXT)}, not {'a list or an object' if key == '*' else 'an object'}"
        return
    for name, entry in entries.items():
        yield from _check(entry, rest, kind, f"{place}.{_short_key(name)}" if place else _short_key(name))


def _is(value: Any, kind: str) -> bool:
    """Return whether a value has a type."""
    if kind == TRUTH:
        return isinstance(value, bool)
    if kind in (TEXT, TEXT_OR_NULL):
        return isinstance(value, str) or (value is None and kind == TEXT_OR_NULL)
    if isinstance(value, bool):
        return False
    if kind == WHOLE:
        return isinstance(value, int)
    try:
        return value is None or (isinstance(value, int | float) and math.isfinite(value))
    except OverflowError:  # a whole number beyond all floats
        return False


def _short_key(key: str) -> str:
    """Return a key of limited length."""
    return key if len(key) <= MAX_TEXT else f"{key[:MAX_TEXT]}..."
