"""Label errors compared with what is to be learned, and warnings of a study."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from colift import scenario
from colift.analysis import learning_benefit
from colift.analysis.study_metrics import STUDY_METRICS, Metric
from colift.scenario import team, template

SETTINGS = scenario.parse(template.scenario_template("t", 3, 0), "t.yaml")


def quality(force: float, *changes: str) -> tuple[learning_benefit.LabelQuality, ...]:
    settings = scenario.parse(template.scenario_template("t", 3, 0), "t.yaml", changes)
    forces = np.tile([force, 0.0, 0.0], (10, 1))
    truth = team.team(settings)[0]
    return learning_benefit.label_quality(
        settings, truth, team.agent_names(settings), forces, np.stack([forces] * 3, 1)
    )


def test_label_errors_have_the_stated_size() -> None:
    payload, agent, *_ = quality(1.0, "sensors.accelerometer_mps2=0", "sensors.tip_force_bias_N=0.05")
    assert payload.residual == pytest.approx(1.0)
    assert payload.bias == pytest.approx(0.05 * 3)  # three contacts, three axes
    assert agent.bias == pytest.approx(0.05 * np.sqrt(3))
    assert payload.noise == pytest.approx(0.1 * 3 * np.sqrt(2 * 1.22 * 8 / 500))
    assert payload.exceeded == ()
    assert learning_benefit.describe_exceeded((payload, agent)) == ""


def test_errors_beyond_the_residual_name_body_and_setting() -> None:
    found = quality(0.1, "sensors.tip_force_bias_N=0.05")
    assert found[0].exceeded == ("bias",)
    message = learning_benefit.describe_exceeded(found)
    assert "payload: residual force 0.1 N, label bias 0.15 N" in message
    assert message.endswith("lower sensors.tip_force_bias_N")
    assert "agent_1" not in message


def case(e_p: float, e_R: float, **others: Any) -> dict[str, Any]:
    return {
        "complete": True,
        "update_times_s": [2.0],
        "e_p_rms_m": e_p,
        "e_R_rms": e_R,
        "Psi_mean": 0.0,
        "e_lam_rms_N": 1.0,
        "delta_W_force_rms_N": 1.0,
        "delta_W_moment_rms_Nm": 1.0,
    } | others


def test_a_figure_worse_with_learning_is_reported_with_its_cause() -> None:
    cases = {"C1": case(0.01, 0.01), "C2": case(0.005, 0.02), "C3": case(0.02, 0.005, complete=False)}
    (c2, first), (c3, second) = learning_benefit.comparison_warnings(SETTINGS, cases)
    assert (c2, c3) == ("C2", "C3")
    assert first.startswith(
        "the attitude error is 20.0 mrad instead of 10.0 mrad in C1 (ratio 2.00); "
        "likely cause: the bias of the tip force sensors"
    )
    assert second == (
        "the position error is 20.0 mm instead of 10.0 mm in C1 (ratio 2.00); likely cause: the flight ended early"
    )


@pytest.mark.parametrize("metric", [metric for metric in STUDY_METRICS if metric.key in learning_benefit.METRICS])
def test_each_printed_error_is_compared_as_printed(metric: Metric):
    """A ratio of 1.01 is reported, and one that is printed as 1.00 is not."""
    cases = [case(1.0, 1.0) | {metric.key: 10.0 * ratio / metric.scale} for ratio in (1.0, 1.01)]
    ((name, message),) = learning_benefit.comparison_warnings(SETTINGS, dict(zip(("C1", "C3"), cases, strict=True)))
    assert name == "C3"
    assert message.startswith(learning_benefit.METRICS[metric.key])
    assert "; likely cause: " in message
    cases[1][metric.key] = 10.049 / metric.scale
    assert not list(learning_benefit.comparison_warnings(SETTINGS, dict(zip(("C1", "C3"), cases, strict=True))))
    swapped = dict(zip(("C3", "C1"), cases, strict=True))
    assert list(learning_benefit.comparison_warnings(SETTINGS, swapped)) == []


def test_all_errors_of_the_study_table_are_compared():
    others = {"sigma_L_force_mean_N", "sigma_A_force_mean_N", "lam_max_N", "thrust_max_N"}
    assert {metric.key for metric in STUDY_METRICS} == others | learning_benefit.METRICS.keys()


def test_missing_and_zero_errors_are_compared():
    cases = {"C1": case(0.0, 1.0, e_lam_rms_N=None), "C3": case(1.0, 1.0)}
    ((_, message),) = learning_benefit.comparison_warnings(SETTINGS, cases)
    assert message.startswith("the position error is 1000.0 mm instead of 0.0 mm in C1; likely cause")


def test_data_that_end_before_a_lap_are_a_cause() -> None:
    learning = {"end_s": 8.0, "update_times_s": [2.0, 4.0]}
    settings = SETTINGS.model_copy(update={"learning": SETTINGS.learning.model_copy(update=learning)})
    ((_, message),) = learning_benefit.comparison_warnings(settings, {"C1": case(1.0, 1.0), "C3": case(2.0, 1.0)})
    assert "learning.end_s is 8 s, one lap ends at 11 s" in message


def test_no_warning_without_a_comparison_or_an_increase() -> None:
    assert list(learning_benefit.comparison_warnings(SETTINGS, {"C3": case(2.0, 2.0)})) == []
    assert list(learning_benefit.comparison_warnings(SETTINGS, {"C1": case(1.0, 1.0), "C3": case(1.00004, 0.5)})) == []
