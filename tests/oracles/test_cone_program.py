"""Solutions of the cone program against Clarabel, on random programs of 3 to 16 contacts."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.onboard.control import cone_program
from tests.support import cone_programs

TEAMS = {3: (3, 1), 4: (2, 2), 6: (3, 2), 16: (4, 4)}
solve = jax.jit(cone_program.solve)


def solver(of: cone_programs.Geometry, tolerance: float = 2e-6, iterations: int = 5000) -> cone_program.ConeProgram:
    program = cone_program.make_program(of.A, of.P, cone_programs.WEIGHTS, max_iterations=iterations)
    return dataclasses.replace(program, tolerance=jnp.asarray(tolerance))


def cold(program: cone_program.ConeProgram) -> cone_program.WarmStart:
    zero = jnp.zeros(program.A.shape[0])
    return cone_program.WarmStart(projected=zero, multipliers=zero)


@pytest.mark.parametrize("contacts", TEAMS)
def test_solution_equals_clarabel(contacts):
    """Objective within 1e-4, forces within 5e-3 N; programs that do not converge have a large residual."""
    of = cone_programs.ring(*TEAMS[contacts])
    program, rng, active = solver(of), np.random.default_rng(contacts), 0
    for _ in range(25):
        p = cone_programs.draw(of, rng)
        found = solve(program, jnp.asarray(p.x_0), jnp.asarray(p.b), p.sets, jnp.asarray(p.n), cold(program))
        x, expected = np.asarray(found.x), cone_programs.reference_solution(of, p)
        if np.asarray(found.residuals).max() > 2e-6:
            assert float(found.iterations) == 5000
            continue
        best = cone_programs.objective(of, p, expected)
        assert abs(cone_programs.objective(of, p, x) - best) < 1e-4 * max(1, best)
        np.testing.assert_allclose(x, expected, atol=5e-3)
        active += float(found.iterations) > 0
    assert active > 10
