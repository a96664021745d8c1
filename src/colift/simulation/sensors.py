"""What is measured on board, and how sensors corrupt it.

`Measurement` is all that the flying software ever sees of the truth. `sense` makes one from the truth; the
noise is drawn beforehand, so that runs that differ in the controller alone see the same noise.
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
    """Standard deviations of the white noise on each tick's reading, and the tips' bias and bandwidth."""

    position: Scalar  # m
    attitude: Scalar  # rad
    velocity: Scalar  # m/s
    angular_velocity: Scalar  # rad/s
    accelerometer: Scalar  # m/s^2
    joint_position: Scalar  # rad or m
    tip_force: Scalar  # N
    tip_force_bias: Scalar  # N
    tip_force_bandwidth: Scalar  # Hz, first order


@pytree
class AgentNoise:
    """Standard normal draws for one tick of a group's sensors."""

    theta: Float[Array, "*time agents 3"]
    x: Float[Array, "*time agents 3"]
    v: Float[Array, "*time agents 3"]
    omega: Float[Array, "*time agents 3"]
    a: Float[Array, "*time agents 3"]
    r: Float[Array, "*time agents n_r"]
    lam: Float[Array, "*time agents arms 3"]


@pytree
class PayloadNoise:
    """Standard normal draws for one tick of the payload's sensors."""

    theta: Float[Array, "*time 3"]
    p: Float[Array, "*time 3"]
    v: Float[Array, "*time 3"]
    omega: Float[Array, "*time 3"]
    a: Float[Array, "*time 3"]


@pytree
class Noise:
    """Standard normal draws for one tick, or with a leading time axis, for many."""

    agents: tuple[AgentNoise, ...]
    payload: PayloadNoise


def sample_noise(team: Team, key: Array, ticks: int) -> Noise:
    """The noise of `ticks` ticks from one random key."""

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
        agents.append(AgentNoise(**normal(k, shapes)))
    payload: dict[str, tuple[int, ...]] = dict.fromkeys(("theta", "p", "v", "omega", "a"), (3,))
    return Noise(agents=tuple(agents), payload=PayloadNoise(**normal(keys[0], payload)))


def sample_tip_bias(team: Team, sensors: SensorNoise, key: Array) -> tuple[Float[Array, "agents arms 3"], ...]:
    """The constant bias of every tip force sensor over a run, N, in the tip body's frame: one draw a sensor axis."""
    keys = jax.random.split(key, len(team.agent_groups))
    return tuple(
        sensors.tip_force_bias * jax.random.normal(k, (size, group.tree.arms, 3))
        for k, size, group in zip(keys, team.sizes, team.agent_groups, strict=True)
    )


@pytree
class SensedState:
    """What the sensors are exposed to at one instant."""

    z: State
    v_dot: tuple[Float[Array, "agents 3"], ...]  # m/s^2, centres of mass, world
    xi_dot: tuple[Float[Array, "agents xi"], ...]
    a_L: Float[Array, "6"]
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, as passed by the sensors' bandwidth, world
    f: ResidualForces


def measure(
    team: Team,
    sensors: SensorNoise,
    lam_bias: tuple[Float[Array, "agents arms 3"], ...],
    truth: SensedState,
    noise: Noise,
) -> Measurement:
    """One tick's measurement of the truth."""
    q = truth.z.payload
    n = noise.payload
    return Measurement(
        agents=tuple(
            jax.vmap(_sense_agent, in_axes=(0, None, 0, 0, 0, 0, 0, 0, None))(
                group, sensors, state, v_dot, xi_dot, lam, offset, e, team.gravity
            )
            for group, state, v_dot, xi_dot, lam, offset, e in zip(
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


class SensorModel:
    """A sensor beside those that every team carries: a `pytree` that adds to a measurement, or changes it.

    What it says of its own goes into `Measurement.more`, a dictionary by name. One without noise or memory leaves
    `draw` and `begin` alone.
    """

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: Any
    ) -> tuple[Measurement, Any]:
        """The measurement with this sensor's part in it, and the next memory."""
        raise NotImplementedError

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Any:
        """The noise of `ticks` ticks from one random key, time first."""
        return ()

    def init(self, measurement: Measurement) -> Any:
        """The memory before the flight, where the other sensors read m at rest."""
        return ()


@pytree
class CalibrationRig(SensorModel):
    """A calibration rig: the true state, and the residual there, each label off by `error` one way or the other."""

    label_error: ResidualForces

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: ResidualForces
    ) -> tuple[Measurement, Any]:
        """`Measurement.rig`."""
        f = jax.tree.map(lambda f, e, sign: f + e * sign, truth.f, self.label_error, noise)
        return dataclasses.replace(measurement, rig=RigReading(z=truth.z, f=f)), state

    def sample_noise(self, team: Team, key: Array, ticks: int) -> ResidualForces:
        """Signs, 1 or -1."""
        leaves, kind = jax.tree.flatten(zero_residual(team))
        signs = [
            jax.random.rademacher(jax.random.fold_in(key, k), (ticks, *leaf.shape), leaf.dtype)
            for k, leaf in enumerate(leaves)
        ]
        return jax.tree.unflatten(kind, signs)


@pytree
class IntermittentState:
    """What `Intermittent` remembers."""

    last_reading: dict[str, Any]  # the readings that came last
    age: Scalar  # s, for how long nothing has come
    next_sample_time: Scalar  # s, when the next is taken
    delay_line: tuple[tuple[dict[str, Any], Bool[Array, ""]], ...]  # oldest first, and whether they come


@pytree
class Intermittent(SensorModel):
    """Readings at a rate of their own, late, and lost now and then; in between the last one that came is held.

    The reading of tick k is taken where `every` has passed since the last, is lost with probability `loss`, and comes
    `delay` ticks later; from `until` on none is taken. `Measurement.age_s` says for how long
    nothing new has come.
    """

    channels: tuple[str, ...] = (
        static()
    )  # fields of the payload's and of the agents' readings, as `payload.p`, `agents.x`
    sample_period: Scalar  # s
    dropout_probability: Scalar  # probability
    failure_time: Scalar  # s
    delay: int = static(default=0)  # ticks

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Float[Array, "time"]:
        """Uniform numbers; below `loss` a reading is lost."""
        return jax.random.uniform(key, (ticks,))

    def init(self, measurement: Measurement) -> Any:
        """Nothing under way."""
        none = _chosen(measurement, self.channels), jnp.array(False)
        return IntermittentState(
            last_reading=_chosen(measurement, self.channels),
            age=jnp.zeros(()),
            next_sample_time=jnp.zeros(()),
            delay_line=(none,) * self.delay,
        )

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: IntermittentState, noise: Any
    ) -> tuple[Measurement, Any]:
        """The measurement with what is held in place of what is read."""
        due = state.next_sample_time
        taken = (clock.t >= due - 1e-9) & (clock.t < self.failure_time - 1e-9)
        (context, came), *coming = (
            *state.delay_line,
            (_chosen(measurement, self.channels), taken & (noise >= self.dropout_probability)),
        )
        held = jax.tree.map(lambda new, old: jnp.where(came, new, old), context, state.last_reading)
        age = jnp.where(came, self.delay * clock.dt, state.age + clock.dt)
        due = jnp.where(taken, due + self.sample_period, due)
        ages = measurement.age_s | dict.fromkeys(self.channels, age)
        kept = IntermittentState(last_reading=held, age=age, next_sample_time=due, delay_line=tuple(coming))
        return dataclasses.replace(_put(measurement, self.channels, held), age_s=ages), kept


@pytree
class BiasWalkState:
    """What `Drifting` remembers: how far the bias of each reading has come; of an attitude, a rotation vector."""

    bias: dict[str, Any]


@pytree
class BiasRandomWalk(SensorModel):
    """A bias that walks at random: `b_0 = start n_0`, `b+ = b + rate sqrt(dt) n`, added to every component.

    n is standard normal, and n_0 the noise of the first tick.
    """

    channels: tuple[str, ...] = (
        static()
    )  # as for `Intermittent`; of an attitude the walk is a rotation in the body's frame
    random_walk_density: Scalar  # unit of the reading, or rad, per square root of a second
    initial_bias_std: Scalar  # unit of the reading, or rad

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Any:
        """Standard normal numbers in the shapes of the readings."""
        sizes, payload = _shapes(team), {"R": 3, "p": 3, "v": 3, "omega": 3, "a": 3}
        out = {}
        for k, name in enumerate(self.channels):
            body, _, field = name.partition(".")
            keys = jax.random.split(jax.random.fold_in(key, k), len(sizes))
            shapes = [(payload[field],)] if body == "payload" else [size[field] for size in sizes]
            drawn = [jax.random.normal(one, (ticks, *shape)) for one, shape in zip(keys, shapes, strict=False)]
            out[name] = drawn[0] if body == "payload" else tuple(drawn)
        return out

    def init(self, measurement: Measurement) -> Any:
        """No bias yet."""
        return BiasWalkState(
            bias={
                name: jax.tree.map(functools.partial(_none, name), x)
                for name, x in _chosen(measurement, self.channels).items()
            }
        )

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: BiasWalkState, noise: Any
    ) -> tuple[Measurement, Any]:
        """The measurement with the bias added."""
        step = jnp.where(clock.t > 0, self.random_walk_density * jnp.sqrt(clock.dt), self.initial_bias_std)
        bias = jax.tree.map(lambda b, n: b + step * n, state.bias, noise)
        read = _chosen(measurement, self.channels)
        off = {name: jax.tree.map(functools.partial(_added, name), read[name], bias[name]) for name in self.channels}
        return _put(measurement, self.channels, off), BiasWalkState(bias=bias)


def _none(name: str, x: Array) -> Array:
    """No bias of a reading; of an attitude, no rotation vector."""
    return jnp.zeros(x.shape[:-1] if name.endswith(".R") else x.shape)


def _added(name: str, x: Array, b: Array) -> Array:
    return x @ so3.exp(b) if name.endswith(".R") else x + b


def _shapes(team: Team) -> list[dict[str, tuple[int, ...]]]:
    """What noise of each field of the agents' readings is like, by group; attitudes by rotation vector."""
    return [
        dict.fromkeys(("R", "x", "v", "omega", "a"), (size, 3))
        | {"r": (size, group.tree.joints), "lam": (size, group.tree.arms, 3)}
        for size, group in zip(team.sizes, team.agent_groups, strict=True)
    ]


def _chosen(measurement: Measurement, names: tuple[str, ...]) -> dict[str, Any]:
    """Readings by name: an array of the payload, one a group of agents."""
    out = {}
    for name in names:
        body, _, field = name.partition(".")
        out[name] = (
            getattr(measurement.payload, field)
            if body == "payload"
            else tuple(getattr(a, field) for a in measurement.agents)
        )
    return out


def _put(measurement: Measurement, names: tuple[str, ...], values: dict[str, Any]) -> Measurement:
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
    """Acceleration of the centre of mass from the base origin at `xi_dot = 0`: `w x (w x s) + 2 w x s' + s''`."""

    def s(r: Float[Array, "n_r"]) -> Float[Array, "3"]:
        return aerial_manipulator.center_of_mass(agent, r)

    def s_dot(r: Float[Array, "n_r"]) -> Float[Array, "3"]:
        return jax.jvp(s, (r,), (q.r_dot,))[1]

    rate, curve = jax.jvp(s_dot, (q.r,), (q.r_dot,))
    return so3.cross(q.omega, so3.cross(q.omega, s(q.r)) + 2 * rate) + curve
