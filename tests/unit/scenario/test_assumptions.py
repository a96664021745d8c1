"""What error bounds rest on: what a scenario states, and what of it holds by construction."""

import numpy as np
import pytest

from colift import scenario
from colift.models.state import zero_residual
from colift.scenario import ScenarioError, assumptions, experiment, team
from tests.support.varied_scenarios import changed


def test_error_bounds_rest_on_what_the_scenario_states():
    s = scenario.load_scenario("paper")
    _, nominal = team.team(s)
    stated = assumptions.bound_assumptions(s, nominal, zero_residual(nominal))
    given = s.certificate
    assert (stated.bound, stated.confidence, stated.rkhs_norm) == ("energy", 0.95, 6)
    assert given.payload_label_error is not None
    assert given.agent_label_error is not None
    np.testing.assert_array_equal(
        stated.payload, [given.payload_label_error.force_N] * 3 + [given.payload_label_error.moment_Nm] * 3
    )
    row = (
        [given.agent_label_error.force_N] * 3
        + [given.agent_label_error.moment_Nm] * 3
        + [given.agent_label_error.joint_torque_Nm] * 3
    )
    np.testing.assert_array_equal(stated.agents[0], [row, row])
    assert stated.assumed == ("rkhs norm", "bounded noise energy")  # of a team among winds nobody knows them


def test_label_errors_that_are_not_stated_are_three_deviations():
    """Label errors that are not stated are three deviations of the prior is noise."""
    s = changed("paper", certificate={})
    _, nominal = team.team(s)
    stated = assumptions.bound_assumptions(s, nominal, zero_residual(nominal))
    noise = s.learning.agents.noise_std
    np.testing.assert_allclose(stated.payload, [0.3] * 3 + [0.06] * 3)
    row = 3 * np.repeat([noise.force_N, noise.moment_Nm, noise.joint_torque_Nm], 3)
    np.testing.assert_allclose(stated.agents[0], [row, row])


def test_in_the_certified_scenario_nothing_is_assumed_unless():
    """In the certified scenario nothing is assumed unless it is changed."""

    def assumed(**sections: object) -> tuple[str, ...]:
        return experiment.make_experiment(changed("certified", **sections), "C1").bound_assumptions.assumed

    certified = scenario.load_scenario("certified")
    assert certified.random_residual is not None
    norm, learning = certified.random_residual.rkhs_norm, certified.learning.model_dump()
    bounds = ("energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler")
    for bound in bounds:
        assert assumed(certificate={"error_bound": bound, "rkhs_norm": norm}) == ()
    assert assumed(certificate={"rkhs_norm": 0.9 * norm}) == ("rkhs norm",)
    assert assumed(disturbances=scenario.load_scenario("paper").disturbances) == ("rkhs norm",)
    assert assumed(nominal={"payload": scenario.load_scenario("paper").payload.model_dump() | {"mass_kg": 1.2}}) == (
        "rkhs norm",
    )
    assert assumed(random_residual=None, learning=learning | {"rig_label_error": None}) == (
        "rkhs norm",
        "bounded noise energy",
    )
    fitted = {
        "certificate": {"error_bound": "abbasi_yadkori", "rkhs_norm": norm},
        "learning": learning | {"hyperparameters": "optimized"},
    }
    assert assumed(**fitted) == ("rkhs norm", "fixed hyperparameters")
    small = {"force_N": 1e-6, "moment_Nm": 1e-6}
    assert assumed(certificate={"rkhs_norm": norm, "payload_label_error": small}) == ("bounded noise energy",)


def test_a_label_error_of_zero_is_refused():
    learning = scenario.load_scenario("certified").learning.model_dump() | {"rig_label_error": 0.0}
    with pytest.raises(ScenarioError, match=r"certificate: label error .* must be positive"):
        experiment.make_experiment(changed("certified", learning=learning), "C1")
