"""Tests of the assumptions of error bounds: values stated by a scenario, and which hold by construction."""

import numpy as np
import pytest

from colift import scenario
from colift.models.state import zero_residual
from colift.scenario import ScenarioError, assumptions, experiment, team
from tests.support.varied_scenarios import changed


def test_bound_assumptions_have_the_stated_values():
    s = scenario.load_scenario("paper")
    _, nominal = team.team(s)
    stated = assumptions.bound_assumptions(s, nominal, zero_residual(nominal))
    certificate = s.certificate
    assert (stated.bound, stated.confidence, stated.rkhs_norm) == ("energy", 0.95, 6)
    assert certificate.payload_label_error is not None
    assert certificate.agent_label_error is not None
    np.testing.assert_array_equal(
        stated.payload,
        [certificate.payload_label_error.force_N] * 3 + [certificate.payload_label_error.moment_Nm] * 3,
    )
    row = (
        [certificate.agent_label_error.force_N] * 3
        + [certificate.agent_label_error.moment_Nm] * 3
        + [certificate.agent_label_error.joint_torque_Nm] * 3
    )
    np.testing.assert_array_equal(stated.agents[0], [row, row])
    assert stated.assumed == ("rkhs norm", "bounded noise energy")  # unknown for a team in wind


def test_default_label_errors_are_three_std():
    """Label errors that are not stated are three standard deviations of the prior noise."""
    s = changed("paper", certificate={})
    _, nominal = team.team(s)
    stated = assumptions.bound_assumptions(s, nominal, zero_residual(nominal))
    noise = s.learning.agents.noise_std
    np.testing.assert_allclose(stated.payload, [0.3] * 3 + [0.06] * 3)
    row = 3 * np.repeat([noise.force_N, noise.moment_Nm, noise.joint_torque_Nm], 3)
    np.testing.assert_allclose(stated.agents[0], [row, row])


def test_certified_scenario_assumes_nothing():
    """A changed certified scenario has unproven assumptions."""

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


def test_zero_label_error_is_refused():
    learning = scenario.load_scenario("certified").learning.model_dump() | {"rig_label_error": 0.0}
    with pytest.raises(ScenarioError, match=r"certificate: label error .* must be positive"):
        experiment.make_experiment(changed("certified", learning=learning), "C1")
