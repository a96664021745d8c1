"""What is measured on board, and how sensors corrupt it.

`Measurement` is all that the flying software ever sees of the truth. `sense` makes one from the truth; the
noise is drawn beforehand, so that runs that differ in the controller alone see the same noise.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift import agent as ag
from colift import so3
from colift.measurement import AgentReading, Measurement, PayloadReading, Sample
from colift.model import Agent, AgentState, Residual, State, Team, no_force
from colift.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class Sensors:
    """Standard deviations of the white noise on each tick's reading, and the tips' bias and bandwidth."""

    position: Scalar  # m
    attitude: Scalar  # rad
    velocity: Scalar  # m/s
    body_rate: Scalar  # rad/s
    accelerometer: Scalar  # m/s^2
    joint: Scalar  # rad or m
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


def draw(team: Team, key: Array, ticks: int) -> Noise:
    """The noise of `ticks` ticks from one random key."""

    def normal(key: Array, shapes: dict[str, tuple[int, ...]]) -> dict[str, Array]:
        keys = jax.random.split(key, len(shapes))
        return {
            name: jax.random.normal(k, (ticks, *shape)) for k, (name, shape) in zip(keys, shapes.items(), strict=True)
        }

    keys = jax.random.split(key, 1 + len(team.groups))
    agents = []
    for size, group, k in zip(team.sizes, team.groups, keys[1:], strict=True):
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("theta", "x", "v", "omega", "a"), (size, 3))
        shapes |= {"r": (size, group.tree.joints), "lam": (size, group.tree.arms, 3)}
        agents.append(AgentNoise(**normal(k, shapes)))
    payload: dict[str, tuple[int, ...]] = dict.fromkeys(("theta", "p", "v", "omega", "a"), (3,))
    return Noise(agents=tuple(agents), payload=PayloadNoise(**normal(keys[0], payload)))


def bias(team: Team, sensors: Sensors, key: Array) -> tuple[Float[Array, "agents arms 3"], ...]:
    """The constant bias of every tip force sensor over a run, N, in the tip body's frame: one draw a sensor axis."""
    keys = jax.random.split(key, len(team.groups))
    return tuple(
        sensors.tip_force_bias * jax.random.normal(k, (size, group.tree.arms, 3))
        for k, size, group in zip(keys, team.sizes, team.groups, strict=True)
    )


@pytree
class Truth:
    """What the sensors are exposed to at one instant."""

    z: State
    v_dot: tuple[Float[Array, "agents 3"], ...]  # m/s^2, centres of mass, world
    xi_dot: tuple[Float[Array, "agents xi"], ...]
    a_L: Float[Array, "6"]
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, as passed by the sensors' bandwidth, world
    f: Residual


def sense(
    team: Team, sensors: Sensors, lam_bias: tuple[Float[Array, "agents arms 3"], ...], truth: Truth, noise: Noise
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
                team.groups, truth.z.agents, truth.v_dot, truth.xi_dot, truth.lam, lam_bias, noise.agents, strict=True
            )
        ),
        payload=PayloadReading(
            R=q.R @ so3.exp(sensors.attitude * n.theta),
            p=q.p + sensors.position * n.p,
            v=q.v + sensors.velocity * n.v,
            omega=q.omega + sensors.body_rate * n.omega,
            a=q.R.T @ (truth.a_L[:3] - team.gravity) + sensors.accelerometer * n.a,
        ),
    )


class Extra:
    """A sensor beside those that every team carries: a `pytree` that adds to a measurement, or changes it.

    What it says of its own goes into `Measurement.more`, a dictionary by name. One without noise or memory leaves
    `draw`, `begin` and `after` alone.
    """

    def __call__(self, m: Measurement, truth: Truth, t: Scalar, memory: Any, noise: Any) -> Measurement:
        """The measurement at time t, s, with this sensor's part in it."""
        raise NotImplementedError

    def draw(self, team: Team, key: Array, ticks: int) -> Any:
        """The noise of `ticks` ticks from one random key, time first."""
        return ()

    def begin(self, m: Measurement, truth: Truth) -> Any:
        """The memory before the flight, where the other sensors read m at rest."""
        return ()

    def after(self, m: Measurement, truth: Truth, t: Scalar, memory: Any) -> Any:
        """The memory after a reading; m is as it came."""
        return memory


@pytree
class Rig(Extra):
    """A calibration rig: the true state, and the residual there, each label off by `error` one way or the other."""

    error: Residual

    def __call__(self, m: Measurement, truth: Truth, t: Scalar, memory: Any, noise: Residual) -> Measurement:
        """`Measurement.rig`."""
        f = jax.tree.map(lambda f, e, sign: f + e * sign, truth.f, self.error, noise)
        return dataclasses.replace(m, rig=Sample(z=truth.z, f=f))

    def draw(self, team: Team, key: Array, ticks: int) -> Residual:
        """Signs, 1 or -1."""
        leaves, kind = jax.tree.flatten(no_force(team))
        signs = [
            jax.random.rademacher(jax.random.fold_in(key, k), (ticks, *leaf.shape), leaf.dtype)
            for k, leaf in enumerate(leaves)
        ]
        return jax.tree.unflatten(kind, signs)


@pytree
class Informant(Extra):
    """Tells the residual exactly, which no sensor does: for the floor of a study."""

    def __call__(self, m: Measurement, truth: Truth, t: Scalar, memory: Any, noise: Any) -> Measurement:
        """`Measurement.residual`."""
        return dataclasses.replace(m, residual=truth.f)


def _sense_agent(
    agent: Agent,
    sensors: Sensors,
    q: AgentState,
    v_dot: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
    lam_bias: Float[Array, "arms 3"],
    noise: AgentNoise,
    gravity: Float[Array, "3"],
) -> AgentReading:
    g = ag.geometry(agent, q.r)
    p = ag.reduce(agent, g)
    xi = jnp.concatenate([q.omega, q.r_dot])
    s_ddot = _center_acceleration(agent, q) - p.base @ xi_dot
    tip = g.rotation[jnp.array(agent.tree.tips)]
    in_tip = jnp.einsum("bji,bj->bi", tip, lam @ q.R)
    return AgentReading(
        R=q.R @ so3.exp(sensors.attitude * noise.theta),
        x=q.x - q.R @ p.s + sensors.position * noise.x,
        v=q.v + q.R @ (p.base @ xi) + sensors.velocity * noise.v,
        omega=q.omega + sensors.body_rate * noise.omega,
        a=q.R.T @ (v_dot - gravity) - s_ddot + sensors.accelerometer * noise.a,
        r=q.r + sensors.joint * noise.r,
        lam=in_tip + lam_bias + sensors.tip_force * noise.lam,
    )


def _center_acceleration(agent: Agent, q: AgentState) -> Float[Array, "3"]:
    """Acceleration of the centre of mass from the base origin at `xi_dot = 0`: `w x (w x s) + 2 w x s' + s''`."""

    def s(r: Float[Array, "n_r"]) -> Float[Array, "3"]:
        return ag.center_of_mass(agent, r)

    def s_dot(r: Float[Array, "n_r"]) -> Float[Array, "3"]:
        return jax.jvp(s, (r,), (q.r_dot,))[1]

    rate, curve = jax.jvp(s_dot, (q.r,), (q.r_dot,))
    return so3.cross(q.omega, so3.cross(q.omega, s(q.r)) + 2 * rate) + curve
