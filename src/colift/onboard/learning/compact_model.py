"""Residual models without the factors of their Gaussian processes, for many models in memory.

Factors follow from inputs and hyperparameters, and take nine tenths of the memory of a model with 256 samples.

See Also:
    docs/decisions/0022-store-gp-data-not-factors.md: files store the same data.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift import gp
from colift.onboard.learning.residual_model import ResidualModel

FACTOR = "inverse_cholesky"


@dataclasses.dataclass(frozen=True)
class CompactModel:
    """Residual model whose factors are computed again on access.

    Attributes:
        arrays: Leaves of the model; None for factors.
        structure: Tree structure of the model.
    """

    arrays: tuple[jax.Array | None, ...]
    structure: Any

    def restored(self) -> ResidualModel:
        """Return the model; all arrays are equal to those of the original to the last bit."""
        model = jax.tree.unflatten(self.structure, self.arrays)
        payload = dataclasses.replace(model.payload, inverse_cholesky=jnp.asarray(_factors(model.payload)))
        agents = tuple(
            dataclasses.replace(group, inverse_cholesky=jnp.asarray(np.stack([*map(_factors, _each(group))])))
            for group in model.agents
        )
        return dataclasses.replace(model, payload=payload, agents=agents)


def compact(model: ResidualModel) -> CompactModel | None:
    """Return a model without its factors.

    Args:
        model: Model whose noise has no `noise_covariance`.

    Returns:
        The compact model. None for a model without samples, whose arrays are shared by all flights, and for one whose
        factors differ from those of `gp.condition`. The first output of each body is compared.
    """
    bodies = [model.payload, *(one for group in model.agents for one in _each(group))]
    if not any(int(one.num_points) for one in bodies):
        return None
    if not all(np.array_equal(_factors(one, 1)[0], np.asarray(one.inverse_cholesky)[0]) for one in bodies):
        return None
    leaves, structure = jax.tree_util.tree_flatten_with_path(model)
    return CompactModel(tuple(None if _is_factor(path) else leaf for path, leaf in leaves), structure)


def _is_factor(path: tuple[Any, ...]) -> bool:
    """Return whether a leaf is a factor of the Gaussian process of a body."""
    names = [getattr(key, "name", "") for key in path]
    return names[0] in ("payload", "agents") and names[-1] == FACTOR


def _each(group: gp.GPPosterior) -> list[gp.GPPosterior]:
    """Return the Gaussian processes of the agents of a group, as arrays on the host."""
    on_host = jax.tree.map(np.asarray, group)
    return [jax.tree.map(lambda x, j=j: x[j], on_host) for j in range(len(on_host.num_points))]


def _factors(posterior: gp.GPPosterior, outputs: int | None = None) -> np.ndarray:
    """Compute the factors of a Gaussian process from its data."""
    n = int(posterior.num_points)
    return gp.inverse_factors(np.asarray(posterior.X)[:n], posterior.hyper, posterior.capacity, outputs=outputs)
