"""Largest loss of thrust that a team at rest can bear, by a linear program for each agent."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import linprog

from colift.analysis.findings import Finding
from colift.math import so3
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import State
from colift.scenario import Scenario, team

MAX_LISTED = 6  # agents in the message of the finding


def largest_losses(truth: Team, state: State) -> np.ndarray:
    """Compute the largest share of its maximum thrust that each agent may lose, one agent at a time.

    Contact forces hold the payload at rest, all thrusts are vertical, and the other agents have their maximum thrusts.
    For agent j, with contact forces `lam` on the payload, the program is::

        minimize u_j  subject to  G lam = -m_L (g, 0),  (sum_b lam_jb)_xy = 0,  0 <= u_j <= u_max,j
        with u_j = m_j |g| + (sum_b lam_jb)_z

    Disturbances, friction limits and the transient are neglected, so the loss is an upper bound for a control law with
    vertical thrusts at rest.

    Args:
        truth: True parameters.
        state: State at rest.

    Returns:
        Shares `(agents,)` in [0, 1]; NaN if the team cannot hover or has no weight.
    """
    gravity = np.asarray(truth.gravity)
    weight = float(np.linalg.norm(gravity))
    most = np.concatenate([np.asarray(group.thrust_max) for group in truth.agent_groups])
    mass = np.concatenate([np.asarray(group.mass).sum(1) for group in truth.agent_groups])
    if weight == 0:
        return np.full(len(most), np.nan)
    R = np.asarray(state.payload.R)
    c = np.asarray(grasp.contact_points(truth)) @ R.T
    arms = [group.tree.arms for size, group in zip(truth.sizes, truth.agent_groups, strict=True) for _ in range(size)]
    owner = np.repeat(np.arange(len(most)), arms)
    _, _, axes = np.linalg.svd(gravity[None])  # the first row is along the vertical, the others are horizontal
    up, across = -gravity / weight, axes[1:]
    balance = np.vstack([np.tile(np.eye(3), len(c)), np.hstack(list(np.asarray(so3.hat(c))))])
    lift = np.stack([np.kron(owner == j, up) for j in range(len(most))])
    sideways = np.vstack([np.kron(owner == j, across) for j in range(len(most))])
    demand = np.concatenate([-float(truth.payload.mass) * gravity, np.zeros(3)])
    bounds = mass * weight
    shares = []
    for j in range(len(most)):
        found = linprog(
            lift[j],
            A_ub=np.vstack([lift, -lift]),
            b_ub=np.concatenate([most - bounds, bounds]),
            A_eq=np.vstack([balance, sideways]),
            b_eq=np.concatenate([demand, np.zeros(len(sideways))]),
            bounds=(None, None),
        )
        shares.append(1 - (found.fun + bounds[j]) / most[j] if found.status == 0 else np.nan)
    return np.array(shares)


def check_losses(settings: Scenario, truth: Team, state: State) -> Iterator[Finding]:
    """Report the largest loss of thrust of each agent; no finding if the team cannot hover or has no weight."""
    losses = largest_losses(truth, state)
    if not np.isfinite(losses).all():
        return
    names = team.agent_names(settings)
    order = np.argsort(losses, kind="stable")[:MAX_LISTED]
    listed = ", ".join(f"{names[k]} {losses[k]:.1%}" for k in sorted(order.tolist()))
    of_all = f", the smallest of {len(names)} agents" if len(names) > MAX_LISTED else ""
    yield Finding(
        "thrust loss",
        f"shares of the largest thrust that one agent may lose at rest: {listed}{of_all}",
        {"largest_thrust_loss": dict(zip(names, losses.tolist(), strict=True))},
    )
