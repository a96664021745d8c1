"""Linear allocation of a payload wrench to contact forces, with internal forces.

In the payload frame the grasp matrix `G = [I ...; hat(c) ...]` is constant. A right inverse and a basis of its null
space are therefore computed once. All allocations here are an `AllocationMap`.

See Also:
    docs/decisions/0005-general-force-allocation: reasons for the allocations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import linalg
from colift.math.pytree import pytree
from colift.models import grasp
from colift.models.state import Wrench

MAX_CONDITION = 1e8
"""Largest condition number of a grasp block; above it, unit wrenches require contact forces that no arm can apply."""
RANK_REGULARIZATION = 1e-9
"""Regularization of `G D G^T` relative to its trace; the forces of three contacts change by less than 1e-6 of them."""


@pytree
class AllocationMap:
    """Linear map `lam = right_inverse W + nullspace eta + offset`, in the payload frame, contacts stacked.

    `LinearAllocator` adds `yaw_gain f` for the residual yaw torques f of agents with rotors.
    """

    right_inverse: Float[Array, "rows 6"]  # right inverse of the grasp matrix, forces [N] and moments [N m] to forces
    nullspace: Float[Array, "rows eta"]  # orthonormal basis, G nullspace = 0
    offset: Float[Array, "rows"]  # N, payload frame, constant internal force lam_f0 of Eq. follower_force
    yaw_gain: Float[Array, "rows agents"] | None = None  # 1/m, internal forces per residual yaw torque; None: not used


class YawTorques(NamedTuple):
    """Yaw torques `tau = levers lam - f` that agents in hover require, with the residual yaw torques f.

    Attributes:
        levers: Moments about the vertical through each base, one row per agent, for contact forces in the payload
            frame, contacts stacked [m].
        moment_ratio: Ratio of reaction torque to force of a rotor, `c_M` [m].
    """

    levers: np.ndarray
    moment_ratio: float

    def thrust_rows(self) -> np.ndarray:
        """Return the map from contact forces to the thrusts that the rotor forces of these torques could generate."""
        return self.levers / self.moment_ratio


def allocate(
    allocation: AllocationMap, R: Float[Array, "3 3"], W: Wrench, eta: Float[Array, " eta"]
) -> Float[Array, "contacts 3"]:
    """Compute contact forces for a payload wrench; `G lam = W` for all eta (Lemma wrench_consistency).

    Args:
        allocation: Linear map.
        R: Payload attitude, payload to world.
        W: Payload wrench [N world, N m payload frame].
        eta: Internal-force input [N].

    Returns:
        Contact forces on the payload [N, world].
    """
    W_L = jnp.concatenate([R.T @ W.F, W.tau])
    lam = allocation.right_inverse @ W_L + allocation.nullspace @ eta + allocation.offset
    return lam.reshape(-1, 3) @ R.T


def allocate_to_closed_contacts(
    c: Float[Array, "contacts 3"],
    closed: Float[Array, " contacts"],
    R: Float[Array, "3 3"],
    W: Wrench,
    lam: Float[Array, "contacts 3"],
) -> Float[Array, "contacts 3"]:
    """Compute the contact forces nearest to given ones that apply a wrench without open contacts.

    `lam_c = D (lam + G^T (G D G^T)^-1 (W - G D lam))`, with 1 for closed and 0 for open contacts on the diagonal of D.
    `G D G^T` is regularized, so that a grasp of rank below 6 gives finite forces.

    Args:
        c: Contact points, one per row [m, payload frame].
        closed: 1 for closed and 0 for open contacts.
        R: Payload attitude, payload to world.
        W: Payload wrench [N world, N m payload frame].
        lam: Contact forces, which are returned if all contacts are closed [N, world].

    Returns:
        Contact forces on the payload [N, world].
    """
    G, share = grasp.grasp_matrix(c, R), jnp.repeat(closed, 3)
    x = share * lam.reshape(-1)
    A = linalg.matmul(share[None] * G, G.T)
    A = A + RANK_REGULARIZATION * jnp.trace(A) * jnp.eye(6)
    missing = jnp.concatenate([W.F, W.tau]) - linalg.matvec(G, x)
    x = x + share * linalg.matvec(G.T, linalg.solve(A, missing[:, None])[:, 0])
    return jnp.where((closed > 0).all(), lam, x.reshape(-1, 3))


def least_squares_allocation(c: np.ndarray) -> AllocationMap:
    """Build the least-squares allocation over all contacts, `lam = G^+ W + Z eta` with Z a basis of `ker G`.

    Raises ValueError if the contacts cannot apply every wrench: fewer than three contacts, or collinear contacts.

    Args:
        c: Contact points, one per row [m, payload frame].

    Returns:
        The allocation.
    """
    G = grasp.payload_frame_grasp_matrix(c)
    _require_rank(G, "the grasp", range(len(c)))
    return AllocationMap(
        right_inverse=jnp.asarray(np.linalg.pinv(G)),
        nullspace=jnp.asarray(grasp.grasp_nullspace(c)),
        offset=jnp.zeros(3 * len(c)),
    )


def rotor_allocation(c: np.ndarray, yaw: YawTorques) -> AllocationMap:
    """Build the allocation that minimizes squared contact forces and squared yaw torques of the agents.

    Rotors generate a yaw torque tau by forces that could generate the thrust `tau / c_M`. With the yaw torques
    `Y lam - f`, the contact forces minimize::

        |lam|^2 + |(Y lam - f) / c_M|^2    subject to G lam = W

    Args:
        c: Contact points, one per row [m, payload frame].
        yaw: Yaw torques.

    Returns:
        The allocation; its `yaw_gain` maps f to contact forces.

    Raises:
        ValueError: If the contacts cannot apply every wrench.
    """
    base, rows = least_squares_allocation(c), yaw.thrust_rows()
    G, Z = grasp.payload_frame_grasp_matrix(c), np.asarray(base.nullspace)
    H = np.eye(3 * len(c)) + rows.T @ rows
    weighted = np.linalg.solve(H, G.T)
    gain = Z @ np.linalg.solve(Z.T @ H @ Z, Z.T @ rows.T) / yaw.moment_ratio
    return AllocationMap(
        right_inverse=jnp.asarray(weighted @ np.linalg.inv(G @ weighted)),
        nullspace=base.nullspace,
        offset=base.offset,
        yaw_gain=jnp.asarray(gain),
    )


def leader_follower_allocation(
    c: np.ndarray, leaders: Sequence[int], lam_f0: np.ndarray | None = None
) -> AllocationMap:
    """Build the leader-follower allocation of the paper.

    Leader contacts apply the wrench, `lam_l = G_l^+ W` (Eq. leader_force). Follower contacts apply internal forces,
    `lam_f = lam_f0 + N(G_f) eta` (Eq. follower_force).

    Args:
        c: Contact points, one per row [m, payload frame].
        leaders: Rows of `c` that are leader contacts.
        lam_f0: Constant internal force, one row per follower contact in the order of `c` [N, payload frame]; None for
            zero.

    Returns:
        The allocation.

    Raises:
        ValueError: If the leader block has a rank below 6, a leader is repeated or does not exist, or `lam_f0` is not
            an internal force of the follower block.
    """
    invalid = [i for i in leaders if not 0 <= i < len(c)]
    if invalid or len(set(leaders)) != len(leaders):
        raise ValueError(f"leader contacts {list(leaders)}: each must be one of 0 to {len(c) - 1}, without repetition")
    followers = [i for i in range(len(c)) if i not in leaders]
    G = grasp.payload_frame_grasp_matrix(c)
    rows = (3 * np.asarray(leaders)[:, None] + np.arange(3)).ravel()
    follower_rows = (3 * np.asarray(followers, dtype=int)[:, None] + np.arange(3)).ravel()
    _require_rank(G[:, rows], "the leader block", leaders)
    right_inverse = np.zeros((3 * len(c), 6))
    right_inverse[rows] = np.linalg.pinv(G[:, rows])
    basis = grasp.grasp_nullspace(c[followers]) if followers else np.zeros((0, 0))
    nullspace = np.zeros((3 * len(c), basis.shape[1]))
    nullspace[follower_rows] = basis
    offset = np.zeros(3 * len(c))
    if lam_f0 is not None:
        if lam_f0.shape != (len(followers), 3):
            raise ValueError(f"lam_f0 must contain one force for each of the {len(followers)} follower contacts")
        offset[follower_rows] = lam_f0.ravel()
        net = G @ offset
        if np.abs(net).max() > 1e-9 * max(1.0, np.abs(offset).max()):
            raise ValueError(
                f"lam_f0 is not an internal force: its wrench on the payload is {np.array2string(net, precision=3)} "
                "(N, N m) and must be zero"
            )
    return AllocationMap(
        right_inverse=jnp.asarray(right_inverse), nullspace=jnp.asarray(nullspace), offset=jnp.asarray(offset)
    )


def internal_force_coordinates(allocation: AllocationMap, lam: np.ndarray) -> np.ndarray:
    """Compute the internal-force input eta with `nullspace eta = lam`.

    Args:
        allocation: Linear map.
        lam: Internal force, one row per contact [N, payload frame].

    Returns:
        Coordinates eta [N].

    Raises:
        ValueError: If the allocation has no internal forces, or cannot produce this one.
    """
    nullspace = np.asarray(allocation.nullspace)
    if nullspace.shape[1] == 0:
        raise ValueError(
            "this allocation has no internal force: the null space of the follower block is {0}; use three or more "
            "follower contacts that are not collinear, or the least-squares allocation"
        )
    eta = nullspace.T @ lam.ravel()
    missing = np.abs(nullspace @ eta - lam.ravel()).max()
    if missing > 1e-9 * max(1.0, np.abs(lam).max()):
        raise ValueError(
            f"the requested internal force is outside the null space of the allocation (by up to {missing:.3g} N): its "
            "forces and moments must cancel, and a leader-follower allocation accepts follower contacts only"
        )
    return eta


def squeeze(c: np.ndarray, pairs: Sequence[tuple[int, int, float]]) -> np.ndarray:
    """Compute the internal force that presses pairs of contacts together.

    Args:
        c: Contact points, one per row [m, payload frame].
        pairs: Triples `(i, j, force)`: contact i is pushed towards contact j and vice versa with this force [N].

    Returns:
        Contact forces, one row per contact [N, payload frame].
    """
    lam = np.zeros_like(c)
    for i, j, force in pairs:
        direction = (c[j] - c[i]) / np.linalg.norm(c[j] - c[i])
        lam[i] += force * direction
        lam[j] -= force * direction
    return lam


def _require_rank(G: np.ndarray, name: str, contacts: Sequence[int] | range) -> None:
    """Raise ValueError if a block of the grasp matrix has a rank below 6."""
    singular = np.linalg.svd(G, compute_uv=False)
    rank = int((singular > singular[0] / MAX_CONDITION).sum())
    if rank < 6:
        raise ValueError(
            f"{name} (contacts {list(contacts)}) has rank {rank}, singular values "
            f"{np.array2string(singular, precision=3)}; rank 6 is required: three contacts that are not collinear"
        )
