"""Kalman filter of the error of a residual model.

See Also:
    colift.onboard.learning.residual_correction: observations, corrections and the protocol.
    docs/learning: equations and limits.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from colift.math.filters import initial_smoothing_factor, smoothing_factor
from colift.math.pytree import constant, pytree
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces
from colift.onboard.learning.residual_correction import (
    Outputs,
    ResidualCorrection,
    ResidualObservation,
    Scalar,
    flatten,
    prediction_step,
    unflatten,
    without_explained_error,
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
        initialized: 0 before the first control period, 1 afterwards.
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

    def weight_and_std(self) -> tuple[Outputs, Outputs]:
        """Return the applied share of the error, and the standard deviation of the corrected prediction."""
        gained = jnp.maximum(self.P[0] - self.P_label, 0.0)  # variance, since the last label
        weight = (self.error_ms + TINY) / (self.error_ms + gained + TINY)
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

    Each output has its own labels. Without labels the variance of d grows from its value ``P_0`` at the last label. The
    prediction without the correction has the mean square error ``E``. The correction is weighted by
    ``w = E / (E + P - P_0)``, which minimizes the variance of the sum. When the model is replaced, d is offset by the
    difference of the two predictions.

    Attributes:
        std: Standard deviation ``sigma`` of the model error [N, N m].
        decay_rate: Decay rate ``lambda`` [1/s].
        sensor_bandwidth: Bandwidth of the sensors of the labels, for all outputs or each of them [Hz].
        max_bandwidth: Largest corner frequency of the filter [Hz].
        averaging_time: Time constant of ``E`` [s].
        noise_averaging_time: Time constant of the Allan variances [s].

    Example:
        ::

            corrector = ResidualKalmanFilter(std=std, sensor_bandwidth=jnp.array(50.0))
            state = corrector.init(team)
            correction, state = corrector.update(state, observation, clock)

    References:
        Hartikainen, Särkkä, *Kalman filtering and smoothing solutions to temporal Gaussian process regression models*,
        2010. Simon, *Optimal State Estimation*, 2006, ch. 7 (correlated noise).
    """

    std: ResidualForces
    sensor_bandwidth: Float[Array, "*outputs"]
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
        z = jnp.zeros_like(p)
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
            initialized=jnp.zeros(()),
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
            return self._correct(current, zero, jnp.ones_like(zero), R, Q, dt)[0]

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
        f, valid = flatten(observation.prediction), flatten(observation.label_valid)
        step = prediction_step(observation, state.update_index, state.prediction, state.initialized)
        state = dataclasses.replace(state, delayed=state.delayed + step, d=state.d - step)
        next_state, nis = self.filter(state, f, observation, clock.dt)
        found = (next_state.d, next_state.v, next_state.noise[0])
        d, v, n = without_explained_error(found, observation)
        next_state = dataclasses.replace(next_state, d=d, v=v, noise=(n, *next_state.noise[1:]))
        weight, std = next_state.weight_and_std()
        forces = lambda x: unflatten(x, observation.label)  # noqa: E731
        correction = ResidualCorrection(
            t=clock.t,
            error=forces(weight * next_state.d),
            rate=forces(weight * next_state.v),
            std=forces(std),
            weight=forces(weight),
            label=observation.label,
            prediction=observation.prediction,
            label_valid=valid.min(),
            nis=(valid * nis).sum() / jnp.maximum(valid.sum(), 1.0),
        )
        return correction, dataclasses.replace(next_state, update_index=observation.update_index)

    def filter(
        self, state: KalmanState, f: Outputs, observation: ResidualObservation, dt: Scalar
    ) -> tuple[KalmanState, Outputs]:
        """Predict over one control period and correct by the label.

        Args:
            state: Filter state of the previous control period.
            f: Prediction of the residual model [N, N m].
            observation: Label of this control period.
            dt: Control period [s].

        Returns:
            The next filter state and the normalized innovation squared of each output.
        """
        y, valid, interval = (flatten(x) for x in (observation.label, observation.label_valid, observation.interval))
        noise = self._label_noise(state.label_noise, y, valid, interval)
        b = initial_smoothing_factor(state.initialized, smoothing_factor(self.sensor_bandwidth, dt))
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
        self, state: KalmanState, y: Outputs, valid: Outputs, R: Outputs, Q: Outputs, dt: Scalar
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

    def _label_noise(self, of: LabelNoise, y: Outputs, valid: Outputs, interval: Outputs) -> LabelNoise:
        """Advance the Allan variances by the label of this control period."""
        labels = of.labels + valid

        def gain(elapsed: Outputs, number: Outputs) -> Outputs:  # of a mean that starts with the first value
            return jnp.maximum(-jnp.expm1(-elapsed / self.noise_averaging_time), 1 / jnp.maximum(number, 1.0))

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
