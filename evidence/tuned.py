"""Teams from `new`, `check` and `tune` alone: gains of `new`, tuned, and by random search of as many loops, all flown.

Flown as the scenario stands, and held out: another seed, the path flown a quarter faster.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from colift import analyse, checkup, scenario, simulate, starter, study, tune
from colift.scenario import Settings
from evidence import collect

TEAMS = ("seven", "trio", "beam", "uneven", "plate")
CASES = ("C1", "C2", "C3")
SLOWEST = ("slowest_mode_1ps", "slowest_mode_late_1ps", "slowest_mode_learned_1ps")


def fly(item: str) -> dict[str, Any]:
    """The loops of one team with each kind of gains, and the RMS errors of each case over the second half."""
    before, after, used = tune.tune(as_new(scenario.load(item)))
    found = checkup.check(after.settings)
    by_chance = chance(before, used)
    kinds = {"hand": before, "tuned": after, "random": by_chance}
    return {
        "sound": found.sound,
        "says": found.lines(),
        "loops": used,
        **{
            kind: {
                "control": of.settings.control.model_dump(mode="json"),
                **tune.numbers(of),
                "flown": flown(of.settings),
                "held_out": flown(held_out(of.settings)),
            }
            for kind, of in kinds.items()
        },
    }


def as_new(settings: Settings) -> Settings:
    """With the gains that `colift new` writes."""
    control = scenario.parse(starter.text("new", 3, 1), "new.yaml").control
    gains = {name: getattr(control, name) for name in tune.names(settings)}
    return settings.model_copy(update={"control": settings.control.model_copy(update=gains)})


def chance(before: tune.Loop, loops: int) -> tune.Loop:
    """The best of as many loops with gains drawn evenly, as logarithms, from where `tune` looks."""
    rng, best = np.random.default_rng(0), before
    size = len(tune.names(before.settings))
    for _ in range(loops - 1):
        try:
            tried = tune.loop(tune.scaled(before.settings, rng.uniform(-tune.FARTHEST, tune.FARTHEST, size)))
        except ValueError:  # no rest
            continue
        best = min(best, tried, key=lambda of: of.growth)
    return best


def held_out(settings: Settings) -> Settings:
    """Another seed, and the reference a quarter faster."""
    path = settings.reference
    faster = path.model_copy(update={"period_s": tuple(0.8 * period for period in path.period_s)})
    return settings.model_copy(update={"seed": settings.seed + 1000, "reference": faster})


def flown(settings: Settings) -> dict[str, dict[str, float] | str]:
    """By case, RMS errors, or why it ended early."""
    errors: dict[str, dict[str, float] | str] = {}
    for case, plan in study.plans(settings, CASES).items():
        flight = simulate.fly_plan(plan)
        summary = analyse.summary(flight, plan.world.team, plan.pilot.team)
        errors[case] = flight.stopped or {name: summary[name] for name in ("e_p_rms_m", "e_R_rms", "Psi_mean")}
    return errors


def falls(errors: dict[str, Any], name: str) -> bool:
    """Whether an error falls from C1 to C3, all complete."""
    if any(isinstance(errors[case], str) for case in CASES):
        return False
    return errors["C1"][name] > errors["C2"][name] > errors["C3"][name]


def main() -> bool:
    """Every team is sound, decays faster when tuned than by hand and by chance, and flies in order as tuned."""
    found, good = collect("tuned", TEAMS, fly), True
    for item in TEAMS:
        of = found[item]
        for kind in ("hand", "tuned", "random"):
            each = of[kind]
            slowest = max(each[name] for name in SLOWEST)
            said = ", ".join(
                f"{case} {e if isinstance(e, str) else format(1e3 * e['e_p_rms_m'], '.1f') + ' mm'}"
                for where in ("flown", "held_out")
                for case, e in each[where].items()
            )
            order = all(falls(each[where], "e_p_rms_m") for where in ("flown", "held_out"))
            print(f"{item:7} {kind:7} {slowest:+.2f} 1/s, {said}{'' if order else ': NOT in order'}")
        rates = {kind: max(of[kind][name] for name in SLOWEST) for kind in ("hand", "tuned", "random")}
        print("\n".join(f"{'':7} {line}" for line in of["says"][-1:]))
        good &= of["sound"] and rates["tuned"] < min(rates["hand"], rates["random"])
        good &= all(falls(of["tuned"][where], "e_p_rms_m") for where in ("flown", "held_out"))
    return good


if __name__ == "__main__":
    main()
