"""Scenario of `colift init` for a vehicle from a URDF or MJCF file.

The joints of rotors, of fingers and those that carry no tip are frozen, a nominal posture within the joint limits is
chosen, and all other numbers are scaled to the vehicle (`colift.scenario.scaling`). The text is read again before it is
returned, so that `colift check` accepts what is written.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from colift.models import aerial_manipulator, grasp, joint_roles, mjcf_import, tip_mobility, urdf_parser
from colift.models.joint_roles import JointRoles
from colift.models.link_tree import ChoiceRequiredError, CoupledJoints, InertiaRule, LinkJoint, LinkTree, reduce_tree
from colift.models.parameters import AerialManipulator
from colift.models.robot import Robot, make_agent
from colift.scenario import from_urdf, gain_limits, loading, names, team
from colift.scenario.errors import ScenarioError, unknown_name_message
from colift.scenario.scaling import vehicle_scale
from colift.scenario.template import MAX_AGENTS, VehicleTemplate, scenario_text

MAX_JOINTS = 10  # of an agent; compilation of the equations of larger ones takes minutes
JOINT_ANGLE_CANDIDATES = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)  # rad, candidates of revolute joints
MAX_CONDITION = 30.0  # of the grasp Jacobian; larger values indicate straight arms
MIN_MANIPULABILITY = 200.0  # largest condition number of a posture that is written
NUM_CANDIDATES = 3000
LIMIT_MARGIN, MAX_LIMIT_MARGIN = 0.05, 0.1  # distance of a nominal position from a limit: share of the range; rad or m
MAX_LISTED = 8  # names in a note


@dataclasses.dataclass(frozen=True)
class VehicleOptions:
    """Choices of the user; names are those of the file or their legal forms (`colift.scenario.names`)."""

    frozen: tuple[str, ...] | None = None  # joints to fix; None: as `joint_roles.classify` proposes
    tips: tuple[str, ...] = ()  # links that hold the payload; empty: as proposed
    mimic: CoupledJoints | None = None  # treatment of joints that follow another one
    inertia: InertiaRule = "strict"  # treatment of inertias that violate the triangle inequality


DEFAULT_OPTIONS = VehicleOptions()


@dataclasses.dataclass(frozen=True)
class GeneratedScenario:
    """Text of a scenario, the number of its agents, and one sentence per decision that the text contains."""

    text: str  # YAML text of the scenario
    agents: int  # number of agents
    notes: tuple[str, ...]  # one sentence per decision


@dataclasses.dataclass(frozen=True)
class _Vehicle:
    """Vehicle of a file with all choices made."""

    tree: LinkTree
    roles: JointRoles
    robot: Robot
    own: AerialManipulator
    nominal_positions: Mapping[str, float]  # rad or m, by the names of all joints that move
    bent: bool  # True if the posture is not the one closest to zero
    options: VehicleOptions


def from_urdf_file(
    name: str, agents: int | None, file: Path, folder: Path, options: VehicleOptions = DEFAULT_OPTIONS
) -> GeneratedScenario:
    """Generate a scenario with agents from a URDF file.

    Args:
        name: Name of the scenario.
        agents: Number of agents; None for the smallest team that can rotate the plate about every axis.
        file: URDF file.
        folder: Folder of the scenario; the scenario contains the path of the file relative to it.
        options: Choices of the user.

    Returns:
        The scenario.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file or an option is invalid, or if the team cannot rotate the plate about every axis; the
            message is one sentence.
    """
    vehicle = _vehicle(urdf_parser.read_urdf(file), options)
    return _generated(name, agents, vehicle, folder, lambda thrust: _urdf_section(vehicle, file, folder, thrust))


def from_mjcf_file(
    name: str, agents: int | None, file: Path, folder: Path, options: VehicleOptions = DEFAULT_OPTIONS
) -> GeneratedScenario:
    """Generate a scenario with agents from an MJCF file, in plain numbers.

    Args:
        name: Name of the scenario.
        agents: Number of agents; None for the smallest team that can rotate the plate about every axis.
        file: MJCF file.
        folder: Folder of the scenario.
        options: Choices of the user.

    Returns:
        The scenario.

    Raises:
        OSError: If the file cannot be read.
        ValueError: As `from_urdf_file`, and if MuJoCo is not installed or does not accept the file.
    """
    vehicle = _vehicle(mjcf_import.read_mjcf(file), options)
    return _generated(name, agents, vehicle, folder, lambda thrust: _plain_section(vehicle, thrust))


def _generated(
    name: str, agents: int | None, vehicle: _Vehicle, folder: Path, section: Callable[[float], str]
) -> GeneratedScenario:
    """Generate the scenario of a vehicle whose agent type is the text of a section with a maximum thrust."""
    arms = len(vehicle.roles.tips)
    agents = max(2, math.ceil(3 / arms)) if agents is None else agents
    if agents > MAX_AGENTS:
        raise ValueError(f"--agents {agents}: must be at most {MAX_AGENTS}")
    if arms * agents < 3:
        raise ValueError(f"--agents {agents}: each holds the payload at {arms}, and three contacts are needed")
    mass, base = sum(body.mass for body in vehicle.robot.bodies), vehicle.robot.bodies[0]
    scale = vehicle_scale(mass, base.mass, float(base.inertia[2, 2]))
    r = np.array([vehicle.nominal_positions[joint.name] for joint in vehicle.robot.joints])
    points, turn = _reach(vehicle.own, r), tangential_heading(vehicle.own, r)
    held = _contact_offsets(points, turn)
    notes = tuple(_notes(vehicle))
    if turn:
        notes += (
            f"the joints move the tips in one plane: the headings are turned by {turn:g} deg from the outward "
            "direction, so that the plane lies along the tangent of the payload",
        )
    comments = "".join(f"    # {note}\n" for note in notes)
    kind = f"  vehicle:\n{comments}{section(2 * 9.81 * (1.3 * mass))}"
    template = VehicleTemplate("vehicle", kind, mass, held, scale, turn)
    text = scenario_text(name, template, agents)
    try:
        settings = loading.parse(text, str(folder / f"{name}.yaml"))
    except ScenarioError as error:
        first = str(error).splitlines()[0].partition(": ")[2] or str(error)
        raise ValueError(f"{vehicle.tree.file}: the vehicle is outside of the range of a scenario: {first}") from None
    limits = gain_limits.translation_limits(settings, team.team(settings)[0])
    if limits.exceeded(settings.control):
        text = scenario_text(name, template, agents, limits.advise(settings.control))
        notes += (
            f"agents rotate to apply horizontal forces, so translation has a right half-plane zero at "
            f"{limits.zero:.3g} rad/s: lower horizontal gains and a lower agent_k_R",
        )
    return GeneratedScenario(text=text, agents=agents, notes=notes)


def _vehicle(tree: LinkTree, options: VehicleOptions) -> _Vehicle:
    """Make all choices for a vehicle; raises `ValueError` with one sentence."""
    options = _resolved(tree, options)
    roles = joint_roles.classify(tree, options.frozen, options.tips)
    nominal_positions = {joint.name: _nominal_position(joint, joint.name in roles.frozen) for joint in tree.moving}
    try:
        robot = reduce_tree(tree, options.mimic, nominal_positions, roles.frozen, options.inertia)
    except ChoiceRequiredError as error:
        raise ValueError(error.advise(lambda option, value: f"--{option} {value}")) from None
    arms, joints = len(roles.tips), len(robot.joints)
    if joints > MAX_JOINTS:
        extra = [joint.name for joint in robot.joints[MAX_JOINTS:]]
        shown = ",".join(extra[:MAX_LISTED]) + (",..." if len(extra) > MAX_LISTED else "")
        raise ValueError(
            f"{tree.joints[extra[0]].location}: {joints} joints move, up to {MAX_JOINTS} are possible: fix "
            f"{len(extra)} more, for example the last ones: --frozen {shown}"
        )
    if joints < 3 * arms - 3:
        links = ", ".join(repr(tip.link) for tip in roles.tips)
        raise ValueError(
            f"{tree.file}: {joints} joints are too few for {arms} tips (links {links}): {3 * arms - 3} or more are "
            "required; choose fewer tips with --tips"
        )
    own = make_agent(robot, [(tip.link, tip.offset) for tip in roles.tips], np.zeros((arms, 3)), 1.0)
    start = np.array([nominal_positions[joint.name] for joint in robot.joints])
    chosen = _bent(own, start, [joint.limits.position for joint in robot.joints])
    nominal_positions |= {joint.name: float(r) for joint, r in zip(robot.joints, chosen, strict=True)}
    return _Vehicle(tree, roles, robot, own, nominal_positions, not np.array_equal(start, chosen), options)


def _resolved(tree: LinkTree, options: VehicleOptions) -> VehicleOptions:
    """Replace the names of joints and links by those of the file."""
    moving = [joint.name for joint in tree.moving]

    def found(option: str, name: str, known: list[str], what: str) -> str:
        resolved = names.find_name(name, known)
        if resolved is None:
            raise ValueError(f"{option}: {unknown_name_message(name, known, what)}")
        return resolved

    frozen = options.frozen
    if frozen is not None:
        frozen = tuple(found("--frozen", name, moving, "a joint that moves") for name in frozen)
    tips = tuple(found("--tips", name, list(tree.links), "a link of the file") for name in options.tips)
    return dataclasses.replace(options, frozen=frozen, tips=tips)


# Posture --------------------------------------------------------------------------------------------------------------


def _nominal_position(joint: LinkJoint, frozen: bool) -> float:
    """Return the position closest to zero within the limits of a joint; a joint that moves has a distance from them."""
    limits = joint.limits.position
    return 0.0 if limits is None or (frozen and limits[0] <= 0.0 <= limits[1]) else _inside(0.0, limits)


def _inside(value: float, limits: tuple[float, float] | None) -> float:
    """Return the closest value within limits, with some distance from them."""
    if limits is None:
        return value
    margin = min(LIMIT_MARGIN * (limits[1] - limits[0]), MAX_LIMIT_MARGIN)
    lower, upper = limits[0] + margin, limits[1] - margin
    return value if lower <= value <= upper else float(f"{min(max(value, lower), upper):.4g}")


def _reach(own: AerialManipulator, r: np.ndarray) -> np.ndarray:
    """Compute the tip positions `(arms, 3)` [m, base frame]."""
    return np.asarray(aerial_manipulator.forward_kinematics(own, jnp.asarray(r)).points[-own.tree.arms :])


def _bent(own: AerialManipulator, start: np.ndarray, limits: Sequence[tuple[float, float] | None]) -> np.ndarray:
    """Find joint positions [rad or m] with a well-conditioned grasp Jacobian: the start if possible, else a candidate.

    The result is the start if no candidate is well conditioned.
    """

    def condition(r: np.ndarray) -> float:
        values, _ = grasp.grasp_jacobian_svd(own, r)
        return values[0] / max(values[-1], 1e-12)

    def cost(r: np.ndarray) -> float:
        tips = _reach(own, r)  # prefer tips at one height, centered below the base
        return condition(r) + np.ptp(tips[:, 2]) / 0.01 + np.abs(tips.mean(0)).sum() / 0.01 + np.abs(r).sum()

    turning = [k for k, slides in enumerate(own.tree.prismatic) if not slides]
    if condition(start) < MAX_CONDITION or not turning:
        return start
    choices = [tuple(dict.fromkeys(_inside(x, limits[k]) for x in JOINT_ANGLE_CANDIDATES)) for k in turning]
    if math.prod(map(len, choices)) <= NUM_CANDIDATES:
        tried = np.array(list(itertools.product(*choices)))
    else:
        generator = np.random.default_rng(0)
        indices = generator.choice(len(JOINT_ANGLE_CANDIDATES), (NUM_CANDIDATES, len(turning)))
        tried = np.array([[choices[c][i % len(choices[c])] for c, i in enumerate(row)] for row in indices])
    postures = np.tile(start, (len(tried), 1))
    postures[:, turning] = tried
    best = min(postures, key=cost)
    return best if condition(best) < MIN_MANIPULABILITY else start  # `check` reports parallel axes


def tangential_heading(agent: AerialManipulator, r: np.ndarray) -> float:
    """Compute the heading with which the plane of a planar arm lies along the tangent of the payload.

    The payload's yaw requires forces along the tangent. Joints that move the tips along it apply them directly.

    Args:
        agent: Parameters of the agent.
        r: Joint positions [rad, m].

    Returns:
        Heading relative to the outward direction, above -90 and up to 90 [deg]; 0 if the joints do not move the tips in
        a single plane.
    """
    bound = tip_mobility.tip_mobility(agent, r).bound
    if len(bound) != 1:
        return 0.0
    turn = round(math.degrees(-math.atan2(bound[0, 1], bound[0, 0])) % 180, 1)
    return turn if turn <= 90 else turn - 180


def _contact_offsets(tips: np.ndarray, turn: float) -> tuple[tuple[float, float, float], ...]:
    """Return the tips in the outward frame of a vehicle whose heading is turned [deg].

    The contacts of a turned vehicle are centered on the outward direction, so that its tangent is that of the contacts.
    """
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    x, y, z = tips.T
    points = np.stack([c * x - s * y, s * x + c * y, z - z.mean()], axis=1) if turn else tips - [0, 0, z.mean()]
    if turn:
        points = points - [0, points[:, 1].mean(), 0]
    return tuple((float(x), float(y), float(z)) for x, y, z in points)


# Text -----------------------------------------------------------------------------------------------------------------


def _urdf_section(vehicle: _Vehicle, file: Path, folder: Path, thrust: float) -> str:
    """Generate an agent type that refers to a URDF file."""
    roles, options = vehicle.roles, vehicle.options
    lines = [f"    urdf: {_quoted(os.path.relpath(file, folder))}", f"    thrust_max_N: {thrust:.3g}"]
    if roles.frozen:
        lines.append(f"    frozen: [{', '.join(map(_quoted, roles.frozen))}]")
    if options.mimic is not None:
        lines.append(f"    mimic_joints: {options.mimic}")
    if options.inertia != "strict":
        lines.append(f"    inertia: {options.inertia}")
    lines.append("    tips:  # links that hold the payload: check that these last links are the hands")
    for k, tip in enumerate(roles.tips):
        offset = f", tip_position_m: {list(tip.offset)}" if any(tip.offset) else ""
        lines.append(f"      - {{link: {_quoted(tip.link)}, name: hand_{k + 1}{offset}}}")
    return "\n".join(lines) + "\n" + _nominal_positions_text(vehicle)


def _plain_section(vehicle: _Vehicle, thrust: float) -> str:
    """Generate an agent type in plain numbers."""
    tips = [(f"hand_{k + 1}", *vehicle.robot.tip(tip.link, tip.offset)) for k, tip in enumerate(vehicle.roles.tips)]
    numbers = from_urdf.agent_type_numbers(vehicle.robot, float(f"{thrust:.3g}"), tips, vehicle.nominal_positions)
    lines = [f"    base: {json.dumps(numbers['base'])}", f"    thrust_max_N: {thrust:.3g}"]
    for section in ("joints", "arms"):
        entries = [f"      - {json.dumps(entry)}" for entry in numbers[section]]
        lines += [f"    {section}:", *entries] if entries else []
    return "\n".join(lines) + "\n"


def _nominal_positions_text(vehicle: _Vehicle) -> str:
    """Generate the lines of the nominal joint positions, commented out if all are zero."""
    tree, lines = vehicle.tree, []
    for unit in ("rad", "m"):
        stated = [
            f"{_quoted(name)}: {value:g}"
            for name, value in vehicle.nominal_positions.items()
            if value and (tree.joints[name].kind == "prismatic") == (unit == "m")
        ]
        if stated:
            reason = "  # at zero these arms are straight, and could not follow the payload" if vehicle.bent else ""
            lines.append(f"    nominal_position_{unit}: {{{', '.join(stated)}}}{reason if unit == 'rad' else ''}\n")
    return "".join(lines) or "    # nominal_position_rad: {joint: 0.5}  # where joints rest; 0 where omitted\n"


def _quoted(text: str) -> str:
    """Format a text as a double-quoted YAML scalar."""
    return '"' + "".join(_character(c) for c in text) + '"'


def _character(c: str) -> str:
    """Format a character of a double-quoted YAML scalar."""
    if c in '"\\':
        return f"\\{c}"
    return c if c.isprintable() else f"\\U{ord(c):08x}"


def _listed(items: Sequence[str]) -> str:
    """List names in a note, some of them if there are many."""
    shown = [name if name.isprintable() else _quoted(name) for name in items]
    if len(shown) > MAX_LISTED:
        return f"{', '.join(shown[: MAX_LISTED - 1])} ... {shown[-1]} ({len(shown)} joints)"
    return ", ".join(shown)


def _notes(vehicle: _Vehicle) -> Iterator[str]:
    """Yield one sentence per decision."""
    tree, roles, robot = vehicle.tree, vehicle.roles, vehicle.robot
    if roles.rotors:
        yield f"rotors: {_listed(roles.rotors)} fixed to the body that carries them (frozen)"
    for group in roles.grippers:
        yield f"gripper: {_listed(group)} fixed, the fingers are one tip (frozen)"
    chosen = set(vehicle.options.frozen or ())
    locked = [name for name in roles.idle if name not in chosen and tree.joints[name].limits.leave_no_range]
    if locked:
        yield f"{_listed(locked)} fixed, the limits leave no range (frozen)"
    if idle := [name for name in roles.idle if name not in {*chosen, *locked}]:
        yield f"{_listed(idle)} fixed, these joints carry no tip (frozen)"
    if roles.rests_on_base:
        (tip,) = roles.tips
        yield f"no arm found: the base holds the payload at {list(tip.offset)} of link {_listed([tip.link])}"
    moving = [joint.name for joint in robot.joints]
    for name in moving:
        limits = tree.joints[name].limits.position
        if limits is not None and _inside(0.0, limits):
            stated = f"its limits {limits[0]:g} to {limits[1]:g}"
            yield f"joint {_listed([name])} rests at {vehicle.nominal_positions[name]:g}, within {stated}"
    mapped = [name for name in moving if names.legal_name(name) != name]
    if mapped:
        pairs = [f"{_listed([name])} is {names.legal_name(name)}" for name in mapped[:MAX_LISTED]]
        yield f"names of joints in results: {', '.join(pairs)}"
    damped = [name for name in tree.damped if name in moving]
    if damped:
        yield f"damping and friction of {_listed(damped)} are not read: add a disturbance of kind joint_friction"
    yield from (*tree.notes, *robot.changes)
