"""Smoothing spline through a table of poses (host).

The position is a least-squares spline of degree 5 with knots at every q-th row. The attitude is a cumulative B-spline
on SO(3) of the same degree; its residual, a rotation vector in the payload frame, is fitted by the same basis. The
number of knots follows from a stated deviation, or from generalized cross-validation.

References:
    de Boor, *A Practical Guide to Splines*, 2001, ch. 14.
    Craven, Wahba, *Smoothing noisy data with spline functions*, Numerische Mathematik 31, 1979.
    Sommer et al., *Efficient derivative computation for cumulative B-splines on Lie groups*, CVPR 2020.
    Kim, Gu, *Smoothing spline Gaussian regression*, J. R. Statist. Soc. B 66, 2004 (the factor `GCV_FACTOR`).

See Also:
    docs/references: derivation.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy import interpolate, linalg
from scipy.sparse import linalg as sparse_linalg

from colift.trajectories.knots import POSITION_COLUMNS
from colift.trajectories.limited_acceleration import SecondDifferences, limited_coefficients, second_differences
from colift.trajectories.pose_spline import PiecewisePolynomial, PoseSpline
from colift.trajectories.rotation_legs import (
    HERMITE,
    exp,
    leg_polynomials,
    limit_rates,
    log,
    quaternion,
    rotation,
    rotation_legs,
    shortest_turns,
    three_point_rates,
)

POSITION_LIMITS = (1e-3, 1e-2)
"""Largest distance of a row, and largest deviation of noise, without a stated deviation [m]."""
ATTITUDE_LIMITS = (2e-3, 2e-2)
"""Largest angle of a row, and largest deviation of noise, without a stated deviation [rad]."""
DEGREE = 5
REFINEMENT = 1.5
"""Ratio of the numbers of knots of two successive fits."""
GCV_FACTOR = 1.4
"""Weight of the degrees of freedom in generalized cross-validation; larger than 1, it avoids fits of the noise."""
CONVERGED = 0.03
"""Change of the acceleration, and deviation relative to its limit, below which a finer fit is not tried."""
MAX_LEGS = 4000
"""Largest number of legs."""
MAX_TO_RMS = 10.0
"""Largest ratio of the largest and the root-mean-square deviation of noise."""
MAX_EXCESS = 0.05
"""Largest relative excess of the acceleration of the path over that of the table."""
MIN_EXCESS = 0.01
"""Excess of the acceleration that is disregarded [m/s^2]."""
MAX_STEP_DEVIATION = 4e-3
"""Largest deviation of a path that a path with limits may replace [m]."""
MAX_SHARE = 0.37
"""Largest share of a tenth of the rows in the squared deviation of noise; normal noise of three axes has 0.27."""
TIMES_PER_LEG = 8
"""Times in each leg at which the acceleration is evaluated."""
FINER_FITS = 6
"""Number of finer fits that are tried after the best one."""
MAX_LEG_TURN = 1.0
"""Largest sum of rotations between the rows of one leg [rad]."""
ROTATION_ITERATIONS = 6
ROTATION_TOLERANCE = 1e-7
CHUNK = 64
STOPPING_TIME = 1.0
"""Shortest time in which the reference comes to rest after the last row [s]."""
MAX_STOPPING_TURN = 4.0
"""Largest product of the angular velocity at the last row and the time to rest [rad]."""
STOPPING_ACCELERATION = (0.5, 0.5)
"""Least acceleration [m/s^2] and angular acceleration [rad/s^2] of that motion; the root mean square of the table
applies if it is larger."""


@dataclasses.dataclass(frozen=True)
class SplineKnots:
    """Knots of a spline and the derivatives there, from which `pose_spline` makes the trajectory.

    Attributes:
        position: Rows of time [s], position, velocity, acceleration and jerk [m, s, world], `(knots, 13)`.
        attitude: Rows of time [s], quaternion (w, x, y, z), angular velocity and its first two derivatives
            [rad, s, payload frame], `(knots, 14)`.
    """

    position: np.ndarray
    attitude: np.ndarray


@dataclasses.dataclass(frozen=True)
class SampleFit:
    """Spline through a table, with its deviations from the rows.

    Attributes:
        knots: The spline.
        deviation: Root-mean-square distance of the rows from the path [m].
        angle: Root-mean-square angle between the attitudes of the rows and the spline [rad].
        largest_deviation: Largest distance [m].
        largest_angle: Largest angle [rad].
        choices: Deviation [m] and largest acceleration [m/s^2] of the splines that were tried, fewest knots first; the
            last one was chosen.
        attitude_choices: Deviation [rad] and largest acceleration [rad/s^2] of the attitude splines that were tried.
    """

    knots: SplineKnots
    deviation: float
    angle: float
    largest_deviation: float
    largest_angle: float
    choices: np.ndarray
    attitude_choices: np.ndarray


@dataclasses.dataclass(frozen=True)
class _Fit:
    """Fit with a number of legs: derivatives at the knots, residual by row, acceleration by row."""

    freedom: int  # number of coefficients per component
    knots: np.ndarray
    states: np.ndarray
    residual: np.ndarray
    acceleration: np.ndarray

    @property
    def deviation(self) -> float:
        return float(np.sqrt((self.residual**2).mean()))

    def follows_rows(self, largest: float, limit: float) -> bool:
        """Return whether all rows are close to the path, or their deviations have the distribution of noise."""
        far = float(self.residual.max())
        return far <= largest or (self.deviation <= limit and far <= MAX_TO_RMS * self.deviation)

    @property
    def gcv(self) -> float:
        left = len(self.residual) - GCV_FACTOR * self.freedom
        return math.inf if left <= 0 else float((self.residual**2).sum() / left**2)


def fit_samples(
    t: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    deviation: float | None = None,
    angle: float | None = None,
) -> SampleFit:
    """Fit a smoothing spline to poses at given times.

    Args:
        t: Times of the n rows, ascending [s].
        p: Positions, one per row [m, world].
        R: Attitudes, payload to world.
        deviation: Root-mean-square distance of the rows from the path [m]; the spline with the fewest knots within it
            is chosen. None selects the spline by generalized cross-validation, or the one through the rows if that
            spline does not follow them (`POSITION_LIMITS`).
        angle: Root-mean-square angle of the attitudes of the rows from the spline [rad], used like `deviation`.

    Returns:
        The spline and its deviations.

    Raises:
        ValueError: If there are fewer than two rows, the numbers of times and poses differ, or the times do not ascend.
    """
    t, p, R = np.asarray(t, float), np.asarray(p, float), np.asarray(R, float)
    if len(t) < 2 or len(p) != len(t) or len(R) != len(t):
        raise ValueError(
            f"table: {len(t)} times for {len(p)} positions and {len(R)} attitudes; at least two are needed"
        )
    if not (np.diff(t) > 0).all():
        raise ValueError(f"table: the time must ascend, but row {int(np.argmin(np.diff(t) > 0)) + 2}")
    paths = _select(len(t), lambda legs: _fit_position(t, p, legs), deviation, POSITION_LIMITS)
    paths += _limited_path(t, p, paths[-1], deviation)
    turning = np.concatenate([[0.0], np.linalg.norm(shortest_turns(R), axis=1).cumsum()])
    if turning[-1] == 0:
        constant = _rows(np.repeat(R[:1], 2, axis=0), np.zeros((2, 3, 3)))
        attitudes = [_Fit(1, t[[0, -1]], constant, np.zeros(len(t)), np.zeros((len(t), 3)))]
    else:
        attitudes = _select(len(t), lambda legs: _fit_attitude(t, R, turning, legs), angle, ATTITUDE_LIMITS)
    path, attitude = paths[-1], attitudes[-1]
    knots = SplineKnots(
        position=_with_rest(path, _moved_position, STOPPING_ACCELERATION[0]),
        attitude=_with_rest(attitude, _moved_attitude, STOPPING_ACCELERATION[1]),
    )
    return SampleFit(
        knots=knots,
        deviation=path.deviation,
        angle=attitude.deviation,
        largest_deviation=float(path.residual.max()),
        largest_angle=float(attitude.residual.max()),
        choices=np.array([[each.deviation, np.linalg.norm(each.acceleration, axis=1).max()] for each in paths]),
        attitude_choices=np.array(
            [[each.deviation, np.linalg.norm(each.acceleration, axis=1).max()] for each in attitudes]
        ),
    )


def _select(
    rows: int, fit: Callable[[int], _Fit | None], stated: float | None, default: tuple[float, float]
) -> list[_Fit]:
    """Return all fits that were tried, by number of legs; the selected one is the last.

    With a stated deviation the fit with the fewest legs within it is selected. Otherwise it is the fit of generalized
    cross-validation if it follows the rows (`_Fit.follows_rows`), or else the finest one.
    """
    fits: list[_Fit] = []
    for found in filter(None, map(fit, _leg_numbers(rows))):
        fits.append(found)
        best = int(np.argmin([each.gcv for each in fits]))
        if stated is not None and found.deviation <= stated:
            return fits
        done = _converged(fits, default[0]) or best < len(fits) - FINER_FITS
        if stated is None and done and fits[best].follows_rows(*default):
            return fits[: best + 1]
    return fits[: best + 1] if stated is None and fits[best].follows_rows(*default) else fits


def _leg_numbers(rows: int) -> list[int]:
    """Return the numbers of legs that are tried, ascending."""
    finest = min(max(rows - DEGREE, 1), MAX_LEGS)
    numbers = [math.ceil(REFINEMENT**k) for k in range(100) if REFINEMENT**k <= finest / 2] + [finest]
    return list(dict.fromkeys(numbers))


def _limited_path(t: np.ndarray, p: np.ndarray, path: _Fit, stated: float | None) -> list[_Fit]:
    """Return a path within the acceleration of the table where `path` exceeds it or misses steps, or an empty list.

    A path is admissible if all rows are within the first of `POSITION_LIMITS`, and their deviation within a stated one.
    """
    if path.freedom >= len(t) or path.deviation > MAX_STEP_DEVIATION:
        return []
    peak = _largest_acceleration(path)
    finest = [legs for legs in (len(t) - 1, 2 * len(t) - 2) if legs <= MAX_LEGS]  # knots at and between all rows
    numbers = [legs for legs in [*_leg_numbers(len(t)), *finest] if legs >= len(path.knots) - 1]
    for noise in (path.deviation, 0.0):  # the deviation may be that of a step instead of noise
        table = second_differences(t, p, noise, peak)
        most = table.largest + max(MAX_EXCESS * table.largest, MIN_EXCESS)
        if peak <= most and not (noise and _misses_steps(path)):
            continue
        for found in (_fit_position(t, p, legs, table) for legs in numbers):
            close = found.residual.max() <= POSITION_LIMITS[0] and found.deviation <= (stated or math.inf)
            if close and _largest_acceleration(found) <= most:
                return [found]
    return []


def _misses_steps(path: _Fit) -> bool:
    """Return whether rows are far from the path, but not by noise: few rows have most of the squared deviation."""
    squares = np.sort(path.residual**2)[::-1]
    share = float(squares[: max(len(squares) // 10, 1)].sum() / max(squares.sum(), 1e-30))
    return bool(path.residual.max() > POSITION_LIMITS[0] and share > MAX_SHARE)


def _largest_acceleration(path: _Fit) -> float:
    """Return the largest acceleration on the path, also between its knots [m/s^2]."""
    a, j = path.states[:, 6:9], path.states[:, 9:12]
    times = np.linspace(path.knots[:-1], path.knots[1:], TIMES_PER_LEG, endpoint=False).ravel()
    inner = interpolate.CubicHermiteSpline(path.knots, a, j)(np.append(times, path.knots[-1]))
    return float(np.linalg.norm(inner, axis=1).max())


def _converged(fits: list[_Fit], limit: float) -> bool:
    """Return whether the last refinement changed neither path nor acceleration by much."""
    last, change = fits[-1], math.inf
    if len(fits) > 1:
        change = float(np.abs(last.acceleration - fits[-2].acceleration).max())
    return last.deviation <= CONVERGED * limit and change <= CONVERGED * float(np.abs(last.acceleration).max()) + 1e-6


class _Basis:
    """B-splines with knots at every q-th row, and the least-squares fit of their coefficients."""

    def __init__(self, t: np.ndarray, legs: int) -> None:
        self.degree = min(DEGREE, len(t) - 1)
        self.rows = np.unique(np.linspace(0, len(t) - 1, legs + 1).round().astype(int))
        inner = t[self.rows[1:-1]]
        if legs >= len(t):  # knots also between the rows, for a path with limits
            inner = np.interp(np.linspace(0, len(t) - 1, legs + 1)[1:-1], np.arange(len(t)), t)
        if len(inner) + self.degree + 1 == len(t):  # as many coefficients as rows: knots between rows, to interpolate
            inner = np.array([t[k + 1 : k + 1 + self.degree].mean() for k in range(len(inner))])
        ends = np.repeat(t[[0]], self.degree + 1), np.repeat(t[[-1]], self.degree + 1)
        self.t = np.concatenate([ends[0], inner, ends[1]])
        self.knots, self.count = self.t[self.degree : -self.degree], len(inner) + self.degree + 1
        self.B = interpolate.BSpline.design_matrix(t, self.t, self.degree)

    @functools.cached_property
    def _solve(self) -> Callable[[np.ndarray], np.ndarray]:
        """Return the interpolation if there are as many coefficients as rows, or the least-squares solution."""
        return sparse_linalg.splu(self.B.tocsc()).solve if self.count == self.B.shape[0] else self._normal_equations()

    def _normal_equations(self) -> Callable[[np.ndarray], np.ndarray]:
        """Return the least-squares solution by Cholesky factorization, with one step of iterative refinement."""
        N = (self.B.T @ self.B).tocsr()
        banded = np.zeros((self.degree + 1, self.count))
        for k in range(self.degree + 1):
            banded[k, : self.count - k] = N.diagonal(-k)
        factor = linalg.cholesky_banded(banded, lower=True), True

        def solve(y: np.ndarray) -> np.ndarray:
            c = linalg.cho_solve_banded(factor, self.B.T @ y)
            return c + linalg.cho_solve_banded(factor, self.B.T @ (y - self.B @ c))

        return solve

    def fit(self, y: np.ndarray) -> np.ndarray:
        """Return the coefficients of the columns of y."""
        return self._solve(y)

    def derivatives(self, c: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
        """Return the spline and its first three derivatives."""
        spline = interpolate.BSpline(self.t, c, self.degree)
        return [spline(t, nu) if nu <= self.degree else np.zeros((len(t), *c.shape[1:])) for nu in range(4)]

    def greville(self) -> np.ndarray:
        """Return the time of each coefficient, the mean of its knots."""
        return np.array([self.t[k + 1 : k + 1 + self.degree].mean() for k in range(self.count)])


def _fit_position(t: np.ndarray, p: np.ndarray, legs: int, limits: SecondDifferences | None = None) -> _Fit:
    """Fit the position with a number of legs, within the range of second differences if they are given."""
    basis = _Basis(t, legs)
    c = basis.fit(p) if limits is None else limited_coefficients(basis.B, basis.t, basis.degree, p, limits)
    return _Fit(
        freedom=basis.count,
        knots=basis.knots,
        states=np.concatenate(basis.derivatives(c, basis.knots), axis=1),
        residual=np.linalg.norm(p - basis.B @ c, axis=1),
        acceleration=basis.derivatives(c, t)[2],
    )


def _fit_attitude(t: np.ndarray, R: np.ndarray, turning: np.ndarray, legs: int) -> _Fit | None:
    """Fit a cumulative B-spline to attitudes; None if a leg would turn too far for its direction to be known.

    `R(t) = Q_0 prod_j exp(sum_(k >= j) B_k(t) d_j)` with `d_j = log(Q_(j-1)^T Q_j)`. The residual
    `e = log(R(t)^T R_row)` is fitted by the same B-splines, and `Q_j` becomes `Q_j exp(e_j)`, until e vanishes.
    """
    if legs >= len(t) - DEGREE:
        return _through_rows(t, R)
    basis = _Basis(t, legs)
    if np.diff(turning[basis.rows]).max() > MAX_LEG_TURN:
        return None
    Q = _interpolated(t, R, basis.greville())
    for _ in range(ROTATION_ITERATIONS):
        e = basis.fit(log(np.swapaxes(_cumulative(basis, Q), 1, 2) @ R))
        Q = Q @ exp(e)
        if np.abs(e).max() < ROTATION_TOLERANCE:
            break
    return _attitude_fit(t, R, basis.count, basis.knots, *_cumulative_derivatives(basis, Q))


def _through_rows(t: np.ndarray, R: np.ndarray) -> _Fit:
    """Return legs through all rows, with the rates of neighbouring rows."""
    T, delta = np.diff(t), shortest_turns(R)
    rates = three_point_rates(T, delta)
    rates[[0, -1], 0] = delta[[0, -1]] / T[[0, -1], None]
    rates = np.concatenate([limit_rates(T, delta, rates), np.zeros((len(t), 1, 3))], axis=1)
    return _attitude_fit(t, R, len(t), t, R, rates)


def _attitude_fit(
    t: np.ndarray, R: np.ndarray, freedom: int, knots: np.ndarray, Q: np.ndarray, rates: np.ndarray
) -> _Fit:
    """Return the fit with given attitudes and rates at the knots."""
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    T = np.diff(knots)
    c = leg_polynomials(T, shortest_turns(Q), rates[:-1], rates[1:])[i]
    s = (t - knots[i]) / T[i]
    phi = (c * (s[:, None] ** np.arange(8))[:, :, None]).sum(1)
    residual = np.linalg.norm(log(np.swapaxes(Q[i] @ exp(phi), 1, 2) @ R), axis=1)
    acceleration = interpolate.CubicHermiteSpline(knots, rates[:, 1], rates[:, 2])(t)
    return _Fit(freedom, knots, _rows(Q, rates), residual, acceleration)


def _interpolated(t: np.ndarray, R: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return attitudes between rows by rotation about a fixed axis."""
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    share = (at - t[i]) / (t[i + 1] - t[i])
    return R[i] @ exp(share[:, None] * log(np.swapaxes(R[i], 1, 2) @ R[i + 1]))


def _cumulative(basis: _Basis, Q: np.ndarray) -> np.ndarray:
    """Evaluate the cumulative B-spline at the rows."""
    width = basis.degree + 1
    first, weights = basis.B.indices[::width], basis.B.data.reshape(-1, width)
    above = np.cumsum(weights[:, ::-1], axis=1)[:, ::-1]
    d = log(np.swapaxes(Q[:-1], 1, 2) @ Q[1:])
    R = Q[first]
    for j in range(1, width):
        R = R @ exp(above[:, j, None] * d[first + j - 1])
    return R


def _cumulative_derivatives(basis: _Basis, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return attitude, and angular velocity and its first two derivatives, at the knots (Sommer et al. 2020)."""
    d, knots = log(np.swapaxes(Q[:-1], 1, 2) @ Q[1:]), basis.knots
    first = np.clip(np.arange(len(knots)), 0, basis.count - basis.degree - 1)
    values = _cumulative_basis(basis, first)
    R, (w, w1, w2), cross = Q[first], np.zeros((3, len(knots), 3)), np.cross
    for j in range(1, basis.degree + 1):
        b, b1, b2, b3 = values[:, :, j - 1, None]
        axis = d[first + j - 1]
        A = exp(b * axis)
        y, u, z = ((x[:, None] @ A)[:, 0] for x in (w, w1, w2))
        y1 = u - b1 * cross(axis, y)
        y2 = z - b1 * cross(axis, u) - b2 * cross(axis, y) - b1 * cross(axis, y1)
        R, w, w1, w2 = R @ A, y + b1 * axis, y1 + b2 * axis, y2 + b3 * axis
    return R, np.stack([w, w1, w2], axis=1)


def _cumulative_basis(basis: _Basis, first: np.ndarray) -> np.ndarray:
    """Return `sum_(k >= first + j) B_k` for j = 1, 2, ... at the knots, and its derivatives: `(4, knots, degree)`."""
    out = np.empty((4, len(first), basis.degree))
    for low in range(0, len(first), CHUNK):  # by chunks of knots, because each depends on few columns
        part = np.arange(low, min(low + CHUNK, len(first)))
        columns = np.arange(first[part[0]] + 1, first[part[-1]] + basis.degree + 1)
        sums = (np.arange(basis.count)[:, None] >= columns).astype(float)
        local = (first[part] - first[part[0]])[:, None] + np.arange(basis.degree)
        for order, value in enumerate(basis.derivatives(sums, basis.knots[part])):
            out[order, part] = np.take_along_axis(value, local, axis=1)
    return out


def _rows(Q: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Return quaternions and rates, one row per knot."""
    return np.concatenate([quaternion(Q), rates.reshape(len(Q), 9)], axis=1)


def _with_rest(fit: _Fit, moved: Callable[[np.ndarray, np.ndarray], np.ndarray], least: float) -> np.ndarray:
    """Return time and state by knot, with legs from rest before the first row and legs to rest after the last one.

    The jerk is reduced to zero within a leg so short that it hardly changes the acceleration, because it is noise if it
    is large. A second leg comes to rest.
    """
    typical = max(float(np.sqrt((fit.acceleration**2).sum(1).mean())), least)
    table = np.column_stack([fit.knots, fit.states])
    before, after = _rest_legs(table[0], -1, typical, moved), _rest_legs(table[-1], 1, typical, moved)
    return np.concatenate([before[::-1], table, after])


def _rest_legs(
    knot: np.ndarray, side: int, typical: float, moved: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return the two knots between one end of the table and rest; `side` is -1 before the table."""
    time, state = knot[0], knot[1:]
    v, a, j = state[-9:].reshape(3, 3)
    fade = side * min(STOPPING_TIME / 2, typical / max(float(np.linalg.norm(j)), 1e-9))
    state = moved(state, (v + a * fade / 2 + j * fade**2 / 10) * fade)
    v, a = v + a * fade + j * fade**2 / 4, a + j * fade / 3
    speed = float(np.linalg.norm(v))
    stop = max(STOPPING_TIME, 2.5 * speed / typical)
    stop = side * (stop if len(knot) == POSITION_COLUMNS else min(stop, MAX_STOPPING_TURN / max(speed, 1e-9)))
    rest = moved(state, (v / 2 + a * stop / 10) * stop)
    faded = np.concatenate([[time + fade], state, v, a, np.zeros(3)])
    return np.stack([faded, np.concatenate([[time + fade + stop], rest, np.zeros(9)])])


def _moved_position(state: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return a position after a displacement."""
    return state[:3] + shift


def _moved_attitude(state: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return the quaternion after a rotation in the payload frame."""
    return quaternion((rotation(state[:4]) @ exp(shift[None])[0])[None])[0]


def pose_spline(knots: SplineKnots) -> PoseSpline:
    """Return the trajectory with given derivatives at its knots.

    Args:
        knots: Knots of position and attitude.

    Returns:
        The trajectory; polynomials of degree 7 join the knots.
    """
    t, states = knots.position[:, 0], knots.position[:, 1:].reshape(-1, 4, 3)
    T = np.diff(t)[:, None, None]
    powers = np.diff(t)[:, None, None] ** np.arange(4)[None, :, None]
    ends = np.concatenate([states[:-1] * powers, states[1:] * powers], axis=1)
    coefficients = HERMITE @ ends / T ** np.arange(8)[None, :, None]
    R, rates = rotation(knots.attitude[:, 1:5]), knots.attitude[:, 5:].reshape(-1, 3, 3)
    return PoseSpline(
        position=PiecewisePolynomial(knots=jnp.asarray(t), coefficients=jnp.asarray(coefficients)),
        attitude=rotation_legs(knots.attitude[:, 0], R, rates),
    )
