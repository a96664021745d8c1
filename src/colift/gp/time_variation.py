"""Changes of a function with time: random walks, and jumps at change points.

A residual changes with its environment: slowly, as with a gust, or at once, as when a load is added. The changes are a
Gaussian process of time and input, so that a model of the present function can use all earlier samples.

See Also:
    colift.gp.semiparametric: estimation of the present function, its parameters and the rate of the changes.

References:
    Astrom, Wittenmark, *Adaptive Control*, 1995, Section 2.2 (parameters as random walks).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from colift.gp.hyperparameters import Hyperparameters
from colift.gp.likelihood import gram_matrix

JUMP_SHARE = 0.05
"""Variance of the jump of f at a change point, divided by the signal variance."""
RATE_SPREAD = 10.0
"""Standard deviation factor of the log-normal prior of the rate."""
RATE_BOUNDS = (1e-6, 10.0)
"""Bounds of the rate [1/s]."""


@dataclasses.dataclass(frozen=True)
class TimeVariation:
    """Changes of theta and f between the samples and the present: random walks and jumps.

    Let `a` be the age of a sample and `n` the number of change points since then. With the rate `rho`, the
    covariance of the changes is that of the prior, elementwise times

        f:      rho min(a_k, a_l) + JUMP_SHARE min(n_k, n_l)
        theta:  rho min(a_k, a_l) + min(n_k, n_l)

    A random walk has independent increments, so that two samples share the changes since the later one. At a change
    point, varying parameters take new values from their prior, and f keeps most of its shape.

    Attributes:
        age: `(N,)`, time since each sample [s].
        jumps: `(N,)`, number of change points since each sample.
        varying: `(parameters,)`, whether each parameter changes.
    """

    age: np.ndarray
    jumps: np.ndarray
    varying: np.ndarray

    def weights(self, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrices above for f and for theta.

        Args:
            rate: Rate `rho` [1/s].
        """
        walk, jumps = (np.minimum(x[:, None], x[None]) for x in (self.age, self.jumps))
        return rate * walk + JUMP_SHARE * jumps, rate * walk + jumps

    def parameter_covariance(self, Phi: np.ndarray, prior: np.ndarray) -> np.ndarray:
        """Return `Phi_i diag(varying prior)^2 Phi_i^T` of each output, `(outputs, N, N)`.

        Args:
            Phi: Basis values, `(N, outputs, parameters)`.
            prior: Prior standard deviation of each parameter.
        """
        scaled = (Phi * (prior * self.varying)).transpose(1, 0, 2)
        return scaled @ scaled.transpose(0, 2, 1)

    def covariance(
        self, X: np.ndarray, Phi: np.ndarray, prior: np.ndarray, hyper: Hyperparameters, rate: float
    ) -> np.ndarray:
        """Return the covariance of all changes, which acts as noise on labels of the present function.

        Args:
            X: Inputs, `(N, dimensions)`.
            Phi: Basis values, `(N, outputs, parameters)`.
            prior: Prior standard deviation of each parameter.
            hyper: Hyperparameters of these outputs, and of further ones that are ignored.
            rate: Rate `rho` [1/s].

        Returns:
            Covariances, `(outputs, N, N)`.
        """
        of_f, of_theta = self.weights(rate)
        K = np.stack([function_covariance(X, hyper, i) for i in range(Phi.shape[1])])
        return of_f * K + of_theta * self.parameter_covariance(Phi, prior)


def function_covariance(X: np.ndarray, hyper: Hyperparameters, i: int) -> np.ndarray:
    """Return the covariance of f of an output at the inputs, `(N, N)`.

    Args:
        X: Inputs, `(N, dimensions)`.
        hyper: Hyperparameters.
        i: Index of the output.
    """
    return gram_matrix(X, float(hyper.signal_variance[i]), np.asarray(hyper.lengthscales)[i], 0.0, hyper.kernel)
