"""Closed loop linearized along the nominal trajectory, including sampling, hold, estimation and compensation.

A run with the same initial state differs from the nominal trajectory by the prediction error `f~` and by noise:

    x_(k+1) = A_k x_k + B_k f~(t_k) + B'_k f~(t_(k+1)) + n_k,    y_k = C_k x_k + D_k f~(t_k),    x_0 = 0

to first order. Node k is a tick of the simulation, and `f~` is linear between nodes. The states are those of plant and
estimator on which commands depend, in the coordinates of the records; an attitude is the nine entries of its matrix.
One forward-mode derivative of `simulator.step` is evaluated at every node.

See Also:
    docs/certificate.md: Derivation, "Closed loop linearized along the nominal trajectory".
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
from colift.models.state import ResidualForces, State, flatten_agent_state, flatten_payload_state
from colift.runtime import signals

Matrix = NDArray[np.float64]
Nodes = Sequence[int] | NDArray[np.integer]  # ticks at which the loop is linearized

MAX_NODE_SPACING = 0.04  # maximum time between nodes [s]
CHUNK_NODES = 16  # nodes per chunk of the adjoint recursion


class TerminatedEarly(ValueError):
    """Error raised if the nominal simulation reaches a termination limit."""


@dataclasses.dataclass(frozen=True)
class LinearizedTrajectory:
    """Deviation of runs from the nominal trajectory, to first order.

    Attributes:
        model_schedule: Residual models and their start ticks, those of the simulated run.
        records: Records of the nominal trajectory.
        nodes: Ticks of the nodes.
        A: State matrices, `(nodes - 1, states, states)`.
        B: Input matrices of both ends of an interval, `(nodes - 1, 2, states, inputs)`.
        N: Noise covariance added until the next node, `(nodes - 1, states, states)`.
        C: Output matrices, `(nodes, outputs, states)`.
        D: Feedthrough matrices, `(nodes, outputs, inputs)`.
        N_y: Variance of an output due to the noise of its own tick, `(nodes, outputs)`.
        outputs: Rows of C and D by name: errors, thrusts `u`, and the states of payload and agents.
        bodies: Input columns of the payload, then of each agent.
    """

    model_schedule: tuple[flight.ModelInterval, ...]
    records: StepRecord
    nodes: NDArray[np.intp]
    A: Matrix
    B: Matrix
    N: Matrix
    C: Matrix
    D: Matrix
    N_y: Matrix
    outputs: dict[str, slice]
    bodies: tuple[slice, ...]

    @property
    def t(self) -> Matrix:
        """Time of the nodes [s]."""
        return np.asarray(self.records.t, float)[self.nodes]

    def output_rows(self, *names: str) -> NDArray[np.intp]:
        """Return the rows of some outputs in C and D, in the given order.

        Args:
            *names: Names in `outputs`.

        Returns:
            Row indices.
        """
        return np.concatenate([np.arange(self.outputs[name].start, self.outputs[name].stop) for name in names])


@pytree
class _ConstantForce:
    """Residual force that is independent of the state."""

    force: ResidualForces

    def __call__(self, _z: State) -> ResidualForces:
        """Return the force."""
        return self.force


def simulate_nominal(
    experiment: flight.Experiment, schedule: Sequence[flight.ModelInterval], nodes: Nodes = (), seed: int | None = None
) -> tuple[StepRecord, list[simulator.LoopState]]:
    """Simulate without online learning; residual models are replaced as scheduled.

    Args:
        experiment: Experiment in the nominal world.
        schedule: Residual models and their start ticks.
        nodes: Ticks at which the closed-loop state is stored.
        seed: Seed of the sensor noise; None for no noise.

    Returns:
        Records of the run, and the closed-loop state at each node.

    Raises:
        TerminatedEarly: If the run reaches a termination limit.
    """
    ticks, chunk, key = (
        round(experiment.duration / experiment.dt),
        flight.ticks_per_chunk(experiment),
        jax.random.key(seed or 0),
    )
    no_noise = jax.tree.map(jnp.zeros_like, experiment.world.sample_noise(key, chunk))
    setup, loop, records, loops = (
        experiment.loop_config,
        simulator.reset(experiment.loop_config, experiment.initial_state),
        [],
        [],
    )
    models = {one.start_tick: one.model for one in schedule}
    stops = sorted({*models, *map(int, nodes), *range(0, ticks, chunk), ticks})
    at = set(map(int, nodes))
    for first, end in zip(stops, [*stops[1:], ticks], strict=True):
        if first in models:
            setup = dataclasses.replace(
                setup, controller=dataclasses.replace(setup.controller, residual_model=models[first])
            )
        if first in at:
            loops.append(loop)
        if end > first:
            noise = no_noise if seed is None else experiment.world.sample_noise(jax.random.fold_in(key, first), chunk)
            loop, step_records = simulator.rollout(setup, loop, noise, jnp.asarray(end - first))
            records.append(jax.tree.map(lambda x, n=end - first: np.asarray(x)[:n], step_records))
        if int(loop.termination):
            cause = termination.TerminationCause(int(loop.termination)).name.lower().replace("_", " ")
            raise TerminatedEarly(
                f"the nominal trajectory ended at t = {int(loop.tick) * experiment.dt:.3g} s: {cause}"
            )
        signals.raise_if_interrupted()
    return jax.tree.map(lambda *x: np.concatenate(x), *records), loops


def linearize_along(
    experiment: flight.Experiment, schedule: Sequence[flight.ModelInterval], with_noise: bool
) -> LinearizedTrajectory:
    """Linearize the closed loop along the run of an experiment, with residual models as scheduled.

    Errors are raised as by `simulate_nominal`.

    Args:
        experiment: Experiment in the nominal world.
        schedule: Residual models and their start ticks.
        with_noise: True to compute noise covariances; else they are zero.

    Returns:
        The linearized closed loop.
    """
    ticks, stride = round(experiment.duration / experiment.dt), max(1, round(MAX_NODE_SPACING / experiment.dt))
    nodes = np.array(sorted({*range(0, ticks, stride), ticks - 1, *(one.start_tick for one in schedule)}))
    records, loops = simulate_nominal(experiment, schedule, nodes)
    derivative = _StepDerivative(experiment, loops[0], with_noise)
    setups = [
        dataclasses.replace(
            experiment.loop_config, controller=dataclasses.replace(experiment.controller, residual_model=o.model)
        )
        for o in schedule
    ]
    active = np.searchsorted([one.start_tick for one in schedule], nodes, side="right") - 1
    J = [derivative.at(setups[which], loop) for which, loop in zip(active, loops, strict=True)]
    n, m = derivative.states, derivative.inputs
    # the derivative at the end of an interval uses the residual model of the interval
    last = [
        following if active[k + 1] == active[k] else derivative.at(setups[active[k]], loops[k + 1])
        for k, following in enumerate(J[1:])
    ]
    with threadpool_limits(1):  # the matrices are small
        strides = [
            _discretize(first[:n], following[:n], int(end - start), n, m)
            for first, following, (start, end) in zip(J[:-1], last, itertools.pairwise(nodes), strict=True)
        ]
    A, B, N = map(np.stack, zip(*strides, strict=True))
    out = np.stack([j[n:] for j in J])
    return LinearizedTrajectory(
        model_schedule=tuple(schedule),
        records=records,
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


def _discretize(first: Matrix, last: Matrix, ticks: int, n: int, m: int) -> tuple[Matrix, Matrix, Matrix]:
    """Compute `(A, (B, B'), N)` over some ticks; derivatives are interpolated between the first and the last tick."""
    A, B, N = np.eye(n), np.zeros((2, n, m)), np.zeros((n, n))
    for j in range(ticks):
        s = (j + 0.5) / ticks
        derivative = first + (j / ticks) * (last - first)
        step, input_matrix, noise = derivative[:, :n], derivative[:, n : n + m], derivative[:, n + m :]
        A, B = step @ A, step @ B
        if noise.size:
            N = step @ N @ step.T + noise @ noise.T
        B[0] += (1 - s) * input_matrix
        B[1] += s * input_matrix
    return A, B, N


class _StepDerivative:
    """Derivative of one step with respect to states, a constant residual and sensor noise."""

    def __init__(self, experiment: flight.Experiment, loop: simulator.LoopState, noisy: bool) -> None:
        """Determine the sizes of states, inputs and noise, and the rows of the outputs."""
        self.no_noise = jax.tree.map(
            lambda x: jnp.zeros(x.shape[1:], x.dtype), experiment.world.sample_noise(jax.random.key(0), 1)
        )
        self.states, self.inputs, noise = _sizes(experiment.loop_config, loop, self.no_noise)
        columns = jnp.eye(self.states + self.inputs + noise)
        self.columns = columns if noisy else columns[: self.states + self.inputs]
        named = jax.eval_shape(lambda: _outputs(experiment.loop_config, loop, self.no_noise)[1])
        ends = itertools.pairwise(np.cumsum([0, *(x.size for x in named.values())]).tolist())
        self.outputs = {name: slice(*both) for name, both in zip(named, ends, strict=True)}

    def at(self, setup: simulator.LoopConfig, loop: simulator.LoopState) -> Matrix:
        """Compute the derivative at a closed-loop state, `(states + outputs, columns)`."""
        signals.raise_if_interrupted()
        return np.asarray(_columns(setup, loop, self.no_noise, self.columns)).T


def _sizes(setup: simulator.LoopConfig, loop: simulator.LoopState, no_noise: Any) -> tuple[int, int, int]:
    """Return the number of states, residual components and noise components."""
    size = lambda tree: sum(x.size for x in jax.tree.leaves(tree))  # noqa: E731
    return size(_moving(loop)), linearization.body_columns(setup.controller.team)[-1].stop, size(no_noise.sensors)


def _column(setup: simulator.LoopConfig, loop: simulator.LoopState, no_noise: Any, e: Array) -> Array:
    """Compute the directional derivative of a step; the outputs follow the states."""
    states, inputs, _ = _sizes(setup, loop, no_noise)
    x, unravel = ravel_pytree(_moving(loop))
    _, unravel_noise = ravel_pytree(no_noise.sensors)

    def tick(y: Array) -> Array:
        moved, f, n = jnp.split(y, [states, states + inputs])
        sources = setup.world.disturbances
        constant_force = _ConstantForce(force=linearization.unflatten(setup.controller.team, f))
        sources = dataclasses.replace(sources, state_functions=(*sources.state_functions, constant_force))
        world = dataclasses.replace(setup.world, disturbances=sources)
        drawn = dataclasses.replace(no_noise, sensors=unravel_noise(n))
        next_loop, out = _outputs(dataclasses.replace(setup, world=world), _with(loop, unravel(x + moved)), drawn)
        return jnp.concatenate([ravel_pytree(_moving(next_loop))[0], *(out[name].reshape(-1) for name in sorted(out))])

    return jax.jvp(tick, (jnp.zeros_like(e),), (e,))[1]


_columns = jax.jit(jax.vmap(codegen.compile(_column), (None, None, None, 0)))


def _moving(loop: simulator.LoopState) -> Any:
    """Return the states on which commands or plant depend, for frozen residual models."""
    world, estimator = loop.world, loop.controller.estimator
    agents = tuple((one.base, one.bias, one.r, one.r_dot, one.encoder) for one in estimator.agents)
    return world.state, world.applied_inputs, agents, estimator.payload, estimator.bias


def _with(loop: simulator.LoopState, moving: Any) -> simulator.LoopState:
    """Replace the values of `_moving` in a closed-loop state."""
    z, applied, agents, payload, bias = moving
    agents = tuple(
        dataclasses.replace(one, base=base, bias=b, r=r, r_dot=r_dot, encoder=encoder)
        for one, (base, b, r, r_dot, encoder) in zip(loop.controller.estimator.agents, agents, strict=True)
    )
    estimator = dataclasses.replace(loop.controller.estimator, agents=agents, payload=payload, bias=bias)
    return dataclasses.replace(
        loop,
        world=dataclasses.replace(loop.world, state=z, applied_inputs=applied),
        controller=dataclasses.replace(loop.controller, estimator=estimator),
    )


def _outputs(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: Any
) -> tuple[simulator.LoopState, dict[str, Array]]:
    """Return the next closed-loop state and the outputs of this step: errors, thrusts and the states of all bodies."""
    z = loop.world.state
    next_loop, row = simulator.step(setup, loop, noise)
    bodies = {"payload": flatten_payload_state(z.payload, jnp.zeros(6))[:18]}
    agents = [x for group in z.agents for x in jax.vmap(flatten_agent_state)(group)]
    bodies |= {f"agent {j}": x for j, x in enumerate(agents)}
    errors = {"e_p": row.e_p, "e_v": row.e_v, "e_R": row.e_R, "e_omega": row.e_omega, "u": row.u}
    return next_loop, errors | bodies


# Effect of inputs and noise on outputs ------------------------------------------------------------------------------


def adjoint_weights(loop: LinearizedTrajectory, rows: Nodes, at: Nodes) -> Matrix:
    """Compute the weights of `f~` in each output by the adjoint recursion.

    Args:
        loop: Linearized closed loop.
        rows: Rows of the outputs.
        at: Nodes of the outputs, ascending.

    Returns:
        `L[t, row, k, input]`, the effect of `f~` at node k on an output at node `at[t]`.
    """
    at = np.asarray(at)
    adjoint = loop.C[at][:, rows]
    outputs, n, m = *adjoint.shape[1:], loop.B.shape[3]
    L = np.zeros((len(at), outputs, len(loop.nodes), m))
    for t, k in enumerate(at):
        L[t, :, k] = loop.D[k, rows]
    ends = sorted({*range(0, int(at.max(initial=0)), CHUNK_NODES), *map(int, at)})
    for start, end in reversed(list(itertools.pairwise(ends))):
        later = slice(int(np.searchsorted(at, end)), None)
        flat, (A, B) = adjoint[later].reshape(-1, n), _transition(loop, start, end)
        L[later, :, start : end + 1] += (flat @ B).reshape(-1, outputs, end - start + 1, m)
        adjoint[later] = (flat @ A).reshape(-1, outputs, n)
    return L


def _transition(loop: LinearizedTrajectory, start: int, end: int) -> tuple[Matrix, Matrix]:
    """Return A and B of `x_end = A x + B f~` between two nodes, with B `(states, (end - start + 1) inputs)`."""
    n, m = loop.B.shape[2:]
    A, B = np.eye(n), np.zeros((n, end - start + 1, m))
    for k in reversed(range(start, end)):
        B[:, k - start] += A @ loop.B[k, 0]
        B[:, k - start + 1] += A @ loop.B[k, 1]
        A = A @ loop.A[k]
    return A, B.reshape(n, -1)


def noise_std(loop: LinearizedTrajectory, rows: Nodes) -> Matrix:
    """Compute the standard deviation of outputs due to sensor noise, `P_(k+1) = A P A^T + N`.

    Args:
        loop: Linearized closed loop.
        rows: Rows of the outputs.

    Returns:
        `(nodes, rows)`, in the units of the outputs.
    """
    P, out = np.zeros_like(loop.A[0]), np.empty((len(loop.nodes), len(rows)))
    for k in range(len(out)):
        C = loop.C[k, rows]
        out[k] = np.sqrt(np.maximum(((C @ P) * C).sum(1), 0) + loop.N_y[k, rows])
        if k < len(loop.A):
            P = loop.A[k] @ P @ loop.A[k].T + loop.N[k]
    return out
