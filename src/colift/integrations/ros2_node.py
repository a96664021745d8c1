"""ROS 2 node of the onboard controller (extra `ros`; docs/ros2_px4.md).

Subscribed topics; BODY is `payload` or the name of an agent:

- `/BODY/pose`: PoseStamped, world frame.
- `/BODY/velocity`: Vector3Stamped, world frame.
- `/BODY/imu`: Imu; angular velocity and specific force, body frame.
- `/AGENT/joint_states`: JointState.
- `/AGENT/ARM/tip_force`: WrenchStamped; force on the payload in the frame of the tip's body.

Published topics:

- `/AGENT/command`: WrenchStamped, base frame; thrust along z and body torque.
- `/AGENT/joint_commands`: JointState; joint torques.

The world frame is ENU and body frames are FLU, in ROS as in colift. The conversion of messages does not require ROS.
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
from colift.runtime import extras
from colift.scenario import Scenario, team

PAYLOAD = "payload"
MAX_MESSAGE_AGE = 0.1  # s, age at which the node stops


class RosNames(NamedTuple):
    """Names of a team in ROS, in team order; `-` is replaced by `_`.

    Attributes:
        agents: Name of each agent.
        joints: Names of the joints of each agent.
        arms: Names of the arms of each agent.
        payload_imu: Whether the payload has gyroscope and accelerometer.
    """

    agents: tuple[str, ...]
    joints: tuple[tuple[str, ...], ...]
    arms: tuple[tuple[str, ...], ...]
    payload_imu: bool = True


def names(settings: Scenario) -> RosNames:
    """Return the ROS names of the team of a scenario.

    Args:
        settings: Scenario.

    Returns:
        The names.
    """
    agents = team.agent_names(settings)

    def own(names: tuple[str, ...], agent: str) -> tuple[str, ...]:
        return tuple(name.partition("/")[2] for name in names if name.startswith(f"{agent}/"))

    joints, arms = team.joint_names(settings), team.contact_names(settings)
    return RosNames(
        agents=tuple(_ros_name(agent) for agent in agents),
        joints=tuple(own(joints, agent) for agent in agents),
        arms=tuple(tuple(map(_ros_name, own(arms, agent))) for agent in agents),
        payload_imu=settings.sensors.payload_imu,
    )


def _ros_name(name: str) -> str:
    """Replace `-`, which ROS does not permit in names."""
    return name.replace("-", "_")


def topics(names: RosNames) -> dict[str, str]:
    """Return the subscribed topics.

    Args:
        names: ROS names of the team.

    Returns:
        Message type by topic.
    """
    types = {}
    for body in (PAYLOAD, *names.agents):
        types |= {f"/{body}/pose": "PoseStamped", f"/{body}/velocity": "Vector3Stamped"}
        types |= {f"/{body}/imu": "Imu"} if body != PAYLOAD or names.payload_imu else {}
    for agent, joints, arms in zip(names.agents, names.joints, names.arms, strict=True):
        types |= {f"/{agent}/joint_states": "JointState"} if joints else {}
        types |= {f"/{agent}/{arm}/tip_force": "WrenchStamped" for arm in arms}
    return types


def measurement_from_messages(team: Team, names: RosNames, messages: Mapping[str, Any]) -> Measurement:
    """Convert the last message of each topic to a measurement.

    An orientation that is not a unit quaternion, a missing joint, or a value that is not finite raises `ValueError`.

    Args:
        team: Parameters of the team.
        names: ROS names of the team.
        messages: Last message of each topic.

    Returns:
        The measurement.
    """
    each_agent = zip(names.agents, names.joints, names.arms, strict=True)
    agents = [_agent(*agent_names, messages) for agent_names in each_agent]
    groups, first = [], 0
    for size, members in zip(team.sizes, team.agent_groups, strict=True):
        group = agents[first : first + size]
        fields = [name for name in group[0] if name != "moment" or members.moment_axis is not None]
        groups.append(AgentReading(**{name: _array(name, [agent[name] for agent in group]) for name in fields}))
        first += size
    payload = {
        "p" if name == "x" else name: _array(f"{PAYLOAD} {name}", values)
        for name, values in _body(PAYLOAD, messages, has_imu=names.payload_imu).items()
    }
    if not names.payload_imu:  # readings that do not exist, as in the simulation
        payload |= dict.fromkeys(("omega", "a"), jnp.full(3, jnp.nan))
    return Measurement(agents=tuple(groups), payload=PayloadReading(**payload))


def _array(name: str, values: Any) -> jax.Array:
    """Return values as an array; raise ValueError if a value is not finite."""
    array = np.asarray(values, float)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} {array.tolist()} is not finite")
    return jnp.asarray(array)


def _xyz(v: Any) -> list[float]:
    """Return the components of a vector message."""
    return [v.x, v.y, v.z]


def _body(body: str, messages: Mapping[str, Any], *, has_imu: bool = True) -> dict[str, Any]:
    """Return the measurements of a body by field name."""
    pose = messages[f"/{body}/pose"].pose
    q = np.array([pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w])
    if not abs(q @ q - 1) <= 1e-3:
        raise ValueError(f"/{body}/pose: the orientation {q.tolist()} is not a unit quaternion")
    found: dict[str, Any] = {
        "R": Rotation.from_quat(q).as_matrix(),
        "x": _xyz(pose.position),
        "v": _xyz(messages[f"/{body}/velocity"].vector),
    }
    if has_imu:
        imu = messages[f"/{body}/imu"]
        found |= {"omega": _xyz(imu.angular_velocity), "a": _xyz(imu.linear_acceleration)}
    return found


def _agent(name: str, joints: tuple[str, ...], arms: tuple[str, ...], messages: Mapping[str, Any]) -> dict[str, Any]:
    """Return the measurements of an agent by field name."""
    r = []
    if joints:
        message = messages[f"/{name}/joint_states"]
        positions = dict(zip(message.name, message.position, strict=True))
        if missing := [joint for joint in joints if joint not in positions]:
            available = ", ".join(positions)
            raise ValueError(f"/{name}/joint_states: {', '.join(missing)} missing; the message contains {available}")
        r = [positions[joint] for joint in joints]
    wrenches = [messages[f"/{name}/{arm}/tip_force"].wrench for arm in arms]
    loads = {"lam": [_xyz(wrench.force) for wrench in wrenches], "moment": [_xyz(x.torque) for x in wrenches]}
    return _body(name, messages) | {"r": r} | loads


class AgentCommand(NamedTuple):
    """Command of one agent for one control period.

    Attributes:
        u: Thrust [N].
        tau: Body torque, base frame [N m].
        tau_r: Joint torques [N m]; forces of prismatic joints [N].
    """

    u: float
    tau: np.ndarray
    tau_r: np.ndarray


def command_messages(inputs: TeamInputs) -> list[AgentCommand]:
    """Split the inputs of a team into the commands of its agents.

    Args:
        inputs: Inputs of all agents.

    Returns:
        Commands in team order.
    """
    return [
        AgentCommand(float(u), tau, tau_r)
        for group in jax.tree.map(np.asarray, inputs)
        for u, tau, tau_r in zip(group.u, group.tau, group.tau_r, strict=True)
    ]


class ControllerStep:
    """Controller with its state, independent of ROS; the first measurement, at rest, initializes the state.

    Attributes:
        controller: Onboard controller.
        names: ROS names of the team.
        dt: Control period [s].
        ticks: Number of control periods until now.
        state: State of the controller.
    """

    def __init__(self, experiment: flight.Experiment, names: RosNames) -> None:
        """Compile the controller.

        Args:
            experiment: Experiment that defines controller and control period.
            names: ROS names of the team.
        """
        self.controller, self.names, self.dt, self.ticks = experiment.calibrated().controller, names, experiment.dt, 0
        measurement = _zero_measurement(self.controller.team)
        self._init = jax.jit(lambda controller, *inputs: controller.init(*inputs)[1])
        self.state = self._init(self.controller, measurement, self._clock())
        self._step = _compile_step(self.controller, self.state, measurement, self._clock())

    def __call__(self, messages: Mapping[str, Any]) -> list[AgentCommand]:
        """Compute the commands of one control period.

        Messages that are not valid raise `ValueError`, as in `measurement_from_messages`.

        Args:
            messages: Last message of each topic.

        Returns:
            Commands in team order.
        """
        m = measurement_from_messages(self.controller.team, self.names, messages)
        if self.ticks == 0:
            self.state = self._init(self.controller, m, self._clock())
        command, self.state = self._step(self.controller, self.state, m, self._clock())
        self.ticks += 1
        return command_messages(command)

    def _clock(self) -> ControlClock:
        return ControlClock(t=jnp.asarray(self.ticks * self.dt), dt=jnp.asarray(self.dt))


def _zero_measurement(team: Team) -> Measurement:
    """Return a measurement with the shapes of the team, zero except for the attitudes."""
    zero = {name: jnp.zeros(3) for name in ("x", "v", "omega", "a")}
    groups = []
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        agent = {"R": jnp.eye(3), **zero, "r": jnp.zeros(group.tree.joints), "lam": jnp.zeros((group.tree.arms, 3))}
        if group.moment_axis is not None:
            agent["moment"] = jnp.zeros((group.tree.arms, 3))
        groups.append(AgentReading(**{name: jnp.repeat(x[None], size, axis=0) for name, x in agent.items()}))
    zero["p"] = zero.pop("x")
    return Measurement(agents=tuple(groups), payload=PayloadReading(R=jnp.eye(3), **zero))


def _compile_step(*args: Any) -> Callable[..., Any]:
    """Compile a control period and call it once."""
    compiled = jax.jit(codegen.compile(lambda controller, *inputs: controller.step(*inputs)[:2]))
    jax.block_until_ready(compiled(*args))
    return compiled


def spin(experiment: flight.Experiment, names: RosNames, seconds: float = float("inf")) -> int:
    """Run the controller of an experiment as the ROS 2 node `colift`.

    The node publishes commands when it has received a message on each topic. After an exception it publishes no further
    commands. A message that is not valid raises `ValueError`. A topic without a message for `MAX_MESSAGE_AGE` raises
    `TimeoutError`.

    Args:
        experiment: Experiment that defines controller and control period.
        names: ROS names of the team.
        seconds: Duration [s].

    Returns:
        Number of control periods.

    Raises:
        ModuleNotFoundError: If ROS 2 is not installed.

    Example:
        >>> settings = colift.load_scenario("paper")  # doctest: +SKIP
        >>> spin(colift.make_experiment(settings, "C1"), names(settings))  # doctest: +SKIP
    """
    try:
        import rclpy
        from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
        from sensor_msgs.msg import Imu, JointState
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"ROS 2 is not installed: {extras.install_command('ros')}", name="rclpy") from error
    message_types = {kind.__name__: kind for kind in (PoseStamped, Vector3Stamped, WrenchStamped, Imu, JointState)}
    controller_step, messages, received = ControllerStep(experiment, names), {}, {}
    rclpy.init()
    try:
        node = rclpy.create_node("colift")
        now = lambda: 1e-9 * node.get_clock().now().nanoseconds  # noqa: E731

        def make_callback(topic: str) -> Callable[[Any], None]:
            def store(message: Any) -> None:
                messages[topic], received[topic] = message, now()

            return store

        required = topics(names)
        for topic, type_name in required.items():
            node.create_subscription(message_types[type_name], topic, make_callback(topic), 10)
        wrenches = [node.create_publisher(WrenchStamped, f"/{agent}/command", 10) for agent in names.agents]
        efforts = [node.create_publisher(JointState, f"/{agent}/joint_commands", 10) for agent in names.agents]

        def step() -> None:
            if messages.keys() != required.keys():
                return
            outdated = [topic for topic, t in received.items() if now() - t > MAX_MESSAGE_AGE]
            if outdated and controller_step.ticks:
                raise TimeoutError(f"no message on {', '.join(outdated)} for {MAX_MESSAGE_AGE:g} s: commands stop")
            stamp = node.get_clock().now().to_msg()
            for j, command in enumerate(controller_step(messages)):
                message = WrenchStamped()
                message.header.stamp, message.header.frame_id = stamp, names.agents[j]
                message.wrench.force.z = command.u
                torque = message.wrench.torque
                torque.x, torque.y, torque.z = command.tau.tolist()
                wrenches[j].publish(message)
                if names.joints[j]:
                    message = JointState(name=list(names.joints[j]), effort=command.tau_r.tolist())
                    message.header.stamp = stamp
                    efforts[j].publish(message)

        node.create_timer(experiment.dt, step)
        end = now() + seconds
        while now() < end and rclpy.ok():
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        rclpy.try_shutdown()
    return controller_step.ticks
