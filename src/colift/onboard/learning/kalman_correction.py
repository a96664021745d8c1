"""Kalman filters of the error of a residual model, and the combination of their forecasts.

See Also:
    colift.onboard.learning.residual_correction: observations, corrections and the protocol.
    docs/learning: equations and limits.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from colift.math.filters import initial_smoothing_factor, smoothing_factor
from colift.math.pytree import constant, pytree
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, zero_residual
from colift.onboard.learning.residual_correction import (
    Outputs,
    ResidualCorrection,
    ResidualObservation,
    Scalar,
    flatten,
    unflatten,
)

SETTLING_PERIODS = 10000
"""Control periods after which covariances are those of the steady state."""
BLOCK = 8
"""Number of labels of a block, over which differenced noise averages out."""
TINY = 1e-12
"""Variance that avoids a division by zero [N^2, (N m)^2]."""


@pytree
class LabelNoise:
    """Moments from which the noise of the labels is computed, one value per output.

    Attributes:
        previous: Last label [N, N m].
        block_sum: Sum of the labels of this block [N, N m].
        previous_block: Sum of the labels of the last block [N, N m].
        count: Number of labels of this block.
        labels: Number of labels.
        allan_1: Allan variance over one label [N^2, (N m)^2].
        allan_block: Allan variance over one block of labels, times its number of labels [N^2, (N m)^2].
    """

    previous: Outputs
    block_sum: Outputs
    previous_block: Outputs
    count: Outputs
    labels: Outputs
    allan_1: Outputs
    allan_block: Outputs

    def variances(self) -> tuple[Outputs, Outputs]:
        """Compute the variances R of white noise and Q of differenced noise.

        White noise of variance R has the Allan variances R over one label, and R over a block, times its length. The
        difference of white noise of variance Q has ``3 Q`` and ``3 Q / BLOCK``.

        Returns:
            R and Q [N^2, (N m)^2].
        """
        Q = jnp.maximum(self.allan_1 - self.allan_block, 0.0) / (3 - 3 / BLOCK)
        R = jnp.maximum(jnp.minimum(self.allan_1, self.allan_block) - 3 / BLOCK * Q, 0.01 * self.allan_1) + TINY
        return R, Q


@pytree
class KalmanState:
    """State of the residual Kalman filter between two control periods, one value per output.

    Attributes:
        update_index: Index of the model update whose model was in use.
        prediction: Prediction of the residual model [N, N m].
        delayed: Prediction behind the first-order lag of the tip force sensors [N, N m].
        d: Model error [N, N m].
        v: Rate of the model error [N/s, N m/s].
        P: Covariances of ``(d, d)``, ``(d, v)`` and ``(v, v)``.
        P_label: Variance of d after the last label.
        noise: Estimated differenced noise ``n`` of the last label, its variance, and its covariances with d and v.
        error_ms: Mean square of the model error over the averaging time [N^2, (N m)^2].
        label_noise: Moments of the labels.
        initialized: 0 before the first label, 1 afterwards.
    """

    update_index: Int[Array, ""]
    prediction: Outputs
    delayed: Outputs
    d: Outputs
    v: Outputs
    P: tuple[Outputs, Outputs, Outputs]
    P_label: Outputs
    noise: tuple[Outputs, Outputs, Outputs, Outputs]
    error_ms: Outputs
    label_noise: LabelNoise
    initialized: Scalar

    def lost_variance(self) -> Outputs:
        """Return the variance that the error has gained since the last label [N^2, (N m)^2]."""
        return jnp.maximum(self.P[0] - self.P_label, 0.0)

    def weight_and_std(self) -> tuple[Outputs, Outputs]:
        """Return the applied share of the error, and the standard deviation of the corrected prediction."""
        weight = (self.error_ms + TINY) / (self.error_ms + self.lost_variance() + TINY)
        return weight, jnp.sqrt(self.P_label + (1 - weight) * self.error_ms)


@pytree
class ResidualKalmanFilter:
    """Kalman filter of the error of the residual model, separately for each output.

    The error d is a Gaussian process of time with a Matern-3/2 kernel, in state-space form (Hartikainen and Särkkä
    2010): ``d' = v``, ``v' = -lambda^2 d - 2 lambda v + w`` with stationary standard deviation sigma. The label of
    period k is

        y_k = F f_hat + d + n_k - n_(k-1) + e_k

    with the tip sensor lag ``F``, white noise e, and the noise n of quantities that the label differentiates. The
    variances R of e and Q of n follow from the Allan variances over one and over `BLOCK` labels. R has a minimum, which
    limits the bandwidth of the feedback from labels to commands: with R alone, the steady-state filter has the corner
    frequency ``(4 lambda^3 sigma^2 / (R dt))^(1/4)`` [rad/s].

    Without labels the variance of d grows from its value ``P_0`` at the last label. The prediction without the
    correction has the mean square error ``E``. The correction is weighted by ``w = E / (E + P - P_0)``, which minimizes
    the variance of the sum. When the model is replaced, d is offset by the difference of the two predictions.

    Attributes:
        std: Standard deviation ``sigma`` of the model error [N, N m].
        decay_rate: Decay rate ``lambda`` [1/s].
        tip_bandwidth: Bandwidth of the tip force sensors [Hz].
        max_bandwidth: Largest corner frequency of the filter [Hz].
        averaging_time: Time constant of ``E`` [s].
        noise_averaging_time: Time constant of the Allan variances [s].

    Example:
        ::

            corrector = ResidualKalmanFilter(std=std, tip_bandwidth=jnp.array(50.0))
            state = corrector.init(team)
            correction, state = corrector.update(state, observation, clock)

    References:
        Hartikainen, Särkkä, *Kalman filtering and smoothing solutions to temporal Gaussian process regression models*,
        2010. Simon, *Optimal State Estimation*, 2006, ch. 7 (correlated noise).
    """

    std: ResidualForces
    tip_bandwidth: Scalar
    decay_rate: Scalar = constant(1.0)
    max_bandwidth: Scalar = constant(10.0)
    averaging_time: Scalar = constant(1.0)
    noise_averaging_time: Scalar = constant(5.0)

    def init(self, team: Team) -> KalmanState:
        """Return the state before the first control period.

        Args:
            team: Nominal parameters.

        Returns:
            The stationary distribution of the error.
        """
        p = self._variance()
        z, zero = jnp.zeros_like(p), jnp.zeros(())
        noise = LabelNoise(previous=z, block_sum=z, previous_block=z, count=z, labels=z, allan_1=z, allan_block=z)
        return KalmanState(
            update_index=jnp.zeros((), int),
            prediction=z,
            delayed=z,
            d=z,
            v=z,
            P=(p, z, p * self.decay_rate**2),
            P_label=p,
            noise=(z, z, z, z),
            error_ms=z,
            label_noise=noise,
            initialized=zero,
        )

    def _variance(self) -> Outputs:
        return flatten(self.std) ** 2

    def min_noise_variance(self, dt: Scalar) -> Outputs:
        """Return the least variance of white label noise, from the largest corner frequency.

        Args:
            dt: Control period [s].

        Returns:
            The variance [N^2, (N m)^2].
        """
        return 4 * self.decay_rate**3 * self._variance() / (dt * (2 * jnp.pi * self.max_bandwidth) ** 4)

    def steady_state(self, state: KalmanState, dt: Scalar) -> KalmanState:
        """Return the state with the covariances of a label in every control period and of the present label noise.

        Args:
            state: Filter state.
            dt: Control period [s].

        Returns:
            The state after `SETTLING_PERIODS` control periods; its error and rate are those of the given state.
        """
        zero = jnp.zeros_like(state.d)

        def advance(_: Int[Array, ""], current: KalmanState) -> KalmanState:
            R, Q = self._noise_variances(state.label_noise, dt)
            return self._correct(current, zero, jnp.ones(()), R, Q, dt)[0]

        end = jax.lax.fori_loop(0, SETTLING_PERIODS, advance, state)
        n = state.noise[0]
        return dataclasses.replace(state, P=end.P, P_label=end.P_label, noise=(n, *end.noise[1:]))

    def update(
        self, state: KalmanState, observation: ResidualObservation, clock: ControlClock
    ) -> tuple[ResidualCorrection, KalmanState]:
        """Advance the filter by one control period.

        Args:
            state: Filter state of the previous control period.
            observation: Label and prediction of this control period.
            clock: Time and period [s].

        Returns:
            The correction and the next filter state.
        """
        f = flatten(observation.prediction)
        state = transfer_to_model(state, f, observation.update_index)
        next_state, nis = self.filter(state, f, observation, clock.dt)
        weight, std = next_state.weight_and_std()
        forces = lambda x: unflatten(x, observation.label)  # noqa: E731
        correction = ResidualCorrection(
            t=clock.t,
            error=forces(weight * next_state.d),
            rate=forces(weight * next_state.v),
            std=forces(std),
            weight=forces(weight),
            model_weight=forces(jnp.ones_like(weight)),
            label=observation.label,
            prediction=observation.prediction,
            label_valid=flatten(observation.valid).min(),
            nis=(flatten(observation.valid) * nis).mean(),
        )
        return correction, dataclasses.replace(next_state, update_index=observation.update_index)

    def filter(
        self, state: KalmanState, f: Outputs, observation: ResidualObservation, dt: Scalar
    ) -> tuple[KalmanState, Outputs]:
        """Predict over one control period and correct by the label.

        Args:
            state: Filter state of the previous control period.
            f: Prediction to which the filtered error is relative [N, N m]; zero for the residual itself.
            observation: Label of this control period.
            dt: Control period [s].

        Returns:
            The next filter state and the normalized innovation squared of each output.
        """
        y, valid, interval = (flatten(x) for x in (observation.label, observation.valid, observation.interval))
        noise = self._label_noise(state.label_noise, y, observation)
        b = initial_smoothing_factor(state.initialized, smoothing_factor(self.tip_bandwidth, dt))
        delayed = state.delayed + b * (f - state.delayed)
        corrected, nis = self._correct(state, y - delayed, valid, *self._noise_variances(noise, dt), dt)
        average, d = valid * -jnp.expm1(-interval / self.averaging_time), corrected.d
        next_state = dataclasses.replace(
            corrected,
            prediction=f,
            delayed=delayed,
            error_ms=state.error_ms + average * (d * d - state.error_ms),
            label_noise=noise,
            initialized=jnp.ones(()),
        )
        return next_state, nis

    def _noise_variances(self, noise: LabelNoise, dt: Scalar) -> tuple[Outputs, Outputs]:
        """Return the variances of white and of differenced label noise."""
        R, Q = noise.variances()
        return jnp.maximum(R, self.min_noise_variance(dt)), Q

    def _correct(
        self, state: KalmanState, y: Outputs, valid, R: Outputs, Q: Outputs, dt: Scalar
    ) -> tuple[KalmanState, Outputs]:
        """Predict error and covariances, and correct them by label minus prediction; return the state and the NIS."""
        d, v, P, (n, P_nn, P_dn, P_vn) = self._predict(state, dt)
        H_d, H_v = P[0] - P_dn, P[1] - P_vn  # covariances of d and v with the predicted label
        S = H_d - P_dn + P_nn + R + Q
        innovation = y - d + n
        K_d, K_v, K_n = valid * H_d / S, valid * H_v / S, valid * Q / S
        P = (P[0] - K_d * H_d, P[1] - K_d * H_v, P[2] - K_v * H_v)
        next_state = dataclasses.replace(
            state,
            d=d + K_d * innovation,
            v=v + K_v * innovation,
            P=P,
            P_label=jnp.where(valid > 0, P[0], state.P_label),
            noise=(K_n * innovation, Q - K_n * Q, -K_d * Q, -K_v * Q),
        )
        return next_state, innovation * innovation / S

    def _predict(
        self, state: KalmanState, dt: Scalar
    ) -> tuple[Outputs, Outputs, tuple[Outputs, Outputs, Outputs], tuple[Outputs, Outputs, Outputs, Outputs]]:
        """Predict mean and covariances over dt: ``P <- A (P - P_inf) A^T + P_inf``."""
        lam, p = self.decay_rate, self._variance()
        r, decay = p * lam * lam, jnp.exp(-lam * dt)
        a, b, c, g = decay * (1 + lam * dt), decay * dt, -decay * lam * lam * dt, decay * (1 - lam * dt)
        P_dd, P_dv, P_vv = state.P[0] - p, state.P[1], state.P[2] - r
        P = (
            a * a * P_dd + 2 * a * b * P_dv + b * b * P_vv + p,
            a * c * P_dd + (a * g + b * c) * P_dv + b * g * P_vv,
            c * c * P_dd + 2 * c * g * P_dv + g * g * P_vv + r,
        )
        n, P_nn, P_dn, P_vn = state.noise
        return (
            a * state.d + b * state.v,
            c * state.d + g * state.v,
            P,
            (n, P_nn, a * P_dn + b * P_vn, c * P_dn + g * P_vn),
        )

    def _label_noise(self, of: LabelNoise, y: Outputs, observation: ResidualObservation) -> LabelNoise:
        """Advance the Allan variances by the label of this control period."""
        valid, time = flatten(observation.valid), self.noise_averaging_time
        interval = flatten(observation.interval)
        labels = of.labels + valid

        def gain(elapsed, number):  # of a mean that starts with the first value
            return jnp.maximum(-jnp.expm1(-elapsed / time), 1 / jnp.maximum(number, 1.0))

        difference = y - of.previous
        b = valid * (of.labels > 0).astype(float) * gain(interval, labels - 1)
        allan_1 = of.allan_1 + b * (0.5 * difference * difference - of.allan_1)
        total, count = of.block_sum + valid * y, of.count + valid
        full = (count >= BLOCK).astype(float)
        change = (total - of.previous_block) / BLOCK
        b = full * (labels > BLOCK).astype(float) * gain(BLOCK * interval, labels / BLOCK - 1)
        allan_block = of.allan_block + b * (0.5 * BLOCK * change * change - of.allan_block)
        return LabelNoise(
            previous=jnp.where(valid > 0, y, of.previous),
            block_sum=(1 - full) * total,
            previous_block=jnp.where(full > 0, total, of.previous_block),
            count=(1 - full) * count,
            labels=labels,
            allan_1=allan_1,
            allan_block=allan_block,
        )


def step_of_model(state: KalmanState, f: Outputs, update_index: Int[Array, ""]) -> Outputs:
    """Return the step of the prediction in the control period in which the model is replaced, otherwise zero."""
    return jnp.where((update_index != state.update_index) & (state.initialized > 0), f - state.prediction, 0.0)


def transfer_to_model(state: KalmanState, f: Outputs, update_index: Int[Array, ""]) -> KalmanState:
    """Offset the error by the step of the prediction when the model is replaced (bumpless transfer)."""
    step = step_of_model(state, f, update_index)
    return dataclasses.replace(state, delayed=state.delayed + step, d=state.d - step)


@pytree
class CombinationState:
    """State of `ForecastCombination` between two control periods.

    Attributes:
        with_model: Kalman filter of the error of the residual model.
        without_model: Kalman filter of the residual.
        origin: Values and rates of both filters at the start of the forecasts: ``d_A``, ``v_A``, ``d_B``, ``v_B``.
        forecast_time: Time since the start of the forecasts [s].
        cross_moment: Mean of ``(y - f_B) (f_A - f_B)`` over the averaging time [N^2, (N m)^2].
        second_moment: Mean of ``(f_A - f_B)^2`` [N^2, (N m)^2].
    """

    with_model: KalmanState
    without_model: KalmanState
    origin: tuple[Outputs, Outputs, Outputs, Outputs]
    forecast_time: Scalar
    cross_moment: Outputs
    second_moment: Outputs


@pytree
class ForecastCombination:
    """Combination of two forecasts of the labels, with and without the residual model.

    Filter A estimates the error of the residual model, filter B the residual itself. Every ``horizon`` both forecast
    the labels: ``f_A = F f_hat + d_A`` and ``f_B = d_B``. The share of A minimizes the mean square of
    ``y - w f_A - (1 - w) f_B`` over the averaging time (Granger and Ramanathan 1984):

        w = (<(y - f_B)^T (f_A - f_B)> + L_B) / (<|f_A - f_B|^2> + L_A + L_B)

    within [0, 1]. The components of a vector have one share. ``L_A`` and ``L_B`` are the variances that the estimates
    have gained since the last label; without labels they return the prediction to the model.

    Attributes:
        with_model: Kalman filter of the error of the residual model.
        without_model: Kalman filter of the residual, without the model.
        horizon: Longest duration of a forecast [s].
        averaging_time: Time constant of the means [s].

    Example:
        ::

            corrector = ForecastCombination(with_model=slow, without_model=fast)
            state = corrector.init(team)
            correction, state = corrector.update(state, observation, clock)

    References:
        Bates, Granger, *The combination of forecasts*, 1969. Granger, Ramanathan, *Improved methods of combining
        forecasts*, 1984.
    """

    with_model: ResidualKalmanFilter
    without_model: ResidualKalmanFilter
    horizon: Scalar = constant(0.1)
    averaging_time: Scalar = constant(1.0)

    def init(self, team: Team) -> CombinationState:
        """Return the state before the first control period.

        Args:
            team: Nominal parameters.
        """
        z = jnp.zeros_like(flatten(zero_residual(team)))
        return CombinationState(
            with_model=self.with_model.init(team),
            without_model=self.without_model.init(team),
            origin=(z, z, z, z),
            forecast_time=jnp.zeros(()),
            cross_moment=z,
            second_moment=z,
        )

    def steady_state(self, state: CombinationState, dt: Scalar) -> CombinationState:
        """Return the state with steady-state covariances and the whole share for the filter without the model.

        Args:
            state: State of the combination.
            dt: Control period [s].

        Returns:
            The state. The loop is linearized with this filter, whose bandwidth is larger.
        """
        return dataclasses.replace(
            state,
            with_model=self.with_model.steady_state(state.with_model, dt),
            without_model=self.without_model.steady_state(state.without_model, dt),
            cross_moment=jnp.zeros_like(state.cross_moment),
            second_moment=jnp.ones_like(state.second_moment),
        )

    def update(
        self, state: CombinationState, observation: ResidualObservation, clock: ControlClock
    ) -> tuple[ResidualCorrection, CombinationState]:
        """Advance both filters and the share of the model by one control period.

        Args:
            state: State of the previous control period.
            observation: Label and prediction of this control period.
            clock: Time and period [s].

        Returns:
            The correction and the next state.
        """
        y, f = flatten(observation.label), flatten(observation.prediction)
        correction, A = self.with_model.update(state.with_model, observation, clock)
        B, _ = self.without_model.filter(state.without_model, jnp.zeros_like(f), observation, clock.dt)
        d_A, v_A, d_B, v_B = state.origin
        d_A = d_A - step_of_model(state.with_model, f, observation.update_index)
        elapsed = state.forecast_time + clock.dt
        f_A = A.delayed + d_A + elapsed * v_A
        f_B = d_B + elapsed * v_B
        average = flatten(observation.valid) * -jnp.expm1(-flatten(observation.interval) / self.averaging_time)
        cross_moment = state.cross_moment + average * ((y - f_B) * (f_A - f_B) - state.cross_moment)
        second_moment = state.second_moment + average * ((f_A - f_B) ** 2 - state.second_moment)
        (weight, std_A), (_, std_B) = A.weight_and_std(), B.weight_and_std()
        L_A, L_B = weight * A.lost_variance(), B.lost_variance() + TINY
        forces = lambda x: unflatten(x, observation.label)  # noqa: E731
        means = lambda x: _vector_means(forces(x))  # noqa: E731
        w = jnp.clip(means(cross_moment + L_B) / means(second_moment + L_A + L_B), 0.0, 1.0)
        restart = elapsed >= self.horizon
        begin = lambda new, old: jnp.where(restart, new, old)  # noqa: E731
        next_state = CombinationState(
            with_model=A,
            without_model=B,
            origin=(begin(A.d, d_A), begin(A.v, v_A), begin(B.d, d_B), begin(B.v, v_B)),
            forecast_time=jnp.where(restart, 0.0, elapsed),
            cross_moment=cross_moment,
            second_moment=second_moment,
        )
        combined = dataclasses.replace(
            correction,
            error=forces(w * weight * A.d + (1 - w) * B.d),
            rate=forces(w * weight * A.v + (1 - w) * B.v),
            std=forces(w * std_A + (1 - w) * std_B),
            model_weight=forces(w),
        )
        return combined, next_state


def _vector_means(forces: ResidualForces) -> Outputs:
    """Return the mean over the components of each vector, in the place of each component."""
    mean = lambda leaf: jnp.broadcast_to(leaf.mean(-1, keepdims=True), leaf.shape) if leaf.size else leaf  # noqa: E731
    return flatten(jax.tree.map(mean, forces))
