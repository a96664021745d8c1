"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matmul
from colift.math.pytree import pytree
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import (
    AgentInput,
    AgentState,
    ControlClock,
    PayloadState,
    ResidualForces,
    State,
    TeamInputs,
    Wrench,
)
from colift.onboard.control import preview, tracking
from colift.onboard.control.actuator_compensation import NoCompensation
from colift.onboard.estimation.state_estimator import StateEstimate
from colift.onboard.interfaces import (
    ActuatorCompensator,
    AgentController,
    Allocator,
    ContactForceCommand,
    ControlContext,
    Estimator,
    PayloadController,
    ResidualPredictor,
    TeamPreview,
    Telemetry,
)
from colift.onboard.learning import residual_correction, residual_model
from colift.onboard.learning.recorder import DataRecorder, RecorderState
from colift.trajectories import base

Scalar = Float[Array, ""]


def context_at(controller: LeaderFollowerController, state: State, a_L: Float[Array, "6"], t: Scalar) -> ControlContext:
    """What a pilot would know that believed in the state z, without a measurement: to ask its law about a state."""
    lam = tuple(jnp.zeros_like(group.contact_position) for group in controller.team.agent_groups)
    return ControlContext(
        team=controller.team,
        clock=ControlClock(t=t, dt=jnp.ones(())),
        measurement=None,
        estimate=StateEstimate(agents=state.agents, payload=state.payload, a_L=a_L, lam=lam),
        setpoint=controller.reference.evaluate(t),
        last_wrench=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
        initialized=jnp.zeros(()),
    )


# The paper's pilot ----------------------------------------------------------------------------------------------------


@pytree
class ControllerState:
    """What the flying software keeps between ticks."""

    estimator: Any
    recorder: RecorderState
    predictor: Any
    leader: Any
    last_command: TeamInputs  # commands of the last tick, after the thrust limit
    actuator: Any
    innovation: Any
    last_wrench: Wrench  # desired wrench of the last tick
    initialized: Scalar  # 0 before the first tick, 1 after


@pytree
class ControlDemand:
    """What the law asks of the team."""

    acceleration_cmd: tracking.AccelerationCommand
    f_hat: ResidualForces
    W: Wrench
    forces: ContactForceCommand


@pytree
class LeaderFollowerController:
    """The paper's pilot: its parts, what they take along, and what has been learned so far."""

    team: Team  # nominal
    reference: base.ReferenceTrajectory
    estimator: Estimator
    recorder: DataRecorder
    residual_model: residual_model.ResidualModel
    residual_predictor: ResidualPredictor
    payload_controller: PayloadController
    allocator: Allocator
    agent_controller: AgentController
    actuator_compensator: ActuatorCompensator = NoCompensation()
    innovation_filter: residual_correction.InnovationFilter | None = None
    preview_step: Scalar | None = None  # s between the times around now at which the law is evaluated on the reference

    def init(self, first: Measurement, clock: ControlClock) -> tuple[TeamInputs, ControllerState]:
        """The command at rest, and the memory before the first tick: empty data sets, that command last applied."""
        none = tuple(
            AgentInput(u=jnp.zeros(size), tau=jnp.zeros((size, 3)), tau_r=jnp.zeros((size, group.tree.joints)))
            for size, group in zip(self.team.sizes, self.team.agent_groups, strict=True)
        )
        state = ControllerState(
            estimator=self.estimator.init(self.team, first),
            recorder=self.recorder.init(self.team, self.residual_model),
            predictor=self.residual_predictor.init(self.team),
            leader=self.payload_controller.init(),
            last_command=none,
            actuator=self.actuator_compensator.init(none),
            innovation=None if self.innovation_filter is None else self.innovation_filter.init(self.team),
            last_wrench=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
            initialized=jnp.zeros(()),
        )
        q_hat, _ = self.estimator.update(self.team, state.estimator, first, none, clock)
        context = ControlContext(
            team=self.team,
            clock=clock,
            measurement=first,
            estimate=q_hat,
            setpoint=self.reference.evaluate(clock.t),
            last_wrench=state.last_wrench,
            initialized=state.initialized,
            innovation=None
            if self.innovation_filter is None
            else residual_correction.zero_innovation(self.team, clock.t),
        )
        hover, _, _ = self.control_law(state.leader, state.predictor, context)
        return hover, dataclasses.replace(state, last_command=hover, actuator=self.actuator_compensator.init(hover))

    def step(
        self, state: ControllerState, measurement: Measurement, clock: ControlClock
    ) -> tuple[TeamInputs, ControllerState, Telemetry]:
        """One control tick: the commands, the next memory, and what was decided."""
        applied = self.actuator_compensator.effective_command(state.actuator, state.last_command)
        q_hat, seen = self.estimator.update(self.team, state.estimator, measurement, applied, clock)
        d = self.reference.evaluate(clock.t)
        context = ControlContext(
            team=self.team,
            clock=clock,
            measurement=measurement,
            estimate=q_hat,
            setpoint=d,
            last_wrench=state.last_wrench,
            initialized=state.initialized,
        )
        innovation_state = state.innovation
        if self.innovation_filter is not None:
            innovation_state, innovation = self.innovation_filter.update(
                innovation_state, self.team, self.residual_model, q_hat, clock
            )
            context = dataclasses.replace(context, innovation=innovation)
        predictor = self.residual_predictor.update(state.predictor, self.residual_model, context)
        requested, leader, decided = self.control_law(state.leader, predictor, context)
        command, drive = self.actuator_compensator.command(self.team, state.actuator, requested, clock.dt)
        state = ControllerState(
            estimator=seen,
            recorder=self.recorder.record(state.recorder, measurement, q_hat.sample, clock.t),
            innovation=innovation_state,
            predictor=predictor,
            leader=leader,
            last_command=command,
            actuator=drive,
            last_wrench=decided.W_d,
            initialized=jnp.ones(()),
        )
        return command, state, decided

    def control_law(self, leader: Any, predictor: Any, context: ControlContext) -> tuple[TeamInputs, Any, Telemetry]:
        """The control law at what is known now: what it asks of the vehicles, and the leader's next memory."""
        requested, then_leader = self._asked(leader, predictor, context)
        if self.preview_step is not None:
            context = dataclasses.replace(context, preview=self._ahead(leader, predictor, context, self.preview_step))
        inputs, saturated = self.agent_controller.compute(
            context, requested.acceleration_cmd, requested.forces, requested.f_hat
        )
        decided = Telemetry(
            estimate=context.estimate,
            setpoint=context.setpoint,
            W_d=requested.W,
            lam_cmd=requested.forces.lam,
            f_hat=requested.f_hat,
            eta=requested.forces.eta,
            saturated=saturated,
            innovation=context.innovation,
        )
        return inputs, then_leader, decided

    def _asked(self, leader: Any, predictor: Any, context: ControlContext) -> tuple[ControlDemand, Any]:
        to, leader = self.payload_controller.compute(leader, context)
        f_hat = self.residual_predictor.predict(predictor, self.residual_model, context, to)
        load = self.team.payload
        W = tracking.desired_wrench(load, self.team.gravity, context.estimate.payload, to, f_hat.payload)
        forces = self.allocator.allocate(context, W, Wrench(F=load.mass * to.jerk, tau=jnp.zeros(3)))
        return ControlDemand(acceleration_cmd=to, f_hat=f_hat, W=W, forces=forces), leader

    def _ahead(self, leader: Any, predictor: Any, context: ControlContext, step: Scalar) -> TeamPreview:
        """The law on the reference around now: the payload on it, agents carried along as they turn now."""

        def at(s: Scalar) -> tuple[PayloadState, ControlDemand]:
            clock = dataclasses.replace(context.clock, t=context.clock.t + s)
            d = self.reference.evaluate(clock.t)
            load = PayloadState(R=d.R, p=d.p, v=d.v, omega=d.omega)

            def carried(q: AgentState) -> AgentState:
                R, x = matmul(q.R, so3.exp(s * q.omega)), q.x + d.p - context.setpoint.p
                return dataclasses.replace(q, R=R, x=x, v=d.v, r_dot=jnp.zeros_like(q.r_dot))

            agents, a_L = (
                tuple(jax.vmap(carried)(q) for q in context.estimate.agents),
                jnp.concatenate([d.a, d.omega_dot]),
            )
            q_hat = dataclasses.replace(context.estimate, payload=load, agents=agents, a_L=a_L)
            then = dataclasses.replace(context, clock=clock, setpoint=d, estimate=q_hat)
            return load, self._asked(leader, predictor, then)[0]

        load, requested = jax.vmap(at)(step * jnp.asarray(preview.PREVIEW_NODES))
        return TeamPreview(
            step=step,
            payload=load,
            acceleration_cmd=requested.acceleration_cmd,
            lam=requested.forces.lam,
            f_hat=requested.f_hat,
        )
