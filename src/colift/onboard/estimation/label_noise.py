"""Noise of the labels of the agents from the noise of the sensors.

White noise of inertial sensors, velocities and encoders enters the equations of motion through momenta that are
differenced over one control period. Joint rates follow from the grasp (`state_estimator.joint_rates`). The noise of the
payload's gyroscope is therefore in the labels of all agents.

Contact forces are averaged by double exponential smoothing with the stages ``s_1``, ``s_2`` of the label filter. The
average ``2 s_1 - s_2`` has no lag for ramps beyond that of the tip force filter.

Correlations between agents and the noise of the payload's equations of motion are neglected.

References:
    Brown, *Smoothing, Forecasting and Prediction of Discrete Time Series*, 1963, ch. 9.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.filters import smoothing_factor
from colift.math.pytree import pytree
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import PayloadState
from colift.onboard.estimation import state_estimator
from colift.onboard.estimation.nav_filter import FilterBandwidths, NavState

Scalar = Float[Array, ""]
MEMORY = 20.0
"""Length of impulse responses, in time constants of the slowest filter."""


@pytree
class NoiseSources:
    """Standard deviations of white sensor noise in one control period.

    Attributes:
        angular_velocity: Gyroscopes [rad/s].
        acceleration: Accelerometers [m/s^2].
        velocity: Velocities [m/s].
        joint_position: Encoders [rad or m].
    """

    angular_velocity: Scalar
    acceleration: Scalar
    velocity: Scalar
    joint_position: Scalar


def covariances(
    team: Team,
    R: tuple[Float[Array, "_agents 3 3"], ...],
    R_L: Float[Array, "3 3"],
    r: tuple[Float[Array, "_agents _n_r"], ...],
    sensors: NoiseSources,
    filters: FilterBandwidths,
    dt: float,
) -> tuple[Float[Array, "_agents _outputs _outputs"], ...]:
    """Return the covariances of the noise of averaged labels without contact forces, of a team at rest (host).

    With the Jacobians ``J_s`` of the label before its filters with respect to source s, and the impulse responses
    ``g_s`` of its filters, the covariance is ``sum_s sigma_s^2 |g_s|^2 J_s J_s^T``.

    Args:
        team: Nominal parameters.
        R: Attitudes of the agents, body to world, by group.
        R_L: Attitude of the payload, payload frame to world.
        r: Joint positions [rad or m], by group.
        sensors: Noise of the sensors.
        filters: Corner frequencies.
        dt: Control period [s].

    Returns:
        Covariances by group, with outputs in N and N m.
    """
    weights = jax.tree.map(lambda std, gain: (std * gain) ** 2, sensors, _gains(filters, dt))
    return tuple(
        _covariances(group, attitude, R_L, joints, weights)
        for group, attitude, joints in zip(team.agent_groups, R, r, strict=True)
    )


def _gains(filters: FilterBandwidths, dt: float) -> NoiseSources:
    """Return the norms of the impulse responses from each sensor to the momenta's rate after all filters."""
    from scipy.signal import lfilter  # here, because it takes long to import

    slowest = min(float(f) for f in (filters.complementary, filters.joint, filters.label, filters.tip_force))
    impulse = np.zeros(int(MEMORY / (2 * np.pi * slowest * dt)) + 2)
    impulse[0] = 1

    def low_pass(x: np.ndarray, hertz: Scalar) -> np.ndarray:
        b = float(smoothing_factor(hertz, jnp.asarray(dt)))
        return lfilter([b], [1, b - 1], x)

    def rate(x: np.ndarray) -> np.ndarray:
        return np.diff(x, prepend=0.0) / dt

    def norm(x: np.ndarray) -> Scalar:
        first = low_pass(low_pass(x, filters.tip_force), filters.label)
        return jnp.asarray(np.linalg.norm(2 * first - low_pass(first, filters.label)))

    encoder = low_pass(low_pass(impulse, filters.joint), filters.joint)
    return NoiseSources(
        angular_velocity=norm(rate(impulse)),
        acceleration=norm(impulse),
        velocity=norm(rate(low_pass(impulse, filters.complementary))),
        joint_position=norm(rate(rate(encoder))),
    )


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, 0, None, 0, None))
def _covariances(
    agent: AerialManipulator,
    R: Float[Array, "3 3"],
    R_L: Float[Array, "3 3"],
    r: Float[Array, "n_r"],
    weights: NoiseSources,
) -> Float[Array, "outputs outputs"]:
    """Return the covariance of one agent, for the variances of each source after the filters."""
    g = aerial_manipulator.forward_kinematics(agent, r)
    p = aerial_manipulator.centroidal_model(agent, g)
    zero = jnp.zeros(3)

    def momenta(omega: Array, omega_L: Array, v: Array, v_L: Array, encoder_rate: Array) -> Array:
        payload = PayloadState(R=R_L, p=zero, omega=omega_L, v=v_L)
        rates = state_estimator.joint_rates(agent, g, NavState(R=R, x=zero, v=v), omega, payload, encoder_rate)
        xi = jnp.concatenate([omega, rates])
        return jnp.concatenate([-p.mass * (R @ (p.J_base @ xi)), p.M_bar @ xi])

    omega, omega_L, v, v_L, encoder = jax.jacfwd(momenta, argnums=(0, 1, 2, 3, 4))(
        zero, zero, zero, zero, jnp.zeros_like(r)
    )
    acceleration = v.at[:3].add(p.mass * jnp.eye(3))  # accelerometers also predict the velocities
    square = lambda J: J @ J.T  # noqa: E731
    return (
        weights.angular_velocity * (square(omega) + square(omega_L))
        + weights.acceleration * (square(acceleration) + square(v_L))
        + weights.velocity * (square(v) + square(v_L))
        + weights.joint_position * square(encoder)
    )
