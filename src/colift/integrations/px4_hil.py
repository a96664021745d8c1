"""A team in the loop with autopilots: PX4's simulator protocol in lockstep, over TCP on this computer (extra `px4`).

We are the simulator, and so the server; each autopilot is a client of its own port. At every tick each is sent
`HIL_SENSOR`, whose time is its clock, and answers with `HIL_ACTUATOR_CONTROLS`; the world stands still until all have.
Before, it is held at rest until all have answered once and are armed: an autopilot that boots answers nothing. Thrust
and body torque are what the rotors make of the answers; joints stay with our pilot. Not flown on PX4.
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
from colift.simulation.world import GroundTruth

try:
    from pymavlink.dialects.v20 import common as mavlink
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("pymavlink is not installed: pip install 'colift[px4]'", name="pymavlink") from error

HOST, PORT = "127.0.0.1", 4560  # PX4's; instance i of it asks at PORT + i
RESPONSE_TIMEOUT = 10.0  # s, for an answer in lockstep
ARMING_TIMEOUT = 0.002  # s, for an answer while autopilots boot and arm
ALL = 0b1101111111111  # of `fields_updated`: all but the differential pressure
GPS_EVERY = 0.1  # s


class AutopilotConnection:
    """One autopilot, on one connection."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.mav = mavlink.MAVLink(io.BytesIO(), srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_ALL)
        self.mav.robust_parsing = True

    def send(self, messages: Sequence[Any]) -> None:
        """Send messages, in one piece."""
        self.connection.settimeout(RESPONSE_TIMEOUT)
        self.connection.sendall(b"".join(message.pack(self.mav) for message in messages))

    def receive_actuators(self, time: int, timeout: float = RESPONSE_TIMEOUT) -> Any:
        """`HIL_ACTUATOR_CONTROLS` of a time, us, or later: older ones are of sensors that were not waited for.

        Raises TimeoutError where there is none within `patience`, s, ConnectionError where the autopilot has gone.
        """
        self.connection.settimeout(timeout)
        while True:
            received = self.connection.recv(4096)
            if not received:
                raise ConnectionError("the autopilot has closed the connection")
            found: Any = self.mav.parse_buffer(received) or ()
            for message in found:
                if message.get_type() == "HIL_ACTUATOR_CONTROLS" and message.time_usec >= time:
                    return message


@contextlib.contextmanager
def open_servers(count: int, port: int = PORT) -> Generator[list[socket.socket]]:
    """Servers for so many autopilots, on `port` and the next ones of this computer; port 0: any that are free."""
    with contextlib.ExitStack() as held:
        yield [held.enter_context(socket.create_server((HOST, port + i if port else 0))) for i in range(count)]


@contextlib.contextmanager
def accept_connections(servers: Sequence[socket.socket], timeout: float = 60.0) -> Generator[list[AutopilotConnection]]:
    """The autopilots, in the order of the servers; raises TimeoutError where one does not come."""
    with contextlib.ExitStack() as held:
        links = []
        for server in servers:
            server.settimeout(timeout)
            try:
                links.append(AutopilotConnection(held.enter_context(server.accept()[0])))
            except TimeoutError:
                port = server.getsockname()[1]
                raise TimeoutError(f"no autopilot has come to {HOST}:{port} in {timeout:g} s") from None
        yield links


class ThrustTorqueSetpoint(NamedTuple):
    """What our pilot asks of one vehicle, as PX4 takes it."""

    thrust: np.ndarray  # `VehicleThrustSetpoint.xyz`
    torque: np.ndarray  # `VehicleTorqueSetpoint.xyz`


def run_lockstep(
    experiment: flight.Experiment,
    links: Sequence[AutopilotConnection],
    ask: Callable[[int, ThrustTorqueSetpoint], None] = lambda _agent, _setpoint: None,
    frame: px4_frames.Airframe = px4_frames.QUAD_X,
    home: px4_frames.HomePosition = px4_frames.HOME,
    timeout: float = 60.0,
) -> Iterator[tuple[float, GroundTruth]]:
    """Fly a plan's world and pilot with an autopilot a vehicle; yields time, s, and truth at the start of every tick.

    `ask` is told what the pilot wants of each, in team order, before its autopilot hears the time: how it comes there
    is not part of the simulator's protocol. Raises ValueError for another number of autopilots than agents,
    TimeoutError where they are not all armed after `patience`, s, or one is silent later, ConnectionError where one has
    gone.
    """
    team, dt = experiment.world.team, experiment.dt
    if len(links) != sum(team.sizes):
        raise ValueError(f"{len(links)} autopilots for {sum(team.sizes)} agents")
    setup, room = experiment.loop_config, flight.ticks_per_chunk(experiment)
    most = np.concatenate([np.asarray(group.thrust_max) for group in team.agent_groups])
    key, noise = jax.random.fold_in(jax.random.key(experiment.seed), 2), None

    def turn(tick: int, command: TeamInputs, readings: Sequence[AgentReading]) -> int:
        """Tell all autopilots what is wanted and what is measured; the time, us."""
        for j, (u, tau) in enumerate(_wanted(command)):
            ask(
                j,
                ThrustTorqueSetpoint(
                    px4_frames.thrust_setpoint(u, most[j]), px4_frames.torque_setpoint(frame, tau, most[j])
                ),
            )
        time = 1 + round(1e6 * (tick + 1) * dt)  # PX4's clock must not stand at 0
        for link, reading in zip(links, readings, strict=True):
            link.send(list(sensor_messages(reading, time, tick % max(1, round(GPS_EVERY / dt)) == 0, home)))
        return time

    readings, state, command, controller_state = _begin(setup, experiment.initial_state)
    waited, awake, until = 0, [False] * len(links), monotonic() + timeout
    while not all(awake):
        turn(waited, command, readings)
        awake = [_armed(link) or was for link, was in zip(links, awake, strict=True)]
        waited += 1
        if monotonic() > until:
            raise TimeoutError(f"autopilots {_list(awake)} are not armed after {timeout:g} s")
    for k in range(round(experiment.duration / dt)):
        if k % room == 0:
            noise = _drawn(experiment.world, jax.random.fold_in(key, k), room)
        clock = ControlClock(t=jnp.asarray(k * dt), dt=jnp.asarray(dt))
        drawn = jax.tree.map(lambda x, i=k % room: x[i], noise)
        readings, state, command, controller_state = _decide(setup, state, controller_state, clock, drawn)
        time = turn(waited + k, command, readings)
        answers = [np.asarray(link.receive_actuators(time).controls[: len(frame.x)], float) for link in links]
        made = [px4_frames.rotor_wrench(frame, each, float(thrust)) for each, thrust in zip(answers, most, strict=True)]
        state, truth = _move(setup, state, _replaced(command, made), clock)
        yield k * dt, truth


def _armed(link: AutopilotConnection) -> bool:
    """Whether an autopilot answers, to whatever it was sent, and is armed."""
    try:
        return bool(link.receive_actuators(0, ARMING_TIMEOUT).mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    except TimeoutError:
        return False


def _list(awake: Sequence[bool]) -> str:
    return ", ".join(str(i) for i, armed in enumerate(awake) if not armed)


@jax.jit
def _begin(setup: simulator.LoopConfig, state: State) -> tuple[list[AgentReading], Any, TeamInputs, Any]:
    """What a team at rest reads, the world there, the command that holds it, and our pilot's memory."""
    m = setup.world.measure_at_rest(state)
    command, controller_state = setup.controller.init(m, ControlClock(t=jnp.zeros(()), dt=setup.dt))
    return _each(m), setup.world.init(state, command), command, controller_state


_drawn = jax.jit(lambda world, key, ticks: world.sample_noise(key, ticks), static_argnums=2)


@jax.jit
def _decide(
    setup: simulator.LoopConfig, state: Any, controller_state: Any, clock: ControlClock, noise: Any
) -> tuple[list[AgentReading], Any, TeamInputs, Any]:
    """What each agent's sensors say, the world after they did, and what our pilot makes of it."""
    m, state = setup.world.measure(state, clock, noise)
    command, controller_state, _ = setup.controller.step(controller_state, m, clock)
    return _each(m), state, command, controller_state


def _each(measurement: Measurement) -> list[AgentReading]:
    """Readings in team order."""
    return [jax.tree.map(lambda x, j=j: x[j], group) for group in measurement.agents for j in range(len(group.x))]


@jax.jit
def _move(setup: simulator.LoopConfig, state: Any, command: TeamInputs, clock: ControlClock) -> tuple[Any, GroundTruth]:
    return setup.world.step(state, command, clock)


def _wanted(command: TeamInputs) -> list[tuple[float, np.ndarray]]:
    """Thrust, N, and torque, N m, body frame, of each agent."""
    return [
        (float(u), np.asarray(tau)) for group in command for u, tau in zip(group.u, np.asarray(group.tau), strict=True)
    ]


def _replaced(command: TeamInputs, made: Sequence[tuple[float, np.ndarray]]) -> TeamInputs:
    """The command with each agent's thrust and torque as they are made."""
    left = iter(made)
    groups = []
    for group in command:
        u, tau = zip(*(next(left) for _ in range(len(group.u))), strict=True)
        groups.append(AgentInput(u=jnp.asarray(u), tau=jnp.asarray(np.stack(tau)), tau_r=group.tau_r))
    return tuple(groups)


def sensor_messages(reading: AgentReading, time: int, gps: bool, home: px4_frames.HomePosition) -> Iterator[Any]:
    """What an autopilot is sent at a time, us: its sensors, its state as measured and, where asked, its GPS.

    `HIL_STATE_QUATERNION` is what PX4 logs as the truth; here it is the measured state, for nothing else is known of
    the truth on this side. Accelerations are specific forces, as PX4's are; barometer and magnetometer without noise.
    """
    R, p = np.asarray(reading.R), np.asarray(reading.x)
    q = np.asarray(so3.quaternion(jnp.asarray(px4_frames.attitude_enu_ned(R))))
    a, omega, v = (
        px4_frames.flu_frd(np.asarray(reading.a)),
        px4_frames.flu_frd(np.asarray(reading.omega)),
        px4_frames.enu_ned(np.asarray(reading.v)),
    )
    field = px4_frames.attitude_enu_ned(R).T @ np.array(home.field)
    latitude, longitude, height = (int(x) for x in px4_frames.geodetic(home, p))
    altitude = home.altitude + float(p[2])
    hPa = px4_frames.pressure(altitude)
    yield mavlink.MAVLink_hil_sensor_message(
        time, *a, *omega, *field, hPa, 0.0, altitude, 20.0, fields_updated=ALL, id=0
    )
    yield mavlink.MAVLink_hil_state_quaternion_message(
        time, q.tolist(), *omega, latitude, longitude, height, *_short(100 * v), 0, 0, *_short(1000 * a / GRAVITY)
    )
    if gps:
        ground = math.hypot(v[0], v[1])
        course = round(100 * math.degrees(math.atan2(v[1], v[0]))) % 36000
        yield mavlink.MAVLink_hil_gps_message(
            time, 3, latitude, longitude, height, 30, 40, round(100 * ground), *_short(100 * v), course, 12
        )


GRAVITY = 9.80665  # m/s^2, of a mG


def _short(values: np.ndarray) -> list[int]:
    """Numbers as MAVLink's 16-bit integers."""
    return [int(x) for x in np.clip(np.rint(values), -(2**15), 2**15 - 1)]
