"""Splines through tables: deviation, acceleration, noise, ends, invariance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.trajectories import pose_spline, smoothing_spline

along = jax.jit(jax.vmap(lambda path, t: path.evaluate(t), (None, 0)))
ROWS = 8288


def position(t: np.ndarray) -> np.ndarray:
    return np.stack([2 * np.sin(0.7 * t), 1.5 * np.cos(0.9 * t), 2 + 0.5 * np.sin(1.3 * t)], axis=1)


def acceleration(t: np.ndarray) -> np.ndarray:
    rates = np.array([0.7, 0.9, 1.3]) ** 2
    return -rates * np.stack([2 * np.sin(0.7 * t), 1.5 * np.cos(0.9 * t), 0.5 * np.sin(1.3 * t)], axis=1)


def attitude(t: np.ndarray) -> Rotation:
    """Several turns of yaw with roll and pitch."""
    return Rotation.from_euler("ZYX", np.stack([0.5 * t, 0.3 * np.sin(1.1 * t), 0.2 * np.cos(0.8 * t)], axis=1))


def flat(rows: int) -> np.ndarray:
    return np.broadcast_to(np.eye(3), (rows, 3, 3))


def path_of(*table: np.ndarray, **stated: float) -> tuple[pose_spline.PoseSpline, smoothing_spline.SampleFit]:
    fit = smoothing_spline.fit_samples(*table, **stated)
    return smoothing_spline.pose_spline(fit.knots), fit


def angles(R: jax.Array, rows: Rotation) -> np.ndarray:
    return (Rotation.from_matrix(np.asarray(R)).inv() * rows).magnitude()


@pytest.mark.parametrize("digits", [15, 6, 4])
def test_thousands_of_rows_give_path_and_acceleration(digits):
    """Rounded as files have them: path within 1 mm, acceleration within 5 % of the largest one of the table."""
    t = 0.01 * np.arange(ROWS)
    p, q = position(t).round(digits), attitude(t).as_quat().round(digits)
    path, fit = path_of(t, p, Rotation.from_quat(q).as_matrix())
    d, a = along(path, jnp.asarray(t)), acceleration(t)
    largest = np.linalg.norm(a, axis=1).max()
    assert np.linalg.norm(d.p - p, axis=1).max() <= 1e-3
    assert angles(d.R, Rotation.from_quat(q)).max() <= 1e-3
    assert np.linalg.norm(d.a - a, axis=1).max() <= 0.05 * largest
    assert np.linalg.norm(d.a, axis=1).max() == pytest.approx(largest, rel=0.05)
    assert fit.deviation == pytest.approx(np.sqrt((np.linalg.norm(d.p - p, axis=1) ** 2).mean()), rel=0.05, abs=1e-6)


def trapezoid(rate: float, shift: float = 0.0, a: float = 2.0, v: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Return times and positions of 4 m from rest to rest with a trapezoidal velocity, oblique."""
    t, rise, end = np.arange(0, 6, 1 / rate), v / a, 4 / v + v / a
    s = np.clip(t - shift, 0, end)
    x = np.where(s < rise, a * s**2 / 2, np.where(s < end - rise, v * (s - rise / 2), 4 - a * (end - s) ** 2 / 2))
    return t, x[:, None] * [0.6, 0.0, 0.8]


@pytest.mark.parametrize("rate", [10, 20, 100])
@pytest.mark.parametrize(("shift", "digits"), [(0.0, 12), (1.0, 12), (1.0, 5)])
def test_steps_of_the_acceleration_are_not_exceeded(rate, shift, digits):
    t, p = trapezoid(rate, shift)
    p = p.round(digits)
    largest = np.linalg.norm(np.diff(p, 2, axis=0), axis=1).max() * rate**2  # 2 m/s^2 and the effect of rounding
    path, _ = path_of(t, p, flat(len(t)))
    assert np.linalg.norm(along(path, jnp.asarray(t)).p - p, axis=1).max() <= 1e-3
    between = np.linspace(t[0], t[-1], 5000)
    assert np.linalg.norm(along(path, jnp.asarray(between)).a, axis=1).max() <= 1.05 * largest
    np.testing.assert_allclose(along(path, jnp.zeros(1)).v, 0, atol=0.01)


@pytest.mark.parametrize(("a", "v"), [(3.0, 1.2), (4.0, 2.0), (5.0, 2.0)])
def test_steps_within_few_rows_are_not_exceeded(a, v):
    t, p = trapezoid(10, 0.0, a, v)
    path, _ = path_of(t, p, flat(len(t)))
    assert np.linalg.norm(along(path, jnp.asarray(t)).p - p, axis=1).max() <= 1e-3
    assert np.linalg.norm(along(path, jnp.asarray(np.linspace(0, t[-1], 5000))).a, axis=1).max() <= 1.05 * a


def test_a_limited_path_keeps_a_stated_deviation():
    t, p = trapezoid(100)
    for deviation in (1e-4, 1e-5):
        path, fit = path_of(t, p, flat(len(t)), deviation=deviation)
        assert fit.deviation <= deviation
        between = np.linspace(t[0], t[-1], 5000)
        assert np.linalg.norm(along(path, jnp.asarray(between)).a, axis=1).max() <= 1.05 * 2


def test_noise_is_smoothed_to_less_than_its_size():
    rng, t = np.random.default_rng(0), 0.01 * np.arange(2000)
    turned = attitude(t) * Rotation.from_rotvec(1e-3 * rng.normal(size=(len(t), 3)))
    path, fit = path_of(t, position(t) + 5e-4 * rng.normal(size=(len(t), 3)), turned.as_matrix())
    d, inner = along(path, jnp.asarray(t)), slice(50, -50)
    assert fit.deviation == pytest.approx(5e-4 * 3**0.5, rel=0.1)
    assert np.linalg.norm(d.p - position(t), axis=1)[inner].max() <= 5e-4
    assert np.linalg.norm(d.a - acceleration(t), axis=1)[inner].max() <= 0.1
    assert angles(d.R, attitude(t)).max() <= 1e-3


def test_a_stated_deviation_is_kept_with_fewer_knots():
    rng, t = np.random.default_rng(1), 0.02 * np.arange(1000)
    p = position(t) + 1e-3 * rng.normal(size=(len(t), 3))
    counts = []
    for deviation in (2e-3, 5e-3, 2e-2):
        _, fit = path_of(t, p, flat(len(t)), deviation=deviation)
        assert fit.deviation <= deviation
        counts.append(len(fit.knots.position))
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1]


def test_few_rows_that_are_no_noise_are_met():
    rng = np.random.default_rng(2)
    t, p = np.cumsum(rng.uniform(0.5, 2, 12)), rng.normal(size=(12, 3))
    R = Rotation.from_rotvec(rng.normal(size=(12, 3)))
    path, _ = path_of(t, p, R.as_matrix())
    d = along(path, jnp.asarray(t))
    np.testing.assert_allclose(d.p, p, atol=1e-8)
    np.testing.assert_allclose(d.R, R.as_matrix(), atol=1e-8)


@pytest.mark.parametrize("rows", [2, 3, 5, 6, 7, 12])
def test_any_number_of_rows_has_a_path(rows):
    t = np.arange(rows, dtype=float)
    path, _ = path_of(t, position(t), attitude(t).as_matrix())
    d = along(path, jnp.asarray(t))
    np.testing.assert_allclose(d.p, position(t), atol=1e-8)
    np.testing.assert_allclose(d.R, attitude(t).as_matrix(), atol=1e-8)


def test_the_start_velocity_is_taken_along_and_it_ends_at_rest():
    t = 0.08 * np.arange(100)
    p = np.stack([np.sin(t), np.zeros(100), np.full(100, 2.0)], axis=1)
    R = Rotation.from_euler("z", 0.5 * t[:, None])
    path, _ = path_of(t, p, R.as_matrix())
    d = along(path, jnp.asarray(t))
    np.testing.assert_allclose(d.v[0], [1, 0, 0], atol=1e-3)
    np.testing.assert_allclose(d.omega[0], [0, 0, 0.5], atol=1e-3)
    assert np.abs(d.a[:, 0] + np.sin(t)).max() <= 0.05
    for edge in (-100.0, 200.0):
        still = along(path, jnp.array([edge]))
        for rate in (still.v, still.a, still.j, still.omega, still.omega_dot):
            np.testing.assert_allclose(rate, 0, atol=1e-9)
    around = np.concatenate([np.linspace(-30, 0, 400), np.linspace(t[-1], t[-1] + 30, 400)])
    assert np.linalg.norm(along(path, jnp.asarray(around)).a, axis=1).max() <= 2


def test_derivatives_are_continuous_everywhere():
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0, 10, 200))
    path, fit = path_of(t, position(t), attitude(t).as_matrix())
    for knots in (fit.knots.position[:, 0], fit.knots.attitude[:, 0]):
        before, after = (along(path, jnp.asarray(knots + side * 1e-9)) for side in (-1, 1))
        for name in ("p", "v", "a", "j", "R", "omega", "omega_dot"):
            np.testing.assert_allclose(getattr(before, name), getattr(after, name), atol=1e-6)


def test_body_rates_of_a_table_do_not_depend_on_the_world():
    t, R_0 = 0.05 * np.arange(300), Rotation.from_rotvec([1.0, -2.0, 0.5])
    one, _ = path_of(t, position(t), attitude(t).as_matrix())
    other, _ = path_of(t, position(t), (R_0 * attitude(t)).as_matrix())
    times = jnp.linspace(-1, 16, 500)
    a, b = along(one, times), along(other, times)
    np.testing.assert_allclose(a.omega, b.omega, atol=1e-9)
    np.testing.assert_allclose(a.omega_dot, b.omega_dot, atol=1e-8)


@pytest.mark.parametrize(
    ("t", "said"), [([0.0], "at least two"), ([0.0, 1.0, 1.0], "row 3"), ([0.0, 2.0, 1.0], "must ascend")]
)
def test_times_that_no_table_can_have_are_refused(t, said):
    with pytest.raises(ValueError, match=said):
        smoothing_spline.fit_samples(np.array(t), np.zeros((len(t), 3)), flat(len(t)))
