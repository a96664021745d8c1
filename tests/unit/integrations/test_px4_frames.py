"""Tests of PX4's frames and units against SciPy, geometry, and round trips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from colift.integrations import px4_frames

vectors = arrays(float, 3, elements=st.floats(-100, 100))
seeds = st.integers(0, 2**31)
EAST, NORTH, UP = np.eye(3)


def test_the_axes_by_name() -> None:
    np.testing.assert_array_equal(px4_frames.enu_ned(np.eye(3)), [[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    np.testing.assert_array_equal(px4_frames.flu_frd(np.eye(3)), [[1, 0, 0], [0, -1, 0], [0, 0, -1]])


@given(vectors)
def test_frame_conversions_are_involutory_rotations(v: np.ndarray) -> None:
    for turn, matrix in ((px4_frames.enu_ned, px4_frames.WORLD), (px4_frames.flu_frd, px4_frames.BODY)):
        np.testing.assert_array_equal(turn(turn(v)), v)
        assert np.linalg.det(matrix) == 1


@given(seeds, vectors)
def test_attitude_conversion_commutes_with_rotation(seed: int, v: np.ndarray) -> None:
    """`R' body(v) = world(R v)`, which defines the conversion, and back."""
    R = Rotation.random(random_state=seed).as_matrix()
    np.testing.assert_allclose(
        px4_frames.attitude_enu_ned(R) @ px4_frames.flu_frd(v), px4_frames.enu_ned(R @ v), atol=1e-12
    )
    np.testing.assert_allclose(px4_frames.attitude_enu_ned(px4_frames.attitude_enu_ned(R)), R, atol=1e-15)


@pytest.mark.parametrize(
    ("nose", "left", "yaw", "pitch", "roll"),
    [
        (NORTH, -EAST, 0, 0, 0),
        (EAST, NORTH, 90, 0, 0),
        (-NORTH, EAST, 180, 0, 0),
        (UP, -EAST, 0, 90, 0),
        (EAST, (NORTH + UP) / np.sqrt(2), 90, 0, 45),
    ],
)
def test_yaw_pitch_and_roll_signs(nose: np.ndarray, left: np.ndarray, yaw: float, pitch: float, roll: float) -> None:
    """Clockwise from north, nose up and right side down are positive in NED and FRD."""
    R = np.stack([nose, left, np.cross(nose, left)], axis=1)
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()
    np.testing.assert_allclose(px4_frames.attitude_enu_ned(R), expected, atol=1e-12)


@given(st.sampled_from([0.0, 1.0]) | st.floats(1e-3, 1), st.floats(0, 1))
def test_signal_and_thrust_share_are_inverse(s: float, f: float) -> None:
    frame = px4_frames.Airframe(x=(0.1,), y=(0.1,), moment_ratio=(0.0,), quadratic=f)
    np.testing.assert_allclose(
        px4_frames.actuator_signal(frame, px4_frames.thrust_fraction(frame, np.array([s]))), s, atol=1e-7
    )
    np.testing.assert_allclose(
        px4_frames.thrust_fraction(frame, px4_frames.actuator_signal(frame, np.array([s]))), s, atol=1e-12
    )
    assert px4_frames.thrust_fraction(frame, np.array([-s])) == 0
    assert px4_frames.actuator_signal(frame, np.array([1 + s])) == pytest.approx(1)


def test_rotor_torque_signs() -> None:
    """More force on the left lifts the left side: a roll to the right, which FRD and FLU both count as positive."""
    for louder, torque in (
        ((1, 2), np.array([1.0, 0, 0])),  # rear left and front left: right wing down, positive about x in both
        ((0, 2), np.array([0, -1.0, 0])),  # front: nose up, negative about y, which points left
        ((0, 1), np.array([0, 0, -1.0])),  # counterclockwise ones: the body goes clockwise, negative about z up
    ):
        signals = np.full(4, 0.5)
        signals[list(louder)] += 0.1
        u, tau = px4_frames.rotor_wrench(px4_frames.QUAD_X, signals, 40.0)
        assert u == pytest.approx(22)
        np.testing.assert_allclose(tau / np.linalg.norm(tau), torque, atol=1e-12)


@given(st.floats(8, 32), arrays(float, 3, elements=st.floats(-0.2, 0.2)), st.floats(0, 1))
def test_controls_round_trip(u: float, tau: np.ndarray, f: float) -> None:
    frame = px4_frames.Airframe(px4_frames.QUAD_X.x, px4_frames.QUAD_X.y, px4_frames.QUAD_X.moment_ratio, f)
    signals = px4_frames.actuator_controls(frame, u, tau, 40.0)
    assert ((signals >= 0) & (signals <= 1)).all()
    found, torque = px4_frames.rotor_wrench(frame, signals, 40.0)
    np.testing.assert_allclose([found, *torque], [u, *tau], atol=1e-12)


def test_setpoints_are_normalized() -> None:
    np.testing.assert_array_equal(px4_frames.thrust_setpoint(30.0, 40.0), [0, 0, -0.75])
    most = px4_frames.rotor_wrench(px4_frames.QUAD_X, np.array([0.0, 1.0, 1.0, 0.0]), 40.0)[1]
    np.testing.assert_allclose(px4_frames.torque_setpoint(px4_frames.QUAD_X, most, 40.0), [1, 0, 0], atol=1e-15)
    most = px4_frames.rotor_wrench(px4_frames.QUAD_X, np.array([1.0, 0.0, 1.0, 0.0]), 40.0)[1]
    np.testing.assert_allclose(px4_frames.torque_setpoint(px4_frames.QUAD_X, most, 40.0), [0, 1, 0], atol=1e-15)


@given(vectors)
def test_geodetic_distances_equal_local_distances(p: np.ndarray) -> None:
    """By the haversine formula between two positions, to the centimeter of the format."""
    lat, lon, alt = px4_frames.geodetic(px4_frames.DEFAULT_HOME, p) * [1e-7, 1e-7, 1e-3]
    a, b = np.deg2rad([lat, px4_frames.DEFAULT_HOME.latitude])
    c = np.deg2rad(lon - px4_frames.DEFAULT_HOME.longitude)
    haversine = np.sin((a - b) / 2) ** 2 + np.cos(a) * np.cos(b) * np.sin(c / 2) ** 2
    far = 2 * px4_frames.EARTH_RADIUS * np.arcsin(np.sqrt(haversine))
    assert far == pytest.approx(np.hypot(p[0], p[1]), abs=0.02)
    assert alt - px4_frames.DEFAULT_HOME.altitude == pytest.approx(p[2], abs=6e-4)
    assert np.sign(lat - px4_frames.DEFAULT_HOME.latitude) in (0, np.sign(p[1]))


@pytest.mark.parametrize(("altitude", "hPa"), [(0.0, 1013.25), (1000.0, 898.75), (5000.0, 540.20)])
def test_pressure_is_that_of_the_standard_atmosphere(altitude: float, hPa: float) -> None:
    assert px4_frames.pressure(altitude) == pytest.approx(hPa, abs=0.05)
