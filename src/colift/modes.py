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

from colift import interrupt, simulate, so3
from colift.linalg import mul
from colift.model import State
from colift.world import Noise, Simulated

ITERATIONS = 30  # of Newton's method; from a team that hovers level it takes a handful
AT_REST = 1e-9  # what a tick may still change, in SI units
STEP = 1e-5  # of differences, in SI units; they neglect its fourth power
GONE = 0.01  # a mode that leaves less than this of itself after one tick is no mode of the motion
NEUTRAL = 1e-6  # rad/s, below which a rate is rounding: of |z|, divided by the tick


POSE = r"\.world\.z\.(payload\.[Rp]|agents\[\d+\]\.[Rxr])"
LEARNING = r"\.recorder\.|\.estimator\.(agents\[\d+\]\.)?(momenta|carried|known|label|state|warm)\b|\.ticks$"


@dataclasses.dataclass(frozen=True)
class Modes:
    """The sampled loop's modes at rest, slowest first, as rates `log(z) / dt`, and how each moves the payload."""

    eigenvalues: np.ndarray  # (modes,) rad/s
    payload: np.ndarray  # (modes, 6) amplitude of the payload's (theta, p), the largest pose of the mode being 1
    names: tuple[str, ...] = ("theta_x", "theta_y", "theta_z", "p_x", "p_y", "p_z")

    @property
    def stable(self) -> bool:
        """Whether every mode decays."""
        return bool(self.eigenvalues[0].real < -NEUTRAL)

    @property
    def rate(self) -> tuple[float, float]:
        """Real and imaginary part of the slowest eigenvalue, rad/s."""
        return float(self.eigenvalues[0].real), float(self.eigenvalues[0].imag)

    def slowest(self) -> str:
        """The slowest mode in words: its eigenvalue and where it is seen most."""
        value, shape = self.eigenvalues[0], self.payload[0]
        seen = self.names[int(np.argmax(shape))] if shape.max() > 0.05 else "the agents' attitudes and joints"
        return f"{value.real:+.2f} {abs(value.imag):+.2f}i rad/s, seen most in {seen}"


Carried = dict[str, Array]
"""What one tick hands to the next, of world and memory, by its place in the loop, as far as it may come back."""


def at_rest(plan: simulate.Plan, z: State) -> Modes:
    """Modes of a plan's loop at the rest near z, as `monodromy` has it."""
    x, M = monodromy(plan, z)
    values, vectors = np.linalg.eig(M)
    order = np.argsort(-np.abs(values))
    order = order[np.abs(values[order]) > GONE]
    shapes = np.abs(vectors[:, order])
    place = _unravel(x, np.arange(len(M)))
    load = np.concatenate([place[f".world.z.payload.{part}"] for part in "Rp"])
    poses = [place[key].ravel() for key in place if re.fullmatch(POSE, key)]
    payload = shapes[load] / np.maximum(shapes[np.concatenate(poses)].max(0), np.finfo(float).tiny)
    rates = np.log(values[order].astype(complex)) / plan.dt
    return Modes(eigenvalues=rates, payload=payload.T)


def monodromy(plan: simulate.Plan, z: State) -> tuple[Carried, np.ndarray]:
    """The rest x near z, the reference held at its start, and the map's derivative there; on the host.

    Bodies move by the truth's parameters and are flown by the nominal ones; sensors are exact, and nothing else acts
    that is unknown. So the rest may be off the reference, as by a payload that is heavier than believed. Newton's
    method on `x = map(x)`, its slope anew where the last one helps little, by differences of `simulate.advance`: no
    program is compiled that a flight does not need anyway. Raises ValueError where there is no rest near z.
    """
    plan = dataclasses.replace(plan, world=_alone(plan.world))
    noise = plan.world.draw(jax.random.key(0), simulate.chunk(plan))  # of sensors that have none
    setup = plan.setup
    begun = simulate.start(setup, z)
    after, _ = simulate.advance(setup, begun, noise, jnp.asarray(1))
    loop = dataclasses.replace(after, tick=begun.tick, ended=begun.ended)  # a clock that stands still, no limit met
    slope, last = None, np.inf
    for _ in range(ITERATIONS):
        interrupt.check()
        off = _changed(setup, loop, noise, [_take(loop)])[0]
        if np.abs(off).max() <= AT_REST:
            return _take(loop), _slope(setup, loop, noise)
        if not np.isfinite(off).all():
            break
        if slope is None or np.abs(off).max() > last / 10:
            slope = _slope(setup, loop, noise)
        if not np.isfinite(slope).all():
            break
        last = np.abs(off).max()
        step = np.linalg.lstsq(np.eye(len(off)) - slope, off)[0]
        loop = _put(loop, jax.tree.map(lambda leaf: leaf[0], _move(_take(loop), jnp.asarray(step[None]))))
    raise ValueError("the team finds no rest near the start of its reference")


def _slope(setup: simulate.Setup, loop: simulate.Loop, noise: Any) -> np.ndarray:
    """The map's derivative at a loop: `(8 (f_1 - f_-1) - (f_2 - f_-2)) / (12 h)`, f_k k steps h along a coordinate."""
    x = _take(loop)
    n = sum(math.prod(shape) for _, shape in _shapes(x))
    steps = STEP * np.stack([k * np.eye(n) for k in (1, -1, 2, -2)])
    moved = _move(x, jnp.asarray(steps.reshape(-1, n)))
    around = [_row(moved, jnp.asarray(k)) for k in range(4 * n)]
    near, back, far, farther_back = _changed(setup, loop, noise, around).reshape(4, n, n)
    return ((8 * (near - back) - (far - farther_back)) / (12 * STEP)).T


def _changed(setup: simulate.Setup, loop: simulate.Loop, noise: Noise, at: Sequence[Carried]) -> np.ndarray:
    """What a loop carries one tick after each of `at`, in coordinates around what it carries now."""
    leaves, kind = jax.tree.flatten(loop)
    place = {key: k for k, (key, leaf) in enumerate(_leaves(loop)) if _comes_back(key, leaf)}
    one = jnp.asarray(1)
    run, after = simulate.program(setup, loop, noise, one), []
    for y in at:
        here = list(leaves)
        for key, k in place.items():
            here[k] = y[key]
        there = jax.tree.leaves(run(setup, kind.unflatten(here), noise, one)[0])
        after.append({key: there[k] for key, k in place.items()})
    return np.asarray(_coordinates(_take(loop), jax.tree.map(lambda *leaf: np.stack(leaf), *after)))


def _alone(world: Simulated) -> Simulated:
    """The true bodies with nothing else unknown, and sensors without noise or bias."""
    quiet = jax.tree.map(jnp.zeros_like, world.sensors)
    return dataclasses.replace(
        world,
        acting=jnp.zeros_like(world.acting),
        sensors=dataclasses.replace(quiet, tip_force_bandwidth=world.sensors.tip_force_bandwidth),
        lam_bias=jax.tree.map(jnp.zeros_like, world.lam_bias),
    )


# Local coordinates: a rotation vector, body frame, of every attitude; a difference of everything else -----------------


def _shapes(x: Carried) -> list[tuple[bool, tuple[int, ...]]]:
    """Of every leaf, whether it is an attitude, and the shape of its coordinates."""
    leaves = [(key.endswith(".R"), x[key].shape) for key in sorted(x)]
    return [(attitude, shape[:-1] if attitude else shape) for attitude, shape in leaves]


def _unravel(x: Carried, d: Any) -> dict[str, Any]:
    """A row of coordinates at the places that they move."""
    shapes = [shape for _, shape in _shapes(x)]
    ends = np.cumsum([0] + [math.prod(shape) for shape in shapes])
    parts = [d[a:b].reshape(shape) for (a, b), shape in zip(itertools.pairwise(ends), shapes, strict=True)]
    return jax.tree.unflatten(jax.tree.structure(x), parts)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _move(x: Carried, d: Array) -> Carried:
    turns = jax.tree.unflatten(jax.tree.structure(x), [attitude for attitude, _ in _shapes(x)])
    return jax.tree.map(lambda attitude, a, b: mul(a, so3.exp(b)) if attitude else a + b, turns, x, _unravel(x, d))


@jax.jit
def _row(moved: Carried, k: Array) -> Carried:
    return jax.tree.map(lambda leaf: leaf[k], moved)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _coordinates(x: Carried, y: Carried) -> Array:
    """Of y around x, to first order."""
    pairs = zip(_shapes(x), jax.tree.leaves(x), jax.tree.leaves(y), strict=True)
    parts = [so3.vee(mul(jnp.swapaxes(a, -1, -2), b)) if attitude else b - a for (attitude, _), a, b in pairs]
    return jnp.concatenate([part.ravel() for part in parts])


# What a tick hands on -------------------------------------------------------------------------------------------------


def _take(loop: simulate.Loop) -> Carried:
    return {key: leaf for key, leaf in _leaves(loop) if _comes_back(key, leaf)}


def _put(loop: simulate.Loop, x: Carried) -> simulate.Loop:
    return jax.tree.unflatten(jax.tree.structure(loop), [x.get(key, leaf) for key, leaf in _leaves(loop)])


def _leaves(loop: simulate.Loop) -> list[tuple[str, Array]]:
    return [(jax.tree_util.keystr(path), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(loop)]


def _comes_back(key: str, leaf: Array) -> bool:
    """Data and labels are for learning: they come back to the plant through no tick."""
    return jnp.issubdtype(leaf.dtype, jnp.floating) and not re.search(LEARNING, key)
