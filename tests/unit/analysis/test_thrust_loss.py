"""Tests of the largest loss of thrust against closed forms and against all basic solutions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from colift.analysis import thrust_loss
from colift.models.parameters import Team
from colift.models.state import State
from colift.scenario import initial_states, team, termination
from tests.support import paper_flights as paper
from tests.support import small_team as light


def level(contacts: np.ndarray, **changes: object) -> tuple[Team, State]:
    """Return a team of single bodies with one contact each, and its state at rest."""
    agents = [
        {"name": f"n{i}", "type": "body", "contact_positions_m": [tuple(map(float, c))]} for i, c in enumerate(contacts)
    ]
    settings = light.settings(agents=agents, **changes)
    truth, _ = team.team(settings)
    return truth, initial_states.equilibrium_state(settings, truth)


def brute_force(truth: Team, contacts: np.ndarray) -> np.ndarray:
    """Return the losses by all basic solutions: all lifts but three are at a limit."""
    g, count = float(np.linalg.norm(truth.gravity)), len(contacts)
    (group,) = truth.agent_groups
    mass, most = np.asarray(group.mass).sum(1), np.asarray(group.thrust_max)
    A = np.vstack([np.ones(count), contacts[:, 1], contacts[:, 0]])
    b = np.array([float(truth.payload.mass) * g, 0.0, 0.0])
    least = np.full(count, np.inf)
    for free in itertools.combinations(range(count), 3):
        fixed = [i for i in range(count) if i not in free]
        if abs(np.linalg.det(A[:, free])) < 1e-9:
            continue
        for ends in itertools.product((0.0, 1.0), repeat=len(fixed)):
            lift = np.zeros(count)
            lift[fixed] = np.array(ends) * most[fixed] - mass[fixed] * g
            lift[list(free)] = np.linalg.solve(A[:, free], b - A @ lift)
            u = lift + mass * g
            if (u > -1e-9).all() and (u < most + 1e-9).all():
                least = np.minimum(least, u)
    return 1 - least / most


@pytest.mark.parametrize(("count", "seed"), [(3, 0), (4, 1), (4, 2), (5, 3), (6, 4)])
def test_loss_is_that_of_the_best_basic_solution(count, seed):
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    contacts = np.stack([0.4 * np.cos(angle), 0.4 * np.sin(angle), np.full(count, 0.03)], axis=1)
    truth, state = level(contacts)
    np.testing.assert_allclose(thrust_loss.largest_losses(truth, state), brute_force(truth, contacts), atol=1e-7)


def test_two_agents_with_two_arms_may_lose_their_hover_margin():
    """The lift of each agent is fixed by the pitch equilibrium, so nothing can be shared."""
    setup = paper.paper_experiment("C1")
    truth = setup.world.team
    z = initial_states.equilibrium_state(paper.SETTINGS, truth)
    hover = termination.undisturbed_hover_thrust(truth, setup.controller, z)
    most = np.asarray(truth.agent_groups[0].thrust_max)
    np.testing.assert_allclose(thrust_loss.largest_losses(truth, z), 1 - hover / most, atol=1e-6)


def test_finding_names_the_share_of_each_agent():
    settings = light.settings()
    truth, _ = team.team(settings)
    state = initial_states.equilibrium_state(settings, truth)
    (finding,) = thrust_loss.check_losses(settings, truth, state)
    shares = finding.values["largest_thrust_loss"]
    assert list(shares) == [agent.name for agent in settings.agents]
    assert finding.message.endswith(", ".join(f"{name} {share:.1%}" for name, share in shares.items()))


def test_team_without_weight_has_no_finding():
    settings = light.settings(gravity_mps2=(0.0, 0.0, 0.0))
    truth, _ = team.team(settings)
    state = initial_states.equilibrium_state(settings, truth)
    assert not list(thrust_loss.check_losses(settings, truth, state))
