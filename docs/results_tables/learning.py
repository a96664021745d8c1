"""Tables of tracking, changes, random environments, generalization and reinforcement learning."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from colift.campaigns import statistics
from evidence import campaign, contact_forces, replay
from results_tables import CASES, items, limits, markdown, number, spread, table, targets


def _named(case: str) -> tuple[str, str]:
    return f"`{case}`", CASES.get(case, "-")


def _mm(values: Any) -> np.ndarray:
    return 1e3 * np.array([np.inf if x is None else x for x in values], dtype=float)


# Tracking -------------------------------------------------------------------------------------------------------------

METRICS = {
    "e_p_rms_m": ("position error [mm]", 1e3),
    "e_R_rms": ("attitude error [mrad]", 1e3),
    "delta_W_force_rms_N": ("wrench mismatch, force [N]", 1.0),
    "e_lam_rms_N": ("contact force error [N]", 1.0),
    "contact_force_hf_rms_N": ("contact forces above 20 Hz [N]", 1.0),
}


@table("orderings")
def position_errors() -> str:
    """RMS position error of each case over the second half: median and range over seeds."""
    found = list(items("orderings").values())
    rows = []
    for case in sorted(found[0], key=lambda case: -np.median([seed[case]["e_p_rms_m"] for seed in found])):
        x = _mm(seed[case]["e_p_rms_m"] for seed in found)
        complete = sum(seed[case]["complete"] for seed in found)
        rows.append((*_named(case), np.median(x), x.min(), x.max(), len(x), f"{complete} of {len(x)}"))
    return markdown(("case", "meaning", "median [mm]", "least", "greatest", "n", "complete flights"), rows)


@table("orderings")
def metrics() -> str:
    """Medians over seeds of further metrics of each case."""
    found = list(items("orderings").values())
    rows = [
        (
            *_named(case),
            *(scale * float(np.median([seed[case][key] for seed in found])) for key, (_, scale) in METRICS.items()),
        )
        for case in found[0]
    ]
    return markdown(("case", "meaning", *(name for name, _ in METRICS.values())), rows)


def _interval(interval: statistics.Interval, scale: float = 1.0) -> str:
    """Return a confidence interval as text."""
    return f"{number(scale * interval.low)} to {number(scale * interval.high)}"


@table("campaign")
def medians() -> str:
    """Medians over the samples of a campaign, and ratios to C1, with intervals."""
    names = METRICS | {
        "sigma_L_force_mean_N": ("standard deviation of the payload force [N]", 1.0),
        "lam_max_N": ("largest contact force [N]", 1.0),
    }
    rows = []
    for each in statistics.compare_cases(campaign.table(items("campaign")), campaign.METRICS):
        heading, scale = names[each.metric]
        is_reference = each.case == each.reference
        ratio = ("-", "-") if is_reference else (number(each.ratio.value), _interval(each.ratio))
        median = number(scale * each.median.value), _interval(each.median, scale)
        rows.append((heading, f"`{each.case}`", each.samples, *median, *ratio))
    return markdown(("metric", "case", "n", "median", "interval", "ratio to `C1`, median", "interval"), rows)


@table("campaign")
def fractions() -> str:
    """Fractions of the flights of a campaign with a property, with intervals."""
    rows = (
        (one.meaning.replace("|", r"\|"), f"{one.count} of {one.total}", _interval(one.interval))
        for one in campaign.fractions(campaign.table(items("campaign")))
    )
    return markdown(("statement", "flights", "interval of the fraction"), rows)


@table("orderings")
def study_targets() -> str:
    """Targets of the study, each with the number of seeds on which it is met."""
    module, found = importlib.import_module("evidence.orderings"), items("orderings")
    met = {seed: module.targets(each) for seed, each in found.items()}
    others = [seed for seed in met if seed != "0"]
    rows = []
    for name in met["0"]:
        count = sum(met[seed][name] for seed in others)
        good = met["0"][name] and count >= 9
        rows.append((STUDY_TARGETS.get(name, name), met["0"][name], f"{count} of {len(others)}", good))
    return markdown(("target", "met on seed 0", "met on other seeds (at least 9)", "met"), rows)


STUDY_TARGETS = {
    "e_p": "position error: C2 at most 0.5 of C1, C3 at most 0.6 of C2 and 0.2 of C1",
    "Psi": "attitude error function falls from C1 to C2 to C3",
    "delta_W": "wrench mismatch: C2 below C1, C3 at most 0.5 of C2",
    "sigma_L": "predictive standard deviation of the payload: C2 and C3 below C1",
    "sigma_A": "predictive standard deviation of the agents: C1 and C2 equal, C3 below C2",
    "constraint": "constraint residuals at most 1e-10",
    "wrench": "wrench consistency within 1e-9",
    "chatter": "contact forces above 20 Hz at most 0.2 N RMS",
    "data": "at least 200 samples and 4 updates",
    "varying": "the residual varies by at least 0.3 N and 0.03 N m RMS",
}


@table("orderings")
def adaptive_targets() -> str:
    """Targets of `adaptive` over all seeds."""
    module, found = importlib.import_module("evidence.orderings"), list(items("orderings").values())
    e, mismatch = (
        {case: np.array([seed[case][key] for seed in found]) for case in found[0]}
        for key in ("e_p_rms_m", "delta_W_force_rms_N")
    )
    return targets(module.adaptive_targets(e, mismatch))


# Changes --------------------------------------------------------------------------------------------------------------

WORLDS = {
    "home": "no change",
    "wind": "wind direction turns by 180 degrees",
    "mass": "payload mass changes",
    "path": "reference leaves the region of the data",
    "lost": "force labels lost",
    "wind lost": "wind turns, then labels lost",
    "mass lost": "payload mass changes, then labels lost",
    "outdoors": "outdoor wind, same gusts on all seeds",
    "gusts": "outdoor wind, other gusts on each seed",
    "jets": "spatially fixed jets",
    "motors": "motors with lag and delay",
    "laps": "laps of 24 s",
    "laps lost": "laps of 24 s, labels lost",
    "into jets": "reference moves into the jets",
}


def _errors(world: str) -> dict[str, np.ndarray]:
    """Position errors by case, mm; infinite where a flight ended early."""
    found: dict[str, list[float]] = {}
    for item, one in items("changes").items():
        at, case, _ = item.split(": ")
        if at == world:
            found.setdefault(case, []).append(
                np.inf if one["termination_reason"] or one["e_p_rms_m"] is None else one["e_p_rms_m"]
            )
    return {case: 1e3 * np.array(errors) for case, errors in found.items()}


@table("changes")
def errors_by_world() -> str:
    """RMS position error after each change: median and range over seeds."""
    worlds = dict.fromkeys(item.split(": ")[0] for item in items("changes"))
    cases = list(_errors("home"))
    rows = []
    for world in worlds:
        e = _errors(world)
        rows.append((f"`{world}`", WORLDS.get(world, "-"), len(e[cases[0]]), *(spread(e[case]) for case in cases)))
    return markdown(("change", "meaning", "n", *(f"`{case}` [mm]" for case in cases)), rows)


@table("changes")
def changes_targets() -> str:
    """Targets of `adaptive` after changes."""
    return targets(importlib.import_module("evidence.changes").targets(items("changes")))


# Random environments --------------------------------------------------------------------------------------------------


@table("react")
def random_errors() -> str:
    """Return the RMS position error after the changes over all samples in which all compared flights are complete."""
    found = list(items("react").values())
    rows = []
    for case in ("C3", "label_feedback", "label_feedback tuned_lead", "adaptive", "true_residual"):
        ended = sum(bool(one[case]["termination_reason"]) for one in found)
        e = _mm(one[case]["e_p_rms_m"] for one in found if not one[case]["termination_reason"])
        rows.append((*_named(case), np.median(e), np.quantile(e, 0.9), e.max(), len(found), ended))
    return markdown(("case", "meaning", "median [mm]", "90 %", "greatest", "n", "ended early"), rows)


@table("react")
def random_targets() -> str:
    """Targets of `adaptive` in random environments."""
    return targets(importlib.import_module("evidence.react").targets(items("react")))


@table("react")
def random_miscoverage() -> str:
    """Mean miscoverage of `adaptive` by the kind of labels, with its standard error."""
    rows = []
    for name, kind in (("in every period", 0), ("with dropouts", 1), ("lost at 16 s", 2)):
        shares = [one["adaptive"]["miscoverage"] for one in items("react").values() if _label_kind(one) == kind]
        each = (np.array([share[span] for share in shares]) for span in ("second_half", "after_change"))
        rows.append((name, len(shares), *(f"{x.mean():.3f} ± {x.std() / np.sqrt(len(x)):.3f}" for x in each)))
    return markdown(("tip readings", "n", "second half", "within 1 s after a change"), rows)


def _label_kind(one: dict[str, Any]) -> int:
    """Return 0 for tip readings in every period, 1 for dropouts, 2 for a failure."""
    sample = one["sample"]
    return 2 if sample["label_failure_time_s"] is not None else int(sample["dropout_probability"] > 0)


@table("other_teams")
def other_teams_targets() -> str:
    """Targets of `adaptive` in random environments of other teams."""
    module, found = importlib.import_module("evidence.other_teams"), items("other_teams")
    return targets([target for team in module.TEAMS for target in module.targets(team, found)])


@table("replay")
def correction_ablation() -> str:
    """Replays of the correction with a rule left out or a constant changed: forecast error over that of `adaptive`."""
    groups: dict[bool, list[Any]] = {}
    for item, one in items("replay").items():
        if not one["termination_reason"]:
            groups.setdefault(" " in item, []).append(one["forecast_e_p_rms_m"])
    reference, *names = groups[False][0]
    rows = []
    for name in names:
        with_tips, without = (
            [replay.ratios((one[name][h], one[reference][h]) for one in groups[kind])[:2] for h in ("0.0", "0.06")]
            for kind in (False, True)
        )
        found = (*(mean for mean, _ in with_tips), with_tips[1][1], *(mean for mean, _ in without))
        rows.append((name, *(f"{ratio:.2f}" for ratio in found)))
    header = (
        *("variant", "at once: mean", "60 ms ahead: mean", "60 ms ahead: 90 %"),
        *("without tips, at once: mean", "without tips, 60 ms ahead: mean"),
    )
    return markdown(header, rows)


@table("update_ablation")
def update_ablation() -> str:
    """Flights with a rule of the model updates left out or a constant changed: error over that of `adaptive`."""
    found: dict[str, list[dict[str, Any]]] = {}
    for one in items("update_ablation").values():
        for name in one:
            if name != "adaptive":
                found.setdefault(name, []).append(one)
    rows = []
    for name, flown in found.items():
        whole = [one for one in flown if not one[name]["termination_reason"]]
        early, late = (
            replay.ratios((one[name][key], one["adaptive"][key]) for one in whole)
            for key in ("e_p_rms_after_change_m", "e_p_rms_late_m")
        )
        rows.append((name, *(f"{ratio:.2f}" for ratio in (early[0], *late)), f"{len(whole)} of {len(flown)}"))
    header = ("variant", "1.5 s after the change: mean", "later: mean", "90 %", "greatest", "complete flights")
    return markdown(header, rows)


# Generalization -------------------------------------------------------------------------------------------------------

CONDITIONS = {
    "home": "condition of training",
    "wind": "mean wind turned by 90 degrees",
    "speed": "faster reference",
    "larger": "larger reference",
    "moved": "reference moved by 0.3 m",
    "backwards": "reference in the other direction",
    "payload": "heavier payload, nominal parameters unchanged",
    "weighed": "heavier payload, nominal parameters updated",
    "attitude": "reference with attitude motion",
}
OTHER_LAW = ("wind", "payload")  # conditions in which the residual is another function


def _generalized() -> dict[str, dict[str, np.ndarray]]:
    """Return position errors [m] by condition and model, one value per seed."""
    found: dict[str, dict[str, list[float]]] = {}
    for item, one in items("generalization").items():
        model, condition, _ = item.split(": ")
        error = one["e_p_rms_m"]
        found.setdefault(condition, {}).setdefault(model, []).append(np.nan if error is None else error)
    return {condition: {model: np.array(e) for model, e in of.items()} for condition, of in found.items()}


@table("generalization")
def ratios() -> str:
    """Position error of each frozen model over that of `true_residual`: median and range over seeds."""
    found = _generalized()
    models = [model for model in found["home"] if model != "true_residual"]
    rows = []
    for condition, of in found.items():
        known = of["true_residual"]
        rows.append(
            (
                f"`{condition}`",
                CONDITIONS.get(condition, "-"),
                len(known),
                *(spread(of[model] / known) for model in models),
            )
        )
    return markdown(("condition", "meaning", "n", *(f"`{model}`" for model in models)), rows)


@table("generalization")
def generalization_target() -> str:
    """Return the target: one frozen model with at most twice the error of `true_residual` in unchanged environments."""
    found = _generalized()
    models = [model for model in limits("generalization")["MODELS"] if model in found["home"]]
    worst = {
        model: max(
            float(np.median(of[model] / of["true_residual"]))
            for condition, of in found.items()
            if condition not in OTHER_LAW
        )
        for model in models
    }
    best = min(worst, key=lambda model: worst[model])
    rows = [
        (f"`{model}`", ratio, "at most 2 for one model", bool(ratio <= 2), "yes" if model == best else "no")
        for model, ratio in worst.items()
    ]
    return markdown(("frozen model", "largest median ratio to `true_residual`", "limit", "within limit", "best"), rows)


# Reinforcement learning -----------------------------------------------------------------------------------------------


def _evaluations() -> list[list[dict[str, Any]]]:
    """Return evaluations of every learner, one list per seed."""
    return [items("curve")[seed] for seed in limits("curve")["SEEDS"]]


@table("curve")
def learning_curve() -> str:
    """Return position error and return of PPO during training, with those of the cases."""
    rows: list[tuple[Any, ...]] = []
    for case in ("C1", "integral", "C3"):
        one = items("curve")[case]
        e, returns = _mm(one["e_p_rms_m"]), one["return"]
        rows.append((f"`{case}`", CASES[case], "-", np.mean(e), float(np.mean(returns)), 1, one["num_terminated"]))
    step_s, curves = limits("curve")["SETTINGS"]["step_s"], _evaluations()
    for each in zip(*curves, strict=True):
        e = [float(np.mean(_mm(one["e_p_rms_m"]))) for one in each]
        returns = [float(np.mean(one["return"])) for one in each]
        minutes = number(each[0]["steps"] * step_s / 60)
        rows.append(
            (
                "PPO",
                "policy network",
                minutes,
                spread(e),
                spread(returns),
                len(each),
                sum(one["num_terminated"] for one in each),
            )
        )
    header = (
        "method",
        "meaning",
        "training flight time [min]",
        "position error [mm]",
        "return",
        "training seeds",
        "flights terminated early",
    )
    return markdown(header, rows)


@table("curve")
def learning_target() -> str:
    """Return the target: every learner ends below the error without action and without a terminated flight."""
    none = float(min(_mm(items("curve")["C1"]["e_p_rms_m"])))
    last = [curve[-1] for curve in _evaluations()]
    worst, lost = (
        float(max(_mm(e for one in last for e in one["e_p_rms_m"]))),
        sum(one["num_terminated"] for one in last),
    )
    rows = [
        ("largest final position error of PPO [mm]", worst, f"below {number(none)} (C1)", worst < none),
        ("flights that end early under the final policies", lost, "0", lost == 0),
    ]
    return markdown(("target", "measured", "limit", "met"), rows)


def flights_by_team(name: str) -> dict[str, list[dict[str, Any]]]:
    """Return the flights of all seeds of each team, for a result with items `TEAM SEED`."""
    found: dict[str, list[dict[str, Any]]] = {}
    for item, one in items(name).items():
        found.setdefault(item.split()[0], []).append(one)
    return found


@table("contact_forces")
def kinds() -> str:
    """Estimates of the contact forces: tracking relative to tip sensors, and largest errors of forces."""
    cases, rows = ("C3", "label_feedback", "adaptive"), []
    for team, flights in flights_by_team("contact_forces").items():
        for kind, flown in flights[0].items():
            compared = "C3" in flown
            values = [max(one[kind]["C3" if compared else "C1"][name] for one in flights) for name in FORCE_ERRORS]
            ratios: list[str | None] = [None] * len(cases)
            if compared:
                pairs = [contact_forces.ratio_to_tip_sensors(flights, kind, case) for case in cases]
                ratios = [f"{mean:.2f} ({largest:.2f})" for mean, largest in pairs]
            rows.append((f"`{team}`", kind, *ratios, *values))
    header = ("team", "contact forces", *(f"RMS $e_p$ of `{case}`, ratio" for case in cases))
    return markdown((*header, "error of a contact force [N]", "error of the force mismatch [N]"), rows)


@table("contact_force_rivals")
def estimators() -> str:
    """Estimators of the contact forces in flights of C3: errors of tracking and forces, means over the seeds."""
    rows = []
    for team, flights in flights_by_team("contact_force_rivals").items():
        for kind in flights[0]:
            label = kind.replace("_", " ").replace("kalman", "Kalman")
            e_p, *errors = (np.mean([one[kind][name] for one in flights]) for name in ("e_p_rms_m", *FORCE_ERRORS))
            rows.append((f"`{team}`", label, 1e3 * e_p, *errors, len(flights)))
    header = ("team", "estimator", "RMS $e_p$ [mm]", "error of a contact force [N]", "of the force mismatch [N]", "n")
    return markdown(header, rows)


FORCE_ERRORS = ("contact_force_error_N", "mismatch_error_N")
