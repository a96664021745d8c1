"""Ablation of the model updates of `adaptive`: flights with one rule of the updates left out or one constant changed.

Each item is a sample of `evidence react`, drawn with the key of `evidence replay`, with variants of the rules or of the
constants. All variants have equal noise. The correction by the Kalman filter remains in use, so that the ratios state
what a rule of the model updates adds to it. Rules of the correction are compared by `evidence replay`.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any
from unittest import mock

import numpy as np

from colift import gp
from colift.analysis import metrics
from colift.closed_loop.flight import Experiment, run_experiment
from colift.gp import semiparametric, time_variation
from colift.onboard.learning import change_detection, model_update
from colift.onboard.learning.recorder import RecorderState
from colift.onboard.learning.residual_model import ResidualModel, get_model
from colift.onboard.learning.semiparametric import MeanPrior
from colift.scenario import experiment
from evidence import collect, react, replay

SMALL = 1e-6
REFERENCE = "adaptive"
SPANS = {"after_change": (react.CHANGE_TIME, react.EVALUATION_START), "late": (react.EVALUATION_START, np.inf)}

Change = Callable[[], contextlib.AbstractContextManager[Any]]


@contextlib.contextmanager
def with_attribute(name: str, value: Any, *modules: Any) -> Iterator[None]:
    """Replace a function or constant of modules during a flight."""
    with contextlib.ExitStack() as stack:
        for module in modules:
            stack.enter_context(mock.patch.object(module, name, value))
        yield


def select_newest(
    model: ResidualModel,
    samples: model_update.SamplesByBody,
    like: RecorderState,
    t: float,
    variations: Mapping[Any, model_update.Variation],
) -> RecorderState:
    """Keep the newest samples in place of the most informative ones."""
    del t, variations
    newest = {body: tuple(values[-get_model(model, body).capacity :] for values in of) for body, of in samples.items()}
    return model_update.replace_samples(like, {**model_update.samples_by_body(like), **newest})


PATCHES: Mapping[str, Change] = {
    "without change points": lambda: with_attribute("detect_changes", lambda *_: {}, change_detection),
    "without random walks": lambda: with_attribute("RATE_BOUNDS", (1e-9, 1.001e-9), semiparametric),
    "newest samples": lambda: with_attribute("select_samples", select_newest, model_update),
    "one candidate time": lambda: with_attribute("NUM_CANDIDATES", 1, change_detection),
    "jump share 0.01": lambda: with_attribute("JUMP_SHARE", 0.01, gp, time_variation),
    "jump share 0.25": lambda: with_attribute("JUMP_SHARE", 0.25, gp, time_variation),
}


def without_physical_effects(plan: Experiment) -> Experiment:
    """Return the experiment whose mean function consists of constants alone."""
    updates = plan.online_updates
    assert updates is not None
    given = updates.mean_prior
    payload, agents = (
        np.where(np.arange(len(std)) < len(std) - constants, SMALL * std, std)
        for std, constants in ((given.payload, 6), (given.agents, 3))
    )
    return with_mean_prior(plan, dataclasses.replace(given, payload=payload, agents=agents))


def with_median_rate(factor: float) -> Callable[[Experiment], Experiment]:
    """Return the change of the median of the prior of the rate by a factor."""

    def change(plan: Experiment) -> Experiment:
        assert plan.online_updates is not None
        prior = plan.online_updates.mean_prior
        return with_mean_prior(plan, dataclasses.replace(prior, median_rate=factor * prior.median_rate))

    return change


def with_mean_prior(plan: Experiment, mean_prior: MeanPrior) -> Experiment:
    """Return the experiment with another prior of the mean parameters."""
    assert plan.online_updates is not None
    return dataclasses.replace(plan, online_updates=dataclasses.replace(plan.online_updates, mean_prior=mean_prior))


PLANS: Mapping[str, Callable[[Experiment], Experiment]] = {
    "without physical effects": without_physical_effects,
    "median rate * 10": with_median_rate(10.0),
}
VARIANTS = {
    "rules": ("without change points", "without random walks", "newest samples", "without physical effects"),
    "constants": ("one candidate time", "jump share 0.01", "jump share 0.25", "median rate * 10"),
}
SAMPLES = {"rules": replay.SAMPLES, "constants": 20}


def simulate_item(item: str) -> dict[str, Any]:
    """Return for `adaptive` and each variant of a kind the RMS position errors [m] after the change."""
    kind, sample = item.split()
    settings, _ = react.draw(int(sample), replay.KEY)
    plan = experiment.make_experiment(settings, "adaptive")
    found = {REFERENCE: simulate(plan)}
    for name in VARIANTS[kind]:
        with PATCHES.get(name, contextlib.nullcontext)():
            found[name] = simulate(PLANS.get(name, lambda same: same)(plan))
    return found


def simulate(plan: Experiment) -> dict[str, Any]:
    """Return the stored metrics of a flight."""
    flight = run_experiment(plan)
    rows = flight.records
    spans = {name: rows.e_p[(rows.t >= start) & (rows.t < end)] for name, (start, end) in SPANS.items()}
    return {
        "termination_reason": flight.termination_reason,
        "num_change_points": sum(len(update.change_points) for update in flight.updates),
        **{f"e_p_rms_{name}_m": metrics.rms_norm(e) if len(e) else None for name, e in spans.items()},
    }


def main() -> bool:
    """Print the geometric mean, the 90 % quantile and the largest ratio of the errors to those of `adaptive`."""
    items = [f"{kind} {k}" for kind, number in SAMPLES.items() for k in range(number)]
    found = collect("update_ablation", items, simulate_item)
    for kind, names in VARIANTS.items():
        of_kind = [one for item, one in found.items() if item.startswith(kind)]
        for name in names:
            lost = sum(bool(one[name]["termination_reason"]) for one in of_kind)
            spans = "".join(f"  {span}: {summary(of_kind, name, span)}" for span in SPANS)
            print(f"{name:26} {len(of_kind)} samples, {lost} lost{spans}")
    return not any(one[REFERENCE]["termination_reason"] for one in found.values())


def summary(found: Sequence[Mapping[str, Any]], name: str, span: str) -> str:
    """Return the distribution of the ratios of a variant as text."""
    key = f"e_p_rms_{span}_m"
    pairs = [(one[name][key], one[REFERENCE][key]) for one in found if not one[name]["termination_reason"]]
    mean, quantile, greatest = replay.ratios(pairs)
    return f"{mean:.3f}, 90 % {quantile:.2f}, largest {greatest:.2f}"


if __name__ == "__main__":
    main()
