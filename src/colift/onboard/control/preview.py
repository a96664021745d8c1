"""What flies: the leader's wrench on SE(3), and how each agent realizes its contact forces."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import aerial_manipulator
from colift.models.parameters import Agent
from colift.models.state import AgentForce, AgentState, PayloadState
from colift.onboard.control.attitude import turning
from colift.onboard.control.redundancy import _with_tips
from colift.onboard.control.setpoints import Share, Turn
from colift.onboard.control.tracking import Command

NODES = np.arange(-2.0, 3.0)  # of times around now, in steps
# At the nodes, of the quartic through values there: itself, its rate and its second rate, in steps.
QUARTIC = [[[math.perm(k, order) * s ** max(k - order, 0) for k in range(5)] for s in NODES] for order in range(3)]
RATES = np.array(QUARTIC) @ np.linalg.inv(np.vander(NODES, increasing=True))


@pytree
class Ahead:
    """What one agent is asked for where the law is evaluated on the reference, at `NODES` times the step."""

    step: Float[Array, ""]  # s
    load: PayloadState  # times lead
    to: Command
    f: Float[Array, "times 3"]  # N, `m (a - a_g) + sum lam - f_hat_x`


def anticipated(
    agent: Agent,
    gravity: Float[Array, "3"],
    q: AgentState,
    to: Command,
    share: Share,
    f_hat: AgentForce,
    ahead: Ahead,
) -> Turn:
    """Thrust along `f_dir` with the swing of the agent about its tips, its rates from the reference ahead.

    `f_dir = m (x_dd - a_g) + sum lam - f_hat_x`: where an agent turns, its centre of mass does not accelerate as the
    payload does. f_dir is a quartic through five times around now, as the law asks on the reference, so its rates hold
    that of f_hat and no noise. From the turn without the swing follows the swing, and from that the turn.
    """
    m = agent.mass.sum()
    still = dataclasses.replace(q, r=share.rest, r_dot=jnp.zeros_like(q.r_dot))
    g = aerial_manipulator.geometry(agent, still.r)
    reduced, now = aerial_manipulator.reduce(agent, g), len(NODES) // 2

    def swing(f: Float[Array, "3 3"], load: PayloadState, to: Command) -> Float[Array, "3"]:
        turn = turning(f, share.heading)
        assert turn.omega_dot is not None
        _, kappa = aerial_manipulator.bias(agent, g, reduced, turn.omega, still.r_dot)
        free = jnp.concatenate([turn.R.T @ to.a, jnp.zeros_like(still.r)])
        y = _with_tips(agent, load, to, reduced, kappa, turn.R, turn.omega_dot, free)
        return turn.R @ y[:3] - to.a

    swings = m * jax.vmap(swing)(_rates(ahead.f, ahead.step), ahead.load, ahead.to)
    f = m * (to.a - gravity) + share.lam.sum(0) - f_hat.f_x + swings[now]
    return turning(_rates(ahead.f + swings, ahead.step)[now].at[0].set(f), share.heading)


def _rates(values: Float[Array, "times 3"], step: Float[Array, ""]) -> Float[Array, "times 3 3"]:
    """Of the quartic through values at the nodes: there, its value, rate and second rate; step: s."""
    return jnp.stack([jnp.asarray(rate) @ values / step**k for k, rate in enumerate(RATES)], axis=1)
