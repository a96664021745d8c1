"""Batch of flights: the loop is a function of PyTrees, so `jax.vmap` simulates a batch, also in native code.

Eight flights of three vehicles with a plate have residual forces scaled by zero to two. docs/campaigns.md describes
series of seeds. Run it with `python examples/10_batch_of_flights.py`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import colift
from colift import codegen
from colift.closed_loop import signals, simulator

PLATE = Path(__file__).with_name("plate.yaml")
FLIGHTS, TICKS = 8, 1000


def main() -> None:
    """Simulate the batch for two seconds, and print the payload positions."""
    experiment = colift.make_experiment(colift.load_scenario(PLATE), "C1")
    setup, noise = experiment.loop_config, experiment.world.sample_noise(jax.random.key(0), TICKS)
    initial = simulator.reset(setup, experiment.initial_state)

    def simulate(
        setup: simulator.LoopConfig, initial: simulator.LoopState, noise: Any, share: jax.Array
    ) -> signals.StepRecord:
        """Simulate one flight with scaled residual forces."""
        scaled = dataclasses.replace(setup, world=dataclasses.replace(setup.world, disturbance_scale=share))
        return jax.lax.scan(lambda loop, drawn: simulator.step(scaled, loop, drawn), initial, noise)[1]

    shares = jnp.linspace(0.0, 2.0, FLIGHTS)
    rows = jax.jit(jax.vmap(codegen.compile(simulate), in_axes=(None, None, None, 0)))(setup, initial, noise, shares)
    for share, p, p_d in zip(shares, rows.p[:, -1], rows.p_d[:, -1], strict=True):
        distance = 1000 * np.linalg.norm(p - p_d)
        print(f"{share:4.0%} of the disturbances: position error {distance:6.1f} mm after {float(rows.t[0, -1]):.2f} s")


if __name__ == "__main__":
    main()
