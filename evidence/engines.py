"""Flights of the study with MuJoCo and with the built-in plant: same controller, initial state, noise and residuals.

Over 20 s of C1, positions of payload and agents must agree within 5 mm, attitudes within 0.5 deg at every time, and
contact forces below 10 Hz within 5 %. The order C1 > C2 > C3 must hold in MuJoCo as well. Settings of MuJoCo's step and
contacts are compared on the first seconds of C1.
"""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import mujoco
import numpy as np
from scipy.signal import butter, sosfiltfilt

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop import flight, signals
from colift.models import mjcf
from colift.scenario import experiment
from colift.simulation import mujoco_plant
from evidence import collect

CASES = ("C1", "C2", "C3")
TARGETS = {"position_m": 5e-3, "attitude_deg": 0.5, "relative_force_rms": 0.05, "relative_force_peak": 0.05}
LOW_HZ = 10.0
SHORT_S = 4.0
SETTINGS = {  # substeps, integrator, time constant in substeps (MuJoCo takes no less than 2), impedance
    "RK4, 2 ms": (1, "RK4", 2, 0.9999),
    "RK4, 1 ms": (2, "RK4", 2, 0.9999),
    "RK4, 0.5 ms": (4, "RK4", 2, 0.9999),
    "RK4, 0.25 ms": (8, "RK4", 2, 0.9999),
    "implicitfast, 2 ms": (1, "IMPLICITFAST", 2, 0.9999),
    "implicitfast, 0.5 ms": (4, "IMPLICITFAST", 2, 0.9999),
    "RK4, 0.5 ms, 10 times the time constant": (4, "RK4", 20, 0.9999),
    "RK4, 0.5 ms, 100 times the softness": (4, "RK4", 2, 0.99),
    "RK4, 0.5 ms, MuJoCo defaults": (4, "RK4", 40, 0.95),
}


def simulate_case(
    c1_experiment: flight.Experiment, plant: mujoco_plant.MujocoPlant | None
) -> tuple[flight.FlightResult, float]:
    """Return a flight and the processor time of its steps [s], after compilation by a flight of one step."""
    if plant:
        c1_experiment = dataclasses.replace(c1_experiment, world=dataclasses.replace(c1_experiment.world, plant=plant))
    flight.run_experiment(dataclasses.replace(c1_experiment, duration=c1_experiment.dt))
    began = time.process_time()
    return flight.run_experiment(c1_experiment), time.process_time() - began


def differences(a: signals.StepRecord, b: signals.StepRecord) -> dict[str, float]:
    """Return largest differences of positions and attitudes, and relative difference of contact forces below 10 Hz.

    Forces: the RMS over contacts and time, and each contact's largest difference over its largest force.
    """
    position = max(np.linalg.norm(a.p - b.p, axis=-1).max(), np.linalg.norm(a.x - b.x, axis=-1).max())
    angle = max(np.linalg.norm(x - y, axis=(-2, -1)).max() for x, y in ((a.R_L, b.R_L), (a.R, b.R)))
    low = butter(2, LOW_HZ, fs=1 / (a.t[1] - a.t[0]), output="sos")
    of_a, of_b = (
        np.linalg.norm(x, axis=2) for x in (sosfiltfilt(low, a.lam - b.lam, axis=0), sosfiltfilt(low, b.lam, axis=0))
    )
    return {
        "position_m": float(position),
        "attitude_deg": float(np.degrees(2 * np.arcsin(angle / 8**0.5))),
        "relative_force_rms": float(np.sqrt((of_a**2).mean() / (of_b**2).mean())),
        "relative_force_peak": float((of_a.max(0) / of_b.max(0)).max()),
        "constraint_residual_m": float(a.Phi.max()),
    }


def compare_case(name: str) -> dict[str, Any]:
    """Return metrics of one case in both engines, and their differences."""
    settings = scenario.load_scenario("paper")
    c1_experiment = experiment.make_experiment(settings, name)
    ours, ours_s = simulate_case(c1_experiment, None)
    theirs, theirs_s = simulate_case(
        c1_experiment,
        mujoco_plant.mujoco_plant(c1_experiment.world.team, c1_experiment.initial_state, c1_experiment.dt),
    )
    team = c1_experiment.world.team, c1_experiment.controller.team
    found = {who: metrics.summary(flight, *team)["e_p_rms_m"] for who, flight in (("colift", ours), ("mujoco", theirs))}
    stopped = ours.termination_reason or theirs.termination_reason
    return {
        "e_p_rms_m": found,
        "differences": None if stopped else differences(theirs.records, ours.records),
        "termination_reason": stopped,
        "cpu_time_s": {"colift": ours_s, "mujoco": theirs_s},
    }


def compare_settings() -> dict[str, Any]:
    """Compare the first seconds of C1 under every MuJoCo setting with the rigid-contact plant."""
    settings = scenario.load_scenario("paper")
    c1_experiment = dataclasses.replace(experiment.make_experiment(settings, "C1"), duration=SHORT_S)
    ours, ours_s = simulate_case(c1_experiment, None)
    dt, found = c1_experiment.dt, {}
    for name, (substeps, integrator, constant, impedance) in SETTINGS.items():
        softness = mjcf.ContactSoftness(time_constant=constant * dt / substeps, impedance=impedance)
        plant = mujoco_plant.mujoco_plant(c1_experiment.world.team, c1_experiment.initial_state, dt, substeps, softness)
        plant.session.model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")  # ty: ignore[missing-attribute]
        theirs, seconds = simulate_case(c1_experiment, plant)
        found[name] = differences(theirs.records, ours.records) | {"cpu_time_over_colift": seconds / ours_s}
    return found


def compare_item(item: str) -> dict[str, Any]:
    """Return the comparison of a case, or that of all solver settings."""
    return compare_settings() if item == "settings" else compare_case(item)


def main() -> bool:
    """C1 must be within the targets, and the order of the cases must hold in MuJoCo."""
    found = collect("engines", (*CASES, "settings"), compare_item)
    for name, row in found["settings"].items():
        print(f"{name:42}", "  ".join(f"{what} {value:.3g}" for what, value in row.items()))
    for name in CASES:
        if found[name]["termination_reason"]:
            print(name, found[name]["termination_reason"])
            return False
        print(name, "  ".join(f"{what} {value:.3g}" for what, value in found[name]["differences"].items()), end="   ")
        print("  ".join(f"e_p {who} {1e3 * value:.2f} mm" for who, value in found[name]["e_p_rms_m"].items()))
    c1, c2, c3 = (found[name]["e_p_rms_m"]["mujoco"] for name in CASES)
    return c1 > c2 > c3 and all(found["C1"]["differences"][what] <= most for what, most in TARGETS.items())


if __name__ == "__main__":
    main()
