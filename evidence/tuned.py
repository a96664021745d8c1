"""Gains of `init`, gains of `tune`, and random search with equal numbers of linearizations and simulations.

The scenarios are simulated unchanged and in held-out conditions: another seed, and the path 25 % faster.
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


def simulate_item(item: str) -> dict[str, Any]:
    """Return the loops of one team with each kind of gains, and RMS errors of each case over the second half."""
    before, after, spent = gain_tuning.tune(as_new(scenario.load_scenario(item)))
    found = preflight.run_preflight(after.settings)
    by_chance = random_search(before, spent)
    kinds = {"default_gains": before, "tuned_gains": after, "random_search": by_chance}
    return {
        "passed": found.passed,
        "report": found.format_report(),
        "evaluations": spent._asdict(),
        **{
            kind: {
                "control": of.settings.control.model_dump(mode="json"),
                **gain_tuning.summary_values(of),
                "training": simulate_cases(of.settings),
                "held_out": simulate_cases(held_out(of.settings)),
            }
            for kind, of in kinds.items()
        },
    }


def as_new(settings: Scenario) -> Scenario:
    """Return the scenario with the gains that `colift init` writes."""
    control = scenario.parse(template.scenario_template("new", 3, 1), "new.yaml").control
    gains = {name: getattr(control, name) for name in gain_tuning.tunable_gains(settings)}
    return settings.model_copy(update={"control": settings.control.model_copy(update=gains)})


def random_search(before: gain_tuning.LoopDesign, spent: gain_tuning.EvaluationBudget) -> gain_tuning.LoopDesign:
    """Search the gains at random, with as many linearizations and simulations as `tune` used.

    Gains are drawn log-uniformly from the search range of `tune`. All loops are linearized, and flights are simulated
    with those that decay fastest.
    """
    rng, drawn = np.random.default_rng(0), [before]
    low, high = gain_tuning.search_bounds(before)
    for _ in range(spent.linearizations - 1):
        steps = rng.uniform(low, high)
        with contextlib.suppress(ValueError):  # no equilibrium
            drawn.append(gain_tuning.linearize_scenario(gain_tuning.scale_gains(before.settings, steps)))
    drawn.sort(key=lambda of: of.cost)
    flown = [
        of
        for of in map(gain_tuning.simulate_cost, drawn[: spent.simulations])
        if isinstance(of, gain_tuning.FlightCost)
    ]
    return min(flown, key=lambda of: of.cost).loop if flown else drawn[0]


def held_out(settings: Scenario) -> Scenario:
    """Return the scenario with another seed and a reference that is 25 % faster."""
    path = settings.reference
    faster = path.model_copy(update={"period_s": tuple(0.8 * period for period in path.period_s)})
    return settings.model_copy(update={"seed": settings.seed + 1000, "reference": faster})


def simulate_cases(settings: Scenario) -> dict[str, dict[str, float] | str]:
    """Return RMS errors of each case, or the reason of an early end."""
    errors: dict[str, dict[str, float] | str] = {}
    for case, one in experiment.make_experiments(settings, CASES).items():
        flight = run_experiment(one)
        summary = metrics.summary(flight, one.world.team, one.controller.team)
        errors[case] = flight.termination_reason or {
            name: summary[name] for name in ("e_p_rms_m", "e_R_rms", "Psi_mean")
        }
    return errors


def decreases(errors: dict[str, Any], name: str) -> bool:
    """Return whether an error decreases from C1 to C3 in complete flights."""
    if any(isinstance(errors[case], str) for case in CASES):
        return False
    return errors["C1"][name] > errors["C2"][name] > errors["C3"][name]


def cost(of: dict[str, Any]) -> float:
    """Return the cost that `tune` minimizes [m s]: contact error over decay rate of the slowest mode."""
    slowest = max(of[name] for name in SLOWEST)
    return np.inf if isinstance(of["contact_displacement_C1_m"], str) else of["contact_displacement_C1_m"] / -slowest


def main() -> bool:
    """Every team must pass the check, have the smallest cost with tuned gains, and keep the order of the cases."""
    found, good = collect("tuned", TEAMS, simulate_item), True
    for item in TEAMS:
        of = found[item]
        costs = {kind: cost(of[kind]) for kind in ("default_gains", "tuned_gains", "random_search")}
        for kind, each in costs.items():
            slowest = max(of[kind][name] for name in SLOWEST)
            output = ", ".join(
                f"{case} {e if isinstance(e, str) else format(1e3 * e['e_p_rms_m'], '.1f') + ' mm'}"
                for where in ("training", "held_out")
                for case, e in of[kind][where].items()
            )
            order = all(decreases(of[kind][where], "e_p_rms_m") for where in ("training", "held_out"))
            print(f"{item:7} {kind:13} {slowest:+.2f} 1/s, {each:.3g} m s, {output}{'' if order else ': NOT in order'}")
        print("\n".join(f"{'':7} {line}" for line in of["report"][-1:]))
        good &= of["passed"] and costs["tuned_gains"] < min(costs["default_gains"], costs["random_search"])
        good &= all(decreases(of["tuned_gains"][where], "e_p_rms_m") for where in ("training", "held_out"))
    return good


if __name__ == "__main__":
    main()
