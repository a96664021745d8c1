"""Parametric mean functions, linear in parameters that the outputs of a body share (the paper's remark).

`y_i(x) = phi_i(x) theta + offset_i + f_i(x) + noise`: the parameters are identified by generalized least squares
under the GP's own covariance, and the GP then takes `Y - Phi theta`. The basis values are data here; what they
mean (mass, first moments, inertia through a rigid-body regressor) is the caller's.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from colift.gp.hyper import DEFAULT_BOX, Box, Hyper, check
from colift.gp.likelihood import gram, not_positive_definite
from colift.gp.training import Fit, checked, fit


@dataclasses.dataclass(frozen=True)
class Identification:
    """Parameters of a linear mean function, and what the data could not tell about them."""

    theta: np.ndarray
    """`(parameters,)`, unit of y over unit of phi; zero along the null directions."""
    covariance: np.ndarray
    """`(parameters, parameters)`, zero along the null directions: nothing was learned there."""
    null: np.ndarray
    """`(parameters, k)`: unit directions in which the data do not excite the parameters."""
    excitation: np.ndarray
    """`(parameters,)`: singular values of the whitened basis with unit columns, over the largest."""


def identify(
    X: ArrayLike, Y: ArrayLike, Phi: ArrayLike, hyper: Hyper, *, least_excitation: float = 1e-6
) -> Identification:
    """Generalized least squares, `theta = argmin sum_i |L_i^-1 (Y_i - offset_i - Phi_i theta)|^2`, `K_i = L_i L_i^T`.

    Rasmussen and Williams 2006, Section 2.7, with a vague prior. X: `(N, dimensions)`, Y: `(N, outputs)`, Phi:
    `(N, outputs, parameters)`. Directions excited less than `least_excitation` of the best one are null.
    Raises ValueError for data that are not finite or shapes that disagree.
    """
    X, Y, Phi = _checked_basis(X, Y, Phi)
    check(hyper, len(X))
    if hyper.lengthscales.shape != (Y.shape[1], X.shape[1]):
        raise ValueError(f"hyper has lengthscales {hyper.lengthscales.shape}: must be {(Y.shape[1], X.shape[1])}")
    blocks = []
    for i in range(Y.shape[1]):
        s, ls, v = (np.asarray(a)[i] for a in (hyper.signal_variance, hyper.lengthscales, hyper.noise_variance))
        L, info = dpotrf(gram(X, s, ls, v, hyper.kernel).T, lower=1)
        if info:
            raise ValueError(f"output {i}: " + not_positive_definite(len(X), s, v))
        right = np.column_stack([Phi[:, i], Y[:, i] - np.asarray(hyper.offset)[i]])
        blocks.append(solve_triangular(L, right, lower=True))
    A = np.concatenate(blocks)
    return _least_squares(A[:, :-1], A[:, -1], least_excitation)


def _checked_basis(X: ArrayLike, Y: ArrayLike, Phi: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    X, Y = checked(X, Y)
    Phi = np.asarray(Phi, dtype=float)
    if Phi.ndim != 3 or Phi.shape[:2] != Y.shape or not np.isfinite(Phi).all():
        raise ValueError(f"Phi {Phi.shape}: must be finite and (N, outputs, parameters) = ({len(Y)}, {Y.shape[1]}, ..)")
    return X, Y, Phi


def _least_squares(A: np.ndarray, b: np.ndarray, least_excitation: float) -> Identification:
    """Least squares over the excited directions; columns are scaled first, since parameters differ in unit."""
    missing = max(A.shape[1] - A.shape[0], 0)  # with fewer rows than parameters, zero rows complete the SVD's basis
    A, b = np.pad(A, ((0, missing), (0, 0))), np.pad(b, (0, missing))
    norm = np.linalg.norm(A, axis=0)
    scale = np.where(norm > 0, norm, 1.0)
    U, sigma, Vt = np.linalg.svd(A / scale, full_matrices=False)
    excited = sigma > least_excitation * sigma.max(initial=0.0)
    V = Vt.T / scale[:, None]
    null = V[:, ~excited]
    return Identification(
        theta=V[:, excited] @ (U[:, excited].T @ b / sigma[excited]),
        covariance=(V[:, excited] / sigma[excited] ** 2) @ V[:, excited].T,
        null=null / np.linalg.norm(null, axis=0),
        excitation=sigma / max(sigma.max(initial=0.0), np.finfo(float).tiny),
    )


def fit_parametric(
    X: ArrayLike,
    Y: ArrayLike,
    Phi: ArrayLike,
    box: Box = DEFAULT_BOX,
    *,
    rounds: int = 3,
    restarts: int = 2,
    max_iterations: int = 100,
    seed: int = 0,
) -> tuple[Fit, Identification]:
    """Parameters and hyperparameters together, by coordinate ascent on the marginal likelihood.

    Each round fits the hyperparameters of `Y - Phi theta` at zero offset (a constant is a column of Phi), then
    identifies theta under them. The first theta is that of least squares weighted by each output's deviation;
    restarts serve the first round. Raises as `fit` and `identify` do.
    """
    X, Y, Phi = _checked_basis(X, Y, Phi)
    deviation = np.where(Y.std(0) > 0, Y.std(0), 1.0)
    found = _least_squares((Phi / deviation[:, None]).reshape(Y.size, -1), (Y / deviation).reshape(-1), 1e-6)
    start = None
    for k in range(rounds):
        fitted = fit(
            X,
            Y - Phi @ found.theta,
            box,
            start=start,
            offset=np.zeros(Y.shape[1]),
            restarts=0 if k else restarts,
            max_iterations=max_iterations,
            seed=seed,
        )
        start, found = fitted.hyper, identify(X, Y, Phi, fitted.hyper)
    return fitted, found
