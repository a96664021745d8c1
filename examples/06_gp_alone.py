"""Gaussian processes of colift without robots: fit two functions, and evaluate means and error bounds.

Run it with `python examples/06_gp_alone.py`.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from colift import gp

NOISE = 0.05


def main() -> None:
    """Fit two outputs of one input to forty noisy values, and print predictions with error bounds at three inputs."""
    rng = np.random.default_rng(0)
    X = rng.uniform(-3, 3, (40, 1))
    Y = np.concatenate([np.sin(X), X**2 / 4], axis=1) + NOISE * rng.uniform(-1, 1, (40, 2))
    stated = gp.make_hyperparameters(signal_variance=[1.0, 4.0], lengthscales=[[1.0], [2.0]], noise_variance=NOISE**2)
    fit = gp.fit(X, Y, hyperprior=gp.HyperPrior(stated, scale_factor=3.0, min_lengthscale=0.1, max_lengthscale=10.0))
    model = gp.condition(X, Y, fit.hyper, capacity=64)
    at = jnp.array([[-1.0], [0.5], [5.0]])
    mean, variance = gp.predict(model, at)
    beta = gp.error_bounds.bounded_energy(model, norm=4.0, noise_bound=NOISE)
    for x, mu, s in zip(at[:, 0], mean, jnp.sqrt(variance), strict=True):
        bounds = ", ".join(f"{m:+.3f} +- {b * d:.3f}" for m, b, d in zip(mu, beta, s, strict=True))
        print(f"x = {x:+.1f}: {bounds} if the RKHS norm is at most 4 and the noise at most {NOISE}")


if __name__ == "__main__":
    main()
