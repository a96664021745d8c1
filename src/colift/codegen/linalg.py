# ruff: noqa: ARG001  every rule has the arguments graph and equation
"""Rules of dense linear algebra: unrolled factorizations and solutions of small fixed size.

References:
    Golub, Van Loan, *Matrix Computations*, 4th ed., 2013.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from colift.codegen.blocks import While
from colift.codegen.equations import Equation
from colift.codegen.graph import Graph, Nodes
from colift.codegen.interpret import interpret, rule
from colift.codegen.jax_internals import UnsupportedPrimitive, abstract_array
from colift.codegen.loops import build_function


def cholesky(g: Graph, A: Nodes) -> Nodes:
    """Compute the Cholesky factor: lower triangular `L` with `A = L L^T`.

    Args:
        g: Graph.
        A: Nodes of a symmetric positive definite matrix; only its lower triangle is read.

    Returns:
        The nodes of `L`.
    """
    n = A.shape[0]
    L = np.full((n, n), g.const(0.0))
    for j in range(n):
        column = A[j:, j]
        for k in range(j):
            column = g.map("sub", column, g.map("mul", L[j:, k], L[j, k]))
        L[j, j] = g.map("sqrt", column[0])
        L[j + 1 :, j] = g.map("div", column[1:], L[j, j])
    return L


def triangular_solve(g: Graph, A: Nodes, B: Nodes, lower: bool, unit_diagonal: bool) -> Nodes:
    """Solve `A X = B` by substitution.

    Args:
        g: Graph.
        A: Nodes of a triangular matrix.
        B: Nodes of the right-hand sides, by column.
        lower: Whether A is lower triangular; otherwise upper.
        unit_diagonal: Whether the diagonal of A is one and is not read.

    Returns:
        The nodes of `X`.
    """
    n = A.shape[0]
    X = B.copy()
    order = range(n) if lower else range(n)[::-1]
    for done, i in enumerate(order):
        for k in order[:done]:
            X[i] = g.map("sub", X[i], g.map("mul", A[i, k], X[k]))
        if not unit_diagonal:
            X[i] = g.map("div", X[i], A[i, i])
    return X


def lu(g: Graph, A: Nodes) -> list[Nodes]:
    """Compute the LU factorization `P A = L U` with partial pivoting.

    Args:
        g: Graph.
        A: Nodes of a matrix.

    Returns:
        The nodes of L and U in one matrix, of the pivots, and of the permutation.
    """
    m, n = A.shape
    A = A.copy()
    number = [g.const(float(i)) for i in range(m)]
    pivots, permutation = [], np.array(number)
    for k in range(min(m, n)):
        best, at = g.map("abs", A[k, k]), np.asarray(number[k])
        for i in range(k + 1, m):
            size = g.map("abs", A[i, k])
            larger = g.map("lt", best, size)
            best, at = g.map("select", larger, size, best), g.map("select", larger, number[i], at)
        pivots.append(at)
        for i in range(k + 1, m):
            swap = g.map("eq", at, number[i])
            for rows in (A, permutation):
                rows[k], rows[i] = g.map("select", swap, rows[i], rows[k]), g.map("select", swap, rows[k], rows[i])
        for i in range(k + 1, m):
            A[i, k] = g.map("div", A[i, k], A[k, k])
            A[i, k + 1 :] = g.map("sub", A[i, k + 1 :], g.map("mul", A[i, k], A[k, k + 1 :]))
    return [A, np.array(pivots), permutation]


def _matrices(f: Callable[..., Any], *x: Nodes) -> list[Nodes]:
    """Apply a function of matrices over leading batch axes."""
    batch = x[0].shape[:-2]
    results = [f(*(m[i] for m in x)) for i in np.ndindex(batch)]
    return [np.stack(parts).reshape(*batch, *parts[0].shape) for parts in zip(*results, strict=True)]


@rule("cholesky")
def _cholesky(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return _matrices(lambda m: [cholesky(g, m)], a)[0]


@rule("triangular_solve")
def _triangular_solve(g: Graph, eqn: Equation, a: Nodes, b: Nodes) -> Nodes:
    p = eqn.params
    lower = p["lower"]
    if p["transpose_a"]:
        a, lower = np.swapaxes(a, -1, -2), not lower
    if p["left_side"]:
        return _matrices(lambda A, B: [triangular_solve(g, A, B, lower, p["unit_diagonal"])], a, b)[0]
    a, b = np.swapaxes(a, -1, -2), np.swapaxes(b, -1, -2)
    x = _matrices(lambda A, B: [triangular_solve(g, A, B, not lower, p["unit_diagonal"])], a, b)[0]
    return np.swapaxes(x, -1, -2)


@rule("lu")
def _lu(g: Graph, eqn: Equation, a: Nodes) -> list[Nodes]:
    return _matrices(lambda m: lu(g, m), a)


@rule("custom_linear_solve")
def _custom_linear_solve(g: Graph, eqn: Equation, *x: Nodes) -> list[Nodes]:
    lengths, jaxprs = eqn.params["const_lengths"], eqn.params["jaxprs"]
    before = lengths.matvec + lengths.vecmat
    consts = x[before : before + lengths.solve]
    return interpret(g, jaxprs.solve, [*consts, *x[sum(lengths) :]])


MAX_SWEEPS = 30  # not reached in practice, because Jacobi's method converges quadratically
CONVERGENCE_TOLERANCE = 1e-34  # share of the squared Frobenius norm off the diagonal; below rounding


@rule("eigh")
def _eigh(g: Graph, eqn: Equation, a: Nodes) -> list[Nodes]:
    """Compute eigenvectors and eigenvalues in ascending order; signs of eigenvectors may differ from LAPACK's."""
    n = a.shape[-1]
    if not eqn.params["lower"] or eqn.outvars[1].aval.shape[-1] != n:
        raise UnsupportedPrimitive("codegen: 'eigh' is supported only for the lower triangle and for all eigenvalues")
    return _matrices(lambda A: jacobi(g, np.where(np.tri(n, dtype=bool), A, A.T)), a)


def jacobi(g: Graph, A: Nodes) -> list[Nodes]:
    """Compute the eigendecomposition `A = V diag(w) V^T` by cyclic Jacobi rotations (Golub and Van Loan, section 8.5).

    Args:
        g: Graph.
        A: Nodes of a symmetric matrix.

    Returns:
        The nodes of `V` and of `w` in ascending order; `w` is NaN if A contains a NaN.
    """
    n = A.shape[0]
    one, zero = (g.constants(np.full((), x)) for x in (1.0, 0.0))
    V = np.where(np.eye(n, dtype=bool), one, zero)
    avals = [abstract_array(shape, np.dtype(float)) for shape in (A.shape, A.shape, ())]
    test = build_function(g, avals, lambda inner, x: [_not_converged(inner, x[0], x[2])], [None] * 3)
    sweep = build_function(
        g, avals, lambda inner, x: [*_sweep(inner, x[0], x[1]), inner.map("add", x[2], _const(inner, 1.0))], [None] * 3
    )
    out = g.block(While, [A, V, zero], [n * n, n * n, 1], test=test, function=sweep, tests=0, consts=0)
    A, V = (x.reshape(n, n) for x in out[:2])
    total = _squares(g, A)
    has_no_nan = g.map("eq", total, total)
    w = [g.map("select", has_no_nan, A[i, i], _const(g, np.nan)) for i in range(n)]
    for last in range(n - 1, 0, -1):
        for i in range(last):
            swap = g.map("lt", w[i + 1], w[i])
            w[i], w[i + 1] = g.map("select", swap, w[i + 1], w[i]), g.map("select", swap, w[i], w[i + 1])
            V[:, i], V[:, i + 1] = (
                g.map("select", swap, V[:, i + 1], V[:, i]),
                g.map("select", swap, V[:, i], V[:, i + 1]),
            )
    return [V, np.array(w, dtype=np.int64)]


def _const(g: Graph, x: float) -> Nodes:
    """Return the node of a constant as an array without axes."""
    return g.constants(np.array(x))


def _squares(g: Graph, A: Nodes) -> Nodes:
    """Compute the sum of squares of all elements."""
    return functools.reduce(lambda x, y: g.map("add", x, y), g.map("mul", A, A).ravel())


def _not_converged(g: Graph, A: Nodes, sweeps: Nodes) -> Nodes:
    """Compute whether another sweep is necessary and allowed."""
    off = functools.reduce(
        lambda x, y: g.map("add", x, y), (g.map("mul", x, x) for x in A[np.tril_indices(len(A), -1)])
    )
    large = g.map("lt", g.map("mul", _const(g, CONVERGENCE_TOLERANCE), _squares(g, A)), off)
    return g.map("logical_and", large, g.map("lt", sweeps, _const(g, float(MAX_SWEEPS))))


def _sweep(g: Graph, A: Nodes, V: Nodes) -> list[Nodes]:
    """Rotate every element off the diagonal to zero once; return the matrix and the product of rotations."""
    A, V, one = A.copy(), V.copy(), _const(g, 1.0)
    add, sub, mul, div = (lambda x, y, op=op: g.map(op, x, y) for op in ("add", "sub", "mul", "div"))
    for p in range(len(A)):
        for q in range(p + 1, len(A)):
            # t, the tangent of the rotation angle, is the root of smaller size of t^2 + 2 theta t - 1
            theta = div(sub(A[q, q], A[p, p]), mul(_const(g, 2.0), A[q, p]))
            t = div(one, add(g.map("abs", theta), g.map("sqrt", add(mul(theta, theta), one))))
            t = g.map("select", g.map("lt", theta, _const(g, 0.0)), g.map("neg", t), t)
            t = g.map("select", g.map("eq", A[q, p], _const(g, 0.0)), _const(g, 0.0), t)
            c = div(one, g.map("sqrt", add(mul(t, t), one)))
            s = mul(t, c)
            shift = mul(t, A[q, p])
            A[p, p], A[q, q] = sub(A[p, p], shift), add(A[q, q], shift)
            A[p, q] = A[q, p] = _const(g, 0.0)
            for k in set(range(len(A))) - {p, q}:
                x, y = A[k, p], A[k, q]
                A[k, p] = A[p, k] = sub(mul(c, x), mul(s, y))
                A[k, q] = A[q, k] = add(mul(s, x), mul(c, y))
            V[:, p], V[:, q] = sub(mul(c, V[:, p]), mul(s, V[:, q])), add(mul(s, V[:, p]), mul(c, V[:, q]))
    return [A, V]
