"""Campaigns whose driver, workers or all processes are killed with SIGKILL at random moments.

Each item is one campaign of short flights of C1 with ten kills. Half of the moments of a new driver count from its
start, all others from its next new row. A killed driver is started again, and after the last kill the campaign is
completed. Requirements:

- Rows that are stored at a kill keep their files unchanged.
- A flight is repeated only if a killed process had started its batch and its row was not stored.
- The final table equals that of an undisturbed campaign.

The Dask cluster has two worker processes; the kill of all processes includes its scheduler.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

from colift.campaigns import driver, engines, flights, spec, store
from evidence import ROOT, collect
from evidence.targets import Target, report

CAMPAIGNS = {"processes": 5, "Dask": 2}  # by engine
KILLS = 10  # of each campaign
TARGETS = ("driver", "worker", "all")
WORKERS = 2
SPEC = {
    "scenario": "paper",
    "cases": ["C1"],
    "samples": 600,
    "duration_s": 0.5,
    "vary": {
        "control.K_p": {"kind": "log_uniform", "low": 4.0, "high": 6.0},
        "nominal.payload.mass_kg": {"kind": "uniform", "low": 1.0, "high": 1.5},
    },
}
START = 8.0  # s, latest moment of a kill that counts from the start of the driver
AFTER_ROW = 1.5  # s, latest moment of a kill that counts from a new row
DEADLINE = 300.0  # s, for a new row, and for the end of a campaign
VARYING = ("cpu_s", "wall_s", "worker")  # columns that differ between two runs


def traced_rows(batch: flights.Batch, trace: str) -> list[flights.Row]:
    """Append the process and the flights of a batch to a file, then simulate the batch."""
    line = json.dumps([os.getpid(), [planned.id for planned in batch.flights]]) + "\n"
    with Path(trace).open("a") as file:  # one write in append mode, so that lines of two processes do not mix
        file.write(line)
    return flights.run_batch(batch)


def drive(folder: str, address: str = "") -> None:
    """Run the campaign of a folder with processes of this computer, or with the Dask cluster of an address."""
    path = Path(folder)
    task = functools.partial(traced_rows, trace=str(path / "trace"))
    with store.open_store(path / "out") as opened:
        engine = (
            engines.DaskEngine(address, task) if address else engines.LocalEngine(WORKERS, task, flights.WORKER_MODULES)
        )
        driver.run_campaign(spec.load_campaign(path / "campaign.yaml"), opened, engine)


def serve(folder: str) -> None:
    """Run a Dask cluster until this process is killed; write its address to a file."""
    import distributed

    with distributed.LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, local_directory=folder
    ) as cluster:
        (Path(folder) / "address.part").write_text(cluster.scheduler_address)
        (Path(folder) / "address.part").rename(Path(folder) / "address")
        while True:
            time.sleep(60.0)


class Attack:
    """A campaign with its processes, and the record of its kills."""

    def __init__(self, folder: Path, engine: str, generator: random.Random) -> None:
        """Start nothing yet."""
        self.folder, self.engine, self.generator = folder, engine, generator
        self.driver: subprocess.Popen[bytes] | None = None
        self.cluster: subprocess.Popen[bytes] | None = None
        self.store = store.Store(folder / "out")
        self.files: dict[str, str] = {}  # digests of the files with rows at the last kill
        self.repeatable: Counter[str] = Counter()  # how often a flight was in flight at a kill
        self.kills: list[dict[str, Any]] = []
        self.faults: list[str] = []
        (folder / "campaign.yaml").write_text(json.dumps(SPEC))

    def start(self) -> None:
        """Start the cluster and the driver where they do not run."""
        if self.engine == "Dask" and self.cluster is None:
            (self.folder / "address").unlink(missing_ok=True)
            self.cluster = _started("serve", str(self.folder))
            self._wait_until((self.folder / "address").exists, self.cluster)
        if self.driver is None:
            address = (self.folder / "address").read_text() if self.cluster else ""
            self.driver = _started("drive", str(self.folder), address)

    def kill(self) -> None:
        """Wait for a random moment, kill a random target, and compare the files with those of the last kill."""
        is_new = self.driver is None
        self.start()
        assert self.driver is not None
        after_row = not is_new or self.generator.random() < 0.5
        delay, target = self.generator.uniform(0.0, AFTER_ROW if after_row else START), self.generator.choice(TARGETS)
        if after_row:
            before = len(self._parts())
            self._wait_until(lambda: len(self._parts()) > before, self.driver)
        time.sleep(delay)
        killed = self._workers()
        if target == "worker":
            self._wait_until(lambda: bool(self._workers()), self.driver)
            killed = [self.generator.choice(self._workers())]
        if self.driver.poll() is not None:
            raise RuntimeError("the campaign ended before a kill")
        self._send(target, killed)
        lost = self._in_flight(killed)
        self.repeatable.update(lost)
        self._compare_files()
        kind = "new row" if after_row else "start"
        moment = {"target": target, "after": kind, "delay_s": round(delay, 3)}
        self.kills.append(moment | {"stored": len(self.store.read()), "in_flight": len(lost)})

    def complete(self) -> None:
        """Let the campaign end without a kill; compare its table and its repeated flights."""
        self.start()
        assert self.driver is not None
        status = self.driver.wait(DEADLINE)
        if status:
            self.faults.append(f"the driver ends with status {status}")
        self._compare_files()
        attempts = Counter(name for _, names in self._trace() for name in names)
        unexpected = attempts - Counter(set(attempts)) - self.repeatable
        if unexpected:
            self.faults.append(f"{unexpected.total()} flights are repeated that were not in flight at a kill")
        if table(self.folder) != undisturbed():
            self.faults.append("the table differs from that of an undisturbed campaign")

    def repeated(self) -> int:
        """Return the number of flights that were started again."""
        attempts = Counter(name for _, names in self._trace() for name in names)
        return attempts.total() - len(attempts)

    def close(self) -> None:
        """Kill all processes that still run."""
        for process in (self.driver, self.cluster):
            if process is not None:
                _kill_group(process)

    def _send(self, target: str, workers: list[int]) -> None:
        """Send SIGKILL to a target; wait for the end of its processes."""
        if target == "worker":
            os.kill(workers[0], signal.SIGKILL)
        elif self.driver is not None:
            if target == "all":
                self.close()
                self.cluster = None
            else:
                self.driver.kill()
                self.driver.wait()
            self.driver = None
        ended = workers if target != "driver" or self.cluster is None else []
        deadline = time.monotonic() + DEADLINE
        while any(map(_runs, ended)):  # workers of a killed driver end themselves
            if time.monotonic() > deadline:
                raise TimeoutError("a worker survives its driver")
            time.sleep(0.02)

    def _workers(self) -> list[int]:
        """Return the processes that simulate batches."""
        parent = self.cluster or self.driver
        return [] if parent is None else worker_ids(parent.pid)

    def _in_flight(self, killed: list[int]) -> list[str]:
        """Return the flights that killed processes, or workers of a killed driver, started and that have no row."""
        stored = self.store.stored_ids()
        return [name for process, names in self._trace() for name in names if process in killed and name not in stored]

    def _trace(self) -> list[tuple[int, list[str]]]:
        """Return the batches that were started, with their processes."""
        path = self.folder / "trace"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def _parts(self) -> list[Path]:
        """Return the files with rows."""
        return store.part_files(self.store.parts)

    def _compare_files(self) -> None:
        """Add a fault if a file with rows disappeared or changed since the last call."""
        found = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in self._parts()}
        if not self.files.items() <= found.items():
            self.faults.append("a file with rows disappeared or changed")
        self.files = found

    def _wait_until(self, condition: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
        """Wait for a condition while a process runs."""
        deadline = time.monotonic() + DEADLINE
        while not condition():
            if process.poll() is not None:
                raise RuntimeError("the campaign ended before a kill")
            if time.monotonic() > deadline:
                raise TimeoutError("the campaign does not continue")
            time.sleep(0.02)


def _started(function: str, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a process in a group of its own that calls a function of this module."""
    code = f"import sys; from evidence import campaign_kills as module; module.{function}(*sys.argv[1:])"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen([sys.executable, "-c", code, *arguments], env=environment, start_new_session=True, cwd=ROOT)


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    """Kill a process with all processes of its group."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _runs(process: int) -> bool:
    """Return whether a process runs; one that ended and was not waited for does not."""
    try:
        return ") Z " not in Path(f"/proc/{process}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def worker_ids(parent: int) -> list[int]:
    """Return the processes that a driver or a cluster has spawned."""
    found = []
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        threads = Path(f"/proc/{parent}/task").glob("*/children")  # each lists the processes that one thread started
        for child in " ".join(thread.read_text() for thread in threads).split():
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    found.append(int(child))
    return found


def table(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a campaign without the columns that differ between two runs."""
    campaign = spec.load_campaign(folder / "campaign.yaml")
    found = driver.campaign_table(campaign, store.Store(folder / "out"))
    return found.drop(columns=list(VARYING)).astype(object).where(found.notna(), None).to_dict("records")


@functools.cache
def undisturbed() -> list[dict[str, Any]]:
    """Return the rows of a campaign without kills."""
    with attacked("processes", random.Random(0)) as attack:
        attack.start()
        assert attack.driver is not None
        if attack.driver.wait(DEADLINE):
            raise RuntimeError("the undisturbed campaign fails")
        return table(attack.folder)


@contextlib.contextmanager
def attacked(engine: str, generator: random.Random) -> Generator[Attack]:
    """Yield a campaign in a temporary folder; end its processes afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        attack = Attack(Path(folder), engine, generator)
        try:
            yield attack
        finally:
            attack.close()


def kill_campaign(item: str) -> dict[str, Any]:
    """Return the kills of one campaign, its repeated flights and its faults."""
    with attacked(item.split()[0], random.Random(item)) as attack:
        for _ in range(KILLS):
            attack.kill()
        attack.complete()
        rows = len(attack.store.read())
        return {"rows": rows, "repeated": attack.repeated(), "kills": attack.kills, "faults": attack.faults}


def main() -> bool:
    """Kill all campaigns; none may have a fault."""
    if importlib.util.find_spec("distributed") is None:
        raise SystemExit("campaign_kills requires the extra campaign")
    items = [f"{engine} {k}" for engine, number in CAMPAIGNS.items() for k in range(number)]
    found = collect("campaign_kills", items, kill_campaign)
    for item in items:
        for fault in found[item]["faults"]:
            print(f"{item}: {fault}")
    return report(
        [
            Target(
                f"{engine}: faults after {number * KILLS} kills",
                sum(len(found[f"{engine} {k}"]["faults"]) for k in range(number)),
                most=0,
                note=f"{sum(found[f'{engine} {k}']['repeated'] for k in range(number))} flights repeated",
            )
            for engine, number in CAMPAIGNS.items()
        ]
    )


if __name__ == "__main__":
    main()
