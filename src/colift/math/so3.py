"""Rotations: hat, exp, log and the attitude errors of the paper.

Every function takes and returns arrays whose last axis (or two) is the geometry; leading axes are batch.
Rotation matrices map body to world. Small angles use series whose derivatives are finite.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Vector = Float[Array, "*#batch 3"]  # leading axes broadcast
Rotation = Float[Array, "*#batch 3 3"]

SMALL_ANGLE_SQUARED = 1e-4  # rad^2; below it the series used are exact to rounding


@jax.jit
def cross(a: Vector, b: Vector) -> Vector:
    """`a x b`, broadcasting the leading axes."""
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    b1, b2, b3 = b[..., 0], b[..., 1], b[..., 2]
    return jnp.stack([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1], axis=-1)


def identity(batch: tuple[int, ...] = ()) -> Rotation:
    """The identity rotation on the given leading axes."""
    return jnp.broadcast_to(jnp.eye(3), (*batch, 3, 3))


@jax.jit
def hat(a: Vector) -> Float[Array, "*#batch 3 3"]:
    """The skew matrix with `hat(a) b = a x b`."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    o = jnp.zeros_like(x)
    return jnp.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*a.shape, 3)


@jax.jit
def vee(A: Float[Array, "*#batch 3 3"]) -> Vector:
    """The inverse of `hat` on skew matrices; of any matrix, the vector of its skew part."""
    S = (A - jnp.swapaxes(A, -1, -2)) / 2
    return jnp.stack([S[..., 2, 1], S[..., 0, 2], S[..., 1, 0]], axis=-1)


@jax.jit
def exp(theta: Vector) -> Rotation:
    """`exp(hat(theta))` by Rodrigues' formula, `cos t I + sin t hat(theta) / t + (1 - cos t) theta theta^T / t^2`."""
    t2 = (theta * theta).sum(-1)
    small = t2 < SMALL_ANGLE_SQUARED
    t = jnp.sqrt(jnp.where(small, 1.0, t2))
    sinc = jnp.where(small, 1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42)), jnp.sin(t) / t)
    cosc = jnp.where(small, 0.5 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56))), 2 * (jnp.sin(t / 2) / t) ** 2)
    return _rodrigues(theta, 1 - t2 * cosc, sinc, cosc)


@jax.jit
def from_axis_angle(axis: Vector, angle: Float[Array, "*#batch"]) -> Rotation:
    """The rotation by an angle, rad, about a unit vector: `exp` without its small-angle branch."""
    return _rodrigues(axis, jnp.cos(angle), jnp.sin(angle), 1 - jnp.cos(angle))


def _rodrigues(
    a: Vector, cos: Float[Array, "*#batch"], sin: Float[Array, "*#batch"], versine: Float[Array, "*#batch"]
) -> Rotation:
    skew = sin[..., None, None] * hat(a)
    return (
        cos[..., None, None] * identity(a.shape[:-1])
        + skew
        + versine[..., None, None] * a[..., :, None] * a[..., None, :]
    )


@jax.jit
def log(R: Rotation) -> Vector:
    """The rotation vector of R, angle in [0, pi), through the unit quaternion (stable near pi)."""
    q = quaternion(R)
    w, v = q[..., 0], q[..., 1:]
    n2 = (v * v).sum(-1)
    small = n2 < SMALL_ANGLE_SQUARED
    n = jnp.sqrt(jnp.where(small, 1.0, n2))
    # 2 asin(n) / n, by its series near zero
    series = 2 * (1 + n2 / 6 + 3 * n2 * n2 / 40 + 15 * n2**3 / 336)
    return jnp.where(small, series, 2 * jnp.arctan2(n, w) / n)[..., None] * v


def quaternion(R: Rotation) -> Float[Array, "*#batch 4"]:
    """Unit quaternion `(w, x, y, z)`, `w >= 0`, from the best conditioned of the four formulas."""
    m = lambda i, j: R[..., i, j]  # noqa: E731
    trace = m(0, 0) + m(1, 1) + m(2, 2)
    # 4 q q^T, row by row (Bar-Itzhack's matrix): every row is a multiple of q
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
    """One Newton step to the nearest rotation, `R (3 I - R^T R) / 2`: removes rounding, squares the error."""
    return R @ (3 * identity(R.shape[:-2]) - jnp.swapaxes(R, -1, -2) @ R) / 2


@jax.jit
def e_R(R: Rotation, R_d: Rotation) -> Vector:
    """Attitude error `(R_d^T R - R^T R_d)^vee / 2` (Section IV-B)."""
    return vee(jnp.swapaxes(R_d, -1, -2) @ R)


def e_omega(R: Rotation, omega: Vector, R_d: Rotation, omega_d: Vector) -> Vector:
    """Body-rate error `omega - R^T R_d omega_d` in the frame of R, rad/s (Section IV-B)."""
    return omega - ((jnp.swapaxes(R, -1, -2) @ R_d) * omega_d[..., None, :]).sum(-1)


def attitude_error_function(R: Rotation, R_d: Rotation) -> Float[Array, "*#batch"]:
    """Attitude error function `tr(I - R_d^T R) / 2`, in [0, 2] (Section IV-B)."""
    return (3 - (R_d * R).sum((-1, -2))) / 2


def attitude_error_jacobian(R: Rotation, R_d: Rotation) -> Float[Array, "*#batch 3 3"]:
    """The matrix of `d/dt e_R = E e_omega`: `(tr(Q) I - Q) / 2` with `Q = R^T R_d` (Eq. pl_cl_eR)."""
    Q = jnp.swapaxes(R, -1, -2) @ R_d
    return (jnp.trace(Q, axis1=-2, axis2=-1)[..., None, None] * identity(R.shape[:-2]) - Q) / 2
