"""Tests of waypoints from a table: equal to those in the file, and errors with the line of the table."""

import os
import re
from pathlib import Path

import pytest

from colift import scenario
from colift.scenario import Scenario, ScenarioError

SAMPLE = (Path(__file__).parents[2] / "support" / "sample_scenario.yaml").read_text(encoding="utf-8")
HEAD = "time_s,x_m,y_m,z_m"
PLACE = SAMPLE[: SAMPLE.index("reference:")].count("\n") + 1


def read(folder: Path, table: str | bytes, reference: str = "{kind: waypoints, file: way.csv}") -> Scenario:
    (folder / "way.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    text = re.sub(r"^reference:\n(  .*\n)*", f"reference: {reference}\n", SAMPLE, flags=re.MULTILINE)
    (folder / "mine.yaml").write_text(text)
    return scenario.load_scenario(folder / "mine.yaml")


def refused(folder: Path, table: str | bytes, reference: str = "{kind: waypoints, file: way.csv}") -> list[str]:
    with pytest.raises(ScenarioError) as error:
        read(folder, table, reference)
    lines = str(error.value).splitlines()
    assert all(line.startswith(f"{folder}/mine.yaml:{PLACE}: reference") for line in lines)
    return [line.partition(": reference")[2].lstrip(".") for line in lines]


def test_table_equals_poses_in_the_file(tmp_path):
    table = read(tmp_path, f"\ufeff{HEAD}\r\n0,0,0,1\r\n\r\n4,1,0,1.5\r\n")
    poses = "{kind: waypoints, poses: [{time_s: 0, position_m: [0, 0, 1]}, {time_s: 4, position_m: [1, 0, 1.5]}]}"
    assert table == read(tmp_path, "", poses)
    assert table == read(tmp_path, f"{HEAD}\n0,0,0,1,\n4,1,0,1.5\n")  # separators at ends of lines
    assert table == read(tmp_path, f'{HEAD},\n0,0,0,1,\n4, "1",0,1.5, \n')
    turned = read(tmp_path, "yaw_deg, z_m, time_s, x_m, y_m, roll_deg, pitch_deg\n90,1,0,2,3,10,20\n0,0,9,0,0,0,0\n")
    assert turned.reference.poses[0].model_dump() == {"time_s": 0.0, "position_m": (2, 3, 1), "rpy_deg": (10, 20, 90)}


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("time_s,x_m,y_m\n", "file: 'way.csv': line 1: column z_m is required"),
        (f"{HEAD},yaw_deg\n", "file: 'way.csv': line 1: roll_deg, pitch_deg, yaw_deg must occur together"),
        (f"{HEAD},x_m\n", "file: 'way.csv': line 1: column x_m occurs twice"),
        (f"{HEAD},w_m\n", "file: 'way.csv': line 1: 'w_m' is not a column (time_s, "),
        (f"{HEAD}\n0,0,0,1\n5,a,0,1\n", "file: 'way.csv': line 3: x_m: must be a number, got 'a'"),
        (f"{HEAD}\n0,0,0,1\n5,1,0,\n", "file: 'way.csv': line 3: z_m: must be a number, got ''"),
        (f"{HEAD}\n0,0,0,1\n5,1,0,1,,\n", "file: 'way.csv': line 3: must have 4 values, got 6"),
        (f"{HEAD}\n0,0,0,1\n5,1,0\n", "file: 'way.csv': line 3: must have 4 values, got 3"),
        (f"{HEAD}\n0,0,0,1\n5,1e9,0,1\n", "file: 'way.csv': line 3: position_m[0] [m]: must be from -10000 to 10000"),
        (f"{HEAD}\n0,0,0,1\n5,nan,0,1\n", "file: 'way.csv': line 3: position_m[0] [m]: must be finite, got nan"),
        (f"{HEAD}\n0,0,0,1\n", "file: 'way.csv': must contain at least two poses, got 1"),
        (HEAD + "".join(f"\n{i},0,0,1" for i in range(101)), "file: 'way.csv': line 102: at most 100 poses"),
        (f'{HEAD}\n0,0,0,"1\n', "file: 'way.csv': cannot be read: unexpected end of data"),
        (b"\xff\xfe\x00", "file: 'way.csv': cannot be read: 'utf-8' codec can't decode byte 0xff"),
        (f"{HEAD}\n5,0,0,1\n5,1,0,1\n", "poses[1].time_s [s]: must be 0.01 s or more after the pose before, 5, got 5"),
    ],
)
def test_errors_in_a_table_state_its_line(tmp_path, table, says):
    (line,) = refused(tmp_path, table)
    assert line.startswith(says)


@pytest.mark.parametrize("kind", ["waypoints", "sampled"])
def test_a_pipe_in_place_of_a_table_is_refused(tmp_path, kind):
    os.mkfifo(tmp_path / "pipe")
    (line,) = refused(tmp_path, "", f"{{kind: {kind}, file: pipe}}")
    assert line == "file: 'pipe': cannot be read: a pipe, socket or device, not a regular file"


@pytest.mark.parametrize(
    ("reference", "says"),
    [
        ("{kind: waypoints, file: nowhere.csv}", "file: 'nowhere.csv': cannot be read: No such file or directory"),
        ("{kind: waypoints, file: 3}", "file: must be text, got 3"),
        ("{kind: waypoints, file: way.csv, poses: []}", "poses: is not a setting here"),
    ],
)
def test_errors_about_a_table_are_reported(tmp_path, reference, says):
    (line,) = refused(tmp_path, f"{HEAD}\n0,0,0,1\n5,1,0,1\n", reference)
    assert line.startswith(says)


def test_invalid_entries_do_not_count_as_missing(tmp_path):
    poses = "{kind: waypoints, poses: [{time_s: 0, position_m: [0, 0, 1]}, {time_s: a, position_m: [1, 0, 1.5]}]}"
    assert refused(tmp_path, "", poses) == ["poses[1].time_s [s]: must be a number, got 'a'"]
