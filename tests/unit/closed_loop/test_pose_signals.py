"""Quaternions that do not jump, and origins of bases."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.closed_loop import pose_signals
from colift.models import aerial_manipulator
from tests.support import random_logs as flights


@pytest.mark.parametrize("ticks", [1, pose_signals.BATCH, 3 * pose_signals.BATCH + 7])
def test_quaternions_are_continuous_over_several_turns(ticks):
    rng = np.random.default_rng(1)
    axis = np.array([[0.6, 0.0, 0.8], [-1.0, 0.0, 0.0]])
    angle = np.linspace(0.3, 0.3 + 0.02 * ticks, ticks)  # some five turns in the longest
    turns = Rotation.from_rotvec((angle[:, None, None] * axis).reshape(-1, 3)) * Rotation.random(random_state=rng)
    R = turns.as_matrix().reshape(ticks, 2, 3, 3)
    q = pose_signals.continuous_quaternions(R)
    assert q.shape == (ticks, 2, 4)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=1e-14)
    back = Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).as_matrix()
    np.testing.assert_allclose(back, R.reshape(-1, 3, 3), atol=1e-14)
    assert (q[0, :, 0] >= 0).all()
    assert np.abs(np.diff(q, axis=0)).max(initial=0.0) < 0.011
    if ticks > 1000:
        assert (q[:, :, 0].min(axis=0) < -0.5).all()  # of the formula, w is never negative


def test_a_value_that_is_not_finite_stays_at_its_tick():
    R = Rotation.from_rotvec(np.linspace(0, 9, 400)[:, None] * [0, 0, 1]).as_matrix()
    R[-1] = np.nan  # a flight that failed
    q = pose_signals.continuous_quaternions(R)
    assert np.isnan(q[-1]).all()
    assert np.abs(np.diff(q[:-1], axis=0)).max() < 0.02


def test_bases_are_where_the_kinematics_put_them():
    shape = flights.MIXED
    rows = flights.rows(np.random.default_rng(2), shape)
    found = pose_signals.base_positions(shape.team, rows.R, rows.x, rows.r)
    agent = joint = 0
    for size, group in zip(shape.team.sizes, shape.team.agent_groups, strict=True):
        for j in range(size):
            own = jax.tree.map(lambda leaf, j=j: leaf[j], group)
            for k in (0, shape.time - 1):
                r = jax.numpy.asarray(rows.r[k, joint : joint + group.tree.joints])
                s = np.asarray(aerial_manipulator.center_of_mass(own, r))
                np.testing.assert_allclose(found[k, agent] + rows.R[k, agent] @ s, rows.x[k, agent], atol=1e-12)
            agent, joint = agent + 1, joint + group.tree.joints
    assert found.shape == (shape.time, agent, 3)
