"""Error bounds of residual models: ``|f_i(x) - mu_i(x)| <= rho_i(x)`` for every output and every input.

A bound is computed for a companion posterior: the posterior of the same data and kernel with the noise variance at
which the bound is tight. The model itself keeps the noise variance that predicts best. Statements and proofs of all
bounds are in docs/bounds; decision 12 explains the companion posterior.

See Also:
    colift.gp.error_bounds: factors of the bounds and their assumptions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift import gp
from colift.gp import error_bounds
from colift.gp.likelihood import min_noise_ratio
from colift.math.pytree import pytree, transfer
from colift.onboard.learning import residual_model

DETERMINISTIC_BOUNDS = frozenset({"energy"})
"""Bounds that hold deterministically, so they need no share of the confidence."""

ONLINE_BOUNDS = ("energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler")
"""Bounds with one factor for each output and update."""


@dataclasses.dataclass(frozen=True)
class BoundAssumptions:
    """Statements about true residual and labels on which an error bound rests.

    An assumption is reported as *assumed* unless it is listed in `satisfied`.

    Attributes:
        bound: Name of the bound; one of `ONLINE_BOUNDS`.
        confidence: Probability that all bounds hold: of all bodies, outputs, updates and inputs.
        rkhs_norm: Bound B of the RKHS norm of each output minus its prior mean; ``|f| <= B sqrt(signal_variance)``.
        payload: Bounds ``eps`` (6,) of the label errors of the payload [N, N m].
        agents: Bounds of the label errors of the agents, by group, of shape (agents, outputs) [N, N m].
        satisfied: Assumptions that hold by construction of the scenario.
    """

    bound: str
    confidence: float
    rkhs_norm: float
    payload: np.ndarray
    agents: tuple[np.ndarray, ...]
    satisfied: frozenset[error_bounds.BoundAssumption] = frozenset()

    def __post_init__(self) -> None:
        """Check bound, norm and label errors.

        Raises:
            ValueError: If the bound is unknown, or a norm or label error is not positive and finite.
        """
        if self.bound not in ONLINE_BOUNDS:
            raise ValueError(f"bound = {self.bound!r}: must be one of {', '.join(ONLINE_BOUNDS)}")
        if not (np.isfinite(self.rkhs_norm) and self.rkhs_norm > 0):
            raise ValueError(f"rkhs_norm = {self.rkhs_norm}: must be positive and finite")
        for name, eps in (("payload", self.payload), *((f"agents[{i}]", x) for i, x in enumerate(self.agents))):
            if not (np.isfinite(eps).all() and (eps > 0).all()):
                raise ValueError(f"label error of {name} = {eps.tolist()}: must be positive and finite")

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the bound's assumptions that are not satisfied.

        Assumptions of a whole simulation are listed in `colift.certification.assumptions`.
        """
        return describe_assumptions(error_bounds.unsatisfied(self.bound, self.satisfied))


def describe_assumptions(assumptions: Collection[error_bounds.BoundAssumption]) -> tuple[str, ...]:
    """Return the names of assumptions in the order of their definition.

    Args:
        assumptions: Assumptions of error bounds.

    Returns:
        Names in lower case with spaces.
    """
    return tuple(a.name.lower().replace("_", " ") for a in error_bounds.BoundAssumption if a in assumptions)


@pytree
class ConfidenceBands:
    """Bounds ``|f_i(x) - mean_i(x)| <= beta_i sigma_i(x)`` of all outputs, for every input x.

    Attributes:
        bound_posterior: Companion posteriors, which give ``mean_i`` and ``sigma_i``.
        payload_beta: Factors ``beta_i`` of the payload.
        agent_beta: Factors of the agents, by group.
    """

    bound_posterior: residual_model.ResidualModel
    payload_beta: Float[Array, "6"]
    agent_beta: tuple[Float[Array, "_agents _outputs"], ...]


def confidence_bands(
    model: residual_model.ResidualModel, assumptions: BoundAssumptions, update_index: int
) -> ConfidenceBands:
    """Compute the error bounds of a residual model, on the host.

    The admissible probability of failure is divided equally among bodies, and of each body among outputs. Update k
    receives the share ``6 / (pi k)^2`` (rem1 of the paper; docs/errata.md, rows 8 and 16).

    Args:
        model: Residual model.
        assumptions: Bound and statements about residual and labels.
        update_index: Index k of the update; at least 1 for a model with data.

    Returns:
        The bounds; the factor of a model without data is the RKHS norm.
    """
    bodies = 1 + sum(len(group.num_points) for group in model.agents)
    payload, beta = _body_bound(model.payload, assumptions, assumptions.payload, bodies, update_index)
    groups, betas = [], []
    for group, eps in zip(model.agents, assumptions.agents, strict=True):
        if not np.asarray(group.num_points).any():
            groups.append(group)
            betas.append(transfer(np.full(eps.shape, assumptions.rkhs_norm, dtype=float)))
            continue
        # NumPy slices and stacks the arrays: JAX would compile a program for each operation.
        one = [jax.tree.map(lambda x, j=j: jnp.asarray(np.asarray(x)[j]), group) for j in range(len(group.num_points))]
        each = [_body_bound(agent, assumptions, eps[j], bodies, update_index) for j, agent in enumerate(one)]
        groups.append(jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *(companion for companion, _ in each)))
        betas.append(jnp.asarray(np.stack([beta for _, beta in each])))
    companions = dataclasses.replace(model, payload=payload, agents=tuple(groups))
    return ConfidenceBands(bound_posterior=companions, payload_beta=beta, agent_beta=tuple(betas))


def _body_bound(
    model: gp.GPPosterior, assumptions: BoundAssumptions, eps: np.ndarray, bodies: int, update_index: int
) -> tuple[gp.GPPosterior, Float[Array, " outputs"]]:
    """Return the companion posterior of one body and its factors."""
    if int(model.num_points) == 0:
        return model, transfer(np.full(len(eps), assumptions.rkhs_norm, dtype=float))
    share = error_bounds.update_confidence_share(update_index) / (bodies * len(eps))
    (confidence,) = error_bounds.union_bound_levels(assumptions.confidence, [share])
    companion = bound_posterior(model, assumptions.bound, assumptions.rkhs_norm, eps)
    return companion, confidence_factor(companion, assumptions.bound, assumptions.rkhs_norm, eps, float(confidence))


def bound_posterior(model: gp.GPPosterior, bound: str, rkhs_norm: float, eps: np.ndarray) -> gp.GPPosterior:
    """Compute the companion posterior of a model, on the host.

    Its noise variance is ``n eps^2 / B^2`` for the energy bound, which gives ``beta <= sqrt(2) B``. It is ``eps^2``
    for the other bounds: errors of at most ``eps`` then satisfy the noise assumption of Srinivas et al. The variance is
    limited from below by the conditioning of the kernel matrix in float64.

    Args:
        model: GP of a body.
        bound: Name of the bound.
        rkhs_norm: Bound B of the RKHS norm.
        eps: Bounds of the label errors, by output.

    Returns:
        Posterior of the same data and kernel.
    """
    n, h = int(model.num_points), model.hyper
    v = n * eps**2 / rkhs_norm**2 if bound in DETERMINISTIC_BOUNDS else eps**2
    v = np.maximum(v, min_noise_ratio(model.capacity) * np.asarray(h.signal_variance))
    hyper = dataclasses.replace(h, noise_variance=jnp.asarray(v))
    return gp.condition(np.asarray(model.X)[:n], np.asarray(model.Y)[:n], hyper, model.capacity)


def confidence_factor(
    model: gp.GPPosterior, bound: str, rkhs_norm: float, eps: np.ndarray, confidence: float
) -> Float[Array, " outputs"]:
    """Compute the factor beta of an error bound.

    Label errors of zero mean and of at most ``eps`` are sub-Gaussian with ``R = eps`` (Hoeffding's lemma).

    Args:
        model: Companion posterior.
        bound: Name of the bound; one of `ONLINE_BOUNDS`.
        rkhs_norm: Bound B of the RKHS norm.
        eps: Bounds of the label errors, by output.
        confidence: Confidence of the bound of each output.

    Returns:
        Factor of each output; infinite if the data contradict B and ``eps``.

    Raises:
        ValueError: If the bound is unknown.
    """
    match bound:
        case "energy":
            return error_bounds.bounded_energy(model, rkhs_norm, eps)
        case "srinivas":
            gain = error_bounds.max_information_gain(model.hyper, int(model.num_points) + 1)
            return error_bounds.srinivas(model, rkhs_norm, confidence, gain)
        case "abbasi_yadkori":
            return error_bounds.abbasi_yadkori(model, rkhs_norm, eps, confidence)
        case "chowdhury_gopalan":
            return error_bounds.chowdhury_gopalan(model, rkhs_norm, eps, confidence, model.capacity)
        case "fiedler":
            return error_bounds.fiedler(model, rkhs_norm, eps, confidence)
    raise ValueError(f"bound = {bound!r}: must be one of {', '.join(ONLINE_BOUNDS)}")


@jax.jit
def error_radius(
    model: gp.GPPosterior, companion: gp.GPPosterior, beta: Float[Array, " outputs"], x: Float[Array, " dimensions"]
) -> Float[Array, " outputs"]:
    """Compute the error bound ``rho_i(x) = |mu_i(x) - mean_i(x)| + beta_i sigma_i(x)`` of a model.

    Args:
        model: GP with the mean ``mu_i``.
        companion: Companion posterior with ``mean_i`` and ``sigma_i``, which are rounded outward.
        beta: Factors of the bound.
        x: Features of the input.

    Returns:
        Bound of ``|f_i(x) - mu_i(x)|`` in the unit of the output; infinite where beta is infinite.
    """
    return jnp.abs(gp.mean(model, x) - gp.mean(companion, x)) + error_bounds.error_radius(companion, x, beta)


@jax.jit
def payload_radius(
    model: residual_model.ResidualModel, bands: ConfidenceBands, x: Float[Array, "time inputs"]
) -> Float[Array, "time 6"]:
    """Compute the error bounds of the payload outputs at a series of inputs.

    Args:
        model: Residual model.
        bands: Error bounds of the model.
        x: Payload inputs, time first.

    Returns:
        Bounds [N, N m].
    """
    along = jax.vmap(error_radius, in_axes=(None, None, None, 0))
    return along(model.payload, bands.bound_posterior.payload, bands.payload_beta, model.features.payload(x))


@jax.jit
def agent_radius(
    group: gp.GPPosterior,
    companion: gp.GPPosterior,
    beta: Float[Array, "agents outputs"],
    x: Float[Array, "time agents features"],
) -> Float[Array, "time agents outputs"]:
    """Compute the error bounds of the agent outputs of a group at a series of features.

    Args:
        group: GPs of the agents of a group.
        companion: Companion posteriors of the agents.
        beta: Factors of the bounds.
        x: Features of the agents, time first.

    Returns:
        Bounds [N, N m].
    """
    return jax.vmap(jax.vmap(error_radius), in_axes=(None, None, None, 0))(group, companion, beta, x)
