"""GPU benchmark, if JAX has a GPU: steps per second of the JAX back end for batches of 1 to 65 536 teams.

It uses the plant's functions under `jit`, `vmap` and `scan` without changes. A GPU requires JAX's CUDA plug-in (`pip
install "jax[cuda12]"`), which the lock files do not contain.
"""

from __future__ import annotations

from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import Outcome, plant, rounds

BATCHES = tuple(4**k for k in range(9))  # 1 to 65 536
STEPS = 50


def measure(device: jax.Device, batches: Iterable[int], steps: int, seconds: float) -> dict[str, float]:
    """Return steps times teams per second on a device, by batch size; every team has its own masses."""
    case = plant.supported_team(2)
    leaves, tree = jax.tree.flatten(case)
    run = jax.jit(
        jax.vmap(lambda *x: jax.tree.leaves(plant.rollout(steps)(*jax.tree.unflatten(tree, x), jnp.array(plant.DT))))
    )
    found, rng = {}, np.random.default_rng(0)
    for batch in batches:
        scale = rng.uniform(0.9, 1.1, (batch,))
        args = [
            jax.device_put(
                np.asarray(x)[None] * (scale.reshape(-1, *[1] * x.ndim) if heavy else np.ones((batch, *[1] * x.ndim))),
                device,
            )
            for x, heavy in zip(leaves, _masses(case), strict=True)
        ]
        end = run(*args)
        if not all(bool(jnp.isfinite(x).all()) for x in end):
            raise FloatingPointError(f"batch {batch} on {device}: the state is not finite")
        times = rounds({"JAX": (lambda args=args: jax.block_until_ready(run(*args)), steps * batch)}, seconds)["JAX"]
        found[str(batch)] = 1 / float(np.median(times))
        print(f"  {batch:>6} teams: {found[str(batch)]:>12,.0f} steps/s")
    return found


def _masses(case: plant.Case) -> list[bool]:
    """Return which leaves are masses and inertias of the agents; they are scaled together, so that bodies stay
    physical.
    """
    (group,) = case[0].agent_groups
    return [x is group.mass or x is group.inertia for x in jax.tree.leaves(case)]


def run(seconds: float) -> Outcome:
    """Measure on the first GPU."""
    gpus = [device for device in jax.devices() if device.platform == "gpu"]
    if not gpus:
        kinds = ", ".join(sorted({device.device_kind for device in jax.devices()}))
        return Outcome({}, omitted=(f"no GPU was found by JAX (devices: {kinds}): nothing was measured",))
    print(gpus[0].device_kind)
    return Outcome(
        {"device": gpus[0].device_kind, "steps_per_second": measure(gpus[0], BATCHES, STEPS, seconds / len(BATCHES))}
    )
