"""Scenarios of teams with bound axes: a bar on planar arms, and random teams.

The random teams have one or two arms with up to three joints each, planar or not, with levers from 0.05 to 0.5 m, and
attitude gains from 0.3 to 3 times `u l / I`, at which a controller without the acting contact force has no stiffness.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from colift import scenario
from colift.analysis import bound_axes
from colift.models.parameters import Team
from colift.models.state import State
from colift.scenario import Scenario, ScenarioError, initial_states, team
from colift.scenario.template import VehicleTemplate, scenario_text

LEVERS = (0.05, 0.5)  # m, from the base to the tip
GAIN_RATIOS = (0.3, 3.0)  # of agent_k_R, relative to u l / I
DAMPING = 1.77
"""Ratio of `agent_k_omega` to the square root of `agent_k_R`, twice the damping ratio."""
BASE = {"mass_kg": 1.5, "inertia_kgm2": [0.02, 0.02, 0.035]}
AXES = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}


def bar(turn_deg: float = 0.0, **control: Any) -> Scenario:
    """Return three vehicles, by default with outward headings, that hold 2 kg with arms of two joints about y."""
    joints = [
        joint("shoulder", "y", [0, 0, -0.05], 0.15, [0, 0, -0.08], [3e-4, 3e-4, 3e-5]),
        joint("elbow", "y", [0, 0, -0.16], 0.12, [0, 0, -0.0816667], [2.8267e-4, 2.8267e-4, 2.1e-5], parent="shoulder"),
    ]
    arms = [{"name": "tip", "joint": "elbow", "tip_position_m": [0, 0, -0.14]}]
    text = vehicle_text({"base": BASE, "thrust_max_N": 45.1, "joints": joints, "arms": arms})
    vehicle = VehicleTemplate("vehicle", text, 1.77, ((0.0, 0.0, 0.0),), heading_deg=turn_deg)
    parsed = scenario.parse(scenario_text("bar", vehicle, 3), "bar.yaml")
    payload = parsed.payload.model_copy(
        update={"mass_kg": 2.0, "inertia_kgm2": ((0.01, 0, 0), (0, 0.4, 0), (0, 0, 0.4))}
    )
    return parsed.model_copy(update={"payload": payload, "control": parsed.control.model_copy(update=control)})


def random_team(seed: int) -> Scenario:
    """Return a random team that can be built."""
    rng = np.random.default_rng(seed)
    while True:
        candidate = _draw(rng, f"random_{seed}")
        truth, _ = team.team(candidate)
        try:
            z = initial_states.equilibrium_state(candidate, truth)
        except ScenarioError:
            continue
        k_R = float((_critical_gain(truth, z, candidate) or 250.0) * np.exp(rng.uniform(*np.log(GAIN_RATIOS))))
        gains = {"agent_k_R": k_R, "agent_k_omega": DAMPING * float(np.sqrt(k_R))}
        return candidate.model_copy(update={"control": candidate.control.model_copy(update=gains)})


def critical_gain(settings: Scenario) -> float | None:
    """Return the largest `u l / I` of the bound axes [1/s^2]; None without one."""
    truth, _ = team.team(settings)
    return _critical_gain(truth, initial_states.equilibrium_state(settings, truth), settings)


def _critical_gain(truth: Team, state: State, settings: Scenario) -> float | None:
    axes = [axis for axis in bound_axes.bound_axes(truth, state, hover_thrust(settings)) if axis.lever > 0]
    return max((axis.thrust * axis.lever / axis.inertia for axis in axes), default=None)


def hover_thrust(settings: Scenario) -> np.ndarray:
    """Return the thrust of each agent in hover, with equal shares of the payload [N]."""
    truth, _ = team.team(settings)
    masses = np.concatenate([np.asarray(group.mass.sum(1)) for group in truth.agent_groups])
    return 9.81 * (masses + float(truth.payload.mass) / len(masses))


def _draw(rng: np.random.Generator, name: str) -> Scenario:
    """Draw a team; its arms may be singular."""
    two_arms, planar, lever = rng.random() < 0.5, rng.random() < 0.5, rng.uniform(*LEVERS)
    agent_type, offsets = _two_arms(rng, planar, lever) if two_arms else _one_arm(rng, planar, lever)
    agents = int(rng.integers(2, 5) if two_arms else rng.integers(3, 6))
    heading = 0.0 if two_arms else float(rng.choice([0.0, 90.0, round(rng.uniform(-90, 90), 1)]))
    mass = BASE["mass_kg"] + sum(each["body"]["mass_kg"] for each in agent_type.get("joints", ()))
    vehicle = VehicleTemplate("vehicle", vehicle_text(agent_type), mass, offsets, heading_deg=heading)
    return scenario.parse(scenario_text(name, vehicle, agents), f"{name}.yaml")


def _one_arm(rng: np.random.Generator, planar: bool, lever: float) -> tuple[dict[str, Any], Any]:
    """Draw an arm of 0 to 3 joints below the base."""
    count = int(rng.integers(0, 4))
    axes = ["y"] * count if planar else [("x", "y")[k % 2] for k in range(count)]
    joints, link = _chain(rng, "arm", axes, lever, [0.0, 0.0, 0.0])
    last = joints[-1]["name"] if joints else "base"
    arms = [{"name": "tip", "joint": last, "tip_position_m": [0, 0, -link]}]
    return _agent_type(joints, arms), ((0.0, 0.0, 0.0),)


def _two_arms(rng: np.random.Generator, planar: bool, lever: float) -> tuple[dict[str, Any], Any]:
    """Draw a waist and two arms of 1 to 3 joints, which rotate outwards by an angle."""
    count = int(rng.integers(1, 4))
    axes = ["x"] * count if planar else [("x", "y")[k % 2] for k in range(count)]
    angle = rng.uniform(0.6, 1.2)
    joints, arms = [joint("waist", "z", [0, 0, 0], 0.1, [0, 0, 0], [1e-4, 1e-4, 1e-4])], []
    for side, sign in (("left", 1), ("right", -1)):
        chain, link = _chain(rng, side, axes, lever, [0, 0.08 * sign, 0], parent="waist", first_angle=sign * angle)
        joints += chain
        arms.append({"name": side, "joint": chain[-1]["name"], "tip_position_m": [0, 0, -link]})
    reach = round(0.08 + lever * np.sin(angle), 4)
    return _agent_type(joints, arms), ((0.0, reach, 0.0), (0.0, -reach, 0.0))


def _agent_type(joints: list[dict[str, Any]], arms: list[dict[str, Any]]) -> dict[str, Any]:
    return {"base": BASE, "thrust_max_N": 60.0, "arms": arms} | ({"joints": joints} if joints else {})


def _chain(
    rng: np.random.Generator,
    name: str,
    axes: list[str],
    lever: float,
    start: list[float],
    parent: str = "base",
    first_angle: float = 0.0,
) -> tuple[list[dict[str, Any]], float]:
    """Return joints along a straight arm, and the length of its last link [m]."""
    if not axes:
        return [], lever
    link, joints = lever / len(axes), []
    for k, axis in enumerate(axes):
        mass, position = float(rng.uniform(0.05, 0.15)), start if k == 0 else [0, 0, -link]
        across = max(mass * link**2 / 12, 1e-5)
        made = joint(f"{name}_{k}", axis, position, mass, [0, 0, -link / 2], [across, across, 1e-5], parent)
        if k == 0 and first_angle:
            made["nominal_position_rad"] = round(first_angle, 4)
        joints.append(made)
        parent = made["name"]
    return joints, link


def joint(
    name: str,
    axis: str,
    position: list[float],
    mass: float,
    com: list[float],
    inertia: list[float],
    parent: str = "base",
) -> dict[str, Any]:
    """Return the settings of a revolute joint and its body."""
    body = {"mass_kg": mass, "center_of_mass_m": com, "inertia_kgm2": inertia}
    made = {"name": name, "type": "revolute", "axis": AXES[axis], "position_m": position, "body": body}
    return made if parent == "base" else made | {"parent": parent}


def vehicle_text(agent_type: dict[str, Any]) -> str:
    """Return the entry of an agent type, which is JSON and thus YAML."""
    return f"  vehicle: {json.dumps(agent_type)}\n"
