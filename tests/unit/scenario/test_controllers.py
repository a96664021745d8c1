"""Tests of controllers from settings: units, internal forces, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.models import grasp
from colift.onboard.control import bound_tips
from colift.scenario import ScenarioError, controllers, experiment, team, world
from tests.support.varied_scenarios import changed


@pytest.mark.parametrize("name", scenario.shipped_names())
def test_internal_forces_leave_the_wrench_unchanged(name):
    """Internal forces of shipped scenarios change contact forces and not the wrench."""
    s = scenario.load_scenario(name)
    if s.allocation.internal is None:
        pytest.skip("asks for none")
    _, nominal = team.team(s)
    allocation, internal = controllers.allocation(s, nominal)
    lam = np.asarray(allocation.nullspace @ internal.eta)
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


def gains_of(**control: object) -> tuple[list[float], list[float]]:
    """Return the rotational gains of the payload of scenario `paper` with other settings."""
    s = scenario.load_scenario("paper")
    s = s.model_copy(update={"control": s.control.model_copy(update=control)})
    gains = controllers.gains(s, team.team(s)[1])
    return np.asarray(gains.k_R).tolist(), np.asarray(gains.k_omega).tolist()


def test_single_rotational_gains_are_reduced_for_yaw():
    """A number holds for roll and pitch; three numbers are taken as they are."""
    s = scenario.load_scenario("paper")
    zero = bound_tips.yaw_zero(controllers.agents_in_hover(s, team.team(s)[1]))
    yaw = bound_tips.default_yaw_gains(zero, 60.0, 14.0)
    assert yaw[0] == pytest.approx((bound_tips.BANDWIDTH_RATIO * zero) ** 2)
    assert yaw[0] < 60.0
    assert gains_of(k_R=60.0, k_omega=14.0) == ([60.0, 60.0, yaw[0]], [14.0, 14.0, yaw[1]])
    three = (60.0, 50.0, 40.0), (14.0, 13.0, 12.0)
    assert gains_of(k_R=three[0], k_omega=three[1]) == tuple(map(list, three))
    assert gains_of(k_R=three[0], k_omega=14.0)[0] == list(three[0])
    assert gains_of(k_R=60.0, k_omega=three[1])[1] == list(three[1])
    assert gains_of(k_R=0.01, k_omega=1.0) == ([0.01] * 3, [1.0] * 3)


@pytest.mark.parametrize("name", ["plate", "paper", "uneven"])
def test_jerk_feedback_limits_the_loop_gain(name):
    """The share of the measured acceleration is 1 up to a loop gain of 0.8, and limits larger ones to it."""
    s = scenario.load_scenario(name)
    _, nominal = team.team(s)
    gains, hover = controllers.gains(s, nominal), controllers.agents_in_hover(s, nominal)
    loop_gain = bound_tips.acceleration_loop_gain(hover, gains, float(nominal.payload.mass), 9.81)
    assert (loop_gain > bound_tips.MAX_LOOP_GAIN) == (name != "paper")
    assert float(gains.jerk_feedback) * loop_gain == pytest.approx(min(loop_gain, bound_tips.MAX_LOOP_GAIN))


@pytest.mark.parametrize("name", ["paper", "plate"])
def test_integral_gain_has_the_bandwidth_of_each_axis(name):
    """The error dynamics `s^3 + k_omega s^2 + k_R s + k_i` are stable (Routh) by the same margin in pitch and yaw."""
    s = scenario.load_scenario(name)
    integral = experiment.make_experiment(s, "integral").controller.payload_controller
    k_R, k_omega, k_i = (np.asarray(x) for x in (integral.base.gains.k_R, integral.base.gains.k_omega, integral.k_i))
    assert k_R[2] < k_R[1]
    assert k_i[1] == s.baselines.attitude_integral_gain
    np.testing.assert_allclose(k_i / k_R**1.5, k_i[0] / k_R[0] ** 1.5)
    assert (k_i < 0.1 * k_R * k_omega).all()
