"""Readers of files and messages with mutated inputs: each input is read, or refused with the project's error.

A reader makes an input from a seed and reads it. A result that is not finite, a warning of a library, another error, a
crash of the process and a hang are faults.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import math
import socket
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import h5py
import numpy as np

from colift.analysis import conclusions, poses, result_files, run_folders
from colift.analysis.study_metrics import STUDY_METRICS
from colift.cli import certify, tables
from colift.closed_loop import log
from colift.gp import serialization
from colift.integrations import px4_hil
from colift.models import mjcf_import, urdf
from colift.scenario import ScenarioError, from_csv, from_table, load_scenario, migration, parse
from colift.visualization import report
from tests.support import mutations, scenario_mutants
from tests.support import random_logs as flights
from tests.support import summaries as summary_files

LINE_LIMIT = 100_000  # characters of an error
MAX_FAULT = 500  # characters of a fault
DATA = Path(__file__).parent / "fuzz_seeds"


class Reader(NamedTuple):
    """Reader with mutated inputs.

    Attributes:
        make: Function that makes an input from random numbers.
        read: Function that reads an input, which is also in a file of the given path.
        errors: Errors of a refusal.
        file: Name of the file.
    """

    make: Callable[[mutations.Rng], bytes]
    read: Callable[[Path, bytes], Any]
    errors: tuple[type[Exception], ...]
    file: str


def check(name: str, seed: int, folder: Path) -> str | None:
    """Return the fault of one input; None if it was read, an empty text if it was refused.

    Args:
        name: Name of the reader.
        seed: Seed of the input.
        folder: Folder for the file.
    """
    reader = READERS[name]
    content = reader.make(np.random.default_rng([seed, *name.encode()]))
    path = folder / reader.file
    path.write_bytes(content)
    before, shown = sys.unraisablehook, []
    sys.unraisablehook = lambda each: shown.append(f"prints {each.exc_type.__name__}: {each.exc_value}")
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            fault = _read(reader, path, content)
        shown += [f"warns: {each.message}" for each in warned]
    finally:
        sys.unraisablehook = before
    return fault or (shown[0][:MAX_FAULT] if shown else fault)


def _read(reader: Reader, path: Path, content: bytes) -> str | None:
    """Return the fault of a file; None if it was read, an empty text if it was refused."""
    try:
        found = reader.read(path, content)
    except reader.errors as error:
        text = str(error)
        return "" if 0 < len(text) < LINE_LIMIT else f"{type(error).__name__}: empty or endless"
    except Exception as error:  # any other error is a fault
        return f"{type(error).__name__}: {error}"[:MAX_FAULT]
    return next((f"not finite: {place}" for place in non_finite(found)), None)


def non_finite(value: Any, place: str = "result") -> Iterator[str]:
    """Yield the places of numbers that are not finite in nested data, arrays and dataclasses."""
    if isinstance(value, float):
        if not math.isfinite(value):
            yield place
    elif isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            yield place
    elif isinstance(value, Mapping):
        for key, entry in value.items():
            yield from non_finite(entry, f"{place}.{key}")
    elif isinstance(value, list | tuple):
        for k, entry in enumerate(value):
            yield from non_finite(entry, f"{place}[{k}]")
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from non_finite(getattr(value, field.name), f"{place}.{field.name}")


# Scenarios ------------------------------------------------------------------------------------------------------------


def _scenario(path: Path, _content: bytes) -> Any:
    return load_scenario(path).model_dump(mode="json")


def _make_scenario(rng: mutations.Rng) -> bytes:
    return scenario_mutants.mutant(int(rng.integers(2**40)))


SMALL = "schema: 2\nextends: hover\n"
SETTINGS = (
    "payload.mass_kg",
    "agents.front.type",
    "reference.period_s",
    "learning.update_times_s",
    "control.K_p",
    "seed",
)


def _make_override(rng: mutations.Rng) -> bytes:
    name = mutations.mutate_bytes(rng, mutations.pick(rng, SETTINGS).encode(), [b"a.b", b"payload"])
    value = mutations.pick(rng, [*scenario_mutants.NUMBERS, *scenario_mutants.VALUES, *mutations.WORDS])
    stated = mutations.pick(rng, SETTINGS).encode() if rng.integers(2) else name
    return stated + b"=" + value.encode("utf-8", "surrogatepass")


def _override(_path: Path, content: bytes) -> Any:
    return parse(SMALL, "small.yaml", [content.decode("utf-8", "surrogateescape")]).model_dump(mode="json")


def _migrate(_path: Path, content: bytes) -> Any:
    text = content.decode("utf-8", "replace")
    return migration.migrate_text(text)


# Vehicles -------------------------------------------------------------------------------------------------------------

URDF = """<robot name="v" version="1.0"><link name="base"><inertial><origin xyz="0 0 0.01" rpy="0 0 0.1"/>
<mass value="1.5"/><inertia ixx="0.02" iyy="0.02" izz="0.035" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="upper"><inertial><origin xyz="0 0 -0.1"/><mass value="0.12"/>
<inertia ixx="9e-4" iyy="9e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><mass value="0.1"/>
<inertia ixx="2e-4" iyy="2e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 -0.05" rpy="0.1 0 0"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="5" velocity="3"/>
<dynamics damping="0.1" friction="0"/></joint><joint name="slide" type="prismatic"><parent link="upper"/>
<child link="fore"/><origin xyz="0 0 -0.2" quat_xyzw="0 0 0 1"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.2" effort="5" velocity="3"/></joint><joint name="tip_joint" type="fixed">
<parent link="fore"/><child link="tip"/><origin xyz="0 0 -0.1"/></joint></robot>"""
MJCF = """<mujoco><compiler angle="radian" inertiafromgeom="false"/><worldbody>
<body name="uav" pos="0 0 1"><freejoint/><inertial pos="0 0 0.01" mass="2" diaginertia="0.02 0.02 0.035"/>
<body name="upper" pos="0 0 -0.05" quat="0.7071 0 0 0.7071">
<joint name="shoulder" type="hinge" axis="1 0 0" pos="0 0 0.01" range="-1 1" limited="true" damping="0.1"/>
<inertial pos="0 0 -0.08" mass="0.15" diaginertia="3e-4 3e-4 3e-5"/><body name="fore" pos="0 0 -0.16">
<joint name="elbow" type="slide" axis="0 1 0"/><inertial pos="0.01 0 -0.07" mass="0.1" diaginertia="2e-4 2e-4 2e-5"/>
<site name="tool_tip" pos="0 0 -0.14"/></body></body></body></worldbody>
<equality><joint joint1="elbow" joint2="shoulder" polycoef="0 0.1 0 0 0"/></equality></mujoco>"""


def _make_xml(text: str, rng: mutations.Rng) -> bytes:
    if rng.integers(4):
        content = mutations.xml_text(mutations.repeated(rng, ET.fromstring(text), mutations.mutate_xml))
    else:
        content = text.encode()
    return content if rng.integers(3) else mutations.mutate_bytes(rng, content, [text.encode()])


def _urdf(path: Path, content: bytes) -> Any:
    mimic = ("frozen", "independent", None)[len(content) % 3]
    return urdf.parse_urdf(content, str(path), mimic)


def _mjcf(path: Path, _content: bytes) -> Any:
    return mjcf_import.read_mjcf(path)


# Tables of poses ------------------------------------------------------------------------------------------------------

WAYPOINTS = (
    "time_s,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg\n0,0,0,2,0,0,0\n2,1,0.5,2.1,0,0,10\n4,2,1,2,1,0,20\n6,0,1,2,0,0,0\n"
)
POSES = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n" + "".join(
    f"{0.5 * k},{math.sin(0.3 * k):.5f},{0.1 * k:.3f},{2 + 0.05 * k:.3f},1,0,0,0\n" for k in range(9)
)


def _make_table(text: str, rng: mutations.Rng) -> bytes:
    content = mutations.repeated(rng, text, mutations.mutate_table).encode("utf-8", "surrogatepass")
    return content if rng.integers(3) else mutations.mutate_bytes(rng, content, [text.encode()])


class Refused(Exception):
    """Errors in the form of locations and messages."""


def _waypoints(path: Path, _content: bytes) -> Any:
    section = from_csv.WaypointsFromFile(kind="waypoints", file=path.name)
    return _accepted(*from_csv.expand(section, path.parent))


def _pose_table(path: Path, _content: bytes) -> Any:
    section = from_table.SampledFromFile(kind="sampled", file=path.name)
    return _accepted(*from_table.expand(section, path.parent))


def _accepted(data: Any, errors: list[Any]) -> Any:
    if errors:
        raise Refused("\n".join(message for _, message in errors))
    return data


# Results --------------------------------------------------------------------------------------------------------------


@functools.cache
def _log() -> bytes:
    """Return a short log as a study writes it."""
    shape = flights.PAPER._replace(time=3)
    text = load_scenario("paper").model_dump_json(exclude_none=True)
    buffer = io.BytesIO()
    ds = flights.dataset(np.random.default_rng(0), shape, scenario_json=text)
    ds.to_netcdf(buffer, engine="h5netcdf")
    return buffer.getvalue()


def _make_log(rng: mutations.Rng) -> bytes:
    content = _log()
    if rng.integers(3):
        content = _mutated_hdf5(rng, content)
    if not rng.integers(3):
        content = mutations.repeated(rng, content, lambda r, c: mutations.mutate_bytes(r, c, [_log()]))
    return content


def _mutated_hdf5(rng: mutations.Rng, content: bytes) -> bytes:
    """Return a NetCDF file with a variable or attribute removed, renamed, or of other type, shape or content."""
    buffer = io.BytesIO(content)
    with h5py.File(buffer, "r+") as file:
        name, kind = mutations.pick(rng, sorted(file)), int(rng.integers(8))
        attribute = mutations.pick(rng, sorted(name for name in file.attrs if not name.startswith("_NC")))
        x = file[name]
        if kind == 0:
            del file[name]
        elif kind == 1:
            file.move(name, f"{name}_x")
        elif kind == 2:
            del file.attrs[attribute]
        elif kind == 3:
            wrong = mutations.pick(rng, [*mutations.WORDS[:20], 5, -1, 1e300, float("nan"), [1.0, 2.0], [], b"x", True])
            file.attrs[attribute] = wrong
        elif kind == 4 and x.dtype.kind == "f" and x.size:
            x[tuple(int(rng.integers(n)) for n in x.shape)] = mutations.pick(rng, [np.nan, np.inf, 1e300, 0, -1e9])
        elif kind == 5 and x.dtype.kind == "f":
            del file[name]
            file[name] = mutations.pick(rng, [np.zeros(3, int), "text", np.array([b"a", b"b"]), np.zeros((2, 2)), 1.0])
        elif kind == 6 and x.dtype.kind == "f" and x.size:
            x[:] = mutations.pick(rng, [np.nan, 0.0, 1e300])
        else:
            file.attrs["schema"] = mutations.pick(rng, [0, 1, 2, 4, -1, "3", 2.5, 10**9, float("nan"), [3, 3]])
    return buffer.getvalue()


def _read_log(path: Path, _content: bytes) -> Any:
    ds = log.load(path)
    log.to_csv(ds)
    log.update_times(ds)
    if "scenario_json" in ds.attrs:
        poses.scenario_of_log(ds)
        poses.plugin_classes(ds)
    return ds.time.values, ds.time_sigma.values


def _make_json(name: str, rng: mutations.Rng) -> bytes:
    value = json.loads((DATA / name).read_text())
    if rng.integers(5):
        value = mutations.repeated(rng, value, mutations.mutate_json)
    content = mutations.json_text(value)
    return content if rng.integers(4) else mutations.mutate_bytes(rng, content, [content])


def _summary(path: Path, _content: bytes) -> Any:
    summary = result_files.load_summary(path)
    run_folders.read_run(path.parent)
    with report._report_damage(path):
        warnings = report.collect_warnings(summary, None)
        conclusions.conclude_study(summary, warnings)
        tables.study_table(summary)
        for case in summary["cases"].values():
            for metric in STUDY_METRICS:
                metric.format(case[metric.key])
        "".join(report._contact_forces(summary))


def _certificate(path: Path, _content: bytes) -> Any:
    certificate = result_files.load_certificate(path)
    with report._report_damage(path):
        report.collect_warnings(summary_files.SUMMARY | {"cases": {}}, certificate)
        tables.certificate_table(certificate)
        certify.certificate_notes(certificate)


@functools.cache
def _gp() -> bytes:
    rng = np.random.default_rng(0)
    hyper = {"signal_variance": np.ones(2), "lengthscales": np.ones((2, 3)), "noise_variance": np.full(2, 0.1)}
    arrays = {**hyper, "constant_mean": np.zeros(2), "X": rng.normal(size=(4, 3)), "Y": rng.normal(size=(4, 2))}
    buffer = io.BytesIO()
    np.savez(buffer, format=np.asarray(serialization.FORMAT), capacity=np.asarray(4), **arrays)
    return buffer.getvalue()


def _make_gp(rng: mutations.Rng) -> bytes:
    with np.load(io.BytesIO(_gp())) as file:
        arrays = dict(file)
    name, kind = mutations.pick(rng, sorted(arrays)), int(rng.integers(5))
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[name] = mutations.pick(
            rng, [np.zeros(3), np.asarray("x"), np.asarray(-1), np.zeros((0, 3)), np.ones(())]
        )
    elif kind == 2 and arrays[name].dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            arrays[name] = arrays[name] * mutations.pick(rng, [np.nan, np.inf, 1e300, -1.0, 0.0, 1e-300])
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    content = buffer.getvalue()
    return content if kind < 3 else mutations.mutate_bytes(rng, content, [_gp()])


def _read_gp(path: Path, content: bytes) -> Any:
    arrays = serialization._read_arrays(content)  # `load_gp` without the computation of the posterior
    serialization._validate_arrays(arrays)
    return path.name


# Messages of autopilots -----------------------------------------------------------------------------------------------


def _packed(rng: mutations.Rng) -> bytes:
    """Return a message of an autopilot with random or extreme fields."""
    mav = px4_hil.mavlink.MAVLink(None, srcSystem=1)
    kind = int(rng.integers(4))
    if kind == 0:
        return px4_hil.mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(mav)
    controls = rng.normal(size=16).tolist()
    controls[int(rng.integers(16))] = mutations.pick(rng, [np.nan, np.inf, 1e38, -1e38, 0.0])
    stamp = mutations.pick(rng, [0, 1, 2000, 2001, 4001, 2**63, 2**64 - 1])
    mode = mutations.pick(rng, [0, 128, 129, 255])
    return px4_hil.mavlink.MAVLink_hil_actuator_controls_message(stamp, controls, mode, 1).pack(mav)


def _make_messages(rng: mutations.Rng) -> bytes:
    content = b"".join(_packed(rng) for _ in range(int(rng.integers(1, 5))))
    return mutations.repeated(rng, content, lambda r, c: mutations.mutate_bytes(r, c, [_packed(r)]))


class _Received(socket.socket):
    """Socket that has received some bytes, after which the autopilot closes it."""

    def __init__(self, content: bytes) -> None:
        super().__init__()
        self.parts = [content[k : k + 97] for k in range(0, len(content), 97)]

    def recv(self, *_: int) -> bytes:
        return self.parts.pop(0) if self.parts else b""


def _messages(_path: Path, content: bytes) -> Any:
    with _Received(content) as connection:
        link = px4_hil.AutopilotConnection(connection)
        return px4_hil.rotor_signals(link.receive_actuators(2001, 5.0), 0, 2001, 4001, 4)


READERS: dict[str, Reader] = {
    "scenario": Reader(_make_scenario, _scenario, (ScenarioError,), "input.yaml"),
    "override": Reader(_make_override, _override, (ScenarioError,), "input.txt"),
    "migration": Reader(_make_scenario, _migrate, (ScenarioError,), "input.yaml"),
    "urdf": Reader(functools.partial(_make_xml, URDF), _urdf, (ValueError,), "input.urdf"),
    "mjcf": Reader(functools.partial(_make_xml, MJCF), _mjcf, (ValueError, OSError), "input.xml"),
    "waypoints": Reader(functools.partial(_make_table, WAYPOINTS), _waypoints, (Refused,), "input.csv"),
    "pose_table": Reader(functools.partial(_make_table, POSES), _pose_table, (Refused,), "input.csv"),
    "log": Reader(_make_log, _read_log, (ValueError,), "input.nc"),
    "summary": Reader(functools.partial(_make_json, "summary.json"), _summary, (ValueError,), "summary.json"),
    "certificate": Reader(
        functools.partial(_make_json, "certificate.json"), _certificate, (ValueError,), "certificate.json"
    ),
    "gp": Reader(_make_gp, _read_gp, (ValueError,), "input.npz"),
    "autopilot": Reader(_make_messages, _messages, (OSError,), "input.bin"),
}
"""Readers by name."""
