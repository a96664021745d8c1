"""Sensor models: noise, bias, bandwidth, delay and dropout of the measurements.

The `Measurement` is the only information about the true state that the onboard controller receives. The noise is drawn
in advance from a key, so that runs with different controllers have identical noise.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift.math import so3
from colift.math.pytree import pytree, static
from colift.models import aerial_manipulator
from colift.models.measurement import AgentReading, Measurement, PayloadReading, RigReading
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentState, ControlClock, ResidualForces, State, zero_residual

Scalar = Float[Array, ""]


@pytree
class SensorNoise:
    """Standard deviations of the white noise of each reading, and bias and bandwidth of the tip force sensors."""

    position: Scalar  # m
    attitude: Scalar  # rad
    velocity: Scalar  # m/s
    angular_velocity: Scalar  # rad/s
    accelerometer: Scalar  # m/s^2
    joint_position: Scalar  # rad or m
    tip_force: Scalar  # N
    tip_moment: Scalar  # N m, of contacts that bear moments
    tip_force_bias: Scalar  # N, standard deviation of the constant bias
    tip_force_bandwidth: Scalar  # Hz, first-order low-pass filter


@pytree
class AgentNoise:
    """Standard normal samples for the sensors of a group at one tick."""

    theta: Float[Array, "*time agents 3"]  # attitude, as a rotation vector
    x: Float[Array, "*time agents 3"]  # position
    v: Float[Array, "*time agents 3"]  # velocity
    omega: Float[Array, "*time agents 3"]  # angular velocity
    a: Float[Array, "*time agents 3"]  # accelerometer
    r: Float[Array, "*time agents n_r"]  # joint positions
    lam: Float[Array, "*time agents arms 3"]  # tip forces
    moment: Float[Array, "*time agents arms 3"] | None = None  # tip moments; None for point contacts


@pytree
class PayloadNoise:
    """Standard normal samples for the payload's sensors at one tick."""

    theta: Float[Array, "*time 3"]  # attitude, as a rotation vector
    p: Float[Array, "*time 3"]  # position
    v: Float[Array, "*time 3"]  # velocity
    omega: Float[Array, "*time 3"]  # angular velocity
    a: Float[Array, "*time 3"]  # accelerometer


@pytree
class Noise:
    """Standard normal samples for one tick, or for many with a leading time axis."""

    agents: tuple[AgentNoise, ...]  # one per group
    payload: PayloadNoise  # noise of the payload's sensors


def sample_noise(team: Team, key: Array, ticks: int) -> Noise:
    """Draw the sensor noise of several ticks from one random key.

    Args:
        team: Parameters that determine the shapes.
        key: JAX random key.
        ticks: Number of ticks.

    Returns:
        Standard normal samples with a leading time axis.
    """

    def normal(key: Array, shapes: dict[str, tuple[int, ...]]) -> dict[str, Array]:
        keys = jax.random.split(key, len(shapes))
        return {
            name: jax.random.normal(k, (ticks, *shape)) for k, (name, shape) in zip(keys, shapes.items(), strict=True)
        }

    keys = jax.random.split(key, 1 + len(team.agent_groups))
    agents = []
    for size, group, k in zip(team.sizes, team.agent_groups, keys[1:], strict=True):
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("theta", "x", "v", "omega", "a"), (size, 3))
        shapes |= {"r": (size, group.tree.joints), "lam": (size, group.tree.arms, 3)}
        noise = AgentNoise(**normal(k, shapes))
        if group.moment_axis is not None:
            moment = jax.random.normal(jax.random.fold_in(k, 1), (ticks, size, group.tree.arms, 3))
            noise = dataclasses.replace(noise, moment=moment)
        agents.append(noise)
    payload: dict[str, tuple[int, ...]] = dict.fromkeys(("theta", "p", "v", "omega", "a"), (3,))
    return Noise(agents=tuple(agents), payload=PayloadNoise(**normal(keys[0], payload)))


def sample_tip_bias(team: Team, sensors: SensorNoise, key: Array) -> tuple[Float[Array, "agents arms 3"], ...]:
    """Draw the constant bias of every tip force sensor for one run.

    Args:
        team: Parameters that determine the shapes.
        sensors: Standard deviations of the sensors.
        key: JAX random key.

    Returns:
        The bias of every sensor axis [N, tip frame], by group.
    """
    keys = jax.random.split(key, len(team.agent_groups))
    return tuple(
        sensors.tip_force_bias * jax.random.normal(k, (size, group.tree.arms, 3))
        for k, size, group in zip(keys, team.sizes, team.agent_groups, strict=True)
    )


@pytree
class SensedState:
    """True quantities that the sensors measure at one instant."""

    z: State  # state of the team
    v_dot: tuple[Float[Array, "agents 3"], ...]  # m/s^2, centers of mass, world
    xi_dot: tuple[Float[Array, "agents xi"], ...]  # rad/s^2 (prismatic joints: m/s^2), (omega_dot, r_ddot)
    a_L: Float[Array, "6"]  # m/s^2 and rad/s^2, (v_dot in the world, omega_dot in the payload frame)
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, contact forces behind the low-pass filter of the sensors, world
    f: ResidualForces  # unmodelled forces
    moments: tuple[Float[Array, "_agents _arms 3"], ...] | None = None  # N m, contact moments behind the same filter,
    # payload frame; None if all contacts are points


def measure(
    team: Team,
    sensors: SensorNoise,
    lam_bias: tuple[Float[Array, "agents arms 3"], ...],
    truth: SensedState,
    noise: Noise,
) -> Measurement:
    """Compute the measurement of one tick from true quantities.

    Args:
        team: True parameters.
        sensors: Standard deviations of the sensor noise.
        lam_bias: Bias of the tip force sensors [N, tip frame], by group.
        truth: True quantities at this tick.
        noise: Standard normal samples of this tick.

    Returns:
        Readings of all agents and of the payload.
    """
    q = truth.z.payload
    n = noise.payload
    readings = Measurement(
        agents=tuple(
            jax.vmap(_sense_agent, in_axes=(0, None, 0, 0, 0, 0, 0, 0, None))(
                group, sensors, state, v_dot, xi_dot, lam, bias, agent_noise, team.gravity
            )
            for group, state, v_dot, xi_dot, lam, bias, agent_noise in zip(
                team.agent_groups,
                truth.z.agents,
                truth.v_dot,
                truth.xi_dot,
                truth.lam,
                lam_bias,
                noise.agents,
                strict=True,
            )
        ),
        payload=PayloadReading(
            R=q.R @ so3.exp(sensors.attitude * n.theta),
            p=q.p + sensors.position * n.p,
            v=q.v + sensors.velocity * n.v,
            omega=q.omega + sensors.angular_velocity * n.omega,
            a=q.R.T @ (truth.a_L[:3] - team.gravity) + sensors.accelerometer * n.a,
        ),
    )
    return readings if truth.moments is None else _with_moments(readings, team, sensors, truth, noise)


def _with_moments(
    readings: Measurement, team: Team, sensors: SensorNoise, truth: SensedState, noise: Noise
) -> Measurement:
    """Add the readings of tip moments to the agents whose contacts bear moments."""

    def in_tip(
        agent: AerialManipulator, q: AgentState, m: Float[Array, "arms 3"], n: Float[Array, "arms 3"] | None
    ) -> Float[Array, "arms 3"]:
        assert n is not None  # for the type checker: contacts that bear moments have noise
        g = aerial_manipulator.forward_kinematics(agent, q.r)
        tip = g.rotation[jnp.array(agent.tree.tip_bodies)]
        return jnp.einsum("bji,bj->bi", tip, m @ (truth.z.payload.R.T @ q.R)) + sensors.tip_moment * n

    assert truth.moments is not None  # for the type checker
    agents = [
        reading
        if group.moment_axis is None
        else dataclasses.replace(reading, moment=jax.vmap(in_tip)(group, q, m, n.moment))
        for reading, group, q, m, n in zip(
            readings.agents, team.agent_groups, truth.z.agents, truth.moments, noise.agents, strict=True
        )
    ]
    return dataclasses.replace(readings, agents=tuple(agents))


class SensorModel:
    """Base class of additional sensors: adds readings to a measurement or modifies existing ones.

    A custom sensor is a `pytree` that extends this class. It stores its readings in `Measurement.extra` under its
    name. A sensor without noise or state overrides `apply` alone.
    """

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: Any
    ) -> tuple[Measurement, Any]:
        """Add or modify readings.

        Args:
            measurement: Measurement of the sensors before this one.
            truth: True quantities at this tick.
            clock: Time and period [s].
            state: State of this sensor.
            noise: Noise of this tick, as `sample_noise` draws it.

        Returns:
            The new measurement and the next state.

        Raises:
            NotImplementedError: In the base class.
        """
        raise NotImplementedError

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Any:
        """Draw the noise of several ticks from one random key, with time as the leading axis."""
        return ()

    def init(self, measurement: Measurement) -> Any:
        """Return the initial state, given the measurement at rest."""
        return ()


@pytree
class CalibrationRig(SensorModel):
    """Calibration rig: measures the true state and the residual with a bounded label error of random sign."""

    label_error: ResidualForces  # absolute error of every label

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: ResidualForces
    ) -> tuple[Measurement, Any]:
        """Set `Measurement.rig`."""
        f = jax.tree.map(lambda f, e, sign: f + e * sign, truth.f, self.label_error, noise)
        return dataclasses.replace(measurement, rig=RigReading(state=truth.z, residual=f)), state

    def sample_noise(self, team: Team, key: Array, ticks: int) -> ResidualForces:
        """Draw the signs of the label errors, 1 or -1."""
        leaves, kind = jax.tree.flatten(zero_residual(team))
        signs = [
            jax.random.rademacher(jax.random.fold_in(key, k), (ticks, *leaf.shape), leaf.dtype)
            for k, leaf in enumerate(leaves)
        ]
        return jax.tree.unflatten(kind, signs)


@pytree
class IntermittentState:
    """State of `Intermittent`."""

    last_reading: dict[str, Any]  # most recent readings, by channel
    age: Scalar  # s, age of the most recent readings
    next_sample_time: Scalar  # s, time of the next sample
    delay_line: tuple[tuple[dict[str, Any], Bool[Array, ""]], ...]  # pending readings and validity, oldest first


@pytree
class Intermittent(SensorModel):
    """Sensor with its own sample rate, a delay and random dropouts; the last reading is held between samples.

    A reading is sampled when `sample_period` has passed since the previous one. It is lost with probability
    `dropout_probability` and arrives `delay` ticks later. No reading is sampled after `failure_time`.
    `Measurement.measurement_age_s` contains the age of the held readings.
    """

    channels: tuple[str, ...] = (
        static()
    )  # fields of the payload and agent readings, for example `payload.p`, `agents.x`
    sample_period: Scalar  # s
    dropout_probability: Scalar  # in [0, 1]
    failure_time: Scalar  # s
    delay: int = static(default=0)  # ticks

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Float[Array, "time"]:
        """Draw uniform numbers; a value below `dropout_probability` discards the reading."""
        return jax.random.uniform(key, (ticks,))

    def init(self, measurement: Measurement) -> Any:
        """Return a state with an empty delay line and the readings at rest."""
        none = select_channels(measurement, self.channels), jnp.array(False)
        return IntermittentState(
            last_reading=select_channels(measurement, self.channels),
            age=jnp.zeros(()),
            next_sample_time=jnp.zeros(()),
            delay_line=(none,) * self.delay,
        )

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: IntermittentState, noise: Any
    ) -> tuple[Measurement, Any]:
        """Replace the readings of the channels by the held ones."""
        next_sample_time = state.next_sample_time
        sampled = (clock.t >= next_sample_time - 1e-9) & (clock.t < self.failure_time - 1e-9)
        (reading, is_new), *pending = (
            *state.delay_line,
            (select_channels(measurement, self.channels), sampled & (noise >= self.dropout_probability)),
        )
        held = jax.tree.map(lambda new, old: jnp.where(is_new, new, old), reading, state.last_reading)
        age = jnp.where(is_new, self.delay * clock.dt, state.age + clock.dt)
        next_sample_time = jnp.where(sampled, next_sample_time + self.sample_period, next_sample_time)
        ages = measurement.measurement_age_s | dict.fromkeys(self.channels, age)
        next_state = IntermittentState(
            last_reading=held, age=age, next_sample_time=next_sample_time, delay_line=tuple(pending)
        )
        return dataclasses.replace(
            replace_channels(measurement, self.channels, held), measurement_age_s=ages
        ), next_state


@pytree
class Unavailable(SensorModel):
    """Sensors that do not exist: their readings are NaN, so that a result that depends on them is not finite."""

    channels: tuple[str, ...] = static()  # as for `Intermittent`

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: Any
    ) -> tuple[Measurement, Any]:
        """Replace the readings of the channels by NaN."""
        readings = jax.tree.map(lambda x: jnp.full_like(x, jnp.nan), select_channels(measurement, self.channels))
        return replace_channels(measurement, self.channels, readings), state


@pytree
class BiasWalkState:
    """State of `BiasRandomWalk`."""

    bias: dict[str, Any]  # bias of every channel, in its unit; a rotation vector [rad] for attitudes


@pytree
class BiasRandomWalk(SensorModel):
    """Sensor bias as a random walk: `b_0 = initial_bias_std n_0`, `b+ = b + random_walk_density sqrt(dt) n`.

    The samples n are standard normal; n_0 is the sample of the first tick.
    """

    channels: tuple[str, ...] = (
        static()
    )  # as for `Intermittent`; the bias of an attitude is a rotation in the body frame
    random_walk_density: Scalar  # unit of the reading (attitude: rad) per square root of a second
    initial_bias_std: Scalar  # unit of the reading (attitude: rad)

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Any:
        """Draw standard normal samples in the shapes of the readings."""
        return sample_channel_noise(team, self.channels, key, ticks)

    def init(self, measurement: Measurement) -> Any:
        """Return a state without bias."""
        return BiasWalkState(
            bias={
                name: jax.tree.map(functools.partial(_zero_bias, name), x)
                for name, x in select_channels(measurement, self.channels).items()
            }
        )

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: BiasWalkState, noise: Any
    ) -> tuple[Measurement, Any]:
        """Add the bias to the readings of the channels."""
        step = jnp.where(clock.t > 0, self.random_walk_density * jnp.sqrt(clock.dt), self.initial_bias_std)
        bias = jax.tree.map(lambda b, n: b + step * n, state.bias, noise)
        readings = select_channels(measurement, self.channels)
        biased = {
            name: jax.tree.map(functools.partial(add_bias, name), readings[name], bias[name]) for name in self.channels
        }
        return replace_channels(measurement, self.channels, biased), BiasWalkState(bias=bias)


def sample_channel_noise(team: Team, channels: tuple[str, ...], key: Array, ticks: int) -> dict[str, Any]:
    """Draw standard normal samples for readings; those of attitudes are rotation vectors.

    Args:
        team: Parameters that determine the shapes.
        channels: Names of the readings, as for `Intermittent`.
        key: JAX random key.
        ticks: Number of ticks.

    Returns:
        Samples by channel with a leading time axis: an array of the payload, or one array per group of agents.
    """
    sizes, payload = _noise_shapes(team), {"R": 3, "p": 3, "v": 3, "omega": 3, "a": 3}
    out = {}
    for k, name in enumerate(channels):
        body, _, field = name.partition(".")
        keys = jax.random.split(jax.random.fold_in(key, k), len(sizes))
        shapes = [(payload[field],)] if body == "payload" else [size[field] for size in sizes]
        samples = [
            jax.random.normal(group_key, (ticks, *shape)) for group_key, shape in zip(keys, shapes, strict=False)
        ]
        out[name] = samples[0] if body == "payload" else tuple(samples)
    return out


def _zero_bias(name: str, x: Array) -> Array:
    """Return zeros in the shape of a reading's bias; a rotation vector for attitudes."""
    return jnp.zeros(x.shape[:-1] if name.endswith(".R") else x.shape)


def add_bias(name: str, x: Array, b: Array) -> Array:
    """Add the bias to a reading; rotate an attitude in the body frame."""
    return x @ so3.exp(b) if name.endswith(".R") else x + b


def _noise_shapes(team: Team) -> list[dict[str, tuple[int, ...]]]:
    """Return the noise shape of each field of the agents' readings, by group; attitudes have rotation vectors."""
    return [
        dict.fromkeys(("R", "x", "v", "omega", "a"), (size, 3))
        | {"r": (size, group.tree.joints), "lam": (size, group.tree.arms, 3)}
        for size, group in zip(team.sizes, team.agent_groups, strict=True)
    ]


def select_channels(measurement: Measurement, names: tuple[str, ...]) -> dict[str, Any]:
    """Return readings by channel: an array of the payload, or one array per group of agents."""
    out = {}
    for name in names:
        body, _, field = name.partition(".")
        out[name] = (
            getattr(measurement.payload, field)
            if body == "payload"
            else tuple(getattr(a, field) for a in measurement.agents)
        )
    return out


def replace_channels(measurement: Measurement, names: tuple[str, ...], values: dict[str, Any]) -> Measurement:
    """Return the measurement with the readings of these channels replaced."""
    for name in names:
        body, _, field = name.partition(".")
        if body == "payload":
            measurement = dataclasses.replace(
                measurement, payload=dataclasses.replace(measurement.payload, **{field: values[name]})
            )
        else:
            agents = [
                dataclasses.replace(a, **{field: x}) for a, x in zip(measurement.agents, values[name], strict=True)
            ]
            measurement = dataclasses.replace(measurement, agents=tuple(agents))
    return measurement


def _sense_agent(
    agent: AerialManipulator,
    sensors: SensorNoise,
    q: AgentState,
    v_dot: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
    lam_bias: Float[Array, "arms 3"],
    noise: AgentNoise,
    gravity: Float[Array, "3"],
) -> AgentReading:
    """Compute the readings of one agent."""
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    p = aerial_manipulator.centroidal_model(agent, g)
    xi = jnp.concatenate([q.omega, q.r_dot])
    s_ddot = _center_acceleration(agent, q) - p.J_base @ xi_dot
    tip = g.rotation[jnp.array(agent.tree.tip_bodies)]
    in_tip = jnp.einsum("bji,bj->bi", tip, lam @ q.R)
    return AgentReading(
        R=q.R @ so3.exp(sensors.attitude * noise.theta),
        x=q.x - q.R @ p.com_from_base + sensors.position * noise.x,
        v=q.v + q.R @ (p.J_base @ xi) + sensors.velocity * noise.v,
        omega=q.omega + sensors.angular_velocity * noise.omega,
        a=q.R.T @ (v_dot - gravity) - s_ddot + sensors.accelerometer * noise.a,
        r=q.r + sensors.joint_position * noise.r,
        lam=in_tip + lam_bias + sensors.tip_force * noise.lam,
    )


def _center_acceleration(agent: AerialManipulator, q: AgentState) -> Float[Array, "3"]:
    """Compute the acceleration `w x (w x s) + 2 w x s' + s''` of the center of mass from the base at `xi_dot = 0`."""

    def s(r: Float[Array, "n_r"]) -> Float[Array, "3"]:
        return aerial_manipulator.center_of_mass(agent, r)

    def s_dot(r: Float[Array, "n_r"]) -> Float[Array, "3"]:
        return jax.jvp(s, (r,), (q.r_dot,))[1]

    rate, curve = jax.jvp(s_dot, (q.r,), (q.r_dot,))
    return so3.cross(q.omega, so3.cross(q.omega, s(q.r)) + 2 * rate) + curve
