"""Conversion between the frames and units of colift and PX4 (docs/ros2_px4.md).

Frames of colift: world ENU (x east, y north, z up), body FLU (x forward, y left, z up), SI units. Frames of PX4: world
NED, body FRD, numbered rotors, normalized thrust. Vectors may have leading batch axes. PX4 is not required.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

WORLD = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # ENU to NED and NED to ENU
BODY = np.diag([1.0, -1.0, -1.0])  # FLU to FRD and FRD to FLU
EARTH_RADIUS = 6371000.0  # m, as in PX4's map projection


def enu_ned(v: Float[Array, "*#batch 3"]) -> Float[Array, "*#batch 3"]:
    """Convert a vector from ENU to NED or from NED to ENU."""
    return v @ WORLD


def flu_frd(v: Float[Array, "*#batch 3"]) -> Float[Array, "*#batch 3"]:
    """Convert a vector from FLU to FRD or from FRD to FLU."""
    return v @ BODY


def attitude_enu_ned(R: Float[Array, "*#batch 3 3"]) -> Float[Array, "*#batch 3 3"]:
    """Convert an attitude: `R' = WORLD R BODY`, its own inverse.

    Args:
        R: Rotation matrix from FLU to ENU, or from FRD to NED.

    Returns:
        Rotation matrix from FRD to NED, or from FLU to ENU.
    """
    return WORLD @ R @ BODY


@dataclasses.dataclass(frozen=True)
class Airframe:
    """Equal rotors with upward thrust in the order of PX4 (parameters CA_ROTORn_PX, _PY, _KM and THR_MDL_FAC).

    Attributes:
        x: Forward positions [m].
        y: Rightward positions [m].
        moment_ratio: Drag torque over thrust [m]; positive for rotors that turn counterclockwise in a view from above.
        quadratic: Coefficient f of the thrust curve `f s^2 + (1 - f) s` of the signal s.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    moment_ratio: tuple[float, ...]
    quadratic: float = 0.0

    @property
    def effectiveness(self) -> np.ndarray:
        """Control effectiveness matrix (4 by rotors), thrust and FRD moments per newton of each rotor."""
        return np.array([np.ones(len(self.x)), -np.array(self.y), self.x, self.moment_ratio])


QUAD_X = Airframe(x=(0.15, -0.15, 0.15, -0.15), y=(0.15, -0.15, -0.15, 0.15), moment_ratio=(0.05, 0.05, -0.05, -0.05))
"""Quadrotor in X configuration: front right, rear left, front left, rear right."""


def thrust_fraction(airframe: Airframe, signal: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Compute the thrust of a rotor as a fraction of its maximum: `f s^2 + (1 - f) s`.

    Args:
        airframe: Rotors.
        signal: Actuator signal s; clipped to [0, 1].

    Returns:
        Fraction in [0, 1].
    """
    s = np.clip(signal, 0.0, 1.0)
    return airframe.quadratic * s * s + (1 - airframe.quadratic) * s


def actuator_signal(airframe: Airframe, fraction: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Compute the actuator signal for a thrust fraction p: `2 p / (1 - f + sqrt((1 - f)^2 + 4 f p))`.

    Args:
        airframe: Rotors.
        fraction: Thrust over maximum thrust; clipped to [0, 1].

    Returns:
        Actuator signal in [0, 1].
    """
    p, linear = np.clip(fraction, 0.0, 1.0), 1 - airframe.quadratic
    root = linear + np.sqrt(linear * linear + 4 * airframe.quadratic * p)
    return 2 * p / np.where(root > 0, root, 1.0)


def rotor_wrench(
    airframe: Airframe, controls: Float[Array, " rotors"], thrust_max: float
) -> tuple[float, Float[Array, "3"]]:
    """Compute thrust and torque of the rotors.

    Args:
        airframe: Rotors.
        controls: Actuator signal of each rotor.
        thrust_max: Sum of the maximum thrusts of all rotors [N].

    Returns:
        Thrust [N], and torque in FLU [N m].
    """
    forces = thrust_fraction(airframe, controls) * thrust_max / len(airframe.x)
    u, *tau = airframe.effectiveness @ forces
    return float(u), flu_frd(np.array(tau))


def actuator_controls(
    airframe: Airframe, u: float, tau: Float[Array, "3"], thrust_max: float
) -> Float[Array, " rotors"]:
    """Compute the actuator signals of the minimum-norm rotor forces for a thrust and a torque.

    The result is exact if no rotor is at its limit.

    Args:
        airframe: Rotors.
        u: Thrust [N].
        tau: Torque in FLU [N m].
        thrust_max: Sum of the maximum thrusts of all rotors [N].

    Returns:
        Actuator signal of each rotor in [0, 1].
    """
    forces = np.linalg.pinv(airframe.effectiveness) @ np.concatenate([[u], flu_frd(np.asarray(tau))])
    return actuator_signal(airframe, forces * len(airframe.x) / thrust_max)


def thrust_setpoint(u: float, thrust_max: float) -> Float[Array, "3"]:
    """Compute `VehicleThrustSetpoint.xyz` in FRD: `(0, 0, -u / thrust_max)`.

    Args:
        u: Thrust [N].
        thrust_max: Sum of the maximum thrusts of all rotors [N].

    Returns:
        Normalized thrust vector.
    """
    return np.array([0.0, 0.0, -u / thrust_max])


def torque_setpoint(airframe: Airframe, tau: Float[Array, "3"], thrust_max: float) -> Float[Array, "3"]:
    """Compute `VehicleTorqueSetpoint.xyz` in FRD.

    Each component is divided by the torque of one half of the rotors at maximum thrust and the other half at zero.

    Args:
        airframe: Rotors.
        tau: Torque in FLU [N m].
        thrust_max: Sum of the maximum thrusts of all rotors [N].

    Returns:
        Normalized torque vector.
    """
    return flu_frd(np.asarray(tau)) / (np.abs(airframe.effectiveness[1:]).sum(1) / 2 * thrust_max / len(airframe.x))


@dataclasses.dataclass(frozen=True)
class HomePosition:
    """Position of the origin of the world frame on Earth.

    Attributes:
        latitude: Latitude [deg].
        longitude: Longitude [deg].
        altitude: Altitude above sea level [m].
        magnetic_field: Magnetic field in NED [gauss].
    """

    latitude: float = 47.397742
    longitude: float = 8.545594
    altitude: float = 488.0
    magnetic_field: tuple[float, float, float] = (0.21, 0.01, 0.43)


DEFAULT_HOME = HomePosition()
"""Default home position of PX4's simulators."""


def geodetic(home_position: HomePosition, p: Float[Array, "3"]) -> Int[Array, "3"]:
    """Compute geodetic coordinates of a point near home, on a spherical Earth.

    Args:
        home_position: Origin of the world frame.
        p: Position in ENU [m].

    Returns:
        Latitude and longitude [1e-7 deg], and altitude [mm].
    """
    east, north, up = p
    latitude = home_position.latitude + np.rad2deg(north / EARTH_RADIUS)
    longitude = home_position.longitude + np.rad2deg(east / (EARTH_RADIUS * np.cos(np.deg2rad(home_position.latitude))))
    return np.rint([1e7 * latitude, 1e7 * longitude, 1e3 * (home_position.altitude + up)]).astype(int)


def pressure(altitude: float) -> float:
    """Compute the pressure of the standard atmosphere: `1013.25 hPa (1 - 2.25577e-5 h / m)^5.25588`.

    Args:
        altitude: Altitude h above sea level, below 11 000 m [m].

    Returns:
        Pressure [hPa].
    """
    return float(1013.25 * (1 - 2.25577e-5 * altitude) ** 5.25588)
