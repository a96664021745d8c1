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
        len(set(names))
        == len(names)
        == 2 * (len(falsification.ADVERSARIAL_DISTURBANCE) + len(falsification.TRIAL_KINDS))
    )
    hover = scenario.load_scenario(
        "turning",
        [
            "reference={kind: waypoints, poses: "
            "[{time_s: 0, position_m: [0, 0, 2]}, {time_s: 9, position_m: [1, 0, 2]}]}"
        ],
    )
    assert "path 0" not in falsification.trial_names(hover, 1)
    for name in ("worst 0", "drawn", "drawn -1", "path 0", "drawn x"):
        with pytest.raises(ValueError, match=r"unknown trial '.*': must be one of worst e_p, .*'worst e_p 0'"):
            list(falsification.falsify(hover, [name]))


def test_unknown_forces_that_norm_and_labels_allow_break(certified):
    """Unknown forces that norm and labels allow break no radius."""
    tries = ["worst e_p 0", "worst e_omega 1", "drawn 0", "swinging 0", "swinging 1"]
    found = list(falsification.falsify(short(), tries))
    assert [one.name for one in found] == tries
    for one in found:
        assert set(one.ratios) == set(ERRORS)
        assert not one.is_violated, one
        assert one.num_components == made().certificate.errors.size
        assert one.changes == ()
    assert found[0].ratios["e_p"] > 0.3  # the adversary comes near
    assert found[3].ratios != found[4].ratios
    assert next(falsification.falsify(short(), tries[3:4])) == found[3]


def test_a_radius_that_is_too_small_is_found_out(certified, monkeypatch):
    """With a tenth of the radius and of the spans' width the worst unknown is beyond both."""
    of = made().certificate
    recovery = of.radii["recovery"]
    small = dataclasses.replace(recovery, a_priori={error: 0.1 * x for error, x in recovery.a_priori.items()})
    center, span = made().nominal_linearization.records, of.intervals["tube"]
    middle = np.concatenate([getattr(center, error) for error in ERRORS], axis=1)[
        np.searchsorted(center.t, of.t - 1e-9)
    ]
    narrow = dataclasses.replace(
        span, lower=middle + 0.1 * (span.lower - middle), upper=middle + 0.1 * (span.upper - middle)
    )
    wrong = dataclasses.replace(of, radii={"recovery": small}, intervals={"tube": narrow, "run": narrow})
    broken = dataclasses.replace(made(), certificate=wrong)
    monkeypatch.setattr(certification, "certify", lambda *_, **__: broken)
    one = next(falsification.falsify(short(), ["worst e_p 0"]))
    assert one.is_violated
    assert one.ratios["e_p"] > 1
    assert one.violations > 0


def test_a_run_that_ends_early_within_finite_radii_breaks_them(certified, monkeypatch):
    def ends(*_, **__):
        raise linearized_trajectory.TerminatedEarly("the nominal trajectory ended at t = 1 s: distance")

    monkeypatch.setattr(linearized_trajectory, "simulate_nominal", ends)
    one = next(falsification.falsify(short(), ["drawn 0"]))
    assert one.is_violated
    assert one.max_ratio == math.inf
    assert one.message.endswith("distance")


@pytest.mark.parametrize("kind", falsification.TRIAL_KINDS)
@pytest.mark.parametrize("name", ["certified", "paper", "trio"])
def test_other_flights_are_scenarios_that_differ_where_they_say(name, kind):
    """Every change is read, three rounds of them differ, and nothing else is another."""
    settings = scenario.load_scenario(name)
    seen = set()
    for k in range(3):
        rng = np.random.default_rng((settings.seed, k, *kind.encode()))
        changes = falsification.TRIAL_KINDS[kind](settings, k, rng)
        changed = scenario.parse(scenario.to_yaml(settings), settings.name, changes)
        sections = {change.split("=")[0].split(".")[0] for change in changes}
        for section, value in settings:
            assert section in sections or getattr(changed, section) == value
        assert changed != settings or kind == "sensors"
        seen.add(tuple(changes))
    assert len(seen) == 3


def test_another_flight_is_held_against_its_own_radii(monkeypatch):
    """Another flight is held against its own radii and refused in words."""
    of = certified_flights.late()
    monkeypatch.setattr(certification, "certify", lambda *_, **__: of)
    one = next(falsification.falsify(short(), ["late update 0"]))
    radii, observed = of.certificate.radii["energy"], of.certificate.observed
    assert one.ratios["e_p"] == observed["e_p"] / min(radii.a_posteriori["e_p"], radii.a_priori["e_p"])
    assert not one.is_violated
    assert one.changes

    def refuses(*_, **__):
        raise ValueError("no certificate: the flight stopped:\n it tips over")

    monkeypatch.setattr(certification, "certify", refuses)
    one = next(falsification.falsify(short(), ["start 0"]))
    assert one.message == "rejected: no certificate: the flight stopped: it tips over"
    assert (one.ratios, one.is_violated) == ({}, False)


def test_what_was_tried_is_told_with_how_to_repeat_it_and_kept(tmp_path, monkeypatch):
    ratios = {"e_p": 0.5, "e_v": 0.25, "e_R": 0.125, "e_omega": 0.0625}
    given = [
        falsification.FalsificationTrial("drawn 0", (), ratios, 0, 12, ""),
        falsification.FalsificationTrial(
            "start 0", ("initial_state.position_error_m=[1, 0, 0]",), {**ratios, "e_v": 1.5}, 3, 12, ""
        ),
        falsification.FalsificationTrial("seed 0", ("seed=1004",), {**ratios, "e_R": 0.75}, 0, 12, ""),
        falsification.FalsificationTrial("rate 0", ("control_Hz=100",), {}, 0, 0, "refused: too slow"),
    ]
    monkeypatch.setattr(falsification, "falsify", lambda *_: iter(given))
    asked = ["falsify", "certified", "--seed", "3", "--set", "duration_s=30", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, asked, catch_exceptions=False)
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    again = "certified --set duration_s=30"
    assert f"e_p: worst 0.500, colift falsify {again} --seed 3 --case 'drawn 0'" in lines
    assert (
        f"e_v: worst 1.500, colift certify {again} --set 'initial_state.position_error_m=[1, 0, 0]' --seed 3" in lines
    )
    assert f"e_R: worst 0.750, colift certify {again} --seed 1004" in lines
    assert "rate 0: refused: too slow" in lines
    assert "1 of 3 trials that have bounds violate one: start 0" in lines
    kept = json.loads((tmp_path / "falsification.json").read_text())
    assert [one["name"] for one in kept["trials"]] == ["drawn 0", "start 0", "seed 0", "rate 0"]
    assert kept["trials"][1]["ratios"]["e_v"] == 1.5
    assert Path(tmp_path / "falsification.json").read_text().count(kept["run"]) == 1


def test_a_name_that_is_no_try_is_said_with_those_that_are(tmp_path):
    asked = ["falsify", "certified", "--case", "worst", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, asked)
    assert result.exit_code == 2
    assert "unknown trial 'worst': must be one of worst e_p" in result.stderr
