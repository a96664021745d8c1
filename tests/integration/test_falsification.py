"""The search for what breaks a certificate: what it tries, that it finds what is broken, and what it prints."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from colift import scenario
from colift.certification import linearized_trajectory
from colift.certification.certificate import ERRORS
from colift.cli import app
from colift.workflows import certification, falsification
from tests.support import certified_flights
from tests.support.certified_flights import made, short


@pytest.fixture
def certified(monkeypatch) -> None:
    """The scenario's flight is the one there is."""
    of = made()
    monkeypatch.setattr(certification, "certify", lambda *_, **__: of)


def test_a_round_is_every_kind_once_and_each_follows():
    """A round is every kind once and each follows from its name."""
    names = falsification.trial_names(short(), 2)
    assert (
        len(set(names)) == len(names) == 2 * (len(falsification.RESIDUAL_TRIALS) + len(falsification.SCENARIO_TRIALS))
    )
    hover = scenario.load_scenario(
        "turning",
        [
            "reference={kind: waypoints, poses: "
            "[{time_s: 0, position_m: [0, 0, 2]}, {time_s: 9, position_m: [1, 0, 2]}]}"
        ],
    )
    assert "reference_speed:0" not in falsification.trial_names(hover, 1)
    for name in ("worst:0", "seed", "seed:-1", "seed 0", "reference_speed:0", "seed:x"):
        with pytest.raises(
            ValueError, match=r"unknown trial .*: must be KIND:NUMBER .* worst_case_e_p, .*worst_case_e_p:0"
        ):
            list(falsification.falsify(hover, [name]))


def test_unknown_forces_that_norm_and_labels_allow_break(certified):
    """Unknown forces that norm and labels allow break no radius."""
    tries = [f"worst_case_{name}" for name in ("e_p:0", "e_omega:1")]
    tries += ["random_functional:0", "sinusoidal_functional:0", "sinusoidal_functional:1"]
    found = list(falsification.falsify(short(), tries))
    assert [one.name for one in found] == tries
    for one in found:
        assert set(one.observed_over_bound) == set(ERRORS)
        assert not one.is_violated, one
        assert one.num_components == made().certificate.errors.size
        assert one.overrides == ()
    assert found[0].observed_over_bound["e_p"] > 0.3  # the adversary comes near
    assert found[3].observed_over_bound != found[4].observed_over_bound
    assert next(falsification.falsify(short(), tries[3:4])) == found[3]


def test_a_radius_that_is_too_small_is_found_out(certified, monkeypatch):
    """With a tenth of the radius and of the spans' width the worst unknown is beyond both."""
    of = made().certificate
    recovery = of.ultimate_bounds["recovery"]
    small = dataclasses.replace(recovery, a_priori={error: 0.1 * x for error, x in recovery.a_priori.items()})
    center, span = made().nominal_linearization.records, of.intervals["a_priori"]
    middle = np.concatenate([getattr(center, error) for error in ERRORS], axis=1)[
        np.searchsorted(center.t, of.t - 1e-9)
    ]
    narrow = dataclasses.replace(
        span, lower=middle + 0.1 * (span.lower - middle), upper=middle + 0.1 * (span.upper - middle)
    )
    wrong = dataclasses.replace(
        of, ultimate_bounds={"recovery": small}, intervals={"a_priori": narrow, "a_posteriori": narrow}
    )
    broken = dataclasses.replace(made(), certificate=wrong)
    monkeypatch.setattr(certification, "certify", lambda *_, **__: broken)
    one = next(falsification.falsify(short(), ["worst_case_e_p:0"]))
    assert one.is_violated
    assert one.observed_over_bound["e_p"] > 1
    assert one.num_components_outside > 0


def test_a_run_that_ends_early_within_finite_radii_breaks_them(certified, monkeypatch):
    def ends(*_, **__):
        raise linearized_trajectory.TerminatedEarly("the nominal trajectory ended at t = 1 s: distance")

    monkeypatch.setattr(linearized_trajectory, "simulate_nominal", ends)
    one = next(falsification.falsify(short(), ["random_functional:0"]))
    assert one.is_violated
    assert one.max_ratio == math.inf
    assert one.message.endswith("distance")


@pytest.mark.parametrize("kind", falsification.SCENARIO_TRIALS)
@pytest.mark.parametrize("name", ["certified", "paper", "trio"])
def test_other_flights_are_scenarios_that_differ_where_they_say(name, kind):
    """Every change is read, three rounds of them differ, and nothing else is another."""
    settings = scenario.load_scenario(name)
    seen = set()
    for k in range(3):
        rng = falsification.random_generator(settings.seed, kind, k)
        changes = falsification.SCENARIO_TRIALS[kind](settings, k, rng)
        changed = scenario.parse(scenario.to_yaml(settings), settings.name, changes)
        sections = {change.split("=")[0].split(".")[0] for change in changes}
        for section, value in settings:
            assert section in sections or getattr(changed, section) == value
        assert changed != settings or kind == "sensor_noise"
        seen.add(tuple(changes))
    assert len(seen) == 3


def test_another_flight_is_held_against_its_own_radii(monkeypatch):
    """Another flight is held against its own radii and refused in words."""
    of = certified_flights.late()
    monkeypatch.setattr(certification, "certify", lambda *_, **__: of)
    one = next(falsification.falsify(short(), ["late_update:0"]))
    radii, observed = of.certificate.ultimate_bounds["energy"], of.certificate.observed
    assert one.observed_over_bound["e_p"] == observed["e_p"] / min(radii.a_posteriori["e_p"], radii.a_priori["e_p"])
    assert not one.is_violated
    assert one.overrides

    def refuses(*_, **__):
        raise ValueError("no certificate: the flight stopped:\n it tips over")

    monkeypatch.setattr(certification, "certify", refuses)
    one = next(falsification.falsify(short(), ["initial_state:0"]))
    assert one.message == "rejected: no certificate: the flight stopped: it tips over"
    assert (one.observed_over_bound, one.is_violated) == ({}, False)


def test_what_was_tried_is_told_with_how_to_repeat_it_and_kept(tmp_path, monkeypatch):
    ratios = {"e_p": 0.5, "e_v": 0.25, "e_R": 0.125, "e_omega": 0.0625}
    given = [
        falsification.FalsificationTrial("random_functional:0", (), ratios, 0, 12, ""),
        falsification.FalsificationTrial(
            "initial_state:0", ("initial_state.position_error_m=[1, 0, 0]",), {**ratios, "e_v": 1.5}, 3, 12, ""
        ),
        falsification.FalsificationTrial("seed:0", ("seed=1004",), {**ratios, "e_R": 0.75}, 0, 12, ""),
        falsification.FalsificationTrial("control_rate:0", ("control_Hz=100",), {}, 0, 0, "refused: too slow"),
    ]
    monkeypatch.setattr(falsification, "falsify", lambda *_: iter(given))
    asked = ["falsify", "certified", "--seed", "3", "--set", "duration_s=30", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, asked, catch_exceptions=False)
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    again = "certified --set duration_s=30"
    assert f"e_p: worst 0.500, colift falsify {again} --seed 3 --trial random_functional:0" in lines
    assert (
        f"e_v: worst 1.500, colift certify {again} --set 'initial_state.position_error_m=[1, 0, 0]' --seed 3" in lines
    )
    assert f"e_R: worst 0.750, colift certify {again} --seed 1004" in lines
    assert "control_rate:0: refused: too slow" in lines
    assert "1 of 3 trials that have bounds violate one: initial_state:0" in lines
    kept = json.loads((tmp_path / "falsification.json").read_text())
    assert [one["name"] for one in kept["trials"]] == [one.name for one in given]
    assert kept["schema"] == 2
    assert kept["trials"][1]["observed_over_bound"]["e_v"] == 1.5
    assert Path(tmp_path / "falsification.json").read_text().count(kept["run"]) == 1


def test_a_name_that_is_no_try_is_said_with_those_that_are(tmp_path):
    asked = ["falsify", "certified", "--trial", "worst", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, asked)
    assert result.exit_code == 2
    assert "unknown trial worst: must be KIND:NUMBER with one of the kinds worst_case_e_p" in result.stderr
