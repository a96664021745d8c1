"""Poses of a flight that are computed from its records: quaternions and positions of the base origins."""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matvec
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Team

BATCH = 512
"""Ticks that are evaluated at once, so that JAX compiles one program for flights of all lengths."""


def continuous_quaternions(R: np.ndarray) -> np.ndarray:
    """Compute the unit quaternions of attitudes over time, without changes of sign between two ticks.

    Args:
        R: Attitudes `(time, ..., 3, 3)`, body to world.

    Returns:
        Quaternions (w, x, y, z) with `w >= 0` at the first tick.
    """
    q = _in_batches(_quaternions, R)
    flips = (q[1:] * q[:-1]).sum(axis=-1, keepdims=True) < 0
    sign = np.cumprod(np.where(flips, -1.0, 1.0), axis=0)
    return np.concatenate([q[:1], sign * q[1:]])


def base_positions(team: Team, R: np.ndarray, x: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Compute the positions of the base origins: `x - R s(r)`, s: center of mass in the base frame.

    Args:
        team: True parameters of the team.
        R: Base attitudes `(time, agents, 3, 3)`, base to world.
        x: Centres of mass of the agents `(time, agents, 3)` [m, world].
        r: Positions of all joints in team order `(time, joints)` [rad or m].

    Returns:
        Positions `(time, agents, 3)` [m, world].
    """
    positions, agent, joint = [], 0, 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        agents, joints = slice(agent, agent + size), slice(joint, joint + size * group.tree.joints)
        own = r[:, joints].reshape(len(r), size, group.tree.joints)
        positions.append(
            _in_batches(lambda *poses, group=group: _base_origins(group, *poses), R[:, agents], x[:, agents], own)
        )
        agent, joint = agents.stop, joints.stop
    return np.concatenate(positions, axis=1)


def _in_batches(f: Callable[..., Array], *signals: np.ndarray) -> np.ndarray:
    """Evaluate a function of signals over time in batches of constant size; the last one repeats its last tick."""
    batches = []
    for start in range(0, len(signals[0]), BATCH):
        parts = [x[start : start + BATCH] for x in signals]
        ticks = len(parts[0])
        padded = (np.concatenate([x, np.repeat(x[-1:], BATCH - ticks, axis=0)]) for x in parts)
        batches.append(np.asarray(f(*padded))[:ticks])
    return np.concatenate(batches)


_quaternions = jax.jit(so3.quaternion)


@jax.vmap
def _base_origin(
    agent: AerialManipulator, R: Float[Array, "3 3"], x: Float[Array, "3"], r: Float[Array, "n_r"]
) -> Float[Array, "3"]:
    """Compute the position of one base origin."""
    return x - matvec(R, aerial_manipulator.center_of_mass(agent, r))


_base_origins = jax.jit(jax.vmap(_base_origin, in_axes=(None, 0, 0, 0)))
