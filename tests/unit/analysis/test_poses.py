"""Positions of bases from logs of today, which contain them, and from older ones."""

import numpy as np

from colift.analysis import poses
from colift.closed_loop import log_upgrade
from tests.support import old_logs
from tests.support import random_logs as flights


def test_base_positions_are_read_from_the_log():
    ds = flights.dataset(np.random.default_rng(1))
    ds.p_base[:] = 7.0
    np.testing.assert_array_equal(poses.base_positions(ds, flights.PAPER.team), ds.p_base)


def test_base_positions_of_older_logs_are_computed():
    shape, rng = flights.MIXED, np.random.default_rng(2)
    rows, sigma = flights.rows(rng, shape), flights.sigma(rng, shape)
    old = log_upgrade.upgrade(old_logs.schema_2(rows, sigma, shape, scenario_json=old_logs.scenario_json(shape)))
    assert "p_base" not in old
    new = flights.dataset(np.random.default_rng(2), shape)
    np.testing.assert_array_equal(new.x, old.x)
    np.testing.assert_array_equal(poses.base_positions(old, shape.team), new.p_base)
