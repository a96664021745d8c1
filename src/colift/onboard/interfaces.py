"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from jaxtyping import Array, Bool, Float

from colift.math.pytree import pytree
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import ControlClock, PayloadState, ResidualForces, TeamInputs, Wrench
from colift.onboard.control import tracking
from colift.onboard.estimation.state_estimator import StateEstimate
from colift.onboard.learning import residual_correction, residual_model
from colift.trajectories import base

Scalar = Float[Array, ""]


@pytree
class ControlContext:
    """What is known on board when a tick is decided."""

    team: Team  # nominal
    clock: ControlClock
    measurement: Measurement | None  # None where the law is linearized around a state that nothing measured
    estimate: StateEstimate
    setpoint: base.PayloadSetpoint
    last_wrench: Wrench  # desired wrench of the last tick, zero before the first
    initialized: Scalar  # 0 in the first tick, 1 after: what is differenced or filtered begins with the second
    preview: TeamPreview | None = None  # for a realizer that looks ahead
    innovation: residual_correction.Innovation | None = (
        None  # what labels say beyond what is learned, where a pilot listens
    )


@pytree
class TeamPreview:
    """What the law asks for on the reference, at `control.NODES` times the step around now; times lead."""

    step: Scalar  # s
    payload: PayloadState
    acceleration_cmd: tracking.AccelerationCommand
    lam: Float[Array, "times contacts 3"]  # N
    f_hat: ResidualForces


# The doors ------------------------------------------------------------------------------------------------------------


@runtime_checkable
class Controller(Protocol):
    """All that flies: what a loop asks of it."""

    def init(self, first: Measurement, clock: ControlClock) -> tuple[TeamInputs, Any]:
        """The command that holds the team until the first tick, and the memory before it, from a reading at rest."""
        ...

    def step(self, state: Any, measurement: Measurement, clock: ControlClock) -> tuple[TeamInputs, Any, Telemetry]:
        """The command from now on, the next memory, and what was decided."""
        ...


@runtime_checkable
class Estimator(Protocol):
    """States from measurements; ours is `estimate.Estimator`."""

    def init(self, team: Team, first: Measurement) -> Any:
        """The memory at a reading at rest; team: nominal."""
        ...

    def update(
        self, team: Team, state: Any, measurement: Measurement, applied: TeamInputs, clock: ControlClock
    ) -> tuple[StateEstimate, Any]:
        """What is believed now, given the command of the last tick; with labels, if it has any."""
        ...


@runtime_checkable
class ResidualPredictor(Protocol):
    """`f_hat`, the unknown forces that commands compensate."""

    def init(self, team: Team) -> Any:
        """The memory before the first tick; team: nominal."""
        ...

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """The memory of this tick, once a tick."""
        ...

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """The prediction for a payload that is commanded to accelerate so: now, or where a pilot looks ahead."""
        ...


@runtime_checkable
class ActuatorCompensator(Protocol):
    """Commands under which vehicles give what is asked of them."""

    def init(self, command: TeamInputs) -> Any:
        """The memory after a command has acted for ever."""
        ...

    def command(self, team: Team, state: Any, requested: TeamInputs, dt: Scalar) -> tuple[TeamInputs, Any]:
        """The command for what is asked, and the memory one tick of dt, s, later."""
        ...

    def effective_command(self, state: Any, sent: TeamInputs) -> TeamInputs:
        """What is believed to have acted in the last tick, in which `sent` was commanded."""
        ...


@runtime_checkable
class PayloadController(Protocol):
    """How the payload is to accelerate."""

    def init(self) -> Any:
        """The memory before the first tick."""
        ...

    def compute(self, state: Any, context: ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        """The commanded acceleration of the payload, and its rate."""
        ...


@runtime_checkable
class Allocator(Protocol):
    """Contact forces that give a payload wrench."""

    def allocate(self, context: ControlContext, W: Wrench, W_dot: Wrench) -> ContactForceCommand:
        """Commanded contact forces, and their rate."""
        ...


@runtime_checkable
class AgentController(Protocol):
    """Commands that put contact forces on the payload."""

    def compute(
        self,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        forces: ContactForceCommand,
        f_hat: ResidualForces,
    ) -> tuple[TeamInputs, SaturationFlags]:
        """Every agent's command, and which thrusts were limited."""
        ...


SaturationFlags = tuple[Bool[Array, "agents"], ...]


@pytree
class ContactForceCommand:
    """What an allocator asks of the contacts, world."""

    lam: Float[Array, "contacts 3"]  # N, on the payload
    lam_dot: Float[Array, "contacts 3"]  # N/s
    eta: Float[Array, " eta"]  # N, internal-force input, for the log


@pytree
class Telemetry:
    """What one tick decided, for the log."""

    estimate: StateEstimate
    setpoint: base.PayloadSetpoint
    W_d: Wrench
    lam_cmd: Float[Array, "contacts 3"]
    f_hat: ResidualForces
    eta: Float[Array, " eta"]
    saturated: SaturationFlags
    innovation: residual_correction.Innovation | None = None
