"""Text of a new scenario: a team around a plate, with comments, which passes `colift check`."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from colift.models import aerial_manipulator, grasp, urdf
from colift.models.parameters import AerialManipulator


@dataclasses.dataclass(frozen=True)
class VehicleTemplate:
    """Agent type of a new scenario."""

    name: str
    text: str
    mass: float  # kg
    contact_offset: tuple[tuple[float, float, float], ...]  # m, tips: forward, left, above the mean height of the tips


VEHICLES = {  # by arms
    0: VehicleTemplate(
        name="body",
        mass=1.5,
        contact_offset=((0.0, 0.0, 0.0),),
        text="""\
  body:  # a single body with a hook below it
    base: {mass_kg: 1.5, inertia_kgm2: [0.02, 0.02, 0.035]}
    thrust_max_N: 40
    arms:
      - {name: hook, joint: base, tip_position_m: [0, 0, -0.1]}
""",
    ),
    1: VehicleTemplate(
        name="one_arm",
        mass=1.63,
        contact_offset=((0.0, 0.0, 0.0),),
        text="""\
  one_arm:  # one arm on two joints below the base
    base: {mass_kg: 1.5, inertia_kgm2: [0.02, 0.02, 0.035]}
    thrust_max_N: 40
    joints:  # redundant for one contact: they return to rest with control.posture_bandwidth
      - name: roll
        type: revolute
        axis: [1, 0, 0]
        body: {mass_kg: 0.03, inertia_kgm2: [1.0e-5, 1.0e-5, 1.0e-5]}
      - name: pitch
        type: revolute
        parent: roll
        axis: [0, 1, 0]
        body: {mass_kg: 0.1, center_of_mass_m: [0, 0, -0.1], inertia_kgm2: [3.3e-4, 3.3e-4, 1.0e-5]}
    arms:  # a longer arm permits a higher posture bandwidth
      - {name: tip, joint: pitch, tip_position_m: [0, 0, -0.2]}
""",
    ),
    2: VehicleTemplate(
        name="two_arms",
        mass=1.84,
        contact_offset=((0.0, 0.36, 0.0), (0.0, -0.36, 0.0)),
        text="""\
  two_arms:
    base: {mass_kg: 1.5, inertia_kgm2: [0.02, 0.02, 0.035]}
    thrust_max_N: 50
    joints:  # at least 3 n - 3 for n arms, to follow the payload
      - name: waist
        type: revolute
        axis: [0, 0, 1]
        body: {mass_kg: 0.1, inertia_kgm2: [1.0e-4, 1.0e-4, 1.0e-4]}
      - name: left
        type: revolute
        parent: waist
        position_m: [0, 0.08, 0]
        axis: [1, 0, 0]
        nominal_position_rad: 1.2  # from straight down, outwards; 0 and pi/2 are singular
        body: &arm {mass_kg: 0.12, center_of_mass_m: [0, 0, -0.15], inertia_kgm2: [9.0e-4, 9.0e-4, 1.0e-5]}
      - name: right
        type: revolute
        parent: waist
        position_m: [0, -0.08, 0]
        axis: [1, 0, 0]
        nominal_position_rad: -1.2
        body: *arm
    arms:
      - {name: left, joint: left, tip_position_m: [0, 0, -0.3]}
      - {name: right, joint: right, tip_position_m: [0, 0, -0.3]}
""",
    ),
}


def scenario_name(file: Path) -> str:
    """Return the name of the scenario in a file: the file name without suffix, with invalid characters replaced."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", file.stem)[:100]
    return name if re.match(r"[A-Za-z_]", name) else f"_{name}"[:100]


def scenario_template(name: str, agents: int, arms: int) -> str:
    """Generate a scenario with agents at equal distances around a plate.

    Args:
        name: Name of the scenario.
        agents: Number of agents.
        arms: Number of arms of each agent: 0 (the base has a hook), 1 or 2.

    Returns:
        Text of the scenario.

    Raises:
        ValueError: If the team cannot rotate the plate about every axis, or if there is no type with so many arms.
    """
    if arms not in VEHICLES:
        raise ValueError(f"--arms {arms}: must be 0 (single bodies that hold the plate themselves), 1 or 2")
    least = 2 if arms == 2 else 3
    if not least <= agents <= 100:
        raise ValueError(
            f"--agents {agents}: must be from {least} to 100 with --arms {arms}: "
            "three contacts that are not collinear turn the payload about every axis"
        )
    return _scenario(name, VEHICLES[arms], agents)


def from_urdf(name: str, agents: int, file: Path, folder: Path) -> str:
    """Generate a scenario with agents from a URDF file.

    The last body of each chain has a contact. Joints are at zero, or bent if the arms are straight there.

    Args:
        name: Name of the scenario.
        agents: Number of agents.
        file: URDF file.
        folder: Folder of the scenario; the scenario contains the path of the file relative to it.

    Returns:
        Text of the scenario.

    Raises:
        OSError: As `urdf.load_urdf`.
        ValueError: As `urdf.load_urdf`, and if the team cannot rotate the plate about every axis.
    """
    robot = urdf.load_urdf(file)
    tips = _tips(robot)
    if agents > 100:
        raise ValueError(f"--agents {agents}: must be at most 100")
    if len(tips) * agents < 3:
        raise ValueError(f"--agents {agents}: each holds the payload at {len(tips)}, and three contacts are needed")
    mass = sum(body.mass for body in robot.bodies)
    agent = urdf.make_agent(robot, tips, np.zeros((len(tips), 3)), 1.0)
    r = _bent(agent)
    points = _reach(agent, r)
    path = json.dumps(os.path.relpath(file, folder), ensure_ascii=False)
    hands = "\n".join(
        f"      - {{link: {json.dumps(link, ensure_ascii=False)}, name: hand_{k + 1}}}" for k, link in enumerate(tips)
    )
    kind = f"""\
  vehicle:
    urdf: {path}
    thrust_max_N: {2 * 9.81 * (1.3 * mass):.3g}
    tips:  # links that hold the payload: these carry no other; are they the hands?
{hands}
{_nominal_positions_text(robot, r)}"""
    held = tuple((float(x), float(y), float(z)) for x, y, z in points - [0, 0, points[:, 2].mean()])
    return _scenario(name, VehicleTemplate("vehicle", kind, mass, held), agents)


def _tips(robot: urdf.Robot) -> list[str]:
    """Return the outermost link of the last body of each chain; of the base if there is no other body."""
    carried = {joint.parent for joint in robot.joints}
    ends = [k for k in range(len(robot.bodies)) if k not in carried]
    distance_of = lambda link: float(np.linalg.norm(robot.tip(link)[1]))  # noqa: E731
    return [max((link for link in robot.links if robot.tip(link)[0] == k), key=distance_of) for k in ends]


JOINT_ANGLE_CANDIDATES = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)  # rad, candidates of revolute joints
MAX_CONDITION = 30.0  # of the grasp Jacobian; larger values indicate straight arms
MIN_MANIPULABILITY = 200.0  # largest condition number of a posture that is written
NUM_CANDIDATES = 3000


def _reach(agent: AerialManipulator, r: np.ndarray) -> np.ndarray:
    """Compute the tip positions `(arms, 3)` [m, base frame]."""
    return np.asarray(aerial_manipulator.forward_kinematics(agent, jnp.asarray(r)).points[-agent.tree.arms :])


def _bent(agent: AerialManipulator) -> np.ndarray:
    """Find joint positions [rad or m] with a well-conditioned grasp Jacobian: zero if possible, else a candidate.

    Joint limits are not considered. The result is zero if no candidate is well conditioned.
    """

    def condition(r: np.ndarray) -> float:
        values, _ = grasp.grasp_jacobian_svd(agent, r)
        return values[0] / max(values[-1], 1e-12)

    def cost(r: np.ndarray) -> float:
        tips = _reach(agent, r)  # prefer tips at one height, centered below the base
        return condition(r) + np.ptp(tips[:, 2]) / 0.01 + np.abs(tips.mean(0)).sum() / 0.01 + np.abs(r).sum()

    zero, arms = np.zeros(agent.tree.joints), agent.tree.arms
    turning = [k for k, slides in enumerate(agent.tree.prismatic) if not slides]
    if 3 + len(zero) < 3 * arms or condition(zero) < MAX_CONDITION or not turning:
        return zero  # `check` rejects agents with too few joints
    if len(JOINT_ANGLE_CANDIDATES) ** len(turning) <= NUM_CANDIDATES:
        tried = np.array(list(itertools.product(JOINT_ANGLE_CANDIDATES, repeat=len(turning))))
    else:
        tried = np.random.default_rng(0).choice(JOINT_ANGLE_CANDIDATES, (NUM_CANDIDATES, len(turning)))
    rests = np.zeros((len(tried), len(zero)))
    rests[:, turning] = tried
    best = min(rests, key=cost)
    return best if condition(best) < MIN_MANIPULABILITY else zero  # `check` reports parallel axes


def _nominal_positions_text(robot: urdf.Robot, r: np.ndarray) -> str:
    """Generate the line of the nominal joint positions, commented out if all are zero."""
    if not r.any():
        return "    # nominal_position_rad: {joint: 0.5}  # where joints rest; 0 where left out\n"
    bent = ", ".join(f"{json.dumps(joint.name)}: {x:g}" for joint, x in zip(robot.joints, r, strict=True) if x)
    return (
        f"    nominal_position_rad: {{{bent}}}  # at zero these arms are straight, and could not follow the payload\n"
    )


_CONTROL_AND_LEARNING = """\
control:  # slow mode: change K_p, K_v; unstable fast mode: reduce agent_k_omega, K_v
  K_p: 5
  K_v: 4.2
  k_R: 60
  k_omega: 14
  agent_k_R: 250
  agent_k_omega: 28
  posture_bandwidth: 5  # of joints that the contacts leave free
  complementary_filter_Hz: 5
  joint_filter_Hz: 20

allocation: {kind: least_squares}

learning:
  update_times_s: [2, 4, 6, 8, 10, 12]
  start_s: 0.3
  end_s: 12  # one period after the ramp, so that the samples cover the path
  sample_Hz: 20
  label_filter_Hz: 8
  max_samples: 256
  payload:
    signal_std: {force_N: 1, moment_Nm: 0.2}
    noise_std: {force_N: 0.1, moment_Nm: 0.02}
  agents:
    signal_std: {force_N: 1, moment_Nm: 0.1, joint_torque_Nm: 0.1}
    noise_std: {force_N: 0.1, moment_Nm: 0.01, joint_torque_Nm: 0.01}
"""


def _scenario(name: str, vehicle: VehicleTemplate, agents: int) -> str:
    """Generate the text for agents on a circle with clearance between rotors, and a round plate of larger radius."""
    width = 2 * max(abs(y) for _, y, _ in vehicle.contact_offset) + 0.5  # m, with the rotors
    radius = max(0.5, 0.5 * width / math.sin(math.pi / agents)) if agents > 1 else 0.0
    members = "".join(_member(f"agent_{i + 1}", vehicle, 360 * i / agents, radius) for i in range(agents))
    wave = 2 * math.pi / (4 * radius + 2 * width)  # rad/m; the wavelength exceeds the size of the payload
    mass = round(0.3 * vehicle.mass * agents, 2)
    inertia = mass * (radius + 0.1) ** 2 / 4  # of a round plate of some thickness
    return f"""\
# Written by `colift init`. Adapt first the agent type, its contacts, the payload and the reference. Validate changes
# with `colift check {name}.yaml`, and simulate them with `colift study {name}.yaml`. Settings: docs/scenarios.md.
schema: 2
name: {name}
description: {agents} agents around a plate.
duration_s: 24
control_Hz: 500
seed: 0

agent_types:  # frames: x forward, y left, z up, thrust along z
{vehicle.text}
agents:  # contacts in the payload's frame, one for each arm; no three on one line
{members}
payload: {{mass_kg: {mass:g}, inertia_kgm2: [{inertia:.4g}, {inertia:.4g}, {1.9 * inertia:.4g}]}}

nominal:  # parameters of the controller that differ from the true ones
  payload: {{mass_kg: {0.8 * mass:.4g}, inertia_kgm2: [{0.8 * inertia:.4g}, {0.8 * inertia:.4g}, {1.52 * inertia:.4g}]}}

initial_state:
  position_error_m: [0.05, -0.05, 0.05]

reference:
  kind: lissajous
  center_m: [0, 0, 2]
  amplitude_m: [0.5, 0.4, 0.2]
  period_s: 8
  phase_deg: [0, 90, 30]
  ramp_time_s: 3  # from rest

disturbances:  # unknown to the controller
  - name: wind
    kind: wind
    acts_on: payload
    attachment_point_m: [0.1, 0.1, 0]
    linear_drag_Nspm: 0.3
    mean_wind_mps: [1.5, 0.8, 0]
    gusts:
      - {{amplitude_mps: [1, 0.4, 0.5], wave_vector_radpm: [{wave:.3g}, 0, 0], phase_deg: -75}}
  - {{name: rotors, kind: rotor_bias, acts_on: agents, thrust_N: -1, torque_Nm: [0.02, -0.02, 0.01]}}

{_CONTROL_AND_LEARNING}"""


def _member(name: str, vehicle: VehicleTemplate, deg: float, radius: float) -> str:
    """Generate the entry of an agent with outward heading, and contacts at its tips."""
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    places = ((c * (radius + x) - s * y, s * (radius + x) + c * y, 0.05 + z) for x, y, z in vehicle.contact_offset)
    points = [f"[{x:.4f}, {y:.4f}, {float(f'{z:.4f}'):g}]" for x, y, z in places]
    return f"  - {{name: {name}, type: {vehicle.name}, yaw_deg: {deg:g}, contact_positions_m: [{', '.join(points)}]}}\n"
