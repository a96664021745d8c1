"""Feedback correction of a learned residual model from delayed force labels.

The residual model is constant between updates and cannot follow changes of the environment. This module compares each
filtered label with the model prediction behind the same filter, ``F f_hat``. The innovation ``r = F y - F f_hat`` is
added to the prediction. When labels are no longer available, the correction decays to its mean over the last averaging
time.

See Also:
    colift.onboard.learning.residual_predictors.InnovationCorrection: the predictor that uses the innovation.
    docs/learning: equations, tuning and limits.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from colift.math.filters import initial_smoothing_factor, irregular_smoothing_factor, smoothing_factor
from colift.math.pytree import constant, pytree
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, Wrench, split_agent_force, zero_residual
from colift.onboard.estimation.state_estimator import FilterBandwidths, StateEstimate, TrainingSample
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]
T = TypeVar("T")


@pytree
class Innovation:
    """Innovation of one control period and the gains with which it is used.

    Every quantity of type `ResidualForces` has one value per output.

    Attributes:
        t: Time of the control period [s].
        r: Innovation, label minus filtered prediction [N, N m].
        filtered_prediction: Prediction ``m`` of the residual model behind the label filter [N, N m].
        model_gain: Gain ``alpha`` of model changes, in [0, 1]; tends to 1 when labels are unavailable.
        rate: Rate of the label minus ``alpha m`` [N/s, N m/s].
        correction_weight: Weight of the correction: 1 while labels are available, decays to 0 afterwards.
        extrapolation_gain: Gain ``w`` of the extrapolation over the label delay, in [0, 1].
        labels_available: 1 while labels are available, 0 otherwise.
        delay_error_rms: Root mean square of the error due to label delay and label age, over the averaging time.
        correction_error_rms: Root mean square of the innovation minus the correction in use, over the averaging time.
    """

    t: Scalar
    r: ResidualForces
    filtered_prediction: ResidualForces
    model_gain: ResidualForces
    rate: ResidualForces
    correction_weight: Scalar
    extrapolation_gain: ResidualForces
    labels_available: Scalar
    delay_error_rms: ResidualForces
    correction_error_rms: ResidualForces


def zero_innovation(team: Team, t: Scalar) -> Innovation:
    """Return the innovation before the first label: no correction, all gains 1.

    Args:
        team: Nominal parameters.
        t: Time [s].

    Returns:
        The innovation.
    """
    none = zero_residual(team)
    whole = jax.tree.map(jnp.ones_like, none)
    return Innovation(
        t=t,
        r=none,
        filtered_prediction=none,
        model_gain=whole,
        rate=none,
        correction_weight=jnp.ones(()),
        extrapolation_gain=whole,
        labels_available=jnp.ones(()),
        delay_error_rms=none,
        correction_error_rms=none,
    )


@pytree
class ComovementStats:
    """Moments of the changes of label and filtered prediction, for the model gain.

    A change is the difference of a signal to its value behind one more low-pass filter.

    Attributes:
        label_lowpass: Low-pass filtered label [N, N m].
        prediction_lowpass: Low-pass filtered prediction [N, N m].
        cross_moment: Running mean of label change times prediction change [(N)^2, (N m)^2].
        second_moment: Running mean of the squared prediction change [(N)^2, (N m)^2].
    """

    label_lowpass: ResidualForces
    prediction_lowpass: ResidualForces
    cross_moment: ResidualForces
    second_moment: ResidualForces


@pytree
class RateForecast:
    """Comparison of predicted and actual label changes over one label delay, for the extrapolation gain.

    Attributes:
        elapsed: Time since the last forecast [s].
        evidence: Confidence in the moments, from 0 at first to 1 after some ten averaging times with labels.
        model_gain: Model gain ``alpha`` at the time of the forecast.
        baseline: Label minus ``alpha`` times filtered prediction at the time of the forecast [N, N m].
        rate: Rate of the baseline at the time of the forecast [N/s, N m/s].
        cross_moment: Mean of actual times predicted change over ten averaging times [(N)^2, (N m)^2].
        second_moment: Mean of the squared predicted change over ten averaging times [(N)^2, (N m)^2].
    """

    elapsed: Scalar
    evidence: Scalar
    model_gain: ResidualForces
    baseline: ResidualForces
    rate: ResidualForces
    cross_moment: ResidualForces
    second_moment: ResidualForces


@pytree
class InnovationState:
    """State of the innovation filter between two control periods.

    Attributes:
        update_index: Index of the model update whose model was in use.
        prediction: Prediction of the residual model [N, N m].
        sensor_lowpass: Prediction behind the first-order lag of the tip force sensors.
        label_lowpass1: Prediction behind that lag and the first stage of the label filter.
        label_lowpass2: Prediction behind that lag and the whole label filter.
        r: Innovation [N, N m].
        previous: Innovation and filtered prediction before the last label.
        comovement: Moments for the model gain.
        rate_forecast: Forecast and moments for the extrapolation gain.
        time_since_label: Time since the last label [s].
        running_mean: Mean of the innovation over the averaging time, restarted after a model update [N, N m].
        longest_gap: Longest recent time between labels [s]; decays over ten averaging times.
        mean_label_age: Mean age of the last label while labels are available [s].
        delay_error_ms: Mean square of the delay error [(N)^2, (N m)^2].
        window_mean: Mean of the innovation over the averaging time [N, N m].
        window_mean_square: Mean square of the innovation over the averaging time [(N)^2, (N m)^2].
        correction_weight: Weight of the correction.
        initialized: 0 before the first control period, 1 afterwards.
    """

    update_index: Int[Array, ""]
    prediction: ResidualForces
    sensor_lowpass: ResidualForces
    label_lowpass1: ResidualForces
    label_lowpass2: ResidualForces
    r: ResidualForces
    previous: tuple[ResidualForces, ResidualForces]
    comovement: ComovementStats
    rate_forecast: RateForecast
    time_since_label: Scalar
    running_mean: ResidualForces
    longest_gap: Scalar
    mean_label_age: Scalar
    delay_error_ms: ResidualForces
    window_mean: ResidualForces
    window_mean_square: ResidualForces
    correction_weight: Scalar
    initialized: Scalar


@dataclasses.dataclass(frozen=True)
class _LabelStatus:
    """Availability of labels in one control period."""

    has_label: Scalar  # 1 if this period has a label
    age: Scalar  # s, of the last label
    gap: Scalar  # s, without labels before the label of this period
    longest_gap: Scalar  # s
    available: Scalar  # 1 while labels are available
    correction_weight: Scalar


@pytree
class InnovationFilter:
    """Estimate the innovation, its rate and the gain of the model from labels.

    Provides the terms of ``f = m + alpha (f_hat - m) + r + (w T_lead + s) dg/dt`` (docs/learning, Eq. 3), with the
    filtered prediction ``m = F f_hat`` and ``g = F y - alpha m``.

    - *Model gain.* ``alpha = (v + n <dy dm>) / (v + n <dm^2>)``, limited to [0, 1], is the share of model changes
      ``dm`` that label changes ``dy`` confirm (Eq. 4). ``v`` is the variance of labels, ``n`` the variance ratio.
    - *Extrapolation gain.* Once per label delay ``D``, the predicted change ``d = D dg/dt`` is compared with the actual
      change ``Dg``. With the autocorrelation ``h = exp(-2 pi f_y D)`` of filtered white noise and the coherence ``c``,
      ``w = n (<Dg d> - h <d^2>) / ((1 - h) c (v + n <d^2>))``, limited to [0, 1] (Eq. 5).
    - *Loss of labels.* Labels count as unavailable after the hold time, or after twice the longest recent gap. ``r``
      then decays to ``m_r^3 / (m_r^2 + 4 v)`` with its running mean ``m_r``, which rejects a mean that noise explains.
    - *Bumpless transfer.* When the model is replaced, ``r`` is offset by the difference of the two predictions, and the
      running mean starts again from zero.

    Attributes:
        filters: Corner frequencies of the label filters.
        hold_time: Time without labels after which they count as unavailable [s]. The default is about five delays of
            labels that are filtered at 8 Hz; shorter gaps are bridged without a decay.
        decay_time: Time constant of the decay when labels are unavailable [s]; infinite to hold the correction.
        averaging_time: Time constant of all running moments [s]; those of ``w`` use ten times this value. The default
            is about ten label delays, so that moments average the noise, and a tenth of a lap, so that they follow the
            residual along the path.
        variance_ratio: Ratio ``n``. Model changes whose variance is below ``v / n`` leave ``alpha`` near 1; label rates
            with predicted changes below this variance are not extrapolated.
        coherence: Confirmed share of the squared rate at which ``w`` reaches 1; in [0, 1].

    Example:
        ::

            innovation_filter = InnovationFilter(filters=filters, hold_time=jnp.array(0.1))
            state = innovation_filter.init(team)
            state, innovation = innovation_filter.update(state, team, model, estimate, clock)

    References:
        Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, ch. 5.
    """

    filters: FilterBandwidths
    hold_time: Scalar = constant(0.2)
    averaging_time: Scalar = constant(0.5)
    decay_time: Scalar = constant(0.3)
    variance_ratio: Scalar = constant(10.0)
    coherence: Scalar = constant(0.2)

    def init(self, team: Team) -> InnovationState:
        """Return the state before the first control period.

        Args:
            team: Nominal parameters.

        Returns:
            The state before the first label.
        """
        none = zero_residual(team)
        return InnovationState(
            update_index=jnp.zeros((), int),
            prediction=none,
            sensor_lowpass=none,
            label_lowpass1=none,
            label_lowpass2=none,
            r=none,
            previous=(none, none),
            comovement=ComovementStats(
                label_lowpass=none, prediction_lowpass=none, cross_moment=none, second_moment=none
            ),
            rate_forecast=RateForecast(
                elapsed=jnp.zeros(()),
                evidence=jnp.zeros(()),
                model_gain=none,
                baseline=none,
                rate=none,
                cross_moment=none,
                second_moment=none,
            ),
            time_since_label=jnp.ones(()),
            running_mean=none,
            longest_gap=jnp.zeros(()),
            mean_label_age=jnp.zeros(()),
            delay_error_ms=none,
            window_mean=none,
            window_mean_square=none,
            correction_weight=jnp.ones(()),
            initialized=jnp.zeros(()),
        )

    def update(
        self,
        state: InnovationState,
        team: Team,
        model: residual_model.ResidualModel,
        estimate: StateEstimate,
        clock: ControlClock,
    ) -> tuple[InnovationState, Innovation]:
        """Advance the filter by one control period.

        Args:
            state: Filter state of the previous control period.
            team: Nominal parameters.
            model: Residual model in use during this control period.
            estimate: State estimate with the labeled sample of this control period.
            clock: Time and period [s].

        Returns:
            The next filter state and the innovation to be used by the predictor.

        Raises:
            ValueError: If the estimator provides no labels.
        """
        sample, dt = estimate.sample, clock.dt
        if sample is None:
            raise ValueError("the state estimator provides no labels; the innovation filter requires labels")
        f = residual_model.predict(
            model, estimate.payload, estimate.agents, estimate.a_L[:3] - team.gravity, estimate.a_L[3:]
        )
        state = _transfer_to_model(state, f, model.update_index)
        next_state, b = self._filter_prediction(state, f, model.update_index, sample, dt)
        m, y = next_state.label_lowpass2, _label(sample)
        r = jax.tree.map(jnp.subtract, y, m)
        # Means and moments do not change in periods without a label.
        b_average = sample.valid * -jnp.expm1(-sample.sample_interval / self.averaging_time)
        b_mean = initial_smoothing_factor(state.initialized, b_average)
        running_mean = _low_pass(state.running_mean, r, b_mean)
        comovement = _update_comovement(state.comovement, y, m, b, state.initialized * b_average)
        labels = self._availability(state, sample, dt)
        v, weight = label_noise_variance(model), labels.correction_weight
        alpha = self._model_gain(comovement, v, weight)
        previous, elapsed, rate = _label_rate(state, sample, r, m, alpha, weight, dt)
        delay = self.filters.label_delay()
        forecast = self._update_forecast(state, y, m, alpha, rate, labels, dt)
        w = self._extrapolation_gain(forecast, v)
        persistent = jax.tree.map(lambda m, v: m * m * m / (m * m + 4 * v), running_mean, v)
        correction = jax.tree.map(lambda r, r_inf: r_inf + weight * (r - r_inf), r, persistent)
        next_state = dataclasses.replace(
            next_state,
            r=r,
            previous=previous,
            comovement=comovement,
            rate_forecast=forecast,
            time_since_label=elapsed,
            running_mean=running_mean,
            longest_gap=labels.longest_gap,
            correction_weight=weight,
            initialized=jnp.ones(()),
        )
        next_state = self._update_errors(next_state, labels, rate, delay, b_average, b_mean, dt)
        delay_error_rms, correction_error_rms = _error_rms(next_state, correction, delay)
        innovation = Innovation(
            t=clock.t,
            r=correction,
            filtered_prediction=m,
            model_gain=alpha,
            rate=rate,
            correction_weight=weight,
            extrapolation_gain=w,
            labels_available=labels.available,
            delay_error_rms=delay_error_rms,
            correction_error_rms=correction_error_rms,
        )
        return next_state, innovation

    def _filter_prediction(
        self,
        state: InnovationState,
        f: ResidualForces,
        update_index: Int[Array, ""],
        sample: TrainingSample,
        dt: Scalar,
    ) -> tuple[InnovationState, Scalar]:
        """Advance the label filter of the prediction; return the state and the smoothing factor of the label filter."""
        sensor_lowpass = _low_pass(
            state.sensor_lowpass,
            f,
            initial_smoothing_factor(state.initialized, smoothing_factor(self.filters.tip_force, dt)),
        )
        # The filter does not change in periods without a label.
        b = sample.valid * irregular_smoothing_factor(
            smoothing_factor(self.filters.label, dt), sample.sample_interval / dt
        )
        b = initial_smoothing_factor(state.initialized, b)
        stage1 = _low_pass(state.label_lowpass1, sensor_lowpass, b)
        stage2 = _low_pass(state.label_lowpass2, stage1, b)
        next_state = dataclasses.replace(
            state,
            update_index=update_index,
            prediction=f,
            sensor_lowpass=sensor_lowpass,
            label_lowpass1=stage1,
            label_lowpass2=stage2,
        )
        return next_state, b

    def _availability(self, state: InnovationState, sample: TrainingSample, dt: Scalar) -> _LabelStatus:
        """Decide whether labels are available and advance the correction weight."""
        has_label, interval = sample.valid, sample.sample_interval
        age, gap = (1 - has_label) * interval, has_label * (interval - dt)
        longest_gap = jnp.maximum(state.longest_gap * jnp.exp(-dt / (10 * self.averaging_time)), gap)
        available = (age <= jnp.maximum(self.hold_time, 2 * longest_gap) + 1e-9).astype(float)
        weight = state.correction_weight + -jnp.expm1(-dt / self.decay_time) * (available - state.correction_weight)
        return _LabelStatus(
            has_label=has_label,
            age=age,
            gap=gap,
            longest_gap=longest_gap,
            available=available,
            correction_weight=weight,
        )

    def _update_errors(
        self,
        state: InnovationState,
        labels: _LabelStatus,
        rate: ResidualForces,
        delay: Scalar,
        b_average: Scalar,
        b_mean: Scalar,
        dt: Scalar,
    ) -> InnovationState:
        """Advance the running moments of delay error and innovation, and the mean label age."""
        return dataclasses.replace(
            state,
            delay_error_ms=_low_pass(
                state.delay_error_ms, jax.tree.map(lambda x: (delay * x) * (delay * x), rate), b_average
            ),
            window_mean=_low_pass(state.window_mean, state.r, b_mean),
            window_mean_square=_low_pass(state.window_mean_square, jax.tree.map(jnp.square, state.r), b_mean),
            mean_label_age=state.mean_label_age
            + labels.available * -jnp.expm1(-dt / (10 * self.averaging_time)) * (labels.age - state.mean_label_age),
        )

    def _update_forecast(
        self,
        state: InnovationState,
        y: ResidualForces,
        m: ResidualForces,
        alpha: ResidualForces,
        rate: ResidualForces,
        labels: _LabelStatus,
        dt: Scalar,
    ) -> RateForecast:
        """Compare the forecast with the label once it is one label delay old, and start a new one.

        Returns:
            The forecast; one from before an interruption of labels does not enter the moments.
        """
        forecast = state.rate_forecast
        uninterrupted = state.initialized * (
            labels.gap <= jnp.maximum(self.hold_time, 2 * state.longest_gap) + 1e-9
        ).astype(float)
        age = forecast.elapsed + dt
        due = labels.has_label * (age > self.filters.label_delay() - 1e-9).astype(float)
        b = due * uninterrupted * -jnp.expm1(-age / (10 * self.averaging_time))
        remainder = functools.partial(jax.tree.map, lambda y, m, a: y - a * m, y, m)
        actual = jax.tree.map(jnp.subtract, remainder(forecast.model_gain), forecast.baseline)
        predicted = jax.tree.map(lambda r: age * r, forecast.rate)
        alpha, baseline, rate = _where(
            due, (alpha, remainder(alpha), rate), (forecast.model_gain, forecast.baseline, forecast.rate)
        )
        return RateForecast(
            elapsed=(1 - due) * age,
            evidence=forecast.evidence + b * (1 - forecast.evidence),
            model_gain=alpha,
            baseline=baseline,
            rate=rate,
            cross_moment=_low_pass(forecast.cross_moment, jax.tree.map(jnp.multiply, actual, predicted), b),
            second_moment=_low_pass(forecast.second_moment, jax.tree.map(jnp.square, predicted), b),
        )

    def _model_gain(self, comovement: ComovementStats, v: ResidualForces, weight: Scalar) -> ResidualForces:
        """Return ``alpha`` for the label variance v (docs/learning, Eq. 4); 1 for a correction weight of 0."""

        def gain(c: Array, s: Array, v: Array) -> Array:
            alpha = jnp.clip((v + self.variance_ratio * c) / (v + self.variance_ratio * s), 0.0, 1.0)
            return 1 + weight * (alpha - 1)

        return jax.tree.map(gain, comovement.cross_moment, comovement.second_moment, v)

    def _extrapolation_gain(self, forecast: RateForecast, v: ResidualForces) -> ResidualForces:
        """Return ``w`` for the label variance v (docs/learning, Eq. 5)."""

        def gain(c: Array, s: Array, v: Array) -> Array:
            h = jnp.exp(-2 * jnp.pi * self.filters.label * self.filters.label_delay())
            confirmed = jnp.maximum(0.0, forecast.evidence * self.variance_ratio * (c - h * s)) / (1 - h)
            required = self.coherence * (v + self.variance_ratio * s)
            return (jnp.minimum(confirmed, required) + 1e-30) / (required + 1e-30)  # 1 if the coherence is 0

        return jax.tree.map(gain, forecast.cross_moment, forecast.second_moment, v)


def _label_rate(
    state: InnovationState,
    sample: TrainingSample,
    r: ResidualForces,
    m: ResidualForces,
    alpha: ResidualForces,
    weight: Scalar,
    dt: Scalar,
) -> tuple[tuple[ResidualForces, ResidualForces], Scalar, ResidualForces]:
    """Return the previous innovation and prediction, the time since then, and the rate (docs/learning, Eq. 2)."""
    previous = _where(sample.valid, (state.r, state.label_lowpass2), state.previous)
    elapsed = jnp.where(sample.valid > 0, sample.sample_interval, state.time_since_label + dt)
    scale = state.initialized * weight / elapsed
    rate = jax.tree.map(lambda r, m, r_0, m_0, a: scale * (r - r_0 + (1 - a) * (m - m_0)), r, m, *previous, alpha)
    return previous, elapsed, rate


def _error_rms(
    state: InnovationState, correction: ResidualForces, delay: Scalar
) -> tuple[ResidualForces, ResidualForces]:
    """Return the root mean squares of the delay error, and of the innovation minus the correction in use."""
    age_factor = 1 + state.mean_label_age / delay
    correction_error = jax.tree.map(
        lambda q, m, x: jnp.sqrt(jnp.maximum(q - 2 * x * m + x * x, 0.0)),
        state.window_mean_square,
        state.window_mean,
        correction,
    )
    return jax.tree.map(lambda ms: age_factor * jnp.sqrt(ms), state.delay_error_ms), correction_error


def _transfer_to_model(state: InnovationState, f: ResidualForces, update_index: Int[Array, ""]) -> InnovationState:
    """Offset the state by the step of the prediction when the model is replaced (bumpless transfer).

    Returns:
        The state of a filter whose model has always been the new one, up to a constant.
    """
    step = jax.tree.map(
        lambda new, old: jnp.where((update_index != state.update_index) & (state.initialized > 0), new - old, 0.0),
        f,
        state.prediction,
    )
    plus, minus = (lambda x: jax.tree.map(jnp.add, x, step)), (lambda x: jax.tree.map(jnp.subtract, x, step))
    scaled = jax.tree.map(jnp.multiply, state.rate_forecast.model_gain, step)
    return dataclasses.replace(
        state,
        sensor_lowpass=plus(state.sensor_lowpass),
        label_lowpass1=plus(state.label_lowpass1),
        label_lowpass2=plus(state.label_lowpass2),
        r=minus(state.r),
        previous=(minus(state.previous[0]), plus(state.previous[1])),
        comovement=dataclasses.replace(state.comovement, prediction_lowpass=plus(state.comovement.prediction_lowpass)),
        rate_forecast=dataclasses.replace(
            state.rate_forecast, baseline=jax.tree.map(jnp.subtract, state.rate_forecast.baseline, scaled)
        ),
        running_mean=jax.tree.map(lambda d, mean: jnp.where(d != 0, 0.0, mean), step, state.running_mean),
    )


def _update_comovement(
    stats: ComovementStats, y: ResidualForces, m: ResidualForces, b: Scalar, b_average: Scalar
) -> ComovementStats:
    """Update the moments with a label and a filtered prediction, with the smoothing factors of filter and means."""
    label, prediction = _low_pass(stats.label_lowpass, y, b), _low_pass(stats.prediction_lowpass, m, b)
    dy, dm = (jax.tree.map(jnp.subtract, *pair) for pair in ((y, label), (m, prediction)))
    return ComovementStats(
        label_lowpass=label,
        prediction_lowpass=prediction,
        cross_moment=_low_pass(stats.cross_moment, jax.tree.map(jnp.multiply, dy, dm), b_average),
        second_moment=_low_pass(stats.second_moment, jax.tree.map(jnp.multiply, dm, dm), b_average),
    )


def _where(condition: Scalar, new: T, old: T) -> T:
    """Return the new PyTree if the condition is positive, otherwise the old one."""
    return jax.tree.map(lambda new, old: jnp.where(condition > 0, new, old), new, old)


def _low_pass(state: ResidualForces, x: ResidualForces, b: Scalar) -> ResidualForces:
    """Advance a first-order low-pass filter with the smoothing factor b."""
    return jax.tree.map(lambda old, new: old + b * (new - old), state, x)


def _label(sample: TrainingSample) -> ResidualForces:
    """Return the labels of payload and agents."""
    return _residual_forces(sample.payload[1], tuple(y for _, y in sample.agents))


def label_noise_variance(model: residual_model.ResidualModel) -> ResidualForces:
    """Return the noise variance of labels in a residual model.

    Args:
        model: Residual model.

    Returns:
        Variance of each output [(N)^2, (N m)^2].
    """
    return _residual_forces(model.payload.hyper.noise_variance, tuple(g.hyper.noise_variance for g in model.agents))


def _residual_forces(
    payload: Float[Array, "6"], agents: tuple[Float[Array, "_agents _outputs"], ...]
) -> ResidualForces:
    """Return residual forces from the output vectors of payload and agents."""
    return ResidualForces(
        payload=Wrench(F=payload[:3], tau=payload[3:]),
        agents=tuple(split_agent_force(y) for y in agents),
    )
