"""Export of flights as ROS 2 bags in MCAP format with poses, wrenches and joint states (extra `mcap`).

Frames are `world`, `payload` (origin at the center of mass), the name of each agent (its base, the root of its URDF)
and `agent/arm` (the contact, fixed in the payload frame); `/tf` contains their poses. A wrench is in the frame of its
header. Time starts at 0. ROS does not permit `-` in names; it is replaced by `_`.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from colift.analysis import poses
from colift.closed_loop import log
from colift.math import so3
from colift.models import aerial_manipulator
from colift.models.parameters import Team
from colift.runtime import extras
from colift.scenario import team as team_module

try:
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"mcap and rosbags are not installed: {extras.install_command('mcap')}", name="mcap"
    ) from error

WORLD, PAYLOAD = "world", "payload"
ROS = get_typestore(Stores.ROS2_JAZZY)  # message definitions
Time = ROS.types["builtin_interfaces/msg/Time"]
Header = ROS.types["std_msgs/msg/Header"]
JointState = ROS.types["sensor_msgs/msg/JointState"]
TFMessage = ROS.types["tf2_msgs/msg/TFMessage"]
GEOMETRY = ("Vector3", "Point", "Quaternion", "Transform", "TransformStamped", "Pose", "PoseStamped")
"""Messages of geometry_msgs."""
Vector3, Point, Quaternion, Transform, TransformStamped, Pose, PoseStamped, Wrench, WrenchStamped = (
    ROS.types[f"geometry_msgs/msg/{name}"] for name in (*GEOMETRY, "Wrench", "WrenchStamped")
)


class BagTopic(NamedTuple):
    """Topic of a bag.

    Attributes:
        name: Name of the topic.
        type: Message type.
        frame: Frame id of the header.
        message: Function of header and row index that returns the message.
    """

    name: str
    type: Any
    frame: str
    message: Callable[[Any, int], Any]


def to_mcap(ds: xr.Dataset) -> bytes:
    """Convert the log of a flight to an MCAP file with one message per topic and tick.

    The metadata record `colift` identifies run, scenario and case. A log without a valid scenario raises `ValueError`,
    as do names that are equal after the replacement of `-`.

    Args:
        ds: Log.

    Returns:
        Content of the file.

    Example:
        >>> Path("C3.mcap").write_bytes(to_mcap(log.load("out/paper/C3.nc")))  # doctest: +SKIP
    """
    settings = poses.scenario_of_log(ds)
    team, _ = team_module.team(settings)
    topics = tuple(_topics(ds, team))
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="ros2", library=f"colift {version('colift')}")
    schemas: dict[str, int] = {}  # id by message type
    channels = []
    for topic in topics:
        type_name = topic.type.__msgtype__
        if type_name not in schemas:
            text, _ = ROS.generate_msgdef(type_name, ros_version=2)
            schemas[type_name] = writer.register_schema(type_name, "ros2msg", text.encode())
        channels.append(writer.register_channel(topic.name, "cdr", schemas[type_name]))
    attributes = ("run", "scenario", "case", "seed", "version", "termination_reason")
    writer.add_metadata("colift", {name: str(ds.attrs[name]) for name in attributes if name in ds.attrs})
    for k, t in enumerate(np.rint(1e9 * ds.time.values).astype(int).tolist()):
        stamp = Time(sec=t // 10**9, nanosec=t % 10**9)
        for topic, channel in zip(topics, channels, strict=True):
            message = topic.message(Header(stamp=stamp, frame_id=topic.frame), k)
            data = ROS.serialize_cdr(message, topic.type.__msgtype__)
            writer.add_message(channel, log_time=t, data=bytes(data), publish_time=t)
    writer.finish()
    return buffer.getvalue()


def _topics(ds: xr.Dataset, team: Team) -> Iterator[BagTopic]:
    """Generate all topics; raise ValueError for names that are equal in ROS."""
    R_L, lam = ds.R_L.values, ds.lam.values
    into_payload = lambda F: np.einsum("tji,tj->ti", R_L, F)  # noqa: E731
    agents, contacts = ([str(name) for name in ds[dim].values] for dim in ("agent", "contact"))
    frame = {name: _ros_name(name) for name in (*agents, *contacts)}
    names = [WORLD, PAYLOAD, *frame.values()]
    if len(set(names)) < len(names):
        duplicates = sorted({name for name in names if names.count(name) > 1})
        raise ValueError(f"{', '.join(duplicates)}: frame names must be unique after the replacement of '-' by '_'")
    R_d = poses.desired_attitude(jnp.asarray(R_L), jnp.asarray(ds.e_R.values), jnp.asarray(ds.Psi.values))
    base, attitude, q_L = poses.base_positions(ds, team), ds.q.values, ds.q_L.values
    transforms = [(WORLD, PAYLOAD, ds.p.values, q_L)]
    yield _pose("/payload/pose", ds.p.values, q_L)
    yield _pose("/payload/reference", ds.p_d.values, np.asarray(_quaternion_of(R_d)))
    yield _wrench("/payload/wrench_desired", PAYLOAD, into_payload(ds.W_d_force.values), ds.W_d_moment.values)
    joint_signals = [log.all_joints(ds, signal) for signal in ("r", "r_dot", "tau_r")]
    joint_names = [str(name) for name in joint_signals[0].joint.values]
    for j, name in enumerate(agents):
        frame_id = frame[name]
        thrust = ds.u.values[:, j, None] * aerial_manipulator.E3
        transforms.append((WORLD, frame_id, base[:, j], attitude[:, j]))
        yield _pose(f"/{frame_id}/pose", base[:, j], attitude[:, j])
        yield _wrench(f"/{frame_id}/wrench", frame_id, thrust, ds.tau.values[:, j])
        joint_indices = [k for k, joint in enumerate(joint_names) if joint.startswith(f"{name}/")]
        if joint_indices:
            joints = [joint_names[k].partition("/")[2] for k in joint_indices]
            yield _joints(f"/{frame_id}/joint_states", joints, *(x.values[:, joint_indices] for x in joint_signals))
    positions = np.concatenate([np.asarray(group.contact_position).reshape(-1, 3) for group in team.agent_groups])
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (len(R_L), 1))
    for b, name in enumerate(contacts):
        frame_id = frame[name]
        transforms.append((PAYLOAD, frame_id, np.tile(positions[b], (len(R_L), 1)), identity))
        yield _wrench(f"/{frame_id}/force", frame_id, into_payload(lam[:, b]), np.zeros((len(R_L), 3)))
    yield _transforms(transforms)


_quaternion_of = jax.jit(so3.quaternion)


def _ros_name(name: str) -> str:
    """Replace `-`, which ROS does not permit in names."""
    return name.replace("-", "_")


# Messages -------------------------------------------------------------------------------------------------------------


def _pose(topic: str, p: np.ndarray, q: np.ndarray) -> BagTopic:
    """Return the topic of a pose in the world frame."""

    def message(header: Any, k: int) -> Any:
        return PoseStamped(header=header, pose=Pose(position=_vector(Point, p[k]), orientation=_quaternion(q[k])))

    return BagTopic(topic, PoseStamped, WORLD, message)


def _wrench(topic: str, frame: str, F: np.ndarray, tau: np.ndarray) -> BagTopic:
    """Return the topic of a wrench."""

    def message(header: Any, k: int) -> Any:
        return WrenchStamped(
            header=header, wrench=Wrench(force=_vector(Vector3, F[k]), torque=_vector(Vector3, tau[k]))
        )

    return BagTopic(topic, WrenchStamped, frame, message)


def _joints(topic: str, names: Sequence[str], r: np.ndarray, r_dot: np.ndarray, tau: np.ndarray) -> BagTopic:
    """Return the topic of joint states."""
    r, r_dot, tau = map(np.ascontiguousarray, (r, r_dot, tau))  # rosbags requires contiguous rows

    def message(header: Any, k: int) -> Any:
        return JointState(header=header, name=list(names), position=r[k], velocity=r_dot[k], effort=tau[k])

    return BagTopic(topic, JointState, "", message)


def _transforms(transforms: Sequence[tuple[str, str, np.ndarray, np.ndarray]]) -> BagTopic:
    """Return the topic `/tf`; each transform consists of parent, child, position and quaternion."""

    def message(header: Any, k: int) -> Any:
        return TFMessage(
            transforms=[
                TransformStamped(
                    header=Header(stamp=header.stamp, frame_id=parent),
                    child_frame_id=child,
                    transform=Transform(translation=_vector(Vector3, p[k]), rotation=_quaternion(q[k])),
                )
                for parent, child, p, q in transforms
            ]
        )

    return BagTopic("/tf", TFMessage, WORLD, message)


def _vector(message_type: Any, v: np.ndarray) -> Any:
    """Return a message with fields x, y and z."""
    x, y, z = v.tolist()
    return message_type(x=x, y=y, z=z)


def _quaternion(wxyz: np.ndarray) -> Any:
    """Return the message of a quaternion."""
    w, x, y, z = wxyz.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
