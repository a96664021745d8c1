"""The certificate where every assumption holds: 200 draws of the unknown forces, and adversaries that fit the data.

Certified radii are never exceeded (the energy bound and optimal recovery hold for certain, so the confidence is 1);
how tight they are, with the floor that no learning removes and without; and certificate over adversary, recomputed on
the run that the adversary produces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from colift import scenario, study
from evidence import collect

RUNS, FIRST = 200, 100  # seeds 100 to 299: the scenario was made with others
ADVERSARIES = range(FIRST, FIRST + 8)
NAMES = ("energy", "recovery")

_loop: list[Any] = []  # the team's response, the same for all seeds


def fly(seed: int, rounds: int) -> dict[str, Any]:
    """One certified flight; with rounds, its adversary's as well."""
    settings = scenario.load("certified").model_copy(update={"seed": seed})
    made = study.certify(settings, _loop[0] if _loop else None, NAMES)
    _loop[:] = [made.loop]
    out = figures(made)
    if rounds:
        out["adversary"] = figures(study.challenge(made, rounds))
    return out


def figures(made: study.Certified) -> dict[str, Any]:
    """What is kept of a certificate; m, m/s, 1 and rad/s."""
    found = made.certificate
    return {
        "n": int(made.flight.oracle.payload.n),
        "observed": dict(found.observed),
        "floor": dict(found.floor),
        "unknown_m": found.unknown,
        "contraction": found.tube.contraction if found.tube else None,
        "radii": {name: {"run": dict(r.run), "tube": dict(r.tube)} for name, r in found.radii.items()},
        "assumed": list(found.radii["recovery"].assumed),
        "above_bound_in_time": float((found.e_p > found.bound).mean()),
    }


def main() -> bool:
    """Fly all draws, then the adversaries; print and judge."""
    items = [f"{seed}" for seed in range(FIRST, FIRST + RUNS)] + [f"{seed} adversary" for seed in ADVERSARIES]
    found = collect("certified", items, lambda item: fly(int(item.split()[0]), 2 if "adversary" in item else 0))
    runs = [found[item] for item in items[:RUNS]]
    good = all(run["contraction"] is not None for run in runs)
    for name in NAMES:
        for where in ("tube", "run"):
            exceeded = sum(
                run["observed"][e] > run["radii"][name][where][e]
                for run in runs
                for e in ("e_p", "e_v", "e_R", "e_omega")
            )
            tightness = np.array([run["radii"][name][where]["e_p"] / run["observed"]["e_p"] for run in runs])
            alone = np.array(
                [(run["radii"][name][where]["e_p"] - run["floor"]["e_p"]) / run["unknown_m"] for run in runs]
            )
            print(
                f"{name:9} {where:5} exceeded in {exceeded} of {4 * RUNS} errors; certified / observed e_p: median "
                f"{np.median(tightness):.2f}, 95 % {np.percentile(tightness, 95):.2f}; without the floor: median "
                f"{np.median(alone):.2f}, 95 % {np.percentile(alone, 95):.2f}"
            )
            good &= exceeded == 0
            if name == "recovery":
                good &= bool(np.median(tightness) <= 8 and np.percentile(tightness, 95) <= 14)
    against = np.array(
        [
            (lambda a: a["radii"]["recovery"]["run"]["e_p"] / a["observed"]["e_p"])(found[item]["adversary"])
            for item in items[RUNS:]
        ]
    )
    print(f"certificate / adversary on the run it produces: {against.min():.3f} to {against.max():.3f}")
    return bool(good and (against >= 1).all() and (against <= 1.5).all())
