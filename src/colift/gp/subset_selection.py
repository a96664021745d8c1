"""Selection of a subset of the data by information gain, for data sets above the budget (host)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dsyr
from scipy.linalg.lapack import dpotrf, dpotri

from colift.gp.hyperparameters import Hyperparameters
from colift.gp.likelihood import conditioning_error_message, gram_matrix, single_thread_blas


def select_subset(X: ArrayLike, hyper: Hyperparameters, budget: int, noise: ArrayLike) -> np.ndarray:
    """Select points by greedy removal of the point with the least information given the others.

    The information of point k is `I(y; f) - I(y_{-k}; f) = -1/2 sum_i log(v_ik P_ikk)` [nats], summed over outputs,
    with `P_i = (K_f,i + diag(v_i))^-1` of the remaining points and `v_ik = noise_k noise_variance_i`. A removal costs
    O(N^2) after one inverse. A ValueError is raised if a Gram matrix is not positive definite to working precision.

    Args:
        X: Inputs, `(N, dimensions)`.
        hyper: Hyperparameters.
        budget: Maximum number of points to keep.
        noise: Factor of the noise variance of each point for the selection, `(N,)`.

    Returns:
        Whether each point is kept, `(N,)`.
    """
    X, noise = np.asarray(X, float), np.asarray(noise, float)
    kept = np.ones(len(X), bool)
    if len(X) > budget:
        with single_thread_blas(len(X)):
            kept[_redundant_points(X, hyper, len(X) - budget, noise)] = False
    return kept


def _redundant_points(X: np.ndarray, hyper: Hyperparameters, num_removed: int, noise: np.ndarray) -> np.ndarray:
    """Return whether each point is removed."""
    # outputs with equal hyperparameters share an inverse
    kinds, outputs = np.unique(_output_parameters(hyper), axis=0, return_counts=True)
    P = [np.asfortranarray(_inverse(X, noise, kind, hyper)) for kind in kinds]
    removed = np.zeros(len(X), bool)
    for _ in range(num_removed):
        left_out = np.stack([p.diagonal() for p in P]) * kinds[:, 1:2] * noise
        k = int(np.argmin(np.where(removed, np.inf, -outputs @ np.log(np.where(removed, 1.0, left_out)))))
        for i, p in enumerate(P):  # the inverse without row and column k
            row = np.concatenate([p[k, :k], p[k:, k]])
            P[i] = dsyr(-1 / row[k], row, lower=1, a=p, overwrite_a=1)
        removed[k] = True
    return removed


def _output_parameters(hyper: Hyperparameters) -> np.ndarray:
    """Return signal variance, noise variance and length-scales of each output as rows."""
    columns = hyper.signal_variance, hyper.noise_variance, *np.asarray(hyper.lengthscales).T
    return np.column_stack([np.asarray(a) for a in columns])


def _inverse(X: np.ndarray, noise: np.ndarray, kind: np.ndarray, hyper: Hyperparameters) -> np.ndarray:
    """Compute the lower triangle of P."""
    K = gram_matrix(X, kind[0], kind[2:], 0.0, hyper.kernel)
    K.flat[:: len(K) + 1] += kind[1] * noise
    L, info = dpotrf(K, lower=1)
    if info:
        raise ValueError(conditioning_error_message(len(K), kind[0], kind[1]))
    return dpotri(L, lower=1)[0]
