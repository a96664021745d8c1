"""Tests of the falsification search: trials, detection of invalid bounds, and output."""

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
    """Replace the certified flight by a stored one."""
    of = made()
    monkeypatch.setattr(certification, "certify", lambda *_, **__: of)


def test_round_has_every_kind_and_names_are_reproducible():
    """A round has each kind of trial once, and a trial follows from its name."""
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


def test_admissible_residuals_violate_no_bound(certified):
    """Residuals that norm and labels allow violate no bound."""
    trials = ["worst e_p 0", "worst e_omega 1", "drawn 0", "swinging 0", "swinging 1"]
    found = list(falsification.falsify(short(), trials))
    assert [one.name for one in found] == trials
    for one in found:
        assert set(one.ratios) == set(ERRORS)
        assert not one.is_violated, one
        assert one.num_components == made().certificate.errors.size
        assert one.changes == ()
    assert found[0].ratios["e_p"] > 0.3  # close to the bound
    assert found[3].ratios != found[4].ratios
    assert next(falsification.falsify(short(), trials[3:4])) == found[3]


def test_too_small_bounds_are_falsified(certified, monkeypatch):
    """With bounds and intervals scaled by 0.1 the worst-case residual violates both."""
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


def test_early_termination_violates_finite_bounds(certified, monkeypatch):
    def ends(*_, **__):
        raise linearized_trajectory.TerminatedEarly("the nominal trajectory ended at t = 1 s: distance")

    monkeypatch.setattr(linearized_trajectory, "simulate_nominal", ends)
    one = next(falsification.falsify(short(), ["drawn 0"]))
    assert one.is_violated
    assert one.max_ratio == math.inf
    assert one.message.endswith("distance")


@pytest.mark.parametrize("kind", falsification.TRIAL_KINDS)
@pytest.mark.parametrize("name", ["certified", "paper", "trio"])
def test_trials_change_only_the_stated_settings(name, kind):
    """Every override is accepted, three rounds differ, and all other settings are unchanged."""
    settings = scenario.load_scenario(name)
    changes_of_rounds = set()
    for k in range(3):
        rng = np.random.default_rng((settings.seed, k, *kind.encode()))
        changes = falsification.TRIAL_KINDS[kind](settings, k, rng)
        changed = scenario.parse(scenario.to_yaml(settings), settings.name, changes)
        sections = {change.split("=")[0].split(".")[0] for change in changes}
        for section, value in settings:
            assert section in sections or getattr(changed, section) == value
        assert changed != settings or kind == "sensors"
        changes_of_rounds.add(tuple(changes))
    assert len(changes_of_rounds) == 3


def test_trial_uses_bounds_of_its_own_flight(monkeypatch):
    """A trial with another flight is compared with that flight's bounds; a refusal is reported as a message."""
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


def test_trials_are_printed_with_commands_and_saved(tmp_path, monkeypatch):
    ratios = {"e_p": 0.5, "e_v": 0.25, "e_R": 0.125, "e_omega": 0.0625}
    trials = [
        falsification.FalsificationTrial("drawn 0", (), ratios, 0, 12, ""),
        falsification.FalsificationTrial(
            "start 0", ("initial_state.position_error_m=[1, 0, 0]",), {**ratios, "e_v": 1.5}, 3, 12, ""
        ),
        falsification.FalsificationTrial("seed 0", ("seed=1004",), {**ratios, "e_R": 0.75}, 0, 12, ""),
        falsification.FalsificationTrial("rate 0", ("control_Hz=100",), {}, 0, 0, "refused: too slow"),
    ]
    monkeypatch.setattr(falsification, "falsify", lambda *_: iter(trials))
    arguments = ["falsify", "certified", "--seed", "3", "--set", "duration_s=30", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, arguments, catch_exceptions=False)
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


def test_unknown_trial_is_refused_with_known_names(tmp_path):
    arguments = ["falsify", "certified", "--case", "worst", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, arguments)
    assert result.exit_code == 2
    assert "unknown trial 'worst': must be one of worst e_p" in result.stderr
