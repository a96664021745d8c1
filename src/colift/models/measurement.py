"""Sensor readings, the only information about the plant that the controller receives."""

from __future__ import annotations

import dataclasses

from jaxtyping import Array, Bool, Float, PyTree

from colift.math.pytree import pytree
from colift.models.state import ResidualForces, State

ContactFlags = tuple[Bool[Array, "_agents _arms"], ...]
"""A property of each contact, by group."""


@pytree
class AgentReading:
    """Readings of an agent: pose and twist of the base, accelerometer at its origin, encoders, tip force sensors."""

    R: Float[Array, "*agents 3 3"]  # base attitude, body to world
    x: Float[Array, "*agents 3"]  # m, base origin, world
    v: Float[Array, "*agents 3"]  # m/s, base origin, world
    omega: Float[Array, "*agents 3"]  # rad/s, base frame
    a: Float[Array, "*agents 3"]  # m/s^2, specific force at the base origin, base frame
    r: Float[Array, "*agents n_r"]  # rad or m, joint positions
    lam: Float[Array, "*agents arms 3"]  # N, force on the payload, frame of the tip body
    moment: Float[Array, "*agents arms 3"] | None = None  # N m, moment on the payload, likewise; None for points


@pytree
class PayloadReading:
    """Readings of the payload: pose, twist, accelerometer at the center of mass."""

    R: Float[Array, "3 3"]  # payload attitude, payload frame to world
    p: Float[Array, "3"]  # m, center of mass, world
    v: Float[Array, "3"]  # m/s, world
    omega: Float[Array, "3"]  # rad/s, payload frame
    a: Float[Array, "3"]  # m/s^2, specific force, payload frame


@pytree
class RigReading:
    """Readings of a calibration rig: a prescribed state and its residual with bounded noise.

    A rig exists in studies only, to obtain labels with a stated error bound.

    Attributes:
        state: State of the team that the rig prescribes.
        residual: Residual forces in this state, with the label error.
    """

    state: State
    residual: ResidualForces


@pytree
class Measurement:
    """Readings of all sensors in one control period.

    Attributes:
        agents: Readings of the agents, by group.
        payload: Readings of the payload.
        rig: Readings of a calibration rig; None without one.
        measurement_age_s: Age of each reading that is held between samples [s], by name.
        extra: Readings of user-defined sensors, by name; each is a PyTree of arrays.
        link_delay_s: Delay of the leader's message that arrives at each agent in this period [s]; negative if none
            arrives. None if every message arrives in the period in which it is sent.
        regrasped: True for contacts whose gripper reports that it has closed again, by group. None if no contact can.
        ungrasped: True for contacts whose gripper has not closed since the start, by group. None if all were closed at
            the start.
    """

    agents: tuple[AgentReading, ...]
    payload: PayloadReading
    rig: RigReading | None = None
    measurement_age_s: dict[str, Float[Array, ""]] = dataclasses.field(default_factory=dict)
    extra: dict[str, PyTree] = dataclasses.field(default_factory=dict)
    link_delay_s: Float[Array, "team"] | None = None
    regrasped: ContactFlags | None = None
    ungrasped: ContactFlags | None = None
