"""Tables of error bounds: certificates, baseline methods, GP bounds, ultimate bounds."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np

from results_tables import ERRORS, items, limits, markdown, number, spread, table

METHODS = {
    "recovery": "optimal recovery (this project)",
    "energy": "energy bound (this project)",
    "pointwise": "pointwise tube",
    "L1": "L1 norms",
    "conformal": "split-conformal prediction",
}
HEADS = tuple(f"{name} `{error}`" for error, name in ERRORS.items())


def _array(runs: list[dict[str, Any]], *keys: str) -> np.ndarray:
    """Return one number of each run by its keys."""
    for key in keys:
        runs = [each[key] for each in runs]
    return np.array(runs, dtype=float)


def _runs(kind: str = "") -> list[dict[str, Any]]:
    """Return certified runs: the draws, or those of the kind `adversarial_test` or `noise`."""
    return [one for item, one in items("certified").items() if item.partition(" ")[2] == kind]


# Certified scenario ---------------------------------------------------------------------------------------------------


@table("certified")
def bound_tightness() -> str:
    """Error bounds valid for any run over observed errors, by method and error."""
    runs = _runs()
    rows = []
    for name in ("recovery", "energy"):
        for scope, meaning in (("a_priori", "any run"), ("a_posteriori", "the executed run")):
            for error in ERRORS:
                bound, observed = _array(runs, "ultimate_bounds", name, scope, error), _array(runs, "observed", error)
                ratio = bound / observed
                exceeded = int((observed > bound).sum())
                rows.append(
                    (METHODS[name], meaning, f"{ERRORS[error]} `{error}`", *_two(ratio), f"{exceeded} of {len(runs)}")
                )
    header = ("method", "valid for", "error", "bound over observed error, median", "95 %", "exceeded")
    return markdown(header, rows)


def _two(x: np.ndarray) -> tuple[float, float]:
    return float(np.median(x)), float(np.percentile(x, 95))


@table("certified")
def nominal_share() -> str:
    """Return the share of the observed error that the nominal trajectory has without residuals."""
    runs = _runs()
    rows = []
    for error in ERRORS:
        share = 100 * _array(runs, "nominal_error", error) / _array(runs, "observed", error)
        rows.append(
            (f"{ERRORS[error]} `{error}`", float(np.median(share)), float(share.min()), float(share.max()), len(runs))
        )
    return markdown(("error", "nominal error over observed error, median [%]", "least", "greatest", "n"), rows)


@table("certified")
def bound_targets() -> str:
    """Targets of the bounds by optimal recovery for any run, and of the adversarial tests."""
    runs, asked = _runs(), limits("certified")["TARGETS"]
    rows: list[tuple[Any, ...]] = []
    for error in ERRORS:
        bound = _array(runs, "ultimate_bounds", "recovery", "a_priori", error)
        ratio = (bound - _array(runs, "nominal_error", error)) / _array(runs, "disturbance_response", error)
        for what, value, most in zip(("median", "95 %"), _two(ratio), asked[error], strict=True):
            text = f"`{error}`: (bound - nominal error) over the effect of unknown forces, {what}"
            rows.append((text, value, f"at most {most}", value <= most))
    against = _runs("adversarial_test")
    reached = _array(against, "adversarial_test", "observed", "e_p")
    before = _array(against, "ultimate_bounds", "recovery", "a_priori", "e_p") / reached
    after = _array(against, "adversarial_test", "ultimate_bounds", "recovery", "a_posteriori", "e_p") / reached
    rows += [
        (
            "bound known before the run over error under adversarial forces, greatest",
            before.max(),
            "at most 2.5",
            before.max() <= 2.5,
        ),
        ("the same, least", before.min(), "-", None),
        ("bound of the adversarial run over its error, least", after.min(), "at least 1", bool((after >= 1).all())),
        ("the same, greatest", after.max(), "-", None),
    ]
    flown = [*runs, *(run["adversarial_test"] for run in against), *_runs("noise")]
    for scope, meaning in (("a_priori", "any run"), ("a_posteriori", "the executed run")):
        left = int(_array(flown, "num_components_outside", scope).sum())
        rows.append((f"error components outside their interval, {meaning}", left, "0", left == 0))
    return markdown(("target", "measured", "limit", "met"), rows)


@table("certified")
def linearization_error() -> str:
    """The error that the linearized closed loop does not contain, over the bound for any run."""
    runs = [*_runs(), *(run["adversarial_test"] for run in _runs("adversarial_test"))]
    rows = []
    for error in ERRORS:
        share = (
            100
            * _array(runs, "linearization_error", error)
            / _array(runs, "ultimate_bounds", "recovery", "a_priori", error)
        )
        rows.append((f"{ERRORS[error]} `{error}`", *_two(share), len(runs)))
    return markdown(("error", "linearization error over bound, median [%]", "95 %", "n"), rows)


# Baselines


@table("rivals")
def methods() -> str:
    """Bounds of all methods over the error of the same runs, exceedances and cost."""
    found = items("rivals")
    each = [one for item, one in found.items() if item.startswith("seed ")]
    batches = [one for item, one in found.items() if item.startswith("calibration ")]
    past, confidence = [run for one in batches for run in one["observed_errors"]], limits("rivals")["CONFIDENCE"]
    rank = math.ceil((len(past) + 1) * confidence) - 1
    quantile = {error: sorted(run[error] for run in past)[rank] for error in ERRORS}
    drawn = next(iter(each[0]["observed_errors"]))
    cost = {
        **dict.fromkeys(("recovery", "energy"), _cost(each, "colift")),
        **dict.fromkeys(("pointwise", "L1"), _cost(each, "pointwise and L1")),
        "conformal": sum(one["computation_time_s"] for one in batches),
    }
    rows = []
    for method, meaning in METHODS.items():
        bounds = [quantile if method == "conformal" else one["ultimate_bounds"][method] for one in each]
        over = [
            float(
                np.median(
                    [
                        bound[error] / one["observed_errors"][drawn][error]
                        for one, bound in zip(each, bounds, strict=True)
                    ]
                )
            )
            for error in ERRORS
        ]
        broken = Counter(
            "drawn" if name == drawn else "adversarial"
            for one, bound in zip(each, bounds, strict=True)
            for name, reached in one["observed_errors"].items()
            for error in ERRORS
            if reached[error] > bound[error]
        )
        many = len(each) * len(ERRORS)
        tries = many * (len(each[0]["observed_errors"]) - 1)
        holds = f"{100 * confidence:.0f} % of draws" if method == "conformal" else "all runs of the assumptions"
        rows.append(
            (
                meaning,
                holds,
                *over,
                f"{broken['drawn']} of {many}",
                f"{broken['adversarial']} of {tries}",
                number(cost[method]),
            )
        )
    header = ("method", "valid for", *HEADS, "exceeded as drawn", "exceeded under adversarial forces", "cost [s]")
    return markdown(header, rows)


def _cost(each: list[dict[str, Any]], kind: str) -> float:
    return float(np.median([one["computation_time_s"][kind] for one in each]))


# GP bounds ------------------------------------------------------------------------------------------------------------


@table("coverage")
def failure_rates() -> str:
    """Return failure rates of GP error bounds where their assumptions hold, and of controls where they do not."""
    summary = items("coverage")["summary"]
    grouped: dict[tuple[str, bool], list[dict[str, Any]]] = {}
    for case, row in summary["table"].items():
        grouped.setdefault((case.split(", ")[-1], row["assumptions_met"]), []).append(row)
    rows = []
    for (bound, claims), each in sorted(grouped.items(), key=lambda one: (not one[0][1], one[0][0])):
        rate, allowed = max(row["violation_rate"] for row in each), each[0]["allowed_rate"]
        looseness = [row["bound_over_error"] for row in each if row["bound_over_error"] < 1e6]
        met = bool(rate <= allowed) if claims else None
        rows.append(
            (
                f"`{bound}`",
                "yes" if claims else "no",
                len(each),
                summary["num_draws"],
                100 * rate,
                100 * allowed,
                met,
                spread(looseness) if looseness else None,
            )
        )
    header = (
        "bound, confidence",
        "assumptions met",
        "settings",
        "draws per setting",
        "largest failure rate [%]",
        "allowed [%]",
    )
    return markdown((*header, "met", "bound over error"), rows)


# Ultimate bounds ------------------------------------------------------------------------------------------------------


@table("rotation")
def attitude_bound() -> str:
    """Return the attitude bound over the worst error found, by magnitude of the disturbance."""
    found, asked = items("rotation"), limits("rotation")
    sizes: dict[float, list[dict[str, float]]] = {}
    for item, one in found.items():
        sizes.setdefault(float(item.split(", rho ")[1].split()[0]), []).append(one)
    rows = []
    for size, each in sizes.items():
        worst = max(max(one["e_R"], one["angle"], one["e_omega"]) for one in each)
        least = min(min(one.values()) for one in each)
        limit = f"at most {asked['TARGET']}" if size <= asked["UP_TO"] else "-"
        met = bool(least >= 1 and (size > asked["UP_TO"] or worst <= asked["TARGET"]))
        textbook = min(one["e_R_textbook"] for one in each)
        rows.append((size, len(each), least, worst, limit, met, textbook))
    header = ("disturbance over $k_R$", "damping ratios", "bound over error found, least", "greatest", "limit", "met")
    return markdown((*header, "textbook bound over error found, least"), rows)


@table("translation")
def translation_bound() -> str:
    """Return the translation bound over the attained error, by kind of gains."""
    asked, draws = limits("translation")["TARGET"], limits("translation")["DRAWS"]
    rows = []
    for kind, one in items("translation").items():
        met = bool(1 <= one["bound_over_attained"] <= asked and one["textbook_over_bound_min"] > 1)
        rows.append(
            (
                kind,
                draws,
                number(one["bound_over_attained"], 5),
                f"at most {asked}",
                met,
                one["textbook_over_bound_median"],
            )
        )
    header = (
        "damping, gains",
        "n",
        "bound over reached error, greatest",
        "limit",
        "met",
        "textbook over this bound, median",
    )
    return markdown(header, rows)


@table("corollary")
def bounds_by_data() -> str:
    """Bounds of the position error against the number of samples (Corollary 1): medians over seeds."""
    rates: dict[str, list[dict[str, Any]]] = {}
    for item, one in items("corollary").items():
        rates.setdefault(item.partition(" ")[2], []).append(one)

    def middle(each: list[dict[str, Any]], *keys: str | int) -> float:
        values: list[Any] = each
        for key in keys:
            values = [value[key] for value in values]
        return float(np.median(values))

    rows = [
        (
            rate,
            middle(each, "num_samples"),
            1e3 * middle(each, "recovery_bound_m", "a_posteriori"),
            1e3 * middle(each, "energy_bound_m", "a_posteriori"),
            1e3 * middle(each, "observed_error_m"),
            1e3 * middle(each, "nominal_error_m"),
            middle(each, "payload_beta", 0),
            middle(each, "payload_std", 0),
            len(each),
        )
        for rate, each in rates.items()
    ]
    header = (
        "sampling rate",
        "samples",
        "optimal recovery [mm]",
        "energy bound [mm]",
        "observed [mm]",
        "nominal error [mm]",
    )
    return markdown((*header, r"$\beta$", r"greatest $\sigma$ [N]", "seeds"), rows)


@table("variants")
def other_runs() -> str:
    """Bounds of runs that differ from the certified scenario: largest error over bound, and exceedances."""
    kinds: dict[str, list[dict[str, Any]]] = {}
    for item, tries in items("variants").items():
        kinds.setdefault(item.rsplit(" ", 1)[0], []).extend(tries)
    rows = []
    for kind, each in kinds.items():
        held = [one for one in each if one["observed_over_bound"] and None not in one["observed_over_bound"].values()]
        worst = max((ratio for one in held for ratio in one["observed_over_bound"].values()), default=None)
        broken = sum(bool(one["violated"]) for one in each)
        reasons = len(each) - len(held)
        rows.append((f"`{kind}`", len(each), len(held), reasons, worst, broken, broken == 0))
    header = (
        "kind of run",
        "n",
        "with a bound",
        "without, with a reason",
        "largest error over bound",
        "exceeded",
        "met",
    )
    return markdown(header, rows)
