"""Control of a rigid assembly: vehicles without joints whose rigid grips hold the payload.

Agents and payload are one rigid body. All thrusts are along the third axis of the payload frame, so the assembly
tilts to accelerate horizontally, as one multirotor does. The payload attitude is therefore not tracked, except for its
heading.

In this module M is the mass of the assembly, c its center of mass and J its inertia about c, both in the payload frame.

References:
    Lee, Leok, McClamroch, *Geometric tracking control of a quadrotor UAV on SE(3)*, CDC 2010.
    Mellinger, Shomin, Michael, Kumar, *Cooperative Grasping and Transport using Multiple Quadrotors*, DARS 2010.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import linalg, so3
from colift.math.linalg import matmul, matvec
from colift.math.pytree import constant, pytree
from colift.models import aerial_manipulator, inverse_dynamics
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentInput, AgentState, GeneralizedForce, PayloadState, ResidualForces, TeamInputs
from colift.onboard.control import realization, tracking
from colift.onboard.control.attitude import attitude_from_thrust
from colift.onboard.control.redundancy import motion_with_tip_constraint
from colift.onboard.interfaces import (
    AllocationDemand,
    ContactForceCommand,
    ControlContext,
    PartState,
    SaturationFlags,
)

Scalar = Float[Array, ""]


@pytree
class Assembly:
    """Mass properties of a rigid assembly, and the effect of its inputs; all in the payload frame."""

    mass: Scalar  # kg
    com: Float[Array, "3"]  # m, center of mass
    inertia: Float[Array, "3 3"]  # kg m^2, about the center of mass
    R: tuple[Float[Array, "_agents 3 3"], ...]  # attitudes of the agents
    base: tuple[Float[Array, "_agents 3"], ...]  # m, base origins of the agents
    agent_com: tuple[Float[Array, "_agents 3"], ...]  # m, centers of mass of the agents


def assembly(team: Team) -> Assembly:
    """Compute the mass properties of a team that is one rigid body.

    Args:
        team: Nominal parameters, with rigid grips and without joints.

    Returns:
        The mass properties.
    """
    R, base, com, masses = [], [], [], [team.payload.mass[None]]
    for group in team.agent_groups:
        assert group.grip_rotation is not None  # for the type checker
        turn = group.grip_rotation[:, 0]
        R.append(turn)
        base.append(group.contact_position[:, 0] - matvec(turn, group.tip_position[:, 0]))
        com.append(base[-1] + matvec(turn, group.com[:, 0]))
        masses.append(group.mass[:, 0])
    m, x = jnp.concatenate(masses), jnp.concatenate([jnp.zeros((1, 3)), *com])
    inertias = jnp.concatenate(
        [
            team.payload.inertia[None],
            *(
                matmul(matmul(turn, g.inertia[:, 0]), linalg.transpose(turn))
                for turn, g in zip(R, team.agent_groups, strict=True)
            ),
        ]
    )
    mass = m.sum()
    center = (m[:, None] * x).sum(0) / mass
    offset = so3.hat(x - center[None])
    J = (inertias - m[:, None, None] * matmul(offset, offset)).sum(0)
    return Assembly(mass=mass, com=center, inertia=J, R=tuple(R), base=tuple(base), agent_com=tuple(com))


def residual_wrench(
    body: Assembly, payload: PayloadState, f_hat: ResidualForces
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Compute the wrench of all predicted residuals about the center of mass of the assembly.

    Args:
        body: Mass properties.
        payload: Estimated state of the payload.
        f_hat: Predicted residuals of agents and payload.

    Returns:
        Force [N, world] and moment [N m, payload frame].
    """
    F = f_hat.payload.F + sum(f.f_x.sum(0) for f in f_hat.agents)
    tau = f_hat.payload.tau + so3.cross(-body.com, payload.R.T @ f_hat.payload.F)
    for f, x, R in zip(f_hat.agents, body.agent_com, body.R, strict=True):
        force = f.f_x @ payload.R
        tau = tau + (so3.cross(x - body.com[None], force) + matvec(R, f.f_w)).sum(0)
    return F, tau


@pytree
class RigidAssemblyAllocator:
    """Attitude control of the assembly, and the least inputs that generate its thrust and moment.

    1. The desired thrust is `f = M (a - a_g) - F_hat`. The desired attitude has its third axis along f and the heading
       of the reference; its angular velocity follows from `f_dot = M (jerk - K_v e_a)`. The acceleration error e_a is
       that of the present thrust. Feedback of the measured acceleration of the payload, which the angular acceleration
       changes, would be unstable.
    2. `alpha = -k_R e_R - k_w e_w - w x R^T R_d w_d`, and the thrust is `T = f . R e_3`.
    3. The inputs `(u_j, tau_j)` of least norm generate T and the moment `J alpha + w x J w - tau_hat`. A torque counts
       with the rotor forces that generate it, `tau / torque_lever`.
    4. Newton's and Euler's equations of each agent yield its contact force and moment.

    Implements the protocol ``Allocator``. The achieved acceleration is that of the assembly, without the horizontal
    part that requires a rotation first.
    """

    gains: tracking.Gains  # `agent_k_R` and `agent_k_omega` apply to the assembly, which is actuated like one agent
    torque_lever: Scalar = constant(0.25)  # m, distance of rotors from the center of their vehicle

    def init(self) -> PartState:
        """Return the empty state."""
        return ()

    def allocate(
        self, state: PartState, context: ControlContext, demand: AllocationDemand
    ) -> tuple[ContactForceCommand, PartState]:
        """Compute contact forces and moments of all agents; see `Allocator`."""
        team, payload, command = context.team, context.estimate.payload, demand.acceleration_cmd
        body = assembly(team)
        F_hat, tau_hat = residual_wrench(body, payload, demand.f_hat)
        f = body.mass * (command.a - team.gravity) - F_hat
        heading = context.setpoint.R[:, 0]
        yaw = jnp.arctan2(heading[1], heading[0])
        thrust = f @ payload.R[:, 2]
        specific_force = (thrust * payload.R[:, 2] + F_hat) / body.mass  # of the center of mass
        e_a = specific_force + team.gravity - context.setpoint.a
        f_dot = body.mass * (command.jerk - self.gains.K_v @ e_a)
        R_d, R_d_dot = jax.jvp(lambda f: attitude_from_thrust(f, yaw), (f,), (f_dot,))
        omega_d = so3.vee(R_d.T @ R_d_dot)
        to_body = payload.R.T @ R_d
        alpha = -self.gains.agent_k_R * so3.e_R(payload.R, R_d) - so3.cross(payload.omega, to_body @ omega_d)
        alpha = alpha - self.gains.agent_k_omega * so3.e_omega(payload.R, payload.omega, R_d, omega_d)
        moment = body.inertia @ alpha + so3.cross(payload.omega, body.inertia @ payload.omega) - tau_hat
        inputs = self._inputs(body, jnp.concatenate([thrust[None], moment]))
        offset = tracking.point_acceleration(
            payload, tracking.AccelerationCommand(a=jnp.zeros(3), alpha=alpha, jerk=jnp.zeros(3)), body.com[None]
        )[0]
        achieved = dataclasses.replace(command, a=specific_force + team.gravity - offset, alpha=alpha, alpha_dot=None)
        loads = [
            jax.vmap(_contact_load, in_axes=(0, 0, 0, 0, 0, None, None, None))(
                group, x, R, u, f_j, payload, achieved, team.gravity
            )
            for group, x, R, u, f_j in zip(
                team.agent_groups, body.agent_com, body.R, inputs, demand.f_hat.agents, strict=True
            )
        ]
        lam = jnp.concatenate([force for force, _ in loads])
        return ContactForceCommand(
            lam=lam,
            lam_dot=jnp.zeros_like(lam),
            eta=jnp.zeros(0),
            acceleration=achieved,
            moments=jnp.concatenate([moments for _, moments in loads]),
        ), state

    def _inputs(self, body: Assembly, demand: Float[Array, "4"]) -> tuple[Float[Array, "_agents 4"], ...]:
        """Return thrust and body torque of each agent by group, of least norm for a thrust and a moment."""
        maps = []
        for R, base in zip(body.R, body.base, strict=True):
            lever = so3.cross(base - body.com[None], jnp.array([[0.0, 0.0, 1.0]]))
            by_thrust = jnp.concatenate([jnp.ones((len(base), 1)), lever], axis=1)[:, :, None]
            by_torque = jnp.pad(R * self.torque_lever, ((0, 0), (1, 0), (0, 0)))
            maps.append(jnp.concatenate([by_thrust, by_torque], axis=2))
        A = jnp.concatenate(maps).transpose(1, 0, 2).reshape(4, -1)
        x = (A.T @ linalg.solve(A @ A.T, demand[:, None])[:, 0]).reshape(-1, 4)
        x = x * jnp.concatenate([jnp.ones(1), jnp.full(3, self.torque_lever)])[None]
        ends = np.cumsum([len(base) for base in body.base])
        return tuple(x[end - len(base) : end] for end, base in zip(ends, body.base, strict=True))


def _contact_load(
    agent: AerialManipulator,
    x: Float[Array, "3"],
    R: Float[Array, "3 3"],
    inputs: Float[Array, "4"],
    f_hat: GeneralizedForce,
    payload: PayloadState,
    acceleration: tracking.AccelerationCommand,
    gravity: Float[Array, "3"],
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Return force [N, world] and moment [N m, payload frame] of an agent's contact for its thrust and torque."""
    attitude = payload.R @ R
    a = tracking.point_acceleration(payload, acceleration, x[None])[0]
    lam = inputs[0] * attitude[:, 2] + f_hat.f_x - agent.mass[0] * (a - gravity)
    q = AgentState(R=attitude, x=payload.p, r=jnp.zeros(0), omega=R.T @ payload.omega, v=payload.v, r_dot=jnp.zeros(0))
    _, Q, thrust = inverse_dynamics.agent_inverse_dynamics(agent, q, a - gravity, R.T @ acceleration.alpha, lam[None])
    return lam, R @ (inputs[1:] + f_hat.f_w + inputs[0] * thrust - Q)


@pytree
class RigidGripController:
    """Controller of agents with rigid grips and without joints, which move with the payload.

    Inverse dynamics for the commanded contact force and moment yields thrust and torque. Implements the protocol
    ``AgentController``; requires an allocator that commands contact moments.
    """

    def init(self) -> PartState:
        """Return the empty state."""
        return ()

    def compute(
        self,
        state: PartState,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        forces: ContactForceCommand,
        f_hat: ResidualForces,
    ) -> tuple[tuple[TeamInputs, SaturationFlags], PartState]:
        """Compute the inputs of all agents, with thrust limited to the range of the rotors; see `AgentController`.

        Raises:
            ValueError: If the allocator commands no contact moments.
        """
        if forces.moments is None:
            raise ValueError("RigidGripController requires contact moments: use RigidAssemblyAllocator")
        team, first, inputs, saturated = context.team, 0, [], []
        for group, q, f in zip(team.agent_groups, context.estimate.agents, f_hat.agents, strict=True):
            own = slice(first, first + len(group.mass))
            first = own.stop
            requested = jax.vmap(_inputs, in_axes=(0, 0, 0, 0, 0, None, None, None))(
                group,
                q,
                forces.lam[own],
                forces.moments[own],
                f,
                context.estimate.payload,
                acceleration_cmd,
                team.gravity,
            )
            limited, at_limit = realization.limit_thrust(group, requested)
            inputs.append(limited)
            saturated.append(at_limit)
        return (tuple(inputs), tuple(saturated)), state


def _inputs(
    agent: AerialManipulator,
    q: AgentState,
    lam: Float[Array, "3"],
    moment: Float[Array, "3"],
    f_hat: GeneralizedForce,
    payload: PayloadState,
    acceleration_cmd: tracking.AccelerationCommand,
    gravity: Float[Array, "3"],
) -> AgentInput:
    """Return the inputs of one agent for its contact force [N, world] and moment [N m, payload frame]."""
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    p = aerial_manipulator.centroidal_model(agent, g)
    h, kappa = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
    omega_dot = q.R.T @ (payload.R @ acceleration_cmd.alpha)
    y = motion_with_tip_constraint(agent, payload, acceleration_cmd, p, kappa, q.R, omega_dot, jnp.zeros(3))
    inputs = realization.inputs_for_acceleration(p, h, q, q.R @ y[:3] - gravity, omega_dot, lam[None], f_hat)
    load = inverse_dynamics.contact_moment_load(agent, p, (q.R.T @ (payload.R @ moment))[None])
    return dataclasses.replace(inputs, tau=inputs.tau + load)
