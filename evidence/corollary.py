"""Corollary 1 in flight: certified and observed ultimate error against the number of data, towards the floor.

The samples of a flight are taken ever denser; hyperparameters, norm and label errors stay. The factor beta, the
greatest deviation and their product are kept apart (docs/errata.md, row 17).
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from colift import scenario, study
from colift.certify import certificate, reach
from evidence import collect

RATES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # samples a second, over 16.5 s
SEEDS = (100, 101)
CAPACITY = 160


def fly(seed: int, rate: float) -> dict[str, Any]:
    """One certified flight whose samples are taken at that rate."""
    settings = scenario.load("certified")
    learning = settings.learning.model_copy(update={"sample_Hz": rate, "capacity": CAPACITY})
    made = study.certify(settings.model_copy(update={"seed": seed, "learning": learning}), names=("energy", "recovery"))
    found = made.certificate
    grid = certificate.path_of(made.plan, made.flight, certificate.STEP)
    (payload, *_) = certificate.bodies(made.plan, made.flight, made.twin.rows, grid.path, "energy")
    radius = reach.greatest(payload).max(0)
    return {
        "n": int(made.flight.oracle.payload.n),
        "observed_m": found.observed["e_p"],
        "floor_m": found.floor["e_p"],
        "unknown_m": found.unknown,
        "energy_m": {"run": found.radii["energy"].run["e_p"], "tube": _number(found.radii["energy"].tube["e_p"])},
        "recovery_m": {"run": found.radii["recovery"].run["e_p"], "tube": _number(found.radii["recovery"].tube["e_p"])},
        "payload_beta": payload.beta.tolist(),
        "payload_radius": radius.tolist(),
        "payload_deviation": (radius / payload.beta).tolist(),
    }


def _number(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def main() -> bool:
    """Fly all; on the median over seeds, more data never certify a larger radius by more than a tenth."""
    items = [f"{seed} {rate:g} Hz" for seed in SEEDS for rate in RATES]
    found = collect("corollary", items, lambda item: fly(int(item.split()[0]), float(item.split()[1])))
    good = True
    for name in ("energy_m", "recovery_m"):
        rows = [[found[f"{seed} {rate:g} Hz"] for seed in SEEDS] for rate in RATES]
        radius = [float(np.median([each[name]["run"] for each in row])) for row in rows]
        print(name, [f"{row[0]['n']}: {1e3 * r:.2f} mm" for row, r in zip(rows, radius, strict=True)])
        good &= all(later <= 1.1 * earlier for earlier, later in itertools.pairwise(radius))
    return good
