"""Four certificates of the same flights: colift, a pointwise tube, an L1 norm bound, and split-conformal prediction.

Plant, data and assumptions are those of the scenario `certified`. All four bound the errors before the flight.

- `pointwise`: the energy bound at each time along a tube with the same slopes, summed with the weights of the loop
  (Koller et al. 2018, Lederer et al. 2019).
- `L1`: the largest bound of each residual along the path, enlarged by a small gain, times the L1 norm of the loop
  (Hovakimyan and Cao 2010, Lakshmanan et al. 2020).
- `conformal`: a quantile of the errors in 200 flights with other draws (Vovk et al. 2005, Lindemann et al. 2023).

Each is compared with flights with other residuals that are consistent with norm and data: the drawn residuals, and
trials of `colift falsify`.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from colift import scenario
from colift.certification import (
    a_priori,
    adversary,
    body_models,
    linearized_trajectory,
    nominal_run,
    reachability,
    tube,
)
from colift.certification.certificate import ERRORS
from colift.closed_loop.flight import FlightResult, run_experiment
from colift.scenario import experiment
from colift.workflows import certification, falsification
from evidence import collect

SEEDS = tuple(range(100, 104))
TRIES = (
    *(f"worst_case_{error}:0" for error in ERRORS),
    *("random_functional:0", "sinusoidal_functional:0", "sinusoidal_functional:1"),
)
CALIBRATION, AT_ONCE, FROM = 200, 20, 1000  # flights of other seeds, so many an item
CONFIDENCE = 0.95  # of split-conformal prediction; the others are certain
RIVALS = ("recovery", "energy", "pointwise", "L1", "conformal")


def simulate_item(item: str) -> dict[str, Any]:
    """Return the certificates of one seed, or the errors of some calibration flights."""
    kind, k = item.split()
    return calibration_errors(int(k)) if kind == "calibration" else compare(int(k))


def calibration_errors(k: int) -> dict[str, Any]:
    """Return the largest errors in the window of each flight, and the duration [s]."""
    begun, reached = time.perf_counter(), []
    for seed in range(FROM + k * AT_ONCE, FROM + (k + 1) * AT_ONCE):
        flight = run_experiment(experiment.make_experiment(_settings(seed), "C3"))
        late = flight.records.t >= _window_start(flight)
        reached.append({error: _size(getattr(flight.records, error)[late]) for error in ERRORS})
    return {"observed_errors": reached, "computation_time_s": time.perf_counter() - begun}


def compare(seed: int) -> dict[str, Any]:
    """Return bounds for any run by each certificate [m, m/s, 1, rad/s], and the errors of the flights."""
    begun = time.perf_counter()
    made = certification.certify(_settings(seed), names=("energy", "recovery"))
    ours, found, loop = time.perf_counter() - begun, made.certificate, made.nominal_linearization
    begun = time.perf_counter()
    others = baseline_bounds(made)
    theirs = time.perf_counter() - begun
    reached = {"simulation": dict(found.observed)}
    for name in TRIES:
        kind, number = name.split(":")
        rng = falsification.random_generator(seed, kind, int(number))
        L = falsification.RESIDUAL_TRIALS[kind](made, int(number), rng)
        forces = adversary.worst_case_residual(made.experiment, made.flight, loop.nodes, loop.records, L)
        rows, _ = linearized_trajectory.simulate_nominal(
            nominal_run.nominal_experiment(made.experiment, forces),
            made.nominal_linearization.model_schedule,
            seed=seed,
        )
        late = rows.t >= found.window[0] - 1e-9
        reached[name] = {error: _size(getattr(rows, error)[late]) for error in ERRORS}
    radii = {name: dict(each.a_priori) for name, each in found.ultimate_bounds.items()} | others
    return {
        "ultimate_bounds": radii,
        "observed_errors": reached,
        "computation_time_s": {"colift": ours, "pointwise and L1": theirs},
    }


def baseline_bounds(made: certification.CertificationResult) -> dict[str, dict[str, float]]:
    """Return bounds of the pointwise tube and by L1 norms; infinite if there is none.

    `e^0 + sum_k |L_k| (rho + d)(t_k)`, `d = M (rho + d)`; and `e^0 + sum_k |L_k| r`, `r = (1 - sup sum M)^-1 sup rho`.
    """
    loop, window = made.nominal_linearization, made.certificate.window
    held = body_models.body_models(made.experiment, made.flight, loop.records, loop.nodes, "energy")
    rho = np.concatenate([reachability.max_error(body) for body in held], axis=1)
    gains = a_priori.tube_gains(loop, held)
    cells = np.stack([rho[part].max(0) for part in np.split(np.arange(len(rho)), gains.nodes[:-1] + 1)])
    all_of = np.full_like(rho, np.inf)
    try:
        d, _ = tube.solve_tube(gains.M, np.einsum("tisj,sj->ti", gains.M, cells))
        all_of = rho + d[gains.cell_index(len(rho))]
    except ValueError:  # it has no tube
        pass
    gain = gains.M.sum(2).max(0)
    small = np.abs(np.linalg.eigvals(gain)).max() < 1
    constant = np.linalg.solve(np.eye(len(gain)) - gain, rho.max(0)) if small else np.full(len(gain), np.inf)
    at = np.flatnonzero(loop.t >= window[0] - 1e-9)
    L = np.abs(linearized_trajectory.adjoint_weights(loop, loop.output_rows(*ERRORS), at))
    base = np.concatenate([getattr(loop.records, error)[loop.nodes[at]] for error in ERRORS], axis=1)
    return {
        "pointwise": _radii(base, np.einsum("trki,ki->tr", L, all_of)),
        "L1": _radii(base, L.sum(2) @ constant),
    }


def _radii(base: np.ndarray, reach: np.ndarray) -> dict[str, float]:
    corner = np.abs(base) + reach
    return {error: _size(corner[:, 3 * i : 3 * i + 3]) for i, error in enumerate(ERRORS)}


def _settings(seed: int) -> scenario.Scenario:
    return scenario.load_scenario("certified").model_copy(update={"seed": seed})


def _window_start(flight: FlightResult) -> float:
    """Return the start of the last period of the reference [s]."""
    return flight.records.t[-1] - 8.0 + 1e-9


def _size(x: np.ndarray) -> float:
    return float(np.linalg.norm(x, axis=1).max())


def main() -> bool:
    """Compare the bounds; those of colift must hold, and be smaller than those of every deterministic baseline."""
    certified, flights = [f"seed {seed}" for seed in SEEDS], CALIBRATION // AT_ONCE
    found = collect("rivals", [*certified, *(f"calibration {k}" for k in range(flights))], simulate_item)
    each = [found[item] for item in certified]
    past = [flight for k in range(flights) for flight in found[f"calibration {k}"]["observed_errors"]]
    rank = math.ceil((len(past) + 1) * CONFIDENCE) - 1
    quantile = {error: sorted(flight[error] for flight in past)[rank] for error in ERRORS}
    exceeded: dict[str, int] = {}
    medians: dict[str, dict[str, float]] = {}
    for baseline in RIVALS:
        radii = [quantile if baseline == "conformal" else one["ultimate_bounds"][baseline] for one in each]
        broken = {
            kind: sum(
                one["observed_errors"][name][error] > radius[error]
                for one, radius in zip(each, radii, strict=True)
                for name in one["observed_errors"]
                for error in ERRORS
                if (name == "simulation") == (kind == "drawn")
            )
            for kind in ("drawn", "attack")
        }
        medians[baseline] = {error: float(np.median([radius[error] for radius in radii])) for error in ERRORS}
        over = {
            error: np.median(
                [
                    radius[error] / one["observed_errors"]["simulation"][error]
                    for one, radius in zip(each, radii, strict=True)
                ]
            )
            for error in ERRORS
        }
        output = ", ".join(f"{error} {over[error]:.3g}" for error in ERRORS)
        print(
            f"{baseline:9} bound / observed error, median: {output}; "
            f"exceeded {broken['drawn']} and {broken['attack']} times"
        )
        exceeded[baseline] = broken["drawn"] + (broken["attack"] if baseline != "conformal" else 0)
    many = len(SEEDS) * len(ERRORS)
    print(
        f"of {many} errors for drawn residuals and {many * len(TRIES)} in trials; "
        f"conformal level: {CONFIDENCE:.0%} of draws"
    )
    spent = {
        name: np.median([one["computation_time_s"][name] for one in each]) for name in ("colift", "pointwise and L1")
    }
    total = sum(found[f"calibration {k}"]["computation_time_s"] for k in range(flights))
    print(
        f"computation time: colift {spent['colift']:.0f} s, pointwise and L1 {spent['pointwise and L1']:.0f} s, "
        f"conformal {total:.0f} s"
    )
    certain = [baseline for baseline in RIVALS if not exceeded[baseline] and baseline != "conformal"]
    ours = medians["recovery"]
    finite = all(math.isfinite(one["ultimate_bounds"]["recovery"][error]) for one in each for error in ERRORS)
    return (
        finite
        and "recovery" in certain
        and all(ours[e] <= medians[baseline][e] for baseline in certain for e in ERRORS)
    )


if __name__ == "__main__":
    main()
