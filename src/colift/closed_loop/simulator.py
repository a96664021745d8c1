"""Simulator: one control period of world and controller, and rollouts of many periods.

A rollout runs as generated C where a C compiler is available and every component has native code, otherwise as a
compiled JAX program. Both yield the same records.

See Also:
    colift.closed_loop.flight: flights with model updates between rollouts.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from colift import codegen
from colift.closed_loop import termination
from colift.closed_loop.signals import StepRecord, make_record
from colift.math.pytree import pytree
from colift.models.state import ControlClock, State
from colift.onboard.controller import LeaderFollowerController
from colift.onboard.interfaces import Controller, PartState
from colift.simulation.world import SimulatedWorld, World

if TYPE_CHECKING:
    from typing_extensions import TypeVar

    WorldT = TypeVar("WorldT", bound=World, covariant=True, default=SimulatedWorld)
    ControllerT = TypeVar("ControllerT", bound=Controller, covariant=True, default=LeaderFollowerController)
else:  # without defaults: type checks at run time would accept these only (beartype 0.23)
    from typing import TypeVar

    WorldT = TypeVar("WorldT", bound=World, covariant=True)
    ControllerT = TypeVar("ControllerT", bound=Controller, covariant=True)
Scalar = Float[Array, ""]


@pytree
class LoopState:
    """State of world and controller between ticks."""

    world: PartState  # state of the world
    controller: PartState  # state of the controller
    tick: Int[Array, ""]  # number of ticks since the start
    saturated_ticks: tuple[
        Int[Array, "agents"], ...
    ]  # ticks of each thrust at its limit without interruption, by group
    termination: Int[Array, ""]  # a `termination.TerminationCause`, 0 during the flight


@pytree
class LoopConfig(Generic[WorldT, ControllerT]):
    """Constant data of a closed loop: world, controller, termination limits and period.

    Any `World` and any `Controller` may be used; without parameters the type has those of `make_experiment`.
    """

    world: WorldT  # simulated world
    controller: ControllerT  # onboard controller
    termination_limits: termination.TerminationLimits  # limits whose violation ends a flight
    dt: Scalar  # s, control period


def reset(setup: LoopConfig[World, Controller], state: State) -> LoopState:
    """Return the loop state before the first tick.

    The command before the first tick is the one that the controller computes from the noise-free measurement at rest.

    Args:
        setup: World, controller, limits and period.
        state: Initial state of the team.

    Returns:
        The loop state.
    """
    return _program(_reset, setup, state)(setup, state)


def _reset(setup: LoopConfig[World, Controller], state: State) -> LoopState:
    """Compute `reset`; compiled by `_program`."""
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


def step(setup: LoopConfig[World, Controller], loop: LoopState, noise: Any) -> tuple[LoopState, StepRecord]:
    """Simulate one control period: measure, compute the commands, advance the world, record.

    Args:
        setup: World, controller, limits and period.
        loop: Loop state at the start of the period.
        noise: Sensor noise of this tick.

    Returns:
        The loop state after the period and the record of the tick.
    """
    world, dt = setup.world, setup.dt
    clock = ControlClock(t=loop.tick.astype(dt.dtype) * dt, dt=dt)
    measurement, state = world.measure(loop.world, clock, noise)
    command, controller_state, telemetry = setup.controller.step(loop.controller, measurement, clock)
    state, truth = world.step(state, command, clock)
    row = make_record(world.team, setup.controller.team, clock.t, truth, telemetry)
    saturated = tuple(
        jnp.where(at_limit, ticks + 1, 0)
        for ticks, at_limit in zip(loop.saturated_ticks, telemetry.saturated, strict=True)
    )
    values = monitored_values(
        row, _finite(state.state) & _finite(row), jnp.concatenate(saturated).astype(dt.dtype) * dt
    )
    loop = LoopState(
        world=state,
        controller=controller_state,
        tick=loop.tick + 1,
        saturated_ticks=saturated,
        termination=jnp.where(
            loop.termination > 0, loop.termination, termination.check_termination(setup.termination_limits, values)
        ),
    )
    return loop, row


def monitored_values(
    row: StepRecord, finite: Bool[Array, ""], saturated: Float[Array, "agents"]
) -> termination.MonitoredValues:
    """Return the monitored values of one tick.

    Args:
        row: Record of the tick.
        finite: Whether state and record are finite.
        saturated: Time of each thrust at its limit without interruption [s].

    Returns:
        The values that are compared with the termination limits.
    """
    return termination.MonitoredValues(
        finite=finite,
        delassus=row.min_delassus_singular_value,
        distance=jnp.sqrt((row.e_p * row.e_p).sum()),
        heights=jnp.concatenate([row.p[2:], row.x[:, 2]]),
        attitude=jnp.arccos(jnp.clip(1 - row.Psi, -1.0, 1.0)),
        tilt=jnp.arccos(jnp.clip(row.R[:, 2, 2], -1.0, 1.0)),
        saturated=saturated,
        contact_forces=row.lam @ row.R_L,
        contact_moments=row.contact_moment,
    )


def _finite(tree: object) -> Bool[Array, ""]:
    """Return whether all leaves are finite."""
    return jnp.stack([jnp.isfinite(x).all() for x in jax.tree.leaves(tree)]).all()


def rollout(
    setup: LoopConfig[World, Controller], loop: LoopState, noise: Any, ticks: Int[Array, ""]
) -> tuple[LoopState, StepRecord]:
    """Simulate up to `ticks` control periods; stop after the tick at which a limit is exceeded.

    The number of ticks is data rather than shape, so that rollouts of any length share one compiled program.

    Args:
        setup: World, controller, limits and period.
        loop: Loop state at the start.
        noise: Sensor noise with a leading time axis; its length limits the number of ticks.
        ticks: Number of control periods.

    Returns:
        The loop state at the end, and records with a leading time axis as long as the noise. Records after the last
        tick are zero.

    Example:
        ::

            loop = simulator.reset(experiment.loop_config, experiment.initial_state)
            noise = experiment.world.sample_noise(key, 100)
            loop, records = simulator.rollout(experiment.loop_config, loop, noise, jnp.asarray(100))
    """
    return compile_rollout(setup, loop, noise, ticks)(setup, loop, noise, ticks)


def compile_rollout(*templates: Any) -> Callable[..., tuple[LoopState, StepRecord]]:
    """Return the compiled program of `rollout` for arguments like these; avoids the look-up in many short calls."""
    return _program(_advance, *templates)


class BatchedRollout:
    """Compiled program of `rollout` for several flights.

    Attributes:
        read: Indices of the leaves of the setup that the program reads.
    """

    def __init__(self, structure: Any, read: frozenset[int]) -> None:
        """Compile nothing yet.

        Args:
            structure: Tree structure of the arguments of `rollout`.
            read: As the attribute.
        """
        self.read = read
        setup, *others = (part.num_leaves for part in structure.children())
        axes = [0 if k in read else None for k in range(setup)] + [0] * sum(others)

        def advance(*leaves: Any) -> Any:
            return _native_advance(*jax.tree.unflatten(structure, leaves))

        self._program = jax.jit(jax.vmap(advance, in_axes=axes))

    def __call__(self, setup: list[Any], loop: Any, noise: Any, ticks: Any) -> Any:
        """Simulate up to `ticks` control periods of each flight.

        Args:
            setup: Leaves of the setup; those in `read` have the flights as first axis.
            loop: Loop states, flights first.
            noise: Noise, flights first.
            ticks: Number of control periods of each flight.

        Returns:
            Loop states and records, flights first.
        """
        return self._program(*setup, *jax.tree.leaves((loop, noise)), ticks)


def compile_batched_rollout(*templates: Any) -> BatchedRollout | None:
    """Return the compiled program of `rollout` for several flights with arguments like these.

    Args:
        *templates: Arguments of `rollout` for one flight.

    Returns:
        The program; None if the rollout has no native code.
    """
    leaves, structure = jax.tree.flatten(templates)
    return _compiled_batch(structure, tuple(map(jax.typeof, leaves)))


@functools.cache
def _compiled_batch(structure: Any, types: tuple[Any, ...]) -> BatchedRollout | None:
    """Compile a rollout of several flights for arguments of the given structure and types."""
    templates = [jax.ShapeDtypeStruct(each.shape, each.dtype) for each in types]
    read = codegen.read_arguments(_native_advance, *jax.tree.unflatten(structure, templates))
    setup = structure.children()[0].num_leaves
    return None if read is None else BatchedRollout(structure, frozenset(k for k in read if k < setup))


def _program(f: Callable[..., Any], *templates: Any) -> Callable[..., Any]:
    """Return the compiled program of a function for arguments like these."""
    leaves, structure = jax.tree.flatten(templates)
    return _compiled(f, structure, tuple(map(jax.typeof, leaves)))


@functools.cache
def _compiled(f: Callable[..., Any], structure: Any, types: tuple[Any, ...]) -> Callable[..., Any]:
    """Compile a function for arguments of the given structure and types."""
    del structure, types  # parts of the key
    return jax.jit(codegen.compile(f))


def _advance(
    setup: LoopConfig[World, Controller], loop: LoopState, noise: Any, ticks: Int[Array, ""]
) -> tuple[LoopState, StepRecord]:
    """Simulate up to `ticks` periods; see `rollout`."""
    capacity, noise_at = jax.tree.leaves(noise)[0].shape[0], lambda i: jax.tree.map(lambda x: x[i], noise)
    traced_step = jax.jit(step)  # traced once for both the shapes of the records and the loop
    shape = jax.eval_shape(traced_step, setup, loop, jax.eval_shape(noise_at, 0))[1]
    rows = jax.tree.map(lambda s: jnp.zeros((capacity, *s.shape), s.dtype), shape)

    def body(carry: tuple[LoopState, StepRecord, Int[Array, ""]]) -> tuple[LoopState, StepRecord, Int[Array, ""]]:
        loop, rows, i = carry
        loop, row = traced_step(setup, loop, noise_at(i))
        return loop, jax.tree.map(lambda buffer, x: buffer.at[i].set(x), rows, row), i + 1

    def unfinished(carry: tuple[LoopState, StepRecord, Int[Array, ""]]) -> Bool[Array, ""]:
        return (carry[2] < jnp.minimum(ticks, capacity)) & (carry[0].termination == 0)

    loop, rows, _ = jax.lax.while_loop(unfinished, body, (loop, rows, jnp.zeros((), int)))
    return loop, rows


_native_advance = codegen.compile(_advance)
"""Native code of `_advance`, also for several flights."""
