"""Tests of the falsification search: trials, detection of invalid bounds, and output."""

from __future__ import annotations

import contextlib
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
from colift.runtime import signals
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


@pytest.mark.long
def test_admissible_residuals_violate_no_bound(certified):
    """Residuals that norm and labels allow violate no bound."""
    trials = [f"worst_case_{name}" for name in ("e_p:0", "e_omega:1")]
    trials += ["random_functional:0", "sinusoidal_functional:0", "sinusoidal_functional:1"]
    found = list(falsification.falsify(short(), trials))
    assert [one.name for one in found] == trials
    for one in found:
        assert set(one.observed_over_bound) == set(ERRORS)
        assert not one.is_violated, one
        assert one.num_components == made().certificate.errors.size
        assert one.overrides == ()
    assert found[0].observed_over_bound["e_p"] > 0.3  # close to the bound
    assert found[3].observed_over_bound != found[4].observed_over_bound
    assert next(falsification.falsify(short(), trials[3:4])) == found[3]


def test_too_small_bounds_are_falsified(certified, monkeypatch):
    """With bounds and intervals scaled by 0.1 the worst-case residual violates both."""
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


def test_early_termination_violates_finite_bounds(certified, monkeypatch):
    def ends(*_, **__):
        raise linearized_trajectory.TerminatedEarly("the nominal trajectory ended at t = 1 s: distance")

    monkeypatch.setattr(linearized_trajectory, "simulate_nominal", ends)
    one = next(falsification.falsify(short(), ["random_functional:0"]))
    assert one.is_violated
    assert one.max_ratio == math.inf
    assert one.message.endswith("distance")


@pytest.mark.parametrize("kind", falsification.SCENARIO_TRIALS)
@pytest.mark.parametrize("name", ["certified", "paper", "trio"])
def test_trials_change_only_the_stated_settings(name, kind):
    """Every override is accepted, three rounds differ, and all other settings are unchanged."""
    settings = scenario.load_scenario(name)
    changes_of_rounds = set()
    for k in range(3):
        rng = falsification.random_generator(settings.seed, kind, k)
        changes = falsification.SCENARIO_TRIALS[kind](settings, k, rng)
        changed = scenario.parse(scenario.to_yaml(settings), settings.name, changes)
        sections = {change.split("=")[0].split(".")[0] for change in changes}
        for section, value in settings:
            assert section in sections or getattr(changed, section) == value
        assert changed != settings or kind == "sensor_noise"
        changes_of_rounds.add(tuple(changes))
    assert len(changes_of_rounds) == 3


def test_trial_uses_bounds_of_its_own_flight(monkeypatch):
    """A trial with another flight is compared with that flight's bounds; a refusal is reported as a message."""
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


def test_trials_are_printed_with_commands_and_saved(tmp_path, monkeypatch):
    ratios = {"e_p": 0.5, "e_v": 0.25, "e_R": 0.125, "e_omega": 0.0625}
    trials = [
        falsification.FalsificationTrial("random_functional:0", (), ratios, 0, 12, ""),
        falsification.FalsificationTrial(
            "initial_state:0", ("initial_state.position_error_m=[1, 0, 0]",), {**ratios, "e_v": 1.5}, 3, 12, ""
        ),
        falsification.FalsificationTrial("seed:0", ("seed=1004",), {**ratios, "e_R": 0.75}, 0, 12, ""),
        falsification.FalsificationTrial("control_rate:0", ("control_Hz=100",), {}, 0, 0, "refused: too slow"),
    ]
    monkeypatch.setattr(falsification, "falsify", lambda *_: iter(trials))
    arguments = ["falsify", "certified", "--seed", "3", "--set", "duration_s=30", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, arguments, catch_exceptions=False)
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
    assert [one["name"] for one in kept["trials"]] == [one.name for one in trials]
    assert kept["schema"] == 2
    assert kept["trials"][1]["observed_over_bound"]["e_v"] == 1.5
    assert Path(tmp_path / "falsification.json").read_text().count(kept["run"]) == 1


def run_trials(monkeypatch, out: Path, names: list[str], stop_after: int | None, *options: str) -> dict | None:
    """Run `falsify` with trials that are replaced, interrupted after some of them; return the content of the file."""
    done = [falsification.FalsificationTrial(name, (), {"e_p": 0.5}, 0, 12, "") for name in names]

    def trials(*_):
        yield from done[:stop_after]
        if stop_after is not None:
            raise signals.Interrupted

    monkeypatch.setattr(falsification, "falsify", trials)
    arguments = ["falsify", "certified", "--out", str(out), "--trial", ",".join(names), "-q", *options]
    with contextlib.suppress(signals.Interrupted):
        result = CliRunner().invoke(app.app, arguments, catch_exceptions=False)
        assert result.exit_code == 0, result.output
    file = out / "falsification.json"
    return json.loads(file.read_text()) if file.exists() else None


def names_of(content: dict) -> list[str]:
    return [trial["name"] for trial in content["trials"]]


def test_interrupted_trials_are_pending_and_earlier_kept(tmp_path, monkeypatch):
    out = tmp_path / "out"
    first = run_trials(monkeypatch, out, ["seed:0", "seed:1"], None)
    assert (names_of(first), first["pending"]) == (["seed:0", "seed:1"], [])
    second = run_trials(monkeypatch, out, ["seed:2", "seed:3"], 1)
    assert (names_of(second), second["pending"]) == (["seed:0", "seed:1", "seed:2"], ["seed:3"])
    third = run_trials(monkeypatch, out, ["seed:3", "seed:0"], None)
    assert (names_of(third), third["pending"]) == (["seed:0", "seed:1", "seed:2", "seed:3"], [])


def test_interrupted_replacement_keeps_the_earlier_file(tmp_path, monkeypatch):
    out = tmp_path / "out"
    first = run_trials(monkeypatch, out, ["seed:0", "seed:1"], None)
    assert run_trials(monkeypatch, out, ["seed:2", "seed:3"], 1, "--replace") == first
    assert names_of(run_trials(monkeypatch, out, ["seed:2"], None, "--replace")) == ["seed:2"]


def test_damaged_earlier_trials_are_refused(tmp_path, monkeypatch):
    out = tmp_path / "out"
    first = run_trials(monkeypatch, out, ["seed:0"], None)
    for damaged in ({"run": first["run"], "trials": 5}, {"run": first["run"], "trials": [{}]}, {"run": first["run"]}):
        (out / "falsification.json").write_text(json.dumps(damaged))
        result = CliRunner().invoke(app.app, ["falsify", "certified", "--out", str(out), "--trial", "seed:1"])
        assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
        assert "falsification.json: the earlier trials are damaged" in result.stderr


def test_unknown_trial_is_refused_with_known_names(tmp_path):
    arguments = ["falsify", "certified", "--trial", "worst", "--out", str(tmp_path)]
    result = CliRunner().invoke(app.app, arguments)
    assert result.exit_code == 2
    assert "unknown trial worst: must be KIND:NUMBER with one of the kinds worst_case_e_p" in result.stderr
