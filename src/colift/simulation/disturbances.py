"""Disturbances of the simulated plant: forces and torques at points of the payload and of the agents.

A `DisturbanceModel` defines force and torque as a function of a point's motion and of time. `PayloadDisturbance` and
`AgentDisturbance` attach a model to a body. The Jacobian of the point maps force and torque to `(f_x, f_w, f_r)` of an
agent or to the payload wrench. Onboard code does not import this module.
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
    """Motion of the point at which a disturbance acts."""

    x: Vector  # m, world
    v: Vector  # m/s, world
    R: Float[Array, "3 3"]  # body to world
    omega: Vector  # rad/s, body frame


class DisturbanceModel:
    """Base class of disturbances: force and torque as a function of a point's motion, time and a state.

    A custom model is a `pytree` that extends this class. A model without a state overrides `__call__` alone.
    `time_invariant` is true if force and torque depend on the motion alone, as Assumption 3 requires. Certificates
    check it.

    Attributes:
        time_invariant: Whether force and torque are functions of the motion alone.

    Example:
        ::

            @pytree
            class LinearDrag(DisturbanceModel):
                coefficient: Float[Array, ""]  # N s/m
                time_invariant: ClassVar[bool] = True

                def __call__(self, at, t, state):
                    return -self.coefficient * at.v, jnp.zeros(3)
    """

    time_invariant: ClassVar[bool]

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Compute force and torque.

        Args:
            at: Motion of the point.
            t: Time [s].
            state: State of the model, as `init` and `update` return it.

        Returns:
            Force [N, world] and torque [N m, body frame].

        Raises:
            NotImplementedError: In the base class.
        """
        raise NotImplementedError

    def init(self) -> Any:
        """Return the initial state, a PyTree; every agent with this disturbance has a separate one."""
        return ()

    def update(self, at: PointKinematics, t: Scalar, state: Any, dt: Scalar) -> Any:
        """Advance the state by one step; it is constant during a plant step.

        Args:
            at: Motion of the point at time t.
            t: Time [s].
            state: State at time t.
            dt: Step length [s].

        Returns:
            The state at time t + dt.
        """
        return state


@pytree
class ConstantWrench(DisturbanceModel):
    """Constant force in the world frame and constant torque in the body frame."""

    force: Vector  # N
    torque: Vector  # N m
    time_invariant: ClassVar[bool] = True  # see `DisturbanceModel`

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Return the constant force and torque."""
        return self.force, self.torque


@pytree
class Wind(DisturbanceModel):
    """Drag in a steady wind field: `F = -(c_1 + c_2 |w|) w`, with the air-relative velocity `w = v - wind(x)`.

    The field `wind(x) = mean + sum_k gust_k sin(wave_k . x + phase_k)` varies in space and is constant in time.
    """

    linear: Scalar  # N s/m
    quadratic: Scalar  # N s^2/m^2
    mean: Vector  # m/s
    gust: Float[Array, "waves 3"]  # m/s
    wave: Float[Array, "waves 3"]  # rad/m
    phase: Float[Array, "waves"]  # rad
    time_invariant: ClassVar[bool] = True  # see `DisturbanceModel`

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Return the drag force; the torque is zero."""
        sines = jnp.sin((self.wave * at.x[None]).sum(1) + self.phase)
        w = at.v - self.mean - (self.gust * sines[:, None]).sum(0)
        speed = jnp.sqrt((w * w).sum() + 1e-6)  # differentiable at w = 0
        return -(self.linear + self.quadratic * speed) * w, jnp.zeros(3)


@pytree
class TimeVaryingWind(DisturbanceModel):
    """Wind with travelling gusts and a change of direction about the vertical.

    At time t the gust phases are `phase - rate t`. The mean rotates smoothly by `turn_angle` within `ramp_time` after
    `start`.
    """

    base_wind: Wind  # wind at time zero
    phase_rate: Float[Array, "waves"]  # rad/s
    turn_angle: Scalar  # rad
    start: Scalar  # s
    ramp_time: Scalar  # s
    time_invariant: ClassVar[bool] = False  # see `DisturbanceModel`

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Return the drag force in the wind at time t; the torque is zero."""
        angle = self.turn_angle * smoothstep((t - self.start) / self.ramp_time)
        rotation = so3.exp(angle * jnp.array([0.0, 0.0, 1.0]))
        wind = dataclasses.replace(
            self.base_wind, mean=matvec(rotation, self.base_wind.mean), phase=self.base_wind.phase - self.phase_rate * t
        )
        return wind(at, t, state)


def smoothstep(s: Scalar) -> Scalar:
    """Compute `s^2 (3 - 2 s)` for s in [0, 1]; 0 below and 1 above."""
    s = jnp.clip(s, 0.0, 1.0)
    return s * s * (3 - 2 * s)


@pytree
class Tether(DisturbanceModel):
    """Elastic line to a fixed anchor: `F = k (|d| - l) d / |d|` if `|d| > l`, otherwise zero.

    The vector d points from the body to the anchor.
    """

    anchor: Vector  # m, world
    stiffness: Scalar  # N/m
    length: Scalar  # m, rest length
    time_invariant: ClassVar[bool] = True  # see `DisturbanceModel`

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Return the tension force; the torque is zero."""
        d = self.anchor - at.x
        distance = jnp.sqrt((d * d).sum() + 1e-9)
        return self.stiffness * jnp.maximum(distance - self.length, 0.0) / distance * d, jnp.zeros(3)


@pytree
class GaussianJet(DisturbanceModel):
    """Local air jet with a Gaussian force profile: `F = force exp(-|x - center|^2 / (2 width^2))`."""

    force: Vector  # N at the center
    center: Vector  # m, world
    width: Scalar  # m, standard deviation of the profile
    time_invariant: ClassVar[bool] = True  # see `DisturbanceModel`

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Return the jet force; the torque is zero."""
        d = (at.x - self.center) / self.width
        return jnp.exp(-(d * d).sum() / 2) * self.force, jnp.zeros(3)


@pytree
class RotorBias(DisturbanceModel):
    """Constant thrust error along the body z axis and constant torque error."""

    thrust: Scalar  # N
    torque: Vector  # N m, body frame
    time_invariant: ClassVar[bool] = True  # see `DisturbanceModel`

    def __call__(self, at: PointKinematics, t: Scalar, state: Any) -> tuple[Vector, Vector]:
        """Return the force along the body z axis and the torque."""
        return self.thrust * at.R[:, 2], self.torque


@pytree
class PayloadDisturbance:
    """Disturbance at a point of the payload."""

    name: str = static(default="")  # name of the source in results
    model: DisturbanceModel  # force and torque at the point
    point: Vector  # m, payload frame


@pytree
class AgentDisturbance:
    """Disturbance at a point of one body of every agent of a group; the agents lead the axes of all leaves."""

    body: int = static()  # index of the body in the agent's tree
    name: str = static(default="")  # name of the source in results
    model: DisturbanceModel  # force and torque at the point
    point: Float[Array, "*agents 3"]  # m, body frame
    active: Float[Array, "*agents"]  # 1 for agents with this disturbance, 0 for the others


@pytree
class JointFriction:
    """Joint friction of a group: `f_r = -viscous r_dot - coulomb tanh(r_dot / speed)`."""

    viscous: Float[Array, "*agents n_r"]  # N m s/rad or N s/m
    coulomb: Float[Array, "*agents n_r"]  # N m or N
    speed: Float[Array, "*agents n_r"]  # rad/s or m/s, smoothing speed of the Coulomb friction


@pytree
class DisturbanceSet:
    """All disturbances of a scenario."""

    payload: tuple[PayloadDisturbance, ...]  # disturbances of the payload
    agents: tuple[tuple[AgentDisturbance, ...], ...]  # one tuple per group
    joints: tuple[JointFriction, ...]  # one per group
    state_functions: tuple[Callable[[State], ResidualForces], ...] = ()  # functions of the state; each is a PyTree


@pytree
class DisturbanceState:
    """States of all disturbance models between ticks."""

    payload: tuple[Any, ...]  # one state per payload disturbance
    agents: tuple[tuple[Any, ...], ...]  # one tuple per group, agents lead


def init(sources: DisturbanceSet, team: Team) -> DisturbanceState:
    """Return the initial states of all disturbance models."""
    return DisturbanceState(
        payload=tuple(disturbance.model.init() for disturbance in sources.payload),
        agents=tuple(
            tuple(
                jax.vmap(lambda model: model.init(), axis_size=size)(disturbance.model)
                for disturbance in group_disturbances
            )
            for size, group_disturbances in zip(team.sizes, sources.agents, strict=True)
        ),
    )


def disturbance_forces(
    sources: DisturbanceSet, team: Team, team_state: State, t: Scalar, disturbance_state: DisturbanceState
) -> ResidualForces:
    """Compute the true unmodelled forces `f_uk` of all disturbances.

    Args:
        sources: Disturbances of the scenario.
        team: True parameters.
        team_state: State of the team.
        t: Time [s].
        disturbance_state: States of the disturbance models.

    Returns:
        Generalized forces on every agent and the payload wrench.
    """
    total = ResidualForces(
        agents=tuple(
            jax.vmap(_agent_forces, in_axes=(0, 0, 0, 0, None, 0))(
                group, state, group_disturbances, friction, t, states
            )
            for group, state, group_disturbances, friction, states in zip(
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
        total = jax.tree.map(jnp.add, total, function(team_state))
    return total


def initial_forces(sources: DisturbanceSet, team: Team, state: State) -> ResidualForces:
    """Compute the disturbance forces at time zero with the initial model states."""
    return disturbance_forces(sources, team, state, jnp.zeros(()), init(sources, team))


def update(
    sources: DisturbanceSet, team: Team, team_state: State, t: Scalar, disturbance_state: DisturbanceState, dt: Scalar
) -> DisturbanceState:
    """Advance the states of all disturbance models by one step.

    Args:
        sources: Disturbances of the scenario.
        team: True parameters.
        team_state: State of the team at time t.
        t: Time [s].
        disturbance_state: States of the models at time t.
        dt: Step length [s].

    Returns:
        The states at time t + dt.
    """

    def update_agent(
        agent: AerialManipulator,
        q: AgentState,
        group_disturbances: tuple[AgentDisturbance, ...],
        states: tuple[Any, ...],
    ) -> tuple[Any, ...]:
        kinematics = _kinematics(agent, q)
        return tuple(
            disturbance.model.update(_body_point(agent, q, kinematics, disturbance)[0], t, old, dt)
            for disturbance, old in zip(group_disturbances, states, strict=True)
        )

    return DisturbanceState(
        payload=tuple(
            disturbance.model.update(_payload_point(disturbance, team_state.payload), t, old, dt)
            for disturbance, old in zip(sources.payload, disturbance_state.payload, strict=True)
        ),
        agents=tuple(
            jax.vmap(update_agent)(group, state, group_disturbances, states) if jax.tree.leaves(states) else states
            for group, state, group_disturbances, states in zip(
                team.agent_groups, team_state.agents, sources.agents, disturbance_state.agents, strict=True
            )
        ),
    )


def time_varying_names(sources: DisturbanceSet) -> tuple[str, ...]:
    """Return the names of the active disturbances that depend on time, without duplicates.

    A disturbance without a name is listed by its class. Joint friction and state functions are time invariant by
    definition.

    Args:
        sources: Disturbances of the scenario.

    Returns:
        The names in the order of the scenario.
    """
    return tuple(
        dict.fromkeys(_name(disturbance) for disturbance in _active(sources) if not disturbance.model.time_invariant)
    )


def stateful_names(sources: DisturbanceSet) -> tuple[str, ...]:
    """Return the names of the active disturbances with a state, without duplicates."""
    return tuple(
        dict.fromkeys(
            _name(disturbance) for disturbance in _active(sources) if jax.tree.leaves(disturbance.model.init())
        )
    )


def _active(sources: DisturbanceSet) -> Iterator[PayloadDisturbance | AgentDisturbance]:
    """Yield all payload disturbances and the agent disturbances that act on at least one agent."""
    yield from sources.payload
    yield from (
        disturbance
        for group_disturbances in sources.agents
        for disturbance in group_disturbances
        if np.any(disturbance.active)
    )


def _name(disturbance: PayloadDisturbance | AgentDisturbance) -> str:
    """Return the name of a disturbance, or the class of its model."""
    return disturbance.name or type(disturbance.model).__name__


def payload_wrench(
    disturbances: tuple[PayloadDisturbance, ...], q: PayloadState, t: Scalar, state: tuple[Any, ...]
) -> Wrench:
    """Compute the wrench of the payload disturbances: `F = sum F_i`, `tau = sum c_i x R^T F_i + T_i`.

    Args:
        disturbances: Disturbances of the payload.
        q: State of the payload.
        t: Time [s].
        state: States of the models.

    Returns:
        Force [N, world] and moment [N m, payload frame].
    """
    F, tau = jnp.zeros(3), jnp.zeros(3)
    for disturbance, model_state in zip(disturbances, state, strict=True):
        force, torque = disturbance.model(_payload_point(disturbance, q), t, model_state)
        F, tau = F + force, tau + so3.cross(disturbance.point, matvec(transpose(q.R), force)) + torque
    return Wrench(F=F, tau=tau)


def _payload_point(disturbance: PayloadDisturbance, q: PayloadState) -> PointKinematics:
    """Return the motion of a disturbance's point on the payload."""
    v = q.v + matvec(q.R, so3.cross(q.omega, disturbance.point))
    return PointKinematics(x=q.p + matvec(q.R, disturbance.point), v=v, R=q.R, omega=q.omega)


AgentKinematics = tuple[aerial_manipulator.ForwardKinematics, aerial_manipulator.CentroidalModel, Float[Array, "xi"]]


def _kinematics(agent: AerialManipulator, q: AgentState) -> AgentKinematics:
    """Return kinematics, centroidal model and velocity `xi = (omega, r_dot)` of an agent."""
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    return g, aerial_manipulator.centroidal_model(agent, g), jnp.concatenate([q.omega, q.r_dot])


def _body_point(
    agent: AerialManipulator, q: AgentState, kinematics: AgentKinematics, disturbance: AgentDisturbance
) -> tuple[PointKinematics, Float[Array, "3 xi"]]:
    """Return the motion of a disturbance's point on an agent, and the point's Jacobian B with respect to xi."""
    (g, p, xi), i = kinematics, disturbance.body
    lever = matvec(g.rotation[i], disturbance.point - agent.com[i])
    B = p.J_com[i] - matmul(so3.hat(lever), p.J_angular[i])
    rho = g.points[i] + lever - p.com_from_base
    return PointKinematics(
        x=q.x + matvec(q.R, rho),
        v=q.v + matvec(q.R, matvec(B, xi)),
        R=matmul(q.R, g.rotation[i]),
        omega=matvec(transpose(g.rotation[i]), matvec(p.J_angular[i], xi)),
    ), B


def _agent_forces(
    agent: AerialManipulator,
    q: AgentState,
    disturbances: tuple[AgentDisturbance, ...],
    friction: JointFriction,
    t: Scalar,
    state: tuple[Any, ...],
) -> GeneralizedForce:
    """Compute the generalized forces of all disturbances and of joint friction on one agent."""
    kinematics = g, p, xi = _kinematics(agent, q)
    f_x, Q = jnp.zeros(3), jnp.zeros_like(xi)
    for disturbance, model_state in zip(disturbances, state, strict=True):
        at, B = _body_point(agent, q, kinematics, disturbance)
        force, torque = disturbance.model(at, t, model_state)
        f_x = f_x + disturbance.active * force
        from_force = matvec(transpose(B), matvec(transpose(q.R), force))
        from_torque = matvec(transpose(p.J_angular[disturbance.body]), matvec(g.rotation[disturbance.body], torque))
        Q = Q + disturbance.active * (from_force + from_torque)
    friction_force = -friction.viscous * q.r_dot - friction.coulomb * jnp.tanh(q.r_dot / friction.speed)
    return GeneralizedForce(f_x=f_x, f_w=Q[:3], f_r=Q[3:] + friction_force)
