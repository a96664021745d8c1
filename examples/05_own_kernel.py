"""User-defined features and kernel of a learned residual model: position and velocity as inputs of the payload's model.

A kernel is a `colift.math.pytree.pytree` with a `__call__` of the squared distance in length-scales. Features are a
`colift.onboard.learning.features.Features`. In a scenario file they are `plugins.features` and `plugins.kernel`; here
they replace the default ones in Python. Run it with `python examples/05_own_kernel.py`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import colift
from colift import gp
from colift.closed_loop import flight
from colift.math.pytree import pytree
from colift.onboard.learning import features

PLATE = Path(__file__).with_name("plate.yaml")


@pytree
class RationalQuadratic(gp.Kernel):
    """Rational quadratic kernel `(1 + r2 / (2 a))^-a`, a mixture of squared exponentials."""

    a: Float[Array, ""]

    def __call__(self, r2: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        return (1 + r2 / (2 * self.a)) ** -self.a


@pytree
class Motion(features.DefaultFeatures):
    """Position and velocity of the payload; the default features of the agents."""

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 6"]:
        return x[..., :6]

    def payload_names(self) -> tuple[str, ...]:
        return features.PAYLOAD_FEATURES[:6]


def with_kernel(experiment: flight.Experiment, kernel: gp.Kernel) -> flight.Experiment:
    """Return the experiment with a kernel and `Motion` features in the payload's model."""
    model, options = experiment.controller.residual_model, experiment.fit_options
    assert options is not None
    median = options.payload.median
    hyper = dataclasses.replace(median, kernel=kernel, lengthscales=median.lengthscales[:, :6])
    prior = dataclasses.replace(model, features=Motion(), payload=gp.prior(hyper, model.payload.capacity))
    hyperprior = dataclasses.replace(options.payload, median=hyper)
    return dataclasses.replace(
        experiment,
        controller=dataclasses.replace(experiment.controller, residual_model=prior),
        fit_options=dataclasses.replace(options, payload=hyperprior),
    )


def main() -> None:
    """Simulate two seconds of C2 with a model update at 1.5 s, and print the fit and the prediction error."""
    experiment = colift.make_experiment(colift.load_scenario(PLATE), "C2")
    experiment = dataclasses.replace(experiment, duration=2.0, update_times=(1.5,))
    flight = colift.run_experiment(with_kernel(experiment, RationalQuadratic(a=jnp.array(1.0))))
    fit, rows = flight.updates[0].fits["payload"], flight.records
    print(f"{flight.updates[0].num_samples['payload']} samples, {type(fit.hyper.kernel).__name__}; ", end="")
    print(f"log likelihoods {np.array2string(fit.log_likelihood, precision=1)}")
    error = np.linalg.norm((rows.f_L - rows.f_L_hat)[:, :3], axis=1)
    print(
        f"mean error of the predicted force: {error[rows.t < 1.5].mean():.2f} N before the update, "
        f"{error[rows.t >= 1.5].mean():.2f} N after it"
    )


if __name__ == "__main__":
    main()
