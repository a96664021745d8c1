"""The comparison of logs of two versions: values bit by bit, and what only one of them has."""

from __future__ import annotations

import numpy as np

from colift.closed_loop import log_upgrade
from evidence import renaming
from tests.support import old_logs
from tests.support import random_logs as flights


def test_an_old_log_is_compared_with_a_new_one() -> None:
    """Variables that only the new log has are listed, not compared."""
    shape, rng = flights.PAPER, np.random.default_rng(2)
    rows, sigma = flights.rows(rng, shape), flights.sigma(rng, shape)
    old = log_upgrade.upgrade(old_logs.schema_2(rows, sigma, shape))
    new = flights.dataset(np.random.default_rng(2), shape)
    found = renaming.compare_flights(old, new)
    assert found["differ"] == []
    signals = "correction_", "label_", "model_prediction_"  # of the residual corrector, from schema 4 on
    assert [name for name in found["not_compared"] if not name.startswith(signals)] == ["p_base"]
    assert found["variables"] == len(new.data_vars) - len(found["not_compared"])
    assert found["bytes"] == sum(x.nbytes for name, x in new.data_vars.items() if name not in found["not_compared"])


def test_a_bit_and_a_lost_variable_are_differences() -> None:
    old = flights.dataset(np.random.default_rng(2))
    new = old.copy(deep=True)
    new.W_d_moment[3, 1] = np.nextafter(new.W_d_moment[3, 1], 9.0)
    assert renaming.compare_flights(old, new.drop_vars("u"))["differ"] == ["u", "W_d_moment"]
