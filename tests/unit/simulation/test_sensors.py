"""Tests of sensors: values without noise, noise models, and independence of noise from the controller."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import AgentInput, ControlClock, ResidualForces, State, zero_residual
from colift.simulation import contact_dynamics
from colift.simulation import sensors as sensors_module
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam

STRUCTURE = ((teams.WAIST_TWO_ARMS, 2),)
TICKS = 4000
DEVIATIONS = {
    "position": 2e-3,
    "attitude": 3.5e-3,
    "velocity": 1e-2,
    "angular_velocity": 1e-2,
    "accelerometer": 5e-2,
    "joint_position": 1.7e-3,
    "tip_force": 0.1,
    "tip_moment": 0.005,
    "tip_force_bias": 0.05,
    "tip_force_bandwidth": 50.0,
}


@functools.cache
def sensors() -> sensors_module.SensorNoise:
    """Return sensors with these standard deviations."""
    return sensors_module.SensorNoise(**{name: jnp.array(value) for name, value in DEVIATIONS.items()})


@functools.cache
def case(seed: int = 3) -> tuple[Team, State, sensors_module.SensedState]:
    """A moving team on its grasp and its sensed state."""
    rng = np.random.default_rng(seed)
    team, z = PinocchioTeam(teams.team(rng, STRUCTURE)).on_grasp(teams.free_state(rng, STRUCTURE))
    return team, z, sensed_state(team, z)


def inputs() -> tuple[AgentInput, ...]:
    """Constant commands."""
    rng = np.random.default_rng(7)
    draw = lambda *shape: jnp.array(rng.normal(size=shape))  # noqa: E731
    return (AgentInput(u=20 + draw(2), tau=0.1 * draw(2, 3), tau_r=0.1 * draw(2, 3)),)


accelerate, sense = jax.jit(contact_dynamics.forward_dynamics), jax.jit(sensors_module.measure)


def sensed_state(team: Team, z: State) -> sensors_module.SensedState:
    """Return the sensed state of a team at z under `inputs`."""
    a, lam = accelerate(team, z, inputs(), zero_residual(team))
    return sensors_module.SensedState(
        z=z,
        v_dot=tuple(x.v_dot for x in a.agents),
        xi_dot=tuple(x.xi_dot for x in a.agents),
        a_L=a.payload,
        lam=lam,
        f=residual(team),
    )


def residual(team: Team) -> ResidualForces:
    """Generated residual forces for the calibration rig."""
    rng = np.random.default_rng(8)
    return jax.tree.map(lambda x: jnp.array(rng.normal(size=x.shape)), zero_residual(team))


CLOCK = ControlClock(t=jnp.array(0.0), dt=jnp.array(0.002))


def no_noise(team: Team) -> sensors_module.Noise:
    """Zero noise of one step."""
    return jax.tree.map(lambda x: jnp.zeros(x.shape[1:]), sensors_module.sample_noise(team, jax.random.key(0), 1))


def no_bias(team: Team) -> tuple[jax.Array, ...]:
    """Tip sensors without bias."""
    return tuple(jnp.zeros_like(group.contact_position) for group in team.agent_groups)


def readings() -> Measurement:
    """Many measurements of one instant, without bias."""
    team, _, truth = case()
    many = jax.jit(jax.vmap(sensors_module.measure, in_axes=(None, None, None, None, 0)))
    return many(team, sensors(), no_bias(team), truth, sensors_module.sample_noise(team, jax.random.key(1), TICKS))


def ideal() -> Measurement:
    """One measurement without noise."""
    team, _, truth = case()
    return sense(team, sensors(), no_bias(team), truth, no_noise(team))


def test_noise_has_stated_std_and_zero_mean():
    noisy, exact = readings(), ideal()
    agents, load = (noisy.agents[0], exact.agents[0]), (noisy.payload, exact.payload)
    pairs = [
        *(("position", *(getattr(m, name) for m in of)) for of, name in ((agents, "x"), (load, "p"))),
        *(("velocity", *(m.v for m in of)) for of in (agents, load)),
        *(("angular_velocity", *(m.omega for m in of)) for of in (agents, load)),
        *(("accelerometer", *(m.a for m in of)) for of in (agents, load)),
        ("joint_position", *(m.r for m in agents)),
        ("tip_force", *(m.lam for m in agents)),
    ]
    for name, of_all, of_one in pairs:
        error = np.asarray(of_all) - np.asarray(of_one)
        # five standard errors of a deviation and of a mean of normal numbers
        np.testing.assert_allclose(error.std(0), DEVIATIONS[name], rtol=5 / np.sqrt(2 * TICKS), err_msg=name)
        assert np.abs(error.mean(0)).max() < 5 * DEVIATIONS[name] / np.sqrt(TICKS), name


def test_attitude_noise_is_a_small_rotation_in_the_body_frame():
    noisy, exact = readings(), ideal()
    for of_all, of_one in ((noisy.agents[0].R[:, 0], exact.agents[0].R[0]), (noisy.payload.R, exact.payload.R)):
        turn = Rotation.from_matrix(np.asarray(of_one).T @ np.asarray(of_all)).as_rotvec()
        np.testing.assert_allclose(turn.std(0), DEVIATIONS["attitude"], rtol=5 / np.sqrt(2 * TICKS))
        assert np.abs(turn.mean(0)).max() < 5 * DEVIATIONS["attitude"] / np.sqrt(TICKS)


def test_noise_is_white_and_independent_across_channels():
    noise = sensors_module.sample_noise(case()[0], jax.random.key(2), TICKS)
    x = np.concatenate([np.asarray(leaf).reshape(TICKS, -1) for leaf in jax.tree.leaves(noise)], axis=1)
    bound = 6 / np.sqrt(TICKS)
    correlation = np.corrcoef(x.T) - np.eye(x.shape[1])
    assert np.abs(correlation).max() < bound
    assert np.abs((x[1:] * x[:-1]).mean(0)).max() < bound


def test_tip_bias_is_constant_and_random_per_axis():
    team, _, truth = case()
    offset = sensors_module.sample_tip_bias(team, sensors(), jax.random.key(4))
    biased = sense(team, sensors(), offset, truth, no_noise(team))
    np.testing.assert_allclose(biased.agents[0].lam - ideal().agents[0].lam, offset[0], atol=1e-12)
    np.testing.assert_array_equal(offset[0], sensors_module.sample_tip_bias(team, sensors(), jax.random.key(4))[0])
    drawn = np.concatenate(
        [sensors_module.sample_tip_bias(team, sensors(), jax.random.key(k))[0].ravel() for k in range(200)]
    )
    assert drawn.std() == pytest.approx(DEVIATIONS["tip_force_bias"], rel=5 / np.sqrt(2 * len(drawn)))


def test_measurement_without_noise_is_exact():
    team, z, truth = case()
    m, load = ideal(), z.payload
    np.testing.assert_allclose(m.payload.p, load.p)
    np.testing.assert_allclose(m.payload.R, load.R, atol=1e-12)
    np.testing.assert_allclose(m.agents[0].r, z.agents[0].r)
    np.testing.assert_allclose(m.payload.a, np.asarray(load.R).T @ (truth.a_L[:3] - team.gravity), atol=1e-12)
    model = PinocchioTeam(team)
    q, v = model.coordinates(z)
    # bases are free-flyers: their own coordinates are position, quaternion, then joints
    for j, part in enumerate(model.parts):
        first = 7 * j + sum(of.model.nq - 7 for of in model.free[:j])
        np.testing.assert_allclose(m.agents[0].x[j], q[first : first + 3], atol=1e-12)
        R = np.asarray(z.agents[0].R[j])
        np.testing.assert_allclose(m.agents[0].v[j], R @ v[part][:3], atol=1e-12)


def test_tip_force_is_in_the_frame_of_its_body():
    team, z, truth = case()
    model, m = PinocchioTeam(team), ideal()
    model.constraint_residual(z)  # places all frames
    turns = [model.data.oMf[f].rotation for f in model.tips]
    expected = [R.T @ lam for R, lam in zip(turns, np.asarray(truth.lam[0]).reshape(-1, 3), strict=True)]
    np.testing.assert_allclose(np.asarray(m.agents[0].lam).reshape(-1, 3), expected, atol=1e-10)


def test_accelerometer_measures_specific_force():
    """An accelerometer measures the rate of its velocity minus gravity."""
    team, z, _ = case()
    f, h, u = zero_residual(team), 1e-4, inputs()
    step = jax.jit(lambda z, dt: contact_dynamics.rkmk4_step(team, z, u, lambda z, _: f, dt))
    ends = [
        sense(team, sensors(), no_bias(team), sensed_state(team, step(z, jnp.array(s))), no_noise(team))
        for s in (h, -h)
    ]
    m = ideal()
    for now, ahead, behind in zip(
        (*(jax.tree.map(lambda x, j=j: x[j], m.agents[0]) for j in (0, 1)), m.payload),
        *((*(jax.tree.map(lambda x, j=j: x[j], e.agents[0]) for j in (0, 1)), e.payload) for e in ends),
        strict=True,
    ):
        rate = (np.asarray(ahead.v) - np.asarray(behind.v)) / (2 * h)
        np.testing.assert_allclose(now.a, np.asarray(now.R).T @ (rate - np.asarray(team.gravity)), atol=1e-4)


def test_noise_depends_on_key_and_structure_only():
    team, _, _ = case()
    other = dataclasses.replace(team, gravity=2 * team.gravity)
    a, b, c = (sensors_module.sample_noise(t, jax.random.key(k), 5) for t, k in ((team, 0), (other, 0), (team, 1)))
    for x, y, z in zip(*map(jax.tree.leaves, (a, b, c)), strict=True):
        np.testing.assert_array_equal(x, y)
        same = np.asarray(x) == np.asarray(z)
        assert not same.all() if set(np.unique(x)) == {-1, 1} else not same.any()  # random signs may agree


# The calibration rig --------------------------------------------------------------------------------------------------


def test_rig_reports_true_state_and_bounded_label_errors():
    """The rig reports the true state and labels with errors of the stated magnitude and random sign."""
    team, z, truth = case()
    rng = np.random.default_rng(9)
    rig = jax.tree.map(lambda x: jnp.array(rng.uniform(0.1, 1, x.shape)), zero_residual(team))
    held = sensors_module.CalibrationRig(label_error=rig)
    noise, m = held.sample_noise(team, jax.random.key(2), TICKS), ideal()
    sample = jax.vmap(lambda drawn: held.apply(m, truth, CLOCK, (), drawn)[0])(noise).rig
    for reported, state in zip(jax.tree.leaves(sample.state), jax.tree.leaves(z), strict=True):
        np.testing.assert_array_equal(reported, np.broadcast_to(state, reported.shape))
    signs = []
    for reported, f, e in zip(*map(jax.tree.leaves, (sample.residual, truth.f, rig)), strict=True):
        error = np.asarray(reported) - np.asarray(f)
        np.testing.assert_allclose(np.abs(error), np.broadcast_to(e, error.shape), rtol=1e-12)
        signs.append(np.sign(error).reshape(TICKS, -1))
    signs = np.concatenate(signs, axis=1)
    # independent fair signs at every step and output: means and products within five standard deviations
    assert np.abs(signs.mean(0)).max() < 5 / np.sqrt(TICKS)
    products = signs.T @ signs / TICKS - np.eye(signs.shape[1])
    assert np.abs(products).max() < 5 / np.sqrt(TICKS)
    assert np.abs((signs[1:] * signs[:-1]).mean(0)).max() < 5 / np.sqrt(TICKS)


def test_rig_without_error_reports_the_residual():
    team, _, truth = case()
    held, none = sensors_module.CalibrationRig(label_error=zero_residual(team)), zero_residual(team)
    m, _ = held.apply(ideal(), truth, CLOCK, (), none)
    jax.tree.map(np.testing.assert_array_equal, m.rig.residual, truth.f)


# Intermittent measurements and bias walks -----------------------------------------------------------------------------


def apply_to_motion(of: sensors_module.SensorModel, ticks: int = 400, seed: int = 0) -> Measurement:
    """Return the measurements of a payload that moves at one meter per second along x, step by step."""
    team, _, truth = case()
    first = ideal()

    def at(k: jax.Array) -> Measurement:
        p = first.payload.p + jnp.array([1.0, 0, 0]) * k * CLOCK.dt
        return dataclasses.replace(first, payload=dataclasses.replace(first.payload, p=p))

    def step(state: object, now: tuple) -> tuple:
        k, noise = now
        m, state = of.apply(at(k), truth, ControlClock(t=k * CLOCK.dt, dt=CLOCK.dt), state, noise)
        return state, m

    steps = jnp.arange(ticks, dtype=float)
    noise = of.sample_noise(team, jax.random.key(seed), ticks)
    return jax.jit(lambda: jax.lax.scan(step, of.init(at(jnp.array(0.0))), (steps, noise))[1])()


def intermittent(
    of: tuple[str, ...], every: float = 0.002, loss: float = 0.0, until: float = np.inf, delay: int = 0
) -> sensors_module.Intermittent:
    numbers = {
        name: jnp.array(x)
        for name, x in {"sample_period": every, "dropout_probability": loss, "failure_time": until}.items()
    }
    return sensors_module.Intermittent(channels=of, delay=delay, **numbers)


def test_failed_sensor_holds_its_last_reading():
    m = apply_to_motion(intermittent(("payload.p",), until=0.1))
    x, k = np.asarray(m.payload.p[:, 0] - ideal().payload.p[0]), np.arange(400)
    np.testing.assert_allclose(x, 0.002 * np.minimum(k, 49), atol=1e-12)
    np.testing.assert_allclose(m.measurement_age_s["payload.p"], 0.002 * np.maximum(k - 49, 0), atol=1e-12)


@pytest.mark.parametrize("delay", [0, 3])
def test_slow_sensor_holds_its_reading_and_reports_its_age(delay):
    """A slow sensor holds its last reading and reports its age."""
    of = intermittent(("payload.p",), every=0.02, delay=delay)
    m = apply_to_motion(of)
    x = np.asarray(m.payload.p[:, 0] - ideal().payload.p[0])
    k = np.arange(len(x))
    last = np.maximum((k - delay) // 10, 0) * 10
    np.testing.assert_allclose(x, 0.002 * last, atol=1e-12)
    seen = k >= delay
    assert set(m.measurement_age_s) == {"payload.p"}
    np.testing.assert_allclose(np.asarray(m.measurement_age_s["payload.p"])[seen], 0.002 * (k - last)[seen], atol=1e-12)
    np.testing.assert_array_equal(m.payload.v, np.broadcast_to(ideal().payload.v, m.payload.v.shape))


def test_dropout_rate_is_as_stated():
    of = intermittent(("payload.p",), loss=0.3)
    x = np.asarray(apply_to_motion(of, TICKS).payload.p[:, 0])
    came = (np.diff(x) > 0).mean()
    assert abs(came - 0.7) < 5 * np.sqrt(0.21 / TICKS)


def test_sensor_with_full_dropout_holds_the_first_reading():
    of = intermittent(("payload.p", "agents.x"), loss=1.0)
    m = apply_to_motion(of)
    np.testing.assert_array_equal(m.payload.p, np.broadcast_to(ideal().payload.p, m.payload.p.shape))


@pytest.mark.long
def test_bias_random_walk_grows_with_root_of_time():
    """A bias walk grows with the root of time and rotates attitudes about their own axes."""
    rate, ticks = 0.01, 100
    of = sensors_module.BiasRandomWalk(
        channels=("payload.v", "agents.lam", "payload.R"),
        random_walk_density=jnp.array(rate),
        initial_bias_std=jnp.array(rate),
    )
    runs = [apply_to_motion(of, ticks, seed) for seed in range(40)]
    ends = np.array([np.asarray(m.payload.v[-1] - ideal().payload.v) for m in runs])
    ends = np.concatenate([ends.ravel(), *(np.ravel(m.agents[0].lam[-1] - ideal().agents[0].lam) for m in runs)])
    expected = rate * np.sqrt(1 + (ticks - 1) * 0.002)
    assert abs(ends.std() / expected - 1) < 5 / np.sqrt(2 * len(ends))
    R, R_0 = np.asarray(runs[0].payload.R[-1]), np.asarray(ideal().payload.R)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert 0 < np.linalg.norm(Rotation.from_matrix(R_0.T @ R).as_rotvec()) < 8 * expected
    steps = np.diff(np.asarray(runs[0].payload.v), axis=0)
    assert abs((steps[1:] * steps[:-1]).mean()) < 5 * steps.var() / np.sqrt(steps.size)  # independent steps
