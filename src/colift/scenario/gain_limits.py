r"""Limits of the gains of payload translation and agent attitude for agents with bound directions.

Agents apply horizontal forces along bound directions (`redundancy.bound_directions`, matrix `D`) by rotations about
their tips. Let phi be the tilt, u the thrust, m the mass, l the height of the center of mass above the tips, and m_L
the mass of the payload. For equal agents the payload accelerates by

    `x_dd = g (phi - phi_dd / z^2)`,    `z^-2 = norm((m_L I + sum m D)^-1 sum m l D) / g`.

The gain of this transfer function has its minimum between low and high frequencies at the zero z. With the position
gains `K_p` and `K_v`, and with the attitude loop `T`, the loop gain is

    `(K_v s + K_p) / s^2  T(s)  (1 - s^2 / z^2)`.

- Without lag of the attitude loop, the loop gain is below 1 at one frequency only if `K_v < z / 2`.
- At high frequencies the loop gain is `K_v k_omega / z^2` with the effective gain `k_omega` of the attitude loop.
- Contact forces react to the rotation with the inertia `rho m l^2`, `rho = m_L / (m_L + sum m)`. The torques do not
  include this reaction, so the effective attitude gains are `L agent_k_R` and `L agent_k_omega` with
  `L = I / (I + rho m l^2)`. The damping ratio is `sqrt(L) agent_k_omega / (2 sqrt(agent_k_R))`.

References:
    Skogestad, Postlethwaite, *Multivariable Feedback Control*, 2005, sec. 5.7: limits by right half-plane zeros.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from colift.math.pytree import transfer
from colift.models.parameters import Team
from colift.onboard.control import bound_tips
from colift.scenario import controllers, schema


class Ratios(NamedTuple):
    """Gains relative to the zero and to the attitude loop.

    Attributes:
        bandwidth: `K_v / z`.
        loop_gain: `K_v L agent_k_omega / z^2`.
        damping: Damping ratio of the attitude loop, `sqrt(L) agent_k_omega / (2 sqrt(agent_k_R))`.
    """

    bandwidth: float
    loop_gain: float
    damping: float


LIMITS = Ratios(bandwidth=0.5, loop_gain=0.85, damping=0.6)
"""Largest bandwidth and loop gain, and smallest damping ratio. All shipped scenarios are within these limits."""
ADVISED = Ratios(bandwidth=0.35, loop_gain=0.6, damping=0.75)
"""Ratios of gains that are advised."""


class TranslationGains(NamedTuple):
    """Gains that affect the horizontal motion of the payload.

    Attributes:
        K_p: Horizontal position gain [1/s^2].
        K_v: Horizontal velocity gain [1/s].
        agent_k_R: Attitude gain of the agents [1/s^2].
    """

    K_p: float
    K_v: float
    agent_k_R: float


@dataclasses.dataclass(frozen=True)
class TranslationLimits:
    """Limits of a team.

    Attributes:
        zero: Zero z of horizontal translation [rad/s]; infinite without bound tips below the center of mass.
        inertia_ratio: Smallest `L` of the agents, at most 1.
    """

    zero: float
    inertia_ratio: float

    def gains(self, ratios: Ratios, agent_k_omega: float) -> TranslationGains:
        """Compute the gains with given ratios; `K_p` is infinite, because only `K_v` is limited."""
        rate = self.inertia_ratio * agent_k_omega
        K_v = min(ratios.bandwidth * self.zero, ratios.loop_gain * self.zero**2 / rate)
        return TranslationGains(math.inf, K_v, rate * agent_k_omega / (2 * ratios.damping) ** 2)

    def exceeded(self, control: schema.Control) -> bool:
        """Return whether gains are above `LIMITS`."""
        limits, present = self.gains(LIMITS, control.agent_k_omega), present_gains(control)
        return present.K_v > limits.K_v or present.agent_k_R > limits.agent_k_R

    def advise(self, control: schema.Control) -> TranslationGains:
        """Compute gains with the ratios `ADVISED`, at most the present ones, with two digits.

        `K_p` decreases with the square of `K_v`, so that the damping ratio of the payload is unchanged.

        Args:
            control: Controller settings.

        Returns:
            Gains.
        """
        advised, present = self.gains(ADVISED, control.agent_k_omega), present_gains(control)
        K_v, agent_k_R = (min(a, b) for a, b in zip(advised[1:], present[1:], strict=True))
        ratio = K_v / present.K_v if present.K_v else 1.0
        return TranslationGains(*(float(f"{x:.2g}") for x in (present.K_p * ratio**2, K_v, agent_k_R)))


def present_gains(control: schema.Control) -> TranslationGains:
    """Return the larger of the two horizontal gains of a scenario, and the attitude gain."""
    K_p, K_v = (max(np.broadcast_to(gain, 3)[:2].tolist()) for gain in (control.K_p, control.K_v))
    return TranslationGains(K_p, K_v, control.agent_k_R)


def translation_limits(settings: schema.Scenario, team: Team) -> TranslationLimits:
    """Compute zero and inertia ratio of a team in hover, with equal shares of the payload.

    Args:
        settings: Scenario, which contains headings and postures.
        team: Parameters.

    Returns:
        The limits; none without gravity.
    """
    g = float(np.linalg.norm(team.gravity))
    if g == 0:
        return TranslationLimits(math.inf, 1.0)
    return team_limits(controllers.agents_in_hover(settings, team), float(team.payload.mass), g)


def team_limits(team: Sequence[bound_tips.HoverAgent], payload_mass: float, g: float) -> TranslationLimits:
    """Compute zero and inertia ratio of agents in hover.

    Args:
        team: Agents in hover.
        payload_mass: Mass of the payload [kg].
        g: Gravitational acceleration [m/s^2], positive.

    Returns:
        The limits.
    """
    rho = payload_mass / (payload_mass + sum(float(each.agent.mass.sum()) for each in team))
    inertial, levers, ratio = payload_mass * np.eye(2), np.zeros((2, 2)), 1.0
    for agent, posture, yaw, _ in team:
        p, bound, motion = bound_tips.motion_about_tips(agent, posture, transfer(bound_tips.rotation_z(yaw)))
        m, height = float(p.mass), -float(np.asarray(p.tip_from_com)[:, 2].mean())
        D, motion = np.asarray(bound)[:2, :2], np.asarray(motion)
        if not (np.isfinite(D).all() and np.isfinite(motion).all()):  # straight arms, which other checks report
            continue
        spin = np.concatenate([np.eye(3), motion[3:]])
        inertia = np.diagonal(spin.T @ np.asarray(p.M_bar) @ spin)[:2]
        lever = np.linalg.norm(motion[:2, :2], axis=0)
        inertial, levers = inertial + m * D, levers + m * max(height, 0.0) * D
        ratio = min(ratio, float((inertia / (inertia + rho * m * lever**2)).min()))
    delay = float(np.linalg.norm(np.linalg.solve(inertial, levers), 2)) / g
    return TranslationLimits(1 / math.sqrt(delay) if delay > 0 else math.inf, ratio)
