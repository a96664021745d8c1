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
from colift.models.state import Clock, Inputs, PayloadState, Residual, Wrench
from colift.onboard.control import tracking
from colift.onboard.estimation.state_estimator import Estimate
from colift.onboard.learning import residual_correction, residual_model
from colift.trajectories import base

Scalar = Float[Array, ""]


@pytree
class Now:
    """What is known on board when a tick is decided."""

    team: Team  # nominal
    clock: Clock
    m: Measurement | None  # None where the law is linearized around a state that nothing measured
    q_hat: Estimate
    d: base.Setpoint
    W: Wrench  # desired wrench of the last tick, zero before the first
    ticks: Scalar  # 0 in the first tick, 1 after: what is differenced or filtered begins with the second
    ahead: Ahead | None = None  # for a realizer that looks ahead
    news: residual_correction.News | None = None  # what labels say beyond what is learned, where a pilot listens


@pytree
class Ahead:
    """What the law asks for on the reference, at `control.NODES` times the step around now; times lead."""

    step: Scalar  # s
    load: PayloadState
    to: tracking.Command
    lam: Float[Array, "times contacts 3"]  # N
    f_hat: Residual


# The doors ------------------------------------------------------------------------------------------------------------


@runtime_checkable
class Pilot(Protocol):
    """All that flies: what a loop asks of it."""

    def begin(self, first: Measurement, clock: Clock) -> tuple[Inputs, Any]:
        """The command that holds the team until the first tick, and the memory before it, from a reading at rest."""
        ...

    def tick(self, memory: Any, m: Measurement, clock: Clock) -> tuple[Inputs, Any, Telemetry]:
        """The command from now on, the next memory, and what was decided."""
        ...


@runtime_checkable
class Estimator(Protocol):
    """States from measurements; ours is `estimate.Estimator`."""

    def begin(self, team: Team, first: Measurement) -> Any:
        """The memory at a reading at rest; team: nominal."""
        ...

    def observe(self, team: Team, memory: Any, m: Measurement, applied: Inputs, clock: Clock) -> tuple[Estimate, Any]:
        """What is believed now, given the command of the last tick; with labels, if it has any."""
        ...


@runtime_checkable
class Predictor(Protocol):
    """`f_hat`, the unknown forces that commands compensate."""

    def begin(self, team: Team) -> Any:
        """The memory before the first tick; team: nominal."""
        ...

    def observe(self, memory: Any, oracle: residual_model.Oracle, now: Now) -> Any:
        """The memory of this tick, once a tick."""
        ...

    def predict(self, memory: Any, oracle: residual_model.Oracle, now: Now, to: tracking.Command) -> Residual:
        """The prediction for a payload that is commanded to accelerate so: now, or where a pilot looks ahead."""
        ...


@runtime_checkable
class Drive(Protocol):
    """Commands under which vehicles give what is asked of them."""

    def begin(self, command: Inputs) -> Any:
        """The memory after a command has acted for ever."""
        ...

    def command(self, team: Team, memory: Any, asked: Inputs, dt: Scalar) -> tuple[Inputs, Any]:
        """The command for what is asked, and the memory one tick of dt, s, later."""
        ...

    def acts(self, memory: Any, sent: Inputs) -> Inputs:
        """What is believed to have acted in the last tick, in which `sent` was commanded."""
        ...


@runtime_checkable
class Leader(Protocol):
    """How the payload is to accelerate."""

    def begin(self) -> Any:
        """The memory before the first tick."""
        ...

    def lead(self, memory: Any, now: Now) -> tuple[tracking.Command, Any]:
        """The commanded acceleration of the payload, and its rate."""
        ...


@runtime_checkable
class Allocator(Protocol):
    """Contact forces that give a payload wrench."""

    def allocate(self, now: Now, W: Wrench, W_dot: Wrench) -> Forces:
        """Commanded contact forces, and their rate."""
        ...


@runtime_checkable
class Realizer(Protocol):
    """Commands that put contact forces on the payload."""

    def realize(self, now: Now, to: tracking.Command, forces: Forces, f_hat: Residual) -> tuple[Inputs, Saturated]:
        """Every agent's command, and which thrusts were limited."""
        ...


Saturated = tuple[Bool[Array, "agents"], ...]


@pytree
class Forces:
    """What an allocator asks of the contacts, world."""

    lam: Float[Array, "contacts 3"]  # N, on the payload
    lam_dot: Float[Array, "contacts 3"]  # N/s
    eta: Float[Array, " eta"]  # N, internal-force input, for the log


@pytree
class Telemetry:
    """What one tick decided, for the log."""

    q_hat: Estimate
    d: base.Setpoint
    W_d: Wrench
    lam_cmd: Float[Array, "contacts 3"]
    f_hat: Residual
    eta: Float[Array, " eta"]
    saturated: Saturated
    news: residual_correction.News | None = None
