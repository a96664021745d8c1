"""Several flights in one program: the lanes of a vector register hold flights.

The flights of a group advance together from one chunk of control periods to the next. Model updates of each flight run
on the host between two chunks. A flight that ended earlier keeps its state. Records agree with those of single flights
to rounding, and they do not depend on the other flights of a group.

See Also:
    colift.closed_loop.flight: single flights.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift.closed_loop import flight, simulator
from colift.closed_loop.flight import Experiment, FlightResult, SimulatedFlight
from colift.codegen import build
from colift.runtime import signals
from colift.simulation.world import World


def run_batch(
    experiments: Sequence[Experiment[World]], progress: Callable[[float], None] = lambda _t: None
) -> Iterator[tuple[int, FlightResult]]:
    """Simulate flights with their model updates, as many at a time as the lanes of a vector.

    Flights without native code are simulated one after another.

    Args:
        experiments: Definitions of the flights.
        progress: Function called with the simulated time of all flights [s].

    Yields:
        Index and result of each flight, after all flights of its group ended.

    Example:
        ::

            for k, found in run_batch(experiments):
                print(k, found.termination_reason)
    """
    groups: dict[Hashable, list[int]] = {}
    for k, experiment in enumerate(experiments):
        groups.setdefault(_structure(experiment), []).append(k)
    before = 0.0
    for indices in groups.values():
        for first in range(0, len(indices), build.lanes()):
            members = indices[first : first + build.lanes()]
            chosen = [experiments[k] for k in members]
            total = sum(one.duration for one in chosen)
            report = lambda t, before=before: progress(before + t)  # noqa: E731
            yield from zip(members, _run_group(chosen, report), strict=True)
            before += total
            progress(before)


def _structure(experiment: Experiment[World]) -> Hashable:
    """Return a value that is equal for flights with the same program."""
    leaves, structure = jax.tree.flatten((experiment.loop_config, experiment.initial_state))
    return structure, tuple(map(jax.typeof, leaves)), flight.ticks_per_chunk(experiment)


def _run_group(experiments: Sequence[Experiment[World]], progress: Callable[[float], None]) -> list[FlightResult]:
    """Simulate the flights of one structure together."""
    with contextlib.ExitStack() as files:
        flights = [
            files.enter_context(contextlib.closing(SimulatedFlight(one, keep_factors=False))) for one in experiments
        ]
        group = _Group.start(flights)
        if group is None:
            files.close()
            return [flight.run_experiment(one) for one in experiments]
        while any(one.continues for one in flights):
            signals.raise_if_interrupted()
            group.advance()
            progress(sum(one.time for one in flights))
        return [one.result() for one in flights]


class _Group:
    """Flights of one structure with their stacked arguments; lanes without a flight repeat the first one."""

    def __init__(self, flights: Sequence[SimulatedFlight], program: simulator.BatchedRollout, loops: list[Any]) -> None:
        """Stack the initial states."""
        self.flights, self.program = flights, program
        self.first = jax.tree.leaves(flights[0].setup)  # also holds the arguments that the program does not read
        self.setups = [self._read_leaves(one) for one in flights]
        self.noise: list[Any] = [None] * len(flights)
        self.setup = self._stacked_setup()
        self.loop = jax.tree.map(jnp.asarray, _stack(self._filled(loops)))

    @classmethod
    def start(cls, flights: Sequence[SimulatedFlight]) -> _Group | None:
        """Return the flights at their first control period; None if the rollout has no native code."""
        loops = [simulator.reset(one.setup, one.experiment.initial_state) for one in flights]
        noise, ticks = flights[0].next_chunk()
        program = simulator.compile_batched_rollout(flights[0].setup, loops[0], noise, jnp.asarray(ticks))
        return None if program is None else cls(flights, program, loops)

    def advance(self) -> None:
        """Simulate one chunk of each flight that continues, with the model updates at its end."""
        start_time, ticks = time.perf_counter(), np.zeros(build.lanes(), int)
        active = [k for k, one in enumerate(self.flights) if one.continues]
        for k in active:
            self.noise[k], ticks[k] = self.flights[k].next_chunk()
        noise = _stack(self._filled(self.noise))
        self.loop, rows = self.program(self.setup, self.loop, noise, ticks)
        loop, rows = jax.tree.map(np.asarray, (self.loop, rows))
        own = [jax.tree.map(lambda x, k=k: x[k], (loop, rows)) for k in active]
        for k, (state, records) in zip(active, own, strict=True):
            self.flights[k].add_records(state, records)
        duration = (time.perf_counter() - start_time) / len(active)
        changed = False
        for k, (state, _) in zip(active, own, strict=True):
            self.flights[k].wall_time["simulation"] += duration
            if self.flights[k].update_model(state):
                self.setups[k], changed = self._read_leaves(self.flights[k]), True
        if changed:
            self.setup = self._stacked_setup()

    def _read_leaves(self, one: SimulatedFlight) -> list[Any]:
        """Return the leaves of the setup of a flight that the program reads."""
        return [leaf if k in self.program.read else None for k, leaf in enumerate(jax.tree.leaves(one.setup))]

    def _stacked_setup(self) -> list[Any]:
        """Return the leaves of all setups with the lanes as first axis; of the first flight where they are not read."""
        columns = zip(self.first, *self._filled(self.setups), strict=True)
        return [jnp.asarray(np.stack(rest)) if k in self.program.read else x for k, (x, *rest) in enumerate(columns)]

    def _filled(self, values: Sequence[Any]) -> list[Any]:
        """Return one value for each lane."""
        return [*values, *[values[0]] * (build.lanes() - len(values))]


def _stack(trees: Sequence[Any]) -> Any:
    """Stack the leaves of trees on the host."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)
