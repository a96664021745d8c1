"""The truth's unknown forces: named sources, each a force or torque at a point of a body.

A law says what force and torque act on a body that moves in a certain way; a `Mount` says where. The point's
Jacobian maps them to `(f_x, f_w, f_r)` of an agent or to the payload's wrench. Only the plant uses this module.
"""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift import agent as ag
from colift import estimate, learn, so3
from colift.model import Agent, AgentForce, AgentState, PayloadState, Residual, State, Team, Wrench
from colift.pytree import pytree, static

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class Motion:
    """How the point of attack moves."""

    x: Vector  # m, world
    v: Vector  # m/s, world
    R: Float[Array, "3 3"]  # body to world
    omega: Vector  # rad/s, body frame


@runtime_checkable
class Law(Protocol):
    """A force (N, world) and a torque (N m, body frame) as a function of a point's motion.

    A law is time invariant if they depend on the motion alone, as Assumption 3 wants; certificates ask (`varying`).
    """

    time_invariant: ClassVar[bool]

    def __call__(self, at: Motion) -> tuple[Vector, Vector]: ...


@pytree
class Constant:
    """A force fixed in the world and a torque fixed in the body."""

    force: Vector  # N
    torque: Vector  # N m
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion) -> tuple[Vector, Vector]:  # noqa: ARG002  a law like the others
        return self.force, self.torque


@pytree
class Wind:
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

    def __call__(self, at: Motion) -> tuple[Vector, Vector]:
        sines = jnp.sin((self.wave * at.x[None]).sum(1) + self.phase)
        w = at.v - self.mean - (self.gust * sines[:, None]).sum(0)
        speed = jnp.sqrt((w * w).sum() + 1e-6)  # smooth where the air is at rest
        return -(self.linear + self.quadratic * speed) * w, jnp.zeros(3)


@pytree
class Tether:
    """An elastic line to a fixed point: `F = k (|d| - l) d / |d|`, `d` from the body to the anchor; taut only."""

    anchor: Vector  # m, world
    stiffness: Scalar  # N/m
    length: Scalar  # m, unstretched
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion) -> tuple[Vector, Vector]:
        d = self.anchor - at.x
        distance = jnp.sqrt((d * d).sum() + 1e-9)
        return self.stiffness * jnp.maximum(distance - self.length, 0.0) / distance * d, jnp.zeros(3)


@pytree
class Jet:
    """A local stream: `F = force exp(-|x - center|^2 / (2 width^2))`."""

    force: Vector  # N at the centre
    center: Vector  # m, world
    width: Scalar  # m
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion) -> tuple[Vector, Vector]:
        d = (at.x - self.center) / self.width
        return jnp.exp(-(d * d).sum() / 2) * self.force, jnp.zeros(3)


@pytree
class RotorBias:
    """Rotors that do not give what is asked: a thrust along the body's third axis and a torque, both constant."""

    thrust: Scalar  # N
    torque: Vector  # N m, body frame
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: Motion) -> tuple[Vector, Vector]:
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
    functions: tuple[learn.Oracle, ...] = ()  # residuals that are posterior means, hence of known norm in their RKHS


def residual(sources: Disturbances, team: Team, z: State) -> Residual:
    """The truth's `f_uk`: what the sources do to every agent and to the payload in the state z."""
    named = Residual(
        agents=tuple(
            jax.vmap(_on_agent)(group, state, mounts, friction)
            for group, state, mounts, friction in zip(
                team.groups, z.agents, sources.agents, sources.joints, strict=True
            )
        ),
        payload=on_payload(sources.payload, z.payload),
    )
    for function in sources.functions:
        named = jax.tree.map(jnp.add, named, _mean(function, z))
    return named


def _mean(function: learn.Oracle, z: State) -> Residual:
    """What an oracle would predict at the true state."""
    inputs = tuple(jax.vmap(estimate.flat_agent)(q) for q in z.agents)
    return Residual(
        agents=learn.agents_mean(function, inputs),
        payload=learn.payload_mean(function, estimate.flat_payload(z.payload, jnp.zeros(6))),
    )


def varying(sources: Disturbances) -> tuple[str, ...]:
    """Names of the active sources that are not time invariant, each once; of one without a name, its law's.

    Friction and functions are time invariant by their equations.
    """
    carried = (mount for mounts in sources.agents for mount in mounts if np.any(mount.active))
    mounts = [mount for mount in (*sources.payload, *carried) if not mount.law.time_invariant]
    return tuple(dict.fromkeys(mount.name or type(mount.law).__name__ for mount in mounts))


def on_payload(mounts: tuple[Mount, ...], q: PayloadState) -> Wrench:
    """The sum of the payload's sources: `F = sum F_i`, `tau = sum c_i x R^T F_i + T_i`."""
    F, tau = jnp.zeros(3), jnp.zeros(3)
    for mount in mounts:
        v = q.v + q.R @ so3.cross(q.omega, mount.point)
        force, torque = mount.law(Motion(x=q.p + q.R @ mount.point, v=v, R=q.R, omega=q.omega))
        F, tau = F + force, tau + so3.cross(mount.point, q.R.T @ force) + torque
    return Wrench(F=F, tau=tau)


def _on_agent(agent: Agent, q: AgentState, mounts: tuple[AgentMount, ...], friction: JointFriction) -> AgentForce:
    g = ag.geometry(agent, q.r)
    p = ag.reduce(agent, g)
    xi = jnp.concatenate([q.omega, q.r_dot])
    f_x, Q = jnp.zeros(3), jnp.zeros_like(xi)
    for mount in mounts:
        i = mount.body
        lever = g.rotation[i] @ (mount.point - agent.com[i])
        B = p.com[i] - so3.hat(lever) @ p.spin[i]
        rho = g.point[i] + lever - p.s
        at = Motion(
            x=q.x + q.R @ rho,
            v=q.v + q.R @ (B @ xi),
            R=q.R @ g.rotation[i],
            omega=g.rotation[i].T @ (p.spin[i] @ xi),
        )
        force, torque = mount.law(at)
        f_x = f_x + mount.active * force
        Q = Q + mount.active * (B.T @ (q.R.T @ force) + p.spin[i].T @ (g.rotation[i] @ torque))
    rubbing = -friction.viscous * q.r_dot - friction.coulomb * jnp.tanh(q.r_dot / friction.speed)
    return AgentForce(f_x=f_x, f_w=Q[:3], f_r=Q[3:] + rubbing)
