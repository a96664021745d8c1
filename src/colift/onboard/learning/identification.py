"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
"""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import block_diag, eigvalsh

from colift.math import so3
from colift.models.parameters import Payload
from colift.models.state import PayloadState

T = TypeVar("T")


def inertial_regressor(q: PayloadState, a: Float[Array, "3"], alpha: Float[Array, "3"]) -> Float[Array, "6 10"]:
    """`Y` with `Y theta` the inertial wrench of a rigid body, theta = (m, m c, J_xx, J_yy, J_zz, J_xy, J_xz, J_yz).

    `F = m a + R (alpha x + w x (w x)) m c`, `tau = m c x R^T a + J alpha + w x J w`, `a` the acceleration of the
    payload's frame less gravity (world), `J` about its origin. Linear in theta; used for the remark on mean functions.
    """
    w = q.omega
    turn = so3.hat(alpha) + so3.hat(w) @ so3.hat(w)
    zero = jnp.zeros((3, 1))
    force = jnp.concatenate([a[:, None], q.R @ turn, jnp.zeros((3, 6))], axis=1)
    moment = jnp.concatenate([zero, -so3.hat(q.R.T @ a), _symmetric(alpha) + so3.hat(w) @ _symmetric(w)], axis=1)
    return jnp.concatenate([force, moment])


def _symmetric(v: Float[Array, "3"]) -> Float[Array, "3 6"]:
    """`S` with `S j = J v` for `j = (J_xx, J_yy, J_zz, J_xy, J_xz, J_yz)`."""
    x, y, z = v[0], v[1], v[2]
    o = jnp.zeros_like(x)
    return jnp.stack([x, o, o, y, z, o, o, y, o, x, o, z, o, o, z, o, x, y]).reshape(3, 6)


def inertial_regressors(X: np.ndarray) -> np.ndarray:
    """`Y(x)`, (samples, 6, 10), at payload samples (host)."""
    q = jax.vmap(payload_state_from_input)(jnp.asarray(X))
    return np.asarray(jax.vmap(inertial_regressor)(q, jnp.asarray(X[:, 18:21]), jnp.asarray(X[:, 21:24])))


def identify_parameters(
    Phi: np.ndarray, Y: np.ndarray, K: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Parameters from labels, by least squares with a prior deviation on each parameter (host).

    Minimizes `sum_i e_i^T K_i^-1 e_i + |theta / prior|^2`, e the errors `Y - Phi theta` and K_i the covariance of
    output i's, `(outputs, samples, samples)`; a direction that the motion does not excite keeps its prior. Returns
    theta and, per parameter, how much of the prior's deviation remains (1: not excited).
    """
    A = (Phi * prior).swapaxes(0, 1)
    T = np.linalg.solve(K, A)
    H = np.einsum("inp,inq->pq", A, T) + np.eye(len(prior))
    return prior * np.linalg.solve(H, np.einsum("inp,ni->p", T, Y)), np.sqrt(np.diag(np.linalg.inv(H)))


def enforce_physical_consistency(theta: np.ndarray, nominal: Payload) -> np.ndarray:
    """`theta` as far as it leaves a body, `M - M(theta) >= M / 10` (host).

    M is the `(6, 6)` inertia of the payload as believed, `M(theta) = [[m I, -hat(m c)], [hat(m c), J]]`. What is told
    least goes first: J is scaled down, then `m c` with it, then all. Where less than nothing is left a command pushes
    the wrong way, whatever the gains.
    """
    M = block_diag(float(nominal.mass) * np.eye(3), nominal.inertia)
    for first in (4, 1, 0):
        stays, goes = np.where(np.arange(10) < first, theta, 0.0), np.where(np.arange(10) < first, 0.0, theta)
        room = 0.9 * M - _spatial(stays)
        if eigvalsh(room)[0] > 0:
            break
    return stays + goes / max(1.0, eigvalsh(_spatial(goes), room)[-1])


def _spatial(theta: np.ndarray) -> np.ndarray:
    h, (xx, yy, zz, xy, xz, yz) = np.asarray(so3.hat(jnp.asarray(theta[1:4]))), theta[4:]
    return np.block([[theta[0] * np.eye(3), -h], [h, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])]])


def payload_state_from_input(x: Float[Array, "24"]) -> PayloadState:
    """Of a payload sample."""
    return PayloadState(p=x[:3], v=x[3:6], R=x[6:15].reshape(3, 3), omega=x[15:18])
