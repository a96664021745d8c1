"""Leader-follower controller of the paper, composed of replaceable parts.

The controller holds the parts of ``colift.onboard.interfaces``, the nominal team, the reference and the residual model
in use. Its methods are pure functions: the state after each control period is returned explicitly. A part is replaced
with ``dataclasses.replace``.

See Also:
    colift.onboard.interfaces: order of the calls in one control period, and the protocol of each part.
"""

from __future__ import annotations

import dataclasses

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
    zero_residual,
)
from colift.onboard.control import preview, tracking
from colift.onboard.control.actuator_compensation import NoCompensation
from colift.onboard.control.command_link import CommandLink, LeaderMessage
from colift.onboard.estimation.contact_monitor import ContactMonitor
from colift.onboard.estimation.effectiveness import EffectivenessFilter
from colift.onboard.estimation.state_estimator import StateEstimate
from colift.onboard.interfaces import (
    ActuatorCompensator,
    AgentController,
    AllocationDemand,
    Allocator,
    ContactForceCommand,
    ControlContext,
    Estimator,
    PartState,
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
    """Return the control context at a given state, without measurement and history.

    Used to evaluate parts of the controller at a state, for linearization and safety checks.

    Args:
        controller: Controller whose nominal team and reference are used.
        state: State of the team, taken as the estimate.
        a_L: Payload acceleration: linear [m/s^2, world], angular [rad/s^2, payload frame].
        t: Time [s].

    Returns:
        The context of a first control period at this state, with zero contact forces.
    """
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


def tracking_demand(
    team: Team, payload: PayloadState, command: tracking.AccelerationCommand, f_hat: ResidualForces
) -> AllocationDemand:
    """Compute the demand on the allocator for a commanded acceleration and predicted residuals.

    Args:
        team: Nominal parameters.
        payload: Estimated payload state.
        command: Commanded payload acceleration.
        f_hat: Predicted residuals of agents and payload.

    Returns:
        The demand, with the desired wrench (`tracking.desired_wrench`) and its rate.
    """
    return AllocationDemand(
        acceleration_cmd=command,
        f_hat=f_hat,
        W=tracking.desired_wrench(team.payload, team.gravity, payload, command, f_hat.payload),
        W_dot=tracking.desired_wrench_rate(team.payload, payload, command),
    )


@pytree
class ControlLawState:
    """States of the parts that the control law evaluates.

    Attributes:
        predictor: State of the residual predictor in this control period; the control law does not change it.
        payload_controller: State of the payload controller.
        allocator: State of the allocator.
        agent_controller: State of the agent controller.
        command_link: State of the link to the agents; `()` without one.
    """

    predictor: PartState
    payload_controller: PartState
    allocator: PartState
    agent_controller: PartState
    command_link: PartState = ()


@pytree
class ControllerState:
    """State of the controller between two control periods.

    Attributes:
        estimator: State of the estimator.
        recorder: Data sets recorded so far.
        control_law: States of predictor, payload controller, allocator and agent controller.
        last_command: Commands of the previous control period, after the thrust limit.
        actuator: State of the actuator compensator.
        corrector: State of the residual corrector; None without a corrector.
        last_wrench: Desired payload wrench of the previous control period [N world, N m payload frame].
        last_f_hat: Residual forces of the previous control period: those compensated, or with a corrector their
            estimate, which is not extrapolated.
        last_shortfall: Achieved minus commanded payload acceleration of the previous control period [m/s^2 world,
            rad/s^2 payload frame]; None if the allocator has no limits.
        initialized: 0 before the first control period, 1 afterwards.
        effectiveness: State of the estimate of rotor effectiveness; None without one.
        open_contacts: Contacts that have opened; None without their detection.
    """

    estimator: PartState
    recorder: RecorderState
    control_law: ControlLawState
    last_command: TeamInputs
    actuator: PartState
    corrector: PartState
    last_wrench: Wrench
    last_f_hat: ResidualForces
    last_shortfall: Float[Array, "6"] | None
    initialized: Scalar
    effectiveness: PartState = None
    open_contacts: PartState = None


@pytree
class ControlDemand:
    """Demand of the payload controller on the team, as far as the allocator achieves it.

    Attributes:
        acceleration_cmd: Achieved payload acceleration; the commanded one for an allocator without limits.
        shortfall: Achieved minus commanded acceleration [m/s^2 world, rad/s^2 payload frame]; None without limits.
        f_hat: Predicted residuals.
        W: Desired payload wrench for the achieved acceleration [N world, N m payload frame].
        forces: Commanded contact forces.
    """

    acceleration_cmd: tracking.AccelerationCommand
    shortfall: Float[Array, "6"] | None
    f_hat: ResidualForces
    W: Wrench
    forces: ContactForceCommand


@pytree
class LeaderFollowerController:
    """Leader-follower controller of the paper: a payload controller (leader) and controllers of the agents.

    Implements the protocol ``Controller``.

    Attributes:
        team: Nominal parameters.
        reference: Reference trajectory of the payload.
        estimator: State estimation and labels.
        recorder: Sampling of training data.
        residual_model: Residual model in use; constant between two model updates.
        residual_predictor: Prediction of the residuals.
        payload_controller: Tracking controller of the payload.
        allocator: Distribution of the payload wrench to contact forces.
        agent_controller: Controller of the agents.
        actuator_compensator: Compensation of the actuator dynamics; by default none.
        residual_corrector: Estimator of the error of the residual model; None disables it.
        effectiveness_filter: Estimate of the rotor effectiveness of each agent, which limits its thrust and is
            compensated; None: all agents are assumed healthy.
        contact_monitor: Detection of contacts that have opened, which the control law then does not use; None: all
            contacts are assumed closed.
        command_link: Link that transmits the leader's commands to the agents; None if they arrive without delay.
        preview_step: Interval between the times at which the control law is evaluated on the reference [s], such as
            `colift.onboard.control.preview.PREVIEW_STEP`; None disables the preview.

    Example:
        Replace the payload controller of an experiment::

            controller = experiment.controller
            integral = IntegralAction(base=controller.payload_controller, K_i=jnp.array(1.0), k_i=jnp.array(5.0))
            controller = dataclasses.replace(controller, payload_controller=integral)
            experiment = dataclasses.replace(experiment, controller=controller)
    """

    team: Team
    reference: base.ReferenceTrajectory
    estimator: Estimator
    recorder: DataRecorder
    residual_model: residual_model.ResidualModel
    residual_predictor: ResidualPredictor
    payload_controller: PayloadController
    allocator: Allocator
    agent_controller: AgentController
    actuator_compensator: ActuatorCompensator = NoCompensation()
    residual_corrector: residual_correction.ResidualCorrector | None = None
    effectiveness_filter: EffectivenessFilter | None = None
    contact_monitor: ContactMonitor | None = None
    command_link: CommandLink | None = None
    preview_step: Scalar | None = None

    def init(self, measurement: Measurement, clock: ControlClock) -> tuple[TeamInputs, ControllerState]:
        """Compute the command at rest and the initial state, with empty data sets and this command as the last one.

        Args:
            measurement: Readings of the team at rest.
            clock: Time and control period [s].

        Returns:
            The command until the first control period, and the state before that period.
        """
        zero = tuple(
            AgentInput(u=jnp.zeros(size), tau=jnp.zeros((size, 3)), tau_r=jnp.zeros((size, group.tree.joints)))
            for size, group in zip(self.team.sizes, self.team.agent_groups, strict=True)
        )
        state = ControllerState(
            estimator=self.estimator.init(self.team, measurement),
            recorder=self.recorder.init(self.team, self.residual_model),
            control_law=self.init_control_law(),
            last_command=zero,
            actuator=self.actuator_compensator.init(zero),
            corrector=None if self.residual_corrector is None else self.residual_corrector.init(self.team),
            last_wrench=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
            last_f_hat=zero_residual(self.team),
            last_shortfall=None,
            initialized=jnp.zeros(()),
            effectiveness=None if self.effectiveness_filter is None else self.effectiveness_filter.init(self.team),
            open_contacts=None if self.contact_monitor is None else self.contact_monitor.init(self.team, measurement),
        )
        team = (
            self.team if self.contact_monitor is None else self.contact_monitor.acting(state.open_contacts, self.team)
        )
        estimate, _ = self.estimator.update(team, state.estimator, measurement, zero, state.last_f_hat, clock)
        context = ControlContext(
            team=team,
            clock=clock,
            measurement=measurement,
            estimate=estimate,
            setpoint=self.reference.evaluate(clock.t),
            last_wrench=state.last_wrench,
            initialized=state.initialized,
            correction=None
            if self.residual_corrector is None
            else residual_correction.zero_correction(zero_residual(self.team), clock.t),
        )
        hover, _, telemetry = dataclasses.replace(self, command_link=None).control_law(state.control_law, context)
        control_law = state.control_law
        if self.command_link is not None:
            demand, context, _ = self._leader(control_law, context)
            link = self.command_link.init(self.team, _message(demand, context), control_law.agent_controller)
            control_law = dataclasses.replace(control_law, command_link=link)
        return hover, dataclasses.replace(
            state,
            control_law=control_law,
            last_command=hover,
            actuator=self.actuator_compensator.init(hover),
            last_shortfall=None if telemetry.shortfall is None else jnp.zeros(6),
        )

    def init_control_law(self) -> ControlLawState:
        """Return the states of the parts of the control law before the first control period."""
        return ControlLawState(
            predictor=self.residual_predictor.init(self.team),
            payload_controller=self.payload_controller.init(),
            allocator=self.allocator.init(),
            agent_controller=self.agent_controller.init(),
        )

    def step(
        self, state: ControllerState, measurement: Measurement, clock: ControlClock
    ) -> tuple[TeamInputs, ControllerState, Telemetry]:
        """Advance the controller by one control period.

        Args:
            state: State after the previous control period.
            measurement: Readings of this control period.
            clock: Time and control period [s].

        Returns:
            The command until the next control period, the next state, and intermediate results for the log.
        """
        applied = self.actuator_compensator.effective_command(state.actuator, state.last_command)
        health, effectiveness, team = self.effectiveness_filter, state.effectiveness, self.team
        monitor, open_contacts = self.contact_monitor, state.open_contacts
        if monitor is not None:
            team = monitor.acting(open_contacts, team)
        acting = applied if health is None else health.acting(effectiveness, team, applied)
        estimate, estimator_state = self.estimator.update(
            team, state.estimator, measurement, acting, state.last_f_hat, clock
        )
        if monitor is not None:
            open_contacts = monitor.update(open_contacts, self.team, estimate, measurement, clock.t)
            team = monitor.acting(open_contacts, self.team)
        setpoint = self.reference.evaluate(clock.t)
        context = ControlContext(
            team=team,
            clock=clock,
            measurement=measurement,
            estimate=estimate,
            setpoint=setpoint,
            last_wrench=state.last_wrench,
            initialized=state.initialized,
            last_shortfall=state.last_shortfall,
        )
        corrector, observation = state.corrector, self._observe(estimate, clock)
        if health is not None:
            modelled = state.last_f_hat if observation is None else observation.prediction
            effectiveness = health.update(effectiveness, team, estimate, modelled, applied, clock.dt)
            if observation is not None:
                change = health.label_change(state.effectiveness, effectiveness, team, estimate, applied)
                observation = dataclasses.replace(observation, next_label_change=change)
            context = dataclasses.replace(context, team=health.limited(effectiveness, team))
        if self.residual_corrector is not None and observation is not None:
            correction, corrector = self.residual_corrector.update(corrector, observation, clock)
            context = dataclasses.replace(context, correction=correction)
        predictor = self.residual_predictor.update(state.control_law.predictor, self.residual_model, context)
        requested, control_law, telemetry = self.control_law(
            dataclasses.replace(state.control_law, predictor=predictor), context
        )
        if health is not None:
            requested = health.compensated(effectiveness, team, requested)
            telemetry = dataclasses.replace(telemetry, effectiveness=effectiveness.in_use)
        command, actuator = self.actuator_compensator.command(self.team, state.actuator, requested, clock.dt)
        state = ControllerState(
            estimator=estimator_state,
            recorder=self.recorder.record(state.recorder, measurement, estimate.sample, clock.t),
            corrector=corrector,
            control_law=control_law,
            last_command=command,
            actuator=actuator,
            last_wrench=telemetry.W_d,
            last_f_hat=telemetry.f_hat if context.correction is None else context.correction.corrected,
            last_shortfall=telemetry.shortfall,
            initialized=jnp.ones(()),
            effectiveness=effectiveness,
            open_contacts=open_contacts,
        )
        return command, state, telemetry

    def _observe(self, estimate: StateEstimate, clock: ControlClock) -> residual_correction.ResidualObservation | None:
        """Return label and prediction of this control period; None without a residual corrector."""
        if self.residual_corrector is None:
            return None
        return residual_correction.observe(self.residual_model, self.team, estimate, clock.dt)

    def control_law(
        self, state: ControlLawState, context: ControlContext
    ) -> tuple[TeamInputs, ControlLawState, Telemetry]:
        """Evaluate the control law in a given context, without actuator compensation.

        Args:
            state: States of the parts of the control law; that of the predictor in this control period.
            context: Inputs of this control period; its preview is computed here.

        Returns:
            The requested inputs of the agents, the next states of the parts, and intermediate results.
        """
        demand, context, next_state = self._leader(state, context)
        link, measurement, part = self.command_link, context.measurement, state.agent_controller
        if link is None or measurement is None or measurement.link_delay_s is None:
            (inputs, saturated), part = self.agent_controller.compute(
                part, context, demand.acceleration_cmd, demand.forces, demand.f_hat
            )
        else:
            link_state = link.deliver(state.command_link, context, _message(demand, context))
            (inputs, saturated), link_state = link.compute(self.agent_controller, link_state, context, demand.f_hat)
            next_state = dataclasses.replace(next_state, command_link=link_state)
        telemetry = Telemetry(
            estimate=context.estimate,
            setpoint=context.setpoint,
            W_d=demand.W,
            lam_cmd=demand.forces.lam,
            f_hat=demand.f_hat,
            eta=demand.forces.eta,
            saturated=saturated,
            correction=context.correction,
            allocation=demand.forces.report,
            shortfall=demand.shortfall,
        )
        return inputs, dataclasses.replace(next_state, agent_controller=part), telemetry

    def _leader(
        self, state: ControlLawState, context: ControlContext
    ) -> tuple[ControlDemand, ControlContext, ControlLawState]:
        """Evaluate the control law up to the agent controllers; return the demand and the context with its preview."""
        demand, next_state = self._demand(state, context)
        if self.preview_step is not None:
            team_preview = self._preview(state, context, self.preview_step)
            context = dataclasses.replace(context, preview=team_preview)
        return demand, context, next_state

    def _demand(self, state: ControlLawState, context: ControlContext) -> tuple[ControlDemand, ControlLawState]:
        """Evaluate payload controller, prediction, desired wrench and allocation."""
        command, payload_controller = self.payload_controller.compute(state.payload_controller, context)
        f_hat = self.residual_predictor.predict(
            state.predictor, self.residual_model, context, _expected_acceleration(command, context)
        )
        demand = tracking_demand(self.team, context.estimate.payload, command, f_hat)
        forces, allocator = self.allocator.allocate(state.allocator, context, demand)
        next_state = dataclasses.replace(state, payload_controller=payload_controller, allocator=allocator)
        if (achieved := forces.acceleration) is None:
            return ControlDemand(
                acceleration_cmd=command, shortfall=None, f_hat=f_hat, W=demand.W, forces=forces
            ), next_state
        payload, gravity = self.team.payload, self.team.gravity
        W = tracking.desired_wrench(payload, gravity, context.estimate.payload, achieved, f_hat.payload)
        shortfall = None
        if forces.report is not None:
            shortfall = jnp.concatenate([achieved.a - command.a, achieved.alpha - command.alpha])
        return ControlDemand(
            acceleration_cmd=achieved, shortfall=shortfall, f_hat=f_hat, W=W, forces=forces
        ), next_state

    def _preview(self, state: ControlLawState, context: ControlContext, step: Scalar) -> TeamPreview:
        """Evaluate the control law on the reference at times around the current one.

        The payload is on the reference. Agents move with it and continue to rotate at their current angular velocity.

        Returns:
            The preview of the team.
        """

        def evaluate(s: Scalar) -> tuple[PayloadState, ControlDemand]:
            clock = dataclasses.replace(context.clock, t=context.clock.t + s)
            d = self.reference.evaluate(clock.t)
            payload = PayloadState(R=d.R, p=d.p, v=d.v, omega=d.omega)

            def moved(q: AgentState) -> AgentState:
                R, x = matmul(q.R, so3.exp(s * q.omega)), q.x + d.p - context.setpoint.p
                return dataclasses.replace(q, R=R, x=x, v=d.v, r_dot=jnp.zeros_like(q.r_dot))

            agents, a_L = (
                tuple(jax.vmap(moved)(q) for q in context.estimate.agents),
                jnp.concatenate([d.a, d.omega_dot]),
            )
            estimate = dataclasses.replace(context.estimate, payload=payload, agents=agents, a_L=a_L)
            previewed = dataclasses.replace(context, clock=clock, setpoint=d, estimate=estimate, is_preview=True)
            return payload, self._demand(state, previewed)[0]

        payload, demand = jax.vmap(evaluate)(step * jnp.asarray(preview.PREVIEW_NODES))
        return TeamPreview(
            step=step,
            payload=payload,
            acceleration_cmd=demand.acceleration_cmd,
            lam=demand.forces.lam,
            f_hat=demand.f_hat,
        )


def _expected_acceleration(
    command: tracking.AccelerationCommand, context: ControlContext
) -> tracking.AccelerationCommand:
    """Return the commanded acceleration plus the shortfall of the last control period.

    Residuals of payload parameters are proportional to the acceleration. At a limit the commanded acceleration may
    exceed the achieved one by several times the gravitational acceleration, and so would these residuals.
    """
    if context.last_shortfall is None or context.is_preview:  # the preview has no limits
        return command
    d = context.last_shortfall
    return dataclasses.replace(command, a=command.a + d[:3], alpha=command.alpha + d[3:])


def _message(demand: ControlDemand, context: ControlContext) -> LeaderMessage:
    """Return the commands that the leader sends to the agents."""
    forces = dataclasses.replace(demand.forces, acceleration=None, report=None)
    return LeaderMessage(acceleration_cmd=demand.acceleration_cmd, forces=forces, preview=context.preview)
