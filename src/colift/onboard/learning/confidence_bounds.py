"""Confidence bands of the frozen oracles: how far each output's prediction may be from the unknown function.

A band is taken on a companion of the oracle: the posterior of the same data and kernel at the `noise_variance` v
at which its bound is tight, for that is free in the bound, while the oracle's own is chosen to predict well.
`docs/bounds.md` has the bounds, and decision 0012 why a companion.
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
from colift.math.pytree import pytree
from colift.onboard.learning import residual_model

DETERMINISTIC = frozenset({"energy"})  # holds for certain or not at all: it takes no share of the confidence
ONLINE_BOUNDS = ("energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler")
"""Bounds whose factor is one number an output and an update."""


@dataclasses.dataclass(frozen=True)
class BoundAssumptions:
    """What a person states of the unknown functions and of the labels; what rests on it is assumed unless `met`."""

    bound: str  # one of ALONG
    confidence: float  # that every band holds: all bodies, outputs, updates, inputs
    rkhs_norm: float  # B, of every output less its prior mean: |f| <= B sqrt(signal_variance)
    payload: np.ndarray  # (6,) eps, at most the size of a label's error, N and N m
    agents: tuple[np.ndarray, ...]  # by group, (agents, outputs)
    satisfied: frozenset[error_bounds.BoundAssumption] = frozenset()

    def __post_init__(self) -> None:
        if self.bound not in ONLINE_BOUNDS:
            raise ValueError(f"bound = {self.bound!r}: must be one of {', '.join(ONLINE_BOUNDS)}")
        if not (np.isfinite(self.rkhs_norm) and self.rkhs_norm > 0):
            raise ValueError(f"norm = {self.rkhs_norm}: must be positive and finite")
        for name, eps in (("payload", self.payload), *((f"agents[{i}]", x) for i, x in enumerate(self.agents))):
            if not (np.isfinite(eps).all() and (eps > 0).all()):
                raise ValueError(f"label error of {name} = {eps.tolist()}: must be positive and finite")

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the bound's assumptions that are not met. What flies rests on more: `colift.certification.assumptions`."""
        return describe_assumptions(error_bounds.unsatisfied(self.bound, self.satisfied))


def describe_assumptions(assumptions: Collection[error_bounds.BoundAssumption]) -> tuple[str, ...]:
    """Assumptions in words, in the order in which they are defined."""
    return tuple(a.name.lower().replace("_", " ") for a in error_bounds.BoundAssumption if a in assumptions)


@pytree
class ConfidenceBands:
    """`|f_i(x) - mean_i(x)| <= beta_i sigma_i(x)` for every x, mean and deviation those of the companions."""

    bound_posterior: residual_model.ResidualModel
    payload_beta: Float[Array, "6"]  # beta
    agent_beta: tuple[Float[Array, "_agents _outputs"], ...]  # beta, by group


def confidence_bands(oracle: residual_model.ResidualModel, stated: BoundAssumptions, k: int) -> ConfidenceBands:
    """The bands of the oracle of update k = 1, 2, ...; of one without data, at any k, beta = B (host).

    Each body has an equal share of what `confidence` leaves, each of its outputs an equal share of that, update k the
    share `6 / (pi k)^2` (rem1 of the paper, and rows 8 and 16 of the errata). Raises ValueError for k < 1 with data.
    """
    bodies = 1 + sum(len(group.num_points) for group in oracle.agents)
    payload, beta = _band(oracle.payload, stated, stated.payload, bodies, k)
    groups, betas = [], []
    for group, eps in zip(oracle.agents, stated.agents, strict=True):
        if not np.asarray(group.num_points).any():
            groups.append(group)
            betas.append(jnp.full(eps.shape, stated.rkhs_norm, dtype=float))
            continue
        # slices and stacks by NumPy: by JAX each would be a program to compile
        one = [jax.tree.map(lambda x, j=j: jnp.asarray(np.asarray(x)[j]), group) for j in range(len(group.num_points))]
        each = [_band(model, stated, eps[j], bodies, k) for j, model in enumerate(one)]
        groups.append(jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *(other for other, _ in each)))
        betas.append(jnp.asarray(np.stack([beta for _, beta in each])))
    companion = dataclasses.replace(oracle, payload=payload, agents=tuple(groups))
    return ConfidenceBands(bound_posterior=companion, payload_beta=beta, agent_beta=tuple(betas))


def _band(
    model: gp.GPPosterior, stated: BoundAssumptions, eps: np.ndarray, bodies: int, k: int
) -> tuple[gp.GPPosterior, Float[Array, " outputs"]]:
    """The companion of one body's model, and its beta."""
    if int(model.num_points) == 0:
        return model, jnp.full(len(eps), stated.rkhs_norm, dtype=float)
    share = error_bounds.update_confidence_share(k) / (bodies * len(eps))
    (confidence,) = error_bounds.union_bound_levels(stated.confidence, [share])
    other = bound_posterior(model, stated.bound, stated.rkhs_norm, eps)
    return other, confidence_factor(other, stated.bound, stated.rkhs_norm, eps, float(confidence))


def bound_posterior(model: gp.GPPosterior, bound: str, norm: float, eps: np.ndarray) -> gp.GPPosterior:
    """The posterior of the same data at `v = n eps^2 / B^2` for the energy bound, `v = eps^2` for the others (host).

    The first gives `beta <= sqrt(2) B`; with the second, labels within eps are within the model, as the bound of
    Srinivas needs. Not below what float64 can bear.
    """
    n, h = int(model.num_points), model.hyper
    v = n * eps**2 / norm**2 if bound in DETERMINISTIC else eps**2
    v = np.maximum(v, min_noise_ratio(model.capacity) * np.asarray(h.signal_variance))
    hyper = dataclasses.replace(h, noise_variance=jnp.asarray(v))
    return gp.condition(np.asarray(model.X)[:n], np.asarray(model.Y)[:n], hyper, model.capacity)


def confidence_factor(
    model: gp.GPPosterior, bound: str, norm: float, eps: np.ndarray, confidence: float
) -> Float[Array, " outputs"]:
    """beta of every output under a bound of ALONG; infinite where the data contradict B and eps.

    Errors of zero mean within eps are sub-Gaussian with `R = eps` (Hoeffding's lemma).
    """
    match bound:
        case "energy":
            return error_bounds.bounded_energy(model, norm, eps)
        case "srinivas":
            gain = error_bounds.max_information_gain(model.hyper, int(model.num_points) + 1)
            return error_bounds.srinivas(model, norm, confidence, gain)
        case "abbasi_yadkori":
            return error_bounds.abbasi_yadkori(model, norm, eps, confidence)
        case "chowdhury_gopalan":
            return error_bounds.chowdhury_gopalan(model, norm, eps, confidence, model.capacity)
        case "fiedler":
            return error_bounds.fiedler(model, norm, eps, confidence)
    raise ValueError(f"bound = {bound!r}: must be one of {', '.join(ONLINE_BOUNDS)}")


@jax.jit
def error_radius(
    model: gp.GPPosterior, other: gp.GPPosterior, beta: Float[Array, " outputs"], x: Float[Array, " dimensions"]
) -> Float[Array, " outputs"]:
    """`rho_i(x) = |mu_i(x) - mean_i(x)| + beta_i sigma_i(x)`, unit of y: bounds `|f_i(x) - mu_i(x)|` at every x.

    mu is the model's mean; mean and sigma are the companion's, rounded outward. Infinite where beta is.
    """
    return jnp.abs(gp.mean(model, x) - gp.mean(other, x)) + error_bounds.error_radius(other, x, beta)


@jax.jit
def payload_radius(
    model: residual_model.ResidualModel, held: ConfidenceBands, x: Float[Array, "time inputs"]
) -> Float[Array, "time 6"]:
    """`rho_i` of each payload output along a path of samples, N and N m."""
    along = jax.vmap(error_radius, in_axes=(None, None, None, 0))
    return along(model.payload, held.bound_posterior.payload, held.payload_beta, model.features.payload(x))


@jax.jit
def agent_radius(
    group: gp.GPPosterior,
    other: gp.GPPosterior,
    beta: Float[Array, "agents outputs"],
    x: Float[Array, "time agents features"],
) -> Float[Array, "time agents outputs"]:
    """`rho_i` of each agent output of a group along a path of features."""
    return jax.vmap(jax.vmap(error_radius), in_axes=(None, None, None, 0))(group, other, beta, x)
