"""Optimal recovery: all that data with bounded noise tell about a linear functional of the function (host).

The interval from the least to the greatest value that a function of norm at most B can have there, if it passes every
datum within eps. No bound from the same assumptions is smaller (Scharnhorst, Maddalena, Jiang and Jones 2023; in
general Micchelli and Rivlin 1977). One conic program a side, so for certificates and not for a control loop.

`recover` serves one functional. For many on the same data: `consistent` once, then `greatest` for each, or `least` for
all at once.
"""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, sparse

from colift.gp.fitting import validate_data
from colift.gp.hyperparameters import Hyperparameters
from colift.gp.kernels import Kernel
from colift.gp.likelihood import kernel_matrix

# By how much the program's eps and B exceed the stated, tried in turn: room inside, without which the solver stalls.
# The result is for the stated ones all the same, and the less room, the closer it is to the best.
MARGINS = (1e-6, 1e-5, 1e-4, 1e-3)
ITERATE_DTYPE = np.float32  # of the iterates of `least`: whatever they are, they bound
CHECK_INTERVAL = (
    100  # iterations of `least` between two looks at what they gained; some gain nothing in fifty, and then much
)
MIN_IMPROVEMENT = 1e-3  # of the largest value f can have, that a round must gain somewhere for another to follow
MAX_ROUNDS = 20
BATCH_SIZE = 256  # functionals of `least` at a time: what is read and written stays in a core's cache
RELAXATION = 1.6  # times the step, as usual
ADMM_PENALTY = 0.03  # of multipliers that differ from their copies, for functionals of size one
ROUNDING = 1e-12  # of products of some thousand correlations, for weights whose magnitudes sum to one
RANK_TOLERANCE = 1e-13  # directions of the Gram matrix below this fraction of its largest are lost in rounding
INFEASIBLE_MESSAGE = "the data contradict norm and noise_bound: no function of that norm passes that closely"


@dataclasses.dataclass(frozen=True)
class RecoveryInterval:
    """Values the functional can have; unit of y times that of the weights."""

    lower: float
    upper: float

    def radius(self, estimate: float) -> float:
        """Largest distance of a possible value from `estimate`."""
        return max(self.upper - estimate, estimate - self.lower)


@dataclasses.dataclass(frozen=True)
class FeasibleSet:
    """The functions of one output that norm and data allow: `||f|| <= B`, `|Y_k - offset - f(x_k)| <= eps`.

    Kept in units of `unit = B sqrt(signal_variance)`, the largest value f can have, with inputs in length-scales.
    """

    U: np.ndarray  # (N, dimensions), inputs
    K: np.ndarray  # (N, N), correlations of the data
    r: np.ndarray  # (N,), (Y - offset) / unit
    eps: float
    unit: float  # unit of y
    norm: float  # B
    signal_variance: float  # (unit of y)^2
    lengthscales: np.ndarray  # (dimensions,), unit of x
    kernel: Kernel

    def correlations(self, points: np.ndarray) -> np.ndarray:
        """`k(x_k, z_l) / signal_variance`, `(N, L)`: products with weights are the `k` of a functional."""
        return kernel_matrix(self.kernel, self.U, points / self.lengthscales)


@dataclasses.dataclass(frozen=True)
class WorstCase:
    """The greatest value of a functional, and what proves and what reaches it.

    `value` is an upper bound whatever the solver's tolerance. `nu`: multipliers of the data. `weights`: those of the
    data's kernels and of the functional's representer in the function that reaches the value, up to that tolerance.
    """

    value: float  # unit of y times that of the functional's weights
    nu: np.ndarray  # (N,)
    weights: np.ndarray  # (N + 1,), 1 / unit of y, for kernels of `signal_variance`


def feasible_set(
    X: ArrayLike, Y: ArrayLike, hyper: Hyperparameters, output: int, norm: float, noise_bound: float
) -> FeasibleSet:
    """What the data of one output allow; norm: B; noise_bound: eps, unit of y.

    X: `(N, dimensions)`; Y: `(N, outputs)`. Raises ValueError for shapes or numbers that are not that.
    """
    X, Y = validate_data(X, Y)
    for name, value in (("norm", norm), ("noise_bound", noise_bound)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} = {value}: must be positive and finite")
    s, offset = float(np.asarray(hyper.signal_variance)[output]), float(np.asarray(hyper.constant_mean)[output])
    ls = np.asarray(hyper.lengthscales)[output]
    unit, U = norm * s**0.5, X / ls
    return FeasibleSet(
        U=U,
        K=kernel_matrix(hyper.kernel, U, U),
        r=(Y[:, output] - offset) / unit,
        eps=noise_bound / unit,
        unit=unit,
        norm=norm,
        signal_variance=s,
        lengthscales=ls,
        kernel=hyper.kernel,
    )


def recovery_interval(
    X: ArrayLike,
    Y: ArrayLike,
    hyper: Hyperparameters,
    output: int,
    norm: float,
    noise_bound: float,
    points: ArrayLike,
    weights: ArrayLike = (1.0,),
) -> RecoveryInterval:
    """Bounds on `sum_l a_l (offset + f(z_l))` over all f with `||f|| <= B`, `|Y_k - offset - f(x_k)| <= eps`.

    Any numbers nu give an upper bound, for `f(z) = sum_k nu_k f(x_k) + <f, k_z - sum_k nu_k k_xk>`:
    `nu^T r + eps |nu|_1 + B ||k_z - sum_k nu_k k_xk||`. The program finds the best nu, and what is returned is this
    expression at what it found, so that no tolerance of the solver enters. Where the program has no solution the
    data contradict B and eps.

    X: `(N, dimensions)`; Y: `(N, outputs)`; points z: `(L, dimensions)`, weights a: `(L,)`, one point's value by
    default. norm: B; noise_bound: eps, unit of y. `noise_variance` has no part in it.
    Raises ValueError for shapes or numbers that are not that, or data that contradict B and eps; RuntimeError
    where the solver fails.
    """
    allowed = feasible_set(X, Y, hyper, output, norm, noise_bound)
    Z, a = np.asarray(points, dtype=float), np.asarray(weights, dtype=float)
    dimensions = allowed.U.shape[1]
    if Z.shape != (a.size, dimensions) or a.ndim != 1 or not (np.isfinite(Z).all() and np.isfinite(a).all()):
        raise ValueError(f"points {Z.shape} and weights {a.shape}: must be finite, (L, {dimensions}) and (L,)")
    k, V = allowed.correlations(Z) @ a, Z / allowed.lengthscales
    square, mass = float(a @ kernel_matrix(hyper.kernel, V, V) @ a), float(np.abs(a).sum())
    upper, lower = (sign * maximize_functional(allowed, sign * k, square, mass).value for sign in (1, -1))
    centre = float(np.asarray(hyper.constant_mean)[output]) * a.sum()
    return RecoveryInterval(lower=float(centre + lower), upper=float(centre + upper))


def maximize_functional(allowed: FeasibleSet, k: np.ndarray, square: float, mass: float) -> WorstCase:
    """The greatest value of a functional of f, given its representer's products with the data's and with itself.

    For `sum_l a_l f(z_l)`: `k = correlations(Z) a`, `(N,)`, `square = a^T C a` with C the correlations of Z, and `mass
    = |a|_1`. Raises as `recover` does.
    """
    square = max(square, 0.0)  # rounded
    size = square**0.5 or 1.0  # a functional that is zero has no size to be measured in
    nu, weights = _solution(allowed, k / size, square / size**2)
    nu, weights = size * nu, weights * allowed.unit / allowed.signal_variance
    weights[-1] /= size
    return WorstCase(
        value=float(dual_upper_bounds(allowed, nu[:, None], k[:, None], np.array([square]), np.array([mass]))[0]),
        nu=nu,
        weights=weights,
    )


def dual_upper_bounds(
    allowed: FeasibleSet, nu: np.ndarray, k: np.ndarray, square: np.ndarray, mass: np.ndarray
) -> np.ndarray:
    """Upper bounds of many functionals by any multipliers, `nu^T r + eps |nu|_1 + B ||k_z - sum_k nu_k k_xk||`.

    nu, k: `(N, functionals)`; square, mass: `(functionals,)`; see `greatest`.
    """
    size = np.abs(nu).sum(0)
    # Products of rounded correlations err by less than this, which would else make a residual near zero too small.
    rounding = ROUNDING * (mass + size) ** 2
    residual2 = np.maximum(square + np.sum(nu * (allowed.K @ nu - 2 * k), axis=0), 0.0) + rounding
    return allowed.unit * (allowed.r @ nu + allowed.eps * size + np.sqrt(residual2))


def minimize_upper_bounds(allowed: FeasibleSet, k: np.ndarray, square: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Upper bounds of many functionals, `above` at multipliers that are nearly the best: within about `GAIN`.

    `min_nu g(nu) + eps |nu|_1`, `g(nu) = r^T nu + sqrt(square - 2 k^T nu + nu^T K nu)`, by the alternating direction
    method of multipliers (Boyd et al. 2011, 3.4.3), whose step in g is diagonal in the eigenvectors of K; whatever it
    finds bounds. k: `(N, functionals)`; square, mass: `(functionals,)`; see `greatest`. Raises as `recover`: of data
    that contradict B and eps the program of a functional of nothing knows.
    """
    _solution(allowed, np.zeros(len(allowed.r)), 0.0)
    values, V = (x.astype(ITERATE_DTYPE) for x in linalg.eigh(allowed.K))
    values = np.maximum(values, 0)[:, None]
    best, square = np.empty_like(square), np.maximum(square, 0.0)  # rounded
    for first in range(0, len(best), BATCH_SIZE):
        some = slice(first, first + BATCH_SIZE)
        best[some] = _least(allowed, values, V, k[:, some], square[some], mass[some])
    return best


def _least(
    allowed: FeasibleSet, values: np.ndarray, V: np.ndarray, k: np.ndarray, square: np.ndarray, mass: np.ndarray
) -> np.ndarray:
    """`least` of some functionals, `K = V diag(values) V^T`."""
    size = np.where(square > 0, np.sqrt(square), 1.0)
    c, r = V.T @ (k / size).astype(ITERATE_DTYPE), (V.T @ allowed.r.astype(ITERATE_DTYPE))[:, None]
    most = ITERATE_DTYPE(allowed.eps / ADMM_PENALTY)
    copy, price = np.zeros((2, *k.shape), ITERATE_DTYPE)
    root, tiny = np.ones(len(square), ITERATE_DTYPE), np.finfo(ITERATE_DTYPE).eps  # root: sqrt(...), held within a step
    best, left = dual_upper_bounds(allowed, copy, k, square, mass), np.arange(len(square))
    for _ in range(MAX_ROUNDS):
        for _ in range(CHECK_INTERVAL):
            nu = (c + root * (ADMM_PENALTY * (V.T @ (copy - price)) - r)) / (values + ADMM_PENALTY * root)
            root = np.sqrt(np.maximum(1 + np.sum(nu * (values * nu - 2 * c), axis=0), tiny))
            price += RELAXATION * (V @ nu) + (1 - RELAXATION) * copy
            copy = price - np.clip(price, -most, most)
            price -= copy
        found = dual_upper_bounds(allowed, size[left] * copy, k[:, left], square[left], mass[left])
        gains = best[left] - found > MIN_IMPROVEMENT * allowed.unit * size[left]
        best[left] = np.fmin(best[left], found)  # what is no number bounds nothing
        left, root = left[gains], root[gains]
        c, copy, price = c[:, gains], copy[:, gains], price[:, gains]
        if not len(left):
            break
    return best


def _solution(allowed: FeasibleSet, k: np.ndarray, square: float) -> tuple[np.ndarray, np.ndarray]:
    """The best nu, and the function that proves it best as weights of the data's representers and the functional's.

    From the program `max F_z c` over `|c| <= 1`, `|r - F c| <= eps`, with `[F; F_z] [F; F_z]^T` the Gram matrix:
    c are coordinates of f in an orthonormal basis of the span of all representers.
    """
    gram = np.block([[allowed.K, k[:, None]], [k[None], np.full((1, 1), square)]])
    values, vectors = linalg.eigh(gram)
    kept = values > RANK_TOLERANCE * values[-1]
    vectors, scale, N = vectors[:, kept], np.sqrt(values[kept]), len(k)
    for margin in MARGINS:
        status, x, z = _solve(vectors * scale, allowed.r, allowed.eps * (1 + margin), 1 + margin)
        if "PrimalInfeasible" in status:
            raise ValueError(INFEASIBLE_MESSAGE)
        if status in ("Solved", "AlmostSolved"):
            return z[:N] - z[N : 2 * N], vectors @ (x / scale)
    raise RuntimeError(f"Clarabel ended with {status} on {N} points, noise_bound / (norm sqrt(s)) = {allowed.eps:.3g}")


def _solve(F: np.ndarray, r: np.ndarray, eps: float, B: float) -> tuple[str, np.ndarray, np.ndarray]:
    """Clarabel's status, its c, and its multipliers of `F c <= eps + r`, `-F c <= eps - r`, `|c| <= B`, in order."""
    # not at the top: nothing in flight needs it; by name: it is compiled and has no stubs
    clarabel: Any = importlib.import_module("clarabel")
    N, rank = len(r), F.shape[1]
    rows = sparse.csc_matrix(np.vstack([F[:N], -F[:N], np.zeros((1, rank)), -np.eye(rank)]))
    limits = np.concatenate([eps + r, eps - r, [B], np.zeros(rank)])
    cones = [clarabel.NonnegativeConeT(2 * N), clarabel.SecondOrderConeT(1 + rank)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(sparse.csc_matrix((rank, rank)), -F[N], rows, limits, cones, settings).solve()
    return str(solution.status), np.asarray(solution.x), np.asarray(solution.z)
