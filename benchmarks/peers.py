"""The reference team in MuJoCo and in Pinocchio."""

from __future__ import annotations

from collections.abc import Callable

import jax
import mujoco
import numpy as np
import pinocchio as pin

from benchmarks.plant import DT, Case
from colift.models import aerial_manipulator
from colift.models.parameters import Team
from colift.models.state import zero_residual
from tests.support.pinocchio_team import PinocchioTeam


def mujoco_team(team: Team) -> mujoco.MjModel:
    """Return the same team in MuJoCo, with contacts as `connect` constraints."""
    numbers = lambda x: " ".join(repr(float(v)) for v in np.ravel(x))  # noqa: E731
    bodies, motors, grips = [], [], []
    (group,) = team.agent_groups
    for j in range(team.sizes[0]):
        a = jax.tree.map(lambda x, j=j: np.asarray(x)[j], group)

        def body(i: int, inside: str, a: object = a, j: int = j) -> str:
            J = a.inertia[i]
            full = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
            inertial = f'<inertial pos="{numbers(a.com[i])}" mass="{a.mass[i]}" fullinertia="{numbers(full)}"/>'
            if i == 0:
                return f'<body name="a{j}b0"><freejoint/>{inertial}<site name="s{j}"/>{inside}</body>'
            place, axis = numbers(a.joint_position[i - 1]), numbers(a.joint_axis[i - 1])
            joint = f'<joint name="j{j}{i}" axis="{axis}"/>'
            return f'<body name="a{j}b{i}" pos="{place}">{joint}{inertial}{inside}</body>'

        bodies.append(body(0, body(1, body(2, "") + body(3, ""))))
        gears = ["0 0 1 0 0 0", "0 0 0 1 0 0", "0 0 0 0 1 0", "0 0 0 0 0 1"]
        motors += [f'<motor site="s{j}" gear="{gear}"/>' for gear in gears]
        motors += [f'<motor joint="j{j}{i}"/>' for i in (1, 2, 3)]
        ends = zip(group.tree.tip_bodies, a.tip_position, strict=True)
        grips += [f'<connect body1="a{j}b{i}" body2="load" anchor="{numbers(tip)}"/>' for i, tip in ends]
    J = np.asarray(team.payload.inertia)
    return mujoco.MjModel.from_xml_string(f"""
      <mujoco><option timestep="{DT}" integrator="RK4" gravity="{numbers(team.gravity)}"/>
      <worldbody>{"".join(bodies)}
        <body name="load"><freejoint/><inertial pos="0 0 0" mass="{float(team.payload.mass)}"
          diaginertia="{numbers(np.diag(J))}"/></body>
      </worldbody>
      <equality>{"".join(grips)}</equality><actuator>{"".join(motors)}</actuator></mujoco>""")


def mujoco_state(model: mujoco.MjModel, case: Case) -> mujoco.MjData:
    """Return a level state and the inputs in MuJoCo's coordinates; anchors are set from the payload's contacts."""
    team, z, (u,) = case
    (group,), (a,) = team.agent_groups, z.agents
    origin = a.x - jax.vmap(aerial_manipulator.center_of_mass)(group, a.r)
    level = np.array([1.0, 0, 0, 0])
    data = mujoco.MjData(model)
    data.qpos = np.concatenate(
        [
            *(np.concatenate([o, level, r]) for o, r in zip(np.asarray(origin), np.asarray(a.r), strict=True)),
            z.payload.p,
            level,
        ]
    )
    data.ctrl = np.concatenate([u.u[:, None], u.tau, u.tau_r], axis=1).ravel()
    model.eq_data[:, 3:6] = np.asarray(group.contact_position).reshape(-1, 3)
    return data


def pinocchio_evaluations(case: Case) -> Callable[[], None]:
    """Return a function with four evaluations of Pinocchio's constrained dynamics at the initial state."""
    team, z, inputs = case
    peer = PinocchioTeam(team)
    q, v = peer.coordinates(z)
    tau = peer.force(q, z, inputs, zero_residual(team))
    model, data = peer.model, peer.model.createData()
    frames = [(model.frames[a], model.frames[b]) for a, b in zip(peer.tips, peer.contacts, strict=True)]
    grips = pin.StdVec_RigidConstraintModel()
    for a, b in frames:
        grips.append(
            pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D, model, a.parentJoint, a.placement, b.parentJoint, b.placement, pin.LOCAL
            )
        )
    contact_data = pin.StdVec_RigidConstraintData()
    for grip in grips:
        contact_data.append(grip.createData())
    settings = pin.ProximalSettings(1e-12, 1e-12, 1)
    pin.initConstraintDynamics(model, data, grips, contact_data)

    def run() -> None:
        for _ in range(4):
            pin.constraintDynamics(model, data, q, v, tau, grips, contact_data, settings)

    return run


def mujoco_velocities(cases: Case) -> np.ndarray:
    """Return velocities of level teams in MuJoCo's coordinates: body origins (world), body rates, joints."""
    (group,), (a,), load = cases[0].agent_groups, cases[1].agents, cases[1].payload
    moving = jax.vmap(
        jax.vmap(lambda agent, r, r_dot: jax.jvp(lambda r: aerial_manipulator.center_of_mass(agent, r), (r,), (r_dot,)))
    )
    com, com_dot = (np.asarray(x) for x in jax.jit(moving)(group, a.r, a.r_dot))
    omega = np.asarray(a.omega)
    origin = np.asarray(a.v) - com_dot - np.cross(omega, com)
    rows = np.concatenate([origin, omega, np.asarray(a.r_dot)], axis=-1)
    return np.concatenate([rows.reshape(len(rows), -1), np.asarray(load.v), np.asarray(load.omega)], axis=-1)
