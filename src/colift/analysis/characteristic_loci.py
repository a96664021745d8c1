"""Characteristic loci of a sampled loop, and its delay margin.

The loop is broken at the commands: ``x+ = A x + B u`` with the command ``u = K x``. Its loop transfer function is
``L(z) = K (z I - A)^-1 B``, and the closed loop is ``x+ = (A + B K) x``. The characteristic loci are the eigenvalues of
L on the unit circle (MacFarlane and Postlethwaite 1977).

See Also:
    colift.analysis.stability: the matrices of the sampled closed loop.

References:
    MacFarlane, Postlethwaite, *The generalized Nyquist stability criterion and multivariable root loci*, 1977.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy import linalg
from scipy.optimize import brentq

SMALLEST_ANGLE = 1e-4  # rad a tick, the lowest frequency; at 500 Hz 0.05 rad/s
POINTS_PER_DECADE = 12
LIGHTLY_DAMPED = 0.1  # damping ratio below which the frequencies of a pole are added to the grid
ANGLE_TOLERANCE = 1e-7  # relative error of the frequency of a crossing
LOG_TOLERANCE = 1e-5  # of the magnitude of loci that cross the unit circle together

Loci = Callable[[float], np.ndarray]
"""Characteristic loci by angle of z [rad], largest magnitude first."""


def delay_margin(A: np.ndarray, B: np.ndarray, K: np.ndarray) -> float:
    """Compute the smallest delay of all commands, in ticks, at which a stable loop has a pole on the unit circle.

    With a delay of tau ticks the poles are the roots of ``det(I - z^-tau L(z))``. A locus ``mu`` that has magnitude 1
    at ``z = exp(i w)`` is such a root for ``tau = (arg mu mod 2 pi) / w``. The margin is the smallest of these delays.
    It is zero if a locus has at least magnitude 1 at the Nyquist frequency, where a part of a tick has no phase.

    Args:
        A: State matrix of the loop without commands, `(n, n)`.
        B: Input matrix, `(n, m)`.
        K: Output matrix of the commands, `(m, n)`.

    Returns:
        The delay in ticks, infinite if no locus crosses the unit circle.
    """
    loci, angles = characteristic_loci(A, B, K), frequency_grid(A, A + B @ K)
    values = np.array([loci(angle) for angle in angles])
    if np.abs(values[-1]).max(initial=0.0) >= 1:
        return 0.0
    crossings = (
        found
        for low, high, at_low, at_high in zip(angles, angles[1:], values, values[1:], strict=False)
        for found in _crossings(loci, (float(low), float(high)), (np.abs(at_low) > 1) != (np.abs(at_high) > 1))
    )
    delays = [np.mod(np.angle(mu), 2 * np.pi).min() / angle for angle, mu in crossings]
    return float(min(delays, default=np.inf))


def characteristic_loci(A: np.ndarray, B: np.ndarray, K: np.ndarray) -> Loci:
    """Return the function that computes the characteristic loci, by the Schur form of A.

    Args:
        A: State matrix of the loop without commands, `(n, n)`.
        B: Input matrix, `(n, m)`.
        K: Output matrix of the commands, `(m, n)`.

    Returns:
        The loci by angle.
    """
    T, Q = linalg.schur(A.astype(complex))
    output, applied, identity = K @ Q, Q.conj().T @ B, np.eye(len(T))

    def loci(angle: float) -> np.ndarray:
        response = linalg.solve_triangular(np.exp(1j * angle) * identity - T, applied, check_finite=False)
        mu = np.linalg.eigvals(output @ response)
        return mu[np.argsort(-np.abs(mu))]

    return loci


def frequency_grid(*matrices: np.ndarray) -> np.ndarray:
    """Return angles up to the Nyquist frequency: a logarithmic grid, and points around lightly damped poles.

    Args:
        matrices: Discrete-time state matrices whose poles are considered.

    Returns:
        Angles in ascending order [rad a tick].
    """
    decades = np.log10(np.pi / SMALLEST_ANGLE)
    found = [np.geomspace(SMALLEST_ANGLE, np.pi, round(POINTS_PER_DECADE * decades))]
    for matrix in matrices:
        z = np.linalg.eigvals(matrix)
        s = np.log(z[np.abs(z) > np.exp(-np.pi)])
        s = s[(s.imag > 0) & (np.abs(s.real) < LIGHTLY_DAMPED * np.abs(s))]
        width = np.maximum(np.abs(s.real), 1e-3 * s.imag)
        found += [s.imag + k * width for k in (-3, -1, 1, 3)]
    angles = np.concatenate(found)
    angles = np.unique(np.minimum(angles[angles >= SMALLEST_ANGLE], np.pi))
    distinct = np.diff(np.log(angles), prepend=-np.inf) > 1e-4
    distinct[-1] = True
    return angles[distinct]


def _crossings(loci: Loci, interval: tuple[float, float], crossing: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the angles of an interval at which loci cross the unit circle, with these loci.

    Magnitudes in descending order are continuous functions of the angle, so that each has a bracketed root.
    """
    remaining = np.flatnonzero(crossing)
    while len(remaining):
        i = int(remaining[0])
        angle = float(
            brentq(
                lambda w, i=i: np.log(np.abs(loci(w)[i])),
                *interval,
                xtol=ANGLE_TOLERANCE * interval[0],
                rtol=ANGLE_TOLERANCE,
            )
        )
        mu = loci(angle)
        on_circle = np.abs(np.log(np.abs(mu))) < LOG_TOLERANCE
        on_circle[i] = True
        yield angle, mu[on_circle]
        remaining = remaining[~on_circle[remaining]]
