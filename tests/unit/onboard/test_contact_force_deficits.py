"""Tests of the contact forces that agents off their attitude setpoint apply, against the coupled dynamics."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.closed_loop import linearization
from colift.math import so3
from colift.models import aerial_manipulator, grasp
from colift.models.state import State, zero_residual
from colift.onboard import controller
from colift.onboard.control import attitude, realization, setpoints, tracking
from colift.scenario import controllers, initial_states, team
from colift.simulation import contact_dynamics
from tests.support import planar_teams, small_team

TILT = 1e-3  # rad
TEAMS = {
    "rigid hooks": small_team.settings,
    "two arms": lambda: scenario.load_scenario("paper"),
    "planar arms": lambda: planar_teams.bar(90.0),
}
NO_ACCELERATION = tracking.AccelerationCommand(a=jnp.zeros(3), alpha=jnp.zeros(3), jerk=jnp.zeros(3))
accelerate = jax.jit(contact_dynamics.forward_dynamics)
deficits_of = jax.jit(realization.contact_force_deficits)


@functools.cache
def hover(name: str) -> tuple[controller.LeaderFollowerController, State]:
    """Return the controller of a team with its nominal parameters, and the team at rest."""
    settings = TEAMS[name]()
    _, nominal = team.team(settings)
    return controllers.make_controller(settings, nominal), initial_states.equilibrium_state(settings, nominal)


@dataclasses.dataclass
class Tilted:
    """A team in hover with agent 0 off its attitude setpoint, its commanded contact forces and desired thrusts."""

    z: State
    lam: tuple[jax.Array, ...]  # N, world
    thrust: tuple[jax.Array, ...]  # N, world
    deficits: tuple[jax.Array, ...]  # N, world


def tilted(name: str, rotation: np.ndarray) -> Tilted:
    """Rotate agent 0 about its tips from its setpoint; `rotation` is a rotation vector [rad, base frame]."""
    controlled, z = hover(name)
    nominal = controlled.team
    demand = controller.tracking_demand(nominal, z.payload, NO_ACCELERATION, zero_residual(nominal))
    command, _ = controlled.allocator.allocate(
        (), controller.context_at(controlled, z, jnp.zeros(6), jnp.zeros(())), demand
    )
    lam = grasp.split_contacts(nominal, command.lam)
    desired = jax.vmap(attitude.desired_thrust, in_axes=(0, None, None, None, 0, None))
    thrust = tuple(
        desired(group, nominal.gravity, z.payload, NO_ACCELERATION, forces, jnp.zeros(3))
        for group, forces in zip(nominal.agent_groups, lam, strict=True)
    )
    agents = [
        dataclasses.replace(q, R=jax.vmap(attitude.attitude_from_thrust)(f, yaw))
        for q, f, yaw in zip(z.agents, thrust, controlled.agent_controller.yaw, strict=True)
    ]
    R = agents[0].R.at[0].set(agents[0].R[0] @ so3.exp(jnp.asarray(rotation)))
    agents[0] = dataclasses.replace(agents[0], R=R)
    z = contact_dynamics.consistent_initial_state(nominal, dataclasses.replace(z, agents=tuple(agents)))
    return Tilted(z=z, lam=lam, thrust=thrust, deficits=deficits_of(nominal, z.agents, z.payload, thrust))


def realized(name: str, of: Tilted, deficits: tuple[jax.Array, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return contact forces less commanded ones and angular accelerations by agent, without attitude feedback."""
    controlled, _ = hover(name)
    nominal, none = controlled.team, zero_residual(controlled.team)
    act = jax.vmap(realization.agent_inputs, in_axes=(0, None, None, 0, None, None, 0, 0, 0, 0, None))
    inputs = []
    for group, q, lam, yaw, f_hat, f, deficit in zip(
        nominal.agent_groups, of.z.agents, of.lam, controlled.agent_controller.yaw, none.agents, of.thrust, deficits,
        strict=True,
    ):  # fmt: skip
        here = setpoints.AttitudeSetpoint(f=f, R=q.R, omega=q.omega)
        setpoint = setpoints.AgentSetpoint(lam=lam, lam_dot=0 * lam, yaw=yaw, nominal_posture=q.r)
        gains = controlled.agent_controller.gains
        inputs.append(
            act(group, gains, nominal.gravity, q, of.z.payload, NO_ACCELERATION, setpoint, f_hat, here, deficit, None)
        )
    a, lam = accelerate(nominal, of.z, tuple(inputs), none)
    missing = [np.asarray(true - commanded).sum(1) for true, commanded in zip(lam, of.lam, strict=True)]
    return np.concatenate(missing), np.concatenate([np.asarray(agent.xi_dot)[:, :3] for agent in a.agents])


def test_aligned_thrusts_have_no_deficits():
    for name in TEAMS:
        of = tilted(name, np.zeros(3))
        aligned = tuple(
            jnp.linalg.norm(f, axis=1)[:, None] * q.R[:, :, 2] for f, q in zip(of.thrust, of.z.agents, strict=True)
        )
        deficits = deficits_of(hover(name)[0].team, of.z.agents, of.z.payload, aligned)
        assert np.abs(np.concatenate(deficits)).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "axis"), [("rigid hooks", 0), ("rigid hooks", 1), ("two arms", 0), ("two arms", 1), ("planar arms", 0)]
)
def test_tilted_agent_lacks_the_deficits(name, axis):
    """Contact forces are the commanded ones less the deficits, and the agents hold their attitudes.

    The largest error, 9 %, is that of two arms which a roll of the payload moves.
    """
    of = tilted(name, TILT * np.eye(3)[axis])
    deficits = np.concatenate(of.deficits)
    largest = np.linalg.norm(deficits, axis=1).max()
    assert np.linalg.norm(deficits[0]) > 0.1 * TILT * np.linalg.norm(of.thrust[0][0])
    missing, turning = realized(name, of, of.deficits)
    if name == "rigid hooks":  # to first order
        np.testing.assert_allclose(missing[:, :2], -deficits[:, :2], atol=2 * TILT * largest)
    np.testing.assert_allclose(missing, -deficits, atol=0.1 * largest)
    _, turning_without = realized(name, of, tuple(0 * each for each in of.deficits))
    assert np.abs(turning).max() < 0.1 * np.abs(turning_without).max()


def test_free_direction_of_planar_arms_has_small_deficits():
    """Joints about one axis move the tips across the other one, so the agent lacks hardly any force."""
    bound, free = (tilted("planar arms", TILT * np.eye(3)[axis]) for axis in (0, 1))
    assert np.abs(free.deficits[0]).max() < 0.01 * np.abs(bound.deficits[0]).max()


@pytest.mark.parametrize(("name", "axis"), [("rigid hooks", 0), ("rigid hooks", 1), ("two arms", 1)])
def test_static_torque_leans_agents_by_its_share_of_stiffness(name, axis):
    """An unknown torque t leans each agent by `e = t / (I k_R)` from its setpoint, in equilibrium of the loop.

    The horizontal forces sum to zero, so the bases are level and the setpoints lean by -e. This acceleration
    `a_cmd = g e` is that of the position feedback, `K_p e_p`.
    """
    controlled, z = hover(name)
    loop = linearization.linearize(controlled, z)
    f = np.zeros(loop.B.shape[1])
    for columns in linearization.body_columns(controlled.team)[1:]:
        f[columns.start + 3 + axis] = 1.0  # N m, base frame
    rows = loop.output_rows("e_p")
    e_p = (loop.D[rows] - loop.C[rows] @ np.linalg.solve(loop.A, loop.B)) @ f
    agent, q = (jax.tree.map(lambda x: x[0], value[0]) for value in (controlled.team.agent_groups, z.agents))
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
    lean = 1 / (float(p.M_bar[axis, axis]) * float(controlled.agent_controller.gains.agent_k_R))
    across = 1 - axis  # a torque about y pushes along x, a torque about x against y
    expected = (1 if axis == 1 else -1) * 9.81 * lean / float(controlled.payload_controller.gains.K_p[across, across])
    assert e_p[across] == pytest.approx(expected, rel=0.01)
    assert np.abs(e_p[[axis, 2]]).max() < 0.1 * abs(expected)
