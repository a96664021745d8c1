"""An unknown force of your own, with time and memory: a squall on a plate that three vehicles carry.

A force is a `colift.math.pytree.pytree` of the methods of `colift.simulation.disturbances.Law`, and a `Mount` says where it attacks. In
a scenario file it is one of `disturbances`, of the kind `own`. Run it with `python examples/03_own_disturbance.py`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import colift
from colift.closed_loop import flight
from colift.math.pytree import pytree
from colift.simulation import disturbances

Scalar = Float[Array, ""]
PLATE = Path(__file__).with_name("plate.yaml")


@pytree
class Squall(disturbances.DisturbanceModel):
    """A wind that swells and sinks, and air that follows it with a lag: `w' = (gust sin t - w) / lag`."""

    gust: Float[Array, "3"]  # m/s, world frame
    lag: Scalar  # s
    drag: Scalar  # N s/m
    time_invariant: ClassVar[bool] = False  # every certificate of a flight under it says so

    def __call__(self, at: disturbances.PointKinematics, t: Scalar, memory: Any) -> tuple[Any, Any]:
        """Force, N, and torque, N m, both in the world frame, on a point that moves as `at` says."""
        return self.drag * (memory - at.v), jnp.zeros(3)

    def begin(self) -> Any:
        return jnp.zeros(3)

    def after(self, at: disturbances.PointKinematics, t: Scalar, memory: Any, dt: Scalar) -> Any:
        return memory + dt / self.lag * (self.gust * jnp.sin(t) - memory)


def blown(plan: flight.Experiment, law: disturbances.DisturbanceModel) -> flight.Experiment:
    """The plan with one more unknown force, 10 cm ahead of the payload's centre of mass."""
    world = plan.world
    mount = disturbances.PayloadDisturbance(name="squall", model=law, point=jnp.array([0.1, 0.0, 0.0]))
    sources = dataclasses.replace(world.disturbances, payload=(*world.disturbances.payload, mount))
    return dataclasses.replace(plan, world=dataclasses.replace(world, disturbances=sources))


def main() -> None:
    """Fly two seconds without and with it, and say how far apart the payloads end, and how hard it pushed."""
    plan = dataclasses.replace(colift.make_experiment(colift.load_scenario(PLATE), "C1"), duration=2.0)
    squall = Squall(gust=jnp.array([6.0, 3.0, 0.0]), lag=jnp.array(0.5), drag=jnp.array(0.4))
    calm, rough = (colift.run_experiment(of).records for of in (plan, blown(plan, squall)))
    pushed = np.linalg.norm((rough.f_L - calm.f_L)[:, :3], axis=1).max()
    print(f"{1e3 * np.linalg.norm(rough.p[-1] - calm.p[-1]):.0f} mm apart after {rough.t[-1]:.1f} s; ", end="")
    print(f"what is unknown differs by up to {pushed:.2f} N")


if __name__ == "__main__":
    main()
