"""Flights of `paper` at rotor limits: four rotors at 0.25 m without lag, and constrained allocation.

The RMS position error is that from 4 s to 12 s. A limit is the sum of the largest rotor forces of a vehicle. There are
four kinds of items:

- `C1 30 301`: one case, limit [N] and seed. The flight ends where the payload is 3 m from its reference.
- `C1 share 301`: one case at 95 % of its rotor need. The rotor need is the mean over time and agents, in the flight at
  50 N, of the number of rotors times the largest rotor force. The payload may sink, and the attitude error counts.
- `C1 least_squares 301`: the same flight, with constrained allocation, at 95 % of the rotor need of a flight with least
  squares. Least squares requires more yaw torque, so this limit can exceed the flight's own need.
- `C1 dip 301`: the rotors of all agents have 90 % of the rotor need from 12 s to 15 s, by a loss of effectiveness. The
  limit is 50 N, and the position error has no bound, since a bound limits the speed of return.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop.flight import FlightResult, run_experiment
from colift.models.actuator_lag import ring_mixer
from colift.scenario import Scenario, experiment
from colift.scenario import team as team_module
from evidence import collect, limits
from evidence.targets import Target, report

CASES = ("C1", "C3", "adaptive")
SEEDS = (301, 302, 303, 304, 305)  # not used for tuning
SHARE_SEEDS = tuple(range(301, 321))
LIMITS = tuple(float(x) for x in np.arange(29.0, 50.25, 0.5))  # N
COARSE = (*np.arange(29.0, 36.5, 1.0).tolist(), 40.0, 50.0)
DURATION, EVALUATION_START = 12.0, 4.0  # s
SHARE, ATTITUDE_DEG = 0.95, 10.0
NEEDS = {"share": "constrained", "least_squares": "least_squares"}  # kind of item: allocation of its rotor need
TOLERANCE = 1.05  # ratio of errors that still counts as non-increasing: errors without an active limit are noise
ROTORS = {"num_rotors": 4, "radius_m": 0.25, "moment_ratio_m": 0.016}
BANDWIDTH = 1000.0  # Hz, of the motors


def rotor_scenario(limit: float, seed: int, distance: float = 3.0, allocation: str = "constrained") -> Scenario:
    """Return the scenario at a limit of the rotors of each vehicle [N], with a limit of the position error [m]."""
    data = scenario.load_scenario("paper").model_dump()
    data |= {"seed": seed, "duration_s": DURATION}
    data["agent_types"]["two_arms"]["thrust_max_N"] = limit
    data["actuators"] = {"kind": "motors", "bandwidth_Hz": BANDWIDTH, "rotors": ROTORS}
    data["allocation"]["kind"] = allocation
    data["control"]["position_error_bound_m"] = 0.3
    data["termination"] |= {"max_position_error_m": distance, "max_saturation_time_s": 1000.0, "min_height_m": None}
    data["termination"] |= dict.fromkeys(("max_attitude_error_deg", "max_tilt_deg"), 180.0)
    return Scenario.model_validate(data)


def fly(case: str, *arguments: Any) -> FlightResult:
    """Return the flight of a case, with the arguments of `rotor_scenario`."""
    return run_experiment(experiment.make_experiment(rotor_scenario(*arguments), case))


def found(flight: FlightResult) -> dict[str, Any]:
    """Return the stored metrics of a flight; None for those that a flight that ended early does not have."""
    rows, complete = flight.records, not flight.termination_reason
    late = rows.t >= EVALUATION_START
    angles = np.degrees(2 * np.arcsin(np.sqrt(np.clip(rows.Psi / 2, 0, 1))))
    return {
        "termination_reason": flight.termination_reason,
        "end_s": float(rows.t[-1]),
        "e_p_rms_m": metrics.rms_norm(rows.e_p[late]) if complete else None,
        "attitude_deg": float(angles[late].max()) if complete else None,
    }


def rotor_need(flight: FlightResult) -> float:
    """Return the mean over time and agents of the number of rotors times the largest rotor force [N]."""
    rows = flight.records
    late = rows.t >= EVALUATION_START
    count = ROTORS["num_rotors"]
    mixer = ring_mixer(count, ROTORS["radius_m"], ROTORS["moment_ratio_m"], np.ones(1))
    inputs = np.concatenate([rows.u[late][..., None], rows.tau[late]], axis=-1)
    return float(count * (inputs @ np.asarray(mixer.mixer).T).max(-1).mean())


def dip(case: str, seed: int) -> dict[str, Any]:
    """Return the rotor need [N] and the metrics of a flight with a dip of the rotor forces."""
    base = rotor_scenario(LIMITS[-1], seed, 1000.0)
    need = rotor_need(fly(case, LIMITS[-1], seed))
    without_bound = base.control.model_dump() | {"position_error_bound_m": None}
    settings = limits.changed(base, duration_s=limits.DURATION, control=without_bound)
    shares = dict.fromkeys(team_module.agent_names(base), limits.REMAINING * need / LIMITS[-1])
    settings = limits.with_losses(settings, shares, limits.DIP_END)
    return limits.found(run_experiment(experiment.make_experiment(settings, case))) | {"need_N": need}


def simulate_item(item: str) -> dict[str, Any]:
    """Return the metrics of the flight of an item, and the rotor need [N] of an item at a share of it."""
    case, limit, seed = item.split()
    if limit == "dip":
        return dip(case, int(seed))
    if limit not in NEEDS:
        return found(fly(case, float(limit), int(seed)))
    need = rotor_need(fly(case, LIMITS[-1], int(seed), 3.0, NEEDS[limit]))
    return found(fly(case, SHARE * need, int(seed), 1000.0)) | {"need_N": need}


def items() -> list[str]:
    """Return all items; a coarse grid of the first seeds of `C1` and `C3` comes first."""
    orders = [
        (SEEDS[:1], CASES[:2], COARSE),
        (SEEDS[1:2], CASES[:2], COARSE),
        (SEEDS[:1], CASES[2:], COARSE),
        (SEEDS, CASES, LIMITS),
    ]
    grid = [f"{case} {limit:g} {seed}" for s, c, x in orders for seed, case, limit in itertools.product(s, c, x)]
    shares = [f"{case} {kind} {seed}" for kind in NEEDS for seed in SHARE_SEEDS for case in CASES]
    dips = [f"{case} dip {seed}" for seed in SEEDS for case in CASES]
    return list(dict.fromkeys(grid + shares + dips))


def worse(flight: dict[str, Any], larger: dict[str, Any]) -> bool:
    """Return whether the flight at the larger limit has a larger error, or ends earlier."""
    if flight["e_p_rms_m"] is None or larger["e_p_rms_m"] is None:
        if flight["e_p_rms_m"] is None and larger["e_p_rms_m"] is None:
            return larger["end_s"] < flight["end_s"] / TOLERANCE
        return larger["e_p_rms_m"] is None
    return larger["e_p_rms_m"] > TOLERANCE * flight["e_p_rms_m"]


def series(of: dict[str, Any], case: str, seed: int) -> dict[float, dict[str, Any]]:
    """Return the computed flights of a case and a seed by limit, in increasing order."""
    return {limit: of[item] for limit in LIMITS if (item := f"{case} {limit:g} {seed}") in of}


def increases(of: dict[str, Any], case: str) -> tuple[int, int]:
    """Return how many pairs of neighbouring computed limits have a larger error at the larger limit, and all pairs."""
    pairs = [pair for seed in SEEDS for pair in itertools.pairwise(series(of, case, seed).values())]
    return sum(worse(*pair) for pair in pairs), len(pairs)


def targets(of: dict[str, Any]) -> list[Target]:
    """Return the targets of all cases, for the items that have been computed."""
    result = []
    for case in CASES:
        count, total = increases(of, case)
        flights = sum(len(series(of, case, seed)) for seed in SEEDS)
        note = f"{count} of {total} neighbouring limits, {flights} flights"
        description = f"{case}: limits whose error exceeds that of the next smaller limit"
        result.append(Target(description, count if total else np.nan, most=0, note=note))
    for kind, case in itertools.product(NEEDS, CASES):
        shares = [of[item] for seed in SHARE_SEEDS if (item := f"{case} {kind} {seed}") in of]
        bounded = [one["attitude_deg"] is not None and one["attitude_deg"] <= ATTITUDE_DEG for one in shares]
        note = f"{sum(bounded)} of {len(bounded)} flights"
        description = f"{case}: attitude error within {ATTITUDE_DEG:g} degrees at {100 * SHARE:g} % of the rotor need"
        description += " of least squares" if kind == "least_squares" else ""
        measured = 100 * sum(bounded) / len(bounded) if bounded else np.nan
        result.append(Target(description, measured, least=100.0, unit="% of flights", note=note))
    for case in CASES:
        flights = [of[item] for seed in SEEDS if (item := f"{case} dip {seed}") in of]
        met = [limits.dip_met(flight) for flight in flights]
        description = f"{case}: dip to {100 * limits.REMAINING:g} % of the rotor need: error 4 s to 5 s after it"
        measured = 100 * sum(met) / len(met) if met else np.nan
        note = f"{sum(met)} of {len(met)} flights"
        result.append(Target(description, measured, least=100.0, unit="% of flights", note=note))
    return result


def main() -> bool:
    """Print the targets; return whether all are met."""
    return report(targets(collect("rotor_limits", items(), simulate_item)))


if __name__ == "__main__":
    main()
