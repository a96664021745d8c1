"""Corollary 1 in simulation: bound and observed ultimate error against the number of samples.

The sampling rate of a flight increases; hyperparameters, norm and label errors are constant. The factor beta, the
largest standard deviation and their product are stored separately (docs/errata.md, row 17).
"""

from __future__ import annotations

import itertools
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from colift import scenario
from colift.certification import body_models, reachability
from colift.visualization import certificate_figures
from colift.workflows import certification
from evidence import collect

RATES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # samples a second, over 16.5 s
SEEDS = (100, 101)
CAPACITY = 160
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "corollary.png"


def simulate_item(item: str) -> dict[str, Any]:
    """Return one flight with its bounds for a sampling rate."""
    seed, rate, _ = item.split()  # such as "3 20 Hz"
    settings = scenario.load_scenario("certified")
    learning = settings.learning.model_copy(update={"sample_Hz": float(rate), "max_samples": CAPACITY})
    made = certification.certify(
        settings.model_copy(update={"seed": int(seed), "learning": learning}), names=("energy", "recovery")
    )
    found = made.certificate
    (payload, *_) = body_models.body_models(
        made.experiment, made.flight, made.nominal_linearization.records, made.nominal_linearization.nodes, "energy"
    )
    radius = reachability.max_error(payload).max(0)
    return {
        "num_samples": int(made.flight.model.payload.num_points),
        "observed_error_m": found.observed["e_p"],
        "nominal_error_m": found.nominal_error["e_p"],
        "disturbance_response_m": found.disturbance_response["e_p"],
        **{
            f"{name}_bound_m": {
                "a_posteriori": bounds.a_posteriori["e_p"],
                "a_priori": _number(bounds.a_priori["e_p"]),
            }
            for name, bounds in found.ultimate_bounds.items()
        },
        "payload_beta": payload.beta.tolist(),
        "payload_error_bound": radius.tolist(),
        "payload_std": (radius / payload.beta).tolist(),
    }


def _number(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _median(found: dict[str, Any], pick: Callable[[dict[str, Any]], float]) -> list[float]:
    """Return the median of a quantity over the seeds, for each rate."""
    return [float(np.median([pick(found[f"{seed} {rate:g} Hz"]) for seed in SEEDS])) for rate in RATES]


def _radii(found: dict[str, Any]) -> dict[str, list[float]]:
    """Return bounds and observed error for each rate [m]."""
    return {
        "energy bound, a posteriori": _median(found, lambda run: run["energy_bound_m"]["a_posteriori"]),
        "optimal recovery, a posteriori": _median(found, lambda run: run["recovery_bound_m"]["a_posteriori"]),
        "observed": _median(found, lambda run: run["observed_error_m"]),
    }


def draw(found: dict[str, Any], path: Path) -> None:
    """Draw bounds and observed error, and the factors of the energy bound of one output."""
    parts = {
        r"$\beta$": _median(found, lambda run: run["payload_beta"][0]),
        r"maximum $\sigma$": _median(found, lambda run: run["payload_std"][0]),
        r"maximum $\beta\sigma$": _median(found, lambda run: run["payload_error_bound"][0]),
    }
    with tempfile.TemporaryDirectory() as folder:
        n, floor = (_median(found, lambda run, name=name: run[name]) for name in ("num_samples", "nominal_error_m"))
        drawn = Path(folder) / "corollary"
        certificate_figures.plot_bound_vs_data(n, _radii(found), floor, parts, drawn)
        shutil.copy(drawn.with_suffix(".png"), path)


def main() -> bool:
    """Simulate and plot all; in the median over seeds, more data increase the bound by at most a tenth."""
    items = [f"{seed} {rate:g} Hz" for seed in SEEDS for rate in RATES]
    found = collect("corollary", items, simulate_item)
    draw(found, FIGURE)
    radii = _radii(found)
    for name, radius in radii.items():
        print(f"{name:28}" + "".join(f"{1e3 * each:8.2f}" for each in radius) + "  mm")
    return all(
        later <= 1.1 * earlier
        for name, radius in radii.items()
        if name != "observed"
        for earlier, later in itertools.pairwise(radius)
    )
