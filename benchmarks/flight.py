"""Control period with frozen residual models: native code and JAX's loop, many flights at once, larger teams.

The case is C3 of the paper's study: 24 posterior means at 256 points, sensors, filters, labels, control, plant, log.
The points are random, because they do not affect the time of a tick. Larger teams are those of `colift init` with two
arms per agent; each agent adds 9 means.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import colift
from benchmarks import Outcome, ratios, rounds
from colift import codegen, gp, scenario
from colift.closed_loop import simulator
from colift.scenario import Scenario, template

TICKS = 250  # half a second
FLIGHTS = 256
AGENTS = (2, 4, 8, 16)


def fill_posterior(model: gp.GPPosterior, rng: np.random.Generator) -> gp.GPPosterior:
    """Return a posterior at its capacity."""
    n = model.X.shape[-2]
    alpha = rng.normal(size=model.alpha.shape) * 1e-3
    return dataclasses.replace(
        model,
        X=jnp.asarray(rng.normal(size=model.X.shape)),
        alpha=jnp.asarray(alpha),
        num_points=jnp.full(model.num_points.shape, n),
    )


def prepare_flight(settings: Scenario) -> tuple[simulator.LoopConfig, simulator.LoopState, Any]:
    """Return C3 with full residual models at its initial state, and the noise of half a second."""
    case_experiment = colift.make_experiment(settings, "C3")
    rng, model = np.random.default_rng(0), case_experiment.controller.residual_model
    model = dataclasses.replace(
        model,
        payload=fill_posterior(model.payload, rng),
        agents=tuple(fill_posterior(group, rng) for group in model.agents),
    )
    setup = dataclasses.replace(
        case_experiment, controller=dataclasses.replace(case_experiment.controller, residual_model=model)
    ).loop_config
    return (
        setup,
        simulator.reset(setup, case_experiment.initial_state),
        case_experiment.world.sample_noise(jax.random.key(0), TICKS),
    )


def prepare_batch(setup: simulator.LoopConfig, loop: simulator.LoopState, noise: Any) -> Callable[[], object]:
    """Measure half a second of flights that differ in noise and residuals."""
    ticks, rng = jnp.asarray(TICKS), np.random.default_rng(1)
    shares = jnp.asarray(rng.uniform(0.5, 1.0, FLIGHTS))
    drawn = jax.tree.map(
        lambda x: jnp.asarray(np.asarray(x)[None] * rng.choice([-1.0, 1.0], (FLIGHTS,) + (1,) * x.ndim)), noise
    )

    def one(share: jax.Array, noise: Any) -> Any:
        world = dataclasses.replace(setup.world, disturbance_scale=share)
        return simulator._advance(dataclasses.replace(setup, world=world), loop, noise, ticks)[0]

    run = jax.jit(jax.vmap(codegen.compile(one, threads=1)))
    return lambda: jax.block_until_ready(run(shares, drawn))


def growth(seconds: float) -> tuple[dict[str, Any], dict[str, bool]]:
    """Return CPU time per step and agent for teams of N, ratios to N = 4, and the duration of compilation and one
    flight.
    """
    contenders, first = {}, {}
    for n in AGENTS:
        setup, loop, noise = prepare_flight(scenario.parse(template.scenario_template("team", n, 2), "team.yaml"))
        ticks, began = jnp.asarray(TICKS), time.perf_counter()
        end, _ = simulator.rollout(setup, loop, noise, ticks)
        first[n] = time.perf_counter() - began
        if int(end.tick) < TICKS:
            raise RuntimeError(f"N = {n}: the flight ended after {int(end.tick)} of {TICKS} ticks")
        fly = simulator.compile_rollout(setup, loop, noise, ticks)
        contenders[str(n)] = (lambda fly=fly, given=(setup, loop, noise, ticks): jax.block_until_ready(fly(*given)), n)
    times = rounds({n: (once, TICKS * agents) for n, (once, agents) in contenders.items()}, seconds, time.process_time)
    to_4, figures = ratios(times, "4"), {}
    for n, t in times.items():
        us = float(np.median(t)) * 1e6
        figures[n] = {"time_per_tick_and_agent_us": us, "ratio_to_4": to_4[n], "first_call_s": first[int(n)]}
        print(f"  N = {n:<3} {us:>8.3g} us a tick and agent {to_4[n]:>8.3g}x, first {first[int(n)]:>5.3g} s")
    worst = max(to_4, key=to_4.__getitem__)
    met = to_4[worst] <= 1.3
    return figures, {f"a tick and agent: at most {to_4[worst]:.2f}x of N = 4 (at N = {worst}), within 1.3x": met}


def run(seconds: float) -> Outcome:
    """Measure ratios to JAX's loop in the same run, real-time factor, and growth with the team."""
    setup, loop, noise = prepare_flight(colift.load_scenario("paper"))
    ticks, by_jax = jnp.asarray(TICKS), jax.jit(simulator._advance)
    contenders = {
        "native": (lambda: jax.block_until_ready(simulator.rollout(setup, loop, noise, ticks)), TICKS),
        "JAX": (lambda: jax.block_until_ready(by_jax(setup, loop, noise, ticks)), TICKS),
        f"{FLIGHTS} at once, native, one core": (prepare_batch(setup, loop, noise), TICKS * FLIGHTS),
    }
    times = rounds(contenders, seconds)
    to, dt = ratios(times, "native"), float(setup.dt)
    figures = {
        name: {
            "time_per_tick_us": float(np.median(t)) * 1e6,
            "ratio_to_native": to[name],
            "real_time_factor": dt / float(np.median(t)),
        }
        for name, t in times.items()
    }
    for name, one in figures.items():
        print(
            f"  {name:<34} {one['time_per_tick_us']:>8.4g} us a tick, {one['real_time_factor']:>6.3g} times real time"
        )
    grown, targets = growth(seconds)
    flight, batch = (
        figures["native"]["time_per_tick_us"] * 1e-6 * 20 / dt,
        list(figures.values())[-1]["real_time_factor"],
    )
    return Outcome(
        figures | {"agents": grown},
        {
            f"a flight of 20 s takes {flight:.2f} s, within 1.5 s": flight <= 1.5,
            f"{FLIGHTS} flights run at {batch:.1f} times real time on one core, at least 25": batch >= 25,
        }
        | targets,
    )
