"""Validation of team parameters: physical consistency of inertias, rotation matrices, finite values.

The functions run on the host, outside of `jax.jit`.

References:
    Traversaro, Brossette, Escande, Nori, *Identification of fully physical consistent inertial parameters using
    optimization on manifolds*, IROS 2016.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import ArrayLike

from colift.math import so3
from colift.models.parameters import Team, agent_names


def validate_team(team: Team, names: Sequence[str] = ()) -> None:
    """Validate all parameters of a team.

    Masses and thrusts must be positive, joint axes unit vectors, joint frames rotations, and positions finite. Inertias
    must be symmetric, positive definite and satisfy the triangle inequality: no principal moment exceeds the sum of the
    others.

    Args:
        team: Team.
        names: Names of the agents in team order, for messages.

    Raises:
        ValueError: If a parameter is invalid; the message contains the body, the value and the condition.
    """
    if not np.isfinite(team.gravity).all():
        raise ValueError(f"gravity {np.asarray(team.gravity).tolist()} m/s^2 is not finite")
    validate_inertia("the payload", team.payload.mass, team.payload.inertia)
    groups = [jax.tree.map(np.asarray, group) for group in team.agent_groups]
    agents = [(group, j) for group, size in zip(groups, team.sizes, strict=True) for j in range(size)]
    for name, (group, j) in zip(agent_names(team, names), agents, strict=True):
        for i in range(group.tree.joints + 1):
            validate_inertia(f"{name}, body {i}", group.mass[j, i], group.inertia[j, i])
        if not 0 < group.thrust_max[j] < np.inf:
            raise ValueError(f"{name}: thrust_max {group.thrust_max[j]:g} N is not positive and finite")
        for field in ("com", "joint_position", "tip_position", "contact_position"):
            if not np.isfinite(points := np.asarray(getattr(group, field)[j])).all():
                raise ValueError(f"{name}: {field} {points.tolist()} m is not finite")
        for k in range(group.tree.joints):
            axis, R = np.asarray(group.joint_axis[j, k]), np.asarray(group.joint_rotation[j, k])
            if not abs(np.linalg.norm(axis) - 1) <= 1e-9:
                raise ValueError(f"{name}, joint {k}: joint_axis {axis.tolist()} is not a unit vector")
            if not so3.is_rotation(R, 1e-9):
                raise ValueError(f"{name}, joint {k}: joint_rotation {R.tolist()} is not a rotation matrix")


def validate_mass(body: str, mass: ArrayLike) -> None:
    """Validate a mass.

    Args:
        body: Name of the body, for messages.
        mass: Mass [kg].

    Raises:
        ValueError: If the mass is not positive and finite.
    """
    m = float(np.asarray(mass))
    if not (np.isfinite(m) and m > 0):
        raise ValueError(f"{body}: mass {m:g} kg is not positive{'' if np.isfinite(m) else ' and finite'}")


def validate_inertia(body: str, mass: ArrayLike, inertia: ArrayLike) -> None:
    """Validate mass and inertia of a rigid body.

    Args:
        body: Name of the body, for messages.
        mass: Mass [kg].
        inertia: Inertia about the center of mass [kg m^2].

    Raises:
        ValueError: If no rigid body has these values.
    """
    validate_mass(body, mass)
    J = np.asarray(inertia)
    if J.shape != (3, 3) or not np.isfinite(J).all():
        raise ValueError(f"{body}: inertia {J.tolist()} kg m^2 is not a 3 x 3 matrix of finite numbers")
    if not np.abs(J - J.T).max() <= 1e-9 * np.abs(J).max():
        raise ValueError(f"{body}: inertia {J.tolist()} kg m^2 is not symmetric")
    a, b, c = np.linalg.eigvalsh(J)
    if not a > 0:
        raise ValueError(
            f"{body}: inertia is not positive definite: principal moments {a:.4g}, {b:.4g}, {c:.4g} kg m^2"
        )
    if c > (a + b) * (1 + 1e-9):
        raise ValueError(
            f"{body}: inertia violates the triangle inequality: principal moments {a:.4g}, {b:.4g}, {c:.4g} kg m^2, "
            f"and {c:.4g} > {a + b:.4g}"
        )
