"""Tests of controllers from settings: units, internal forces, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.models import grasp
from colift.scenario import ScenarioError, controllers, team, world
from tests.support.varied_scenarios import changed


@pytest.mark.parametrize("name", scenario.shipped_names())
def test_internal_forces_leave_the_wrench_unchanged(name):
    """Internal forces of shipped scenarios change contact forces and not the wrench."""
    s = scenario.load_scenario(name)
    if s.allocation.internal is None:
        pytest.skip("asks for none")
    _, nominal = team.team(s)
    experiment, internal = controllers.allocation(s, nominal)
    lam = np.asarray(experiment.nullspace @ internal.eta)
    assert np.linalg.norm(lam) >= 1
    assert np.linalg.norm(lam.reshape(-1, 3), axis=1).max() >= 0.5
    G = np.asarray(grasp.grasp_matrix(grasp.contact_points(nominal), jnp.eye(3)))
    assert np.abs(G @ lam).max() <= 1e-12
    assert (float(internal.start), float(internal.end)) == (8, 14)


def test_missing_internal_forces_are_refused():
    """A request of internal forces that do not exist is an error that states so."""
    leaders = {"kind": "leader_follower", "leader_contacts": ["front/left", "front/right", "rear/left"]}
    internal = scenario.load_scenario("paper").allocation.internal
    assert internal is not None
    s = changed("paper", allocation=leaders)
    _, nominal = team.team(s)
    assert controllers.allocation(s, nominal)[0].nullspace.shape == (12, 0)
    with pytest.raises(ScenarioError, match="no internal force"):
        controllers.allocation(changed("paper", allocation=leaders | {"internal": internal.model_dump()}), nominal)


def test_leader_block_without_full_rank_is_refused():
    """A leader block that cannot carry every wrench is refused."""
    s = changed("paper", allocation={"kind": "leader_follower", "leader_contacts": ["front/left", "front/right"]})
    with pytest.raises(ScenarioError, match="rank 5"):
        controllers.allocation(s, team.team(s)[1])


def test_sensors_and_controller_are_in_SI():
    s = scenario.load_scenario("paper")
    noise = world.make_sensor_noise(s)
    np.testing.assert_allclose(noise.attitude, 0.2 * np.pi / 180)
    np.testing.assert_allclose(noise.joint_position, 0.1 * np.pi / 180)
    controller = controllers.make_controller(s, team.team(s)[1])
    np.testing.assert_allclose(controller.recorder.sample_period, 1 / s.learning.sample_Hz)
    np.testing.assert_array_equal(controller.payload_controller.gains.K_p, np.diag(s.control.K_p))
    assert not bool(controller.recorder.payload)
    assert all(leaf.dtype in (jnp.float64, int, bool) and not leaf.weak_type for leaf in jax.tree.leaves(controller))


def test_preview_step_selects_the_preview_controller():
    settings = scenario.load_scenario("paper")
    far = settings.model_copy(update={"control": settings.control.model_copy(update={"preview_step_s": 0.03})})
    _, nominal = team.team(settings)
    ours, theirs = controllers.make_controller(settings, nominal), controllers.make_controller(far, nominal)
    assert (type(ours.agent_controller).__name__, ours.preview_step) == ("ThrustVectoringController", None)
    assert (type(theirs.agent_controller).__name__, float(theirs.preview_step)) == (
        "PreviewThrustVectoringController",
        0.03,
    )
