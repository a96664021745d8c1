"""Features and a kernel of your own in what a flight learns: what the payload feels by where it is and how fast.

A kernel is a `colift.math.pytree.pytree` with a `__call__` of the squared distance in length-scales; features are a
`colift.onboard.learning.features.Features`. In a scenario file they are `plugins.features` and `plugins.kernel`; here they take the place of
the paper's in Python. Run it with `python examples/05_own_kernel.py`.
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
class Heavy(gp.Kernel):
    """The rational quadratic, `(1 + r2 / (2 a))^-a`: squared exponentials of many length-scales in one."""

    a: Float[Array, ""]

    def __call__(self, r2: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        return (1 + r2 / (2 * self.a)) ** -self.a


@pytree
class Motion(features.DefaultFeatures):
    """Of the payload position and velocity alone; of the agents what the paper takes."""

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 6"]:
        return x[..., :6]

    def payload_names(self) -> tuple[str, ...]:
        return features.PAYLOAD_FEATURES[:6]


def taught(plan: flight.Experiment, kernel: gp.Kernel) -> flight.Experiment:
    """The plan with that kernel of those features for the payload's model."""
    oracle, training = plan.controller.residual_model, plan.fit_options
    assert training is not None
    median = training.payload.median
    hyper = dataclasses.replace(median, kernel=kernel, lengthscales=median.lengthscales[:, :6])
    seen = dataclasses.replace(oracle, features=Motion(), payload=gp.prior(hyper, oracle.payload.capacity))
    belief = dataclasses.replace(training.payload, median=hyper)
    return dataclasses.replace(
        plan,
        controller=dataclasses.replace(plan.controller, residual_model=seen),
        fit_options=dataclasses.replace(training, payload=belief),
    )


def main() -> None:
    """Fly C2 for two seconds, learn from the first 1.5, and say what the labels told."""
    plan = dataclasses.replace(colift.make_experiment(colift.load_scenario(PLATE), "C2"), duration=2.0, update_times=(1.5,))
    flight = colift.run_experiment(taught(plan, Heavy(a=jnp.array(1.0))))
    fit, rows = flight.updates[0].fits["payload"], flight.records
    print(f"{flight.updates[0].n['payload']} samples, {type(fit.hyper.kernel).__name__}; ", end="")
    print(f"log likelihoods {np.array2string(fit.log_likelihood, precision=1)}")
    left = np.linalg.norm((rows.f_L - rows.f_L_hat)[:, :3], axis=1)
    print(
        f"unknown force left, mean: {left[rows.t < 1.5].mean():.2f} N before, {left[rows.t >= 1.5].mean():.2f} N after"
    )


if __name__ == "__main__":
    main()
