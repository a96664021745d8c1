"""Accuracy of the cone program of the allocation within limits against Clarabel, and its iterations in flight.

Items of the form `16 contacts 3` are blocks of 250 random programs of a ring of agents, solved without a warm start and
with at most 5000 iterations (`tests.support.cone_programs`). Larger residuals than its tolerance flag a program as not
converged. Programs have a solution for all limits, since limits are penalties. About half of the demands exceed the
limits.

Items of the form `iterations trio C1` are flights at 95 % of the mean need (`evidence.limits`), with the tolerance and
the 100 iterations of the controller. Their iterations start from the solution of the last control period.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift.closed_loop.flight import run_experiment
from colift.math.pytree import pytree
from colift.onboard.control import cone_program
from colift.onboard.control.constrained_allocation import ConstrainedAllocator
from colift.onboard.interfaces import AllocationReport
from colift.scenario import experiment
from evidence import collect, limits
from evidence.targets import Target, report
from tests.support import cone_programs
from tests.support.cone_programs import RINGS

BLOCKS, BLOCK_SIZE = 10, 250
OBJECTIVE_ERROR, VIOLATION = 1e-4, 1e-3  # relative to at least 1, and N
LEVEL, SEED, CASES = 0.95, 301, ("C1", "true_residual")
WARM_ITERATIONS = 40


def solve_block(contacts: int, block: int) -> dict[str, Any]:
    """Return how many programs of a block are flagged or differ from Clarabel, and the largest differences."""
    of, rng = cone_programs.ring(*RINGS[contacts]), np.random.default_rng((contacts, block))
    program = cone_programs.make_program(of)
    flagged, different, errors, violations = 0, 0, [], []
    for _ in range(BLOCK_SIZE):
        p = cone_programs.draw(of, rng)
        found = cone_programs.solution(program, p)
        if np.asarray(found.residuals).max() > cone_programs.TOLERANCE:
            flagged += 1
            continue
        x, expected = np.asarray(found.x), cone_programs.reference_solution(of, p)
        best = cone_programs.objective(of, p, expected)
        error = abs(cone_programs.objective(of, p, x) - best) / max(1.0, best)
        violation = largest_distance(of, p, x) - largest_distance(of, p, expected)
        different += error > OBJECTIVE_ERROR or violation > VIOLATION
        errors.append(error)
        violations.append(violation)
    return {
        "programs": BLOCK_SIZE,
        "flagged": flagged,
        "different": int(different),
        "objective_error": float(max(errors)),
        "violation_N": float(max(violations)),
    }


def largest_distance(of: cone_programs.Geometry, p: cone_programs.Problem, x: np.ndarray) -> float:
    """Return the largest distance of a thrust or contact force from its set [N]."""
    blocks = (of.A @ x + p.b)[:-6].reshape(-1, 3)
    inside = np.asarray(cone_program.project(jnp.asarray(blocks), p.sets))
    return float(np.linalg.norm(blocks - inside, axis=1).max())


@pytree
class CountingAllocator(ConstrainedAllocator):
    """Allocation within limits that reports iterations and the larger residual in place of both residuals."""

    def _report(self, solution: cone_program.Solution, sets: cone_program.ConeSets, up: jax.Array) -> AllocationReport:
        found = super()._report(solution, sets, up)
        return dataclasses.replace(found, residuals=jnp.stack([solution.iterations, solution.residuals.max()]))


def count_iterations(team: str, case: str) -> dict[str, Any]:
    """Return percentiles of the iterations in a flight at a limit below the need, from 4 s on."""
    settings = limits.team_scenario(team, SEED)
    plan = experiment.make_experiment(settings, case)
    need = limits.needs(plan, settings)
    plan = limits.with_limits(plan, np.full_like(need, LEVEL * need.mean()))
    allocator = plan.controller.allocator
    assert isinstance(allocator, ConstrainedAllocator)  # for the type checker
    fields = {field.name: getattr(allocator, field.name) for field in dataclasses.fields(allocator)}
    controller = dataclasses.replace(plan.controller, allocator=CountingAllocator(**fields))
    flight = run_experiment(dataclasses.replace(plan, controller=controller))
    rows = flight.records
    counts, residual = rows.allocation_primal, rows.allocation_dual
    assert counts is not None  # for the type checker
    assert residual is not None
    late = rows.t >= limits.EVALUATION_START
    return {
        "end_s": float(rows.t[-1]),
        "saturated_share": float((counts[late] > 0).mean()),
        "median": float(np.median(counts[late])),
        "percentile_99": float(np.percentile(counts[late], 99)),
        "largest": float(counts[late].max()),
        "residual_percentile_99_N": float(np.percentile(residual[late], 99)),
    }


def compute_item(item: str) -> dict[str, Any]:
    """Return the result of a block of programs, or of a flight."""
    first, second, third = item.split()
    return count_iterations(second, third) if first == "iterations" else solve_block(int(first), int(third))


def items() -> list[str]:
    """Return all items."""
    flights = [f"iterations {team} {case}" for team in limits.TEAMS for case in CASES]
    return [*flights, *(f"{contacts} contacts {block}" for block in range(BLOCKS) for contacts in RINGS)]


def blocks_of(of: dict[str, Any], contacts: int | None = None) -> list[dict[str, Any]]:
    """Return the computed blocks with a number of contacts; None for all."""
    kinds = RINGS if contacts is None else (contacts,)
    return [of[item] for n in kinds for block in range(BLOCKS) if (item := f"{n} contacts {block}") in of]


def targets(of: dict[str, Any]) -> list[Target]:
    """Return the targets of accuracy and iterations."""
    blocks = blocks_of(of)
    total, flagged, different = (sum(one[name] for one in blocks) for name in ("programs", "flagged", "different"))
    equal = 100 * (total - flagged - different) / total if total else np.nan
    flights = [one for item, one in of.items() if item.startswith("iterations")]
    most = max((one["percentile_99"] for one in flights), default=np.nan)
    return [
        Target("programs that agree with Clarabel", equal, least=99.9, unit="%", note=f"{total} programs"),
        Target("programs that differ and are not flagged", different, most=0, note=f"{flagged} flagged"),
        Target(
            "99th percentile of warm iterations in flight", most, most=WARM_ITERATIONS, note=f"{len(flights)} flights"
        ),
    ]


def main() -> bool:
    """Print the targets; return whether all are met."""
    return report(targets(collect("cone_programs", items(), compute_item)))


if __name__ == "__main__":
    main()
