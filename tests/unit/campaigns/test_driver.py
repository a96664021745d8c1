"""Campaigns that are interrupted, whose workers end, and whose folder cannot be written."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from colift.campaigns import driver, engines, spec, store
from colift.campaigns.flights import MAX_BATCH
from colift.runtime import atomic_write
from tests.support import campaigns

DRIVER = """
import sys
from pathlib import Path
from colift.campaigns import engines
from tests.support import campaigns

if __name__ == "__main__":
    campaigns.run(Path(sys.argv[1]), Path(sys.argv[2]), engines.LocalEngine(int(sys.argv[3]), campaigns.slow_rows))
"""


@contextlib.contextmanager
def started_driver(path: Path, out: Path, jobs: int) -> Generator[subprocess.Popen[bytes]]:
    """Start a campaign in a process group of its own, and wait until it adds rows."""
    script = path.parent / "drive.py"
    script.write_text(DRIVER)
    command = [sys.executable, str(script), str(path), str(out), str(jobs)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(command, env=environment, start_new_session=True) as process:
        before, deadline = len(store.part_files(out / "parts")), time.monotonic() + 120
        while len(store.part_files(out / "parts")) == before and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        yield process


def worker_ids(driver_id: int) -> list[int]:
    """Return the processes that compute batches for a driver."""
    children = Path(f"/proc/{driver_id}/task/{driver_id}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def undisturbed(path: Path, out: Path) -> list[dict[str, object]]:
    campaigns.run(path, out, campaigns.InlineEngine(campaigns.quick_rows))
    return campaigns.numbers(path, out)


def test_repeated_campaign_computes_what_is_missing(tmp_path: Path):
    path, out = campaigns.write(tmp_path), tmp_path / "out"
    for samples, new in ((12, 12), (12, 0), (20, 8)):
        engine = campaigns.InlineEngine(campaigns.quick_rows)
        found = campaigns.run(campaigns.write(tmp_path, samples=samples), out, engine)
        assert engine.computed == found.simulated == new
        assert found.missing == 0
    assert len(campaigns.numbers(path, out)) == 20
    assert campaigns.numbers(path, out) == undisturbed(path, tmp_path / "other")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"seeds": [4]}, {"seeds": [4, 5]}),
        (
            {"vary": {"control.K_p": [4, 5], "control.K_v": [4]}},
            {"vary": {"control.K_p": [4, 5], "control.K_v": [4, 5]}},
        ),
        ({"samples": 4, "sampling": "saltelli"}, {"samples": 8, "sampling": "saltelli"}),
    ],
    ids=["seeds", "grid", "saltelli"],
)
def test_extended_campaign_numbers_its_samples_again(
    before: dict[str, object], after: dict[str, object], tmp_path: Path
):
    """Rows that were stored with another numbering are paired with the new ones as in an undisturbed campaign."""
    out = tmp_path / "out"
    rest = {"cases": ["C1", "C3"], "samples": 4} | ({"samples": 1, "seeds": [4]} if "vary" in before else {})
    for changes in (before, after):
        path = campaigns.write(tmp_path, **(rest | changes))
        campaigns.run(path, out, campaigns.InlineEngine(campaigns.quick_rows))
    assert campaigns.numbers(path, out) == undisturbed(path, tmp_path / "other")


def test_killed_driver_loses_batches_in_flight_only(tmp_path: Path):
    """After `kill -9` of the driver its worker ends, and the next run yields the table of an undisturbed campaign."""
    path, out = campaigns.write(tmp_path, samples=70), tmp_path / "out"
    with started_driver(path, out, 1) as process:
        process.kill()
    stored = len(store.Store(out).read())
    assert 0 < stored < 70
    engine = campaigns.InlineEngine(campaigns.quick_rows)
    campaigns.run(path, out, engine)
    assert engine.computed == 70 - stored
    assert campaigns.numbers(path, out) == undisturbed(path, tmp_path / "other")


@pytest.mark.long
def test_kills_at_random_moments_repeat_batches_in_flight_only(tmp_path: Path):
    """Driver, a worker, or all are killed at five moments; the final table equals that of an undisturbed campaign."""
    generator, flights = random.Random(0), 800
    path, out = campaigns.write(tmp_path, samples=flights), tmp_path / "out"
    for target in ("driver", "worker", "all", "worker", "driver"):
        with started_driver(path, out, 2) as process:
            time.sleep(generator.uniform(0.0, 0.4))
            assert process.poll() is None, "the campaign ended before the signal"
            if target == "worker":
                os.kill(generator.choice(worker_ids(process.pid)), signal.SIGKILL)
                time.sleep(0.4)  # the driver sends the batch to another process
                assert process.poll() is None
            os.killpg(process.pid, signal.SIGKILL) if target == "all" else process.kill()
    stored = len(store.Store(out).read())
    engine = campaigns.InlineEngine(campaigns.quick_rows)
    campaigns.run(path, out, engine)
    assert engine.computed == flights - stored
    assert campaigns.numbers(path, out) == undisturbed(path, tmp_path / "other")


def test_flight_that_ends_its_worker_is_named(tmp_path: Path):
    path, out = campaigns.write(tmp_path), tmp_path / "out"
    found = campaigns.run(path, out, engines.LocalEngine(2, campaigns.rows_or_death))
    assert found.lost == 1
    rows = campaigns.numbers(path, out)
    lost = [row for row in rows if row["termination_reason"]]
    assert [(row["sample"], row["termination_reason"]) for row in lost] == [(campaigns.FATAL_SAMPLE, "lost: signal 9")]
    assert [row for row in rows if row not in lost] == [
        row for row in undisturbed(path, tmp_path / "other") if row["sample"] != campaigns.FATAL_SAMPLE
    ]


def test_exception_in_a_worker_is_the_reason_of_a_row(tmp_path: Path):
    path, out = campaigns.write(tmp_path), tmp_path / "out"
    campaigns.run(path, out, engines.LocalEngine(1, campaigns.rows_or_error))
    reasons = [row["termination_reason"] for row in campaigns.numbers(path, out)]
    assert reasons[campaigns.FATAL_SAMPLE] == "lost: ZeroDivisionError: division by zero"
    assert sum(map(bool, reasons)) == 1


@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="the extra campaign is not installed")
def test_dask_cluster_repeats_batches_of_a_killed_worker(tmp_path: Path):
    """One of two worker processes is killed while batches are computed."""
    import distributed

    path, out = campaigns.write(tmp_path, samples=70), tmp_path / "out"
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        engine = engines.DaskEngine(cluster.scheduler_address, campaigns.slow_rows)
        killed: list[int] = []

        def kill(found: driver.Progress) -> None:
            if found.simulated and not killed:
                killed.append(cluster.workers[0].pid)
                os.kill(killed[0], signal.SIGKILL)

        with store.open_store(out) as opened:
            found = driver.run_campaign(spec.load_campaign(path), opened, engine, kill)
    assert killed
    assert found.lost == 0
    assert campaigns.numbers(path, out) == undisturbed(path, tmp_path / "other")


def test_stopping_rule_ends_the_campaign_early(tmp_path: Path):
    rule = {"metric": "e_p_rms_m", "half_width": 0.4}
    path, out = campaigns.write(tmp_path, samples=300, until=rule), tmp_path / "out"
    engine = campaigns.InlineEngine(campaigns.quick_rows)
    found = campaigns.run(path, out, engine)
    assert found.stopped_at == driver.STOPPING_SAMPLES
    assert found.missing == 0
    assert engine.computed < 300
    assert len(campaigns.numbers(path, out)) == found.stopped_at
    assert campaigns.run(path, out, engine).simulated == 0


def test_first_batch_compiles_before_the_others(tmp_path: Path):
    path = campaigns.write(tmp_path, samples=100, cases=["C1", "C3"])
    campaign = spec.load_campaign(path)
    flights = driver.plan_flights(campaign)
    batches = list(driver.make_batches(campaign, tmp_path, flights, MAX_BATCH, True))
    assert [len(batch.flights) for batch in batches[:2]] == [1, 1]
    assert all(len({flight.case for flight in batch.flights}) == 1 for batch in batches)
    assert max(len(batch.flights) for batch in batches) == MAX_BATCH
    assert sorted(flight.id for batch in batches for flight in batch.flights) == sorted(each.id for each in flights)


def test_whole_numbers_of_a_float_setting_share_a_structure(tmp_path: Path):
    """Each value of `learning.max_samples` has its program; all values of a gain and of a component have the same."""
    vary = {"control.K_p": [4, 5.5, 6], "initial_state.velocity_mps.0": [0, 1], "learning.max_samples": [20, 40]}
    campaign = spec.load_campaign(campaigns.write(tmp_path, vary=vary, samples=1))
    keys = {driver.structure_key(flight) for flight in driver.plan_flights(campaign)}
    assert len(keys) == 2


def test_full_disk_and_rows_of_another_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path, out = campaigns.write(tmp_path), tmp_path / "out"

    def full(file: Path, content: bytes) -> None:
        raise OSError(errno.ENOSPC, f"cannot write {file}: No space left on device")

    with monkeypatch.context() as context:
        context.setattr(atomic_write, "write_atomic", full)
        with pytest.raises(OSError, match="No space left on device"):
            campaigns.run(path, out, campaigns.InlineEngine(campaigns.quick_rows))
    campaigns.run(path, out, campaigns.InlineEngine(campaigns.quick_rows))
    monkeypatch.setattr(store, "version", lambda _name: "9.9.9")
    with pytest.raises(OSError, match=r"contains rows of colift .*, and this is 9\.9\.9: choose another --out"):
        campaigns.run(path, out, campaigns.InlineEngine(campaigns.quick_rows))


def test_two_campaigns_cannot_share_a_folder(tmp_path: Path):
    out = tmp_path / "out"
    with store.open_store(out), pytest.raises(BlockingIOError, match="is in use"), store.open_store(out):
        pass
    with store.open_store(out):
        pass
