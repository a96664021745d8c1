"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.filters import smoothing_factor
from colift.math.pytree import pytree
from colift.models import inverse_dynamics
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State, add_payload_wrench
from colift.onboard.control import tracking
from colift.onboard.interfaces import ControlContext, ResidualPredictor
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]


# The paper's parts, and those of the rivals ---------------------------------------------------------------------------


@pytree
class LearnedResidual:
    """`f_hat`: the frozen oracles at the estimated state, the parametric part at the commanded acceleration."""

    def init(self, team: Team) -> Any:
        """Nothing is remembered."""
        return ()

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """Nothing is remembered."""
        return state

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """`f_hat_L = mean_L(q_L) + Y(q_L, a, alpha) theta`, `f_hat_j = mean_j(q_j)`."""
        q_hat = context.estimate
        return residual_model.predict(
            model, q_hat.payload, q_hat.agents, acceleration_cmd.a - context.team.gravity, acceleration_cmd.alpha
        )


@pytree
class DisturbanceObserver:
    """Another predictor with a wrench observer added: a low-pass of what the last command did not explain.

    `d = m_L (v_dot - a_g) - F_d`, `J w_dot + w x J w - tau_d`: residual and realization error in one.
    """

    base: ResidualPredictor
    bandwidth: Float[Array, "2"]  # Hz, of the force and of the moment

    def init(self, team: Team) -> Any:
        """What is observed, and the other's memory."""
        return jnp.zeros(6), self.base.init(team)

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """`d+ = d + b (d_now - d)`."""
        d, of_other = state
        q, a = context.estimate.payload, context.estimate.a_L
        W = inverse_dynamics.payload_inverse_dynamics(
            context.team.payload, a[:3] - context.team.gravity, a[3:], q.omega
        )
        left = jnp.concatenate([W.F - context.last_wrench.F, W.tau - context.last_wrench.tau])
        # before the first tick there was no command to explain anything
        d = d + context.initialized * jnp.repeat(smoothing_factor(self.bandwidth, context.clock.dt), 3) * (left - d)
        return d, self.base.update(of_other, model, context)

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """The other's prediction, and what is observed on the payload."""
        d, of_other = state
        return add_payload_wrench(self.base.predict(of_other, model, context, acceleration_cmd), d)


@pytree
class InnovationCorrection:
    """Another predictor as far as labels go along with it, and what they say beyond.

    `m + alpha (f_hat - m) + r + (w lead + s) r'`, s ahead of now: m the mean as late as labels, alpha how much of its
    changes they make as well, r' the rate of the label less alpha m, w how much of such rates came true before. Of an
    agent r' is the part that it may follow without hearing itself (`colift.onboard.control.label_feedback`).
    """

    base: ResidualPredictor
    compute: Scalar  # s, for the delay of labels
    rate_attenuation: tuple[Float[Array, "agents"], ...]  # 0 to 1, by group

    def init(self, team: Team) -> Any:
        """The other's memory."""
        return self.base.init(team)

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """The other's memory."""
        return self.base.update(state, model, context)

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """The sum of both. Raises ValueError where the pilot does not listen."""
        if context.innovation is None:
            raise ValueError("this predictor needs a pilot that listens: `LeaderFollower.listener`")
        f = self.base.predict(state, model, context, acceleration_cmd)
        innovation, s = context.innovation, context.clock.t - context.innovation.t

        def corrected(f: Array, m: Array, alpha: Array, r: Array, rate: Array, w: Array) -> Array:
            return m + alpha * (f - m) + r + (w * self.compute + s) * rate

        agents = zip(innovation.rate.agents, self.rate_attenuation, strict=True)
        heeded = tuple(jax.tree.map(functools.partial(jnp.multiply, c[:, None]), of) for of, c in agents)
        rate = dataclasses.replace(innovation.rate, agents=heeded)
        return jax.tree.map(
            corrected,
            f,
            innovation.filtered_prediction,
            innovation.model_gain,
            innovation.r,
            rate,
            innovation.extrapolation_gain,
        )


@pytree
class TrueResidual:
    """The residual as a function that is known exactly, which no team has: what a study measures learners by."""

    function: Callable[
        [State, tracking.AccelerationCommand, Scalar], ResidualForces
    ]  # of state, acceleration and time, s; a PyTree

    def init(self, team: Team) -> Any:
        """Nothing is remembered."""
        return ()

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """Nothing is remembered."""
        return state

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """The function at the estimated state and the commanded acceleration."""
        z = State(agents=context.estimate.agents, payload=context.estimate.payload)
        return self.function(z, acceleration_cmd, context.clock.t)
