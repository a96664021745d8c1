"""Which points to keep where there are more than a budget allows: those that tell most beside the others (host)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dsyr
from scipy.linalg.lapack import dpotrf, dpotri

from colift.gp.hyperparameters import Hyperparameters
from colift.gp.likelihood import conditioning_error_message, gram_matrix, single_thread_blas


def select_subset(X: ArrayLike, hyper: Hyperparameters, budget: int, noise: ArrayLike, first: ArrayLike) -> np.ndarray:
    """Whether each point of X `(N, dimensions)` is kept: one by one the others go that tell least beside what is left.

    Point k tells `I(y; f) - I(y_{-k}; f) = -1/2 sum_i log(v_ik P_ikk)` nats, summed over outputs, with
    `P_i = (K_f,i + diag(v_i))^-1` of the points left and `v_ik = noise_k noise_variance_i`. It costs O(N^2) a point
    that goes, after one inverse.

    noise: (N,) how many times the noise variance a point has for this purpose. first: (N,) those that go before any
    other does. Raises ValueError where a Gram matrix is not positive definite to working precision.
    """
    X, noise, may = np.asarray(X, float), np.asarray(noise, float), np.asarray(first, bool)
    stays = np.ones(len(X), bool)
    if may.sum() <= len(X) - budget:  # all of them go
        stays, may = ~may, ~may
    if stays.sum() > budget:
        with single_thread_blas(len(X)):
            stays[_told_by_others(X, hyper, int(stays.sum()) - budget, noise, may, stays)] = False
    return stays


def _told_by_others(
    X: np.ndarray, hyper: Hyperparameters, going: int, noise: np.ndarray, may: np.ndarray, stays: np.ndarray
) -> np.ndarray:
    """So many of those that may go, of the points that are left."""
    left, own = np.flatnonzero(may), may[stays]
    kinds, outputs = np.unique(_kinds(hyper), axis=0, return_counts=True)  # outputs with the same hyperparameters
    P = [_inverse(X[stays], noise[stays], kind, hyper)[np.ix_(own, own)] for kind in kinds]
    P = [np.asfortranarray(p) for p in P]
    v, gone = noise[left], np.zeros(len(left), bool)
    for _ in range(going):
        left_out = np.stack([p.diagonal() for p in P]) * kinds[:, 1:2] * v
        k = int(np.argmin(np.where(gone, np.inf, -outputs @ np.log(np.where(gone, 1.0, left_out)))))
        for i, p in enumerate(P):  # the inverse without row and column k
            row = np.concatenate([p[k, :k], p[k:, k]])
            P[i] = dsyr(-1 / row[k], row, lower=1, a=p, overwrite_a=1)
        gone[k] = True
    return left[gone]


def _kinds(hyper: Hyperparameters) -> np.ndarray:
    """Of each output signal and noise variance, and length-scales."""
    columns = hyper.signal_variance, hyper.noise_variance, *np.asarray(hyper.lengthscales).T
    return np.column_stack([np.asarray(a) for a in columns])


def _inverse(X: np.ndarray, noise: np.ndarray, kind: np.ndarray, hyper: Hyperparameters) -> np.ndarray:
    """The lower triangle of P."""
    K = gram_matrix(X, kind[0], kind[2:], 0.0, hyper.kernel)
    K.flat[:: len(K) + 1] += kind[1] * noise
    L, info = dpotrf(K, lower=1)
    if info:
        raise ValueError(conditioning_error_message(len(K), kind[0], kind[1]))
    return dpotri(L, lower=1)[0]
