"""Agent type from a URDF file and additional settings, as plain numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from colift.models import urdf
from colift.scenario import fields
from colift.scenario.cross_checks import MAX_ENTRIES
from colift.scenario.errors import ErrorMessage, ScenarioError, format_value, unknown_name_message
from colift.scenario.schema import NAME, ZERO, AgentType, Name, Section


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
    mimic_joints: Literal["frozen", "independent"] | None = None
    """Treatment of joints with `<mimic>`, which the model does not support: `frozen` at the rest position of the joint
    they follow, or `independent`. By default a file with such joints is rejected."""
    nominal_position_rad: dict[str, fields.JointAngle] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Rest positions of revolute joints by name; default 0."""
    nominal_position_m: dict[str, fields.BodyLength] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Rest positions of prismatic joints by name; default 0."""


def expand(section: AgentTypeFromUrdf, folder: Path) -> tuple[dict[str, Any], list[ErrorMessage]]:
    """Return the agent type in plain numbers, and its errors as `(location, message)`."""
    try:
        robot = urdf.load_urdf(
            folder / section.urdf, section.mimic_joints, section.nominal_position_rad | section.nominal_position_m
        )
    except OSError as error:
        return {}, [(("urdf",), f"{format_value(section.urdf)} cannot be read: {error.strerror or error}")]
    except ValueError as error:
        return {}, [(("urdf",), str(error))]
    errors = list(_errors(section, robot))
    if errors:
        return {}, errors
    numbers = _numbers(section, robot)
    try:
        AgentType.model_validate(numbers)
    except ScenarioError as error:
        return {}, [(("urdf",), f"{section.urdf}: {line}") for line in str(error).splitlines()]
    return numbers, []


def _errors(section: AgentTypeFromUrdf, robot: urdf.Robot) -> Iterator[ErrorMessage]:
    for joint in robot.joints:
        if not re.fullmatch(NAME, joint.name):
            yield ("urdf",), f"joint {format_value(joint.name)}: a name is a letter, then letters, digits, - or _"
    for i, tip in enumerate(section.tips):
        if tip.link not in robot.links:
            yield ("tips", i), unknown_name_message(tip.link, robot.links, "a link of the file")
        elif tip.name is None and not re.fullmatch(NAME, tip.link):
            yield ("tips", i), f"{format_value(tip.link)} cannot name an arm: give the tip a `name`"
    for setting, slides, moves in (("nominal_position_rad", False, "turns"), ("nominal_position_m", True, "slides")):
        known = [joint.name for joint in robot.joints if joint.prismatic == slides]
        for name in getattr(section, setting):
            if name not in known:
                yield (setting, name), unknown_name_message(name, known, f"a joint that {moves}")


def _numbers(section: AgentTypeFromUrdf, robot: urdf.Robot) -> dict[str, Any]:
    """Return the settings of `AgentType`."""
    names = ["base", *(joint.name for joint in robot.joints)]
    bodies = [
        {"mass_kg": body.mass, "center_of_mass_m": body.com.tolist(), "inertia_kgm2": body.inertia.tolist()}
        for body in robot.bodies
    ]
    joints = []
    for joint, body in zip(robot.joints, bodies[1:], strict=True):
        kind, rest = ("prismatic", "nominal_position_m") if joint.prismatic else ("revolute", "nominal_position_rad")
        joints.append(
            {
                "name": joint.name,
                "type": kind,
                "parent": names[joint.parent],
                "position_m": joint.position.tolist(),
                "rpy_deg": _rpy_deg(joint.rotation),
                "axis": joint.axis.tolist(),
                rest: getattr(section, rest).get(joint.name, 0.0),
                "body": body,
            }
        )
    arms = []
    for tip in section.tips:
        body, point = robot.tip(tip.link, tip.tip_position_m)
        arms.append({"name": tip.name or tip.link, "joint": names[body], "tip_position_m": point.tolist()})
    return {"base": bodies[0], "thrust_max_N": section.thrust_max_N, "joints": joints, "arms": arms}


def _rpy_deg(R: np.ndarray) -> list[float]:
    """Return the angles of `R = R_z(yaw) R_y(pitch) R_x(roll)`; correct for any yaw at a pitch of +-90 deg."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    rest = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ R
    pitch, roll = np.arctan2(-rest[2, 0], rest[0, 0]), np.arctan2(-rest[1, 2], rest[1, 1])
    return np.rad2deg([roll, pitch, yaw]).tolist()
