"""Tests of contact forces from the agents' equations of motion, and of payload labels without tip readings."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight, signals
from colift.models import aerial_manipulator
from colift.models.measurement import Measurement
from colift.models.parameters import KinematicTree, Team
from colift.models.state import AgentInput, ResidualForces, flatten_agent_force, zero_residual
from colift.onboard.estimation import contact_forces, state_estimator
from colift.scenario import experiment
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams
from tests.support import small_team as light
from tests.support.pinocchio_team import PinocchioTeam
from tests.unit.onboard import test_state_estimator as estimation

PLANAR_ARM = KinematicTree(parents=(0,), prismatic=(False,), tip_bodies=(1,))
STRUCTURES = {
    "one arm": ((teams.CHAIN, 1),),
    "one planar arm": ((PLANAR_ARM, 2),),
    "no joints": ((teams.RIGID, 1),),
    "two arms": ((teams.WAIST_TWO_ARMS, 2),),
    "two sliding arms": ((teams.SLIDING_ARMS, 1),),
}


def random_forces(team: Team, rng: np.random.Generator, scale: float = 1.0) -> ResidualForces:
    return jax.tree.map(lambda x: jnp.asarray(scale * rng.normal(size=x.shape)), zero_residual(team))


def agents_at_random(
    structure: tuple, seed: int
) -> tuple[Team, list[tuple[jax.Array, jax.Array, jax.Array, jax.Array]]]:
    """Return Jacobian, attitude, generalized contact force and contact forces of each agent of a moving team.

    The contact forces are those of the constrained dynamics with random residuals and inputs. The generalized contact
    force is the residual minus that of the same motion without contact forces.
    """
    rng = np.random.default_rng(seed)
    team, z = PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))
    inputs = tuple(
        AgentInput(
            u=jnp.asarray(rng.uniform(10, 20, size)),
            tau=jnp.asarray(rng.normal(size=(size, 3))),
            tau_r=jnp.asarray(rng.normal(size=(size, group.tree.joints))),
        )
        for size, group in zip(team.sizes, team.agent_groups, strict=True)
    )
    f = random_forces(team, rng)
    a, lam = jax.jit(contact_dynamics.forward_dynamics)(team, z, inputs, f)
    modelled = signals.true_residual(team, z, a, jax.tree.map(jnp.zeros_like, lam), inputs)
    found = []
    for group, q, f_k, m_k, lam_k in zip(team.agent_groups, z.agents, f.agents, modelled.agents, lam, strict=True):
        A_lam = flatten_agent_force(f_k) - flatten_agent_force(m_k)
        for j in range(len(q.x)):
            agent = jax.tree.map(lambda x, j=j: x[j], group)
            p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r[j]))
            found.append((p.J_tip, q.R[j], A_lam[j], lam_k[j]))
    return team, found


@pytest.mark.parametrize("kind", STRUCTURES)
def test_reconstructed_contact_forces_are_the_true_ones(kind):
    """With the exact model and the exact residual; regularization affects the differences of arms alone."""
    _, agents = agents_at_random(STRUCTURES[kind], seed=3)
    for J_tip, R, A_lam, lam in agents:
        found = contact_forces.reconstruct_contact_forces(J_tip, R, A_lam, 1e-4) @ R.T
        np.testing.assert_allclose(found, lam, rtol=1e-4, atol=1e-4)
        regularized = contact_forces.reconstruct_contact_forces(J_tip, R, A_lam) @ R.T
        np.testing.assert_allclose(regularized.sum(0), lam.sum(0), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(regularized, lam, atol=0.02 * np.abs(lam).max())


def test_undetermined_differences_of_arms_are_zero():
    """Two arms of a rigid body: the moment does not contain forces along the line between their tips."""
    tips = np.array([[0.3, 0.0, -0.1], [-0.3, 0.0, -0.1]])
    J_tip = jnp.asarray(np.stack([np.cross(tip, np.eye(3)) for tip in tips]))  # of the moment `tip x lam`
    lam = np.array([[1.0, -2.0, 5.0], [4.0, 3.0, 8.0]])
    A_lam = jnp.asarray(np.concatenate([lam.sum(0), np.cross(tips, lam).sum(0)]))
    found = np.asarray(contact_forces.reconstruct_contact_forces(J_tip, jnp.eye(3), A_lam))
    np.testing.assert_allclose(found.sum(0), lam.sum(0), atol=1e-12)
    np.testing.assert_allclose(found[:, 0], lam[:, 0].mean(), atol=1e-9)
    np.testing.assert_allclose(found[:, 1:], lam[:, 1:], atol=0.02)


@pytest.mark.parametrize("kind", STRUCTURES)
def test_moment_labels_without_tip_readings(kind):
    """The label is the true residual; moments of differences between the arms have the compensated residual instead.

    The projection on these moments is computed by a singular value decomposition.
    """
    _, agents = agents_at_random(STRUCTURES[kind], seed=5)
    rng, informative = np.random.default_rng(6), 0
    for J_tip, R, A_lam, _ in agents:
        J = np.asarray(contact_forces.contact_jacobian(J_tip))
        f, e = rng.normal(size=len(J)), rng.normal(size=len(J))
        y = f - np.asarray(A_lam)[3:]  # moments of `f = y + A lam`
        f_hat = np.concatenate([np.asarray(A_lam)[:3], f + e - y])  # exact force, moments with the error e
        label = y + J @ np.asarray(
            contact_forces.reconstruct_contact_forces(J_tip, R, jnp.asarray(f_hat), contact_forces.LABEL_MIN_LEVER)
        ).reshape(-1)
        each = J.reshape(len(J), -1, 3)
        U, s, _ = np.linalg.svd((each - each.mean(1, keepdims=True)).reshape(len(J), -1))
        P = (U[:, : len(s)] * (s > 1e-6)) @ U[:, : len(s)].T
        np.testing.assert_allclose(label - f, P @ e, atol=1e-3)
        informative += np.trace(np.eye(len(J)) - P)
    assert informative >= 3


def test_open_contacts_bear_no_reconstructed_force():
    """The closed contact bears the whole force, and the label of the moments is exact; without contacts it is zero."""
    _, agents = agents_at_random(STRUCTURES["two arms"], seed=8)
    J_tip, R, _, _ = agents[0]
    rng = np.random.default_rng(9)
    force, e, y = rng.normal(size=3), rng.normal(size=J_tip.shape[-1]), rng.normal(size=J_tip.shape[-1])
    closed = jnp.array([0.0, 1.0])
    exact = np.asarray(J_tip[1].T @ (R.T @ force))
    A_lam = jnp.asarray(np.concatenate([force, exact + e - y]))
    for min_lever in (contact_forces.MIN_LEVER, contact_forces.LABEL_MIN_LEVER):
        lam = contact_forces.reconstruct_contact_forces(J_tip, R, A_lam, min_lever, closed)
        np.testing.assert_allclose(lam @ R.T, np.stack([np.zeros(3), force]), atol=1e-9)
        np.testing.assert_allclose(contact_forces.contact_jacobian(J_tip) @ lam.reshape(-1), exact, atol=1e-9)
        free = contact_forces.reconstruct_contact_forces(J_tip, R, A_lam, min_lever, jnp.zeros(2))
        np.testing.assert_array_equal(free, 0.0)


# Estimates without tip readings ---------------------------------------------------------------------------------------


def estimates(
    age: float, seed: int | None = None, e: ResidualForces | None = None
) -> tuple[Team, state_estimator.StateEstimate, state_estimator.EstimatorState, ResidualForces]:
    """Return estimates of noisy readings with tip readings of an age.

    The compensated residual has the error e, which is random for a seed, and otherwise zero.
    """
    team, _, _, stream = estimation.steady_stream()
    rng = np.random.default_rng(4)
    noisy = jax.tree.map(lambda x: x + 0.01 * jnp.array(rng.normal(size=x.shape)), stream)

    def prepared(m: Measurement, exact: Measurement) -> Measurement:
        """Return a reading with exact attitudes, which remain rotations, and with the age of the tip readings."""
        return dataclasses.replace(
            m,
            measurement_age_s={"agents.lam": jnp.array(age)},
            payload=dataclasses.replace(m.payload, R=exact.payload.R),
            agents=tuple(dataclasses.replace(a, R=b.R) for a, b in zip(m.agents, exact.agents, strict=True)),
        )

    noisy = jax.vmap(prepared)(noisy, stream)
    if e is None:
        e = zero_residual(team) if seed is None else random_forces(team, np.random.default_rng(seed))
    f_hat = jax.tree.map(jnp.add, random_forces(team, np.random.default_rng(0)), e)
    estimate, state = estimation.run_estimator(team, estimation.FILTERS, noisy, estimation.constant_inputs(), f_hat)
    return team, estimate, state, e


def test_sum_of_forces_is_exact_without_tip_readings():
    """An error of the compensated residuals changes the payload's label by the opposite sum of forces."""
    _, exact, _, _ = estimates(age=1.0)
    _, wrong, _, e = estimates(age=1.0, seed=1)
    change = np.asarray(wrong.sample.unfiltered[0]) - np.asarray(exact.sample.unfiltered[0])
    np.testing.assert_allclose(change[:, :3] + np.asarray(e.agents[0].f_x).sum(0), 0.0, atol=1e-9)
    assert np.abs(change[:, :3]).min() > 0.1
    assert not np.any(exact.sample.valid)


def test_recent_tip_readings_are_used_as_measured():
    """The compensated residuals have no influence while tip readings are recent."""
    _, exact, _, _ = estimates(age=0.02)
    _, wrong, _, _ = estimates(age=0.02, seed=1)
    jax.tree.map(np.testing.assert_array_equal, exact, wrong)
    assert np.all(exact.sample.valid)


def test_training_samples_are_held_without_tip_readings():
    """The payload's label before the filter continues; the filtered inputs and labels of samples do not."""
    _, estimate, _, _ = estimates(age=1.0)
    y, (x, held) = estimate.sample.unfiltered[0], estimate.sample.payload
    assert np.abs(np.diff(y, axis=0)).max(axis=1).min() > 0
    for signal in (held, x):
        np.testing.assert_allclose(signal, np.broadcast_to(signal[0], signal.shape), atol=1e-12)


def test_undetermined_moments_have_the_compensated_label():
    """Errors of the compensated moments change the labels by their projection, which is idempotent."""
    team, exact, _, _ = estimates(age=1.0)
    label = np.asarray(exact.sample.unfiltered[1][0])[-1]

    def change(moments: np.ndarray) -> np.ndarray:
        zero = zero_residual(team)
        f = dataclasses.replace(zero.agents[0], f_w=jnp.asarray(moments[:, :3]), f_r=jnp.asarray(moments[:, 3:]))
        _, wrong, _, _ = estimates(age=1.0, e=dataclasses.replace(zero, agents=(f,)))
        return np.asarray(wrong.sample.unfiltered[1][0])[-1] - label

    moments = np.random.default_rng(7).normal(size=label[:, 3:].shape)
    once = change(moments)
    np.testing.assert_allclose(once[:, :3], 0.0, atol=1e-12)
    assert 0.1 < np.linalg.norm(once) < 0.9 * np.linalg.norm(moments)
    np.testing.assert_allclose(change(once[:, 3:]), once, atol=1e-5)


# Flights --------------------------------------------------------------------------------------------------------------


def test_payload_correction_continues_without_tip_readings():
    """After the loss of all tip sensors the payload's correction follows the residual, and the agents' one decays."""
    failure = 0.6
    lost = {"kind": "intermittent", "channels": ["agents.lam"], "rate_Hz": 500, "failure_time_s": failure}
    base = light.settings()
    sensors = base.sensors.model_validate(base.sensors.model_dump() | {"models": [lost]})
    plan = experiment.make_experiment(light.settings(sensors=sensors), "adaptive")
    rows = flight.run_experiment(dataclasses.replace(plan, duration=2.0)).records
    late = rows.t > failure + 0.1
    assert not rows.label_valid[late].any()
    assert rows.label_valid[rows.t < failure].all()
    np.testing.assert_array_equal(np.asarray(rows.correction_weight_L)[late], 1.0)
    assert np.asarray(rows.correction_weight_x)[late][-1].max() < 1
    assert np.abs(np.diff(np.asarray(rows.correction_L)[late, :3], axis=0)).max(axis=1).min() > 0
    total = np.asarray(rows.f_L)[:, :3] - rows.f_L_hat[:, :3] + (np.asarray(rows.f_x) - rows.f_x_hat).sum(1)
    assert np.sqrt((total[late] ** 2).mean()) < 0.15
    assert np.abs(np.asarray(rows.lam_hat) - rows.lam)[late].max() < 1.0
