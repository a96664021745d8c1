"""Result files of earlier versions are read under the names of today; other files are refused in one line."""

from __future__ import annotations

import functools
import json

import pytest

from colift.analysis import result_checks, result_files
from tests.support import summaries

BODY = {"exceeded_share": {"plain": 0.1, "force": 0.0}, "tightness_median": 4.0, "beta": [2.0]}
METRICS = {
    "complete": True,
    "stopped": "",
    "e_p_rms_m": 0.1,
    "e_v_rms": 0.2,
    "sigma_L_force_mean": 0.3,
    "singular_min": 0.15,
    "n_data": {"payload": 10, "agents": 20},
    "updates": [1.0],
    "correlation": {"sigma_L_e_p": {"run": 0.1}},
    "outside": {"payload": {"share": [0.05], "error_over_deviation": [1.0]}},
    "bound": {"payload": BODY, "agents": [BODY]},
    "residual": {"payload": {"mean": [1.0], "varying_rms": [0.5], "constant_share": [0.8]}},
    "wall_s": {"fit": 1.0, "radii": 2.0},
}
SUMMARY = {  # as version 0.1 wrote it
    "scenario": "paper",
    "settings": "38ec2d4a5380",
    "run": "colift-run-1",
    "slowest_mode": {"stable": True, "says": "-0.9 rad/s", "rad_s": [-0.9, 3.2]},
    "margins": {"delay_s": 0.014, "gain": [0.4, 1.5], "says": "delay margin 14 ms"},
    "limits": {"distance_m": 3.0, "height_m": None, "grip": 0.01, "grip_1pkg": [0.002]},
    "cases": {"C3": METRICS, "C4": METRICS},
    "heldout": {"C4": {"moved": {"e_p_rms_m": None, "stopped": "distance"}}},
    "bound": {"bound": "energy", "norm": 6.0, "assumed": ["rkhs norm"]},
    "residual": METRICS["residual"],
    "wall_s": {"figures": 4.0},
}
CERTIFICATE = {
    "scenario": "certified",
    "settings": "b5a50e813c3a",
    "run": "colift-run-1",
    "exceeded": [
        {"flight": "adversary", "error": "e_p", "bound": "energy", "of": "tube", "observed": 2.0, "radius": 1.0}
    ],
    "observed": {"e_p": 0.004},
    "floor": {"e_p": 0.003},
    "unknown": {"e_p": 0.002},
    "beyond_first_order": {"e_p": 1e-5},
    "noise": {"e_p": 0.0},
    "components_left": {"tube": 0, "run": 1},
    "radii": {
        "energy": {
            "run": {"e_p": 0.02},
            "tube": {"e_p": 0.03},
            "tightness": {"run": {"e_p": 5.0}, "tube": {"e_p": 7.5}},
            "assumed": ["first order"],
            "status": "assumed",
        }
    },
    "left_out": {"recovery": "no function passes"},
    "no_tube": "",
    "tube": {"difference": [0.05], "contraction": 0.7},
    "interface": {"alpha_N_Nm": [1.0], "gamma_1_s": 0.9, "kappa_N_Nm": [[1.0]], "static_N_Nm": [[2.0]]},
    "slack_m": {"energy, one functional, any run": 0.03, "floor: nothing unknown": 0.003},
    "adversary": {"observed": {"e_p": 0.007}, "radius": {"e_p": 0.008}, "radius_over_adversary": 1.1},
}


def written(path, content):
    path.write_text(json.dumps(content))
    return path


def test_a_summary_of_version_0_1_is_read(tmp_path):
    found = result_files.load_summary(written(tmp_path / "summary.json", SUMMARY))
    body = {"violation_rate": {"total": 0.1, "force": 0.0}, "bound_over_error_median": 4.0, "beta": [2.0]}
    residual = {"payload": {"mean": [1.0], "state_dependent_std": [0.5], "mean_power_fraction": [0.8]}}
    metrics = {
        "complete": True,
        "termination_reason": "",
        "e_p_rms_m": 0.1,
        "e_v_rms_mps": 0.2,
        "sigma_L_force_mean_N": 0.3,
        "min_delassus_singular_value_1pkg": 0.15,
        "num_samples": {"payload": 10, "agents": 20},
        "update_times_s": [1.0],
        "correlation": {"sigma_L_e_p": {"run": 0.1}},
        "miscoverage": {"payload": {"rate": [0.05], "normalized_error_rms": [1.0]}},
        "error_bound": {"payload": body, "agents": [body]},
        "residual": residual,
        "wall_time_s": {"fit": 1.0, "error_bounds": 2.0},
    }
    assert found == {
        "schema": 2,
        "scenario": "paper",
        "settings_digest": "38ec2d4a5380",
        "run": "colift-run-1",
        "slowest_mode": {"stable": True, "description": "-0.9 rad/s", "eigenvalue_radps": [-0.9, 3.2]},
        "stability_margins": {
            "delay_margin_s": 0.014,
            "gain_margin": [0.4, 1.5],
            "description": "delay margin 14 ms",
        },
        "termination_limits": {
            "max_position_error_m": 3.0,
            "min_height_m": None,
            "min_grasp_ratio": 0.01,
            "min_delassus_singular_value_1pkg": [0.002],
        },
        "cases": {"C3": metrics, "adaptive": metrics},
        "held_out": {"adaptive": {"moved": {"e_p_rms_m": None, "termination_reason": "distance"}}},
        "error_bound_assumptions": {"bound": "energy", "rkhs_norm": 6.0, "unproven_assumptions": ["rkhs norm"]},
        "residual": residual,
        "wall_time_s": {"figures": 4.0},
    }


def test_a_certificate_of_version_0_1_is_read(tmp_path):
    found = result_files.load_certificate(written(tmp_path / "certificate.json", CERTIFICATE))
    assert found == {
        "schema": 2,
        "scenario": "certified",
        "settings_digest": "b5a50e813c3a",
        "run": "colift-run-1",
        "violations": [
            {
                "run": "adversarial_test",
                "error": "e_p",
                "prediction_bound": "energy",
                "kind": "a_priori",
                "observed": 2.0,
                "ultimate_bound": 1.0,
            }
        ],
        "observed": {"e_p": 0.004},
        "nominal_error": {"e_p": 0.003},
        "disturbance_response": {"e_p": 0.002},
        "linearization_error": {"e_p": 1e-5},
        "noise_response": {"e_p": 0.0},
        "num_components_outside": {"a_priori": 0, "a_posteriori": 1},
        "ultimate_bounds": {
            "energy": {
                "a_posteriori": {"e_p": 0.02},
                "a_priori": {"e_p": 0.03},
                "bound_over_observed": {"a_posteriori": {"e_p": 5.0}, "a_priori": {"e_p": 7.5}},
                "unproven_assumptions": ["first order"],
                "status": "assumed",
            }
        },
        "unavailable_bounds": {"recovery": "no function passes"},
        "tube_failure": "",
        "tube": {"residual_deviation": [0.05], "contraction": 0.7},
        "agent_iss": {"alpha_N_Nm": [1.0], "gamma_1ps": 0.9, "kappa": [[1.0]], "static_gain": [[2.0]]},
        "conservatism_m": {"energy, a priori": 0.03, "nominal error": 0.003},
        "adversarial_test": {
            "observed": {"e_p": 0.007},
            "a_posteriori": {"e_p": 0.008},
            "bound_over_observed": 1.1,
        },
    }


def test_a_file_of_the_present_schema_is_returned_as_it_is(tmp_path):
    content = {"schema": 2, "cases": {}, "bound": "a key that schema 1 has as well"}
    assert result_files.load_summary(written(tmp_path / "summary.json", content)) == content


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"summary.json:1: not JSON"),
        ("[]", "summary.json: must contain a JSON object"),
        ('{"observed": {}}', "summary.json: has no entry cases, so it is not a result file of colift"),
        ('{"schema": 3, "cases": {}}', "summary.json: is of schema 3; this version of colift reads schema 2 and 1"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "summary.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"summary\.json") as error:
        result_files.load_summary(path)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1


DAMAGES = [
    ("cases.C1.e_p_rms_m", "0.1", "not a number of at least 0 or null"),
    ("cases.C1.e_p_rms_m", True, "not a number of at least 0 or null"),
    ("cases.C1.e_p_rms_m", 10**400, "a whole number of 1329 bits, not a number"),
    ("cases.C1.complete", "yes", "not true or false"),
    ("cases.C1.warnings", [5], "cases.C1.warnings.0 is 5, not a text"),
    ("cases.C1.error_bound.payload", [], "cases.C1.error_bound.payload is \\[\\], not an object"),
    ("cases.C1.e_p_rms_m", -1e308, "cases.C1.e_p_rms_m is -1e\\+308, not a number of at least 0"),
    ("cases.C1.update_times_s", [True, "x"], "cases.C1.update_times_s.0 is True, not a number of at least 0"),
    ("cases.C1.update_times_s", {"a": 1.0}, "cases.C1.update_times_s is {'a': 1.0}, not a list"),
    ("cases.C1.error_bound.payload.violation_rate.force", 1.5, "force is 1.5, not a number from 0 to 1"),
    ("cases.C1.saturated_ticks", -1, "is -1, not a whole number of at least 0"),
    ("cases.<script>", {}, "cases has the entry '<script>', whose name is not an identifier"),
    ("cases.C1.contact_forces", {"\x1b[2J\n": 1}, r"forces\.'\\x1b\[2J\\n' is 1, not an object"),
    ("stability_margins.gain_margin", [1], "gain_margin is \\[1\\], not a list of two numbers"),
    ("stability_margins.gain_margin", ["0", "1"], "not a list of two numbers"),
    ("cases", 5, "cases is 5, not an object"),
    ("cases", [], "cases is \\[\\], not an object"),
    ("seed", 1.5, "seed is 1.5, not a whole number"),
    ("versions", "3.11", "versions is '3.11', not an object"),
    ("slowest_mode", "stable", "slowest_mode is 'stable', not an object"),
    ("schema", "2", "is of schema '2'"),
]


@pytest.mark.parametrize(("place", "value", "reason"), DAMAGES)
def test_a_summary_with_wrong_types_is_refused(tmp_path, place, value, reason):
    content = json.loads(json.dumps(summaries.SUMMARY | {"cases": {"C1": summaries.metrics()}}))
    path = tmp_path / "summary.json"
    path.write_text(json.dumps(content))
    result_files.load_summary(path)
    *keys, last = place.split(".")
    functools.reduce(dict.__getitem__, keys, content)[last] = value
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=reason) as refused:
        result_files.load_summary(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_optional_sections_may_be_null(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text(json.dumps(summaries.SUMMARY | {"cases": {}, "slowest_mode": None}))
    assert result_files.load_summary(path)["slowest_mode"] is None


def test_a_case_without_a_required_entry_is_refused():
    complete = summaries.metrics(update_times_s=[])
    result_checks.refuse_incomplete_case("C1", complete)
    for key in result_checks.REQUIRED_OF_CASE:
        with pytest.raises(ValueError, match=f"C1 has no entry '{key}'"):
            result_checks.refuse_incomplete_case("C1", {name: x for name, x in complete.items() if name != key})
