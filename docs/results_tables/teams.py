"""Tables of generated teams, gain tuning, redundant joints and tuned baselines."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from evidence import cone_programs, payloads, realization, rotor_limits, verdicts
from evidence import limits as limit_flights
from results_tables import CASES, items, limits, markdown, number, table
from results_tables import targets as target_table
from tests.support import user_teams

KINDS = {
    "default_gains": "default gains",
    "tuned_gains": "tuned",
    "random_search": "random search, same budget",
}


FINE_LIMITS_END = 36.0  # N, rotor limit up to which the table has all limits


@table("limits")
def limits_targets() -> str:
    """Targets of the flights at thrust limits and with losses of thrust."""
    return target_table(limit_flights.targets(items("limits")))


@table("limits")
def limits_fractions() -> str:
    """Flights at thrust limits and with losses that meet their targets, by team and case."""
    names = [f"{100 * level:g} %" for level in limit_flights.LEVELS]
    names += ["bearable", "told", "estimated", "dip"]
    rows = []
    for team, case in itertools.product(limit_flights.TEAMS, limit_flights.CASES):
        found = limit_flights.counts(items("limits"), team, case)
        rows.append(
            (
                f"`{team}`",
                f"`{case}`",
                *("{} of {}".format(*found[n]) if n in found and found[n][1] else "-" for n in names),
            )
        )
    return markdown(("team", "case", *names), rows)


@table("limits")
def limits_values() -> str:
    """Attitude error, ratio of contact forces and position error at thrust limits, by team and case: medians."""
    names = ["unlimited", *(f"{100 * level:g} %" for level in limit_flights.LEVELS), "bearable", "clipped"]
    rows = []
    for team, case in itertools.product(limit_flights.TEAMS, limit_flights.CASES):
        groups = limit_flights.flights_of(items("limits"), team, case)
        cells = []
        for name in names:
            flown = [(one[name], one["unlimited"]) for one in groups if name in one]
            kept = [(a, b) for a, b in flown if not a["termination_reason"]]
            angle = np.median([a["attitude_deg"] for a, _ in kept]) if kept else np.inf
            ratio = np.median([a["contact_force_N"] / b["contact_force_N"] for a, b in kept]) if kept else np.inf
            error = number(np.median([a["e_p_rms_m"] for a, _ in kept]), 2) if kept else ""
            ended = f" ({len(flown) - len(kept)} lost)" * (len(kept) < len(flown))
            cells.append(f"{angle:.2g}, {ratio:.2f}, {error}{ended}" if kept else "lost" if flown else "-")
        rows.append((f"`{team}`", f"`{case}`", *cells))
    return markdown(("team", "case", *names), rows)


@table("rotor_limits")
def rotor_limits_targets() -> str:
    """Targets of the flights at rotor limits."""
    return target_table(rotor_limits.targets(items("rotor_limits")))


@table("rotor_limits")
def rotor_limits_values() -> str:
    """RMS position error, or the time at which a flight ended, at rotor limits by case and limit."""
    of, rows = items("rotor_limits"), []
    shown = [limit for limit in rotor_limits.LIMITS if limit <= FINE_LIMITS_END or limit in rotor_limits.COARSE]
    for limit in shown:
        cells = []
        for case in rotor_limits.CASES:
            flown = [each for seed in rotor_limits.SEEDS if (each := of.get(f"{case} {limit:g} {seed}"))]
            errors = [number(1e3 * one["e_p_rms_m"]) if one["e_p_rms_m"] else f"{one['end_s']:.1f} s" for one in flown]
            cells.append(", ".join(errors) or "-")
        if set(cells) != {"-"}:
            rows.append((f"{limit:g}", *cells))
    return markdown(("limit [N]", *(f"`{case}` [mm]" for case in rotor_limits.CASES)), rows)


@table("cone_programs")
def cone_program_targets() -> str:
    """Targets of the solver of the allocation within limits."""
    return target_table(cone_programs.targets(items("cone_programs")))


@table("cone_programs")
def cone_program_accuracy() -> str:
    """Differences of the solver from Clarabel by number of contacts."""
    rows = []
    for contacts in cone_programs.RINGS:
        if blocks := cone_programs.blocks_of(items("cone_programs"), contacts):
            counts = (sum(one[name] for one in blocks) for name in ("programs", "flagged", "different"))
            worst = (max(one[name] for one in blocks) for name in ("objective_error", "violation_N"))
            rows.append((contacts, *counts, *worst))
    return markdown(
        (
            "contacts",
            "programs",
            "not converged",
            "different",
            "largest error of the objective",
            "largest violation [N]",
        ),
        rows,
    )


@table("cone_programs")
def cone_program_iterations() -> str:
    """Iterations of the solver and its residual at 95 % of the need, by team and case."""
    rows = []
    for team, case in itertools.product(limit_flights.TEAMS, cone_programs.CASES):
        if one := items("cone_programs").get(f"iterations {team} {case}"):
            values = (one[name] for name in ("median", "percentile_99", "residual_percentile_99_N", "end_s"))
            rows.append((f"`{team}`", f"`{case}`", *values))
    return markdown(("team", "case", "median", "99th percentile", "residual, 99th percentile [N]", "end [s]"), rows)


@table("starts")
def generated_teams() -> str:
    """Teams of `colift init`: safety check, and position error of C1 to C3."""
    rows = []
    for item, one in items("starts").items():
        e = [one["e_p_rms_m"][case] for case in ("C1", "C2", "C3")]
        falls = None not in e and e[0] > e[1] > e[2]
        rows.append((item, one["passed"], *(None if x is None else 1e3 * x for x in e), bool(falls and one["passed"])))
    return markdown(("agents x arms", "safety check passed", *_columns("C1", "C2", "C3"), "met"), rows)


def _columns(*cases: str) -> tuple[str, ...]:
    return tuple(f"`{case}` ({CASES[case]}) [mm]" for case in cases)


@table("realization")
def random_teams() -> str:
    """Random teams with bound directions: targets, and flights by the verdict of the preflight check."""
    found = items("realization")
    rows = [(each.description, each.measured, each.limit, each.met) for each in realization.targets(found)]
    for verdict in ("sound", "weak", "unsound"):
        chosen = [one for one in found.values() if one["verdict"] == verdict]
        for case in ("C1", "C3"):
            complete = sum(not one[case]["termination_reason"] for one in chosen)
            rows.append(
                (
                    f"verdict {verdict}: complete flights of {case} ({CASES[case]})",
                    f"{complete} of {len(chosen)}",
                    None,
                    None,
                )
            )
    return markdown(("random teams", "value", "limit", "met"), rows)


@table("payloads")
def user_payloads() -> str:
    """Three vehicles with nine payloads: verdict, options that were typed, and C1."""
    found = items("payloads")
    rows = [(each.description, each.measured, each.limit, each.met) for each in payloads.targets(found)]
    for vehicle in user_teams.VEHICLES:
        chosen = [one for name, one in found.items() if name.split()[0] == vehicle]
        complete = [one for one in chosen if not one["C1"]["termination_reason"]]
        as_written = sum(not one["typed"] for one in complete)
        value = f"{len(complete)} of {len(chosen)}, {as_written} of them as written"
        rows.append((f"vehicle `{vehicle}`: complete flights of C1", value, None, None))
    return markdown(("payloads", "value", "limit", "met"), rows)


@table("verdicts")
def drawn_teams() -> str:
    """Newly drawn teams: targets, and flights by the verdict of the preflight check."""
    found = items("verdicts")
    rows = [(each.description, each.measured, each.limit, each.met) for each in verdicts.targets(found)]
    for verdict in ("sound", "weak", "unsound"):
        chosen = [one for one in found.values() if one["verdict"] == verdict]
        good = sum(map(verdicts.as_predicted, chosen))
        what = f"verdict {verdict}: C1 and C3 complete, with a smaller error in C3"
        rows.append((what, f"{good} of {len(chosen)}", None, None))
    return markdown(("drawn teams", "value", "limit", "met"), rows)


@table("tuned")
def tuned_gains() -> str:
    """Gains before and after tuning, and by random search: decay rate, cost, and position errors."""
    slowest = limits("tuned")["SLOWEST"]
    rows = []
    for team, one in items("tuned").items():
        cost = {}
        for kind in KINDS:
            rate, moved = max(one[kind][name] for name in slowest), one[kind]["contact_displacement_C1_m"]
            cost[kind] = np.inf if isinstance(moved, str) else moved / -rate
        for kind, meaning in KINDS.items():
            rate = -max(one[kind][name] for name in slowest)
            flown, other = (_errors(one[kind][where]) for where in ("training", "held_out"))
            met = None
            if kind == "tuned_gains":
                met = bool(
                    one["passed"]
                    and cost["tuned_gains"] < min(cost["default_gains"], cost["random_search"])
                    and flown[1]
                    and other[1]
                )
            rows.append((f"`{team}`", meaning, rate, cost[kind], flown[0], other[0], met))
    header = (
        "team",
        "gains",
        "slowest decay rate [1/s]",
        "cost [m s]",
        "C1, C2, C3 [mm]",
        "held-out: C1, C2, C3 [mm]",
        "met",
    )
    return markdown(header, rows)


def _errors(flown: dict[str, Any]) -> tuple[str, bool]:
    """Return position errors of C1 to C3 [mm], and whether they decrease."""
    e = [np.inf if isinstance(one, str) else 1e3 * one["e_p_rms_m"] for one in flown.values()]
    return ", ".join("ended early" if np.isinf(x) else number(x) for x in e), bool(
        np.isfinite(e).all() and e[0] > e[1] > e[2]
    )


@table("redundant")
def redundant_joints() -> str:
    """Return position errors of each case for teams with redundant joints or two arms per agent."""
    cases = ("C1", "C2", "C3", "adaptive")
    rows = []
    for item, one in items("redundant").items():
        team, seed, *changes = item.split()
        stopped = [case for case in cases if one[case]["termination_reason"]]
        e = [None if one[case]["termination_reason"] else 1e3 * one[case]["e_p_rms_m"] for case in cases]
        order = e[1:] if changes else e
        falls = not stopped and all(a > b for a, b in itertools.pairwise(order))
        rows.append((f"`{team}`", int(seed), "no" if changes else "yes", *e, bool(falls)))
    return markdown(("team", "seed", "force sensor bias", *_columns(*cases), "errors fall"), rows)


@table("baselines")
def baseline_tuning() -> str:
    """Baselines on the tuning seeds: best position error of the grid, and number of settings."""
    grids: dict[str, list[float]] = {}
    for item, error in items("baselines").items():
        grids.setdefault(item.rsplit(" ", 1)[0], []).append(1e3 * error)
    seeds = limits("baselines")["SEEDS"]
    rows = [
        (
            f"`{case}`",
            CASES[case],
            len(grid),
            min(grid),
            float(np.median(grid)),
            max(grid),
            f"{seeds[0]} to {seeds[-1]}",
        )
        for case, grid in grids.items()
    ]
    return markdown(("case", "meaning", "settings", "best [mm]", "median [mm]", "worst [mm]", "seeds"), rows)
