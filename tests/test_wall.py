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


def other_world(of: simulate.Plan, by: float = 1.5) -> simulate.World:
    """Another truth: a heavier payload and agents, winds `by` times as large, sensors without noise."""
    team = of.world.team
    load = dataclasses.replace(team.payload, mass=1.3 * team.payload.mass, inertia=1.2 * team.payload.inertia)
    (group,) = team.groups
    group = dataclasses.replace(group, mass=1.1 * group.mass, inertia=1.1 * group.inertia)
    mounts = jax.tree.map(lambda x: by * x, (of.world.sources.payload, of.world.sources.agents))
    sources = dataclasses.replace(of.world.sources, payload=mounts[0], agents=mounts[1])
    world = paper_flights.quiet(of).world
    return dataclasses.replace(world, team=dataclasses.replace(team, payload=load, groups=(group,)), sources=sources)


@pytest.fixture(scope="module")
def fly_on() -> Any:
    """`(plan, world, recorded) -> (memory, row, measurement)`: a plan's loop in a world, from the plan's own start.

    Where there is a recording, the sensors play it. The rig always shows the world that is flown in.
    """
    first = plan("C3")
    noise = sensor.draw(first.world.team, jax.random.key(0), TICKS)
    sense = sensor.sense

    @jax.jit
    def run(
        world: simulate.World, pilot: Any, oracle: Any, begun: simulate.Loop, recorded: Any, replay: jax.Array
    ) -> Any:
        def step(loop: simulate.Loop, now: Any) -> Any:
            draws, kept = now
            read: list[sensor.Measurement] = []

            def reading(*args: Any) -> sensor.Measurement:
                live = sense(*args)
                m = jax.tree.map(lambda old, new: jnp.where(replay, old, new), kept, live)
                read.append(dataclasses.replace(m, rig=live.rig))
                return read[-1]

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sensor, "sense", reading)
                loop, row = simulate.tick(world, pilot, oracle, loop, draws)
            (m,) = read
            return loop, (loop.memory, row, m)

        return jax.lax.scan(step, begun, (noise, recorded))[1]

    def fly(of: simulate.Plan, world: simulate.World, recorded: Any = None) -> Any:
        recorder = dataclasses.replace(of.pilot.recorder, start=paper_flights.number(0.0))
        pilot = dataclasses.replace(of.pilot, recorder=recorder)
        begun = simulate.start(of.world, pilot, of.oracle, of.z)  # one start for all: only the ticks differ
        replay = jnp.array(recorded is not None)
        return run(world, pilot, of.oracle, begun, blank if recorded is None else recorded, replay)

    draws = jax.tree.map(lambda x: x[0], noise)
    still = _still(first)
    shapes = jax.eval_shape(lambda: sense(first.world.team, first.world.sensors, first.world.lam_bias, still, draws))
    blank = jax.tree.map(lambda s: jnp.zeros((TICKS, *s.shape)), shapes)
    return fly


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


COMMANDS = ("u", "tau", "tau_r", "lam_cmd", "W_d", "f_L_hat", "f_x_hat", "f_w_hat", "f_r_hat", "lam_hat", "R_L_hat")
COMMANDS += ("eta", "saturated")


def changed(one: Any, other: Any) -> list[str]:
    """The commands and parts of the memory that differ by a bit between two flights."""
    (memory, row, _), (memory_again, row_again, _) = one, other
    names = [name for name in COMMANDS if not np.array_equal(getattr(row, name), getattr(row_again, name))]
    leaves = zip(jax.tree_util.tree_leaves_with_path(memory), jax.tree.leaves(memory_again), strict=True)
    return names + [jax.tree_util.keystr(path) for (path, a), b in leaves if not np.array_equal(a, b)]


@pytest.mark.parametrize("case", ["C1", "C2", "C3"])
def test_with_the_measurements_fixed_another_truth_changes_no_command_and_no_memory(fly_on, case):
    """Nor does it through the rig, which shows the other truth, for these cases take no sample from it."""
    of = plan(case)
    flown = memory, row, stream = fly_on(of, of.world)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(flown))
    again = _, row_again, seen = fly_on(of, other_world(of), stream)
    assert changed(flown, again) == []
    # the truths do differ, and the loop was watching: the plant goes elsewhere, the rig says so, data were recorded
    assert np.abs(row.p - row_again.p).max() > 1e-3
    assert np.abs(row.lam - row_again.lam).max() > 0.1
    assert np.abs(stream.rig.f.payload.F - seen.rig.f.payload.F).max() > 0.1
    assert (int(memory.payload_data.n[-1]) > 5) == (case != "C1")
    assert bool((memory.agent_data[0].n[-1] > 5).all()) == (case == "C3")


@pytest.mark.parametrize("case", ["C1", "C2", "C3"])
def test_a_truth_that_is_not_finite_does_not_reach_what_flies(fly_on, case):
    """A product with zero would let it through: 0 times NaN is NaN."""
    of = plan(case)
    flown = fly_on(of, of.world)
    again = _, row, seen = fly_on(of, other_world(of, by=np.nan), flown[2])
    assert changed(flown, again) == []
    assert np.isnan(row.f_x).all()
    assert np.isnan(row.p[1:]).all()
    assert np.isnan(seen.rig.f.payload.F).all()


def test_what_is_measured_is_what_changes_commands(fly_on):
    """The tests above can fail: the same other truth, measured, changes the commands."""
    of = plan("C3")
    _, row, _ = fly_on(of, of.world)
    _, seen, _ = fly_on(of, other_world(of))
    assert np.abs(row.u - seen.u).max() > 0.1


def test_the_ways_around_the_sensors_that_a_study_may_open_would_be_seen(fly_on):
    """They can fail, too, where samples come from the rig, or where the pilot is told the exact residual."""
    of = plan("C3")
    recorder = dataclasses.replace(of.pilot.recorder, rig=jnp.array(True))
    at_rig = paper_flights.with_pilot(of, recorder=recorder)
    flown = fly_on(at_rig, of.world)
    leaks = changed(flown, fly_on(at_rig, other_world(of), flown[2]))
    assert leaks == [".payload_data.X", ".payload_data.Y", ".agent_data[0].X", ".agent_data[0].Y"]
    flown = fly_on(of, of.world)
    knowing = dataclasses.replace(other_world(of), told=jnp.array(True))
    assert {"u", "tau", "f_L_hat", "f_x_hat"} <= set(changed(flown, fly_on(of, knowing, flown[2])))


def test_no_case_of_the_paper_is_told_the_residual_or_takes_samples_from_the_rig():
    """`given` and the rig are the two ways around the sensors: both are shut in C1 to C3."""
    for case in ("C1", "C2", "C3"):
        assert not plan(case).world.told
        assert not plan(case).pilot.recorder.rig
