"""Bound axes of the agents of a team: attitude stiffness, and the bandwidth with which tips follow commands.

A direction across the thrust of an agent is bound if no joint moves the tips in it (`colift.models.tip_mobility`). With
the thrust u in hover, the height l of the center of mass above the tips, the mass m and the inertia I about the axis of
the rotation, the contact force along a bound direction follows the tilt phi by

    `lam = u phi - m l phi_dd`.

The transfer function has zeros at `+-sqrt(u / (m l))`: the tip first moves against the command. A zero in the right
half plane limits the bandwidth of a loop through it to about half of its value.

References:
    Skogestad, Postlethwaite, *Multivariable Feedback Control*, 2005, sec. 5.7: limits by right half plane zeros.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from colift.models import grasp, tip_mobility
from colift.models.parameters import Team
from colift.models.state import State

MAX_YAW_STIFFNESS = 1 / 8
"""Largest yaw gain `k_R`, relative to the square of the zero of yaw."""
MAX_YAW_RATE_GAIN = 1 / 2
"""Largest yaw gain `k_omega`, relative to the zero of yaw."""
ADVISED_YAW_GAINS = (0.1, 0.4)
"""Yaw gains that are advised: `k_R` and `k_omega` relative to the squared zero and the zero; damping ratio 0.63."""


@dataclasses.dataclass(frozen=True)
class BoundAxis:
    """One bound direction of one agent."""

    agent: str  # name
    direction: np.ndarray  # (3,) unit vector across the thrust, base frame
    mass: float  # kg, m
    inertia: float  # kg m^2, I, about the axis of the rotation that moves the center of mass along the direction
    thrust: float  # N, u, in hover, with the share of the payload
    lever: float  # m, l, height of the center of mass above the tips; joints that follow the rotation reduce it

    @property
    def bandwidth(self) -> float:
        """Zero of the transfer function from tilt to contact force [rad/s]; infinite for `l <= 0`."""
        return math.sqrt(self.thrust / (self.mass * self.lever)) if self.lever > 0 else math.inf

    def attitude_stiffness(self, agent_k_R: float, compensated: bool = True) -> float:
        """Compute the stiffness of the attitude control about the axis [N m/rad].

        It is `I k_R` if the agent controller computes its torques with the contact force that will act. A controller
        that uses the commanded contact force instead adds the moment `-u l` per rad of attitude error.

        Args:
            agent_k_R: Attitude gain of the agents [1/s^2].
            compensated: Whether the torques contain the contact force that will act.

        Returns:
            The stiffness; the attitude is unstable if it is negative.
        """
        stiffness = self.inertia * agent_k_R
        return stiffness if compensated else stiffness - self.thrust * self.lever

    def tilt(self, torque: float, agent_k_R: float, compensated: bool = True) -> float:
        """Compute the tilt by a constant torque about the axis that the controller does not compensate.

        Args:
            torque: Torque [N m].
            agent_k_R: Attitude gain of the agents [1/s^2].
            compensated: As in `attitude_stiffness`.

        Returns:
            Tilt [rad]; infinite if the stiffness is not positive.
        """
        stiffness = self.attitude_stiffness(agent_k_R, compensated)
        return torque / stiffness if stiffness > 0 else math.inf

    def acceleration_feedback(self, agent_k_omega: float, K_v: float, payload_mass: float, agents: int) -> float:
        """Compute the loop gain of measured payload acceleration through `K_v` and the attitude rate.

        `k_omega K_v m l I / (u (I + rho m l^2))` with `rho = m_L / (m_L + N m)`. A controller whose attitude rate
        contains the measured acceleration is unstable for values above about 1.

        Args:
            agent_k_omega: Angular velocity gain of the agents [1/s].
            K_v: Velocity gain of the payload [1/s].
            payload_mass: Mass of the payload [kg].
            agents: Number of agents.

        Returns:
            The loop gain.
        """
        m, inertia = self.mass, self.inertia
        rho = payload_mass / (payload_mass + agents * m)
        return agent_k_omega * K_v * m * self.lever * inertia / (self.thrust * (inertia + rho * m * self.lever**2))


def bound_axes(
    team: Team, state: State, thrust: Float[np.ndarray, "agents"], names: Sequence[str] = ()
) -> tuple[BoundAxis, ...]:
    """Find the bound directions of all agents.

    Args:
        team: Team.
        state: State at rest.
        thrust: Thrust of each agent in hover [N].
        names: Names of the agents in team order.

    Returns:
        One entry per agent and bound direction. An agent with two bound directions has its base axes x and y.
    """
    found = []
    for (name, agent, r, _), u in zip(grasp.iter_agents(team, state, names), thrust, strict=True):
        mobility = tip_mobility.tip_mobility(agent, r)
        for direction in mobility.bound:
            upright = direction * np.sign(direction[np.argmax(np.abs(direction))])
            inertia, lever = mobility.rotational_inertia(upright), mobility.lever(upright)
            found.append(BoundAxis(name, upright, mobility.mass, inertia, float(u), lever))
    return tuple(found)


def contact_center(contacts: Float[np.ndarray, "arms 3"]) -> np.ndarray:
    """Return the mean of an agent's contacts, horizontal part in the payload frame [m]."""
    return np.append(np.asarray(contacts)[:, :2].mean(0), 0.0)


def tangent(contacts: Float[np.ndarray, "arms 3"]) -> np.ndarray | None:
    """Return the unit vector along which an agent moves with the yaw of the payload, payload frame.

    Args:
        contacts: Contact points of the agent, payload frame [m].

    Returns:
        The vector; None if the mean of the contacts is on the vertical axis through the center of mass.
    """
    center = contact_center(contacts)
    radius = float(np.linalg.norm(center))
    return None if radius < 1e-6 else np.array([-center[1], center[0], 0.0]) / radius


def advised_yaw_gains(zero: float) -> tuple[float, float]:
    """Return yaw gains `k_R` [1/s^2] and `k_omega` [1/s] for a zero [rad/s], rounded to two digits."""
    stiffness, rate = ADVISED_YAW_GAINS
    return float(f"{stiffness * zero**2:.2g}"), float(f"{rate * zero:.2g}")


def yaw_gains_within_limit(zero: float, k_R: float, k_omega: float) -> bool:
    """Return whether yaw gains [1/s^2, 1/s] keep the bandwidth of yaw below the limit of its zero [rad/s]."""
    return k_R <= MAX_YAW_STIFFNESS * zero**2 and k_omega <= MAX_YAW_RATE_GAIN * zero
