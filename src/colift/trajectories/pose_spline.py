"""Piecewise reference trajectory: polynomials in position, and legs on SO(3) in attitude.

The attitude of a leg is a rotation relative to its start, in the payload frame. A rotation of the world therefore
leaves the angular velocity unchanged, and any number of turns is possible.

See Also:
    colift.trajectories.minimum_snap: the spline through waypoints.
    colift.trajectories.smoothing_spline: the spline of a table of poses.
    docs/references: derivation.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from colift.math import so3
from colift.math.linalg import matmul
from colift.math.pytree import pytree
from colift.trajectories.base import PayloadSetpoint, differentiate_motion

Scalar = Float[Array, ""]


@pytree
class PiecewisePolynomial:
    """Polynomials of degree 7, `x(t) = sum_k c_k s^k` with `s = t - t_i` on `[t_i, t_(i+1)]`."""

    knots: Float[Array, "knots"]  # s, ascending
    coefficients: Float[Array, "legs 8 3"]  # by leg and power k, in the unit of x per s^k

    def value(self, t: Scalar) -> tuple[Int[Array, ""], Float[Array, "3"]]:
        """Evaluate the polynomial at a time.

        Args:
            t: Time [s]; the polynomial is constant outside the knots.

        Returns:
            Leg and value.
        """
        i = jnp.clip((t >= self.knots).sum() - 1, 0, len(self.knots) - 2)
        c, s = self.coefficients[i], jnp.clip(t, self.knots[0], self.knots[-1]) - self.knots[i]
        value = c[-1]
        for k in reversed(range(c.shape[0] - 1)):
            value = c[k] + s * value
        return i, value


@pytree
class RotationLegs:
    """Attitude by legs, `R(t) = R_i exp(phi_i(t))`, with a polynomial rotation vector for each leg.

    `rotation_legs.rotation_legs` computes the polynomials from attitudes, angular velocities, accelerations and their
    rates at the knots, which are then continuous.

    References:
        Park, Kang, *Smooth invariant interpolation of rotations*, ACM Transactions on Graphics 16, 1997.
    """

    phi: PiecewisePolynomial  # rad, payload frame; zero at the start of each leg
    R: Float[Array, "legs 3 3"]  # attitude at the start of each leg, payload to world

    def value(self, t: Scalar) -> Float[Array, "3 3"]:
        """Evaluate the attitude.

        Args:
            t: Time [s]; the attitude is constant outside the knots.

        Returns:
            Attitude, payload to world.
        """
        i, phi = self.phi.value(t)
        return matmul(self.R[i], so3.exp(phi))


@pytree
class PoseSpline:
    """Reference trajectory with a piecewise polynomial in position and rotation legs in attitude.

    The pose is constant before the first knot and after the last one. `minimum_snap` and `fit_samples` build it.
    """

    position: PiecewisePolynomial  # m, world
    attitude: RotationLegs  # payload to world

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """Compute the setpoint at time t [s]; see `ReferenceTrajectory`."""
        return differentiate_motion(lambda t: self.position.value(t)[1], self.attitude.value, t)
