"""Tests that the controller depends on the true state only through sensors: with fixed measurements another world
changes no command.
"""

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
from tests.support.paper_flights import paper_experiment

TICKS = 150


def other_world(of: flight.Experiment, by: float = 1.5) -> SimulatedWorld:
    """Return another world: heavier payload and agents, wind scaled by `by`, sensors without noise."""
    team = of.world.team
    payload = dataclasses.replace(team.payload, mass=1.3 * team.payload.mass, inertia=1.2 * team.payload.inertia)
    (group,) = team.agent_groups
    group = dataclasses.replace(group, mass=1.1 * group.mass, inertia=1.1 * group.inertia)
    mounts = jax.tree.map(lambda x: by * x, (of.world.disturbances.payload, of.world.disturbances.agents))
    sources = dataclasses.replace(of.world.disturbances, payload=mounts[0], agents=mounts[1])
    world = paper_flights.without_noise(of).world
    return dataclasses.replace(
        world, team=dataclasses.replace(team, payload=payload, agent_groups=(group,)), disturbances=sources
    )


@pytree
class ReplayedWorld:
    """World whose sensors play a recording; a calibration rig still reports the simulated world."""

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
def simulate_in() -> Any:
    """Function `(experiment, world, recorded) -> (state, row, measurement)` that simulates an experiment in a world.

    The initial state is that of the experiment; if a recording is given, the sensors play it.
    """

    @jax.jit
    def run(setup: simulator.LoopConfig, begun: simulator.LoopState, noise: Any) -> Any:
        def step(loop: simulator.LoopState, noise_now: Any) -> Any:
            clock = ControlClock(t=loop.tick.astype(setup.dt.dtype) * setup.dt, dt=setup.dt)
            m, _ = setup.world.measure(loop.world, clock, noise_now)
            loop, row = simulator.step(setup, loop, noise_now)
            return loop, (loop.controller, row, m)

        return jax.lax.scan(step, begun, noise)[1]

    def simulate(of: flight.Experiment, world: SimulatedWorld, recorded: Any = None) -> Any:
        recorder = dataclasses.replace(of.controller.recorder, start=paper_flights.number(0.0))
        of = paper_flights.with_controller(of, recorder=recorder)
        begun = simulator.reset(of.loop_config, of.initial_state)  # equal initial loops
        drawn = world.sample_noise(jax.random.key(0), TICKS)
        if recorded is None:  # rounding differs between recording and replay: compare replays only
            shape = jax.eval_shape(lambda: world.measure_at_rest(of.initial_state))
            recorded = jax.tree.map(lambda s: jnp.zeros((TICKS, *s.shape)), shape)
            replay = jnp.zeros(TICKS, bool)
        else:
            replay = jnp.ones(TICKS, bool)
        setup = dataclasses.replace(of.loop_config, world=ReplayedWorld(world=world))
        return run(setup, begun, (drawn, recorded, replay))

    return simulate


COMMANDS = ("u", "tau", "tau_r", "lam_cmd", "W_d", "f_L_hat", "f_x_hat", "f_w_hat", "f_r_hat", "lam_hat", "R_L_hat")
COMMANDS += ("eta", "thrust_saturated")


def changed(one: Any, other: Any) -> list[str]:
    """Return the commands and parts of the controller state that differ between two flights."""
    (state, row, _), (state_again, row_again, _) = one, other
    names = [name for name in COMMANDS if not np.array_equal(getattr(row, name), getattr(row_again, name))]
    leaves = zip(jax.tree_util.tree_leaves_with_path(state), jax.tree.leaves(state_again), strict=True)
    return names + [jax.tree_util.keystr(path) for (path, a), b in leaves if not np.array_equal(a, b)]


@pytest.mark.parametrize("case", ["C1", pytest.param("C2", marks=pytest.mark.long), "C3"])
def test_commands_depend_only_on_measurements(simulate_in, case):
    """With fixed measurements another world changes neither commands nor controller state."""
    of = paper_experiment(case)
    recorded = simulate_in(of, of.world)[2]
    flown = state, row, _ = simulate_in(of, of.world, recorded)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(flown))
    again = _, row_again, _ = simulate_in(of, other_world(of), recorded)
    assert changed(flown, again) == []
    # the worlds differ, and data were recorded
    assert np.abs(row.p - row_again.p).max() > 1e-3
    assert np.abs(row.lam - row_again.lam).max() > 0.1
    assert (int(state.recorder.payload.n[-1]) > 5) == (case != "C1")
    assert bool((state.recorder.agents[0].n[-1] > 5).all()) == (case == "C3")


@pytest.mark.parametrize("case", ["C1", "C2", "C3"])
def test_nan_in_the_world_does_not_reach_commands(simulate_in, case):
    of = paper_experiment(case)
    recorded = simulate_in(of, of.world)[2]
    flown = simulate_in(of, of.world, recorded)
    again = _, row, _ = simulate_in(of, other_world(of, by=np.nan), recorded)
    assert changed(flown, again) == []
    assert np.isnan(row.f_x).all()
    assert np.isnan(row.p[1:]).all()


def test_other_measurements_change_commands(simulate_in):
    """The tests above can fail: without the recording the other world changes the commands."""
    of = paper_experiment("C3")
    _, row, _ = simulate_in(of, of.world)
    _, row_measured, _ = simulate_in(of, other_world(of))
    assert np.abs(row.u - row_measured.u).max() > 0.1


@pytest.mark.long
def test_calibration_rig_is_detected(simulate_in):
    """The tests above can also fail through samples of a calibration rig, which contain true values."""
    of = paper_experiment("C3")
    error = jax.tree.map(jnp.zeros_like, zero_residual(of.world.team))
    at_rig = paper_flights.with_controller(of, recorder=recorder.RigRecorder(**vars(of.controller.recorder)))
    at_rig = paper_flights.with_world(at_rig, sensor_models=(sensors.CalibrationRig(label_error=error),))
    recorded = simulate_in(at_rig, at_rig.world)[2]
    differences = changed(
        simulate_in(at_rig, at_rig.world, recorded), simulate_in(at_rig, other_world(at_rig), recorded)
    )
    assert differences == [f".recorder.{name}" for name in ("payload.X", "payload.Y", "agents[0].X", "agents[0].Y")]


def test_cases_of_the_paper_have_no_true_values():
    """Only `Measurement.rig` and `residual_predictors.TrueResidual` bypass the sensors; C1 to C3 have neither."""
    for case in ("C1", "C2", "C3"):
        m = paper_experiment(case).world.measure_at_rest(paper_experiment(case).initial_state)
        assert m.rig is None
        assert m.extra == {}
        assert type(paper_experiment(case).controller.residual_predictor) is residual_predictors.LearnedResidual
