"""Tests of generated C code against JAX: equal functions, equal numbers."""

from __future__ import annotations

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import codegen
from colift.codegen.interpret import RULES
from colift.codegen.jax_internals import Program, programs_in
from colift.codegen.vmap_primitive import trace
from colift.math import so3
from colift.math.vmap import vmap_agents
from colift.models.state import AgentInput, zero_residual
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam

BATCH = 11  # neither a multiple of the vector's length nor less


def assert_close(actual, expected, tolerance=1e-12):
    """Equal structure, types and shapes; equal values to a tolerance relative to each array's largest."""
    assert jax.tree.structure(actual) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True):
        assert a.dtype == b.dtype
        assert a.shape == b.shape
        scale = max(1.0, float(np.max(np.abs(np.asarray(b, float)), initial=0.0, where=np.isfinite(b))))
        np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=tolerance, atol=tolerance * scale)


def emitted(f, *args, batched):
    """Return the C code of a function."""
    leaves, tree = jax.tree.flatten(args)
    return codegen.source(trace(f, tree, leaves)[0], batched=batched)


def random_batch(rng, args):
    """Return a batch of arguments close to the given ones."""

    def one(x):
        x = np.asarray(x)
        if x.dtype == bool:
            return jnp.asarray(rng.random((BATCH, *x.shape)) < 0.5)
        if np.issubdtype(x.dtype, np.integer):
            return jnp.asarray(rng.integers(0, 3, (BATCH, *x.shape)), x.dtype)
        return jnp.asarray(x + 0.1 * rng.normal(size=(BATCH, *x.shape)))

    return jax.tree.map(one, args)


def check(f, *args, tolerance=1e-12):
    """Assert that `native.compile(f)` equals `f`, alone and in a batch."""
    assert_close(jax.jit(codegen.compile(f))(*args), jax.jit(f)(*args), tolerance)
    batch = random_batch(np.random.default_rng(0), args)
    assert_close(jax.jit(jax.vmap(codegen.compile(f)))(*batch), jax.jit(jax.vmap(f))(*batch), tolerance)


A = jnp.asarray(np.random.default_rng(1).normal(size=(4, 4)))
X = jnp.asarray(np.random.default_rng(2).normal(size=4))
SPD = A @ A.T + jnp.eye(4)


@jax.custom_vjp
def reversed_gradient(x):
    return 2 * x


reversed_gradient.defvjp(lambda x: (2 * x, None), lambda _, g: (-g,))

OPERATIONS = {
    "arithmetic": lambda x, A: (x + 2 * x - x / 3 - (-x) * x, 1 / x, x / 4, 0 * x, 1 * x, x - x, 2 - (-x), -x * -x),
    "powers": lambda x, A: (x**2, x**3, x**-2, jnp.abs(x) ** 0.5, jnp.abs(x) ** 1.7, jnp.abs(x) ** x, jnp.square(x)),
    "roots": lambda x, A: (jnp.sqrt(jnp.abs(x)), jax.lax.rsqrt(jnp.abs(x)), jnp.cbrt(x), jnp.linalg.norm(x)),
    "circular": lambda x, A: (jnp.sin(x), jnp.cos(x), jnp.tan(x), jnp.arctan2(x, x[::-1]), jnp.arctan(x)),
    "inverse circular": lambda x, A: (jnp.arcsin(jnp.tanh(x)), jnp.arccos(jnp.tanh(x))),
    "hyperbolic": lambda x, A: (jnp.sinh(x), jnp.cosh(x), jnp.tanh(x), jnp.arcsinh(x), jnp.arctanh(jnp.sin(x) / 2)),
    "exponential": lambda x, A: (jnp.exp(x), jnp.expm1(x), jnp.log(jnp.abs(x)), jnp.log1p(x * x), jax.nn.sigmoid(x)),
    "smooth": lambda x, A: (jax.nn.softplus(x), jax.scipy.special.erf(x), jax.nn.logsumexp(x), jnp.logaddexp(x, -x)),
    "rounding": lambda x, A: (jnp.floor(9 * x), jnp.ceil(9 * x), jnp.round(9 * x), jnp.trunc(9 * x), jnp.sign(x)),
    "remainders": lambda x, A: (jnp.fmod(9 * x, 2.0), jnp.mod(9 * x, 2.0)),
    "extremes": lambda x, A: (jnp.maximum(x, 0.1), jnp.minimum(x, x[::-1]), jnp.clip(x, -0.2, 0.3), jnp.abs(x)),
    "choice": lambda x, A: (jnp.where(x > 0, x, A[0]), jnp.where((x > 0) & ~(x < 0.5) | (x <= -1), 1.0, x)),
    "comparison": lambda x, A: (x > 0, x >= x[::-1], x == x, x != x[::-1], (x > 0) ^ (x < 0.5), jnp.isfinite(x)),
    "choice of booleans": lambda x, A: (jnp.where(x > 0, x > 0.5, x < -0.5), (x > 0) == (A[0] > 0)),
    "reductions": lambda x, A: (A.sum(), A.sum(0), A.max(1), A.min(), A.prod(0), A.mean(), jnp.cumsum(A, 1)),
    "logical reductions": lambda x, A: ((A > 0).all(), (A > 0).any(1), (A > 0).sum(0), jnp.argmax(A, 1), jnp.argmin(A)),
    "running": lambda x, A: (jnp.cumprod(x), jax.lax.cummax(x), jax.lax.cummin(x, reverse=True)),
    "products": lambda x, A: (A @ x, A @ A.T, x @ x, jnp.outer(x, x), jnp.kron(A, jnp.eye(2)), jnp.trace(A)),
    "einsum": lambda x, A: (jnp.einsum("ij,kj,k->ik", A, A, x), jnp.einsum("ii->i", A)),
    "batched product": lambda x, A: (A.reshape(2, 2, 4) @ A.reshape(2, 4, 2), jnp.stack([A, A.T]) @ A[None]),
    "shapes": lambda x, A: (A.T, A.reshape(2, 8), A[:, None], A.ravel()[::-1], jnp.flip(A, 1), A.swapaxes(0, 1)[1:3]),
    "joining": lambda x, A: (jnp.stack([x, A[1]]), jnp.concatenate([A, x[None]]), jnp.tile(x, (2, 2))),
    "parting": lambda x, A: (jnp.split(A, 2), jnp.unstack(A)),
    "padding": lambda x, A: (jnp.pad(x, (1, 2)), jax.lax.pad(x, 0.5, [(-1, 2, 1)]), jnp.zeros(0), A[:0].sum(0)),
    "triangles": lambda x, A: (jnp.tril(A), jnp.triu(A, 1), jnp.diag(x), jnp.diagonal(A), jnp.eye(3)),
    "fixed indices": lambda x, A: (A[jnp.array([2, 0])], A[jnp.array([0, 1]), jnp.array([3, 2])], A[1, 2], A[-1]),
    "computed indices": lambda x, A: (
        A[jnp.argmax(x)],
        jnp.take_along_axis(A, jnp.argmax(A, 1)[:, None], 1),
        jax.lax.dynamic_slice(A, (jnp.argmax(x), jnp.argmin(x)), (2, 2)),
        jax.lax.dynamic_update_slice(A, A[:1, :2], (jnp.argmax(x), jnp.argmin(x))),
        jnp.take(x, jnp.argmax(x) + 2, mode="fill", fill_value=7.0),
        jnp.take(x, jnp.argmax(x) + 2, mode="clip"),
    ),
    "writing": lambda x, A: (x.at[1].set(5.0), A.at[1:3, 2].add(x[:2]), A.at[:, 0].multiply(2.0)),
    "writing extremes": lambda x, A: (x.at[0].max(0.3), x.at[0].min(0.1)),
    "writing anywhere": lambda x, A: (
        x.at[jnp.argmax(x)].set(5.0),
        A.at[jnp.argmax(A, 1), jnp.argmin(x)].add(x),
        A.at[jnp.argmax(x) + jnp.arange(3)].multiply(2.0),
        jnp.arange(4).at[jnp.argmax(x)].add(3),
        (A > 0).at[jnp.argmin(x), 1:3].set(False),
        jax.lax.dynamic_update_slice(x, x[:2] ** 2, (jnp.argmax(x),)),
    ),
    "integers": lambda x, A: (jnp.arange(4) * 3 // 2, jnp.argmax(x) * 7 % 3, (9 * x).astype(int), jnp.arange(4) > 1),
    "factorizations": lambda x, A: (
        jnp.linalg.cholesky(A @ A.T + jnp.eye(4)),
        jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(A @ A.T + jnp.eye(4)), True), x),
        jnp.linalg.solve(A, x),
        jnp.linalg.inv(A),
        jnp.linalg.det(A),
        jnp.linalg.eigvalsh(A @ A.T),
        jnp.linalg.eigvalsh(jnp.stack([A + A.T, 0 * A, jnp.eye(4), jnp.diag(jnp.array([1.0, 1, -2, 1e-9]))])),
        (lambda e: e[1] @ jnp.diag(e[0]) @ e[1].T)(jnp.linalg.eigh(A + A.T)),
    ),
    "triangular": lambda x, A: tuple(
        jax.lax.linalg.triangular_solve(
            A + 4 * jnp.eye(4), A[:, :4], left_side=left, lower=lower, transpose_a=turned, unit_diagonal=unit
        )
        for left in (True, False) for lower in (True, False) for turned in (True, False) for unit in (True, False)
    ),
    "branches": lambda x, A: (
        jax.lax.cond(x[0] > 0, lambda: x, lambda: -x),
        jax.lax.switch(jnp.argmax(x), [lambda: x, lambda: 2 * x, lambda: 3 * x]),
        jax.lax.select_n(jnp.argmax(A, 1).astype(jnp.int32) % 3, x, 2 * x, 3 * x),
    ),
    "loops": lambda x, A: (
        jax.lax.fori_loop(0, 3, lambda i, y: y + i * x[i], x),
        jax.lax.scan(lambda y, t: (jnp.sin(y) + t, y), x, A, reverse=True),
        jax.lax.map(lambda y: y * x, A),
        jax.lax.while_loop(lambda y: (y * y).sum() < 50.0, lambda y: 1.3 * y + 0.1, x),
    ),
    "derivatives": lambda x, A: (
        jax.grad(lambda x: jnp.sin(x).prod())(x),
        jax.jacfwd(lambda x: jax.nn.softplus(A @ x))(x),
        jax.checkpoint(jnp.sin)(x),
        reversed_gradient(x),
        jax.lax.optimization_barrier(jax.device_put(jax.lax.stop_gradient(jnp.copy(x)))),
    ),
    "rotations": lambda x, A: (so3.exp(x[1:]), so3.log(so3.exp(x[1:])), so3.exp(1e-3 * x[1:]), so3.exp(0 * x[1:])),
}  # fmt: skip


def test_operations():
    """Every operation of the table, one compilation for all."""
    check(lambda x, A: {name: f(x, A) for name, f in OPERATIONS.items()}, X, A)


def test_table_covers_every_rule():
    """Every rule of the interpreter has a case in the table above, or a named test below."""
    jaxpr = jax.make_jaxpr(lambda x, A: [f(x, A) for f in OPERATIONS.values()])(X, A)
    seen = set()

    def walk(program):
        for e in program.equations:
            seen.add(e.name)
            for inner in programs_in(e.params):
                walk(inner)

    walk(Program.from_jaxpr(jaxpr))
    elsewhere = {"loop"}
    assert {name for name in RULES if name not in seen | elsewhere} == set()


def random_program(seed):
    """Return a random function of a vector and a matrix; each step applies an operation to earlier values.

    Every operation is continuous: a jump would turn rounding of an argument at its edge into a difference.
    """
    rng = np.random.default_rng(seed)
    unary = [jnp.sin, jnp.cos, jnp.tanh, jnp.abs, jnp.negative, lambda a: a * a, lambda a: a / (1 + a * a),
             lambda a: a + 0.0, lambda a: 1.0 * a, lambda a: jnp.where(a > 0.1, a, 0.2 - a), lambda a: a.T,
             lambda a: jnp.exp(-jnp.abs(a)), lambda a: a - a.sum() / 9, lambda a: jnp.sqrt(1 + a * a)]  # fmt: skip
    binary = [jnp.add, jnp.subtract, jnp.multiply, jnp.maximum, jnp.minimum, lambda a, b: jnp.arctan2(a, 2 + b * b),
              lambda a, b: jnp.where(a < b, a * a, a * b), lambda a, b: a @ b / 3, lambda a, b: a * b[:, :1],
              lambda a, b: jnp.concatenate([a[1:], b[:1]]), lambda a, b: jnp.einsum("ij,kj->ik", a, b) / 3]  # fmt: skip
    masks = np.array([0.0, 1.0, -1.0])
    steps = [(rng.random() < 0.5, rng.integers(1 << 30), rng.random(2)) for _ in range(rng.integers(10, 60))]
    constants = jnp.asarray(rng.choice(masks, size=(len(steps), 3, 3)))

    def f(x, A):
        values = [A, so3.hat(x), jnp.outer(x, x)]
        for k, (one, pick, at) in enumerate(steps):
            a, b = (values[int(u * len(values))] for u in at)
            new = unary[pick % len(unary)](a) if one else binary[pick % len(binary)](a, b)
            values.append(jnp.tanh(new) + constants[k] * a if pick % 3 == 0 else new)
        return values[-1], sum(values)

    return f


@pytest.mark.long
@settings(max_examples=8)
@given(st.integers(0, 10**9))
def test_random_programs(seed):
    x, A = jnp.asarray([0.3, -0.2, 0.7]), jnp.asarray(np.random.default_rng(seed).normal(size=(3, 3)))
    check(random_program(seed), x, A, tolerance=1e-11)


def test_sine_and_cosine_are_exact_to_rounding():
    """Against the C library, over twenty orders of magnitude and near the zeros; infinities give NaN."""
    rng = np.random.default_rng(0)
    zeros = np.arange(-2000, 2000) * np.pi / 2
    x = np.concatenate([rng.normal(size=4000) * 10.0 ** rng.uniform(-15, 6, 4000), zeros, zeros * (1 + 1e-15),
                        [0.0, -0.0, 99999.9, 1e5, 1e22, np.inf, -np.inf, np.nan]])  # fmt: skip
    f = codegen.compile(lambda x: (jnp.sin(x), jnp.cos(x)))
    with np.errstate(invalid="ignore"):
        expected = np.sin(x), np.cos(x)
    for actual in (jax.vmap(f)(jnp.asarray(x)), zip(*(f(jnp.asarray(v)) for v in x[::200]), strict=True)):
        for a, b in zip(actual, expected, strict=True):
            a = np.asarray(a)
            np.testing.assert_allclose(a, b if a.size == x.size else b[::200], rtol=0, atol=1.2e-16)


def test_small_angles_keep_relative_accuracy():
    x = 10.0 ** -np.arange(1.0, 300.0)
    np.testing.assert_allclose(jax.vmap(codegen.compile(jnp.sin))(jnp.asarray(x)), np.sin(x), rtol=3e-16, atol=0)


def test_nan_propagates_as_in_jax():
    x = jnp.array([1.0, jnp.nan, -2.0, jnp.nan])

    def f(x, y):
        extremes = jnp.maximum(x, y), jnp.minimum(y, x), jnp.clip(x, 0.0, 1.0), x.max(), x.min()
        return extremes, jnp.argmax(x), jnp.argmin(x), x.sum(), jnp.sign(x), x < y, x != x, jnp.sqrt(x)

    for a, b in ((x, x[::-1]), (jnp.zeros(4), x), (x, jnp.zeros(4))):
        jax.tree.map(np.testing.assert_array_equal, codegen.compile(f)(a, b), f(a, b))
    many = jnp.stack([x, x[::-1], jnp.zeros(4)]), jnp.stack([x[::-1], x, x])
    jax.tree.map(np.testing.assert_array_equal, jax.vmap(codegen.compile(f))(*many), jax.vmap(f)(*many))


# batches


def plain(a, b, k, flag):
    return {"y": jnp.where(flag, so3.exp(a) @ b, -b) * k, "k": k + 1, "flag": ~flag}


PLAIN = (jnp.array([0.1, 0.2, 0.3]), jnp.arange(9.0).reshape(3, 3), jnp.array(2), jnp.array(True))


@pytest.mark.parametrize("axes", [(0, None, None, None), (None, 0, 0, None), (1, 2, 0, 0), (None, None, None, 0)])
def test_batches_may_share_any_argument(axes):
    rng = np.random.default_rng(0)
    args = [
        x if d is None else jnp.moveaxis(y, 0, d) for x, y, d in zip(PLAIN, random_batch(rng, PLAIN), axes, strict=True)
    ]
    args[2] = args[2].astype(float)
    actual, expected = (jax.jit(jax.vmap(f, in_axes=axes))(*args) for f in (codegen.compile(plain), plain))
    assert_close(actual, expected)


def test_read_arguments_are_those_that_results_depend_on(monkeypatch):
    """An argument inside an unread branch of a tree is not read; a function without native code has none."""
    first, unread, last = (jnp.arange(3.0), jnp.ones((4, 4)), jnp.array(2.0))
    used = codegen.compile(lambda pair, scale: jnp.sin(pair[0]) * scale)
    assert codegen.read_arguments(used, (first, unread), last) == {0, 2}
    callback = codegen.compile(lambda x: jax.pure_callback(np.sin, jax.ShapeDtypeStruct((3,), float), x))
    assert codegen.read_arguments(callback, first) is None
    monkeypatch.setattr(codegen.build, "compiler", lambda: None)
    assert codegen.read_arguments(used, (first, unread), last) is None


def test_nested_batches():
    rng = np.random.default_rng(0)
    a, b = jnp.asarray(rng.normal(size=(5, 3))), jnp.asarray(rng.normal(size=(7, 3, 3)))
    k = jnp.asarray(rng.normal(size=(7, 5)))

    def twice(f):
        return jax.vmap(jax.vmap(f, in_axes=(0, None, 0, None)), in_axes=(None, 0, 0, None))

    assert_close(twice(codegen.compile(plain))(a, b, k, PLAIN[3]), twice(plain)(a, b, k, PLAIN[3]))


@pytest.mark.parametrize("size", [0, 1, 7, 8, 9, 257])
def test_batches_of_any_size_on_any_number_of_threads(size):
    rng = np.random.default_rng(size)
    a = jnp.asarray(rng.normal(size=(size, 3)))
    one, four = (jax.jit(jax.vmap(codegen.compile(so3.exp, threads=t)))(a) for t in (1, 4))
    np.testing.assert_array_equal(one, four)
    assert_close(one, jax.vmap(so3.exp)(a))


def test_inside_a_scan_of_a_batch():
    step = codegen.compile(lambda z, u: so3.exp(u) @ z)

    def run(step):
        z = jnp.broadcast_to(jnp.eye(3), (4, 3, 3))
        u = jnp.asarray(np.random.default_rng(0).normal(size=(20, 4, 3)))
        return jax.lax.scan(lambda z, u: (jax.vmap(step)(z, u), z.sum()), z, u)

    assert_close(jax.jit(lambda: run(step))(), run(lambda z, u: so3.exp(u) @ z))


def test_native_inside_native():
    inner = codegen.compile(so3.exp)
    check(lambda a: inner(a) @ inner(2 * a), jnp.array([0.1, 0.2, 0.3]))


@pytest.mark.long
def test_derivatives_are_those_of_jax():
    def f(a, b):
        return (jnp.cos(b) @ a).sum() + jnp.sin(b).prod()

    g, (a, b) = codegen.compile(f), PLAIN[:2]
    for d in (jax.grad, jax.jacfwd, jax.hessian):
        assert_close(jax.jit(d(g, argnums=(0, 1)))(a, b), d(f, argnums=(0, 1))(a, b))
    many = random_batch(np.random.default_rng(0), (a, b))
    assert_close(jax.vmap(jax.grad(g))(*many), jax.vmap(jax.grad(f))(*many))
    assert_close(jax.grad(lambda a: jax.vmap(g, in_axes=(None, 0))(a, many[1]).sum())(a),
                 jax.grad(lambda a: jax.vmap(f, in_axes=(None, 0))(a, many[1]).sum())(a))  # fmt: skip


# loops


def per_agent(agent, x, shared):
    """Return a function of one agent that is too large to unroll; outputs are new, constant, forwarded, or shared."""
    R = so3.exp(x) @ so3.exp(agent["p"] @ x) @ so3.exp(shared) @ agent["p"]
    for _ in range(2):
        R = so3.exp(R[0]) @ R / (1 + (R * R).sum())
    return {"R": R, "half": R[:2, 1:], "zero": jnp.zeros(3), "p": agent["p"], "s": shared, "big": x > 0}


@pytest.mark.parametrize("agents", [1, 3, 9])
def test_maps_over_agents(agents):
    rng = np.random.default_rng(agents)
    agent = {"p": jnp.asarray(rng.normal(size=(agents, 3, 3))), "unused": jnp.zeros((agents, 5))}
    x, shared = jnp.asarray(rng.normal(size=(agents, 3))), jnp.asarray(rng.normal(size=3))

    def f(agent, x, shared):
        out = vmap_agents(per_agent, (0, 0, None))(agent, x, shared)
        again = vmap_agents(per_agent, (0, 0, None))({**agent, "p": out["R"]}, out["R"][:, 0], out["R"].sum((0, 1)))
        return {**out, "again": again, "mean": out["half"].mean(0)}

    check(f, agent, x, shared)


def test_scan_with_every_kind_of_output():
    def f(x, steps):
        def body(carry, step):
            R, k, done, unused = carry
            u, turn = step
            R = jnp.where(done, R, so3.exp(u) @ so3.exp(turn * u) @ so3.exp(R[0]) @ R)
            return (R, k + 1, done | (k > 12), unused), (R[0], k, done, jnp.zeros(2))

        start = (so3.exp(x), jnp.array(0), jnp.array(False), x)
        return jax.lax.scan(body, start, steps), jax.lax.scan(body, start, steps, reverse=True)

    rng = np.random.default_rng(0)
    check(f, X[:3], (jnp.asarray(rng.normal(size=(20, 3))), jnp.asarray(rng.normal(size=20))))


def random_team_program(seed):
    """Return a random function of `(agents, 3, 3)` and `(3, 3)`: maps over agents, array code and sums."""
    rng = np.random.default_rng(seed)
    mapped = vmap_agents(lambda a, b, s: (so3.exp(jnp.tanh(a[0])) @ b + s, jnp.sin(a) * b[1][None]), (0, 0, None))
    alone = [jnp.sin, lambda a: a / (1 + a * a), lambda a: a.swapaxes(1, 2), lambda a: a[:, ::-1], jnp.tanh,
             lambda a: jnp.concatenate([a[:, 1:], a[:, :1]], 1), lambda a: jnp.where(a > 0, a, -a / 2),
             lambda a: jnp.pad(a[:, :2], ((0, 0), (1, 0), (0, 0))), lambda a: a.reshape(-1, 9).reshape(a.shape),
             lambda a: jnp.broadcast_to(a.max(2)[:, :, None], a.shape), lambda a: jnp.cumsum(a, 1) / 3,
             lambda a: jnp.stack([a[:, 0], a[:, 1], a[:, 0]], 2), lambda a: a - a.mean(0)[None], lambda a: a[::-1],
             lambda a: so3.hat(a[:, 0])]  # fmt: skip
    joined = [
        jnp.add,
        jnp.multiply,
        lambda a, b: a @ b / 3,
        jnp.maximum,
        lambda a, b: jnp.einsum("nij,nkj->nik", a, b) / 3,
    ]
    shared = [
        lambda a, s: a @ s,
        lambda a, s: a * s[None],
        lambda a, s: a + jnp.trace(s),
        lambda a, s: a @ s[0][:, None] + a,
    ]
    steps = [(rng.integers(5), rng.integers(1 << 30), rng.random(3)) for _ in range(rng.integers(8, 25))]

    def f(a, s):
        values, sums = [a], [s]
        for kind, pick, at in steps:
            x, y = (values[int(u * len(values))] for u in at[:2])
            t = sums[int(at[2] * len(sums))]
            if kind == 0:
                values += mapped(x, y, t)
            elif kind == 1:
                values.append(joined[pick % len(joined)](x, y))
            elif kind == 2:
                values.append(shared[pick % len(shared)](x, t))
            elif kind == 3:
                sums.append(jnp.tanh(x.sum(0) * t))
            else:
                values.append(alone[pick % len(alone)](x))
        return [jnp.tanh(v) for v in values[-3:]], sums[-1], sum(values)

    return f


@pytest.mark.long
@settings(max_examples=5)
@given(st.integers(0, 10**9), st.integers(2, 9))
def test_random_programs_over_agents(seed, agents):
    rng = np.random.default_rng(seed)
    a, s = jnp.asarray(rng.normal(size=(agents, 3, 3))), jnp.asarray(rng.normal(size=(3, 3)))
    check(random_team_program(seed), a, s, tolerance=1e-11)


def test_code_size_is_independent_of_the_number_of_agents():
    def lines(agents):
        def f(agent, x, shared):
            out = vmap_agents(per_agent, (0, 0, None))(agent, 2 * x[:, ::-1], shared)
            return out, so3.exp(out["R"][:, 0] + x) @ agent["p"]

        rng = np.random.default_rng(0)
        agent = {"p": jnp.asarray(rng.normal(size=(agents, 3, 3)))}
        args = agent, jnp.zeros((agents, 3)), jnp.zeros(3)
        return emitted(f, *args, batched=True).count("\n")

    assert lines(64) == lines(16)


def test_arrays_without_elements_are_read_and_written():
    """For example of a vehicle without joints."""

    def f(none, log, i, x):
        none = jax.lax.fori_loop(0, i, lambda k, y: y.at[k].set(y[k] + x.sum()), none)
        log = log.at[i].set(jax.lax.dynamic_index_in_dim(none, i, keepdims=False).sum() + x[i])
        log = jax.lax.dynamic_update_slice(log, x[:0], (i,))
        return none, log.at[jnp.zeros((0,), int) + i].add(x[:0]), jnp.take(x, jnp.zeros((0,), int) + i)

    check(f, jnp.zeros((4, 2, 0)), jnp.zeros(4), jnp.asarray(2), jnp.arange(4.0))


def test_large_teams_do_not_overflow_the_stack():
    rng = np.random.default_rng(0)
    args = {"p": jnp.asarray(rng.normal(size=(300, 3, 3)))}, jnp.asarray(rng.normal(size=(300, 3))), jnp.ones(3)

    def f(agent, x, shared):
        first = vmap_agents(per_agent, (0, 0, None))(agent, x, shared)
        mean = first["half"].mean((0, 1, 2)) * shared
        return vmap_agents(per_agent, (0, 0, None))(agent, first["R"][:, 0], mean)["half"].sum(0)

    assert "= allocate(" in emitted(f, *args, batched=True).split("noinline")[-1]
    check(f, *args, tolerance=1e-10)


def test_dimensions_may_be_numpy_integers():
    def f(x):
        wide = jax.lax.broadcast_in_dim(x, (4, 2), (np.int64(0),))
        return vmap_agents(jnp.sin)(wide), jnp.transpose(wide, (np.int64(1), np.int64(0)))

    check(f, X)


def test_a_native_function_batched_inside_a_native_function():
    def one(x: jax.Array, y: jax.Array) -> jax.Array:
        return jnp.sin(x).sum() * y

    inner = codegen.compile(one)
    outer = codegen.compile(lambda x, y: jax.vmap(jax.vmap(inner, in_axes=(0, None)), in_axes=(None, 0))(x, y))
    x, y = jnp.arange(12.0).reshape(3, 4), jnp.arange(2.0)
    assert_close(outer(x, y), jax.vmap(jax.vmap(one, in_axes=(0, None)), in_axes=(None, 0))(x, y))


@pytest.mark.long
def test_vmap_agents_equals_vmap():
    def f(x, y):
        return {"a": jnp.sin(x) @ y, "b": x.sum()}

    rng = np.random.default_rng(0)
    x, y = jnp.asarray(rng.normal(size=(4, 3, 3))), jnp.asarray(rng.normal(size=3))
    mine, theirs = vmap_agents(f, (0, None)), jax.vmap(f, in_axes=(0, None))
    assert_close(mine(x, y), theirs(x, y))
    assert_close(jax.jit(mine)(x, y), theirs(x, y))
    for d in (jax.jacrev, jax.jacfwd, jax.hessian):
        assert_close(d(mine, argnums=(0, 1))(x, y), d(theirs, argnums=(0, 1))(x, y))
    assert_close(jax.vmap(mine, in_axes=(None, 0))(x, jnp.stack([y, -y])),
                 jax.vmap(theirs, in_axes=(None, 0))(x, jnp.stack([y, -y])))  # fmt: skip
    assert_close(jax.grad(lambda s: vmap_agents(lambda a: a * s)(x).sum())(2.0), x.sum())
    with pytest.raises(ValueError, match=r"equal lengths of their leading axes, got \[3, 4\]"):
        vmap_agents(f)(x, y)


# folding


def statements(f, *args):
    """Return the statements of the one emitted function."""
    text = emitted(f, *args, batched=False)
    (body,) = re.findall(r"noinline\)\) void f0\(.*?\) \{\n(.*?)\n\}", text, re.DOTALL)
    return [line.strip() for line in body.splitlines()]


def test_constants_fold_and_dead_code_is_dropped():
    C = jnp.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    body = statements(lambda x: (C @ x, x + 0.0), jnp.ones(3))
    assert [line for line in body if "*" in line.split("=")[1] or "+" in line.split("=")[1]] == []
    assert statements(lambda x: jnp.sin(x) * 0.0 + (x * 7.0 - x * 7.0), jnp.ones(())) == ["o0[0] = 0.0;"]


def test_folded_zeros_ignore_nan():
    """The only difference to JAX: a literal zero times or over x, and x - x, are zero as for real numbers."""
    f = codegen.compile(lambda x: (0.0 * x, 0.0 / x, x - x, (x + 1.0) - (1.0 + x)))
    for x in (jnp.nan, jnp.inf, 0.0):
        assert f(jnp.array(x)) == (0.0, 0.0, 0.0, 0.0)
    y = jnp.array(0.0)
    assert all(np.isnan(codegen.compile(lambda x, y: (y * x, x + y * x, x - y - x))(jnp.array(jnp.nan), y)))


def test_equal_expressions_are_computed_once():
    body = statements(lambda x, y: ((x * y) ** 2, (y * x) ** 2 + 1.0), jnp.ones(()), jnp.ones(()))
    assert sum("*" in line.split("=")[1] for line in body) == 2


# refusals and fallbacks


def test_unknown_operations_are_named_with_source_line():
    with pytest.raises(codegen.UnsupportedPrimitive, match=r"'sort' is not supported, at .*test_codegen\.py"):
        emitted(lambda x: jnp.sort(x), X, batched=False)


def test_too_large_programs_are_refused():
    with pytest.raises(codegen.UnsupportedPrimitive, match="'cumsum' would be 60000 statements of C"):
        emitted(jnp.cumsum, jnp.ones(60_000), batched=False)


def test_other_platforms_use_jax():
    traced = jax.jit(codegen.compile(so3.exp)).trace(X[1:])
    assert "colift_" in traced.lower(lowering_platforms=("cpu",)).as_text()
    assert "colift_" not in traced.lower(lowering_platforms=("cuda",)).as_text()


def test_single_precision_is_refused():
    with pytest.raises(TypeError, match=r"float64.*got float32"):
        jax.jit(codegen.compile(jnp.sin))(jnp.ones(3, jnp.float32))


def test_traced_closures_are_refused():
    with pytest.raises(TypeError, match="closes over a traced value"):
        jax.jit(lambda s: codegen.compile(lambda x: x * s)(X))(2.0)


def test_threads_must_be_positive():
    with pytest.raises(ValueError, match="threads is 0, must be at least 1"):
        codegen.compile(jnp.sin, threads=0)


# the plant


def plant_step(team, z, inputs, f, dt):
    """Return one step of the plant on the grasp."""
    return contact_dynamics.project_to_constraints(
        team, contact_dynamics.rkmk4_step(team, z, inputs, lambda z, _: f, dt)
    )


@pytest.mark.parametrize("structure", [teams.POOL[2], pytest.param(teams.POOL[6], marks=pytest.mark.long)])
def test_plant(structure):
    """One step of the plant with all team parameters as arguments: alone and in a batch of different teams."""
    rng = np.random.default_rng(0)
    samples = []
    for _ in range(BATCH):
        team, z = PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))
        inputs = tuple(
            AgentInput(
                u=jnp.asarray(rng.uniform(5, 20, size)),
                tau=jnp.asarray(rng.normal(size=(size, 3))),
                tau_r=jnp.asarray(rng.normal(size=(size, tree.joints))),
            )
            for tree, size in structure
        )
        samples.append((team, z, inputs, zero_residual(team), jnp.array(1e-4)))
    by_jax = jax.jit(plant_step)
    expected = [by_jax(*sample) for sample in samples]
    by_native = jax.jit(codegen.compile(plant_step))
    for sample, result in zip(samples, expected, strict=True):
        assert_close(by_native(*sample), result)
    flat = [jax.tree.leaves(sample) for sample in samples]  # a batch of teams does not have the annotated shapes
    batch = [jnp.stack(x) for x in zip(*flat, strict=True)]
    results = [jnp.stack(x) for x in zip(*map(jax.tree.leaves, expected), strict=True)]
    tree = jax.tree.structure(samples[0])
    step = codegen.compile(lambda *x: jax.tree.leaves(plant_step(*jax.tree.unflatten(tree, x))))
    assert_close(jax.jit(jax.vmap(step))(*batch), results)
