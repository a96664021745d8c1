"""Interfaces of the onboard controller and of its parts.

A controller converts measurements to commands, once in every control period. ``LeaderFollowerController``
(``colift.onboard.controller``) is composed of the parts below. A user replaces one part, or the whole controller.

One control period of ``LeaderFollowerController``, in the order of the calls:

==  ===============================================  =========================================================
1   ``ActuatorCompensator.effective_command``        inputs that were in effect since the previous period
2   ``Estimator.update``                             state estimate and training sample
3   ``ReferenceTrajectory.evaluate``                 setpoint of the payload
4   ``ResidualCorrector.update``                     error of the residual model (optional part)
5   ``ResidualPredictor.update``                     state of the predictor
6   ``PayloadController.compute``                    commanded payload acceleration
7   ``ResidualPredictor.predict``                    predicted residuals ``f_hat``
8   ``tracking.desired_wrench``                      desired payload wrench ``W``
9   ``Allocator.allocate``                           contact forces ``lam``, the acceleration that they achieve
10  ``AgentController.compute``                      requested thrust, body torque and joint torques
11  ``ActuatorCompensator.command``                  commands sent to the vehicles
12  ``DataRecorder.record``                          data sets of the next model update
==  ===============================================  =========================================================

Rules for a part:

- It is an immutable PyTree (``colift.math.pytree.pytree``); its parameters are its fields. No base class is needed.
- Its methods are pure JAX functions. They are compiled, and may be exported as C code.
- Its state is explicit: ``init`` returns it, and each method returns the next one. A state is any PyTree of fixed
  structure, shapes and dtypes; a part without state returns ``()``.
- Measurements are the only information about the simulated world. ``ControlContext`` contains all inputs of a part.

Units are SI. Positions, velocities and forces are in the world frame. Angular velocities and moments are in the frame
of their own body. Any exception is stated.

Example:
    A payload controller that limits the acceleration command of another one::

        @pytree
        class AccelerationLimit:
            base: PayloadController
            max_acceleration: Float[Array, ""]  # m/s^2

            def init(self) -> PartState:
                return self.base.init()

            def compute(self, state: PartState, context: ControlContext) -> tuple[AccelerationCommand, PartState]:
                command, state = self.base.compute(state, context)
                norm = jnp.sqrt((command.a * command.a).sum() + 1e-12)
                scale = jnp.minimum(1.0, self.max_acceleration / norm)
                return dataclasses.replace(command, a=scale * command.a), state


        experiment = colift.make_experiment(colift.load_scenario("paper"), "C1")
        controller = experiment.controller
        limited = AccelerationLimit(base=controller.payload_controller, max_acceleration=jnp.array(2.0))
        controller = dataclasses.replace(controller, payload_controller=limited)
        result = colift.run_experiment(dataclasses.replace(experiment, controller=controller))

See Also:
    docs/change_a_part: how to replace a part in Python and in a scenario file.
    docs/notation: symbols, units and frames.
"""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, runtime_checkable

from jaxtyping import Array, Bool, Float

from colift.math.pytree import pytree, static
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import ControlClock, PayloadState, ResidualForces, TeamInputs, Wrench
from colift.onboard.control import tracking
from colift.onboard.estimation.state_estimator import StateEstimate
from colift.onboard.learning import residual_correction, residual_model
from colift.trajectories import base

Scalar = Float[Array, ""]

PartState: TypeAlias = Any
"""State of a part between control periods: any PyTree of fixed structure, shapes and dtypes; ``()`` for none."""

SaturationFlags = tuple[Bool[Array, "agents"], ...]
"""Agents whose thrust command was limited, one array per group of agents."""


# Data that parts exchange ---------------------------------------------------------------------------------------------


@pytree
class ControlContext:
    """Inputs of all parts in one control period.

    Attributes:
        team: Nominal parameters of the team: masses [kg], inertias [kg m^2, body frame], geometry [m, body frame] and
            gravity [m/s^2, world]. They may differ from those of the simulated team.
        clock: Time ``t`` of this control period [s] and its length ``dt`` [s].
        measurement: Readings of all sensors in this period. None if the control law is evaluated at a given state
            without sensors, as in a linearization.
        estimate: Estimated state. Agents: attitude, center of mass [m, world], joint positions [rad or m], and their
            rates. Payload: pose and twist. Also the payload acceleration ``a_L`` and the contact forces on the payload
            ``lam`` [N, world], as measured or reconstructed.
        setpoint: Desired payload pose at ``clock.t`` with its derivatives: ``p`` to ``j`` in the world frame [m to
            m/s^3], ``omega`` and ``omega_dot`` in the desired payload frame [rad/s, rad/s^2].
        last_wrench: Desired payload wrench of the previous period: force [N, world] and moment [N m, payload frame].
            Zero before the first period.
        initialized: 0 in the first period, 1 afterwards. Differences and filters start with the second period.
        preview: Control law evaluated on the reference at times around ``clock.t``. Set for ``AgentController.compute``
            if the controller has a ``preview_step``; None otherwise.
        correction: Estimated error of the residual model [N, N m]. None without a ``residual_corrector``.
        last_shortfall: Achieved minus commanded payload acceleration of the previous period [m/s^2 world, rad/s^2
            payload frame], for anti-windup and the prediction of residuals. None if the allocator has no limits.
        is_preview: True in evaluations for the preview, where an allocator may neglect limits to save time.
    """

    team: Team
    clock: ControlClock
    measurement: Measurement | None
    estimate: StateEstimate
    setpoint: base.PayloadSetpoint
    last_wrench: Wrench
    initialized: Scalar
    preview: TeamPreview | None = None
    correction: residual_correction.ResidualCorrection | None = None
    last_shortfall: Float[Array, "6"] | None = None
    is_preview: bool = static(default=False)


@pytree
class TeamPreview:
    """Control law evaluated on the reference at times around the current one; all fields but `step` lead with time.

    The times are ``t + step * PREVIEW_NODES`` (``colift.onboard.control.preview``).

    Attributes:
        step: Interval between two of the times [s].
        payload: Payload states on the reference.
        acceleration_cmd: Commanded payload accelerations there.
        lam: Commanded contact forces on the payload [N, world].
        f_hat: Predicted residuals of agents and payload.
    """

    step: Scalar
    payload: PayloadState
    acceleration_cmd: tracking.AccelerationCommand
    lam: Float[Array, "times contacts 3"]
    f_hat: ResidualForces


@pytree
class AllocationDemand:
    """Demand on the team that an allocator distributes to the contacts.

    Attributes:
        acceleration_cmd: Commanded payload acceleration.
        f_hat: Predicted residuals of agents and payload.
        W: Desired payload wrench for both: force [N, world] and moment [N m, payload frame].
        W_dot: Its rate [N/s, N m/s], same frames.
    """

    acceleration_cmd: tracking.AccelerationCommand
    f_hat: ResidualForces
    W: Wrench
    W_dot: Wrench


@pytree
class AllocationReport:
    """Limits that act in one allocation, and the accuracy of its solution.

    The slack is the part of the commanded acceleration that is not achieved, as a force: force on the team's mass, or
    moment on the team's inertia divided by the lever of the contacts.

    Attributes:
        slack: Slack of roll and pitch, of z, of x and y, and of yaw [N].
        residuals: Primal and dual residual of the solution [N].
        tilt: Agents whose thrust direction is at its limit.
        thrust: Agents whose thrust is at its minimum or maximum.
        friction: Contacts whose force is at the friction cone.
        force: Contacts whose force is at its minimum or maximum.
    """

    slack: Float[Array, "4"]
    residuals: Float[Array, "2"]
    tilt: Bool[Array, "agents"]
    thrust: Bool[Array, "agents"]
    friction: Bool[Array, "contacts"]
    force: Bool[Array, "contacts"]


@pytree
class ContactForceCommand:
    """Commanded contact forces of all contacts, in the order of the team.

    Attributes:
        lam: Contact forces on the payload [N, world].
        lam_dot: Their rate, a feedforward of the agents' attitudes [N/s, world].
        eta: Internal-force input, coordinates in the null space of the grasp matrix [N]; for the log.
        acceleration: Payload acceleration that these forces achieve. None if it is the commanded one.
        report: Limits that act. None for an allocator without limits.
        moments: Moments of the contacts on the payload [N m, payload frame]. None if no moments are commanded.
    """

    lam: Float[Array, "contacts 3"]
    lam_dot: Float[Array, "contacts 3"]
    eta: Float[Array, " eta"]
    acceleration: tracking.AccelerationCommand | None = None
    report: AllocationReport | None = None
    moments: Float[Array, "contacts 3"] | None = None


@pytree
class Telemetry:
    """Intermediate results of one control period, for the log.

    Attributes:
        estimate: State estimate.
        setpoint: Desired payload pose with its derivatives.
        W_d: Desired payload wrench for the achieved acceleration: force [N, world] and moment [N m, payload frame].
        lam_cmd: Commanded contact forces on the payload [N, world].
        f_hat: Predicted residuals of agents and payload.
        eta: Internal-force input [N].
        saturated: Agents whose thrust command was limited.
        correction: Estimated error of the residual model; None without a ``residual_corrector``.
        allocation: Limits that act in the allocation; None for an allocator without limits.
        shortfall: Achieved minus commanded payload acceleration [m/s^2 world, rad/s^2 payload frame]; None for an
            allocator without limits.
        effectiveness: Rotor effectiveness that the controller compensates; None without an estimate.
    """

    estimate: StateEstimate
    setpoint: base.PayloadSetpoint
    W_d: Wrench
    lam_cmd: Float[Array, "contacts 3"]
    f_hat: ResidualForces
    eta: Float[Array, " eta"]
    saturated: SaturationFlags
    correction: residual_correction.ResidualCorrection | None = None
    allocation: AllocationReport | None = None
    shortfall: Float[Array, "6"] | None = None
    effectiveness: Float[Array, "agents"] | None = None


# The whole controller -------------------------------------------------------------------------------------------------


@runtime_checkable
class Controller(Protocol):
    """Map from measurements to the commands of all agents, called once in every control period.

    Implementation: ``controller.LeaderFollowerController``.
    """

    @property
    def team(self) -> Team:
        """Nominal parameters of the team; the log computes residuals with them."""
        ...

    def init(self, measurement: Measurement, clock: ControlClock) -> tuple[TeamInputs, PartState]:
        """Compute the initial command and the initial state.

        Args:
            measurement: Readings of the team at rest.
            clock: Time and control period [s].

        Returns:
            The command until the first control period, and the state before that period.
        """
        ...

    def step(
        self, state: PartState, measurement: Measurement, clock: ControlClock
    ) -> tuple[TeamInputs, PartState, Telemetry]:
        """Advance the controller by one control period.

        Args:
            state: State after the previous control period.
            measurement: Readings of this control period.
            clock: Time and control period [s].

        Returns:
            The command until the next control period, the next state, and intermediate results for the log.
        """
        ...


# Its parts ------------------------------------------------------------------------------------------------------------


@runtime_checkable
class Estimator(Protocol):
    """State estimation from measurements; an estimator may also provide training samples.

    Implementation: ``state_estimator.ComplementaryFilter``.
    """

    def init(self, team: Team, measurement: Measurement) -> PartState:
        """Compute the state of an estimator in steady state at rest.

        Args:
            team: Nominal parameters.
            measurement: Readings of the team at rest.

        Returns:
            The state before the first control period.
        """
        ...

    def update(
        self,
        team: Team,
        state: PartState,
        measurement: Measurement,
        applied: TeamInputs,
        f_hat: ResidualForces,
        clock: ControlClock,
    ) -> tuple[StateEstimate, PartState]:
        """Update the estimate with the readings of one control period.

        Args:
            team: Nominal parameters.
            state: State after the previous control period.
            measurement: Readings of this control period.
            applied: Inputs in effect since the previous control period: thrust [N], body torque [N m, body frame],
                joint torques or forces [N m or N].
            f_hat: Residual forces compensated in the previous control period, with a corrector their estimate before
                its extrapolation; zero before the first one. They replace
                tip force readings that are missing.
            clock: Time and control period [s].

        Returns:
            The state estimate, with a training sample if the estimator computes labels, and the next state.
        """
        ...


@runtime_checkable
class ResidualPredictor(Protocol):
    """Prediction of the residual forces ``f_hat`` that the controller compensates.

    Implementations: ``LearnedResidual``, ``DisturbanceObserver``, ``CorrectedResidual`` and ``TrueResidual`` in
    ``colift.onboard.learning.residual_predictors``.
    """

    def init(self, team: Team) -> PartState:
        """Return the state before the first control period.

        Args:
            team: Nominal parameters.
        """
        ...

    def update(self, state: PartState, model: residual_model.ResidualModel, context: ControlContext) -> PartState:
        """Advance the state by one control period; called once, before `predict`.

        Args:
            state: State after the previous control period.
            model: Residual model in use.
            context: Inputs of this control period.

        Returns:
            The state that `predict` receives in this control period.
        """
        ...

    def predict(
        self,
        state: PartState,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Predict the residual forces for a commanded payload acceleration.

        With a preview the method is also evaluated at states on the reference, with their time in `context.clock`.

        Args:
            state: Result of `update` in this control period.
            model: Residual model in use.
            context: Inputs at the time of the prediction.
            acceleration_cmd: Commanded payload acceleration [m/s^2 world, rad/s^2 payload frame], at limits with the
                shortfall of the previous period.

        Returns:
            Residuals of the agents (force on the center of mass [N, world], moment [N m, body frame], joint torques
            or forces [N m or N]) and of the payload (force [N, world], moment [N m, payload frame]).
        """
        ...


@runtime_checkable
class PayloadController(Protocol):
    """Tracking controller of the payload; the leader of the paper.

    Implementations: ``GeometricTracking`` and ``IntegralAction`` in ``colift.onboard.control.payload_controllers``.
    """

    def init(self) -> PartState:
        """Return the state before the first control period."""
        ...

    def compute(self, state: PartState, context: ControlContext) -> tuple[tracking.AccelerationCommand, PartState]:
        """Compute the commanded payload acceleration and its rate.

        Args:
            state: State after the previous control period.
            context: Inputs of this control period.

        Returns:
            The acceleration command and the next state.
        """
        ...


@runtime_checkable
class Allocator(Protocol):
    """Distribution of a payload wrench to contact forces.

    An allocator without limits returns forces with ``G lam = W``. An allocator with limits also returns the payload
    acceleration that its forces achieve. The agent controllers, the disturbance observer, the integral action and the
    log then use the achieved acceleration and its wrench.

    Implementation: ``allocators.LinearAllocator``.
    """

    def init(self) -> PartState:
        """Return the state before the first control period, such as a warm start; ``()`` for none."""
        ...

    def allocate(
        self, state: PartState, context: ControlContext, demand: AllocationDemand
    ) -> tuple[ContactForceCommand, PartState]:
        """Compute contact forces for a demand, and their rate.

        With a preview the method is also evaluated at states on the reference (`ControlContext.is_preview`), with the
        state of this control period; the states that these calls return are not used.

        Args:
            state: State after the previous control period.
            context: Inputs of this control period.
            demand: Commanded acceleration, predicted residuals and desired payload wrench.

        Returns:
            Commanded contact forces on the payload, and the next state.
        """
        ...


@runtime_checkable
class AgentController(Protocol):
    """Controller of all agents: commands that apply the contact forces to the payload.

    Implementations: ``ThrustVectoringController`` and ``PreviewThrustVectoringController`` in
    ``colift.onboard.control.agent_controllers``.
    """

    def init(self) -> PartState:
        """Return the state before the first control period; ``()`` for none."""
        ...

    def compute(
        self,
        state: PartState,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        forces: ContactForceCommand,
        f_hat: ResidualForces,
    ) -> tuple[tuple[TeamInputs, SaturationFlags], PartState]:
        """Compute the requested inputs of all agents.

        Args:
            state: State after the previous control period.
            context: Inputs of this control period.
            acceleration_cmd: Payload acceleration that the commanded forces achieve; the arm tips follow it.
            forces: Commanded contact forces.
            f_hat: Predicted residuals.

        Returns:
            A pair of results, and the next state. The results are the inputs by group of agents: thrust [N], body
            torque [N m, body frame] and joint torques or forces [N m or N]; and the agents whose thrust was limited.
        """
        ...


@runtime_checkable
class ActuatorCompensator(Protocol):
    """Compensation of the actuator dynamics.

    Implementations: ``NoCompensation``, ``LagInversion`` and ``KnownRotorLimits`` in
    ``colift.onboard.control.actuator_compensation``.
    """

    def init(self, command: TeamInputs) -> PartState:
        """Return the state after a constant command.

        Args:
            command: Command that has been constant for a long time.
        """
        ...

    def command(self, team: Team, state: PartState, requested: TeamInputs, dt: Scalar) -> tuple[TeamInputs, PartState]:
        """Compute the commands with which the actuators produce the requested inputs.

        Args:
            team: Nominal parameters.
            state: State after the previous control period.
            requested: Inputs that should act on the agents.
            dt: Control period [s].

        Returns:
            The commands to be sent, and the state one control period later.
        """
        ...

    def effective_command(self, state: PartState, last_command: TeamInputs) -> TeamInputs:
        """Estimate the inputs that acted on the agents since the previous control period.

        Args:
            state: State after the previous control period.
            last_command: Commands sent in the previous control period.

        Returns:
            Estimated inputs, in the units of the commands.
        """
        ...
