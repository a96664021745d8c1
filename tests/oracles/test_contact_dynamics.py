"""Tests of the rigid-contact plant against Pinocchio's dense solution and its own conservation laws."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.math import so3
from colift.models import aerial_manipulator, grasp
from colift.models.parameters import Team
from colift.models.state import AgentInput, GeneralizedForce, ResidualForces, State, Wrench
from colift.simulation import contact_dynamics, faults
from tests.support import payload_motions as motion
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam

accelerate, project = jax.jit(contact_dynamics.forward_dynamics), jax.jit(contact_dynamics.project_to_constraints)
integrate = jax.jit(lambda team, z, inputs, f, dt: contact_dynamics.rkmk4_step(team, z, inputs, lambda _z, _t: f, dt))
MIXED = teams.POOL[5]  # (n, n_r) = (2, 3), (1, 3), (3, 7) together


def random_forces(rng: np.random.Generator, team: Team) -> tuple[tuple[AgentInput, ...], ResidualForces]:
    """Return random inputs about hover and random residual forces on every body."""
    draw = lambda *shape: jnp.array(rng.normal(size=shape))  # noqa: E731
    shapes = [(size, group.tree.joints) for size, group in zip(team.sizes, team.agent_groups, strict=True)]
    inputs = tuple(AgentInput(u=20 + 5 * draw(n), tau=draw(n, 3), tau_r=draw(n, k)) for n, k in shapes)
    f = ResidualForces(
        agents=tuple(GeneralizedForce(f_x=draw(n, 3), f_w=draw(n, 3), f_r=draw(n, k)) for n, k in shapes),
        payload=Wrench(F=draw(3), tau=draw(3)),
    )
    return inputs, f


def random_team(seed: int, structure: tuple) -> tuple[Team, State]:
    """Return a random team of a structure at a random state on its grasp."""
    rng = np.random.default_rng(seed)
    return PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))


def relative_error(a: np.ndarray, b: np.ndarray) -> float:
    """Return the largest error divided by the largest entry."""
    return float(np.abs(np.asarray(a) - b).max() / np.abs(b).max())


def moments_along_axes(team: Team, moments: tuple | None) -> np.ndarray:
    """Return the moments of the contacts along their axes, in team order."""
    along = []
    for group, part in zip(team.agent_groups, moments, strict=True):
        for j in range(len(part)):
            for k, b in enumerate(group.tree.moment_arms):
                along.append(float(group.moment_axis[j, k] @ part[j, b]))
    return np.array(along)


@pytest.mark.parametrize("structure", [*teams.POOL, *teams.WITH_MOMENTS])
@pytest.mark.parametrize("seed", range(8))
def test_accelerations_and_forces_equal_pinocchio(structure: tuple, seed: int) -> None:
    team, z = random_team(seed, structure)
    inputs, f = random_forces(np.random.default_rng(seed + 1000), team)
    expected = PinocchioTeam(team).solve_kkt(z, inputs, f)
    a, lam = accelerate(team, z, inputs, f)

    allowed = 1e-9 if expected.condition <= 1e6 else 1e-15 * expected.condition
    v_dot = np.concatenate([np.asarray(group.v_dot) for group in a.agents])
    xi_dot = [xi for group in a.agents for xi in np.asarray(group.xi_dot)]
    assert relative_error(grasp.stack_contacts(lam), expected.lam) < allowed
    assert relative_error(a.payload, expected.payload) < allowed
    if len(expected.moments):
        assert relative_error(moments_along_axes(team, a.contact_moments), expected.moments) < allowed
    assert relative_error(v_dot, np.array(expected.v_dot)) < allowed
    for ours, theirs in zip(xi_dot, expected.xi_dot, strict=True):
        assert relative_error(ours, theirs) < allowed


@pytest.mark.parametrize("structure", [*teams.POOL, *teams.WITH_MOMENTS])
def test_a_regrasp_is_a_perfectly_inelastic_impact(structure: tuple) -> None:
    """The velocity after it is `v - M^-1 A^T (A M^-1 A^T)^-1 A v` with Pinocchio's M and A.

    Momenta are conserved, and the lost energy is that of the velocity difference (Carnot's theorem).
    """
    team, z = random_team(11, structure)
    shapes = [group.contact_position.shape[:2] for group in team.agent_groups]
    given = faults.Faults(
        release_time=tuple(jnp.zeros(shape) for shape in shapes),
        regrasp_time=tuple(jnp.zeros(shape) for shape in shapes),
    )
    reference, rng = PinocchioTeam(team), np.random.default_rng(12)
    q, v = reference.coordinates(z)
    v = v + rng.normal(size=v.shape)  # every tip moves relative to its contact point
    M, A = reference.mass_matrix(q), reference.jacobian(q)
    S = A @ np.linalg.solve(M, A.T)
    expected = v - np.linalg.solve(M, A.T @ np.linalg.solve(S, A @ v))

    before = reference.state(z, v)
    found = given.regrasps(team, before, given.initial_regrasps(), jnp.zeros(()))
    assert all(bool(np.asarray(closed).all()) for closed in found)
    after = jax.jit(contact_dynamics.project_to_constraints)(given.team_at(team, jnp.zeros(()), found), before)
    allowed = max(1e-9, 1e-15 * float(np.linalg.cond(S)))
    _, v_after = reference.coordinates(after)
    assert relative_error(v_after, expected) < allowed
    np.testing.assert_allclose(reference.momentum(after), reference.momentum(before), atol=1e-8)
    lost = reference.energy(before)[0] - reference.energy(after)[0]
    difference = v - v_after
    np.testing.assert_allclose(lost, difference @ M @ difference / 2, rtol=1e-6)


@pytest.mark.parametrize("structure", teams.POOL)
def test_an_impact_ends_on_the_constraints(structure: tuple) -> None:
    """Tips are 1 cm away and move. Two more Newton steps satisfy the constraints; without an impact nothing changes."""
    team, z = random_team(13, structure)
    reference, rng = PinocchioTeam(team), np.random.default_rng(14)
    _, v = reference.coordinates(z)
    payload = dataclasses.replace(z.payload, p=z.payload.p + 0.006 * jnp.ones(3))
    before = reference.state(dataclasses.replace(z, payload=payload), v + rng.normal(size=v.shape))
    one = jax.jit(contact_dynamics.project_to_constraints)(team, before)
    after = jax.jit(contact_dynamics.complete_impact)(team, one, jnp.array(True))
    assert float(jnp.abs(grasp.constraint_rate(team, after)).max()) < 1e-9
    assert float(jnp.abs(grasp.constraint_residual(team, after)).max()) < 1e-9
    assert float(jnp.abs(grasp.constraint_rate(team, one)).max()) > 1e-6  # one step is not enough
    unchanged = jax.jit(contact_dynamics.complete_impact)(team, one, jnp.array(False))
    for found, given in zip(jax.tree.leaves(unchanged), jax.tree.leaves(one), strict=True):
        np.testing.assert_array_equal(found, given)


@pytest.mark.parametrize("structure", teams.POOL)
def test_contact_forces_are_not_observable_from_motion(structure: tuple) -> None:
    """Any change d of the contact forces, with `A^T d` and `-G d` in the residuals, changes no acceleration.

    The null space of the residuals and contact forces with respect to all accelerations therefore contains every
    contact force. Only tip force sensors or a prior determine them (docs/errata.md, row 11).
    """
    team, z = random_team(3, structure)
    rng = np.random.default_rng(7)
    inputs, f = random_forces(rng, team)
    a, lam = accelerate(team, z, inputs, f)
    d = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), lam)
    W = grasp.payload_wrench(grasp.contact_points(team), z.payload.R, grasp.stack_contacts(d))
    agents = []
    for group, q, f_k, d_k in zip(team.agent_groups, z.agents, f.agents, d, strict=True):
        J = jax.vmap(lambda agent, r: aerial_manipulator.centroidal_model(
            agent, aerial_manipulator.forward_kinematics(agent, r)).J_tip)(group, q.r)  # fmt: skip
        moments = jnp.einsum("abix,aji,abj->ax", J, q.R, d_k)
        agents.append(
            GeneralizedForce(f_x=f_k.f_x + d_k.sum(1), f_w=f_k.f_w + moments[:, :3], f_r=f_k.f_r + moments[:, 3:])
        )
    changed = ResidualForces(agents=tuple(agents), payload=Wrench(F=f.payload.F - W.F, tau=f.payload.tau - W.tau))
    a_changed, lam_changed = accelerate(team, z, inputs, changed)
    for now, before in zip(jax.tree.leaves(a_changed), jax.tree.leaves(a), strict=True):
        np.testing.assert_allclose(now, before, atol=1e-10 * max(1.0, float(np.abs(before).max(initial=0))))
    for now, before, change in zip(lam_changed, lam, d, strict=True):
        np.testing.assert_allclose(now, before + change, atol=1e-9)


def rotate_world(team: Team, z: State, f: ResidualForces, R: np.ndarray) -> tuple[Team, State, ResidualForces]:
    """Return the same team, state and forces in a world frame rotated by R."""
    R = jnp.array(R)
    agents = tuple(dataclasses.replace(a, R=R @ a.R, x=a.x @ R.T, v=a.v @ R.T) for a in z.agents)
    load = dataclasses.replace(z.payload, R=R @ z.payload.R, p=R @ z.payload.p, v=R @ z.payload.v)
    forces = tuple(dataclasses.replace(part, f_x=part.f_x @ R.T) for part in f.agents)
    wrench = dataclasses.replace(f.payload, F=R @ f.payload.F)
    team = dataclasses.replace(team, gravity=R @ team.gravity)
    return team, State(agents=agents, payload=load), ResidualForces(agents=forces, payload=wrench)


@pytest.mark.parametrize("seed", range(3))
def test_dynamics_are_independent_of_the_world_frame(seed: int) -> None:
    team, z = random_team(seed, MIXED)
    inputs, f = random_forces(np.random.default_rng(seed), team)
    R = teams.rotation(np.random.default_rng(seed + 1))
    a, lam = accelerate(team, z, inputs, f)
    team, z, f = rotate_world(team, z, f, R)
    b, lam_turned = accelerate(team, z, inputs, f)
    assert relative_error(grasp.stack_contacts(lam_turned), np.asarray(grasp.stack_contacts(lam)) @ R.T) < 1e-11
    assert relative_error(b.payload[3:], np.asarray(a.payload[3:])) < 1e-11
    assert relative_error(b.payload[:3], R @ np.asarray(a.payload[:3])) < 1e-11
    for before, after in zip(a.agents, b.agents, strict=True):
        assert relative_error(after.xi_dot, np.asarray(before.xi_dot)) < 1e-11


def test_dynamics_are_independent_of_agent_grouping() -> None:
    team, z = random_team(0, teams.POOL[2])
    inputs, f = random_forces(np.random.default_rng(0), team)
    _, lam = accelerate(team, z, inputs, f)

    def apart(groups: tuple) -> tuple:
        return tuple(jax.tree.map(lambda x, j=j: x[j : j + 1], group) for group in groups for j in range(2))

    split = dataclasses.replace(team, agent_groups=apart(team.agent_groups))
    z = dataclasses.replace(z, agents=apart(z.agents))
    f = dataclasses.replace(f, agents=apart(f.agents))
    _, lam_apart = accelerate(split, z, apart(inputs), f)
    assert relative_error(grasp.stack_contacts(lam_apart), np.asarray(grasp.stack_contacts(lam))) < 1e-12


# Constraint manifold -----------------------------------------------------------------------------------------------


def off_grasp_state(z: State, size: float, seed: int = 0) -> State:
    """Return a state off the grasp by about `size` in every coordinate."""
    rng = np.random.default_rng(seed)
    shift = jax.tree.map(lambda x: jnp.array(size * rng.normal(size=x.shape)), contact_dynamics.zero_tangent(z))
    return jax.jit(contact_dynamics.retract)(z, shift)


def max_constraint_residual(team: Team, z: State) -> float:
    """Return the largest constraint residual [m or m/s]."""
    return max(float(jnp.abs(residual(team, z)).max(initial=0.0)) for residual in (Phi, Phi_dot, rotations))


Phi, Phi_dot = jax.jit(grasp.constraint_residual), jax.jit(grasp.constraint_rate)
rotations = jax.jit(grasp.rotation_residuals)


@pytest.mark.parametrize("structure", [teams.POOL[2], MIXED, *teams.WITH_MOMENTS])
def test_projection_converges_quadratically(structure: tuple) -> None:
    team, z = random_team(1, structure)
    near = off_grasp_state(z, 1e-4)
    start, errors = max_constraint_residual(team, near), []
    for _ in range(4):
        near = project(team, near)
        errors.append(max_constraint_residual(team, near))
    assert errors[0] < 1e3 * start**2
    assert errors[-1] < 1e-13
    again = project(team, near)
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(near), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-13)


@pytest.mark.parametrize("structure", [teams.POOL[2], MIXED, *teams.WITH_MOMENTS])
def test_projected_velocities_are_nearest_in_mass_metric(structure: tuple) -> None:
    """`v - M^-1 A^T (A M^-1 A^T)^-1 A v`, dense."""
    team, z = random_team(2, structure)
    model = PinocchioTeam(team)
    q, v = model.coordinates(z)
    fast = v + np.random.default_rng(3).normal(size=v.shape)
    M, A = model.mass_matrix(q), model.jacobian(q)
    nearest = fast - np.linalg.solve(M, A.T @ np.linalg.solve(A @ np.linalg.solve(M, A.T), A @ fast))
    expected, found = model.state(z, nearest), project(team, model.state(z, fast))
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)


def test_consistent_start_keeps_payload_and_attitudes() -> None:
    """The consistent initial state keeps the payload state and the attitudes of the guess."""
    team, guess = teams.reference_team(), teams.reference_guess()
    load = dataclasses.replace(guess.payload, v=jnp.array([1.0, 0.5, 0.2]), omega=jnp.array([0.1, 0.0, 0.3]))
    guess = dataclasses.replace(guess, payload=load)
    z = contact_dynamics.consistent_initial_state(team, guess)
    assert max_constraint_residual(team, z) <= 1e-12
    np.testing.assert_allclose(z.payload.p, load.p, atol=1e-6)
    np.testing.assert_allclose(z.payload.v, load.v, atol=1e-4)
    np.testing.assert_allclose(z.agents[0].R, guess.agents[0].R, atol=1e-2)


@pytest.mark.parametrize("seed", range(3))
def test_consistent_start_of_random_teams(seed: int) -> None:
    team, z = random_team(seed, MIXED)
    assert (
        max_constraint_residual(team, contact_dynamics.consistent_initial_state(team, off_grasp_state(z, 0.02, seed)))
        <= 1e-12
    )


def test_unreachable_start_is_refused_with_the_residual() -> None:
    team, guess = teams.reference_team(), teams.reference_guess()
    far = dataclasses.replace(
        team.agent_groups[0], contact_position=team.agent_groups[0].contact_position.at[1].mul(3.0)
    )
    with pytest.raises(ValueError, match=r"cannot be made consistent .* front arm 2: [\d.]+ m, 0 m/s") as e:
        contact_dynamics.consistent_initial_state(
            dataclasses.replace(team, agent_groups=(far,)), guess, ("rear", "front")
        )
    assert "1e-12 m" in str(e.value)


def test_start_without_rotation_matrix_is_refused() -> None:
    team, guess = teams.reference_team(), teams.reference_guess()
    bent = dataclasses.replace(guess, agents=(dataclasses.replace(guess.agents[0], R=-guess.agents[0].R),))
    with pytest.raises(ValueError, match="the attitude R of rear is not a rotation matrix"):
        contact_dynamics.consistent_initial_state(team, bent, ("rear", "front"))


# Motion ------------------------------------------------------------------------------------------------------------


def test_energy_and_momentum_equal_pinocchio() -> None:
    team, z = random_team(4, MIXED)
    kinetic, potential = jax.jit(motion.energy)(team, z)
    expected = PinocchioTeam(team).energy(z)
    np.testing.assert_allclose((kinetic, potential), expected, rtol=1e-13)
    np.testing.assert_allclose(jax.jit(motion.momentum)(team, z), PinocchioTeam(team).momentum(z), atol=1e-12)


@pytest.mark.parametrize("projected", [True, False])
@pytest.mark.parametrize("falling", [1.0, 0.0])
def test_energy_and_momentum_are_conserved(falling: float, projected: bool) -> None:
    """Over 2 s; `./dev evidence plant` tests 10 s and more teams."""
    team, z = motion.moving_reference_team(0)
    team = dataclasses.replace(team, gravity=falling * team.gravity)
    _, seen = motion.track(team, z, jnp.array(1e-3), jnp.array(projected), samples=20, every=100)
    seen = {name: np.asarray(value) for name, value in seen.items()}
    total = seen["kinetic"] + seen["potential"]
    assert np.abs(total - total[0]).max() < 1e-9 * seen["kinetic"].max()
    t = 0.1 * np.arange(21)[:, None]
    mass = float(team.payload.mass + sum(group.mass.sum() for group in team.agent_groups))
    fallen = seen["momentum"][:, :3] - mass * t * np.asarray(team.gravity)
    assert np.abs(fallen - fallen[0]).max() < 1e-10
    if falling == 0:
        assert np.abs(seen["momentum"] - seen["momentum"][0]).max() < 1e-10
    limit = 1e-12 if projected else 1e-8
    assert max(seen["Phi"].max(), seen["Phi_dot"].max()) < limit
    assert seen["rough"][-1] < 1e-9 * seen["kinetic"].max()


def test_central_difference_of_steps_equals_state_rate() -> None:
    """A step forward minus a step back: `R_dot = R hat(omega)`, `x_dot = v`, `v_dot` and `xi_dot` of the dynamics."""
    team, z = random_team(3, ((teams.SLIDING_ARM, 2),))
    inputs, f = random_forces(np.random.default_rng(3), team)
    a, _ = accelerate(team, z, inputs, f)
    h = 1e-4
    ahead, behind = (integrate(team, z, inputs, f, jnp.array(dt)) for dt in (h, -h))
    parts = [(z.payload, ahead.payload, behind.payload, a.payload[:3], a.payload[3:])]
    for now, after, before, b in zip(z.agents, ahead.agents, behind.agents, a.agents, strict=True):
        parts.append((now, after, before, b.v_dot, b.xi_dot[:, :3]))
        assert relative_error((after.r - before.r) / (2 * h), np.asarray(now.r_dot)) < 1e-4
        assert relative_error((after.r_dot - before.r_dot) / (2 * h), np.asarray(b.xi_dot[:, 3:])) < 1e-4
    for now, after, before, v_dot, omega_dot in parts:
        place = lambda q: getattr(q, "x", getattr(q, "p", None))  # noqa: E731  agents have x, the payload p
        turned = np.asarray(now.R) @ np.asarray(so3.hat(now.omega))
        assert relative_error((after.R - before.R) / (2 * h), turned) < 1e-4
        assert relative_error((place(after) - place(before)) / (2 * h), np.asarray(now.v)) < 1e-4
        assert relative_error((after.v - before.v) / (2 * h), np.asarray(v_dot)) < 1e-4
        assert relative_error((after.omega - before.omega) / (2 * h), np.asarray(omega_dot)) < 1e-4


def test_order_of_convergence() -> None:
    """Order four in the state and at least three in the contact forces, over five step sizes."""
    slopes = motion.convergence(*motion.moving_reference_team(1), seed=1, projected=True)
    assert slopes["state"] == pytest.approx(4, abs=0.15)
    assert slopes["force"] > 3


# Derivatives -------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_gradients_through_steps() -> None:
    """Forward and reverse mode against central differences; `./dev evidence plant` tests 1 s of the reference team."""
    team, z = random_team(0, ((teams.SLIDING_ARM, 2),))
    error = motion.gradient_errors(team, z, seed=0, steps=50)
    assert error["forward"] < 1e-6
    assert error["reverse"] < 1e-6
