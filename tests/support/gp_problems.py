"""Random GP problems, and their posterior with 50 digits, for the tests of colift.gp."""

import jax.numpy as jnp
import mpmath
import numpy as np

from colift import gp

EPS = np.finfo(float).eps


def problem(seed: int, N: int = 40, dimensions: int = 4, outputs: int = 3, noise: float = 1e-2):
    """Return inputs with different scales and offsets, smooth outputs with different units, and hyperparameters."""
    rng = np.random.default_rng(seed)
    x_scale, y_scale = 10 ** rng.uniform(-2, 2, dimensions), 10 ** rng.uniform(-2, 2, outputs)
    Z = rng.normal(size=(N, dimensions))
    F = np.sin(Z @ rng.normal(size=(dimensions, outputs))) + 0.3 * Z[:, :1] ** 2
    X = (Z + rng.normal(size=dimensions)) * x_scale
    Y = (F + noise**0.5 * rng.normal(size=F.shape) + rng.normal(size=outputs)) * y_scale
    hyper = gp.make_hyperparameters(
        rng.uniform(0.5, 2, outputs) * y_scale**2,
        rng.uniform(0.7, 4, (outputs, dimensions)) * x_scale,
        noise * y_scale**2,
        rng.normal(size=outputs) * y_scale,
    )
    queries = (rng.normal(size=(7, dimensions)) + rng.normal(size=dimensions)) * x_scale
    queries[0] = X[0]
    return X, Y, hyper, jnp.asarray(queries)


def arrays(hyper, i):
    """Return signal variance, length-scales, noise variance and offset of output i as NumPy arrays."""
    return (
        float(hyper.signal_variance[i]),
        np.asarray(hyper.lengthscales[i]),
        float(hyper.noise_variance[i]),
        float(hyper.constant_mean[i]),
    )


def gram(X, hyper, i):
    """Return the Gram matrix entry by entry in float64."""
    s, ls, v, _ = arrays(hyper, i)
    return s * np.exp(-0.5 * (((X[:, None] - X[None]) / ls) ** 2).sum(-1)) + v * np.eye(len(X))


def exact(X, y, queries, hyper, i):
    """Return mean and variance at queries, and the log likelihood, of output i by mpmath with 50 digits."""
    with mpmath.workdps(50):
        s, ls, v, offset = (mpmath.mpmathify(a) if np.ndim(a) == 0 else a for a in arrays(hyper, i))

        def k(a, b):
            r2 = sum(((mpmath.mpf(p) - mpmath.mpf(q)) / mpmath.mpf(w)) ** 2 for p, q, w in zip(a, b, ls, strict=True))
            return s * mpmath.exp(-r2 / 2)

        X, queries = X.tolist(), np.asarray(queries).tolist()
        n = len(X)
        K = mpmath.matrix(n, n)
        for p in range(n):
            for q in range(p + 1):
                K[p, q] = K[q, p] = k(X[p], X[q]) + (v if p == q else 0)
        L = mpmath.cholesky(K)
        r = mpmath.matrix([mpmath.mpf(float(t)) - offset for t in y])
        e = forward(L, r)
        means, variances = [], []
        for x in queries:
            u = forward(L, mpmath.matrix([k(x, p) for p in X]))
            means.append(offset + mpmath.fdot(u, e))
            variances.append(s - mpmath.fdot(u, u))
        log_det = 2 * sum(mpmath.log(L[p, p]) for p in range(n))
        log_likelihood = -(mpmath.fdot(e, e) + log_det + n * mpmath.log(2 * mpmath.pi)) / 2
        gain = (log_det - n * mpmath.log(v)) / 2
        return np.array(means, dtype=float), np.array(variances, dtype=float), float(log_likelihood), float(gain)


def forward(L, b):
    """Return `L^-1 b` by forward substitution in the current precision of mpmath."""
    x = mpmath.matrix(len(b), 1)
    for p in range(len(b)):
        x[p] = (b[p] - mpmath.fsum(L[p, q] * x[q] for q in range(p))) / L[p, p]
    return x
