"""Implementations of the protocol `AgentController`: thrust vectoring with inverse dynamics."""

from __future__ import annotations

import dataclasses

import jax
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import grasp
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentState, GeneralizedForce, ResidualForces, TeamInputs
from colift.onboard.control import attitude, preview, realization, setpoints, tracking
from colift.onboard.interfaces import ContactForceCommand, ControlContext, PartState, SaturationFlags


@pytree
class ThrustVectoringController:
    """Agent controller of the paper: thrust along the commanded direction, tips on the payload, inverse dynamics."""

    gains: tracking.Gains  # feedback gains
    yaw: tuple[Float[Array, "agents"], ...]  # rad, heading of each agent, world
    nominal_posture: tuple[Float[Array, "agents n_r"], ...]  # rad or m, joint positions of the posture control

    def init(self) -> PartState:
        """Return the empty state."""
        return ()

    def compute(
        self,
        state: PartState,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        forces: ContactForceCommand,
        f_hat: ResidualForces,
    ) -> tuple[tuple[TeamInputs, SaturationFlags], PartState]:
        """Compute the inputs of all agents, with thrust limited to the range of the rotors; see `AgentController`."""
        team, inputs, saturated = context.team, [], []
        agent_inputs = jax.vmap(realization.agent_inputs, in_axes=(0, None, None, 0, None, None, 0, 0, 0, 0, 0))
        agent_setpoints = tuple(
            setpoints.AgentSetpoint(lam=lam, lam_dot=lam_dot, yaw=yaw, nominal_posture=posture)
            for lam, lam_dot, yaw, posture in zip(
                grasp.split_contacts(team, forces.lam),
                grasp.split_contacts(team, forces.lam_dot),
                self.yaw,
                self.nominal_posture,
                strict=True,
            )
        )
        steering = self._steering(context, acceleration_cmd)
        steered = tuple(  # a residual whose compensation is the force of the steering
            f if a is None else dataclasses.replace(f, f_x=f.f_x - group.mass.sum(1)[:, None] * a)
            for group, f, a in zip(team.agent_groups, f_hat.agents, steering, strict=True)
        )
        attitudes = self.attitude_setpoints(
            context, acceleration_cmd, agent_setpoints, dataclasses.replace(f_hat, agents=steered)
        )
        payload, agents = context.estimate.payload, context.estimate.agents
        deficits = realization.contact_force_deficits(team, agents, payload, tuple(d.f for d in attitudes))
        for group, q, setpoint, f, desired, deficit, extra in zip(
            team.agent_groups, agents, agent_setpoints, f_hat.agents, attitudes, deficits, steering, strict=True
        ):
            requested = agent_inputs(
                group, self.gains, team.gravity, q, payload, acceleration_cmd, setpoint, f, desired, deficit, extra
            )
            limited, at_limit = realization.limit_thrust(group, requested)
            inputs.append(limited)
            saturated.append(at_limit)
        return (tuple(inputs), tuple(saturated)), state

    def _steering(
        self, context: ControlContext, acceleration_cmd: tracking.AccelerationCommand
    ) -> tuple[Float[Array, "agents 3"] | None, ...]:
        """Return `realization.free_flight_acceleration` by group; None where no contact can open."""
        d, payload = context.setpoint, context.estimate.payload
        reference = dataclasses.replace(acceleration_cmd, a=d.a, alpha=payload.R.T @ d.R @ d.omega_dot)
        compute = jax.vmap(realization.free_flight_acceleration, in_axes=(0, None, 0, None, None, None))
        return tuple(
            None
            if group.contact_compliance is None
            else compute(group, self.gains, q, payload, acceleration_cmd, reference)
            for group, q in zip(context.team.agent_groups, context.estimate.agents, strict=True)
        )

    def attitude_setpoints(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        agent_setpoints: tuple[setpoints.AgentSetpoint, ...],
        f_hat: ResidualForces,
    ) -> tuple[setpoints.AttitudeSetpoint, ...]:
        """Compute the attitude setpoints of all agents (`attitude.thrust_attitude_setpoint`).

        Args:
            context: Inputs of this control period.
            acceleration_cmd: Commanded payload acceleration.
            agent_setpoints: Contact forces, heading and posture, by group of agents.
            f_hat: Predicted residuals.

        Returns:
            Attitude setpoints by group of agents.
        """
        compute = jax.vmap(attitude.thrust_attitude_setpoint, in_axes=(0, None, None, None, 0, 0))
        gravity, payload = context.team.gravity, context.estimate.payload
        return tuple(
            compute(group, gravity, payload, acceleration_cmd, setpoint, f)
            for group, setpoint, f in zip(context.team.agent_groups, agent_setpoints, f_hat.agents, strict=True)
        )


@pytree
class PreviewThrustVectoringController(ThrustVectoringController):
    """Thrust vectoring with attitude rates from the preview; requires a controller with a `preview_step`."""

    def attitude_setpoints(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        agent_setpoints: tuple[setpoints.AgentSetpoint, ...],
        f_hat: ResidualForces,
    ) -> tuple[setpoints.AttitudeSetpoint, ...]:
        """Compute the attitude setpoints of all agents (`preview.preview_attitude_setpoint`).

        Args:
            context: Inputs of this control period, with a preview.
            acceleration_cmd: Commanded payload acceleration.
            agent_setpoints: Contact forces, heading and posture, by group of agents.
            f_hat: Predicted residuals.

        Returns:
            Attitude setpoints by group of agents, with angular accelerations.

        Raises:
            ValueError: If the context has no preview.
        """
        if context.preview is None:
            raise ValueError(
                "PreviewThrustVectoringController requires a preview of the reference: set "
                "`LeaderFollowerController.preview_step` (setting `control.preview_step_s`)"
            )
        team_preview, team, out = context.preview, context.team, []
        lam = jax.vmap(lambda x: grasp.split_contacts(team, x))(team_preview.lam)
        for group, q, setpoint, f, previewed_lam, previewed_f in zip(
            team.agent_groups,
            context.estimate.agents,
            agent_setpoints,
            f_hat.agents,
            lam,
            team_preview.f_hat.agents,
            strict=True,
        ):
            out.append(
                jax.vmap(self._attitude_setpoint, in_axes=(None, None, 0, 0, 0, 0, 1, 1))(
                    context, acceleration_cmd, group, q, setpoint, f, previewed_lam, previewed_f.f_x
                )
            )
        return tuple(out)

    def _attitude_setpoint(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        agent: AerialManipulator,
        q: AgentState,
        setpoint: setpoints.AgentSetpoint,
        f_hat: GeneralizedForce,
        lam: Float[Array, "times arms 3"],
        f_x: Float[Array, "times 3"],
    ) -> setpoints.AttitudeSetpoint:
        """Compute the setpoint of one agent from its previewed contact forces and residual forces."""
        team_preview, gravity = context.preview, context.team.gravity
        assert team_preview is not None
        f = jax.vmap(attitude.desired_thrust, in_axes=(None, None, 0, 0, 0, 0))(
            agent, gravity, team_preview.payload, team_preview.acceleration_cmd, lam, f_x
        )
        agent_preview = preview.AgentPreview(
            step=team_preview.step, payload=team_preview.payload, acceleration_cmd=team_preview.acceleration_cmd, f=f
        )
        return preview.preview_attitude_setpoint(
            agent, gravity, q, context.estimate.payload, acceleration_cmd, setpoint, f_hat, agent_preview
        )
