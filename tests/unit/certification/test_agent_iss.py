"""Tests of the agent layer: algebraic gains against the plant, peak gains against simulations."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from colift.certification import agent_iss, peak_gain
from colift.closed_loop import linearization
from colift.closed_loop.linearization import OUTPUTS, LinearizedLoop
from colift.models import grasp
from colift.models.state import ResidualForces
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams
from tests.unit.onboard.test_control import STRUCTURES, commands, solve_aligned, task

seeds = st.integers(0, 2**31)
accelerate = jax.jit(contact_dynamics.forward_dynamics)


# Static part ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("structure", "seed"), [(1, 1), (1, 2), *(pytest.param(2, seed, marks=pytest.mark.long) for seed in (3, 4))]
)
def test_mismatch_and_acceleration_error_are_linear(structure, seed):
    """A moving team under the control law with exact states, residuals, and thrusts off their direction.

    `aligned` gives the lateral part of `f_des` by what it does: the forces that restore the commanded contact forces.
    """
    problem = task(seed, STRUCTURES[structure])
    rng, inputs = np.random.default_rng(seed), commands(problem)
    _, _, lateral = solve_aligned(problem, inputs)
    unknown = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), problem.f)  # f - f_hat
    total = jax.tree.map(jnp.add, problem.f, unknown)
    a, lam = accelerate(problem.team, problem.z, inputs, total)

    parts, first = [], 0
    for f, q in zip(unknown.agents, problem.z.agents, strict=True):
        size = len(f.f_x)
        d = lateral[2 * first : 2 * (first + size)].reshape(size, 2)
        tilted = np.einsum("jik,jk->ji", np.asarray(q.R)[:, :, :2], d)
        parts.append(dataclasses.replace(f, f_x=f.f_x - jnp.asarray(tilted)))
        first += size
    left = np.asarray(linearization.flatten(ResidualForces(agents=tuple(parts), payload=unknown.payload)))

    D, K = (np.asarray(x) for x in agent_iss.algebraic_gain(problem.team, problem.z))
    R, c = np.asarray(problem.z.payload.R), np.asarray(grasp.contact_points(problem.team))
    forces = np.concatenate([np.asarray(x).reshape(-1, 3) for x in lam])
    requested = np.concatenate([np.asarray(share.lam).reshape(-1, 3) for share in problem.shares])
    missed = np.concatenate([(forces - requested).sum(0), np.cross(c, (forces - requested) @ R).sum(0)])
    error = np.asarray(a.payload) - np.concatenate([problem.to.a, problem.to.alpha])
    scale = np.abs(K) @ np.abs(left)
    assert np.abs(missed).max() > 0.1
    np.testing.assert_allclose(missed, K @ left, atol=1e-9 * scale.max())
    np.testing.assert_allclose(error, D @ left, atol=1e-9 * (np.abs(D) @ np.abs(left)).max())


@functools.cache
def equilibrium_gains() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the payload's columns of D and K, and its mass matrix, of the reference team on its grasp."""
    team = teams.reference_team()
    z = contact_dynamics.consistent_initial_state(team, teams.reference_guess())
    D, K = (np.asarray(x)[:, :6] for x in agent_iss.algebraic_gain(team, z))
    M_L = np.diag([1.5, 1.5, 1.5, 0.04, 0.15, 0.18])
    return D, K, M_L


def test_payload_residual_is_shared_by_mass():
    """`D_L = (M_L + M_A)^-1`, `K_L = -M_A (M_L + M_A)^-1` with M_A symmetric and positive, as large as the agents'
    mass.
    """
    D, K, M_L = equilibrium_gains()
    M_A = np.linalg.inv(D) - M_L
    np.testing.assert_allclose(M_A, M_A.T, atol=1e-9)
    assert np.linalg.eigvalsh(M_A).min() > 0
    np.testing.assert_allclose(K, -M_A @ D, atol=1e-10)
    assert M_A[2, 2] == pytest.approx(2 * 1.84, rel=0.05)  # vertical motion does not change the agents' configuration


def test_vertical_gain_of_the_reference_team():
    _, K, _ = equilibrium_gains()
    assert K[2, 2] == pytest.approx(-0.71, abs=0.005)


# Dynamic part ---------------------------------------------------------------------------------------------------------


BODIES = (slice(0, 6), slice(6, 10), slice(10, 13))


def loop(seed: int) -> LinearizedLoop:
    """Return a random stable response with three bodies."""
    rng, states = np.random.default_rng(seed), 4
    A = rng.normal(size=(states, states))
    A -= (np.linalg.eigvals(A).real.max() + rng.uniform(0.5, 1.5)) * np.eye(states)
    rows = sum(OUTPUTS.values())
    B, C, D = (rng.normal(size=shape) for shape in ((states, 13), (rows, states), (rows, 13)))
    return LinearizedLoop(A=A, B=B, C=C, D=0.3 * D, basis=np.eye(states), bodies=BODIES)


def simulated(found: LinearizedLoop, f: np.ndarray, step: float) -> np.ndarray:
    """Return delta_W before and after each step of held inputs, by the matrix exponential."""
    n = len(found.A)
    both = expm(np.block([[found.A, found.B], [np.zeros((13, n + 13))]]) * step)
    rows, x, y = found.output_rows("delta_W"), np.zeros(n), []
    for now in f:
        y.append(found.C[rows] @ x + found.D[rows] @ now)
        x = both[:n, :n] @ x + both[:n, n:] @ now
        y.append(found.C[rows] @ x + found.D[rows] @ now)
    return np.array(y)


@given(seeds)
@settings(max_examples=6)
def test_bounded_residuals_do_not_exceed_the_sum(seed):
    """The response to bounded residuals stays below the sum over bodies."""
    rng, found, step = np.random.default_rng(seed), loop(seed), 0.05
    layer = agent_iss.agent_iss_constants(found, np.array([0.1, 0.2]))
    np.testing.assert_array_equal(layer.vartheta, [0.1, 0.2])
    rho = rng.uniform(0.1, 2, 3)
    closest = 0.0
    for dwell in (1, 10, 40, 400):
        raw = np.repeat(rng.normal(size=(400 // dwell, 13)), dwell, axis=0)
        f = np.concatenate(
            [
                r * raw[:, c] / np.linalg.norm(raw[:, c], axis=1, keepdims=True)
                for r, c in zip(rho, BODIES, strict=True)
            ],
            axis=1,
        )
        y = simulated(found, f, step)
        for index, part in enumerate((y[:, :3], y[:, 3:])):
            share = np.linalg.norm(part, axis=1).max() / (layer.kappa[index] @ rho)
            assert share <= 1
            closest = max(closest, share)
    assert closest > 0.25  # random inputs are close to the bound


@given(seeds)
@settings(max_examples=4)
def test_each_gain_is_attained(seed):
    """Each gain is attained by an input of its body and is at least the direct and the steady-state gain."""
    found = loop(seed)
    layer, rows = agent_iss.agent_iss_constants(found, np.zeros(2)), found.output_rows("delta_W")
    steady = found.D[rows] - found.C[rows] @ np.linalg.solve(found.A, found.B)
    for index, part in enumerate((slice(0, 3), slice(3, 6))):
        for b, columns in enumerate(BODIES):
            at_once = np.linalg.norm(found.D[rows][part, columns], 2)
            assert layer.static[index, b] == pytest.approx(at_once, rel=1e-12)
            assert layer.kappa[index, b] >= max(at_once, np.linalg.norm(steady[part, columns], 2))
            n = columns.stop - columns.start
            C, D = found.C[rows][part], found.D[rows][part, columns]
            worst = peak_gain.peak_gain_continuous(found.A, found.B[:, columns], C, D, [n], [1.0])
            f = np.zeros((len(worst.inputs), 13))
            f[:, columns] = worst.inputs
            y = simulated(found, f, worst.step)[-2, part]  # the last input acts through D alone
            assert np.linalg.norm(y) >= 0.99 * layer.kappa[index, b]


@given(seeds)
@settings(max_examples=8)
def test_transients_stay_below_their_bound(seed):
    """On a finer time grid than that of the computation; gamma is below the slowest rate."""
    found = loop(seed)
    layer, rows = agent_iss.agent_iss_constants(found, np.zeros(2)), found.output_rows("delta_W")
    slowest = -np.linalg.eigvals(found.A).real.max()
    assert 0 < layer.gamma < slowest
    step = 0.013 / np.abs(np.linalg.eigvals(found.A)).max()
    power, state = expm(found.A * step), np.eye(len(found.A))
    greatest = np.zeros(2)
    for k in range(3000):
        y = found.C[rows] @ state
        sizes = [np.linalg.norm(y[part], 2) for part in (slice(0, 3), slice(3, 6))]
        greatest = np.maximum(greatest, np.exp(layer.gamma * k * step) * np.array(sizes))
        state = power @ state
    assert (greatest <= layer.alpha).all()
    assert (greatest >= 0.9 * layer.alpha).all()


def test_unstable_loop_is_refused():
    found = loop(0)
    with pytest.raises(ValueError, match="unstable"):
        agent_iss.agent_iss_constants(dataclasses.replace(found, A=found.A + 3 * np.eye(4)), np.zeros(2))


def test_vertical_payload_force_agrees_with_statics():
    """A vertical force on the payload accelerates 1.5 kg of payload and the mass of the agents."""
    D, K, _ = equilibrium_gains()
    F = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    assert (D @ F)[2] == pytest.approx(1 / (1.5 + 3.68), rel=0.02)
    assert (K @ F)[2] == pytest.approx(1.5 * (D @ F)[2] - 1, rel=1e-9)
