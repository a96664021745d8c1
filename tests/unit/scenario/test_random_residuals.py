"""Tests of random residual functions of known norm against sums over their kernels."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import gp, scenario
from colift.models.state import ResidualForces, State
from colift.onboard.learning import residual_model
from colift.scenario import Scenario, ScenarioError, experiment, initial_states, random_residuals, team, trajectories
from tests.support.varied_scenarios import changed

SEEDED = {"rkhs_norm": 1.7}
FEW = {"num_centers": 6, "center_std": 0.0}


def drawn(**sections: object) -> tuple[residual_model.ResidualModel, ResidualForces, Scenario]:
    """The functions of `certified` with few kernels on the reference."""
    s = changed("certified", **({"random_residual": SEEDED} | sections))
    truth, _ = team.team(s)
    found = random_residuals.sample_residuals(s, truth, initial_team(), **FEW)
    assert found is not None
    return *found, s


@functools.cache
def initial_team() -> State:
    """The team of `certified` in its initial state."""
    s = scenario.load_scenario("certified")
    return initial_states.initial_state(s, team.team(s)[0])


def functions(model: residual_model.ResidualModel) -> list[gp.GPPosterior]:
    """Return the functions of the bodies as a list."""
    (group,) = model.agents
    return [model.payload, *(jax.tree.map(lambda x, j=j: x[j], group) for j in range(len(group.num_points)))]


def correlations(X: np.ndarray, Z: np.ndarray, ls: np.ndarray) -> np.ndarray:
    """Return `exp(-|x - z|^2 / 2)` in length-scales, entry by entry."""
    return np.exp(-0.5 * (((X[:, None] - Z[None]) / ls) ** 2).sum(-1))


@pytest.mark.parametrize("spread", [0.0, 0.3])
def test_every_output_has_the_stated_norm(spread):
    """Every output of every body has exactly the stated norm."""
    s = changed("certified", random_residual=SEEDED)
    truth, _ = team.team(s)
    found = random_residuals.sample_residuals(s, truth, initial_team(), num_centers=6, center_std=spread)
    assert found is not None
    for f, outputs in zip(functions(found[0]), (6, 9, 9), strict=True):
        assert int(f.num_points) == 6
        X, alpha = np.asarray(f.X)[:6], np.asarray(f.alpha)[:, :6]
        for i in range(outputs):
            K = float(f.hyper.signal_variance[i]) * correlations(X, X, np.asarray(f.hyper.lengthscales)[i])
            np.testing.assert_allclose(np.sqrt(alpha[i] @ K @ alpha[i]), 1.7, rtol=1e-9)
            values = K @ alpha[i]
            assert np.abs(values).max() <= 1.7 * float(f.hyper.signal_variance[i]) ** 0.5


def test_functions_depend_on_the_seed_only():
    first, deviation, _ = drawn()
    again, _, _ = drawn(certificate={"rkhs_norm": 9.0})
    other, _, _ = drawn(seed=1)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert not np.isclose(first.payload.alpha[:, :6], other.payload.alpha[:, :6]).any()
    assert not np.isclose(first.agents[0].X[:, :6, 9:12], other.agents[0].X[:, :6, 9:12]).any()
    agents = np.asarray(first.agents[0].alpha)[:, :, :6]
    assert not np.isclose(agents[0], agents[1]).any()  # unlike agents
    assert all((np.asarray(x) > 0).all() for x in jax.tree.leaves(deviation))


def test_kernel_centers_are_on_the_reference():
    """On the Lissajous figure, after its ramp: `((p - c) / A)^2 + (v T / 2 pi A)^2 = 1` on each axis."""
    model, _, s = drawn()
    payload, front, rear = (np.asarray(f.X)[:6] for f in functions(model))
    c, A, T = (np.array(x) for x in (s.reference.center_m, s.reference.amplitude_m, s.reference.period_s))
    unit = ((payload[:, :3] - c) / A) ** 2 + (payload[:, 3:6] * T / (2 * np.pi * A)) ** 2
    np.testing.assert_allclose(unit, 1, atol=1e-9)
    np.testing.assert_allclose(payload[:, 18], np.linalg.norm(payload[:, 3:6], axis=1), rtol=1e-9)
    np.testing.assert_allclose(payload[:, 6:15], np.tile(np.eye(3).ravel(), (6, 1)), atol=1e-12)
    shift = payload[:, :3] - np.asarray(initial_team().payload.p)
    for j, x in enumerate((front, rear)):
        np.testing.assert_allclose(x[:, 9:12], np.asarray(initial_team().agents[0].x)[j] + shift, atol=1e-12)
        np.testing.assert_allclose(x[:, 18:21], payload[:, 3:6], atol=1e-12)
        np.testing.assert_allclose(x[:, 12:15], np.tile(initial_team().agents[0].r[j], (6, 1)), atol=1e-12)
    scattered = random_residuals.sample_residuals(s, team.team(s)[0], initial_team(), num_centers=6, center_std=0.5)
    assert scattered is not None
    off = (np.asarray(scattered[0].payload.X)[:6] - payload) / np.asarray(model.payload.hyper.lengthscales)[0]
    assert 0.3 < off.std() < 0.7  # of 120 values with standard deviation 0.5


def test_deviations_are_those_along_the_reference():
    model, deviation, s = drawn()
    t = np.linspace(s.reference.ramp_time_s, s.duration_s, 400)
    A, T, phase = (np.array(x) for x in (s.reference.amplitude_m, s.reference.period_s, s.reference.phase_deg))
    angle = 2 * np.pi * t[:, None] / T + np.deg2rad(phase)
    p, v = s.reference.center_m + A * np.sin(angle), 2 * np.pi * A / T * np.cos(angle)
    x = np.concatenate([p, v, np.tile(np.eye(3).ravel(), (400, 1)), np.zeros((400, 3))], axis=1)
    x = np.concatenate([x, np.linalg.norm(v, axis=1, keepdims=True), np.full((400, 1), 1e-6)], axis=1)
    f = model.payload
    X, ls = np.asarray(f.X)[:6], np.asarray(f.hyper.lengthscales)
    stated = np.concatenate([deviation.payload.F, deviation.payload.tau])
    for i in range(6):
        values = float(f.hyper.signal_variance[i]) * correlations(x, X, ls[i]) @ np.asarray(f.alpha)[i, :6]
        np.testing.assert_allclose(stated[i], values.std(), rtol=1e-9)


def test_the_world_has_the_residual_and_the_rig_s_errors():
    s = scenario.load_scenario("certified")
    found = random_residuals.sample_residuals(s, team.team(s)[0], initial_team())
    assert found is not None
    model, deviation = found
    assert int(model.payload.num_points) == 30
    c3 = experiment.make_experiment(s, "C3")
    (rig,) = c3.world.sensor_models
    jax.tree.map(lambda e, of: np.testing.assert_allclose(e, 0.1 * of), rig.label_error, deviation)
    jax.tree.map(
        np.testing.assert_array_equal,
        c3.world.disturbances.state_functions,
        (residual_model.ResidualFunction(model=model),),
    )


def test_missing_section_or_norm():
    """Without the section nothing is drawn, and without a norm it is an error."""
    s = scenario.load_scenario("paper")
    truth, _ = team.team(s)
    assert random_residuals.sample_residuals(s, truth, initial_team()) is None
    assert experiment.make_experiment(s, "C1").world.disturbances.state_functions == ()
    with pytest.raises(ScenarioError):
        changed("certified", random_residual={"rkhs_norm": 0})


means = jax.jit(jax.vmap(gp.mean, (None, 0)))


def test_outputs_with_small_variation_are_redrawn():
    """Variation: half of maximum minus minimum along the reference, in signal standard deviations."""
    free, _, s = drawn(random_residual=SEEDED | {"min_variation": 0.0})
    constrained, _, _ = drawn(random_residual=SEEDED | {"min_variation": 0.5})
    t = jnp.linspace(s.reference.ramp_time_s, s.duration_s, 150)  # other times than those of the drawing
    payload, (agents,) = random_residuals._team_features(
        trajectories.make_reference(s), free.features, initial_team(), t
    )
    few = 0
    for f, g, x in zip(functions(free), functions(constrained), (payload, agents[:, 0], agents[:, 1]), strict=True):
        before, after = (np.ptp(means(h, x), axis=0) / 2 / np.sqrt(h.hyper.signal_variance) for h in (f, g))
        assert (after > 0.49).all()
        enough = before > 0.51
        np.testing.assert_array_equal(np.asarray(f.alpha)[enough], np.asarray(g.alpha)[enough])
        few += (before < 0.49).sum()
    assert few


def test_unattainable_variation_is_refused(monkeypatch):
    monkeypatch.setattr(random_residuals, "MAX_ATTEMPTS", 3)
    with pytest.raises(ScenarioError, match=r"certified: random_residual\.min_variation: after 3 draws"):
        drawn(random_residual=SEEDED | {"rkhs_norm": 0.1, "min_variation": 0.9})
