"""What labels say beyond what is learned: the innovation, label less mean, and what is left of it when labels stop.

A memory, as a frozen Gaussian process is one, fails where the world has changed, and its deviation does not see that.
The innovation does: `r = F y - F f_hat`, F the filter that labels go through, so that both are equally late.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from colift.math.filters import initial_smoothing_factor, irregular_smoothing_factor, smoothing_factor
from colift.math.pytree import pytree
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, Wrench, split_agent_force, zero_residual
from colift.onboard.estimation.state_estimator import FilterBandwidths, StateEstimate, TrainingSample
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]
T = TypeVar("T")


@pytree
class Innovation:
    """What labels say beyond the oracle, as it is to be used."""

    t: Scalar  # s, when it was so
    r: ResidualForces  # N and N m
    filtered_prediction: ResidualForces  # N and N m, the oracle's, as late as labels: r + mean is the label
    model_gain: ResidualForces  # alpha, 0 to 1: how much of what the mean changes labels change as well; 1 where they have stopped
    rate: ResidualForces  # N/s and N m/s, of the label less alpha times the mean
    correction_weight: (
        Scalar  # 1 while labels come, if now and then; falls to 0 when they stop, and r to its running mean
    )
    extrapolation_gain: (
        ResidualForces  # w, 0 to 1: how much of the rate is to be trusted for the labels' delay, as it came true before
    )
    labels_available: Scalar  # 1 while labels come, 0 once they have stopped
    delay_error_rms: (
        ResidualForces  # N and N m, by how much labels are late, and again as old as they are: RMS over their last span
    )
    correction_error_rms: (
        ResidualForces  # N and N m, what labels said of late beyond mean and r: RMS over their last span
    )


def zero_innovation(team: Team, t: Scalar) -> Innovation:
    """Before any label."""
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
    """How labels and the late mean move against themselves behind one filter more, and how alike they do."""

    label_lowpass: ResidualForces  # behind it
    prediction_lowpass: ResidualForces
    cross_moment: ResidualForces  # (N, N m)^2, means over the last span, of both and of the mean's own
    second_moment: ResidualForces


@pytree
class RateForecast:
    """What was to come by the rate of labels, one delay of theirs ago, and how far such things came true."""

    elapsed: Scalar  # s, since then
    evidence: Scalar  # 0 at first, 1 once labels have come for ten spans and more
    model_gain: ResidualForces  # alpha, as it was then
    baseline: ResidualForces  # the label less alpha times the mean
    rate: ResidualForces  # of that
    cross_moment: (
        ResidualForces  # (N, N m)^2, means over ten spans of what came times what was foretold, and of that alone
    )
    second_moment: ResidualForces


@pytree
class InnovationState:
    """What a listener keeps between ticks."""

    update_index: Int[Array, ""]  # of the oracle
    prediction: ResidualForces  # the mean
    sensor_lowpass: ResidualForces  # behind a copy of the tips' bandwidth
    label_lowpass1: ResidualForces  # and behind the labels' filter
    label_lowpass2: ResidualForces
    r: ResidualForces
    previous: tuple[ResidualForces, ResidualForces]  # r and the late mean before the last label
    comovement: ComovementStats
    rate_forecast: RateForecast
    time_since_label: Scalar  # s since then
    running_mean: ResidualForces
    longest_gap: Scalar  # s, the longest silence that a label ended, forgotten within ten spans
    mean_label_age: Scalar  # s, of the last label while they come: mean over ten spans
    delay_error_ms: ResidualForces  # N^2 and (N m)^2
    window_mean: ResidualForces  # N and N m, mean of r over the last span of labels
    window_mean_square: ResidualForces  # N^2 and (N m)^2, of its square
    correction_weight: Scalar
    initialized: Scalar  # 0 before the first tick, 1 after


@pytree
class InnovationFilter:
    """Compares labels with the oracle, tick by tick.

    While labels come, `r` is label less mean, held from one label to the next. When there is none for `hold`, or for
    twice as long as silence has lasted lately, `r` falls within `fade` to what has changed for good: its mean m over
    the last `span`, as far as that is no noise, `m m^2 / (m^2 + 4 v)`, v the oracle's variance of labels. Where another
    oracle takes over, what it says more is taken from r at once, not only when the filter has seen it, and m begins
    anew, at nothing: what has changed for good is in the new oracle, and errors of the one before are not its own.

    A mean that was true at its places need not be true at this time. With d y, d f what label and late mean are off
    the same behind one filter more, `alpha = (1 + n <d y d f> / v) / (1 + n <d f d f> / v)`, within 0 and 1 and n the
    doubt, is how much of the mean's changes labels make as well; means over the last span.

    A rate may be noise. Each delay of labels, while they come, it is held against what they did since: with g the
    label less alpha times the mean, D g what it has become more and d its age times its rate of then,
    `s = n <(D g - h d) d> / (1 - h)` is the square of what came true, h = `exp(-2 pi label delay)` what white noise
    behind two lags foretells of itself, and `w = s / (c (v + n <d d>))`, within 0 and 1 and c the coherence, how much
    of a rate is to be trusted; means over ten spans, from nothing on.
    """

    filters: FilterBandwidths
    hold_time: Scalar  # s
    decay_time: Scalar  # s; inf: r is held
    averaging_time: Scalar  # s
    variance_ratio: (
        Scalar  # n: a mean that has moved by less than the variance of labels over n is trusted, a rate is not
    )
    coherence: Scalar  # c, of the square of what rates foretell: the share that comes true where w is 1

    def init(self, team: Team) -> InnovationState:
        """Nothing heard yet."""
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
        past: InnovationState,
        team: Team,
        model: residual_model.ResidualModel,
        estimate: StateEstimate,
        clock: ControlClock,
    ) -> tuple[InnovationState, Innovation]:
        """The innovation of this tick. Raises ValueError where nothing is labelled."""
        labelled, dt = estimate.sample, clock.dt
        if labelled is None:
            raise ValueError("the estimator gives no labels: this pilot cannot listen")
        on, waited = labelled.valid, labelled.sample_interval
        f = residual_model.predict(
            model, estimate.payload, estimate.agents, estimate.a_L[:3] - team.gravity, estimate.a_L[3:]
        )
        past = _taken_over(past, f, model.update_index)
        copy = _low(
            past.sensor_lowpass,
            f,
            initial_smoothing_factor(past.initialized, smoothing_factor(self.filters.tip_force, dt)),
        )
        b = on * irregular_smoothing_factor(
            smoothing_factor(self.filters.label, dt), waited / dt
        )  # stands still where the labels do
        b = initial_smoothing_factor(past.initialized, b)
        inner = _low(past.label_lowpass1, copy, b)
        outer = _low(past.label_lowpass2, inner, b)
        y = _label(labelled)
        r = jax.tree.map(jnp.subtract, y, outer)
        b_span = on * -jnp.expm1(-waited / self.averaging_time)
        b_mean = initial_smoothing_factor(past.initialized, b_span)
        average = _low(past.running_mean, r, b_mean)
        moved = _moved(past.comovement, y, outer, b, past.initialized * b_span)
        silent, ended = (1 - on) * waited, on * (waited - dt)
        gap = jnp.maximum(past.longest_gap * jnp.exp(-dt / (10 * self.averaging_time)), ended)
        speaking = (silent <= jnp.maximum(self.hold_time, 2 * gap) + 1e-9).astype(float)
        fresh = past.correction_weight + -jnp.expm1(-dt / self.decay_time) * (speaking - past.correction_weight)
        v = label_noise_variance(model)
        trust = jax.tree.map(
            lambda c, s, v: 1 + fresh * (self._alpha(c, s, v) - 1), moved.cross_moment, moved.second_moment, v
        )
        before = _if(on, (past.r, past.label_lowpass2), past.previous)
        elapsed = jnp.where(on > 0, waited, past.time_since_label + dt)
        by = past.initialized * fresh / elapsed
        rate = jax.tree.map(lambda r, m, r_0, m_0, a: by * (r - r_0 + (1 - a) * (m - m_0)), r, outer, *before, trust)
        delay = self.filters.label_delay()
        went_on = past.initialized * (ended <= jnp.maximum(self.hold_time, 2 * past.longest_gap) + 1e-9).astype(
            float
        )  # until this label
        foretold = self._held_against(past.rate_forecast, y, outer, trust, rate, on, went_on, dt)
        ahead = jax.tree.map(
            functools.partial(self._ahead, foretold.evidence), foretold.cross_moment, foretold.second_moment, v
        )
        lasting = jax.tree.map(lambda m, v: m * m * m / (m * m + 4 * v), average, v)
        used = jax.tree.map(lambda r, left: left + fresh * (r - left), r, lasting)
        # stand still where the labels do
        late = _low(past.delay_error_ms, jax.tree.map(lambda x: (delay * x) * (delay * x), rate), b_span)
        level = _low(past.window_mean, r, b_mean)
        said = _low(past.window_mean_square, jax.tree.map(jnp.square, r), b_mean)
        age = past.mean_label_age + speaking * -jnp.expm1(-dt / (10 * self.averaging_time)) * (
            silent - past.mean_label_age
        )
        as_old = 1 + age / delay
        left = jax.tree.map(lambda q, m, x: jnp.sqrt(jnp.maximum(q - 2 * x * m + x * x, 0.0)), said, level, used)
        innovation_state = InnovationState(
            update_index=model.update_index,
            prediction=f,
            sensor_lowpass=copy,
            label_lowpass1=inner,
            label_lowpass2=outer,
            r=r,
            previous=before,
            comovement=moved,
            rate_forecast=foretold,
            time_since_label=elapsed,
            running_mean=average,
            longest_gap=gap,
            mean_label_age=age,
            delay_error_ms=late,
            window_mean=level,
            window_mean_square=said,
            correction_weight=fresh,
            initialized=jnp.ones(()),
        )
        innovation = Innovation(
            t=clock.t,
            r=used,
            filtered_prediction=outer,
            model_gain=trust,
            rate=rate,
            correction_weight=fresh,
            extrapolation_gain=ahead,
            labels_available=speaking,
            delay_error_rms=jax.tree.map(lambda of: as_old * jnp.sqrt(of), late),
            correction_error_rms=left,
        )
        return innovation_state, innovation

    def _held_against(
        self,
        past: RateForecast,
        y: ResidualForces,
        mean: ResidualForces,
        trust: ResidualForces,
        rate: ResidualForces,
        on: Scalar,
        went_on: Scalar,
        dt: Scalar,
    ) -> RateForecast:
        """The memory after the label y, against which what was foretold is held once it is as old as labels are late.

        As long as they went on: a rate from before they stopped says nothing of when they come again.
        """
        age = past.elapsed + dt
        due = on * (age > self.filters.label_delay() - 1e-9).astype(float)
        b = due * went_on * -jnp.expm1(-age / (10 * self.averaging_time))
        rest = functools.partial(jax.tree.map, lambda y, m, a: y - a * m, y, mean)
        came = jax.tree.map(jnp.subtract, rest(past.model_gain), past.baseline)
        told = jax.tree.map(lambda r: age * r, past.rate)
        trust, left, rate = _if(due, (trust, rest(trust), rate), (past.model_gain, past.baseline, past.rate))
        return RateForecast(
            elapsed=(1 - due) * age,
            evidence=past.evidence + b * (1 - past.evidence),
            model_gain=trust,
            baseline=left,
            rate=rate,
            cross_moment=_low(past.cross_moment, jax.tree.map(jnp.multiply, came, told), b),
            second_moment=_low(past.second_moment, jax.tree.map(jnp.square, told), b),
        )

    def _alpha(self, c: Array, s: Array, v: Array) -> Array:
        return jnp.clip((v + self.variance_ratio * c) / (v + self.variance_ratio * s), 0.0, 1.0)

    def _ahead(self, known: Scalar, c: Array, s: Array, v: Array) -> Array:
        of_noise = jnp.exp(-2 * jnp.pi * self.filters.label * self.filters.label_delay())
        true = jnp.maximum(0.0, known * self.variance_ratio * (c - of_noise * s)) / (1 - of_noise)
        whole = self.coherence * (v + self.variance_ratio * s)
        return (jnp.minimum(true, whole) + 1e-30) / (whole + 1e-30)  # 1 where no coherence is asked


def _taken_over(past: InnovationState, f: ResidualForces, k: Int[Array, ""]) -> InnovationState:
    """The memory as if the oracle k, whose mean now is f, had been there before, but for a constant."""
    more = jax.tree.map(
        lambda new, old: jnp.where((k != past.update_index) & (past.initialized > 0), new - old, 0.0),
        f,
        past.prediction,
    )
    plus, less = (lambda x: jax.tree.map(jnp.add, x, more)), (lambda x: jax.tree.map(jnp.subtract, x, more))
    trusted = jax.tree.map(jnp.multiply, past.rate_forecast.model_gain, more)
    return dataclasses.replace(
        past,
        sensor_lowpass=plus(past.sensor_lowpass),
        label_lowpass1=plus(past.label_lowpass1),
        label_lowpass2=plus(past.label_lowpass2),
        r=less(past.r),
        previous=(less(past.previous[0]), plus(past.previous[1])),
        comovement=dataclasses.replace(past.comovement, prediction_lowpass=plus(past.comovement.prediction_lowpass)),
        rate_forecast=dataclasses.replace(
            past.rate_forecast, baseline=jax.tree.map(jnp.subtract, past.rate_forecast.baseline, trusted)
        ),
        running_mean=jax.tree.map(lambda of, m: jnp.where(of != 0, 0.0, m), more, past.running_mean),
    )


def _moved(
    past: ComovementStats, y: ResidualForces, mean: ResidualForces, b: Scalar, b_span: Scalar
) -> ComovementStats:
    """The memory after the label y and the late mean, one filter more with the blend b, means with b_span."""
    label, slow = _low(past.label_lowpass, y, b), _low(past.prediction_lowpass, mean, b)
    dy, df = (jax.tree.map(jnp.subtract, *each) for each in ((y, label), (mean, slow)))
    return ComovementStats(
        label_lowpass=label,
        prediction_lowpass=slow,
        cross_moment=_low(past.cross_moment, jax.tree.map(jnp.multiply, dy, df), b_span),
        second_moment=_low(past.second_moment, jax.tree.map(jnp.multiply, df, df), b_span),
    )


def _if(on: Scalar, new: T, old: T) -> T:
    return jax.tree.map(lambda new, old: jnp.where(on > 0, new, old), new, old)


def _low(past: ResidualForces, context: ResidualForces, b: Scalar) -> ResidualForces:
    return jax.tree.map(lambda old, new: old + b * (new - old), past, context)


def _label(labelled: TrainingSample) -> ResidualForces:
    return _residual(labelled.payload[1], tuple(y for _, y in labelled.agents))


def label_noise_variance(model: residual_model.ResidualModel) -> ResidualForces:
    """Variance of labels, by output, (N, N m)^2."""
    return _residual(model.payload.hyper.noise_variance, tuple(g.hyper.noise_variance for g in model.agents))


def _residual(payload: Float[Array, "6"], agents: tuple[Float[Array, "_agents _outputs"], ...]) -> ResidualForces:
    return ResidualForces(
        payload=Wrench(F=payload[:3], tau=payload[3:]),
        agents=tuple(split_agent_force(y) for y in agents),
    )
