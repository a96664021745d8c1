"""Flights with changes of the environment and sensor failures: C3, `label_feedback`, `adaptive` and `true_residual`.

Each sample draws a seed, a rotation of the wind, a mass step of the payload, a path outside of the training data, true
and nominal actuator lag, label dropout and noise. All cases have preview and the same nominal lag. Case
`label_feedback` is simulated with its default lead time, and with the best one in nominal conditions (`evidence
baselines`). Errors are those after the changes. For samples with label dropout, `gp_label_feedback` is simulated with
the correction that is held and with the decaying one of `adaptive`. C1 is simulated if `adaptive` does not complete the
flight.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop import log
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.onboard.control import preview
from colift.scenario import Scenario, controllers, experiment
from evidence import collect
from evidence.targets import Target, report

SAMPLES = 200
KEY = 2026  # of the random numbers
CASES = ("C3", "label_feedback", "adaptive", "true_residual")
LEAD_TIME = 0.04  # s, of the second variant of label_feedback
DELAYS = ((0, 0), (3, 4), (5, 4))  # ticks, true and nominal; each pair is compiled separately
DECAYING = "gp_label_feedback decaying"  # with the decaying correction of `adaptive`
CHANGE_TIME, EVALUATION_START = 13.0, 14.5  # s
SECOND_HALF, AFTER_CHANGE = (10.0, 20.0), (CHANGE_TIME, CHANGE_TIME + 1)  # s


def draw(sample: int, key: int = KEY) -> tuple[Scenario, dict[str, Any]]:
    """Return the scenario of a sample and its random parameters; another key gives other samples, for tuning."""
    rng = np.random.default_rng((key, sample))
    parameters = {
        "wind_turn_deg": float(rng.uniform(-180, 180)) * (rng.random() < 0.7),
        "added_mass_kg": 1.5 * float(rng.uniform(-0.2, 0.4)) * (rng.random() < 0.6),
        "path_offset_m": [float(x) for x in rng.uniform(-1, 1, 2) * (rng.random() < 0.4)],
        "actuator_lag_s": float(rng.uniform(0, 0.03)),
        "nominal_lag_ratio": float(rng.uniform(0.7, 1.3)),
        "delay_ticks": DELAYS[sample % len(DELAYS)],
        "dropout_probability": float(rng.uniform(0, 1)) if rng.random() < 0.4 else 0.0,
        "label_failure_time_s": 16.0 if rng.random() < 0.3 else None,
        "noise_scale": float(rng.uniform(0.5, 3.0)),
    }
    base = scenario.load_scenario("paper")
    data = base.model_dump()
    for source in data["disturbances"]:
        if source["kind"] == "wind":
            source["direction_change"] = {
                "change_deg": parameters["wind_turn_deg"],
                "start_s": CHANGE_TIME,
                "ramp_time_s": 0.3,
            }
    data["payload_mass_step"] = {"mass_kg": parameters["added_mass_kg"], "start_s": CHANGE_TIME}
    data["reference"]["departure"] = {
        "offset_m": [*parameters["path_offset_m"], 0.0],
        "start_s": 11.0,
        "ramp_time_s": 3.0,
    }
    fast = 1 / max(2 * np.pi * parameters["actuator_lag_s"], 1e-4)
    tick = 1 / base.control_Hz
    true, nominal = parameters["delay_ticks"]
    data["actuators"] = {"kind": "motors", "bandwidth_Hz": fast, "delay_s": true * tick}
    data["nominal"]["actuators"] = {"bandwidth_Hz": fast / parameters["nominal_lag_ratio"], "delay_s": nominal * tick}
    data["sensors"] |= scaled_noise(data["sensors"], parameters["noise_scale"])
    ended = {
        "kind": "intermittent",
        "channels": ["agents.lam"],
        "rate_Hz": base.control_Hz,
        "dropout_probability": min(parameters["dropout_probability"], 0.99),
    }
    data["sensors"]["models"] = [ended | {"failure_time_s": parameters["label_failure_time_s"]}]
    data["control"]["preview_step_s"] = preview.PREVIEW_STEP
    data["seed"] = 1000 * (1 + key - KEY) + sample
    return Scenario.model_validate(data), parameters


def scaled_noise(sensors: dict[str, Any], scale: float) -> dict[str, float]:
    """Return the standard deviations of sensors, multiplied by a factor."""
    return {name: x * scale for name, x in sensors.items() if isinstance(x, float) and "Hz" not in name}


def simulate_item(item: str) -> dict[str, Any]:
    """Return for each case of a sample the RMS position error after the changes [m] and other metrics."""
    settings, parameters = draw(int(item))
    experiments = experiment.make_experiments(
        settings, (*CASES, *(["gp_label_feedback"] if parameters["label_failure_time_s"] else []))
    )
    experiments["label_feedback tuned_lead"] = with_lead_time(settings)
    if parameters["label_failure_time_s"]:
        experiments[DECAYING] = decaying(experiments["gp_label_feedback"], experiments["adaptive"])
    cases = {case: simulate_case(case_experiment) for case, case_experiment in experiments.items()}
    if cases["adaptive"]["termination_reason"]:
        cases["C1"] = simulate_case(experiment.make_experiment(settings, "C1"))
    return {"sample": parameters, **cases}


def with_lead_time(settings: Scenario) -> Experiment:
    """Return the experiment of `label_feedback` with the best lead time in nominal conditions."""
    plan = experiment.make_experiment(settings, "label_feedback")
    return dataclasses.replace(plan, controller=controllers.with_lead_time(plan.controller, LEAD_TIME))


def decaying(held_correction: Experiment, adaptive: Experiment) -> Experiment:
    """Return the experiment of `gp_label_feedback` with the decaying correction of `adaptive`."""
    controller = dataclasses.replace(
        held_correction.controller,
        residual_corrector=adaptive.controller.residual_corrector,
        residual_predictor=adaptive.controller.residual_predictor,
    )
    return dataclasses.replace(held_correction, controller=controller)


def simulate_case(case_experiment: Experiment) -> dict[str, Any]:
    """Return the stored metrics of a flight; None for those that a flight that ended early does not have."""
    flight = run_experiment(case_experiment)
    rows, late = flight.records, flight.records.t >= EVALUATION_START
    first_second = late & (rows.t < EVALUATION_START + 1)
    found = {
        "e_p_rms_m": metrics.rms_norm(rows.e_p[late]) if late.any() else None,
        "e_p_rms_first_second_m": metrics.rms_norm(rows.e_p[first_second]) if first_second.any() else None,
        "termination_reason": flight.termination_reason,
        "contact_force_hf_rms_N": metrics.high_frequency_rms(metrics.second_half(rows)),
        "miscoverage": {
            name: miscoverage(flight, *span)
            for name, span in (("second_half", SECOND_HALF), ("after_change", AFTER_CHANGE))
        },
    }
    return {key: None if isinstance(x, float) and not np.isfinite(x) else x for key, x in found.items()}


def miscoverage(flight: FlightResult, start: float, end: float) -> float | None:
    """Return the share of force errors above 1.96 predictive standard deviations from start to end [s]."""
    at = log.uncertainty_indices(flight.records, flight.uncertainty)
    now = (flight.uncertainty.t >= start) & (flight.uncertainty.t < end)
    errors = flight.records.f_L - flight.records.f_L_hat, flight.records.f_x - flight.records.f_x_hat
    off = [
        np.abs(e[at][now]) / s[now]
        for e, s in zip(errors, log.predictive_std(flight.records, flight.uncertainty), strict=True)
    ]
    return float(np.mean([(x > 1.96).mean() for x in off])) if now.any() else None


def share(ratios: list[float], maximum: float) -> tuple[int, str]:
    """Return the number of ratios within a bound, and their distribution as text."""
    x = np.array(ratios)
    within = int((x <= maximum).sum())
    spread = f"median {np.median(x):.2f}, 90 % {np.quantile(x, 0.9):.2f}, worst {x.max():.2f}"
    return within, f"{within} of {len(x)} ({spread})"


def main() -> bool:
    """Print the comparison and the targets of `adaptive`; return whether all are met."""
    found_of = collect("react", map(str, range(SAMPLES)), simulate_item)
    ended = {
        case: [item for item, found in found_of.items() if found[case]["termination_reason"]]
        for case in (*CASES, "label_feedback tuned_lead")
    }
    print("ended early: " + ", ".join(f"{case} {len(items)}" for case, items in ended.items()))
    whole = {
        item: found
        for item, found in found_of.items()
        if not any(found[case]["termination_reason"] for case in ("adaptive", "true_residual"))
    }

    for case in (*CASES, "label_feedback tuned_lead"):
        e = [1e3 * error(f, case) for f in whole.values()]
        spread = f"median {np.median(e):.1f} mm, 90 % {np.quantile(e, 0.9):.1f}, worst {max(e):.1f}"
        print(f"{case:5} e_p after the changes: {spread}")
    return report(targets(found_of))


def error(found: dict[str, Any], case: str) -> float:
    """Return the position error of a case after the changes [m]; infinite if its flight ended early."""
    e = found[case]["e_p_rms_m"]
    return np.inf if found[case]["termination_reason"] or e is None else e


def targets(found_of: dict[str, Any]) -> list[Target]:
    """Return targets over the samples in which `adaptive` and `true_residual` complete their flights."""

    def over(flights: list[dict[str, Any]], *cases: str) -> list[float]:
        return [error(f, "adaptive") / min(error(f, case) for case in cases) for f in flights]

    ended = [item for item, found in found_of.items() if found["adaptive"]["termination_reason"]]
    every = [
        found
        for found in found_of.values()
        if not any(found[case]["termination_reason"] for case in ("adaptive", "true_residual"))
    ]
    with_labels = [f for f in every if f["sample"]["label_failure_time_s"] is None]
    without_labels = [f for f in every if f["sample"]["label_failure_time_s"] is not None]
    stepped = [f for f in every if abs(f["sample"]["wind_turn_deg"]) > 30 or abs(f["sample"]["added_mass_kg"]) > 0.1]
    first_second = [
        f["adaptive"]["e_p_rms_first_second_m"] / f["true_residual"]["e_p_rms_first_second_m"] for f in stepped
    ]
    outside = {span: [f["adaptive"]["miscoverage"][span] for f in every] for span in ("second_half", "after_change")}
    parameters = (  # quantity, values, largest value, required share of the flights
        ("with labels: e_p of adaptive over true_residual", over(with_labels, "true_residual"), 2.5, 0.9),
        (
            "without labels: e_p of adaptive over the smallest of C3, gp_label_feedback and its decaying variant",
            over(without_labels, "C3", "gp_label_feedback", DECAYING),
            1.15,
            1.0,
        ),
        ("e_p of adaptive over the smaller of C3 and label_feedback", over(every, "C3", "label_feedback"), 1.15, 1.0),
        (
            "the same, with label_feedback also at its best lead time",
            over(every, "C3", "label_feedback", "label_feedback tuned_lead"),
            1.15,
            1.0,
        ),
        ("1.5 s to 2.5 s after a step change: e_p of adaptive over true_residual", first_second, 2.0, 1.0),
        (
            "contact forces of adaptive above 20 Hz [N RMS]",
            [f["adaptive"]["contact_force_hf_rms_N"] for f in every],
            0.2,
            1.0,
        ),
        (
            "share of errors of adaptive above 1.96 predictive standard deviations, second half",
            outside["second_half"],
            0.1,
            1.0,
        ),
        ("the same, within 1 s after a change", outside["after_change"], 0.1, 1.0),
    )
    shares = []
    for quantity, ratios, maximum, least in parameters:
        within, note = share(ratios, maximum)
        percent = 100 * within / len(ratios)
        shares.append(
            Target(f"{quantity}, at most {maximum:g}", percent, least=100 * least, unit="% of flights", note=note)
        )
    worse = sum(found_of[item]["C1"]["termination_reason"] == "" for item in ended)
    return [*shares, Target("flights that C1 completes and adaptive does not", worse, most=0)]


if __name__ == "__main__":
    main()
