"""Checks of the bound axes of a scenario: attitude stiffness, tilt by a torque, and the gains of the payload.

See Also:
    colift.analysis.bound_axes: definitions.
    colift.scenario.gain_limits: limits of the gains of translation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from colift.analysis import bound_axes, headings, remedies
from colift.analysis.bound_axes import BoundAxis
from colift.analysis.findings import Finding, Level
from colift.models.parameters import Team
from colift.models.state import State
from colift.onboard.control import bound_tips
from colift.scenario import Scenario, controllers, gain_limits, team

REFERENCE_TORQUE = 0.01
"""Torque whose tilt is reported if the disturbances apply none to the agents [N m]."""
MIN_STIFFNESS_SHARE = 0.5
"""Smallest share of the attitude stiffness that must remain; used with the commanded contact force only."""
YAW_GAIN_LEVEL = Level.weak
"""Level of yaw gains above the limit; whether yaw is unstable then follows from the slowest mode."""
TRANSLATION_GAIN_LEVEL = Level.weak
"""Level of horizontal gains above the limit; whether the payload is unstable then follows from the slowest mode."""


@dataclasses.dataclass(frozen=True)
class _TypeAxis:
    """Bound direction of the agents of one type; of its agents the one with the smallest bandwidth."""

    kind: str
    label: str  # of the direction, for example `y`
    axis: BoundAxis


def check_bound_axes(
    settings: Scenario,
    axes: Sequence[BoundAxis],
    torques: np.ndarray,
    compensated: bool = True,
) -> Iterator[Finding]:
    """Report attitude stiffness, tilt and bandwidth of every agent type and bound direction.

    Args:
        settings: Scenario.
        axes: Bound axes of the team.
        torques: Torques of the disturbances on each agent at rest `(agents, 3)`, base frame [N m].
        compensated: Whether the torques of the agent controller contain the contact force that will act.

    Yields:
        One finding, or none if no agent has a bound axis.
    """
    k_R = settings.control.agent_k_R
    sentences, values, advice, level = [], {}, [], Level.passed
    for found in _by_type(settings, axes):
        axis = found.axis
        torque = _largest_torque(settings, found, torques)
        asked, left = axis.attitude_stiffness(k_R), axis.attitude_stiffness(k_R, compensated)
        tilt = np.degrees(axis.tilt(torque, k_R, compensated))
        values[f"{found.kind}/{found.label}"] = {
            "thrust_N": axis.thrust,
            "lever_m": axis.lever,
            "inertia_kgm2": axis.inertia,
            "stiffness_Nmprad": asked,
            "remaining_stiffness_Nmprad": left,
            "torque_Nm": torque,
            "tilt_deg": float(tilt) if np.isfinite(tilt) else None,
            "bandwidth_radps": axis.bandwidth if np.isfinite(axis.bandwidth) else None,
        }
        stiffness = f"{asked:.3g} N m/rad" + ("" if compensated else f", of which {left:.3g} remain")
        limit = f", bandwidth {axis.bandwidth:.3g} rad/s" if np.isfinite(axis.bandwidth) else ""
        sentences.append((found, f"stiffness {stiffness}, {torque:.2g} N m tilt it by {tilt:.3g} deg{limit}"))
        if left < MIN_STIFFNESS_SHARE * asked:
            level = Level.failed
            needed = axis.thrust * axis.lever / axis.inertia / (1 - MIN_STIFFNESS_SHARE)
            advice += [f"--set control.agent_k_R={needed:.3g}", _joint_advice(found)]
    if sentences:
        message = f"no joint moves the tips of {_merged(sentences)}"
        yield Finding("bound axes", message, {"axes": values}, tuple(dict.fromkeys(advice)), level)


def check_yaw_gains(
    settings: Scenario, truth: Team, state: State, axes: Sequence[BoundAxis], zero: float
) -> Iterator[Finding]:
    """Check the yaw gains of the payload against the bandwidth of bound tips.

    Args:
        settings: Scenario.
        truth: True parameters.
        state: State at rest.
        axes: Bound axes of the team.
        zero: Zero of the payload's yaw command [rad/s], see `bound_tips.yaw_zero`.

    Yields:
        One finding, or none if the zero does not limit the stated gains.
    """
    given = settings.control
    stated = float(np.broadcast_to(given.k_R, 3)[2]), float(np.broadcast_to(given.k_omega, 3)[2])
    unlimited = bound_tips.default_yaw_gains(zero, *stated) == stated
    if unlimited and bound_axes.yaw_gains_within_limit(zero, *stated):
        return
    gains = controllers.gains(settings, truth)
    k_R, k_omega = np.asarray(gains.k_R), np.asarray(gains.k_omega)
    good = bound_axes.yaw_gains_within_limit(zero, float(k_R[2]), float(k_omega[2]))
    limits = bound_axes.MAX_YAW_STIFFNESS * zero**2, bound_axes.MAX_YAW_RATE_GAIN * zero
    message = (
        f"no joint moves the tips along the tangent, so yaw has a right half-plane zero at {zero:.3g} rad/s: "
        f"control.k_R = {k_R[2]:.3g} 1/s^2 about z (limit {limits[0]:.3g}), "
        f"control.k_omega = {k_omega[2]:.3g} 1/s (limit {limits[1]:.3g})"
    )
    values = {"zero_radps": zero, "k_R_1ps2": float(k_R[2]), "k_omega_1ps": float(k_omega[2])}
    values |= {"max_k_R_1ps2": limits[0], "max_k_omega_1ps": limits[1]}
    advice = () if good else yaw_advice(settings, truth, state, axes, zero)
    yield Finding("yaw gain", message, values, advice, Level.passed if good else YAW_GAIN_LEVEL)


def yaw_advice(
    settings: Scenario, truth: Team, state: State, axes: Sequence[BoundAxis], zero: float
) -> tuple[str, ...]:
    """Propose lower yaw gains, headings that turn planar arms, or another joint.

    Args:
        settings: Scenario.
        truth: True parameters.
        state: State at rest.
        axes: Bound axes of the team.
        zero: Zero of the payload's yaw command [rad/s].

    Returns:
        Sentences with options to type.
    """
    given = settings.control
    k_R, k_omega = (np.broadcast_to(x, (3,)).tolist() for x in (given.k_R, given.k_omega))
    stiffness, rate = bound_axes.advised_yaw_gains(zero)
    lowered = (("k_R", k_R, stiffness), ("k_omega", k_omega, rate))
    advice = [
        " ".join(
            f"--set 'control.{name}=[{gain[0]:g},{gain[1]:g},{limit:g}]'"
            for name, gain, limit in lowered
            if limit < gain[2]
        )
    ]
    if turns := headings.turns_to_tangent(settings, truth, state):
        option, _ = headings.heading_change(settings, turns)
        advice.append(f"{option} turns the arms, so that their joints move the tips along the tangent")
    else:
        limiting = min(_by_type(settings, axes), key=lambda found: found.axis.bandwidth)
        advice.append(_joint_advice(limiting))
    return tuple(advice)


def check_translation_gains(settings: Scenario, limits: gain_limits.TranslationLimits) -> Iterator[Finding]:
    """Check the horizontal gains of the payload and the attitude gain of the agents against the limits of bound tips.

    Args:
        settings: Scenario.
        limits: Limits of the team.

    Yields:
        One finding, or none if bound tips do not limit translation.
    """
    if not np.isfinite(limits.zero):
        return
    present = gain_limits.present_gains(settings.control)
    most = limits.gains(gain_limits.LIMITS, settings.control.agent_k_omega)
    good = not limits.exceeded(settings.control)
    message = (
        f"agents rotate to apply horizontal forces, so translation has a right half-plane zero at {limits.zero:.3g} "
        f"rad/s: control.K_v = {present.K_v:.3g} 1/s across the vertical (limit {most.K_v:.3g}), "
        f"control.agent_k_R = {present.agent_k_R:.3g} 1/s^2 (limit {most.agent_k_R:.3g})"
    )
    values = {"zero_radps": limits.zero, "inertia_ratio": limits.inertia_ratio, "K_v_1ps": present.K_v}
    values |= {"max_K_v_1ps": most.K_v, "agent_k_R_1ps2": present.agent_k_R, "max_agent_k_R_1ps2": most.agent_k_R}
    advice = () if good else (remedies.translation_change(settings, limits)[0],)
    yield Finding("translation gain", message, values, advice, Level.passed if good else TRANSLATION_GAIN_LEVEL)


def _joint_advice(found: _TypeAxis) -> str:
    """Propose a joint that moves the tips in a bound direction."""
    return f"or add a joint that moves the tips along {found.label} (agent_types.{found.kind}.joints)"


def _by_type(settings: Scenario, axes: Sequence[BoundAxis]) -> list[_TypeAxis]:
    """Return one bound axis per agent type and direction, with the smallest bandwidth."""
    kinds = {agent.name: agent.type for agent in settings.agents}
    found: dict[tuple[str, str], _TypeAxis] = {}
    for axis in axes:
        key = kinds[axis.agent], _label(axis.direction)
        if key not in found or axis.bandwidth < found[key].axis.bandwidth:
            found[key] = _TypeAxis(*key, axis)
    return list(found.values())


def _label(direction: np.ndarray) -> str:
    """Return the name of a direction: that of a base axis, or the angle from the x axis."""
    for name, unit in zip("xy", np.eye(3), strict=False):
        if abs(direction @ unit) > 0.999:
            return name
    return f"{np.degrees(np.arctan2(direction[1], direction[0])):.0f} deg from x"


def _largest_torque(settings: Scenario, found: _TypeAxis, torques: np.ndarray) -> float:
    """Return the largest disturbance torque on the agents of a type about the axis of the rotation [N m]."""
    kinds = {agent.name: agent.type for agent in settings.agents}
    members = [kinds[name] == found.kind for name in team.agent_names(settings)]
    axis = np.cross([0.0, 0.0, 1.0], found.axis.direction)
    largest = float(np.abs(torques[np.array(members)] @ axis).max())
    return largest if largest > 1e-9 else REFERENCE_TORQUE


def _merged(sentences: Sequence[tuple[_TypeAxis, str]]) -> str:
    """Join the sentences of all types; directions with equal numbers are named together."""
    labels: dict[tuple[str, str], list[str]] = {}
    for found, text in sentences:
        labels.setdefault((found.kind, text), []).append(found.label)
    return "; ".join(f"{kind} along {' and '.join(names)}: {text}" for (kind, text), names in labels.items())
