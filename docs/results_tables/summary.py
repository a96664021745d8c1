"""The table of all claims, and the table of the README."""

from __future__ import annotations

import contextlib
import importlib
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from colift.campaigns import statistics
from evidence import campaign
from results_tables import CASES, MissingResult, count_faults, items, limits, markdown, number, record, table
from results_tables.certificate import METHODS, _array, _runs
from results_tables.learning import _errors, _generalized, _mm


def _median(case: str) -> float:
    return float(np.median(_mm(seed[case]["e_p_rms_m"] for seed in items("orderings").values())))


def _seeds(name: str) -> str:
    """Return the number of items whose names begin with a seed, and the range of the seeds."""
    seeds = sorted({int(word) for item in items(name) for word in item.split()[:1] if word.isdigit()})
    return f"{len(seeds)}, seeds {seeds[0]} to {seeds[-1]}"


def _bound(method: str) -> str:
    found = items("rivals")
    each = [one for item, one in found.items() if item.startswith("seed ")]
    drawn = next(iter(each[0]["observed_errors"]))
    past = [
        run["e_p"] for item, one in found.items() if item.startswith("calibration ") for run in one["observed_errors"]
    ]
    rank = math.ceil((len(past) + 1) * limits("rivals")["CONFIDENCE"]) - 1
    quantile = sorted(past)[rank]
    bounds = [quantile if method == "conformal" else one["ultimate_bounds"][method]["e_p"] for one in each]
    return number(
        float(
            np.median([bound / one["observed_errors"][drawn]["e_p"] for one, bound in zip(each, bounds, strict=True)])
        )
    )


def _rivals() -> str:
    seeds = [item.split()[1] for item in items("rivals") if item.startswith("seed ")]
    return f"{len(seeds)}, seeds {seeds[0]} to {seeds[-1]}"


def _nominal() -> str:
    return number(float(np.median(100 * _array(_runs(), "nominal_error", "e_p") / _array(_runs(), "observed", "e_p"))))


def _met(name: str) -> str:
    targets = importlib.import_module(f"evidence.{name}").targets(items(name))
    return f"{sum(target.met for target in targets)} of {len(targets)}"


def _frozen() -> str:
    found, models = _generalized(), limits("generalization")["MODELS"]
    ratios = {
        model: max(
            float(np.median(of[model] / of["true_residual"]))
            for name, of in found.items()
            if name not in ("wind", "payload")
        )
        for model in models
    }
    return number(min(ratios.values()))


def _rate() -> str:
    rows = [row for row in items("coverage")["summary"]["table"].values() if row["assumptions_met"]]
    return f"{sum(row['violation_rate'] <= row['allowed_rate'] for row in rows)} of {len(rows)}"


def _policy() -> str:
    last = [items("curve")[seed][-1]["e_p_rms_m"] for seed in limits("curve")["SEEDS"]]
    return number(float(np.median([np.mean(_mm(e)) for e in last])))


def _passed(name: str) -> str:
    found = items(name).values()
    return f"{sum(one['passed'] for one in found)} of {len(found)}"


Claim = tuple[str, str, str, str, str]
"""Page, claim, metric, value, and n with seeds."""


def _orderings() -> Iterator[Claim]:
    error, seeds = "RMS position error, median [mm]", _seeds("orderings")
    for case in ("C1", "C2", "C3", "adaptive", "true_residual"):
        yield "tracking", f"tracking, `{case}` ({CASES[case]})", error, number(_median(case)), seeds


def _changes() -> Iterator[Claim]:
    yield "changes", "`adaptive` after changes", "targets met", _met("changes"), f"{len(items('changes'))} runs"


def _react() -> Iterator[Claim]:
    n = f"{len(items('react'))} draws"
    yield "random_environments", "`adaptive` in random environments", "targets met", _met("react"), n


def _generalization() -> Iterator[Claim]:
    found = _generalized()
    n = f"{len(found)} conditions, {len(found['home']['true_residual'])} seeds"
    metric = "best model, largest median ratio to `true_residual`"
    yield "generalization", "frozen models in other conditions", metric, _frozen(), n


def _error_bounds() -> Iterator[Claim]:
    metric = "position error bound over observed error, median"
    for method in METHODS:
        yield "certificate", f"error bound by {METHODS[method]}", metric, _bound(method), _rivals()


def _certified() -> Iterator[Claim]:
    metric = "nominal position error over observed error, median [%]"
    yield "certificate", "share of the nominal trajectory in the error", metric, _nominal(), f"{len(_runs())} draws"


def _coverage() -> Iterator[Claim]:
    n = f"{items('coverage')['summary']['num_draws']} draws a setting"
    yield "certificate", "GP error bounds", "settings with at most the allowed failure rate", _rate(), n


def _plant() -> Iterator[Claim]:
    row = items("plant")["summary"]["table"]["agreement"]
    metric, n = "largest relative error", f"{row['count']} teams"
    yield "plant", "plant against Pinocchio", metric, number(row["worst"]), n


def _engines() -> Iterator[Claim]:
    apart = items("engines")["C1"]["differences"]["position_m"]
    metric = "largest difference of position [um]"
    yield "plant", "plant against MuJoCo, `C1`", metric, number(1e6 * apart), "1, seed 0"


def _drake() -> Iterator[Claim]:
    apart = items("drake")["C1"]["extrapolated"]["position_m"]
    metric = "largest difference of position, extrapolated [um]"
    yield "plant", "plant against Drake, `C1`", metric, number(1e6 * apart), "1, seed 0"


def _onboard() -> Iterator[Claim]:
    one = items("onboard")["x86-64, AVX2"]
    metric, n = "time of a control step, median [us]", f"{int(one['steps'])} steps"
    yield "onboard_code", "generated C code, AVX2", metric, number(one["step_time_median_us"]), n


def _curve() -> Iterator[Claim]:
    metric, n = "final RMS position error, median [mm]", f"{len(limits('curve')['SEEDS'])} training seeds"
    yield "reinforcement_learning", "reinforcement learning (PPO)", metric, _policy(), n


def _teams(result: str, claim: str) -> Callable[[], Iterator[Claim]]:
    """Return the claim on teams that pass the safety check."""

    def claims() -> Iterator[Claim]:
        n = f"{len(items(result))} teams"
        yield "starts_and_tuning", claim, "teams that pass the safety check", _passed(result), n

    return claims


def _fuzz() -> Iterator[Claim]:
    n = f"{sum(one['inputs'] for one in items('fuzz').values())} inputs"
    yield (
        "robustness",
        "readers of files and messages",
        "mutated inputs with a fault",
        str(count_faults(items("fuzz").values())),
        n,
    )


def _file_faults() -> Iterator[Claim]:
    trials = sum(one["operations"] + one["killed"] for one in items("file_faults").values())
    metric = "failures and kills with a fault"
    yield (
        "robustness",
        "results after failing file operations",
        metric,
        str(count_faults(items("file_faults").values())),
        f"{trials} trials",
    )


def _campaign() -> Iterator[Claim]:
    order = statistics.orderings(campaign.table(items("campaign")))[-1]
    value, n = f"{order.count} of {order.total}", f"{order.total} samples"
    yield "tracking", "paper's order of the cases with varied settings", f"samples with {order.meaning}", value, n


CLAIMS: dict[str, Callable[[], Iterator[Claim]]] = {
    "orderings": _orderings,
    "campaign": _campaign,
    "changes": _changes,
    "react": _react,
    "generalization": _generalization,
    "rivals": _error_bounds,
    "certified": _certified,
    "coverage": _coverage,
    "plant": _plant,
    "engines": _engines,
    "drake": _drake,
    "onboard": _onboard,
    "curve": _curve,
    "starts": _teams("starts", "teams of `colift init`"),
    "tuned": _teams("tuned", "gains of `colift tune`"),
    "fuzz": _fuzz,
    "file_faults": _file_faults,
}


@table("+".join(CLAIMS))
def claims() -> str:
    """Return one row per claim: metric, value, n, seeds, command, page. Claims without a result have no row."""
    rows: list[tuple[str, ...]] = []
    for result, found in CLAIMS.items():
        with contextlib.suppress(MissingResult):
            rows += [
                (claim, metric, value, n, f"`{record(result)['command']}`", f"[{page.replace('_', ' ')}]({page}.md)")
                for page, claim, metric, value, n in found()
            ]
    return markdown(("claim", "metric", "value", "n, seeds", "command", "page"), rows)


@table("changes+react")
def readme() -> str:
    """Median position error of five cases: nominal, wind change, loss of labels, random environments."""
    worlds = [_errors(world) for world in ("home", "wind", "lost")]
    found = list(items("react").values())
    rows: list[tuple[Any, ...]] = []
    for case in ("C1", "C3", "label_feedback", "adaptive", "true_residual"):
        random = [1e3 * one[case]["e_p_rms_m"] for one in found if case in one and not one[case]["termination_reason"]]
        e = [
            *(float(np.median(world[case])) for world in worlds),
            float(np.median(random)) if len(random) > 1 else None,
        ]
        rows.append((f"`{case}`", CASES[case], *(None if x is None else number(x) for x in e)))
    n = [len(world["C1"]) for world in worlds]
    names = ("nominal", "wind change", "sensor loss", "random environments")
    heads = [f"{name} (n = {count})" for name, count in zip(names, (*n, len(found)), strict=True)]
    return markdown(("case", "meaning", *heads), rows)
