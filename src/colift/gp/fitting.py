"""Hyperparameters by maximum likelihood within bounds, or by maximum a posteriori (MAP) estimation (host).

See Also:
    docs/decisions/0015-fit-hyperparameters-by-map-estimation.md: Choice of the MAP estimate.
"""

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

MAX_MAGNITUDE, MIN_MAGNITUDE = 1e100, 1e-100  # magnitudes whose squares neither overflow nor vanish
FTOL, GTOL = 1e-12, 1e-5  # tolerances of `_maximize`
BOUND_TOLERANCE = 0.01  # relative distance within which a length-scale counts as at its bound


@dataclasses.dataclass(frozen=True)
class FitResult:
    """Fitted hyperparameters and diagnostics of the fit."""

    hyper: Hyperparameters
    """Hyperparameters in the units of the data."""
    log_likelihood: np.ndarray
    """`(outputs,)`, log marginal likelihood of the data without the prior [nats]; of shared sets the output's share."""
    lengthscales: np.ndarray
    """`(outputs, dimensions)`, in standard deviations of the inputs: the relevance of each input."""
    at_lower: np.ndarray
    """`(outputs, dimensions)`, whether the length-scale is at its lower bound."""
    at_upper: np.ndarray
    """`(outputs, dimensions)`, whether the length-scale is at its upper bound; without a prior, an inactive input."""
    num_evaluations: int
    """Evaluations of the likelihood and its gradient, over all outputs and starts."""
    converged: np.ndarray
    """`(outputs,)`, whether the best start met the tolerance within `max_iterations`."""


def concatenate_fits(first: FitResult, second: FitResult) -> FitResult:
    """Concatenate the fits of two groups of outputs.

    Args:
        first: Fit of the first outputs.
        second: Fit of the outputs that follow; the kernel must be the same.

    Returns:
        Fit of all outputs.
    """
    arrays = ("log_likelihood", "lengthscales", "at_lower", "at_upper", "converged")
    return FitResult(
        hyper=concatenate(first.hyper, second.hyper),
        num_evaluations=first.num_evaluations + second.num_evaluations,
        **{name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in arrays},
    )


def fit(
    X: ArrayLike,
    Y: ArrayLike,
    bounds: HyperparameterBounds = DEFAULT_BOUNDS,
    *,
    hyperprior: HyperPrior | None = None,
    start: Hyperparameters | None = None,
    constant_mean: ArrayLike | None = None,
    restarts: int = 2,
    max_iterations: int = 100,
    seed: int = 0,
) -> FitResult:
    """Maximize the log marginal likelihood of each output over its own hyperparameters by L-BFGS-B in log space.

    Inputs and outputs are standardized inside. With a hyperprior its log density is added (MAP estimate), and its
    length-scale bounds replace those of `bounds`. A constant output gets the smallest signal variance of the bounds.

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.
        bounds: Bounds of the hyperparameters of standardized data.
        hyperprior: Prior of the hyperparameters.
        start: First start in place of the prior's median, clipped to the bounds.
        constant_mean: Constant prior mean of each output [unit of y]; default: the mean of Y. The paper uses zeros.
        restarts: Number of further starts, drawn from the prior, or log-uniformly within the bounds.
        max_iterations: Maximum number of iterations of each start.
        seed: Seed of the further starts.

    Returns:
        Fitted hyperparameters and diagnostics.

    Example:
        >>> result = fit(X, Y)
        >>> model = condition(X, Y, result.hyper)
    """
    problem = _standardize(X, Y, constant_mean)
    groups = [[i] for i in range(problem.T.shape[1])]
    return _fit_groups(problem, groups, bounds, hyperprior, start, restarts, max_iterations, seed)


def fit_shared(
    X: ArrayLike,
    Y: ArrayLike,
    bounds: HyperparameterBounds = DEFAULT_BOUNDS,
    *,
    hyperprior: HyperPrior | None = None,
    start: Hyperparameters | None = None,
    constant_mean: ArrayLike | None = None,
    restarts: int = 2,
    max_iterations: int = 100,
    seed: int = 0,
) -> FitResult:
    """Fit one set of hyperparameters for all outputs, shared in standardized units.

    The hyperprior counts once; its center is the mean of the outputs' log medians.

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.
        bounds: Bounds of the hyperparameters of standardized data.
        hyperprior: Prior of the hyperparameters.
        start: First start in place of the prior's median, clipped to the bounds.
        constant_mean: Constant prior mean of each output [unit of y]; default: the mean of Y.
        restarts: Number of further starts.
        max_iterations: Maximum number of iterations of each start.
        seed: Seed of the further starts.

    Returns:
        Fitted hyperparameters and diagnostics.
    """
    problem = _standardize(X, Y, constant_mean)
    groups = [list(range(problem.T.shape[1]))]
    return _fit_groups(problem, groups, bounds, hyperprior, start, restarts, max_iterations, seed)


@dataclasses.dataclass(frozen=True)
class _Standardized:
    """Standardized data with their scales."""

    Z: np.ndarray  # (N, dimensions) inputs, centered, unit deviation
    T: np.ndarray  # (N, outputs) (Y - constant_mean) / y_scale
    x_scale: np.ndarray
    y_scale: np.ndarray
    constant_mean: np.ndarray


def _equal_kernels(first: Kernel, second: Kernel) -> bool:
    """Return whether two kernels have the same type and parameters."""
    leaves = zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=False)
    return type(first) is type(second) and all(np.array_equal(a, b) for a, b in leaves)


def _describe_kernel(kernel: Kernel) -> str:
    """Return the type of a kernel and its parameters for messages."""
    parameters = [np.asarray(leaf).tolist() for leaf in jax.tree.leaves(kernel)]
    return type(kernel).__name__ + (f" {parameters}" if parameters else "")


def _common_kernel(hyperprior: HyperPrior | None, start: Hyperparameters | None) -> Kernel:
    """Return the kernel of hyperprior and start, or the default if neither is given."""
    kernels = [
        hyper.kernel for hyper in (None if hyperprior is None else hyperprior.median, start) if hyper is not None
    ]
    if len(kernels) == 2 and not _equal_kernels(*kernels):
        raise ValueError(
            f"kernels of hyperprior ({_describe_kernel(kernels[0])}) and start ({_describe_kernel(kernels[1])}): "
            "must be equal"
        )
    return kernels[0] if kernels else DEFAULT_KERNEL


def validate_data(X: ArrayLike, Y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Convert inputs and outputs to float64 arrays and check them.

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.

    Returns:
        Both arrays.

    Raises:
        ValueError: If the shapes disagree, or an entry is not finite or above 1e100 in magnitude.
    """
    X, Y = np.asarray(X, dtype=float), np.asarray(Y, dtype=float)
    if X.ndim != 2 or Y.ndim != 2 or len(X) != len(Y):
        raise ValueError(f"X {X.shape} and Y {Y.shape}: must be (N, dimensions) and (N, outputs) with one N")
    for name, A in (("X", X), ("Y", Y)):
        invalid = ~(np.abs(A) <= MAX_MAGNITUDE)
        if invalid.any():
            row, column = np.argwhere(invalid)[0]
            raise ValueError(
                f"{name}[{row}, {column}] = {A[row, column]}: must be finite, at most {MAX_MAGNITUDE:g} in magnitude"
            )
    return X, Y


def _standardize(X: ArrayLike, Y: ArrayLike, constant_mean: ArrayLike | None) -> _Standardized:
    """Center and scale the data; raise ValueError for fewer than two points."""
    X, Y = validate_data(X, Y)
    if len(X) < 2:
        raise ValueError(f"{len(X)} data point(s): a fit needs at least 2; use condition with given hyperparameters")
    constant_mean = (
        Y.mean(0) if constant_mean is None else np.broadcast_to(np.asarray(constant_mean, dtype=float), Y.shape[1:])
    )
    if not np.isfinite(constant_mean).all():
        raise ValueError(f"constant_mean = {constant_mean.tolist()}: must be finite")
    x_scale, y_scale = column_std(X), column_std(Y)
    return _Standardized((X - X.mean(0)) / x_scale, (Y - constant_mean) / y_scale, x_scale, y_scale, constant_mean)


def column_std(A: np.ndarray) -> np.ndarray:
    """Compute the standard deviation of each column, 1 for columns that are constant up to rounding.

    Args:
        A: Data, `(N, columns)`.

    Returns:
        Standard deviations, `(columns,)`.
    """
    deviation = A.std(0)
    constant = deviation <= np.maximum(8 * np.finfo(float).eps * np.abs(A).max(0), MIN_MAGNITUDE)
    return np.where(constant, 1.0, deviation)


def _fit_groups(
    problem: _Standardized,
    groups: list[list[int]],
    bounds: HyperparameterBounds,
    hyperprior: HyperPrior | None,
    start: Hyperparameters | None,
    restarts: int,
    max_iterations: int,
    seed: int,
) -> FitResult:
    """Fit one set of hyperparameters to each group of outputs and convert to the units of the data."""
    N, D = problem.Z.shape
    m = problem.T.shape[1]
    log_bounds, kernel = _log_bounds(problem, bounds, hyperprior), _common_kernel(hyperprior, start)
    rng = np.random.default_rng(seed)
    theta, value, converged, evaluations = np.empty((m, D + 2)), np.empty(m), np.empty(m, dtype=bool), 0
    scratch = np.empty((2, N, N))
    for group in groups:
        log_prior = _log_prior(problem, group, hyperprior)
        starts = [
            _first_start(problem.Z, log_prior) if start is None else _log_parameters(start, problem, group, "start")
        ]
        starts += list(log_prior.sample(rng, log_bounds, restarts))
        T = np.asfortranarray(problem.T[:, group])
        with single_thread_blas(N):
            results = [
                _maximize(
                    np.clip(t, *log_bounds.T), problem.Z, T, kernel, log_prior, log_bounds, max_iterations, scratch
                )
                for t in starts
            ]
        best = min(results, key=lambda r: r.fun)
        theta[group], converged[group] = best.x, best.success
        value[group] = (-best.fun - log_prior(best.x)[0]) / len(group)
        evaluations += sum(r.nfev for r in results)
    ls = np.exp(theta[:, 1:-1])
    fitted = Hyperparameters(
        kernel=kernel,
        signal_variance=jnp.asarray(np.exp(theta[:, 0]) * problem.y_scale**2),
        lengthscales=jnp.asarray(ls * problem.x_scale),
        noise_variance=jnp.asarray(np.exp(theta[:, -1]) * problem.y_scale**2),
        constant_mean=jnp.asarray(problem.constant_mean),
    )
    lower, upper = np.exp(log_bounds[1:-1].T)
    return FitResult(
        hyper=fitted,
        log_likelihood=value - N * np.log(problem.y_scale),
        lengthscales=ls,
        at_lower=ls < lower * (1 + BOUND_TOLERANCE),
        at_upper=ls > upper * (1 - BOUND_TOLERANCE),
        num_evaluations=evaluations,
        converged=converged,
    )


def _log_bounds(problem: _Standardized, bounds: HyperparameterBounds, hyperprior: HyperPrior | None) -> np.ndarray:
    """Return the log bounds in standardized units, `(dimensions + 2, 2)`; a prior replaces those of length-scales."""
    D = problem.Z.shape[1]
    ls = np.tile(bounds.lengthscale, (D, 1))
    if hyperprior is not None:
        ls = np.outer(1 / problem.x_scale, [hyperprior.min_lengthscale, hyperprior.max_lengthscale])
    return np.log(np.vstack([bounds.signal_variance, ls, bounds.noise_variance]))


@dataclasses.dataclass(frozen=True)
class _LogPrior:
    """Independent normal densities of the log hyperparameters theta, flat where the deviation is infinite."""

    center: np.ndarray
    deviation: np.ndarray

    def __call__(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute `-1/2 |(theta - center) / deviation|^2` and its gradient."""
        u = (theta - self.center) / self.deviation
        return -0.5 * float(u @ u), -u / self.deviation

    def sample(self, rng: np.random.Generator, log_bounds: np.ndarray, count: int) -> np.ndarray:
        """Draw `(count, theta)` starts from the density, or uniformly within the bounds where it is flat."""
        flat = np.isinf(self.deviation)
        uniform = rng.uniform(*log_bounds.T, (count, len(log_bounds)))
        normal = self.center + np.where(flat, 0.0, self.deviation) * rng.normal(size=(count, len(log_bounds)))
        return np.where(flat, uniform, normal)


def _log_prior(problem: _Standardized, group: list[int], hyperprior: HyperPrior | None) -> _LogPrior:
    """Return the prior of theta in standardized units, flat without a hyperprior."""
    D = problem.Z.shape[1]
    if hyperprior is None:
        return _LogPrior(center=np.zeros(D + 2), deviation=np.full(D + 2, np.inf))
    center = _log_parameters(hyperprior.median, problem, group, "hyperprior")
    # the log of a variance is twice the log of its deviation
    deviation = np.log(hyperprior.scale_factor) * np.array([2.0, *[1.0] * D, 2.0])
    return _LogPrior(center=center, deviation=deviation)


def _first_start(Z: np.ndarray, log_prior: _LogPrior) -> np.ndarray:
    """Return the start of the first search: the prior's median, or default values if no prior is given.

    The default is unit signal variance, noise variance 0.1, and lengthscales such that points at
    a typical distance have correlation 1/e.
    """
    if np.isfinite(log_prior.deviation).all():
        return log_prior.center
    varying = max(np.count_nonzero(Z.any(0)), 1)
    return np.log([1.0, *[varying**0.5] * Z.shape[1], 0.1])


def _log_parameters(hyper: Hyperparameters, problem: _Standardized, group: list[int], name: str) -> np.ndarray:
    """Return theta of hyperparameters in standardized units, averaged over the outputs of a group."""
    shape = (problem.T.shape[1], problem.Z.shape[1])
    if hyper.lengthscales.shape != shape:
        raise ValueError(f"{name} has lengthscales {hyper.lengthscales.shape}: must be (outputs, dimensions) = {shape}")
    validate(hyper)
    i = np.asarray(group)
    s = np.log(np.asarray(hyper.signal_variance)[i] / problem.y_scale[i] ** 2)
    ls = np.log(np.asarray(hyper.lengthscales)[i] / problem.x_scale)
    v = np.log(np.asarray(hyper.noise_variance)[i] / problem.y_scale[i] ** 2)
    return np.concatenate([[s.mean()], ls.mean(0), [v.mean()]])


def _maximize(
    theta: np.ndarray,
    Z: np.ndarray,
    T: np.ndarray,
    kernel: Kernel,
    log_prior: _LogPrior,
    log_bounds: np.ndarray,
    max_iterations: int,
    scratch: np.ndarray,
) -> OptimizeResult:
    """Minimize the negative log posterior of one group from one start."""

    def negative(t: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = log_marginal_likelihood(t, Z, T, scratch, kernel)
        prior_value, prior_gradient = log_prior(t)
        return -value - prior_value, -gradient - prior_gradient

    # A gradient below GTOL is within GTOL / curvature of the optimum, and a prior has a curvature of about 1. The
    # remaining error has no effect on predictions. FTOL ends a search whose gradient stays above GTOL by rounding.
    options = {"maxiter": max_iterations, "ftol": FTOL, "gtol": GTOL}
    return minimize(negative, theta, jac=True, method="L-BFGS-B", bounds=log_bounds, options=options)
