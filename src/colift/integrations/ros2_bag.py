"""A flight as a ROS 2 bag in the MCAP format: poses, wrenches and joint states (the extra `mcap`).

Frames are `world`, `payload` (at its centre of mass), an agent's name (its base, the root of its URDF) and
`agent/arm` (its contact, fixed in the payload); `/tf` says where they are. A wrench is in the frame that its header
names. Time begins at 0. ROS has no `-` in names: here it is `_`.
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
from jaxtyping import Array, Float

from colift.analysis import poses
from colift.math import so3
from colift.math.linalg import matvec
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Team
from colift.scenario import team as team_module

try:
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("mcap and rosbags are not installed: pip install 'colift[mcap]'", name="mcap") from error

WORLD, PAYLOAD = "world", "payload"
ROS = get_typestore(Stores.ROS2_JAZZY)
Time = ROS.types["builtin_interfaces/msg/Time"]
Header = ROS.types["std_msgs/msg/Header"]
JointState = ROS.types["sensor_msgs/msg/JointState"]
TFMessage = ROS.types["tf2_msgs/msg/TFMessage"]
GEOMETRY = ("Vector3", "Point", "Quaternion", "Transform", "TransformStamped", "Pose", "PoseStamped")
Vector3, Point, Quaternion, Transform, TransformStamped, Pose, PoseStamped, Wrench, WrenchStamped = (
    ROS.types[f"geometry_msgs/msg/{name}"] for name in (*GEOMETRY, "Wrench", "WrenchStamped")
)


class BagTopic(NamedTuple):
    """One stream of messages: what it is at row k of the log, under a header."""

    name: str
    type: Any
    frame: str
    message: Callable[[Any, int], Any]


def to_mcap(ds: xr.Dataset) -> bytes:
    """The flight of a log as an MCAP file, a message a topic a tick; the metadata `colift` say what was flown.

    Raises ValueError for a log that does not hold its scenario, and for names that are the same to ROS.
    """
    told = poses.scenario_of_log(ds)
    team, _ = team_module.team(told)
    topics = tuple(_topics(ds, team))
    state = io.BytesIO()
    writer = Writer(state)
    writer.start(profile="ros2", library=f"colift {version('colift')}")
    schemas: dict[str, int] = {}
    channels = []
    for topic in topics:
        kind = topic.type.__msgtype__
        if kind not in schemas:
            text, _ = ROS.generate_msgdef(kind, ros_version=2)
            schemas[kind] = writer.register_schema(kind, "ros2msg", text.encode())
        channels.append(writer.register_channel(topic.name, "cdr", schemas[kind]))
    stated = ("run", "scenario", "case", "seed", "version", "stopped")
    writer.add_metadata("colift", {name: str(ds.attrs[name]) for name in stated if name in ds.attrs})
    for k, t in enumerate(np.rint(1e9 * ds.time.values).astype(int).tolist()):
        stamp = Time(sec=t // 10**9, nanosec=t % 10**9)
        for topic, channel in zip(topics, channels, strict=True):
            message = topic.message(Header(stamp=stamp, frame_id=topic.frame), k)
            data = ROS.serialize_cdr(message, topic.type.__msgtype__)
            writer.add_message(channel, log_time=t, data=bytes(data), publish_time=t)
    writer.finish()
    return state.getvalue()


def _topics(ds: xr.Dataset, team: Team) -> Iterator[BagTopic]:
    R_L, lam = ds.R_L.values, ds.lam.values
    into_payload = lambda F: np.einsum("tji,tj->ti", R_L, F)  # noqa: E731
    agents, contacts = ([str(name) for name in ds[dim].values] for dim in ("agent", "contact"))
    frame = {name: _ros(name) for name in (*agents, *contacts)}
    names = [WORLD, PAYLOAD, *frame.values()]
    if len(set(names)) < len(names):
        same = sorted({name for name in names if names.count(name) > 1})
        raise ValueError(f"{', '.join(same)}: more than one frame of that name in ROS, which has no '-' in names")
    R_d = poses.desired_attitude(jnp.asarray(R_L), jnp.asarray(ds.e_R.values), jnp.asarray(ds.Psi.values))
    base, attitude = base_positions(ds, team), _quaternions(ds.R.values)
    q_L, W = _quaternions(R_L), ds.W_d.values
    placed = [(WORLD, PAYLOAD, ds.p.values, q_L)]
    yield _pose("/payload/pose", ds.p.values, q_L)
    yield _pose("/payload/reference", ds.p_d.values, _quaternions(R_d))
    yield _wrench("/payload/wrench_desired", PAYLOAD, into_payload(W[:, :3]), W[:, 3:])
    for j, name in enumerate(agents):
        at = frame[name]
        thrust = ds.u.values[:, j, None] * aerial_manipulator.E3
        placed.append((WORLD, at, base[:, j], attitude[:, j]))
        yield _pose(f"/{at}/pose", base[:, j], attitude[:, j])
        yield _wrench(f"/{at}/wrench", at, thrust, ds.tau.values[:, j])
        own = [k for k, joint in enumerate(ds.joint.values) if str(joint).startswith(f"{name}/")]
        if own:
            joints = [str(ds.joint.values[k]).partition("/")[2] for k in own]
            yield _joints(f"/{at}/joint_states", joints, *(ds[x].values[:, own] for x in ("r", "r_dot", "tau_r")))
    ends = np.concatenate([np.asarray(group.contact_position).reshape(-1, 3) for group in team.agent_groups])
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(R_L), 1))
    for b, name in enumerate(contacts):
        at = frame[name]
        placed.append((PAYLOAD, at, np.tile(ends[b], (len(R_L), 1)), level))
        yield _wrench(f"/{at}/force", at, into_payload(lam[:, b]), np.zeros((len(R_L), 3)))
    yield _frames(placed)


def base_positions(ds: xr.Dataset, team: Team) -> np.ndarray:
    """Origins of the bases in the world along a log, `(time, agents, 3)`, m: `x - R s(r)`."""
    found = [np.asarray(_origins(*group)) for group in poses.poses_by_group(ds, team)]
    return np.concatenate(found, axis=1)


@jax.vmap
def _origin(
    agent: AerialManipulator, R: Float[Array, "3 3"], x: Float[Array, "3"], r: Float[Array, "n_r"]
) -> Float[Array, "3"]:
    return x - matvec(R, aerial_manipulator.center_of_mass(agent, r))


_origins = jax.jit(jax.vmap(_origin, in_axes=(None, 0, 0, 0)))
_turned = jax.jit(so3.quaternion)


def _quaternions(R: Any) -> np.ndarray:
    return np.asarray(_turned(jnp.asarray(R)))


def _ros(name: str) -> str:
    return name.replace("-", "_")


# Messages -------------------------------------------------------------------------------------------------------------


def _pose(topic: str, p: np.ndarray, q: np.ndarray) -> BagTopic:
    def message(header: Any, k: int) -> Any:
        return PoseStamped(header=header, pose=Pose(position=_vector(Point, p[k]), orientation=_quaternion(q[k])))

    return BagTopic(topic, PoseStamped, WORLD, message)


def _wrench(topic: str, frame: str, F: np.ndarray, tau: np.ndarray) -> BagTopic:
    def message(header: Any, k: int) -> Any:
        return WrenchStamped(
            header=header, wrench=Wrench(force=_vector(Vector3, F[k]), torque=_vector(Vector3, tau[k]))
        )

    return BagTopic(topic, WrenchStamped, frame, message)


def _joints(topic: str, names: Sequence[str], r: np.ndarray, r_dot: np.ndarray, tau: np.ndarray) -> BagTopic:
    r, r_dot, tau = map(np.ascontiguousarray, (r, r_dot, tau))  # rosbags takes no other rows

    def message(header: Any, k: int) -> Any:
        return JointState(header=header, name=list(names), position=r[k], velocity=r_dot[k], effort=tau[k])

    return BagTopic(topic, JointState, "", message)


def _frames(placed: Sequence[tuple[str, str, np.ndarray, np.ndarray]]) -> BagTopic:
    def message(header: Any, k: int) -> Any:
        return TFMessage(
            transforms=[
                TransformStamped(
                    header=Header(stamp=header.stamp, frame_id=parent),
                    child_frame_id=child,
                    transform=Transform(translation=_vector(Vector3, p[k]), rotation=_quaternion(q[k])),
                )
                for parent, child, p, q in placed
            ]
        )

    return BagTopic("/tf", TFMessage, WORLD, message)


def _vector(kind: Any, v: np.ndarray) -> Any:
    x, y, z = v.tolist()
    return kind(x=x, y=y, z=z)


def _quaternion(wxyz: np.ndarray) -> Any:
    w, x, y, z = wxyz.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
