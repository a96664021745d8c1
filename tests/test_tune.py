"""Gains that are chosen: the steps of the search on matrices that are known, and what is written."""

from __future__ import annotations

import dataclasses
import functools
import json
import types
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from colift import modes, scenario, starter, study, tune
from colift.__main__ import app
from colift.scenario import Settings, build
from tests import light

DT = 0.002


def oscillator(settings: Settings) -> np.ndarray:
    """A payload on a spring and a damper, K_p and K_v, sampled; the other gains are six poles of their own."""
    control = settings.control
    A = np.zeros((6, 6))
    A[0, 1], A[1, 0], A[1, 1] = 1.0, -control.K_p[0], -control.K_v[0]
    for k, name in enumerate(("k_R", "k_omega", "agent_k_R", "agent_k_omega")):
        A[2 + k, 2 + k] = -getattr(control, name)
    values, vectors = np.linalg.eig(A)
    return np.real(vectors @ np.diag(np.exp(DT * values)) @ np.linalg.inv(vectors))


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops that are `oscillator`, with late commands the same; plans that are their settings."""

    def loop(settings: Settings) -> tune.Loop:
        plan = types.SimpleNamespace(dt=DT, settings=settings)
        return tune.Loop(settings, plan, None, {}, oscillator(settings))  # pyright: ignore

    monkeypatch.setattr(tune, "loop", loop)
    monkeypatch.setattr(study, "plan", lambda settings, _case: settings)
    monkeypatch.setattr(modes, "derivative", lambda settings, _z, _x: oscillator(settings))
    monkeypatch.setattr(modes, "delayed", lambda _x, M, _ticks: M)
    monkeypatch.setattr(tune, "_most_stiffness", lambda _: tune.FARTHEST)


def started(**gains: object) -> Settings:
    return light.settings(control=light.SAMPLE.control.model_copy(update=gains))


def test_the_slopes_are_the_derivatives_of_the_rates(known: None):
    of = tune.loop(started(K_p=(5.0,) * 3, K_v=(4.2,) * 3))
    rates, slopes = tune._slopes(of)
    i = int(np.argmax(rates))  # Re = -K_v / 2, whatever K_p is
    assert rates[i] == pytest.approx(-2.1, abs=1e-9)
    np.testing.assert_allclose(slopes[i], [0, -2.1, 0, 0, 0, 0], atol=2e-3)


def test_the_search_finds_what_damps_best_within_its_budget(known: None):
    """Of `s^2 + K_v s + K_p` the slower pole is fastest where both are `-sqrt(K_p)`; K_p is at its bound."""
    before = started(K_p=(5.0,) * 3, K_v=(1.0,) * 3)
    first, best, used = tune.tune(before)
    assert first.growth == pytest.approx(-0.5, abs=1e-6)
    most = -np.sqrt(5.0 * np.exp(tune.FARTHEST))
    assert most - 1e-9 <= best.growth < -2  # K_v at its bound, 4, gives -2: both have moved
    assert used <= tune.LOOPS
    assert all(0.24 < getattr(best.settings.control, name) / getattr(before.control, name) < 4.01
               for name in ("k_R", "agent_k_R"))  # fmt: skip


def test_late_commands_count(known: None, monkeypatch: pytest.MonkeyPatch):
    of = tune.loop(started())
    late = np.eye(6) * np.exp(0.5 * DT)
    monkeypatch.setattr(modes, "delayed", lambda _x, _M, _ticks: late)
    assert of.growth == pytest.approx(0.5)
    assert of.ticks == 2


def test_the_posture_is_a_gain_only_where_joints_are_beyond_need():
    assert "posture" not in tune.names(scenario.load("paper"))
    assert "posture" in tune.names(scenario.load("beam"))
    assert tune.names(light.settings()) == tune.GAINS[:-1]


def test_gains_are_scaled_and_written_with_three_digits():
    steps = np.log([1.2345, 1, 1, 1, 2, 1])
    control = tune.scaled(started(K_p=(5.0, 5.0, 6.0)), steps).control
    assert control.K_p == (6.17, 6.17, 7.41)
    assert control.agent_k_R == 2 * light.SAMPLE.control.agent_k_R


def test_the_text_keeps_comments_where_it_says_the_same():
    written = starter.text("mine", 3, 0)
    tuned = tune.scaled(scenario.parse(written, "mine.yaml"), np.full(6, 0.1))
    text = tune.text(tuned, written, "mine.yaml")
    assert "# A scenario to begin with" in text
    assert "K_p: 5.53" in text
    assert scenario.parse(text, "mine.yaml") == tuned
    other = tuned.model_copy(update={"seed": 7})  # as by --set: the text would say otherwise
    assert scenario.parse(tune.text(other, written, "mine.yaml"), "mine.yaml") == other
    assert "#" not in tune.text(tuned, None, "mine.yaml")


@functools.cache
def lit() -> tune.Loop:
    return tune.loop(light.settings())


def test_thrust_bounds_the_stiffness():
    of = lit()
    assert of.growth < 0
    near = of.settings.model_copy(
        update={"start": of.settings.start.model_copy(update={"position_error_m": (0, 0, 0)})}
    )
    assert tune._most_stiffness(dataclasses.replace(of, settings=near)) == tune.FARTHEST
    far = of.settings.model_copy(update={"start": of.settings.start.model_copy(update={"position_error_m": (9, 0, 0)})})
    assert tune._most_stiffness(dataclasses.replace(of, settings=far)) == 0


def test_a_real_loop_s_slopes_point_where_it_decays_faster():
    """The light team: the rate along a short step, as the slopes have it and as the loop with it has it."""
    of = lit()
    rates, slopes = tune._slopes(of)
    step = tune._step(rates, slopes, np.full(6, -0.05), np.full(6, 0.05))
    assert tune.loop(tune.scaled(of.settings, step)).growth < of.growth
    found = tune.numbers(of)
    assert found["slowest_mode_1ps"] <= of.growth
    assert 0 < found["delay_margin_s"] <= 0.05
    truth, names = of.plan.world.team, build.agent_names(of.settings)
    assert len(names) == sum(truth.sizes)
    assert 0.01 < found["e_p_C1_m"] < 1


def test_the_command_writes_a_scenario_and_overwrites_none(
    tmp_path: Path, known: None, monkeypatch: pytest.MonkeyPatch
):
    made = light.write(tmp_path / "team.yaml")
    monkeypatch.setattr(tune, "numbers", lambda of: {
        "slowest_mode_1ps": of.growth, "slowest_mode_late_1ps": of.growth, "delay_margin_s": 0.01, "thrust_margin": 0.5,
        "e_p_C1_m": 0.1,
    })  # fmt: skip
    out = tmp_path / "tuned.yaml"
    said = CliRunner().invoke(app, ["tune", str(made), "--out", str(out), "--json"])
    assert said.exit_code == 0, said.stderr
    found = json.loads(said.stdout)
    assert found["after"]["slowest_mode_1ps"] < found["before"]["slowest_mode_1ps"] < 0
    assert scenario.load(out).control.K_p == tuple(found["control"]["K_p"])
    before = out.read_bytes()
    again = CliRunner().invoke(app, ["tune", str(made), "--out", str(out)])
    assert (again.exit_code, again.stderr.count("\n")) == (2, 1)
    assert "exists" in again.stderr
    assert out.read_bytes() == before
    assert CliRunner().invoke(app, ["tune", str(made), "--out", str(tmp_path / "x.txt")]).exit_code == 2
    shown = CliRunner().invoke(app, ["tune", str(made), "--out", str(tmp_path / "other.yaml")])
    assert "slowest mode, 1/s" in shown.stdout
