"""Peak-to-peak gains of stable linear systems in the 2-norm, with proved upper bounds and worst-case inputs.

Inputs are divided into groups of columns, each with its own bound `|d_g(t)|_2 <= rho_g`. The largest `|y(t)|_2` from
zero initial state is::

    sup over unit u of f(u),   f(u) = sum_g rho_g (|D_g^T u| + integral |H_g(s)^T u| ds),   H_g(s) = C e^{A s} B_g

In discrete time the integral is a sum over `C A^k B_g`. f is a norm of u, hence convex, as used in `_maximize_norm`.
The trapezoidal rule with its remainder bounds the integral from above. An input that is constant on each step bounds
it from below.

See Also:
    docs/certificate.md: Derivation, section "Translation".

References:
    Boyd, Barratt, *Linear Controller Design: Limits of Performance*, 1991.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm, matrix_balance

Matrix = NDArray[np.float64]

ROUNDING = 1e-7  # relative; covers cancellation in square roots of squares, and the powers of A
TRUNCATION_TOLERANCE = 1e-6  # norm of e^{A T} at which the response is truncated; the remainder is bounded
MAX_RESPONSE_ENTRIES = 30_000_000  # numbers in a stored response; slower systems are rejected


@dataclasses.dataclass(frozen=True)
class PeakGain:
    """Largest `|y|_2` for inputs within their bounds, in the unit of the output.

    Attributes:
        bound: Upper bound over all inputs.
        lower_bound: Value reached by `inputs`.
        direction: Unit output vector with the largest bound.
        contributions: Contributions of the groups along `direction`.
        inputs: Worst-case inputs in order of time, `(steps, columns)`. They reach `lower_bound` at the end (in discrete
            time with the last sample, which acts through D alone).
        step: Duration of each input value [s]; 1 in discrete time.
    """

    bound: float
    lower_bound: float
    direction: Matrix
    contributions: Matrix
    inputs: Matrix
    step: float


def peak_gain_continuous(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike | None,
    groups: Sequence[int],
    rho: ArrayLike,
    rtol: float = 1e-3,
) -> PeakGain:
    """Compute the largest `|y|` of `x' = A x + B d, y = C x + D d` from zero initial state, for `|d_g(t)| <= rho_g`.

    Args:
        A: State matrix.
        B: Input matrix.
        C: Output matrix with at most 3 rows.
        D: Feedthrough matrix; default: zero.
        groups: Number of columns of each input group, in order.
        rho: Bound of each group.
        rtol: Relative distance of upper and lower bound, approximately.

    Returns:
        Peak gain with the worst-case input.

    Raises:
        ValueError: If the system is unstable or too slow to resolve, or the arguments are inconsistent.

    Example:
        >>> gain = peak_gain_continuous([[-1.0]], [[1.0]], [[1.0]], None, [1], [0.5])
        >>> gain.lower_bound, gain.bound
    """
    A, B, C, D, rho = _validate(A, B, C, D, groups, rho)
    slowest = float(np.max(np.linalg.eigvals(A).real))
    if slowest >= 0:
        raise ValueError(f"the system is unstable: an eigenvalue has real part {slowest:.6g} 1/s, must be negative")
    A, B, C = _balanced(A, B, C)
    h = 0.2 / float(np.linalg.norm(A, 2))
    while True:
        H, held, remainder, tail = _sampled_response(A, B, C, groups, h)
        lower = np.max(_direction_function(held, np.ones(len(held)), D, groups, rho)(np.eye(len(C))).sum(-1))
        if rho @ remainder <= rtol / 4 * lower:
            break
        h *= float(max(0.1, 0.95 * np.sqrt(rtol / 4 * lower / (rho @ remainder))))
    weights = np.full(len(H), h)
    weights[[0, -1]] = h / 2
    return _assemble(_direction_function(H, weights, D, groups, rho, remainder + tail), held, D, groups, rho, h, rtol)


def _sampled_response(
    A: Matrix, B: Matrix, C: Matrix, groups: Sequence[int], h: float
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return `H(k h)`, its integral over each step, and for each group the quadrature remainder and the tail.

    On a step `|H(s)^T u|` is at most its linear interpolation plus `(s - a)(b - s) / 2 sup |H''|`, whose integral is
    `h^3 / 12 sup |H''|`. Here `H'' = Y e^{A tau} A^2 B` with `Y = C e^{A k h}`, and `|e^{A tau} - I| <= e^{|A| h} - 1`.
    """
    n, size = len(A), float(np.linalg.norm(A, 2))
    both = expm(np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]]) * h)
    Y, last = _powers(both[:n, :n], C, B.shape[1])
    rows = np.linalg.norm(Y, 2, axis=(1, 2))
    reach = h * np.exp(size * h) * rows.sum() / (1 - np.linalg.norm(last, 2))
    remainder, tail = np.zeros(len(groups)), np.zeros(len(groups))
    for g, columns in enumerate(_columns(groups)):
        curve = A @ A @ B[:, columns]
        curvature = np.linalg.norm(Y @ curve, 2, axis=(1, 2)) + np.expm1(size * h) * rows * np.linalg.norm(curve, 2)
        remainder[g] = h**3 / 12 * curvature.sum()
        tail[g] = reach * np.linalg.norm(last @ B[:, columns], 2)
    return np.concatenate([Y, (C @ last)[None]]) @ B, Y @ (both[:n, n:] @ B), remainder, tail


def peak_gain_discrete(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike | None,
    groups: Sequence[int],
    rho: ArrayLike,
    rtol: float = 1e-3,
) -> PeakGain:
    """Compute the largest `|y|` of `x+ = A x + B d, y = C x + D d` from zero initial state, for `|d_g| <= rho_g`.

    Args:
        A: State matrix.
        B: Input matrix.
        C: Output matrix with at most 3 rows.
        D: Feedthrough matrix; default: zero.
        groups: Number of columns of each input group, in order.
        rho: Bound of each group.
        rtol: Relative distance of upper and lower bound, approximately.

    Returns:
        Peak gain with the worst-case input.

    Raises:
        ValueError: If the system is unstable or too slow to resolve, or the arguments are inconsistent.
    """
    A, B, C, D, rho = _validate(A, B, C, D, groups, rho)
    slowest = float(np.max(np.abs(np.linalg.eigvals(A))))
    if slowest >= 1:
        raise ValueError(f"the system is unstable: an eigenvalue has modulus {slowest:.6g}, must be below 1")
    A, B, C = _balanced(A, B, C)
    Y, last = _powers(A, C, B.shape[1])
    reach = np.linalg.norm(Y, 2, axis=(1, 2)).sum() / (1 - np.linalg.norm(last, 2))
    rest = np.array([reach * np.linalg.norm(last @ B[:, columns], 2) for columns in _columns(groups)])
    H = Y @ B
    return _assemble(_direction_function(H, np.ones(len(H)), D, groups, rho, rest), H, D, groups, rho, 1.0, rtol)


def _assemble(
    upper: Callable[[Matrix], Matrix],
    H: Matrix,
    D: Matrix,
    groups: Sequence[int],
    rho: Matrix,
    step: float,
    rtol: float,
) -> PeakGain:
    """Maximize over directions and construct the worst-case input."""
    bound, u = _maximize_norm(lambda directions: upper(directions).sum(-1), H.shape[1], rtol / 2)
    inputs = np.zeros((len(H) + 1, H.shape[2]))  # the last input acts through D alone
    for columns, limit in zip(_columns(groups), rho, strict=True):
        for rows, g in ((slice(None, -1), H[::-1, :, columns]), (slice(-1, None), D[None, :, columns])):
            along = np.einsum("kmn,m->kn", g, u)
            size = np.linalg.norm(along, axis=1, keepdims=True)
            inputs[rows, columns] = limit * np.divide(along, size, out=np.zeros_like(along), where=size > 0)
    reached = float(np.linalg.norm(np.einsum("kmn,kn->m", H[::-1], inputs[:-1]) + D @ inputs[-1]))
    return PeakGain(bound, reached, u, upper(u[None])[0], inputs, step)


def _maximize_norm(f: Callable[[Matrix], Matrix], m: int, rtol: float) -> tuple[float, Matrix]:
    """Bound the norm f over unit vectors of m components from above, within rtol of the best vector found.

    The sphere is divided into cones over simplices with unit vertices `v_i`. By convexity, a unit vector
    `u = sum_i l_i v_i`, `l >= 0`, has `f(u) <= sum_i l_i f(v_i)`. This is at most `max_i f(v_i) / distance`, with the
    distance of the simplex's plane from zero, and at most `|V^-1 f(v)|`. Cones with a larger bound are bisected.

    Args:
        f: Norm of several vectors, `(vectors, m)`.
        m: Number of components.
        rtol: Relative tolerance.

    Returns:
        Upper bound, and the best vector found.
    """
    # half of the sphere suffices since f(-u) = f(u)
    signs = np.array(np.meshgrid(*[[1.0]] + [[1.0, -1.0]] * (m - 1))).reshape(m, -1).T
    cones = signs[:, :, None] * np.eye(m)
    values = f(cones.reshape(-1, m)).reshape(-1, m)
    best, u = float(values.max()), cones.reshape(-1, m)[values.argmax()]
    resolved_bound = 0.0
    while len(cones):
        inverse = np.linalg.inv(cones)
        plane = np.linalg.norm(inverse.sum(-1), axis=-1)
        linear = np.linalg.norm(np.einsum("nij,nj->ni", inverse, values), axis=-1)
        bounds = np.minimum(plane * values.max(-1), linear)
        resolved = bounds <= (1 + rtol) * best
        resolved_bound = max(resolved_bound, float(np.max(bounds[resolved], initial=0.0)))
        cones, values = cones[~resolved], values[~resolved]
        if not len(cones):
            break
        edges = np.linalg.norm(cones[:, :, None] - cones[:, None], axis=-1).reshape(len(cones), -1)
        i, j = np.divmod(edges.argmax(-1), m)
        n = np.arange(len(cones))
        middle = cones[n, i] + cones[n, j]
        middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
        new = f(middle)
        if new.max() > best:
            best, u = float(new.max()), middle[new.argmax()]
        halves = [(cones.copy(), values.copy()) for _ in range(2)]
        for (c, v), k in zip(halves, (i, j), strict=True):
            c[n, k], v[n, k] = middle, new
        cones, values = (np.concatenate(parts) for parts in zip(*halves, strict=True))
    return max(resolved_bound, best), u


def _direction_function(
    H: Matrix, weights: Matrix, D: Matrix, groups: Sequence[int], rho: Matrix, rest: Matrix | float = 0.0
) -> Callable[[Matrix], Matrix]:
    """Return the function of unit vectors with each group's part of f.

    A group contributes `rho_g (|D_g^T u| + sum_k w_k |H_kg^T u| + rest_g)`.
    """
    i, j = np.triu_indices(H.shape[1])
    twice = np.where(i == j, 1.0, 2.0)
    squares = []  # coefficients of the quadratic form u^T (H H^T) u
    for columns in _columns(groups):
        g = H[:, :, columns]
        squares.append((g @ g.transpose(0, 2, 1))[:, i, j] * twice * weights[:, None] ** 2)

    def f(directions: Matrix) -> Matrix:
        total = np.empty((len(directions), len(groups)))
        for start in range(0, len(directions), 64):
            u = directions[start : start + 64]
            uu = (u[:, i] * u[:, j]).T
            for g, square in enumerate(squares):
                q = square @ uu
                total[start : start + 64, g] = np.sqrt(np.maximum(q, 0.0, out=q), out=q).sum(0)
        for g, columns in enumerate(_columns(groups)):
            total[:, g] += np.linalg.norm(directions @ D[:, columns], axis=-1)
        return rho * (total * (1 + ROUNDING) + rest)

    return f


def _powers(A: Matrix, C: Matrix, inputs: int) -> tuple[Matrix, Matrix]:
    """Return `C A^k` for k < K, and `A^K` with norm below TRUNCATION_TOLERANCE; raise ValueError if K is too large."""
    Y, power = C[None], A
    while np.linalg.norm(power, 2) > TRUNCATION_TOLERANCE:
        if 2 * len(Y) * C.shape[0] * (len(A) + inputs) > MAX_RESPONSE_ENTRIES:
            raise ValueError(
                f"the system is too slow to resolve: after {len(Y)} steps the norm of its state "
                f"is still {np.linalg.norm(power, 2):.3g} of the initial norm"
            )
        Y, power = np.concatenate([Y, Y @ power]), power @ power
    return Y, power


def _balanced(A: Matrix, B: Matrix, C: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Scale the states to similar magnitudes by powers of two, without rounding."""
    A, (scale, _) = matrix_balance(A, permute=False, separate=True)
    return A, B / scale[:, None], C * scale


def _columns(groups: Sequence[int]) -> list[slice]:
    """Return the columns of each group."""
    ends = np.cumsum(groups)
    return [slice(int(end) - size, int(end)) for end, size in zip(ends, groups, strict=True)]


def _validate(
    A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike | None, groups: Sequence[int], rho: ArrayLike
) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
    """Convert the arguments to arrays; raise ValueError if they are inconsistent."""
    A, B, C = (np.asarray(M, float) for M in (A, B, C))
    D = np.zeros((len(C), B.shape[1])) if D is None else np.asarray(D, float)
    rho = np.asarray(rho, float)
    if not all(np.isfinite(M).all() for M in (A, B, C, D)):
        raise ValueError("A, B, C, D: all entries must be finite")
    if A.shape != (len(A), len(A)) or B.shape[:1] != (len(A),) or C.shape[1:] != (len(A),):
        raise ValueError(f"shapes A {A.shape}, B {B.shape}, C {C.shape} are inconsistent")
    if D.shape != (len(C), B.shape[1]):
        raise ValueError(f"D has shape {D.shape}, must be {(len(C), B.shape[1])}")
    if len(C) > 3:
        raise ValueError(f"C has {len(C)} rows: must be at most 3, the limit of the search over directions")
    if sum(groups) != B.shape[1] or min(groups, default=0) < 1:
        raise ValueError(f"groups = {list(groups)}: must be positive and add up to the {B.shape[1]} columns of B")
    if rho.shape != (len(groups),) or not (np.isfinite(rho).all() and (rho >= 0).all()):
        raise ValueError(f"rho = {rho}: must be {len(groups)} finite numbers of at least 0")
    return A, B, C, D, rho
