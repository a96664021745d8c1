"""Tests of the linearized loop against finite differences and a simulation of the nonlinear loop."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.linalg import expm

from colift import gp, scenario
from colift.closed_loop import linearization
from colift.closed_loop.linearization import OUTPUTS
from colift.models import aerial_manipulator, grasp, state
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State, zero_residual
from colift.onboard import controller
from colift.onboard.learning import features, residual_model
from colift.scenario import controllers, initial_states, schema, team
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams

SIZES = np.repeat([0.5, 0.05, 0.5, 0.05, 0.02, 0.5, 0.05, 0.02], 3)  # N and N m, of a flat residual of the study's team


@functools.cache
def study() -> tuple[controller.LeaderFollowerController, State]:
    """The study's controller with a model without data, and the nominal team at rest on the reference."""
    settings = scenario.load_scenario("paper")
    small = settings.learning.model_copy(update={"max_samples": 2})
    settings = settings.model_copy(update={"initial_state": schema.InitialState(), "learning": small})
    _, nominal = team.team(settings)
    return controllers.make_controller(settings, nominal), initial_states.initial_state(settings, nominal)


@functools.cache
def spring_damper_model() -> residual_model.ResidualModel:
    """Model that predicts zero at equilibrium, and a spring and damper on the payload elsewhere."""
    controlled, z = study()
    model = controlled.residual_model
    hyper, x = (
        model.payload.hyper,
        np.asarray(features.payload_features(state.flatten_payload_state(z.payload, jnp.zeros(6)))),
    )
    apart = 0.3 * np.asarray(hyper.lengthscales)[0] * np.eye(20)[[0, 3]].sum(0)
    w = np.array([8.0, 3.0, -5.0, 6.0, 2.0, -7.0])[:, None] * np.array([1.0, -1.0])
    return dataclasses.replace(model, payload=gp.from_expansion(hyper, np.stack([x + apart, x - apart]), w))


@functools.cache
def loop(with_model: bool = False) -> linearization.LinearizedLoop:
    """Return the linearization of `study`, or of the loop with `spring_damper_model`."""
    controlled, z = study()
    return linearization.linearize(
        dataclasses.replace(controlled, residual_model=spring_damper_model()) if with_model else controlled, z
    )


def closed_loop(controlled: controller.LeaderFollowerController, z: State, f: ResidualForces) -> tuple[Any, Any, Any]:
    """Return acceleration, contact forces and desired wrench; the measured acceleration is the resulting one.

    The law is affine in it, and only its first three components enter.
    """
    team = controlled.team

    def evaluate(a: jax.Array) -> tuple[Any, Any, Any]:
        now = controller.context_at(controlled, z, a, jnp.zeros(()))
        inputs, _, telemetry = controlled.control_law(controlled.init_control_law(), now)
        return *contact_dynamics.forward_dynamics(team, z, inputs, f), telemetry.W_d

    found = jax.lax.map(lambda a: evaluate(a)[0].payload[:3], jnp.concatenate([jnp.zeros((1, 6)), jnp.eye(3, 6)]))
    slope = (found[1:] - found[:1]).T
    return evaluate(jnp.concatenate([jnp.linalg.solve(jnp.eye(3) - slope, found[0]), jnp.zeros(3)]))


@jax.jit
def coordinate_rates(
    controlled: controller.LeaderFollowerController, z: State, shift: jax.Array, f: jax.Array
) -> tuple[Any, ...]:
    """Return rates of the local coordinates at a displacement, and the quantities of the outputs."""
    d = ravel_pytree(contact_dynamics.zero_tangent(z))[1](shift)
    at = contact_dynamics.retract(z, d)
    a, lam, W_d = closed_loop(controlled, at, linearization.unflatten(controlled.team, f))
    return ravel_pytree(contact_dynamics.tangent_rate(at, d, a))[0], a.payload, lam, W_d, at


@jax.jit
def step(controlled: controller.LeaderFollowerController, z: State, f: jax.Array, dt: jax.Array) -> State:
    """One fourth-order step of the closed loop with control at every stage."""
    zero, unravel = ravel_pytree(contact_dynamics.zero_tangent(z))

    def stage(carry: tuple[jax.Array, jax.Array], node: jax.Array) -> tuple[tuple[jax.Array, jax.Array], None]:
        slope, total = carry
        d = unravel(dt * node[0] * slope)
        at = contact_dynamics.retract(z, d)
        a, _, _ = closed_loop(controlled, at, linearization.unflatten(controlled.team, f))
        slope = ravel_pytree(contact_dynamics.tangent_rate(at, d, a))[0]
        return (slope, total + dt * node[1] * slope), None

    nodes = jnp.array([[0.0, 1 / 6], [0.5, 1 / 3], [0.5, 1 / 3], [1.0, 1 / 6]])
    (_, total), _ = jax.lax.scan(stage, (zero, zero), nodes)
    return contact_dynamics.retract(z, unravel(total))


def errors(z: State) -> np.ndarray:
    """Tracking errors relative to the state of `study`, in NumPy."""
    q, d = (jax.tree.map(np.asarray, x.payload) for x in (z, study()[1]))
    Q = d.R.T @ q.R
    e_R = np.array([Q[2, 1] - Q[1, 2], Q[0, 2] - Q[2, 0], Q[1, 0] - Q[0, 1]]) / 2
    return np.concatenate([q.p - d.p, q.v, e_R, q.omega])  # the reference is at rest


def outputs(shift: np.ndarray, f: np.ndarray, with_model: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return rate and outputs of the closed loop at a displacement; outputs by the paper's law and Newton's law in
    NumPy.
    """
    controlled, z = study()
    controlled = dataclasses.replace(controlled, residual_model=spring_damper_model()) if with_model else controlled
    rate, a, lam, W_d, at = coordinate_rates(controlled, z, jnp.asarray(shift), jnp.asarray(f))
    e, gains, q = errors(at), controlled.payload_controller.gains, at.payload
    to = np.concatenate(
        [
            -np.asarray(gains.K_p) @ e[:3] - np.asarray(gains.K_v) @ e[3:6],
            -np.asarray(gains.k_R) * e[6:9] - np.asarray(gains.k_omega) * e[9:],
        ]
    )
    forces = np.concatenate([np.asarray(part).reshape(-1, 3) for part in lam])
    c, R = np.asarray(grasp.contact_points(controlled.team)), np.asarray(q.R)
    W = np.concatenate([forces.sum(0), np.cross(c, forces @ R).sum(0)])
    return np.asarray(rate), np.concatenate([e, np.asarray(a) - to, W - np.concatenate([W_d.F, W_d.tau])])


# Residual vectors -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("structure", [teams.POOL[3], teams.POOL[5], teams.POOL[0]])
def test_residual_vector_round_trip_and_body_columns(structure):
    """Conversion of residuals to a vector and back, and the columns of every body."""
    rng = np.random.default_rng(0)
    team = teams.team(rng, structure)
    f = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), zero_residual(team))
    row = linearization.flatten(f)
    jax.tree.map(np.testing.assert_array_equal, linearization.unflatten(team, row), f)
    columns = linearization.body_columns(team)
    assert [c.start for c in columns] == [0, *(c.stop for c in columns[:-1])]
    assert columns[-1].stop == len(row)
    np.testing.assert_array_equal(row[columns[0]], np.concatenate([f.payload.F, f.payload.tau]))
    each = [(group, j) for group, (_, size) in zip(f.agents, structure, strict=True) for j in range(size)]
    assert len(columns) == 1 + len(each)
    for where, (group, j) in zip(columns[1:], each, strict=True):
        np.testing.assert_array_equal(row[where], np.concatenate([group.f_x[j], group.f_w[j], group.f_r[j]]))


def test_output_rows_have_the_order_of_the_outputs():
    found, first = loop(), 0
    for name, size in OUTPUTS.items():
        assert found.output_rows(name) == slice(first, first + size)
        first += size
    assert len(found.C) == len(found.D) == first


# The linearized loop --------------------------------------------------------------------------------------------------


def test_rates_and_outputs_vanish_at_equilibrium():
    """At rest on the reference all rates and outputs are zero."""
    rate, y = outputs(np.zeros(loop().basis.shape[0]), np.zeros(24))
    assert np.abs(rate).max() < 1e-7  # the start is consistent to nanometers
    assert np.abs(y).max() < 1e-7


def test_states_span_all_motions_on_the_grasp():
    controlled, z = study()
    T = loop().basis
    free = 6 + 3 * 2  # the payload's velocities and the agents' attitudes (the tree's joints follow)
    assert T.shape[1] == 2 * free
    np.testing.assert_allclose(T.T @ T, np.eye(2 * free), atol=1e-12)
    unravel, h = ravel_pytree(contact_dynamics.zero_tangent(z))[1], 1e-5

    @jax.jit
    def gap(d: jax.Array) -> tuple[jax.Array, jax.Array]:
        at = contact_dynamics.retract(z, unravel(d))
        return grasp.constraint_residual(controlled.team, at), grasp.constraint_rate(controlled.team, at)

    for direction in T.T:
        for ahead, behind in zip(gap(jnp.asarray(h * direction)), gap(jnp.asarray(-h * direction)), strict=True):
            assert np.abs(ahead - behind).max() / (2 * h) < 1e-8


def test_direct_term_is_exact_for_any_residual():
    """The plant is linear in forces: the direct term holds for residuals of any magnitude."""
    rng, found = np.random.default_rng(1), loop()
    still = np.zeros(len(found.basis))
    for size in (0.1, 20.0):
        f = size * SIZES * rng.normal(size=24)
        y = outputs(still, f)[1] - outputs(still, 0 * f)[1]
        np.testing.assert_allclose(y, found.D @ f, atol=1e-9 * (1 + size))
    assert np.abs(found.D[: found.output_rows("a").start]).max() == 0  # errors do not jump


@pytest.mark.parametrize("with_model", [False, True])
def test_linearization_equals_central_differences(with_model):
    """Extrapolated central differences in random directions of state and residual together."""
    rng, found = np.random.default_rng(2), loop(with_model)
    if with_model:  # the feedback of the model is part of the loop
        assert np.abs(found.C - loop().C @ (loop().basis.T @ found.basis)).max() > 0.1
    T = found.basis
    for _ in range(5):
        x, f = rng.normal(size=T.shape[1]), SIZES * rng.normal(size=24)

        def slope(h: float) -> np.ndarray:
            ends = [np.concatenate(outputs(s * T @ x, s * f, with_model)) for s in (h, -h)]  # noqa: B023
            return (ends[0] - ends[1]) / (2 * h)

        h = 1e-3
        rate, y = np.split((4 * slope(h / 2) - slope(h)) / 3, [len(T)])
        scale = np.abs(y).max()
        np.testing.assert_allclose(T.T @ rate, found.A @ x + found.B @ f, atol=1e-7 * np.abs(rate).max())
        np.testing.assert_allclose(y, found.C @ x + found.D @ f, atol=1e-7 * scale)
        # it stays on the grasp: the rate has no part across it
        np.testing.assert_allclose(T @ (T.T @ rate), rate, atol=1e-7 * np.abs(rate).max())


def test_eigenvalues_equal_those_by_differences():
    T, h = loop().basis, 1e-4
    none = np.zeros(24)
    A = np.stack([T.T @ (outputs(h * d, none)[0] - outputs(-h * d, none)[0]) for d in T.T], axis=1) / (2 * h)
    expected = np.linalg.eigvals(A)
    for value in np.linalg.eigvals(loop().A):
        assert np.abs(expected - value).min() < 1e-4 * abs(value)


def steady_mismatch(truth: Team, r: jax.Array, k_R: float) -> float:
    """Compute delta_W in x under a constant unknown payload force of 1 N in x, by statics of two agents on the x axis.

    Unknowns: commanded acceleration `(a, alpha)`, difference `(d, beta)` from it by the tilt, and the lateral force
    `delta` that the thrust of an agent lacks. The contacts are at `(+-X, 0, h)`.
    """
    agent = jax.tree.map(lambda x: x[0], truth.agent_groups[0])
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r))
    m, m_L, J, N = float(p.mass), float(truth.payload.mass), float(truth.payload.inertia[1, 1]), 2
    X, _, h = np.abs(agent.contact_position[0])
    u, height = 9.81 * (m_L / N + m), -float(p.tip_from_com[:, 2].mean())
    tilting = u * height / (float(p.M_bar[1, 1]) * k_R)
    equations = [
        ([m_L + N * m, N * m * h, -N, 0, 0], -1),  # the contact forces N (m (a + h alpha) - delta) + m_L a balance 1 N
        ([-h * m_L, J + N * m * X**2, 0, 0, 0], h),  # and have no moment about y
        ([0, 0, N, m_L + N * m, N * m * h], 0),  # m_L d = -sum of deficits, deficit = delta + m (d + h beta)
        ([0, 0, N * h, N * h * m, J + N * m * (h * h + X**2)], 0),  # (J + N m X^2) beta = -h sum of deficits
        (
            [tilting * m, tilting * m * h, 1, tilting * m, tilting * m * h],
            0,
        ),  # torques for the acceleration of the tips
    ]
    a = np.linalg.solve(np.array([row for row, _ in equations]), np.array([b for _, b in equations]))[0]
    return float(-1 - m_L * a)


def test_constant_payload_force_is_shared_by_mass():
    """An unknown force on the payload in equilibrium: `delta_W = -N m / (m_L + N m)` vertically, -0.71 at 1.5 kg.

    Along the team agents also tilt, because their torques are computed for an acceleration of the tips.
    """
    controlled, z = study()
    truth, _ = team.team(scenario.load_scenario("paper"))
    found = linearization.linearize(dataclasses.replace(controlled, team=truth), z)
    rows = found.output_rows("delta_W")
    steady = found.D[rows] - found.C[rows] @ np.linalg.solve(found.A, found.B)
    along = steady_mismatch(truth, z.agents[0].r[0], float(controlled.agent_controller.gains.agent_k_R))
    assert along == pytest.approx(-0.81, abs=0.005)
    np.testing.assert_allclose(np.diag(steady)[[2, 0]], [-3.68 / 5.18, along], rtol=1e-6)


@pytest.mark.long
def test_small_constant_residual_has_the_linear_response():
    """Half a second of the nonlinear loop; the difference is of second order in the residual."""
    controlled, start = study()
    rng, found = np.random.default_rng(3), loop()
    f, seconds, steps = SIZES * rng.choice([-1.0, 1.0], 24), 0.5, 100
    n = len(found.A)
    both = expm(np.block([[found.A, (found.B @ f)[:, None]], [np.zeros((1, n + 1))]]) * seconds)
    rows = slice(0, found.output_rows("a").start)
    linear = found.C[rows] @ both[:n, n]

    def off(size: float) -> np.ndarray:
        z = start
        for _ in range(steps):
            z = step(controlled, z, jnp.asarray(size * f), jnp.asarray(seconds / steps))
        return errors(z) - size * linear

    whole, half = off(0.2), off(0.1)
    assert np.linalg.norm(whole) < 0.05 * np.linalg.norm(0.2 * linear)
    assert np.linalg.norm(half) == pytest.approx(np.linalg.norm(whole) / 4, rel=0.1)
    assert np.abs(linear[:3]).max() > 1e-3


# Redundant joints -----------------------------------------------------------------------------------------------------


@functools.cache
def three_joint_arms() -> schema.Scenario:
    """Three agents of the scenario `beam`, each with one arm of three joints, around a payload."""
    settings = scenario.load_scenario("beam")
    agents = [
        agent.model_copy(update={"contact_positions_m": (c,)})
        for agent, c in zip(settings.agents, ((0.5, 0.0, 0.05), (-0.3, 0.4, 0.05), (-0.3, -0.4, 0.05)), strict=False)
    ]
    small = settings.learning.model_copy(update={"max_samples": 2})
    return settings.model_copy(update={"agents": tuple(agents), "learning": small})


@pytest.mark.parametrize("seed", range(8))
def test_redundant_joints_return_at_the_stated_rate(seed):
    """Random links, masses, poses and rates: each mode is faster than half the rate, or than the payload's own 2.1
    1/s.
    """
    rng, settings = np.random.default_rng(seed), three_joint_arms()
    kind, rate = settings.agent_types["one_arm"], float(rng.uniform(1, 4))
    joints = [
        joint.model_copy(
            update={
                "nominal_position_rad": joint.nominal_position_rad + rng.uniform(-0.3, 0.3),
                "position_m": tuple(rng.uniform(0.5, 2) * np.array(joint.position_m)),
                "body": joint.body.model_copy(update={"mass_kg": rng.uniform(0.3, 2) * joint.body.mass_kg}),
            }
        )
        for joint in kind.joints
    ]
    arm = kind.arms[0].model_copy(update={"tip_position_m": (0.0, 0.0, -rng.uniform(0.08, 0.3))})
    changed = settings.model_copy(
        update={
            "agent_types": {"one_arm": kind.model_copy(update={"joints": tuple(joints), "arms": (arm,)})},
            "control": settings.control.model_copy(update={"posture_bandwidth": rate}),
        }
    )
    _, nominal = team.team(changed)
    controlled, z = controllers.make_controller(changed, nominal), initial_states.equilibrium_state(changed, nominal)
    slowest = np.linalg.eigvals(linearization.linearize(controlled, z).A).real.max()
    assert slowest < -min(rate / 2, 2.0)
