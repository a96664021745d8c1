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
from colift.math.linalg import matmul, matvec, transpose
from colift.math.pytree import pytree, static
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentState, GeneralizedForce, PayloadState, ResidualForces, State, Wrench

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class PointKinematics:
    """How the point of attack moves."""

    x: Vector  # m, world
    v: Vector  # m/s, world
    R: Float[Array, "3 3"]  # body to world
    omega: Vector  # rad/s, body frame


class DisturbanceModel:
    """A force (N, world) and a torque (N m, body frame) as a function of a point's motion, time and a memory.

    One of your own is a `pytree` that extends this class. It is time invariant if force and torque depend on the motion
    alone, as Assumption 3 wants; certificates ask (`varying`). A law without a memory leaves `begin` and `after` alone.
    """

    time_invariant: ClassVar[bool]

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Force and torque at time t, s."""
        raise NotImplementedError

    def init(self) -> Any:
        """The memory before the flight, a PyTree; every agent that carries the law has its own."""
        return ()

    def update(self, at: PointKinematics, t: Scalar, state: Any, dt: Scalar) -> Any:
        """The memory at t + dt, from the motion at t; a step of the plant holds it in between."""
        return state


@pytree
class ConstantWrench(DisturbanceModel):
    """A force fixed in the world and a torque fixed in the body."""

    force: Vector  # N
    torque: Vector  # N m
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        return self.force, self.torque


@pytree
class Wind(DisturbanceModel):
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

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        sines = jnp.sin((self.wave * at.x[None]).sum(1) + self.phase)
        w = at.v - self.mean - (self.gust * sines[:, None]).sum(0)
        speed = jnp.sqrt((w * w).sum() + 1e-6)  # smooth where the air is at rest
        return -(self.linear + self.quadratic * speed) * w, jnp.zeros(3)


@pytree
class TimeVaryingWind(DisturbanceModel):
    """A wind that turns about the vertical and whose gusts travel: at time t the wind of phases `phase - rate t`.

    Its mean turns by `angle` within `over` from `start` on, smoothly.
    """

    base_wind: Wind
    phase_rate: Float[Array, "waves"]  # rad/s
    turn_angle: Scalar  # rad
    start: Scalar  # s
    ramp_time: Scalar  # s
    time_invariant: ClassVar[bool] = False

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        angle = self.turn_angle * smoothstep((t - self.start) / self.ramp_time)
        turned = so3.exp(angle * jnp.array([0.0, 0.0, 1.0]))
        context = dataclasses.replace(
            self.base_wind, mean=matvec(turned, self.base_wind.mean), phase=self.base_wind.phase - self.phase_rate * t
        )
        return context(at, t, state)


def smoothstep(s: Scalar) -> Scalar:
    """`s^2 (3 - 2 s)`, from 0 at s = 0 to 1 at s = 1, level before and after."""
    s = jnp.clip(s, 0.0, 1.0)
    return s * s * (3 - 2 * s)


@pytree
class Tether(DisturbanceModel):
    """An elastic line to a fixed point: `F = k (|d| - l) d / |d|`, `d` from the body to the anchor; taut only."""

    anchor: Vector  # m, world
    stiffness: Scalar  # N/m
    length: Scalar  # m, unstretched
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        d = self.anchor - at.x
        distance = jnp.sqrt((d * d).sum() + 1e-9)
        return self.stiffness * jnp.maximum(distance - self.length, 0.0) / distance * d, jnp.zeros(3)


@pytree
class GaussianJet(DisturbanceModel):
    """A local stream: `F = force exp(-|x - center|^2 / (2 width^2))`."""

    force: Vector  # N at the centre
    center: Vector  # m, world
    width: Scalar  # m
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        d = (at.x - self.center) / self.width
        return jnp.exp(-(d * d).sum() / 2) * self.force, jnp.zeros(3)


@pytree
class RotorBias(DisturbanceModel):
    """Rotors that do not give what is asked: a thrust along the body's third axis and a torque, both constant."""

    thrust: Scalar  # N
    torque: Vector  # N m, body frame
    time_invariant: ClassVar[bool] = True

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        return self.thrust * at.R[:, 2], self.torque


@pytree
class PayloadDisturbance:
    """A law at a point of the payload."""

    name: str = static(default="")  # of the source, for results
    model: DisturbanceModel
    point: Vector  # m, payload frame


@pytree
class AgentDisturbance:
    """A law at a point of one body of every agent of a group; the group's axis leads all leaves."""

    body: int = static()
    name: str = static(default="")  # of the source, for results
    model: DisturbanceModel
    point: Float[Array, "*agents 3"]  # m, in the body's frame
    active: Float[Array, "*agents"]  # 1 on the agents that carry it, 0 on the others


@pytree
class JointFriction:
    """Friction in every joint of a group: `f_r = -viscous r_dot - coulomb tanh(r_dot / speed)`."""

    viscous: Float[Array, "*agents n_r"]  # N m s/rad or N s/m
    coulomb: Float[Array, "*agents n_r"]  # N m or N
    speed: Float[Array, "*agents n_r"]  # rad/s or m/s, below which it is smoothed


@pytree
class DisturbanceSet:
    """All sources of a scenario."""

    payload: tuple[PayloadDisturbance, ...]
    agents: tuple[tuple[AgentDisturbance, ...], ...]  # by group
    joints: tuple[JointFriction, ...]  # by group
    state_functions: tuple[Callable[[State], ResidualForces], ...] = ()  # of the state alone, PyTrees as well


@pytree
class DisturbanceState:
    """What the laws keep between ticks, by source."""

    payload: tuple[Any, ...]
    agents: tuple[tuple[Any, ...], ...]  # by group, agents lead


def init(sources: DisturbanceSet, team: Team) -> DisturbanceState:
    """The memory of all laws before the flight."""
    return DisturbanceState(
        payload=tuple(mount.model.init() for mount in sources.payload),
        agents=tuple(
            tuple(jax.vmap(lambda law: law.init(), axis_size=size)(mount.model) for mount in mounts)
            for size, mounts in zip(team.sizes, sources.agents, strict=True)
        ),
    )


def disturbance_forces(
    sources: DisturbanceSet, team: Team, team_state: State, t: Scalar, disturbance_state: DisturbanceState
) -> ResidualForces:
    """The truth's `f_uk`: what the sources do to every agent and to the payload in the state z at time t, s."""
    named = ResidualForces(
        agents=tuple(
            jax.vmap(_on_agent, in_axes=(0, 0, 0, 0, None, 0))(group, state, mounts, friction, t, kept)
            for group, state, mounts, friction, kept in zip(
                team.agent_groups,
                team_state.agents,
                sources.agents,
                sources.joints,
                disturbance_state.agents,
                strict=True,
            )
        ),
        payload=payload_wrench(sources.payload, team_state.payload, t, disturbance_state.payload),
    )
    for function in sources.state_functions:
        named = jax.tree.map(jnp.add, named, function(team_state))
    return named


def initial_forces(sources: DisturbanceSet, team: Team, state: State) -> ResidualForces:
    """`forces` at time zero, before any law has a past."""
    return disturbance_forces(sources, team, state, jnp.zeros(()), init(sources, team))


def update(
    sources: DisturbanceSet, team: Team, team_state: State, t: Scalar, disturbance_state: DisturbanceState, dt: Scalar
) -> DisturbanceState:
    """The memory of all laws at t + dt, from the state z at t."""

    def of_agent(
        agent: AerialManipulator, q: AgentState, mounts: tuple[AgentDisturbance, ...], kept: tuple[Any, ...]
    ) -> tuple[Any, ...]:
        carried = _carried(agent, q)
        return tuple(
            mount.model.update(_of_body(agent, q, carried, mount)[0], t, past, dt)
            for mount, past in zip(mounts, kept, strict=True)
        )

    return DisturbanceState(
        payload=tuple(
            mount.model.update(_of_payload(mount, team_state.payload), t, past, dt)
            for mount, past in zip(sources.payload, disturbance_state.payload, strict=True)
        ),
        agents=tuple(
            jax.vmap(of_agent)(group, state, mounts, kept) if jax.tree.leaves(kept) else kept
            for group, state, mounts, kept in zip(
                team.agent_groups, team_state.agents, sources.agents, disturbance_state.agents, strict=True
            )
        ),
    )


def time_varying_names(sources: DisturbanceSet) -> tuple[str, ...]:
    """Names of the active sources that are not time invariant, each once; of one without a name, its law's.

    Friction and functions are time invariant by their equations.
    """
    return tuple(dict.fromkeys(_name(mount) for mount in _active(sources) if not mount.model.time_invariant))


def stateful_names(sources: DisturbanceSet) -> tuple[str, ...]:
    """Names, as `varying` gives them, of the active sources whose force depends on what was before."""
    return tuple(dict.fromkeys(_name(mount) for mount in _active(sources) if jax.tree.leaves(mount.model.init())))


def _active(sources: DisturbanceSet) -> Iterator[PayloadDisturbance | AgentDisturbance]:
    yield from sources.payload
    yield from (mount for mounts in sources.agents for mount in mounts if np.any(mount.active))


def _name(mount: PayloadDisturbance | AgentDisturbance) -> str:
    return mount.name or type(mount.model).__name__


def payload_wrench(
    mounts: tuple[PayloadDisturbance, ...], q: PayloadState, t: Scalar, state: tuple[Any, ...]
) -> Wrench:
    """The sum of the payload's sources: `F = sum F_i`, `tau = sum c_i x R^T F_i + T_i`."""
    F, tau = jnp.zeros(3), jnp.zeros(3)
    for mount, kept in zip(mounts, state, strict=True):
        force, torque = mount.model(_of_payload(mount, q), t, kept)
        F, tau = F + force, tau + so3.cross(mount.point, matvec(transpose(q.R), force)) + torque
    return Wrench(F=F, tau=tau)


def _of_payload(mount: PayloadDisturbance, q: PayloadState) -> PointKinematics:
    v = q.v + matvec(q.R, so3.cross(q.omega, mount.point))
    return PointKinematics(x=q.p + matvec(q.R, mount.point), v=v, R=q.R, omega=q.omega)


MountedModel = tuple[aerial_manipulator.ForwardKinematics, aerial_manipulator.CentroidalModel, Float[Array, "xi"]]


def _carried(agent: AerialManipulator, q: AgentState) -> MountedModel:
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    return g, aerial_manipulator.centroidal_model(agent, g), jnp.concatenate([q.omega, q.r_dot])


def _of_body(
    agent: AerialManipulator, q: AgentState, carried: MountedModel, mount: AgentDisturbance
) -> tuple[PointKinematics, Float[Array, "3 xi"]]:
    """How the point of a mount moves, and its Jacobian B."""
    (g, p, xi), i = carried, mount.body
    lever = matvec(g.rotation[i], mount.point - agent.com[i])
    B = p.J_com[i] - matmul(so3.hat(lever), p.J_angular[i])
    rho = g.joint_origin[i] + lever - p.com_from_base
    return PointKinematics(
        x=q.x + matvec(q.R, rho),
        v=q.v + matvec(q.R, matvec(B, xi)),
        R=matmul(q.R, g.rotation[i]),
        omega=matvec(transpose(g.rotation[i]), matvec(p.J_angular[i], xi)),
    ), B


def _on_agent(
    agent: AerialManipulator,
    q: AgentState,
    mounts: tuple[AgentDisturbance, ...],
    friction: JointFriction,
    t: Scalar,
    state: tuple[Any, ...],
) -> GeneralizedForce:
    carried = g, p, xi = _carried(agent, q)
    f_x, Q = jnp.zeros(3), jnp.zeros_like(xi)
    for mount, kept in zip(mounts, state, strict=True):
        at, B = _of_body(agent, q, carried, mount)
        force, torque = mount.model(at, t, kept)
        f_x = f_x + mount.active * force
        by_force = matvec(transpose(B), matvec(transpose(q.R), force))
        by_torque = matvec(transpose(p.J_angular[mount.body]), matvec(g.rotation[mount.body], torque))
        Q = Q + mount.active * (by_force + by_torque)
    rubbing = -friction.viscous * q.r_dot - friction.coulomb * jnp.tanh(q.r_dot / friction.speed)
    return GeneralizedForce(f_x=f_x, f_w=Q[:3], f_r=Q[3:] + rubbing)
