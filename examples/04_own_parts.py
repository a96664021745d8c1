"""User-defined parts of a controller: payload controllers, an allocator and a sensor for three vehicles with a plate.

Each part is a `colift.math.pytree.pytree` with the methods of a protocol in `colift.onboard.interfaces`, or of
`colift.simulation.sensors.SensorModel`. The other parts stay as in the scenario. Run it with
`python examples/04_own_parts.py`: integral action and weighted contacts reduce the error and one contact's force.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import colift
from colift.math.pytree import pytree, static
from colift.models import grasp
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import ControlClock
from colift.onboard import interfaces
from colift.onboard.control import allocation, tracking
from colift.simulation import sensors

Scalar = Float[Array, ""]
PLATE = Path(__file__).with_name("plate.yaml")


@pytree
class AccelerationLimit:
    """Payload controller that limits the acceleration command of another one: `a = a_0 min(1, limit / |a_0|)`."""

    base: interfaces.PayloadController
    limit: Scalar  # m/s^2

    def init(self) -> Any:
        return self.base.init()

    def compute(self, state: Any, context: interfaces.ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        command, state = self.base.compute(state, context)
        norm = jnp.sqrt((command.a * command.a).sum() + 1e-12)
        return dataclasses.replace(command, a=command.a * jnp.minimum(1.0, self.limit / norm)), state


@pytree
class WeightedAllocator:
    """Weighted least-squares allocation of the wrench to the contacts, in the payload frame."""

    right_inverse: Float[Array, "rows 6"]

    def init(self) -> Any:
        return ()

    def allocate(
        self, state: Any, context: interfaces.ControlContext, demand: interfaces.AllocationDemand
    ) -> tuple[interfaces.ContactForceCommand, Any]:
        rows, no_eta = len(self.right_inverse), jnp.zeros(0)
        weighted = allocation.AllocationMap(
            right_inverse=self.right_inverse, nullspace=jnp.zeros((rows, 0)), offset=jnp.zeros(rows)
        )
        lam, lam_dot = (
            allocation.allocate(weighted, context.estimate.payload.R, wrench, no_eta)
            for wrench in (demand.W, demand.W_dot)
        )
        return interfaces.ContactForceCommand(lam=lam, lam_dot=lam_dot, eta=no_eta), state


def weighted_allocator(team: Team, weights: np.ndarray) -> WeightedAllocator:
    """Make an allocator with the right inverse `W^-1 G^T (G W^-1 G^T)^-1`; a larger weight reduces the force."""
    G = np.asarray(grasp.grasp_matrix(grasp.contact_points(team), jnp.eye(3)))
    inverse_weights = np.repeat(1 / weights, 3)
    right_inverse = inverse_weights[:, None] * G.T @ np.linalg.inv(G * inverse_weights @ G.T)
    return WeightedAllocator(right_inverse=jnp.asarray(right_inverse))


@pytree
class PositionIntegral:
    """Integral action on the position error, added to another payload controller: `a = a_0 - k_i int e_p dt`."""

    base: interfaces.PayloadController
    k_i: Scalar  # 1/s^3

    def init(self) -> Any:
        return jnp.zeros(3), self.base.init()

    def compute(self, state: Any, context: interfaces.ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        integral, base_state = state
        integral = integral + context.clock.dt * (context.estimate.payload.p - context.setpoint.p)
        command, base_state = self.base.compute(base_state, context)
        return dataclasses.replace(command, a=command.a - self.k_i * integral), (integral, base_state)


@pytree
class MeanPosition(sensors.SensorModel):
    """Positioning system that averages the last readings of the payload position: less noise, more delay."""

    readings: int = static(default=4)

    def init(self, m: Measurement) -> Any:
        return jnp.tile(m.payload.p, (self.readings, 1))

    def apply(
        self, m: Measurement, truth: sensors.SensedState, clock: ControlClock, state: Any, noise: Any
    ) -> tuple[Measurement, Any]:
        window = jnp.concatenate([state[1:], m.payload.p[None]])
        return dataclasses.replace(m, payload=dataclasses.replace(m.payload, p=window.mean(0))), window


def with_own_parts(experiment: colift.Experiment) -> colift.Experiment:
    """Return the experiment with the parts above."""
    controller, world = experiment.controller, experiment.world
    limited = AccelerationLimit(base=controller.payload_controller, limit=jnp.array(3.0))
    return dataclasses.replace(
        experiment,
        world=dataclasses.replace(world, sensor_models=(*world.sensor_models, MeanPosition())),
        controller=dataclasses.replace(
            controller,
            payload_controller=PositionIntegral(base=limited, k_i=jnp.array(2.0)),
            allocator=weighted_allocator(controller.team, np.array([1.0, 1.0, 4.0])),
        ),
    )


def main() -> None:
    """Simulate six seconds with the paper's parts and with these, and print error and lateral contact force."""
    experiment = colift.make_experiment(colift.load_scenario(PLATE), "C1")
    for each, title in ((experiment, "parts of the paper"), (with_own_parts(experiment), "own parts")):
        late = colift.run_experiment(each, duration=6.0).records
        half = len(late.t) // 2
        error = np.sqrt((late.e_p[half:] ** 2).sum(1).mean())
        lateral = np.linalg.norm(late.lam[half:, 2, :2], axis=1).mean()
        print(f"{title:>18}: RMS position error {1e3 * error:.0f} mm, lateral force of contact 3 {lateral:.2f} N")


if __name__ == "__main__":
    main()
