"""Tests of the checks of the linearized loop: levels of modes, margins, and displacement by disturbances."""

from __future__ import annotations

import dataclasses
import functools
import json

import numpy as np
import pytest

from colift import scenario
from colift.analysis import loop_checks, remedies, stability
from colift.analysis.findings import Level
from colift.scenario import experiment, initial_states, schema
from tests.support import small_team as light

BUDGET = remedies.SearchBudget(1000)


def quiet(_what: str) -> None:
    """Discard a description of the progress."""


def two_modes(rate: float, joint: float, load: float) -> stability.Modes:
    """Two modes: the payload's at 2 1/s, and one at a given rate that moves a joint of `beam` and the payload."""
    joints = np.zeros((2, 12))
    joints[:, 4] = 0.1, joint
    payload = np.zeros((2, 6))
    payload[:, 3] = 1.0, load
    return stability.Modes(
        eigenvalues=np.array([-2.0, -rate + 1j]), payload=payload, attitude=np.zeros((2, 4, 3)), joints=joints
    )


def one_mode(value: complex, share: float = 1.0) -> stability.Modes:
    """A mode that moves the payload in yaw by a share of the largest amplitude."""
    payload = np.zeros((1, 6))
    payload[0, 2] = share
    none = np.zeros((1, 0))
    return stability.Modes(eigenvalues=np.array([value]), payload=payload, attitude=none.reshape(1, 0, 3), joints=none)


@functools.cache
def small_loop() -> tuple[experiment.flight.Experiment, loop_checks.LoopAnalysis]:
    """Experiment and loop of the smallest team, with a constant force on its payload."""
    force = schema.ConstantWrench(name="push", kind="constant", acts_on="payload", force_N=(0.0, 0.0, 1.0))
    c1 = experiment.make_experiment(light.settings(disturbances=(force,)), "C1")
    return c1, loop_checks.analyze_loop(c1, c1.initial_state)


# Modes ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("modes", "reasons"),
    [
        (one_mode(-0.905 + 3.24j), ()),  # the paper's team
        (one_mode(-0.344 + 2.46j), ()),  # plate
        (one_mode(-0.0164 + 0.565j), ("time constant of 61 s exceeds a third of the run", "damping 0.029")),
        (one_mode(-0.2 + 0.1j), ("decays by less than 0.3 1/s",)),
        (one_mode(-1 + 15j), ("damping 0.067",)),
        (one_mode(-1 + 15j, share=0.1), ()),  # the payload hardly moves
        (one_mode(-1 + 0j), ()),
    ],
)
def test_slow_and_hardly_damped_modes_are_weak(modes: stability.Modes, reasons: tuple[str, ...]):
    found = loop_checks.mode_weaknesses(modes, 24.0)
    assert len(found) == len(reasons)
    assert all(part in text for part, text in zip(reasons, found, strict=True))


def test_a_short_run_needs_a_fast_mode():
    assert loop_checks.mode_weaknesses(one_mode(-0.5 + 0j), 24.0) == ()
    (reason,) = loop_checks.mode_weaknesses(one_mode(-0.5 + 0j), 5.0)
    assert reason == "its time constant of 2 s exceeds a third of the run of 5 s"


@pytest.mark.parametrize(
    ("value", "level", "mode"), [(0.1 + 1j, "failed", ()), (-0.1 + 1j, "weak", ()), (-1, "passed", None)]
)
def test_level_of_the_slowest_mode(
    monkeypatch: pytest.MonkeyPatch, value: complex, level: str, mode: tuple[int] | None
):
    """Advice is searched for modes that are unstable or weak only."""
    searched = []
    monkeypatch.setattr(remedies, "stabilizing_changes", lambda *given: searched.append(given[5:]) or ("a gain",))
    loop = loop_checks.LoopAnalysis({}, np.eye(1), 0.002, one_mode(complex(value)), None)
    found = loop_checks.check_mode(light.settings(), loop, quiet, BUDGET)
    assert (found.level.value, bool(found.advice)) == (level, level != "passed")
    assert searched == ([] if mode is None else [mode])
    assert loop_checks.check_mode(light.settings(), loop, quiet, None).advice == ()
    json.dumps(found.values, allow_nan=False)


def test_advice_for_damping_ranks_gains_by_the_payload_mode(monkeypatch: pytest.MonkeyPatch):
    """The slowest mode is sound, and the second one is hardly damped."""
    searched = []
    monkeypatch.setattr(remedies, "stabilizing_changes", lambda *given: searched.append(given[5:]) or ("a gain",))
    modes = stability.Modes(
        eigenvalues=np.array([-1.0, -1.5 + 30j]),
        payload=np.eye(2, 6),
        attitude=np.zeros((2, 0, 3)),
        joints=np.eye(2, 0),
    )
    loop = loop_checks.LoopAnalysis({}, np.eye(1), 0.002, modes, None)
    assert loop_checks.check_mode(light.settings(), loop, quiet, BUDGET).level is Level.weak
    assert searched == [(1,)]


def test_slow_redundant_joints_are_weak_and_named(monkeypatch: pytest.MonkeyPatch):
    """Redundant joints that return too slowly are weak and are named."""
    beam = scenario.load_scenario("beam", ("control.posture_bandwidth=5",))
    monkeypatch.setattr(remedies, "posture_changes", lambda _settings, rate, joint, *_: (f"{rate} {joint}",))
    (slow,) = loop_checks.check_posture(beam, two_modes(2.4, 1.0, 0.1), quiet, BUDGET)
    assert (
        slow.message == "redundant joints converge at 2.4 1/s, slowest agent_2/shoulder; control.posture_bandwidth = 5"
    )
    assert (slow.level, slow.advice) == (Level.weak, ("2.4 agent_2/shoulder",))
    (fast,) = loop_checks.check_posture(beam, two_modes(2.6, 1.0, 0.1), quiet, BUDGET)
    assert (fast.level, fast.advice) == (Level.passed, ())
    assert not list(loop_checks.check_posture(beam, two_modes(0.1, 1.0, 1.0), quiet, BUDGET))  # the payload's mode
    assert not list(loop_checks.check_posture(scenario.load_scenario("paper"), two_modes(0.1, 1.0, 0.1), quiet, BUDGET))
    (held,) = loop_checks.check_posture(
        scenario.load_scenario("beam", ("control.posture_bandwidth=0",)), two_modes(2.6, 1.0, 0.1), quiet, BUDGET
    )
    assert held.level is Level.weak


# Margins --------------------------------------------------------------------------------------------------------------


def with_margins(delay: float, gain: tuple[float, float]) -> loop_checks.LoopAnalysis:
    _, loop = small_loop()
    return dataclasses.replace(loop, margins=stability.Margins(delay, gain, 0.05))


@pytest.mark.parametrize(
    ("delay", "gain", "levels"),
    [
        (0.02, (0.5, 1.6), ("passed", "passed")),
        (0.008, (0.5, 1.6), ("weak", "passed")),
        (0.001, (0.5, 1.6), ("failed", "passed")),
        (0.02, (0.75, 1.6), ("passed", "weak")),
        (0.02, (0.5, 1.2), ("passed", "weak")),
    ],
)
def test_levels_of_the_margins(delay: float, gain: tuple[float, float], levels: tuple[str, str]):
    found = list(loop_checks.check_margins(light.settings(), with_margins(delay, gain), quiet, None))
    assert [finding.subject for finding in found] == ["delay margin", "gain margin"]
    assert tuple(finding.level.value for finding in found) == levels


def test_unknown_margins_are_no_failure():
    """An unknown delay margin is reported and does not fail the check."""
    loop = loop_checks.LoopAnalysis({}, np.eye(1), 0.002, one_mode(-1), None, "no independent commands")
    (found,) = loop_checks.check_margins(light.settings(), loop, quiet, BUDGET)
    assert found.message == "not known: no independent commands"
    assert (found.level, found.advice, found.values) == (Level.passed, (), {"delay_margin_s": None})


@pytest.mark.long
@pytest.mark.parametrize(("gain", "ticks"), [(2.0, 0), (0.4, 0), (1.0, 8)])
def test_predicted_growth_is_that_of_the_changed_loop(gain: float, ticks: int):
    """To first order the growth of the varied loop follows a change of the gains by 1 %."""
    c1, loop = small_loop()
    varied = stability.vary_loop(loop.equilibrium, loop.step_jacobian, loop.dt, gain, ticks)
    settings = light.settings()
    control = settings.control.model_copy(update={"agent_k_omega": 1.01 * settings.control.agent_k_omega})
    changed = experiment.make_experiment(light.settings(control=control), "C1")
    z = initial_states.equilibrium_state(settings, c1.world.team)
    Mv = stability.directional_derivative(changed, z, loop.equilibrium, varied.right[: len(loop.step_jacobian)])
    M = stability.step_jacobian(changed, z, loop.equilibrium)
    exact = stability.vary_loop(loop.equilibrium, M, loop.dt, gain, ticks).growth
    assert abs(exact - varied.growth) > 1e-4
    assert varied.predict_growth(Mv) - varied.growth == pytest.approx(exact - varied.growth, rel=0.1)


@pytest.mark.long
def test_margin_advice_names_gains_that_lower_the_growth():
    _, loop = small_loop()
    varied = stability.vary_loop(loop.equilibrium, loop.step_jacobian, loop.dt, 3.0)
    (text,) = remedies.margin_changes(
        light.settings(), loop.equilibrium, {"3 times the commands": varied}, BUDGET
    ).values()
    assert text.startswith("--set control.")
    assert f"with 3 times the commands from {varied.growth:+.3g} to " in text


# Disturbances ---------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_displacement_is_force_over_stiffness():
    """A vertical force of 1 N displaces all bodies by `1 / (K_p (m_L + sum m))`, with the nominal payload mass."""
    c1, loop = small_loop()
    settings = light.settings()
    p, theta = stability.rest_displacement(c1, c1.initial_state, loop.equilibrium, loop.step_jacobian)
    masses = settings.nominal.payload.mass_kg + 3 * 1.5
    expected = 1 / (settings.control.K_p[2] * masses)
    np.testing.assert_allclose(p, [0, 0, expected], atol=0.02 * expected)
    np.testing.assert_allclose(theta, 0, atol=1e-3)
    found = loop_checks.check_disturbances(settings, c1, c1.initial_state, loop)
    assert found.message.startswith(f"at rest they move the payload by {1e3 * np.linalg.norm(p):.3g} mm and ")
    assert found.level is Level.passed


@pytest.mark.long
def test_displacement_beyond_the_termination_limit_is_weak():
    c1, loop = small_loop()
    limits = light.settings().termination.model_copy(update={"max_position_error_m": 0.01})
    settings = light.settings(termination=limits, initial_state=schema.InitialState())
    found = loop_checks.check_disturbances(settings, c1, c1.initial_state, loop)
    assert found.level is Level.weak
    assert found.advice[0].startswith("raise control.K_p; termination.max_position_error_m = 0.01")
