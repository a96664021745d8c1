"""From a payload wrench to contact forces, with internal forces that leave the wrench alone.

In the payload frame the grasp matrix `[I ...; hat(c) ...]` is constant, so a right inverse and a basis of its
kernel are computed once, when a strategy is built. Both strategies are one linear map, `Allocation`.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import grasp
from colift.models.state import Wrench

MAX_CONDITION = 1e8  # of a grasp block; beyond, a wrench of 1 N asks for forces that no arm holds


@pytree
class AllocationMap:
    """`lam = inverse W + kernel eta + offset`, all in the payload frame, contacts stacked."""

    right_inverse: Float[Array, "rows 6"]  # right inverse of G
    nullspace: Float[Array, "rows eta"]  # orthonormal, G kernel = 0
    offset: Float[Array, "rows"]  # N, lam_f0 of Eq. follower_force, G offset = 0


def allocate(
    allocation: AllocationMap, R: Float[Array, "3 3"], W: Wrench, eta: Float[Array, " eta"]
) -> Float[Array, "contacts 3"]:
    """Commanded contact forces on the payload, N, world (Lemma wrench_consistency: `G lam = W` whatever eta)."""
    W_L = jnp.concatenate([R.T @ W.F, W.tau])
    lam = allocation.right_inverse @ W_L + allocation.nullspace @ eta + allocation.offset
    return lam.reshape(-1, 3) @ R.T


def least_squares_allocation(c: np.ndarray) -> AllocationMap:
    """The general allocation `lam = G^+ W + Z eta`: least squares over all contacts, Z a basis of `ker G`.

    `c` holds the contacts by row, payload frame, m.

    Raises:
        ValueError: if the contacts cannot give every wrench (fewer than three, or collinear).
    """
    G = _matrix(c)
    _require_rank(G, "the grasp", range(len(c)))
    return AllocationMap(
        right_inverse=jnp.asarray(np.linalg.pinv(G)),
        nullspace=jnp.asarray(grasp.grasp_nullspace(c)),
        offset=jnp.zeros(3 * len(c)),
    )


def leader_follower_allocation(
    c: np.ndarray, leaders: Sequence[int], lam_f0: np.ndarray | None = None
) -> AllocationMap:
    """The paper's split: `lam_l = G_l^+ W`, `lam_f = lam_f0 + N(G_f) eta` (Eq. leader_force, follower_force).

    `leaders` are rows of `c`; `lam_f0` is one force per follower contact, in their order, N, payload frame.

    Raises:
        ValueError: if the leader block has rank below 6, a leader is named twice or does not exist, or
            `lam_f0` is not an internal force of the follower block.
    """
    wrong = [i for i in leaders if not 0 <= i < len(c)]
    if wrong or len(set(leaders)) != len(leaders):
        raise ValueError(f"leader contacts {list(leaders)}: each must be one of 0 to {len(c) - 1}, named once")
    followers = [i for i in range(len(c)) if i not in leaders]
    G = _matrix(c)
    rows = (3 * np.asarray(leaders)[:, None] + np.arange(3)).ravel()
    follow = (3 * np.asarray(followers, dtype=int)[:, None] + np.arange(3)).ravel()
    _require_rank(G[:, rows], "the leader block", leaders)
    inverse = np.zeros((3 * len(c), 6))
    inverse[rows] = np.linalg.pinv(G[:, rows])
    basis = grasp.grasp_nullspace(c[followers]) if followers else np.zeros((0, 0))
    kernel = np.zeros((3 * len(c), basis.shape[1]))
    kernel[follow] = basis
    offset = np.zeros(3 * len(c))
    if lam_f0 is not None:
        if lam_f0.shape != (len(followers), 3):
            raise ValueError(f"lam_f0 must hold one force for each of the {len(followers)} follower contacts")
        offset[follow] = lam_f0.ravel()
        net = G @ offset
        if np.abs(net).max() > 1e-9 * max(1.0, np.abs(offset).max()):
            raise ValueError(
                f"lam_f0 is not an internal force: it puts the wrench {np.array2string(net, precision=3)} "
                "(N, N m) on the payload; its forces and moments must cancel"
            )
    return AllocationMap(right_inverse=jnp.asarray(inverse), nullspace=jnp.asarray(kernel), offset=jnp.asarray(offset))


def internal_force_coordinates(allocation: AllocationMap, lam: np.ndarray) -> np.ndarray:
    """The eta whose internal force `kernel eta` is `lam`, one force a contact, N, payload frame.

    Raises:
        ValueError: if the strategy has no internal forces at all, or cannot produce this one.
    """
    kernel = np.asarray(allocation.nullspace)
    if kernel.shape[1] == 0:
        raise ValueError(
            "this allocation has no internal force: the kernel of the follower block is {0}, so no eta exists; "
            "use three or more follower contacts that are not collinear, or the balanced allocation"
        )
    eta = kernel.T @ lam.ravel()
    missing = np.abs(kernel @ eta - lam.ravel()).max()
    if missing > 1e-9 * max(1.0, np.abs(lam).max()):
        raise ValueError(
            f"the requested internal force is outside the allocation's kernel (by up to {missing:.3g} N): "
            "it must cancel in force and moment and, for the leader-follower split, use follower contacts only"
        )
    return eta


def squeeze(c: np.ndarray, pairs: Sequence[tuple[int, int, float]]) -> np.ndarray:
    """Internal forces that press contacts together: `(a, b, newton)` pushes a towards b and b towards a."""
    lam = np.zeros_like(c)
    for a, b, newton in pairs:
        along = (c[b] - c[a]) / np.linalg.norm(c[b] - c[a])
        lam[a] += newton * along
        lam[b] -= newton * along
    return lam


def _matrix(c: np.ndarray) -> np.ndarray:
    return np.asarray(grasp.grasp_matrix(jnp.asarray(c), jnp.eye(3)))


def _require_rank(G: np.ndarray, name: str, used: Sequence[int] | range) -> None:
    singular = np.linalg.svd(G, compute_uv=False)
    rank = int((singular > singular[0] / MAX_CONDITION).sum())
    if rank < 6:
        raise ValueError(
            f"{name} (contacts {list(used)}) has rank {rank}, singular values "
            f"{np.array2string(singular, precision=3)}; every wrench needs rank 6: three contacts not in line"
        )
