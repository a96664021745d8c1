"""Kalman filter of a payload without gyroscope and accelerometer.

The nominal equations of motion predict pose and velocity from the contact wrench `(F, tau)` of the previous control
period and an estimated residual wrench `(d_F, d_tau)`. Poses correct the prediction::

    m v_dot = F + d_F + m a_g,    J w_dot = tau + d_tau - w x J w,    (d_F, d_tau) random walks

Each axis of position and attitude is then a chain of three integrators. Let q be the spectral density of the rate of
the residual acceleration, and r that of the pose noise. The poles of the steady-state Kalman filter are the stable
roots of ``s^6 = q / r``: those of a third-order Butterworth filter with the corner frequency ``(q / r)^(1/6)``.

References:
    Anderson, Moore, *Optimal Filtering*, 1979, ch. 4 (steady-state filter).
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, sec. 6.5
    (alpha-beta-gamma filter).
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import linalg, so3
from colift.math.pytree import pytree, static
from colift.models import grasp
from colift.models.parameters import Team
from colift.onboard.estimation import nav_filter
from colift.onboard.estimation.nav_filter import NavState, ReadingClock

Scalar = Float[Array, ""]

DECAY_RATE = 1.0
"""Decay rate of the residual's correlation [1/s], as in `kalman_correction`."""


@pytree
class PayloadFilterState:
    """Estimates besides pose and velocity, and the contact wrench of the previous control period."""

    omega: Float[Array, "3"]  # rad/s, angular velocity, payload frame
    residual: Float[Array, "6"]  # residual wrench, N world and N m payload frame
    wrench: Float[Array, "6"]  # contact wrench, N world and N m payload frame
    last_inputs: Float[Array, "periods 24"]  # inputs of the learned model, newest first, for the delay of the poses
    input_errors: Float[Array, "3 24"]  # inputs minus those with the lag of the residual, and their integrals


@pytree
class PayloadMotion:
    """Motion of the payload in one control period.

    Attributes:
        nav: Pose and velocity; with a clock their history, newest first.
        omega: Angular velocity [rad/s, payload frame].
        specific_force: Acceleration without gravity [m/s^2, world].
        omega_dot: Angular acceleration [rad/s^2, payload frame].
    """

    nav: NavState
    omega: Float[Array, "3"]
    specific_force: Float[Array, "3"]
    omega_dot: Float[Array, "3"]


@pytree
class PayloadFilter:
    """Steady-state Kalman filter of pose, velocity and residual wrench of the payload.

    Attitude and position have the same corner frequency, so that all labels of the payload have the same delay.

    Attributes:
        corner: Corner frequency [rad/s].
        pose_delay: Delay of the poses, in control periods.
    """

    corner: Scalar
    pose_delay: int = static(default=0)

    def label_delay(self, dt: float) -> Scalar:
        """Return the delay of the residual wrench: ``2 / corner`` and the delay of the poses [s].

        Args:
            dt: Control period [s].
        """
        return 2 / self.corner + self.pose_delay * dt

    def init(self, team: Team) -> PayloadFilterState:
        """Return the state at rest, in which the contact wrench balances gravity.

        Args:
            team: Nominal parameters.
        """
        weight = jnp.concatenate([-team.payload.mass * team.gravity, jnp.zeros(3)])
        return PayloadFilterState(
            omega=jnp.zeros(3),
            residual=jnp.zeros(6),
            wrench=weight,
            last_inputs=jnp.zeros((1 + self.pose_delay, 24)),
            input_errors=jnp.zeros((3, 24)),
        )

    def delay_inputs(
        self,
        state: PayloadFilterState,
        x: Float[Array, "24"],
        initialized: Scalar,
        dt: Scalar,
        clock: ReadingClock | None,
    ) -> tuple[Float[Array, "24"], PayloadFilterState]:
        """Filter the inputs of the learned model as the filter does the residual acceleration.

        The estimates follow from poses that are late by h. The filtered inputs are therefore those of ``t - h``. The
        estimation error ``(e_x, e_v, e_a)`` of a chain of integrators follows from the change of its input alone::

            e_x <- e_x + dt e_v + dt^2 e_a / 2,    e_v <- e_v + dt e_a,    e_a <- e_a + change of the input

        Each pose then subtracts the gains times ``e_x``. The filtered input is the delayed one minus ``e_a``.

        Args:
            state: State of the filter.
            x: Inputs of this control period.
            initialized: 0 in the first control period, which sets the steady state; 1 afterwards.
            dt: Control period [s].
            clock: Ages of the poses, and whether they are new; None if they are new in every control period.

        Returns:
            The filtered inputs, and the state.
        """
        e_x, e_v, e_a = state.input_errors
        last = jnp.concatenate([x[None], state.last_inputs])  # the oldest two have the age of the poses
        change = last[-2] - last[-1]
        predicted = jnp.stack([e_x + dt * e_v + dt * dt / 2 * e_a, e_v + dt * e_a, e_a + change])
        is_new, interval = (jnp.ones(()), dt) if clock is None else (clock.is_new[1], clock.elapsed[1])
        gains = is_new * correction_gains(self.corner, interval)
        errors = initialized * (predicted - gains[:, None] * predicted[:1])
        held = initialized * (last[:-1] - x[None]) + x[None]
        return held[-1] - errors[2], dataclasses.replace(state, last_inputs=held, input_errors=errors)

    def update(
        self,
        team: Team,
        previous: tuple[NavState, PayloadFilterState],
        measured: NavState,
        initialized: Scalar,
        dt: Scalar,
        clock: ReadingClock | None,
    ) -> tuple[PayloadMotion, PayloadFilterState]:
        """Predict over one control period, and correct by the poses that arrive in it.

        A pose of age h is compared with the estimate at ``t - h``. It corrects this estimate, and the later ones by the
        motion that follows from its correction. Earlier estimates are corrected like that at ``t - h``. Of the measured
        velocities only the first one is used, because motion capture derives velocities from poses.

        Args:
            team: Nominal parameters.
            previous: Pose and velocity (with a clock their history), and the state of the previous control period.
            measured: Measured pose and velocity.
            initialized: 0 in the first control period, in which pose and velocity are taken over; 1 afterwards.
            dt: Control period [s].
            clock: Ages of the poses, and whether they are new; None if they are new in every control period.

        Returns:
            The motion, and the state with the contact wrench unchanged.
        """
        nav, state = previous
        predicted, omega = _predict(team, nav_filter.newest(nav, clock), state, dt)
        if clock is None:
            history, now = jax.tree.map(lambda x: x[None], predicted), nav_filter.initial_clock()
            now = dataclasses.replace(now, elapsed=jnp.broadcast_to(dt, 3))
        else:
            history, now = nav_filter.shift(nav, predicted), clock
        sampled, used = nav_filter.sample_periods(now, len(history.x), dt)
        R_h, x_h = jnp.einsum("k,kij->ij", sampled[0], history.R), sampled[1] @ history.x
        e_R, e_x = used[0] * so3.vee(R_h.T @ measured.R), used[1] * (measured.x - x_h)
        times = jnp.arange(len(history.x), dtype=float) * dt
        since = now.age[:2, None] - times[None]  # s, from the sample to each estimate
        (angle, rate, acceleration_R), (shift, velocity, acceleration_x) = (
            _corrections(initialized * correction_gains(self.corner, interval), jnp.maximum(time, 0.0))
            for interval, time in zip(now.elapsed[:2], since, strict=True)
        )
        start = lambda given, corrected: given[None] + initialized * (corrected - given[None])  # noqa: E731
        fused = NavState(
            R=start(measured.R, so3.exp(angle[:, None] * (R_h @ e_R)[None]) @ history.R),
            x=start(measured.x, history.x + shift[:, None] * e_x[None]),
            v=start(measured.v, history.v + velocity[:, None] * e_x[None]),
        )
        e_now = history.R[0].T @ (R_h @ e_R)  # present payload frame
        omega = initialized * omega + rate[0] * e_now
        residual = state.residual + jnp.concatenate(
            [acceleration_x * team.payload.mass * e_x, acceleration_R * (team.payload.inertia @ e_now)]
        )
        next_state = dataclasses.replace(state, omega=omega, residual=residual)
        motion = PayloadMotion(
            nav=jax.tree.map(lambda x: x[0], fused) if clock is None else fused,
            omega=omega,
            specific_force=(state.wrench + residual)[:3] / team.payload.mass,
            omega_dot=_angular_acceleration(team, next_state),
        )
        return motion, next_state


def contact_wrench(
    team: Team, R: Float[Array, "3 3"], lam: tuple[Float[Array, "_agents _arms 3"], ...]
) -> Float[Array, "6"]:
    """Return the wrench of the contact forces on the payload [N world, N m payload frame].

    Args:
        team: Nominal parameters.
        R: Attitude of the payload, payload frame to world.
        lam: Contact forces on the payload [N, world], by group.
    """
    W = grasp.payload_wrench(grasp.contact_points(team), R, grasp.stack_contacts(lam))
    return jnp.concatenate([W.F, W.tau])


def _corrections(gains: Float[Array, "3"], time: Float[Array, "periods"]) -> tuple[Array, Array, Scalar]:
    """Return the corrections of pose, velocity and acceleration at a time after the sample, per pose error.

    A correction of velocity and acceleration at the sample moves the later estimates::

        k_1 + k_2 t + k_3 t^2 / 2,    k_2 + k_3 t,    k_3
    """
    k_1, k_2, k_3 = gains
    return k_1 + time * (k_2 + time * k_3 / 2), k_2 + time * k_3, k_3


def _angular_acceleration(team: Team, state: PayloadFilterState) -> Float[Array, "3"]:
    """Return ``J^-1 (tau + d_tau - w x J w)`` [rad/s^2, payload frame]."""
    J = team.payload.inertia
    moment = (state.wrench + state.residual)[3:] - so3.cross(state.omega, J @ state.omega)
    return linalg.solve(J, moment[:, None])[:, 0]


def _predict(team: Team, nav: NavState, state: PayloadFilterState, dt: Scalar) -> tuple[NavState, Float[Array, "3"]]:
    """Return pose, velocity and angular velocity after one control period with constant wrenches."""
    omega = state.omega + _angular_acceleration(team, state) * dt
    specific_force = nav.R.T @ (state.wrench + state.residual)[:3] / team.payload.mass
    return nav_filter.predict(nav, (state.omega + omega) / 2, specific_force, team.gravity, dt), omega


def correction_gains(corner: Scalar, interval: Scalar) -> Float[Array, "3"]:
    """Compute the gains of a chain of three integrators for one pose error.

    With the gains ``k`` the estimates of pose, velocity and acceleration after a correction have the poles
    ``z_i = exp(s_i T)``. Here ``s_i`` are the poles of a third-order Butterworth filter, and T is the time between two
    poses. Matching the characteristic polynomial gives::

        k_1 = 1 - z_1 z_2 z_3,    k_3 = (1 - z_1) (1 - z_2) (1 - z_3) / T^2
        k_2 = (3 - z_1 - z_2 - z_3 - k_1) / T - k_3 T / 2

    Args:
        corner: Corner frequency [rad/s].
        interval: Time T since the previous pose [s].

    Returns:
        Gains for pose [1], velocity [1/s] and acceleration [1/s^2].
    """
    angle = corner * interval
    real, radius = jnp.exp(-angle), jnp.exp(-angle / 2)
    pair, product = 2 * radius * jnp.cos(jnp.sqrt(3.0) / 2 * angle), radius * radius
    k_1 = 1 - real * product
    k_3 = (1 - real) * (1 - pair + product) / interval**2
    k_2 = (3 - real - pair - k_1) / interval - k_3 * interval / 2
    return jnp.stack([k_1, k_2, k_3])


def corner_frequency(residual_acceleration_std: float, noise_std: float, period: float) -> float:
    """Return the corner frequency of the steady-state Kalman filter [rad/s].

    The residual acceleration has the standard deviation `sigma` and the correlation ``exp(-lambda |t|)`` with
    `DECAY_RATE`. For times below ``1 / lambda`` it is a random walk, whose rate has the spectral density
    ``q = 2 lambda sigma^2``. White noise with the standard deviation s in poses of the period T has the spectral
    density ``r = s^2 T``.

    Args:
        residual_acceleration_std: Standard deviation `sigma` [m/s^2 or rad/s^2].
        noise_std: Standard deviation s of a pose [m or rad].
        period: Time T between two poses [s].
    """
    return float((2 * DECAY_RATE * residual_acceleration_std**2 / (noise_std**2 * period)) ** (1 / 6))
