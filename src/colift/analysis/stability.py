"""The sampled loop at rest, to first order: how fast a small disturbance dies out, or grows.

One tick of what flies, with its filters, and one step of the plant under the held command are a map of what the one
hands to the next. Its fixed point is the rest; its derivative there has the modes.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import re
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy import linalg

from colift.closed_loop import flight, simulator
from colift.math import so3
from colift.math.linalg import matmul
from colift.models.state import State
from colift.runtime import signals
from colift.simulation import sensors
from colift.simulation.world import SimulatedWorld, WorldNoise

MAX_NEWTON_ITERATIONS = 30  # of Newton's method; from a team that hovers level it takes a handful
SETTLING_TIME = 10.0  # s of flight, where Newton's method needs another start
EQUILIBRIUM_TOLERANCE = 1e-9  # what a tick may still change, in SI units
STEP = 1e-5  # of differences, in SI units; they neglect its fourth power
DEADBEAT_THRESHOLD = 0.01  # a mode that leaves less than this of itself after one tick is no mode of the motion
MARGINAL_THRESHOLD = 1e-6  # rad/s, below which a rate is rounding: of |z|, divided by the tick


POSE = r"\.world\.z\.(payload\.[Rp]|agents\[\d+\]\.[Rxr])"
LEARNING = r"\.recorder\.|\.estimator\.(agents\[\d+\]\.)?bias\b|\.(warm|fresh|silent|ticks)$"
SECOND_ORDER_STATES = (
    r"\.listener\.(late|said|gap|age|foretold|moved\.(products|squares))"  # of the second order at rest
)
SENSORS = r"\.extra\[\d+\]\.(age|due|bias)\b"  # their clocks and drifts, which stand still
LABELS = r"\.estimator\.(agents\[\d+\]\.)?(momenta|carried|known|label|state)\b"


@dataclasses.dataclass(frozen=True)
class Modes:
    """The sampled loop's modes at rest, slowest first, as rates `log(z) / dt`, and how each moves the payload."""

    eigenvalues: np.ndarray  # (modes,) rad/s
    payload: np.ndarray  # (modes, 6) amplitude of the payload's (theta, p), the largest pose of the mode being 1
    attitude: np.ndarray  # (modes, agents, 3) that of every agent's rotation vector, body frame
    joints: np.ndarray  # (modes, joints) that of every joint, in team order
    names: tuple[str, ...] = ("theta_x", "theta_y", "theta_z", "p_x", "p_y", "p_z")

    @property
    def stable(self) -> bool:
        """Whether every mode decays."""
        return bool(self.eigenvalues[0].real < -MARGINAL_THRESHOLD)

    @property
    def slowest_eigenvalue(self) -> tuple[float, float]:
        """Real and imaginary part of the slowest eigenvalue, rad/s."""
        return float(self.eigenvalues[0].real), float(self.eigenvalues[0].imag)

    def describe_slowest(self) -> str:
        """The slowest mode in words: its eigenvalue and where it is seen most."""
        value, shape = self.eigenvalues[0], self.payload[0]
        seen = self.names[int(np.argmax(shape))] if shape.max() > 0.05 else "the agents' attitudes and joints"
        return f"{value.real:+.2f} {abs(value.imag):+.2f}i rad/s, seen most in {seen}"


LoopStateTree = dict[str, Array]
"""What one tick hands to the next, of world and memory, by its place in the loop, as far as it may come back."""


def modes_at_equilibrium(experiment: flight.Experiment, state: State) -> Modes:
    """Modes of a plan's loop at the rest near z, as `monodromy` has it."""
    return compute_modes(*equilibrium_and_jacobian(experiment, state), experiment.dt)


def compute_modes(x: LoopStateTree, M: np.ndarray, dt: float) -> Modes:
    """Modes of a loop with the rest x and the derivative M of its tick of dt, s."""
    values, vectors = np.linalg.eig(M)
    order = np.argsort(-np.abs(values))
    order = order[np.abs(values[order]) > DEADBEAT_THRESHOLD]
    shapes = np.abs(vectors[:, order])
    shapes = shapes / np.maximum(shapes[_rows_of(x, POSE)].max(0), np.finfo(float).tiny)
    return Modes(
        eigenvalues=np.log(values[order].astype(complex)) / dt,
        payload=shapes[np.concatenate([_rows_of(x, rf"\.world\.z\.payload\.{part}") for part in "Rp"])].T,
        attitude=shapes[_rows_of(x, r"\.world\.z\.agents\[\d+\]\.R")].T.reshape(len(order), -1, 3),
        joints=shapes[_rows_of(x, r"\.world\.z\.agents\[\d+\]\.r")].T,
    )


def delay_margin(x: LoopStateTree, M: np.ndarray, most: int) -> int:
    """How many whole ticks, at most `most`, every command may come later until the loop is unstable; -1 if it is.

    M as `monodromy` has it. What the pilot remembers moves the world through commands alone, so M tells how they act:
    `world_memory = B K_memory`, K the rows of the command that was applied. Raises ValueError where what is remembered
    does not move every command by itself.
    """
    B, K = _commands(x, M)
    for ticks in range(most + 1):
        if np.abs(np.linalg.eigvals(_delayed(M, B, K, ticks))).max() >= 1:
            return ticks - 1
    return most


MAX_GAIN = 4.0  # beyond which, and below the inverse of which, a gain margin is not sought


def gain_margin(x: LoopStateTree, M: np.ndarray) -> tuple[float, float]:
    """How many times as weak, and as strong, all commands may be with the loop still stable: a range about 1.

    `x+ = (M + (g - 1) B K) x`; its ends to 1 %, within `GAIN_MOST`. NaN where the loop is unstable as it is. Raises as
    `delay_margin`.
    """
    B, K = _commands(x, M)
    BK = B @ K

    def stable(g: float) -> bool:
        return bool(np.abs(np.linalg.eigvals(M + (g - 1) * BK)).max() < 1)

    if not stable(1.0):
        return np.nan, np.nan
    ends = []
    for step in (MAX_GAIN**-0.25, MAX_GAIN**0.25):
        good, bad = 1.0, step
        while stable(bad) and not np.isclose(good, step**3):
            good, bad = bad, bad * step
        if stable(bad):
            ends.append(bad)
            continue
        while abs(np.log(bad / good)) > 0.01:
            middle = float(np.sqrt(good * bad))
            good, bad = (middle, bad) if stable(middle) else (good, middle)
        ends.append(good)
    return ends[0], ends[1]


@dataclasses.dataclass(frozen=True)
class Margins:
    """How far commands may be off, all alike, with the loop at rest still stable."""

    delay_margin: float  # s, how much later they may come
    gain_margin: tuple[float, float]  # how many times as strong they may be
    max_delay_tested: float  # s, up to which a delay was tried

    def describe(self) -> str:
        """In words."""
        delay = f"{1e3 * self.delay_margin:.3g} ms later" + (
            " or more" if self.delay_margin >= self.max_delay_tested else ""
        )
        return f"commands may come {delay}, or be {format_gain_margin(self.gain_margin)}"


def format_gain_margin(gain: tuple[float, float]) -> str:
    """A gain margin in words."""
    least, greatest = gain
    low = f"{least:.2g}" + (" or less" if least <= 1.001 / MAX_GAIN else "")
    high = f"{greatest:.3g}" + (" or more" if greatest >= MAX_GAIN / 1.001 else "")
    return f"{low} to {high} times as strong"


MAX_DELAY = 0.05  # s, beyond which a delay margin is not sought


def stability_margins(x: LoopStateTree, M: np.ndarray, dt: float) -> Margins:
    """Delay and gain margin of a loop with ticks of dt, s; raises as `delay_margin`."""
    most = round(MAX_DELAY / dt)
    return Margins(
        delay_margin=delay_margin(x, M, most) * dt, gain_margin=gain_margin(x, M), max_delay_tested=most * dt
    )


def with_input_delay(x: LoopStateTree, M: np.ndarray, ticks: int) -> np.ndarray:
    """The derivative of a loop whose commands act so many ticks later; raises as `delay_margin`."""
    return _delayed(M, *_commands(x, M), ticks)


NEGLIGIBLE_SENSITIVITY = 1e-7  # of the most that any state moves a command by


def _commands(x: LoopStateTree, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(B, K)`: how commands move the world, and the rows of M by which they follow."""
    command, world = _rows_of(x, r"\.memory\.sent\[\d+\]\..*"), _rows_of(x, r"\.world\..*")
    state, K = np.setdiff1d(np.arange(len(M)), world), M[command]
    # M is known to some 1e-10; what next to no state commands, as a force that only squeezes, needs no column of B
    inverse = np.linalg.pinv(K[:, state], rcond=NEGLIGIBLE_SENSITIVITY)
    if np.linalg.norm(K - K[:, state] @ (inverse @ K), 2) > 10 * NEGLIGIBLE_SENSITIVITY * np.linalg.norm(K, 2):
        raise ValueError("what the pilot remembers does not move every command by itself")
    B = np.zeros((len(M), len(command)))
    B[world] = M[np.ix_(world, state)] @ inverse
    return B, K


def _delayed(M: np.ndarray, B: np.ndarray, K: np.ndarray, ticks: int) -> np.ndarray:
    """`x+ = (M - B K) x + B u_1`, `u_k+ = u_(k+1)`, the last one `K x`: a queue between command and world."""
    if ticks == 0:
        return M
    n, m = B.shape
    whole = np.eye(n + m * ticks, k=m)
    whole[:n] = 0.0
    whole[:n, :n], whole[:n, n : n + m], whole[-m:, :n] = M - B @ K, B, K
    return whole


def _rows_of(x: LoopStateTree, where: str) -> np.ndarray:
    """The rows of the coordinates at the places whose names are of a form."""
    place = _unravel(x, np.arange(sum(math.prod(shape) for _, shape in _shapes(x))))
    return np.concatenate([place[key].ravel() for key in sorted(place) if re.fullmatch(where, key)])


def equilibrium_and_jacobian(experiment: flight.Experiment, state: State) -> tuple[LoopStateTree, np.ndarray]:
    """The rest x near z, the reference held at its start, and the map's derivative there; on the host.

    Bodies move by the truth's parameters and are flown by the nominal ones; sensors are exact and read at every tick,
    and nothing else acts that is unknown. So the rest may be off the reference, as by a payload that is heavier than
    believed. Newton's method on `x = map(x)`, its slope anew where the last one helps little, by differences of
    `simulate.advance`: no program is compiled that a flight does not need anyway. Where it does not get there from z,
    as where rest is half a metre lower, it begins where the loop has settled. Raises ValueError where there is no rest
    near z.
    """
    setup, loop, noise = _begun(experiment, state)
    found = _rest(setup, loop, noise) or _rest(setup, _settled(setup, loop, noise), noise)
    if found is None:
        raise ValueError("the team finds no rest near the start of its reference")
    return found


def _rest(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise
) -> tuple[LoopStateTree, np.ndarray] | None:
    """By Newton's method from a loop, the rest and the derivative there."""
    slope, last = None, np.inf
    for _ in range(MAX_NEWTON_ITERATIONS):
        signals.raise_if_interrupted()
        off = _changed(setup, loop, noise, [_take(loop)])[0]
        if np.abs(off).max() <= EQUILIBRIUM_TOLERANCE:
            return _take(loop), _slope(setup, loop, noise)
        if not np.isfinite(off).all():
            break
        if slope is None or np.abs(off).max() > last / 10:
            ahead = _around(setup, loop, noise, (1,))[0]
            slope = (ahead - off).T / STEP  # to first order in the step: it only searches
        if not np.isfinite(slope).all():
            break
        last = np.abs(off).max()
        step = np.linalg.lstsq(np.eye(len(off)) - slope, off)[0]
        loop = _put(loop, jax.tree.map(lambda leaf: leaf[0], _move(_take(loop), jnp.asarray(step[None]))))
    return None


def _settled(setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise) -> simulator.LoopState:
    """The loop after `SETTLE`, its clock put back every twentieth of a second, in which the reference hardly begins."""
    ticks = max(1, round(0.05 / float(setup.dt)))
    for _ in range(round(SETTLING_TIME / float(setup.dt)) // ticks):
        after, _ = simulator.rollout(setup, loop, noise, jnp.asarray(ticks))
        loop = dataclasses.replace(after, tick=loop.tick, termination=loop.termination)
    return loop


def _begun(experiment: flight.Experiment, state: State) -> tuple[simulator.LoopConfig, simulator.LoopState, WorldNoise]:
    """The loop by itself just after z, its clock held and no limit met, and the noise of sensors that have none.

    Just after: a tick, and as many more as the latest readings take to come.
    """
    experiment = dataclasses.replace(experiment, world=_alone(experiment.world))
    noise = experiment.world.sample_noise(jax.random.key(0), flight.ticks_per_chunk(experiment))
    begun = simulator.reset(experiment.loop_config, state)
    late = max(
        (part.delay for part in experiment.world.sensor_models if isinstance(part, sensors.Intermittent)), default=0
    )
    after, _ = simulator.rollout(experiment.loop_config, begun, noise, jnp.asarray(1 + late))
    return experiment.loop_config, dataclasses.replace(after, tick=begun.tick, termination=begun.termination), noise


def predict_growth_rate(experiment: flight.Experiment, state: State, x: LoopStateTree, M: np.ndarray) -> float:
    """Growth rate, 1/s, of the slowest mode of a plan near the one of rest x and derivative M, to first order.

    `z' = w^H M' v`, v and w the mode's right and left vectors with `w^H v = 1`: M' along one mode is four ticks where
    all of M' is hundreds.
    """
    setup, loop, noise = _begun(experiment, state)
    loop = _put(loop, x)
    values, left, right = linalg.eig(M, left=True)
    k = int(np.argmax(np.abs(values)))
    v, w = right[:, k], left[:, k].conj()
    w = w / (w @ v)
    parts = np.stack([v.real, v.imag])
    moved = _move(x, jnp.asarray(STEP * np.concatenate([parts, -parts])))
    ahead = _changed(setup, loop, noise, [_row(moved, jnp.asarray(i)) for i in range(4)])
    along = (ahead[:2] - ahead[2:]) / (2 * STEP)
    return float(np.log(np.abs(w @ (along[0] + 1j * along[1]))) / experiment.dt)


def step_jacobian(experiment: flight.Experiment, state: State, x: LoopStateTree) -> np.ndarray:
    """The derivative of a plan's loop at x, the rest of a loop near it, as `estimate` takes it along one mode."""
    setup, loop, noise = _begun(experiment, state)
    return _slope(setup, _put(loop, x), noise)


def _slope(setup: simulator.LoopConfig, loop: simulator.LoopState, noise: Any) -> np.ndarray:
    """The map's derivative at a loop: `(8 (f_1 - f_-1) - (f_2 - f_-2)) / (12 h)`, f_k k steps h along a coordinate."""
    near, back, far, farther_back = _around(setup, loop, noise, (1, -1, 2, -2))
    return ((8 * (near - back) - (far - farther_back)) / (12 * STEP)).T


def _around(setup: simulator.LoopConfig, loop: simulator.LoopState, noise: Any, steps: Sequence[int]) -> np.ndarray:
    """`(steps, coordinates, coordinates)`: the map so many times `STEP` along each coordinate from a loop."""
    x = _take(loop)
    n = sum(math.prod(shape) for _, shape in _shapes(x))
    moves = STEP * np.stack([k * np.eye(n) for k in steps])
    moved = _move(x, jnp.asarray(moves.reshape(-1, n)))
    at = [_row(moved, jnp.asarray(k)) for k in range(len(steps) * n)]
    return _changed(setup, loop, noise, at).reshape(len(steps), n, n)


def _changed(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise, at: Sequence[LoopStateTree]
) -> np.ndarray:
    """What a loop carries one tick after each of `at`, in coordinates around what it carries now."""
    leaves, kind = jax.tree.flatten(loop)
    carried = _take(loop)
    place = {key: k for k, (key, _) in enumerate(_leaves(loop)) if key in carried}
    one = jnp.asarray(1)
    run, after = simulator.compile_rollout(setup, loop, noise, one), []
    for y in at:
        here = list(leaves)
        for key, k in place.items():
            here[k] = y[key]
        there = jax.tree.leaves(run(setup, kind.unflatten(here), noise, one)[0])
        after.append({key: there[k] for key, k in place.items()})
    return np.asarray(_coordinates(_take(loop), jax.tree.map(lambda *leaf: np.stack(leaf), *after)))


def _alone(world: SimulatedWorld) -> SimulatedWorld:
    """The true bodies with nothing else unknown, and sensors without noise or bias that read at every tick."""
    quiet = jax.tree.map(jnp.zeros_like, world.sensors)
    return dataclasses.replace(
        world,
        disturbance_scale=jnp.zeros_like(world.disturbance_scale),
        sensors=dataclasses.replace(quiet, tip_force_bandwidth=world.sensors.tip_force_bandwidth),
        tip_force_bias=jax.tree.map(jnp.zeros_like, world.tip_force_bias),
        sensor_models=tuple(map(_faithful, world.sensor_models)),
    )


def _faithful(part: sensors.SensorModel) -> sensors.SensorModel:
    """A sensor that reads whenever it is asked and drifts nowhere: its own clock would stand still with the loop's."""
    zero = jnp.zeros(())
    match part:
        case sensors.Intermittent():
            return dataclasses.replace(
                part, sample_period=zero, dropout_probability=zero, failure_time=jnp.full((), jnp.inf)
            )
        case sensors.BiasRandomWalk():
            return dataclasses.replace(part, random_walk_density=zero, initial_bias_std=zero)
        case _:
            return part


# Local coordinates: a rotation vector, body frame, of every attitude; a difference of everything else -----------------


def _shapes(x: LoopStateTree) -> list[tuple[bool, tuple[int, ...]]]:
    """Of every leaf, whether it is an attitude, and the shape of its coordinates."""
    leaves = [(key.endswith(".R"), x[key].shape) for key in sorted(x)]
    return [(attitude, shape[:-1] if attitude else shape) for attitude, shape in leaves]


def _unravel(x: LoopStateTree, d: Any) -> dict[str, Any]:
    """A row of coordinates at the places that they move."""
    shapes = [shape for _, shape in _shapes(x)]
    ends = np.cumsum([0] + [math.prod(shape) for shape in shapes])
    parts = [d[a:b].reshape(shape) for (a, b), shape in zip(itertools.pairwise(ends), shapes, strict=True)]
    return jax.tree.unflatten(jax.tree.structure(x), parts)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _move(x: LoopStateTree, d: Array) -> LoopStateTree:
    turns = jax.tree.unflatten(jax.tree.structure(x), [attitude for attitude, _ in _shapes(x)])
    return jax.tree.map(lambda attitude, a, b: matmul(a, so3.exp(b)) if attitude else a + b, turns, x, _unravel(x, d))


@jax.jit
def _row(moved: LoopStateTree, k: Array) -> LoopStateTree:
    return jax.tree.map(lambda leaf: leaf[k], moved)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _coordinates(x: LoopStateTree, y: LoopStateTree) -> Array:
    """Of y around x, to first order."""
    pairs = zip(_shapes(x), jax.tree.leaves(x), jax.tree.leaves(y), strict=True)
    parts = [so3.vee(matmul(jnp.swapaxes(a, -1, -2), b)) if attitude else b - a for (attitude, _), a, b in pairs]
    return jnp.concatenate([part.ravel() for part in parts])


# What a tick hands on -------------------------------------------------------------------------------------------------


def _take(loop: simulator.LoopState) -> LoopStateTree:
    """Data are for learning, and labels where nobody listens: they come back to the plant through no tick."""
    listens = getattr(loop.controller, "listener", None) is not None
    apart = "|".join((LEARNING, SENSORS, SECOND_ORDER_STATES if listens else LABELS))
    return {
        key: leaf
        for key, leaf in _leaves(loop)
        if jnp.issubdtype(leaf.dtype, jnp.floating) and not re.search(apart, key)
    }


def _put(loop: simulator.LoopState, x: LoopStateTree) -> simulator.LoopState:
    return jax.tree.unflatten(jax.tree.structure(loop), [x.get(key, leaf) for key, leaf in _leaves(loop)])


def _leaves(loop: simulator.LoopState) -> list[tuple[str, Array]]:
    return [(jax.tree_util.keystr(path), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(loop)]
