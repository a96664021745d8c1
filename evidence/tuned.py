"""Teams from `new`, `check` and `tune` alone: gains of `new`, tuned, and by random search of as many loops and flights.

Flown as the scenario stands, and held out: another seed, the path flown a quarter faster.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from colift import scenario
from colift.analysis import gain_tuning, metrics, preflight
from colift.closed_loop.flight import run_experiment
from colift.scenario import Scenario, experiment, template
from evidence import collect

TEAMS = ("seven", "trio", "beam", "uneven", "plate")
CASES = ("C1", "C2", "C3")
SLOWEST = ("slowest_mode_1ps", "slowest_mode_delayed_1ps", "slowest_mode_true_parameters_1ps")


def fly(item: str) -> dict[str, Any]:
    """The loops of one team with each kind of gains, and the RMS errors of each case over the second half."""
    before, after, spent = gain_tuning.tune(as_new(scenario.load_scenario(item)))
    found = preflight.run_preflight(after.settings)
    by_chance = chance(before, spent)
    kinds = {"default_gains": before, "tuned_gains": after, "random_search": by_chance}
    return {
        "passed": found.passed,
        "report": found.format_report(),
        "evaluations": spent._asdict(),
        **{
            kind: {
                "control": of.settings.control.model_dump(mode="json"),
                **gain_tuning.summary_values(of),
                "training": flown(of.settings),
                "held_out": flown(held_out(of.settings)),
            }
            for kind, of in kinds.items()
        },
    }


def as_new(settings: Scenario) -> Scenario:
    """With the gains that `colift init` writes."""
    control = scenario.parse(template.scenario_template("new", 3, 1), "new.yaml").control
    gains = {name: getattr(control, name) for name in gain_tuning.tunable_gains(settings)}
    return settings.model_copy(update={"control": settings.control.model_copy(update=gains)})


def chance(before: gain_tuning.LoopDesign, spent: gain_tuning.EvaluationBudget) -> gain_tuning.LoopDesign:
    """The best of as many loops and flights, with gains drawn evenly, as logarithms, from where `tune` looks.

    All loops are looked at, then the fastest are flown.
    """
    rng, drawn = np.random.default_rng(0), [before]
    low, high = gain_tuning.search_bounds(before)
    for _ in range(spent.linearizations - 1):
        steps = rng.uniform(low, high)
        with contextlib.suppress(ValueError):  # no rest
            drawn.append(gain_tuning.linearize_scenario(gain_tuning.scale_gains(before.settings, steps)))
    drawn.sort(key=lambda of: of.cost)
    flown = [
        of
        for of in map(gain_tuning.simulate_cost, drawn[: spent.simulations])
        if isinstance(of, gain_tuning.FlightCost)
    ]
    return min(flown, key=lambda of: of.cost).loop if flown else drawn[0]


def held_out(settings: Scenario) -> Scenario:
    """Another seed, and the reference a quarter faster."""
    path = settings.reference
    faster = path.model_copy(update={"period_s": tuple(0.8 * period for period in path.period_s)})
    return settings.model_copy(update={"seed": settings.seed + 1000, "reference": faster})


def flown(settings: Scenario) -> dict[str, dict[str, float] | str]:
    """By case, RMS errors, or why it ended early."""
    errors: dict[str, dict[str, float] | str] = {}
    for case, plan in experiment.make_experiments(settings, CASES).items():
        flight = run_experiment(plan)
        summary = metrics.summary(flight, plan.world.team, plan.controller.team)
        errors[case] = flight.termination_reason or {
            name: summary[name] for name in ("e_p_rms_m", "e_R_rms", "Psi_mean")
        }
    return errors


def falls(errors: dict[str, Any], name: str) -> bool:
    """Whether an error falls from C1 to C3, all complete."""
    if any(isinstance(errors[case], str) for case in CASES):
        return False
    return errors["C1"][name] > errors["C2"][name] > errors["C3"][name]


def cost(of: dict[str, Any]) -> float:
    """m s, what `tune` makes small: how far contacts are off over how fast the slowest mode decays."""
    slowest = max(of[name] for name in SLOWEST)
    return np.inf if isinstance(of["contact_displacement_C1_m"], str) else of["contact_displacement_C1_m"] / -slowest


def main() -> bool:
    """Every team must pass the check, have the smallest cost with tuned gains, and keep the order of the cases."""
    found, good = collect("tuned", TEAMS, fly), True
    for item in TEAMS:
        of = found[item]
        costs = {kind: cost(of[kind]) for kind in ("default_gains", "tuned_gains", "random_search")}
        for kind, each in costs.items():
            slowest = max(of[kind][name] for name in SLOWEST)
            said = ", ".join(
                f"{case} {e if isinstance(e, str) else format(1e3 * e['e_p_rms_m'], '.1f') + ' mm'}"
                for where in ("training", "held_out")
                for case, e in of[kind][where].items()
            )
            order = all(falls(of[kind][where], "e_p_rms_m") for where in ("training", "held_out"))
            print(f"{item:7} {kind:13} {slowest:+.2f} 1/s, {each:.3g} m s, {said}{'' if order else ': NOT in order'}")
        print("\n".join(f"{'':7} {line}" for line in of["report"][-1:]))
        good &= of["passed"] and costs["tuned_gains"] < min(costs["default_gains"], costs["random_search"])
        good &= all(falls(of["tuned_gains"][where], "e_p_rms_m") for where in ("training", "held_out"))
    return good


if __name__ == "__main__":
    main()
