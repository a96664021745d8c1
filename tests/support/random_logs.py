"""Random logs for tests of log and figures, with the shapes of a team."""

from __future__ import annotations

import dataclasses
import functools
import re
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from colift.closed_loop import log
from colift.closed_loop.signals import StepRecord
from colift.models.parameters import KinematicTree, Team
from colift.onboard.learning.prediction_uncertainty import PredictionUncertainty
from tests.support import random_teams


class Shape(NamedTuple):
    """Groups as `(agents, joints, arms)` each."""

    groups: tuple[tuple[int, int, int], ...]
    eta: int = 6
    time: int = 40
    period: float = 0.002

    @property
    def sizes(self) -> dict[str, int]:
        """Return the sizes of the dimensions named in the annotations of `Row`."""
        agents, joints, contacts = (
            sum(n for n, _, _ in self.groups),
            sum(n * j for n, j, _ in self.groups),
            sum(n * a for n, _, a in self.groups),
        )
        return {"time": self.time, "agents": agents, "joints": joints, "contacts": contacts, "eta": self.eta}

    @property
    def team(self) -> Team:
        """A random team of these groups; agents with four joints have two that slide."""
        return team(self.groups)

    @property
    def names(self) -> dict[str, list[str]]:
        """Return names of agents, joints and contacts in team order."""
        team = [(j, a) for n, j, a in self.groups for _ in range(n)]
        return {
            "agents": [f"agent{i}" for i in range(len(team))],
            "joints": [f"agent{i}/joint{k}" for i, (joints, _) in enumerate(team) for k in range(joints)],
            "contacts": [f"agent{i}/arm{k}" for i, (_, arms) in enumerate(team) for k in range(arms)],
        }


RUN = "colift-run-0123456789ab"
PAPER = Shape(groups=((2, 3, 2),))
MIXED = Shape(groups=((2, 3, 2), (1, 0, 1), (1, 4, 3)), eta=18)


@functools.cache
def team(groups: tuple[tuple[int, int, int], ...]) -> Team:
    """A random team of groups `(agents, joints, arms)`."""
    structure = []
    for size, joints, arms in groups:
        slides = (False, True, True, False) if joints == 4 else (False,) * joints
        tips = tuple(max(0, joints - k) for k in range(arms))
        structure.append((KinematicTree(parents=(0,) * joints, prismatic=slides, tip_bodies=tips), size))
    return random_teams.team(np.random.default_rng(11), tuple(structure))


def field_axes(field: str) -> list[str]:
    """Return the axes that the annotation of a field of `Row` states."""
    stated = re.search(r"Array, ['\"](.*?)['\"]", str(StepRecord.__annotations__[field]))
    assert stated
    return stated[1].replace("*", "").split()


def rows(rng: np.random.Generator, shape: Shape, **given: np.ndarray) -> StepRecord:
    """Return a random log with the shapes that `Row` states; some signals may be given."""
    sizes = shape.sizes
    leaves = {
        field.name: rng.normal(size=[sizes[axis] if axis in sizes else int(axis) for axis in field_axes(field.name)])
        for field in dataclasses.fields(StepRecord)
    }
    leaves["t"] = shape.period * np.arange(shape.time)
    for field in dataclasses.fields(StepRecord):
        if str(StepRecord.__annotations__[field.name]).startswith("Bool"):
            leaves[field.name] = leaves[field.name] > 1
    leaves["Psi"] = np.abs(leaves["Psi"])
    leaves["label_valid"] = (leaves["label_valid"] > 0).astype(float)
    for name in ("correction_weight_L", "correction_weight_x"):
        leaves[name] = 1 / (1 + np.exp(-leaves[name]))
    leaves |= given
    # built of JAX arrays, so that the annotations are checked; in a flight the leaves are NumPy's too
    return jax.tree.map(np.array, StepRecord(**{name: jnp.asarray(x) for name, x in leaves.items()}))


def sigma(rng: np.random.Generator, shape: Shape, every: int = 5) -> PredictionUncertainty:
    """Return random standard deviations and bounds at a decimated rate."""
    t = shape.period * np.arange(0, shape.time, every)
    return PredictionUncertainty(
        t=t,
        payload_std=rng.uniform(0.1, 1, (len(t), 6)),
        agent_std=tuple(rng.uniform(0.1, 1, (len(t), n, 6 + joints)) for n, joints, _ in shape.groups),
        payload_label_bias=rng.uniform(0.05, 0.1, (len(t), 6)),
        agent_label_bias=tuple(rng.uniform(0.05, 0.1, (len(t), n, 6 + joints)) for n, joints, _ in shape.groups),
        payload_radius=rng.uniform(1, 9, (len(t), 6)),
        agent_radius=tuple(rng.uniform(1, 9, (len(t), n, 6 + joints)) for n, joints, _ in shape.groups),
        force_errors_to_payload=rng.uniform(0, 1, (len(t), 6, sum(n for n, _, _ in shape.groups), 3)),
    )


def dataset(rng: np.random.Generator, shape: Shape = PAPER, **attrs: object) -> xr.Dataset:
    """Return a random flight as the study logs it."""
    stated = {
        "case": "C3",
        "seed": 1,
        "complete": 1,
        "termination_reason": "",
        "update_times_s": [0.02, 0.05],
        "T_end_s": 0.05,
    }
    stated |= {
        "rho_bound": "energy",
        "rho_confidence": 0.95,
        "bound_assumptions": "rkhs norm, bounded noise energy",
        "run": RUN,
    }
    drawn = rows(rng, shape), sigma(rng, shape)
    return log.dataset(drawn[0], team=shape.team, sigma=drawn[1], attrs=stated | attrs, **shape.names)
