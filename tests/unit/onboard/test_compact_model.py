"""Models without factors are restored bit for bit, or kept where their data do not determine the factors."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from colift import gp
from colift.onboard.learning import compact_model
from colift.onboard.learning.residual_model import ResidualModel

CAPACITY = 12
HYPER = {m: gp.make_hyperparameters(np.full(m, 4.0), np.ones((m, d)), np.full(m, 0.01)) for m, d in ((6, 20), (9, 24))}


def posterior(outputs: int, n: int, noise: float = 0.0) -> gp.GPPosterior:
    """Return a Gaussian process with random data and correlated noise of a covariance."""
    rng, hyper = np.random.default_rng(n), HYPER[outputs]
    covariance = np.full((outputs, n, n), noise) if noise else None
    X, Y = rng.normal(size=(n, hyper.lengthscales.shape[1])), rng.normal(size=(n, outputs))
    return gp.condition(X, Y, hyper, CAPACITY, covariance)


def model(payload: gp.GPPosterior, *agents: gp.GPPosterior) -> ResidualModel:
    """Return a model of one group."""
    group = jax.tree.map(lambda *x: jnp.stack(x), *agents)
    return ResidualModel(payload=payload, agents=(group,), inertial_parameters=jnp.zeros(10))


def test_restored_model_has_the_same_bits():
    """A body may have no samples."""
    of = model(posterior(6, 7), posterior(9, 5), gp.prior(HYPER[9], CAPACITY))
    found = compact_model.compact(of)
    assert found is not None
    assert sum(array is None for array in found.arrays) == 2
    restored = found.restored()
    assert jax.tree.structure(restored) == jax.tree.structure(of)
    assert all(map(np.array_equal, jax.tree.leaves(restored), jax.tree.leaves(of)))


def test_models_that_data_do_not_determine_are_kept():
    """Priors share their arrays; correlated noise, and points added by `append`, change the factors."""
    priors = [gp.prior(HYPER[m], CAPACITY) for m in (6, 9)]
    assert compact_model.compact(model(*priors)) is None
    assert compact_model.compact(model(posterior(6, 7, 0.1), posterior(9, 5))) is None
    x, y = jnp.full(20, 0.3), jnp.ones(6)
    grown, accepted = gp.append(posterior(6, 7), x, y)
    assert accepted
    assert compact_model.compact(model(grown, posterior(9, 5))) is None
