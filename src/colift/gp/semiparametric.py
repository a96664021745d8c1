"""GPs with a mean function that is linear in parameters shared by the outputs (remark of the paper).

`y_i(x) = phi_i(x) theta + f_i(x) + noise` with `theta ~ N(0, diag(prior)^2)`. Parameters and hyperparameters are fitted
together; the GP is then conditioned on `Y - Phi theta`. The basis values are arguments of the functions. The caller
defines their meaning, for example mass, first moments or drag (Rasmussen and Williams 2006, Section 2.7).

With a `TimeVariation`, theta and f change with time. The fitted values are those at the present.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.optimize import minimize

from colift.gp.fitting import FTOL, GTOL, validate_data
from colift.gp.hyperparameters import INACTIVE_LENGTHSCALE, Hyperparameters, HyperPrior
from colift.gp.kernels import Kernel
from colift.gp.likelihood import (
    LOG_2PI,
    conditioning_error_message,
    min_noise_ratio,
    single_thread_blas,
    squared_distances,
)
from colift.gp.time_variation import RATE_BOUNDS, RATE_SPREAD, TimeVariation, function_covariance


@dataclasses.dataclass(frozen=True)
class SemiparametricFit:
    """Fitted parameters and hyperparameters of outputs with a common mean function."""

    hyper: Hyperparameters
    """Hyperparameters with zero constant mean; a constant is a column of Phi."""
    theta: np.ndarray
    """`(parameters,)`, posterior mean [unit of y / unit of phi]; zero for parameters that the data do not excite."""
    covariance: np.ndarray
    """`(parameters, parameters)`, posterior covariance of theta."""
    log_likelihood: np.ndarray
    """`(outputs,)`, share of each output in the log likelihood given theta [nats]."""
    num_evaluations: int
    """Evaluations of the likelihood and its gradient."""
    converged: bool
    """True if the tolerance was met within `max_iterations`."""
    rate: float | None
    """Rate of the random walks [1/s]; None without a time variation."""


def fit_semiparametric(
    X: ArrayLike,
    Y: ArrayLike,
    Phi: ArrayLike,
    prior: ArrayLike,
    groups: Sequence[Sequence[int]],
    hyperprior: HyperPrior,
    *,
    start: Hyperparameters | None = None,
    max_iterations: int = 100,
    variation: TimeVariation | None = None,
    median_rate: float = 1 / 300,
    start_rate: float | None = None,
) -> SemiparametricFit:
    """Fit the hyperparameters by MAP estimation with theta marginalized, and theta by its posterior mean.

    Outputs of a group share signal variance, noise variance and one factor of the prior's median length-scales, taken
    from the first output. Inputs with `INACTIVE_LENGTHSCALE` are not used. The hyperprior counts once for each of the
    three shared values. A ValueError is raised for data that are not finite and for shapes that disagree.

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.
        Phi: Basis values, `(N, outputs, parameters)`.
        prior: Prior standard deviation of each parameter.
        groups: Outputs that share hyperparameters.
        hyperprior: Prior of the hyperparameters.
        start: Start in place of the prior's median.
        max_iterations: Maximum number of iterations.
        variation: Changes of theta and f with time; None for constant ones.
        median_rate: Median of the prior of the rate of the changes [1/s].
        start_rate: Start of the rate in place of its median [1/s].

    Returns:
        Fitted parameters and hyperparameters.
    """
    X, Y, Phi, prior = _validate(X, Y, Phi, prior)
    parts = [_output_group(X, list(outputs), hyperprior) for outputs in groups]
    centers = [part.log_parameters(hyperprior.median) for part in parts]
    starts = centers if start is None else [part.log_parameters(start) for part in parts]
    # the log of a variance is twice the log of its deviation
    deviation = np.log(hyperprior.scale_factor) * np.tile([2.0, 1.0, 2.0], len(parts))
    bounds = np.concatenate([part.bounds for part in parts])
    if variation is not None:
        centers, starts = [*centers, _log(median_rate)], [*starts, _log(start_rate or median_rate)]
        deviation, bounds = np.append(deviation, np.log(RATE_SPREAD)), np.vstack([bounds, np.log(RATE_BOUNDS)])
    center, kernel = np.concatenate(centers), hyperprior.median.kernel

    def negative(t: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope, _, _ = log_marginal_likelihood(t, parts, Y, Phi, prior, kernel, variation)
        off = (t - center) / deviation
        return 0.5 * float(off @ off) - value, off / deviation - slope

    options = {"maxiter": max_iterations, "ftol": FTOL, "gtol": GTOL}
    with single_thread_blas(len(X)):
        first = np.clip(np.concatenate(starts), *bounds.T)
        found = minimize(negative, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        _, _, theta, covariance = log_marginal_likelihood(found.x, parts, Y, Phi, prior, kernel, variation)
        logs = found.x[: 3 * len(parts)]
        likelihood = _output_log_likelihoods(logs, parts, Y - Phi @ theta, kernel)
    return SemiparametricFit(
        hyper=_hyperparameters(logs, parts, X.shape[1], kernel),
        theta=theta,
        covariance=covariance,
        log_likelihood=likelihood,
        num_evaluations=found.nfev,
        # a line search that stalls by rounding ends near GTOL on some processors; its optimum is as good
        converged=bool(found.success) or float(np.abs(found.jac).max()) <= 10 * GTOL,
        rate=None if variation is None else float(np.exp(found.x[-1])),
    )


def _log(x: float) -> np.ndarray:
    """Return the logarithm of a number as an array of one element."""
    return np.log([x])


def estimate_parameters(
    X: np.ndarray,
    Y: np.ndarray,
    Phi: np.ndarray,
    prior: np.ndarray,
    hyper: Hyperparameters,
    noise_covariance: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate theta for given hyperparameters: `theta = A^-1 Phi^T K^-1 y` (`log_marginal_likelihood`).

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.
        Phi: Basis values, `(N, outputs, parameters)`.
        prior: Prior standard deviation of each parameter.
        hyper: Hyperparameters of these outputs, and of further ones that are ignored.
        noise_covariance: Covariance of correlated noise, `(outputs, N, N)`.

    Returns:
        Posterior mean and covariance of theta.
    """
    A, b = np.diag(1 / prior**2), np.zeros(len(prior))
    with single_thread_blas(len(X)):
        for i in range(Y.shape[1]):
            K = function_covariance(X, hyper, i) + noise_covariance[i]
            K.flat[:: len(K) + 1] += float(hyper.noise_variance[i])
            T = cho_solve(cho_factor(K, lower=True), Phi[:, i])
            A += Phi[:, i].T @ T
            b += T.T @ Y[:, i]
        factor = cho_factor(A, lower=True)
        return cho_solve(factor, b), cho_solve(factor, np.eye(len(prior)))


@dataclasses.dataclass(frozen=True)
class OutputGroup:
    """Outputs that share `(log s, log factor, log v)`.

    Attributes:
        outputs: Indices of the outputs.
        columns: Active inputs.
        lengthscales: Length-scales at a factor of 1.
        r2: Squared scaled distances at a factor of 1, `(N, N)`.
        bounds: Bounds of the three logarithms, `(3, 2)`.
    """

    outputs: list[int]
    columns: np.ndarray
    lengthscales: np.ndarray
    r2: np.ndarray
    bounds: np.ndarray

    def log_parameters(self, hyper: Hyperparameters) -> np.ndarray:
        """Return the three logarithms of this group.

        Args:
            hyper: Hyperparameters of all outputs.

        Returns:
            `(log s, log factor, log v)`.
        """
        i = self.outputs[0]
        ratio = np.asarray(hyper.lengthscales)[i, self.columns] / self.lengthscales
        return np.log([float(hyper.signal_variance[i]), np.exp(np.log(ratio).mean()), float(hyper.noise_variance[i])])


def _output_group(X: np.ndarray, outputs: list[int], hyperprior: HyperPrior) -> OutputGroup:
    """Create a group of outputs with its distances and bounds."""
    median = np.asarray(hyperprior.median.lengthscales)[outputs[0]]
    columns = np.flatnonzero(median < INACTIVE_LENGTHSCALE)
    shape = median[columns]
    r2 = np.empty((len(X), len(X)))
    squared_distances(X[:, columns] / shape, r2)
    signal = np.log(float(hyperprior.median.signal_variance[outputs[0]]))
    log_range = 2 * np.log(1e3)  # a variance may differ from the prior's median by a factor of 1e6
    factor = np.log([hyperprior.min_lengthscale / shape.max(), hyperprior.max_lengthscale / shape.min()])
    noise = np.log(float(hyperprior.median.noise_variance[outputs[0]]))
    min_noise = signal + np.log(min_noise_ratio(len(X))) + log_range
    limits = [[signal - log_range, signal + log_range], factor, [max(noise - log_range, min_noise), noise + log_range]]
    return OutputGroup(outputs=outputs, columns=columns, lengthscales=shape, r2=r2, bounds=np.array(limits))


def log_marginal_likelihood(
    t: np.ndarray,
    parts: Sequence[OutputGroup],
    Y: np.ndarray,
    Phi: np.ndarray,
    prior: np.ndarray,
    kernel: Kernel,
    variation: TimeVariation | None = None,
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Compute `log N(y; 0, C)` with `C = K + Phi diag(prior)^2 Phi^T`, its gradient, and the posterior of theta.

    With `A = diag(prior)^-2 + Phi^T K^-1 Phi`: `theta = A^-1 Phi^T K^-1 y`, `C^-1 y = K^-1 (y - Phi theta)`,
    `|C| = |K| |A| |diag(prior)|^2`, and the gradient is `1/2 tr((a a^T - C^-1) dK/dt)`, `a = C^-1 y`,
    `C^-1 = K^-1 - K^-1 Phi A^-1 Phi^T K^-1` (Rasmussen and Williams 2006, Section 2.7 and Eq. 5.9). K contains the
    covariance of the changes with time.

    Args:
        t: Logarithms `(log s, log factor, log v)` of each group, then `log rho` if there is a time variation.
        parts: Groups of outputs.
        Y: Labels, `(N, outputs)`.
        Phi: Basis values, `(N, outputs, parameters)`.
        prior: Prior standard deviation of each parameter.
        kernel: Correlation function.
        variation: Changes of theta and f with time; None for constant ones.

    Returns:
        Value [nats], gradient, and mean and covariance of theta.

    Raises:
        ValueError: If K is not positive definite to working precision.
    """
    N, p = len(Y), len(prior)
    A, b, log_det, factors = np.diag(1 / prior**2), np.zeros(p), 2 * np.log(prior).sum(), []
    rate = 0.0 if variation is None else float(np.exp(t[-1]))
    of_f, of_theta = (0.0, 0.0) if variation is None else variation.weights(rate)
    B = np.zeros(Y.shape[1]) if variation is None else variation.parameter_covariance(Phi, prior)
    for k, part in enumerate(parts):
        s, factor, v = np.exp(t[3 * k : 3 * k + 3])
        E, slope = kernel.numpy_value_and_slope(part.r2 / factor**2)
        shared = s * E * (1 + of_f) + v * np.eye(N)
        inverse = None
        for q in part.outputs:
            if inverse is None or variation is not None:  # outputs of a group differ by the changes of theta only
                L, info = dpotrf((shared + of_theta * B[q]).T, lower=1, clean=1)
                if info:
                    raise ValueError(conditioning_error_message(N, s, v))
                inverse, _ = dpotri(L, lower=1)
                inverse = np.tril(inverse) + np.tril(inverse, -1).T
            log_det += 2 * np.log(np.diagonal(L)).sum()
            T = inverse @ Phi[:, q]  # K^-1 Phi
            A += Phi[:, q].T @ T
            b += T.T @ Y[:, q]
            factors.append((k, q, E, slope, inverse, T))
    factor_A = cho_factor(A, lower=True)
    theta, covariance = cho_solve(factor_A, b), cho_solve(factor_A, np.eye(p))
    log_det += 2 * np.log(np.diagonal(factor_A[0])).sum()
    value, gradient = -0.5 * (log_det + Y.size * LOG_2PI), np.zeros(len(t))
    for k, q, E, slope, inverse, T in factors:
        s, factor, v = np.exp(t[3 * k : 3 * k + 3])
        R = Y[:, q] - Phi[:, q] @ theta
        a = inverse @ R
        value -= 0.5 * float(Y[:, q] @ a)
        M = np.outer(a, a) - inverse + T @ covariance @ T.T
        weighted = M * (1 + of_f)
        gradient[3 * k : 3 * k + 3] += (
            0.5 * s * np.vdot(weighted, E),
            0.5 * s * np.vdot(weighted, slope * parts[k].r2) / factor**2,
            0.5 * v * np.trace(M),
        )
        if variation is not None:
            walk = rate * np.minimum(variation.age[:, None], variation.age[None])
            gradient[-1] += 0.5 * np.vdot(M * walk, s * E + B[q])
    return value, gradient, theta, covariance


def _output_log_likelihoods(t: np.ndarray, parts: Sequence[OutputGroup], R: np.ndarray, kernel: Kernel) -> np.ndarray:
    """Compute the log likelihood of `Y - Phi theta` of each output [nats]."""
    N, out = len(R), np.empty(R.shape[1])
    for part, (s, factor, v) in zip(parts, np.exp(t).reshape(-1, 3), strict=True):
        E, _ = kernel.numpy_value_and_slope(part.r2 / factor**2)
        chol = cho_factor(s * E + v * np.eye(N), lower=True)
        log_det = 2 * np.log(np.diagonal(chol[0])).sum()
        for i in part.outputs:
            out[i] = -0.5 * (float(R[:, i] @ cho_solve(chol, R[:, i])) + log_det + N * LOG_2PI)
    return out


def _hyperparameters(t: np.ndarray, parts: Sequence[OutputGroup], dimensions: int, kernel: Kernel) -> Hyperparameters:
    """Expand the logarithms of the groups to hyperparameters of all outputs."""
    m = sum(len(part.outputs) for part in parts)
    signal, noise, scale = np.empty(m), np.empty(m), np.full((m, dimensions), INACTIVE_LENGTHSCALE)
    for part, (s, factor, v) in zip(parts, np.exp(t).reshape(-1, 3), strict=True):
        signal[part.outputs], noise[part.outputs] = s, v
        scale[np.array(part.outputs)[:, None], part.columns] = factor * part.lengthscales
    return Hyperparameters(
        kernel=kernel,
        signal_variance=jnp.asarray(signal),
        lengthscales=jnp.asarray(scale),
        noise_variance=jnp.asarray(noise),
        constant_mean=jnp.zeros(m),
    )


def _validate(
    X: ArrayLike, Y: ArrayLike, Phi: ArrayLike, prior: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Convert the arguments to arrays; raise ValueError if they are not finite or their shapes disagree."""
    X, Y = validate_data(X, Y)
    Phi, prior = np.asarray(Phi, dtype=float), np.asarray(prior, dtype=float)
    if Phi.ndim != 3 or Phi.shape[:2] != Y.shape or not np.isfinite(Phi).all():
        raise ValueError(f"Phi {Phi.shape}: must be finite and (N, outputs, parameters) = ({len(Y)}, {Y.shape[1]}, ..)")
    if prior.shape != Phi.shape[2:] or not ((prior > 0) & np.isfinite(prior)).all():
        raise ValueError(
            f"prior {prior.tolist()}: must be positive and finite, one for each of {Phi.shape[2]} parameters"
        )
    return X, Y, Phi, prior
