"""Tests of contacts that bear moments against MuJoCo: rigid grips, and the onset of torsional slip of a soft finger."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.closed_loop import termination
from colift.models.state import AgentInput, GeneralizedForce, ResidualForces, Wrench
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam

STRUCTURE = ((teams.RIGID_GRIP, 3),)
accelerate = jax.jit(contact_dynamics.forward_dynamics)


def one_body(team, z, inputs) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a MuJoCo model in which agents and payload are one body, with sensors at the grips."""
    numbers = lambda x: " ".join(repr(float(v)) for v in np.ravel(x))  # noqa: E731
    quaternion = lambda R: numbers(Rotation.from_matrix(np.asarray(R)).as_quat(scalar_first=True))  # noqa: E731
    group, payload = team.agent_groups[0], team.payload

    def inertial(mass, com, J) -> str:
        J = np.asarray(J)
        entries = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
        return f'<inertial pos="{numbers(com)}" mass="{float(mass)!r}" fullinertia="{numbers(entries)}"/>'

    bodies, sensors = [], []
    for j in range(3):
        R, c = np.asarray(group.grip_rotation[j, 0]), np.asarray(group.contact_position[j, 0])
        tip = np.asarray(group.tip_position[j, 0])
        bodies.append(
            f'<body name="a{j}" pos="{numbers(c - R @ tip)}" quat="{quaternion(R)}">'
            f"{inertial(group.mass[j, 0], group.com[j, 0], group.inertia[j, 0])}"
            f'<site name="grip{j}" pos="{numbers(tip)}"/></body>'
        )
        sensors.append(f'<force site="grip{j}"/><torque site="grip{j}"/>')
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="{numbers(team.gravity)}"/><worldbody>'
        f'<body pos="{numbers(z.payload.p)}" quat="{quaternion(z.payload.R)}"><freejoint/>'
        f"{inertial(payload.mass, np.zeros(3), payload.inertia)}{''.join(bodies)}</body></worldbody>"
        f"<sensor>{''.join(sensors)}</sensor></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel[:] = [*z.payload.v, *z.payload.omega]
    mujoco.mj_kinematics(model, data)
    for j in range(3):  # forces of actuators are not part of MuJoCo's force sensors, external forces are
        body = data.body(f"a{j}")
        R = body.xmat.reshape(3, 3)
        thrust = float(inputs[0].u[j]) * R[:, 2]
        moment = R @ np.asarray(inputs[0].tau[j]) + np.cross(body.xpos - body.xipos, thrust)
        data.xfrc_applied[model.body(f"a{j}").id] = [*thrust, *moment]
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("seed", range(6))
def test_loads_of_rigid_grips_equal_one_body_of_mujoco(seed: int) -> None:
    rng = np.random.default_rng(seed)
    team, z = PinocchioTeam(teams.team(rng, STRUCTURE)).on_grasp(teams.free_state(rng, STRUCTURE))
    inputs = (
        AgentInput(
            u=jnp.array(20 + rng.normal(size=3)), tau=jnp.array(rng.normal(size=(3, 3))), tau_r=jnp.zeros((3, 0))
        ),
    )
    none = ResidualForces(
        agents=(GeneralizedForce(f_x=jnp.zeros((3, 3)), f_w=jnp.zeros((3, 3)), f_r=jnp.zeros((3, 0))),),
        payload=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
    )
    a, lam = accelerate(team, z, inputs, none)
    assert a.contact_moments is not None
    _, data = one_body(team, z, inputs)
    np.testing.assert_allclose(a.payload, data.qacc, rtol=1e-9, atol=1e-9)
    read = -data.sensordata.reshape(3, 2, 3)  # the sensors measure the load on the agent
    turn = np.asarray(z.payload.R) @ np.asarray(team.agent_groups[0].grip_rotation[:, 0])  # frames of the sensors
    np.testing.assert_allclose(lam[0][:, 0], np.einsum("jab,jb->ja", turn, read[:, 0]), rtol=1e-8, atol=1e-8)
    moments = np.asarray(a.contact_moments[0][:, 0]) @ np.asarray(z.payload.R).T
    np.testing.assert_allclose(moments, np.einsum("jab,jb->ja", turn, read[:, 1]), rtol=1e-8, atol=1e-8)


def sliding_acceleration(moment: float, normal: float, friction: float) -> float:
    """Return the angular acceleration of a ball that is pressed on a plane with a moment about the normal."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="2e-4" cone="elliptic" gravity="0 0 0" impratio="100"/><worldbody>
        <geom type="plane" size="1 1 1" condim="4" friction="1 {friction} 0"/>
        <body pos="0 0 0.05"><freejoint/>
        <geom type="sphere" size="0.05" mass="0.5" condim="4" friction="1 {friction} 0"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.xfrc_applied[1, 2] = -normal
    for _ in range(2000):  # rest
        mujoco.mj_step(model, data)
    data.xfrc_applied[1, 5] = moment
    before = data.qvel[5]
    for _ in range(1000):
        mujoco.mj_step(model, data)
    return float((data.qvel[5] - before) / (1000 * model.opt.timestep))


@pytest.mark.parametrize(("friction", "normal"), [(0.01, 5.0), (0.02, 3.0), (0.005, 8.0)])
def test_onset_of_torsional_slip_equals_mujoco(friction: float, normal: float) -> None:
    """The moment at which MuJoCo's contact starts to slide is that at which a flight ends, within 2 %.

    While it slides, the acceleration is linear in the moment; its zero is the onset.
    """
    moments = friction * normal * np.array([1.5, 2.0, 2.5])
    slope, intercept = np.polyfit(moments, [sliding_acceleration(m, normal, friction) for m in moments], 1)
    onset = -intercept / slope
    limits = termination.ContactLimits(
        normal=jnp.array([[0.0, 0.0, 1.0]]),
        friction=jnp.array(1.0),
        min_force=jnp.array(0.0),
        max_force=jnp.array(np.inf),
        torsional_friction=jnp.array([friction]),
    )
    excess = lambda share: termination.contact_excess(  # noqa: E731
        limits, jnp.array([[0.0, 0.0, normal]]), jnp.array([[0.0, 0.0, share * onset]])
    )[3]
    assert excess(0.98) < 0 < excess(1.02)
    assert sliding_acceleration(0.9 * onset, normal, friction) < 0.02 * sliding_acceleration(
        2 * onset, normal, friction
    )
