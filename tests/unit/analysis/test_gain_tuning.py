"""Tests of gain tuning: search on known matrices, cost of simulations, and the written scenario."""

from __future__ import annotations

import dataclasses
import functools
import json
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from colift import scenario
from colift.analysis import gain_tuning, stability
from colift.cli import scenario as scenario_commands
from colift.cli.app import app
from colift.closed_loop import flight as flight_module
from colift.runtime import signals
from colift.scenario import team, template
from tests.support import small_team as light

DT = 0.002
FREE, SECOND = 2, np.array([False, True])


@dataclasses.dataclass(frozen=True)
class Spring:
    """`s^2 + 2 d w s + w^2`, sampled; steps are those of log w and log d from w = 2 and d = 0.25."""

    steps: np.ndarray

    @property
    def M(self) -> np.ndarray:
        w, d = np.array([2, 0.25]) * np.exp(self.steps)
        return expm(DT * np.array([[0.0, 1.0], [-w * w, -2 * d * w]]))

    @property
    def cost(self) -> float:
        return float(np.log(np.abs(np.linalg.eigvals(self.M)).max()) / DT)


def slopes(of: Spring) -> gain_tuning.ValuesAndGradients:
    return gain_tuning.growth_rates(
        of.M, [Spring(of.steps + gain_tuning.DIFFERENCE_STEP * e).M for e in np.eye(FREE)], DT
    )


def test_rate_gradients_equal_finite_differences():
    rates, found = slopes(Spring(np.zeros(FREE)))
    np.testing.assert_allclose(rates, -0.5, atol=1e-9)  # Re = -d w
    np.testing.assert_allclose(found, [[-0.5, -0.5]] * 2, atol=1e-3)
    of = Spring(np.array([0.0, 2.0]))  # two real poles
    rates, found = slopes(of)
    for k, e in enumerate(1e-4 * np.eye(FREE)):
        ahead, behind = (slopes(Spring(of.steps + s * e))[0] for s in (1, -1))
        np.testing.assert_allclose(found[:, k], (ahead - behind) / 2e-4, rtol=5e-3, atol=1e-2)


def test_search_finds_fastest_decay_within_budget():
    """The slower pole is fastest, at -w, for a double pole: d = 1 and the largest w."""
    low, high = np.full(FREE, -2.0), np.array([1.0, 3.0])
    first = Spring(np.zeros(FREE))
    best, where, used = gain_tuning.minimize(
        first, Spring, slopes, np.zeros(FREE), (low, high), SECOND, gain_tuning.MAX_LINEARIZATIONS
    )
    assert first.cost == pytest.approx(-0.5, abs=1e-9)
    assert best.cost == pytest.approx(-2 * np.e, rel=0.1)
    assert best.steps[0] == pytest.approx(1.0)
    np.testing.assert_array_equal(where, best.steps)
    assert used <= gain_tuning.MAX_LINEARIZATIONS


def test_step_is_shortened_where_linearization_fails():
    low, high = np.full(FREE, -2.0), np.full(FREE, 2.0)
    near = lambda at: Spring(at) if at[1] < 0.4 else None  # noqa: E731
    best, _, used = gain_tuning.minimize(
        Spring(np.zeros(FREE)), near, slopes, np.zeros(FREE), (low, high), SECOND, gain_tuning.MAX_LINEARIZATIONS
    )
    assert 0.29 < best.steps[1] < 0.4
    assert used <= gain_tuning.MAX_LINEARIZATIONS


def test_optimal_loop_is_unchanged():
    none = np.zeros(FREE)
    first = Spring(none)
    best, _, _ = gain_tuning.minimize(first, Spring, slopes, none, (none, none), SECOND, gain_tuning.MAX_LINEARIZATIONS)
    assert best is first


@pytest.mark.long
def test_cost_includes_delayed_commands(monkeypatch: pytest.MonkeyPatch):
    of = light_design()
    late = np.eye(6) * np.exp(0.5 * of.experiment.dt)
    assert of.cost < 0
    monkeypatch.setattr(stability, "with_input_delay", lambda _x, _M, _ticks: late)
    assert of.cost == pytest.approx(0.5)
    assert of.delay_ticks == 2


def test_posture_is_tuned_only_for_redundant_arms():
    assert "posture_bandwidth" not in gain_tuning.tunable_gains(scenario.load_scenario("paper"))
    assert "posture_bandwidth" in gain_tuning.tunable_gains(scenario.load_scenario("beam"))
    assert gain_tuning.tunable_gains(light.settings()) == gain_tuning.GAINS[:-1]


def test_gains_are_scaled_and_written_with_three_digits():
    settings = light.settings(control=light.SAMPLE.control.model_copy(update={"K_p": (5.0, 5.0, 6.0)}))
    control = gain_tuning.scale_gains(settings, np.log([1.1111, 1, 1, 1, 2, 0.5])).control
    assert control.K_p == (6.17, 6.17, 7.41)
    assert control.K_v == (4.67, 4.67, 4.67)
    assert (control.agent_k_R, control.agent_k_omega) == (1000.0, 28.0)


def test_written_scenario_keeps_comments():
    written = template.scenario_template("mine", 3, 0)
    tuned = gain_tuning.scale_gains(scenario.parse(written, "mine.yaml"), np.full(6, 0.1))
    text = gain_tuning.to_yaml(tuned, written, "mine.yaml")
    assert "# Written by `colift init`." in text
    assert "K_p: 6.11" in text
    assert scenario.parse(text, "mine.yaml") == tuned
    other = tuned.model_copy(update={"seed": 7})  # as by --set: the text states another value
    assert scenario.parse(gain_tuning.to_yaml(other, written, "mine.yaml"), "mine.yaml") == other
    assert "#" not in gain_tuning.to_yaml(tuned, None, "mine.yaml")


def test_contact_error_follows_from_position_and_attitude():
    """Against exact contact errors for small angles, of which `e_R` is one to third order."""
    rng = np.random.default_rng(0)
    contacts, e_p = rng.normal(size=(5, 3)), 0.1 * rng.normal(size=(7, 3))
    R_d = Rotation.random(7, rng)
    R = R_d * Rotation.from_rotvec(1e-3 * rng.normal(size=(7, 3)))
    skew = (R_d.inv() * R).as_matrix() - (R.inv() * R_d).as_matrix()
    e_R = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) / 2
    off = [np.linalg.norm(e_p + R.apply(c) - R_d.apply(c), axis=1) for c in contacts]
    assert gain_tuning.contact_displacement_rms(e_p, e_R, R.as_matrix(), contacts) == pytest.approx(
        np.sqrt(np.mean(np.square(off))), rel=1e-5
    )


@pytest.mark.long
def test_flight_cost_decreases_as_its_gradient_predicts():
    of = gain_tuning.simulate_cost(light_design())
    assert isinstance(of, gain_tuning.FlightCost)
    assert of.cost == pytest.approx(of.error / -light_design().cost)
    costs, slopes = gain_tuning._flight_gradients(of)
    assert costs.max() >= of.cost * (1 - 1e-9)
    step = gain_tuning._linear_program_step(costs, slopes, np.full(6, -0.05), np.full(6, 0.05))
    nearer = gain_tuning.simulate_cost(gain_tuning.linearize_scenario(gain_tuning.scale_gains(of.loop.settings, step)))
    assert isinstance(nearer, gain_tuning.FlightCost)
    promised = of.cost - (costs + slopes @ step).max()
    assert promised > 0
    assert of.cost - nearer.cost == pytest.approx(promised, rel=0.3)


@pytest.mark.long
def test_unstable_or_failed_designs_have_no_cost(monkeypatch: pytest.MonkeyPatch):
    """Unstable designs are not simulated; terminated or saturated simulations have no cost."""
    of = light_design()
    flight = flight_module.run_experiment(of.experiment)
    for change, outcome in (
        ({"termination_reason": "limit exceeded"}, "lost"),
        (
            {
                "records": dataclasses.replace(
                    jax.tree.map(jnp.asarray, flight.records),
                    thrust_saturated=jnp.ones_like(flight.records.thrust_saturated),
                )
            },
            "saturated",
        ),
    ):
        monkeypatch.setattr(gain_tuning, "run_experiment", lambda _plan, c=change: dataclasses.replace(flight, **c))
        assert gain_tuning.simulate_cost(of) == outcome
    known_cost = gain_tuning.FlightCost(of, 0.1)
    monkeypatch.setattr(
        gain_tuning, "run_experiment", lambda _plan: dataclasses.replace(flight, termination_reason="near it")
    )
    rates, slopes = gain_tuning._mode_gradients(of)
    np.testing.assert_allclose(gain_tuning._flight_gradients(known_cost)[1], (0.1 / rates**2)[:, None] * slopes)
    monkeypatch.setattr(gain_tuning, "run_experiment", lambda _plan: pytest.fail("flown"))
    grows = dataclasses.replace(of, step_jacobian=np.eye(len(of.step_jacobian)) * 1.01)
    assert gain_tuning.simulate_cost(grows) == "grows"
    assert gain_tuning.summary_values(grows)["contact_displacement_C1_m"] == "grows"


class Fake(gain_tuning.LoopDesign):
    """Loop whose decay rate is K_v."""

    @property
    def cost(self) -> float:
        return -float(self.settings.control.K_v[0])


def test_tune_simulates_from_the_better_start(monkeypatch: pytest.MonkeyPatch):
    """The error decreases with K_p.

    If the fastest design of stage one fails in simulation, stage two starts from the first.
    """
    settings, known_cost = (
        light.settings(),
        {field.name: getattr(light_design(), field.name) for field in dataclasses.fields(gain_tuning.LoopDesign)},
    )
    fake = lambda to: Fake(**known_cost | {"settings": to})  # noqa: E731
    K = lambda of: (float(of.settings.control.K_p[0]), float(of.settings.control.K_v[0]))  # noqa: E731

    def slopes(of: Any) -> gain_tuning.ValuesAndGradients:
        rate = gain_tuning.TUNED_GAINS[1, :6]
        return np.array([of.cost]), (of.cost * rate)[None]

    def flown_slopes(of: gain_tuning.FlightCost) -> gain_tuning.ValuesAndGradients:
        return np.array([of.cost]), (of.cost * -(gain_tuning.TUNED_GAINS[0, :6] + gain_tuning.TUNED_GAINS[1, :6]))[None]

    monkeypatch.setattr(gain_tuning, "linearize_scenario", fake)
    monkeypatch.setattr(gain_tuning, "_max_frequency_ratio", lambda _of: gain_tuning.MAX_GAIN_RATIO)
    monkeypatch.setattr(gain_tuning, "_mode_gradients", slopes)
    monkeypatch.setattr(gain_tuning, "_flight_gradients", flown_slopes)
    for lost_above in (np.inf, 1.2 * settings.control.K_v[0]):
        flies = lambda of, most=lost_above: gain_tuning.FlightCost(of, 1 / K(of)[0]) if K(of)[1] <= most else "lost"  # noqa: E731
        monkeypatch.setattr(gain_tuning, "simulate_cost", flies)
        first, best, spent = gain_tuning.tune(settings)
        assert first.settings == settings
        start, end = flies(first), flies(best)
        assert isinstance(start, gain_tuning.FlightCost)
        assert isinstance(end, gain_tuning.FlightCost)
        assert end.cost < start.cost
        assert 2 < spent.simulations <= gain_tuning.MAX_SIMULATIONS
        assert spent.simulations < spent.linearizations <= gain_tuning.MAX_LINEARIZATIONS + gain_tuning.MAX_SIMULATIONS
    monkeypatch.setattr(gain_tuning, "simulate_cost", lambda _of: "lost")
    _, best, spent = gain_tuning.tune(settings)
    assert best.cost == pytest.approx(-4 * settings.control.K_v[0], rel=0.01)
    assert spent.simulations == 2


def test_posture_bound_depends_on_stability(monkeypatch: pytest.MonkeyPatch):
    """For a stable redundant team the stated posture bandwidth is the upper bound, since a larger one is missed by
    more.
    """
    monkeypatch.setattr(gain_tuning, "_max_frequency_ratio", lambda _of: 0.5)
    known_cost = {
        field.name: getattr(light_design(), field.name) for field in dataclasses.fields(gain_tuning.LoopDesign)
    }

    class At(gain_tuning.LoopDesign):
        cost = -1.0

    class Growing(gain_tuning.LoopDesign):
        cost = 1.0

    for name, kind, most in (("beam", At, 0.0), ("beam", Growing, gain_tuning.MAX_GAIN_RATIO), ("trio", At, None)):
        low, high = gain_tuning.search_bounds(kind(**known_cost | {"settings": scenario.load_scenario(name)}))
        assert (low == -gain_tuning.MAX_GAIN_RATIO).all()
        assert high[0] == 0.5
        assert (high[1:6] == gain_tuning.MAX_GAIN_RATIO).all()
        assert high[6:].tolist() == ([] if most is None else [most])


def test_search_never_exceeds_its_budget():
    """Steps with random costs, for several budgets."""
    rng = np.random.default_rng(0)

    @dataclasses.dataclass(frozen=True)
    class Chance:
        cost: float

    for most in range(4, 40):
        at = lambda _steps: Chance(rng.normal())  # noqa: E731
        known_cost = lambda _of: (np.zeros(1), rng.normal(size=(1, 2)))  # noqa: E731
        bounds = (-np.ones(2), np.ones(2))
        _, _, used = gain_tuning.minimize(
            Chance(0.0), at, known_cost, np.zeros(2), bounds, np.array([False, True]), most
        )
        assert used <= most


@functools.cache
def light_design() -> gain_tuning.LoopDesign:
    return gain_tuning.linearize_scenario(light.settings())


@pytest.mark.long
def test_stiffness_is_limited_by_thrust():
    of = light_design()
    assert of.cost < 0
    near = of.settings.model_copy(
        update={"initial_state": of.settings.initial_state.model_copy(update={"position_error_m": (0, 0, 0)})}
    )
    assert gain_tuning._max_frequency_ratio(dataclasses.replace(of, settings=near)) == gain_tuning.MAX_GAIN_RATIO
    wide = of.settings.termination.model_copy(update={"max_position_error_m": 10.0})
    start = of.settings.initial_state.model_copy(update={"position_error_m": (9, 0, 0)})
    far = of.settings.model_copy(update={"initial_state": start, "termination": wide})
    assert gain_tuning._max_frequency_ratio(dataclasses.replace(of, settings=far)) == 0


@pytest.mark.long
def test_gradients_of_a_real_loop_predict_its_decay_rate():
    """The decay rate after a short step, as predicted by the gradients and as linearized again."""
    of = light_design()
    rates, slopes = gain_tuning._mode_gradients(of)
    step = gain_tuning._linear_program_step(rates, slopes, np.full(6, -0.05), np.full(6, 0.05))
    assert gain_tuning.linearize_scenario(gain_tuning.scale_gains(of.settings, step)).cost < of.cost
    found = gain_tuning.summary_values(of)
    assert found["slowest_mode_1ps"] <= of.cost
    assert 0 < found["delay_margin_s"] <= 0.05
    truth, names = of.experiment.world.team, team.agent_names(of.settings)
    assert len(names) == sum(truth.sizes)
    assert 0.01 < found["static_e_p_C1_m"] < 1


def test_command_writes_scenario_without_overwriting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made = light.write(tmp_path / "team.yaml")
    monkeypatch.setattr(gain_tuning, "simulate_cost", lambda of: gain_tuning.FlightCost(of, 0.1))
    after = dataclasses.replace(
        light_design(), settings=gain_tuning.scale_gains(light_design().settings, np.full(6, 0.1))
    )
    monkeypatch.setattr(
        gain_tuning,
        "tune",
        lambda _settings, _say, _better: (light_design(), after, gain_tuning.EvaluationBudget(9, 2)),
    )
    out = tmp_path / "tuned.yaml"
    outcome = CliRunner().invoke(app, ["tune", str(made), "--out", str(out), "--json"])
    assert outcome.exit_code == 0, outcome.stderr
    found = json.loads(outcome.stdout)
    assert found["after"]["static_e_p_C1_m"] == pytest.approx(
        found["before"]["static_e_p_C1_m"] / np.exp(0.2), rel=1e-2
    )
    assert scenario.load_scenario(out) == after.settings
    before = out.read_bytes()
    again = CliRunner().invoke(app, ["tune", str(made), "--out", str(out)])
    assert (again.exit_code, again.stderr.count("\n")) == (2, 1)
    assert "exists" in again.stderr
    assert out.read_bytes() == before
    assert CliRunner().invoke(app, ["tune", str(made), "--out", str(tmp_path / "x.txt")]).exit_code == 2
    shown = CliRunner().invoke(app, ["tune", str(made), "--out", str(tmp_path / "other.yaml")])
    assert "slowest mode, 1/s" in shown.stdout
    assert shown.stdout.splitlines()[-1] == f"sample with these gains is in {tmp_path / 'other.yaml'}"


def test_interrupted_command_writes_best_gains_so_far(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made, out = light.write(tmp_path / "team.yaml"), tmp_path / "tuned.yaml"
    best = dataclasses.replace(
        light_design(), settings=gain_tuning.scale_gains(light_design().settings, np.full(6, 0.1))
    )

    def ended(
        _settings: object,
        _say: object,
        better: Callable[[gain_tuning.LoopDesign], None],
        found: Sequence[gain_tuning.LoopDesign],
    ) -> None:
        for each in found:
            better(each)
        raise signals.Interrupted

    for found, expected in (((), light.settings()), ((light_design(), best), best.settings)):
        out.unlink(missing_ok=True)
        monkeypatch.setattr(gain_tuning, "tune", functools.partial(ended, found=found))
        with pytest.raises(signals.Interrupted):
            CliRunner().invoke(app, ["tune", str(made), "--out", str(out)])
        assert out.read_text().startswith("# colift tune: the search is not complete")
        assert scenario.load_scenario(out) == expected
    nowhere = CliRunner().invoke(app, ["tune", str(made), "--out", str(tmp_path / "none" / "tuned.yaml")])
    assert (nowhere.exit_code, nowhere.stderr.count("\n")) == (2, 1)


def best_gains(tmp_path: Path) -> scenario_commands.BestGains:
    return scenario_commands.BestGains(light_design().settings, None, tmp_path / "tuned.yaml")


def improved(step: float) -> gain_tuning.LoopDesign:
    """The light design with other gains."""
    changed = gain_tuning.scale_gains(light_design().settings, np.full(6, step))
    return dataclasses.replace(light_design(), settings=changed)


def test_every_improvement_is_in_the_file(tmp_path: Path):
    """A process that is killed leaves the last improvement."""
    best = best_gains(tmp_path)
    for step in (0.1, 0.2):
        best.update(improved(step))
        assert scenario.load_scenario(best.out) == improved(step).settings
        assert best.out.read_text().startswith(scenario_commands.INCOMPLETE_SEARCH)
    best.save(complete=True)
    assert "not complete" not in best.out.read_text()
    assert [file.name for file in tmp_path.iterdir()] == ["tuned.yaml"]


def test_a_file_of_another_program_is_not_replaced(tmp_path: Path):
    best = best_gains(tmp_path)
    best.out.write_text("mine")
    with pytest.raises(FileExistsError, match="File exists"):
        best.update(improved(0.1))
    assert best.out.read_text() == "mine"


def test_forced_termination_writes_the_best_gains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The function that another thread calls writes after a signal only, and never after the end of the search."""
    best = best_gains(tmp_path)
    best.save_if_interrupted()
    assert not best.out.exists()
    monkeypatch.setattr(signals, "_received", [signal.SIGHUP])
    best.best = improved(0.1).settings
    best.save_if_interrupted()
    assert scenario.load_scenario(best.out) == improved(0.1).settings
    best.save(complete=True)
    before = best.out.read_text()
    best.save_if_interrupted()
    assert best.out.read_text() == before


HANGUP = """
import os, signal, sys, time
from pathlib import Path
from colift.cli.scenario import BestGains
from colift.runtime import signals
from tests.support import small_team
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored under nohup
signals.GRACE_PERIOD = 0.2
best = BestGains(small_team.settings(), None, Path(sys.argv[1]))
with signals.handle_signals(), signals.on_exit(best.save_if_interrupted):
    os.kill(os.getpid(), signal.SIGHUP)
    while True:  # no check point, as in the solver of a linearization
        time.sleep(0.01)
"""


def test_a_closed_terminal_leaves_the_best_gains(tmp_path: Path):
    out = tmp_path / "tuned.yaml"
    done = subprocess.run(
        [sys.executable, "-c", HANGUP, str(out)],
        cwd=Path(__file__).parents[3],  # of the module `tests`
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 128 + signal.SIGHUP, done.stderr
    assert out.read_text().startswith(scenario_commands.INCOMPLETE_SEARCH)
    assert scenario.load_scenario(out) == light.settings()


def test_search_reports_best_design_so_far():
    first, seen = Spring(np.zeros(FREE)), []
    bounds = np.full(FREE, -1.0), np.full(FREE, 1.0)
    best, *_ = gain_tuning.minimize(
        first, Spring, slopes, np.zeros(FREE), bounds, SECOND, 40, lambda of, _used: seen.append(of)
    )
    costs = [of.cost for of in seen]
    assert seen[0] is first
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] >= best.cost
