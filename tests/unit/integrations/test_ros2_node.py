"""Tests of the ROS 2 node: conversion of messages, commands, and a run with ROS where installed."""

from __future__ import annotations

import copy
import dataclasses
import importlib
import os
import threading
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.integrations import ros2_node
from colift.models.measurement import Measurement
from colift.models.state import ControlClock
from colift.scenario import experiment, team
from tests.support import small_team as light

ROS = get_typestore(Stores.ROS2_JAZZY)
TOLD = scenario.load_scenario("paper")
NAMES = ros2_node.names(TOLD)


def kind(name: str) -> Any:
    package = "sensor_msgs" if name in ("Imu", "JointState") else "geometry_msgs"
    return ROS.types[f"{package}/msg/{name}"]


def vector(v: np.ndarray, ros_names: str = "Vector3") -> Any:
    return kind(ros_names)(*map(float, v))


def to_messages(m: Measurement, ros_names: ros2_node.RosNames) -> dict[str, Any]:
    """Return a measurement as ROS messages."""
    header = ROS.types["std_msgs/msg/Header"](ROS.types["builtin_interfaces/msg/Time"](0, 0), "")
    m = jax.tree.map(np.asarray, m)
    bodies = {"payload": (m.payload, m.payload.p)}
    agents = [jax.tree.map(lambda x, j=j: x[j], group) for group in m.agents for j in range(len(group.x))]
    bodies |= {name: (agent, agent.x) for name, agent in zip(ros_names.agents, agents, strict=True)}
    messages = {}
    for name, (reading, x) in bodies.items():
        q = kind("Quaternion")(*map(float, Rotation.from_matrix(reading.R).as_quat()))
        messages[f"/{name}/pose"] = kind("PoseStamped")(header, kind("Pose")(vector(x, "Point"), q))
        messages[f"/{name}/velocity"] = kind("Vector3Stamped")(header, vector(reading.v))
        none, omega, a = np.zeros(9), vector(reading.omega), vector(reading.a)
        messages[f"/{name}/imu"] = kind("Imu")(header, q, none, omega, none, a, none)
    for name, joints, arms, agent in zip(*ros_names[:3], agents, strict=True):
        if joints:
            order = np.arange(len(joints))[::-1]  # a message has its own order
            states = [joints[k] for k in order], agent.r[order], np.zeros(len(joints)), np.zeros(len(joints))
            messages[f"/{name}/joint_states"] = kind("JointState")(header, *states)
        moments = np.zeros_like(agent.lam) if agent.moment is None else agent.moment
        for arm, lam, moment in zip(arms, agent.lam, moments, strict=True):
            force = kind("Wrench")(vector(lam), vector(moment))
            messages[f"/{name}/{arm}/tip_force"] = kind("WrenchStamped")(header, force)
    return messages


@pytest.fixture(scope="module")
def random_measurement() -> tuple[Any, Measurement]:
    """The paper's nominal team, and a measurement of it with random numbers."""
    truth, nominal = team.team(TOLD)
    rng = np.random.default_rng(0)
    like = ros2_node._zero_measurement(truth)
    drawn = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), like)

    def turned(x: jax.Array) -> jax.Array:
        R = Rotation.random(int(np.prod(x.shape[:-2])), random_state=rng).as_matrix()
        return jnp.asarray(R.reshape(x.shape))

    return nominal, jax.tree_util.tree_map_with_path(lambda path, x: turned(x) if path[-1].name == "R" else x, drawn)


def test_measurement_is_read_from_messages(random_measurement: tuple[Any, Measurement]) -> None:
    team, m = random_measurement
    messages = to_messages(m, NAMES)
    assert messages.keys() == ros2_node.topics(NAMES).keys()
    assert {topic: type(x).__name__.rpartition("__")[2] for topic, x in messages.items()} == ros2_node.topics(NAMES)
    found = ros2_node.measurement_from_messages(team, NAMES, messages)
    assert jax.tree.structure(found) == jax.tree.structure(m)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(m), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-15)


def test_moments_of_rigid_grips_are_read_from_messages() -> None:
    settings = scenario.load_scenario("rigid_beam")
    truth, _ = team.team(settings)
    like = ros2_node._zero_measurement(truth)
    moment = jnp.asarray(np.random.default_rng(1).normal(size=(2, 1, 3)))
    given = dataclasses.replace(like, agents=(dataclasses.replace(like.agents[0], moment=moment),))
    ros_names = ros2_node.names(settings)
    found = ros2_node.measurement_from_messages(truth, ros_names, to_messages(given, ros_names))
    np.testing.assert_array_equal(found.agents[0].moment, moment)


def test_unusable_messages_are_refused(random_measurement: tuple[Any, Measurement]) -> None:
    team, m = random_measurement
    agent, joint = NAMES.agents[0], NAMES.joints[0][0]

    def answer(topic: str, change: Any) -> str:
        messages = copy.deepcopy(to_messages(m, NAMES))
        change(messages[topic])
        with pytest.raises(ValueError) as caught:  # noqa: PT011
            ros2_node.measurement_from_messages(team, NAMES, messages)
        return str(caught.value)

    assert "x " in answer(f"/{agent}/pose", lambda x: setattr(x.pose.position, "y", np.nan))
    assert "is not a unit quaternion" in answer("/payload/pose", lambda x: setattr(x.pose.orientation, "w", 3.0))
    missing = answer(f"/{agent}/joint_states", lambda x: setattr(x, "name", ["other", *x.name[:-1]]))
    assert f"/{agent}/joint_states: {joint} missing; the message contains other" in missing


@pytest.mark.long
def test_node_commands_equal_the_controller() -> None:
    """Through messages and back, against the controller: three steps of a team at rest, then moved."""
    settings = light.settings()
    case_experiment, ros_names = experiment.make_experiment(settings, "C1"), ros2_node.names(settings)
    tick, controller = ros2_node.ControllerStep(case_experiment, ros_names), case_experiment.controller
    m, state = case_experiment.world.measure_at_rest(case_experiment.initial_state), None
    begin, step = jax.jit(controller.init), jax.jit(controller.step)
    for k in range(3):
        clock = ControlClock(t=jnp.asarray(k * case_experiment.dt), dt=jnp.asarray(case_experiment.dt))
        moved = dataclasses.replace(m.payload, p=m.payload.p + jnp.array([0.01 * k, 0.0, -0.02 * k]))
        m = dataclasses.replace(m, payload=moved)
        if k == 0:
            _, state = begin(m, clock)
        expected, state, _ = step(state, m, clock)
        for j, command in enumerate(tick(to_messages(m, ros_names))):
            np.testing.assert_allclose(command.u, expected[0].u[j], atol=1e-9)
            np.testing.assert_allclose(command.tau, expected[0].tau[j], atol=1e-9)
            assert command.tau_r.shape == (0,)


def test_names_are_valid_in_ros() -> None:
    agents = [agent.model_dump() | {"name": f"n-{i}"} for i, agent in enumerate(light.settings().agents)]
    ros_names = ros2_node.names(light.settings(agents=agents))
    assert ros_names == ros2_node.RosNames(agents=("n_0", "n_1", "n_2"), joints=((), (), ()), arms=(("hook",),) * 3)


def test_a_payload_without_imu_has_no_topic_for_it() -> None:
    """Readings that do not exist are NaN, as in the simulation; those of the agents are required."""
    settings = light.settings(sensors={"payload_imu": False})
    case_experiment, ros_names = experiment.make_experiment(settings, "C1"), ros2_node.names(settings)
    found = ros2_node.topics(ros_names)
    assert "/payload/imu" not in found
    assert f"/{ros_names.agents[0]}/imu" in found
    m = case_experiment.world.measure_at_rest(case_experiment.initial_state)
    messages = {name: each for name, each in to_messages(m, ros_names).items() if name in found}
    read = ros2_node.measurement_from_messages(case_experiment.controller.team, ros_names, messages)
    assert np.isnan(read.payload.omega).all()
    np.testing.assert_allclose(read.payload.p, m.payload.p)


@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")  # of ROS's parser of parameters
def test_node_stops_when_messages_stop() -> None:
    """Another node of the process publishes its topics and then stops."""
    rclpy = pytest.importorskip("rclpy", reason="ROS 2: pip install 'colift[ros]'")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    from geometry_msgs.msg import WrenchStamped

    settings = light.settings()
    case_experiment, ros_names = experiment.make_experiment(settings, "C1"), ros2_node.names(settings)
    messages, commanded, over = (
        to_messages(case_experiment.world.measure_at_rest(case_experiment.initial_state), ros_names),
        [],
        threading.Event(),
    )

    def feed() -> None:
        context = rclpy.Context()
        rclpy.init(context=context)
        other = rclpy.create_node("feeder", context=context)
        executor = rclpy.executors.SingleThreadedExecutor(context=context)
        executor.add_node(other)
        made = {topic: _ros_message(message) for topic, message in messages.items()}
        publishers = {topic: other.create_publisher(type(x), topic, 10) for topic, x in made.items()}
        other.create_subscription(WrenchStamped, f"/{ros_names.agents[0]}/command", commanded.append, 10)
        while not over.is_set() and len(commanded) < 20:
            for topic, publisher in publishers.items():
                publisher.publish(made[topic])
            executor.spin_once(timeout_sec=0.005)
        rclpy.shutdown(context=context)

    thread = threading.Thread(target=feed, daemon=True)
    thread.start()
    try:
        with pytest.raises(TimeoutError, match=r"for 0\.1 s: commands stop"):
            ros2_node.spin(case_experiment, ros_names, 120.0)
    finally:
        over.set()
        thread.join(10)
    assert len(commanded) >= 20
    weight = sum(float(g.mass.sum()) for g in case_experiment.controller.team.agent_groups) + float(
        case_experiment.controller.team.payload.mass
    )
    assert 0 < commanded[0].wrench.force.z < 2 * 9.81 * weight
    assert commanded[0].header.frame_id == ros_names.agents[0]


def _ros_message(message: Any) -> Any:
    """Convert a message of rosbags to one of ROS with the same fields."""
    package, _, name = message.__msgtype__.partition("/msg/")
    made = getattr(importlib.import_module(f"{package}.msg"), name)()
    for field in made.get_fields_and_field_types():
        value = getattr(message, field)
        value = _ros_message(value) if hasattr(value, "__msgtype__") else value
        setattr(
            made,
            field,
            value.tolist() if isinstance(value, np.ndarray) and field in ("position", "velocity", "effort") else value,
        )
    return made
