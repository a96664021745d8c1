"""Settings of earlier files that have another location now, or that are constants of algorithms.

The tables use the names of schema 2. Migration moves settings of schema 1 with them after it has renamed them. The
validation of a file uses them to state where a setting is now.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import Any

from ruamel.yaml.comments import CommentedMap, CommentedSeq

from colift.scenario.errors import Location, ScenarioError

_LEARNING = "colift.onboard.learning"

CONSTANTS: dict[str, tuple[float, str | None]] = {
    "online_correction.lead_time_s": (
        0.02,
        f"the field lead_time of {_LEARNING}.residual_predictors.CorrectedResidual",
    ),
    "online_correction.hold_time_s": (0.2, None),
    "online_correction.averaging_time_s": (0.5, None),
    "online_correction.nis_threshold": (3.0, None),
    "online_correction.preview_step_s": (
        0.03,
        "the field preview_step of colift.onboard.controller.LeaderFollowerController",
    ),
    "termination.min_grasp_ratio": (
        0.01,
        "the field min_delassus of colift.closed_loop.termination.TerminationLimits",
    ),
    "termination.hover_thrust_margin": (
        0.1,
        "the argument thrust_margin of colift.analysis.preflight.run_preflight",
    ),
    "random_residual.num_centers": (
        30,
        "the argument num_centers of colift.scenario.random_residuals.sample_residuals",
    ),
    "random_residual.center_std": (
        0.2,
        "the argument center_std of colift.scenario.random_residuals.sample_residuals",
    ),
}
"""Former setting to its default, and to the field or argument that replaces it.

None: no parameter replaces it. `ResidualKalmanFilter` corrects the residual model without a hold time and without
running moments of labels.
"""

MOVED = {
    "online_correction.update_period_s": "learning.update_period_s",
    "online_correction.refit_period_s": "learning.refit_period_s",
    "learning.payload.force_std_N": "learning.payload.signal_std.force_N",
    "learning.payload.moment_std_Nm": "learning.payload.signal_std.moment_Nm",
    "learning.payload.force_noise_std_N": "learning.payload.noise_std.force_N",
    "learning.payload.moment_noise_std_Nm": "learning.payload.noise_std.moment_Nm",
    "learning.agents.force_std_N": "learning.agents.signal_std.force_N",
    "learning.agents.moment_std_Nm": "learning.agents.signal_std.moment_Nm",
    "learning.agents.joint_torque_std_Nm": "learning.agents.signal_std.joint_torque_Nm",
    "learning.agents.force_noise_std_N": "learning.agents.noise_std.force_N",
    "learning.agents.moment_noise_std_Nm": "learning.agents.noise_std.moment_Nm",
    "learning.agents.joint_torque_noise_std_Nm": "learning.agents.noise_std.joint_torque_Nm",
    "certificate.payload_label_error.force_error_N": "certificate.payload_label_error.force_N",
    "certificate.payload_label_error.moment_error_Nm": "certificate.payload_label_error.moment_Nm",
    "certificate.agent_label_error.force_error_N": "certificate.agent_label_error.force_N",
    "certificate.agent_label_error.moment_error_Nm": "certificate.agent_label_error.moment_Nm",
    "certificate.agent_label_error.joint_torque_error_Nm": "certificate.agent_label_error.joint_torque_Nm",
}
"""Former location of a setting to its present one."""

PAIRS = {
    "baselines.dob_Hz": ("baselines.dob_force_Hz", "baselines.dob_moment_Hz", 0.5),
    "baselines.ridge_alpha": ("baselines.ridge_alpha", "baselines.ridge_alpha_moment", 0.3),
}
"""Setting with one value for force and one for moment, to the two former settings and the default of the first.

The default of the second was the value of the first.
"""

FORMER_RIG_LABEL_ERROR = 0.1
"""Former default of `learning.rig_label_error`, which had an effect with label source `calibration_rig` only."""


def remedy(field: str | None) -> str:
    """State what to do with a setting that no longer exists.

    Args:
        field: Field or argument that replaces the setting; None if nothing replaces it.
    """
    return "remove it; no parameter replaces it" if field is None else f"remove it, and set {field} in Python"


def relocation_hint(location: Location, value: Any) -> str | None:
    """Describe where a former setting is now.

    Args:
        location: Location of the setting; within a section of its own, the last part of the location.
        value: Value, whose entries are described for a former section.

    Returns:
        The description; None if there was no such setting.
    """
    path = ".".join(map(str, location))
    if path == "online_correction" and isinstance(value, Mapping):
        found = [(name, relocation_hint((path, name), None)) for name in value]
        known = [f"{name} {words}" for name, words in found if words]
        return "; ".join(["is no longer a section", *known])
    for former, (_, field) in CONSTANTS.items():
        if _is_at(former, path):
            return f"is no longer a setting: {remedy(field)}"
    for former, present in _successors().items():
        if _is_at(former, path):
            return f"is now {present}"
    return None


def _successors() -> dict[str, str]:
    pairs = {former: present for present, (force, moment, _) in PAIRS.items() for former in (force, moment)}
    rig = {"learning.label_source": "learning.rig_label_error; without it, labels are from onboard sensors"}
    return MOVED | {former: f"{present}, [force, moment]" for former, present in pairs.items()} | rig


def _is_at(former: str, path: str) -> bool:
    return former == path or former.endswith(f".{path}")


def successor(path: str) -> str:
    """Return the present location of a setting; the path itself if the location is the same."""
    pairs = {former: present for present, (force, moment, _) in PAIRS.items() for former in (force, moment)}
    return (MOVED | pairs).get(path, path)


def restructure(data: MutableMapping[str, Any], names: Mapping[str, str]) -> None:
    """Move former settings to their present locations, in location and with their comments.

    Args:
        data: Scenario with names of schema 2.
        names: Names that the file has for settings of the section `baselines`, for messages.

    Raises:
        ScenarioError: If a file that extends another one states one of two settings that form a pair now.
    """
    extends = "extends" in data
    for present, (force, moment, default) in PAIRS.items():
        section, first = _holder(data, force)
        pair = (first, moment.rpartition(".")[2])
        stated = [name for name in pair if section.get(name) is not None]
        if extends and len(stated) == 1:
            this, other = (names.get(name, name) for name in (pair if stated == [first] else reversed(pair)))
            raise ScenarioError(
                f"baselines.{this}: cannot be migrated, because the file extends another one: state {other} as well"
            )
        _combine(section, present.rpartition(".")[2], pair, default)
    _join_rig_settings(data, extends)
    for former, present in MOVED.items():
        section, name = _holder(data, former)
        if name in section and isinstance(data.get(present.partition(".")[0], {}), MutableMapping):
            _move(data, former, present)
    if not data.get("online_correction", True):
        comment = _pop_comment(data, "online_correction")
        del data["online_correction"]
        if "learning" in data:
            _add_comment(data, "learning", comment)


def _holder(data: MutableMapping[str, Any], path: str) -> tuple[MutableMapping[str, Any], str]:
    """Return the section of a path and the name in it; an empty section if there is none."""
    *sections, name = path.split(".")
    holder: Any = data
    for section in sections:
        holder = holder.get(section) if isinstance(holder, MutableMapping) else None
    return (holder if isinstance(holder, MutableMapping) else {}), name


def _move(data: MutableMapping[str, Any], former: str, present: str) -> None:
    """Move a setting to its present location; a missing section is created where the setting was."""
    section, name = _holder(data, former)
    *holders, new = present.split(".")
    target, old = data, former.split(".")
    for key, was in zip(holders, old, strict=False):
        if key not in target:
            _insert(target, list(target).index(was), key, _empty_like(section))
        target = target[key]
    comment = _pop_comment(section, name)
    _insert(target, 0 if holders == ["learning"] else len(target), new, section.pop(name))
    _add_comment(target, new, comment)


def _combine(section: MutableMapping[str, Any], new: str, pair: tuple[str, str], default: float) -> None:
    """Write the settings of force and moment as one number, or as a list of two."""
    stated = [name for name in pair if name in section]
    if not stated:
        return
    at, comments = list(section).index(stated[0]), [_pop_comment(section, name) for name in stated]
    force, moment = (section.pop(name, None) for name in pair)
    if force is None and moment is None:
        return
    force = default if force is None else force
    _insert(section, at, new, force if moment in (None, force) else _inline([force, moment], section))
    for comment in comments:
        _add_comment(section, new, comment)


def _join_rig_settings(data: MutableMapping[str, Any], extends: bool) -> None:
    """Replace the source of labels by the label error of the calibration rig, if labels are from one."""
    section, name = _holder(data, "learning.label_source")
    source, comment = section.pop(name, None), _pop_comment(section, name)
    if source == "calibration_rig":
        section.setdefault("rig_label_error", FORMER_RIG_LABEL_ERROR)
    elif source is not None and extends:
        section["rig_label_error"] = None
    elif not extends:
        section.pop("rig_label_error", None)
    if "rig_label_error" in section:
        _add_comment(section, "rig_label_error", comment)


# Comments of files ----------------------------------------------------------------------------------------------------


def _insert(target: MutableMapping[str, Any], at: int, key: str, value: Any) -> None:
    if isinstance(target, CommentedMap):
        target.insert(at, key, value)
    else:
        target[key] = value


def _empty_like(section: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """Return an empty section, on one line if the given one is."""
    if not isinstance(section, CommentedMap):
        return {}
    made = CommentedMap()
    if section.fa.flow_style():
        made.fa.set_flow_style()
    return made


def _inline(values: list[Any], section: MutableMapping[str, Any]) -> list[Any]:
    """Return a list that is written on one line."""
    if not isinstance(section, CommentedMap):
        return values
    made = CommentedSeq(values)
    made.fa.set_flow_style()
    return made


def _pop_comment(section: MutableMapping[str, Any], name: str) -> list[Any] | None:
    return section.ca.items.pop(name, None) if isinstance(section, CommentedMap) else None


def _add_comment(section: MutableMapping[str, Any], name: str, comment: list[Any] | None) -> None:
    """Attach a comment to a setting, behind the comment that it has."""
    if not isinstance(section, CommentedMap) or comment is None:
        return
    before = section.ca.items.get(name)
    if before is None or before[2] is None:
        section.ca.items[name] = comment
    elif comment[2] is not None:
        before[2].value = f"{before[2].value.rstrip()} {comment[2].value.lstrip()}"
