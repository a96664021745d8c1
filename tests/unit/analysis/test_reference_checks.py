"""Checks of references through poses: overshoot, acceleration and half turns, each with a remedy."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from colift import scenario
from colift.analysis import reference_checks
from colift.scenario import Scenario, schema, team

SHORT = ["learning.start_s=0.2", "learning.end_s=1", "learning.update_times_s=[0.9]"]


def waypoints(*poses: tuple[float, ...]) -> Scenario:
    """Waypoints of time and position, and optionally yaw."""
    listed = ", ".join(
        f"{{time_s: {t}, position_m: {list(p[:3])}, rpy_deg: [0, 0, {p[3] if len(p) > 3 else 0}]}}" for t, *p in poses
    )
    return scenario.load_scenario("hover", [f"reference={{kind: waypoints, poses: [{listed}]}}", "duration_s=60"])


def sampled(folder: Path, rows: np.ndarray, options: str = "", columns: str = "time_s,x_m,y_m,z_m") -> Scenario:
    lines = "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in rows)
    (folder / "log.csv").write_text(f"{columns}\n{lines}")
    return scenario.load_scenario(
        "hover",
        [f"reference={{kind: sampled, file: {folder / 'log.csv'}{options}}}", f"duration_s={rows[-1, 0]:.2f}", *SHORT],
    )


def found(settings: Scenario) -> reference_checks.ReferenceFinding:
    made = reference_checks.check_reference(settings, team.team(settings)[0])
    assert made is not None
    assert len(made.advice) == len(made.warnings)
    return made


def test_a_lissajous_curve_is_not_checked():
    s = scenario.load_scenario("hover")
    assert reference_checks.check_reference(s, team.team(s)[0]) is None


def test_gentle_waypoints_pass():
    seen = found(waypoints((0, 0, 0, 2), (5, 1, 0, 2), (10, 1, 1, 3)))
    assert seen.advice == ()
    assert re.fullmatch(r"3 waypoints; largest acceleration [\d.]+ m/s² at [\d.]+ s", seen.message)


UNEVEN = [(0, 0, 0, 2), (4, 1, 0, 2), (4.1, 1.1, 0.1, 2), (12, 4, 1, 2)]


def test_an_overshoot_has_leg_time_size_and_a_time_that_helps():
    seen = found(waypoints(*UNEVEN))
    size = float(seen.values["overshoot_m"])
    text = (
        rf"leaves the box of its poses by {size:.3g} m along [xy] in leg \d \(from [\d.]+ s to [\d.]+ s\) at [\d.]+ s"
    )
    assert re.search(text, seen.message)
    assert size > 0.2
    legs, least = re.fullmatch(r"give legs? ([\d, and]+) at least ([\d.]+) s \(reference.*\)", seen.advice[0]).groups()
    T = np.diff([t for t, *_ in UNEVEN])
    for k in re.findall(r"\d+", legs):
        T[int(k) - 1] = float(least)
    times = np.concatenate([[0], np.cumsum(T)])
    eased = found(waypoints(*[(t, *p) for t, (_, *p) in zip(times, UNEVEN, strict=True)]))
    assert "leaves the box" not in eased.message


def typed(settings: Scenario, advice: str) -> Scenario:
    """Waypoints with the change that an advice states."""
    poses = [pose.model_dump() for pose in settings.reference.poses]
    if added := re.findall(r"\{time_s.*?\}", advice):
        kept = [] if advice.startswith("replace") else poses
        poses = sorted(kept + [yaml.safe_load(text) for text in added], key=lambda pose: pose["time_s"])
    else:
        times = re.search(r"time_s ([\d., ]+)", advice)[1].split(", ")
        poses = [pose | {"time_s": float(t)} for pose, t in zip(poses, times, strict=True)]
    changed = schema.Waypoints.model_validate({"kind": "waypoints", "poses": poses})
    return settings.model_copy(update={"reference": changed, "duration_s": max(60, poses[-1]["time_s"])})


HOLD = [(0, 0, 0, 2), (6, 1, 0, 2), (12, 1, 1, 2), (24, 1, 1, 2)]
TURNS = [(0, 0, 0, 2, -179), (6, 1, 0, 2, 178), (12, 1, 1, 2, 150), (24, 1, 1, 2, 540)]
FAST = [(0, 0, 0, 2), (0.3, 1, 0, 2), (12, 1, 1, 2)]


@pytest.mark.parametrize(
    "poses",
    [
        UNEVEN,
        HOLD,
        TURNS,
        FAST,
        [(0, 0, 0, 2), (1, 10, 0, 2), (5, 12, 0, 2)],
        [(0, 0, 0, 2), (0.2, 5, 0, 2), (0.4, 0, 0, 2)],
        [(0, 0, 0, 2), (30, 5, 0, 2), (30.5, 5, 1, 2), (60, 0, 0, 3)],
        [(0, 0, 0, 2, 0), (0.3, 0.1, 0, 2, 170), (5, 1, 0, 2, 170)],
        [(0, 0, 0, 2, 0), (10, 0, 0, 2, 0), (11, 1, 0, 2, 90), (30, 1, 0, 2, 90), (31, 1, 1, 2, 90)],
    ],
)
def test_one_change_removes_all_faults_as_typed(poses):
    settings = waypoints(*poses)
    (advice,) = found(settings).advice
    assert found(typed(settings, advice)).advice == ()


def test_a_path_beyond_the_duration_states_a_longer_one():
    settings = waypoints(*FAST).model_copy(update={"duration_s": 12.0})
    (advice,) = found(settings).advice
    assert advice.endswith("; duration_s: 22.7 for the whole path)")


def test_poses_that_waypoints_cannot_pass_are_for_a_table(tmp_path):
    rows = [(0, 0, 0, 2), (0.05, 0.01, 0, 2), (6, 1, 0, 2), (6.02, 1, 0, 2), (8, 0, 0, 2)]
    seen = found(waypoints(*rows))
    assert seen.values["overshoot_m"] > 100
    assert seen.advice[0] == "kind: sampled with these poses as a table stays near the box"
    assert found(sampled(tmp_path, np.array(rows))).advice == ()


def test_a_dense_table_that_starts_in_motion_is_for_a_table(tmp_path):
    t = 0.08 * np.arange(60)
    rows = np.column_stack([t, np.sin(t), 0 * t, 2 + 0 * t])
    seen = found(waypoints(*map(tuple, rows.tolist())))
    assert re.search(
        r"accelerates by [\d.]+ m/s² at [\d.]+ s in leg 1 .*; the limit of the team is [\d.]+ m/s²", seen.message
    )
    assert seen.advice[-1].startswith("kind: sampled with these poses as a table keeps the start velocity")
    quiet = found(sampled(tmp_path, rows))
    assert quiet.advice == ()
    assert quiet.values["acceleration_mps2"] == pytest.approx(1, rel=0.05)


def test_a_leg_that_is_too_fast_is_given_more_time():
    poses = [(0, 0, 0, 2), (1, 10, 0, 2), (5, 12, 0, 2)]
    seen = found(waypoints(*poses))
    assert re.match(r"give leg 1 (at least )?[\d.]+ s|multiply all times by [\d.]+", seen.advice[-1])
    slow = found(typed(waypoints(*poses), seen.advice[-1]))
    assert "accelerates by" not in slow.message


def test_a_fast_table_is_flown_more_slowly(tmp_path):
    t = 0.01 * np.arange(600)
    rows = np.column_stack([t, 3 * np.sin(4 * t), 0 * t, 2 + 0 * t])
    (advice,) = found(sampled(tmp_path, rows)).advice
    scale = re.fullmatch(r"--set reference.time_scale=([\d.]+), which is a slower motion", advice)[1]
    slow = sampled(tmp_path, rows, f", time_scale: {scale}")
    assert found(slow.model_copy(update={"duration_s": slow.reference.end_s})).advice == ()


def test_noise_is_smoothed_by_the_proposed_deviation(tmp_path):
    rng, t = np.random.default_rng(0), 0.01 * np.arange(1000)
    rows = np.column_stack([t, np.sin(t) + 0.02 * rng.normal(size=1000), 0 * t, 2 + 0 * t])
    advice = found(sampled(tmp_path, rows)).advice
    name, deviation = re.search(
        r"if this is noise of the table, --set reference.(\w+)=([\d.e-]+) reduces", advice[0]
    ).groups()
    assert found(sampled(tmp_path, rows, f", {name}: {deviation}")).advice == ()


def test_a_deviation_within_the_present_one_is_not_proposed(tmp_path):
    """A first attitude that is far from the next one is no noise."""
    t = 0.05 * np.arange(200)
    turn = np.where(t > 0, np.pi / 2, 0.0) + 0.3 * np.random.default_rng(0).normal(size=200).cumsum() / 14
    rows = np.column_stack([t, 0 * t, 0 * t, 2 + 0 * t, turn])
    columns = "time_s,x_m,y_m,z_m,roll_rad"
    settings = sampled(tmp_path, np.column_stack([rows, 0 * t, 0 * t]), columns=f"{columns},pitch_rad,yaw_rad")
    advice = found(settings).advice
    for stated in re.findall(r"--set reference\.deviation_deg=([\d.e-]+)", " ".join(advice)):
        assert float(stated) > settings.reference.table("attitude_fits")[-1, 0]
    assert advice


def test_a_turn_that_angles_state_but_no_leg_makes_is_named():
    seen = found(waypoints((0, 0, 0, 2, 0), (5, 1, 0, 2, 360)))
    assert "changes yaw by 360 deg in leg 1, which turns by the shorter way" in seen.message
    assert seen.advice == ("add 2 poses to leg 1, so that each turns by 170 deg or less",)
    assert found(waypoints((0, 0, 0, 2, 170), (5, 1, 0, 2, -170))).advice == ()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (waypoints((0, 0, 0, 2), (5, 1, 0, 2)), "reference.poses: time_s"),
        (scenario.load_scenario("hover"), "reference.period_s, amplitude_m"),
    ],
)
def test_a_slower_reference_is_named_by_its_own_settings(settings, says):
    assert says in reference_checks.slower_reference(settings)
