"""Predictors of the residual forces that the controller compensates.

A predictor implements `colift.onboard.interfaces.ResidualPredictor`. The cases of a study differ mainly in their
predictor: the residual model alone, a disturbance observer, the correction by current labels, or the true residual.

See Also:
    colift.onboard.learning.residual_model: the predictions of the residual model.
    colift.onboard.learning.residual_correction: estimators of the model error.
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
from colift.math.pytree import constant, pytree
from colift.models import inverse_dynamics
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State, add_payload_wrench
from colift.onboard.control import tracking
from colift.onboard.interfaces import ControlContext, ResidualPredictor
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]
DEFAULT_LEAD_TIME = 0.02
"""Default lead time of a correction by labels [s], about half the delay of labels that are filtered at 8 Hz."""


@pytree
class LearnedResidual:
    """Prediction ``f_hat`` of the residual model at the estimated state.

    The inertial part is evaluated at the commanded acceleration, because a measured acceleration would close an
    algebraic loop.

    Example:
        ::

            predictor = LearnedResidual()
            f_hat = predictor.predict(predictor.init(team), model, context, acceleration_cmd)
    """

    def init(self, team: Team) -> Any:
        """Return an empty state."""
        return ()

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """Return the state without change."""
        return state

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Return ``f_hat_L = mean_L(q_L) + Y(q_L, a, alpha) theta`` and ``f_hat_j = mean_j(q_j)``."""
        q_hat = context.estimate
        return residual_model.predict(
            model, q_hat.payload, q_hat.agents, acceleration_cmd.a - context.team.gravity, acceleration_cmd.alpha
        )


@pytree
class DisturbanceObserver:
    """Base predictor plus a disturbance observer of the payload wrench.

    The observer is a low-pass filter of the wrench that the last command does not explain:
    ``d_F = m_L (v_dot - a_g) - F_d`` and ``d_tau = J w_dot + w x J w - tau_d``. It contains the residual and the
    wrench mismatch of the team.

    Attributes:
        base: Predictor to which the observed wrench is added.
        bandwidth: Corner frequencies of force and moment [Hz].

    References:
        Chen, Ballance, Gawthrop, O'Reilly, *A nonlinear disturbance observer for robotic manipulators*, 2000.
    """

    base: ResidualPredictor
    bandwidth: Float[Array, "2"]

    def init(self, team: Team) -> Any:
        """Return a zero wrench and the initial state of the base predictor."""
        return jnp.zeros(6), self.base.init(team)

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """Advance the low-pass filter ``d+ = d + b (d_now - d)`` by one control period."""
        d, base_state = state
        q, a = context.estimate.payload, context.estimate.a_L
        W = inverse_dynamics.payload_inverse_dynamics(
            context.team.payload, a[:3] - context.team.gravity, a[3:], q.omega
        )
        unexplained = jnp.concatenate([W.F - context.last_wrench.F, W.tau - context.last_wrench.tau])
        # The first control period has no previous command, so the observer starts with the second.
        d = d + context.initialized * jnp.repeat(smoothing_factor(self.bandwidth, context.clock.dt), 3) * (
            unexplained - d
        )
        return d, self.base.update(base_state, model, context)

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Return the base prediction plus the observed payload wrench."""
        d, base_state = state
        return add_payload_wrench(self.base.predict(base_state, model, context, acceleration_cmd), d)


@pytree
class CorrectedResidual:
    """Base predictor corrected by the estimated error of the residual model.

    A time ``h`` after the control period of the correction, the prediction is ``f = f_hat + d + h a v`` with the
    correction ``d`` and its rate ``v`` (docs/learning, Eq. 5). ``h`` is the lead time plus the preview time.

    Attributes:
        base: Predictor that is corrected.
        lead_time: Lead time that compensates the delay of the correction [s].
        rate_attenuation: Share ``a`` of the rate that is used for each agent, by group, in [0, 1]. It limits the label
            loop gain (`colift.onboard.control.label_feedback`).
        payload_lead_time: Further lead time for the payload, whose labels have a longer delay without gyroscope and
            accelerometer [s]; None: the same lead time for all bodies.
    """

    base: ResidualPredictor
    lead_time: Scalar = constant(DEFAULT_LEAD_TIME)
    rate_attenuation: tuple[Float[Array, "agents"], ...]
    payload_lead_time: Scalar | None = None

    def init(self, team: Team) -> Any:
        """Return the initial state of the base predictor."""
        return self.base.init(team)

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """Return the next state of the base predictor."""
        return self.base.update(state, model, context)

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Return the corrected prediction.

        Args:
            state: State of the base predictor.
            model: Residual model in use.
            context: Control context with a correction.
            acceleration_cmd: Commanded acceleration of the payload.

        Returns:
            The corrected prediction [N, N m].

        Raises:
            ValueError: If the control context contains no correction.
        """
        if context.correction is None:
            raise ValueError(
                "the control context contains no correction; "
                "this predictor requires `LeaderFollowerController.residual_corrector`"
            )
        f = self.base.predict(state, model, context, acceleration_cmd)
        correction = context.correction
        h = self.lead_time + context.clock.t - correction.t
        agents = zip(correction.rate.agents, self.rate_attenuation, strict=True)
        attenuated = tuple(jax.tree.map(functools.partial(jnp.multiply, a[:, None]), force) for force, a in agents)
        rate = dataclasses.replace(correction.rate, agents=attenuated)
        corrected = jax.tree.map(lambda f, d, v: f + d + h * v, f, correction.error, rate)
        if self.payload_lead_time is None:
            return corrected
        W_dot = rate.payload
        return add_payload_wrench(corrected, self.payload_lead_time * jnp.concatenate([W_dot.F, W_dot.tau]))


@pytree
class TrueResidual:
    """Exact residual function at the estimated state: a reference for learning that is not realizable.

    Attributes:
        function: PyTree that returns the residual for state, commanded acceleration and time [s].
    """

    function: Callable[[State, tracking.AccelerationCommand, Scalar], ResidualForces]

    def init(self, team: Team) -> Any:
        """Return an empty state."""
        return ()

    def update(self, state: Any, model: residual_model.ResidualModel, context: ControlContext) -> Any:
        """Return the state without change."""
        return state

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Return the residual at the estimated state and the commanded acceleration."""
        z = State(agents=context.estimate.agents, payload=context.estimate.payload)
        return self.function(z, acceleration_cmd, context.clock.t)
