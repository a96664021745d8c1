"""Tests of the control of a team that is one rigid body: mass properties, commands, labels and a flight."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight
from colift.math import so3
from colift.models import grasp
from colift.models.state import GeneralizedForce, ResidualForces, State, Wrench
from colift.onboard import controller
from colift.onboard.control import rigid_assembly, tracking
from colift.scenario import controllers, experiment, initial_states, team
from colift.scenario.errors import ScenarioError
from colift.simulation import contact_dynamics
from colift.workflows import python_api

EXACT = {
    f"sensors.{name}": 0
    for name in (
        "position_m",
        "attitude_deg",
        "velocity_mps",
        "angular_velocity_radps",
        "accelerometer_mps2",
        "tip_force_N",
        "tip_force_bias_N",
        "tip_moment_Nm",
    )
}


def random_case(seed: int) -> tuple[controller.LeaderFollowerController, State, ResidualForces]:
    """Return a controller of three unequal vehicles on a beam, a random state of the team, and random residuals."""
    rng = np.random.default_rng(seed)
    agents = [
        {"name": f"n{j}", "type": "drone", "yaw_deg": float(rng.uniform(-180, 180)), "contact_positions_m": [c]}
        for j, c in enumerate(rng.uniform(-0.6, 0.6, (3, 3)).round(3).tolist())
    ]
    heavy = {
        "base": {"mass_kg": 2.2, "inertia_kgm2": [0.03, 0.03, 0.05], "center_of_mass_m": [0.01, 0, 0.02]},
        "thrust_max_N": 60,
        "arms": [{"name": "grip", "joint": "base", "tip_position_m": [0.05, 0, -0.1], "contact": "rigid"}],
    }
    agents[1]["type"] = "heavy"
    settings = python_api.load_scenario("rigid_beam", {"agents": agents, "agent_types.heavy": heavy})
    _, nominal = team.team(settings)
    z = initial_states.equilibrium_state(settings, nominal)
    R, omega = so3.exp(jnp.asarray(0.3 * rng.normal(size=3))), jnp.asarray(rng.normal(size=3))
    v = jnp.asarray(0.3 * rng.normal(size=3))

    def moved(q):
        x = z.payload.p[None] + (q.x - z.payload.p[None]) @ R.T
        attitude = jnp.einsum("ij,ajk->aik", R, q.R)
        spin = jnp.einsum("aji,j->ai", attitude, R @ omega)
        return dataclasses.replace(
            q, R=attitude, x=x, omega=spin, v=v[None] + so3.cross((R @ omega)[None], x - z.payload.p[None])
        )

    payload = dataclasses.replace(z.payload, R=R, omega=omega, v=v)
    z = State(agents=tuple(moved(q) for q in z.agents), payload=payload)
    draw = lambda *shape: jnp.asarray(rng.normal(size=shape))  # noqa: E731
    f = ResidualForces(
        agents=(GeneralizedForce(f_x=draw(3, 3), f_w=draw(3, 3), f_r=jnp.zeros((3, 0))),),
        payload=Wrench(F=draw(3), tau=draw(3)),
    )
    controlled = controllers.make_controller(settings, nominal)
    slow = dataclasses.replace(controlled.allocator.gains, agent_k_R=jnp.array(4.0), agent_k_omega=jnp.array(2.0))
    return dataclasses.replace(controlled, allocator=dataclasses.replace(controlled.allocator, gains=slow)), z, f


def test_mass_properties_are_those_of_all_bodies() -> None:
    controlled, z, _ = random_case(0)
    group, payload = controlled.team.agent_groups[0], controlled.team.payload
    body = jax.jit(rigid_assembly.assembly)(controlled.team)
    to_payload = lambda x: (np.asarray(x) - np.asarray(z.payload.p)) @ np.asarray(z.payload.R)  # noqa: E731
    masses = np.array([float(payload.mass), *np.asarray(group.mass[:, 0])])
    places = np.concatenate([np.zeros((1, 3)), to_payload(z.agents[0].x)])
    turns = np.einsum("ji,ajk->aik", np.asarray(z.payload.R), np.asarray(z.agents[0].R))
    com = masses @ places / masses.sum()
    J = np.asarray(payload.inertia) + np.einsum("aij,ajk,alk->il", turns, np.asarray(group.inertia[:, 0]), turns)
    for m, x in zip(masses, places - com, strict=True):
        J = J + m * (x @ x * np.eye(3) - np.outer(x, x))
    np.testing.assert_allclose(body.mass, masses.sum(), rtol=1e-12)
    np.testing.assert_allclose(body.com, com, atol=1e-9)
    np.testing.assert_allclose(body.inertia, J, atol=1e-9)


@jax.jit
def respond(controlled: controller.LeaderFollowerController, z: State, f: ResidualForces):
    """Return allocation, and the accelerations and loads that its inputs cause in the plant."""
    context = controller.context_at(controlled, z, jnp.zeros(6), jnp.asarray(1.0))
    command, _ = controlled.payload_controller.compute(controlled.payload_controller.init(), context)
    demand = controller.tracking_demand(controlled.team, z.payload, command, f)
    forces, _ = controlled.allocator.allocate((), context, demand)
    (inputs, saturated), _ = controlled.agent_controller.compute((), context, forces.acceleration, forces, f)
    return command, forces, saturated, contact_dynamics.forward_dynamics(controlled.team, z, inputs, f)


@pytest.mark.parametrize("seed", range(8))
def test_the_plant_has_the_commanded_accelerations_and_loads(seed: int) -> None:
    """With exact residuals, the payload accelerates as the allocator states, and the contacts bear its loads."""
    controlled, z, f = random_case(seed)
    _, forces, saturated, (a, lam) = respond(controlled, z, f)
    assert not np.asarray(saturated).any()
    achieved = forces.acceleration
    np.testing.assert_allclose(a.payload[:3], achieved.a, atol=1e-8)
    np.testing.assert_allclose(a.payload[3:], achieved.alpha, atol=1e-8)
    np.testing.assert_allclose(grasp.stack_contacts(lam), forces.lam, atol=1e-7)
    np.testing.assert_allclose(grasp.stack_contacts(a.contact_moments), forces.moments, atol=1e-7)


def test_the_commanded_acceleration_along_the_thrust_is_achieved() -> None:
    """Across the thrust the assembly has to tilt first; along it, the center of mass accelerates as commanded."""
    controlled, z, f = random_case(3)
    command, forces, _, (a, _) = respond(controlled, z, f)
    com = rigid_assembly.assembly(controlled.team).com
    zero = tracking.AccelerationCommand(a=jnp.zeros(3), alpha=forces.acceleration.alpha, jerk=jnp.zeros(3))
    shift = tracking.point_acceleration(z.payload, zero, com[None])[0]
    np.testing.assert_allclose((a.payload[:3] + shift - command.a) @ z.payload.R[:, 2], 0, atol=1e-8)


def test_a_beam_with_two_vehicles_flies() -> None:
    """It tilts for horizontal accelerations; labels of force and moment converge to the true residuals."""
    given = python_api.load_scenario("rigid_beam", EXACT | {"duration_s": 12.0, "agents.rear.yaw_deg": 90})
    rows = flight.run_experiment(experiment.make_experiment(given, "label_feedback")).records
    late = rows.t > 9
    assert np.linalg.norm(rows.e_p[late], axis=1).max() < 5e-3
    assert np.rad2deg(np.arccos(rows.R_L[late, 2, 2])).max() > 1
    assert np.linalg.norm(rows.contact_moment[late], axis=2).max() > 0.02
    np.testing.assert_allclose(rows.f_L_hat[late].mean(0), rows.f_L[late].mean(0), atol=0.02)
    np.testing.assert_allclose(rows.f_w_hat[late].mean(0), rows.f_w[late].mean(0), atol=2e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"allocation": {"kind": "constrained"}}, "allocation.kind: constrained is not available for vehicles"),
        ({"contact_forces": {"kind": "momentum_observer"}}, "must be tip_sensors with contacts that bear moments"),
        ({"sensors.payload_imu": False}, "must be true with contacts that bear moments"),
        ({"physics": {"kind": "mujoco"}}, "mujoco supports contacts of type point alone"),
        ({"control.preview_step_s": 0.02}, "control.preview_step_s is not available for vehicles"),
        ({"faults": [{"kind": "contact", "who": "rear/grip", "start_s": 3}]}, "kind: contact is not available"),
        ({"faults": [{"kind": "contact", "who": "rear/grip", "start_s": 3, "end_s": 4}]}, "does not close again"),
    ],
)
def test_settings_for_point_contacts_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        experiment.make_experiment(python_api.load_scenario("rigid_beam", changes), "C1")


def test_a_rigid_grip_without_wrist_is_refused_beside_joints() -> None:
    """The attitude of such an agent could not differ from that of the payload."""
    arm = {"name": "tip", "joint": "elbow", "tip_position_m": [0, 0, -0.12], "contact": "rigid"}
    given = python_api.load_scenario("beam", {"agent_types.one_arm.arms": [arm]})
    with pytest.raises(ScenarioError, match="rotate it about 2 of 3 axes, which fixes the attitude of the agent"):
        experiment.make_experiment(given, "C1")
