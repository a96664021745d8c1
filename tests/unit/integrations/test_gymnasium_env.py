"""Tests of the Gymnasium environments: both checkers, observations, actions, ends and resets."""

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


def test_gymnasium_checker_passes(alone: TransportEnv) -> None:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The environment .* is different from the unwrapped version")
        check_env(alone, skip_render_check=True)


def test_stable_baselines_3_checker_passes(alone: TransportEnv) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="PyTorch: gigabytes")
    checker.check_env(alone, skip_render_check=True)


def test_action_is_added_to_the_desired_wrench(alone: TransportEnv) -> None:
    """For one state and one noise, the first `W_d` of two actions differs by the share of the action limits."""
    task, action = alone.task, jnp.array([0.5, -1.0, 0.25, 1.0, 0.0, -0.3])
    alone.reset(seed=1)
    noise = task.setup.world.sample_noise(jax.random.key(0), task.frame_skip)

    def with_action(wrench: jax.Array) -> np.ndarray:
        payload_controller = dataclasses.replace(task.setup.controller.payload_controller, wrench=wrench)
        setup = dataclasses.replace(
            task.setup, controller=dataclasses.replace(task.setup.controller, payload_controller=payload_controller)
        )
        return np.asarray(simulator.rollout(setup, alone._loop, noise, jnp.asarray(task.frame_skip))[1].W_d[0])

    most = np.array([2.0] * 3 + [0.2] * 3)
    np.testing.assert_allclose(
        with_action(action * most) - with_action(jnp.zeros(6)), np.asarray(action) * most, atol=1e-12
    )


def test_action_is_limited_to_one(alone: TransportEnv) -> None:
    def flight(action: list[float]) -> np.ndarray:
        alone.reset(seed=2)
        return np.stack([alone.step(np.array(action, np.float32))[0] for _ in range(5)])

    pushed = flight([0, 0, 1, 0, 0, 0])
    at = list(gymnasium_env.BOUNDS).index("e_v") * 3 + 2
    assert pushed[-1, at] > flight([0, 0, 0, 0, 0, 0])[-1, at] + 0.005
    np.testing.assert_array_equal(flight([0, 0, 7, 0, 0, 0]), pushed)


def test_observation_is_the_estimate(alone: TransportEnv) -> None:
    """The observation is a function of the control context and differs from the true state by sensor errors."""
    assert list(inspect.signature(gymnasium_env.observation).parameters) == ["context"]
    assert isinstance(alone.task.setup.controller.payload_controller, interfaces.PayloadController)
    alone.reset(seed=3)
    before = alone._loop
    observation, _, _, _, info = alone.step(np.zeros(6, np.float32))
    seed = jnp.array([alone._noise_seed, alone._steps - 1])
    setup, ticks = alone.task.setup, alone.task.frame_skip
    noise = setup.world.sample_noise(jax.random.fold_in(jax.random.key(seed[0]), seed[1]), ticks)
    rows = simulator.rollout(setup, before, noise, jnp.asarray(ticks))[1]
    off = np.abs(observation[:3] * gymnasium_env.BOUNDS["e_p"] - np.asarray(rows.e_p[-1]))
    assert (off > 0).all()
    assert off.max() < 0.01
    np.testing.assert_allclose(info["e_p_m"], metrics.rms_norm(np.asarray(rows.e_p)))


def test_reward_values(alone: TransportEnv) -> None:
    """The reward is one without errors and one half at the stated errors."""
    step = lambda e_p, e_R: gymnasium_env.reward(jnp.asarray([e_p]), jnp.asarray([e_R]))  # noqa: E731
    zero = [0.0, 0.0, 0.0]
    assert float(step(zero, zero)[0]) == 1
    np.testing.assert_allclose(step([0.0, 0.03, 0.04], zero), 0.5)
    np.testing.assert_allclose(step(zero, [0.05, 0.0, 0.0]), 0.5)
    np.testing.assert_array_equal(step([np.nan, 0.0, 0.0], zero), 0.0)


def test_episode_is_truncated_after_the_duration(alone: TransportEnv) -> None:
    alone.reset(seed=4)
    ends = [alone.step(alone.action_space.sample())[2:4] for _ in range(9)]
    assert ends == [(False, False)] * 8 + [(False, True)]


def test_episode_terminates_at_a_limit(path: Path) -> None:
    """A payload that is pushed away reaches the distance limit; afterwards the state is constant."""
    env = TransportEnv(
        str(path), overrides=["termination.max_position_error_m=0.21", "duration_s=1"], step_s=STEP, force_N=60.0
    )
    observation, info = env.reset(seed=5)
    assert info["cause"] == termination.TerminationCause.NONE
    away = np.concatenate([np.sign(observation[:3]), np.zeros(3)]).astype(np.float32)
    terminated = False
    while not terminated:
        observation, reward, terminated, truncated, info = env.step(away)
        assert not truncated
    assert info["cause"] == termination.TerminationCause.DISTANCE
    assert env.observation_space.contains(observation)
    again, reward, terminated, *_ = env.step(away)
    assert (reward, terminated) == (0, True)
    np.testing.assert_array_equal(again, observation)


def test_vectorized_flights_equal_single_flights(alone: TransportEnv, many: TransportVecEnv) -> None:
    rng = np.random.default_rng(6)
    observation, _ = many.reset(seed=7)
    first, _ = alone.reset(seed=8)
    np.testing.assert_allclose(observation[1], first, atol=1e-6)
    for _ in range(5):
        actions = rng.uniform(-1, 1, (3, 6)).astype(np.float32)
        observation, rewards, *_ = many.step(actions)
        one, reward, *_ = alone.step(actions[1])
        np.testing.assert_allclose(observation[1], one, atol=1e-6)
        np.testing.assert_allclose(rewards[1], reward, atol=1e-9)
    assert np.abs(observation[0] - observation[1]).max() > 1e-4


def test_finished_flight_is_reset_in_the_next_step(many: TransportVecEnv) -> None:
    assert many.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.NEXT_STEP
    first, _ = many.reset(seed=9)
    actions = np.ones((3, 6), np.float32)
    while not (done := many.step(actions)[3]).any():
        pass
    assert done.all()
    observation, rewards, terminated, truncated, _ = many.step(actions)
    assert not (terminated | truncated).any()
    np.testing.assert_array_equal(rewards, 0)
    assert np.abs(observation - first).max() < 0.2  # as at a reset, with another noise: 0.04 in the acceleration
    assert np.abs(observation - first).max() > 0
    assert (many.step(actions)[1] > 0).all()
    again, _ = many.reset(seed=9)
    np.testing.assert_array_equal(again, first)


def test_stable_baselines_3_gets_the_reset_observation(many: TransportVecEnv) -> None:
    """At the end of an episode stable-baselines3 receives the first observation of the next one."""
    pytest.importorskip("stable_baselines3", reason="PyTorch: gigabytes")
    from evidence import curve

    flights = curve.to_vec_env(many)
    flights.seed(9)
    first, actions, done = flights.reset(), np.zeros((3, 6), np.float32), np.zeros(3, bool)
    np.testing.assert_array_equal(first, many.reset(seed=9)[0])
    while not done.any():
        observation, _, done, infos = flights.step(actions)
    assert done.all()
    assert all(each["TimeLimit.truncated"] for each in infos)
    assert np.abs(observation - first).max() < 0.2  # as at a reset, with another noise: 0.04 in the acceleration
    assert np.abs(np.stack([each["terminal_observation"] for each in infos]) - first).max() > 0.1
    _, rewards, done, _ = flights.step(actions)
    assert (rewards > 0).all()
    assert not done.any()


def test_gymnasium_make_creates_both(path: Path) -> None:
    name, options = "colift.integrations.gymnasium_env:colift/Transport-v0", {"scenario": str(path)}
    assert isinstance(gymnasium.make(name, **options).unwrapped, TransportEnv)
    assert isinstance(gymnasium.make_vec(name, 2, vectorization_mode="vector_entry_point", **options), TransportVecEnv)


@pytest.mark.parametrize(
    ("options", "answer"),
    [
        ({"step_s": 0.0005}, "step_s = 0.0005: must be a multiple of the control period, 0.002 s"),
        ({"step_s": 0.021}, "step_s = 0.021: must be a multiple"),
        ({"force_N": -1.0}, "force_N = -1: must be finite and not negative"),
        ({"moment_Nm": np.inf}, "moment_Nm = inf: must be finite"),
    ],
)
def test_invalid_arguments_are_refused(options: dict[str, float], answer: str, path: Path) -> None:
    with pytest.raises(ValueError, match=answer):
        TransportEnv(str(path), **options)


def test_case_with_online_learning_is_refused(path: Path) -> None:
    with pytest.raises(ValueError, match="case 'C3' updates its models during a flight"):
        TransportEnv(str(path), case="C3")


def test_number_of_seeds_is_checked(many: TransportVecEnv) -> None:
    with pytest.raises(ValueError, match="seed: 2 seeds for 3 simulations"):
        many.reset(seed=[1, 2])
