"""Controller of agents that fly without payload, for the calibration of their residual models."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentInput, AgentState, GeneralizedForce, ResidualForces, TeamInputs
from colift.onboard.control import attitude, realization, tracking
from colift.onboard.interfaces import ContactForceCommand, ControlContext, PartState, SaturationFlags
from colift.trajectories.base import PayloadSetpoint

Scalar = Float[Array, ""]


@pytree
class FreeFlightController:
    """Agents fly along the path of the payload's reference, each with its own offset, with oscillating joints.

    Implements the protocol `AgentController`. Contact forces are zero. With the position ``p_d`` of the reference and
    the offset ``o``, the center of mass and the joints follow::

        x_dd = p_d'' - K_p (x - p_d - o) - K_v (v - p_d'),    r_dd = s'' - k_R (r - r_0 - s) - k_w (r' - s')

    with ``s_i = A_i sin(2 pi f_i t)`` and the gains ``k_R, k_w`` of the agents' attitudes. The thrust is directed as in
    `attitude.attitude_from_thrust`.

    Attributes:
        gains: Feedback gains; the payload's position gains apply to the centers of mass.
        yaw: Heading of each agent [rad, world], by group.
        offset: Centers of mass relative to the reference [m, world], by group.
        r: Mean joint positions [rad or m], by group.
        amplitude: Amplitudes of the joints [rad or m], by group.
        frequency: Frequencies of the joints [Hz], by group.
    """

    gains: tracking.Gains
    yaw: tuple[Float[Array, "agents"], ...]
    offset: tuple[Float[Array, "agents 3"], ...]
    r: tuple[Float[Array, "agents n_r"], ...]
    amplitude: tuple[Float[Array, "agents n_r"], ...]
    frequency: tuple[Float[Array, "agents n_r"], ...]

    def init(self) -> PartState:
        """Return the empty state."""
        return ()

    def compute(
        self,
        state: PartState,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
        forces: ContactForceCommand,
        f_hat: ResidualForces,
    ) -> tuple[tuple[TeamInputs, SaturationFlags], PartState]:
        """Compute the inputs of all agents, with thrust limited to the range of the rotors; see `AgentController`."""
        inputs, saturated = [], []
        compute = jax.vmap(self._inputs, in_axes=(0, None, 0, 0, None, 0, 0, 0, 0, 0, None))
        for i, (group, q, f) in enumerate(
            zip(context.team.agent_groups, context.estimate.agents, f_hat.agents, strict=True)
        ):
            given = (self.offset[i], self.r[i], self.yaw[i], self.amplitude[i], self.frequency[i])
            requested = compute(group, context.team.gravity, q, f, context.setpoint, *given, context.clock.t)
            limited, at_limit = realization.limit_thrust(group, requested)
            inputs.append(limited)
            saturated.append(at_limit)
        return (tuple(inputs), tuple(saturated)), state

    def _inputs(
        self,
        agent: AerialManipulator,
        gravity: Float[Array, "3"],
        q: AgentState,
        f_hat: GeneralizedForce,
        d: PayloadSetpoint,
        offset: Float[Array, "3"],
        r: Float[Array, "n_r"],
        yaw: Scalar,
        amplitude: Float[Array, "n_r"],
        frequency: Float[Array, "n_r"],
        t: Scalar,
    ) -> AgentInput:
        """Compute thrust and torques of one agent."""
        gains, w = self.gains, 2 * jnp.pi * frequency
        a = d.a - gains.K_p @ (q.x - d.p - offset) - gains.K_v @ (q.v - d.v)
        s, c = amplitude * jnp.sin(w * t), amplitude * jnp.cos(w * t)
        r_dd = -w * w * s - gains.agent_k_R * (q.r - r - s) - gains.agent_k_omega * (q.r_dot - w * c)
        f = agent.mass.sum() * (a - gravity) - f_hat.f_x
        R_d = attitude.attitude_from_thrust(f, yaw)
        omega_dot = realization.attitude_feedback(gains, q, R_d, jnp.zeros(3))
        g = aerial_manipulator.forward_kinematics(agent, q.r)
        p = aerial_manipulator.centroidal_model(agent, g)
        h, _ = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
        xi_dot, lam = jnp.concatenate([omega_dot, r_dd]), jnp.zeros((agent.tree.arms, 3))
        return realization.inputs_for_acceleration(p, h, q, a - gravity, xi_dot, lam, f_hat)
