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
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentState, GeneralizedForce, PayloadState
from colift.onboard.control.attitude import attitude_trajectory
from colift.onboard.control.redundancy import _with_tips
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand

PREVIEW_NODES = np.arange(-2.0, 3.0)  # of times around now, in steps
# At the nodes, of the quartic through values there: itself, its rate and its second rate, in steps.
PREVIEW_BASIS = [
    [[math.perm(k, order) * s ** max(k - order, 0) for k in range(5)] for s in PREVIEW_NODES] for order in range(3)
]
FINITE_DIFFERENCE_WEIGHTS = np.array(PREVIEW_BASIS) @ np.linalg.inv(np.vander(PREVIEW_NODES, increasing=True))


@pytree
class AgentPreview:
    """What one agent is asked for where the law is evaluated on the reference, at `NODES` times the step."""

    step: Float[Array, ""]  # s
    payload: PayloadState  # times lead
    acceleration_cmd: AccelerationCommand
    f: Float[Array, "times 3"]  # N, `m (a - a_g) + sum lam - f_hat_x`


def preview_attitude_setpoint(
    agent: AerialManipulator,
    gravity: Float[Array, "3"],
    q: AgentState,
    acceleration_cmd: AccelerationCommand,
    share: AgentSetpoint,
    f_hat: GeneralizedForce,
    preview: AgentPreview,
) -> AttitudeSetpoint:
    """Thrust along `f_dir` with the swing of the agent about its tips, its rates from the reference ahead.

    `f_dir = m (x_dd - a_g) + sum lam - f_hat_x`: where an agent turns, its centre of mass does not accelerate as the
    payload does. f_dir is a quartic through five times around now, as the law asks on the reference, so its rates hold
    that of f_hat and no noise. From the turn without the swing follows the swing, and from that the turn.
    """
    m = agent.mass.sum()
    still = dataclasses.replace(q, r=share.nominal_posture, r_dot=jnp.zeros_like(q.r_dot))
    g = aerial_manipulator.forward_kinematics(agent, still.r)
    reduced, context = aerial_manipulator.centroidal_model(agent, g), len(PREVIEW_NODES) // 2

    def swing(
        f: Float[Array, "3 3"], payload: PayloadState, acceleration_cmd: AccelerationCommand
    ) -> Float[Array, "3"]:
        turn = attitude_trajectory(f, share.yaw)
        assert turn.omega_dot is not None
        _, kappa = aerial_manipulator.bias_forces(agent, g, reduced, turn.omega, still.r_dot)
        free = jnp.concatenate([turn.R.T @ acceleration_cmd.a, jnp.zeros_like(still.r)])
        y = _with_tips(agent, payload, acceleration_cmd, reduced, kappa, turn.R, turn.omega_dot, free)
        return turn.R @ y[:3] - acceleration_cmd.a

    swings = m * jax.vmap(swing)(_rates(preview.f, preview.step), preview.payload, preview.acceleration_cmd)
    f = m * (acceleration_cmd.a - gravity) + share.lam.sum(0) - f_hat.f_x + swings[context]
    return attitude_trajectory(_rates(preview.f + swings, preview.step)[context].at[0].set(f), share.yaw)


def _rates(values: Float[Array, "times 3"], step: Float[Array, ""]) -> Float[Array, "times 3 3"]:
    """Of the quartic through values at the nodes: there, its value, rate and second rate; step: s."""
    return jnp.stack([jnp.asarray(rate) @ values / step**k for k, rate in enumerate(FINITE_DIFFERENCE_WEIGHTS)], axis=1)
