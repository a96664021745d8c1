"""Tests of exported ROS 2 bags, read back by the readers of rosbags and of mcap."""

from __future__ import annotations

import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.closed_loop import log
from colift.integrations import ros2_bag
from colift.scenario import team as team_module
from tests.support import pinocchio_team, varied_scenarios
from tests.support import random_logs as flights

TOLD = scenario.load_scenario("paper")
SHAPE = flights.Shape(groups=((2, 3, 2),), time=12)


@pytest.fixture(scope="module")
def ds() -> xr.Dataset:
    """Random signals of the paper's team with rotation matrices as attitudes."""
    rng = np.random.default_rng(3)
    turned = {name: Rotation.random(n, random_state=rng).as_matrix() for name, n in (("R", 24), ("R_L", 12), ("d", 12))}
    R_L, R_d = turned["R_L"], turned["d"]
    Q = np.einsum("tji,tjk->tik", R_d, R_L)
    e_R = np.stack([Q[:, 2, 1] - Q[:, 1, 2], Q[:, 0, 2] - Q[:, 2, 0], Q[:, 1, 0] - Q[:, 0, 1]], axis=1) / 2
    Psi = (3 - np.trace(Q, axis1=1, axis2=2)) / 2
    attrs = {"scenario_json": TOLD.model_dump_json(exclude_none=True), "run": flights.RUN, "case": "C1", "R_d": R_d}
    names = {"agents": team_module.agent_names(TOLD), "joints": team_module.joint_names(TOLD)}
    names["contacts"] = team_module.contact_names(TOLD)
    rows = flights.rows(rng, SHAPE, R=turned["R"].reshape(12, 2, 3, 3), R_L=R_L, e_R=e_R, Psi=Psi)
    team, _ = team_module.team(TOLD)
    made = log.dataset(rows, team=team, sigma=flights.sigma(rng, SHAPE), attrs={}, **names)
    return made.assign_attrs(**attrs)


@pytest.fixture(scope="module")
def path(ds: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("bag") / "C1.mcap"
    file.write_bytes(ros2_bag.to_mcap(ds))
    return file


@pytest.fixture(scope="module")
def messages(path: Path) -> dict[str, list[Any]]:
    """Return all messages of every topic as rosbags reads them by the definitions in the file."""
    store, found = get_typestore(Stores.EMPTY), {}
    with Reader(path) as reader:
        types = {}
        for connection in reader.connections:
            types |= get_types_from_msg(connection.msgdef.data, connection.msgtype)
        store.register(types)
        for connection, t, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            header = message.header if hasattr(message, "header") else message.transforms[0].header
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == t
            found.setdefault(connection.topic, []).append(message)
    return found


def xyz(v: Any) -> list[float]:
    return [v.x, v.y, v.z]


def matrix(q: Any) -> np.ndarray:
    return Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()


def test_topics_and_times(ds: xr.Dataset, messages: dict[str, list[Any]]) -> None:
    names = {"payload/pose", "payload/reference", "payload/wrench_desired", "tf"}
    for agent in team_module.agent_names(TOLD):
        names |= {f"{agent}/{x}" for x in ("pose", "wrench", "joint_states")}
    names |= {f"{contact}/force" for contact in team_module.contact_names(TOLD)}
    assert set(messages) == {f"/{name}" for name in names}
    assert {len(each) for each in messages.values()} == {len(ds.time)}
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages["/payload/pose"]]
    np.testing.assert_allclose(stamps, ds.time.values, atol=5e-10)


def test_poses_of_payload_and_reference(ds: xr.Dataset, messages: dict[str, list[Any]]) -> None:
    for topic, p, R in (("pose", ds.p.values, ds.R_L.values), ("reference", ds.p_d.values, ds.attrs["R_d"])):
        for k, m in enumerate(messages[f"/payload/{topic}"]):
            assert m.header.frame_id == "world"
            np.testing.assert_array_equal(xyz(m.pose.position), p[k])
            np.testing.assert_allclose(matrix(m.pose.orientation), R[k], atol=1e-12)


def test_agent_pose_is_the_base_pose(ds: xr.Dataset, messages: dict[str, list[Any]]) -> None:
    team, _ = team_module.team(TOLD)
    for j, name in enumerate(team_module.agent_names(TOLD)):
        agent = pinocchio_team.FreeAgent(pinocchio_team.take(team.agent_groups[0], j))
        for k, m in enumerate(messages[f"/{name}/pose"]):
            still = {"omega": np.zeros(3), "v": np.zeros(3), "r_dot": np.zeros(3)}
            r = ds.r.values[k, 3 * j : 3 * j + 3]
            q, _ = agent.coordinates(SimpleNamespace(R=ds.R.values[k, j], x=ds.x.values[k, j], r=r, **still))
            np.testing.assert_allclose(xyz(m.pose.position), q[:3], atol=1e-12)
            np.testing.assert_allclose(matrix(m.pose.orientation), ds.R.values[k, j], atol=1e-12)


def test_wrenches_are_in_the_stated_frames(ds: xr.Dataset, messages: dict[str, list[Any]]) -> None:
    """Transformed to the world by /tf they equal the log."""
    for k, tf in enumerate(messages["/tf"]):
        frames = {t.child_frame_id: t for t in tf.transforms}
        R_L = matrix(frames["payload"].transform.rotation)
        for topic, F, tau in [("payload/wrench_desired", ds.W_d_force.values[k], ds.W_d_moment.values[k])] + [
            (f"{name}/force", ds.lam.values[k, b], np.zeros(3)) for b, name in enumerate(ds.contact.values)
        ]:
            m = messages[f"/{topic}"][k]
            assert m.header.frame_id == topic.rpartition("/")[0]
            np.testing.assert_allclose(R_L @ xyz(m.wrench.force), F, atol=1e-12)
            np.testing.assert_array_equal(xyz(m.wrench.torque), tau)
        for j, name in enumerate(ds.agent.values):
            m = messages[f"/{name}/wrench"][k]
            assert m.header.frame_id == name
            np.testing.assert_array_equal(xyz(m.wrench.force), [0, 0, ds.u.values[k, j]])
            np.testing.assert_array_equal(xyz(m.wrench.torque), ds.tau.values[k, j])


def test_frames_form_one_tree(ds: xr.Dataset, messages: dict[str, list[Any]]) -> None:
    contacts = [c for agent in TOLD.agents for c in agent.contact_positions_m]
    for k, tf in enumerate(messages["/tf"]):
        frames = {t.child_frame_id: t for t in tf.transforms}
        assert {t.header.frame_id for t in tf.transforms} == {"world", "payload"}
        np.testing.assert_array_equal(xyz(frames["payload"].transform.translation), ds.p.values[k])
        for name, at in zip(ds.contact.values, contacts, strict=True):
            assert frames[name].header.frame_id == "payload"
            np.testing.assert_array_equal(xyz(frames[name].transform.translation), at)
        for name in ds.agent.values:
            where = messages[f"/{name}/pose"][k].pose.position
            np.testing.assert_array_equal(xyz(frames[name].transform.translation), xyz(where))


def test_joint_names_are_those_of_the_scenario(ds: xr.Dataset, messages: dict[str, list[Any]]) -> None:
    for j, agent in enumerate(TOLD.agents):
        own = slice(3 * j, 3 * j + 3)
        for k, m in enumerate(messages[f"/{agent.name}/joint_states"]):
            assert list(m.name) == [joint.name for joint in TOLD.agent_types[agent.type].joints]
            for found, logged in ((m.position, ds.r), (m.velocity, ds.r_dot), (m.effort, ds.tau_r)):
                np.testing.assert_array_equal(found, logged.values[k, own])


def test_cdr_bytes_read_by_mcap(ds: xr.Dataset, path: Path) -> None:
    """CDR decoded in the test: little endian, doubles aligned to eight bytes after a header of four."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}["colift"]
        assert (metadata["run"], metadata["case"]) == (flights.RUN, "C1")
        poses = [m for _, _, m in reader.iter_messages(topics="/payload/pose")]
    assert [m.log_time for m in poses] == np.rint(1e9 * ds.time.values).astype(int).tolist()
    for k, m in enumerate(poses):
        sec, nanosec, size, frame = struct.unpack_from("<iII6s", m.data, 4)
        assert (m.data[:2], sec * 10**9 + nanosec, size, frame) == (b"\0\1", m.log_time, 6, b"world\0")
        x, y, z, *quaternion = struct.unpack_from("<7d", m.data, 4 + 24)
        np.testing.assert_array_equal([x, y, z], ds.p.values[k])
        np.testing.assert_allclose(pin.Quaternion(np.array(quaternion)).matrix(), ds.R_L.values[k], atol=1e-12)


def test_ambiguous_ros_names_are_refused(ds: xr.Dataset) -> None:
    names = ["n-1", "n_1"]
    with pytest.raises(ValueError, match="n_1: frame names must be unique"):
        ros2_bag.to_mcap(ds.assign_coords(agent=names))


def test_prismatic_joints_are_in_the_joint_states(tmp_path: Path) -> None:
    """A team with joints of both types: two cranes that slide, and a claw that turns."""
    told, shape = varied_scenarios.mixed(), flights.Shape(groups=((2, 1, 1), (1, 2, 2)), time=3)
    rng = np.random.default_rng(4)
    rows = flights.rows(rng, shape)
    names = {
        "agents": team_module.agent_names(told),
        "joints": team_module.joint_names(told),
        "contacts": team_module.contact_names(told),
    }
    attrs = {"scenario_json": told.model_dump_json(exclude_none=True)}
    made = log.dataset(rows, team=team_module.team(told)[0], sigma=flights.sigma(rng, shape), attrs=attrs, **names)
    assert made.prismatic_joint.values.tolist() == ["a/hook", "c/winch"]
    (tmp_path / "C1.mcap").write_bytes(ros2_bag.to_mcap(made))
    store, found = get_typestore(Stores.ROS2_JAZZY), {}
    with Reader(tmp_path / "C1.mcap") as reader:
        for connection, _, raw in reader.messages():
            if connection.topic.endswith("joint_states"):
                found.setdefault(connection.topic, []).append(store.deserialize_cdr(raw, connection.msgtype))
    own = {"a": [0], "c": [1], "b": [2, 3]}
    assert set(found) == {f"/{name}/joint_states" for name in own}
    for name, columns in own.items():
        for k, m in enumerate(found[f"/{name}/joint_states"]):
            for values, logged in ((m.position, rows.r), (m.velocity, rows.r_dot), (m.effort, rows.tau_r)):
                np.testing.assert_array_equal(values, logged[k, columns])
