"""Implementations of the protocol `ActuatorCompensator`."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import constant, pytree
from colift.models.actuator_lag import ActuatorLag, ActuatorLagState, RotorMixer
from colift.models.parameters import Team
from colift.models.state import AgentInput, TeamInputs
from colift.onboard.interfaces import PartState

Scalar = Float[Array, ""]


@pytree
class NoCompensation:
    """Commands equal to the requested inputs, for actuators that are assumed ideal."""

    def init(self, command: TeamInputs) -> PartState:
        """Return the empty state."""
        return ()

    def command(self, team: Team, state: PartState, requested: TeamInputs, dt: Scalar) -> tuple[TeamInputs, PartState]:
        """Return the requested inputs; see `ActuatorCompensator`."""
        return requested, state

    def effective_command(self, state: PartState, last_command: TeamInputs) -> TeamInputs:
        """Return the last command; see `ActuatorCompensator`."""
        return last_command


@pytree
class LagInversion:
    """Inversion of a modelled actuator lag behind a faster lag.

    Commands are `u + kappa (u_des - u)`, with u the modelled input at the time the command takes effect. The closed
    actuator response is then `kappa` times as fast.
    """

    lag: ActuatorLag  # nominal lag and delay of thrust and body torque
    bandwidth_ratio: Scalar = constant(2.0)  # kappa, closed-loop bandwidth divided by the bandwidth of the lag

    def init(self, command: TeamInputs) -> ActuatorLagState:
        """Return the state of the lag after a constant command; see `ActuatorCompensator`."""
        return self.lag.init(command)

    def command(
        self, team: Team, state: ActuatorLagState, requested: TeamInputs, dt: Scalar
    ) -> tuple[TeamInputs, ActuatorLagState]:
        """Invert the lag, and limit the thrust to the range of the rotors; see `ActuatorCompensator`."""
        commands = self.lag.invert(state, requested, self.bandwidth_ratio, dt)
        commands = tuple(
            dataclasses.replace(command, u=jnp.clip(command.u, 0.0, group.thrust_max))
            for command, group in zip(commands, team.agent_groups, strict=True)
        )
        return commands, self.lag.step(state, commands, dt)

    def effective_command(self, state: ActuatorLagState, last_command: TeamInputs) -> TeamInputs:
        """Return the output of the lag model; see `ActuatorCompensator`."""
        return state.output


@pytree
class KnownRotorLimits:
    """Another compensation with rotors whose limits are known, as to the mixer of a flight controller.

    The inputs that acted are those of the mixer. With the commands in their place, labels would contain the limited
    part as a residual force. Its compensation increases the commands further.
    """

    base: LagInversion | NoCompensation
    limits: tuple[RotorMixer, ...]  # rotors of each group

    def init(self, command: TeamInputs) -> PartState:
        """Return the state of the other compensation; see `ActuatorCompensator`."""
        return self.base.init(command)

    def command(self, team: Team, state: PartState, requested: TeamInputs, dt: Scalar) -> tuple[TeamInputs, PartState]:
        """Return the commands of the other compensation; see `ActuatorCompensator`."""
        return self.base.command(team, state, requested, dt)

    def effective_command(self, state: PartState, last_command: TeamInputs) -> TeamInputs:
        """Return the inputs of the other compensation within the rotor limits; see `ActuatorCompensator`."""
        given = self.base.effective_command(state, last_command)
        limited = [mixer(part.u, part.tau) for mixer, part in zip(self.limits, given, strict=True)]
        return tuple(AgentInput(u=u, tau=tau, tau_r=part.tau_r) for (u, tau), part in zip(limited, given, strict=True))
