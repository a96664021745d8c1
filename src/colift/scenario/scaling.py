r"""Scaling of a scenario with the size of its vehicles, by dynamic similarity.

The numbers of `colift init` are those of a reference vehicle with mass `m_0` and radius of gyration `k_0`. Gravity is
the same for every vehicle. Two systems are similar if their Froude numbers `v^2 / (g l)` agree. With the ratios
`L = k / k_0` of lengths and `M = m / m_0` of masses, all quantities follow from their dimensions:

- length, path, position noise: `L`
- time, period, delay: `T = sqrt(L)`, from `sqrt(l / g)`
- rate, bandwidth, velocity gain: `1 / T`
- position and attitude gains (1/s^2): `1 / L`
- speed, wind: `L / T = T`
- acceleration, angle: 1
- force: `M`, from `m g`
- moment: `M L`, from `m g l`
- inertia: `M L^2`
- drag coefficient (N s/m): `M / T`

The linearized closed loop of a geometrically similar vehicle has the eigenvalues of the reference divided by `T`.

References:
    Barenblatt, *Scaling*, Cambridge University Press, 2003, ch. 1.
"""

from __future__ import annotations

import dataclasses
import math

REFERENCE_MASS = 1.5  # kg, vehicle of `colift init` without arms
REFERENCE_RADIUS = math.sqrt(0.035 / 1.5)  # m, its radius of gyration about the vertical
MAX_SHAPE_RATIO = 2.5  # of the length to the one of a vehicle with the same mean density
CONTROL_RATES = (100, 125, 200, 250, 400, 500, 800, 1000, 2000)  # Hz, with periods of whole microseconds
REFERENCE_CONTROL_RATE = 500.0  # Hz


@dataclasses.dataclass(frozen=True)
class Scale:
    """Ratios of a vehicle to the reference vehicle."""

    length: float = 1.0  # ratio L of the radii of gyration
    mass: float = 1.0  # ratio M of the masses

    @property
    def time(self) -> float:
        """Ratio of times, `sqrt(L)`."""
        return math.sqrt(self.length)

    @property
    def rate(self) -> float:
        """Ratio of rates, `1 / T`."""
        return 1 / self.time

    @property
    def gain(self) -> float:
        """Ratio of position and attitude gains, `1 / L`."""
        return 1 / self.length

    @property
    def integral_gain(self) -> float:
        """Ratio of integral gains, `1 / T^3`."""
        return self.time**-3

    @property
    def speed(self) -> float:
        """Ratio of speeds, `T`."""
        return self.time

    @property
    def force(self) -> float:
        """Ratio of forces, `M`."""
        return self.mass

    @property
    def moment(self) -> float:
        """Ratio of moments, `M L`."""
        return self.mass * self.length

    @property
    def inertia(self) -> float:
        """Ratio of inertias, `M L^2`."""
        return self.mass * self.length**2

    @property
    def drag(self) -> float:
        """Ratio of drag coefficients, `M / T`."""
        return self.mass / self.time

    @property
    def control_rate(self) -> float:
        """Control rate [Hz]: the smallest of `CONTROL_RATES` that is not below 0.9 of the scaled reference rate."""
        required = 0.9 * REFERENCE_CONTROL_RATE * self.rate
        return float(next((rate for rate in CONTROL_RATES if rate >= required), CONTROL_RATES[-1]))


REFERENCE = Scale()


def vehicle_scale(mass: float, base_mass: float, yaw_inertia: float) -> Scale:
    """Compute the scale of a vehicle.

    The length is the radius of gyration of the base, within `MAX_SHAPE_RATIO` of the length of a vehicle with the mean
    density of the reference vehicle, `(m / m_0)^(1/3)`. Inertias in files are sometimes placeholders.

    Args:
        mass: Mass of the vehicle with its arms [kg].
        base_mass: Mass of the base [kg].
        yaw_inertia: Inertia of the base about its third axis [kg m^2].

    Returns:
        The scale.

    Example:
        >>> crazyflie = vehicle_scale(0.027, 0.027, 2.17e-5)
        >>> f"{crazyflie.length:.2f} {crazyflie.mass:.3f} {crazyflie.control_rate:g}"
        '0.19 0.018 2000'
    """
    similar = (mass / REFERENCE_MASS) ** (1 / 3)
    radius = math.sqrt(yaw_inertia / base_mass) / REFERENCE_RADIUS
    return Scale(
        length=min(max(radius, similar / MAX_SHAPE_RATIO), similar * MAX_SHAPE_RATIO), mass=mass / REFERENCE_MASS
    )
