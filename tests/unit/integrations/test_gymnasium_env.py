"""The Gymnasium environments: both checkers, what is seen and asked for, ends and beginnings."""

from __future__ import annotations

import dataclasses
import inspect
import warnings
from pathlib import Path

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from colift.analysis import metrics
from colift.closed_loop import simulator, termination
from colift.integrations import gymnasium_env
from colift.integrations.gymnasium_env import TransportEnv, TransportVecEnv
from colift.onboard import interfaces
from tests.support import small_team as light

STEP = 0.02  # s
DURATION = 0.2


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    short = {"update_times_s": (0.1,), "start_s": 0.01, "end_s": 0.1}
    learning = light.SAMPLE.learning.model_copy(update=short)
    folder = tmp_path_factory.mktemp("scenario")
    return light.write(folder / "light.yaml", learning=learning, duration_s=DURATION)


@pytest.fixture(scope="module")
def alone(path: Path) -> TransportEnv:
    return TransportEnv(str(path), step_s=STEP)


@pytest.fixture(scope="module")
def many(path: Path) -> TransportVecEnv:
    return TransportVecEnv(3, str(path), step_s=STEP)


def test_gymnasium_finds_no_fault(alone: TransportEnv) -> None:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The environment .* is different from the unwrapped version")
        check_env(alone, skip_render_check=True)


def test_stable_baselines_3_finds_no_fault(alone: TransportEnv) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="PyTorch: gigabytes")
    checker.check_env(alone, skip_render_check=True)


def test_what_is_asked_for_is_added_to_the_desired_wrench(alone: TransportEnv) -> None:
    """Of two flights from one state under one noise, the first tick's `W_d` differs by the share of the limits."""
    task, action = alone.task, jnp.array([0.5, -1.0, 0.25, 1.0, 0.0, -0.3])
    alone.reset(seed=1)
    noise = task.setup.world.sample_noise(jax.random.key(0), task.frame_skip)

    def asked(wrench: jax.Array) -> np.ndarray:
        leader = dataclasses.replace(task.setup.controller.payload_controller, wrench=wrench)
        setup = dataclasses.replace(
            task.setup, controller=dataclasses.replace(task.setup.controller, payload_controller=leader)
        )
        return np.asarray(simulator.rollout(setup, alone._loop, noise, jnp.asarray(task.frame_skip))[1].W_d[0])

    most = np.array([2.0] * 3 + [0.2] * 3)
    np.testing.assert_allclose(asked(action * most) - asked(jnp.zeros(6)), np.asarray(action) * most, atol=1e-12)


def test_an_action_acts_and_is_cut_at_one(alone: TransportEnv) -> None:
    def flown(action: list[float]) -> np.ndarray:
        alone.reset(seed=2)
        return np.stack([alone.step(np.array(action, np.float32))[0] for _ in range(5)])

    pushed = flown([0, 0, 1, 0, 0, 0])
    at = list(gymnasium_env.BOUNDS).index("e_v") * 3 + 2
    assert pushed[-1, at] > flown([0, 0, 0, 0, 0, 0])[-1, at] + 0.005
    np.testing.assert_array_equal(flown([0, 0, 7, 0, 0, 0]), pushed)


def test_what_is_seen_is_the_pilot_s_not_the_truth(alone: TransportEnv) -> None:
    """It is a function of the control context, and differs from the truth by what the sensors do."""
    assert list(inspect.signature(gymnasium_env.observation).parameters) == ["context"]
    assert isinstance(alone.task.setup.controller.payload_controller, interfaces.PayloadController)
    alone.reset(seed=3)
    before = alone._loop
    seen, _, _, _, info = alone.step(np.zeros(6, np.float32))
    seed = jnp.array([alone._noise_seed, alone._steps - 1])
    setup, ticks = alone.task.setup, alone.task.frame_skip
    noise = setup.world.sample_noise(jax.random.fold_in(jax.random.key(seed[0]), seed[1]), ticks)
    rows = simulator.rollout(setup, before, noise, jnp.asarray(ticks))[1]
    off = np.abs(seen[:3] * gymnasium_env.BOUNDS["e_p"] - np.asarray(rows.e_p[-1]))
    assert (off > 0).all()
    assert off.max() < 0.01
    np.testing.assert_allclose(info["e_p_m"], metrics.rms_norm(np.asarray(rows.e_p)))


def test_the_reward_is_one_without_errors_and_half_at_the_stated(alone: TransportEnv) -> None:
    """The reward is one without errors and half at the stated ones."""
    step = lambda e_p, e_R: gymnasium_env.reward(jnp.asarray([e_p]), jnp.asarray([e_R]))  # noqa: E731
    zero = [0.0, 0.0, 0.0]
    assert float(step(zero, zero)[0]) == 1
    np.testing.assert_allclose(step([0.0, 0.03, 0.04], zero), 0.5)
    np.testing.assert_allclose(step(zero, [0.05, 0.0, 0.0]), 0.5)
    np.testing.assert_array_equal(step([np.nan, 0.0, 0.0], zero), 0.0)


def test_an_episode_is_truncated_after_the_scenario_s_duration(alone: TransportEnv) -> None:
    alone.reset(seed=4)
    ends = [alone.step(alone.action_space.sample())[2:4] for _ in range(9)]
    assert ends == [(False, False)] * 8 + [(False, True)]


def test_an_episode_ends_with_the_limit_that_was_met(path: Path) -> None:
    """Pushed away from the reference, the payload meets the limit of its distance; then nothing moves any more."""
    env = TransportEnv(
        str(path), overrides=["termination.max_position_error_m=0.21", "duration_s=1"], step_s=STEP, force_N=60.0
    )
    seen, info = env.reset(seed=5)
    assert info["cause"] == termination.TerminationCause.NONE
    away = np.concatenate([np.sign(seen[:3]), np.zeros(3)]).astype(np.float32)
    terminated = False
    while not terminated:
        seen, reward, terminated, truncated, info = env.step(away)
        assert not truncated
    assert info["cause"] == termination.TerminationCause.DISTANCE
    assert env.observation_space.contains(seen)
    again, reward, terminated, *_ = env.step(away)
    assert (reward, terminated) == (0, True)
    np.testing.assert_array_equal(again, seen)


def test_flights_side_by_side_are_those_flown_alone(alone: TransportEnv, many: TransportVecEnv) -> None:
    rng = np.random.default_rng(6)
    seen, _ = many.reset(seed=7)
    first, _ = alone.reset(seed=8)
    np.testing.assert_allclose(seen[1], first, atol=1e-6)
    for _ in range(5):
        actions = rng.uniform(-1, 1, (3, 6)).astype(np.float32)
        seen, rewards, *_ = many.step(actions)
        one, reward, *_ = alone.step(actions[1])
        np.testing.assert_allclose(seen[1], one, atol=1e-6)
        np.testing.assert_allclose(rewards[1], reward, atol=1e-9)
    assert np.abs(seen[0] - seen[1]).max() > 1e-4


def test_a_flight_that_is_over_begins_anew_in_the_next_step(many: TransportVecEnv) -> None:
    assert many.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.NEXT_STEP
    first, _ = many.reset(seed=9)
    actions = np.ones((3, 6), np.float32)
    while not (over := many.step(actions)[3]).any():
        pass
    assert over.all()
    seen, rewards, terminated, truncated, _ = many.step(actions)
    assert not (terminated | truncated).any()
    np.testing.assert_array_equal(rewards, 0)
    assert np.abs(seen - first).max() < 0.1  # as at a start, under another noise
    assert np.abs(seen - first).max() > 0
    assert (many.step(actions)[1] > 0).all()
    again, _ = many.reset(seed=9)
    np.testing.assert_array_equal(again, first)


def test_stable_baselines_3_sees_the_next_episode_s_beginning(many: TransportVecEnv) -> None:
    """Stable baselines 3 sees the next episode is beginning with an end."""
    pytest.importorskip("stable_baselines3", reason="PyTorch: gigabytes")
    from evidence import curve

    flights = curve.adapted(many)
    flights.seed(9)
    first, actions, over = flights.reset(), np.zeros((3, 6), np.float32), np.zeros(3, bool)
    np.testing.assert_array_equal(first, many.reset(seed=9)[0])
    while not over.any():
        seen, _, over, told = flights.step(actions)
    assert over.all()
    assert all(each["TimeLimit.truncated"] for each in told)
    assert np.abs(seen - first).max() < 0.1  # as at a start, under another noise
    assert np.abs(np.stack([each["terminal_observation"] for each in told]) - first).max() > 0.1
    _, rewards, over, _ = flights.step(actions)
    assert (rewards > 0).all()
    assert not over.any()


def test_gymnasium_makes_both(path: Path) -> None:
    name, given = "colift.integrations.gymnasium_env:colift/Transport-v0", {"scenario": str(path)}
    assert isinstance(gymnasium.make(name, **given).unwrapped, TransportEnv)
    assert isinstance(gymnasium.make_vec(name, 2, vectorization_mode="vector_entry_point", **given), TransportVecEnv)


@pytest.mark.parametrize(
    ("given", "answer"),
    [
        ({"step_s": 0.0005}, "step_s = 0.0005: must be a multiple of the control period, 0.002 s"),
        ({"step_s": 0.021}, "step_s = 0.021: must be a multiple"),
        ({"force_N": -1.0}, "force_N = -1: must be finite and not negative"),
        ({"moment_Nm": np.inf}, "moment_Nm = inf: must be finite"),
    ],
)
def test_what_cannot_be_is_refused(given: dict[str, float], answer: str, path: Path) -> None:
    with pytest.raises(ValueError, match=answer):
        TransportEnv(str(path), **given)


def test_a_case_that_learns_on_the_way_is_refused(path: Path) -> None:
    with pytest.raises(ValueError, match="case 'C3' updates its models during a flight"):
        TransportEnv(str(path), case="C3")


def test_seeds_must_be_as_many_as_flights(many: TransportVecEnv) -> None:
    with pytest.raises(ValueError, match="seed: 2 seeds for 3 simulations"):
        many.reset(seed=[1, 2])
