"""Types of the entries of `summary.json` and `certificate.json`, for files that are damaged.

A path consists of keys. `*` stands for every key of an object, `<name>` for every key that is an identifier, and `[]`
for every element of a list. Entries that a file does not contain are not checked: older files lack some, and the
readers report a missing entry by its name.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from colift.analysis.study_metrics import STUDY_METRICS
from colift.runtime import text

MAX_TEXT = 60
"""Largest number of characters of a value in a message."""
TEXT, TRUTH, NUMBER, WHOLE = "a text", "true or false", "a number or null", "a whole number of at least 0"
TEXT_OR_NULL, SIZE, RATE = "a text or null", "a number of at least 0 or null", "a number from 0 to 1 or null"
TIME = "a number of at least 0"
VECTORS = {"a list of two numbers": 2, "a list of three numbers": 3}
"""Lists of a fixed length with their numbers of elements."""
PAIR, VECTOR = VECTORS

_SIZES_OF_CASE = (
    *(metric.key for metric in STUDY_METRICS if metric.key != "thrust_max_N"),
    *("e_v_rms_mps", "e_omega_rms_radps", "delta_W_rms", "sigma_L_mean", "sigma_A_mean"),
    *("sigma_L_moment_mean_Nm", "sigma_A_moment_mean_Nm", "contact_force_hf_rms_N", "wrench_consistency_max"),
    *("interface_identity_max", "Phi_max_m", "Phi_dot_max_mps", "eta_max_N", "min_delassus_singular_value_1pkg"),
)
_CASE_TYPES: Mapping[str, str] = {
    **dict.fromkeys(("saturated_ticks", "num_samples.*"), WHOLE),
    "complete": TRUTH,
    **dict.fromkeys(("termination_reason", "warnings.[]"), TEXT),
    **dict.fromkeys((*_SIZES_OF_CASE, "wall_time_s.*"), SIZE),
    **dict.fromkeys(("thrust_min_N", "thrust_max_N", "residual.*.*.[]"), NUMBER),
    "update_times_s.[]": TIME,
    **dict.fromkeys(("miscoverage.payload.rate.[]", "miscoverage.agents.rate.[].[]"), RATE),
    **dict.fromkeys(
        ("miscoverage.payload.normalized_error_rms.[]", "miscoverage.agents.normalized_error_rms.[].[]"), SIZE
    ),
    **dict.fromkeys(("error_bound.payload.violation_rate.*", "error_bound.agents.[].violation_rate.*"), RATE),
    **dict.fromkeys(
        ("error_bound.payload.bound_over_error_median", "error_bound.agents.[].bound_over_error_median"), SIZE
    ),
    **dict.fromkeys(("error_bound.payload.beta.[]", "error_bound.agents.[].beta.[]"), NUMBER),
    "contact_forces.*.bias_N": VECTOR,
    **{
        f"contact_forces.*.{name}_N": SIZE
        for name in ("peak", "mean", "internal_peak", "internal_mean", "error_rms", "std")
    },
    **dict.fromkeys(("contact_force_prior.unknowns", "contact_force_prior.combinations"), WHOLE),
    **{f"contact_force_prior.{part}.{name}": SIZE for part in ("force", "moment") for name in ("std", "error_rms")},
}
"""Types of the entries of one case."""
SUMMARY_TYPES: Mapping[str, str] = {
    **dict.fromkeys(("scenario", "version", "settings_digest", "plant", "run", "command", "versions.*"), TEXT),
    **dict.fromkeys(("seed", "schema"), WHOLE),
    **dict.fromkeys(("warnings.[]", "comparison_warnings.[]"), TEXT),
    **dict.fromkeys(("check.verdict", "check.failed.[]", "check.weak.[]"), TEXT),
    **{f"cases.<name>.{path}": kind for path, kind in _CASE_TYPES.items()},
    **dict.fromkeys(("slowest_mode.description", "stability_margins.description"), TEXT),
    "slowest_mode.stable": TRUTH,
    "slowest_mode.eigenvalue_radps.[]": NUMBER,
    "stability_margins.delay_margin_s": SIZE,
    "stability_margins.gain_margin": PAIR,
    "error_bound_assumptions.bound": TEXT,
    "error_bound_assumptions.unproven_assumptions.[]": TEXT,
    "error_bound_assumptions.confidence": RATE,
    **dict.fromkeys(
        (
            "error_bound_assumptions.rkhs_norm",
            "error_bound_assumptions.label_error_payload.[]",
            "error_bound_assumptions.label_error_agents.[]",
            "termination_limits.min_delassus_singular_value_1pkg.[]",
        ),
        SIZE,
    ),
    **{
        f"termination_limits.{name}": NUMBER
        for name in (
            *("max_position_error_m", "min_height_m", "max_attitude_error_deg", "max_tilt_deg"),
            *("max_saturation_time_s", "min_grasp_ratio"),
        )
    },
    "hover_thrust_N.*": NUMBER,
    "held_out.<name>.<name>.e_p_rms_m": SIZE,
    "held_out.<name>.<name>.termination_reason": TEXT,
    "residual.*.*.[]": NUMBER,
    "wall_time_s.*": SIZE,
}
"""Types of the entries of a summary."""
CERTIFICATE_TYPES: Mapping[str, str] = {
    **dict.fromkeys(("scenario", "version", "settings_digest", "run", "unavailable_bounds.*", "units.*"), TEXT),
    **dict.fromkeys(("seed", "schema", "num_components_outside.*"), WHOLE),
    "window_s": PAIR,
    "confidence": RATE,
    **{
        f"{name}.*": SIZE
        for name in (
            *("observed", "nominal_error", "linearization_error", "disturbance_response", "noise_response"),
            *("conservatism_m", "adversarial_test.observed", "adversarial_test.a_posteriori"),
        )
    },
    "tube_failure": TEXT_OR_NULL,
    "ultimate_bounds.*.a_priori.*": SIZE,
    "ultimate_bounds.*.a_posteriori.*": SIZE,
    "ultimate_bounds.*.bound_over_observed.*.*": SIZE,
    "ultimate_bounds.*.status": TEXT,
    "ultimate_bounds.*.unproven_assumptions.[]": TEXT,
    **{f"violations.[].{name}": TEXT for name in ("run", "kind", "error", "prediction_bound")},
    **{f"violations.[].{name}": SIZE for name in ("observed", "ultimate_bound")},
    "adversarial_test.bound_over_observed": SIZE,
}
"""Types of the entries of a certificate."""
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
    if not isinstance(value, list if key == "[]" else dict):
        yield f"{place} is {text.shorten(value, MAX_TEXT)}, not {'a list' if key == '[]' else 'an object'}"
        return
    if key == "[]":
        entries = {str(k): entry for k, entry in enumerate(value)}
    else:
        entries = value if key in ("*", "<name>") else {key: value[key]} if key in value else {}
    for name, entry in entries.items():
        if key == "<name>" and not re.fullmatch("[A-Za-z0-9_]+", name):
            yield f"{place} has the entry {text.shorten(name, MAX_TEXT)}, whose name is not an identifier"
            return
        yield from _check(entry, rest, kind, f"{place}.{_short_key(name)}" if place else _short_key(name))


def _is(value: Any, kind: str) -> bool:
    """Return whether a value has a type."""
    if kind == TRUTH:
        return isinstance(value, bool)
    if kind in (TEXT, TEXT_OR_NULL):
        return isinstance(value, str) or (value is None and kind == TEXT_OR_NULL)
    if kind in VECTORS:
        return isinstance(value, list) and len(value) == VECTORS[kind] and all(_is(each, NUMBER) for each in value)
    if value is None:
        return kind in (NUMBER, SIZE, RATE)
    if isinstance(value, bool) or not isinstance(value, int if kind == WHOLE else int | float):
        return False
    least, largest = -math.inf if kind == NUMBER else 0, 1 if kind == RATE else math.inf
    try:
        return least <= value <= largest and (kind == WHOLE or math.isfinite(value))
    except OverflowError:  # a whole number beyond all floats
        return False


def _short_key(key: str) -> str:
    """Return a key of limited length in one line."""
    short = key if len(key) <= MAX_TEXT else f"{key[:MAX_TEXT]}..."
    return short if short.isprintable() else repr(short)
