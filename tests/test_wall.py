"""What flies sees the truth through its sensors alone: measurements fixed, another truth changes no command."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import sensor, simulate
from colift.model import no_force
from tests import paper_flights
from tests.paper_flights import plan

TICKS = 150


def other_world(of: simulate.Plan) -> simulate.World:
    """Another truth: a heavier payload and agents, other winds, sensors without noise."""
    team = of.world.team
    load = dataclasses.replace(team.payload, mass=1.3 * team.payload.mass, inertia=1.2 * team.payload.inertia)
    (group,) = team.groups
    group = dataclasses.replace(group, mass=1.1 * group.mass, inertia=1.1 * group.inertia)
    mounts = tuple(jax.tree.map(lambda x: 1.5 * x, mount) for mount in of.world.sources.payload)
    sources = dataclasses.replace(of.world.sources, payload=mounts)
    world = paper_flights.quiet(of).world
    return dataclasses.replace(world, team=dataclasses.replace(team, payload=load, groups=(group,)), sources=sources)


@pytest.fixture(scope="module")
def fly_on() -> Any:
    """`(world, recorded, replay) -> (commands, plant, measurements)`: the loop, its sensors replaced by a recording."""
    of = paper_flights.shortened("C3")
    recorder = dataclasses.replace(of.pilot.recorder, start=paper_flights.number(0.0))
    pilot = dataclasses.replace(of.pilot, recorder=recorder)
    noise = sensor.draw(of.world.team, jax.random.key(0), TICKS)
    sense = sensor.sense

    @jax.jit
    def run(world: simulate.World, recorded: sensor.Measurement, replay: jax.Array) -> Any:
        def step(loop: simulate.Loop, now: Any) -> Any:
            draws, kept = now
            read: list[sensor.Measurement] = []

            def reading(*args: Any) -> sensor.Measurement:
                m = jax.tree.map(lambda old, new: jnp.where(replay, old, new), kept, sense(*args))
                read.append(m)
                return m

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sensor, "sense", reading)
                loop, row = simulate.tick(world, pilot, of.oracle, loop, draws)
            (m,) = read
            return loop, (loop.memory, row, m)

        begun = simulate.start(of.world, pilot, of.oracle, of.z)  # one start for all: only the ticks differ
        return jax.lax.scan(step, begun, (noise, recorded))[1]

    shapes = jax.eval_shape(
        lambda: sense(
            of.world.team, of.world.sensors, of.world.lam_bias, _still(of), jax.tree.map(lambda x: x[0], noise)
        )
    )
    blank = jax.tree.map(lambda s: jnp.zeros((TICKS, *s.shape)), shapes)
    return lambda world, recorded=None: run(
        world, blank if recorded is None else recorded, jnp.array(recorded is not None)
    )


def _still(of: simulate.Plan) -> sensor.Truth:
    """What sensors feel of a team that does not move, for its shapes."""
    (q,) = of.z.agents
    return sensor.Truth(
        z=of.z,
        v_dot=(jnp.zeros_like(q.v),),
        xi_dot=(jnp.zeros((len(q.v), 3 + q.r.shape[1])),),
        a_L=jnp.zeros(6),
        lam=(jnp.zeros_like(of.world.team.groups[0].contact),),
        f=no_force(of.world.team),
    )


COMMANDS = ("u", "tau", "tau_r", "lam_cmd", "W_d", "f_L_hat", "f_x_hat", "lam_hat", "R_L_hat", "eta", "saturated")


def test_with_the_measurements_fixed_another_truth_changes_no_command_and_no_memory(fly_on):
    of = plan("C3")
    memory, row, stream = fly_on(of.world)
    memory_again, row_again, _ = fly_on(other_world(of), stream)
    for name in COMMANDS:
        np.testing.assert_array_equal(getattr(row, name), getattr(row_again, name), err_msg=name)
    for a, b in zip(jax.tree.leaves(memory), jax.tree.leaves(memory_again), strict=True):
        np.testing.assert_array_equal(a, b)
    # the truths do differ, and the loop was watching: the plant goes elsewhere, data were recorded
    assert np.abs(row.p - row_again.p).max() > 1e-3
    assert np.abs(row.lam - row_again.lam).max() > 0.1
    assert int(memory.payload_data.n[-1]) > 5


def test_what_is_measured_is_what_changes_commands(fly_on):
    """The test above can fail: the same other truth, measured, changes the commands."""
    of = plan("C3")
    _, row, _ = fly_on(of.world)
    _, seen, _ = fly_on(other_world(of))
    assert np.abs(row.u - seen.u).max() > 0.1


def test_the_residual_that_a_study_may_tell_is_zero_in_every_case_of_the_paper():
    """`given` is the one way around the sensors: the share of the truth that it holds is zero in C1 to C3."""
    assert [float(plan(case).world.told) for case in ("C1", "C2", "C3")] == [0, 0, 0]
