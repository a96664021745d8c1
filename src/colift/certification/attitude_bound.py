"""Ultimate bound of the payload's attitude error, and the region of attraction for which it holds.

`e_R' = E e_omega`, `e_omega' = -k_R e_R - k_omega e_omega + d`, `|d(t)|_2 <= rho` (Eq. err_eomega_learning divided by
J_L), with gains proportional to the inertia, `K_R = k_R J`, `K_omega = k_omega J`. Two methods are combined:

- `lyapunov_bound`: `V = a Psi + |e_omega|^2 / 2 + c e_R . e_omega` with `a = k_R + c k_omega` decreases outside a small
  set. This gives the region of attraction and a first ultimate bound.
- `refine_bound`: peak gains for the rotation vector `phi` (angle `theta`) and the rate
  `Omega = exp(hat(phi) / 2) e_omega`, expressed half-way between the two attitudes. In these coordinates the equations
  are linear up to terms of third order.

Units: angles in rad, rates in rad/s, k_R and rho in 1/s^2, k_omega in 1/s.

See Also:
    docs/certificate.md: Derivation, section "Rotation".
    docs/decisions/0006-scale-rotational-gains-by-inertia.md: Choice of the gains.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

ROUNDING = 1e-9  # relative; a bound needs a few dozen operations on positive numbers


@dataclasses.dataclass(frozen=True)
class RegionOfAttraction:
    """States with `V <= level` and `Psi <= Psi_edge`, from which `V` decreases to its ultimate level.

    Attributes:
        a: Coefficient of Psi in V [1/s^2].
        c: Coefficient of the cross term in V [1/s].
        level: Level of V that bounds the region [1/s^2].
        ultimate_level: Ultimate bound of V [1/s^2].
        Psi_edge: Largest admissible Psi.
        angle_at_rest: Largest initial angle with zero rate error [rad].
        rate_aligned: Largest initial `|e_omega|` with zero attitude error [rad/s].
    """

    a: float
    c: float
    level: float
    ultimate_level: float
    Psi_edge: float
    angle_at_rest: float
    rate_aligned: float

    def contains(self, angle: float, rate: float) -> bool:
        """Return whether all initial states within the given bounds lie in the region.

        Args:
            angle: Bound of the angle of `R_d^T R` [rad].
            rate: Bound of `|e_omega|` [rad/s].

        Returns:
            True if all of them do.
        """
        return bool(1 - np.cos(angle) <= self.Psi_edge and self.value(angle, rate) <= self.level)

    def value(self, angle: float, rate: float) -> float:
        """Return the largest V over all states within the given bounds.

        Args:
            angle: Bound of the angle of `R_d^T R` [rad].
            rate: Bound of `|e_omega|` [rad/s].

        Returns:
            Largest V [1/s^2].
        """
        Psi, sine = 1 - np.cos(angle), np.sin(min(angle, np.pi / 2))
        return float(self.a * Psi + rate * rate / 2 + self.c * sine * rate)


@dataclasses.dataclass(frozen=True)
class AttitudeBound:
    """Ultimate bounds of the attitude error, valid for all initial states in `region`.

    Attributes:
        angle: Bound of the angle of `R_d^T R` [rad].
        Psi: Bound of Psi.
        e_R: Bound of `|e_R|_2`.
        e_omega: Bound of `|e_omega|_2` [rad/s].
        method: Method that gives `angle`: "small gain" or "Lyapunov".
        lyapunov_bound: Bound of the angle by the Lyapunov function alone [rad].
        angle_from_rest: Bound of the angle at all times from zero error [rad]; infinite if none is found.
        rate_from_rest: Bound of `|e_omega|_2` at all times from zero error [rad/s]; infinite if none is found.
        region: Region of attraction.
    """

    angle: float
    Psi: float
    e_R: float
    e_omega: float
    method: str
    lyapunov_bound: float
    angle_from_rest: float
    rate_from_rest: float
    region: RegionOfAttraction


def ultimate_bound(k_R: float, k_omega: float, rho: float) -> AttitudeBound:
    """Compute ultimate bounds of the attitude error for every disturbance with `|d(t)|_2 <= rho`.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].
        rho: Bound of the disturbance [rad/s^2].

    Returns:
        Bounds with their region of attraction.

    Raises:
        ValueError: If no region of attraction is found; the message contains the largest rho that has one.

    Example:
        >>> bound = ultimate_bound(k_R=8.0, k_omega=4.0, rho=0.5)
        >>> bound.angle, bound.region.angle_at_rest
    """
    _validate(k_R, k_omega, rho)
    region = region_of_attraction(k_R, k_omega, rho)
    if region is None:
        raise ValueError(
            f"no certificate for rho = {rho:.6g} rad/s^2 at k_R = {k_R:.6g} and k_omega = {k_omega:.6g}: V may "
            f"increase on every level set; a certificate exists up to rho = {max_disturbance(k_R, k_omega):.4g} rad/s^2"
        )
    first_bound = lyapunov_bound(k_R, k_omega, rho, region)
    angle, rate = refine_bound(k_R, k_omega, rho, first_bound)
    from_rest = transient_bound(k_R, k_omega, rho, 0.0, 0.0)
    return AttitudeBound(
        angle=angle,
        Psi=float(1 - np.cos(angle)),
        e_R=float(np.sin(min(angle, np.pi / 2))),
        e_omega=rate,
        method="small gain" if angle < first_bound[0] else "Lyapunov",
        lyapunov_bound=first_bound[0],
        angle_from_rest=from_rest[0],
        rate_from_rest=from_rest[1],
        region=region,
    )


def max_disturbance(k_R: float, k_omega: float) -> float:
    """Return the largest rho for which `region_of_attraction` finds a region, to 1e-4 of k_R.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].

    Returns:
        Bound of the disturbance [rad/s^2].
    """
    low, high = 0.0, k_R  # a constant disturbance of k_R overturns the payload
    while high - low > 1e-4 * k_R:
        middle = (low + high) / 2
        low, high = (middle, high) if region_of_attraction(k_R, k_omega, middle) else (low, middle)
    return low


# Lyapunov function --------------------------------------------------------------------------------------------------


def region_of_attraction(k_R: float, k_omega: float, rho: float) -> RegionOfAttraction | None:
    """Find the region of attraction with the largest angle at rest over c.

    With `a = k_R + c k_omega`, `V' <= -q + sqrt(q q_star)`, `q = (k_omega - c) |e_omega|^2 + c k_R |e_R|^2`. V
    decreases for `q > q_star`, hence for `|e_R|^2 > q_star / (c k_R)`, and on every level set within this bound.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].
        rho: Bound of the disturbance [rad/s^2].

    Returns:
        Region of attraction, None if no c gives one.
    """
    found = [region for c in _candidate_coefficients(k_omega) if (region := _region_for(k_R, k_omega, rho, c))]
    if not found:
        return None
    start = max(found, key=lambda region: region.angle_at_rest).c

    def loss(c: float) -> float:
        region = _region_for(k_R, k_omega, rho, c)
        return -region.angle_at_rest if region else 0.0

    refined = minimize_scalar(loss, bounds=(start * 0.8, min(start * 1.25, 0.999 * k_omega)), method="bounded")
    found += [region] if (region := _region_for(k_R, k_omega, rho, float(refined.x))) else []
    return max(found, key=lambda region: region.angle_at_rest)


def lyapunov_bound(k_R: float, k_omega: float, rho: float, region: RegionOfAttraction) -> tuple[float, float]:
    """Compute ultimate bounds by the Lyapunov function, first with the region's c, then with every applicable c.

    Once `Psi <= Psi_1` holds for all later times, every c whose edge exceeds `Psi_1` gives a bound. The smallest is
    taken.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].
        rho: Bound of the disturbance [rad/s^2].
        region: Region of attraction.

    Returns:
        Bounds of the angle [rad] and of `|e_omega|` [rad/s].
    """
    angle, rate = _level_set_bounds(k_R, k_omega, region.c, region.ultimate_level)
    regions = [r for c in _candidate_coefficients(k_omega) if (r := _region_for(k_R, k_omega, rho, c))]
    for _ in range(2):
        both = [
            _level_set_bounds(k_R, k_omega, r.c, r.ultimate_level) for r in regions if 1 - np.cos(angle) < r.Psi_edge
        ]
        angle, rate = min([angle, *(b[0] for b in both)]), min([rate, *(b[1] for b in both)])
    return angle, rate


def _candidate_coefficients(k_omega: float) -> list[float]:
    """Return candidates for c; each gives a valid proof, so a coarse grid affects only tightness."""
    shares = np.concatenate([np.geomspace(1e-6, 0.02, 12, endpoint=False), np.linspace(0.02, 0.98, 49)])
    return [float(k_omega * share) for share in shares]


def _dissipation_threshold(k_R: float, k_omega: float, rho: float, c: float) -> float:
    """Compute `q_star = rho^2 (1 / (k_omega - c) + c / k_R)`; V decreases where q exceeds it (Cauchy-Schwarz)."""
    return rho * rho * (1 / (k_omega - c) + c / k_R) * (1 + ROUNDING)


def _region_for(k_R: float, k_omega: float, rho: float, c: float) -> RegionOfAttraction | None:
    """Return the largest region of one c, None unless `q_star / (c k_R) < 1` and `a > c^2`."""
    a, sine2 = k_R + c * k_omega, _dissipation_threshold(k_R, k_omega, rho, c) / (c * k_R)
    if sine2 >= 1 or a <= c * c:
        return None
    edge = (1 + float(np.sqrt(1 - sine2))) * (1 - ROUNDING)  # Psi of pi - arcsin(sine)
    level = a * edge - c * c / 2 * edge * (2 - edge)  # minimum of V at this Psi over e_omega
    ultimate_level = _ultimate_level(k_R, k_omega, rho, c)
    if level <= ultimate_level:
        return None
    return RegionOfAttraction(
        a, c, level, ultimate_level, edge, float(np.arccos(1 - level / a)), float(np.sqrt(2 * level))
    )


def _ultimate_level(k_R: float, k_omega: float, rho: float, c: float) -> float:
    """Return the largest V with `q <= q_star`, `Psi < 1`: `q_star` times the largest eigenvalue of a 2 x 2 pencil."""
    q_star = _dissipation_threshold(k_R, k_omega, rho, c)
    convex = 1 + np.sqrt(1 - q_star / (c * k_R))  # Psi <= |e_R|^2 / (1 + cos theta)
    x, y = (k_R + c * k_omega) / convex / (c * k_R), 0.5 / (k_omega - c)
    z = 0.5 * c / np.sqrt(c * k_R * (k_omega - c))
    return float(q_star * ((x + y) / 2 + np.hypot((x - y) / 2, z))) * (1 + ROUNDING)


def _level_set_bounds(k_R: float, k_omega: float, c: float, level: float) -> tuple[float, float]:
    """Return the largest angle and `|e_omega|` where V is at most a level."""
    a = k_R + c * k_omega
    b = a - c * c  # c^2/2 Psi^2 + b Psi <= level, and (1 - c^2 / a) |e_omega|^2 / 2 <= level
    Psi = 2 * level / (b + np.sqrt(b * b + 2 * c * c * level))
    return float(np.arccos(1 - Psi) * (1 + ROUNDING)), float(np.sqrt(2 * level * a / b) * (1 + ROUNDING))


# Small-gain iteration -----------------------------------------------------------------------------------------------


def refine_bound(
    k_R: float, k_omega: float, rho: float, bounds: tuple[float, float], free: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Refine bounds of angle and rate by the iteration `x <- min(x, free + F(x))`; every iterate is a bound.

    `phi' = Omega + (theta / (2 sin(theta / 2)) - 1) Omega_across` and
    `Omega' = -k_R phi - k_omega Omega + d + k_R (theta - sin theta) n + g`, `|g| <= tan(theta / 4) |Omega|^2 / 2`. F
    applies the peak gains of the linear part to the largest nonlinear terms and increases with both bounds.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].
        rho: Bound of the disturbance [rad/s^2].
        bounds: Bounds of angle [rad] and rate [rad/s] to refine.
        free: Peaks of the free linear response [rad, rad/s]; zero for ultimate bounds.

    Returns:
        Refined bounds of angle [rad] and rate [rad/s].
    """
    peaks = peak_gains(k_R, k_omega)
    while True:
        forced_response = _forced_response_peaks(peaks, k_R, rho, *bounds)
        new = min(bounds[0], free[0] + forced_response[0]), min(bounds[1], free[1] + forced_response[1])
        if new[0] >= bounds[0] * (1 - ROUNDING) and new[1] >= bounds[1] * (1 - ROUNDING):
            return bounds
        bounds = new


def transient_bound(k_R: float, k_omega: float, rho: float, angle: float, rate: float) -> tuple[float, float]:
    """Compute bounds at all times on angle and `|e_omega|` from bounded initial errors.

    The result is the smaller of two bounds. One refines the best bound by the level set of the initial state. The other
    is a pair x with `free + F(x) < x`, which cannot be reached from below.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].
        rho: Bound of the disturbance [rad/s^2].
        angle: Bound of the initial angle [rad].
        rate: Bound of the initial `|e_omega|` [rad/s].

    Returns:
        Bounds of angle [rad] and rate [rad/s]; infinite if none is found.
    """
    _validate(k_R, k_omega, rho)
    free = _free_response_peaks(k_R, k_omega, angle, rate)
    found = [_invariant_bounds(k_R, k_omega, rho, free)]
    for c in _candidate_coefficients(k_omega):
        region = _region_for(k_R, k_omega, rho, c)
        if region and region.contains(angle, rate):
            found.append(_level_set_bounds(k_R, k_omega, c, max(region.value(angle, rate), region.ultimate_level)))
    best = min(x[0] for x in found), min(x[1] for x in found)
    return refine_bound(k_R, k_omega, rho, best, free) if np.isfinite(best).all() else best


def _invariant_bounds(k_R: float, k_omega: float, rho: float, free: tuple[float, float]) -> tuple[float, float]:
    """Return the smallest x found from below with `free + F(x) < x`; infinite if none is found."""
    peaks, x = peak_gains(k_R, k_omega), free
    while x[0] < np.pi and math.isfinite(x[1]):
        forced_response = _forced_response_peaks(peaks, k_R, rho, *x)
        new = free[0] + forced_response[0], free[1] + forced_response[1]
        if new[0] < x[0] and new[1] < x[1]:
            return x
        x = (
            new[0] * (1 + 1e-6) + 1e-12,
            new[1] * (1 + 1e-6) + 1e-12,
        )  # the fixed point of this iteration is just above that of F
    return np.inf, np.inf


def _free_response_peaks(k_R: float, k_omega: float, angle: float, rate: float) -> tuple[float, float]:
    """Return the peaks of `|phi|` and `|Omega|` of the free response; `|Omega|^2 + k_R |phi|^2` never increases."""
    w = float(np.sqrt(abs(k_R - k_omega * k_omega / 4)))
    t = 2 / k_omega  # time of the largest phi from a unit rate, at critical damping
    if w > 0:
        t = float(np.arctan2(w, k_omega / 2) if 4 * k_R > k_omega * k_omega else np.arctanh(2 * w / k_omega)) / w
    peak = float(expm(np.array([[0.0, 1.0], [-k_R, -k_omega]]) * t)[0, 1]) * (1 + ROUNDING)
    return angle + peak * rate, k_R * peak * angle + rate


def _forced_response_peaks(
    peaks: tuple[float, float, float, float], k_R: float, rho: float, angle: float, rate: float
) -> tuple[float, float]:
    """Evaluate F: the peak gains applied to disturbance and nonlinear terms for bounds on angle (below pi) and rate."""
    across = (angle / 2 / math.sin(angle / 2) - 1 if angle > 1e-4 else angle * angle / 23) * rate
    softening = angle - math.sin(angle) if angle > 1e-2 else angle**3 / 6
    force = rho + k_R * softening + math.tan(angle / 4) * rate * rate / 2
    return peaks[0] * across + peaks[1] * force, peaks[2] * across + peaks[3] * force


def peak_gains(k_R: float, k_omega: float) -> tuple[float, float, float, float]:
    """Compute the peak gains of `phi' = Omega + w, Omega' = -k_R phi - k_omega Omega + f`.

    For three decoupled axes they are gains in the 2-norm, since the impulse response is a scalar times I.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].

    Returns:
        Gains from w to phi, f to phi, w to Omega, f to Omega.
    """
    b = _absolute_integral(k_R, k_omega, 0.0, 1.0)
    return _absolute_integral(k_R, k_omega, 1.0, 0.0), b, k_R * b, _absolute_integral(k_R, k_omega, 1.0, -k_omega)


def _absolute_integral(k_R: float, k_omega: float, y: float, y_dot: float) -> float:
    """Compute `integral |y| dt` of `y'' + k_omega y' + k_R y = 0` exactly, by the primitive `-(y' + k_omega y) / k_R`.

    Between zeros the primitive changes by `|y'(t_1)| / k_R` times a geometric series of ratio `exp(-zeta pi / ...)`.

    Args:
        k_R: Attitude gain over the inertia [1/s^2].
        k_omega: Rate gain over the inertia [1/s].
        y: Initial value.
        y_dot: Initial derivative.

    Returns:
        The integral.
    """
    t, ratio = _first_zero(k_R, k_omega, y, y_dot)
    if t is None:
        return abs(y_dot + k_omega * y) / k_R * (1 + ROUNDING)
    slope = (expm(np.array([[0.0, 1.0], [-k_R, -k_omega]]) * t) @ [y, y_dot])[1]
    first = abs(slope - y_dot - k_omega * y) / k_R if t > 0 else 0.0
    return float(first + abs(slope) / k_R * (1 + ratio) / (1 - ratio)) * (1 + ROUNDING)


def _first_zero(k_R: float, k_omega: float, y: float, y_dot: float) -> tuple[float | None, float]:
    """Return the first time with y = 0, None if there is none, and the ratio of |y'| at consecutive zeros.

    `y = e^{-k_omega t / 2} (y(0) C(t) + q S(t))`, `q = y'(0) + k_omega y(0) / 2`, with cos and sin / w, or cosh and
    sinh / w, where `w^2 = |k_R - k_omega^2 / 4|`.
    """
    square, q = k_R - k_omega * k_omega / 4, y_dot + k_omega * y / 2
    w = float(np.sqrt(abs(square)))
    if square > 0:
        return float(np.arctan2(w * y, -q) % np.pi) / w, float(np.exp(-k_omega / 2 * np.pi / w))
    if y == 0:
        return 0.0, 0.0
    if q * y >= 0 or w * abs(y) >= abs(q):
        return None, 0.0
    return (float(np.arctanh(-w * y / q)) / w if w > 0 else -y / q), 0.0


def _validate(k_R: float, k_omega: float, rho: float) -> None:
    """Raise ValueError for gains that are not positive or a negative disturbance bound."""
    for name, value in (("k_R", k_R), ("k_omega", k_omega)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} = {value}: must be finite and positive for a stable attitude")
    if not (np.isfinite(rho) and rho >= 0):
        raise ValueError(f"rho = {rho} rad/s^2: must be finite and at least 0")
