"""The pilot's tick as a ROS 2 node: sensors' topics in, commands' topics out (the extra `ros`; docs/ros2_px4.md).

Of each `body`, `payload` or an agent's name: `/body/pose` (PoseStamped, world), `/body/velocity` (Vector3Stamped,
world) and `/body/imu` (Imu: rate and specific force, body frame); of each agent also `/agent/joint_states`
(JointState), and of each contact `/agent/arm/tip_force` (WrenchStamped: force on the payload, frame of the tip's body).
Out: `/agent/command` (WrenchStamped, base frame: thrust along z, body torque) and `/agent/joint_commands` (JointState,
effort). ROS's world is ENU and its bodies FLU, as ours. What a message holds is read without ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from colift import codegen
from colift.closed_loop import flight
from colift.models.measurement import AgentReading, Measurement, PayloadReading
from colift.models.parameters import Team
from colift.models.state import ControlClock, TeamInputs
from colift.scenario import Scenario, team

PAYLOAD = "payload"
MAX_MESSAGE_AGE = 0.1  # s, after which a reading is not flown with


class RosNames(NamedTuple):
    """Of everything in team order, as ROS has them: `-` is `_`."""

    agents: tuple[str, ...]
    joints: tuple[tuple[str, ...], ...]  # of each agent
    arms: tuple[tuple[str, ...], ...]


def names(settings: Scenario) -> RosNames:
    """The names of a scenario's team."""
    agents = team.agent_names(settings)

    def own(of: tuple[str, ...], agent: str) -> tuple[str, ...]:
        return tuple(name.partition("/")[2] for name in of if name.startswith(f"{agent}/"))

    joints, arms = team.joint_names(settings), team.contact_names(settings)
    return RosNames(
        agents=tuple(_ros(agent) for agent in agents),
        joints=tuple(own(joints, agent) for agent in agents),
        arms=tuple(tuple(map(_ros, own(arms, agent))) for agent in agents),
    )


def _ros(name: str) -> str:
    return name.replace("-", "_")


def topics(of: RosNames) -> dict[str, str]:
    """Every topic that is listened to, and its message's type."""
    found = {}
    for body in (PAYLOAD, *of.agents):
        found |= {f"/{body}/pose": "PoseStamped", f"/{body}/velocity": "Vector3Stamped", f"/{body}/imu": "Imu"}
    for agent, joints, arms in zip(*of, strict=True):
        found |= {f"/{agent}/joint_states": "JointState"} if joints else {}
        found |= {f"/{agent}/{arm}/tip_force": "WrenchStamped" for arm in arms}
    return found


def measurement_from_messages(team: Team, of: RosNames, innovation_state: Mapping[str, Any]) -> Measurement:
    """What the last message of every topic says, by topic.

    Raises ValueError for an attitude that is none, a joint that is missing, and a number that is not finite.
    """
    each = [_agent(*one, innovation_state) for one in zip(*of, strict=True)]
    groups, first = [], 0
    for size in team.sizes:
        of_group = each[first : first + size]
        groups.append(AgentReading(**{name: _array(name, [one[name] for one in of_group]) for name in of_group[0]}))
        first += size
    return Measurement(
        agents=tuple(groups),
        payload=PayloadReading(**{
            "p" if name == "x" else name: _array(f"{PAYLOAD}'s {name}", x) for name, x in _body(PAYLOAD, innovation_state).items()
        }),
    )  # fmt: skip


def _array(what: str, values: Any) -> jax.Array:
    array = np.asarray(values, float)
    if not np.isfinite(array).all():
        raise ValueError(f"{what} {array.tolist()} is not finite")
    return jnp.asarray(array)


def _xyz(v: Any) -> list[float]:
    return [v.x, v.y, v.z]


def _body(body: str, innovation_state: Mapping[str, Any]) -> dict[str, Any]:
    pose, imu = innovation_state[f"/{body}/pose"].pose, innovation_state[f"/{body}/imu"]
    q = np.array([pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w])
    if not abs(q @ q - 1) <= 1e-3:
        raise ValueError(f"/{body}/pose: the orientation {q.tolist()} is not a unit quaternion")
    return {
        "R": Rotation.from_quat(q).as_matrix(),
        "x": _xyz(pose.position),
        "v": _xyz(innovation_state[f"/{body}/velocity"].vector),
        "omega": _xyz(imu.angular_velocity),
        "a": _xyz(imu.linear_acceleration),
    }


def _agent(
    name: str, joints: tuple[str, ...], arms: tuple[str, ...], innovation_state: Mapping[str, Any]
) -> dict[str, Any]:
    r = []
    if joints:
        state = innovation_state[f"/{name}/joint_states"]
        at = dict(zip(state.name, state.position, strict=True))
        if missing := [joint for joint in joints if joint not in at]:
            raise ValueError(f"/{name}/joint_states: {', '.join(missing)} missing; there are {', '.join(at)}")
        r = [at[joint] for joint in joints]
    lam = [_xyz(innovation_state[f"/{name}/{arm}/tip_force"].wrench.force) for arm in arms]
    return _body(name, innovation_state) | {"r": r, "lam": lam}


class AgentCommand(NamedTuple):
    """What one agent is to do until the next tick."""

    u: float  # N
    tau: np.ndarray  # N m, base frame
    tau_r: np.ndarray  # N m or N


def command_messages(inputs: TeamInputs) -> list[AgentCommand]:
    """Of each agent, in team order."""
    return [
        AgentCommand(float(u), tau, tau_r)
        for group in jax.tree.map(np.asarray, inputs)
        for u, tau, tau_r in zip(group.u, group.tau, group.tau_r, strict=True)
    ]


class ControllerStep:
    """The pilot between ticks, without ROS: compiled when it is made, begun by the first measurement, at rest."""

    def __init__(self, experiment: flight.Experiment, of: RosNames) -> None:
        self.pilot, self.names, self.dt, self.ticks = experiment.controller, of, experiment.dt, 0
        still = _still(self.pilot.team)
        self._begin = jax.jit(lambda controller, *now: controller.init(*now)[1])
        self.memory = self._begin(self.pilot, still, self._clock())
        self._tick = _compiled(self.pilot, self.memory, still, self._clock())

    def __call__(self, innovation_state: Mapping[str, Any]) -> list[AgentCommand]:
        """The commands from now on; raises ValueError as `measurement`."""
        m = measurement_from_messages(self.pilot.team, self.names, innovation_state)
        if self.ticks == 0:
            self.memory = self._begin(self.pilot, m, self._clock())
        command, self.memory = self._tick(self.pilot, self.memory, m, self._clock())
        self.ticks += 1
        return command_messages(command)

    def _clock(self) -> ControlClock:
        return ControlClock(t=jnp.asarray(self.ticks * self.dt), dt=jnp.asarray(self.dt))


def _still(team: Team) -> Measurement:
    """A measurement of the team's shapes."""
    zero = {name: jnp.zeros(3) for name in ("x", "v", "omega", "a")}
    groups = []
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        one = {"R": jnp.eye(3), **zero, "r": jnp.zeros(group.tree.joints), "lam": jnp.zeros((group.tree.arms, 3))}
        groups.append(AgentReading(**{name: jnp.repeat(x[None], size, axis=0) for name, x in one.items()}))
    zero["p"] = zero.pop("x")
    return Measurement(agents=tuple(groups), payload=PayloadReading(R=jnp.eye(3), **zero))


def _compiled(*like: Any) -> Callable[..., Any]:
    """The tick in native code, or by JAX where a part has none: its first call must not take seconds."""
    tick = lambda controller, *now: controller.step(*now)[:2]  # noqa: E731
    try:
        made = jax.jit(codegen.compile(tick))
        made.lower(*like)
    except codegen.UnsupportedPrimitive:
        made = jax.jit(tick)
    jax.block_until_ready(made(*like))
    return made


def spin(experiment: flight.Experiment, of: RosNames, seconds: float = float("inf")) -> int:
    """Fly a plan's pilot as the ROS 2 node `colift`, for so long; the number of ticks that were commanded.

    It begins once every topic was heard. Raises ModuleNotFoundError where ROS is not installed, TimeoutError where a
    topic falls silent for `STALE`, ValueError as `measurement`: then nothing more is commanded.
    """
    try:
        import rclpy
        from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
        from sensor_msgs.msg import Imu, JointState
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("ROS 2 is not installed: pip install 'colift[ros]'", name="rclpy") from error
    kinds = {kind.__name__: kind for kind in (PoseStamped, Vector3Stamped, WrenchStamped, Imu, JointState)}
    tick, innovation_state, since = ControllerStep(experiment, of), {}, {}
    rclpy.init()
    try:
        node = rclpy.create_node("colift")
        context = lambda: 1e-9 * node.get_clock().now().nanoseconds  # noqa: E731

        def hear(topic: str) -> Callable[[Any], None]:
            def keep(message: Any) -> None:
                innovation_state[topic], since[topic] = message, context()

            return keep

        wanted = topics(of)
        for topic, kind in wanted.items():
            node.create_subscription(kinds[kind], topic, hear(topic), 10)
        wrenches = [node.create_publisher(WrenchStamped, f"/{agent}/command", 10) for agent in of.agents]
        efforts = [node.create_publisher(JointState, f"/{agent}/joint_commands", 10) for agent in of.agents]

        def step() -> None:
            if innovation_state.keys() != wanted.keys():
                return
            silent = [topic for topic, t in since.items() if context() - t > MAX_MESSAGE_AGE]
            if silent and tick.ticks:
                raise TimeoutError(f"{', '.join(silent)} silent for {MAX_MESSAGE_AGE:g} s: nothing more is commanded")
            stamp = node.get_clock().now().to_msg()
            for j, command in enumerate(tick(innovation_state)):
                message = WrenchStamped()
                message.header.stamp, message.header.frame_id = stamp, of.agents[j]
                message.wrench.force.z = command.u
                torque = message.wrench.torque
                torque.x, torque.y, torque.z = command.tau.tolist()
                wrenches[j].publish(message)
                if of.joints[j]:
                    message = JointState(name=list(of.joints[j]), effort=command.tau_r.tolist())
                    message.header.stamp = stamp
                    efforts[j].publish(message)

        node.create_timer(experiment.dt, step)
        until = context() + seconds
        while context() < until and rclpy.ok():
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        rclpy.try_shutdown()
    return tick.ticks
