"""Complementary filter of pose and velocity of one body, with readings that are slow or late.

Gyroscope and accelerometer predict pose and velocity in every control period. Readings of pose and velocity correct the
prediction at a low bandwidth. A reading that is sampled rarely corrects once, when it arrives. A late reading is
compared with the estimate at the time of its sample, and the whole history is corrected.

References:
    Mahony, Hamel, Pflimlin, *Nonlinear complementary filters on the special orthogonal group*, IEEE TAC 2008.
    Khosravian, Trumpf, Mahony, Hamel, *State estimation for invariant systems on Lie groups with delayed output
    measurements*, Automatica 2016 (correction of a prediction by delayed readings).
"""

from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.filters import initial_smoothing_factor, irregular_smoothing_factor, smoothing_factor
from colift.math.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class FilterBandwidths:
    """Corner frequencies of the onboard filters."""

    complementary: Scalar  # Hz, correction of predicted poses and velocities by the measured ones
    imu_bias: Scalar  # Hz, estimation of the biases of gyroscopes and accelerometers from the corrections
    joint: Scalar  # Hz, second order, joint positions and their rates
    label: Scalar  # Hz, second order, labels and their inputs
    tip_force: Float[Array, "*outputs"]  # Hz, first order, known bandwidth of the tip force sensors, or of the sensors
    # of each label

    def label_delay(self) -> Float[Array, "*outputs"]:
        """Return the delay of labels `1 / (pi label) + 1 / (2 pi tip_force)` [s]."""
        return (1 / self.label + 1 / (2 * self.tip_force)) / jnp.pi


@pytree
class NavState:
    """Pose and velocity of the sensor origin of a body."""

    R: Float[Array, "*agents 3 3"]  # attitude, body to world
    x: Float[Array, "*agents 3"]  # m, position, world
    v: Float[Array, "*agents 3"]  # m/s, velocity, world


@pytree
class ImuBias:
    """Estimated biases of gyroscope and accelerometer of a body."""

    omega: Float[Array, "*agents 3"]  # rad/s, body frame
    a: Float[Array, "*agents 3"]  # m/s^2, body frame


@pytree
class ReadingClock:
    """Age and interval of the readings of attitude, position and velocity of a body, in this order.

    Attributes:
        age: Age of the reading in use [s].
        elapsed: Time since the reading before it arrived, or since the reading in use arrived [s].
        is_new: 1 if the reading arrived in this control period, 0 otherwise.
    """

    age: Float[Array, "*time 3"]
    elapsed: Float[Array, "*time 3"]
    is_new: Float[Array, "*time 3"]


CHANNELS = {"payload": ("payload.R", "payload.p", "payload.v"), "agents": ("agents.R", "agents.x", "agents.v")}
"""Names of attitude, position and velocity in `Measurement.measurement_age_s`, by body."""


def initial_clock() -> ReadingClock:
    """Return the clock before the first control period."""
    return ReadingClock(age=jnp.zeros(3), elapsed=jnp.zeros(3), is_new=jnp.ones(3))


def advance_clock(
    clock: ReadingClock, channels: tuple[str, ...], ages: Mapping[str, Scalar], dt: Scalar
) -> ReadingClock:
    """Return the clock of this control period. The age of a held reading grows by dt in each period.

    Args:
        clock: Clock of the previous control period.
        channels: Names of attitude, position and velocity.
        ages: Ages of the readings that are held between samples [s]; other readings are new in every period.
        dt: Control period [s].
    """
    age = jnp.stack([ages.get(name, jnp.zeros(())) for name in channels])
    elapsed = clock.elapsed * (1 - clock.is_new) + dt
    return ReadingClock(age=age, elapsed=elapsed, is_new=(age < clock.age + 0.5 * dt).astype(float))


def zero_bias(*agents: int) -> ImuBias:
    """Return zero biases.

    Args:
        *agents: Leading axes of the arrays; none for a single body.
    """
    return ImuBias(omega=jnp.zeros((*agents, 3)), a=jnp.zeros((*agents, 3)))


def predict(nav: NavState, omega: so3.Vector, specific_force: so3.Vector, gravity: so3.Vector, dt: Scalar) -> NavState:
    """Predict pose and velocity after dt: `R exp(omega dt)`, `v + a dt`, `x + v dt + a dt^2 / 2`.

    Args:
        nav: Pose and velocity.
        omega: Angular velocity without bias [rad/s, body frame].
        specific_force: Specific force without bias [m/s^2, body frame].
        gravity: Gravitational acceleration [m/s^2, world].
        dt: Time step [s].
    """
    acceleration = nav.R @ specific_force + gravity
    return NavState(
        R=nav.R @ so3.exp(omega * dt),
        v=nav.v + acceleration * dt,
        x=nav.x + nav.v * dt + acceleration * (dt * dt / 2),
    )


def newest(nav: NavState, clock: object) -> NavState:
    """Return the newest estimate of a history.

    Args:
        nav: History, newest first; without a clock the estimate itself.
        clock: Clock of the readings; None if there is no history.
    """
    return nav if clock is None else NavState(R=nav.R[0], x=nav.x[0], v=nav.v[0])


def update(
    previous: tuple[NavState, ImuBias],
    measured: NavState,
    omega: so3.Vector,
    a: so3.Vector,
    gravity: so3.Vector,
    filters: FilterBandwidths,
    initialized: Scalar,
    dt: Scalar,
    clock: ReadingClock | None = None,
) -> tuple[NavState, ImuBias, so3.Vector, so3.Vector]:
    """Advance the complementary filter of one body by one control period.

    Readings of this period correct the prediction::

        R = R_- exp(omega dt) exp(b e),   v = v_- + a dt + b (v_measured - v),   x = x_- + v dt + b (x_measured - x)

    `e` is the skew part of the attitude error of the prediction, and b the smoothing factor. The biases follow
    `b_omega' = -k e` and `b_a' = -k R^T (v_measured - v)`. k is the product of the corner frequencies of fusion and
    bias [rad^2/s^2].

    With a clock, a reading of age ``h`` that arrives in this period is compared with the estimate at ``t - h``. With
    the history ``R_k, x_k, v_k`` of estimates k periods ago, all estimates are corrected::

        R_k <- exp(b_R R_h e) R_k,   x_k <- x_k + b_x (x_measured - x_h),   v_k <- v_k + b_v (v_measured - v_h)

    The smoothing factor b of a reading n periods after the previous one is `irregular_smoothing_factor`. Biases are
    corrected n times as much. A reading older than the history is not used. For readings of every period without age
    the result is that without a clock, up to rounding.

    Args:
        previous: Pose and velocity and biases of the previous control period; with a clock the history of pose and
            velocity, newest first.
        measured: Measured pose and velocity.
        omega: Angular velocity of the gyroscope [rad/s, body frame].
        a: Specific force of the accelerometer [m/s^2, body frame].
        gravity: Gravitational acceleration [m/s^2, world].
        filters: Corner frequencies.
        initialized: 0 in the first control period, in which the measured values are taken over; 1 afterwards.
        dt: Control period [s].
        clock: Ages of the readings, and whether they are new; None if all readings are new in every control period.

    Returns:
        Pose and velocity (with a clock their history), biases, and angular velocity and specific force without their
        biases, in the body frame.
    """
    nav, bias = previous
    omega, specific_force = omega - bias.omega, a - bias.a
    predicted = predict(newest(nav, clock), omega, specific_force, gravity, dt)
    if clock is None:
        fused, next_bias = _correct(predicted, bias, measured, filters, initialized, dt)
    else:
        fused, next_bias = _correct_history(shift(nav, predicted), bias, measured, filters, initialized, dt, clock)
    return fused, next_bias, omega, specific_force


def _correct(
    predicted: NavState, bias: ImuBias, measured: NavState, filters: FilterBandwidths, initialized: Scalar, dt: Scalar
) -> tuple[NavState, ImuBias]:
    """Correct the prediction and the biases by readings of this period."""
    b = initial_smoothing_factor(initialized, smoothing_factor(filters.complementary, dt))
    R, x, v = predicted.R, predicted.x, predicted.v
    e, e_v = so3.vee(R.T @ measured.R), measured.v - v
    k = initialized * dt * (2 * jnp.pi) ** 2 * filters.complementary * filters.imu_bias
    next_bias = ImuBias(omega=bias.omega - k * e, a=bias.a - k * (R.T @ e_v))
    return NavState(R=R @ so3.exp(b * e), x=x + b * (measured.x - x), v=v + b * e_v), next_bias


def initial_history(nav: NavState, length: int) -> NavState:
    """Return a history of equal estimates, newest first, with time as the first axis after the agents.

    Args:
        nav: Pose and velocity of a body or of the agents of a group.
        length: Number of control periods of the history.
    """
    repeated = lambda x, axes: jnp.repeat(jnp.expand_dims(x, x.ndim - axes), length, x.ndim - axes)  # noqa: E731
    return NavState(R=repeated(nav.R, 2), x=repeated(nav.x, 1), v=repeated(nav.v, 1))


def shift(history: NavState, predicted: NavState) -> NavState:
    """Return the history with the prediction as newest estimate, without the oldest one.

    Args:
        history: Estimates, newest first.
        predicted: Prediction for this control period.
    """
    return jax.tree.map(lambda new, old: jnp.concatenate([new[None], old[:-1]]), predicted, history)


def sample_periods(clock: ReadingClock, length: int, dt: Scalar) -> tuple[Float[Array, "3 periods"], Float[Array, "3"]]:
    """Return the period of the history in which each reading was sampled, and whether the reading is used.

    Args:
        clock: Clock of the readings of attitude, position and velocity.
        length: Number of control periods of the history.
        dt: Control period [s].

    Returns:
        Rows with 1 in the period of the sample, and 0 elsewhere; 1 for a new reading that is not older than the
        history, and 0 otherwise.
    """
    sampled = (jnp.abs(jnp.arange(length, dtype=float)[None] * dt - clock.age[:, None]) < 0.5 * dt).astype(float)
    return sampled, clock.is_new * sampled.sum(1)


def _correct_history(
    history: NavState,
    bias: ImuBias,
    measured: NavState,
    filters: FilterBandwidths,
    initialized: Scalar,
    dt: Scalar,
    clock: ReadingClock,
) -> tuple[NavState, ImuBias]:
    """Correct all estimates of the history and the biases by readings of their own age."""
    R, x, v = history.R, history.x, history.v
    sampled, used = sample_periods(clock, len(R), dt)
    R_h, x_h, v_h = jnp.einsum("k,kij->ij", sampled[0], R), sampled[1] @ x, sampled[2] @ v
    periods = clock.elapsed / dt
    smoothing = irregular_smoothing_factor(smoothing_factor(filters.complementary, dt), jnp.maximum(periods, 1.0))
    b = initial_smoothing_factor(initialized, used * smoothing)
    first = 1 - initialized  # the first reading is taken over whatever its age
    e = used[0] * so3.vee(R_h.T @ measured.R)
    e_v = used[2] * (measured.v - v_h)
    k = initialized * periods * dt * (2 * jnp.pi) ** 2 * filters.complementary * filters.imu_bias
    next_bias = ImuBias(omega=bias.omega - k[0] * e, a=bias.a - k[2] * (R_h.T @ e_v))
    rotation = so3.exp(b[0] * (R_h @ e))
    start = lambda given, corrected: first * given[None] + (1 - first) * corrected  # noqa: E731
    fused = NavState(
        R=start(measured.R, rotation[None] @ R),
        x=start(measured.x, x + b[1] * used[1] * (measured.x - x_h)[None]),
        v=start(measured.v, v + b[2] * e_v[None]),
    )
    return fused, next_bias
