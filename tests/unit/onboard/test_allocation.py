"""Tests of allocation: the wrench is independent of internal forces (Lemma wrench_consistency), and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from colift.models import grasp
from colift.models.state import Wrench
from colift.onboard.control import allocation

SQUARE = np.array([[0.5, 0.36, 0.05], [0.5, -0.36, 0.05], [-0.5, 0.36, 0.05], [-0.5, -0.36, 0.05]])
seeds = st.integers(0, 10**6)
apply = jax.jit(allocation.allocate)
apply_to_closed = jax.jit(allocation.allocate_to_closed_contacts)


def dense_G(c: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return the grasp matrix column by column: the effect of a unit force at one contact, moment in the payload
    frame.
    """
    columns = [np.concatenate([e, np.cross(point, R.T @ e)]) for point in c for e in np.eye(3)]
    return np.array(columns).T


def contacts(rng: np.random.Generator, count: int) -> np.ndarray:
    """Random contacts about a meter apart; three or more are never nearly collinear."""
    while True:
        c = rng.uniform(-1, 1, (count, 3))
        if count < 3 or np.linalg.svd(c - c.mean(0), compute_uv=False)[1] > 0.2:
            return c


def strategy(rng: np.random.Generator, kind: str) -> tuple[np.ndarray, allocation.AllocationMap, list[int]]:
    """Random contacts with an allocation, and the rows that carry the wrench."""
    if kind == "balanced":
        c = contacts(rng, int(rng.integers(3, 7)))
        return c, allocation.least_squares_allocation(c), list(range(len(c)))
    leaders, followers = contacts(rng, int(rng.integers(3, 5))), contacts(rng, int(rng.integers(0, 4)))
    c = np.concatenate([leaders, followers])
    shuffled = rng.permutation(len(c))
    chosen = [int(np.flatnonzero(shuffled == i)[0]) for i in range(len(leaders))]
    return c[shuffled], allocation.leader_follower_allocation(c[shuffled], chosen), chosen


def draw(rng: np.random.Generator, experiment: allocation.AllocationMap) -> tuple[np.ndarray, Wrench, np.ndarray]:
    """A random attitude, wrench and internal-force input."""
    W = Wrench(F=jnp.array(10 * rng.normal(size=3)), tau=jnp.array(rng.normal(size=3)))
    return Rotation.random(random_state=rng).as_matrix(), W, 5 * rng.normal(size=experiment.nullspace.shape[1])


@pytest.mark.parametrize("kind", ["balanced", "leader_follower"])
@given(seed=seeds)
def test_wrench_is_independent_of_internal_forces(kind, seed):
    rng = np.random.default_rng(seed)
    c, experiment, _ = strategy(rng, kind)
    R, W, eta = draw(rng, experiment)
    lam = apply(experiment, jnp.array(R), W, jnp.array(eta))
    scale = max(1.0, np.abs(lam).max())
    np.testing.assert_allclose(dense_G(c, R) @ np.ravel(lam), [*W.F, *W.tau], atol=1e-12 * scale)
    again = grasp.payload_wrench(jnp.array(c), jnp.array(R), lam)
    np.testing.assert_allclose([*again.F, *again.tau], [*W.F, *W.tau], atol=1e-12 * scale)


@given(seed=seeds)
def test_least_squares_allocation_has_minimal_norm(seed):
    rng = np.random.default_rng(seed)
    c, experiment, _ = strategy(rng, "balanced")
    R, W, _ = draw(rng, experiment)
    lam = apply(experiment, jnp.array(R), W, jnp.zeros(experiment.nullspace.shape[1]))
    # G depends on R, but |lam| does not: the pseudo-inverse at R is that at I, rotated
    expected = np.linalg.pinv(dense_G(c, R)) @ np.array([*W.F, *W.tau])
    np.testing.assert_allclose(np.ravel(lam), expected, atol=1e-11 * max(1.0, np.abs(expected).max()))


@given(seed=seeds)
def test_closed_contacts_apply_the_wrench(seed):
    """The forces are those of the correction of least norm over the columns of the closed contacts."""
    rng = np.random.default_rng(seed)
    c, closed = np.concatenate([contacts(rng, 3), contacts(rng, 2)]), np.array([1.0, 1.0, 1.0, 0.0, rng.integers(2)])
    R, given_lam = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=(5, 3))
    W = Wrench(F=jnp.array(10 * rng.normal(size=3)), tau=jnp.array(rng.normal(size=3)))
    lam = np.asarray(apply_to_closed(jnp.array(c), jnp.array(closed), jnp.array(R), W, jnp.array(given_lam)))
    G, kept = dense_G(c, R), np.repeat(closed > 0, 3)
    rest = np.array([*W.F, *W.tau]) - G[:, kept] @ given_lam.ravel()[kept]
    expected = given_lam.ravel() * kept
    expected[kept] += np.linalg.pinv(G[:, kept]) @ rest
    scale = np.linalg.cond(G[:, kept]) ** 2 * np.abs(expected).max()  # regularization of 1e-9 in the normal equations
    np.testing.assert_allclose(lam.ravel(), expected, atol=1e-8 * scale)
    everywhere = apply_to_closed(jnp.array(c), jnp.ones(5), jnp.array(R), W, jnp.array(given_lam))
    np.testing.assert_array_equal(everywhere, given_lam)


@pytest.mark.parametrize("kind", ["balanced", "leader_follower"])
@given(seed=seeds)
def test_nullspace_is_an_orthonormal_basis(kind, seed):
    """The null space is an orthonormal basis of the internal forces."""
    rng = np.random.default_rng(seed)
    c, experiment, carriers = strategy(rng, kind)
    Z = np.asarray(experiment.nullspace)
    free = c if kind == "balanced" else c[[i for i in range(len(c)) if i not in carriers]]
    assert Z.shape[1] == 3 * len(free) - np.linalg.matrix_rank(dense_G(free, np.eye(3)), tol=1e-9)
    np.testing.assert_allclose(Z.T @ Z, np.eye(Z.shape[1]), atol=1e-12)
    assert np.abs(dense_G(c, np.eye(3)) @ Z).max(initial=0) < 1e-12
    if kind == "leader_follower":
        assert not Z.reshape(len(c), 3, -1)[carriers].any()


@given(seed=seeds)
def test_only_leaders_carry_the_wrench(seed):
    rng = np.random.default_rng(seed)
    c, experiment, leaders = strategy(rng, "leader_follower")
    R, W, eta = draw(rng, experiment)
    lam = np.asarray(apply(experiment, jnp.array(R), W, jnp.array(eta)))
    quiet = np.asarray(apply(experiment, jnp.array(R), W, jnp.zeros(len(eta))))
    followers = [i for i in range(len(c)) if i not in leaders]
    np.testing.assert_allclose(lam[leaders], quiet[leaders], atol=1e-12)
    assert not quiet[followers].any()


@given(seed=seeds)
def test_coordinates_of_an_internal_force_are_recovered(seed):
    rng = np.random.default_rng(seed)
    c, experiment, _ = strategy(rng, "balanced")
    pairs = [(0, 1, rng.normal()), (1, 2, rng.normal()), (0, 2, 1.0)]
    lam = allocation.squeeze(c, pairs)
    np.testing.assert_allclose(dense_G(c, np.eye(3)) @ lam.ravel(), 0, atol=1e-12)
    eta = allocation.internal_force_coordinates(experiment, lam)
    np.testing.assert_allclose(np.asarray(experiment.nullspace) @ eta, lam.ravel(), atol=1e-12)


def test_squeeze_force_presses_contacts_together():
    lam = allocation.squeeze(SQUARE, [(0, 2, 1.5)])
    np.testing.assert_allclose(lam[[0, 2]], [[-1.5, 0, 0], [1.5, 0, 0]])
    assert not lam[[1, 3]].any()


def test_leader_block_without_full_rank_is_refused():
    """A leader block that cannot carry every wrench is refused with its rank."""
    for leaders, rank in (([0], 3), ([0, 3], 5)):
        with pytest.raises(ValueError, match=rf"leader block \(contacts .*rank {rank}.*rank 6"):
            allocation.leader_follower_allocation(SQUARE, leaders)
    row = np.outer([0, 1, 2, 3], [1.0, 0.2, 0])
    with pytest.raises(ValueError, match=r"leader block.*rank 5"):
        allocation.leader_follower_allocation(np.concatenate([row, SQUARE]), [0, 1, 2])
    with pytest.raises(ValueError, match=r"the grasp .*rank 5"):
        allocation.least_squares_allocation(row)


@pytest.mark.parametrize("leaders", [[0, 1, 1], [0, 1, 4], [-1, 0, 1]])
def test_leaders_must_exist_and_be_named_once(leaders):
    with pytest.raises(ValueError, match="each must be one of 0 to 3, without repetition"):
        allocation.leader_follower_allocation(SQUARE, leaders)


def test_leader_follower_split_without_internal_force():
    """On two agents with two arms the paper's split leaves no internal force, which the error states."""
    experiment = allocation.leader_follower_allocation(SQUARE, [0, 1, 2])
    assert experiment.nullspace.shape == (12, 0)
    with pytest.raises(ValueError, match=r"no internal force.*; use three or more follower contacts"):
        allocation.internal_force_coordinates(experiment, allocation.squeeze(SQUARE, [(0, 2, 1.0)]))


def test_force_outside_the_nullspace_is_refused():
    """An internal force outside the null space is refused with its size."""
    experiment = allocation.leader_follower_allocation(np.concatenate([SQUARE[:3], -SQUARE[:3]]), [0, 1, 2])
    with pytest.raises(ValueError, match=r"outside the null space of the allocation \(by up to 1 N\)"):
        allocation.internal_force_coordinates(
            experiment, allocation.squeeze(np.concatenate([SQUARE[:3], -SQUARE[:3]]), [(0, 2, 1.0)])
        )
    with pytest.raises(ValueError, match="outside the null space of the allocation"):
        allocation.internal_force_coordinates(allocation.least_squares_allocation(SQUARE), np.ones((4, 3)))


def test_follower_offset_must_be_internal():
    c = np.concatenate([SQUARE[:3], -SQUARE[:3]])
    lam_f0 = allocation.squeeze(-SQUARE[:3], [(0, 1, 2.0), (1, 2, -0.7)])
    experiment = allocation.leader_follower_allocation(c, [0, 1, 2], lam_f0)
    W = Wrench(F=jnp.array([1.0, 2, 3]), tau=jnp.array([0.1, 0.2, 0.3]))
    eta = jnp.zeros(experiment.nullspace.shape[1])
    R = Rotation.from_euler("xyz", [0.3, -0.4, 0.5]).as_matrix()
    lam = np.asarray(apply(experiment, jnp.array(R), W, eta))
    np.testing.assert_allclose(lam[3:], lam_f0 @ R.T, atol=1e-12)
    np.testing.assert_allclose(dense_G(c, R) @ lam.ravel(), [*W.F, *W.tau], atol=1e-12)
    with pytest.raises(ValueError, match="not an internal force: its wrench on the payload is"):
        allocation.leader_follower_allocation(c, [0, 1, 2], lam_f0 + np.array([0, 0, 0.1]))
    with pytest.raises(ValueError, match="one force for each of the 3 follower contacts"):
        allocation.leader_follower_allocation(c, [0, 1, 2], lam_f0[:2])


@given(seed=seeds)
def test_rotor_allocation_minimizes_forces_and_yaw_torques(seed):
    """The expected forces eliminate `G lam = W` and solve a dense least-squares problem in internal forces."""
    rng = np.random.default_rng(seed)
    c, agents = contacts(rng, int(rng.integers(3, 7))), int(rng.integers(1, 4))
    yaw = allocation.YawTorques(rng.normal(size=(agents, 3 * len(c))), float(rng.uniform(0.01, 1)))
    W, f, found = rng.normal(size=6), rng.normal(size=agents), allocation.rotor_allocation(c, yaw)
    lam = np.asarray(found.right_inverse) @ W + np.asarray(found.yaw_gain) @ f
    G = dense_G(c, np.eye(3))
    particular, Z = np.linalg.pinv(G) @ W, np.asarray(found.nullspace)
    A = np.vstack([np.eye(3 * len(c)), yaw.levers / yaw.moment_ratio])
    b = np.concatenate([np.zeros(3 * len(c)), f / yaw.moment_ratio])
    internal = np.linalg.lstsq(A @ Z, b - A @ particular, rcond=None)[0]
    np.testing.assert_allclose(lam, particular + Z @ internal, atol=1e-6 * (1 + np.abs(lam).max()))
    np.testing.assert_allclose(G @ lam, W, atol=1e-8 * (1 + np.abs(lam).max()))
