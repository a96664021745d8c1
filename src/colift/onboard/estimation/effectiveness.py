"""Estimate of the rotor effectiveness of each agent: thrust that its motion explains, over the commanded thrust.

The label of an agent along its thrust axis is the explained thrust minus the assumed one. With the assumed
effectiveness ``t``, the commanded thrust u, the label f before the label filter and the residual `f_hat` of the model,
the explained thrust is ``z = b_3 . (f - f_hat) + t u``. The state is a random walk with scalar measurements::

    theta+ = theta + q,    z = theta u + n

Its Kalman filter needs the ratio of the variances of q and n only. It is such that the gain `K u` is that of a low-pass
filter with corner frequency `bandwidth` in steady state at half the largest thrust.

A residual force along the thrust axis that the model does not predict has the same effect as a loss of effectiveness.
An agent therefore counts as healthy, with effectiveness 1, while the missing thrust is at most three standard
deviations of the residual.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, sec. 5.2.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.filters import smoothing_factor
from colift.math.pytree import constant, pytree
from colift.models.parameters import Team
from colift.models.state import AgentInput, ResidualForces, TeamInputs
from colift.onboard.estimation.state_estimator import StateEstimate

Scalar = Float[Array, ""]

DETECTION_FACTOR = 3.0
"""Missing thrust at which an agent counts as faulty, in standard deviations of its residual force."""
MIN_EFFECTIVENESS = 0.1
"""Smallest effectiveness that is compensated; below it the agent cannot carry itself."""


@pytree
class EffectivenessState:
    """State of the filter; agents in team order."""

    estimate: Float[Array, "agents"]  # theta
    covariance: Float[Array, "agents"]  # 1/N^2, variance of theta over that of n
    in_use: Float[Array, "agents"]  # effectiveness that the controller compensates; 1 for healthy agents


@pytree
class LabelChange:
    """Change of the agents' labels from the next control period on, by a change of the assumed rotor effectiveness.

    Attributes:
        axes: Thrust axes ``b_3`` of the agents, by group.
        thrust: Change of the label along this axis, by group [N].
    """

    axes: tuple[Float[Array, "_agents 3"], ...]
    thrust: tuple[Float[Array, "_agents"], ...]


@pytree
class EffectivenessFilter:
    """Kalman filter of the rotor effectiveness of each agent.

    Attributes:
        residual_std: Standard deviation of the residual force of an agent along its thrust [N].
        bandwidth: Corner frequency in steady state [Hz].
    """

    residual_std: Scalar
    bandwidth: Scalar = constant(10.0)

    def init(self, team: Team) -> EffectivenessState:
        """Return the state of healthy agents, without uncertainty."""
        ones = jnp.ones(sum(team.sizes))
        return EffectivenessState(estimate=ones, covariance=jnp.zeros_like(ones), in_use=ones)

    def update(
        self,
        state: EffectivenessState,
        team: Team,
        estimate: StateEstimate,
        f_hat: ResidualForces,
        command: TeamInputs,
        dt: Scalar,
    ) -> EffectivenessState:
        """Advance the filter by one control period.

        Args:
            state: State after the previous control period, whose `in_use` the labels assume.
            team: Nominal parameters.
            estimate: State estimate with labels; without labels or recent tip readings the state is held.
            f_hat: Residuals that the model predicts, without feedback correction.
            command: Inputs in effect since the previous control period, for effectiveness 1.
            dt: Control period [s].

        Returns:
            The next state.
        """
        if estimate.sample is None:
            return state
        u = jnp.concatenate([part.u for part in command])
        axes = jnp.concatenate([q.R[:, :, 2] for q in estimate.agents])
        labels = jnp.concatenate([label[:, :3] for label in estimate.sample.unfiltered[1]])
        unexplained = labels - jnp.concatenate([f.f_x for f in f_hat.agents])
        explained = (axes * unexplained).sum(-1) + state.in_use * u
        most = jnp.concatenate([group.thrust_max for group in team.agent_groups])
        w = smoothing_factor(self.bandwidth, dt)
        predicted = state.covariance + w * w / (1 - w) / (most / 2) ** 2
        gain = estimate.sample.valid * predicted * u / (1 + u * u * predicted)
        theta = state.estimate + gain * (explained - state.estimate * u)
        faulty = (1 - theta) * u > DETECTION_FACTOR * self.residual_std
        return EffectivenessState(
            estimate=theta,
            covariance=(1 - gain * u) * predicted,
            in_use=jnp.where(faulty, jnp.clip(theta, MIN_EFFECTIVENESS, 1.0), 1.0),
        )

    def label_change(
        self,
        before: EffectivenessState,
        after: EffectivenessState,
        team: Team,
        estimate: StateEstimate,
        command: TeamInputs,
    ) -> LabelChange:
        """Return the change of the agents' labels by a change of the effectiveness in use.

        Args:
            before: State that the present labels assume.
            after: State that the next labels assume.
            team: Nominal parameters.
            estimate: State estimate, with the thrust axes.
            command: Inputs in effect, for effectiveness 1.

        Returns:
            The differences of the assumed thrusts along the thrust axes.
        """
        thrust = tuple(
            (old - new) * part.u
            for old, new, part in zip(self._by_group(before, team), self._by_group(after, team), command, strict=True)
        )
        return LabelChange(axes=tuple(q.R[:, :, 2] for q in estimate.agents), thrust=thrust)

    def limited(self, state: EffectivenessState, team: Team) -> Team:
        """Return the team with the thrusts that the agents can still generate."""
        groups = tuple(
            dataclasses.replace(group, thrust_max=share * group.thrust_max)
            for group, share in zip(team.agent_groups, self._by_group(state, team), strict=True)
        )
        return dataclasses.replace(team, agent_groups=groups)

    def acting(self, state: EffectivenessState, team: Team, command: TeamInputs) -> TeamInputs:
        """Return the inputs that act on the agents for a command."""
        return tuple(
            AgentInput(u=share * part.u, tau=share[:, None] * part.tau, tau_r=part.tau_r)
            for part, share in zip(command, self._by_group(state, team), strict=True)
        )

    def compensated(self, state: EffectivenessState, team: Team, requested: TeamInputs) -> TeamInputs:
        """Return the command with which the requested inputs act, the inverse of `acting`."""
        return tuple(
            AgentInput(u=part.u / share, tau=part.tau / share[:, None], tau_r=part.tau_r)
            for part, share in zip(requested, self._by_group(state, team), strict=True)
        )

    def _by_group(self, state: EffectivenessState, team: Team) -> list[Float[Array, "agents"]]:
        """Return the effectiveness in use by group of agents."""
        ends = [sum(team.sizes[: k + 1]) for k in range(len(team.sizes))]
        return [state.in_use[end - size : end] for size, end in zip(team.sizes, ends, strict=True)]
