"""Changes of waypoints: what they state, and that they are evaluated before."""

import dataclasses
import re

import numpy as np
import pytest

from colift.analysis import waypoint_remedies
from colift.scenario import schema


def waypoints(*poses: tuple[float, ...]) -> schema.Waypoints:
    """Waypoints of time, x, y and yaw."""
    listed = [{"time_s": t, "position_m": [x, y, 2], "rpy_deg": [0, 0, yaw]} for t, x, y, yaw in poses]
    return schema.Waypoints.model_validate({"kind": "waypoints", "poses": listed})


HOLD = waypoints((0, 0, 0, 0), (6, 1, 0, 0), (12, 1, 1, 90), (24, 1, 1, 90))
FAULTS = waypoint_remedies.Faults(8.75, True, False, False, np.inf, 24.0)


def test_the_first_change_that_works_is_stated():
    seen: list[schema.Waypoints] = []

    def works(changed: schema.Waypoints) -> bool:
        seen.append(changed)
        return len(seen) == 2

    sentence = waypoint_remedies.remedy(HOLD, FAULTS, works)
    added = [pose for pose in seen[-1].poses if pose not in HOLD.poses]
    stated = re.findall(r"time_s: ([\d.]+)", sentence)
    assert sentence.startswith("add the poses {time_s: ")
    assert len(seen) == 2
    assert [float(t) for t in stated] == [pose.time_s for pose in added]
    assert "rpy_deg: [0, 0, 45]" in sentence


@pytest.mark.parametrize("overshoot", [True, False])
def test_equal_intervals_are_evaluated(overshoot: bool):
    equal = waypoints((0, 0, 0, 0), (5, 1, 0, 0), (10, 1, 0, 0), (15, 0, 0, 0), (20, 0, 0, 0))
    faults = dataclasses.replace(FAULTS, overshoot=overshoot, excess=not overshoot, maximum=2.0)
    assert "0 more" not in waypoint_remedies.remedy(equal, faults, lambda changed: False)
    assert "leg" in waypoint_remedies.remedy(equal, faults, lambda changed: True) or overshoot


def test_added_poses_of_late_legs_have_ascending_times():
    late = waypoints((0, 0, 0, 0), (20001, 1, 0, 0), (20003, 1, 0, 0), (20004, 0, 0, 0))
    seen: list[schema.Waypoints] = []
    waypoint_remedies.remedy(late, FAULTS, lambda changed: bool(seen.append(changed)))
    assert seen
    assert all((np.diff([pose.time_s for pose in each.poses]) > 0).all() for each in seen)


def test_no_change_that_works_is_a_table_of_the_path():
    assert waypoint_remedies.remedy(HOLD, FAULTS, lambda changed: False).startswith("use a table of the whole path")
    assert waypoint_remedies.remedy_with_turns(HOLD, FAULTS, lambda changed: False) == ""


@pytest.mark.parametrize(("yaws", "pieces"), [((0, 360), 3), ((0, 190), 1), ((-10, 350, 0), 3)])
def test_stated_turns_need_several_legs(yaws, pieces):
    turned = waypoints(*((5 * k, k, 0, yaw) for k, yaw in enumerate(yaws)))
    assert waypoint_remedies.turn_pieces(turned, 0) == pieces


def test_added_poses_turn_by_the_stated_angles():
    turned = waypoints((0, 0, 0, 0), (6, 1, 0, 360), (12, 1, 1, 360), (24, 1, 1, 360))
    sentence = waypoint_remedies.remedy_with_turns(turned, FAULTS, lambda changed: True)
    assert "rpy_deg: [0, 0, 120]" in sentence
    assert "rpy_deg: [0, 0, 240]" in sentence


@pytest.mark.parametrize(("x", "text"), [(0.0123, "0.013"), (11.0, "11"), (10.1, "11"), (2.0, "2")])
def test_numbers_are_rounded_up(x, text):
    assert waypoint_remedies.rounded_up(x) == text
