"""Hyperparameters that maximize the marginal likelihood within a box, or their posterior under a belief (host)."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import OptimizeResult, minimize

from colift.gp.hyperparameters import (
    DEFAULT_BOUNDS,
    HyperparameterBounds,
    Hyperparameters,
    HyperPrior,
    concatenate,
    validate,
)
from colift.gp.kernels import DEFAULT_KERNEL, Kernel
from colift.gp.likelihood import log_marginal_likelihood, single_thread_blas

LARGEST, SMALLEST = 1e100, 1e-100  # magnitudes whose squares neither overflow nor vanish
FTOL, GTOL = 1e-12, 1e-5  # of `_maximize`
AT_BOUND = 0.01  # a length-scale this close to its bound, as a fraction, counts as at it


@dataclasses.dataclass(frozen=True)
class FitResult:
    """Fitted hyperparameters, and what a person needs to trust them."""

    hyper: Hyperparameters
    """In the units of the data."""
    log_likelihood: np.ndarray
    """`(outputs,)`, nats, of the data in their own units, no belief in it; with one shared set, each output's share."""
    lengthscales: np.ndarray
    """`(outputs, dimensions)`, in standard deviations of the inputs: the relevance of each input."""
    at_lower: np.ndarray
    """`(outputs, dimensions)`: length-scale at its lower bound."""
    at_upper: np.ndarray
    """`(outputs, dimensions)`: length-scale at its upper bound; without a belief, an input of no visible influence."""
    num_evaluations: int
    """Evaluations of the likelihood and its gradient, over all outputs and starts."""
    converged: np.ndarray
    """`(outputs,)`: whether the best start met the tolerance within `max_iterations`."""


def concatenate_fits(first: FitResult, then: FitResult) -> FitResult:
    """Of the outputs of both, in this order."""
    arrays = ("log_likelihood", "lengthscales", "at_lower", "at_upper", "converged")
    return FitResult(
        hyper=concatenate(first.hyper, then.hyper),
        num_evaluations=first.num_evaluations + then.num_evaluations,
        **{name: np.concatenate([getattr(first, name), getattr(then, name)]) for name in arrays},
    )


def fit(
    X: ArrayLike,
    Y: ArrayLike,
    box: HyperparameterBounds = DEFAULT_BOUNDS,
    *,
    hyperprior: HyperPrior | None = None,
    start: Hyperparameters | None = None,
    constant_mean: ArrayLike | None = None,
    restarts: int = 2,
    max_iterations: int = 100,
    seed: int = 0,
) -> FitResult:
    """Maximize each output's log marginal likelihood over its own hyperparameters, in log space, by L-BFGS-B.

    X: `(N, dimensions)`, Y: `(N, outputs)`; both are standardized inside. With a `belief` its log density is added to
    the likelihood (the mode of the posterior, decision 0015) and its length-scale bounds replace those of the box.
    `start`: a warm start, moved into the bounds where it lies outside, in place of the belief's median; `restarts`:
    further starts, drawn from the belief, or log-uniform in the box. `constant_mean`: the constant prior mean, by default the
    mean of Y (zeros give the paper's choice). A constant output gets the least signal variance of the box, in units of
    its own (unit deviation is taken as 1).
    Raises ValueError for fewer than 2 points, shapes that disagree, or data that are not finite.
    """
    problem = _standardize(X, Y, constant_mean)
    groups = [[i] for i in range(problem.T.shape[1])]
    return _fit_groups(problem, groups, box, hyperprior, start, restarts, max_iterations, seed)


def fit_shared(
    X: ArrayLike,
    Y: ArrayLike,
    box: HyperparameterBounds = DEFAULT_BOUNDS,
    *,
    hyperprior: HyperPrior | None = None,
    start: Hyperparameters | None = None,
    constant_mean: ArrayLike | None = None,
    restarts: int = 2,
    max_iterations: int = 100,
    seed: int = 0,
) -> FitResult:
    """Like `fit`, with one set of hyperparameters for all outputs of a body, shared in standardized units.

    The belief counts once, about the mean over the outputs of its medians' logarithms.
    """
    problem = _standardize(X, Y, constant_mean)
    groups = [list(range(problem.T.shape[1]))]
    return _fit_groups(problem, groups, box, hyperprior, start, restarts, max_iterations, seed)


@dataclasses.dataclass(frozen=True)
class _Standardized:
    Z: np.ndarray  # (N, dimensions) inputs, centred, unit deviation
    T: np.ndarray  # (N, outputs) outputs less constant_mean, over their deviation
    x_scale: np.ndarray
    y_scale: np.ndarray
    constant_mean: np.ndarray


def _same(one: Kernel, other: Kernel) -> bool:
    leaves = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=False)
    return type(one) is type(other) and all(np.array_equal(a, b) for a, b in leaves)


def _named(kernel: Kernel) -> str:
    parameters = [np.asarray(leaf).tolist() for leaf in jax.tree.leaves(kernel)]
    return type(kernel).__name__ + (f" {parameters}" if parameters else "")


def _kernel(hyperprior: HyperPrior | None, start: Hyperparameters | None) -> Kernel:
    """That of the belief and the start; the default where there is neither."""
    given = [hyper.kernel for hyper in (None if hyperprior is None else hyperprior.median, start) if hyper is not None]
    if len(given) == 2 and not _same(*given):
        raise ValueError(f"belief is of {_named(given[0])}, start of {_named(given[1])}: must be one kernel")
    return given[0] if given else DEFAULT_KERNEL


def validate_data(X: ArrayLike, Y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Inputs `(N, dimensions)` and outputs `(N, outputs)` as float64, or a ValueError that names what is wrong."""
    X, Y = np.asarray(X, dtype=float), np.asarray(Y, dtype=float)
    if X.ndim != 2 or Y.ndim != 2 or len(X) != len(Y):
        raise ValueError(f"X {X.shape} and Y {Y.shape}: must be (N, dimensions) and (N, outputs) with one N")
    for name, A in (("X", X), ("Y", Y)):
        bad = ~(np.abs(A) <= LARGEST)
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise ValueError(f"{name}[{row}, {column}] = {A[row, column]}: must be finite, at most {LARGEST:g}")
    return X, Y


def _standardize(X: ArrayLike, Y: ArrayLike, constant_mean: ArrayLike | None) -> _Standardized:
    X, Y = validate_data(X, Y)
    if len(X) < 2:
        raise ValueError(f"{len(X)} data point(s): fit needs at least 2; condition on stated hyperparameters instead")
    constant_mean = (
        Y.mean(0) if constant_mean is None else np.broadcast_to(np.asarray(constant_mean, dtype=float), Y.shape[1:])
    )
    if not np.isfinite(constant_mean).all():
        raise ValueError(f"constant_mean = {constant_mean.tolist()}: must be finite")
    x_scale, y_scale = column_std(X), column_std(Y)
    return _Standardized((X - X.mean(0)) / x_scale, (Y - constant_mean) / y_scale, x_scale, y_scale, constant_mean)


def column_std(A: np.ndarray) -> np.ndarray:
    """Standard deviation of each column; 1 for one that is constant to rounding."""
    deviation = A.std(0)
    constant = deviation <= np.maximum(8 * np.finfo(float).eps * np.abs(A).max(0), SMALLEST)
    return np.where(constant, 1.0, deviation)


def _fit_groups(
    problem: _Standardized,
    groups: list[list[int]],
    box: HyperparameterBounds,
    hyperprior: HyperPrior | None,
    start: Hyperparameters | None,
    restarts: int,
    max_iterations: int,
    seed: int,
) -> FitResult:
    """Fit one set of hyperparameters to each group of outputs and return to the units of the data."""
    N, D = problem.Z.shape
    m = problem.T.shape[1]
    bounds, kernel = _bounds(problem, box, hyperprior), _kernel(hyperprior, start)
    rng = np.random.default_rng(seed)
    theta, value, converged, evaluations = np.empty((m, D + 2)), np.empty(m), np.empty(m, dtype=bool), 0
    scratch = np.empty((2, N, N))
    for group in groups:
        density = _density(problem, group, hyperprior)
        starts = [_first_start(problem.Z, density) if start is None else _logarithms(start, problem, group, "start")]
        starts += list(density.draw(rng, bounds, restarts))
        T = np.asfortranarray(problem.T[:, group])
        with single_thread_blas(N):
            results = [
                _maximize(np.clip(t, *bounds.T), problem.Z, T, kernel, density, bounds, max_iterations, scratch)
                for t in starts
            ]
        best = min(results, key=lambda r: r.fun)
        theta[group], converged[group] = best.x, best.success
        value[group] = (-best.fun - density(best.x)[0]) / len(group)
        evaluations += sum(r.nfev for r in results)
    ls = np.exp(theta[:, 1:-1])
    fitted = Hyperparameters(
        kernel=kernel,
        signal_variance=jnp.asarray(np.exp(theta[:, 0]) * problem.y_scale**2),
        lengthscales=jnp.asarray(ls * problem.x_scale),
        noise_variance=jnp.asarray(np.exp(theta[:, -1]) * problem.y_scale**2),
        constant_mean=jnp.asarray(problem.constant_mean),
    )
    least, greatest = np.exp(bounds[1:-1].T)
    return FitResult(
        hyper=fitted,
        log_likelihood=value - N * np.log(problem.y_scale),
        lengthscales=ls,
        at_lower=ls < least * (1 + AT_BOUND),
        at_upper=ls > greatest * (1 - AT_BOUND),
        num_evaluations=evaluations,
        converged=converged,
    )


def _bounds(problem: _Standardized, box: HyperparameterBounds, hyperprior: HyperPrior | None) -> np.ndarray:
    """`(dimensions + 2, 2)`, logarithms in standardized units; the belief's length-scales in place of the box's."""
    D = problem.Z.shape[1]
    ls = np.tile(box.lengthscale, (D, 1))
    if hyperprior is not None:
        ls = np.outer(1 / problem.x_scale, [hyperprior.min_lengthscale, hyperprior.max_lengthscale])
    return np.log(np.vstack([box.signal_variance, ls, box.noise_variance]))


@dataclasses.dataclass(frozen=True)
class _Density:
    """Independent normals of the logarithms theta, flat where the deviation is infinite."""

    center: np.ndarray
    deviation: np.ndarray

    def __call__(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """`-1/2 |(theta - center) / deviation|^2` and its gradient."""
        u = (theta - self.center) / self.deviation
        return -0.5 * float(u @ u), -u / self.deviation

    def draw(self, rng: np.random.Generator, bounds: np.ndarray, count: int) -> np.ndarray:
        """`(count, theta)` starts: from the density, or uniform in the bounds where it is flat."""
        flat = np.isinf(self.deviation)
        uniform = rng.uniform(*bounds.T, (count, len(bounds)))
        normal = self.center + np.where(flat, 0.0, self.deviation) * rng.normal(size=(count, len(bounds)))
        return np.where(flat, uniform, normal)


def _density(problem: _Standardized, group: list[int], hyperprior: HyperPrior | None) -> _Density:
    """What a belief says of theta in standardized units; flat without one."""
    D = problem.Z.shape[1]
    if hyperprior is None:
        return _Density(center=np.zeros(D + 2), deviation=np.full(D + 2, np.inf))
    center = _logarithms(hyperprior.median, problem, group, "belief")
    deviation = np.log(hyperprior.scale_factor) * np.array(
        [2.0, *[1.0] * D, 2.0]
    )  # a variance has twice its deviation's log
    return _Density(center=center, deviation=deviation)


def _first_start(Z: np.ndarray, density: _Density) -> np.ndarray:
    """The belief's median; without one unit signal, noise a tenth, and typical points correlated by 1/e."""
    if np.isfinite(density.deviation).all():
        return density.center
    varying = max(np.count_nonzero(Z.any(0)), 1)
    return np.log([1.0, *[varying**0.5] * Z.shape[1], 0.1])


def _logarithms(given: Hyperparameters, problem: _Standardized, group: list[int], name: str) -> np.ndarray:
    """theta of stated hyperparameters in standardized units; of several outputs, the mean."""
    shape = (problem.T.shape[1], problem.Z.shape[1])
    if given.lengthscales.shape != shape:
        raise ValueError(f"{name} has lengthscales {given.lengthscales.shape}: must be (outputs, dimensions) = {shape}")
    validate(given)
    i = np.asarray(group)
    s = np.log(np.asarray(given.signal_variance)[i] / problem.y_scale[i] ** 2)
    ls = np.log(np.asarray(given.lengthscales)[i] / problem.x_scale)
    v = np.log(np.asarray(given.noise_variance)[i] / problem.y_scale[i] ** 2)
    return np.concatenate([[s.mean()], ls.mean(0), [v.mean()]])


def _maximize(
    theta: np.ndarray,
    Z: np.ndarray,
    T: np.ndarray,
    kernel: Kernel,
    density: _Density,
    bounds: np.ndarray,
    max_iterations: int,
    scratch: np.ndarray,
) -> OptimizeResult:
    def negative(t: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = log_marginal_likelihood(t, Z, T, scratch, kernel)
        more, slope = density(t)
        return -value - more, -gradient - slope

    # A slope below GTOL is within GTOL over the curvature of the optimum, and a belief has a curvature of about 1:
    # what is left is far below what moves a prediction. FTOL only ends a search that rounding keeps above GTOL.
    options = {"maxiter": max_iterations, "ftol": FTOL, "gtol": GTOL}
    return minimize(negative, theta, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
