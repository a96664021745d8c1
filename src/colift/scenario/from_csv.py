"""Waypoints from a table of comma-separated values, as plain numbers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from colift.runtime import bounded_read
from colift.scenario.errors import ErrorMessage, ScenarioError, format_value, unknown_name_message
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema import Pose, Section

POSITION_COLUMNS, ATTITUDE_COLUMNS = ("time_s", "x_m", "y_m", "z_m"), ("roll_deg", "pitch_deg", "yaw_deg")


class WaypointsFromFile(Section):
    """Waypoints from a table with a line of column names and one line per pose, in ascending order of time."""

    kind: Literal["waypoints"]
    """Kind of the reference."""
    file: str
    """Path of the table, relative to the scenario's. Columns time_s, x_m, y_m, z_m and optionally roll_deg,
    pitch_deg, yaw_deg, in any order."""


def expand(section: WaypointsFromFile, folder: Path) -> tuple[dict[str, Any], list[ErrorMessage]]:
    """Return the reference in plain numbers, and its errors as `(location, message)`."""
    try:
        content = bounded_read.read_bytes(folder / section.file, bounded_read.MAX_TABLE_BYTES)
        rows = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True, skipinitialspace=True)
        names = ["time_s" if name.strip() == "t_s" else name.strip() for name in next(rows, [])]  # t_s: schema 1
        if names and not names[-1]:  # a separator at the end of the line
            names.pop()
        poses, errors = [], list(_columns(names))
        for row in [] if errors else rows:
            if row:
                pose, found = _pose(names, row)
                poses.append(pose)
                errors += [f"line {rows.line_num}: {message}" for message in found]
            if len(poses) > MAX_ENTRIES:
                errors.append(
                    f"line {rows.line_num}: at most {MAX_ENTRIES} poses are allowed; kind: sampled reads more"
                )
                break
    except OSError as error:
        errors, poses = [f"cannot be read: {error.strerror or error}"], []
    except (csv.Error, ValueError) as error:  # ValueError: no UTF-8, a NUL in the path
        errors, poses = [f"cannot be read: {error}"], []
    if not errors and len(poses) < 2:
        errors = [f"must contain at least two poses, got {len(poses)}"]
    return {"kind": "waypoints", "poses": poses}, [
        (("file",), f"{format_value(section.file)}: {line}") for line in errors
    ]


def _columns(names: list[str]) -> Iterator[str]:
    yield from (f"line 1: column {name} is required" for name in POSITION_COLUMNS if name not in names)
    if 0 < sum(name in names for name in ATTITUDE_COLUMNS) < len(ATTITUDE_COLUMNS):
        yield f"line 1: {', '.join(ATTITUDE_COLUMNS)} must occur together"
    for i, name in enumerate(names):
        if name not in POSITION_COLUMNS + ATTITUDE_COLUMNS:
            yield f"line 1: {unknown_name_message(name, POSITION_COLUMNS + ATTITUDE_COLUMNS, 'a column')}"
        elif name in names[:i]:
            yield f"line 1: column {name} occurs twice"


def _pose(names: list[str], row: list[str]) -> tuple[dict[str, Any], list[str]]:
    """Return one line as a pose, and its errors."""
    if len(row) == len(names) + 1 and not row[-1].strip():  # a separator at the end of the line
        row = row[:-1]
    if len(row) != len(names):
        return {}, [f"must have {len(names)} values, got {len(row)}"]
    numbers, errors = {}, []
    for name, text in zip(names, row, strict=True):
        try:
            numbers[name] = float(text)
        except ValueError:
            errors.append(f"{name}: must be a number, got {format_value(text)}")
    if errors:
        return {}, errors
    pose: dict[str, Any] = {"time_s": numbers["time_s"], "position_m": [numbers[name] for name in POSITION_COLUMNS[1:]]}
    pose |= {"rpy_deg": [numbers[name] for name in ATTITUDE_COLUMNS]} if ATTITUDE_COLUMNS[0] in names else {}
    try:
        Pose.model_validate(pose)
    except ScenarioError as error:
        errors = str(error).splitlines()
    return pose, errors
