"""Tables of damaged inputs, failing file operations, interrupts, killed campaigns and tested versions."""

from __future__ import annotations

from typing import Any

from results_tables import count_faults, items, markdown, table


def _groups(name: str, separator: str = " ") -> dict[str, list[dict[str, Any]]]:
    """Return the items of a result by the part of their names before the last separator."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for item, one in items(name).items():
        groups.setdefault(item.rpartition(separator)[0], []).append(one)
    return groups


@table("interrupts+handover")
def interrupted_commands() -> str:
    """Return the interrupted commands: trials, trials without a fault, and the longest time until the end."""
    groups = [(kind, each, "failures") for kind, each in sorted(_groups("interrupts").items())]
    groups += [(f"tune, {kind}", each, "faults") for kind, each in sorted(_groups("handover").items())]
    rows = (
        (kind, f"{sum(not one[faults] for one in each)} of {len(each)}", max(one["exit_time_s"] for one in each))
        for kind, each, faults in groups
    )
    return markdown(("command, signal", "trials without a fault", "longest time to the end [s]"), rows)


@table("file_faults")
def file_operations() -> str:
    """Return the commands whose file operations fail or end the process: operations, kills, faults."""
    rows = ((name, one["operations"], one["killed"], len(one["faults"])) for name, one in items("file_faults").items())
    return markdown(("command", "failing operations", "kills", "faults"), rows)


@table("campaign_kills")
def killed_campaigns() -> str:
    """Return the campaigns whose processes are killed: kills by target, repeated flights, faults."""
    rows = []
    for engine, each in _groups("campaign_kills").items():
        kills = [kill for one in each for kill in one["kills"]]
        counts = (sum(kill["target"] == target for kill in kills) for target in ("driver", "worker", "all"))
        numbers = (sum(one[key] for one in each) for key in ("rows", "repeated"))
        rows.append((engine, len(kills), *counts, *numbers, count_faults(each)))
    header = ("engine", "kills", "of the driver", "of a worker", "of all", "flights", "repeated flights", "faults")
    return markdown(header, rows)


@table("damage+fuzz")
def damaged_inputs() -> str:
    """Return the readers with damaged or mutated inputs: inputs, and faults."""
    rows = [
        (f"commands with a damaged `{file}`", sum(len(one["answers"]) for one in each), count_faults(each))
        for file, each in _groups("damage", ": ").items()
    ]
    rows += [
        (f"reader `{reader}`, mutated inputs", sum(one["inputs"] for one in each), count_faults(each))
        for reader, each in sorted(_groups("fuzz").items())
    ]
    return markdown(("input", "number", "faults"), rows)


@table("environments")
def tested_versions() -> str:
    """Return the environments of the tests: versions of main packages, numbers of passed and failed tests."""
    packages = {
        "jax": "JAX",
        "numpy": "NumPy",
        "scipy": "SciPy",
        "pydantic": "pydantic",
        "mujoco": "MuJoCo",
        "pin": "Pinocchio",
    }
    rows = [
        (*name.split(), *(one["versions"][package] for package in packages), one["passed_tests"], len(one["failures"]))
        for name, one in sorted(items("environments").items())
    ]
    return markdown(("Python", "environment", *packages.values(), "tests passed", "tests failed"), rows)
