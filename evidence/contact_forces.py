"""Flights without tip force sensors against flights with them, on three teams; `bar` is not shipped.

The contact forces come from tip force sensors, or from priors of the residuals: without a calibration flight, or after
one of 10 s. An observer with a random-walk wrench and constant noise is a first-order filter in steady state, so the
momentum observer without calibration is flown with several bandwidths. The seeds are not used for any tuning or test.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import colift
from colift.closed_loop import flight
from colift.scenario import Scenario
from evidence import collect
from evidence.targets import Target, report
from tests.support import planar_teams

TEAMS = ("paper", "trio", "bar")
SEEDS = range(44_000, 44_005)
CASES = ("C1", "C2", "C3", "label_feedback", "adaptive")
CALIBRATION = 10.0  # s
KINDS: dict[str, dict[str, Any]] = {
    "tip_sensors": {"kind": "tip_sensors"},
    "momentum_observer": {"kind": "momentum_observer"},
    "least_squares": {"kind": "least_squares"},
    "momentum_observer, calibrated": {"kind": "momentum_observer", "calibration_s": CALIBRATION},
    "least_squares, calibrated": {"kind": "least_squares", "calibration_s": CALIBRATION},
}
BANDWIDTHS = (2.0, 5.0, 20.0)  # Hz, of the momentum observer without calibration; its default is 50 Hz
CALIBRATED = [kind for kind in KINDS if kind.endswith("calibrated")]


def settings_of(team: str, seed: int, kind: dict[str, Any], bandwidth: float | None = None) -> Scenario:
    """Return the scenario of a team with one kind of contact forces."""
    base = planar_teams.bar() if team == "bar" else colift.load_scenario(team)
    data = base.model_dump() | {"contact_forces": kind, "seed": seed}
    if bandwidth is not None:
        data["sensors"] = base.sensors.model_dump() | {"tip_force_bandwidth_Hz": bandwidth}
    return Scenario.model_validate(data)


def simulate(settings: Scenario, case: str) -> dict[str, Any]:
    """Return errors of tracking, contact forces and wrench mismatch of a flight, in its second half."""
    return errors_of(flight.run_experiment(colift.make_experiment(settings, case)))


def errors_of(result: flight.FlightResult) -> dict[str, Any]:
    """Return errors of tracking, contact forces and wrench mismatch in the second half of a flight."""
    rows = result.records
    half = slice(len(rows.t) // 2, None)

    def rms(x: Any) -> float:
        return float(np.sqrt((np.asarray(x)[half] ** 2).sum(-1).mean()))

    found: dict[str, Any] = {
        "termination_reason": result.termination_reason,
        "e_p_rms_m": rms(rows.e_p),
        "e_R_rms": rms(rows.e_R),
        "contact_force_error_N": rms(np.asarray(rows.lam_hat) - rows.lam),
    }
    if rows.lam_std is None:  # an estimate of the mismatch from the readings
        net = (np.asarray(rows.lam_hat) - rows.lam).sum(1)
        return found | {"mismatch_error_N": rms(net)}
    return found | {
        "contact_force_std_N": rms(rows.lam_std),
        "mismatch_error_N": rms((np.asarray(rows.delta_W_hat) - rows.delta_W)[:, :3]),
    }


def compute_item(item: str) -> dict[str, Any]:
    """Return the flights of a team and a seed by kind and case."""
    team, seed = item.split()
    found: dict[str, Any] = {
        kind: {case: simulate(settings_of(team, int(seed), given), case) for case in CASES}
        for kind, given in KINDS.items()
    }
    for bandwidth in BANDWIDTHS:
        scenario = settings_of(team, int(seed), KINDS["momentum_observer"], bandwidth)
        found[f"momentum_observer, {bandwidth:g} Hz"] = {"C1": simulate(scenario, "C1")}
    return found


def ratio_to_tip_sensors(flights: Sequence[dict[str, Any]], kind: str, case: str) -> tuple[float, float]:
    """Return the mean RMS position error over that with tip sensors, and the largest ratio of one seed."""
    errors = np.array([[each[name][case]["e_p_rms_m"] for each in flights] for name in (kind, "tip_sensors")])
    return float(errors[0].mean() / errors[1].mean()), float((errors[0] / errors[1]).max())


def targets(found: dict[str, Any]) -> list[Target]:
    """Return targets: tracking relative to tip sensors, and errors of the contact forces."""
    out = []
    for team in TEAMS:
        flights = [each for item, each in found.items() if item.split()[0] == team]
        for case, most in (("C3", 1.3), ("label_feedback", 1.1), ("adaptive", 1.3)):
            for kind in CALIBRATED:
                mean, largest = ratio_to_tip_sensors(flights, kind, case)
                name = f"{team}, {kind}: RMS e_p of {case} over that with tip sensors, mean of the seeds"
                out.append(Target(name, mean, most=most, note=f"largest of a seed {largest:.2f}"))
        for kind in CALIBRATED:
            errors = [each[kind]["C3"]["contact_force_error_N"] for each in flights]
            out.append(Target(f"{team}, {kind}: error of a contact force, C3", max(errors), most=0.35, unit="N"))
            ratios = [
                each[kind]["C3"]["mismatch_error_N"] / each["tip_sensors"]["C3"]["mismatch_error_N"] for each in flights
            ]
            out.append(
                Target(f"{team}, {kind}: error of the wrench mismatch over that with tip sensors", max(ratios), 2)
            )
    every = [each[kind] for each in found.values() for kind in KINDS]
    held = [of["C3"]["e_p_rms_m"] < of["C2"]["e_p_rms_m"] < of["C1"]["e_p_rms_m"] for of in every]
    out.append(Target("share of flights with C3 < C2 < C1, all kinds", sum(held) / len(held), least=1.0))
    return out


def main() -> bool:
    """Print the targets and return whether all are met."""
    items = [f"{team} {seed}" for team in TEAMS for seed in SEEDS]
    return report(targets(collect("contact_forces", items, compute_item)))
