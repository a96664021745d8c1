"""Faults of the simulated team: rotors of reduced or stuck force, open contacts, and links with delays and losses.

See Also:
    colift.simulation.sensors: rates, delays, dropouts and failures of sensors.
    docs/scenarios: settings of the faults.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift.math.pytree import pytree, static
from colift.models import grasp
from colift.models.actuator_lag import RotorMixer
from colift.models.measurement import ContactFlags, Measurement
from colift.models.parameters import OPEN_COMPLIANCE, Team
from colift.models.state import AgentInput, ControlClock, State, TeamInputs
from colift.simulation.sensors import SensedState, SensorModel

Scalar = Float[Array, ""]

CAPTURE_DISTANCE = 0.01
"""Distance between a tip and its contact point within which an open contact can close [m]."""


@pytree
class ThrustLoss:
    """Loss of rotor effectiveness of one agent: thrust and body torque are multiplied by a share in an interval."""

    share: tuple[Float[Array, "agents"], ...]  # remaining share of each agent in the interval, by group
    start: Scalar  # s
    end: Scalar  # s; inf: until the end of the flight


@pytree
class LinkFault(SensorModel):
    """Link from the leader to an agent with its own rate, a delay and random losses, in an interval.

    The leader sends a message when `period` has passed since the previous one, first at `start`. It is lost with
    probability `loss_probability` and arrives `delay` ticks later.
    """

    member: Bool[Array, "team"]  # True for the agent
    period: Scalar  # s, between two messages
    loss_probability: Scalar
    start: Scalar  # s
    end: Scalar  # s; inf: until the end of the flight
    delay: int = static(default=0)  # ticks

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Float[Array, "time"]:
        """Draw uniform numbers; a message is lost at a value below `loss_probability`."""
        return jax.random.uniform(key, (ticks,))

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: Float[Array, ""]
    ) -> tuple[Measurement, Any]:
        """Set `Measurement.link_delay_s` of the agent."""
        given = measurement.link_delay_s
        present = jnp.zeros(len(self.member)) if given is None else given
        active = (clock.t >= self.start - 1e-9) & (clock.t < self.end - 1e-9)
        sent = clock.t - self.delay * clock.dt - self.start + 1e-9  # s, since the start
        due = jnp.floor(sent / self.period) > jnp.floor((sent - clock.dt) / self.period)
        arrives = (sent >= 0) & due & (noise >= self.loss_probability)
        delay = jnp.where(arrives, self.delay * clock.dt, -1.0)
        return dataclasses.replace(measurement, link_delay_s=jnp.where(active & self.member, delay, present)), state


RotorForces = tuple[Float[Array, "agents rotors"], ...]
"""Force of each rotor [N], by group."""


@pytree
class RotorFault:
    """Rotors with a share of their force, or with the force of the last period before the interval."""

    share: tuple[Float[Array, "agents rotors"], ...]  # remaining share of each rotor in the interval, by group
    stuck: tuple[Bool[Array, "agents rotors"], ...]  # rotors that keep their force
    start: Scalar  # s
    end: Scalar  # s; inf: until the end of the flight


@pytree
class Faults:
    """Faults of a flight, unknown to the controller."""

    thrust: tuple[ThrustLoss, ...] = ()  # losses of rotor thrust; shares of simultaneous losses multiply
    rotors: tuple[RotorFault, ...] = ()  # faults of single rotors, after the losses of thrust
    mixers: tuple[RotorMixer, ...] = ()  # rotors of each group; empty without faults of single rotors
    release_time: tuple[Float[Array, "_agents _arms"], ...] | None = None  # s, by group; inf: never. None: no release
    regrasp_time: tuple[Float[Array, "_agents _arms"], ...] | None = None  # s, by group; inf: never. None: no regrasp
    starts_open: bool = static(default=False)  # whether contacts are open from the start, which their grippers report

    def rotor_forces(self, inputs: TeamInputs) -> RotorForces | None:
        """Return the rotor forces that generate the inputs [N]; None without faults of single rotors.

        They are unique, since a mixer generates thrust and torque by forces in the row space of its effectiveness.
        """
        if not self.rotors:
            return None
        return tuple(
            jnp.concatenate([part.u[:, None], part.tau], axis=1) @ mixer.mixer.T
            for mixer, part in zip(self.mixers, inputs, strict=True)
        )

    def limit(self, inputs: TeamInputs, last: RotorForces | None, t: Scalar) -> tuple[TeamInputs, RotorForces | None]:
        """Compute the inputs that act in a period.

        Args:
            inputs: Inputs that the actuators apply.
            last: Rotor forces of the previous period [N]; None without faults of single rotors.
            t: Time [s].

        Returns:
            The inputs after the faults, and the rotor forces of this period.
        """
        for loss in self.thrust:
            active = (t >= loss.start - 1e-9) & (t < loss.end - 1e-9)
            scales = [jnp.where(active, share, 1.0) for share in loss.share]
            inputs = tuple(
                AgentInput(u=scale * part.u, tau=scale[:, None] * part.tau, tau_r=part.tau_r)
                for scale, part in zip(scales, inputs, strict=True)
            )
        forces = self.rotor_forces(inputs)
        if forces is None or last is None:
            return inputs, forces
        for fault in self.rotors:
            active = (t >= fault.start - 1e-9) & (t < fault.end - 1e-9)
            forces = tuple(
                jnp.where(active, jnp.where(stuck, before, share * now), now)
                for stuck, share, before, now in zip(fault.stuck, fault.share, last, forces, strict=True)
            )
        acting = [now @ mixer.effectiveness.T for mixer, now in zip(self.mixers, forces, strict=True)]
        return tuple(
            AgentInput(u=part[:, 0], tau=part[:, 1:], tau_r=given.tau_r)
            for part, given in zip(acting, inputs, strict=True)
        ), forces

    def initial_regrasps(self) -> ContactFlags | None:
        """Return the contacts that have closed again before the flight: none. None if no contact can close again."""
        times = self.regrasp_time
        return None if times is None else tuple(jnp.zeros(time.shape, bool) for time in times)

    def ungrasped(self, regrasped: ContactFlags | None) -> ContactFlags | None:
        """Return the contacts that are open since the start; None if all were closed then.

        Args:
            regrasped: Contacts that have closed again; None if none can.
        """
        if self.release_time is None or not self.starts_open:
            return None
        opened = tuple(time <= 1e-9 for time in self.release_time)
        if regrasped is None:
            return opened
        return tuple(is_open & ~closed for is_open, closed in zip(opened, regrasped, strict=True))

    def team_at(self, team: Team, t: Scalar, regrasped: ContactFlags | None = None) -> Team:
        """Return the true parameters with the compliance of open contacts.

        Args:
            team: True parameters without faults.
            t: Time [s].
            regrasped: Contacts that have closed again; None if none can.

        Returns:
            The true parameters.
        """
        if self.release_time is None:
            return team
        opened = [t >= start - 1e-9 for start in self.release_time]
        if regrasped is not None:
            opened = [is_open & ~closed for is_open, closed in zip(opened, regrasped, strict=True)]
        groups = tuple(
            dataclasses.replace(group, contact_compliance=jnp.where(is_open, OPEN_COMPLIANCE, 0.0))
            for group, is_open in zip(team.agent_groups, opened, strict=True)
        )
        return dataclasses.replace(team, agent_groups=groups)

    def regrasps(self, team: Team, state: State, regrasped: ContactFlags | None, t: Scalar) -> ContactFlags | None:
        """Return the contacts that have closed again: now if a tip is within `CAPTURE_DISTANCE` of its contact point.

        The projection at the end of the control period is then the impact, which is perfectly inelastic. The velocity
        after it is the nearest one, in the metric of the mass matrix, at which no tip moves relative to its contact
        point (`contact_dynamics.project_to_constraints`). Impulses at the contacts cause the difference. Momenta are
        therefore conserved, and the kinetic energy decreases by that of the difference (Carnot's theorem). The same
        projection closes the remaining distance. Two further steps remove the products of its corrections
        (`contact_dynamics.complete_impact`).

        Args:
            team: True parameters without faults.
            state: State of the team at time t.
            regrasped: Contacts that have closed again before; None if none can.
            t: Time [s].

        References:
            Brogliato, *Nonsmooth Mechanics*, 2016 (impacts as projections in the kinetic metric).
        """
        if self.regrasp_time is None or regrasped is None:
            return regrasped
        gaps = grasp.split_contacts(team, grasp.constraint_residual(team, state))
        return tuple(
            was_closed | ((t >= time - 1e-9) & ((gap * gap).sum(-1) <= CAPTURE_DISTANCE**2))
            for was_closed, time, gap in zip(regrasped, self.regrasp_time, gaps, strict=True)
        )
