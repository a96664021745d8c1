"""Optimal recovery: tight bounds of linear functionals from a norm bound and data with bounded noise (host).

The bounds are the extreme values over all functions with RKHS norm at most B that fit every label within eps. No
smaller bound follows from these assumptions (Scharnhorst, Maddalena, Jiang and Jones 2023; in general Micchelli and
Rivlin 1977). Each side needs one conic program, so the method serves certificates and not control loops.

`recovery_interval` treats one functional. For many functionals on the same data, call `feasible_set` once, then
`maximize_functional` for each or `minimize_upper_bounds` for all.

See Also:
    docs/bounds.md: Derivation.
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

# Relative margins by which eps and B of the program exceed the stated values, tried in order. Without an interior the
# solver stalls. The result is valid for the stated values; a smaller margin gives a tighter bound.
MARGINS = (1e-6, 1e-5, 1e-4, 1e-3)
ITERATE_DTYPE = np.float32  # precision of the iterates; the bound is valid for any iterate
CHECK_INTERVAL = 100  # iterations per round; within fifty iterations some functionals do not yet improve
MIN_IMPROVEMENT = 1e-3  # fraction of the largest function value; a round without this gain is the last
MAX_ROUNDS = 20
BATCH_SIZE = 256  # functionals per batch, so that the arrays fit into a core's cache
RELAXATION = 1.6  # over-relaxation of the step (Boyd et al. 2011, 3.4.3)
ADMM_PENALTY = 0.03  # penalty parameter for functionals of unit norm
ROUNDING = 1e-12  # rounding of products of about 1000 correlations, for weights of unit 1-norm
RANK_TOLERANCE = 1e-13  # eigenvalues of the Gram matrix below this fraction of the largest are rounding errors
INFEASIBLE_MESSAGE = (
    "the data contradict norm and noise_bound: no function of this norm fits all labels within noise_bound"
)


@dataclasses.dataclass(frozen=True)
class RecoveryInterval:
    """Interval of the admissible values of a functional [unit of y times unit of the weights]."""

    lower: float  # smallest admissible value
    upper: float  # largest admissible value

    def radius(self, estimate: float) -> float:
        """Return the largest distance of an admissible value from an estimate.

        Args:
            estimate: Estimate of the functional [unit of y times unit of the weights].

        Returns:
            Distance in the same unit.
        """
        return max(self.upper - estimate, estimate - self.lower)


@dataclasses.dataclass(frozen=True)
class FeasibleSet:
    """Set of the functions of one output with `||f|| <= B` and `|Y_k - constant_mean - f(x_k)| <= eps`.

    Values are in units of `unit = B sqrt(signal_variance)`, the largest function value; inputs are in length-scales.

    Attributes:
        U: Inputs in length-scales, `(N, dimensions)`.
        K: Correlations of the data, `(N, N)`.
        r: Labels `(Y - constant_mean) / unit`, `(N,)`.
        eps: Noise bound divided by `unit`.
        unit: Largest function value [unit of y].
        norm: RKHS norm bound B.
        signal_variance: Signal variance [unit of y squared].
        lengthscales: Length-scales, `(dimensions,)` [unit of x].
        kernel: Correlation function.
    """

    U: np.ndarray
    K: np.ndarray
    r: np.ndarray
    eps: float
    unit: float
    norm: float
    signal_variance: float
    lengthscales: np.ndarray
    kernel: Kernel

    def correlations(self, points: np.ndarray) -> np.ndarray:
        """Compute `k(x_k, z_l) / signal_variance` of data and points.

        The product with the weights of a functional gives the argument `k` of the functions below.

        Args:
            points: `(L, dimensions)` [unit of x].

        Returns:
            `(N, L)`.
        """
        return kernel_matrix(self.kernel, self.U, points / self.lengthscales)


@dataclasses.dataclass(frozen=True)
class WorstCase:
    """Maximum of a functional, with its certificate and its maximizer.

    Attributes:
        value: Upper bound of the maximum, valid for any solver tolerance [unit of y times unit of the weights].
        nu: Multipliers of the data, `(N,)`.
        weights: Kernel weights of the maximizer for the data and for the functional's representer, `(N + 1,)`
            [1 / unit of y], accurate to the solver tolerance.
    """

    value: float
    nu: np.ndarray
    weights: np.ndarray


def feasible_set(
    X: ArrayLike, Y: ArrayLike, hyper: Hyperparameters, output: int, norm: float, noise_bound: float
) -> FeasibleSet:
    """Create the set of functions that the data of one output allow.

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.
        hyper: Hyperparameters; the noise variance is not used.
        output: Index of the output.
        norm: RKHS norm bound B.
        noise_bound: Bound eps of each label error [unit of y].

    Returns:
        The feasible set.

    Raises:
        ValueError: If a shape is wrong, or norm or noise bound is not positive and finite.
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
    """Bound `sum_l a_l (constant_mean + f(z_l))` over all f of the feasible set.

    The feasible set contains all f with `||f|| <= B` and `|Y_k - constant_mean - f(x_k)| <= eps`.

    Any multipliers nu give an upper bound, since `f(z) = sum_k nu_k f(x_k) + <f, k_z - sum_k nu_k k_xk>`:
    `nu^T r + eps |nu|_1 + B ||k_z - sum_k nu_k k_xk||`. The conic program finds the best nu. The returned value is this
    expression at the solver's nu, so it does not depend on solver tolerances.

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.
        hyper: Hyperparameters; the noise variance is not used.
        output: Index of the output.
        norm: RKHS norm bound B.
        noise_bound: Bound eps of each label error [unit of y].
        points: Points z, `(L, dimensions)` [unit of x].
        weights: Weights a, `(L,)`; by default the value at one point.

    Returns:
        Interval of the functional's values.

    Raises:
        ValueError: If shapes or numbers are not admissible.
    """
    feasible = feasible_set(X, Y, hyper, output, norm, noise_bound)
    Z, a = np.asarray(points, dtype=float), np.asarray(weights, dtype=float)
    dimensions = feasible.U.shape[1]
    if Z.shape != (a.size, dimensions) or a.ndim != 1 or not (np.isfinite(Z).all() and np.isfinite(a).all()):
        raise ValueError(f"points {Z.shape} and weights {a.shape}: must be finite, (L, {dimensions}) and (L,)")
    k, V = feasible.correlations(Z) @ a, Z / feasible.lengthscales
    squared_norm, l1_norm = float(a @ kernel_matrix(hyper.kernel, V, V) @ a), float(np.abs(a).sum())
    upper, lower = (sign * maximize_functional(feasible, sign * k, squared_norm, l1_norm).value for sign in (1, -1))
    center = float(np.asarray(hyper.constant_mean)[output]) * a.sum()
    return RecoveryInterval(lower=float(center + lower), upper=float(center + upper))


def maximize_functional(feasible: FeasibleSet, k: np.ndarray, squared_norm: float, l1_norm: float) -> WorstCase:
    """Maximize a functional of f, given by the inner products of its representer.

    For `sum_l a_l f(z_l)`: `k = correlations(Z) a`, `squared_norm = a^T C a` with the correlations C of Z, and
    `l1_norm = |a|_1`. A ValueError is raised if the data contradict norm and noise bound, and a RuntimeError if the
    solver fails.

    Args:
        feasible: Functions allowed by norm and data.
        k: Inner products with the data's representers, `(N,)`.
        squared_norm: Inner product of the representer with itself.
        l1_norm: Sum of the magnitudes of the weights.

    Returns:
        Upper bound, multipliers and maximizer.
    """
    squared_norm = max(squared_norm, 0.0)  # may be negative by rounding
    size = squared_norm**0.5 or 1.0  # the zero functional is not scaled
    nu, weights = _solve_conic_program(feasible, k / size, squared_norm / size**2)
    nu, weights = size * nu, weights * feasible.unit / feasible.signal_variance
    weights[-1] /= size
    return WorstCase(
        value=float(
            dual_upper_bounds(feasible, nu[:, None], k[:, None], np.array([squared_norm]), np.array([l1_norm]))[0]
        ),
        nu=nu,
        weights=weights,
    )


def dual_upper_bounds(
    feasible: FeasibleSet, nu: np.ndarray, k: np.ndarray, squared_norm: np.ndarray, l1_norm: np.ndarray
) -> np.ndarray:
    """Compute upper bounds of functionals from any multipliers, `nu^T r + eps |nu|_1 + B ||k_z - sum_k nu_k k_xk||`.

    Args:
        feasible: Functions allowed by norm and data.
        nu: Multipliers, `(N, functionals)`.
        k: Inner products with the data's representers, `(N, functionals)`; see `maximize_functional`.
        squared_norm: `(functionals,)`.
        l1_norm: `(functionals,)`.

    Returns:
        Upper bounds, `(functionals,)`.
    """
    size = np.abs(nu).sum(0)
    # bound of the rounding error of the products, which can make a small residual too small
    rounding = ROUNDING * (l1_norm + size) ** 2
    residual2 = np.maximum(squared_norm + np.sum(nu * (feasible.K @ nu - 2 * k), axis=0), 0.0) + rounding
    return feasible.unit * (feasible.r @ nu + feasible.eps * size + np.sqrt(residual2))


def minimize_upper_bounds(
    feasible: FeasibleSet, k: np.ndarray, squared_norm: np.ndarray, l1_norm: np.ndarray
) -> np.ndarray:
    """Compute nearly optimal upper bounds of many functionals, usually to about `MIN_IMPROVEMENT`.

    `min_nu g(nu) + eps |nu|_1`, `g(nu) = r^T nu + sqrt(squared_norm - 2 k^T nu + nu^T K nu)`, is solved by the
    alternating direction method of multipliers (Boyd et al. 2011, 3.4.3). Its step in g is diagonal in the eigenvectors
    of K. The result is an upper bound for any iterate. A conic program for the zero functional checks that the data do
    not contradict norm and noise bound; it raises as `maximize_functional`.

    Args:
        feasible: Functions allowed by norm and data.
        k: Inner products with the data's representers, `(N, functionals)`; see `maximize_functional`.
        squared_norm: `(functionals,)`.
        l1_norm: `(functionals,)`.

    Returns:
        Upper bounds, `(functionals,)`.
    """
    _solve_conic_program(feasible, np.zeros(len(feasible.r)), 0.0)
    values, V = (x.astype(ITERATE_DTYPE) for x in linalg.eigh(feasible.K))
    values = np.maximum(values, 0)[:, None]
    best, squared_norm = np.empty_like(squared_norm), np.maximum(squared_norm, 0.0)  # may be negative by rounding
    for first in range(0, len(best), BATCH_SIZE):
        batch = slice(first, first + BATCH_SIZE)
        best[batch] = _minimize_batch(feasible, values, V, k[:, batch], squared_norm[batch], l1_norm[batch])
    return best


def _minimize_batch(
    feasible: FeasibleSet,
    values: np.ndarray,
    V: np.ndarray,
    k: np.ndarray,
    squared_norm: np.ndarray,
    l1_norm: np.ndarray,
) -> np.ndarray:
    """Compute `minimize_upper_bounds` for one batch of functionals, with `K = V diag(values) V^T`."""
    size = np.where(squared_norm > 0, np.sqrt(squared_norm), 1.0)
    c, r = V.T @ (k / size).astype(ITERATE_DTYPE), (V.T @ feasible.r.astype(ITERATE_DTYPE))[:, None]
    threshold = ITERATE_DTYPE(feasible.eps / ADMM_PENALTY)
    copy, dual = np.zeros((2, *k.shape), ITERATE_DTYPE)
    # root is the square root in g, constant within a step
    root, tiny = np.ones(len(squared_norm), ITERATE_DTYPE), np.finfo(ITERATE_DTYPE).eps
    best, remaining = dual_upper_bounds(feasible, copy, k, squared_norm, l1_norm), np.arange(len(squared_norm))
    for _ in range(MAX_ROUNDS):
        for _ in range(CHECK_INTERVAL):
            nu = (c + root * (ADMM_PENALTY * (V.T @ (copy - dual)) - r)) / (values + ADMM_PENALTY * root)
            root = np.sqrt(np.maximum(1 + np.sum(nu * (values * nu - 2 * c), axis=0), tiny))
            dual += RELAXATION * (V @ nu) + (1 - RELAXATION) * copy
            copy = dual - np.clip(dual, -threshold, threshold)
            dual -= copy
        bounds = dual_upper_bounds(
            feasible, size[remaining] * copy, k[:, remaining], squared_norm[remaining], l1_norm[remaining]
        )
        gains = best[remaining] - bounds > MIN_IMPROVEMENT * feasible.unit * size[remaining]
        best[remaining] = np.fmin(best[remaining], bounds)  # ignores NaN
        remaining, root = remaining[gains], root[gains]
        c, copy, dual = c[:, gains], copy[:, gains], dual[:, gains]
        if not len(remaining):
            break
    return best


def _solve_conic_program(feasible: FeasibleSet, k: np.ndarray, squared_norm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the best nu, and the maximizing function as kernel weights.

    The weights belong to the data and the functional's representer, in this order.

    The program is `max F_z c` over `|c| <= 1`, `|r - F c| <= eps`, where `[F; F_z] [F; F_z]^T` is the Gram matrix. c
    are coordinates of f in an orthonormal basis of the span of all representers.

    Args:
        feasible: Functions allowed by norm and data.
        k: Inner products with the data's representers, `(N,)`.
        squared_norm: Inner product of the functional's representer with itself.

    Returns:
        nu `(N,)` and weights `(N + 1,)`.

    Raises:
        ValueError: If the data contradict norm and noise bound.
        RuntimeError: If the solver fails.
    """
    gram = np.block([[feasible.K, k[:, None]], [k[None], np.full((1, 1), squared_norm)]])
    values, vectors = linalg.eigh(gram)
    kept = values > RANK_TOLERANCE * values[-1]
    vectors, scale, N = vectors[:, kept], np.sqrt(values[kept]), len(k)
    for margin in MARGINS:
        status, x, z = _solve(vectors * scale, feasible.r, feasible.eps * (1 + margin), 1 + margin)
        if "PrimalInfeasible" in status:
            raise ValueError(INFEASIBLE_MESSAGE)
        if status in ("Solved", "AlmostSolved"):
            return z[:N] - z[N : 2 * N], vectors @ (x / scale)
    raise RuntimeError(f"Clarabel ended with {status} on {N} points, noise_bound / (norm sqrt(s)) = {feasible.eps:.3g}")


def _solve(F: np.ndarray, r: np.ndarray, eps: float, B: float) -> tuple[str, np.ndarray, np.ndarray]:
    """Return Clarabel's status, c, and multipliers of `F c <= eps + r`, `-F c <= eps - r` and `|c| <= B` (in order)."""
    # imported here since simulations do not need it, and by name since the compiled module has no stubs
    clarabel: Any = importlib.import_module("clarabel")
    N, rank = len(r), F.shape[1]
    rows = sparse.csc_matrix(np.vstack([F[:N], -F[:N], np.zeros((1, rank)), -np.eye(rank)]))
    limits = np.concatenate([eps + r, eps - r, [B], np.zeros(rank)])
    cones = [clarabel.NonnegativeConeT(2 * N), clarabel.SecondOrderConeT(1 + rank)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(sparse.csc_matrix((rank, rank)), -F[N], rows, limits, cones, settings).solve()
    return str(solution.status), np.asarray(solution.x), np.asarray(solution.z)
