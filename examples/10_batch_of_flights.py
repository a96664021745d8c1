"""Many flights at once: the loop is a function of PyTrees, so a batch of them is `jax.vmap`, in native code as one is.

Eight flights of three vehicles with a plate, under none to twice the unknown forces. Run it with
`python examples/10_batch_of_flights.py`. Many seeds one after another are in docs/campaigns.md.
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
    """Fly the batch for two seconds, and print where each payload is."""
    plan = colift.make_experiment(colift.load_scenario(PLATE), "C1")
    setup, noise = plan.loop_config, plan.world.sample_noise(jax.random.key(0), TICKS)
    begun = simulator.reset(setup, plan.initial_state)

    def fly(
        setup: simulator.LoopConfig, begun: simulator.LoopState, noise: Any, share: jax.Array
    ) -> signals.StepRecord:
        """One flight under that share of all unknown forces."""
        blown = dataclasses.replace(setup, world=dataclasses.replace(setup.world, disturbance_scale=share))
        return jax.lax.scan(lambda loop, drawn: simulator.step(blown, loop, drawn), begun, noise)[1]

    shares = jnp.linspace(0.0, 2.0, FLIGHTS)
    rows = jax.jit(jax.vmap(codegen.compile(fly), in_axes=(None, None, None, 0)))(setup, begun, noise, shares)
    for share, p, p_d in zip(shares, rows.p[:, -1], rows.p_d[:, -1], strict=True):
        off = 1000 * np.linalg.norm(p - p_d)
        print(f"{share:4.0%} of the unknown forces: {off:6.1f} mm off after {float(rows.t[0, -1]):.2f} s")


if __name__ == "__main__":
    main()
