"""Tests of one aerial manipulator against Pinocchio, MuJoCo and numerical derivatives."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pinocchio as pin
import pytest

from colift.math import so3
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, KinematicTree
from colift.models.state import AgentState
from tests.support import random_teams as teams
from tests.support.mujoco_agent import MujocoAgent
from tests.support.pinocchio_team import FreeAgent, take

SEEDS = range(4)


@jax.jit
def all_quantities(agent: AerialManipulator, state: AgentState) -> dict[str, object]:
    """Return all quantities of the module at a state, compiled once per tree."""
    g = aerial_manipulator.forward_kinematics(agent, state.r)
    q = aerial_manipulator.centroidal_model(agent, g)
    h, kappa = aerial_manipulator.bias_forces(agent, g, q, state.omega, state.r_dot)
    xi = jnp.concatenate([state.omega, state.r_dot])
    along = lambda f: jax.jvp(f, (state.r,), (state.r_dot,))[1]  # noqa: E731
    return {
        "g": g,
        "q": q,
        "h": h,
        "kappa": kappa,
        "tips": aerial_manipulator.tip_positions(agent, state),
        "s": aerial_manipulator.center_of_mass(agent, state.r),
        "momenta": aerial_manipulator.momenta(agent, state.r, xi),
        "drift": aerial_manipulator.momentum_drift(agent, state.r, xi),
        "M_bar_dot": along(
            lambda r: aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r)).M_bar
        ),
        "J_rho": jax.jacfwd(
            lambda r: (
                aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r)).tip_from_com
            )
        )(state.r),
        "J_s": jax.jacfwd(lambda r: aerial_manipulator.center_of_mass(agent, r))(state.r),
        "rho_ddot": _second_derivative(agent, state),
    }


def _second_derivative(agent: AerialManipulator, state: AgentState) -> jax.Array:
    """`R^T d^2/dt^2 (R rho)` with constant body rate and joint rates."""

    def at(t: jax.Array) -> jax.Array:
        rho = aerial_manipulator.centroidal_model(
            agent, aerial_manipulator.forward_kinematics(agent, state.r + t * state.r_dot)
        ).tip_from_com
        return rho @ so3.exp(t * state.omega).T

    first = lambda t: jax.jvp(at, (t,), (jnp.ones(()),))[1]  # noqa: E731
    return jax.jvp(first, (jnp.zeros(()),), (jnp.ones(()),))[1]


@pytest.fixture(params=[(tree, seed) for tree in teams.TREES for seed in SEEDS], ids=str, scope="module")
def case(request: pytest.FixtureRequest) -> SimpleNamespace:
    tree: KinematicTree
    tree, seed = request.param
    rng = np.random.default_rng(seed)
    agent, state = teams.agent(rng, tree), teams.agent_state(rng, tree)
    arrays = take(teams.stack([agent]), 0), take(teams.stack([state]), 0)
    ours = SimpleNamespace(**all_quantities(agent, state))
    return SimpleNamespace(
        agent=agent, state=state, arrays=arrays, xi=np.r_[arrays[1].omega, arrays[1].r_dot], **vars(ours)
    )


def pinocchio(case: SimpleNamespace) -> tuple[FreeAgent, np.ndarray, np.ndarray]:
    free = FreeAgent(case.arrays[0])
    q, v = free.coordinates(case.arrays[1])
    return free, q, v


def test_reduced_mass_matrix_is_the_schur_complement_of_M0(case: SimpleNamespace) -> None:
    """`M_bar = M_rr - M_rv M_vv^-1 M_vr` (Eq. M0_partition), with M_0 from Pinocchio."""
    free, q, _ = pinocchio(case)
    order = np.array([0, 1, 2, 3, 4, 5, *(6 + free.index)])
    M = pin.crba(free.model, free.data, q)
    M = (np.triu(M) + np.triu(M, 1).T)[np.ix_(order, order)]
    schur = M[3:, 3:] - M[3:, :3] @ np.linalg.solve(M[:3, :3], M[:3, 3:])
    np.testing.assert_allclose(case.q.M_bar, schur, atol=1e-14)
    assert np.linalg.eigvalsh(np.asarray(case.q.M_bar))[0] > 0
    # couplings of errata row 3: M_vr = m d(base to CoM)/d(omega, r), in the base frame
    m, s = float(case.q.mass), np.asarray(case.s)
    np.testing.assert_allclose(M[:3, :3], m * np.eye(3), atol=1e-14)
    np.testing.assert_allclose(M[:3, 3:], m * np.hstack([-np.asarray(so3.hat(jnp.array(s))), case.J_s]), atol=1e-14)


def test_mass_matrix_and_accelerations_equal_mujoco(case: SimpleNamespace) -> None:
    gravity = np.array([0.3, -0.2, -9.81])  # has no effect on (mu, nu): it acts on the center of mass
    mujoco_agent = MujocoAgent(case.arrays[0], gravity)
    mujoco_agent.set(case.arrays[1])
    M, R = mujoco_agent.mass_matrix(), case.arrays[1].R
    schur = M[3:, 3:] - M[3:, :3] @ np.linalg.solve(M[:3, :3], M[:3, 3:])
    np.testing.assert_allclose(case.q.M_bar, schur, atol=1e-10)  # MuJoCo keeps inertias as principal axes
    np.testing.assert_allclose(M[:3, 3:], -float(case.q.mass) * R @ case.q.J_base, atol=1e-10)
    Q = np.random.default_rng(0).normal(size=len(case.xi))
    xi_dot = np.linalg.solve(np.asarray(case.q.M_bar), Q - case.h)
    np.testing.assert_allclose(xi_dot, mujoco_agent.xi_dot(Q), rtol=1e-8, atol=1e-8)


def test_bias_forces_equal_pinocchio(case: SimpleNamespace) -> None:
    """`h` from Pinocchio's inverse dynamics at the acceleration that keeps `xi` and the center of mass constant."""
    free, q, v = pinocchio(case)
    a = np.zeros(free.model.nv)
    pin.centerOfMass(free.model, free.data, q, v, a)
    a[:3] = -case.arrays[1].R.T @ free.data.acom[0]
    free.model.gravity.linear = np.zeros(3)
    tau = pin.rnea(free.model, free.data, q, v, a)
    np.testing.assert_allclose(case.h, free.to_colift(tau), atol=1e-12)


def test_tips_and_center_of_mass_equal_pinocchio(case: SimpleNamespace) -> None:
    free, q, v = pinocchio(case)
    pin.framesForwardKinematics(free.model, free.data, q)
    np.testing.assert_allclose(case.tips, [free.data.oMf[f].translation for f in free.tips], atol=1e-14)
    pin.centerOfMass(free.model, free.data, q, v)
    np.testing.assert_allclose(free.data.com[0], case.arrays[1].x, atol=1e-14)
    np.testing.assert_allclose(case.q.com_from_base, case.s, atol=1e-15)
    np.testing.assert_allclose(case.s, case.arrays[1].R.T @ (case.arrays[1].x - q[:3]), atol=1e-14)


def test_contact_jacobian(case: SimpleNamespace) -> None:
    """`B = [-hat(rho), d rho / d r]`, also of the base origin (`rho = -s`)."""
    n = case.agent.tree.arms
    np.testing.assert_allclose(case.q.J_tip[:, :, :3], -so3.hat(case.q.tip_from_com), atol=1e-15)
    np.testing.assert_allclose(case.q.J_tip[:, :, 3:], case.J_rho, atol=1e-14)
    np.testing.assert_allclose(case.q.J_base, np.hstack([so3.hat(case.s), -np.asarray(case.J_s)]), atol=1e-14)
    assert case.q.tip_from_com.shape == (n, 3)


def test_contact_acceleration(case: SimpleNamespace) -> None:
    np.testing.assert_allclose(case.kappa, case.rho_ddot, atol=1e-12)


def test_momenta_obey_the_papers_equation(case: SimpleNamespace) -> None:
    """`M_bar_dot xi - h` is the drift `(mu x omega, 1/2 xi^T dM_bar xi)` of Eq. nom_momentum."""
    np.testing.assert_allclose(case.momenta, case.q.M_bar @ case.xi, atol=1e-14)
    np.testing.assert_allclose(case.M_bar_dot @ case.xi - case.h, case.drift, atol=1e-12)


def test_drift_equals_finite_differences(case: SimpleNamespace) -> None:
    """Second row of Eq. nom_momentum by finite differences of the kinetic energy in the paper's reduced coordinates."""
    step, r, xi = 1e-5, np.asarray(case.state.r), case.xi

    def energy(offset: np.ndarray) -> float:
        return float(xi @ np.asarray(mass_matrix(case.agent, jnp.array(r + offset))) @ xi) / 2

    offsets = step * np.eye(len(r))
    central = [(energy(d) - energy(-d)) / (2 * step) for d in offsets]
    np.testing.assert_allclose(case.drift[3:], central, atol=1e-8)
    np.testing.assert_allclose(case.drift[:3], np.cross(case.momenta[:3], xi[:3]), atol=1e-14)


@jax.jit
def mass_matrix(agent: AerialManipulator, r: jax.Array) -> jax.Array:
    return aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r)).M_bar


def test_angular_momentum_equals_pinocchio(case: SimpleNamespace) -> None:
    """`mu` is the angular momentum about the center of mass, in the base frame."""
    free, q, v = pinocchio(case)
    h = pin.computeCentroidalMomentum(free.model, free.data, q, v)
    np.testing.assert_allclose(case.momenta[:3], case.arrays[1].R.T @ h.angular, atol=1e-13)
    np.testing.assert_allclose(h.linear, float(case.q.mass) * case.arrays[1].v, atol=1e-13)
