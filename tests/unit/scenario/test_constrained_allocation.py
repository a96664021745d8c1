"""Tests of the settings of the allocation within limits."""

import numpy as np
import pytest

from colift import scenario
from colift.onboard.control import cone_program, constrained_allocation
from colift.scenario import ScenarioError, controllers, team
from colift.workflows import python_api

NORMAL = {"front/left": [0, -1, 0], "front/right": [0, 2, 0], "rear/left": [0, -1, 0], "rear/right": [0, 1, 0]}


def load(**allocation):
    return python_api.load_scenario("paper", {"allocation": {"kind": "constrained", **allocation}})


def build(**allocation):
    settings = load(**allocation)
    _, nominal = team.team(settings)
    return controllers.make_controller(settings, nominal).allocator


def test_settings_reach_the_allocator():
    contact = {"friction": 0.6, "normal": NORMAL, "min_force_N": 2, "max_force_N": 20}
    part = build(tilt_deg=30, contact=contact)
    assert isinstance(part, constrained_allocation.ConstrainedAllocator)
    assert float(part.tan_tilt) == pytest.approx(np.tan(np.pi / 6))
    np.testing.assert_array_equal(part.contacts.axis[1], [0, 1, 0])
    for name, expected in (("tan", 0.6), ("minimum", 2), ("maximum", 20)):
        np.testing.assert_array_equal(getattr(part.contacts, name), [expected] * 4)


def test_contacts_without_limits_have_none():
    part = build()
    np.testing.assert_array_equal(part.contacts.tan, [cone_program.UNLIMITED] * 4)
    np.testing.assert_array_equal(part.contacts.minimum, [-cone_program.UNLIMITED] * 4)


def test_friction_implies_contacts_that_only_press():
    np.testing.assert_array_equal(build(contact={"friction": 0.6, "normal": NORMAL}).contacts.minimum, np.zeros(4))


@pytest.mark.parametrize(
    ("allocation", "message"),
    [
        ({"tilt_deg": 0.5}, "allocation.tilt_deg"),
        (
            {"contact": {"friction": 0.6}},
            "contact.friction: requires `contact.normal` of every contact; missing: front/",
        ),
        ({"contact": {"normal": {"front/lift": [0, 1, 0]}}}, "did you mean 'front/left'"),
        ({"contact": {"normal": {**NORMAL, "front/left": [0, 0, 0]}}}, "must not be zero"),
        (
            {"contact": {"normal": NORMAL, "min_force_N": 5, "max_force_N": 4}},
            "contact.min_force_N.* must not exceed max_force_N = 4, got 5",
        ),
    ],
)
def test_contradictory_settings_are_refused(allocation, message):
    with pytest.raises(ScenarioError, match=message.replace("(", r"\(")):
        load(**allocation)


def test_bound_of_the_position_error_reaches_the_controller():
    settings = scenario.load_scenario("paper", ["control.position_error_bound_m=0.3"])
    _, nominal = team.team(settings)
    assert float(controllers.make_controller(settings, nominal).payload_controller.position_error_bound) == 0.3
