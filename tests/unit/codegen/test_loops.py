"""Tests of loops, branches and computed indices in generated code against JAX, on random shapes and indices."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import codegen, gp
from colift.codegen import outlining
from tests.unit.codegen.test_codegen import assert_close, check, emitted


def check_single(f, *args):
    """Assert that native code equals JAX, without a batch."""
    assert_close(jax.jit(codegen.compile(f))(*args), jax.jit(f)(*args))


@pytest.mark.long
@settings(max_examples=6)
@given(st.integers(0, 10**9))
def test_random_indices(seed):
    """Reads and writes at indices in and out of range in all modes of JAX; integers and masks too."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(1, 6, 3))
    A, i = jnp.asarray(rng.normal(size=shape)), jnp.asarray(rng.integers(-9, 9, (2, 3)))
    new, k = jnp.asarray(rng.normal(size=(2, shape[2]))), jnp.asarray(rng.integers(0, 9, shape))
    sizes = tuple(int(rng.integers(1, n + 1)) for n in shape)

    def f(A, i, new, k):
        reads = [A.at[i[:, 0], i[:, 1]].get(mode=mode) for mode in ("clip", "fill")] + [
            A[i[0, 0], :, i[1, 2]],
            k[i[0, 1]],
        ]
        writes = [A.at[i[0, 0]].set(new[0], mode="drop"), A.at[i[0, 0], i[0, 1]].add(new[1], mode="clip")]
        writes += [A.at[i[:, 0], 0].multiply(new), A.at[i[:, 0], i[:, 1]].max(new), k.at[i[1]].add(2)]
        part = jax.lax.dynamic_slice(A, i[0], sizes)
        return reads, writes, part, jax.lax.dynamic_update_slice(A, part + 1, i[1]), (A > 0).at[i[1, 0]].set(True)

    check(f, A, i, new, k)


@pytest.mark.parametrize("ticks", [0, 1, 7])
def test_while_writes_to_its_carry(ticks):
    """A log written by rows, growing data, a state, and constants; in a batch each sample ends separately."""

    def f(x, ticks, log):
        def body(carry):
            x, log, data, i, kept = carry
            now = (x[0] > 0.2) | (i == 2)
            data, _ = jax.vmap(gp.keep_first, in_axes=(0, 0, 0, None, None))(
                data, jnp.stack([x, -x]), x[:2, None], x[1], now
            )
            return jnp.sin(x + kept[i % 3]) + 0.1, log.at[i].set(x * 2), data, i + 1, kept

        start = (x, log, gp.empty_dataset(3, 3, 1, batch=(2,)), jnp.zeros((), int), jnp.array([0.1, 0.5, -0.3]))
        return jax.lax.while_loop(lambda c: (c[3] < ticks) & (c[0].sum() < 2.8), body, start)

    x, log = jnp.array([0.3, -0.1, 0.2]), jnp.zeros((5, 3)) - 1
    check_single(f, x, jnp.array(ticks), log)
    many = jnp.asarray(np.random.default_rng(0).normal(size=(6, 3))), jnp.arange(6), jnp.tile(log, (6, 1, 1))
    assert_close(jax.jit(jax.vmap(codegen.compile(f)))(*many), jax.jit(jax.vmap(f))(*many))


def test_log_is_written_in_place():
    def f(log, n):
        step = lambda c: (c[0].at[c[1]].set(jnp.sin(c[0][c[1] - 1]) + 1), c[1] + 1)  # noqa: E731
        return jax.lax.while_loop(lambda c: c[1] < n, step, (log, n - n))

    log = jnp.asarray(np.random.default_rng(0).normal(size=(30, 4)))
    text = emitted(f, log, jnp.array(20), batched=False)
    assert text.count("memcpy(m, a0, 120 ") + text.count("memcpy(m, in[0], 120 ") <= 1
    assert sum("120 * sizeof" in line for line in text.splitlines()) <= 2  # in, and out
    check_single(f, log, jnp.array(20))


@pytest.mark.parametrize("length", [0, 1, 2, 33])
def test_scans_of_any_length(length):
    rng = np.random.default_rng(length)
    steps = jnp.asarray(rng.normal(size=(length, 12)))

    def f(x, A, steps):
        def step(c, s):
            y = jnp.tanh(A @ jnp.cos(A) @ c[0] + s)  # cos(A) is the same in every step
            return (y, c[1].at[jnp.argmax(y)].add(1)), y * c[0]

        return jax.lax.scan(step, (x, jnp.zeros(12, int)), steps), jax.lax.scan(
            step, (x, jnp.zeros(12, int)), steps, reverse=True
        )

    check(f, jnp.ones(12), jnp.asarray(rng.normal(size=(12, 12)) / 12), steps)


def test_large_branches_are_not_evaluated_both():
    def f(k, A):
        many = [lambda A, s=s: jnp.sin(A @ A * s) @ jnp.cos(A) + s for s in (1.0, 2.0, 3.0)]
        return jax.lax.switch(k, many, A), jax.lax.cond(k > 0, many[0], lambda A: A, A)

    A = jnp.asarray(np.random.default_rng(0).normal(size=(6, 6)))
    assert "else if (which <= 1.0)" in emitted(f, jnp.array(1), A, batched=False)
    natively, by_jax = jax.jit(codegen.compile(f)), jax.jit(f)
    for k in (-1, 0, 1, 2, 5):
        assert_close(natively(jnp.array(k), A), by_jax(jnp.array(k), A))
    ks = jnp.arange(-1, 6)
    many = jax.jit(jax.vmap(codegen.compile(f), in_axes=(0, None)))(ks, A)
    assert_close(many, jax.jit(jax.vmap(f, in_axes=(0, None)))(ks, A))


@pytest.mark.long
@settings(max_examples=5)
@given(st.integers(0, 10**9))
def test_random_programs_of_large_arrays(seed):
    """Elementwise code, products, transposes and reductions along long axes, combined at random."""
    rng = np.random.default_rng(seed)
    n, m = (int(k) for k in rng.choice([16, 19, 37, 64], 2))
    a, b = jnp.asarray(rng.normal(size=(n, m))), jnp.asarray(rng.normal(size=(2, m, 5)))
    steps = [(int(rng.integers(9)), *rng.random(2)) for _ in range(10)]

    def step(kind, x, y, b):
        return [
            lambda: jnp.sin(x) * y,
            lambda: (x @ b[0] @ b[1].T) / m,
            lambda: x - y.mean(0)[None],
            lambda: x * y.max(1)[:, None],
            lambda: (x.T @ y).sum(1)[None] / n + x,
            lambda: jnp.where(x > y, x, -y),
            lambda: x[::-1] + jnp.cumsum(y, 0) / n,
            lambda: jnp.concatenate([x[:, 1:], y[:, :1]], 1),
            lambda: x / (1 + jnp.einsum("ij,kj->i", y, x)[:, None] ** 2),
        ][kind]()

    def f(a, b):
        values = [a, jnp.exp(-jnp.abs(a))]
        for kind, p, q in steps:
            values.append(step(kind, values[int(p * len(values))], values[int(q * len(values))], b))
        last = jnp.tanh(values[-1])
        return last, last.sum(), (last > 0).any(0), last.min(1), jnp.prod(1 + last / 99)

    check(f, a, b, tolerance=1e-10)


def test_reductions_of_empty_arrays_and_nan():
    x = jnp.zeros((40, 40)).at[3, 4].set(jnp.nan)

    def f(x):
        y = jnp.sqrt(x + 1) * x
        return y[:0].sum(0), y[:, :0].max(1, initial=-1.0), y.sum(1), y.max(0), y.min(), (y > 0).all(), y[:0] @ y

    jax.tree.map(np.testing.assert_array_equal, codegen.compile(f)(x), jax.jit(f)(x))


def test_posterior_means_compile_to_loops():
    rng = np.random.default_rng(0)
    hyper = gp.make_hyperparameters(np.array([1.0, 0.3]), rng.uniform(1, 2, (2, 6)), 1e-2, 0.5)
    models = [gp.condition(rng.normal(size=(50, 6)), rng.normal(size=(50, 2)), hyper, 61) for _ in range(3)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *models)

    def f(model, x):
        return jax.vmap(gp.mean)(model, x), jax.vmap(gp.variance)(model, x)

    x = jnp.asarray(rng.normal(size=(3, 6)))
    assert emitted(f, stacked, x, batched=False).count("\n") < 2000
    flat, tree = jax.tree.flatten((stacked, x))  # a batch of models does not have the annotated shapes
    g = lambda *leaves: f(*jax.tree.unflatten(tree, leaves))  # noqa: E731
    assert_close(jax.jit(codegen.compile(g))(*flat), jax.jit(g)(*flat), 1e-11)


def test_exponentials_are_exact_to_rounding():
    x = np.concatenate([np.linspace(-746, 711, 4001), [0.0, -0.0, 1e-300, np.inf, -np.inf, np.nan, 709.78, -745.1]])
    f = codegen.compile(jnp.exp)
    for actual in (jax.vmap(f)(jnp.asarray(x)), jnp.stack([f(jnp.asarray(v)) for v in x[::97]])):
        expected = np.array(
            [math.inf if v > 709.79 else math.exp(v) for v in (x if actual.size == x.size else x[::97])]
        )
        np.testing.assert_allclose(
            actual, expected, rtol=4e-16, atol=2.3e-308
        )  # XLA runs with denormals flushed to zero


def test_long_functions_are_split(monkeypatch):
    """Split functions compute the same; values and masks that are used later are stored in the frame."""
    monkeypatch.setattr(outlining, "MAX_PART_LINES", 40)
    A = jnp.asarray(np.random.default_rng(0).normal(size=(6, 6)))

    def f(A):
        mask = A > 0.1
        B = jnp.sin(A) @ A
        C = jnp.linalg.inv(B @ B.T + jnp.eye(6))
        return jnp.where(mask, C, B), jnp.linalg.det(C), jnp.arctan2(B, C)

    assert "f0_3(" in emitted(f, A, batched=False)
    check(f, A, tolerance=1e-10)
