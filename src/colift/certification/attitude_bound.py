"""The ultimate bound of the payload's attitude, and the set of states from which it is reached.

`e_R' = E e_omega`, `e_omega' = -k_R e_R - k_omega e_omega + d`, `|d(t)|_2 <= rho` (Eq. err_eomega_learning over J_L),
with the gains of decision 0006, `K_R = k_R J`, `K_omega = k_omega J`. Two tools, both exact algebra:

- `trap`: `V = a Psi + |e_omega|^2 / 2 + c e_R . e_omega`, `a = k_R + c k_omega`, which falls wherever the state is not
  small: the region of attraction, and a first ultimate bound.
- `shrink`: peak gains in the rotation vector `phi` (angle `theta`) and the rate `Omega = exp(hat(phi) / 2) e_omega`,
  seen half-way between the two attitudes, in which the equations are linear up to terms of third order.

Derivations: `docs/certificate.md`, "Rotation". Angles rad, rates rad/s, k_R and rho 1/s^2, k_omega 1/s.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

ROUNDING = 1e-9  # relative; every bound here is a few dozen operations on positive numbers


@dataclasses.dataclass(frozen=True)
class RegionOfAttraction:
    """States `V <= level`, `Psi <= Psi_edge`, from which `V` falls to its ultimate level: a region of attraction.

    `V = a Psi + |e_omega|^2 / 2 + c e_R . e_omega`; its limit is at most `settled`. `angle_at_rest` is the
    greatest initial angle without rate, `rate_aligned` the greatest initial `|e_omega|` without attitude error.
    """

    a: float
    c: float
    level: float
    ultimate_level: float
    Psi_edge: float
    angle_at_rest: float
    rate_aligned: float

    def contains(self, angle: float, rate: float) -> bool:
        """Whether every start with at most that angle, rad, and `|e_omega|`, rad/s, lies in the region."""
        return bool(1 - np.cos(angle) <= self.Psi_edge and self.value(angle, rate) <= self.level)

    def value(self, angle: float, rate: float) -> float:
        """The greatest V over all states with at most that angle, rad, and `|e_omega|`, rad/s."""
        Psi, sine = 1 - np.cos(angle), np.sin(min(angle, np.pi / 2))
        return float(self.a * Psi + rate * rate / 2 + self.c * sine * rate)


@dataclasses.dataclass(frozen=True)
class AttitudeBound:
    """Ultimate bounds on the angle of `R_d^T R`, `Psi`, `|e_R|_2` and `|e_omega|_2`, valid from all of `region`.

    `by_trap` is the angle that the Lyapunov function alone gives; `method` says which of the two gave `angle`.
    `angle_from_rest` and `rate_from_rest` hold at all times from zero error (infinite where that is not shown).
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
    """Bounds on what is left of any start in the region of attraction, for every d with `|d(t)|_2 <= rho`.

    Raises ValueError where no region of attraction is found, with the greatest rho for which one is.
    """
    _check(k_R, k_omega, rho)
    region = region_of_attraction(k_R, k_omega, rho)
    if region is None:
        raise ValueError(
            f"no certificate for rho = {rho:.6g} rad/s^2 at k_R = {k_R:.6g} and k_omega = {k_omega:.6g}: every level "
            f"set of V has a place where V may grow; up to rho = {max_disturbance(k_R, k_omega):.4g} rad/s^2 one has none"
        )
    trapped = lyapunov_bound(k_R, k_omega, rho, region)
    angle, rate = refine_bound(k_R, k_omega, rho, trapped)
    from_rest = transient_bound(k_R, k_omega, rho, 0.0, 0.0)
    return AttitudeBound(
        angle=angle,
        Psi=float(1 - np.cos(angle)),
        e_R=float(np.sin(min(angle, np.pi / 2))),
        e_omega=rate,
        method="small gain" if angle < trapped[0] else "Lyapunov",
        lyapunov_bound=trapped[0],
        angle_from_rest=from_rest[0],
        rate_from_rest=from_rest[1],
        region=region,
    )


def max_disturbance(k_R: float, k_omega: float) -> float:
    """The greatest rho for which `attraction` finds a region, to 1e-4."""
    low, high = 0.0, k_R  # a steady disturbance of k_R overturns the payload
    while high - low > 1e-4 * k_R:
        middle = (low + high) / 2
        low, high = (middle, high) if region_of_attraction(k_R, k_omega, middle) else (low, middle)
    return low


# -- the Lyapunov function -------------------------------------------------------------------------------------------


def region_of_attraction(k_R: float, k_omega: float, rho: float) -> RegionOfAttraction | None:
    """The region of attraction whose angle at rest is greatest, over c; None if no c gives one.

    With `a = k_R + c k_omega`, `V' <= -q + sqrt(q q_star)`, `q = (k_omega - c) |e_omega|^2 + c k_R |e_R|^2`: V falls
    wherever `q > q_star`, hence for `|e_R|^2 > q_star / (c k_R)`, and on every level set up to the edge of that.
    """
    found = [region for c in _shares(k_omega) if (region := _region(k_R, k_omega, rho, c))]
    if not found:
        return None
    start = max(found, key=lambda region: region.angle_at_rest).c

    def loss(c: float) -> float:
        region = _region(k_R, k_omega, rho, c)
        return -region.angle_at_rest if region else 0.0

    refined = minimize_scalar(loss, bounds=(start * 0.8, min(start * 1.25, 0.999 * k_omega)), method="bounded")
    found += [region] if (region := _region(k_R, k_omega, rho, float(refined.x))) else []
    return max(found, key=lambda region: region.angle_at_rest)


def lyapunov_bound(k_R: float, k_omega: float, rho: float, region: RegionOfAttraction) -> tuple[float, float]:
    """Ultimate bounds on angle and `|e_omega|` by the Lyapunov function: by the region's c, then by any that applies.

    Once `Psi <= Psi_1` for good, every c with `Psi_1` inside its own edge bounds the limit; the smallest is taken.
    """
    angle, rate = _within(k_R, k_omega, region.c, region.ultimate_level)
    regions = [r for c in _shares(k_omega) if (r := _region(k_R, k_omega, rho, c))]
    for _ in range(2):
        both = [_within(k_R, k_omega, r.c, r.ultimate_level) for r in regions if 1 - np.cos(angle) < r.Psi_edge]
        angle, rate = min([angle, *(b[0] for b in both)]), min([rate, *(b[1] for b in both)])
    return angle, rate


def _shares(k_omega: float) -> list[float]:
    """Candidates for c: each is a proof of its own, so that a coarse choice costs size, never truth."""
    shares = np.concatenate([np.geomspace(1e-6, 0.02, 12, endpoint=False), np.linspace(0.02, 0.98, 49)])
    return [float(k_omega * share) for share in shares]


def _unsettled(k_R: float, k_omega: float, rho: float, c: float) -> float:
    """`q_star = rho^2 (1 / (k_omega - c) + c / k_R)`: V falls wherever q exceeds it (Cauchy-Schwarz)."""
    return rho * rho * (1 / (k_omega - c) + c / k_R) * (1 + ROUNDING)


def _region(k_R: float, k_omega: float, rho: float, c: float) -> RegionOfAttraction | None:
    """The greatest region of one c, or None: `sine^2 = q_star / (c k_R)` must be below 1, and `a > c^2`."""
    a, sine2 = k_R + c * k_omega, _unsettled(k_R, k_omega, rho, c) / (c * k_R)
    if sine2 >= 1 or a <= c * c:
        return None
    edge = (1 + float(np.sqrt(1 - sine2))) * (1 - ROUNDING)  # Psi of pi - arcsin(sine)
    level = a * edge - c * c / 2 * edge * (2 - edge)  # the least of V at that Psi, over e_omega
    settled = _settled_level(k_R, k_omega, rho, c)
    if level <= settled:
        return None
    return RegionOfAttraction(a, c, level, settled, edge, float(np.arccos(1 - level / a)), float(np.sqrt(2 * level)))


def _settled_level(k_R: float, k_omega: float, rho: float, c: float) -> float:
    """The greatest V with `q <= q_star` and `Psi < 1`: `q_star` times the greatest eigenvalue of a 2 x 2 pencil."""
    q_star = _unsettled(k_R, k_omega, rho, c)
    convex = 1 + np.sqrt(1 - q_star / (c * k_R))  # Psi <= |e_R|^2 / (1 + cos theta)
    x, y = (k_R + c * k_omega) / convex / (c * k_R), 0.5 / (k_omega - c)
    z = 0.5 * c / np.sqrt(c * k_R * (k_omega - c))
    return float(q_star * ((x + y) / 2 + np.hypot((x - y) / 2, z))) * (1 + ROUNDING)


def _within(k_R: float, k_omega: float, c: float, level: float) -> tuple[float, float]:
    """The greatest angle and `|e_omega|` where V is at most that level."""
    a = k_R + c * k_omega
    b = a - c * c  # c^2/2 Psi^2 + b Psi <= level, and (1 - c^2 / a) |e_omega|^2 / 2 <= level
    Psi = 2 * level / (b + np.sqrt(b * b + 2 * c * c * level))
    return float(np.arccos(1 - Psi) * (1 + ROUNDING)), float(np.sqrt(2 * level * a / b) * (1 + ROUNDING))


# -- the small-gain iteration ----------------------------------------------------------------------------------------


def refine_bound(
    k_R: float, k_omega: float, rho: float, bounds: tuple[float, float], free: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Bounds on angle and rate from earlier ones: `x <- min(x, free + F(x))` until it stays; every iterate is a bound.

    `phi' = Omega + (theta / (2 sin(theta / 2)) - 1) Omega_across` and
    `Omega' = -k_R phi - k_omega Omega + d + k_R (theta - sin theta) n + g`, `|g| <= tan(theta / 4) |Omega|^2 / 2`.
    F is what the peak gains of the linear part make of the greatest sizes of the rest; it grows with both. `free` is
    the peak of the free linear response: nothing for bounds in the limit.
    """
    peaks = peak_gains(k_R, k_omega)
    while True:
        push = _push(peaks, k_R, rho, *bounds)
        new = min(bounds[0], free[0] + push[0]), min(bounds[1], free[1] + push[1])
        if new[0] >= bounds[0] * (1 - ROUNDING) and new[1] >= bounds[1] * (1 - ROUNDING):
            return bounds
        bounds = new


def transient_bound(k_R: float, k_omega: float, rho: float, angle: float, rate: float) -> tuple[float, float]:
    """Bounds at all times on angle and `|e_omega|` after a start with at most these; infinite where none is found.

    The smaller of two: what `shrink` makes of the best bound by the level set that the start is on, and a pair x
    with `free + F(x) < x`, which is never reached from below.
    """
    _check(k_R, k_omega, rho)
    free = _free(k_R, k_omega, angle, rate)
    found = [_never_reached(k_R, k_omega, rho, free)]
    for c in _shares(k_omega):
        region = _region(k_R, k_omega, rho, c)
        if region and region.contains(angle, rate):
            found.append(_within(k_R, k_omega, c, max(region.value(angle, rate), region.ultimate_level)))
    best = min(x[0] for x in found), min(x[1] for x in found)
    return refine_bound(k_R, k_omega, rho, best, free) if np.isfinite(best).all() else best


def _never_reached(k_R: float, k_omega: float, rho: float, free: tuple[float, float]) -> tuple[float, float]:
    """The least x found with `free + F(x) < x`, from below; infinite where none is."""
    peaks, x = peak_gains(k_R, k_omega), free
    while x[0] < np.pi and math.isfinite(x[1]):
        push = _push(peaks, k_R, rho, *x)
        new = free[0] + push[0], free[1] + push[1]
        if new[0] < x[0] and new[1] < x[1]:
            return x
        x = new[0] * (1 + 1e-6) + 1e-12, new[1] * (1 + 1e-6) + 1e-12  # its fixed point is just above that of F
    return np.inf, np.inf


def _free(k_R: float, k_omega: float, angle: float, rate: float) -> tuple[float, float]:
    """Peaks of `|phi|` and `|Omega|` of the free linear response: its energy `|Omega|^2 + k_R |phi|^2` never grows."""
    w = float(np.sqrt(abs(k_R - k_omega * k_omega / 4)))
    t = 2 / k_omega  # of the greatest phi from a rate of 1, at critical damping
    if w > 0:
        t = float(np.arctan2(w, k_omega / 2) if 4 * k_R > k_omega * k_omega else np.arctanh(2 * w / k_omega)) / w
    peak = float(expm(np.array([[0.0, 1.0], [-k_R, -k_omega]]) * t)[0, 1]) * (1 + ROUNDING)
    return angle + peak * rate, k_R * peak * angle + rate


def _push(
    peaks: tuple[float, float, float, float], k_R: float, rho: float, angle: float, rate: float
) -> tuple[float, float]:
    """F: what disturbance and nonlinear rest make of bounds on angle (below pi) and rate, by the peak gains."""
    across = (angle / 2 / math.sin(angle / 2) - 1 if angle > 1e-4 else angle * angle / 23) * rate
    softening = angle - math.sin(angle) if angle > 1e-2 else angle**3 / 6
    force = rho + k_R * softening + math.tan(angle / 4) * rate * rate / 2
    return peaks[0] * across + peaks[1] * force, peaks[2] * across + peaks[3] * force


def peak_gains(k_R: float, k_omega: float) -> tuple[float, float, float, float]:
    """Peak gains of `phi' = Omega + w, Omega' = -k_R phi - k_omega Omega + f`: w and f to phi, then to Omega.

    Times three decoupled axes they are the gains in the 2-norm: the impulse response is a scalar times I.
    """
    b = _area(k_R, k_omega, 0.0, 1.0)
    return _area(k_R, k_omega, 1.0, 0.0), b, k_R * b, _area(k_R, k_omega, 1.0, -k_omega)


def _area(k_R: float, k_omega: float, y: float, y_dot: float) -> float:
    """`integral |y| dt` of `y'' + k_omega y' + k_R y = 0`: exact, by the primitive `-(y' + k_omega y) / k_R`.

    Between zeros the primitive changes by `|y'(t_1)| / k_R` times a geometric series of ratio `exp(-zeta pi / ...)`.
    """
    t, ratio = _first_zero(k_R, k_omega, y, y_dot)
    if t is None:
        return abs(y_dot + k_omega * y) / k_R * (1 + ROUNDING)
    slope = (expm(np.array([[0.0, 1.0], [-k_R, -k_omega]]) * t) @ [y, y_dot])[1]
    first = abs(slope - y_dot - k_omega * y) / k_R if t > 0 else 0.0
    return float(first + abs(slope) / k_R * (1 + ratio) / (1 - ratio)) * (1 + ROUNDING)


def _first_zero(k_R: float, k_omega: float, y: float, y_dot: float) -> tuple[float | None, float]:
    """The first time with y = 0, None if there is none, and by how much |y'| falls from one zero to the next.

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


def _check(k_R: float, k_omega: float, rho: float) -> None:
    for name, value in (("k_R", k_R), ("k_omega", k_omega)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} = {value}: must be finite and positive, or the attitude is not stable")
    if not (np.isfinite(rho) and rho >= 0):
        raise ValueError(f"rho = {rho} rad/s^2: must be finite and not negative")
