"""Tests of models before any data, and of the start of fits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import gp, scenario
from colift.onboard.learning.features import PAYLOAD_FEATURES, agent_feature_names
from colift.scenario import ScenarioError, priors, team


def test_prior_std_is_that_of_the_scenario():
    """Before any data the models predict the scenario's standard deviations."""
    s = scenario.load_scenario("paper")
    prior = s.learning.agents.signal_std
    model = priors.prior_model(s, team.team(s)[1])
    expected = np.repeat([prior.force_N, prior.moment_Nm, prior.joint_torque_Nm], 3) ** 2
    variance = jax.vmap(gp.variance)(model.agents[0], jnp.ones((2, 24)))
    np.testing.assert_allclose(variance, np.tile(expected, (2, 1)))
    assert np.abs(gp.mean(model.payload, jnp.ones(20))).max() == 0


def test_rotation_and_joint_rates_have_own_length_scales():
    """Rates of rotation and of joints have separate length-scales."""
    s = scenario.load_scenario("certified")
    assert (s.learning.payload.lengthscale, s.learning.payload.rate_lengthscale) == (3, 15)
    model = priors.prior_model(s, team.team(s)[1])
    rates = {"payload": ["omega_x", "omega_y", "omega_z", "|omega|"]}
    rates["agents"] = ["omega_x", "omega_y", "omega_z", "r_dot_1", "r_dot_2", "r_dot_3"]
    for name, features, hyper in (
        ("payload", PAYLOAD_FEATURES, model.payload.hyper),
        ("agents", agent_feature_names(3), jax.tree.map(lambda x: x[0], model.agents[0].hyper)),
    ):
        expected = [15.0 if feature in rates[name] else 3.0 for feature in features]
        np.testing.assert_array_equal(hyper.lengthscales, np.tile(expected, (len(hyper.signal_variance), 1)))


def test_too_small_noise_is_refused():
    """Noise that is too small for the number of samples is refused with its section."""
    s = scenario.load_scenario("paper")
    noise = s.learning.agents.noise_std.model_copy(update={"joint_torque_Nm": 1e-9})
    quiet = s.learning.agents.model_copy(update={"noise_std": noise})
    s = s.model_copy(update={"learning": s.learning.model_copy(update={"agents": quiet})})
    with pytest.raises(ScenarioError, match=r"^paper: learning.agents: output 6: "):
        priors.prior_model(s, team.team(s)[1])


def test_fits_start_from_the_stated_hyperparameters():
    """Fits start from the scenario's hyperparameters and stay within its bounds."""
    s = scenario.load_scenario("paper")
    _, nominal = team.team(s)
    training, model = priors.fit_options(s, nominal), priors.prior_model(s, nominal)
    assert (training.restarts, training.max_iterations) == (1, 300)
    stated = (model.payload.hyper, *(jax.tree.map(lambda x: x[0], group.hyper) for group in model.agents))
    for belief, hyper in zip((training.payload, *training.agents), stated, strict=True):
        assert (belief.min_lengthscale, belief.max_lengthscale, belief.scale_factor) == (0.1, 30.0, 3.0)
        jax.tree.map(np.testing.assert_array_equal, belief.median, hyper)
    certified = scenario.load_scenario("certified")
    assert priors.fit_options(certified, team.team(certified)[1]) is None
