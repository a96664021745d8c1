"""Link that transmits the commands of the leader to each agent, with delays and losses.

An agent holds the last message that it received. A message older than `hold_time` fades: its commanded acceleration
decreases to zero, and its contact forces lose the part that generates this acceleration. Gravity, predicted residuals
and internal forces stay. The agent's own feedback of attitude, tips and posture continues without delay.

See Also:
    docs/decisions/0005-general-force-allocation: measured results for other times of holding and fading.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import constant, pytree, static
from colift.models.parameters import Payload, Team
from colift.models.state import ResidualForces, TeamInputs, Wrench
from colift.onboard.control import tracking
from colift.onboard.control.allocation import AllocationMap, allocate
from colift.onboard.interfaces import (
    AgentController,
    ContactForceCommand,
    ControlContext,
    PartState,
    SaturationFlags,
    TeamPreview,
)

Scalar = Float[Array, ""]


@pytree
class LeaderMessage:
    """Commands of the leader in one control period.

    Attributes:
        acceleration_cmd: Commanded payload acceleration.
        forces: Commanded contact forces.
        preview: Preview of the reference; None for agent controllers without one.
    """

    acceleration_cmd: tracking.AccelerationCommand
    forces: ContactForceCommand
    preview: TeamPreview | None


@pytree
class CommandLinkState:
    """State of the link.

    Attributes:
        pending: Messages of the last periods with a leading time axis, oldest first.
        received: Last message that each agent received, with a leading axis of agents.
        age: Time since each of them was sent [s].
        agent_controllers: State of the agent controller on board of each agent, with a leading axis of agents.
    """

    pending: LeaderMessage
    received: LeaderMessage
    age: Float[Array, "agents"]
    agent_controllers: PartState


@pytree
class CommandLink:
    """Link from the leader to the agents; `Measurement.link_delay_s` states which messages arrive.

    Attributes:
        allocation: Map from a wrench to contact forces, for the part that fades.
        max_delay: Largest delay of a message, in control periods.
        hold_time: Age up to which a message is used without change [s].
        fade_time: Time constant with which older messages fade [s].
    """

    allocation: AllocationMap
    max_delay: int = static(default=0)
    hold_time: Scalar = constant(0.4)
    fade_time: Scalar = constant(0.2)

    def init(self, team: Team, message: LeaderMessage, agent_controller: PartState) -> CommandLinkState:
        """Return the state after a constant message.

        Args:
            team: Nominal parameters.
            message: Message that all agents have received.
            agent_controller: Initial state of the agent controller.

        Returns:
            The state before the first control period.
        """

        def repeat(tree: PartState, times: int) -> PartState:
            return jax.tree.map(lambda x: jnp.broadcast_to(x, (times, *jnp.shape(x))), tree)

        agents = sum(team.sizes)
        return CommandLinkState(
            pending=repeat(message, self.max_delay + 1),
            received=repeat(message, agents),
            age=jnp.zeros(agents),
            agent_controllers=repeat(agent_controller, agents),
        )

    def deliver(self, state: CommandLinkState, context: ControlContext, message: LeaderMessage) -> CommandLinkState:
        """Send a message, and replace the held message of each agent to which one arrives.

        Args:
            state: State after the previous control period.
            context: Inputs of this control period, with a measurement.
            message: Message of this control period.

        Returns:
            The next state, with the held messages of this control period.
        """
        assert context.measurement is not None
        assert context.measurement.link_delay_s is not None
        delay, dt = context.measurement.link_delay_s, context.clock.dt
        sent = jax.tree.map(lambda old, new: jnp.concatenate([old[1:], new[None]]), state.pending, message)
        arrives = delay >= 0
        index = self.max_delay - jnp.round(jnp.maximum(delay, 0.0) / dt).astype(int)

        def hold(line: Array, held: Array) -> Array:
            return jnp.where(arrives.reshape(-1, *(1,) * (held.ndim - 1)), line[index], held)

        return dataclasses.replace(
            state,
            pending=sent,
            received=jax.tree.map(hold, sent, state.received),
            age=jnp.where(arrives, delay, state.age + dt),
        )

    def fade(self, payload: Payload, R: Float[Array, "3 3"], message: LeaderMessage, age: Scalar) -> LeaderMessage:
        """Return a message as an agent uses it at an age.

        With the share ``s = min(1, exp(-(age - hold_time) / fade_time))`` of the commanded acceleration `(a, alpha)`::

            acceleration = s (a, alpha),    lam = lam_0 - (1 - s) B (m a, J alpha)

        B is the right inverse of the grasp matrix in the allocation (`AllocationMap.right_inverse`).
        Rates are multiplied by s. The same applies to each time of the preview.

        Args:
            payload: Nominal parameters of the payload.
            R: Estimated payload attitude.
            message: Held message of the agent.
            age: Time since it was sent [s].

        Returns:
            The message after fading; unchanged up to the age `hold_time`.
        """
        share = jnp.minimum(1.0, jnp.exp((self.hold_time - age) / self.fade_time))

        def faded(
            lam: Float[Array, "contacts 3"], command: tracking.AccelerationCommand
        ) -> tuple[Float[Array, "contacts 3"], tracking.AccelerationCommand]:
            W = Wrench(F=payload.mass * command.a, tau=payload.inertia @ command.alpha)
            inertial = dataclasses.replace(self.allocation, offset=jnp.zeros_like(self.allocation.offset))
            eta = jnp.zeros(inertial.nullspace.shape[1])
            return lam - (1 - share) * allocate(inertial, R, W, eta), jax.tree.map(lambda x: share * x, command)

        lam, command = faded(message.forces.lam, message.acceleration_cmd)
        forces = dataclasses.replace(message.forces, lam=lam, lam_dot=share * message.forces.lam_dot)
        preview = message.preview
        if preview is not None:
            lam, previewed = jax.vmap(faded)(preview.lam, preview.acceleration_cmd)
            preview = dataclasses.replace(preview, lam=lam, acceleration_cmd=previewed)
        return LeaderMessage(acceleration_cmd=command, forces=forces, preview=preview)

    def compute(
        self, agent_controller: AgentController, state: CommandLinkState, context: ControlContext, f_hat: ResidualForces
    ) -> tuple[tuple[TeamInputs, SaturationFlags], CommandLinkState]:
        """Evaluate the agent controller on board of each agent, with the message that this agent holds.

        Args:
            agent_controller: Agent controller.
            state: Result of `deliver` in this control period.
            context: Inputs of this control period.
            f_hat: Predicted residuals.

        Returns:
            Inputs and saturation of all agents, and the next state.
        """
        R, payload = context.estimate.payload.R, context.team.payload

        def on_board(
            part: PartState, held: LeaderMessage, age: Scalar
        ) -> tuple[tuple[TeamInputs, SaturationFlags], PartState]:
            message = self.fade(payload, R, held, age)
            own = dataclasses.replace(context, preview=message.preview)
            return agent_controller.compute(part, own, message.acceleration_cmd, message.forces, f_hat)

        results, parts = jax.vmap(on_board)(state.agent_controllers, state.received, state.age)
        inputs, saturated, first = [], [], 0
        for size, group, flags in zip(context.team.sizes, *results, strict=True):
            own, member = first + jnp.arange(size), jnp.arange(size)
            inputs.append(jax.tree.map(lambda x, own=own, member=member: x[own, member], group))
            saturated.append(flags[own, member])
            first += size
        return (tuple(inputs), tuple(saturated)), dataclasses.replace(state, agent_controllers=parts)
