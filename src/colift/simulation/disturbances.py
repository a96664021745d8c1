"""The truth's unknown forces: named sources, each a force or torque at a point of a body.

A law says what force and torque act on a body that moves in a certain way at a certain time; a `Mount` says where. The
point's Jacobian maps them to `(f_x, f_w, f_r)` of an agent or to the payload's wrench. Only the plant uses this module.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import apply, mul, transpose
from colift.math.pytree import pytree, static
from colift.models import aerial_manipulator
from colift.models.parameters import Agent, Team
from colift.models.state import AgentForce, AgentState, PayloadState, Residual, State, Wrench

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class Motion:
    """How the point of attack moves."""

    x: Vector  # m, world
    v: Vector  # m/s, world
    R: Float[Array, "3 3"]  # body to world
    omega: Vector  # rad/s, body frame


class Law:
    """A force (N, world) and a torque (N m, body frame) as a function of a point's motion, time and a memory.

    One of your own is a `pytree` that extends this class. It is time invariant if force and torque depend on the motion
    alone, as Assumption 3 wants; certificates ask (`varying`). A law without a memory leaves `begin` and `after` alone.
    """

    time_invariant: ClassVar[bool]

    def __call__(self, at: Motion, t: Scalar, memory: Any) -> tuple[Vector, Vector]:
        """Force and torque at time t, s."""
        raise NotImplementedError

    def begin(self) -> Any:
        """The memory before the flight, a PyTree; every agent that carries the law has its own."""
        return ()

    def after(self, at: Motion, t: Scalar, memory: Any, dt: Scalar) -> Any:
        """The memory at t + dt, from the motion at t; a step of the plant holds it in between."""
        return memory


@pytree
class Constant(Law):
    """A force fixed in the world and a torque fixed in the body."""

    force: Vector  # N
    torque: Vector  # N m
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion, t: Scalar, memory: Any) -> tuple[Vector, Vector]:
        return self.force, self.torque


@pytree
class Wind(Law):
    """Drag in a steady wind field: `F = -(c_1 + c_2 |w|) w`, `w = v - wind(x)` the velocity through the air.

    `wind(x) = mean + sum_k gust_k sin(wave_k . x + phase_k)`: it varies in space, not in time.
    """

    linear: Scalar  # N s/m
    quadratic: Scalar  # N s^2/m^2
    mean: Vector  # m/s
    gust: Float[Array, "waves 3"]  # m/s
    wave: Float[Array, "waves 3"]  # rad/m
    phase: Float[Array, "waves"]  # rad
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion, t: Scalar, memory: Any) -> tuple[Vector, Vector]:
        sines = jnp.sin((self.wave * at.x[None]).sum(1) + self.phase)
        w = at.v - self.mean - (self.gust * sines[:, None]).sum(0)
        speed = jnp.sqrt((w * w).sum() + 1e-6)  # smooth where the air is at rest
        return -(self.linear + self.quadratic * speed) * w, jnp.zeros(3)


@pytree
class Weather(Law):
    """A wind that turns about the vertical and whose gusts travel: at time t the wind of phases `phase - rate t`.

    Its mean turns by `angle` within `over` from `start` on, smoothly.
    """

    wind: Wind
    rate: Float[Array, "waves"]  # rad/s
    angle: Scalar  # rad
    start: Scalar  # s
    over: Scalar  # s
    time_invariant: ClassVar[bool] = False

    def __call__(self, at: Motion, t: Scalar, memory: Any) -> tuple[Vector, Vector]:
        angle = self.angle * risen((t - self.start) / self.over)
        turned = so3.exp(angle * jnp.array([0.0, 0.0, 1.0]))
        now = dataclasses.replace(self.wind, mean=apply(turned, self.wind.mean), phase=self.wind.phase - self.rate * t)
        return now(at, t, memory)


def risen(s: Scalar) -> Scalar:
    """`s^2 (3 - 2 s)`, from 0 at s = 0 to 1 at s = 1, level before and after."""
    s = jnp.clip(s, 0.0, 1.0)
    return s * s * (3 - 2 * s)


@pytree
class Tether(Law):
    """An elastic line to a fixed point: `F = k (|d| - l) d / |d|`, `d` from the body to the anchor; taut only."""

    anchor: Vector  # m, world
    stiffness: Scalar  # N/m
    length: Scalar  # m, unstretched
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion, t: Scalar, memory: Any) -> tuple[Vector, Vector]:
        d = self.anchor - at.x
        distance = jnp.sqrt((d * d).sum() + 1e-9)
        return self.stiffness * jnp.maximum(distance - self.length, 0.0) / distance * d, jnp.zeros(3)


@pytree
class Jet(Law):
    """A local stream: `F = force exp(-|x - center|^2 / (2 width^2))`."""

    force: Vector  # N at the centre
    center: Vector  # m, world
    width: Scalar  # m
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion, t: Scalar, memory: Any) -> tuple[Vector, Vector]:
        d = (at.x - self.center) / self.width
        return jnp.exp(-(d * d).sum() / 2) * self.force, jnp.zeros(3)


@pytree
class RotorBias(Law):
    """Rotors that do not give what is asked: a thrust along the body's third axis and a torque, both constant."""

    thrust: Scalar  # N
    torque: Vector  # N m, body frame
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion, t: Scalar, memory: Any) -> tuple[Vector, Vector]:
        return self.thrust * at.R[:, 2], self.torque


@pytree
class Mount:
    """A law at a point of the payload."""

    name: str = static(default="")  # of the source, for results
    law: Law
    point: Vector  # m, payload frame


@pytree
class AgentMount:
    """A law at a point of one body of every agent of a group; the group's axis leads all leaves."""

    body: int = static()
    name: str = static(default="")  # of the source, for results
    law: Law
    point: Float[Array, "*agents 3"]  # m, in the body's frame
    active: Float[Array, "*agents"]  # 1 on the agents that carry it, 0 on the others


@pytree
class JointFriction:
    """Friction in every joint of a group: `f_r = -viscous r_dot - coulomb tanh(r_dot / speed)`."""

    viscous: Float[Array, "*agents n_r"]  # N m s/rad or N s/m
    coulomb: Float[Array, "*agents n_r"]  # N m or N
    speed: Float[Array, "*agents n_r"]  # rad/s or m/s, below which it is smoothed


@pytree
class Disturbances:
    """All sources of a scenario."""

    payload: tuple[Mount, ...]
    agents: tuple[tuple[AgentMount, ...], ...]  # by group
    joints: tuple[JointFriction, ...]  # by group
    functions: tuple[Callable[[State], Residual], ...] = ()  # of the state alone, PyTrees as well


@pytree
class Memory:
    """What the laws keep between ticks, by source."""

    payload: tuple[Any, ...]
    agents: tuple[tuple[Any, ...], ...]  # by group, agents lead


def begin(sources: Disturbances, team: Team) -> Memory:
    """The memory of all laws before the flight."""
    return Memory(
        payload=tuple(mount.law.begin() for mount in sources.payload),
        agents=tuple(
            tuple(jax.vmap(lambda law: law.begin(), axis_size=size)(mount.law) for mount in mounts)
            for size, mounts in zip(team.sizes, sources.agents, strict=True)
        ),
    )


def forces(sources: Disturbances, team: Team, z: State, t: Scalar, memory: Memory) -> Residual:
    """The truth's `f_uk`: what the sources do to every agent and to the payload in the state z at time t, s."""
    named = Residual(
        agents=tuple(
            jax.vmap(_on_agent, in_axes=(0, 0, 0, 0, None, 0))(group, state, mounts, friction, t, kept)
            for group, state, mounts, friction, kept in zip(
                team.groups, z.agents, sources.agents, sources.joints, memory.agents, strict=True
            )
        ),
        payload=on_payload(sources.payload, z.payload, t, memory.payload),
    )
    for function in sources.functions:
        named = jax.tree.map(jnp.add, named, function(z))
    return named


def at_start(sources: Disturbances, team: Team, z: State) -> Residual:
    """`forces` at time zero, before any law has a past."""
    return forces(sources, team, z, jnp.zeros(()), begin(sources, team))


def after(sources: Disturbances, team: Team, z: State, t: Scalar, memory: Memory, dt: Scalar) -> Memory:
    """The memory of all laws at t + dt, from the state z at t."""

    def of_agent(agent: Agent, q: AgentState, mounts: tuple[AgentMount, ...], kept: tuple[Any, ...]) -> tuple[Any, ...]:
        carried = _carried(agent, q)
        return tuple(
            mount.law.after(_of_body(agent, q, carried, mount)[0], t, past, dt)
            for mount, past in zip(mounts, kept, strict=True)
        )

    return Memory(
        payload=tuple(
            mount.law.after(_of_payload(mount, z.payload), t, past, dt)
            for mount, past in zip(sources.payload, memory.payload, strict=True)
        ),
        agents=tuple(
            jax.vmap(of_agent)(group, state, mounts, kept) if jax.tree.leaves(kept) else kept
            for group, state, mounts, kept in zip(team.groups, z.agents, sources.agents, memory.agents, strict=True)
        ),
    )


def varying(sources: Disturbances) -> tuple[str, ...]:
    """Names of the active sources that are not time invariant, each once; of one without a name, its law's.

    Friction and functions are time invariant by their equations.
    """
    return tuple(dict.fromkeys(_name(mount) for mount in _active(sources) if not mount.law.time_invariant))


def remembering(sources: Disturbances) -> tuple[str, ...]:
    """Names, as `varying` gives them, of the active sources whose force depends on what was before."""
    return tuple(dict.fromkeys(_name(mount) for mount in _active(sources) if jax.tree.leaves(mount.law.begin())))


def _active(sources: Disturbances) -> Iterator[Mount | AgentMount]:
    yield from sources.payload
    yield from (mount for mounts in sources.agents for mount in mounts if np.any(mount.active))


def _name(mount: Mount | AgentMount) -> str:
    return mount.name or type(mount.law).__name__


def on_payload(mounts: tuple[Mount, ...], q: PayloadState, t: Scalar, memory: tuple[Any, ...]) -> Wrench:
    """The sum of the payload's sources: `F = sum F_i`, `tau = sum c_i x R^T F_i + T_i`."""
    F, tau = jnp.zeros(3), jnp.zeros(3)
    for mount, kept in zip(mounts, memory, strict=True):
        force, torque = mount.law(_of_payload(mount, q), t, kept)
        F, tau = F + force, tau + so3.cross(mount.point, apply(transpose(q.R), force)) + torque
    return Wrench(F=F, tau=tau)


def _of_payload(mount: Mount, q: PayloadState) -> Motion:
    v = q.v + apply(q.R, so3.cross(q.omega, mount.point))
    return Motion(x=q.p + apply(q.R, mount.point), v=v, R=q.R, omega=q.omega)


Carried = tuple[aerial_manipulator.Geometry, aerial_manipulator.Reduced, Float[Array, "xi"]]


def _carried(agent: Agent, q: AgentState) -> Carried:
    g = aerial_manipulator.geometry(agent, q.r)
    return g, aerial_manipulator.reduce(agent, g), jnp.concatenate([q.omega, q.r_dot])


def _of_body(agent: Agent, q: AgentState, carried: Carried, mount: AgentMount) -> tuple[Motion, Float[Array, "3 xi"]]:
    """How the point of a mount moves, and its Jacobian B."""
    (g, p, xi), i = carried, mount.body
    lever = apply(g.rotation[i], mount.point - agent.com[i])
    B = p.com[i] - mul(so3.hat(lever), p.spin[i])
    rho = g.point[i] + lever - p.s
    return Motion(
        x=q.x + apply(q.R, rho),
        v=q.v + apply(q.R, apply(B, xi)),
        R=mul(q.R, g.rotation[i]),
        omega=apply(transpose(g.rotation[i]), apply(p.spin[i], xi)),
    ), B


def _on_agent(
    agent: Agent,
    q: AgentState,
    mounts: tuple[AgentMount, ...],
    friction: JointFriction,
    t: Scalar,
    memory: tuple[Any, ...],
) -> AgentForce:
    carried = g, p, xi = _carried(agent, q)
    f_x, Q = jnp.zeros(3), jnp.zeros_like(xi)
    for mount, kept in zip(mounts, memory, strict=True):
        at, B = _of_body(agent, q, carried, mount)
        force, torque = mount.law(at, t, kept)
        f_x = f_x + mount.active * force
        by_force = apply(transpose(B), apply(transpose(q.R), force))
        by_torque = apply(transpose(p.spin[mount.body]), apply(g.rotation[mount.body], torque))
        Q = Q + mount.active * (by_force + by_torque)
    rubbing = -friction.viscous * q.r_dot - friction.coulomb * jnp.tanh(q.r_dot / friction.speed)
    return AgentForce(f_x=f_x, f_w=Q[:3], f_r=Q[3:] + rubbing)
