"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import grasp
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentInput, AgentState, GeneralizedForce, ResidualForces, TeamInputs
from colift.onboard.control import attitude, preview, realization, setpoints, tracking
from colift.onboard.interfaces import ContactForceCommand, ControlContext, SaturationFlags


@pytree
class ThrustVectoringController:
    """The paper's realization: thrust along a commanded direction, tips on the payload, torques by inverse dynamics."""

    gains: tracking.Gains
    yaw: tuple[Float[Array, "agents"], ...]  # rad
    nominal_posture: tuple[Float[Array, "agents n_r"], ...]

    def compute(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        forces: ContactForceCommand,
        f_hat: ResidualForces,
    ) -> tuple[TeamInputs, SaturationFlags]:
        """`control.realize` of every agent, thrust limited to what its rotors give."""
        team, inputs, saturated = context.team, [], []
        realize = jax.vmap(realization.agent_inputs, in_axes=(0, None, None, 0, None, None, 0, 0, 0))
        shares = tuple(
            setpoints.AgentSetpoint(lam=lam, lam_dot=lam_dot, yaw=heading, nominal_posture=rest)
            for lam, lam_dot, heading, rest in zip(
                grasp.split_contacts(team, forces.lam),
                grasp.split_contacts(team, forces.lam_dot),
                self.yaw,
                self.nominal_posture,
                strict=True,
            )
        )
        turns = self.attitude_setpoints(context, acceleration_cmd, shares, f_hat)
        for group, q, share, f, turn in zip(
            team.agent_groups, context.estimate.agents, shares, f_hat.agents, turns, strict=True
        ):
            requested = realize(
                group, self.gains, team.gravity, q, context.estimate.payload, acceleration_cmd, share, f, turn
            )
            u = jnp.clip(requested.u, 0.0, group.thrust_max)
            inputs.append(AgentInput(u=u, tau=requested.tau, tau_r=requested.tau_r))
            saturated.append(u != requested.u)
        return tuple(inputs), tuple(saturated)

    def attitude_setpoints(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        shares: tuple[setpoints.AgentSetpoint, ...],
        f_hat: ResidualForces,
    ) -> tuple[setpoints.AttitudeSetpoint, ...]:
        """`control.aligned`, by group."""
        turn = jax.vmap(attitude.thrust_attitude_setpoint, in_axes=(0, None, None, 0, 0))
        each = zip(context.team.agent_groups, shares, f_hat.agents, strict=True)
        return tuple(turn(group, context.team.gravity, acceleration_cmd, share, f) for group, share, f in each)


@pytree
class PreviewThrustVectoringController(ThrustVectoringController):
    """The same with the attitude's rates from the reference ahead, for a pilot with a `look_ahead`."""

    def attitude_setpoints(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        shares: tuple[setpoints.AgentSetpoint, ...],
        f_hat: ResidualForces,
    ) -> tuple[setpoints.AttitudeSetpoint, ...]:
        """`control.anticipated`, by group. Raises ValueError where the pilot does not look ahead."""
        if context.preview is None:
            raise ValueError("this realizer needs a pilot that looks ahead: `LeaderFollower.look_ahead`")
        far, team, out = context.preview, context.team, []
        lam = jax.vmap(lambda x: grasp.split_contacts(team, x))(far.lam)
        for group, q, share, f, lam_far, f_far in zip(
            team.agent_groups, context.estimate.agents, shares, f_hat.agents, lam, far.f_hat.agents, strict=True
        ):
            out.append(
                jax.vmap(self._turn, in_axes=(None, None, 0, 0, 0, 0, 1, 1))(
                    context, acceleration_cmd, group, q, share, f, lam_far, f_far.f_x
                )
            )
        return tuple(out)

    def _turn(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        agent: AerialManipulator,
        q: AgentState,
        share: setpoints.AgentSetpoint,
        f_hat: GeneralizedForce,
        lam: Float[Array, "times arms 3"],
        f_x: Float[Array, "times 3"],
    ) -> setpoints.AttitudeSetpoint:
        far, gravity = context.preview, context.team.gravity
        assert far is not None
        f = agent.mass.sum() * (far.acceleration_cmd.a - gravity[None]) + lam.sum(1) - f_x
        ahead = preview.AgentPreview(step=far.step, payload=far.payload, acceleration_cmd=far.acceleration_cmd, f=f)
        return preview.preview_attitude_setpoint(agent, gravity, q, acceleration_cmd, share, f_hat, ahead)
