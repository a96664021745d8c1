"""Tests of integers in generated code: results equal to JAX, or an error."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import codegen

KINDS = {"int64": (1 - 2**53, 2**53 - 1), "int32": (-(2**31), 2**31 - 1), "uint32": (0, 2**32 - 1)}
REFUSED = (jax.errors.JaxRuntimeError, ValueError)  # which of them is JAX's choice, by how it runs a call
STEPS = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "square": lambda a, b: a * a,
    "cube": lambda a, b: a**3,
    "sum": lambda a, b: jax.lax.reduce_sum(jnp.stack([a, b, a, b]), (0,)),
    "cumsum": lambda a, b: jax.lax.cumsum(jnp.stack([a, b, a]))[1],
    "dot": lambda a, b: jnp.stack([a, b]) @ jnp.stack([b, a]),
    "quotient": lambda a, b: jax.lax.div(a, b),
    "remainder": lambda a, b: jax.lax.rem(a, b),
    "written": lambda a, b: jnp.stack([a, b]).at[0].add(b)[0],
    "larger": jnp.maximum,
    "opposite": lambda a, b: -a,
    "size": lambda a, b: jnp.abs(a),
}


def exactly(name: str, a: int, b: int) -> list[int]:
    """Return the intermediate integers of a step by Python; an empty list if undefined."""
    quotient = [abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)] if b else []
    return {
        "add": [a + b], "sub": [a - b], "mul": [a * b], "square": [a * a], "cube": [a**3],
        "sum": [a + b, 2 * a + b, 2 * (a + b)], "cumsum": [a + b], "dot": [a * b, 2 * a * b],
        "quotient": quotient, "remainder": [a - b * quotient[0]] if b else [], "written": [a + b],
        "larger": [max(a, b)], "opposite": [-a], "size": [abs(a)],
    }[name]  # fmt: skip


COMPILED = {name: codegen.compile(f) for name, f in STEPS.items()}


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20)
@given(data=st.data())
def test_integer_steps_equal_jax_or_are_refused(kind, data):
    """Correct while all intermediate values are representable; otherwise an error."""
    low, high = KINDS[kind]
    near = st.sampled_from([low, low + 1, high, high - 1, 0, 1, 2, 2**16, 2**26 + 1]).filter(lambda x: low <= x <= high)
    one = st.one_of(near, st.integers(low, high), st.integers(max(low, -1000), 1000))
    a, b = data.draw(one), data.draw(one)
    name = data.draw(st.sampled_from([name for name in STEPS if kind != "uint32" or name not in ("opposite", "size")]))
    args = jnp.asarray(a, kind), jnp.asarray(b, kind)
    steps = exactly(name, a, b)
    if steps and all(low <= x <= high for x in steps):
        actual, expected = COMPILED[name](*args), STEPS[name](*args)
        assert actual.dtype == expected.dtype
        assert int(actual) == int(expected) == steps[-1]
    else:
        with pytest.raises(REFUSED, match="integer out of its type's range or beyond 2\\^53"):
            jax.block_until_ready(COMPILED[name](*args))


def test_one_overflow_in_a_batch_is_an_error():
    """One overflow in a batch raises an error and does not affect the next call."""
    square = jax.jit(jax.vmap(codegen.compile(lambda k: k * k, threads=2)))
    k = np.arange(300)
    assert (np.asarray(square(jnp.asarray(k))) == k**2).all()
    for at in (0, 7, 150, 299):
        bad = k.copy()
        bad[at] = 2**30
        with pytest.raises(REFUSED, match="integer out of its type"):
            jax.block_until_ready(square(jnp.asarray(bad)))
        assert (np.asarray(square(jnp.asarray(k))) == k**2).all()


def test_arguments_and_conversions_are_checked():
    scaled = codegen.compile(lambda k: k.astype(float) * 2.0)
    assert scaled(jnp.asarray(2**53 - 1)) == 2.0 * (2**53 - 1)
    whole = codegen.compile(lambda x: x.astype(jnp.int32))
    assert whole(jnp.asarray(-2147483648.9)) == -(2**31)
    for f, x in ((scaled, jnp.asarray(2**53)), (whole, jnp.asarray(2.0**31)), (whole, jnp.asarray(np.nan))):
        with pytest.raises(REFUSED, match="integer out of its type"):
            jax.block_until_ready(f(x))


def test_constant_overflow_is_refused_at_compile_time():
    with pytest.raises(OverflowError, match=r"an int64 would be 2\d+; .* carried exactly, at .*test_integers"):
        codegen.compile(lambda k: k + jnp.asarray(2**53 - 1) * jnp.asarray(3))(jnp.asarray(1))
    with pytest.raises(OverflowError, match=f"the integer {2**63 - 1} is not exactly a double"):
        codegen.compile(lambda k: k < jnp.asarray(2**63 - 1))(jnp.asarray(1))
    with pytest.raises(codegen.UnsupportedPrimitive, match="got int8"):
        codegen.kernel(jax.make_jaxpr(lambda k: k.astype(jnp.int8).astype(float))(jnp.asarray(1)))


def test_integers_at_computed_indices():
    k = jnp.asarray([4, 5, 6])
    f = lambda k: tuple(jnp.take(k, jnp.argmax(k) + 7, mode=mode) for mode in ("clip", "fill")) + (k[jnp.argmin(k)],)  # noqa: E731
    assert list(map(int, codegen.compile(f)(k))) == list(map(int, f(k)))
