"""Tables of damaged inputs, failing file operations and interrupts."""

from __future__ import annotations

import itertools

from results_tables import Cell, items, markdown, table


@table("interrupts+handover")
def interrupted_commands() -> str:
    """Return the interrupted commands: trials, trials without a fault, and the longest time until the end."""
    trials = [(item, one, one["failures"]) for item, one in items("interrupts").items()]
    trials += [(f"tune, {item}", one, one["faults"]) for item, one in items("handover").items()]
    rows = []
    for kind, group in itertools.groupby(
        sorted(trials, key=lambda each: each[0]), lambda each: each[0].rpartition(" ")[0]
    ):
        each = list(group)
        good, longest = sum(not faults for _, _, faults in each), max(one["exit_time_s"] for _, one, _ in each)
        rows.append((kind, f"{good} of {len(each)}", longest))
    return markdown(("command, signal", "trials without a fault", "longest time to the end [s]"), rows)


@table("file_faults")
def file_operations() -> str:
    """Return the commands whose file operations fail or end the process: operations, kills, faults."""
    rows = [(name, one["operations"], one["killed"], len(one["faults"])) for name, one in items("file_faults").items()]
    return markdown(("command", "failing operations", "kills", "faults"), rows)


@table("damage+fuzz")
def damaged_inputs() -> str:
    """Return the readers with damaged or mutated inputs: inputs, and inputs with a fault."""
    found = items("damage")
    rows: list[tuple[Cell, ...]] = [
        (
            f"commands with a damaged `{file}`",
            sum(len(one["answers"]) for one in group),
            sum(len(one["faults"]) for one in group),
        )
        for file, group in (
            (file, [one for item, one in found.items() if item.startswith(f"{file}: ")])
            for file in dict.fromkeys(item.partition(": ")[0] for item in found)
        )
    ]
    blocks = items("fuzz")
    for reader in sorted({item.rpartition(" ")[0] for item in blocks}):
        each = [one for item, one in blocks.items() if item.rpartition(" ")[0] == reader]
        rows.append(
            (
                f"reader `{reader}`, mutated inputs",
                sum(one["inputs"] for one in each),
                sum(len(one["faults"]) for one in each),
            )
        )
    return markdown(("input", "number", "faults"), rows)
