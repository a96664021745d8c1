"""Tests of disturbances: virtual work by finite differences of independent kinematics, and properties of each model."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from colift import gp
from colift.math.pytree import pytree
from colift.models.state import PayloadState, State
from colift.onboard.learning import residual_model
from colift.simulation import disturbances
from tests.support import random_teams as teams
from tests.support.pinocchio_team import take

STRUCTURE = ((teams.SEVEN, 2),)
seeds = st.integers(0, 10**6)
forces = jax.jit(disturbances.initial_forces)
on_payload = jax.jit(
    lambda mounts, q: disturbances.payload_wrench(mounts, q, NOW, tuple(m.model.init() for m in mounts))
)
NOW = jnp.zeros(())


def vector(rng: np.random.Generator, size: float = 1.0) -> jax.Array:
    """Three normal numbers."""
    return jnp.array(size * rng.normal(size=3))


def scalar(rng: np.random.Generator) -> jax.Array:
    """A number between a half and two."""
    return jnp.array(rng.uniform(0.5, 2))


def wind(rng: np.random.Generator) -> disturbances.Wind:
    """Drag in a wind with two gusts."""
    gust, wave = (jnp.array(rng.normal(size=(2, 3))) for _ in range(2))
    phase = jnp.array(rng.normal(size=2))
    linear, quadratic = scalar(rng), scalar(rng)
    return disturbances.Wind(linear=linear, quadratic=quadratic, mean=vector(rng), gust=gust, wave=wave, phase=phase)


LAWS = {
    "constant": lambda rng: disturbances.ConstantWrench(force=vector(rng), torque=vector(rng)),
    "wind": wind,
    "tether": lambda rng: disturbances.Tether(anchor=vector(rng, 3), stiffness=scalar(rng), length=jnp.array(0.3)),
    "jet": lambda rng: disturbances.GaussianJet(force=vector(rng), center=vector(rng), width=scalar(rng)),
    "rotor_bias": lambda rng: disturbances.RotorBias(thrust=scalar(rng), torque=vector(rng)),
}


def motion(rng: np.random.Generator, **parts: object) -> disturbances.PointKinematics:
    """Return a random motion of a point, with some values given."""
    at = {"x": vector(rng), "v": vector(rng), "R": jnp.array(teams.rotation(rng)), "omega": vector(rng)}
    return disturbances.PointKinematics(**(at | parts))


# Virtual work ---------------------------------------------------------------------------------------------------------


def body_pose(agent: SimpleNamespace, R: np.ndarray, x: np.ndarray, r: np.ndarray, body: int) -> tuple:
    """Return attitude and origin of a body in the world, joint by joint in NumPy, with the center of mass at x."""
    frames = [(np.eye(3), np.zeros(3))]
    for k, parent in enumerate(agent.tree.parents):
        up, at = frames[parent]
        axis = agent.joint_axis[k]
        slides = agent.tree.prismatic[k]
        turn = np.eye(3) if slides else Rotation.from_rotvec(r[k] * axis).as_matrix()
        shift = agent.joint_position[k] + agent.joint_rotation[k] @ axis * (r[k] if slides else 0)
        frames.append((up @ agent.joint_rotation[k] @ turn, at + up @ shift))
    centers = np.array([at + up @ c for (up, at), c in zip(frames, agent.com, strict=True)])
    s = agent.mass @ centers / agent.mass.sum()
    up, at = frames[body]
    return R @ up, x + R @ (at - s)


def test_generalized_force_has_the_virtual_work():
    """The generalized force does the work of its force and torque."""
    rng = np.random.default_rng(5)
    team, z = teams.team(rng, STRUCTURE), teams.free_state(rng, STRUCTURE)
    h = 1e-6
    for body in (0, 3, 7):
        force, torque, point = rng.normal(size=(3, 3))
        model = disturbances.ConstantWrench(force=jnp.array(force), torque=jnp.array(torque))
        mount = disturbances.AgentDisturbance(
            body=body,
            model=for_two_agents(model),
            point=jnp.tile(jnp.array(point), (2, 1)),
            active=jnp.array([1.0, 0.0]),
        )
        f = forces(disturbance_set((mount,)), team, z).agents[0]
        assert not any(np.any(leaf[1]) for leaf in jax.tree.leaves(f))  # inactive for the second agent
        agent, q = take(team.agent_groups[0], 0), take(z.agents[0], 0)

        def work(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Point of attack and attitude of the body after a small motion (x, theta, r)."""
            R = q.R @ Rotation.from_rotvec(d[3:6]).as_matrix()  # noqa: B023
            turned, origin = body_pose(agent, R, q.x + d[:3], q.r + d[6:], body)  # noqa: B023
            return origin + turned @ point, turned  # noqa: B023

        _, at_rest = work(np.zeros(13))
        for e, of_ours in zip(np.eye(13), np.concatenate([f.f_x[0], f.f_w[0], f.f_r[0]]), strict=True):
            (ahead, R_ahead), (behind, R_behind) = work(h * e), work(-h * e)
            spin = at_rest.T @ (R_ahead - R_behind) / (2 * h)  # hat of the body's rate in its own frame
            rate = np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]]) / 2
            np.testing.assert_allclose(of_ours, force @ (ahead - behind) / (2 * h) + torque @ rate, atol=1e-8)


def for_two_agents(model: disturbances.DisturbanceModel) -> disturbances.DisturbanceModel:
    """Return the model with the leading axis of a group of two."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (2, *x.shape)), model)


def disturbance_set(mounts: tuple = (), payload: tuple = ()) -> disturbances.DisturbanceSet:
    """Return these disturbances on the agents of `STRUCTURE` and on the payload, without friction."""
    none = jnp.zeros((2, 7))
    friction = disturbances.JointFriction(viscous=none, coulomb=none, speed=none + 1)
    return disturbances.DisturbanceSet(payload=payload, agents=(mounts,), joints=(friction,))


def test_point_velocity_is_consistent_with_power():
    """The power of the generalized force equals the power at the point."""
    rng = np.random.default_rng(6)
    team, z = teams.team(rng, STRUCTURE), teams.free_state(rng, STRUCTURE)
    none = jnp.zeros((0, 3))
    drag = disturbances.Wind(
        linear=jnp.array(1.0), quadratic=jnp.array(0.0), mean=jnp.zeros(3), gust=none, wave=none, phase=none[:, 0]
    )
    point, h = rng.normal(size=(2, 3)), 1e-6
    mount = disturbances.AgentDisturbance(
        body=5, model=for_two_agents(drag), point=jnp.array(point), active=jnp.ones(2)
    )
    f = forces(disturbance_set((mount,)), team, z).agents[0]
    for j in range(2):
        agent, q = take(team.agent_groups[0], j), take(z.agents[0], j)
        ends = []
        for s in (h, -h):
            R = q.R @ Rotation.from_rotvec(s * q.omega).as_matrix()
            turned, origin = body_pose(agent, R, q.x + s * q.v, q.r + s * q.r_dot, 5)
            ends.append(origin + turned @ point[j])
        v = (ends[0] - ends[1]) / (2 * h)
        power = f.f_x[j] @ q.v + f.f_w[j] @ q.omega + f.f_r[j] @ q.r_dot
        np.testing.assert_allclose(f.f_x[j], -v, atol=1e-8)
        np.testing.assert_allclose(power, -(v @ v), atol=1e-7)


@pytest.mark.parametrize("name", LAWS)
def test_payload_wrench_has_the_virtual_work(name):
    rng = np.random.default_rng(7)
    q, point, h = teams.payload_state(rng), rng.normal(size=3), 1e-6
    model = LAWS[name](rng)
    W = on_payload((disturbances.PayloadDisturbance(model=model, point=jnp.array(point)),), q)
    R = np.asarray(q.R)
    v = q.v + R @ np.cross(q.omega, point)
    force, torque = model(disturbances.PointKinematics(x=q.p + q.R @ point, v=v, R=q.R, omega=q.omega), NOW, ())
    np.testing.assert_allclose(W.F, force, atol=1e-12)
    for e, of_ours in zip(np.eye(3), W.tau, strict=True):
        ahead, behind = (R @ Rotation.from_rotvec(s * e).as_matrix() @ point for s in (h, -h))
        np.testing.assert_allclose(of_ours, force @ (ahead - behind) / (2 * h) + torque @ e, atol=1e-8)


def test_sources_add_up():
    rng = np.random.default_rng(8)
    q = teams.payload_state(rng)
    mounts = tuple(disturbances.PayloadDisturbance(model=make(rng), point=vector(rng)) for make in LAWS.values())
    total = on_payload(mounts, q)
    each = [on_payload((mount,), q) for mount in mounts]
    np.testing.assert_allclose(total.F, sum(W.F for W in each), atol=1e-12)
    np.testing.assert_allclose(total.tau, sum(W.tau for W in each), atol=1e-12)


# Disturbance models ---------------------------------------------------------------------------------------------------


@given(seed=seeds)
def test_drag_dissipates_relative_to_the_air(seed):
    rng = np.random.default_rng(seed)
    model, at = wind(rng), motion(rng)
    air = np.asarray(model.mean) + np.asarray(model.gust).T @ np.sin(
        np.asarray(model.wave) @ np.asarray(at.x) + model.phase
    )
    relative = at.v - air
    force, torque = jax.jit(lambda model, at: model(at, NOW, ()))(model, at)
    assert not np.any(torque)
    assert force @ relative < 0
    speed = np.linalg.norm(relative)
    np.testing.assert_allclose(force, -(model.linear + model.quadratic * speed) * relative, atol=1e-5)
    drag_free, _ = model(dataclasses.replace(at, v=jnp.array(air)), NOW, ())
    np.testing.assert_allclose(drag_free, 0, atol=1e-12)


def test_the_tether_is_conservative():
    """Its force is the gradient of `-k (d - l)^2 / 2`, so its work around any loop is zero."""
    rng = np.random.default_rng(9)
    model = disturbances.Tether(anchor=jnp.zeros(3), stiffness=jnp.array(2.0), length=jnp.array(0.8))
    force = jax.jit(jax.vmap(lambda x: model(motion(rng, x=x), NOW, ())[0]))
    s = 2 * np.pi * np.arange(2000) / 2000
    loop = np.stack([np.cos(s) + 0.3, 0.7 * np.sin(2 * s), 0.4 * np.sin(s + 1)], axis=1)  # slack and taut
    step = np.stack([-np.sin(s), 1.4 * np.cos(2 * s), 0.4 * np.cos(s + 1)], axis=1) * (s[1] - s[0])
    f = np.asarray(force(jnp.array(loop)))
    distance = np.linalg.norm(loop, axis=1)
    assert distance.min() < 0.8 < distance.max()
    assert not f[distance < 0.8].any()
    # the force has a kink where the tether becomes slack: the trapezoidal rule is of second order, (2 pi / 2000)^2
    assert abs((f * step).sum()) < 1e-5 * np.abs((f * step).sum(1)).sum()
    x, h = np.array([0.6, 0.9, -0.4]), 1e-5
    energy = lambda x: max(np.linalg.norm(x) - 0.8, 0.0) ** 2  # noqa: E731  k / 2 = 1
    gradient = [(energy(x + h * e) - energy(x - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(force(jnp.array([x]))[0], -np.array(gradient), atol=1e-8)


@given(seed=seeds)
def test_jet_profile(seed):
    """A jet is smooth, strongest at its center, and 0.61 of that at one standard deviation."""
    rng = np.random.default_rng(seed)
    model = LAWS["jet"](rng)
    away = rng.normal(size=3)
    away *= float(model.width) / np.linalg.norm(away)
    np.testing.assert_allclose(model(motion(rng, x=model.center), NOW, ())[0], model.force, atol=1e-12)
    np.testing.assert_allclose(
        model(motion(rng, x=model.center + jnp.array(away)), NOW, ())[0], np.exp(-0.5) * model.force
    )


@pytest.mark.parametrize("name", LAWS)
def test_models_are_smooth(name):
    rng = np.random.default_rng(11)
    model, at, h = LAWS[name](rng), motion(rng), 1e-6
    of_v = jax.jacfwd(lambda v: model(dataclasses.replace(at, v=v), NOW, ())[0])(at.v)
    of_x = jax.jacfwd(lambda x: model(dataclasses.replace(at, x=x), NOW, ())[0])(at.x)
    for jacobian, field in ((of_v, "v"), (of_x, "x")):
        for e, column in zip(np.eye(3), jacobian.T, strict=True):
            ends = [
                model(dataclasses.replace(at, **{field: getattr(at, field) + jnp.array(s * e)}), NOW, ())[0]
                for s in (h, -h)
            ]
            np.testing.assert_allclose(column, (ends[0] - ends[1]) / (2 * h), atol=1e-6)
    still = dataclasses.replace(at, v=jnp.zeros(3), x=jnp.zeros(3))
    assert np.isfinite(jax.jacfwd(lambda v: model(dataclasses.replace(still, v=v), NOW, ())[0])(still.v)).all()


def test_rotor_bias_acts_along_body_z():
    rng = np.random.default_rng(12)
    at = motion(rng)
    model = disturbances.RotorBias(thrust=jnp.array(-1.5), torque=jnp.array([0.1, 0.2, 0.3]))
    force, torque = model(at, NOW, ())
    np.testing.assert_allclose(at.R.T @ force, [0, 0, -1.5], atol=1e-12)
    np.testing.assert_allclose(torque, [0.1, 0.2, 0.3])


def test_joint_friction_opposes_every_joint():
    rng = np.random.default_rng(13)
    team, z = teams.team(rng, STRUCTURE), teams.free_state(rng, STRUCTURE)
    viscous, coulomb = (jnp.array(rng.uniform(0.1, 1, (2, 7))) for _ in range(2))
    friction = disturbances.JointFriction(viscous=viscous, coulomb=coulomb, speed=jnp.full((2, 7), 1e-3))
    f = forces(dataclasses.replace(disturbance_set(), joints=(friction,)), team, z).agents[0]
    r_dot = z.agents[0].r_dot
    assert np.all(f.f_r * r_dot < 0)
    fast = np.abs(r_dot) > 0.01  # dry friction has its full magnitude
    np.testing.assert_allclose(f.f_r[fast], (-viscous * r_dot - coulomb * jnp.sign(r_dot))[fast], atol=1e-8)
    assert not np.any(f.f_x)
    assert not np.any(f.f_w)


@pytest.mark.parametrize("name", LAWS)
def test_shipped_models_are_time_invariant(name):
    assert LAWS[name](np.random.default_rng(0)).time_invariant


@pytree
class TimeVarying(disturbances.ConstantWrench):
    """Disturbance model that declares a dependence on time."""

    time_invariant: ClassVar[bool] = False


def test_active_time_varying_sources_are_named_once():
    rng = np.random.default_rng(15)
    steady = disturbances.PayloadDisturbance(name="steady", model=wind(rng), point=vector(rng))
    turning = TimeVarying(force=vector(rng), torque=vector(rng))
    on_load = [disturbances.PayloadDisturbance(name=name, model=turning, point=vector(rng)) for name in ("gust", "")]

    def on_agents(name: str, active: list[float]) -> disturbances.AgentDisturbance:
        model = for_two_agents(turning)
        return disturbances.AgentDisturbance(
            body=0, name=name, model=model, point=jnp.ones((2, 3)), active=jnp.array(active)
        )

    def varying(
        *payload: disturbances.PayloadDisturbance, agents: tuple[disturbances.AgentDisturbance, ...] = ()
    ) -> tuple[str, ...]:
        return disturbances.time_varying_names(dataclasses.replace(disturbance_set(agents), payload=payload))

    assert varying() == ()
    assert varying(steady) == ()
    assert varying(steady, *on_load) == ("gust", "TimeVarying")
    assert varying(agents=(on_agents("fan", [0.0, 0.0]),)) == ()  # inactive for all agents
    assert varying(agents=(on_agents("fan", [0.0, 1.0]), on_agents("fan", [1.0, 0.0]))) == ("fan",)
    assert varying(on_load[0], agents=(on_agents("gust", [1.0, 1.0]),)) == ("gust",)


def test_time_varying_wind():
    """Before the turn, and at each period of a gust, it is the steady wind; afterwards the wind with the mean
    rotated.
    """
    rng = np.random.default_rng(0)
    steady = wind(rng)
    still = {
        "phase_rate": jnp.zeros(2),
        "turn_angle": jnp.array(0.0),
        "start": jnp.array(2.0),
        "ramp_time": jnp.array(0.5),
    }
    at = motion(rng)
    model = jax.jit(lambda model, t: model(at, t, ())[0])
    turning = disturbances.TimeVaryingWind(base_wind=steady, **still | {"turn_angle": jnp.array(np.pi / 2)})
    np.testing.assert_allclose(model(turning, jnp.array(1.9)), model(steady, NOW), rtol=1e-12)
    x, y, z = np.asarray(steady.mean)
    turned = dataclasses.replace(steady, mean=jnp.array([-y, x, z]))
    np.testing.assert_allclose(model(turning, jnp.array(2.5)), model(turned, NOW), rtol=1e-9)
    halfway = model(turning, jnp.array(2.25))
    half = Rotation.from_rotvec([0, 0, np.pi / 4]).apply([x, y, z])
    np.testing.assert_allclose(halfway, model(dataclasses.replace(steady, mean=jnp.array(half)), NOW), rtol=1e-9)
    gusting = disturbances.TimeVaryingWind(
        base_wind=steady, **still | {"phase_rate": jnp.array([2 * np.pi / 3, 2 * np.pi / 6])}
    )
    np.testing.assert_allclose(model(gusting, jnp.array(6.0)), model(steady, NOW), rtol=1e-9)
    assert np.abs(model(gusting, jnp.array(1.0)) - model(steady, NOW)).max() > 1e-3
    assert not gusting.time_invariant


def test_no_sources_give_zero_residual():
    rng = np.random.default_rng(14)
    z: State = teams.free_state(rng, STRUCTURE)
    f = forces(disturbance_set(), teams.team(rng, STRUCTURE), z)
    assert not any(np.any(leaf) for leaf in jax.tree.leaves(f))
    load: PayloadState = z.payload
    assert not np.any(on_payload((), load).F)


# Functions ------------------------------------------------------------------------------------------------------------


def test_functions_add_their_value_at_the_true_state():
    """Each output is a sum of kernels, term by term in NumPy; two functions and a wind."""
    rng = np.random.default_rng(11)
    team, z = teams.team(rng, STRUCTURE), teams.free_state(rng, STRUCTURE)
    blow = disturbances.PayloadDisturbance(model=wind(rng), point=vector(rng))
    named = dataclasses.replace(disturbance_set(), payload=(blow,))
    joints = team.agent_groups[0].tree.joints

    def drawn() -> tuple[residual_model.ResidualModel, list[tuple]]:
        parts = []

        def one(outputs: int, dimensions: int) -> gp.GPPosterior:
            s, ls = rng.uniform(0.5, 2, outputs), rng.uniform(2, 4, (outputs, dimensions))
            hyper = gp.make_hyperparameters(s, ls, 0.01)
            Z, w = rng.normal(size=(4, dimensions)), rng.normal(size=(outputs, 4))
            parts.append((s, ls, Z, w))
            return gp.from_expansion(hyper, Z, w)

        payload, agents = one(6, 20), [one(6 + joints, 18 + 2 * joints) for _ in range(2)]
        group = jax.tree.map(lambda *x: jnp.stack(x), *agents)
        return residual_model.ResidualModel(payload=payload, agents=(group,), inertial_parameters=jnp.zeros(10)), parts

    def value(part: tuple, x: np.ndarray) -> np.ndarray:
        s, ls, Z, w = part
        return np.array(
            [
                s[i] * sum(w[i, k] * np.exp(-0.5 * (((x - Z[k]) / ls[i]) ** 2).sum()) for k in range(4))
                for i in range(len(s))
            ]
        )

    (first, parts), (second, others) = drawn(), drawn()
    found = forces(
        dataclasses.replace(
            named,
            state_functions=(
                residual_model.ResidualFunction(model=first),
                residual_model.ResidualFunction(model=second),
            ),
        ),
        team,
        z,
    )
    alone = forces(named, team, z)
    q = jax.tree.map(np.asarray, z.payload)
    speeds = [np.linalg.norm(q.v), np.linalg.norm(q.omega)]
    x = np.concatenate([q.p, q.v, q.R.ravel(), q.omega, speeds])
    added = np.concatenate([found.payload.F - alone.payload.F, found.payload.tau - alone.payload.tau])
    np.testing.assert_allclose(added, value(parts[0], x) + value(others[0], x), atol=1e-9)
    assert np.abs(added).max() > 0.05
    for j in range(2):
        q = take(z.agents[0], j)
        x = np.concatenate([q.R.ravel(), q.x, q.r, q.omega, q.v, q.r_dot])
        f = take(found.agents[0], j)
        expected = value(parts[1 + j], x) + value(others[1 + j], x)
        np.testing.assert_allclose(np.concatenate([f.f_x, f.f_w, f.f_r]), expected, atol=1e-9)
