"""Gains by gradients of the sampled loop's modes: every mode is to die out soon, also where commands come late.

The loop to first order (`modes.monodromy`) has its eigenvalues, and these have derivatives with the gains; a linear
program within a trust region says which step makes the slowest faster. Nothing is flown.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import linprog

from colift import checkup, disturbance, modes, simulate, study
from colift.model import State
from colift.scenario import ScenarioError, Settings, build, parse, with_control
from colift.scenario import text as every_setting

GAINS = ("K_p", "K_v", "k_R", "k_omega", "agent_k_R", "agent_k_omega", "posture")
LATE = 0.004  # s, twice what `check` asks for; with commands that late, modes are to die out as fast
FARTHEST = math.log(4)  # of a gain from where it began
STEP = 1e-3  # of a gain's logarithm, for the derivative of a matrix that is known to some 1e-10
REGION, LEAST_REGION = 0.3, 0.03  # of logarithms: the first trust region, and the one at which the search ends
LOOPS = 80  # matrices at most, and as many for whoever is compared with
SLOWEST = 60  # eigenvalues that a step looks at


@dataclasses.dataclass(frozen=True)
class Loop:
    """What is known of a scenario's gains without a flight."""

    settings: Settings
    plan: simulate.Plan
    z: State
    x: modes.Carried
    M: np.ndarray

    @property
    def ticks(self) -> int:
        """How many ticks `LATE` is, rounded up."""
        return math.ceil(LATE * self.settings.control_Hz - 1e-9)

    def matrices(self, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The loop's derivative and the one with late commands, for a derivative M near this loop's."""
        return M, modes.delayed(self.x, M, self.ticks)

    @property
    def growth(self) -> float:
        """1/s, of the slowest mode of both, which is to be as negative as can be."""
        return max(math.log(np.abs(np.linalg.eigvals(A)).max()) for A in self.matrices(self.M)) / self.plan.dt


def loop(settings: Settings) -> Loop:
    """The loop of a scenario at its rest. Raises ScenarioError as `study.plan`, ValueError where it finds no rest."""
    plan = study.plan(settings, "C1")
    z = build.at_rest(settings, plan.world.team)
    return Loop(settings, plan, z, *modes.monodromy(plan, z))


def names(settings: Settings) -> tuple[str, ...]:
    """The gains that there are to choose: the posture's only where an agent has joints beyond need."""
    beyond = checkup.beyond_need(settings) and settings.control.posture > 0
    return GAINS if beyond else GAINS[:-1]


def scaled(settings: Settings, steps: np.ndarray) -> Settings:
    """Settings whose gains are `exp(steps)` times what they are, to three digits."""
    change: dict[str, Any] = {}
    for name, step in zip(names(settings), steps, strict=True):
        now = getattr(settings.control, name)
        new = [float(f"{math.exp(step) * each:.3g}") for each in np.atleast_1d(now)]
        change[name] = tuple(new) if np.ndim(now) else new[0]
    return settings.model_copy(update={"control": settings.control.model_copy(update=change)})


def tune(settings: Settings, progress: Callable[[str], None] = lambda _what: None) -> tuple[Loop, Loop, int]:
    """The loop as it is, the one with the gains that were found, and how many matrices that took.

    Sequential linear programs: least t with `Re lambda_i + (d Re lambda_i / d log g) s <= t` for the slowest modes, on
    time and late, `|s| <= region`; a step that helps is taken and widens the region, another narrows it. `K_p` is kept
    below what the start's error and `limits.thrust_margin` leave of the thrust. Raises as `loop`.
    """
    progress("its loop at rest")
    first = best = loop(settings)
    free = len(names(settings))
    low, high = np.full(free, -FARTHEST), np.full(free, FARTHEST)
    high[0] = min(high[0], _most_stiffness(first))
    at, region, used, slopes = np.zeros(free), REGION, 1, None
    while region > LEAST_REGION and used + free < LOOPS:
        if slopes is None:
            progress(f"slowest mode {best.growth:+.3g} 1/s, {used} of at most {LOOPS} loops looked at")
            slopes = _slopes(best)
            used += free
        step = _step(*slopes, np.maximum(low - at, -region), np.minimum(high - at, region))
        tried = None
        with contextlib.suppress(ValueError, ScenarioError):  # no rest with these
            tried = loop(scaled(settings, at + step))
        used += 1
        if tried is not None and tried.growth < best.growth - 0.005 * abs(best.growth):
            best, at, region, slopes = tried, at + step, min(1.5 * region, 1.0), None
        else:
            region /= 3
    return first, best, used


def _slopes(of: Loop) -> tuple[np.ndarray, np.ndarray]:
    """Rates of the slowest modes, 1/s, and their derivatives with the logarithms of the gains.

    `z' = w^H M' v` with the right and left vectors, `w^H v = 1`; M' by differences, at the rest of the loop as it is.
    """
    rates, slopes = [], []
    free = len(names(of.settings))
    moved = []
    for k in range(free):
        # not rounded: a step is shorter than the third digit
        control = {
            name: _times(getattr(of.settings.control, name), math.exp(STEP)) for name in (names(of.settings)[k],)
        }
        settings = of.settings.model_copy(update={"control": of.settings.control.model_copy(update=control)})
        moved.append(of.matrices(modes.derivative(study.plan(settings, "C1"), of.z, of.x)))
    for j, M in enumerate(of.matrices(of.M)):
        values, vectors = np.linalg.eig(M)
        left = np.linalg.inv(vectors)
        rate = np.log(np.maximum(np.abs(values), 1e-300)) / of.plan.dt
        for i in np.argsort(-rate)[:SLOWEST]:
            turned = [left[i] @ ((A[j] - M) @ vectors[:, i]) / STEP / values[i] for A in moved]
            rates.append(rate[i])
            slopes.append(np.real(turned) / of.plan.dt)
    return np.array(rates), np.array(slopes)


def _times(gain: Any, factor: float) -> Any:
    return tuple(factor * each for each in gain) if isinstance(gain, tuple) else factor * gain


def _step(rates: np.ndarray, slopes: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step within bounds after which, to first order, the slowest mode is fastest."""
    free = slopes.shape[1]
    sums = np.hstack([slopes, -np.ones((len(rates), 1))])
    bounds = [*zip(low, high, strict=True), (None, None)]
    found = linprog(np.r_[np.zeros(free), 1.0], A_ub=sums, b_ub=-rates, bounds=bounds)
    return found.x[:free] if found.success else np.zeros(free)


def _most_stiffness(of: Loop) -> float:
    """How much larger, as a logarithm, K_p may be: what the start's error asks for has to be left of the thrust."""
    error = float(np.linalg.norm(of.settings.start.position_error_m))
    plan = of.plan
    hover = build.hover(of.settings, plan.world.team, plan.pilot, plan.world.sources)
    have = np.concatenate([group.thrust_max for group in plan.world.team.groups])
    left = float(((1 - of.settings.limits.thrust_margin) * have / hover).min()) - 1
    asked = max(of.settings.control.K_p) * error / max(float(np.linalg.norm(of.settings.gravity_mps2)), 1e-9)
    return math.log(max(left / asked, 1.0)) if asked > 0 else FARTHEST


# What is said of it ---------------------------------------------------------------------------------------------------


def numbers(of: Loop) -> dict[str, float]:
    """Slowest mode, late modes, delay and thrust margins, and how far what is unknown holds a payload off under C1."""
    truth, nominal = of.plan.world.team, of.plan.pilot.team
    try:
        ticks = modes.delay_margin(of.x, of.M, round(checkup.DELAY_MOST * of.settings.control_Hz))
    except ValueError:
        ticks = -1
    hover = build.hover(of.settings, truth, of.plan.pilot, of.plan.world.sources)
    have = np.concatenate([group.thrust_max for group in truth.groups])
    f = disturbance.at_start(of.plan.world.sources, truth, of.z)
    total = lambda team: float(team.payload.mass + sum(group.mass.sum() for group in team.groups))  # noqa: E731
    force = np.asarray(f.payload.F) + sum(np.asarray(part.f_x).sum(0) for part in f.agents)
    force = force + (total(truth) - total(nominal)) * np.asarray(truth.gravity)
    on_time, late = (math.log(np.abs(np.linalg.eigvals(A)).max()) / of.plan.dt for A in of.matrices(of.M))
    return {
        "slowest_mode_1ps": on_time,
        "slowest_mode_late_1ps": late,
        "delay_margin_s": ticks * of.plan.dt,
        "thrust_margin": float((1 - hover / have).min()),
        "e_p_C1_m": float(np.linalg.norm(force / np.array(of.settings.control.K_p))) / total(nominal),
    }


def text(tuned: Settings, written: str | None, file: str) -> str:
    """The scenario with its gains for a file of that name: as it is `written`, comments kept, where that says the same.

    Otherwise, as where nothing is written or a setting was changed, with every setting.
    """
    if written is not None:
        with contextlib.suppress(ScenarioError):
            gains = {name: getattr(tuned.control, name) for name in names(tuned)}
            kept = with_control(written, gains)
            if parse(kept, file) == tuned:
                return kept
    return every_setting(tuned)


def lines(before: Loop, after: Loop, used: int) -> list[str]:
    """Both side by side, as a person reads them, then the gains."""
    old, new = numbers(before), numbers(after)
    said = [f"{'':44} {'before':>10} {'after':>10}"]
    for label, key, scale, spec in (
        ("slowest mode, 1/s", "slowest_mode_1ps", 1, "+.3g"),
        (f"the same, commands {1e3 * LATE:g} ms late, 1/s", "slowest_mode_late_1ps", 1, "+.3g"),
        ("delay margin, ms", "delay_margin_s", 1e3, ".3g"),
        ("thrust left at hover, %", "thrust_margin", 100, ".3g"),
        ("e_p under C1 by what is unknown, mm", "e_p_C1_m", 1e3, ".3g"),
    ):
        said.append(f"{label:44} {format(scale * old[key], spec):>10} {format(scale * new[key], spec):>10}")
    for name in names(before.settings):
        then, now = (getattr(each.settings.control, name) for each in (before, after))
        said.append(f"{'control.' + name:44} {_shown(then):>10} {_shown(now):>10}")
    return [*said, f"{used} loops looked at"]


def _shown(gain: Any) -> str:
    values = list(dict.fromkeys(gain)) if isinstance(gain, tuple) else [gain]
    return f"{values[0]:g}" if len(values) == 1 else "/".join(f"{x:g}" for x in gain)
