"""Samples of the varied settings, and the flights of a campaign."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import math
from importlib.metadata import version

import numpy as np
from pydantic import JsonValue
from scipy import special
from scipy.stats import qmc

from colift.campaigns.spec import Campaign, Distribution, Grid, LoadedCampaign, LogUniform, Normal, Uniform
from colift.scenario.cases import case_id

SIGNIFICANT_DIGITS = 12
"""Digits of a sampled number, so that mathematical libraries with other rounding yield the same flights."""
Settings = tuple[tuple[str, JsonValue], ...]
"""Paths and values of settings."""


@dataclasses.dataclass(frozen=True)
class PlannedFlight:
    """One flight of a campaign.

    Attributes:
        id: SHA-256 of settings, case and version.
        sample: Number of the sample; flights of one sample differ in the case only.
        case: Identifier of the case.
        seed: Seed of the noise.
        settings: Varied settings.
    """

    id: str
    sample: int
    case: str
    seed: int
    settings: Settings


def plan_flights(campaign: LoadedCampaign) -> tuple[PlannedFlight, ...]:
    """List all flights of a campaign in the order of their samples.

    The result depends on the specification and the scenario only. More samples or seeds keep the former flights.

    Args:
        campaign: Specification with its scenario.

    Returns:
        The flights; those of one sample are adjacent.
    """
    spec, first = campaign.spec, campaign.scenario.seed
    base = hashlib.sha256(campaign.settings_json.encode()).hexdigest()
    shared = [base, spec.duration_s, version("colift"), campaign.scenario.physics.kind]
    flights = []
    for number, settings in enumerate(_combinations(spec)):
        seeds = spec.seeds or (first if spec.sampling == "saltelli" else first + number,)
        for k, seed in enumerate(seeds):
            for case in dict.fromkeys(map(case_id, spec.cases)):
                key = json.dumps([*shared, case, seed, sorted(settings)], sort_keys=True)
                identifier = hashlib.sha256(key.encode()).hexdigest()
                flights.append(PlannedFlight(identifier, number * len(seeds) + k, case, seed, settings))
    return tuple(flights)


def _combinations(spec: Campaign) -> list[Settings]:
    """Return the settings of all samples: each draw with each combination of the grids."""
    grids = {path: variation.values for path, variation in spec.vary.items() if isinstance(variation, Grid)}
    drawn = {path: variation for path, variation in spec.vary.items() if not isinstance(variation, Grid)}
    values = _draw(list(drawn.values()), spec)
    combined = []
    for row in values:
        for combination in itertools.product(*grids.values()):
            by_path = dict(zip(drawn, row, strict=True)) | dict(zip(grids, combination, strict=True))
            combined.append(tuple((path, by_path[path]) for path in spec.vary))
    return combined


def _draw(distributions: list[Distribution], spec: Campaign) -> list[list[float]]:
    """Return the values of all distributions, one row per draw."""
    d, n = len(distributions), spec.samples
    if not d:
        return [[] for _ in range(n)]
    if spec.sampling == "random":
        columns = [np.random.default_rng([spec.sampling_seed, k]).random(n) for k in range(d)]
        u = np.stack(columns, axis=1)
    elif spec.sampling == "saltelli":
        u = _saltelli(_sobol(2 * d, n, spec.sampling_seed))
    else:
        u = _sobol(d, n, spec.sampling_seed)
    x = np.stack([_quantile(each, u[:, k]) for k, each in enumerate(distributions)], axis=1)
    return [[float(f"{value:.{SIGNIFICANT_DIGITS}g}") for value in row] for row in x.tolist()]


def _sobol(d: int, n: int, seed: int) -> np.ndarray:
    """Return the first n points of a scrambled Sobol sequence within (0, 1)."""
    sequence = qmc.Sobol(d, scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(math.ceil(math.log2(n)))[:n]
    return np.clip(points, 2.0**-31, 1 - 2.0**-31)


def _saltelli(points: np.ndarray) -> np.ndarray:
    """Return the samples A, B, and A with each column of B (Saltelli et al. 2010), one below the other."""
    A, B = np.split(points, 2, axis=1)
    mixed = []
    for k in range(A.shape[1]):
        AB = A.copy()
        AB[:, k] = B[:, k]
        mixed.append(AB)
    return np.concatenate([A, B, *mixed])


def _quantile(distribution: Distribution, u: np.ndarray) -> np.ndarray:
    """Return the quantiles of a distribution."""
    match distribution:
        case Uniform(low=low, high=high):
            return low + (high - low) * u
        case LogUniform(low=low, high=high):
            return np.exp(np.log(low) + (np.log(high) - np.log(low)) * u)
        case Normal(mean=mean, std=std):
            return mean + std * special.ndtri(u)
    raise TypeError(f"no distribution: {type(distribution).__name__}")
