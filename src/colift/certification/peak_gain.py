"""Peak-to-peak gains of stable linear systems, in the 2-norm: proved upper bounds, and the input that reaches them.

Inputs come in groups of columns, each with a bound of its own, `|d_g(t)|_2 <= rho_g`. The greatest `|y(t)|_2` from
rest is::

    sup over unit u of f(u),   f(u) = sum_g rho_g (|D_g^T u| + integral |H_g(s)^T u| ds),   H_g(s) = C e^{A s} B_g

(a sum over `C A^k B_g` in discrete time). f is a norm of u, hence convex, which is what `_greatest` uses; the
integral is bounded from above by the trapezoidal rule and a remainder, and from below by the input that is held
constant on every step. Derivations: `docs/certificate.md`, "Translation".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm, matrix_balance

Matrix = NDArray[np.float64]

ROUNDING = 1e-7  # relative; covers square roots of squares that cancel, and the powers of A
TRUNCATION_TOLERANCE = 1e-6  # the norm of e^{A T} at which the response is cut; what is left is bounded
SAMPLES = 30_000_000  # numbers in a stored response; a system slower than that is refused


@dataclasses.dataclass(frozen=True)
class PeakGain:
    """The greatest `|y|_2` that inputs within their bounds can bring about, in the output's unit.

    No input exceeds `bound`. `inputs`, of shape (steps, columns) in order of time and each held for `step` (s; one
    sample in discrete time), brings the output from rest to the size `reached` at the end (in discrete time: with
    the last sample, which acts through D alone). `shares` are what the groups add along `direction`, the unit output
    for which the bound is greatest.
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
    """The greatest `|y|` of `x' = A x + B d, y = C x + D d` from rest, for `|d_g(t)| <= rho_g`.

    groups: how many columns of B (and D) each input has, in order; rho: the bound of each. The bound exceeds
    what is reached by at most about rtol. Raises ValueError for a system that is unstable or too slow to resolve.
    """
    A, B, C, D, rho = _checked(A, B, C, D, groups, rho)
    slowest = float(np.max(np.linalg.eigvals(A).real))
    if slowest >= 0:
        raise ValueError(f"the system is unstable: an eigenvalue has real part {slowest:.6g} 1/s, must be negative")
    A, B, C = _balanced(A, B, C)
    h = 0.2 / float(np.linalg.norm(A, 2))
    while True:
        H, held, remainder, tail = _sampled(A, B, C, groups, h)
        lower = np.max(_norm(held, np.ones(len(held)), D, groups, rho)(np.eye(len(C))).sum(-1))
        if rho @ remainder <= rtol / 4 * lower:
            break
        h *= float(max(0.1, 0.95 * np.sqrt(rtol / 4 * lower / (rho @ remainder))))
    weights = np.full(len(H), h)
    weights[[0, -1]] = h / 2
    return _gain(_norm(H, weights, D, groups, rho, remainder + tail), held, D, groups, rho, h, rtol)


def _sampled(A: Matrix, B: Matrix, C: Matrix, groups: Sequence[int], h: float) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """`H(k h)`, its integral over each step, and for each group the trapezoidal rule's remainder and the tail.

    On a step `|H(s)^T u|` is at most its linear interpolation plus `(s - a)(b - s) / 2 sup |H''|`, which integrates to
    `h^3 / 12 sup |H''|`; there `H'' = Y e^{A tau} A^2 B` with `Y = C e^{A k h}`, `|e^{A tau} - I| <= e^{|A| h} - 1`.
    """
    n, size = len(A), float(np.linalg.norm(A, 2))
    both = expm(np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]]) * h)
    Y, last = _powers(both[:n, :n], C, B.shape[1])
    rows = np.linalg.norm(Y, 2, axis=(1, 2))
    reach = h * np.exp(size * h) * rows.sum() / (1 - np.linalg.norm(last, 2))
    remainder, tail = np.zeros(len(groups)), np.zeros(len(groups))
    for g, columns in enumerate(_columns(groups)):
        curve = A @ A @ B[:, columns]
        bend = np.linalg.norm(Y @ curve, 2, axis=(1, 2)) + np.expm1(size * h) * rows * np.linalg.norm(curve, 2)
        remainder[g] = h**3 / 12 * bend.sum()
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
    """The greatest `|y|` of `x+ = A x + B d, y = C x + D d` from rest, for `|d_g| <= rho_g`; else as `continuous`."""
    A, B, C, D, rho = _checked(A, B, C, D, groups, rho)
    slowest = float(np.max(np.abs(np.linalg.eigvals(A))))
    if slowest >= 1:
        raise ValueError(f"the system is unstable: an eigenvalue has modulus {slowest:.6g}, must be below 1")
    A, B, C = _balanced(A, B, C)
    Y, last = _powers(A, C, B.shape[1])
    reach = np.linalg.norm(Y, 2, axis=(1, 2)).sum() / (1 - np.linalg.norm(last, 2))
    rest = np.array([reach * np.linalg.norm(last @ B[:, columns], 2) for columns in _columns(groups)])
    H = Y @ B
    return _gain(_norm(H, np.ones(len(H)), D, groups, rho, rest), H, D, groups, rho, 1.0, rtol)


def _gain(
    upper: Callable[[Matrix], Matrix],
    H: Matrix,
    D: Matrix,
    groups: Sequence[int],
    rho: Matrix,
    step: float,
    rtol: float,
) -> PeakGain:
    bound, u = _greatest(lambda directions: upper(directions).sum(-1), H.shape[1], rtol / 2)
    inputs = np.zeros((len(H) + 1, H.shape[2]))  # the last one acts through D alone
    for columns, limit in zip(_columns(groups), rho, strict=True):
        for rows, g in ((slice(None, -1), H[::-1, :, columns]), (slice(-1, None), D[None, :, columns])):
            along = np.einsum("kmn,m->kn", g, u)
            size = np.linalg.norm(along, axis=1, keepdims=True)
            inputs[rows, columns] = limit * np.divide(along, size, out=np.zeros_like(along), where=size > 0)
    reached = float(np.linalg.norm(np.einsum("kmn,kn->m", H[::-1], inputs[:-1]) + D @ inputs[-1]))
    return PeakGain(bound, reached, u, upper(u[None])[0], inputs, step)


def _greatest(f: Callable[[Matrix], Matrix], m: int, rtol: float) -> tuple[float, Matrix]:
    """An upper bound on the norm f over unit vectors of m numbers, within rtol of the best one found, and that one.

    The sphere is cut into cones over simplices with unit vertices `v_i`. A unit `u = sum_i l_i v_i`, `l >= 0`, in
    one of them has `f(u) <= sum_i l_i f(v_i)` by convexity, which is at most `max_i f(v_i) / distance` (of the
    simplex's plane from zero) and at most `|V^-1 f(v)|`. Cones whose bound is not small enough are halved.
    """
    signs = np.array(np.meshgrid(*[[1.0]] + [[1.0, -1.0]] * (m - 1))).reshape(m, -1).T  # f(-u) = f(u): half of them
    cones = signs[:, :, None] * np.eye(m)
    values = f(cones.reshape(-1, m)).reshape(-1, m)
    best, u = float(values.max()), cones.reshape(-1, m)[values.argmax()]
    settled = 0.0
    while len(cones):
        inverse = np.linalg.inv(cones)
        plane = np.linalg.norm(inverse.sum(-1), axis=-1)
        linear = np.linalg.norm(np.einsum("nij,nj->ni", inverse, values), axis=-1)
        bounds = np.minimum(plane * values.max(-1), linear)
        done = bounds <= (1 + rtol) * best
        settled = max(settled, float(np.max(bounds[done], initial=0.0)))
        cones, values = cones[~done], values[~done]
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
    return max(settled, best), u


def _norm(
    H: Matrix, weights: Matrix, D: Matrix, groups: Sequence[int], rho: Matrix, rest: Matrix | float = 0.0
) -> Callable[[Matrix], Matrix]:
    """What each group adds to f at each of some unit vectors: `rho_g (|D_g^T u| + sum_k w_k |H_kg^T u| + rest_g)`."""
    i, j = np.triu_indices(H.shape[1])
    twice = np.where(i == j, 1.0, 2.0)
    squares = []  # u^T (H H^T) u as a product of two short vectors
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
    """`C A^k` for k < K and `A^K`, whose norm is below TAIL. Raises ValueError where K would be too large."""
    Y, power = C[None], A
    while np.linalg.norm(power, 2) > TRUNCATION_TOLERANCE:
        if 2 * len(Y) * C.shape[0] * (len(A) + inputs) > SAMPLES:
            raise ValueError(
                f"the system is too slow to resolve: after {len(Y)} steps its state still has "
                f"{np.linalg.norm(power, 2):.3g} of its size"
            )
        Y, power = np.concatenate([Y, Y @ power]), power @ power
    return Y, power


def _balanced(A: Matrix, B: Matrix, C: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """The same system in states of like size: powers of two, so nothing is rounded."""
    A, (scale, _) = matrix_balance(A, permute=False, separate=True)
    return A, B / scale[:, None], C * scale


def _columns(groups: Sequence[int]) -> list[slice]:
    ends = np.cumsum(groups)
    return [slice(int(end) - size, int(end)) for end, size in zip(ends, groups, strict=True)]


def _checked(
    A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike | None, groups: Sequence[int], rho: ArrayLike
) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
    A, B, C = (np.asarray(M, float) for M in (A, B, C))
    D = np.zeros((len(C), B.shape[1])) if D is None else np.asarray(D, float)
    rho = np.asarray(rho, float)
    if not all(np.isfinite(M).all() for M in (A, B, C, D)):
        raise ValueError("A, B, C, D: every entry must be finite")
    if A.shape != (len(A), len(A)) or B.shape[:1] != (len(A),) or C.shape[1:] != (len(A),):
        raise ValueError(f"shapes A {A.shape}, B {B.shape}, C {C.shape} do not fit together")
    if D.shape != (len(C), B.shape[1]):
        raise ValueError(f"D has shape {D.shape}, must be {(len(C), B.shape[1])}")
    if len(C) > 3:
        raise ValueError(f"C has {len(C)} rows: directions are searched for outputs of at most 3 numbers")
    if sum(groups) != B.shape[1] or min(groups, default=0) < 1:
        raise ValueError(f"groups = {list(groups)}: must be positive and add up to the {B.shape[1]} columns of B")
    if rho.shape != (len(groups),) or not (np.isfinite(rho).all() and (rho >= 0).all()):
        raise ValueError(f"rho = {rho}: must be {len(groups)} finite numbers, none negative")
    return A, B, C, D, rho
