"""Test of initial states of shipped scenarios: on the manifold, off the reference as stated."""

import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.math import so3
from colift.models import grasp
from colift.scenario import initial_states, team, trajectories

LONG = {"beam", "seven", "leader_block"}  # longer to build than a test should take


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in scenario.shipped_names()]
)
def test_initial_states_are_on_the_manifold(name):
    """Shipped scenarios start on the manifold with the stated offset from the reference."""
    s = scenario.load_scenario(name)
    truth, _ = team.team(s)
    z = initial_states.initial_state(s, truth)
    assert np.abs(grasp.constraint_residual(truth, z)).max() <= 1e-10
    assert np.abs(grasp.constraint_rate(truth, z)).max() <= 1e-10
    d = trajectories.make_reference(s).evaluate(jnp.zeros(()))
    np.testing.assert_allclose(z.payload.p - d.p, s.initial_state.position_error_m, atol=1e-3)
    np.testing.assert_allclose(so3.log(d.R.T @ z.payload.R), np.deg2rad(s.initial_state.attitude_error_deg), atol=1e-3)
