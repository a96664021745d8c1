"""What the environment teaches: a residual wrench learned by the cross-entropy method, against rivals without it.

The policy adds to the leader's wrench a constant and a share of each axis' own error and rate: 18 numbers. Of every
generation the policies fly side by side, each under a noise of its own; the mean of the best is then judged on noises
that no policy was chosen by.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from colift.environment import Transports
from evidence import collect

SEEDS = range(5)
GENERATIONS, FLIGHTS, BEST, JUDGED = 8, 16, 4, 4
SETTINGS = {"scenario": "paper", "step_s": 0.02, "force_N": 4.0, "moment_Nm": 0.5}
SHORT = ("duration_s=4", "learning.update_times_s=[2]", "learning.start_s=0.5", "learning.end_s=2")
RIVALS = {"C1": "no action", "I": "no action, integral action in the leader"}
SPREAD = 0.3  # of each number, at first


def act(theta: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """`constant + share error + share rate`, axis by axis: of the payload's position, and of its attitude."""
    constant, of_error, of_rate = np.moveaxis(theta.reshape(-1, 3, 6), 1, 0)
    error, rate = (np.concatenate([seen[:, k : k + 3], seen[:, k + 6 : k + 9]], axis=1) for k in (0, 3))
    return np.clip(constant + of_error * error + of_rate * rate, -1, 1).astype(np.float32)


def flown(env: Transports, theta: np.ndarray, seed: int) -> np.ndarray:
    """The mean reward of one episode of each flight; what has ended early earns nothing more."""
    seen, _ = env.reset(seed=seed)
    total, on = np.zeros(env.num_envs), np.ones(env.num_envs, bool)
    for _ in range(env.task.steps - 1):  # a reset has flown the first
        seen, rewards, ended, truncated, _ = env.step(act(theta, seen))
        total += on * rewards
        on &= ~(ended | truncated)
        if not on.any():
            break
    return total / (env.task.steps - 1)


def learn(seed: int) -> list[float]:
    """The judged reward before the first generation and after each."""
    rng = np.random.default_rng(seed)
    env, judge = (Transports(n, changes=SHORT, **SETTINGS) for n in (FLIGHTS, JUDGED))
    mean, spread = np.zeros(18), np.full(18, SPREAD)
    curve = [float(flown(judge, mean[None], HELD_OUT).mean())]
    for generation in range(GENERATIONS):
        theta = mean + spread * rng.normal(size=(FLIGHTS, 18))
        reward = flown(env, theta, 1000 * (1 + seed) + FLIGHTS * generation)
        best = theta[np.argsort(reward)[-BEST:]]
        mean, spread = best.mean(0), best.std(0) + 0.02
        curve.append(float(flown(judge, mean[None], HELD_OUT).mean()))
    return curve


HELD_OUT = 10**6  # the first of the seeds of noise on which policies are judged


def compute(item: str) -> Any:
    """A rival's judged reward, or the learning curve of a seed."""
    if item in RIVALS:
        return float(
            flown(Transports(JUDGED, case=item, changes=SHORT, **SETTINGS), np.zeros((1, 18)), HELD_OUT).mean()
        )
    return learn(int(item.removeprefix("seed ")))


def main() -> bool:
    """Every seed ends above no action."""
    items = [*RIVALS, *(f"seed {seed}" for seed in SEEDS)]
    found = collect("environment", items, compute)
    for rival, what in RIVALS.items():
        print(f"{rival:6} {what}: mean reward {found[rival]:.3f}")
    curves = np.array([found[item] for item in items[len(RIVALS) :]])
    for generation, (least, middle, most) in enumerate(np.quantile(curves, [0, 0.5, 1], axis=0).T):
        print(f"{generation:2} generations: {least:.3f} / {middle:.3f} / {most:.3f} (least, median, greatest seed)")
    return bool((curves[:, -1] > found["C1"]).all())


if __name__ == "__main__":
    main()
