"""Test of disturbances from settings: bodies, points and sizes."""

import numpy as np

from colift.scenario import disturbances, team
from colift.simulation.disturbances import initial_forces
from tests.support import random_teams as teams
from tests.support.varied_scenarios import mixed


def test_sources_act_on_the_named_bodies():
    truth, _ = team.team(mixed())
    z = teams.free_state(
        np.random.default_rng(0), tuple((g.tree, n) for g, n in zip(truth.agent_groups, truth.sizes, strict=True))
    )
    forces = initial_forces(disturbances.make_disturbances(mixed()), truth, z)
    up = [np.asarray(q.R[:, :, 2]) for q in z.agents]
    np.testing.assert_allclose(forces.agents[0].f_x, 0.5 * up[0] + np.array([[0, 0, 0], [1, 2, 3]]))
    np.testing.assert_allclose(forces.agents[1].f_x, 0.5 * up[1])
    # on crane a the bias alone: at the base, off the center of mass by the hook's share of the mass
    np.testing.assert_allclose(forces.agents[0].f_r[0], [-0.5 * 0.8 * 0.1 / 1.1])
    r_dot = z.agents[1].r_dot[0]
    np.testing.assert_allclose(forces.agents[1].f_r[0], -0.3 * r_dot - 0.1 * np.tanh(r_dot / 0.05))
    assert np.abs(forces.payload.F).max() == 0
