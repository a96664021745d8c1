"""Low-pass filter of force labels minus predictions, with the rate of the difference.

See Also:
    colift.onboard.learning.residual_correction: observations, corrections and the protocol.
    docs/learning: equations and limits.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from colift.math.filters import initial_smoothing_factor, irregular_smoothing_factor, smoothing_factor
from colift.math.pytree import constant, pytree
from colift.models.parameters import Team
from colift.models.state import ControlClock, zero_residual
from colift.onboard.estimation.nav_filter import FilterBandwidths
from colift.onboard.learning.residual_correction import (
    Outputs,
    ResidualCorrection,
    ResidualObservation,
    Scalar,
    flatten,
    prediction_step,
    unflatten,
    without_explained_error,
    zero_correction,
)


@pytree
class LabelFilterState:
    """State of the label filter between two control periods.

    Attributes:
        update_index: Index of the model update whose model was in use.
        prediction: Prediction of the residual model [N, N m].
        sensor_lowpass: Prediction behind the first-order lag of the tip force sensors [N, N m].
        stage1: Label minus that prediction, behind the first stage of the label filter [N, N m].
        error: Label minus that prediction, behind the whole label filter [N, N m].
        previous: Error at the last label [N, N m].
        rate_ms: Mean square of the rate over the averaging time [(N/s)^2, (N m/s)^2].
        error_ms: Mean square of the error over the averaging time [N^2, (N m)^2].
        time_since_label: Time since the last label [s].
        initialized: 0 before the first control period, 1 afterwards.
    """

    update_index: Int[Array, ""]
    prediction: Outputs
    sensor_lowpass: Outputs
    stage1: Outputs
    error: Outputs
    previous: Outputs
    rate_ms: Outputs
    error_ms: Outputs
    time_since_label: Outputs
    initialized: Scalar


@pytree
class LabelFilter:
    """Label minus prediction behind the label filter, ``F y - F f_hat``, with its rate.

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
        none = jnp.zeros_like(flatten(zero_residual(team)))
        return LabelFilterState(
            update_index=jnp.zeros((), int),
            prediction=none,
            sensor_lowpass=none,
            stage1=none,
            error=none,
            previous=none,
            rate_ms=none,
            error_ms=none,
            time_since_label=jnp.ones_like(none),
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
        f, dt = flatten(observation.prediction), clock.dt
        y, valid, interval = (flatten(x) for x in (observation.label, observation.label_valid, observation.interval))
        step = prediction_step(observation, state.update_index, state.prediction, state.initialized)
        b = initial_smoothing_factor(state.initialized, smoothing_factor(self.filters.tip_force, dt))
        sensor_lowpass = _low_pass(state.sensor_lowpass + step, f, b)
        # The filter does not change in periods without a label.
        b = valid * irregular_smoothing_factor(smoothing_factor(self.filters.label, dt), interval / dt)
        b = initial_smoothing_factor(state.initialized, b)
        stage1 = _low_pass(state.stage1 - step, y - sensor_lowpass, b)
        error = _low_pass(state.error - step, stage1, b)
        previous = jnp.where(valid > 0, state.error, state.previous) - step
        error, stage1, previous = without_explained_error((error, stage1, previous), observation)
        elapsed = jnp.where(valid > 0, interval, state.time_since_label + dt)
        rate = state.initialized / elapsed * (error - previous)
        average = state.initialized * valid * -jnp.expm1(-interval / self.averaging_time)
        next_state = LabelFilterState(
            update_index=observation.update_index,
            prediction=f,
            sensor_lowpass=sensor_lowpass,
            stage1=stage1,
            error=error,
            previous=previous,
            rate_ms=_low_pass(state.rate_ms, rate * rate, average),
            error_ms=_low_pass(state.error_ms, error * error, average),
            time_since_label=elapsed,
            initialized=jnp.ones(()),
        )
        delay = self.filters.label_delay() + (1 - valid) * interval
        std = jnp.sqrt(jnp.minimum(delay * delay * next_state.rate_ms, 2 * next_state.error_ms))
        correction = dataclasses.replace(
            zero_correction(observation.label, clock.t),
            error=unflatten(error, observation.label),
            rate=unflatten(rate, observation.label),
            std=unflatten(std, observation.label),
            label=observation.label,
            prediction=observation.prediction,
            label_valid=valid.min(),
        )
        return correction, next_state


def _low_pass(state: Outputs, x: Outputs, b: Float[Array, "*shape"]) -> Outputs:
    """Advance a first-order low-pass filter with the smoothing factor b."""
    return state + b * (x - state)
