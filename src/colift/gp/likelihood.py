"""Log marginal likelihood of a GP and its gradient in closed form (host, LAPACK)."""

from __future__ import annotations

import contextlib
from contextlib import AbstractContextManager

import numpy as np
from scipy.linalg.blas import dsymm, dsyrk
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.spatial.distance import cdist
from threadpoolctl import ThreadpoolController

from colift.gp.kernels import DEFAULT_KERNEL, Kernel

LOG_2PI = float(np.log(2 * np.pi))
BLAS = ThreadpoolController()  # controls the BLAS libraries loaded so far, those of NumPy and SciPy


def log_marginal_likelihood(
    theta: np.ndarray,
    X: np.ndarray,
    R: np.ndarray,
    scratch: np.ndarray | None = None,
    kernel: Kernel = DEFAULT_KERNEL,
) -> tuple[float, np.ndarray]:
    """Compute the log marginal likelihood of residuals with one kernel, and its gradient.

    `sum_q -1/2 R_q^T K^-1 R_q - 1/2 log|K| - N/2 log 2 pi`, with `K = s E + v I`,
    `E_ij = kernel(|(X_i - X_j) / l|^2)`, and gradient `1/2 tr((A A^T - q K^-1) dK/dtheta)`, `A = K^-1 R`
    (Rasmussen and Williams 2006, Eqs. 2.30 and 5.9).

    Args:
        theta: Logarithms of `(s, l_1 .. l_D, v)`.
        X: Inputs, `(N, D)`.
        R: Labels minus the constant prior mean, `(N, q)`.
        scratch: `(2, N, N)`, overwritten. Shared by several calls, it saves a third of the time at N = 500.
        kernel: Correlation function.

    Returns:
        Value [nats] and gradient with respect to theta.

    Raises:
        ValueError: If K is not positive definite to working precision.
    """
    N, q = R.shape
    E, K = np.empty((2, N, N)) if scratch is None else scratch
    s, ls, v = np.exp(theta[0]), np.exp(theta[1:-1]), np.exp(theta[-1])
    U = X / ls
    squared_distances(U, E)
    E, slope = kernel.numpy_value_and_slope(E)
    np.multiply(s, E, out=K)
    K.flat[:: N + 1] += v
    # All operations below use lower triangles in the memory of K.
    L, info = dpotrf(K.T, lower=1, clean=0, overwrite_a=1)
    if info:
        raise ValueError(conditioning_error_message(N, s, v))
    log_det = 2 * np.log(np.diagonal(L)).sum()
    P, _ = dpotri(L, lower=1, overwrite_c=1)
    A = dsymm(1.0, P, R, lower=1)
    value = -0.5 * np.vdot(R, A) - 0.5 * q * log_det - 0.5 * q * N * LOG_2PI

    M = dsyrk(1.0, A, beta=-q, c=P, lower=1, overwrite_c=1)  # A A^T - q K^-1
    trace = np.trace(M)
    gradient = np.empty_like(theta)
    gradient[0] = 0.5 * (np.vdot(A, R) - q * N - v * trace)  # tr(M s E) = tr(M K) - v tr(M)
    K *= slope  # M is a view of K
    # tr(M dK/dlog l_d) = s/2 sum_ij M_ij slope_ij (U_id - U_jd)^2, computed as products with M.
    MU = dsymm(s, M, np.column_stack([U, np.ones(N)]), lower=1)
    rows = MU[:, -1]
    gradient[1:-1] = rows @ (U * U) - np.einsum("nd,nd->d", U, MU[:, :-1])
    gradient[-1] = 0.5 * v * trace
    return float(value), gradient


def squared_distances(U: np.ndarray, out: np.ndarray) -> None:
    """Compute `|U_i - U_j|^2` by one matrix product, with an error of about `eps |U|^2` off the diagonal.

    Args:
        U: Points, `(N, dimensions)`.
        out: Result, `(N, N)`; zero on the diagonal and nowhere negative.
    """
    square = np.einsum("nd,nd->n", U, U)
    np.matmul(-2 * U, U.T, out=out)
    out += square[:, None]
    out += square
    np.maximum(out, 0.0, out=out)
    out.flat[:: len(U) + 1] = 0.0


def single_thread_blas(N: int) -> AbstractContextManager:
    """Limit BLAS to one thread for problems below 1000 points, where the synchronization of threads dominates.

    On 2 cores the time was equal at N = 500 on an idle machine, and 5 to 30 times shorter at N = 250 on a busy one.

    Args:
        N: Number of points.

    Returns:
        Context manager that applies the limit.
    """
    return BLAS.limit(limits=1, user_api="blas") if N < 1000 else contextlib.nullcontext()


def kernel_matrix(kernel: Kernel, U: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Compute `kernel(|u - v|^2)` for all pairs of rows, from differences and hence exact to rounding.

    Args:
        kernel: Correlation function.
        U: Points in length-scales, `(N, dimensions)`.
        V: Points in length-scales, `(M, dimensions)`.

    Returns:
        Correlations, `(N, M)`.
    """
    return kernel.numpy_value_and_slope(cdist(U, V, "sqeuclidean"))[0]


def gram_matrix(
    X: np.ndarray, signal_variance: float, lengthscales: np.ndarray, noise_variance: float, kernel: Kernel
) -> np.ndarray:
    """Compute `K = signal_variance E + noise_variance I` of one output, with the correlations E of `kernel_matrix`.

    Args:
        X: Inputs, `(N, dimensions)`.
        signal_variance: Signal variance [unit of y squared].
        lengthscales: Length-scales [unit of x].
        noise_variance: Noise variance [unit of y squared].
        kernel: Correlation function.

    Returns:
        `(N, N)`.
    """
    U = X / lengthscales
    K = signal_variance * kernel_matrix(kernel, U, U)
    K.flat[:: len(K) + 1] += noise_variance
    return K


def conditioning_error_message(N: int, signal_variance: float, noise_variance: float) -> str:
    """Return the error message for a Gram matrix that has no Cholesky factor to working precision.

    Args:
        N: Number of points.
        signal_variance: Signal variance [unit of y squared].
        noise_variance: Noise variance [unit of y squared].

    Returns:
        Message with the smallest admissible noise variance.
    """
    return (
        f"the Gram matrix of {N} points may not be positive definite to working precision: noise_variance = "
        f"{noise_variance:.3g} is too small for signal_variance = {signal_variance:.3g}; "
        f"use noise_variance >= {min_noise_ratio(N) * signal_variance:.2g}"
    )


def min_noise_ratio(N: int) -> float:
    """Return the smallest ratio of noise and signal variance for which N points have a Cholesky factor in float64.

    Rounding changes the eigenvalues of K by about `N eps signal_variance` (Higham 2002, Theorem 10.3). The result is
    ten times this value and holds for points at any distance.

    Args:
        N: Number of points.

    Returns:
        Ratio of variances.
    """
    return 10 * N * float(np.finfo(float).eps)


def min_noise_ratio_for_append(N: int) -> float:
    """Return the smallest ratio of noise and signal variance for which an inverse factor may grow to N points by rows.

    An inverse factor W that grows by rows loses `W K W^T = I` faster than one computed at once. The loss was measured
    for 20 to 1000 points on a line, with length-scales of 0.05 to 20 times its length. Its norm is at most
    `150 N eps signal_variance / noise_variance` while it is small. The result keeps it near 0.02;
    `test_dense_points_at_minimal_noise_are_accurate` requires less than 0.25.

    Args:
        N: Number of points.

    Returns:
        Ratio of variances.
    """
    return 1e4 * N * float(np.finfo(float).eps)
