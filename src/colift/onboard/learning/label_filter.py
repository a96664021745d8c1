"""Low-pass filter of force labels minus predictions, with the rate of the difference.

See Also:
    colift.onboard.learning.residual_correction: observations, corrections and the protocol.
    docs/learning: equations and limits.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from colift.math.filters import initial_smoothing_factor, irregular_smoothing_factor, smoothing_factor
from colift.math.pytree import constant, pytree
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, zero_residual
from colift.onboard.estimation.state_estimator import FilterBandwidths
from colift.onboard.learning.residual_correction import (
    ResidualCorrection,
    ResidualObservation,
    Scalar,
    zero_correction,
)


@pytree
class LabelFilterState:
    """State of the label filter between two control periods.

    Attributes:
        update_index: Index of the model update whose model was in use.
        prediction: Prediction of the residual model [N, N m].
        sensor_lowpass: Prediction behind the first-order lag of the tip force sensors.
        stage1: Prediction behind that lag and the first stage of the label filter.
        stage2: Prediction behind that lag and the whole label filter.
        error: Filtered label minus filtered prediction.
        previous: Error at the last label.
        rate_ms: Mean square of the rate over the averaging time [(N/s)^2, (N m/s)^2].
        error_ms: Mean square of the error over the averaging time [N^2, (N m)^2].
        time_since_label: Time since the last label [s].
        initialized: 0 before the first control period, 1 afterwards.
    """

    update_index: Int[Array, ""]
    prediction: ResidualForces
    sensor_lowpass: ResidualForces
    stage1: ResidualForces
    stage2: ResidualForces
    error: ResidualForces
    previous: ResidualForces
    rate_ms: ResidualForces
    error_ms: ResidualForces
    time_since_label: ResidualForces
    initialized: Scalar


@pytree
class LabelFilter:
    """Difference of filtered label and filtered prediction, ``F y - F f_hat``, with its rate.

    The correction is held constant without labels. Its error is the change of the model error over the delay ``D`` of
    the label filter and the age ``a`` of the last label. With mean squares over the averaging time, the variance is
    ``min((D + a)^2 <rate^2>, 2 <error^2>)``. Cases `label_feedback` and `gp_label_feedback` use this filter.

    Attributes:
        filters: Corner frequencies of the label filters.
        averaging_time: Time constant of the mean squares [s].
    """

    filters: FilterBandwidths
    averaging_time: Scalar = constant(1.0)

    def init(self, team: Team) -> LabelFilterState:
        """Return the state before the first control period.

        Args:
            team: Nominal parameters.
        """
        none = zero_residual(team)
        return LabelFilterState(
            update_index=jnp.zeros((), int),
            prediction=none,
            sensor_lowpass=none,
            stage1=none,
            stage2=none,
            error=none,
            previous=none,
            rate_ms=none,
            error_ms=none,
            time_since_label=jax.tree.map(jnp.ones_like, none),
            initialized=jnp.zeros(()),
        )

    def update(
        self, state: LabelFilterState, observation: ResidualObservation, clock: ControlClock
    ) -> tuple[ResidualCorrection, LabelFilterState]:
        """Advance the filter by one control period.

        Args:
            state: Filter state of the previous control period.
            observation: Label and prediction of this control period.
            clock: Time and period [s].

        Returns:
            The correction and the next filter state.
        """
        valid, interval, f, dt = observation.valid, observation.interval, observation.prediction, clock.dt
        replaced = (observation.update_index != state.update_index) & (state.initialized > 0)
        step = jax.tree.map(lambda new, old: jnp.where(replaced, new - old, 0.0), f, state.prediction)
        plus, minus = (lambda x: jax.tree.map(jnp.add, x, step)), (lambda x: jax.tree.map(jnp.subtract, x, step))
        b = initial_smoothing_factor(state.initialized, smoothing_factor(self.filters.tip_force, dt))
        sensor_lowpass = _low_pass(plus(state.sensor_lowpass), f, b)
        # The filter does not change in periods without a label.
        b = jax.tree.map(
            lambda ok, T: initial_smoothing_factor(
                state.initialized, ok * irregular_smoothing_factor(smoothing_factor(self.filters.label, dt), T / dt)
            ),
            valid,
            interval,
        )
        stage1 = _low_pass(plus(state.stage1), sensor_lowpass, b)
        stage2 = _low_pass(plus(state.stage2), stage1, b)
        error = jax.tree.map(jnp.subtract, observation.filtered_label, stage2)
        previous = jax.tree.map(
            lambda ok, now, before: jnp.where(ok > 0, now, before), valid, minus(state.error), minus(state.previous)
        )
        elapsed = jax.tree.map(lambda ok, T, since: jnp.where(ok > 0, T, since + dt), valid, interval, state.time_since_label)
        rate = jax.tree.map(lambda T, now, before: state.initialized / T * (now - before), elapsed, error, previous)
        average = jax.tree.map(lambda ok, T: state.initialized * ok * -jnp.expm1(-T / self.averaging_time), valid, interval)
        rate_ms, error_ms = (
            _low_pass(old, jax.tree.map(jnp.square, x), average)
            for old, x in ((state.rate_ms, rate), (state.error_ms, error))
        )
        next_state = LabelFilterState(
            update_index=observation.update_index,
            prediction=f,
            sensor_lowpass=sensor_lowpass,
            stage1=stage1,
            stage2=stage2,
            error=error,
            previous=previous,
            rate_ms=rate_ms,
            error_ms=error_ms,
            time_since_label=elapsed,
            initialized=jnp.ones(()),
        )
        delay = jax.tree.map(lambda ok, T: self.filters.label_delay() + (1 - ok) * T, valid, interval)
        std = jax.tree.map(
            lambda delay, rate, error: jnp.sqrt(jnp.minimum(delay * delay * rate, 2 * error)), delay, rate_ms, error_ms
        )
        correction = dataclasses.replace(
            zero_correction(observation.label, clock.t),
            error=error,
            rate=rate,
            std=std,
            label=observation.label,
            prediction=f,
            label_valid=jnp.min(valid.agents[0].f_x),
        )
        return correction, next_state


def _low_pass(state: ResidualForces, x: ResidualForces, b) -> ResidualForces:
    """Advance a first-order low-pass filter with the smoothing factor b."""
    if not isinstance(b, ResidualForces):
        return jax.tree.map(lambda old, new: old + b * (new - old), state, x)
    return jax.tree.map(lambda old, new, b: old + b * (new - old), state, x, b)
