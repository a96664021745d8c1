"""Learning curve of a residual wrench without a model: PPO of Stable-Baselines3 in `TransportEnv`, five seeds.

The comparison has the same reward and the same part of the flight: no action (C1, the payload controller of the
scenario); integral action, also a residual wrench; the learned model (C3), which learns during the first half of each
flight. PPO and integral action change the payload's wrench only. C3 also learns the residuals of the agents, which
actions of the environment affect through the payload only. The environment checker of Stable-Baselines3 is an item too.

The algorithm, its rates and the number of its updates were chosen with seed 100, which is not among the five. `./dev
peers` installs Stable-Baselines3 (PyTorch); the stored result is judged without it.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop.flight import run_experiment
from colift.integrations.gymnasium_env import TransportEnv, TransportVecEnv, reward
from colift.scenario import experiment
from colift.visualization import style
from evidence import ROOT, collect

SEEDS = ("0", "1", "2", "3", "4")
CASES = ("C1", "integral", "C3")
SCENARIO = "paper"
SETTINGS = {"step_s": 0.1, "force_N": 4.0, "moment_Nm": 1.0}  # about twice the residual wrench in C1
NUM_PARALLEL = 8  # simulated in parallel
NUM_ROUNDS = 12  # 32 min of flight
EVALUATION_PERIOD = 2  # rounds between two evaluations
NUM_EVALUATIONS, FIRST_SEED = 2, 10_000  # flights of an evaluation, and the first one's seed
PPO = {
    "learning_rate": 1e-3,
    "n_steps": 50,
    "batch_size": 100,
    "gamma": 0.95,  # 2 s
    "gae_lambda": 0.9,
    "policy_kwargs": {"log_std_init": -0.7},
}
MISSING_MESSAGE = "curve: Stable-Baselines3 is not installed; `./dev peers` installs it (PyTorch: gigabytes)"


def compute(item: str) -> Any:
    """Return the warnings of the checker, the flights of a case, or the learning curve of a seed."""
    match item:
        case "checker":
            return checker_warnings()
        case "C1":
            return evaluate(evaluation_environment(), lambda _: np.zeros((NUM_EVALUATIONS, 6)))
    return simulate_case(item) if item in CASES else train(int(item))


def checker_warnings() -> list[str]:
    """Return the warnings of Stable-Baselines3's checker, which raises an exception for an error."""
    try:
        from stable_baselines3.common.env_checker import check_env
    except ModuleNotFoundError as error:
        raise SystemExit(MISSING_MESSAGE) from error
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(TransportEnv(SCENARIO, **SETTINGS), skip_render_check=True)
    return [str(each.message) for each in caught]


def simulate_case(case: str) -> dict[str, Any]:
    """Return the flights of a case without environment: return, RMS e_p over the second half [m], terminated
    flights.
    """
    returns, errors, terminated = [], [], 0
    for seed in range(FIRST_SEED, FIRST_SEED + NUM_EVALUATIONS):
        one = experiment.make_experiment(scenario.load_scenario(SCENARIO).model_copy(update={"seed": seed}), case)
        flight = run_experiment(one)
        ticks, rows = round(SETTINGS["step_s"] / one.dt), flight.records
        returns.append(float(np.asarray(reward(rows.e_p, rows.e_R))[ticks:].sum() / ticks))
        errors.append(metrics.rms_norm(metrics.second_half(rows).e_p))
        terminated += bool(flight.termination_reason)
    return {"return": returns, "e_p_rms_m": errors, "num_terminated": terminated}


def train(seed: int) -> list[dict[str, Any]]:
    """Return the evaluations of one learner before and during training."""
    try:
        import torch
        from stable_baselines3 import PPO as Learner
        from stable_baselines3.common.vec_env import VecNormalize
    except ModuleNotFoundError as error:
        raise SystemExit(MISSING_MESSAGE) from error
    torch.set_num_threads(1)
    normalized = VecNormalize(to_vec_env(TransportVecEnv(NUM_PARALLEL, SCENARIO, **SETTINGS)), gamma=PPO["gamma"])
    evaluation = evaluation_environment()
    model, found = Learner("MlpPolicy", normalized, seed=seed, device="cpu", **PPO), []

    def act(observed: np.ndarray) -> np.ndarray:
        return model.predict(normalized.normalize_obs(observed), deterministic=True)[0]

    for _ in range(0, NUM_ROUNDS, EVALUATION_PERIOD):
        model.learn(
            EVALUATION_PERIOD * NUM_PARALLEL * (evaluation.task.max_episode_steps - 1), reset_num_timesteps=False
        )
        found.append({"steps": model.num_timesteps, **evaluate(evaluation, act)})
        print(f"curve: seed {seed}: {found[-1]}", flush=True)
    return found


def to_vec_env(flights: TransportVecEnv) -> Any:
    """Convert flights to a `VecEnv` of Stable-Baselines3, which requires the next first observation at the end.

    Gymnasium returns it one step later, so that step is simulated at once if all flights end together, as they do here.
    If a flight terminates early, that step counts as one without reward.
    """
    from stable_baselines3.common.vec_env import VecEnv

    class Adapted(VecEnv):
        """See `to_vec_env`."""

        def reset(self) -> np.ndarray:
            return flights.reset(seed=self._seeds[0])[0]

        def step_async(self, actions: np.ndarray) -> None:
            self.actions = actions

        def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
            observations, rewards, ended, truncated_flags, _ = flights.step(self.actions)
            done = ended | truncated_flags
            infos = [
                {"terminal_observation": last, "TimeLimit.truncated": bool(truncated)} if end else {}
                for last, truncated, end in zip(observations, truncated_flags, done, strict=True)
            ]
            return flights.step(self.actions)[0] if done.all() else observations, rewards, done, infos

        def close(self) -> None: ...

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [getattr(flights, attr_name, None)] * self.num_envs

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise NotImplementedError

        def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
            raise NotImplementedError

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
            return [False] * self.num_envs

    return Adapted(flights.num_envs, flights.single_observation_space, flights.single_action_space)


def evaluation_environment() -> TransportVecEnv:
    """Return the flights of an evaluation."""
    return TransportVecEnv(NUM_EVALUATIONS, SCENARIO, **SETTINGS)


def evaluate(flights: TransportVecEnv, act: Any) -> dict[str, Any]:
    """Return the results of flights with the action function `act`, like `simulate_case`, with the environment's
    rewards.
    """
    observations, rewards, errors, terminated = (
        flights.reset(seed=FIRST_SEED)[0],
        [],
        [],
        np.zeros(flights.num_envs, bool),
    )
    for _ in range(flights.task.max_episode_steps - 1):
        observations, reward, ended, _, info = flights.step(act(observations))
        rewards.append(reward)
        errors.append(info["e_p_m"])
        terminated |= ended
    second_half = np.array(errors)[flights.task.max_episode_steps // 2 - 1 :]
    return {
        "return": np.sum(rewards, axis=0).tolist(),
        "e_p_rms_m": np.sqrt((second_half**2).mean(0)).tolist(),
        "num_terminated": int(terminated.sum()),
    }


def plot(found: dict[str, Any], path: Path) -> None:
    """Plot the learning curve: median and range of the seeds against flight time, cases as lines."""
    curves = [found[seed] for seed in SEEDS]
    minutes = [of["steps"] * SETTINGS["step_s"] / 60 for of in curves[0]]
    with style.style_context():
        figure = Figure(figsize=(style.PAGE_WIDTH, 2.4))
        kinds = (("e_p_rms_m", 1e3, r"$\|e_p\|$, RMS [mm]"), ("return", 1.0, "return [1]"))
        for ax, (kind, scale, label) in zip(figure.subplots(1, 2), kinds, strict=True):
            each = scale * np.array([[np.mean(of[kind]) for of in curve] for curve in curves])
            ax.fill_between(minutes, each.min(0), each.max(0), color="0.8", linewidth=0)
            ax.plot(minutes, np.median(each, axis=0), "ko-", clip_on=False, label="PPO, median and range of 5 seeds")
            for case in CASES:
                at, line_style = scale * np.mean(found[case][kind]), style.style_of(case)
                ax.axhline(at, color=line_style.color, linestyle=line_style.dashes)
                ax.annotate(NAMES[case], (minutes[-1], at), (5, 0), textcoords="offset points", va="center", fontsize=7)
            ax.set(xlabel="simulated training time [min]", ylabel=label, xlim=(0, minutes[-1]))
        figure.axes[0].set_yscale("log")
        figure.axes[0].yaxis.set_major_formatter("{x:g}")
        figure.axes[0].legend(loc=(0.02, 0.1))
        figure.savefig(path, dpi=200)


NAMES = {"C1": "no action (C1)", "integral": "integral action", "C3": "learned (C3)"}


def main() -> bool:
    """Print the table and plot the figure; every seed must reduce the error compared with no action."""
    found = collect("curve", ("C1", *SEEDS, "integral", "C3", "checker"), compute)
    print(f"Stable-Baselines3's checker: no fault; warnings: {found['checker'] or 'none'}")
    for case in CASES:
        print(f"{case:5} {summary_line([found[case]])}")
    for k, of in enumerate(found[SEEDS[0]]):
        print(f"PPO   {summary_line([found[seed][k] for seed in SEEDS])}; {of['steps']} steps")
    plot(found, ROOT / "docs" / "figures" / "curve.png")
    last, none = [found[seed][-1] for seed in SEEDS], min(found["C1"]["e_p_rms_m"])
    return all(max(of["e_p_rms_m"]) < none and not of["num_terminated"] for of in last)


def summary_line(found: list[dict[str, Any]]) -> str:
    """Format median, minimum and maximum of the seeds' means, and the number of terminated flights."""
    e, returns = ([float(np.mean(of[kind])) for of in found] for kind in ("e_p_rms_m", "return"))
    terminated = sum(of["num_terminated"] for of in found)
    return (
        f"e_p {1e3 * np.median(e):6.1f} mm ({1e3 * min(e):.1f} to {1e3 * max(e):.1f}), "
        f"return {np.median(returns):6.1f} ({min(returns):.1f} to {max(returns):.1f}), {terminated} terminated early"
    )


if __name__ == "__main__":
    main()
