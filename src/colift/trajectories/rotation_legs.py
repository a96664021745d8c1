"""Rotation legs with given rates at their ends, and the rates of a sequence of attitudes (host).

See Also:
    docs/references: derivation, and the reason why the limits always hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy import special

from colift.trajectories.pose_spline import PiecewisePolynomial, RotationLegs

MAX_TURNING = 1.19
"""Largest length of a leg's path on SO(3), relative to the angle of the leg."""
MAX_TILTING = 1.49
"""Largest angle of the third axis from the axis of a leg on its path, relative to that angle at the ends of the leg."""
NEARLY_HORIZONTAL = 1.48
"""Angle between third axis and axis of a leg [rad] above which `MAX_TILTING` does not apply."""
NO_TURN = 1e-9
"""Angle of a leg without rotation [rad]; the payload is at rest at both ends of such a leg."""
TOLERANCE = 1e-9  # relative, of the limits
BISECTIONS = 45  # steps of the search for a reduction
MAX_PASSES = 60  # passes over all legs


def interpolate_attitudes(t: np.ndarray, R: np.ndarray, delta: np.ndarray | None = None) -> RotationLegs:
    """Compute rotation legs through attitudes at given times, at rest at both ends.

    The rates at inner attitudes are those of `three_point_rates` within the limits of `limit_rates`. The rate of the
    angular acceleration is zero at all attitudes.

    Args:
        t: Times of the n attitudes, ascending [s].
        R: Attitudes, payload to world.
        delta: Rotation vectors of the legs, n - 1 rows of at most pi [rad, payload frame]; default: the shortest ones.

    Returns:
        The legs.
    """
    t, R = np.asarray(t, float), np.asarray(R, float)
    delta = shortest_turns(R) if delta is None else np.asarray(delta, float)
    T = np.diff(t)
    rates = limit_rates(T, delta, three_point_rates(T, delta))
    return rotation_legs(t, R, np.concatenate([rates, np.zeros((len(t), 1, 3))], axis=1), delta)


def rotation_legs(t: np.ndarray, R: np.ndarray, rates: np.ndarray, delta: np.ndarray | None = None) -> RotationLegs:
    """Compute the legs with given attitudes and rates at the knots.

    Args:
        t: Times of the n knots, ascending [s].
        R: Attitudes, payload to world.
        rates: Angular velocity and its first two derivatives, `(n, 3, 3)` [rad, s, payload frame].
        delta: Rotation vectors of the legs, n - 1 rows [rad, payload frame]; by default the shortest ones.

    Returns:
        The legs.
    """
    delta, T = shortest_turns(R) if delta is None else delta, np.diff(t)
    scale = T[:, None, None] ** np.arange(8)[:, None]
    phi = PiecewisePolynomial(
        knots=jnp.asarray(t), coefficients=jnp.asarray(leg_polynomials(T, delta, rates[:-1], rates[1:]) / scale)
    )
    return RotationLegs(phi=phi, R=jnp.asarray(R[:-1]))


def shortest_turns(R: np.ndarray) -> np.ndarray:
    """Return the rotation vectors of `R_k^T R_(k+1)`, one per row [rad, payload frame]."""
    return log(np.swapaxes(R[:-1], 1, 2) @ R[1:])


def leg_polynomials(T: np.ndarray, delta: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Compute the rotation vectors of legs as polynomials of degree 7 of the relative time.

    At the start `phi' = omega`, `phi'' = omega_dot` and `phi''' = omega_ddot + omega x omega_dot / 2`. At the end the
    derivatives follow from `phi' = K(phi) omega` with the inverse right Jacobian
    `K = I + hat(phi) / 2 + c(|phi|^2) hat(phi)^2`.

    Args:
        T: Durations of the legs [s].
        delta: Rotation vectors of the legs [rad].
        start: Angular velocity and its derivatives at the start of each leg, `(legs, 3, 3)`; the second derivative may
            be omitted if it is zero, `(legs, 2, 3)`.
        end: Angular velocity and its derivatives at the end of each leg, of the same shape.

    Returns:
        Coefficients of the powers of `(t - t_k) / T_k`, `(legs, 8, 3)`.
    """
    powers = T[:, None, None] ** np.arange(1, start.shape[1] + 1)[:, None]
    conditions = np.zeros((len(T), 8, 3))
    conditions[:, 1 : start.shape[1] + 1], conditions[:, 4] = powers * start, delta
    conditions[:, 3] += _cross(conditions[:, 1], conditions[:, 2]) / 2
    scaled = powers * end
    conditions[:, 5:] = _end_derivatives(delta, *scaled.swapaxes(0, 1))
    return HERMITE @ conditions


HERMITE = np.linalg.inv(
    [[math.perm(n, k) * s ** (n - k) if n >= k else 0.0 for n in range(8)] for s in (0.0, 1.0) for k in range(4)]
)
"""Coefficients of the polynomial of degree 7 with given derivatives of order 0 to 3 at 0 and 1."""


def _end_derivatives(phi: np.ndarray, w: np.ndarray, w1: np.ndarray, w2: np.ndarray | float = 0.0) -> np.ndarray:
    """Return the first three derivatives of a rotation vector with given angular velocity and its derivatives."""
    w2 = np.broadcast_to(w2, w.shape)
    y = (phi * phi).sum(-1, keepdims=True) / 4
    c, c_x, c_xx = (np.polynomial.polynomial.polyval(y, _JACOBIAN[k]) / 4 ** (k + 1) for k in range(3))
    u = _cross(phi, w)
    v = _cross(phi, u)
    d1 = w + u / 2 + c * v
    x1 = 2 * (phi * d1).sum(-1, keepdims=True)
    u1 = _cross(d1, w) + _cross(phi, w1)
    v1 = _cross(d1, u) + _cross(phi, u1)
    d2 = w1 + u1 / 2 + c_x * x1 * v + c * v1
    x2 = 2 * ((d1 * d1).sum(-1, keepdims=True) + (phi * d2).sum(-1, keepdims=True))
    u2 = _cross(d2, w) + 2 * _cross(d1, w1) + _cross(phi, w2)
    v2 = _cross(d2, u) + 2 * _cross(d1, u1) + _cross(phi, u2)
    d3 = w2 + u2 / 2 + (c_xx * x1**2 + c_x * x2) * v + 2 * c_x * x1 * v1 + c * v2
    return np.stack([d1, d2, d3], axis=1)


_SERIES = [2 * special.zeta(2 * k) / np.pi ** (2 * k) for k in range(1, 40)]
_JACOBIAN = [np.polynomial.polynomial.polyder(_SERIES, k) for k in range(3)]
"""Series of `(1 - h cot h) / h^2` in `h^2` and its first two derivatives; exact to rounding for h up to pi / 2."""


# Rates at the attitudes -----------------------------------------------------------------------------------------------


def three_point_rates(T: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Compute angular velocity and acceleration at the attitudes from neighbouring legs.

    They are those of the parabola through the leg angles: `omega_k = (T_k r_(k-1) + T_(k-1) r_k) / (T_(k-1) + T_k)` and
    `omega_dot_k = 2 (r_k - r_(k-1)) / (T_(k-1) + T_k)` with `r_k = delta_k / T_k`, all in the payload frame.

    Args:
        T: Durations of the legs [s].
        delta: Rotation vectors of the legs [rad, payload frame].

    Returns:
        Angular velocity [rad/s] and acceleration [rad/s^2] by attitude, `(legs + 1, 2, 3)`; zero at both ends.
    """
    rates = np.zeros((len(T) + 1, 2, 3))
    before, after = T[:-1, None], T[1:, None]
    r = delta / T[:, None]
    rates[1:-1, 0] = (after * r[:-1] + before * r[1:]) / (before + after)
    rates[1:-1, 1] = 2 * (r[1:] - r[:-1]) / (before + after)
    return rates


def limit_rates(T: np.ndarray, delta: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Reduce the rates at the attitudes until every leg satisfies both limits.

    Two reductions are used, each at both ends of a leg and by the largest permitted factor c in [0, 1]. The parts of
    angular velocity and acceleration perpendicular to the axis of the leg are multiplied by c if the leg exceeds
    `MAX_TILTING`. Angular velocity and acceleration are multiplied by c and c^2 if it exceeds `MAX_TURNING`. The
    factors are continuous in the data. With zero rates a leg is a rotation about a fixed axis, which satisfies both.

    Args:
        T: Durations of the legs [s].
        delta: Rotation vectors of the legs [rad, payload frame].
        rates: As returned by `three_point_rates`.

    Returns:
        The reduced rates.
    """
    rates, angle = rates.copy(), np.linalg.norm(delta, axis=1)
    still = np.flatnonzero(angle < NO_TURN)
    rates[still] = rates[still + 1] = 0
    colors = [np.arange(first, len(T), 2) for first in (0, 1)]  # the legs of one color have no attitude in common
    for count in range(MAX_PASSES):
        before = rates.copy()
        for legs in (color[angle[color] >= NO_TURN] for color in colors):
            for excess, reduced in ((_tilting, _aligned), (_turning, _slowed)):
                ends = np.stack([rates[legs], rates[legs + 1]], axis=1)
                limited = _reduce(T[legs], delta[legs], ends, excess, reduced, count)
                rates[legs], rates[legs + 1] = limited[:, 0], limited[:, 1]
        if (rates == before).all():
            break
    return rates


Excess = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Function that returns by how much each leg exceeds a limit."""


def _reduce(
    T: np.ndarray,
    delta: np.ndarray,
    ends: np.ndarray,
    excess: Excess,
    reduced: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    count: int,
) -> np.ndarray:
    """Return the rates of legs, reduced until none exceeds a limit; zero rates after half of all passes."""
    over = excess(T, delta, ends) > TOLERANCE
    if not over.any():
        return ends
    T, delta, at = T[over], delta[over], ends[over]
    low, high = np.zeros(len(T)), np.ones(len(T))
    for _ in range(BISECTIONS if count < MAX_PASSES / 2 else 0):
        middle = (low + high) / 2
        far = excess(T, delta, reduced(delta, at, middle)) > 0
        low, high = np.where(far, low, middle), np.where(far, middle, high)
    limited = ends.copy()
    limited[over] = reduced(delta, at, low) if count < MAX_PASSES / 2 else 0
    return limited


def _turning(T: np.ndarray, delta: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the lengths of the paths relative to their limits, less 1."""
    c = leg_polynomials(T, delta, ends[:, 0], ends[:, 1])
    speed = np.linalg.norm(right_jacobian_product(_POWERS[0] @ c, _POWERS[1] @ c), axis=-1)
    return speed @ _SIMPSON / (MAX_TURNING * np.linalg.norm(delta, axis=1)) - 1


def _tilting(T: np.ndarray, delta: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the largest angles between third axis and axis of each leg relative to their limits, less 1."""
    axis = delta / np.linalg.norm(delta, axis=1, keepdims=True)
    tilt = np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), np.abs(axis[:, 2]))
    third = exp(_POWERS[0] @ leg_polynomials(T, delta, ends[:, 0], ends[:, 1]))[..., 2]
    along = (third * axis[:, None]).sum(-1) * np.sign(axis[:, 2:])
    across = np.linalg.norm(_cross(third, axis[:, None]), axis=-1)
    excess = np.arctan2(across, along).max(1) / np.maximum(MAX_TILTING * tilt, NO_TURN) - 1
    return np.where(tilt > NEARLY_HORIZONTAL, -1.0, excess)


def _slowed(delta: np.ndarray, ends: np.ndarray, c: np.ndarray) -> np.ndarray:  # noqa: ARG001
    """Return the rates of a motion that passes both ends more slowly."""
    return ends * np.stack([c, c * c], axis=1)[:, None, :, None]


def _aligned(delta: np.ndarray, ends: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the rates with smaller parts perpendicular to the axis of the leg."""
    axis = (delta / np.linalg.norm(delta, axis=1, keepdims=True))[:, None, None]
    along = (ends * axis).sum(-1, keepdims=True) * axis
    return along + c[:, None, None, None] * (ends - along)


_S = np.linspace(0.0, 1.0, 65)
_SIMPSON = np.array([1.0, *[4.0, 2.0] * 31, 4.0, 1.0]) / (3 * 64)
_POWERS = [
    np.array([[math.perm(n, k) * s ** (n - k) if n >= k else 0.0 for n in range(8)] for s in _S]) for k in (0, 1)
]


# SO(3) without JAX ----------------------------------------------------------------------------------------------------


def exp(theta: np.ndarray) -> np.ndarray:
    """Return the rotations of rotation vectors; leading axes are batch axes."""
    sinc, cosc, _ = _coefficients(theta)
    hat = _cross(theta[..., None, :], np.eye(3)).swapaxes(-1, -2)
    return np.eye(3) + sinc[..., None, None] * hat + cosc[..., None, None] * hat @ hat


def log(R: np.ndarray) -> np.ndarray:
    """Return the rotation vectors of rotations `(n, 3, 3)`, of length up to pi."""
    q = quaternion(R)
    n = np.linalg.norm(q[:, 1:], axis=1)
    half = np.arctan2(n, q[:, 0])
    return 2 * np.where(n > 0, half / np.where(n > 0, n, 1.0), 1.0)[:, None] * q[:, 1:]


def quaternion(R: np.ndarray) -> np.ndarray:
    """Return the unit quaternions `(w, x, y, z)` with `w >= 0` of rotations `(n, 3, 3)`; see `so3.quaternion`."""
    w, v = np.trace(R, axis1=1, axis2=2), np.stack([R[:, 2, 1], R[:, 0, 2], R[:, 1, 0]], axis=1)
    u = np.stack([R[:, 1, 2], R[:, 2, 0], R[:, 0, 1]], axis=1)
    rows = np.empty((len(R), 4, 4))  # 4 q q^T
    rows[:, 0, 0] = 1 + w
    rows[:, 0, 1:] = rows[:, 1:, 0] = v - u
    rows[:, 1:, 1:] = R + np.swapaxes(R, 1, 2) + (1 - w)[:, None, None] * np.eye(3)
    best = np.argmax((rows * rows).sum(-1), axis=1)
    q = rows[np.arange(len(R)), best]
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    return np.where(q[:, :1] < 0, -q, q)


def rotation(q: np.ndarray) -> np.ndarray:
    """Return the rotations of unit quaternions `(w, x, y, z)`; leading axes are batch axes."""
    w, v = q[..., :1, None], q[..., 1:]
    hat = _cross(v[..., None, :], np.eye(3)).swapaxes(-1, -2)
    return np.eye(3) + 2 * w * hat + 2 * hat @ hat


def right_jacobian_product(theta: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the angular velocities `(I - cosc hat + c hat^2) rate` of rotation vectors with given rates."""
    _, cosc, c = _coefficients(theta)
    once = _cross(theta, rate)
    return rate - cosc[..., None] * once + c[..., None] * _cross(theta, once)


def _coefficients(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `sin t / t`, `(1 - cos t) / t^2` and `(t - sin t) / t^3` of the lengths t of rotation vectors."""
    t2 = (theta * theta).sum(-1)
    small = t2 < 1e-4
    t = np.sqrt(np.where(small, 1.0, t2))
    return (
        np.where(small, 1 - t2 / 6 * (1 - t2 / 20), np.sin(t) / t),
        np.where(small, 0.5 - t2 / 24 * (1 - t2 / 30), 2 * (np.sin(t / 2) / t) ** 2),
        np.where(small, (1 - t2 / 20 * (1 - t2 / 42)) / 6, (t - np.sin(t)) / t**3),
    )


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return `a x b`; faster than `numpy.cross` for small arrays."""
    (a1, a2, a3), (b1, b2, b3) = (np.moveaxis(x, -1, 0) for x in (a, b))
    return np.stack([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1], axis=-1)
