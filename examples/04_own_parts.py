"""Parts of your own in a flight: a leader, an allocator, an estimator and a sensor for three vehicles with a plate.

Each is a `colift.math.pytree.pytree` with the methods of a class in `colift.fly` or `colift.simulation.sensors`; the rest of the flight
stays as the scenario says. Run it with `python examples/04_own_parts.py`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import colift
from colift.closed_loop import flight
from colift.math.pytree import pytree
from colift.models import grasp
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import AgentInput, ControlClock, Wrench
from colift.onboard import interfaces
from colift.onboard.control import allocation, tracking
from colift.onboard.estimation import state_estimator
from colift.simulation import sensors

Scalar = Float[Array, ""]
PLATE = Path(__file__).with_name("plate.yaml")


@pytree
class Gentle:
    """A leader that asks for no more than so much acceleration: `a = a_0 limit / max(limit, |a_0|)`."""

    leader: interfaces.PayloadController
    limit: Scalar  # m/s^2

    def begin(self) -> Any:
        return self.leader.init()

    def lead(self, memory: Any, now: interfaces.ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        to, memory = self.leader.compute(memory, now)
        size = jnp.sqrt((to.a * to.a).sum() + 1e-12)
        return dataclasses.replace(to, a=to.a * self.limit / jnp.maximum(size, self.limit)), memory


@pytree
class Weighted:
    """An allocator that spares some contacts: least squares with a weight for each, in the payload's frame."""

    inverse: Float[Array, "rows 6"]

    def allocate(self, now: interfaces.ControlContext, W: Wrench, W_dot: Wrench) -> interfaces.ContactForceCommand:
        none = jnp.zeros(0)
        plan = allocation.AllocationMap(
            right_inverse=self.inverse, nullspace=jnp.zeros((len(self.inverse), 0)), offset=jnp.zeros(len(self.inverse))
        )
        lam, lam_dot = (allocation.allocate(plan, now.estimate.payload.R, wrench, none) for wrench in (W, W_dot))
        return interfaces.ContactForceCommand(lam=lam, lam_dot=lam_dot, eta=none)


def weighted(team: Team, weights: np.ndarray) -> Weighted:
    """`W^-1 G^T (G W^-1 G^T)^-1`: a contact of weight 4 gives half of what one of weight 1 does, where it can."""
    G = np.asarray(grasp.grasp_matrix(grasp.contact_points(team), jnp.eye(3)))
    spared = np.repeat(1 / weights, 3)
    return Weighted(inverse=jnp.asarray(spared[:, None] * G.T @ np.linalg.inv(G * spared @ G.T)))


@pytree
class Trusting:
    """An estimator that takes pose and velocity of the payload as they are measured, and the rest as colift's."""

    estimator: interfaces.Estimator

    def begin(self, team: Team, first: Measurement) -> Any:
        return self.estimator.init(team, first)

    def observe(
        self, team: Team, memory: Any, m: Measurement, applied: tuple[AgentInput, ...], clock: ControlClock
    ) -> tuple[state_estimator.StateEstimate, Any]:
        q_hat, memory = self.estimator.update(team, memory, m, applied, clock)
        read = m.payload
        load = dataclasses.replace(q_hat.payload, p=read.p, v=read.v, R=read.R)
        return dataclasses.replace(q_hat, payload=load), memory


@pytree
class Slow(sensors.SensorModel):
    """A positioning system that reports the payload at every so many ticks, and holds its last report in between."""

    every: Scalar  # s

    def begin(self, m: Measurement) -> Any:
        return jnp.zeros(()), m.payload.p

    def read(
        self, m: Measurement, truth: sensors.SensedState, clock: ControlClock, memory: Any, noise: Any
    ) -> tuple[Measurement, Any]:
        last, p = memory
        due = clock.t - last >= self.every - 1e-9
        last, p = jnp.where(due, clock.t, last), jnp.where(due, m.payload.p, p)
        m = dataclasses.replace(m, payload=dataclasses.replace(m.payload, p=p), extra=m.extra | {"last_report_s": last})
        return m, (last, p)


def changed(plan: flight.Experiment) -> flight.Experiment:
    """The plan with every part above in its place."""
    pilot, world = plan.controller, plan.world
    return dataclasses.replace(
        plan,
        world=dataclasses.replace(world, sensor_models=(*world.sensor_models, Slow(every=jnp.array(0.02)))),
        controller=dataclasses.replace(
            pilot,
            payload_controller=Gentle(leader=pilot.payload_controller, limit=jnp.array(0.2)),
            allocator=weighted(pilot.team, np.array([1.0, 1.0, 4.0])),
            estimator=Trusting(estimator=pilot.estimator),
        ),
    )


def main() -> None:
    """Fly two seconds with the paper's parts and with these, and say how they differ."""
    plan = dataclasses.replace(colift.make_experiment(colift.load_scenario(PLATE), "C1"), duration=2.0)
    for of, what in ((plan, "the paper's parts"), (changed(plan), "parts of one's own")):
        rows = colift.run_experiment(of).records
        sideways = np.linalg.norm(rows.lam[-1, 2, :2])
        print(f"{what:>20}: {1e3 * np.linalg.norm(rows.e_p[-1]):.0f} mm off after {rows.t[-1]:.1f} s, ", end="")
        print(f"the third contact is pushed sideways with {sideways:.2f} N")


if __name__ == "__main__":
    main()
