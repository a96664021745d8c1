"""Control period with the allocation within limits, relative to least squares: native closed loop, and controller as C.

The team is `paper` (N = n = 2) in C1, and in C3 with full residual models. `below limits` has the thrust limits of the
scenario. `at limits` has limits of 95 % of the thrust in hover, so that the solver of the allocation iterates in every
control period. The C code is that of `colift export c`. It replays the first half second of the flight.
"""

from __future__ import annotations

import dataclasses
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import colift
from benchmarks import Outcome, microseconds, ratios, rounds
from benchmarks.flight import fill_posterior
from colift.closed_loop import simulator
from colift.closed_loop.flight import Experiment
from colift.codegen import build
from colift.integrations import c_export
from colift.scenario import termination
from evidence import limits

TICKS, REPEATS, C_ROUNDS = 250, 5, 9
LEVEL = 0.95
RATIO, C_US = 1.5, 100.0
BASE = "least squares"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Wno-psabi")


def experiments(case: str) -> dict[str, Experiment]:
    """Return the flights of a case: least squares, and the allocation within limits below and at its limits."""
    linear = colift.make_experiment(colift.load_scenario("paper"), case)
    limited = colift.make_experiment(colift.load_scenario("paper", overrides={"allocation.kind": "constrained"}), case)
    if case == "C3":
        linear, limited = (with_full_models(one) for one in (linear, limited))
    return {BASE: linear, "below limits": limited, "at limits": with_thrust_limits(limited)}


def with_full_models(given: Experiment) -> Experiment:
    """Return a flight whose residual models are at their capacity."""
    rng, model = np.random.default_rng(0), given.controller.residual_model
    model = dataclasses.replace(
        model,
        payload=fill_posterior(model.payload, rng),
        agents=tuple(fill_posterior(group, rng) for group in model.agents),
    )
    return dataclasses.replace(given, controller=dataclasses.replace(given.controller, residual_model=model))


def with_thrust_limits(given: Experiment) -> Experiment:
    """Return a flight whose thrusts are limited below the thrust in hover, in the plant and in the controller."""
    hover = termination.undisturbed_hover_thrust(given.world.team, given.controller, given.initial_state)
    return limits.with_limits(given, np.full_like(hover, LEVEL * hover.mean()))


def closed_loop(case: str, given: dict[str, Experiment], seconds: float) -> dict[str, dict[str, float]]:
    """Return the time of a control period of the closed loop, and its ratio to least squares."""
    contenders, ticks = {}, jnp.asarray(TICKS)
    for name, one in given.items():
        setup = one.loop_config
        data = (setup, simulator.reset(setup, one.initial_state), one.world.sample_noise(jax.random.key(0), TICKS))
        end, rows = simulator.rollout(*data, ticks)
        if int(end.tick) < TICKS:
            raise RuntimeError(f"{case}, {name}: the flight ended after {int(end.tick)} of {TICKS} control periods")
        if name == "at limits" and not np.asarray(rows.thrust_limited).any(1).all():
            raise RuntimeError(f"{case}: not all control periods are at a limit")
        contenders[name] = (lambda data=data: jax.block_until_ready(simulator.rollout(*data, ticks)), TICKS)
    times = rounds(contenders, seconds)
    us, to_base = microseconds(times), ratios(times, BASE)
    return {name: {"closed_loop_us": us[name], "closed_loop_ratio": to_base[name]} for name in given}


def as_c(case: str, given: dict[str, Experiment]) -> dict[str, dict[str, float]]:
    """Return the median CPU time of a control step as C, and its ratio to least squares, over alternating rounds."""
    command, *_ = build.require_compiler()
    with tempfile.TemporaryDirectory() as made:
        folders = {name: Path(made) / name.replace(" ", "_") for name in given}
        for name, folder in folders.items():
            c_export.export_c(given[name], given[name].controller.residual_model, TICKS, folder, f"paper, {case}")
            parts = [folder / f"{part}.c" for part in ("colift", "learned", "replay")]
            subprocess.run([command, *FLAGS, *parts, "-o", folder / "replay", "-lm"], check=True)
        rows = [{name: step_time_us(folder) for name, folder in folders.items()} for _ in range(C_ROUNDS)]
    times = {name: np.array([row[name] for row in rows]) for name in given}
    to_base = ratios(times, BASE)
    return {name: {"c_us": float(np.median(times[name])), "c_ratio": to_base[name]} for name in given}


def step_time_us(folder: Path) -> float:
    """Replay a flight by the C program of a folder, and return the median CPU time of a control step."""
    command = [folder / "replay", folder / "flight.bin", str(REPEATS)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(dict(line.split() for line in done.stdout.splitlines())["step_time_median_us"])


def run(seconds: float) -> Outcome:
    """Measure both cases; the target concerns the flights at limits."""
    figures: dict[str, Any] = {}
    targets = {}
    for case in ("C1", "C3"):
        given = experiments(case)
        loop, c = closed_loop(case, given, seconds), as_c(case, given)
        figures[case] = {name: loop[name] | c[name] for name in given}
        for name, one in figures[case].items():
            print(f"  {case}, {name:<14}" + "".join(f" {key} {value:>7.3g}" for key, value in one.items()))
        most = figures[case]["at limits"]
        targets |= {
            f"{case} at limits: {most['closed_loop_ratio']:.2f} times the control period of least squares, at most "
            f"{RATIO:g}": most["closed_loop_ratio"] <= RATIO,
            f"{case} at limits: control step of {most['c_us']:.3g} us as C, at most {C_US:g}": most["c_us"] <= C_US,
        }
    return Outcome(figures, targets)
