"""User-defined disturbance with time and state: a gust with a first-order lag on a plate that three vehicles carry.

A disturbance is a `colift.math.pytree.pytree` that extends `colift.simulation.disturbances.DisturbanceModel`. A
`PayloadDisturbance` attaches it to a point of the payload. In a scenario file it is an entry of `disturbances` of the
kind `plugin`. Run it with `python examples/03_own_disturbance.py`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import colift
from colift.math.pytree import pytree
from colift.simulation import disturbances

Scalar = Float[Array, ""]
PLATE = Path(__file__).with_name("plate.yaml")


@pytree
class LaggedGust(disturbances.DisturbanceModel):
    """Drag in a sinusoidal wind with a first-order lag: `w' = (gust sin t - w) / lag`, `F = drag (w - v)`."""

    gust: Float[Array, "3"]  # m/s, world frame
    lag: Scalar  # s
    drag: Scalar  # N s/m
    time_invariant: ClassVar[bool] = False  # certificates name it

    def __call__(self, at: disturbances.PointKinematics, t: Scalar, state: Any) -> tuple[Any, Any]:
        """Return the drag force [N, world frame]; the torque is zero."""
        return self.drag * (state - at.v), jnp.zeros(3)

    def init(self) -> Any:
        return jnp.zeros(3)

    def update(self, at: disturbances.PointKinematics, t: Scalar, state: Any, dt: Scalar) -> Any:
        return state + dt / self.lag * (self.gust * jnp.sin(t) - state)


def with_disturbance(experiment: colift.Experiment, model: disturbances.DisturbanceModel) -> colift.Experiment:
    """Return the experiment with one more disturbance, at a point 10 cm ahead of the payload's center of mass."""
    world = experiment.world
    gust = disturbances.PayloadDisturbance(name="gust", model=model, point=jnp.array([0.1, 0.0, 0.0]))
    sources = dataclasses.replace(world.disturbances, payload=(*world.disturbances.payload, gust))
    return dataclasses.replace(experiment, world=dataclasses.replace(world, disturbances=sources))


def main() -> None:
    """Simulate two seconds without and with the gust, and print the differences of positions and residual forces."""
    experiment = colift.make_experiment(colift.load_scenario(PLATE), "C1")
    gust = LaggedGust(gust=jnp.array([6.0, 3.0, 0.0]), lag=jnp.array(0.5), drag=jnp.array(0.4))
    calm, windy = (
        colift.run_experiment(each, duration=2.0).records for each in (experiment, with_disturbance(experiment, gust))
    )
    force = np.linalg.norm((windy.f_L - calm.f_L)[:, :3], axis=1).max()
    distance = 1e3 * np.linalg.norm(windy.p[-1] - calm.p[-1])
    print(f"position difference {distance:.0f} mm after {windy.t[-1]:.1f} s")
    print(f"largest difference of the residual force {force:.2f} N")


if __name__ == "__main__":
    main()
