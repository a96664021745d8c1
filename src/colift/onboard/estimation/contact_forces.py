"""Contact forces from the equations of motion of an agent, for periods without tip force readings.

See Also:
    docs/learning: labels without tip force readings.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import linalg


def contact_jacobian(J_tip: Float[Array, "arms 3 xi"]) -> Float[Array, "xi contacts"]:
    """Return the matrix from the contact forces of all arms, base frame, to the generalized moments.

    Args:
        J_tip: Tip velocities per angular velocity of the base and per joint velocity, base frame, by arm [m or 1].
    """
    return J_tip.reshape(-1, J_tip.shape[-1]).T


def regularized_pseudoinverse(B: Float[Array, "n m"], scale: float) -> Float[Array, "m n"]:
    """Return `(B^T B + s^2 I)^-1 B^T`, nearly the pseudoinverse of B.

    Args:
        B: Matrix.
        scale: Singular value s below which a direction is suppressed, in the unit of B.
    """
    return linalg.solve(B.T @ B + scale**2 * jnp.eye(B.shape[1]), B.T)


def reconstruct_contact_forces(
    J_tip: Float[Array, "arms 3 xi"],
    R: Float[Array, "3 3"],
    A_lam: Float[Array, "outputs"],
    min_lever: float,
) -> Float[Array, "arms 3"]:
    """Compute the contact forces that agree with the equations of motion of an agent.

    The generalized contact force is ``A lam = f_hat - modelled``, with the forces `modelled` of the nominal equations
    and the compensated residual `f_hat`. The sum of the contact forces satisfies the force equation exactly. With
    ``lam_i = mean(lam) + d_i``, the differences ``d_i`` of several arms follow from the moment equation by regularized
    least squares.

    Args:
        J_tip: Tip velocities per angular velocity of the base and per joint velocity, base frame, by arm [m or 1].
        R: Attitude of the base, body to world.
        A_lam: Generalized contact force ``f_hat - modelled``: force [N, world], then moments [N m, base frame] and
            joint torques or forces [N m or N].
        min_lever: Lever below which the moments determine no difference between the arms [m].

    Returns:
        Contact forces on the payload [N, world].
    """
    arms = len(J_tip)
    lam = jnp.tile(A_lam[:3] / arms, (arms, 1))
    if arms == 1:
        return lam
    J = contact_jacobian(J_tip)
    B = J - jnp.tile(J.reshape(-1, arms, 3).mean(1), arms)  # of the differences between the arms
    difference = regularized_pseudoinverse(B, min_lever) @ (A_lam[3:] - J @ (lam @ R).reshape(-1))
    difference = difference.reshape(arms, 3) @ R.T
    return lam + difference - difference.mean(0, keepdims=True)  # the mean is zero up to rounding
