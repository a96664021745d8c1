"""Solutions of the cone program against Clarabel, on random programs of 3 to 16 contacts."""

import numpy as np
import pytest

from tests.support import cone_programs


@pytest.mark.parametrize("contacts", cone_programs.RINGS)
def test_solution_equals_clarabel(contacts):
    """Objective within 1e-4, forces within 5e-3 N; programs that do not converge have a large residual."""
    of = cone_programs.ring(*cone_programs.RINGS[contacts])
    program, rng, active = cone_programs.make_program(of), np.random.default_rng(contacts), 0
    for _ in range(25):
        p = cone_programs.draw(of, rng)
        found = cone_programs.solution(program, p)
        x, expected = np.asarray(found.x), cone_programs.reference_solution(of, p)
        if np.asarray(found.residuals).max() > cone_programs.TOLERANCE:
            assert float(found.iterations) == cone_programs.ITERATIONS
            continue
        best = cone_programs.objective(of, p, expected)
        assert abs(cone_programs.objective(of, p, x) - best) < 1e-4 * max(1, best)
        np.testing.assert_allclose(x, expected, atol=5e-3)
        active += float(found.iterations) > 0
    assert active > 10
