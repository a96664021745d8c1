"""Hardware-in-the-loop simulation of a team with PX4 autopilots in lockstep, over TCP on this computer (extra `px4`).

The simulator is a server; each autopilot connects to its own port. In each control period the simulator sends
`HIL_SENSOR`, whose time stamp is the clock of the autopilot. The simulation continues when all autopilots have replied
with `HIL_ACTUATOR_CONTROLS`. The team is held at rest until all autopilots have replied once and are armed. The rotor
signals of the replies determine thrust and body torque; the controller of colift controls the joints. The module was
tested with simulated autopilots only.
"""

from __future__ import annotations

import contextlib
import io
import math
import socket
from collections.abc import Callable, Generator, Iterator, Sequence
from time import monotonic
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from colift.closed_loop import flight, simulator
from colift.integrations import px4_frames
from colift.math import so3
from colift.models.measurement import AgentReading, Measurement
from colift.models.state import AgentInput, ControlClock, State, TeamInputs
from colift.runtime import extras
from colift.simulation.world import GroundTruth

try:
    from pymavlink.dialects.v20 import common as mavlink
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"pymavlink is not installed: {extras.install_command('px4')}", name="pymavlink"
    ) from error

HOST, PORT = "127.0.0.1", 4560  # default of PX4; its instance i connects to PORT + i
RESPONSE_TIMEOUT = 10.0  # s, for a reply in lockstep
ARMING_TIMEOUT = 0.002  # s, for a reply while autopilots start and arm
ALL_FIELDS = 0b1101111111111  # `fields_updated`: all fields except the differential pressure
GPS_PERIOD = 0.1  # s


class AutopilotError(ConnectionError):
    """Reply of an autopilot that cannot be used."""


class AutopilotConnection:
    """MAVLink connection to one autopilot.

    Attributes:
        connection: Socket of the connection.
        mav: MAVLink encoder and decoder.
    """

    def __init__(self, connection: socket.socket) -> None:
        """Set up MAVLink on a connected socket.

        Args:
            connection: Socket.
        """
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.mav = mavlink.MAVLink(io.BytesIO(), srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_ALL)
        self.mav.robust_parsing = True

    def send(self, messages: Sequence[Any]) -> None:
        """Send MAVLink messages in one packet.

        Args:
            messages: MAVLink messages.
        """
        self.connection.settimeout(RESPONSE_TIMEOUT)
        self.connection.sendall(b"".join(message.pack(self.mav) for message in messages))

    def receive_actuators(self, time: int, timeout: float = RESPONSE_TIMEOUT) -> Any:
        """Receive `HIL_ACTUATOR_CONTROLS` for the sensor data of a time or a later time; other messages are ignored.

        Args:
            time: Time of the sensor data [us].
            timeout: Maximum waiting time in total [s].

        Returns:
            The MAVLink message.

        Raises:
            TimeoutError: If no such message arrives in time.
            ConnectionError: If the autopilot has closed the connection.
        """
        deadline = monotonic() + timeout
        while (remaining := deadline - monotonic()) > 0:
            self.connection.settimeout(remaining)
            try:
                received = self.connection.recv(4096)
            except TimeoutError:
                break
            if not received:
                raise ConnectionError("the autopilot has closed the connection")
            for message in self._parse(received):
                if message.get_type() == "HIL_ACTUATOR_CONTROLS" and message.time_usec >= time:
                    return message
        raise TimeoutError(f"the autopilot has not replied within {timeout:g} s")

    def _parse(self, received: bytes) -> Sequence[Any]:
        """Return the MAVLink messages that end in the received bytes; bytes without a valid message are skipped."""
        try:
            return self.mav.parse_buffer(received) or ()
        except mavlink.MAVError:
            return ()


@contextlib.contextmanager
def open_servers(count: int, port: int = PORT) -> Generator[list[socket.socket]]:
    """Open one server per autopilot on consecutive ports of this computer.

    Args:
        count: Number of autopilots.
        port: First port; 0 selects free ports.

    Yields:
        Sockets that accept connections until the end of the `with` block.
    """
    with contextlib.ExitStack() as resources:
        yield [resources.enter_context(socket.create_server((HOST, port + i if port else 0))) for i in range(count)]


@contextlib.contextmanager
def accept_connections(servers: Sequence[socket.socket], timeout: float = 60.0) -> Generator[list[AutopilotConnection]]:
    """Wait until an autopilot has connected to each server.

    Args:
        servers: Servers of `open_servers`.
        timeout: Maximum waiting time for each autopilot [s].

    Yields:
        Connections in the order of the servers; they are closed at the end of the `with` block.

    Raises:
        TimeoutError: If an autopilot does not connect in time.
    """
    with contextlib.ExitStack() as resources:
        links = []
        for server in servers:
            server.settimeout(timeout)
            try:
                links.append(AutopilotConnection(resources.enter_context(server.accept()[0])))
            except TimeoutError:
                port = server.getsockname()[1]
                raise TimeoutError(f"no autopilot connected to {HOST}:{port} within {timeout:g} s") from None
        yield links


class ThrustTorqueSetpoint(NamedTuple):
    """Setpoints of the controller for one vehicle in the format of PX4.

    Attributes:
        thrust: `VehicleThrustSetpoint.xyz`.
        torque: `VehicleTorqueSetpoint.xyz`.
    """

    thrust: np.ndarray
    torque: np.ndarray


def run_lockstep(
    experiment: flight.Experiment,
    links: Sequence[AutopilotConnection],
    send_setpoint: Callable[[int, ThrustTorqueSetpoint], None] = lambda _agent, _setpoint: None,
    airframe: px4_frames.Airframe = px4_frames.QUAD_X,
    home_position: px4_frames.HomePosition = px4_frames.DEFAULT_HOME,
    timeout: float = 60.0,
) -> Iterator[tuple[float, GroundTruth]]:
    """Simulate an experiment in lockstep with one autopilot per vehicle.

    The simulator protocol of PX4 does not transmit setpoints; `send_setpoint` must transmit them. An autopilot without
    reply raises `TimeoutError`; one that closes its connection raises `ConnectionError`. An autopilot that disarms, or
    that replies with a wrong time or with signals that are not finite, raises `AutopilotError`.

    Args:
        experiment: Experiment that defines world, controller, initial state and duration.
        links: Connections to the autopilots in team order.
        send_setpoint: Function of agent index and setpoint, called before the autopilot receives the time of the tick.
        airframe: Rotors of each vehicle.
        home_position: Origin of the world frame on Earth.
        timeout: Maximum time until all autopilots are armed [s].

    Yields:
        Time [s] and true signals at the start of each control period.

    Raises:
        ValueError: If the number of autopilots differs from the number of agents.
        TimeoutError: If not all autopilots are armed in time.

    Example:
        >>> with open_servers(2) as servers, accept_connections(servers) as links:  # doctest: +SKIP
        ...     for t, truth in run_lockstep(experiment, links, send_setpoint):
        ...         print(t)
    """
    team, dt = experiment.world.team, experiment.dt
    if len(links) != sum(team.sizes):
        raise ValueError(f"{len(links)} autopilots for {sum(team.sizes)} agents")
    experiment = experiment.calibrated()
    setup, chunk = experiment.loop_config, flight.ticks_per_chunk(experiment)
    thrust_max = np.concatenate([np.asarray(group.thrust_max) for group in team.agent_groups])
    key, noise = jax.random.fold_in(jax.random.key(experiment.seed), 2), None

    def send(tick: int, command: TeamInputs, readings: Sequence[AgentReading]) -> int:
        """Send setpoints and sensor data to all autopilots; return the time stamp [us]."""
        for j, (u, tau) in enumerate(_thrusts_and_torques(command)):
            send_setpoint(
                j,
                ThrustTorqueSetpoint(
                    px4_frames.thrust_setpoint(u, thrust_max[j]),
                    px4_frames.torque_setpoint(airframe, tau, thrust_max[j]),
                ),
            )
        time = 1 + round(1e6 * (tick + 1) * dt)  # the clock of PX4 must not be 0
        for link, reading in zip(links, readings, strict=True):
            link.send(list(sensor_messages(reading, time, tick % max(1, round(GPS_PERIOD / dt)) == 0, home_position)))
        return time

    readings, state, command, controller_state = _init(setup, experiment.initial_state)
    ticks_at_rest, armed, deadline = 0, [False] * len(links), monotonic() + timeout
    while not all(armed):
        send(ticks_at_rest, command, readings)
        armed = [_is_armed(link) or was_armed for link, was_armed in zip(links, armed, strict=True)]
        ticks_at_rest += 1
        if monotonic() > deadline:
            raise TimeoutError(f"autopilots {_list_unarmed(armed)} are not armed after {timeout:g} s")
    for k in range(round(experiment.duration / dt)):
        if k % chunk == 0:
            noise = _sample_noise(experiment.world, jax.random.fold_in(key, k), chunk)
        clock = ControlClock(t=jnp.asarray(k * dt), dt=jnp.asarray(dt))
        sample = jax.tree.map(lambda x, i=k % chunk: x[i], noise)
        readings, state, command, controller_state = _control(setup, state, controller_state, clock, sample)
        time = send(ticks_at_rest + k, command, readings)
        replies = [
            rotor_signals(link.receive_actuators(time), i, time, time + round(1e6 * dt), len(airframe.x))
            for i, link in enumerate(links)
        ]
        wrenches = [
            px4_frames.rotor_wrench(airframe, controls, float(limit))
            for controls, limit in zip(replies, thrust_max, strict=True)
        ]
        state, truth = _step_world(setup, state, _with_rotor_wrenches(command, wrenches), clock)
        yield k * dt, truth


def _is_armed(link: AutopilotConnection) -> bool:
    """Return whether an autopilot replies and is armed."""
    try:
        return bool(link.receive_actuators(0, ARMING_TIMEOUT).mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    except TimeoutError:
        return False


def rotor_signals(message: Any, autopilot: int, time: int, end: int, count: int) -> np.ndarray:
    """Return the rotor signals of a reply, checked.

    Args:
        message: `HIL_ACTUATOR_CONTROLS`.
        autopilot: Index of the autopilot, for the error message.
        time: Time of the sensor data [us].
        end: Time of the next sensor data [us].
        count: Number of rotors.

    Returns:
        Signals of the rotors.

    Raises:
        AutopilotError: If the autopilot is disarmed, if the message is from the future, or if signals are not finite.
    """
    if not message.mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED:
        raise AutopilotError(f"autopilot {autopilot} disarmed at {time} us")
    if message.time_usec >= end:
        raise AutopilotError(
            f"autopilot {autopilot} replied for {message.time_usec} us to the sensor data of {time} us"
        )
    signals = np.asarray(message.controls[:count], float)
    if not np.isfinite(signals).all():
        raise AutopilotError(f"autopilot {autopilot} sent rotor signals that are not finite: {signals.tolist()}")
    return signals


def _list_unarmed(armed: Sequence[bool]) -> str:
    """Return the indices of the autopilots that are not armed, as text."""
    return ", ".join(str(i) for i, is_armed in enumerate(armed) if not is_armed)


@jax.jit
def _init(setup: simulator.LoopConfig, state: State) -> tuple[list[AgentReading], Any, TeamInputs, Any]:
    """Return measurements at rest, state of the world, hover command and state of the controller."""
    m = setup.world.measure_at_rest(state)
    command, controller_state = setup.controller.init(m, ControlClock(t=jnp.zeros(()), dt=setup.dt))
    return _agent_readings(m), setup.world.init(state, command), command, controller_state


_sample_noise = jax.jit(lambda world, key, ticks: world.sample_noise(key, ticks), static_argnums=2)


@jax.jit
def _control(
    setup: simulator.LoopConfig, state: Any, controller_state: Any, clock: ControlClock, noise: Any
) -> tuple[list[AgentReading], Any, TeamInputs, Any]:
    """Measure and compute the command; return measurements, both states and the command."""
    m, state = setup.world.measure(state, clock, noise)
    command, controller_state, _ = setup.controller.step(controller_state, m, clock)
    return _agent_readings(m), state, command, controller_state


def _agent_readings(measurement: Measurement) -> list[AgentReading]:
    """Return the measurements of the agents in team order."""
    return [jax.tree.map(lambda x, j=j: x[j], group) for group in measurement.agents for j in range(len(group.x))]


@jax.jit
def _step_world(
    setup: simulator.LoopConfig, state: Any, command: TeamInputs, clock: ControlClock
) -> tuple[Any, GroundTruth]:
    """Advance the world by one control period."""
    return setup.world.step(state, command, clock)


def _thrusts_and_torques(command: TeamInputs) -> list[tuple[float, np.ndarray]]:
    """Return thrust [N] and torque [N m, body frame] of each agent."""
    return [
        (float(u), np.asarray(tau)) for group in command for u, tau in zip(group.u, np.asarray(group.tau), strict=True)
    ]


def _with_rotor_wrenches(command: TeamInputs, wrenches: Sequence[tuple[float, np.ndarray]]) -> TeamInputs:
    """Replace thrust and torque of each agent by those of its rotors."""
    remaining = iter(wrenches)
    groups = []
    for group in command:
        u, tau = zip(*(next(remaining) for _ in range(len(group.u))), strict=True)
        groups.append(AgentInput(u=jnp.asarray(u), tau=jnp.asarray(np.stack(tau)), tau_r=group.tau_r))
    return tuple(groups)


def sensor_messages(
    reading: AgentReading, time: int, gps: bool, home_position: px4_frames.HomePosition
) -> Iterator[Any]:
    """Generate the MAVLink messages for an autopilot.

    PX4 logs `HIL_STATE_QUATERNION` as the true state; here it contains the measured state. Accelerations are specific
    forces, as in PX4. Barometer and magnetometer have no noise.

    Args:
        reading: Measurement of the agent.
        time: Time stamp [us].
        gps: True if a GPS message is included.
        home_position: Origin of the world frame on Earth.

    Yields:
        MAVLink messages.
    """
    R, p = np.asarray(reading.R), np.asarray(reading.x)
    q = np.asarray(so3.quaternion(jnp.asarray(px4_frames.attitude_enu_ned(R))))
    a, omega, v = (
        px4_frames.flu_frd(np.asarray(reading.a)),
        px4_frames.flu_frd(np.asarray(reading.omega)),
        px4_frames.enu_ned(np.asarray(reading.v)),
    )
    field = px4_frames.attitude_enu_ned(R).T @ np.array(home_position.magnetic_field)
    latitude, longitude, height = (int(x) for x in px4_frames.geodetic(home_position, p))
    altitude = home_position.altitude + float(p[2])
    hPa = px4_frames.pressure(altitude)
    yield mavlink.MAVLink_hil_sensor_message(
        time, *a, *omega, *field, hPa, 0.0, altitude, 20.0, fields_updated=ALL_FIELDS, id=0
    )
    yield mavlink.MAVLink_hil_state_quaternion_message(
        time, q.tolist(), *omega, latitude, longitude, height, *_int16(100 * v), 0, 0, *_int16(1000 * a / GRAVITY)
    )
    if gps:
        ground_speed = math.hypot(v[0], v[1])
        course = round(100 * math.degrees(math.atan2(v[1], v[0]))) % 36000
        yield mavlink.MAVLink_hil_gps_message(
            time, 3, latitude, longitude, height, 30, 40, round(100 * ground_speed), *_int16(100 * v), course, 12
        )


GRAVITY = 9.80665  # m/s^2, conversion of m/s^2 to mG


def _int16(values: np.ndarray) -> list[int]:
    """Round and clip numbers to 16-bit integers."""
    return [int(x) for x in np.clip(np.rint(values), -(2**15), 2**15 - 1)]
