"""Closes the loop: truth, sensors, flight software, log; and the updates of the learned models at times t_k."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from colift import codegen
from colift.closed_loop import termination
from colift.closed_loop.signals import StepRecord, _row
from colift.math.pytree import pytree
from colift.models.state import ControlClock, State

Scalar = Float[Array, ""]

log = logging.getLogger(__name__)


@pytree
class LoopState:
    """The state of world and pilot between ticks."""

    world: Any
    controller: Any
    tick: Int[Array, ""]
    saturated_ticks: tuple[Int[Array, "agents"], ...]  # ticks that each thrust has been at its limit without a break
    termination: Int[Array, ""]  # the `limits.Cause`, 0 while the flight goes on


@pytree
class LoopConfig:
    """Who flies where: what a tick needs beside the state of the loop."""

    world: Any  # a `world.World`
    controller: Any  # a `fly.Pilot`
    termination_limits: termination.TerminationLimits
    dt: Scalar  # s, the clock's tick


def reset(setup: LoopConfig, state: State) -> LoopState:
    """The loop before its first tick: the team at z, held by the command of a noise-free tick at rest."""
    return _program(_start, setup, state)(setup, state)


def _start(setup: LoopConfig, state: State) -> LoopState:
    command, controller_state = setup.controller.init(
        setup.world.measure_at_rest(state), ControlClock(t=jnp.zeros(()), dt=setup.dt)
    )
    return LoopState(
        world=setup.world.init(state, command),
        controller=controller_state,
        tick=jnp.zeros((), int),
        saturated_ticks=tuple(jnp.zeros(size, int) for size in setup.world.team.sizes),
        termination=jnp.zeros((), int),
    )


def step(setup: LoopConfig, loop: LoopState, noise: Any) -> tuple[LoopState, StepRecord]:
    """Measure, fly, step, log: one control period with the commands held."""
    world, dt = setup.world, setup.dt
    clock = ControlClock(t=loop.tick.astype(dt.dtype) * dt, dt=dt)
    m, state = world.measure(loop.world, clock, noise)
    command, controller_state, decided = setup.controller.step(loop.controller, m, clock)
    state, truth = world.step(state, command, clock)
    row = _row(world.team, setup.controller.team, clock.t, truth, decided)
    saturated = tuple(
        jnp.where(context, past + 1, 0) for past, context in zip(loop.saturated_ticks, decided.saturated, strict=True)
    )
    watched = _watched(row, _finite(state.z) & _finite(row), jnp.concatenate(saturated).astype(dt.dtype) * dt)
    loop = LoopState(
        world=state,
        controller=controller_state,
        tick=loop.tick + 1,
        saturated_ticks=saturated,
        termination=jnp.where(
            loop.termination > 0, loop.termination, termination.check_termination(setup.termination_limits, watched)
        ),
    )
    return loop, row


def _watched(
    row: StepRecord, finite: Bool[Array, ""], saturated: Float[Array, "agents"]
) -> termination.MonitoredValues:
    """What may end the flight: the row of one tick, and for how long each thrust has been at its limit, s."""
    return termination.MonitoredValues(
        finite=finite,
        delassus=row.min_delassus_singular_value,
        distance=jnp.sqrt((row.e_p * row.e_p).sum()),
        heights=jnp.concatenate([row.p[2:], row.x[:, 2]]),
        attitude=jnp.arccos(jnp.clip(1 - row.Psi, -1.0, 1.0)),
        tilt=jnp.arccos(jnp.clip(row.R[:, 2, 2], -1.0, 1.0)),
        saturated=saturated,
    )


def _finite(tree: object) -> Bool[Array, ""]:
    return jnp.stack([jnp.isfinite(x).all() for x in jax.tree.leaves(tree)]).all()


def rollout(setup: LoopConfig, loop: LoopState, noise: Any, ticks: Int[Array, ""]) -> tuple[LoopState, StepRecord]:
    """Up to `ticks` ticks, at most as many as there is noise; stops after the tick that met a limit.

    In native code where there is a C compiler, by JAX where there is none or a part calls what has no native code.
    The number of ticks is data, not shape: intervals of any length share one compiled program.
    """
    return compile_rollout(setup, loop, noise, ticks)(setup, loop, noise, ticks)


def compile_rollout(*like: Any) -> Callable[..., tuple[LoopState, StepRecord]]:
    """What `advance` runs for arguments like these: many short calls need not look it up each time."""
    return _program(_advance, *like)


def _program(f: Callable[..., Any], *like: Any) -> Callable[..., Any]:
    leaves, structure = jax.tree.flatten(like)
    return _compiled(f, structure, tuple(map(jax.typeof, leaves)))


@functools.cache
def _compiled(f: Callable[..., Any], structure: Any, like: tuple[Any, ...]) -> Callable[..., Any]:
    compiled = jax.jit(codegen.compile(f))
    try:
        compiled.lower(*jax.tree.unflatten(structure, like))
    except codegen.UnsupportedPrimitive as error:
        log.info("flown by JAX, a few times slower: %s", error)
        return jax.jit(f)
    return compiled


def _advance(setup: LoopConfig, loop: LoopState, noise: Any, ticks: Int[Array, ""]) -> tuple[LoopState, StepRecord]:
    room, context = jax.tree.leaves(noise)[0].shape[0], lambda i: jax.tree.map(lambda x: x[i], noise)
    one = jax.jit(step)  # traced once, for its row's shapes and for the loop
    shape = jax.eval_shape(one, setup, loop, jax.eval_shape(context, 0))[1]
    rows = jax.tree.map(lambda s: jnp.zeros((room, *s.shape), s.dtype), shape)

    def body(carry: tuple[LoopState, StepRecord, Int[Array, ""]]) -> tuple[LoopState, StepRecord, Int[Array, ""]]:
        loop, rows, i = carry
        loop, row = one(setup, loop, context(i))
        return loop, jax.tree.map(lambda buffer, x: buffer.at[i].set(x), rows, row), i + 1

    def go_on(carry: tuple[LoopState, StepRecord, Int[Array, ""]]) -> Bool[Array, ""]:
        return (carry[2] < jnp.minimum(ticks, room)) & (carry[0].termination == 0)

    loop, rows, _ = jax.lax.while_loop(go_on, body, (loop, rows, jnp.zeros((), int)))
    return loop, rows
