"""Tests of the label loop gain: feedback from an agent's motion through its labels."""

from __future__ import annotations

import dataclasses
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.closed_loop import flight
from colift.math.pytree import pytree
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.onboard.control import label_feedback, redundancy, tracking
from colift.onboard.estimation import contact_forces, state_estimator
from colift.onboard.estimation.nav_filter import FilterBandwidths
from colift.scenario import experiment

ARM = "agent_types.two_arms.joints.{}.body.{}={}"


def parts(
    changes: list[str], name: str = "trio"
) -> tuple[AerialManipulator, jax.Array, tracking.Gains, FilterBandwidths]:
    """Return agent, nominal posture, gains and filters of a team's first agent in case `label_feedback`."""
    controller = experiment.make_experiment(scenario.load_scenario(name, changes), "label_feedback").controller
    agent = jax.tree.map(lambda x: x[0], controller.team.agent_groups[0])
    return (
        agent,
        controller.agent_controller.nominal_posture[0][0],
        controller.agent_controller.gains,
        controller.residual_corrector.filters,
    )


def arms(mass_kg: float, reach_m: float) -> list[str]:
    """Return settings of arms with another mass at another distance."""
    each = [("mass_kg", f"{mass_kg}"), ("center_of_mass_m", f"[0,0,{-reach_m}]")]
    return [ARM.format(joint, name, value) for joint in (1, 2) for name, value in each]


def test_posture_tilt_moves_all_tips_equally():
    """The center of mass can then move relative to the tips while these stay."""
    agent, rest, _, _ = parts([])
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, rest))
    tips = p.J_tip[:, :, :3] + p.J_tip[:, :, 3:] @ redundancy.posture_tilt_jacobian(agent, p)
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-10)


def test_loop_gain_increases_with_arm_mass_and_length():
    """The gain increases with mass and length of the arms and is zero without joints."""
    base = label_feedback.label_loop_gain(*parts([]), force=20.0)
    assert (
        0
        < base
        < label_feedback.label_loop_gain(*parts(arms(0.12, 0.3)), force=20.0)
        < label_feedback.label_loop_gain(*parts(arms(0.25, 0.3)), force=20.0)
    )
    assert label_feedback.label_loop_gain(*parts([]), force=40.0) == pytest.approx(base / 2)
    assert label_feedback.label_loop_gain(*parts([], "plate"), force=20.0) == 0
    assert label_feedback.label_loop_gain(*parts([]), force=0.0) == np.inf


def test_loop_gain_depends_on_filter_bandwidths():
    """Joint rates without delay give no loop gain, and slower label filters reduce it."""
    agent, rest, gains, filters = parts([])
    gain = label_feedback.label_loop_gain(agent, rest, gains, filters, 20.0)
    fast = dataclasses.replace(filters, joint=jnp.array(1e6))
    slow = dataclasses.replace(filters, label=filters.label / 2)
    assert label_feedback.label_loop_gain(agent, rest, gains, fast, 20.0) < 1e-3 * gain
    assert label_feedback.label_loop_gain(agent, rest, gains, slow, 20.0) < 0.5 * gain


def test_loop_gain_is_greater_with_encoders_alone():
    """Without gyroscope of the payload, encoders determine all joint motions, and the labels are attenuated more."""
    of = parts(HEAVY_ARMS)
    gain = label_feedback.label_loop_gain(*of, force=20.0, encoders_alone=True)
    assert gain > 100 * label_feedback.label_loop_gain(*of, force=20.0)
    heavy = [*HEAVY_ARMS, "sensors.payload_imu=false"]
    plan = experiment.make_experiment(scenario.load_scenario("trio", heavy), "label_feedback")
    assert max(float(a.max()) for a in plan.controller.residual_predictor.rate_attenuation) < 0.5


def test_rate_attenuation_is_one_to_a_half_and_zero_from_one():
    np.testing.assert_allclose(
        [label_feedback.rate_attenuation(g) for g in (0.0, 0.5, 0.75, 1.0, 3.0)], [1, 1, 0.5, 0, 0]
    )


HEAVY_ARMS = arms(0.25, 0.3)
ENCODERS_ALONE = mock.patch.object(contact_forces, "MIN_LEVER", 1e6)


@pytree
class EncoderRates(state_estimator.ComplementaryFilter):
    """Estimator whose joint rates follow from the encoders alone, with the delay of their filter."""

    def update(self, *arguments):
        with ENCODERS_ALONE:
            return super().update(*arguments)


def flight_reason(heavy: bool, encoders_alone: bool, attenuation: float | None = None) -> str:
    """Return the reason of a flight's termination, empty for a complete flight of one second."""
    setup = experiment.make_experiment(scenario.load_scenario("trio", HEAVY_ARMS if heavy else []), "label_feedback")
    controller = setup.controller
    if attenuation is not None:
        predictor = controller.residual_predictor
        shares = tuple(jnp.full_like(share, attenuation) for share in predictor.rate_attenuation)
        predictor = dataclasses.replace(predictor, rate_attenuation=shares)
        controller = dataclasses.replace(controller, residual_predictor=predictor)
    if encoders_alone:
        controller = dataclasses.replace(controller, estimator=EncoderRates(filters=controller.estimator.filters))
    result = flight.run_experiment(dataclasses.replace(setup, controller=controller, duration=1.0))
    if not result.termination_reason:
        assert np.linalg.norm(np.asarray(result.records.e_p), axis=1).max() < 0.2
    return result.termination_reason


@pytest.mark.parametrize(("changes", "limits"), [([], (0.3, 0.5)), (HEAVY_ARMS, (1.0, 2.0))])
def test_rates_of_tip_motion_open_the_label_loop(changes, limits, monkeypatch):
    """Joint rates by the encoders alone close the loop. Those of joints that move the tips do not depend on them."""
    agent, rest, gains, filters = parts(changes)
    assert label_feedback.label_loop_gain(agent, rest, gains, filters, 20.0) < 5e-3
    not_compiled = label_feedback._posture_motion.__wrapped__
    monkeypatch.setattr(label_feedback, "_posture_motion", jax.jit(lambda *of: not_compiled(*of)))
    with ENCODERS_ALONE:
        assert limits[0] < label_feedback.label_loop_gain(agent, rest, gains, filters, 24.0) < limits[1]


@pytest.mark.long
def test_heavy_arms_need_no_rate_attenuation():
    """Arms of 0.5 kg, whose flights fail where the joint rates follow from the encoders alone."""
    setup = experiment.make_experiment(scenario.load_scenario("trio", HEAVY_ARMS), "label_feedback")
    assert all(np.all(np.asarray(c) == 1.0) for c in setup.controller.residual_predictor.rate_attenuation)
    assert not flight_reason(heavy=True, encoders_alone=False)


@pytest.mark.long
@pytest.mark.parametrize("heavy", [False, True])
def test_rate_attenuation_keeps_the_flight_stable(heavy):
    """With encoder rates and arms of 0.5 kg, a flight fails within 0.2 s if the label rate is used in full."""
    if heavy:
        assert not flight_reason(heavy, encoders_alone=True, attenuation=0.0)
    assert bool(flight_reason(heavy, encoders_alone=True, attenuation=1.0)) == heavy
