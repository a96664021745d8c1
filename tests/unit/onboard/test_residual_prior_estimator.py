"""Tests of contact forces from the equations of motion with a Gaussian prior of the residuals."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.stats

from colift.math import filters
from colift.models import aerial_manipulator, grasp
from colift.models.parameters import Team
from colift.models.state import State, zero_residual
from colift.onboard.estimation import contact_forces
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam

STRUCTURE = ((teams.WAIST_TWO_ARMS, 2), (teams.CHAIN, 1))
RNG_SEED = 44
FORCE_STD = 30.0  # N, of the contact forces


def random_spd(rng: np.random.Generator, scales: np.ndarray) -> np.ndarray:
    A = rng.normal(size=(len(scales), 2 * len(scales)))
    return scales[:, None] * (A @ A.T / A.shape[1]) * scales[None]


class Case:
    """A team in a random grasp with random priors, as dense matrices of the Bayesian linear model."""

    def __init__(self, kind: str) -> None:
        rng = np.random.default_rng(RNG_SEED)
        team, z = PinocchioTeam(teams.team(rng, STRUCTURE)).on_grasp(teams.free_state(rng, STRUCTURE))
        self.team: Team = team
        self.z: State = z
        self.J, self.A = [], []
        for group, q in zip(team.agent_groups, z.agents, strict=True):
            jacobians = []
            for j in range(len(q.x)):
                agent = jax.tree.map(lambda x, j=j: x[j], group)
                g = aerial_manipulator.forward_kinematics(agent, q.r[j])
                p = aerial_manipulator.centroidal_model(agent, g)
                jacobians.append(p.J_tip)
                J = np.asarray(p.J_tip)
                # moments of unit contact forces, one at a time
                columns = [
                    np.concatenate([e, J[b].T @ np.asarray(q.R[j]).T @ e]) for b in range(len(J)) for e in np.eye(3)
                ]
                self.A.append(np.stack(columns, axis=1))
            self.J.append(jnp.stack(jacobians))
        c = np.asarray(grasp.contact_points(team))
        R_L = np.asarray(z.payload.R)
        self.G = np.hstack([np.vstack([np.eye(3), np.cross(p, R_L.T, axisa=0, axisb=0, axisc=0)]) for p in c])
        self.S = [random_spd(rng, np.r_[np.ones(3), np.full(A.shape[0] - 3, 0.1)]) for A in (self.A[0], self.A[2])]
        self.N = [random_spd(rng, np.r_[np.full(3, 0.2), np.full(len(S) - 3, 0.05)]) for S in self.S]
        self.S_L = random_spd(rng, np.array([2.0, 2, 2, 0.4, 0.4, 0.4])) if kind == "least_squares" else None
        self.estimator = contact_forces.ResidualPriorEstimator(
            agent_information=tuple(jnp.asarray(np.linalg.inv(S)) for S in self.S),
            payload_information=None if self.S_L is None else jnp.asarray(np.linalg.inv(self.S_L)),
            contact_force_std=jnp.asarray(FORCE_STD),
            noise=tuple(jnp.tile(N, (size, 1, 1)) for N, size in zip(map(jnp.asarray, self.N), (2, 1), strict=True)),
        )

    def balance(self, y: np.ndarray, y_L: np.ndarray) -> contact_forces.TeamBalance:
        """Return the equations of motion with stacked residuals of all agents and that of the payload."""
        out, start = [], 0
        for group, q, J in zip(self.team.agent_groups, self.z.agents, self.J, strict=True):
            outputs = 6 + group.tree.joints
            stop = start + outputs * len(q.x)
            out.append(
                contact_forces.AgentBalance(
                    R=q.R,
                    y=jnp.asarray(y[start:stop].reshape(-1, outputs)),
                    J_tip=J,
                    measured=jnp.zeros_like(group.contact_position),
                    x=jnp.zeros((len(q.x), 18 + 2 * group.tree.joints)),
                )
            )
            start = stop
        return contact_forces.TeamBalance(
            agents=tuple(out),
            payload=contact_forces.PayloadBalance(R=self.z.payload.R, y=jnp.asarray(y_L)),
            reading_age=jnp.zeros(()),
            f_hat=zero_residual(self.team),
        )

    def estimate(self, y: np.ndarray, y_L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return contact forces in the world frame and their covariance."""
        found = self.estimator.estimate(self.team, self.balance(y, y_L))
        assert found.covariance is not None
        world = [
            lam @ np.asarray(q.R).transpose(0, 2, 1) for lam, q in zip(found.base_frame, self.z.agents, strict=True)
        ]
        return np.concatenate([w.reshape(-1) for w in world]), np.asarray(found.covariance)


@pytest.mark.parametrize("kind", ["momentum_observer", "least_squares"])
def test_estimate_is_that_of_the_bayesian_linear_model(kind):
    """Kay 1993, Theorem 11.1, with dense matrices; and the covariance of 500 draws of residuals and noise."""
    case, rng = Case(kind), np.random.default_rng(RNG_SEED + 1)
    A, S = scipy.linalg.block_diag(*case.A), scipy.linalg.block_diag(case.S[0], case.S[0], case.S[1])
    N = scipy.linalg.block_diag(case.N[0], case.N[0], case.N[1])
    H = A.T @ np.linalg.inv(S) @ A + np.eye(A.shape[1]) / FORCE_STD**2
    if case.S_L is not None:
        H = H + case.G.T @ np.linalg.inv(case.S_L) @ case.G
    P = np.linalg.inv(H)
    K = P @ A.T @ np.linalg.inv(S)
    nees = []
    for draw in range(100):
        f = rng.multivariate_normal(np.zeros(len(S)), S)
        f_L = np.zeros(6) if case.S_L is None else rng.multivariate_normal(np.zeros(6), case.S_L)
        lam = FORCE_STD * rng.normal(size=A.shape[1])
        y, y_L = f - A @ lam + rng.multivariate_normal(np.zeros(len(N)), N), f_L + case.G @ lam
        found, covariance = case.estimate(y, y_L)
        if draw == 0:
            expected = -K @ y + (0 if case.S_L is None else P @ case.G.T @ np.linalg.solve(case.S_L, y_L))
            np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)
            np.testing.assert_allclose(covariance, P + K @ N @ K.T, rtol=1e-8, atol=1e-8)
        nees.append((found - lam) @ np.linalg.solve(covariance, found - lam))
    interval = scipy.stats.chi2.interval(0.95, 100 * len(P))
    assert interval[0] < sum(nees) < interval[1]


def test_a_known_residual_gives_the_true_contact_forces():
    """With tight priors about the true residuals the estimate is exact; without contact the forces are zero."""
    case, rng = Case("momentum_observer"), np.random.default_rng(RNG_SEED + 2)
    A = scipy.linalg.block_diag(*case.A)
    lam = rng.normal(size=A.shape[1])
    found, _ = case.estimate(-A @ lam, np.zeros(6))
    np.testing.assert_allclose(found, lam, atol=0.02)  # the prior of the contact forces shrinks weak directions
    free = contact_forces.FreeFlight().estimate(case.team, case.balance(-A @ lam, np.zeros(6)))
    assert all(not np.asarray(x).any() for x in free.base_frame)


def test_momentum_observer_is_a_first_order_filter():
    """De Luca 2006: `r = K (p - p_0 - integral (known + r))` with `K = b / dt` is the first-order filter."""
    rng, dt = np.random.default_rng(RNG_SEED + 3), 0.002
    b = float(filters.smoothing_factor(jnp.asarray(50.0), jnp.asarray(dt)))
    p, known = np.cumsum(rng.normal(size=200)), rng.normal(size=200)
    K, r, integral, filtered = b / dt, 0.0, 0.0, 0.0
    for k in range(1, 200):
        filtered += b * ((p[k] - p[k - 1]) / dt - known[k] - filtered)
        integral += dt * (known[k] + r)
        r = K * (p[k] - p[0] - integral)
        assert r == pytest.approx(filtered, abs=1e-9 * max(1, abs(filtered)))
