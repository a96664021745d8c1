"""What sensors say: all that what flies ever sees of the truth."""

from __future__ import annotations

import dataclasses
from typing import Any

from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.state import ResidualForces, State


@pytree
class AgentReading:
    """One agent's sensors: pose and twist of the base, accelerometer at its origin, encoders, tip forces."""

    R: Float[Array, "*agents 3 3"]  # base attitude
    x: Float[Array, "*agents 3"]  # m, base origin, world
    v: Float[Array, "*agents 3"]  # m/s, base origin, world
    omega: Float[Array, "*agents 3"]  # rad/s, base frame
    a: Float[Array, "*agents 3"]  # m/s^2, specific force at the base origin, base frame
    r: Float[Array, "*agents n_r"]  # rad or m
    lam: Float[Array, "*agents arms 3"]  # N, force on the payload, in the tip body's frame


@pytree
class PayloadReading:
    """The payload's sensors: pose, twist, accelerometer at the centre of mass."""

    R: Float[Array, "3 3"]
    p: Float[Array, "3"]  # m
    v: Float[Array, "3"]  # m/s
    omega: Float[Array, "3"]  # rad/s, payload frame
    a: Float[Array, "3"]  # m/s^2, specific force, payload frame


@pytree
class RigReading:
    """What a calibration rig reports: the state it holds the team in, and the residual there with bounded noise.

    No flying team has one. It is for studies whose labels must obey a stated bound.
    """

    z: State
    f: ResidualForces


@pytree
class Measurement:
    """Everything the flying software sees in one tick; what a world has no sensor for is None, and not there."""

    agents: tuple[AgentReading, ...]
    payload: PayloadReading
    rig: RigReading | None = None
    age_s: dict[str, Float[Array, ""]] = dataclasses.field(default_factory=dict)  # of readings that are held, by name
    extra: dict[str, Any] = dataclasses.field(default_factory=dict)  # what sensors of your own say, by name
