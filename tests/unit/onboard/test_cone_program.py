"""Tests of the solver of cone programs: projections, free programs, warm starts and residuals."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from colift.onboard.control import cone_program
from tests.support import cone_programs

FAR = cone_program.UNLIMITED
project = jax.jit(cone_program.project)
solve = cone_programs.solve


def random_sets(rng: np.random.Generator, count: int) -> cone_program.ConeSets:
    axis = rng.normal(size=(count, 3))
    least = rng.uniform(-2, 2, count)
    return cone_program.ConeSets(
        axis=jnp.asarray(axis / np.linalg.norm(axis, axis=1, keepdims=True)),
        tan=jnp.asarray(np.where(rng.random(count) < 0.3, FAR, rng.uniform(0.1, 2, count))),
        minimum=jnp.asarray(np.where(rng.random(count) < 0.3, -FAR, least)),
        maximum=jnp.asarray(np.where(rng.random(count) < 0.3, FAR, np.abs(least) + rng.uniform(0.1, 3, count))),
    )


@given(seed=st.integers(0, 10**6))
def test_projection_is_the_nearest_point(seed):
    """The projection is in the set, and the angle to every other point of the set is obtuse."""
    rng = np.random.default_rng(seed)
    sets, v = random_sets(rng, 16), jnp.asarray(4 * rng.normal(size=(16, 3)))
    inside = project(v, sets)
    np.testing.assert_allclose(project(inside, sets), inside, atol=1e-9)
    for _ in range(10):
        other = project(jnp.asarray(4 * rng.normal(size=(16, 3))), sets)
        assert float(((v - inside) * (other - inside)).sum(1).max()) < 1e-8


def arguments(seed: int, iterations: int = 1000) -> tuple:
    of = cone_programs.ring(2, 2)
    program = cone_programs.make_program(of, 1e-4, iterations)
    p = cone_programs.draw(of, np.random.default_rng(seed))
    return program, jnp.asarray(p.x_0), jnp.asarray(p.b), p.sets, jnp.asarray(p.n), cone_programs.cold_start(program)


def test_free_program_returns_the_preferred_value():
    """Without an active limit no iteration is made, and a warm start has no effect."""
    program, x_0, b, sets, n, start = arguments(0)
    wide = dataclasses.replace(
        sets, **{name: jnp.full(6, x) for name, x in (("tan", FAR), ("minimum", -FAR), ("maximum", FAR))}
    )
    b = b.at[-6:].set(-(program.A @ x_0)[-6:])
    found = solve(program, x_0, b, wide, n, dataclasses.replace(start, multipliers=start.multipliers + 5))
    np.testing.assert_allclose(found.x, x_0, rtol=0, atol=1e-12)
    assert (float(found.iterations), float(found.residuals.max())) == (0, 0)


def test_warm_start_of_the_same_program_ends_at_once():
    """The first solution is more accurate than the tolerance: residuals are not monotone from one check to the next."""
    program, *data, start = arguments(1)
    first = solve(dataclasses.replace(program, tolerance=program.tolerance / 10), *data, start)
    again = solve(program, *data, first.warm_start)
    assert float(first.iterations) > 20
    assert float(again.iterations) == cone_program.CHECK_INTERVAL
    np.testing.assert_allclose(again.x, first.x, atol=1e-3)


def test_residuals_report_an_unfinished_solution():
    found = solve(*arguments(1, iterations=10))
    assert float(found.iterations) == 10
    assert float(found.residuals.max()) > 1e-3
