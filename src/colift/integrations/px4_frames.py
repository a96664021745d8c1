"""PX4's frames, units and normalized thrust: pure maps of numbers, without PX4 (docs/ros2_px4.md).

Ours: world ENU (x east, y north, z up), body FLU (x forward, y left, z up), SI. PX4's: world NED, body FRD, rotors by
number, thrust as a share. Vectors may have axes in front.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

WORLD = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # ENU to NED, and back
BODY = np.diag([1.0, -1.0, -1.0])  # FLU to FRD, and back
EARTH = 6371000.0  # m, radius with which PX4 projects


def enu_ned(v: Float[Array, "*#batch 3"]) -> Float[Array, "*#batch 3"]:
    """A vector in ENU in NED, or one in NED in ENU."""
    return v @ WORLD


def flu_frd(v: Float[Array, "*#batch 3"]) -> Float[Array, "*#batch 3"]:
    """A vector in FLU in FRD, or one in FRD in FLU."""
    return v @ BODY


def attitude_enu_ned(R: Float[Array, "*#batch 3 3"]) -> Float[Array, "*#batch 3 3"]:
    """FLU to ENU as FRD to NED, or the other way round: `R' = WORLD R BODY`."""
    return WORLD @ R @ BODY


@dataclasses.dataclass(frozen=True)
class Airframe:
    """Rotors as PX4 numbers and measures them (CA_ROTORn_PX, _PY, _KM, THR_MDL_FAC); all alike, thrust up."""

    x: tuple[float, ...]  # m, forward
    y: tuple[float, ...]  # m, right
    moment_ratio: tuple[
        float, ...
    ]  # m, torque over force: positive for a rotor that turns counterclockwise, seen from above
    quadratic: float = 0.0  # share f of the signal's square in the thrust: `f s^2 + (1 - f) s`

    @property
    def effectiveness(self) -> np.ndarray:
        """`(4, rotors)`: thrust and the moments in FRD, per newton of each rotor: `(1, -y, x, yaw)`."""
        return np.array([np.ones(len(self.x)), -np.array(self.y), self.x, self.moment_ratio])


QUAD_X = Airframe(x=(0.15, -0.15, 0.15, -0.15), y=(0.15, -0.15, -0.15, 0.15), moment_ratio=(0.05, 0.05, -0.05, -0.05))
"""Front right, rear left, front left, rear right."""


def thrust_fraction(frame: Airframe, signal: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """The share of its greatest force that a rotor gives at a signal in [0, 1]; what is beyond is cut there."""
    s = np.clip(signal, 0.0, 1.0)
    return frame.quadratic * s * s + (1 - frame.quadratic) * s


def actuator_signal(frame: Airframe, share: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """The signal that gives a share in [0, 1]: `2 p / (1 - f + sqrt((1 - f)^2 + 4 f p))`; what is beyond is cut."""
    p, linear = np.clip(share, 0.0, 1.0), 1 - frame.quadratic
    root = linear + np.sqrt(linear * linear + 4 * frame.quadratic * p)
    return 2 * p / np.where(root > 0, root, 1.0)


def rotor_wrench(
    frame: Airframe, controls: Float[Array, " rotors"], thrust_max: float
) -> tuple[float, Float[Array, "3"]]:
    """Thrust, N, and torque, N m, FLU, of rotors at their signals; all of them at 1 give `thrust_max`, N."""
    forces = thrust_fraction(frame, controls) * thrust_max / len(frame.x)
    u, *tau = frame.effectiveness @ forces
    return float(u), flu_frd(np.array(tau))


def actuator_controls(frame: Airframe, u: float, tau: Float[Array, "3"], thrust_max: float) -> Float[Array, " rotors"]:
    """Signals of the least forces that give a thrust, N, and a torque, N m, FLU, where no rotor is at its limit."""
    forces = np.linalg.pinv(frame.effectiveness) @ np.concatenate([[u], flu_frd(np.asarray(tau))])
    return actuator_signal(frame, forces * len(frame.x) / thrust_max)


def thrust_setpoint(u: float, thrust_max: float) -> Float[Array, "3"]:
    """`VehicleThrustSetpoint.xyz`, FRD: `(0, 0, -u / thrust_max)`."""
    return np.array([0.0, 0.0, -u / thrust_max])


def torque_setpoint(frame: Airframe, tau: Float[Array, "3"], thrust_max: float) -> Float[Array, "3"]:
    """`VehicleTorqueSetpoint.xyz`, FRD, each over the most that half of the rotors give without the other half."""
    return flu_frd(np.asarray(tau)) / (np.abs(frame.effectiveness[1:]).sum(1) / 2 * thrust_max / len(frame.x))


@dataclasses.dataclass(frozen=True)
class HomePosition:
    """Where the world's origin is on Earth."""

    latitude: float = 47.397742  # deg
    longitude: float = 8.545594  # deg
    altitude: float = 488.0  # m above sea level
    field: tuple[float, float, float] = (0.21, 0.01, 0.43)  # gauss, NED, of the magnetic field


HOME = HomePosition()
"""Where PX4's simulators begin."""


def geodetic(home: HomePosition, p: Float[Array, "3"]) -> Int[Array, "3"]:
    """Latitude and longitude, 1e-7 deg, and altitude, mm, of a point in ENU, m: on a sphere, near home."""
    east, north, up = p
    latitude = home.latitude + np.rad2deg(north / EARTH)
    longitude = home.longitude + np.rad2deg(east / (EARTH * np.cos(np.deg2rad(home.latitude))))
    return np.rint([1e7 * latitude, 1e7 * longitude, 1e3 * (home.altitude + up)]).astype(int)


def pressure(altitude: float) -> float:
    """Pressure of the standard atmosphere, hPa: `1013.25 (1 - 2.25577e-5 h)^5.25588`; altitude h below 11 km, m."""
    return float(1013.25 * (1 - 2.25577e-5 * altitude) ** 5.25588)
