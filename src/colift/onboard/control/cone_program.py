"""Solver of small cone programs with constant matrices by the alternating direction method of multipliers (ADMM).

The unknown is ``x``, near a preferred value ``x_0``. Rows ``v = A x + b`` form blocks of three numbers::

    minimize 1/2 (x - x_0)^T P (x - x_0) + w_c sum_i dist(v_i, K_i) + w_z |e_f . n| + w_xy |e_f x n|
             + w_yaw |e_m . n| + w_rp |e_m x n|

``K_i = {r <= t z, z >= minimum, |v_i| <= maximum}`` is a cone about an axis between two sizes, with z along the axis
and r across it. The last two blocks ``e_f, e_m`` are penalized along and across the direction n. All penalties are
norms: where the constraints can be met and the multipliers stay below the weights, they are exact, and the slack is
zero. The distances instead of strict constraints keep the program solvable for all data.

A, P and the step sizes of the blocks are constants. Their only inverse is computed at construction, and all other
operations of an iteration are one product and closed-form projections. A step size is about the size of a block's
multipliers over the changes of its rows; with one step size for all blocks the solver is three to five times slower.

References:
    Boyd, Parikh, Chu, Peleato, Eckstein, *Distributed optimization and statistical learning via the alternating
    direction method of multipliers*, 2011, sec. 3 and 4.3 (over-relaxation).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.linalg import matvec
from colift.math.pytree import constant, pytree

Scalar = Float[Array, ""]

UNLIMITED = 1e9
"""Number that stands for no limit of a cone or size."""
OVER_RELAXATION = 1.4
CHECK_INTERVAL = 5
"""Iterations between two evaluations of the residuals."""


@pytree
class ConeSets:
    """Sets `K_i = {r <= tan z, z >= minimum, |v_i| <= maximum}` of the blocks; `UNLIMITED` disables a limit."""

    axis: Float[Array, "blocks 3"]  # unit vectors
    tan: Float[Array, " blocks"]  # tangent of the half angle of the cone
    minimum: Float[Array, " blocks"]  # smallest component along the axis
    maximum: Float[Array, " blocks"]  # largest norm


@pytree
class Penalties:
    """Weights of the norm penalties."""

    roll_pitch: Scalar = constant(27.0)  # moments across the direction
    z: Scalar = constant(3.0)  # force along the direction
    xy: Scalar = constant(1.0)  # force across the direction
    yaw: Scalar = constant(9.0)  # moment along the direction
    constraint: Scalar = constant(100.0)  # distance of a block from its set


@pytree
class ConeProgram:
    """Constant matrices of the program, and the settings of the solver."""

    A: Float[Array, "rows unknowns"]  # rows of the blocks
    gain: Float[Array, "unknowns rows"]  # `(P + A^T diag(rho) A)^-1 A^T diag(rho)`
    A_gain: Float[Array, "rows rows"]  # `A gain`
    rho: Float[Array, " rows"]  # step size of each row, equal in a block
    penalties: Penalties
    tolerance: Scalar = constant(1e-3)  # of both residuals, in the unit of the rows
    max_iterations: Scalar = constant(100.0)  # reached in steps of `CHECK_INTERVAL`


@pytree
class WarmStart:
    """Solution of the last program: rows after projection, and scaled multipliers."""

    projected: Float[Array, " rows"]
    multipliers: Float[Array, " rows"]


@pytree
class Solution:
    """Solution of a program."""

    x: Float[Array, " unknowns"]
    v: Float[Array, " rows"]  # rows at the solution, projected
    residuals: Float[Array, "2"]  # primal `|A x + b - z|` and dual `|A^T diag(rho) dz|`, largest entries
    iterations: Scalar
    warm_start: WarmStart


def make_program(
    A: np.ndarray, P: np.ndarray, penalties: Penalties, step_sizes: np.ndarray, max_iterations: int = 100
) -> ConeProgram:
    """Compute the constant matrices of a program on the host.

    Args:
        A: Rows of the blocks.
        P: Symmetric positive definite weight of the deviation from the preferred value.
        penalties: Weights of the penalties.
        step_sizes: Step size of each block `(blocks,)`.
        max_iterations: Largest number of iterations of one solution.

    Returns:
        The program.
    """
    rho = np.repeat(step_sizes, 3)
    gain = np.linalg.solve(P + A.T @ (rho[:, None] * A), A.T * rho)
    return ConeProgram(
        A=jnp.asarray(A),
        gain=jnp.asarray(gain),
        A_gain=jnp.asarray(A @ gain),
        rho=jnp.asarray(rho),
        penalties=penalties,
        max_iterations=jnp.asarray(float(max_iterations)),
    )


def project(v: Float[Array, "blocks 3"], sets: ConeSets) -> Float[Array, "blocks 3"]:
    """Project every block to its set, in closed form.

    The projections to a cone and to a ball about its apex commute. If the result is below the smallest component, the
    projection lies on the disc `z = minimum`.

    Args:
        v: Blocks.
        sets: Sets, one per block.

    Returns:
        The nearest points of the sets.
    """
    z = (v * sets.axis).sum(-1)
    across = v - z[:, None] * sets.axis
    r = jnp.sqrt((across * across).sum(-1) + 1e-30)
    has_cone = sets.tan < UNLIMITED
    t = jnp.where(has_cone, sets.tan, 1.0)
    outside = has_cone & (r > t * z)
    on_cone = jnp.maximum((z + t * r) / (1 + t * t), 0.0)
    z_set, r_set = jnp.where(outside, on_cone, z), jnp.where(outside, t * on_cone, r)
    scale = jnp.minimum(1.0, sets.maximum / jnp.sqrt(z_set * z_set + r_set * r_set + 1e-30))
    z_set, r_set = scale * z_set, scale * r_set
    floor = jnp.where(sets.minimum > -UNLIMITED, sets.minimum, 0.0)
    disc = jnp.sqrt(jnp.maximum(sets.maximum**2 - floor**2, 0.0))
    disc = jnp.where(has_cone, jnp.minimum(disc, t * jnp.maximum(floor, 0.0)), disc)
    low = z_set < sets.minimum
    z_set, r_set = jnp.where(low, sets.minimum, z_set), jnp.where(low, jnp.minimum(r, disc), r_set)
    return z_set[:, None] * sets.axis + (r_set / r)[:, None] * across


def _shrink(e: Float[Array, "*blocks 3"], by: Float[Array, "..."]) -> Float[Array, "*blocks 3"]:
    """Return the proximal point of `by |e|`: a shorter vector, or zero."""
    norm = jnp.sqrt((e * e).sum(-1, keepdims=True) + 1e-30)
    return e * jnp.maximum(0.0, 1 - by / norm)


def _shrink_parts(e: Float[Array, "3"], n: Float[Array, "3"], along: Scalar, across: Scalar) -> Float[Array, "3"]:
    """Return the proximal point of penalties along and across a direction."""
    part = (e * n).sum() * n
    return _shrink(part, along) + _shrink(e - part, across)


def _proximal(
    v: Float[Array, " rows"], sets: ConeSets, n: Float[Array, "3"], weights: Penalties, rho: Float[Array, " rows"]
) -> Float[Array, " rows"]:
    """Return the minimizer of all penalties plus half of the squared distances from v, weighted by rho."""
    blocks, slack = v[:-6].reshape(-1, 3), v[-6:]
    inside = project(blocks, sets)
    inside = inside + _shrink(blocks - inside, weights.constraint / rho[:-6:3, None])
    force = _shrink_parts(slack[:3], n, weights.z / rho[-6], weights.xy / rho[-6])
    moment = _shrink_parts(slack[3:], n, weights.yaw / rho[-3], weights.roll_pitch / rho[-3])
    return jnp.concatenate([inside.reshape(-1), force, moment])


def solve(
    program: ConeProgram,
    x_0: Float[Array, " unknowns"],
    b: Float[Array, " rows"],
    sets: ConeSets,
    n: Float[Array, "3"],
    start: WarmStart,
) -> Solution:
    """Solve the program; where the preferred value has no penalty, it is the solution without an iteration.

    The loop ends when both residuals are below the tolerance, or after `max_iterations`. The residuals show which.

    Args:
        program: Constant matrices.
        x_0: Preferred value.
        b: Offset of the rows.
        sets: Sets of all blocks but the last two.
        n: Direction that separates the penalties of the last two blocks.
        start: Warm start, such as the last solution.

    Returns:
        The solution with its residuals.
    """
    rho, weights = program.rho, program.penalties
    v_0 = matvec(program.A, x_0) + b
    is_free = jnp.abs(v_0 - _proximal(v_0, sets, n, weights, rho)).max() < 1e-9
    zero = jnp.zeros(())

    def iterate(_: Array, carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        z, y, _, _ = carry
        w = v_0 + matvec(program.A_gain, z - y - v_0)
        relaxed = OVER_RELAXATION * w + (1 - OVER_RELAXATION) * z
        z_next = _proximal(relaxed + y, sets, n, weights, rho)
        return z_next, y + relaxed - z_next, w - z_next, z_next - z

    def advance(carry: tuple[Array, Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array, Array]:
        z, y, _, _, count = carry
        z, y, gap, change = jax.lax.fori_loop(0, CHECK_INTERVAL, iterate, (z, y, jnp.zeros_like(z), jnp.zeros_like(z)))
        dual = (program.A * (rho * change)[:, None]).sum(0)
        return z, y, jnp.abs(gap).max(), jnp.abs(dual).max(), count + CHECK_INTERVAL

    def is_running(carry: tuple[Array, Array, Array, Array, Array]) -> Array:
        _, _, primal, dual, count = carry
        return (jnp.maximum(primal, dual) > program.tolerance) & (count < program.max_iterations)

    first = jnp.where(is_free, zero, 1e3)
    z, y = jnp.where(is_free, v_0, start.projected), jnp.where(is_free, 0.0, start.multipliers)
    z, y, primal, dual, count = jax.lax.while_loop(is_running, advance, (z, y, first, first, zero))
    return Solution(
        x=x_0 + matvec(program.gain, z - y - v_0),
        v=z,
        residuals=jnp.stack([primal, dual]),
        iterations=count,
        warm_start=WarmStart(projected=z, multipliers=y),
    )
