"""Identification of rigid-body parameters of the payload by regularized least squares.

The inertial wrench of a rigid body is linear in ten parameters: mass, first moments of mass and moments of inertia.
Labels of the residual therefore identify the error of the nominal parameters. Identified parameters are limited so
that the inertia of the payload remains physically consistent.

References:
    Atkeson, An, Hollerbach, *Estimation of inertial parameters of manipulator loads and links*, 1986.
    Wensing, Kim, Slotine, *Linear matrix inequalities for physically consistent inertial parameter identification*,
    2018.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import block_diag, eigvalsh

from colift.math import so3
from colift.models.parameters import Payload
from colift.models.state import PayloadState


def inertial_regressor(q: PayloadState, a: Float[Array, "3"], alpha: Float[Array, "3"]) -> Float[Array, "6 10"]:
    """Compute the regressor ``Y`` of the inertial wrench of a rigid body.

    ``Y theta`` is the wrench ``F = m a + R (alpha x + w x (w x)) m c``, ``tau = m c x R^T a + J alpha + w x J w`` with
    the parameters ``theta = (m, m c, J_xx, J_yy, J_zz, J_xy, J_xz, J_yz)``. Here ``c`` is the center of mass and ``J``
    the inertia about the origin of the payload frame.

    Args:
        q: Payload state.
        a: Acceleration of the payload's origin minus gravity [m/s^2], world frame.
        alpha: Angular acceleration [rad/s^2], payload frame.

    Returns:
        Regressor of force [N, world frame] and moment [N m, payload frame].
    """
    w = q.omega
    turn = so3.hat(alpha) + so3.hat(w) @ so3.hat(w)
    zero = jnp.zeros((3, 1))
    force = jnp.concatenate([a[:, None], q.R @ turn, jnp.zeros((3, 6))], axis=1)
    moment = jnp.concatenate([zero, -so3.hat(q.R.T @ a), _symmetric(alpha) + so3.hat(w) @ _symmetric(w)], axis=1)
    return jnp.concatenate([force, moment])


def _symmetric(v: Float[Array, "3"]) -> Float[Array, "3 6"]:
    """Return ``S`` with ``S j = J v`` for ``j = (J_xx, J_yy, J_zz, J_xy, J_xz, J_yz)``."""
    x, y, z = v[0], v[1], v[2]
    o = jnp.zeros_like(x)
    return jnp.stack([x, o, o, y, z, o, o, y, o, x, o, z, o, o, z, o, x, y]).reshape(3, 6)


def inertial_regressors(X: np.ndarray) -> np.ndarray:
    """Compute the inertial regressors of payload samples, on the host.

    Args:
        X: Payload inputs in the order of `colift.models.state.flatten_payload_state`, accelerations included.

    Returns:
        Regressors of shape (samples, 6, 10).
    """
    q = jax.vmap(payload_state_from_input)(jnp.asarray(X))
    return np.asarray(jax.vmap(inertial_regressor)(q, jnp.asarray(X[:, 18:21]), jnp.asarray(X[:, 21:24])))


def identify_parameters(
    Phi: np.ndarray, Y: np.ndarray, K: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate parameters of a linear model by least squares with a Gaussian prior, on the host.

    The estimate minimizes ``sum_i e_i^T K_i^-1 e_i + |theta / prior|^2`` with the errors ``e = Y - Phi theta`` of
    output ``i``. Directions that the motion does not excite keep their prior.

    Args:
        Phi: Regressors of shape (samples, outputs, parameters).
        Y: Labels of shape (samples, outputs).
        K: Noise covariance of each output, of shape (outputs, samples, samples).
        prior: Prior standard deviation of each parameter.

    Returns:
        The parameters, and the posterior divided by the prior standard deviation (1: not excited).
    """
    A = (Phi * prior).swapaxes(0, 1)
    T = np.linalg.solve(K, A)
    H = np.einsum("inp,inq->pq", A, T) + np.eye(len(prior))
    return prior * np.linalg.solve(H, np.einsum("inp,ni->p", T, Y)), np.sqrt(np.diag(np.linalg.inv(H)))


def enforce_physical_consistency(theta: np.ndarray, nominal: Payload) -> np.ndarray:
    """Reduce identified parameters until the remaining inertia is physically consistent, on the host.

    The result satisfies ``M - M(theta) >= M / 10`` with the nominal spatial inertia ``M`` and
    ``M(theta) = [[m I, -hat(m c)], [hat(m c), J]]``. With a negative inertia, commands would act in the wrong
    direction for all gains. One common factor reduces the moments of inertia ``J``, which are the least certain
    parameters. If no factor is sufficient, it reduces ``J`` and ``m c``; if this is not sufficient either, it reduces
    all parameters.

    Args:
        theta: Nominal minus true rigid-body parameters, in the order of `inertial_regressor`.
        nominal: Nominal payload.

    Returns:
        The limited parameters.
    """
    M = block_diag(float(nominal.mass) * np.eye(3), nominal.inertia)
    for first in (4, 1, 0):
        kept, scaled = np.where(np.arange(10) < first, theta, 0.0), np.where(np.arange(10) < first, 0.0, theta)
        margin = 0.9 * M - _spatial_inertia(kept)
        if eigvalsh(margin)[0] > 0:
            break
    return kept + scaled / max(1.0, eigvalsh(_spatial_inertia(scaled), margin)[-1])


def _spatial_inertia(theta: np.ndarray) -> np.ndarray:
    """Return ``M(theta)`` of `enforce_physical_consistency`."""
    h, (xx, yy, zz, xy, xz, yz) = np.asarray(so3.hat(jnp.asarray(theta[1:4]))), theta[4:]
    return np.block([[theta[0] * np.eye(3), -h], [h, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])]])


def payload_state_from_input(x: Float[Array, "24"]) -> PayloadState:
    """Return the payload state of a payload input.

    Args:
        x: Payload input in the order of `colift.models.state.flatten_payload_state`.

    Returns:
        The state part of the input.
    """
    return PayloadState(p=x[:3], v=x[3:6], R=x[6:15].reshape(3, 3), omega=x[15:18])
