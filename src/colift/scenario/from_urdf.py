"""Agent type from a URDF file and additional settings, as plain numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from colift.scenario import fields, names
from colift.scenario.errors import ErrorMessage, ScenarioError, format_value, unknown_name_message
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema import ZERO, AgentType, Name, Section

if TYPE_CHECKING:
    from colift.models.link_tree import LinkTree
    from colift.models.robot import Robot

MAX_FROZEN = 1000
ArmNumbers = tuple[str, int, np.ndarray]
"""Name of an arm, index of its body, and its tip in the frame of the body [m]."""


class Tip(Section):
    """Contact point of a link."""

    link: str
    """Link of the file."""
    name: Name | None = None
    """Name of the arm; default: name of the link."""
    tip_position_m: fields.BodyPoint = ZERO
    """Contact point, link frame."""


def _link(tip: Any) -> Any:
    """Convert the name of a link to a tip at its origin."""
    return {"link": tip} if isinstance(tip, str) else tip


class AgentTypeFromUrdf(Section):
    """Agent type from a URDF file instead of `base`, `joints` and `arms`; its root link is the base."""

    urdf: str
    """Path of the file, relative to the scenario's."""
    thrust_max_N: fields.Thrust
    """Largest thrust; larger commands are limited, and the log marks the tick as saturated."""
    tips: Annotated[tuple[Annotated[Tip, BeforeValidator(_link)], ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Links with a contact, one per arm: the name of a link, or a tip with an offset."""
    frozen: Annotated[tuple[str, ...], Field(max_length=MAX_FROZEN)] = ()
    """Joints that are fixed at their nominal positions, such as those of rotors and grippers."""
    mimic_joints: Literal["frozen", "independent"] | None = None
    """Treatment of joints with `<mimic>`, which the model does not support: `frozen` at the nominal position of the
    joint they follow, or `independent`. By default a file with such joints is rejected."""
    inertia: Literal["strict", "balanced"] = "strict"
    """Treatment of inertias that violate the triangle inequality: `strict` rejects them; `balanced` replaces the
    principal moments by the closest ones that satisfy it."""
    nominal_position_rad: dict[str, fields.JointAngle] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Nominal positions of revolute joints by name; default 0."""
    nominal_position_m: dict[str, fields.BodyLength] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Nominal positions of prismatic joints by name; default 0."""


def expand(section: AgentTypeFromUrdf, folder: Path) -> tuple[dict[str, Any], list[ErrorMessage]]:
    """Return the agent type in plain numbers, and its errors as `(location, message)`."""
    from colift.models import link_tree, urdf_parser  # here, because JAX takes long to import

    try:
        tree = urdf_parser.read_urdf(folder / section.urdf)
    except OSError as error:
        return {}, [(("urdf",), f"{format_value(section.urdf)} cannot be read: {error.strerror or error}")]
    except ValueError as error:
        return {}, [(("urdf",), str(error))]
    errors = list(_errors(section, tree))
    if errors:
        return {}, errors
    joints = [joint.name for joint in tree.moving]
    nominal_positions = {_found(name, joints): value for name, value in _nominal(section).items()}
    try:
        robot = link_tree.reduce_tree(
            tree,
            section.mimic_joints,
            nominal_positions,
            [_found(name, joints) for name in section.frozen],
            section.inertia,
        )
    except link_tree.ChoiceRequiredError as error:
        return {}, [(("urdf",), error.advise(_setting))]
    except ValueError as error:
        return {}, [(("urdf",), str(error))]
    numbers = agent_type_numbers(robot, section.thrust_max_N, _tips(section, robot), nominal_positions)
    try:
        AgentType.model_validate(numbers)
    except ScenarioError as error:
        return {}, [(("urdf",), f"{section.urdf}: {line}") for line in str(error).splitlines()]
    return numbers, []


def _setting(option: str, value: str) -> str:
    """Return the setting of a choice in the form of YAML."""
    forms = {"mimic": f"mimic_joints: {value}", "frozen": f"frozen: [{value.replace(',', ', ')}]"}
    return f"`{forms.get(option, f'{option}: {value}')}`"


def _nominal(section: AgentTypeFromUrdf) -> dict[str, float]:
    """Return the nominal positions of all joints [rad, m] by name."""
    return section.nominal_position_rad | section.nominal_position_m


def _found(name: str, known: list[str]) -> str:
    """Return the name in the file of a joint or link that `_errors` accepted."""
    return names.find_name(name, known) or name


def _tips(section: AgentTypeFromUrdf, robot: Robot) -> list[ArmNumbers]:
    """Return name, body and point of each arm."""
    arms = []
    for tip in section.tips:
        link = _found(tip.link, list(robot.links))
        body, point = robot.tip(link, tip.tip_position_m)
        arms.append((tip.name or names.legal_name(link), body, point))
    return arms


def _errors(section: AgentTypeFromUrdf, tree: LinkTree) -> Iterator[ErrorMessage]:
    """Check the names of joints and links in the settings."""
    from colift.models.link_tree import PRISMATIC

    moving = [joint.name for joint in tree.moving]
    for name in moving:
        try:
            names.legal_name(name)
        except ValueError as error:
            yield ("urdf",), f"{tree.joints[name].location}: joint: {error}"
    for i, tip in enumerate(section.tips):
        link = names.find_name(tip.link, list(tree.links))
        if link is None:
            yield ("tips", i), unknown_name_message(tip.link, tree.links, "a link of the file")
        elif tip.name is None:
            try:
                names.legal_name(link)
            except ValueError:
                yield ("tips", i), f"{format_value(tip.link)} cannot name an arm: give the tip a `name`"
    for i, name in enumerate(section.frozen):
        if names.find_name(name, moving) is None:
            yield ("frozen", i), unknown_name_message(name, moving, "a joint that moves")
    for setting, slides, moves in (("nominal_position_rad", False, "turns"), ("nominal_position_m", True, "slides")):
        known = [joint.name for joint in tree.moving if (joint.kind == PRISMATIC) == slides]
        for name in getattr(section, setting):
            if names.find_name(name, known) is None:
                yield (setting, name), unknown_name_message(name, known, f"a joint that {moves}")


def agent_type_numbers(
    robot: Robot, thrust_max: float, tips: Sequence[ArmNumbers], nominal_positions: Mapping[str, float]
) -> dict[str, Any]:
    """Return the settings of `AgentType`.

    Args:
        robot: Kinematics and inertias.
        thrust_max: Maximum thrust [N].
        tips: Name, body and point in the frame of the body [m] of each arm.
        nominal_positions: Nominal positions by the names of the joints in the file [rad, m]; default: 0.

    Returns:
        The settings.
    """
    legal = ["base", *(names.legal_name(joint.name) for joint in robot.joints)]
    bodies = [
        {"mass_kg": body.mass, "center_of_mass_m": body.com.tolist(), "inertia_kgm2": body.inertia.tolist()}
        for body in robot.bodies
    ]
    joints = []
    for k, (joint, body) in enumerate(zip(robot.joints, bodies[1:], strict=True)):
        kind, unit = ("prismatic", "m") if joint.prismatic else ("revolute", "rad")
        limits = joint.limits
        stated = {
            "position_limits": limits.position,
            "max_speed_radps": limits.speed,
            "max_torque_Nm": limits.effort,
        }
        joints.append(
            {
                "name": legal[k + 1],
                "type": kind,
                "parent": legal[joint.parent],
                "position_m": joint.position.tolist(),
                "rpy_deg": _rpy_deg(joint.rotation),
                "axis": joint.axis.tolist(),
                f"nominal_position_{unit}": nominal_positions.get(joint.name, 0.0),
                "body": body,
            }
            | {key: value for key, value in stated.items() if value is not None}
        )
    arms = [{"name": name, "joint": legal[body], "tip_position_m": point.tolist()} for name, body, point in tips]
    return {"base": bodies[0], "thrust_max_N": thrust_max, "joints": joints, "arms": arms}


def _rpy_deg(R: np.ndarray) -> list[float]:
    """Return the angles of `R = R_z(yaw) R_y(pitch) R_x(roll)`; correct for any yaw at a pitch of +-90 deg."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    tilt = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ R
    pitch, roll = np.arctan2(-tilt[2, 0], tilt[0, 0]), np.arctan2(-tilt[1, 2], tilt[1, 1])
    return np.rad2deg([roll, pitch, yaw]).tolist()
