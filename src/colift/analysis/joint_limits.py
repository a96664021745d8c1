"""Joint limits: violations at rest and in simulated flights. The plant does not enforce limits."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from colift.scenario import Scenario, schema, team

TOLERANCE = 1e-6  # rad or m, so that a position on a limit that differs by rounding is within the limits


@dataclasses.dataclass(frozen=True)
class _NamedJoint:
    """Joint of an agent with its settings and the path of its nominal position."""

    name: str  # agent/joint
    joint: schema.Revolute | schema.Prismatic
    path: str

    @property
    def unit(self) -> str:
        """Unit of the position."""
        return "rad" if isinstance(self.joint, schema.Revolute) else "m"

    @property
    def nominal(self) -> float:
        """Nominal position."""
        joint = self.joint
        return joint.nominal_position_rad if isinstance(joint, schema.Revolute) else joint.nominal_position_m


def joints_with_settings(settings: Scenario) -> tuple[_NamedJoint, ...]:
    """Return the joints of all agents in team order, with their settings.

    Args:
        settings: Scenario.

    Returns:
        One entry per joint.
    """
    return tuple(
        _NamedJoint(f"{agent.name}/{joint.name}", joint, nominal_position_path(settings, agent.type, joint))
        for group in team.group_agents(settings)
        for agent in group
        for joint in settings.agent_types[agent.type].joints
    )


def nominal_position_path(settings: Scenario, kind: str, joint: schema.Revolute | schema.Prismatic) -> str:
    """Return the path of the setting of a joint's nominal position, which differs for a type from a URDF file.

    Args:
        settings: Scenario.
        kind: Name of the agent type.
        joint: Joint of this type.

    Returns:
        Path for the option `--set`.
    """
    name = "nominal_position_rad" if isinstance(joint, schema.Revolute) else "nominal_position_m"
    if settings.agent_types[kind].from_file:
        return f"agent_types.{kind}.{name}.{joint.name}"
    return f"agent_types.{kind}.joints.{joint.name}.{name}"


def position_violations(settings: Scenario, equilibrium: np.ndarray) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Find joints whose nominal or equilibrium position is outside of their limits.

    Args:
        settings: Scenario.
        equilibrium: Joint positions at equilibrium in team order [rad or m].

    Returns:
        Sentences on the violations, and the changes that remove them.
    """
    sentences, advice = [], []
    for each, r in zip(joints_with_settings(settings), equilibrium, strict=True):
        limits = each.joint.position_limits
        if limits is None:
            continue
        lower, upper = limits
        stated = f"its limits {lower:g} to {upper:g} {each.unit}"
        if not lower - TOLERANCE <= each.nominal <= upper + TOLERANCE:
            sentences.append(
                f"{each.name} has the nominal position {each.nominal:.3g} {each.unit}, outside of {stated}"
            )
            advice.append(f"--set {each.path}={(lower + upper) / 2:.4g}")
        elif not lower - TOLERANCE <= r <= upper + TOLERANCE:
            sentences.append(f"{each.name} rests at {r:.3g} {each.unit}, outside of {stated}")
            advice.append(
                f"move the contacts of {each.name.partition('/')[0]} (agents: contact_positions_m), so that "
                f"{each.name} rests within its limits"
            )
    return tuple(sentences), tuple(dict.fromkeys(advice))


def flight_violations(
    settings: Scenario, t: np.ndarray, r: np.ndarray, r_dot: np.ndarray, torque: np.ndarray
) -> Iterator[str]:
    """Yield a warning for each joint and limit that a flight violates, with the largest violation.

    Args:
        settings: Scenario.
        t: Times [s].
        r: Joint positions in team order, one row per time [rad or m].
        r_dot: Joint velocities [rad/s or m/s].
        torque: Joint torques or forces [N m or N].

    Yields:
        Sentences.
    """
    for k, each in enumerate(joints_with_settings(settings)):
        joint, unit = each.joint, each.unit
        effort = "N m" if unit == "rad" else "N"
        lower, upper = joint.position_limits or (-np.inf, np.inf)
        speed = np.inf if joint.max_speed_radps is None else joint.max_speed_radps
        most = np.inf if joint.max_torque_Nm is None else joint.max_torque_Nm
        for values, low, high, what in (
            (r, lower, upper, f"leaves its position limits {lower:g} to {upper:g} {unit}"),
            (r_dot, -speed, speed, f"exceeds its speed limit of {speed:g} {unit}/s"),
            (torque, -most, most, f"exceeds its torque limit of {most:g} {effort}"),
        ):
            x = values[:, k]
            excess = np.maximum(x - high, low - x)
            worst = int(np.argmax(excess))
            if excess[worst] > TOLERANCE:
                yield f"{each.name} {what}: {x[worst]:.3g} at {t[worst]:.3g} s"
