"""Short flights of the paper's study, and of variants with other numbers, which share one compiled program."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift import scenario
from colift.closed_loop import signals
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.models.parameters import Team
from colift.models.state import AgentInput, AgentState, PayloadState, ResidualForces, State
from colift.scenario import Scenario, experiment, team
from colift.simulation import contact_dynamics, disturbances
from colift.simulation.world import SimulatedWorld

SETTINGS: Scenario = scenario.load_scenario("paper")
NAMES = team.agent_names(SETTINGS)
SHORT = {"duration": 9.0, "updates": (2.0, 3.5, 5.0, 6.0)}  # the paper's study with earlier updates


@functools.cache
def paper_experiment(case: str) -> Experiment:
    """Return a case of the study as shipped."""
    return experiment.make_experiment(SETTINGS, case)


def shortened(case: str, eta: bool = True) -> Experiment:
    """Return a case with updates and internal forces within nine seconds; `eta` selects internal forces."""
    full = paper_experiment(case)
    eta_on = float(eta) * full.controller.allocator.internal.eta
    full = with_internal(full, start=jnp.array(4.0), end=jnp.array(7.0), eta=eta_on)
    updates = SHORT["updates"] if full.update_times else ()
    return dataclasses.replace(full, duration=SHORT["duration"], update_times=updates)


def flight(case: str, eta: bool = True) -> FlightResult:
    """Return the flight of `shortened`, simulated once per process."""
    return _flight(case, eta)


@functools.cache
def _flight(case: str, eta: bool) -> FlightResult:
    return run_experiment(shortened(case, eta))


def number(x: float) -> jax.Array:
    """Return a strongly typed float64 as built by the scenario, so that the flight is not compiled again."""
    return jnp.array(x, dtype=float)


def with_controller(base_experiment: Experiment, **parts: Any) -> Experiment:
    """Return the experiment with fields of its controller replaced."""
    return dataclasses.replace(base_experiment, controller=dataclasses.replace(base_experiment.controller, **parts))


def with_gains(base_experiment: Experiment, **gains: Any) -> Experiment:
    """Return the experiment with other gains of payload controller and agent controllers."""
    new = dataclasses.replace(base_experiment.controller.payload_controller.gains, **gains)
    payload_controller, agent_controller = (
        dataclasses.replace(part, gains=new)
        for part in (base_experiment.controller.payload_controller, base_experiment.controller.agent_controller)
    )
    return with_controller(base_experiment, payload_controller=payload_controller, agent_controller=agent_controller)


def with_filters(base_experiment: Experiment, **filters: Any) -> Experiment:
    """Return the experiment with other onboard filters."""
    of = base_experiment.controller.estimator
    return with_controller(
        base_experiment, estimator=dataclasses.replace(of, filters=dataclasses.replace(of.filters, **filters))
    )


def with_internal(base_experiment: Experiment, **parts: Any) -> Experiment:
    """Return the experiment with another internal force."""
    of = base_experiment.controller.allocator
    return with_controller(
        base_experiment, allocator=dataclasses.replace(of, internal=dataclasses.replace(of.internal, **parts))
    )


def with_world(base_experiment: Experiment, **parts: Any) -> Experiment:
    """Return the experiment with fields of its world replaced."""
    return dataclasses.replace(base_experiment, world=dataclasses.replace(base_experiment.world, **parts))


def without_noise(base_experiment: Experiment) -> Experiment:
    """Return the experiment with sensors without noise and bias; their bandwidth is unchanged."""
    sensors = jax.tree.map(jnp.zeros_like, base_experiment.world.sensors)
    sensors = dataclasses.replace(sensors, tip_force_bandwidth=base_experiment.world.sensors.tip_force_bandwidth)
    return with_world(
        base_experiment,
        sensors=sensors,
        tip_force_bias=jax.tree.map(jnp.zeros_like, base_experiment.world.tip_force_bias),
    )


def with_exact_sensors(base_experiment: Experiment) -> Experiment:
    """Return the experiment without noise and with measured poses and velocities instead of estimates."""
    return with_filters(without_noise(base_experiment), complementary=number(1e6), joint=number(200.0))


def with_nominal_world(base_experiment: Experiment) -> Experiment:
    """Return the experiment with the nominal team in the world, so that only disturbances are unknown."""
    return with_world(base_experiment, team=base_experiment.controller.team)


def simulate(base_experiment: Experiment, duration: float) -> FlightResult:
    """Simulate an experiment for some seconds."""
    return run_experiment(dataclasses.replace(base_experiment, duration=duration))


def states(team: Team, rows: signals.StepRecord) -> tuple[State, tuple[AgentInput, ...]]:
    """Return states and inputs of a log with time as the leading axis, for a team of one group."""
    (group,), (size,) = team.agent_groups, team.sizes
    joints = (size, group.tree.joints)

    def one(row: signals.StepRecord) -> tuple[State, tuple[AgentInput, ...]]:
        agents = AgentState(
            R=row.R,
            x=row.x,
            r=row.r.reshape(joints),
            omega=row.omega,
            v=row.v_agent,
            r_dot=row.r_dot.reshape(joints),
        )
        load = PayloadState(R=row.R_L, p=row.p, omega=row.omega_L, v=row.v)
        inputs = AgentInput(u=row.u, tau=row.tau, tau_r=row.tau_r.reshape(joints))
        return State(agents=(agents,), payload=load), (inputs,)

    return jax.vmap(one)(jax.tree.map(jnp.asarray, rows))


ROOM = 250


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, 0, 0))
def _accelerations(
    world: SimulatedWorld, nominal: Team, z: State, inputs: tuple[AgentInput, ...]
) -> tuple[jax.Array, ResidualForces]:
    f = disturbances.initial_forces(world.disturbances, world.team, z)
    a, lam = contact_dynamics.forward_dynamics(world.team, z, inputs, f)
    return a.payload, signals.true_residual(nominal, z, a, lam, inputs)


def accelerations_and_residuals(
    base_experiment: Experiment, z: State, inputs: tuple[AgentInput, ...]
) -> tuple[jax.Array, ResidualForces]:
    """Return the payload's acceleration and the residual of the nominal equations for many states and inputs."""
    n = len(z.payload.p)
    parts = []
    for first in range(0, n, ROOM):  # in batches of one size: one compiled program
        pick = np.minimum(np.arange(first, first + ROOM), n - 1)
        piece = jax.tree.map(lambda x, pick=pick: x[pick], (z, inputs))
        parts.append(_accelerations(base_experiment.world, base_experiment.controller.team, *piece))
    return jax.tree.map(lambda *x: jnp.concatenate(x)[:n], *parts)


def rms(x: np.ndarray) -> float:
    """Return the root mean square over time of the norm of each sample."""
    return float(np.sqrt((np.asarray(x).reshape(len(x), -1) ** 2).sum(1).mean()))


def with_weaker_rotors(newton: float) -> Scenario:
    """Return the study with weaker rotors."""
    data = SETTINGS.model_dump()
    data["agent_types"]["two_arms"]["thrust_max_N"] = newton
    return Scenario.model_validate(data)
