"""Engines that simulate batches: processes of this computer, a Dask cluster, or SLURM jobs.

An engine keeps no state that a campaign needs. If it or its workers end, the store determines what is missing.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from colift.campaigns.flights import MAX_BATCH, Batch, Row, run_batch
from colift.runtime import extras

Task = Callable[[Batch], list[Row]]
"""Function that a worker calls with a batch."""
BATCHES_PER_THREAD = 2
"""Batches sent to a cluster for each of its threads, so that none is idle."""
BATCHES_PER_WORKER = 4
"""Smallest number of batches for each worker, so that all end at nearly the same time."""
SLURM_TASKS = 1000
"""Largest number of jobs in the queue of SLURM."""
SLURM_MINUTES = 720
"""Time limit of one job [min]."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Result of one batch.

    Attributes:
        batch: Batch.
        rows: Rows of its flights; None if the worker ended or raised an exception.
        reason: Cause, if there are no rows.
        retry: Whether the batch may succeed in a second attempt.
    """

    batch: Batch
    rows: list[Row] | None = None
    reason: str = ""
    retry: bool = False


@runtime_checkable
class Engine(Protocol):
    """Workers that simulate batches."""

    def slots(self) -> int:
        """Number of batches that the engine accepts at a time."""
        ...

    def batch_size(self, flights: int) -> int:
        """Largest number of flights of one batch, for a number of flights in total."""
        ...

    def prepare(self, batches: int) -> None:
        """Start workers for a number of batches."""
        ...

    def submit(self, batches: Sequence[Batch]) -> None:
        """Send batches to the workers."""
        ...

    def poll(self, timeout: float) -> list[Outcome]:
        """Return the batches that ended; wait for the first one up to a time [s].

        Raises:
            OSError: If a worker cannot write, or if the cluster cannot be reached.
        """
        ...

    def close(self) -> None:
        """End the workers, or cancel their tasks."""
        ...


@dataclasses.dataclass
class _Worker:
    """Process with its pipe and the batch that it simulates."""

    process: BaseProcess
    pipe: Connection
    batch: Batch | None = None


class LocalEngine:
    """Spawned processes of this computer. The end of one process affects the batch of this process only."""

    def __init__(self, jobs: int, task: Task = run_batch, modules: Sequence[str] = ()) -> None:
        """Start no process yet.

        Args:
            jobs: Number of processes.
            task: Function that a worker calls with a batch.
            modules: Modules that a worker imports at its start, before it has a batch.
        """
        self._jobs, self._task, self._modules = jobs, task, tuple(modules)
        self._workers: list[_Worker] = []

    def slots(self) -> int:
        """Number of processes."""
        return self._jobs

    def batch_size(self, flights: int) -> int:
        """Largest number of flights of one batch."""
        return _balanced_size(flights, self._jobs)

    def prepare(self, batches: int) -> None:
        """Start the processes, which import their modules while the first batch compiles."""
        for _ in range(len(self._workers), min(self._jobs, batches)):
            self._start()

    def submit(self, batches: Sequence[Batch]) -> None:
        """Send each batch to an idle process, or to a new one."""
        for batch in batches:
            worker = next((each for each in self._workers if each.batch is None), None) or self._start()
            worker.batch = batch
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # it has ended; `poll` reports it
                worker.pipe.send(batch)

    def poll(self, timeout: float) -> list[Outcome]:
        """Return the batches of processes that sent rows or ended."""
        busy = [(worker, worker.batch) for worker in self._workers if worker.batch is not None]
        ready = connection.wait([end for worker, _ in busy for end in (worker.pipe, worker.process.sentinel)], timeout)
        return [
            self._outcome(worker, batch)
            for worker, batch in busy
            if worker.pipe in ready or worker.process.sentinel in ready
        ]

    def close(self) -> None:
        """End all processes at once; their batches are not written."""
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
            worker.pipe.close()
        self._workers.clear()

    def _start(self) -> _Worker:
        """Start a process."""
        context = multiprocessing.get_context("spawn")
        own, other = context.Pipe()
        process = context.Process(
            target=_work, args=(other, self._task, self._modules), daemon=True, name="colift-campaign"
        )
        process.start()
        other.close()
        self._workers.append(_Worker(process, own))
        return self._workers[-1]

    def _outcome(self, worker: _Worker, batch: Batch) -> Outcome:
        """Return the result of a process that sent something or ended."""
        worker.batch = None
        try:
            found = worker.pipe.recv()
        except (EOFError, ConnectionResetError):
            worker.process.join()
            worker.pipe.close()
            self._workers.remove(worker)
            return Outcome(batch, reason=_describe_exit(worker.process.exitcode), retry=True)
        return _outcome_of(batch, found) if isinstance(found, BaseException) else Outcome(batch, found)


def _balanced_size(flights: int, workers: int) -> int:
    """Return the number of flights of one batch with which all workers end at nearly the same time."""
    return max(1, min(MAX_BATCH, -(-flights // (BATCHES_PER_WORKER * workers))))


def _work(pipe: Connection, task: Task, modules: Sequence[str]) -> None:
    """Simulate batches until the driver ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal; the driver ends this one
    threading.Thread(target=_end_with_driver, daemon=True).start()
    for module in modules:
        importlib.import_module(module)
    while True:
        try:
            batch = pipe.recv()
        except EOFError:
            return
        try:
            found: Any = task(batch)
        except Exception as error:  # any error of a flight is reported to the driver
            found = error if isinstance(error, OSError) else RuntimeError(f"{type(error).__name__}: {error}")
        pipe.send(found)


def _end_with_driver() -> None:
    """End this process when the driver ends, also by `kill -9`."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _describe_exit(code: int | None) -> str:
    """Describe the exit code of a process."""
    return f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"


def _outcome_of(batch: Batch, error: BaseException) -> Outcome:
    """Return the outcome of a batch that raised an exception; raise the exception if a file cannot be written."""
    if isinstance(error, OSError):
        raise error
    return Outcome(batch, reason=(str(error).splitlines() or [type(error).__name__])[0])


class DaskEngine:
    """Existing Dask cluster, which repeats the tasks of workers that end (extra `campaign`)."""

    def __init__(self, address: str, task: Task = run_batch) -> None:
        """Connect to the scheduler of the cluster.

        Args:
            address: Address of the scheduler, such as ``tcp://host:8786``.
            task: Function that a worker calls with a batch.

        Raises:
            OSError: If distributed is not installed, or if the cluster cannot be reached.
        """
        try:
            import distributed
        except ModuleNotFoundError:
            raise OSError(f"a Dask cluster requires distributed: {extras.install_command('campaign')}") from None
        try:
            self._client = distributed.Client(address, timeout=10)
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise OSError(f"the Dask cluster {address} cannot be reached: {reason}") from None
        self._task, self._killed = task, distributed.KilledWorker
        self._futures: dict[Any, Batch] = {}

    def slots(self) -> int:
        """Number of batches for the threads of the cluster at present."""
        return BATCHES_PER_THREAD * max(1, sum(self._client.nthreads().values()))

    def batch_size(self, flights: int) -> int:
        """Largest number of flights of one batch."""
        return _balanced_size(flights, self.slots() // BATCHES_PER_THREAD)

    def prepare(self, batches: int) -> None:
        """Start nothing; the cluster exists."""

    def submit(self, batches: Sequence[Batch]) -> None:
        """Send batches to the cluster."""
        for batch in batches:
            self._futures[self._client.submit(self._task, batch, pure=False)] = batch

    def poll(self, timeout: float) -> list[Outcome]:
        """Return the batches that the cluster has completed or abandoned."""
        import distributed

        try:
            distributed.wait(list(self._futures), timeout=timeout, return_when="FIRST_COMPLETED")
        except TimeoutError:
            return []
        return [self._outcome(future) for future in list(self._futures) if future.done()]

    def close(self) -> None:
        """Cancel all tasks and disconnect."""
        self._client.cancel(list(self._futures))
        self._client.close()

    def _outcome(self, future: Any) -> Outcome:
        """Return the result of a task."""
        batch = self._futures.pop(future)
        error = future.exception()
        if error is None:
            return Outcome(batch, future.result())
        if isinstance(error, self._killed):
            return Outcome(batch, reason="worker ended")
        return _outcome_of(batch, error)


class SlurmEngine:
    """Job arrays of SLURM, submitted by submitit (extra `campaign`). The results folder must be on a shared disk."""

    def __init__(self, partition: str, folder: Path, task: Task = run_batch, cluster: str = "slurm") -> None:
        """Prepare job arrays.

        Args:
            partition: Partition of the cluster.
            folder: Folder for scripts and logs of the jobs.
            task: Function that a worker calls with a batch.
            cluster: Kind of cluster as submitit names it; ``local`` starts processes instead.

        Raises:
            OSError: If submitit or SLURM is not installed.
        """
        try:
            import submitit
            from submitit.core import utils
        except ModuleNotFoundError:
            raise OSError(f"SLURM jobs require submitit: {extras.install_command('campaign')}") from None
        try:
            self._executor = submitit.AutoExecutor(folder=folder, cluster=cluster)
        except RuntimeError as error:
            raise OSError(f"SLURM is not available: {error}") from None
        self._executor.update_parameters(
            slurm_partition=partition, timeout_min=SLURM_MINUTES, cpus_per_task=1, name="colift-campaign"
        )
        self._task, self._unfinished = task, utils.UncompletedJobError
        self._jobs: dict[Any, Batch] = {}

    def slots(self) -> int:
        """Largest number of jobs in the queue."""
        return SLURM_TASKS

    def batch_size(self, flights: int) -> int:
        """Largest number of flights of one job, whose start takes as long as many flights."""
        return min(MAX_BATCH, flights)

    def prepare(self, batches: int) -> None:
        """Start nothing; each job starts its process."""

    def submit(self, batches: Sequence[Batch]) -> None:
        """Submit batches as one job array."""
        if batches:
            with self._executor.batch():
                jobs = [self._executor.submit(self._task, batch) for batch in batches]
            self._jobs |= dict(zip(jobs, batches, strict=True))

    def poll(self, timeout: float) -> list[Outcome]:
        """Return the batches whose jobs ended."""
        done = [job for job in self._jobs if job.done()]
        if not done:
            threading.Event().wait(timeout)
        return [self._outcome(job) for job in done]

    def close(self) -> None:
        """Cancel all jobs."""
        for job in self._jobs:
            job.cancel()

    def _outcome(self, job: Any) -> Outcome:
        """Return the result of a job."""
        batch = self._jobs.pop(job)
        error = job.exception()
        if error is None:
            return Outcome(batch, job.result())
        if isinstance(error, self._unfinished):
            return Outcome(batch, reason=f"job ended, state {job.state}", retry=True)
        return _outcome_of(batch, error)
