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
from colift.gp.likelihood import least_noise
from colift.math.pytree import pytree
from colift.onboard.learning import residual_model

CERTAIN = frozenset({"energy"})  # holds for certain or not at all: it takes no share of the confidence
ALONG = ("energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler")
"""Bounds whose factor is one number an output and an update."""


@dataclasses.dataclass(frozen=True)
class Stated:
    """What a person states of the unknown functions and of the labels; what rests on it is assumed unless `met`."""

    bound: str  # one of ALONG
    confidence: float  # that every band holds: all bodies, outputs, updates, inputs
    norm: float  # B, of every output less its prior mean: |f| <= B sqrt(signal_variance)
    payload: np.ndarray  # (6,) eps, at most the size of a label's error, N and N m
    agents: tuple[np.ndarray, ...]  # by group, (agents, outputs)
    met: frozenset[error_bounds.Assumption] = frozenset()

    def __post_init__(self) -> None:
        if self.bound not in ALONG:
            raise ValueError(f"bound = {self.bound!r}: must be one of {', '.join(ALONG)}")
        if not (np.isfinite(self.norm) and self.norm > 0):
            raise ValueError(f"norm = {self.norm}: must be positive and finite")
        for name, eps in (("payload", self.payload), *((f"agents[{i}]", x) for i, x in enumerate(self.agents))):
            if not (np.isfinite(eps).all() and (eps > 0).all()):
                raise ValueError(f"label error of {name} = {eps.tolist()}: must be positive and finite")

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the bound's assumptions that are not met. What flies rests on more: `colift.certification.assumptions`."""
        return names(error_bounds.unmet(self.bound, self.met))


def names(assumptions: Collection[error_bounds.Assumption]) -> tuple[str, ...]:
    """Assumptions in words, in the order in which they are defined."""
    return tuple(a.name.lower().replace("_", " ") for a in error_bounds.Assumption if a in assumptions)


@pytree
class Bands:
    """`|f_i(x) - mean_i(x)| <= beta_i sigma_i(x)` for every x, mean and deviation those of the companions."""

    companion: residual_model.Oracle
    payload: Float[Array, "6"]  # beta
    agents: tuple[Float[Array, "_agents _outputs"], ...]  # beta, by group


def bands(oracle: residual_model.Oracle, stated: Stated, k: int) -> Bands:
    """The bands of the oracle of update k = 1, 2, ...; of one without data, at any k, beta = B (host).

    Each body has an equal share of what `confidence` leaves, each of its outputs an equal share of that, update k the
    share `6 / (pi k)^2` (rem1 of the paper, and rows 8 and 16 of the errata). Raises ValueError for k < 1 with data.
    """
    bodies = 1 + sum(len(group.n) for group in oracle.agents)
    payload, beta = _band(oracle.payload, stated, stated.payload, bodies, k)
    groups, betas = [], []
    for group, eps in zip(oracle.agents, stated.agents, strict=True):
        if not np.asarray(group.n).any():
            groups.append(group)
            betas.append(jnp.full(eps.shape, stated.norm, dtype=float))
            continue
        # slices and stacks by NumPy: by JAX each would be a program to compile
        one = [jax.tree.map(lambda x, j=j: jnp.asarray(np.asarray(x)[j]), group) for j in range(len(group.n))]
        each = [_band(model, stated, eps[j], bodies, k) for j, model in enumerate(one)]
        groups.append(jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *(other for other, _ in each)))
        betas.append(jnp.asarray(np.stack([beta for _, beta in each])))
    companion = dataclasses.replace(oracle, payload=payload, agents=tuple(groups))
    return Bands(companion=companion, payload=beta, agents=tuple(betas))


def _band(model: gp.GP, stated: Stated, eps: np.ndarray, bodies: int, k: int) -> tuple[gp.GP, Float[Array, " outputs"]]:
    """The companion of one body's model, and its beta."""
    if int(model.n) == 0:
        return model, jnp.full(len(eps), stated.norm, dtype=float)
    share = error_bounds.update_weight(k) / (bodies * len(eps))
    (confidence,) = error_bounds.split_union(stated.confidence, [share])
    other = companion(model, stated.bound, stated.norm, eps)
    return other, factor(other, stated.bound, stated.norm, eps, float(confidence))


def companion(model: gp.GP, bound: str, norm: float, eps: np.ndarray) -> gp.GP:
    """The posterior of the same data at `v = n eps^2 / B^2` for the energy bound, `v = eps^2` for the others (host).

    The first gives `beta <= sqrt(2) B`; with the second, labels within eps are within the model, as the bound of
    Srinivas needs. Not below what float64 can bear.
    """
    n, h = int(model.n), model.hyper
    v = n * eps**2 / norm**2 if bound in CERTAIN else eps**2
    v = np.maximum(v, least_noise(model.capacity) * np.asarray(h.signal_variance))
    hyper = dataclasses.replace(h, noise_variance=jnp.asarray(v))
    return gp.condition(np.asarray(model.X)[:n], np.asarray(model.Y)[:n], hyper, model.capacity)


def factor(model: gp.GP, bound: str, norm: float, eps: np.ndarray, confidence: float) -> Float[Array, " outputs"]:
    """beta of every output under a bound of ALONG; infinite where the data contradict B and eps.

    Errors of zero mean within eps are sub-Gaussian with `R = eps` (Hoeffding's lemma).
    """
    match bound:
        case "energy":
            return error_bounds.energy(model, norm, eps)
        case "srinivas":
            gain = error_bounds.greatest_gain(model.hyper, int(model.n) + 1)
            return error_bounds.srinivas(model, norm, confidence, gain)
        case "abbasi_yadkori":
            return error_bounds.abbasi_yadkori(model, norm, eps, confidence)
        case "chowdhury_gopalan":
            return error_bounds.chowdhury_gopalan(model, norm, eps, confidence, model.capacity)
        case "fiedler":
            return error_bounds.fiedler(model, norm, eps, confidence)
    raise ValueError(f"bound = {bound!r}: must be one of {', '.join(ALONG)}")


@jax.jit
def radius(
    model: gp.GP, other: gp.GP, beta: Float[Array, " outputs"], x: Float[Array, " dimensions"]
) -> Float[Array, " outputs"]:
    """`rho_i(x) = |mu_i(x) - mean_i(x)| + beta_i sigma_i(x)`, unit of y: bounds `|f_i(x) - mu_i(x)|` at every x.

    mu is the model's mean; mean and sigma are the companion's, rounded outward. Infinite where beta is.
    """
    return jnp.abs(gp.mean(model, x) - gp.mean(other, x)) + error_bounds.radius(other, x, beta)


@jax.jit
def payload_radius(
    oracle: residual_model.Oracle, held: Bands, x: Float[Array, "time inputs"]
) -> Float[Array, "time 6"]:
    """`rho_i` of each payload output along a path of samples, N and N m."""
    along = jax.vmap(radius, in_axes=(None, None, None, 0))
    return along(oracle.payload, held.companion.payload, held.payload, oracle.features.payload(x))


@jax.jit
def agent_radius(
    group: gp.GP, other: gp.GP, beta: Float[Array, "agents outputs"], x: Float[Array, "time agents features"]
) -> Float[Array, "time agents outputs"]:
    """`rho_i` of each agent output of a group along a path of features."""
    return jax.vmap(jax.vmap(radius), in_axes=(None, None, None, 0))(group, other, beta, x)
