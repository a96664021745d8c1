"""Tests of the temporary file with the records of a flight."""

import contextlib
import os
import resource
import signal
import tempfile

import jax
import numpy as np
import pytest

from colift.closed_loop.record_file import ALIGNMENT, RecordFile, read_records
from tests.support import random_logs

SHAPE = random_logs.PAPER


@pytest.fixture
def rows():
    return jax.tree.map(np.asarray, random_logs.rows(np.random.default_rng(0), SHAPE))


def part(rows, start, end):
    return jax.tree.map(lambda x: x[start:end], rows)


def test_parts_are_read_as_one_record(rows, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    n = len(rows.t)
    with contextlib.closing(RecordFile(n + 3)) as file:  # a flight that ends early has fewer rows
        for start, end in ((0, 1), (1, n), (n, n)):
            file.append(part(rows, start, end))
        found = file.read()
    assert not list(tmp_path.iterdir())
    assert jax.tree.structure(found) == jax.tree.structure(rows)
    for got, expected in zip(jax.tree.leaves(found), jax.tree.leaves(rows), strict=True):
        assert (got.dtype, got.shape) == (expected.dtype, expected.shape)
        np.testing.assert_array_equal(got, expected)
    found.t[0] = 7.0  # changes are possible, as of other arrays
    assert found.t[0] == 7.0


def test_file_of_a_killed_flight_has_the_rows_until_then(rows, tmp_path):
    file = RecordFile(len(rows.t), tmp_path / "flight.rows")
    for start, end in ((0, 2), (2, 5)):
        file.append(part(rows, start, end))
    found = read_records(tmp_path / "flight.rows")
    file.close()
    assert jax.tree.structure(found) == jax.tree.structure(rows)
    for got, expected in zip(jax.tree.leaves(found), jax.tree.leaves(rows), strict=True):
        np.testing.assert_array_equal(got, expected[:5])
        assert got.ctypes.data % ALIGNMENT == 0


@pytest.mark.parametrize("change", [lambda x: b"", lambda x: b"CDF" + x[3:], lambda x: x[: len(x) // 2]])
def test_other_and_incomplete_files_are_refused(rows, tmp_path, change):
    path = tmp_path / "flight.rows"
    with contextlib.closing(RecordFile(len(rows.t), path)) as file:
        file.append(rows)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(ValueError, match=r"flight\.rows: no records of a flight"):
        read_records(path)


def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "flight.rows")
    with pytest.raises(OSError, match="not a regular file"):
        read_records(tmp_path / "flight.rows")


def test_full_disk_is_named(rows):
    soft_limit, hard_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, hard_limit))
    try:
        with (
            pytest.raises(OSError, match=r"cannot write the records of the flight to .*: File too large"),
            contextlib.closing(RecordFile(len(rows.t))) as file,
        ):
            file.append(rows)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft_limit, hard_limit))
        signal.signal(signal.SIGXFSZ, handler)
