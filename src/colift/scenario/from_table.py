"""Sampled reference from a table of poses, as plain data.

The table is text with one pose per line: a log of a flight, or the output of a planner. The smoothing spline through
its rows replaces the table, so that results contain all data of the reference.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from colift.runtime import bounded_read
from colift.scenario import fields, packing
from colift.scenario.errors import ErrorMessage, format_value, suggestion
from colift.scenario.schema import Section

TIMES = {"time_s": 1, "time_ms": 1_000, "time_us": 1_000_000, "time_ns": 1_000_000_000}
"""Columns of the time, and units per second."""
POSITION = ("x_m", "y_m", "z_m")  # columns of the position
QUATERNION = ("qw", "qx", "qy", "qz")  # columns of the attitude
ANGLES_DEG, ANGLES_RAD = ("roll_deg", "pitch_deg", "yaw_deg"), ("roll_rad", "pitch_rad", "yaw_rad")
KNOWN_COLUMNS = (*TIMES, *POSITION, *QUATERNION, *ANGLES_DEG, *ANGLES_RAD)
SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": None}
MAX_ROWS = 500_000
MAX_LINES_OF_ERRORS = 20
MAX_NORM_ERROR = 0.02  # of a quaternion
MAX_COORDINATE = 1e4  # m, as `fields.Position`
MAX_TIME = 1e5  # s, as `fields.Instant`
MIN_STEP = 1e-6  # s between two poses; the spline of closer ones has no finite coefficients
MAX_DIGITS = 30  # of a whole number, which is read exactly

COMMON_NAMES = {  # patterns of names in logs and plans, without their units
    "time": r"t|time|stamp|timestamp|secs?|seconds",
    **{f"{axis}_m": rf"(p|t|pos|position|p_rs_r)?[._ ]?{axis}(_m)?" for axis in "xyz"},
    **{f"q{part}": rf"(q|quat|quaternion|orientation|q_rs)[._ ]?{part}" for part in "wxyz"},
}

Column = Annotated[str, Field(strict=True, max_length=200)]  # name of a column


class SampledFromFile(Section):
    """Smoothing spline through a table of poses, such as a log or the output of a planner.

    If the table starts at t = 0, the reference starts with the velocity of the table; otherwise it starts from rest.
    After the last pose it comes to rest. [Tables of poses](references.md#tables-of-poses) explains the options with
    examples.
    """

    kind: Literal["sampled"]
    """Kind of the reference."""
    file: str
    """Path of the table, relative to the scenario's. One pose per line, in ascending order of time."""
    columns: tuple[Column, ...] | dict[Column, Column] | None = None
    """Columns of the table: their names in order, or for each name the header of the table. Names are time_s, time_ms,
    time_us or time_ns; x_m, y_m, z_m; and optionally qw, qx, qy, qz, or roll, pitch and yaw in deg or rad (`yaw_deg`).
    By default the header contains these names."""
    extra_columns: Literal["reject", "ignore"] = "reject"
    """Treatment of columns with other names."""
    unordered_rows: Literal["reject", "skip"] = "reject"
    """Treatment of poses whose time does not exceed that of a pose before."""
    separator: Literal["auto", "comma", "semicolon", "tab", "space"] = "auto"
    """Separator of the columns; by default the one of the first pose."""
    comment: Annotated[str, Field(strict=True, min_length=1, max_length=3)] = "#"
    """Start of a comment, at the start of a line or behind a pose. The last comment line before the first pose may be
    the header."""
    frame: Literal["enu", "ned"] = "enu"
    """Axes: `enu` with z up; `ned` with z down and body axes forward, right, down, as PX4 writes them."""
    time_offset_s: fields.TimeOffset | None = None
    """Added to the times of the table; by default the first pose is at 0 s. Poses before 0 s are not flown."""
    time_scale: fields.TimeScale = 1.0
    """Factor of all times; 2 is half the speed."""
    deviation_m: fields.PathDeviation | None = None
    """Root-mean-square distance of the poses from the path, such as the noise of the log. By default generalized
    cross-validation determines it, with at most 0.01 m; a path that this cannot determine goes through all poses."""
    deviation_deg: fields.AngularDeviation | None = None
    """Root-mean-square angle of the attitudes from the spline; default: as for `deviation_m`, at most 1.1 deg."""


@dataclasses.dataclass(frozen=True)
class _Table:
    """Numbers of a table by column, and the line of each row."""

    columns: Mapping[str, Sequence[float | int]]
    lines: Sequence[int]


class _TableError(ValueError):
    """Table that cannot be used; one line per error."""


def expand(section: SampledFromFile, folder: Path) -> tuple[dict[str, Any], list[ErrorMessage]]:
    """Return the reference in plain data, and its errors as `(location, message)`."""
    location = ("file",)
    try:
        content = bounded_read.read_bytes(folder / section.file, bounded_read.MAX_TABLE_BYTES)
        table = _read(section, enumerate(io.StringIO(content.decode("utf-8-sig"), newline=None), start=1))
        with np.errstate(all="ignore"):  # numbers that are not finite or too large are refused with their lines
            t, p, R = _poses(section, table)
    except _TableError as error:
        return {}, [(location, f"{format_value(section.file)}: {line}") for line in str(error).splitlines()]
    except OSError as error:
        return {}, [(location, f"{format_value(section.file)}: cannot be read: {error.strerror or error}")]
    except ValueError as error:  # no UTF-8, a NUL in the path
        return {}, [(location, f"{format_value(section.file)}: cannot be read: {error}")]
    from colift.trajectories import smoothing_spline  # here, because SciPy's splines take long to import

    angle = None if section.deviation_deg is None else float(np.deg2rad(section.deviation_deg))
    try:
        fit = smoothing_spline.fit_samples(t, p, R, section.deviation_m, angle)
    except (RuntimeError, np.linalg.LinAlgError) as error:  # a singular matrix
        return {}, [(location, f"{format_value(section.file)}: no spline exists for these times ({error})")]
    wrong: list[ErrorMessage] = [
        (
            (name,),
            f"is too small for a spline of these poses: the least is {least:.4g} {unit}, got {stated:g}",
        )
        for name, least, unit, stated in (
            ("deviation_m", fit.deviation, "m", section.deviation_m),
            ("deviation_deg", float(np.rad2deg(fit.angle)), "deg", section.deviation_deg),
        )
        if stated is not None and least > 1.001 * stated
    ]
    return {
        "kind": "sampled",
        "name": f"{Path(section.file).name[:200]}, {len(t)} poses",
        "start_s": float(t[0]),
        "end_s": float(t[-1]),
        "tables": {
            "position_knots": packing.pack(fit.knots.position),
            "attitude_knots": packing.pack(fit.knots.attitude),
            "position_fits": packing.pack(fit.choices),
            "attitude_fits": packing.pack(fit.attitude_choices * [180 / np.pi, 1.0]),
            "box": packing.pack(np.stack([p.min(0), p.max(0)])),
        },
    }, wrong


# Text to numbers ------------------------------------------------------------------------------------------------------


def _read(section: SampledFromFile, lines: Iterator[tuple[int, str]]) -> _Table:
    """Read the numbers of all columns that are used."""
    header: tuple[int, str] | None = None
    first: tuple[int, str] | None = None
    for number, line in lines:
        text = line.strip()
        if text.startswith(section.comment):
            header = (number, text.removeprefix(section.comment).strip())
        elif text:
            first = number, line
            break
    if first is None:
        raise _TableError("must hold two poses or more, got 0")
    comment, separator = section.comment, _separator(section, first[1])
    first = first[0], _stripped(first[1], separator)
    if not _is_number(_split(first[1], separator)[0]):  # the first line that is not a comment is the header
        header, first = (first[0], _without_comment(first[1], separator, comment)), None
    given = [] if header is None else _trimmed(_split(header[1], separator), 0)
    stated = len(section.columns if isinstance(section.columns, tuple) else given)
    width = None if first is None else len(_cells(first[1], separator, comment, stated))
    names = None
    if header is not None and len(given) == (width or len(given)):  # or else a comment about something else
        names = header[0], ["time_s" if name == "t_s" else name for name in given]  # t_s: schema 1
    wanted, width = _columns(section, names, width)
    return _numbers([] if first is None else [first], lines, comment, separator, wanted, width)


def _numbers(
    first: list[tuple[int, str]],
    lines: Iterator[tuple[int, str]],
    comment: str,
    separator: str | None,
    wanted: dict[str, int],
    width: int,
) -> _Table:
    """Read the rows of a table."""
    values: dict[str, list[float | int]] = {name: [] for name in wanted}
    numbers, errors = [], []
    for number, line in itertools.chain(first, ((n, _stripped(text, separator)) for n, text in lines)):
        if not line.strip() or line.lstrip().startswith(comment):
            continue
        cells = _cells(line, separator, comment, width)
        if len(cells) != width:
            errors.append(f"line {number}: must have {width} values, got {len(cells)}")
        else:
            errors += _add_row(values, cells, wanted, number)
            numbers.append(number)
        if len(errors) >= MAX_LINES_OF_ERRORS:
            raise _TableError("\n".join([*errors[:MAX_LINES_OF_ERRORS], "more lines may be wrong"]))
        if len(numbers) > MAX_ROWS:
            raise _TableError(f"line {number}: at most {MAX_ROWS} poses are allowed")
    if errors:
        raise _TableError("\n".join(errors))
    if len(numbers) < 2:
        raise _TableError(f"must hold two poses or more, got {len(numbers)}")
    return _Table(values, numbers)


def _add_row(
    values: dict[str, list[float | int]], cells: list[str], wanted: dict[str, int], number: int
) -> Iterator[str]:
    """Append the numbers of one row; yield its errors."""
    for name, column in wanted.items():
        text = cells[column]
        try:  # times in nanoseconds have more digits than a float
            whole = name in TIMES and len(text) <= MAX_DIGITS and text.lstrip("+-").isdecimal()
            values[name].append(int(text) if whole else float(text))
        except ValueError:
            hint = "; the decimal separator is a point" if text.replace(",", "", 1).lstrip("+-").isdecimal() else ""
            yield f"line {number}: {name}: must be a number, got {format_value(text)}{hint}"


def _separator(section: SampledFromFile, line: str) -> str | None:
    """Return the separator; None for any number of spaces."""
    if section.separator != "auto":
        return SEPARATORS[section.separator]
    bare = re.sub(r'"[^"]*"', "", line).partition(section.comment)[0]
    return next((mark for mark in (";", "\t", ",") if mark in bare), None)


def _stripped(line: str, separator: str | None) -> str:
    """Return a line without space at its ends; tabs that separate cells are kept."""
    return line.strip(" \r\n") if separator == "\t" else line.strip()


def _cells(line: str, separator: str | None, comment: str, width: int) -> list[str]:
    """Return the cells of a pose; a comment and one separator behind it are dropped if `width` cells are left."""
    if comment in line:
        short = _trimmed(_split(line[: _comment_start(line, comment)], separator), width)
        if len(short) == width:
            return short
    return _trimmed(_split(line, separator), width)


def _split(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line; a separator within quotes is a part of its cell."""
    if separator is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
    except csv.Error as error:
        raise _TableError(f"a line cannot be read: {error}: {line[:40]}...") from None


def _trimmed(cells: list[str], width: int) -> list[str]:
    """Drop an empty last cell, after a separator at the end of the line, if there are more than `width` cells."""
    return cells[:-1] if len(cells) > width and not cells[-1] else cells


def _comment_start(line: str, comment: str) -> int:
    """Return the index of the first comment outside quotes; the length of the line if there is none."""
    masked = re.sub(r'"[^"]*"', lambda quoted: "\0" * len(quoted[0]), line)
    found = masked.find(comment)
    return len(line) if found < 0 else found


def _without_comment(header: str, separator: str | None, comment: str) -> str:
    """Return a line of names without the comment behind it, which has a space on either side."""
    start = _comment_start(header, comment)
    before, after = header[:start], header[start + len(comment) :]
    alone = before[-1:].isspace() and after[:1].isspace() and not before.rstrip().endswith(separator or "\n")
    return before.rstrip() if alone else header


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


# Columns --------------------------------------------------------------------------------------------------------------


def _columns(
    section: SampledFromFile, header: tuple[int, list[str]] | None, width: int | None
) -> tuple[dict[str, int], int]:
    """Return the index of every column that is used, and the number of columns."""
    where = "reference.columns"
    if isinstance(section.columns, tuple):
        names, width = list(section.columns), width or len(header[1] if header else section.columns)
        if len(names) != width:
            raise _TableError(f"{where} has {len(names)} names, but the table has {width} columns")
    elif header is None:
        raise _TableError(f"has no line of column names: state {where}, such as [time_s, x_m, y_m, z_m]")
    else:
        where, names, width = f"line {header[0]}", _renamed(section.columns or {}, *header), len(header[1])
    errors = list(_column_errors(names, where, section.extra_columns == "ignore"))
    if errors:
        if header is not None and section.columns is None:
            missing = not TIMES.keys() & set(names) or not set(POSITION) <= set(names)
            if missing and (proposal := _proposal(header[1])):
                raise _TableError(f"{where}: the columns have other names: state reference.columns, such as {proposal}")
            errors.append(f"reference.columns can name the columns {', '.join(header[1])[:200]} otherwise")
        raise _TableError("\n".join(errors))
    return {name: names.index(name) for name in names if name in KNOWN_COLUMNS}, width


def _proposal(header: list[str]) -> str:
    """Return settings that assign names in common use; empty if the time or a coordinate has another name."""
    found: dict[str, str] = {}
    for name in header:
        bare = re.sub(r"[\[(].*", "", name).strip(" .-_").lower()
        for column, pattern in COMMON_NAMES.items():
            if re.fullmatch(pattern, bare):
                found.setdefault(_time_column(name) if column == "time" else column, name)
    if len(found.keys() & TIMES.keys()) != 1 or not found.keys() >= set(POSITION):
        return ""
    if not found.keys() >= set(QUATERNION):
        found = {column: name for column, name in found.items() if column not in QUATERNION}
    assigned = ", ".join(
        f"{column}: {name if re.fullmatch(r'[a-z][a-z_]*', name) and name not in ('y', 'n') else format_value(name)}"
        for column, name in found.items()
    )
    rest = ", and extra_columns: ignore" if len(found) < len(header) else ""
    return f"{{{assigned}}}{rest}"


def _time_column(name: str) -> str:
    """Return the column of a time whose unit is in its name."""
    unit = re.search(r"(?<![a-z])(ms|us|ns)(?![a-z])", name.lower())
    return f"time_{unit[1]}" if unit else "time_s"


def _renamed(columns: dict[str, str], line: int, header: list[str]) -> list[str]:
    """Return the header with the names that the setting gives."""
    for name, theirs in columns.items():
        if theirs not in header:
            raise _TableError(
                f"line {line}: has no column {format_value(theirs)} for {name}{suggestion(theirs, header)}"
            )
    given = {theirs: name for name, theirs in columns.items()}
    return [given.get(theirs, theirs if theirs not in columns else f"({theirs})") for theirs in header]


def _column_errors(names: list[str], where: str, ignore: bool) -> Iterator[str]:
    """Yield the errors in the names of the columns."""
    times, angles = [name for name in names if name in TIMES], []
    if len(times) != 1:
        found = " and ".join(times) or "none"
        yield f"{where}: one column of time is required ({', '.join(TIMES)}), got {found}"
    for name in POSITION:
        if name not in names:
            yield f"{where}: column {name} is required{suggestion(name, [n for n in names if n not in KNOWN_COLUMNS])}"
    for group in (QUATERNION, ANGLES_DEG, ANGLES_RAD):
        present = [name for name in group if name in names]
        if present:
            angles.append(present[0])
        if present and len(present) < len(group) and present[-1][:3] != "yaw":
            yield f"{where}: {', '.join(group)} must occur together"
        elif present and len(present) not in (1, len(group)):
            yield f"{where}: {', '.join(group)} must occur together, or {group[-1]} alone"
    if len(angles) > 1:
        yield f"{where}: the attitude is stated twice, by {' and by '.join(angles)}"
    for i, name in enumerate(names):
        if name in names[:i] and name in KNOWN_COLUMNS:
            yield f"{where}: column {name} stands twice"
        elif name not in KNOWN_COLUMNS and name and not ignore:
            hint = suggestion(name, KNOWN_COLUMNS)
            yield f"{where}: column {format_value(name)} is not known{hint}; extra_columns: ignore skips it"


# Numbers to poses -----------------------------------------------------------------------------------------------------


def _poses(section: SampledFromFile, table: _Table) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, positions and attitudes in the frame of the world."""
    (clock,) = (name for name in table.columns if name in TIMES)
    stamps, lines = table.columns[clock], table.lines
    t = _times(section, stamps, TIMES[clock])
    p = np.array([table.columns[name] for name in POSITION], dtype=float).T
    R = _attitudes(table)
    if section.frame == "ned":
        p, R = p @ NED_TO_ENU.T, NED_TO_ENU @ R @ FRD_TO_FLU
    finite = np.isfinite(np.column_stack([t, p, R.reshape(len(R), 9)])).all(1)
    wrong = [(row, "must have finite numbers") for row in np.flatnonzero(~finite)]
    far = np.abs(p).max(1) > MAX_COORDINATE
    shift = "; subtract an origin from all positions of the table"
    wrong += [(row, f"the position must be within {MAX_COORDINATE:g} m{shift}") for row in np.flatnonzero(far)[:1]]
    ordered = np.concatenate([[True], t[1:] - np.maximum.accumulate(t)[:-1] > MIN_STEP])
    if section.unordered_rows == "reject":
        hint = "; unordered_rows: skip leaves such poses out"
        wrong += [
            (
                row,
                f"{clock}: must exceed that of line {lines[row - 1]}, {stamps[row - 1]}, by {MIN_STEP:g} s, "
                f"got {stamps[row]}{hint}",
            )
            for row in np.flatnonzero(~ordered)
        ]
    if wrong:
        found = [f"line {lines[row]}: {sentence}" for row, sentence in sorted(wrong)]
        more = [f"and {len(found) - MAX_LINES_OF_ERRORS} more lines"] if len(found) > MAX_LINES_OF_ERRORS else []
        raise _TableError("\n".join([*found[:MAX_LINES_OF_ERRORS], *more]))
    if np.abs(t).max() > MAX_TIME:
        found = f"got {t[0]:.6g} to {t[-1]:.6g} s; {_time_remedy(clock, stamps[0], float(np.ptp(t)))}"
        raise _TableError(f"the times must be within {MAX_TIME:g} s, {found}")
    if ordered.sum() < 2:
        raise _TableError("must hold two poses or more with ascending times")
    return t[ordered], p[ordered], R[ordered]


def _time_remedy(clock: str, first: float | int, duration: float) -> str:
    """Return the change with which the times are within their limit; first stamps are often seconds since 1970."""
    if duration <= MAX_TIME:
        return "leave out time_offset_s, or adapt it"
    finer = [name for name, count in TIMES.items() if duration * TIMES[clock] / count <= MAX_TIME]
    since_1970 = [name for name in finer if 1e8 < first / TIMES[name] < 1e10]
    for name in since_1970 or finer:
        return f"name the column {name} if that is its unit"
    return "shorten the table, or reduce time_scale"


def _times(section: SampledFromFile, values: Sequence[float | int], per_second: int) -> np.ndarray:
    """Return the times of the simulation [s]; differences of whole numbers are exact."""
    if section.time_offset_s is None:
        shifted = np.array([value - values[0] for value in values], dtype=float) / per_second
    else:
        whole = round(section.time_offset_s * per_second)
        rest = section.time_offset_s - whole / per_second
        shifted = np.array([value + whole for value in values], dtype=float) / per_second + rest
    return section.time_scale * shifted


def _attitudes(table: _Table) -> np.ndarray:
    """Return the attitudes; the identity without columns for them."""
    from colift.trajectories import rotation_legs  # here, because JAX takes long to import

    columns, n = table.columns, len(table.lines)
    if QUATERNION[0] in columns:
        q = np.array([columns[name] for name in QUATERNION], dtype=float).T
        norm = np.linalg.norm(q, axis=1)
        far = np.flatnonzero(np.abs(norm - 1) > MAX_NORM_ERROR)
        if len(far):
            lines = [f"line {table.lines[row]}: the quaternion has the norm {norm[row]:.4g}, not 1" for row in far]
            raise _TableError("\n".join(lines[:MAX_LINES_OF_ERRORS]))
        return rotation_legs.rotation(q / norm[:, None])
    angles = np.zeros((n, 3))
    for group, unit in ((ANGLES_DEG, np.pi / 180), (ANGLES_RAD, 1.0)):
        for axis, name in enumerate(group):
            if name in columns:
                angles[:, axis] = unit * np.array(columns[name], dtype=float)
    roll, pitch, yaw = (rotation_legs.exp(angles[:, axis, None] * np.eye(3)[axis]) for axis in range(3))
    return yaw @ pitch @ roll


NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_TO_FLU = np.diag([1.0, -1.0, -1.0])
