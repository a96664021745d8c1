"""What flies sees the truth through its sensors alone: measurements fixed, another truth changes no command."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight, simulator
from colift.math.pytree import pytree
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import ControlClock, State, zero_residual
from colift.onboard.learning import recorder, residual_predictors
from colift.simulation import sensors
from colift.simulation.world import SimulatedWorld
from tests.support import paper_flights
from tests.support.paper_flights import plan

TICKS = 150


def other_world(of: flight.Experiment, by: float = 1.5) -> SimulatedWorld:
    """Another truth: a heavier payload and agents, winds `by` times as large, sensors without noise."""
    team = of.world.team
    load = dataclasses.replace(team.payload, mass=1.3 * team.payload.mass, inertia=1.2 * team.payload.inertia)
    (group,) = team.agent_groups
    group = dataclasses.replace(group, mass=1.1 * group.mass, inertia=1.1 * group.inertia)
    mounts = jax.tree.map(lambda x: by * x, (of.world.disturbances.payload, of.world.disturbances.agents))
    sources = dataclasses.replace(of.world.disturbances, payload=mounts[0], agents=mounts[1])
    world = paper_flights.quiet(of).world
    return dataclasses.replace(
        world, team=dataclasses.replace(team, payload=load, agent_groups=(group,)), disturbances=sources
    )


@pytree
class Replayed:
    """A world whose sensors play a recording; a rig or an informant in it still shows the world that is flown in."""

    world: SimulatedWorld

    @property
    def team(self) -> Team:
        return self.world.team

    def sample_noise(self, key: Any, ticks: int) -> Any:
        return self.world.sample_noise(key, ticks)

    def measure_at_rest(self, state: State) -> Measurement:
        return self.world.measure_at_rest(state)

    def init(self, state: State, command: Any) -> Any:
        return self.world.init(state, command)

    def measure(self, state: Any, clock: ControlClock, noise: Any) -> tuple[Measurement, Any]:
        drawn, kept, replay = noise
        live, state = self.world.measure(state, clock, drawn)
        played = jax.tree.map(lambda old, new: jnp.where(replay, old, new), kept, live)
        return dataclasses.replace(played, rig=live.rig), state

    def step(self, state: Any, command: Any, clock: ControlClock) -> Any:
        return self.world.step(state, command, clock)


@pytest.fixture(scope="module")
def fly_on() -> Any:
    """`(plan, world, recorded) -> (memory, row, measurement)`: a plan's loop in a world, from the plan's own start.

    Where there is a recording, the sensors play it.
    """

    @jax.jit
    def run(setup: simulator.LoopConfig, begun: simulator.LoopState, noise: Any) -> Any:
        def step(loop: simulator.LoopState, now: Any) -> Any:
            clock = ControlClock(t=loop.tick.astype(setup.dt.dtype) * setup.dt, dt=setup.dt)
            m, _ = setup.world.measure(loop.world, clock, now)
            loop, row = simulator.step(setup, loop, now)
            return loop, (loop.controller, row, m)

        return jax.lax.scan(step, begun, noise)[1]

    def fly(of: flight.Experiment, world: SimulatedWorld, recorded: Any = None) -> Any:
        recorder = dataclasses.replace(of.controller.recorder, start=paper_flights.number(0.0))
        of = paper_flights.with_pilot(of, recorder=recorder)
        begun = simulator.reset(of.loop_config, of.initial_state)  # one start for all: only the ticks differ
        drawn = world.sample_noise(jax.random.key(0), TICKS)
        if recorded is None:  # what is recorded is rounded otherwise than what flies: compare replays with replays
            shape = jax.eval_shape(lambda: world.measure_at_rest(of.initial_state))
            recorded = jax.tree.map(lambda s: jnp.zeros((TICKS, *s.shape)), shape)
            replay = jnp.zeros(TICKS, bool)
        else:
            replay = jnp.ones(TICKS, bool)
        setup = dataclasses.replace(of.loop_config, world=Replayed(world=world))
        return run(setup, begun, (drawn, recorded, replay))

    return fly


COMMANDS = ("u", "tau", "tau_r", "lam_cmd", "W_d", "f_L_hat", "f_x_hat", "f_w_hat", "f_r_hat", "lam_hat", "R_L_hat")
COMMANDS += ("eta", "thrust_saturated")


def changed(one: Any, other: Any) -> list[str]:
    """The commands and parts of the memory that differ by a bit between two flights."""
    (memory, row, _), (memory_again, row_again, _) = one, other
    names = [name for name in COMMANDS if not np.array_equal(getattr(row, name), getattr(row_again, name))]
    leaves = zip(jax.tree_util.tree_leaves_with_path(memory), jax.tree.leaves(memory_again), strict=True)
    return names + [jax.tree_util.keystr(path) for (path, a), b in leaves if not np.array_equal(a, b)]


@pytest.mark.parametrize("case", ["C1", pytest.param("C2", marks=pytest.mark.long), "C3"])
def test_with_the_measurements_fixed_another_truth_changes(fly_on, case):
    """With the measurements fixed another truth changes no command and no memory."""
    of = plan(case)
    stream = fly_on(of, of.world)[2]
    flown = memory, row, _ = fly_on(of, of.world, stream)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(flown))
    again = _, row_again, _ = fly_on(of, other_world(of), stream)
    assert changed(flown, again) == []
    # the truths do differ, and the loop was watching: the plant goes elsewhere, data were recorded
    assert np.abs(row.p - row_again.p).max() > 1e-3
    assert np.abs(row.lam - row_again.lam).max() > 0.1
    assert (int(memory.recorder.payload.n[-1]) > 5) == (case != "C1")
    assert bool((memory.recorder.agents[0].n[-1] > 5).all()) == (case == "C3")


@pytest.mark.parametrize("case", ["C1", "C2", "C3"])
def test_a_truth_that_is_not_finite_does_not_reach_what_flies(fly_on, case):
    of = plan(case)
    stream = fly_on(of, of.world)[2]
    flown = fly_on(of, of.world, stream)
    again = _, row, _ = fly_on(of, other_world(of, by=np.nan), stream)
    assert changed(flown, again) == []
    assert np.isnan(row.f_x).all()
    assert np.isnan(row.p[1:]).all()


def test_what_is_measured_is_what_changes_commands(fly_on):
    """The tests above can fail: the same other truth, measured, changes the commands."""
    of = plan("C3")
    _, row, _ = fly_on(of, of.world)
    _, seen, _ = fly_on(of, other_world(of))
    assert np.abs(row.u - seen.u).max() > 0.1


@pytest.mark.long
def test_the_ways_around_the_sensors_that_a_study_may_open_would(fly_on):
    """They can fail, too, where samples come from a rig, or where the pilot is told the exact residual."""
    of = plan("C3")
    error = jax.tree.map(jnp.zeros_like, zero_residual(of.world.team))
    at_rig = paper_flights.with_pilot(of, recorder=recorder.RigRecorder(**vars(of.controller.recorder)))
    at_rig = paper_flights.with_world(at_rig, sensor_models=(sensors.CalibrationRig(label_error=error),))
    stream = fly_on(at_rig, at_rig.world)[2]
    leaks = changed(fly_on(at_rig, at_rig.world, stream), fly_on(at_rig, other_world(at_rig), stream))
    assert leaks == [f".recorder.{name}" for name in ("payload.X", "payload.Y", "agents[0].X", "agents[0].Y")]


def test_no_case_of_the_paper_has_a_sensor_that_knows_the_truth():
    """`Measurement.rig` and `residual_predictors.TrueResidual` are the ways around the sensors: only O knows."""
    for case in ("C1", "C2", "C3"):
        m = plan(case).world.measure_at_rest(plan(case).initial_state)
        assert m.rig is None
        assert m.extra == {}
        assert type(plan(case).controller.residual_predictor) is residual_predictors.LearnedResidual
