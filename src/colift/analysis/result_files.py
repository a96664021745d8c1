"""Content of `summary.json` and `certificate.json`: schema, and reading of files of earlier versions.

Keys are standard terms and end with the unit of the value, where it has one. `load_summary` and `load_certificate`
rename the keys of schema 1, so that all readers use the present names.

See Also:
    colift.closed_loop.log: reading of the logs of flights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from colift.analysis import result_checks
from colift.closed_loop import log_upgrade
from colift.runtime import bounded_read

SCHEMA = 2
"""Schema of the files that this version writes; files of version 0.1 have schema 1 and no entry `schema`."""

Content = dict[str, Any]  # content of a JSON object

SUMMARY_KEYS = {  # keys of schema 1 and their present names, here and below
    "settings": "settings_digest",
    "margins": "stability_margins",
    "limits": "termination_limits",
    "heldout": "held_out",
    "bound": "error_bound_assumptions",
    "wall_s": "wall_time_s",
}
CASE_KEYS = {
    "I": "integral",
    "DOB": "disturbance_observer",
    "P": "parametric",
    "R": "regression",
    "F": "label_feedback",
    "H": "gp_label_feedback",
    "C4": "adaptive",
    "O": "true_residual",
}
LOOP_KEYS = {
    "says": "description",
    "rad_s": "eigenvalue_radps",
    "delay_s": "delay_margin_s",
    "gain": "gain_margin",
}
BOUND_ASSUMPTION_KEYS = {"norm": "rkhs_norm", "assumed": "unproven_assumptions"}
METRIC_KEYS = {
    "stopped": "termination_reason",
    "e_v_rms": "e_v_rms_mps",
    "e_omega_rms": "e_omega_rms_radps",
    **{f"sigma_{body}_force_mean": f"sigma_{body}_force_mean_N" for body in "LA"},
    **{f"sigma_{body}_moment_mean": f"sigma_{body}_moment_mean_Nm" for body in "LA"},
    "lam_hf_rms_N": "contact_force_hf_rms_N",
    "Phi_dot_max": "Phi_dot_max_mps",
    "singular_min": "min_delassus_singular_value_1pkg",
    "n_data": "num_samples",
    "updates": "update_times_s",
    "outside": "miscoverage",
    "share": "rate",
    "error_over_deviation": "normalized_error_rms",
    "bound": "error_bound",
    "exceeded_share": "violation_rate",
    "plain": "total",
    "tightness_median": "bound_over_error_median",
    "varying_rms": "state_dependent_std",
    "constant_share": "mean_power_fraction",
    "wall_s": "wall_time_s",
    "radii": "error_bounds",
}
CERTIFICATE_KEYS = {
    "settings": "settings_digest",
    "exceeded": "violations",
    "floor": "nominal_error",
    "unknown": "disturbance_response",
    "beyond_first_order": "linearization_error",
    "noise": "noise_response",
    "components_left": "num_components_outside",
    "radii": "ultimate_bounds",
    "left_out": "unavailable_bounds",
    "no_tube": "tube_failure",
    "interface": "agent_iss",
    "slack_m": "conservatism_m",
    "adversary": "adversarial_test",
}
KIND_KEYS = {"tube": "a_priori", "run": "a_posteriori"}
BOUND_KEYS = KIND_KEYS | {"tightness": "bound_over_observed", "assumed": "unproven_assumptions"}
VIOLATION_KEYS = {"flight": "run", "of": "kind", "bound": "prediction_bound", "radius": "ultimate_bound"}
VIOLATION_VALUES = {"this": "simulation", "adversary": "adversarial_test", **KIND_KEYS}
ADVERSARIAL_TEST_KEYS = {"radius": "a_posteriori", "radius_over_adversary": "bound_over_observed"}
TUBE_KEYS = {"difference": "residual_deviation"}
AGENT_ISS_KEYS = {"gamma_1_s": "gamma_1ps", "kappa_N_Nm": "kappa", "static_N_Nm": "static_gain"}
CONSERVATISM_KEYS = {
    "the paper's beta, mismatch and error added": "sum of norms, Srinivas bound",
    "energy bound, mismatch and error added": "sum of norms, energy bound",
    "energy bound, one loop for both": "linearized loop, energy bound",
    **{
        f"{name}, one functional, {old}": f"{name}, {new}"
        for name in ("energy", "recovery")
        for old, new in (("any run", "a priori"), ("this run", "a posteriori"))
    },
    "floor: nothing unknown": "nominal error",
}


def load_summary(path: str | Path) -> Content:
    """Read `summary.json`.

    Args:
        path: Path of an existing file.

    Returns:
        Content of the file with the keys of the present schema.

    Raises:
        ValueError: If the file is not a summary, is damaged, or has a later schema.
    """
    return _load(Path(path), "cases", _upgrade_summary, result_checks.SUMMARY_TYPES)


def load_certificate(path: str | Path) -> Content:
    """Read `certificate.json`.

    Args:
        path: Path of an existing file.

    Returns:
        Content of the file with the keys of the present schema.

    Raises:
        ValueError: If the file is not a certificate, is damaged, or has a later schema.
    """
    return _load(Path(path), "observed", _upgrade_certificate, result_checks.CERTIFICATE_TYPES)


def _load(path: Path, required: str, upgrade: Callable[[Content], Content], types: Mapping[str, str]) -> Content:
    """Read a file; a file of schema 1 is upgraded."""
    content = bounded_read.read_json(path)
    if required not in content:
        raise ValueError(f"{path}: has no entry {required}, so it is not a result file of colift")
    schema = content.get("schema", 1)
    if schema == 1:
        try:
            content = upgrade(content) | {"schema": SCHEMA}
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"{path}: is damaged ({type(error).__name__}: {error})") from error
    elif schema != SCHEMA:
        raise ValueError(f"{path}: is of schema {schema!r:.60}; this version of colift reads schema {SCHEMA} and 1")
    for fault in result_checks.find_damage(content, types):
        raise ValueError(f"{path}: is damaged ({fault})")
    return content


def _upgrade_summary(content: Content) -> Content:
    """Rename the keys of a summary of schema 1."""
    summary = _rename(content, SUMMARY_KEYS)
    for name, table in (
        ("slowest_mode", LOOP_KEYS),
        ("stability_margins", LOOP_KEYS),
        ("termination_limits", log_upgrade.LIMITS),
        ("error_bound_assumptions", BOUND_ASSUMPTION_KEYS),
    ):
        if summary.get(name) is not None:
            summary[name] = _rename(summary[name], table)
    for name in ("cases", "held_out"):
        if name in summary:
            summary[name] = _rename_nested(_rename(summary[name], CASE_KEYS), METRIC_KEYS)
    if "residual" in summary:
        summary["residual"] = _rename_nested(summary["residual"], METRIC_KEYS)
    return summary


def _upgrade_certificate(content: Content) -> Content:
    """Rename the keys of a certificate of schema 1."""
    found = _rename(content, CERTIFICATE_KEYS)
    for name, table in (
        ("num_components_outside", KIND_KEYS),
        ("tube", TUBE_KEYS),
        ("agent_iss", AGENT_ISS_KEYS),
        ("conservatism_m", CONSERVATISM_KEYS),
        ("adversarial_test", ADVERSARIAL_TEST_KEYS),
    ):
        if found.get(name) is not None:
            found[name] = _rename(found[name], table)
    found["ultimate_bounds"] = _rename_nested(found["ultimate_bounds"], BOUND_KEYS)
    found["violations"] = [
        {name: VIOLATION_VALUES.get(value, value) for name, value in _rename(each, VIOLATION_KEYS).items()}
        for each in found["violations"]
    ]
    return found


def _rename(content: Mapping[str, Any], table: Mapping[str, str]) -> Content:
    """Rename the keys of one level."""
    return {table.get(key, key): value for key, value in content.items()}


def _rename_nested(content: Any, table: Mapping[str, str]) -> Any:
    """Rename the keys of all levels."""
    if isinstance(content, dict):
        return {table.get(key, key): _rename_nested(value, table) for key, value in content.items()}
    return [_rename_nested(each, table) for each in content] if isinstance(content, list) else content
