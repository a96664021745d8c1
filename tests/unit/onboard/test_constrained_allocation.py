"""Tests of the allocation within limits, at one state of the paper's team."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.math import so3
from colift.models import grasp
from colift.models.state import add_payload_wrench, zero_residual
from colift.onboard import controller, interfaces
from colift.onboard.control import allocation, constrained_allocation, payload_controllers, tracking
from colift.onboard.learning import residual_predictors
from tests.support import paper_flights as paper

NORMALS = np.array([[0, -1, 0], [0, 1, 0], [0, -1, 0], [0, 1, 0]], float)
JERK = jnp.array([0.3, -0.2, 0.1])


def allocator(
    limits: constrained_allocation.ContactLimits | None = None,
) -> constrained_allocation.ConstrainedAllocator:
    of = paper.paper_experiment("C1").controller
    limits = constrained_allocation.ContactLimits() if limits is None else limits
    return constrained_allocation.constrained_allocator(of.team, of.allocator, np.deg2rad(35), limits, 2000)


@jax.jit
def _allocate(onboard: controller.LeaderFollowerController, state: Any, now: interfaces.ControlContext, a: jax.Array):
    command = tracking.AccelerationCommand(a=a[:3], alpha=a[3:], jerk=JERK)
    demand = controller.tracking_demand(onboard.team, now.estimate.payload, command, zero_residual(onboard.team))
    forces, next_state = onboard.allocator.allocate(state, now, demand)
    preferred, _ = onboard.allocator.base.allocate((), now, demand)
    return forces, preferred, next_state


def allocated(part: constrained_allocation.ConstrainedAllocator, thrust: float, a: Any, roll: float = 0.0) -> Any:
    """Forces within the limits, preferred forces, next state, and controller for a thrust limit [N] of each agent."""
    experiment = paper.paper_experiment("C1")
    groups = experiment.controller.team.agent_groups
    groups = tuple(dataclasses.replace(group, thrust_max=jnp.full(2, float(thrust))) for group in groups)
    onboard = dataclasses.replace(experiment.controller, allocator=part)
    onboard = dataclasses.replace(onboard, team=dataclasses.replace(onboard.team, agent_groups=groups))
    z = experiment.initial_state
    payload = dataclasses.replace(z.payload, R=so3.exp(jnp.array([roll, 0, 0])) @ z.payload.R)
    now = controller.context_at(onboard, dataclasses.replace(z, payload=payload), jnp.zeros(6), jnp.zeros(()))
    return *_allocate(onboard, part.init(), now, jnp.asarray(a, float)), onboard, now


def thrusts(onboard: controller.LeaderFollowerController, now: interfaces.ControlContext, forces: Any) -> np.ndarray:
    """Thrust vectors of the agents for allocated forces, from Newton's law of each agent [N, world]."""
    q, team = now.estimate.payload, onboard.team
    found, rows = [], iter(np.asarray(forces.lam).reshape(-1, 2, 3))
    for group in team.agent_groups:
        for j, c in enumerate(np.asarray(group.contact_position)):
            a = np.asarray(tracking.point_acceleration(q, forces.acceleration, jnp.asarray(c))).mean(0)
            m = float(group.mass[j].sum())
            found.append(m * (a - np.asarray(team.gravity)) + next(rows).sum(0))
    return np.array(found)


def test_forces_without_an_active_limit_are_the_preferred_ones():
    forces, preferred, _, _, _ = allocated(allocator(), 50, [0.3, -0.2, 0.4, 0.5, -0.5, 0.2])
    np.testing.assert_allclose(forces.lam, preferred.lam, rtol=0, atol=1e-9)
    np.testing.assert_allclose(forces.acceleration.a, [0.3, -0.2, 0.4], atol=1e-9)
    np.testing.assert_allclose(forces.acceleration.alpha, [0.5, -0.5, 0.2], atol=1e-9)
    np.testing.assert_allclose(forces.lam_dot, preferred.lam_dot, atol=1e-9)
    assert not any(np.asarray(x).any() for x in (forces.report.tilt, forces.report.thrust, forces.report.force))


@pytest.mark.parametrize("thrust", [22.0, 26.0])
def test_thrusts_stay_within_their_limits(thrust):
    """Roll and pitch are kept while the vertical acceleration is not; forces and achieved acceleration agree."""
    forces, _, _, onboard, now = allocated(allocator(), thrust, [0.5, 0, 2, 1, -1, 0])
    found = thrusts(onboard, now, forces)
    assert np.linalg.norm(found, axis=1).max() < thrust + 1e-3
    assert (np.linalg.norm(found[:, :2], axis=1) <= np.tan(np.deg2rad(35)) * found[:, 2] + 1e-3).all()
    demand = controller.tracking_demand(
        onboard.team, now.estimate.payload, forces.acceleration, zero_residual(onboard.team)
    )
    W = grasp.payload_wrench(grasp.contact_points(onboard.team), now.estimate.payload.R, forces.lam)
    np.testing.assert_allclose(W.F, demand.W.F, atol=1e-9)
    np.testing.assert_allclose(W.tau, demand.W.tau, atol=1e-9)
    np.testing.assert_allclose(forces.acceleration.alpha[:2], [1, -1], atol=1e-3)
    roll_pitch, z, _, _ = np.asarray(forces.report.slack)
    assert (roll_pitch < 1e-3, z > 1, bool(np.asarray(forces.report.thrust).any())) == (True, True, True)


def test_changes_at_a_thrust_limit_need_little_yaw_torque():
    """The yaw torques are about the mean contacts of the agents."""
    of = paper.paper_experiment("C1").controller
    c = np.asarray(grasp.contact_points(of.team)).reshape(2, 2, 3)
    levers = np.zeros((2, 2, 2, 3))
    for j in range(2):
        levers[j, j] = np.cross([0, 0, 1], c[j] - c[j].mean(0))
    yaw = allocation.YawTorques(levers.reshape(2, 12), 0.016)
    limits, largest = constrained_allocation.ContactLimits(), []
    for torques in (None, yaw):
        part = constrained_allocation.constrained_allocator(
            of.team, of.allocator, np.deg2rad(35), limits, 5000, yaw=torques
        )
        forces, preferred, _, _, now = allocated(part, 26, [0.5, 1, 2, 1, -1, 3], roll=0.3)
        change = np.asarray((forces.lam - preferred.lam) @ now.estimate.payload.R).ravel()
        largest.append(np.abs(yaw.levers @ change).max())
    assert largest[1] < 0.1 * largest[0]


def test_contacts_press_within_their_friction_cones():
    limits = constrained_allocation.ContactLimits(normals=NORMALS, friction=0.6, min_force=1.0, max_force=20.0)
    forces, preferred, _, _, now = allocated(allocator(limits), 50, np.zeros(6))
    lam = np.asarray(forces.lam @ now.estimate.payload.R)
    normal = (lam * NORMALS).sum(1)
    side = np.linalg.norm(lam - normal[:, None] * NORMALS, axis=1)
    assert (normal > 1 - 1e-3).all()
    assert (side < 0.6 * normal + 1e-3).all()
    assert not (np.asarray(preferred.lam @ now.estimate.payload.R) * NORMALS > 1).all()
    np.testing.assert_allclose(forces.acceleration.a, 0, atol=1e-3)


def test_an_open_contact_bears_no_force_and_is_at_no_limit():
    limits = constrained_allocation.ContactLimits(max_force=20.0)
    _, _, _, onboard, now = allocated(allocator(limits), 50, np.zeros(6))
    (group,) = onboard.team.agent_groups
    group = dataclasses.replace(group, contact_compliance=jnp.array([[1.0, 0.0], [0.0, 0.0]]))
    now = dataclasses.replace(now, team=dataclasses.replace(onboard.team, agent_groups=(group,)))
    forces, _, _ = _allocate(onboard, onboard.allocator.init(), now, jnp.zeros(6))
    np.testing.assert_allclose(forces.lam[0], 0, atol=1e-2)
    assert not np.asarray(forces.report.force).any()


def test_rates_remain_unless_thrust_directions_change():
    """Contacts that press change the forces within each agent only; a thrust limit below the need changes all rates."""
    limits = constrained_allocation.ContactLimits(normals=NORMALS, friction=0.6, min_force=1.0, max_force=20.0)
    pressing, preferred, _, _, _ = allocated(allocator(limits), 50, np.zeros(6))
    assert np.abs(pressing.lam - preferred.lam).max() > constrained_allocation.RATE_RANGE
    assert np.abs(preferred.lam_dot).max() > 0.01
    np.testing.assert_allclose(pressing.lam_dot, preferred.lam_dot, rtol=0.05)
    np.testing.assert_allclose(pressing.acceleration.jerk, JERK, rtol=0.05)
    limited, _, _, _, _ = allocated(allocator(), 22, [0, 0, 3, 0, 0, 0])
    assert not np.any(limited.lam_dot)
    assert not np.any(limited.acceleration.jerk)


def test_rates_depend_on_horizontal_changes_in_the_world_frame():
    """With a payload in roll, vertical changes of the forces have components along its y axis, which do not count."""
    part, roll = allocator().converged(), 0.4
    need = np.linalg.norm(thrusts(*(found := allocated(part, 50, np.zeros(6), roll))[3:], found[0]), axis=1).max()
    forces, preferred, _, _, now = allocated(part, need - 0.1, np.zeros(6), roll)
    R = np.asarray(now.estimate.payload.R)
    achieved = np.concatenate([R.T @ np.asarray(forces.acceleration.a), np.asarray(forces.acceleration.alpha)])
    slack = np.abs(np.asarray(part.slack_map) @ achieved).max()
    change = np.asarray(forces.lam - preferred.lam).reshape(2, 2, 3).sum(1)
    world, payload = (np.abs(moved[:, :2]).max() for moved in (change, change @ R))
    assert payload > world + 0.01
    share = 1 - (world + slack) / constrained_allocation.RATE_RANGE
    assert 0.1 < share < 0.9
    np.testing.assert_allclose(forces.acceleration.jerk, share * JERK, atol=1e-6)


def test_residuals_are_predicted_at_the_achieved_acceleration():
    """The residual of a wrong mass converges to that of the achieved acceleration in a few control periods."""
    _, _, _, onboard, now = allocated(allocator(), 22, [0, 0, 3, 0, 0, 0])
    zero, mass = zero_residual(onboard.team), 0.3

    def of_mass(state: Any, command: tracking.AccelerationCommand, t: jax.Array) -> Any:
        return add_payload_wrench(zero, -mass * jnp.concatenate([command.a, jnp.zeros(3)]))

    onboard = dataclasses.replace(
        onboard, residual_predictor=residual_predictors.TrueResidual(function=jax.tree_util.Partial(of_mass))
    )
    step = jax.jit(lambda c, state, now: c.control_law(state, now)[1:])
    state, telemetry = step(onboard, onboard.init_control_law(), now)
    demanded, _ = onboard.payload_controller.compute((), now)
    np.testing.assert_allclose(telemetry.f_hat.payload.F, -mass * np.asarray(demanded.a), atol=1e-12)
    assert telemetry.shortfall[2] < -0.5
    for _ in range(5):
        state, telemetry = step(onboard, state, dataclasses.replace(now, last_shortfall=telemetry.shortfall))
    achieved = np.asarray(demanded.a) + np.asarray(telemetry.shortfall)[:3]
    np.testing.assert_allclose(telemetry.f_hat.payload.F, -mass * achieved, atol=1e-3)


def test_agents_and_integral_use_the_achieved_acceleration():
    """The wrench of the log is the achieved one, and the next period receives the difference."""
    _, _, state, onboard, now = allocated(allocator(), 22, [0, 0, 3, 0, 0, 0])
    assert float(jnp.abs(state.multipliers).max()) > 0
    _, next_state, telemetry = jax.jit(lambda c, now: c.control_law(c.init_control_law(), now))(onboard, now)
    payload = onboard.team.payload
    shortfall = np.asarray(telemetry.shortfall)
    assert float(jnp.abs(next_state.allocator.multipliers).max()) > 0
    assert shortfall[2] < -0.5
    demanded, _ = onboard.payload_controller.compute((), now)
    expected = float(payload.mass) * (np.asarray(demanded.a) + shortfall[:3] - np.asarray(onboard.team.gravity))
    np.testing.assert_allclose(telemetry.W_d.F, expected, atol=1e-9)
    integral = payload_controllers.IntegralAction(
        base=onboard.payload_controller, K_i=jnp.array(0.0), k_i=jnp.array(0.0)
    )
    limited = dataclasses.replace(now, last_shortfall=jnp.asarray(shortfall))
    _, (kept, _) = integral.compute(integral.init(), limited)
    np.testing.assert_allclose(kept, -shortfall / 0.5 * float(now.clock.dt))
    _, (free, _) = integral.compute(integral.init(), now)
    np.testing.assert_array_equal(free, np.zeros(6))


def test_position_error_is_bounded_by_its_norm():
    experiment = paper.paper_experiment("C1")
    onboard = experiment.controller
    now = controller.context_at(onboard, experiment.initial_state, jnp.zeros(6), jnp.zeros(()))
    e_p = np.asarray(now.estimate.payload.p - now.setpoint.p)
    bounded = dataclasses.replace(onboard.payload_controller, position_error_bound=jnp.array(0.05))
    (free, _), (command, _) = onboard.payload_controller.compute((), now), bounded.compute((), now)
    K_p = np.asarray(onboard.payload_controller.gains.K_p)
    expected = np.asarray(free.a) + K_p @ e_p - K_p @ e_p * 0.05 / np.linalg.norm(e_p)
    np.testing.assert_allclose(command.a, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"friction": 0.5}, "requires the normal of each contact"),
        ({"min_force": 1.0}, "requires the normal of each contact"),
        ({"normals": NORMALS[:3]}, "3 normals for 4 contacts"),
    ],
)
def test_incomplete_contact_limits_are_refused(limits, message):
    with pytest.raises(ValueError, match=message):
        allocator(constrained_allocation.ContactLimits(**limits))


def test_slack_of_moments_has_the_lever_about_its_axis():
    """A narrow team has a short lever about its long axis in any direction; contacts on a circle have its radius."""
    angles = np.arange(5) * 2 * np.pi / 5
    circle = np.stack([0.7 * np.cos(angles), 0.7 * np.sin(angles), 0 * angles], axis=1)
    np.testing.assert_allclose(constrained_allocation._levers(circle), 0.7 * np.eye(3), atol=1e-12)
    narrow = np.array([[1, 0.1, 0], [1, -0.1, 0], [-1, 0.1, 0], [-1, -0.1, 0]])
    expected = np.diag([np.sqrt(2) * 0.1, np.sqrt(2), np.sqrt(1.01)])
    np.testing.assert_allclose(constrained_allocation._levers(narrow), expected, atol=1e-12)
    R = np.asarray(so3.exp(jnp.array([0.0, 0.0, 0.6])))
    np.testing.assert_allclose(constrained_allocation._levers(narrow @ R.T), R @ expected @ R.T, atol=1e-12)
    upright = np.array([[1.0, 0, 0.1], [1, 0, -0.1], [-1, 0, 0.1], [-1, 0, -0.1]])
    smallest = np.linalg.eigvalsh(constrained_allocation._levers(upright))[0]
    np.testing.assert_allclose(smallest, constrained_allocation.MIN_LEVER_SHARE * np.sqrt(2))
