"""An agent type as a URDF file and what the file does not say, written out in plain numbers."""

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
    """A point of a link that holds the payload."""

    link: str
    """A link of the file."""
    name: Name | None = None
    """Names the arm; the link's name if left out."""
    tip_position_m: fields.BodyPoint = ZERO
    """Contact point, in the link's frame."""


def _link(given: Any) -> Any:
    """A link alone is a tip at its origin."""
    return {"link": given} if isinstance(given, str) else given


class AgentTypeFromUrdf(Section):
    """An agent type read from a URDF file, in place of `base`, `joints` and `arms`: its root link is the base."""

    urdf: str
    """Path of the file, relative to the scenario's."""
    thrust_max_N: fields.Thrust
    """The largest thrust; a command beyond it is cut there, and the tick is marked."""
    tips: Annotated[tuple[Annotated[Tip, BeforeValidator(_link)], ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Links that hold the payload, one arm each: a link's name, or a tip with an offset."""
    mimic_joints: Literal["frozen", "independent"] | None = None
    """Joints with `<mimic>`, which the equations do not have: `frozen` where the joint they follow rests, or
    `independent`, each moving on its own; without it a file that has such joints is refused."""
    nominal_position_rad: dict[str, fields.JointAngle] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Position at rest of joints that turn, by name; 0 where left out."""
    nominal_position_m: dict[str, fields.BodyLength] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Position at rest of joints that slide, by name; 0 where left out."""


def expand(given: AgentTypeFromUrdf, folder: Path) -> tuple[dict[str, Any], list[ErrorMessage]]:
    """The agent type in plain numbers, and what is wrong with it, as `(place, sentence)`."""
    try:
        robot = urdf.load_urdf(
            folder / given.urdf, given.mimic_joints, given.nominal_position_rad | given.nominal_position_m
        )
    except OSError as error:
        return {}, [(("urdf",), f"{format_value(given.urdf)} cannot be read: {error.strerror or error}")]
    except ValueError as error:
        return {}, [(("urdf",), str(error))]
    wrong = list(_mistakes(given, robot))
    if wrong:
        return {}, wrong
    numbers = _numbers(given, robot)
    try:
        AgentType.model_validate(numbers)
    except ScenarioError as error:
        return {}, [(("urdf",), f"{given.urdf}: {line}") for line in str(error).splitlines()]
    return numbers, []


def _mistakes(given: AgentTypeFromUrdf, robot: urdf.Robot) -> Iterator[ErrorMessage]:
    for joint in robot.joints:
        if not re.fullmatch(NAME, joint.name):
            yield ("urdf",), f"joint {format_value(joint.name)}: a name is a letter, then letters, digits, - or _"
    for i, tip in enumerate(given.tips):
        if tip.link not in robot.links:
            yield ("tips", i), unknown_name_message(tip.link, robot.links, "a link of the file")
        elif tip.name is None and not re.fullmatch(NAME, tip.link):
            yield ("tips", i), f"{format_value(tip.link)} cannot name an arm: give the tip a `name`"
    for setting, slides, moves in (("nominal_position_rad", False, "turns"), ("nominal_position_m", True, "slides")):
        known = [joint.name for joint in robot.joints if joint.prismatic == slides]
        for name in getattr(given, setting):
            if name not in known:
                yield (setting, name), unknown_name_message(name, known, f"a joint that {moves}")


def _numbers(given: AgentTypeFromUrdf, robot: urdf.Robot) -> dict[str, Any]:
    """As `AgentType` has it."""
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
                rest: getattr(given, rest).get(joint.name, 0.0),
                "body": body,
            }
        )
    arms = []
    for tip in given.tips:
        body, point = robot.tip(tip.link, tip.tip_position_m)
        arms.append({"name": tip.name or tip.link, "joint": names[body], "tip_position_m": point.tolist()})
    return {"base": bodies[0], "thrust_max_N": given.thrust_max_N, "joints": joints, "arms": arms}


def _rpy_deg(R: np.ndarray) -> list[float]:
    """Angles of `R = R_z(yaw) R_y(pitch) R_x(roll)`; yaw first, so that any yaw is right where pitch is +-90 deg."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    rest = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ R
    pitch, roll = np.arctan2(-rest[2, 0], rest[0, 0]), np.arctan2(-rest[1, 2], rest[1, 1])
    return np.rad2deg([roll, pitch, yaw]).tolist()
