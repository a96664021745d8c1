"""Rotations in SO(3): hat, exponential, logarithm, and the attitude errors of the paper.

The last one or two axes of every array are the vector or matrix; leading axes are batch axes. Rotation matrices map
body coordinates to world coordinates. Series expansions at small angles keep values and derivatives finite.

References:
    Lee, Leok, McClamroch, *Geometric tracking control of a quadrotor UAV on SE(3)*, CDC 2010.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Vector = Float[Array, "*#batch 3"]
"""Vector; leading axes are broadcast."""
Rotation = Float[Array, "*#batch 3 3"]
"""Rotation matrix; leading axes are broadcast."""

SMALL_ANGLE_SQUARED = 1e-4
"""Squared angle [rad^2] below which series are used; their error is below rounding there."""


@jax.jit
def cross(a: Vector, b: Vector) -> Vector:
    """Compute the cross products `a x b`; leading axes are broadcast."""
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    b1, b2, b3 = b[..., 0], b[..., 1], b[..., 2]
    return jnp.stack([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1], axis=-1)


def identity(batch: tuple[int, ...] = ()) -> Rotation:
    """Return identity rotations.

    Args:
        batch: Leading axes.
    """
    return jnp.broadcast_to(jnp.eye(3), (*batch, 3, 3))


@jax.jit
def hat(a: Vector) -> Float[Array, "*#batch 3 3"]:
    """Return the skew-symmetric matrix with `hat(a) b = a x b`."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    o = jnp.zeros_like(x)
    return jnp.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*a.shape, 3)


@jax.jit
def vee(A: Float[Array, "*#batch 3 3"]) -> Vector:
    """Return the vector of the skew-symmetric part of a matrix; the inverse of `hat` for skew-symmetric matrices."""
    S = (A - jnp.swapaxes(A, -1, -2)) / 2
    return jnp.stack([S[..., 2, 1], S[..., 0, 2], S[..., 1, 0]], axis=-1)


@jax.jit
def exp(theta: Vector) -> Rotation:
    """Compute the rotation of a rotation vector by Rodrigues' formula.

    `exp(hat(theta)) = cos t I + sin t hat(theta) / t + (1 - cos t) theta theta^T / t^2` with `t = |theta|`.

    Args:
        theta: Rotation vector [rad].

    Returns:
        Rotation matrix.
    """
    t2 = (theta * theta).sum(-1)
    small = t2 < SMALL_ANGLE_SQUARED
    t = jnp.sqrt(jnp.where(small, 1.0, t2))
    sinc = jnp.where(small, 1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42)), jnp.sin(t) / t)
    cosc = jnp.where(small, 0.5 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56))), 2 * (jnp.sin(t / 2) / t) ** 2)
    return _rodrigues(theta, 1 - t2 * cosc, sinc, cosc)


@jax.jit
def from_axis_angle(axis: Vector, angle: Float[Array, "*#batch"]) -> Rotation:
    """Compute the rotation by an angle about an axis; unlike `exp` it has no branch for small angles.

    Args:
        axis: Unit vector.
        angle: Angle [rad].

    Returns:
        Rotation matrix.
    """
    return _rodrigues(axis, jnp.cos(angle), jnp.sin(angle), 1 - jnp.cos(angle))


def _rodrigues(
    a: Vector, cos: Float[Array, "*#batch"], sin: Float[Array, "*#batch"], versine: Float[Array, "*#batch"]
) -> Rotation:
    """Evaluate Rodrigues' formula for a vector and the coefficients of its three terms."""
    skew = sin[..., None, None] * hat(a)
    return (
        cos[..., None, None] * identity(a.shape[:-1])
        + skew
        + versine[..., None, None] * a[..., :, None] * a[..., None, :]
    )


@jax.jit
def log(R: Rotation) -> Vector:
    """Compute the rotation vector of a rotation, by its unit quaternion; accurate also near an angle of pi.

    Args:
        R: Rotation matrix.

    Returns:
        Rotation vector with a length in [0, pi) [rad].
    """
    q = quaternion(R)
    w, v = q[..., 0], q[..., 1:]
    n2 = (v * v).sum(-1)
    small = n2 < SMALL_ANGLE_SQUARED
    n = jnp.sqrt(jnp.where(small, 1.0, n2))
    # series of 2 asin(n) / n near zero
    series = 2 * (1 + n2 / 6 + 3 * n2 * n2 / 40 + 15 * n2**3 / 336)
    return jnp.where(small, series, 2 * jnp.arctan2(n, w) / n)[..., None] * v


def quaternion(R: Rotation) -> Float[Array, "*#batch 4"]:
    """Compute the unit quaternion of a rotation from the best conditioned of four formulas (Bar-Itzhack 2000).

    Args:
        R: Rotation matrix.

    Returns:
        Quaternion `(w, x, y, z)` with `w >= 0`.
    """
    m = lambda i, j: R[..., i, j]  # noqa: E731
    trace = m(0, 0) + m(1, 1) + m(2, 2)
    # 4 q q^T by rows: every row is a multiple of q, and the longest one is the best conditioned
    rows = jnp.stack(
        [
            jnp.stack([1 + trace, m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1)], -1),
            jnp.stack([m(2, 1) - m(1, 2), 1 + 2 * m(0, 0) - trace, m(0, 1) + m(1, 0), m(0, 2) + m(2, 0)], -1),
            jnp.stack([m(0, 2) - m(2, 0), m(0, 1) + m(1, 0), 1 + 2 * m(1, 1) - trace, m(1, 2) + m(2, 1)], -1),
            jnp.stack([m(1, 0) - m(0, 1), m(0, 2) + m(2, 0), m(1, 2) + m(2, 1), 1 + 2 * m(2, 2) - trace], -1),
        ],
        -2,
    )
    best = jnp.argmax((rows * rows).sum(-1), axis=-1)
    q = jnp.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / jnp.sqrt((q * q).sum(-1))[..., None]
    return jnp.where(q[..., :1] < 0, -q, q)


def orthonormalize(R: Rotation) -> Rotation:
    """Apply one Newton step towards the nearest rotation, `R (3 I - R^T R) / 2`.

    Args:
        R: Matrix close to a rotation, for example after rounding errors.

    Returns:
        Matrix whose distance from a rotation is of the order of the squared distance of R.
    """
    return R @ (3 * identity(R.shape[:-2]) - jnp.swapaxes(R, -1, -2) @ R) / 2


@jax.jit
def e_R(R: Rotation, R_d: Rotation) -> Vector:
    """Compute the attitude error `(R_d^T R - R^T R_d)^vee / 2` (Section IV-B).

    Args:
        R: Attitude, body to world.
        R_d: Desired attitude, body to world.

    Returns:
        Attitude error, the sine of the error angle times its axis [body frame].
    """
    return vee(jnp.swapaxes(R_d, -1, -2) @ R)


def e_omega(R: Rotation, omega: Vector, R_d: Rotation, omega_d: Vector) -> Vector:
    """Compute the angular velocity error `omega - R^T R_d omega_d` (Section IV-B).

    Args:
        R: Attitude, body to world.
        omega: Angular velocity [rad/s, body frame].
        R_d: Desired attitude, body to world.
        omega_d: Desired angular velocity [rad/s, desired body frame].

    Returns:
        Angular velocity error [rad/s, body frame].
    """
    return omega - ((jnp.swapaxes(R, -1, -2) @ R_d) * omega_d[..., None, :]).sum(-1)


def attitude_error_function(R: Rotation, R_d: Rotation) -> Float[Array, "*#batch"]:
    """Compute the attitude error function `Psi = tr(I - R_d^T R) / 2` (Section IV-B).

    Args:
        R: Attitude, body to world.
        R_d: Desired attitude, body to world.

    Returns:
        `1 - cos(angle)`, in [0, 2].
    """
    return (3 - (R_d * R).sum((-1, -2))) / 2


def attitude_error_jacobian(R: Rotation, R_d: Rotation) -> Float[Array, "*#batch 3 3"]:
    """Compute the matrix E of `d/dt e_R = E e_omega` (Eq. pl_cl_eR): `(tr(Q) I - Q) / 2` with `Q = R^T R_d`.

    Args:
        R: Attitude, body to world.
        R_d: Desired attitude, body to world.

    Returns:
        The matrix E.
    """
    Q = jnp.swapaxes(R, -1, -2) @ R_d
    return (jnp.trace(Q, axis1=-2, axis2=-1)[..., None, None] * identity(R.shape[:-2]) - Q) / 2


def is_rotation(R: np.ndarray, tolerance: float) -> bool:
    """Test whether a matrix is a rotation (host).

    Args:
        R: Matrix `(3, 3)`.
        tolerance: Largest entry of `R^T R - I`.

    Returns:
        Whether the matrix is orthogonal to the tolerance and has a positive determinant.
    """
    return bool(np.abs(R.T @ R - np.eye(3)).max() <= tolerance and np.linalg.det(R) > 0)
