"""Tests of the lockstep server with a stand-in autopilot that implements only PX4's side of the protocol."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import queue
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from colift.closed_loop import simulator
from colift.closed_loop.flight import Experiment, draw_noise
from colift.integrations import px4_frames, px4_hil
from colift.models.measurement import AgentReading
from colift.scenario import experiment
from tests.support import small_team as light

TICKS = 100
BOOT, ARM = 3, 7  # sensor messages before the first answer, and before arming
ROTORS = np.array([(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]) * [0.15, 0.15, 0.05]  # m: forward, right, yaw


@dataclasses.dataclass
class StandIn:
    """PX4 in lockstep: its clock is that of the sensor messages, it answers each, its rotors are in FRD."""

    port: int
    setpoints: queue.SimpleQueue  # thrust and torque setpoints, as they would come over uORB
    thrust_max: float
    quits: int = 10**9  # sensor messages after which it ends

    def run(self) -> None:
        self.received: dict[str, list] = {}
        mav = mavlink.MAVLink(None, srcSystem=1)
        with socket.create_connection(("127.0.0.1", self.port)) as connection:
            while len(self.received.get("HIL_SENSOR", ())) < self.quits and (received := connection.recv(4096)):
                for message in mav.parse_buffer(received) or ():
                    self.received.setdefault(message.get_type(), []).append(message)
                    if message.get_type() == "HIL_SENSOR":
                        connection.sendall(self.answer(mav, message.time_usec))

    def answer(self, mav: mavlink.MAVLink, time: int) -> bytes:
        """Return rotor signals for the setpoint by PX4's geometry; none during startup, zeros until armed."""
        thrust, torque = self.setpoints.get(timeout=600)
        received = len(self.received["HIL_SENSOR"])
        if received <= BOOT:
            return b""
        half = np.abs(ROTORS[:, [1, 0, 2]]).sum(0) / 2 * self.thrust_max / 4
        effect = np.array([[1, -y, x, k] for x, y, k in ROTORS]).T * self.thrust_max / 4
        armed = received > ARM
        signals = np.linalg.solve(effect, [-thrust[2] * self.thrust_max, *(np.asarray(torque) * half)]) * armed
        mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed * mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return mavlink.MAVLink_hil_actuator_controls_message(time, [*signals, *[0.0] * 12], mode, 1).pack(mav)


@pytest.fixture(scope="module")
def plan() -> Experiment:
    """Half the initial errors of the sample. With all of them a torque needs a negative rotor signal, clipped to 0."""
    initial = light.SAMPLE.initial_state
    errors = {name: tuple(x / 2 for x in getattr(initial, name)) for name in ("position_error_m", "attitude_error_deg")}
    scenario = light.settings(initial_state=initial.model_copy(update=errors))
    return dataclasses.replace(experiment.make_experiment(scenario, "C1"), duration=TICKS * 0.002)


def simulate_with_autopilots(one_experiment: Experiment, **options: int) -> tuple[list, list[StandIn]]:
    """Return all steps of a flight and the autopilots afterwards."""
    most = [float(x) for group in one_experiment.world.team.agent_groups for x in group.thrust_max]
    with px4_hil.open_servers(len(most), 0) as servers:
        ports = [server.getsockname()[1] for server in servers]
        stand_ins = [StandIn(port, queue.SimpleQueue(), u, **options) for port, u in zip(ports, most, strict=True)]
        threads = [threading.Thread(target=each.run, daemon=True) for each in stand_ins]
        for thread in threads:
            thread.start()
        try:
            with px4_hil.accept_connections(servers, 30.0) as links:
                request = lambda j, setpoint: stand_ins[j].setpoints.put(setpoint)  # noqa: E731
                return list(px4_hil.run_lockstep(one_experiment, links, request)), stand_ins
        finally:
            for thread in threads:
                thread.join(30)


@pytest.fixture(scope="module")
def flight(plan: Experiment) -> tuple[list, list[StandIn]]:
    return simulate_with_autopilots(plan)


@pytest.mark.long
def test_flight_equals_that_without_autopilots(plan: Experiment, flight: tuple[list, list[StandIn]]) -> None:
    """Setpoints in FRD, returned as rotor signals, yield the commanded thrust and torque.

    But for signals of 32 bits, 6e-8 of a rotor's force.
    """
    noise = draw_noise(plan.world, jax.random.fold_in(jax.random.fold_in(jax.random.key(plan.seed), 2), 0), 250)
    _, rows = simulator.rollout(
        plan.loop_config, simulator.reset(plan.loop_config, plan.initial_state), noise, jnp.asarray(TICKS)
    )
    ticks, _ = flight
    assert [t for t, _ in ticks] == pytest.approx(list(0.002 * np.arange(TICKS)))
    for k, (_, truth) in enumerate(ticks):
        np.testing.assert_allclose(truth.inputs[0].u, rows.u[k], atol=1e-4)
        np.testing.assert_allclose(truth.state.payload.p, rows.p[k], atol=1e-7)
        np.testing.assert_allclose(truth.state.agents[0].R, rows.R[k], atol=1e-6)


@pytest.mark.long
def test_simulation_starts_when_all_autopilots_are_armed(flight: tuple[list, list[StandIn]]) -> None:
    _, stand_ins = flight
    for each in stand_ins:
        times = [m.time_usec for m in each.received["HIL_SENSOR"]]
        assert np.diff(times) == pytest.approx(2000)
        assert len(times) >= TICKS + ARM + 1
        assert len(each.received["HIL_STATE_QUATERNION"]) == len(times)
        assert len(each.received["HIL_GPS"]) == -(-len(times) // 50)
        at_rest = each.received["HIL_SENSOR"][: len(times) - TICKS]
        assert len({(m.xacc, m.yacc, m.zacc, m.xgyro, m.abs_pressure) for m in at_rest}) == 1
        assert at_rest[0].zacc == pytest.approx(-9.81, abs=0.01)
        assert {m.fields_updated for m in at_rest} == {0x1BFF}


@pytest.mark.long
def test_lost_autopilot_is_reported(plan: Experiment) -> None:
    with pytest.raises((ConnectionError, OSError)):
        simulate_with_autopilots(plan, quits=20)


def test_sensor_messages_use_px4_frames_and_units() -> None:
    rng = np.random.default_rng(0)
    R = Rotation.random(random_state=rng)
    x, v, a, omega = rng.normal(size=(4, 3)) * [[20], [3], [9], [1]]
    reading = AgentReading(
        R=jnp.array(R.as_matrix()), x=jnp.array(x), v=jnp.array(v), omega=jnp.array(omega), a=jnp.array(a),
        r=jnp.zeros(0), lam=jnp.zeros((1, 3)),
    )  # fmt: skip
    home = px4_frames.DEFAULT_HOME
    sensor, state, gps = px4_hil.sensor_messages(reading, 123, True, home)
    assert {m.time_usec for m in (sensor, state, gps)} == {123}
    np.testing.assert_allclose([sensor.xacc, sensor.yacc, sensor.zacc], a * [1, -1, -1])
    np.testing.assert_allclose([sensor.xgyro, sensor.ygyro, sensor.zgyro], omega * [1, -1, -1])
    to_ned = Rotation.from_quat(np.roll(state.attitude_quaternion, -1))
    forward = R.apply([1, 0, 0])
    np.testing.assert_allclose(to_ned.apply([1, 0, 0]), [forward[1], forward[0], -forward[2]], atol=1e-6)
    north = to_ned.apply([sensor.xmag, sensor.ymag, sensor.zmag])
    np.testing.assert_allclose(north, home.magnetic_field, atol=1e-6)
    np.testing.assert_allclose([state.vx, state.vy, state.vz], 100 * np.array([v[1], v[0], -v[2]]), atol=0.5)
    np.testing.assert_allclose([gps.vn, gps.ve, gps.vd], [state.vx, state.vy, state.vz])
    np.testing.assert_allclose(np.array([state.xacc, state.yacc, state.zacc]) * 9.80665e-3, a * [1, -1, -1], atol=5e-3)
    assert gps.cog == pytest.approx(100 * (np.rad2deg(np.arctan2(v[0], v[1])) % 360), abs=0.5)
    assert gps.alt == pytest.approx(1e3 * (home.altitude + x[2]), abs=0.5)
    for message in (sensor, state, gps):
        message.pack(mavlink.MAVLink(None))


def test_server_binds_to_localhost() -> None:
    with px4_hil.open_servers(2, 0) as servers:
        assert {server.getsockname()[0] for server in servers} == {"127.0.0.1"}
        with (
            pytest.raises(TimeoutError, match=r"no autopilot connected to 127.0.0.1:\d+ within 0.01 s"),
            px4_hil.accept_connections(servers, 0.01),
        ):
            pass


def test_number_of_autopilots_equals_number_of_agents(plan: Experiment) -> None:
    with pytest.raises(ValueError, match="0 autopilots for 3 agents"):
        next(px4_hil.run_lockstep(plan, []))


# Invalid replies ------------------------------------------------------------------------------------------------------


ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def reply(time: int = 2001, signals: tuple[float, ...] = (0.5,) * 4, mode: int = ARMED) -> Any:
    return mavlink.MAVLink_hil_actuator_controls_message(time, [*signals, *[math.nan] * 12], mode, 1)


def test_a_valid_reply_gives_its_rotor_signals() -> None:
    """Channels without a rotor are not used, whatever they contain."""
    np.testing.assert_array_equal(px4_hil.rotor_signals(reply(), 0, 2001, 4001, 4), [0.5] * 4)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (reply(mode=0), "autopilot 1 disarmed at 2001 us"),
        (reply(time=4001), "autopilot 1 replied for 4001 us to the sensor data of 2001 us"),
        (reply(signals=(0.5, math.nan, 0.5, 0.5)), "autopilot 1 sent rotor signals that are not finite"),
        (reply(signals=(0.5, 0.5, 0.5, math.inf)), "autopilot 1 sent rotor signals that are not finite"),
    ],
)
def test_an_invalid_reply_is_refused_with_the_reason(message: Any, reason: str) -> None:
    with pytest.raises(px4_hil.AutopilotError, match=reason):
        px4_hil.rotor_signals(message, 1, 2001, 4001, 4)


@contextlib.contextmanager
def connected() -> Iterator[tuple[px4_hil.AutopilotConnection, socket.socket]]:
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        autopilot = stack.enter_context(socket.create_connection(server.getsockname()))
        yield px4_hil.AutopilotConnection(stack.enter_context(server.accept()[0])), autopilot


def test_the_waiting_time_is_limited_in_total() -> None:
    """An autopilot that sends single bytes does not extend it."""
    with connected() as (link, autopilot):
        ended = threading.Event()

        def send_bytes() -> None:
            while not ended.wait(0.02):
                autopilot.sendall(b"\xfd")

        sender = threading.Thread(target=send_bytes)
        sender.start()
        began = time.monotonic()
        with pytest.raises(TimeoutError, match=r"has not replied within 0\.2 s"):
            link.receive_actuators(0, 0.2)
        assert time.monotonic() - began < 5
        ended.set()
        sender.join()


def test_random_bytes_before_a_reply_are_skipped() -> None:
    """Bytes of no message, damaged messages and messages of other kinds; the valid reply at the end is found."""
    rng = np.random.default_rng(1)
    valid = reply().pack(mavlink.MAVLink(None))
    for _ in range(200):
        damaged = bytearray(valid)
        damaged[rng.integers(len(damaged))] ^= 1 << int(rng.integers(8))
        other = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(mavlink.MAVLink(None))
        noise = rng.bytes(int(rng.integers(40))).replace(b"\xfd", b"").replace(b"\xfe", b"")
        with connected() as (link, autopilot):
            autopilot.sendall(noise + bytes(damaged) + other + valid + valid)
            assert link.receive_actuators(2001, 10.0).time_usec >= 2001
