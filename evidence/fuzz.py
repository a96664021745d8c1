"""Every reader is given mutated inputs: it returns finite values, or raises the project's error for invalid input.

Inputs are valid ones with random changes of bytes, cells, elements or entries (`tests.support.fuzz_readers`). A seed
determines each input, so a fault can be repeated. Every block of seeds runs in a process of its own: a crash, or an
input that exceeds `MAX_CPU_TIME` or `MAX_TIME`, is a fault too.
"""

from __future__ import annotations

import functools
import json
import multiprocessing
import os
import signal
import tempfile
import time
import warnings
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any, NamedTuple

from evidence import collect
from tests.support import fuzz_readers

MAX_CPU_TIME = 60.0  # s for one input; the slowest takes below 1 s on an idle machine
MAX_TIME = 900.0  # s for one input that waits; a busy machine suspends a process for minutes
MAX_FAULTS = 20  # faults that a block stores


class Blocks(NamedTuple):
    """Number of blocks of a reader and of inputs in each."""

    number: int
    inputs: int


FAST, PACKETS, LOGS = Blocks(50, 2000), Blocks(500, 2000), Blocks(20, 100)
BLOCKS = {
    **dict.fromkeys(("urdf", "mjcf", "waypoints", "pose_table", "scenario", "override", "migration"), FAST),
    **dict.fromkeys(("summary", "certificate", "gp"), FAST),
    "autopilot": PACKETS,
    "log": LOGS,  # 200 ms for each input
}
assert BLOCKS.keys() == fuzz_readers.READERS.keys()


def run_block(item: str) -> dict[str, Any]:
    """Read all inputs of a block in another process.

    Args:
        item: Name of the reader and number of the block.

    Returns:
        Number of inputs that were read and refused, and the faults by their seeds.
    """
    name, _, number = item.rpartition(" ")
    count = BLOCKS[name].inputs
    first = int(number) * count
    context, current = _context(), _context().RawValue("q", first)
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        process = context.Process(
            target=_read_inputs, args=(name, range(first, first + count), Path(folder), current, result)
        )
        process.start()
        fault = _watch(process, current)
        if result.exists():
            return json.loads(result.read_text())
        seed = current.value
        return {"inputs": seed - first + 1, "faults": {str(seed): fault or f"ends with {process.exitcode}"}}


@functools.cache
def _context() -> ForkServerContext:
    """Return a server that has imported the readers and forks itself; it has no threads of JAX, which could block."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.support.fuzz_readers"])
    return context


def _read_inputs(name: str, seeds: range, folder: Path, current: Any, result: Path) -> None:
    """Read the inputs of some seeds and write the result; the number of the current seed is shared."""
    null = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # libraries print on invalid input
        os.dup2(null, stream)
    warnings.simplefilter("ignore")
    found: dict[str, Any] = {"inputs": len(seeds), "read": 0, "refused": 0, "faults": {}}
    for seed in seeds:
        current.value = seed
        fault = fuzz_readers.check(name, seed, folder)
        if fault:
            found["faults"][str(seed)] = fault
            if len(found["faults"]) == MAX_FAULTS:
                break
        else:
            found["read" if fault is None else "refused"] += 1
    result.write_text(json.dumps(found))
    os._exit(0)


def _watch(process: Any, current: Any) -> str:
    """Wait for a process; end it if one input takes too long."""
    last, since, used = current.value, time.monotonic(), 0.0
    while process.is_alive():
        process.join(0.2)
        if current.value != last:
            last, since, used = current.value, time.monotonic(), _cpu_time(process.pid)
            continue
        cpu, wall = _cpu_time(process.pid) - used, time.monotonic() - since
        if cpu > MAX_CPU_TIME or wall > MAX_TIME:
            os.kill(process.pid, signal.SIGKILL)
            process.join()
            return f"takes {cpu:.0f} s of processor time and {wall:.0f} s"
    return ""


def _cpu_time(pid: int) -> float:
    """Return the processor time of a process [s]; 0 after its end."""
    try:
        user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    except OSError:
        return 0.0
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def main() -> bool:
    """Read all inputs; none may have a fault."""
    numbers = range(max(blocks.number for blocks in BLOCKS.values()))
    items = [f"{name} {k}" for k in numbers for name, blocks in BLOCKS.items() if k < blocks.number]
    found = collect("fuzz", items, run_block)
    for name, blocks in BLOCKS.items():
        each = [found[f"{name} {k}"] for k in range(blocks.number)]
        inputs, read = (sum(one.get(key, 0) for one in each) for key in ("inputs", "read"))
        print(f"{name}: {inputs} inputs, {read} read, {sum(len(one['faults']) for one in each)} faults")
    for item in items:
        for seed, fault in found[item]["faults"].items():
            print(f"{item}: seed {seed}: {fault}")
    return not any(found[item]["faults"] for item in items)


if __name__ == "__main__":
    main()
