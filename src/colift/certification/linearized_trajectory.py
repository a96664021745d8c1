"""The loop that flies, linearized along a flight: sampled, held, estimated and compensated as it is.

A run that starts as its twin differs from it by the unknown forces `f~` that the twin does not have, and by noise:

    x_(k+1) = A_k x_k + B_k f~(t_k) + B'_k f~(t_(k+1)) + n_k,    y_k = C_k x_k + D_k f~(t_k),    x_0 = 0

to first order; node k is a tick of the flight, and `f~` goes straight between nodes. The states are those of plant and
estimator that commands depend on, as they are logged: an attitude is the nine entries of its matrix. One derivative of
`simulate.tick` by forward mode is taken at every node. Derivation: `docs/certificate.md`, "The loop along a flight".
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from colift import codegen
from colift.closed_loop import flight, linearization, simulator, termination
from colift.closed_loop.signals import StepRecord
from colift.math.pytree import pytree
from colift.models.state import State, flatten_agent_state, flatten_payload_state
from colift.onboard.learning.prediction_uncertainty import ModelInterval
from colift.runtime import signals

Matrix = NDArray[np.float64]
Nodes = Sequence[int] | NDArray[np.integer]

MAX_NODE_SPACING = 0.04  # s, at most, between nodes
CHUNK_NODES = 16  # nodes over which what many outputs answer to is taken at once


class TerminatedEarly(ValueError):
    """A twin met a limit before its time."""


@dataclasses.dataclass(frozen=True)
class LinearizedTrajectory:
    """The deviation of runs from a twin, to first order; see the module."""

    model_schedule: tuple[ModelInterval, ...]  # the oracles that fly, the twin's as the flight's
    records: StepRecord  # the twin's
    nodes: NDArray[np.intp]  # ticks
    A: Matrix  # (nodes - 1, states, states)
    B: Matrix  # (nodes - 1, 2, states, inputs)
    N: Matrix  # (nodes - 1, states, states), the covariance that noise adds until the next node
    C: Matrix  # (nodes, outputs, states)
    D: Matrix  # (nodes, outputs, inputs)
    N_y: Matrix  # (nodes, outputs), the variance of an output by the noise of its own tick
    outputs: dict[str, slice]  # rows of C and D by name: the errors, u, payload, agent 0, ...
    bodies: tuple[slice, ...]  # inputs of the payload, then of each agent

    @property
    def t(self) -> Matrix:
        """s, of the nodes."""
        return np.asarray(self.records.t, float)[self.nodes]

    def output_rows(self, *names: str) -> NDArray[np.intp]:
        """Where some outputs stand in C and D, one behind the other."""
        return np.concatenate([np.arange(self.outputs[name].start, self.outputs[name].stop) for name in names])


@pytree
class _Pushed:
    """An unknown force that is the same everywhere."""

    force: Any

    def __call__(self, _z: State) -> Any:
        return self.force


def simulate_nominal(
    experiment: flight.Experiment, schedule: Sequence[ModelInterval], nodes: Nodes = (), seed: int | None = None
) -> tuple[StepRecord, list[simulator.LoopState]]:
    """A flight without a school: oracles are replaced as scheduled. Its rows, and the loop at nodes.

    seed: of the noise; None: without any. Raises Ended where it meets a limit.
    """
    ticks, room, key = (
        round(experiment.duration / experiment.dt),
        flight.ticks_per_chunk(experiment),
        jax.random.key(seed or 0),
    )
    quiet = jax.tree.map(jnp.zeros_like, experiment.world.sample_noise(key, room))
    setup, loop, rows, loops = (
        experiment.loop_config,
        simulator.reset(experiment.loop_config, experiment.initial_state),
        [],
        [],
    )
    models = {one.start_tick: one.model for one in schedule}
    stops = sorted({*models, *map(int, nodes), *range(0, ticks, room), ticks})
    at = set(map(int, nodes))
    for first, end in zip(stops, [*stops[1:], ticks], strict=True):
        if first in models:
            setup = dataclasses.replace(
                setup, controller=dataclasses.replace(setup.controller, residual_model=models[first])
            )
        if first in at:
            loops.append(loop)
        if end > first:
            noise = quiet if seed is None else experiment.world.sample_noise(jax.random.fold_in(key, first), room)
            loop, flown = simulator.rollout(setup, loop, noise, jnp.asarray(end - first))
            rows.append(jax.tree.map(lambda x, n=end - first: np.asarray(x)[:n], flown))
        if int(loop.termination):
            cause = termination.TerminationCause(int(loop.termination)).name.lower().replace("_", " ")
            raise TerminatedEarly(f"the twin ended at t = {int(loop.tick) * experiment.dt:.3g} s: {cause}")
        signals.raise_if_interrupted()
    return jax.tree.map(lambda *x: np.concatenate(x), *rows), loops


def linearize_along(
    experiment: flight.Experiment, schedule: Sequence[ModelInterval], noisy: bool
) -> LinearizedTrajectory:
    """The variation along the flight of a plan, whose world is the twin's, under oracles as scheduled.

    noisy: whether covariances are asked for; else they are zero. Raises as `flown`.
    """
    ticks, stride = round(experiment.duration / experiment.dt), max(1, round(MAX_NODE_SPACING / experiment.dt))
    nodes = np.array(sorted({*range(0, ticks, stride), ticks - 1, *(one.start_tick for one in schedule)}))
    rows, loops = simulate_nominal(experiment, schedule, nodes)
    derivative = _Derivative(experiment, loops[0], noisy)
    setups = [
        dataclasses.replace(
            experiment.loop_config, controller=dataclasses.replace(experiment.controller, residual_model=o.model)
        )
        for o in schedule
    ]
    flies = np.searchsorted([one.start_tick for one in schedule], nodes, side="right") - 1
    J = [derivative.at(setups[which], loop) for which, loop in zip(flies, loops, strict=True)]
    n, m = derivative.states, derivative.inputs
    # before an update the derivative at its end is that of the oracle until then
    last = [
        then if flies[k + 1] == flies[k] else derivative.at(setups[flies[k]], loops[k + 1])
        for k, then in enumerate(J[1:])
    ]
    with threadpool_limits(1):  # the matrices are small
        strides = [
            _stride(first[:n], then[:n], int(end - start), n, m)
            for first, then, (start, end) in zip(J[:-1], last, itertools.pairwise(nodes), strict=True)
        ]
    A, B, N = map(np.stack, zip(*strides, strict=True))
    out = np.stack([j[n:] for j in J])
    return LinearizedTrajectory(
        model_schedule=tuple(schedule),
        records=rows,
        nodes=nodes,
        A=A,
        B=B,
        N=N,
        C=out[:, :, :n],
        D=out[:, :, n : n + m],
        N_y=(out[:, :, n + m :] ** 2).sum(2),
        outputs=derivative.outputs,
        bodies=linearization.body_columns(experiment.controller.team),
    )


def _stride(first: Matrix, last: Matrix, ticks: int, n: int, m: int) -> tuple[Matrix, Matrix, Matrix]:
    """`(A, (B, B'), N)` over some ticks, whose derivatives go straight from the first to the last."""
    A, B, N = np.eye(n), np.zeros((2, n, m)), np.zeros((n, n))
    for j in range(ticks):
        s = (j + 0.5) / ticks
        context = first + (j / ticks) * (last - first)
        step, push, noise = context[:, :n], context[:, n : n + m], context[:, n + m :]
        A, B = step @ A, step @ B
        if noise.size:
            N = step @ N @ step.T + noise @ noise.T
        B[0] += (1 - s) * push
        B[1] += s * push
    return A, B, N


class _Derivative:
    """Of one tick by the states that commands depend on, by an unknown force, and by the sensors' noise."""

    def __init__(self, experiment: flight.Experiment, loop: simulator.LoopState, noisy: bool) -> None:
        self.quiet = jax.tree.map(
            lambda x: jnp.zeros(x.shape[1:], x.dtype), experiment.world.sample_noise(jax.random.key(0), 1)
        )
        self.states, self.inputs, noise = _sizes(experiment.loop_config, loop, self.quiet)
        columns = jnp.eye(self.states + self.inputs + noise)
        self.columns = columns if noisy else columns[: self.states + self.inputs]
        named = jax.eval_shape(lambda: _outputs(experiment.loop_config, loop, self.quiet)[1])
        ends = itertools.pairwise(np.cumsum([0, *(x.size for x in named.values())]).tolist())
        self.outputs = {name: slice(*both) for name, both in zip(named, ends, strict=True)}

    def at(self, setup: simulator.LoopConfig, loop: simulator.LoopState) -> Matrix:
        """`(states + outputs, columns)`."""
        signals.raise_if_interrupted()
        return np.asarray(_columns(setup, loop, self.quiet, self.columns)).T


def _sizes(setup: simulator.LoopConfig, loop: simulator.LoopState, quiet: Any) -> tuple[int, int, int]:
    """Of states, unknown forces and noise."""
    size = lambda tree: sum(x.size for x in jax.tree.leaves(tree))  # noqa: E731
    return size(_moving(loop)), linearization.body_columns(setup.controller.team)[-1].stop, size(quiet.sensors)


def _column(setup: simulator.LoopConfig, loop: simulator.LoopState, quiet: Any, e: Array) -> Array:
    """The derivative of a tick along a direction, its outputs behind the states."""
    states, inputs, _ = _sizes(setup, loop, quiet)
    x, unravel = ravel_pytree(_moving(loop))
    _, unravel_noise = ravel_pytree(quiet.sensors)

    def tick(y: Array) -> Array:
        moved, f, n = jnp.split(y, [states, states + inputs])
        sources = setup.world.disturbances
        pushed = _Pushed(force=linearization.unflatten(setup.controller.team, f))
        sources = dataclasses.replace(sources, state_functions=(*sources.state_functions, pushed))
        world = dataclasses.replace(setup.world, disturbances=sources)
        drawn = dataclasses.replace(quiet, sensors=unravel_noise(n))
        then, out = _outputs(dataclasses.replace(setup, world=world), _with(loop, unravel(x + moved)), drawn)
        return jnp.concatenate([ravel_pytree(_moving(then))[0], *(out[name].reshape(-1) for name in sorted(out))])

    return jax.jvp(tick, (jnp.zeros_like(e),), (e,))[1]


_columns = jax.jit(jax.vmap(codegen.compile(_column), (None, None, None, 0)))


def _moving(loop: simulator.LoopState) -> Any:
    """What moves commands or plant, of a loop whose labels no frozen oracle hears."""
    world, seen = loop.world, loop.controller.estimator
    agents = tuple((one.base, one.bias, one.joint) for one in seen.agents)
    return world.state, world.applied_inputs, agents, seen.payload, seen.bias


def _with(loop: simulator.LoopState, moving: Any) -> simulator.LoopState:
    """The loop with other values of `_moving`."""
    z, applied, agents, load, bias = moving
    agents = tuple(
        dataclasses.replace(one, base=base, bias=b, joint=joint)
        for one, (base, b, joint) in zip(loop.controller.estimator.agents, agents, strict=True)
    )
    seen = dataclasses.replace(loop.controller.estimator, agents=agents, payload=load, bias=bias)
    return dataclasses.replace(
        loop,
        world=dataclasses.replace(loop.world, state=z, applied_inputs=applied),
        controller=dataclasses.replace(loop.controller, estimator=seen),
    )


def _outputs(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: Any
) -> tuple[simulator.LoopState, dict[str, Array]]:
    """The loop a tick later, and this tick's outputs: errors, thrusts, and what the maps of every body are of."""
    z = loop.world.state
    then, row = simulator.step(setup, loop, noise)
    bodies = {"payload": flatten_payload_state(z.payload, jnp.zeros(6))[:18]}
    agents = [x for group in z.agents for x in jax.vmap(flatten_agent_state)(group)]
    bodies |= {f"agent {j}": x for j, x in enumerate(agents)}
    errors = {"e_p": row.e_p, "e_v": row.e_v, "e_R": row.e_R, "e_omega": row.e_omega, "u": row.u}
    return then, errors | bodies


# What inputs make of outputs ------------------------------------------------------------------------------------------


def adjoint_weights(of: LinearizedTrajectory, rows: Nodes, at: Nodes) -> Matrix:
    """`L[t, row, k, input]`: what `f~` at node k adds to an output at node `at[t]`, by the adjoint; `at` ascends."""
    at = np.asarray(at)
    adjoint = of.C[at][:, rows]
    many, n, m = *adjoint.shape[1:], of.B.shape[3]
    L = np.zeros((len(at), many, len(of.nodes), m))
    for t, k in enumerate(at):
        L[t, :, k] = of.D[k, rows]
    ends = sorted({*range(0, int(at.max(initial=0)), CHUNK_NODES), *map(int, at)})
    for start, end in reversed(list(itertools.pairwise(ends))):
        later = slice(int(np.searchsorted(at, end)), None)
        flat, (A, B) = adjoint[later].reshape(-1, n), _carried(of, start, end)
        L[later, :, start : end + 1] += (flat @ B).reshape(-1, many, end - start + 1, m)
        adjoint[later] = (flat @ A).reshape(-1, many, n)
    return L


def _carried(of: LinearizedTrajectory, start: int, end: int) -> tuple[Matrix, Matrix]:
    """What the state at a node, and `f~` from there to another, make of the state at that: `x_end = A x + B f~`.

    B: (states, (end - start + 1) inputs).
    """
    n, m = of.B.shape[2:]
    A, B = np.eye(n), np.zeros((n, end - start + 1, m))
    for k in reversed(range(start, end)):
        B[:, k - start] += A @ of.B[k, 0]
        B[:, k - start + 1] += A @ of.B[k, 1]
        A = A @ of.A[k]
    return A, B.reshape(n, -1)


def noise_std(of: LinearizedTrajectory, rows: Nodes) -> Matrix:
    """`(nodes, rows)`, the standard deviation of outputs by the sensors' noise: `P_(k+1) = A P A^T + N`."""
    P, out = np.zeros_like(of.A[0]), np.empty((len(of.nodes), len(rows)))
    for k in range(len(out)):
        C = of.C[k, rows]
        out[k] = np.sqrt(np.maximum(((C @ P) * C).sum(1), 0) + of.N_y[k, rows])
        if k < len(of.A):
            P = of.A[k] @ P @ of.A[k].T + of.N[k]
    return out
