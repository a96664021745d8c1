"""Benefit of learning: label errors compared with the residual forces, and errors with and without learning.

A label is the sum of filtered sensor readings. A constant bias of the tip force sensors is learned like a disturbance;
noise limits the accuracy. If bias or noise exceed the residual forces, learning increases the errors.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from colift.analysis import conclusions
from colift.analysis.study_metrics import STUDY_METRICS
from colift.models.parameters import Team
from colift.scenario import Scenario
from colift.scenario.cases import LEARNING_CASES

NOISE_BANDWIDTH = 1.22  # noise-equivalent bandwidth of the critically damped second-order filter over its corner
WITHOUT_LEARNING = "C1"  # case to which the others are compared
METRICS = {  # errors in the table of a study, which learning should reduce
    "e_p_rms_m": "the position error",
    "e_R_rms": "the attitude error",
    "Psi_mean": "the attitude error function",
    "delta_W_force_rms_N": "the force mismatch",
    "delta_W_moment_rms_Nm": "the moment mismatch",
    "e_lam_rms_N": "the contact force error",
}
ATTITUDE = ("e_R_rms", "Psi_mean", "delta_W_moment_rms_Nm")  # metrics of the attitude


@dataclasses.dataclass(frozen=True)
class LabelQuality:
    """Force labels of a body compared with the force that is to be learned.

    Attributes:
        name: Name of the body.
        residual: RMS norm of the residual force along the reference [N].
        bias: Standard deviation of the norm of the label bias [N].
        noise: RMS norm of the label noise [N].
    """

    name: str
    residual: float
    bias: float
    noise: float

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Errors that exceed the residual: "bias", "noise", both or none."""
        return tuple(name for name, value in (("bias", self.bias), ("noise", self.noise)) if value > self.residual > 0)


def label_quality(
    settings: Scenario, truth: Team, names: Sequence[str], payload: np.ndarray, agents: np.ndarray
) -> tuple[LabelQuality, ...]:
    """Compare label errors with residual forces.

    Labels are `m a - sum lam` of the payload and `m a + sum lam` of an agent. With n contacts and the force bias b per
    axis, the bias has the norm `b sqrt(3 n)`. White noise of a tick is reduced by the label filter by the ratio of
    bandwidths.

    Args:
        settings: Scenario.
        truth: True parameters.
        names: Names of the agents in team order.
        payload: Residual forces of the payload along the reference, one row per time [N].
        agents: Residual forces of the agents `(times, agents, 3)` [N].

    Returns:
        One entry for the payload, then one per agent.
    """
    sensors = settings.sensors
    share = np.sqrt(min(1.0, 2 * NOISE_BANDWIDTH * settings.learning.label_filter_Hz / settings.control_Hz))

    def quality(name: str, forces: np.ndarray, mass: float, contacts: int) -> LabelQuality:
        noise = np.sqrt(3 * (contacts * sensors.tip_force_N**2 + (mass * sensors.accelerometer_mps2) ** 2))
        return LabelQuality(
            name=name,
            residual=float(np.sqrt((forces**2).sum(-1).mean())),
            bias=float(sensors.tip_force_bias_N * np.sqrt(3 * contacts)),
            noise=float(share * noise),
        )

    found = [quality("payload", payload, float(truth.payload.mass), truth.contacts)]
    masses = np.concatenate([np.asarray(group.mass).sum(1) for group in truth.agent_groups])
    arms = [group.tree.arms for size, group in zip(truth.sizes, truth.agent_groups, strict=True) for _ in range(size)]
    for j, (name, mass, n) in enumerate(zip(names, masses, arms, strict=True)):
        found.append(quality(name, agents[:, j], float(mass), n))
    return tuple(found)


def describe_exceeded(found: Sequence[LabelQuality]) -> str:
    """Describe the bodies whose label errors exceed the residual forces.

    Args:
        found: Label quality by body.

    Returns:
        A sentence with the settings to change; "" if there are none.
    """
    parts = [
        f"{each.name}: residual force {each.residual:.2g} N, label "
        + " and ".join(f"{what} {getattr(each, what):.2g} N" for what in each.exceeded)
        for each in found
        if each.exceeded
    ]
    if not parts:
        return ""
    settings = {"bias": "sensors.tip_force_bias_N", "noise": "sensors.tip_force_N, or learning.label_filter_Hz"}
    causes = [text for what, text in settings.items() if any(what in each.exceeded for each in found)]
    return f"learning can increase the errors ({'; '.join(parts)}): lower {' and '.join(causes)}"


def comparison_warnings(settings: Scenario, cases: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    """Yield a warning for each case that learns and has a larger error than the case without learning.

    Errors are compared as the table of the study prints them, and their ratio with two digits. All cases have the same
    noise, so no other tolerance is used.

    Args:
        settings: Scenario.
        cases: Summary of each case.

    Yields:
        Case and sentence.
    """
    without = cases.get(WITHOUT_LEARNING)
    if without is None or not without["complete"]:
        return
    for case, found in cases.items():
        worse = _increases(without, found) if case in LEARNING_CASES else {}
        if worse:
            yield (
                case,
                f"{', '.join(worse.values())}; likely cause: {_likely_cause(settings, case, found, tuple(worse))}",
            )


def _increases(without: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, str]:
    """Return a sentence for each metric whose printed value is larger than without learning."""
    worse = {}
    for metric in STUDY_METRICS:
        if metric.key not in METRICS:
            continue
        first, second = (metric.format(each[metric.key]) for each in (without, found))
        if "none" not in (first, second) and float(second) > float(first):
            ratio = conclusions.format_ratio(found[metric.key], without[metric.key])
            if ratio == "1.00":
                continue
            unit = f"x {metric.unit}" if metric.key == "Psi_mean" else metric.unit
            stated = f"{METRICS[metric.key]} is {second} {unit} instead of {first} {unit} in {WITHOUT_LEARNING}"
            worse[metric.key] = stated if ratio == "none" else f"{stated} (ratio {ratio})"
    return worse


def _likely_cause(settings: Scenario, case: str, found: Mapping[str, Any], worse: tuple[str, ...]) -> str:
    """Return the likely cause of an increase, the most specific one first."""
    learning = settings.learning
    if not found["complete"]:
        return "the flight ended early"
    if not found["update_times_s"]:
        return "no model was learned"
    if learning.hyperparameters == "fixed":
        return "hyperparameters that do not fit the data (learning.hyperparameters)"
    reference = settings.reference
    if reference.kind == "lissajous":
        lap = reference.ramp_time_s + max(
            (T for T, a in zip(reference.period_s, reference.amplitude_m, strict=True) if a), default=0.0
        )
        if learning.end_s < lap:
            ends = f"learning.end_s is {learning.end_s:g} s, one lap ends at {lap:.3g} s"
            return f"data that do not cover the reference: {ends}"
    if case == "C2" and settings.sensors.tip_force_bias_N > 0 and all(key in ATTITUDE for key in worse):
        return (
            "the bias of the tip force sensors (sensors.tip_force_bias_N) in the payload's labels, which the agents' "
            "labels cancel in C3"
        )
    return (
        "label errors that are not small compared with the residuals (`colift check` compares them): "
        "sensors.tip_force_bias_N, sensors.tip_force_N"
    )
