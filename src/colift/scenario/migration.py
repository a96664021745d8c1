"""Conversion of scenarios of schema 1 to schema 2.

Schema 2 renames settings and some values and changes no number. Constants of algorithms are no longer settings but
fields of the parts that use them. A file without ``schema`` is of schema 1.

Example:
    ::

        text = migrate_text(Path("my_team.yaml").read_text())
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, MutableMapping
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq, merge_attrib
from ruamel.yaml.error import YAMLError

from colift.scenario import yaml_tree
from colift.scenario.errors import ScenarioError, format_value
from colift.scenario.former_settings import CONSTANTS, remedy, restructure, successor

SCHEMA = 2
"""Schema that this version reads and writes."""

RENAMED: dict[str, dict[str, str]] = {
    "agent_types.*.base": {
        "com_m": "center_of_mass_m",
    },
    "agent_types.*.joints.*.body": {
        "com_m": "center_of_mass_m",
    },
    "agent_types.*.joints.*": {
        "rest_rad": "nominal_position_rad",
        "rest_m": "nominal_position_m",
    },
    "agent_types.*.arms.*": {
        "tip_m": "tip_position_m",
    },
    "agents.*": {
        "contacts_m": "contact_positions_m",
    },
    "": {
        "like": "extends",
        "added": "payload_mass_step",
        "start": "initial_state",
        "drawn": "random_residual",
        "innovation": "online_correction",
        "limits": "termination",
        "plant": "physics",
        "parts": "plugins",
    },
    "added": {
        "over_s": "ramp_time_s",
    },
    "nominal.agent_types.*.base": {
        "com_m": "center_of_mass_m",
    },
    "nominal.agent_types.*.joints.*": {
        "com_m": "center_of_mass_m",
    },
    "start": {
        "body_rate_radps": "angular_velocity_radps",
    },
    "reference": {
        "ramp_s": "ramp_time_s",
        "swing_deg": "rotation_amplitude_deg",
        "swing_period_s": "rotation_period_s",
        "leaves": "departure",
        "part": "class_path",
    },
    "reference.leaves": {
        "shift_m": "offset_m",
        "over_s": "ramp_time_s",
        "swing_deg": "rotation_amplitude_deg",
        "swing_start_s": "rotation_start_s",
        "swing_period_s": "rotation_period_s",
    },
    "reference.poses.*": {
        "t_s": "time_s",
        "p_m": "position_m",
    },
    "disturbances.*": {
        "point_m": "attachment_point_m",
        "linear_Nspm": "linear_drag_Nspm",
        "quadratic_Ns2pm2": "quadratic_drag_Ns2pm2",
        "mean_mps": "mean_wind_mps",
        "turn": "direction_change",
        "length_m": "rest_length_m",
        "width_m": "std_m",
        "part": "class_path",
        "speed_radps": "smoothing_speed_radps",
    },
    "disturbances.*.gusts.*": {
        "wave_radpm": "wave_vector_radpm",
    },
    "disturbances.*.turn": {
        "angle_deg": "change_deg",
        "over_s": "ramp_time_s",
    },
    "drawn": {
        "norm": "rkhs_norm",
        "least": "min_variation",
    },
    "sensors": {
        "body_rate_radps": "angular_velocity_radps",
        "joint_deg": "joint_position_deg",
        "then": "models",
    },
    "sensors.then.*": {
        "of": "channels",
        "loss": "dropout_probability",
        "until_s": "failure_time_s",
        "rate": "random_walk_density",
        "start": "initial_bias_std",
        "part": "class_path",
    },
    "actuators.rotors": {
        "count": "num_rotors",
        "arm_m": "radius_m",
        "yaw_m": "moment_ratio_m",
    },
    "actuators": {
        "part": "class_path",
    },
    "control": {
        "posture": "posture_bandwidth",
        "fusion_Hz": "complementary_filter_Hz",
        "bias_Hz": "imu_bias_filter_Hz",
        "look_ahead_s": "preview_step_s",
    },
    "allocation.internal": {
        "ramp_s": "ramp_time_s",
        "pairs": "squeeze_pairs",
    },
    "learning": {
        "filter_Hz": "label_filter_Hz",
        "capacity": "max_samples",
        "samples": "label_source",
        "rig_error": "rig_label_error",
    },
    "learning.payload": {
        "force_N": "force_std_N",
        "moment_Nm": "moment_std_Nm",
        "force_noise_N": "force_noise_std_N",
        "moment_noise_Nm": "moment_noise_std_Nm",
    },
    "learning.agents": {
        "force_N": "force_std_N",
        "moment_Nm": "moment_std_Nm",
        "force_noise_N": "force_noise_std_N",
        "moment_noise_Nm": "moment_noise_std_Nm",
        "joint_Nm": "joint_torque_std_Nm",
        "joint_noise_Nm": "joint_torque_noise_std_Nm",
    },
    "innovation": {
        "renew_s": "update_period_s",
        "refit_s": "refit_period_s",
    },
    "baselines": {
        "K_i": "position_integral_gain",
        "k_i": "attitude_integral_gain",
        "observer_Hz": "dob_force_Hz",
        "observer_moment_Hz": "dob_moment_Hz",
        "mass_kg": "mass_prior_std_kg",
        "first_moment_kgm": "first_moment_prior_std_kgm",
        "inertia_kgm2": "inertia_prior_std_kgm2",
        "ridge": "ridge_alpha",
        "ridge_moment": "ridge_alpha_moment",
    },
    "certificate": {
        "bound": "error_bound",
        "norm": "rkhs_norm",
        "payload": "payload_label_error",
        "agents": "agent_label_error",
    },
    "certificate.agents": {
        "joint_Nm": "joint_torque_Nm",
    },
    "limits": {
        "distance_m": "max_position_error_m",
        "height_m": "min_height_m",
        "attitude_deg": "max_attitude_error_deg",
        "tilt_deg": "max_tilt_deg",
        "saturation_s": "max_saturation_time_s",
    },
    "plant": {
        "part": "class_path",
    },
    "parts": {
        "leader": "payload_controller",
        "realizer": "agent_controller",
        "predictor": "residual_predictor",
    },
    "parts.leader": {
        "part": "class_path",
    },
    "parts.allocator": {
        "part": "class_path",
    },
    "parts.realizer": {
        "part": "class_path",
    },
    "parts.estimator": {
        "part": "class_path",
    },
    "parts.predictor": {
        "part": "class_path",
    },
    "parts.features": {
        "part": "class_path",
    },
    "parts.kernel": {
        "part": "class_path",
    },
    "agent_types.*.tips.*": {
        "offset_m": "tip_position_m",
    },
    "agent_types.*": {
        "mimic": "mimic_joints",
        "rest_rad": "nominal_position_rad",
        "rest_m": "nominal_position_m",
    },
}
"""Section (``*`` for every entry of a list or mapping, in names of schema 1) to its old and new settings."""

VALUES: dict[tuple[str, str], dict[str, str]] = {
    ("allocation", "kind"): {"balanced": "least_squares"},
    ("sensors.then.*", "kind"): {"drifting": "bias_random_walk", "own": "plugin"},
    ("reference", "kind"): {"own": "plugin"},
    ("actuators", "kind"): {"own": "plugin"},
    ("plant", "kind"): {"own": "plugin"},
    ("disturbances.*", "kind"): {"own": "plugin"},
    ("learning", "samples"): {"estimated": "onboard", "rig": "calibration_rig"},
    ("learning", "hyperparameters"): {"fitted": "optimized", "stated": "fixed"},
}
"""Section and setting, in names of schema 1, to old and new values."""


_LEARNING, _CONTROL = "colift.onboard.learning", "colift.onboard.control"

REMOVED: dict[tuple[str, str], tuple[Any, str | None]] = {
    ("innovation", "lead_s"): CONSTANTS["online_correction.lead_time_s"],
    ("innovation", "hold_s"): CONSTANTS["online_correction.hold_time_s"],
    ("innovation", "span_s"): CONSTANTS["online_correction.averaging_time_s"],
    ("innovation", "surprise"): CONSTANTS["online_correction.nis_threshold"],
    ("innovation", "look_ahead_s"): CONSTANTS["online_correction.preview_step_s"],
    ("limits", "grip"): CONSTANTS["termination.min_grasp_ratio"],
    ("limits", "thrust_margin"): CONSTANTS["termination.hover_thrust_margin"],
    ("drawn", "centers"): CONSTANTS["random_residual.num_centers"],
    ("drawn", "spread"): CONSTANTS["random_residual.center_std"],
    ("innovation", "coherence"): (0.2, None),
    ("innovation", "doubt"): (10.0, None),
    ("innovation", "fade_s"): (0.3, None),
    ("innovation", "patience_s"): (
        0.02,
        "the field max_reading_age of colift.onboard.estimation.contact_forces.TipSensors",
    ),
    ("innovation", "age_s"): (20.0, None),
    ("innovation", "settle_s"): (0.5, None),
    ("innovation", "enough"): (150, None),
    ("innovation", "drag_Nspm"): (0.5, f"the fields payload and agents of {_LEARNING}.semiparametric.MeanPrior"),
    ("innovation", "drag_lever_m"): (0.4, f"the field payload of {_LEARNING}.semiparametric.MeanPrior"),
    ("innovation", "thrust_N"): (2.0, f"the field agents of {_LEARNING}.semiparametric.MeanPrior"),
    ("innovation", "constant"): (3.0, f"the fields payload and agents of {_LEARNING}.semiparametric.MeanPrior"),
    ("learning", "restarts"): (1, f"the field restarts of {_LEARNING}.model_update.FitOptions"),
    ("learning", "max_iterations"): (300, f"the field max_iterations of {_LEARNING}.model_update.FitOptions"),
    ("learning", "prior_factor"): (3.0, "the field scale_factor of colift.gp.HyperPrior"),
    ("learning", "lengthscale_bounds"): (
        [0.1, 30.0],
        "the fields min_lengthscale and max_lengthscale of colift.gp.HyperPrior",
    ),
    ("control", "haste"): (2.0, f"the field bandwidth_ratio of {_CONTROL}.actuator_compensation.LagInversion"),
    ("allocation", "lam_f0_N"): (None, f"the field offset of {_CONTROL}.allocation.AllocationMap"),
    ("actuators", "torque_max_Nm"): (None, "the field torque_max of colift.simulation.actuators.BoxLimits"),
    ("reference", "swing_phase_deg"): (
        [0.0, 0.0, 0.0],
        "the field rotation_phase of colift.trajectories.lissajous.Lissajous",
    ),
}
"""Section and setting, in names of schema 1, to the former default and the field or argument that replaces it.

None: no parameter replaces it.
"""


def migrate_text(text: str) -> str:
    """Rewrite the text of a scenario of schema 1, with its comments, as schema 2.

    Args:
        text: YAML text of a scenario file.

    Returns:
        The text in schema 2; a text of schema 2 is returned as it is.

    Raises:
        ScenarioError: If the text is not valid YAML, holds no mapping, states an unknown schema, or sets a value other
            than the default for a setting that no longer exists.
    """
    schema = yaml_tree.read_valid(text).get("schema", 1)
    if schema == SCHEMA:
        return text
    _check(schema)
    yaml = YAML()
    yaml.composer.warn_double_anchors = False  # a name may be reused
    yaml.preserve_quotes = True
    yaml.width = 4096  # lines keep their length
    yaml.indent(mapping=2, sequence=4, offset=2)
    try:
        with yaml_tree.without_version_warnings():
            data = yaml.load(text)
    except (YAMLError, ValueError) as error:  # ValueError: a date that does not exist
        raise ScenarioError(f"not valid YAML: {' '.join(str(error).split())}") from None
    except NotImplementedError as error:  # of ruamel.yaml, for comments on both sides of a missing value
        raise ScenarioError(f"a comment cannot be kept, remove it: {' '.join(str(error).split())}") from None
    assert isinstance(data, CommentedMap)
    if _has_merge_key(text):
        data = _without_merge_keys(data, {})
    _convert(data, strict=True)
    data.insert(0, "schema", SCHEMA)
    out = io.StringIO()
    yaml.dump(data, out)
    return out.getvalue()


def migrate_data(data: Mapping[str, Any], strict: bool = True) -> dict[str, Any]:
    """Rename the settings of a scenario of schema 1 that is given as plain data.

    Args:
        data: Settings of schema 1, as in the log of a flight.
        strict: Whether to refuse settings that no longer exist and have another value than the default. Otherwise they
            are dropped, which suffices to draw the team of a log.

    Returns:
        The settings in names of schema 2, without the entry ``schema``.

    Raises:
        ScenarioError: If the data state an unknown schema, or set a setting that no longer exists.
    """
    copy = _copy({key: value for key, value in data.items() if key != "schema"})
    if data.get("schema") != SCHEMA:
        _check(data.get("schema", 1))
        _convert(copy, strict)
    return copy


def migrate_path(path: str) -> str:
    """Rename a setting of schema 1 that is given by its dotted path.

    Args:
        path: Path in names of schema 1, such as ``control.look_ahead_s``.

    Returns:
        The path in names of schema 2, such as ``control.preview_step_s``. A setting that is one of a list now has the
        path of the list.
    """
    section, new = "", []
    for name in path.split("."):
        found = RENAMED.get(section, {}).get(name, name)
        new.append(found)
        step = name if _is_section(section, name) else "*"
        section = f"{section}.{step}" if section else step
    return successor(".".join(new))


def _is_section(section: str, name: str) -> bool:
    prefix = f"{section}.{name}" if section else name
    return any(known == prefix or known.startswith(f"{prefix}.") for known in RENAMED)


def _convert(data: MutableMapping[str, Any], strict: bool) -> None:
    """Remove, rename and move the settings of a scenario of schema 1, in place."""
    _remove(data, strict)
    _rename(data, "", set())
    restructure(data, {new: old for old, new in RENAMED["baselines"].items()})


def _without_merge_keys(value: Any, done: dict[int, Any]) -> Any:
    """Copy the data with the settings of each merge key (`<<: *section`) written out."""
    if id(value) in done or not isinstance(value, CommentedMap | CommentedSeq):
        return done.get(id(value), value)
    copy = done[id(value)] = type(value)()
    value.copy_attributes(copy)
    if isinstance(value, CommentedSeq):
        copy.extend(_without_merge_keys(entry, done) for entry in value)
        return copy
    if hasattr(copy, merge_attrib):
        delattr(copy, merge_attrib)
    for key in value:
        copy[key] = _without_merge_keys(value[key], done)
    return copy


def _has_merge_key(text: str) -> bool:
    return re.search(r"<<\s*:", text) is not None


def _check(schema: object) -> None:
    if schema != 1 or isinstance(schema, bool):
        raise ScenarioError(f"schema: must be 1 or {SCHEMA}, got {format_value(schema)}")


def _copy(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copy(entry) for key, entry in value.items()}
    return [_copy(entry) for entry in value] if isinstance(value, list | tuple) else value


def _remove(data: MutableMapping[str, Any], strict: bool) -> None:
    """Drop settings that no longer exist; if `strict`, refuse those that do not have the former default."""
    errors = []
    for (section, name), (default, field) in REMOVED.items():
        settings = data.get(section)
        if not isinstance(settings, MutableMapping) or name not in settings:
            continue
        value = settings[name]
        given = list(value) if isinstance(value, list | tuple) else value
        if strict and given != default:
            line = f"line {settings.lc.key(name)[0] + 1}: " if isinstance(settings, CommentedMap) else ""
            errors.append(
                f"{line}{section}.{name}: {format_value(value)} cannot be migrated, because this is no longer a "
                f"setting; {remedy(field)}"
            )
        del settings[name]
    if errors:
        raise ScenarioError("\n".join(errors))


def _rename(value: Any, section: str, done: set[int]) -> None:
    """Rename in place; an anchor that several entries share is renamed once."""
    if id(value) in done:
        return
    done.add(id(value))
    if isinstance(value, MutableMapping):
        for key in list(value):
            _rename(value[key], _below(section, str(key)), done)
        _rename_values(value, section)
        _rename_keys(value, RENAMED.get(section, {}))
    elif isinstance(value, list):
        for entry in value:
            _rename(entry, f"{section}.*", done)


def _below(section: str, key: str) -> str:
    step = key if not section or _is_section(section, key) else "*"
    return f"{section}.{step}" if section else key


def _rename_values(mapping: MutableMapping[str, Any], section: str) -> None:
    for (where, name), values in VALUES.items():
        if where == section and isinstance(mapping.get(name), str):
            mapping[name] = values.get(mapping[name], mapping[name])


def _rename_keys(mapping: MutableMapping[str, Any], renamed: Mapping[str, str]) -> None:
    keys = list(mapping)
    if isinstance(mapping, CommentedMap):
        for key in keys:
            if key in renamed:
                at = list(mapping).index(key)
                comment = mapping.ca.items.pop(key, None)
                mapping.insert(at, renamed[key], mapping.pop(key))
                if comment is not None:
                    mapping.ca.items[renamed[key]] = comment
        return
    entries = {renamed.get(key, key): mapping[key] for key in keys}
    mapping.clear()
    mapping.update(entries)
