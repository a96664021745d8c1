"""Stability of the sampled closed loop at equilibrium: modes, and margins of delay and gain.

One control period of controller and plant, with filters and held commands, is a discrete-time map of the loop state.
The fixed point of the map is the equilibrium of the loop. The eigenvalues of the Jacobian there are the modes.

See Also:
    colift.closed_loop.linearization: linearization of the continuous loop without filters.
    docs/stability: definitions and measured results.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy import linalg
from threadpoolctl import threadpool_limits

from colift.analysis import characteristic_loci
from colift.closed_loop import flight, simulator
from colift.math import so3
from colift.math.linalg import matmul
from colift.models.state import State
from colift.onboard.control.constrained_allocation import ConstrainedAllocator
from colift.onboard.controller import LeaderFollowerController
from colift.onboard.estimation.state_estimator import ComplementaryFilter
from colift.onboard.learning import kalman_correction
from colift.runtime import signals
from colift.simulation import sensor_faults, sensors
from colift.simulation.world import SimulatedWorld, WorldNoise
from colift.trajectories.base import ReferenceTrajectory
from colift.trajectories.pose_spline import PiecewisePolynomial, PoseSpline, RotationLegs

MAX_NEWTON_ITERATIONS = 30  # about five are needed from level hover
SETTLING_TIME = 10.0  # s, simulated before a second attempt of Newton's method
EQUILIBRIUM_TOLERANCE = 1e-9  # largest change of the loop state in one tick, in SI units
DIFFERENCE_STEP = 1e-5  # of finite differences, in SI units; terms of fourth order are neglected
DEADBEAT_THRESHOLD = 0.01  # modes with a smaller |z| decay within one tick and are omitted
MAX_START_RATE = 1e-6  # m/s, rad/s and their rates per second; a reference with smaller ones starts at rest
MARGINAL_THRESHOLD = 1e-6  # rad/s, rounding error of a rate: that of |z| divided by the control period


# Paths of loop states in `simulator.LoopState`, as regular expressions
POSE = r"\.world\.state\.(payload\.[Rp]|agents\[\d+\]\.[Rxr])"
LEARNING_STATES = (
    r"\.recorder\.|\.estimator\.(agents\[\d+\]\.)?bias\b"
    r"|\.(estimator|corrector)\.time_since_label$|\.initialized$|\.controller\.last_f_hat\b"
    r"|\.estimator\.(clocks|tips)\b"
)
WARM_STARTS = r"\.allocator\.(projected|multipliers)$"  # without influence on a solution to rounding accuracy
SECOND_ORDER_STATES = (  # quadratic in the deviation from the equilibrium
    r"\.corrector\.(P\[|P_label|noise\[[1-3]\]|error_ms|rate_ms|label_noise)"
)
COMMAND = r"\.controller\.last_command\[\d+\]\..*"  # path of the last command in the loop state
SENSORS = r"\.sensors\[\d+\]\.(age|next_sample_time|bias)\b"  # sensor clocks and drifts are held with the loop's clock
LABEL_FILTERS = (
    r"\.estimator\.(agents\[\d+\]\.)?(label|inputs|contact_forces)\b"
    r"|\.estimator\.payload_filter\.(last_inputs|input_errors)\b"
)
"""Paths of the states of the label filters."""
LABELS = (
    rf"{LABEL_FILTERS}|\.estimator\.(agents\[\d+\]\.)?(momenta|com_velocity_offset|modelled_force|modelled_wrench)\b"
)
"""Paths of the states of labels."""


@dataclasses.dataclass(frozen=True)
class Modes:
    """Modes of the sampled loop at equilibrium, slowest first, with eigenvalues `log(z) / dt` and mode shapes.

    Amplitudes are relative to the largest pose amplitude of the mode.
    """

    eigenvalues: np.ndarray  # (modes,) rad/s
    payload: np.ndarray  # (modes, 6) amplitudes of the payload's (theta, p)
    attitude: np.ndarray  # (modes, agents, 3) amplitudes of the agents' rotation vectors, body frame
    joints: np.ndarray  # (modes, joints) amplitudes of the joints, in team order
    names: tuple[str, ...] = ("theta_x", "theta_y", "theta_z", "p_x", "p_y", "p_z")  # of the amplitudes in `payload`

    @property
    def stable(self) -> bool:
        """True if every mode decays."""
        return bool(self.eigenvalues[0].real < -MARGINAL_THRESHOLD)

    @property
    def slowest_eigenvalue(self) -> tuple[float, float]:
        """Real and imaginary part of the slowest eigenvalue [rad/s]."""
        return float(self.eigenvalues[0].real), float(self.eigenvalues[0].imag)

    def describe_slowest(self) -> str:
        """Describe the slowest mode: its eigenvalue and its largest amplitude."""
        value, shape = self.eigenvalues[0], self.payload[0]
        largest = self.names[int(np.argmax(shape))] if shape.max() > 0.05 else "the agents' attitudes and joints"
        return f"{value.real:+.2f} {abs(value.imag):+.2f}i rad/s, largest in {largest}"


CommandLoop = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Matrices `(A, B, K)` of a loop `x+ = A x + B u` with the commands `u = K x`."""
LoopStateTree = dict[str, Array]
"""Loop states that influence the plant in later ticks, by their path in `simulator.LoopState`."""


def modes_at_equilibrium(experiment: flight.Experiment, state: State) -> Modes:
    """Compute the modes of an experiment's loop at the equilibrium near a state."""
    return compute_modes(*equilibrium_and_jacobian(experiment, state), experiment.dt)


def compute_modes(x: LoopStateTree, M: np.ndarray, dt: float) -> Modes:
    """Compute the modes of a loop from its Jacobian.

    Args:
        x: Equilibrium of the loop.
        M: Jacobian of one tick at x.
        dt: Control period [s].

    Returns:
        The modes, slowest first.
    """
    values, vectors = np.linalg.eig(M)
    order = np.argsort(-np.abs(values))
    order = order[np.abs(values[order]) > DEADBEAT_THRESHOLD]
    shapes = np.abs(vectors[:, order])
    shapes = shapes / np.maximum(shapes[_rows_of(x, POSE)].max(0), np.finfo(float).tiny)
    return Modes(
        eigenvalues=np.log(values[order].astype(complex)) / dt,
        payload=shapes[np.concatenate([_rows_of(x, rf"\.world\.state\.payload\.{part}") for part in "Rp"])].T,
        attitude=shapes[_rows_of(x, r"\.world\.state\.agents\[\d+\]\.R")].T.reshape(len(order), -1, 3),
        joints=shapes[_rows_of(x, r"\.world\.state\.agents\[\d+\]\.r")].T,
    )


def delay_margin(x: LoopStateTree, M: np.ndarray, max_ticks: int) -> int:
    """Compute the delay margin in whole ticks.

    The controller state influences the world only through the commands, so M determines the input matrix B:
    `M[world, controller] = B K`, with K the rows of the applied command.

    A ValueError is raised if the controller state does not determine every command independently.

    Args:
        x: Equilibrium of the loop.
        M: Jacobian of one tick at x.
        max_ticks: Largest delay that is considered, in ticks.

    Returns:
        Largest additional delay of all commands for which the loop is stable, at most `max_ticks`; -1 if the loop is
        unstable without delay.
    """
    with threadpool_limits(1):  # the matrices are small
        return _delay_margin(_command_loop(x, M), max_ticks)


def _delay_margin(loop: CommandLoop | None, max_ticks: int) -> int:
    """Compute `delay_margin` from the loop; None stands for an unstable one."""
    if loop is None:
        return -1
    limit = characteristic_loci.delay_margin(*loop)
    return max_ticks if limit > max_ticks else max(math.ceil(limit) - 1, 0)


def _command_loop(x: LoopStateTree, M: np.ndarray) -> CommandLoop | None:
    """Return the loop of the states that influence the commands; None if the whole loop is unstable.

    The eigenvalues of the other states are the same with every gain and delay of the commands.
    """
    B, K = _input_matrices(x, M)
    if np.abs(np.linalg.eigvals(M)).max() >= 1:
        return None
    A = M - B @ K
    rows = _observable(A, K)
    return A[np.ix_(rows, rows)], B[rows], K[:, rows]


def _observable(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return the indices of the states of `x+ = A x` that influence the outputs C x, now or later."""
    found = (C != 0).any(0)
    while (more := found | (A[found] != 0).any(0)).sum() > found.sum():
        found = more
    return np.flatnonzero(found)


MAX_GAIN = 4.0  # largest gain that is tested; the smallest is its inverse


def gain_margin(x: LoopStateTree, M: np.ndarray) -> tuple[float, float]:
    """Compute the range of a common gain of all commands for which the loop is stable.

    The loop with gain g is `x+ = (M + (g - 1) B K) x`. The limits are computed to 1 %, within `1 / MAX_GAIN` and
    `MAX_GAIN`. Raises a ValueError as `delay_margin`.

    Args:
        x: Equilibrium of the loop.
        M: Jacobian of one tick at x.

    Returns:
        Smallest and largest gain; NaN if the loop is unstable with gain 1.
    """
    with threadpool_limits(1):  # the matrices are small
        return _gain_margin(_command_loop(x, M))


def _gain_margin(loop: CommandLoop | None) -> tuple[float, float]:
    """Compute `gain_margin` from the loop; None stands for an unstable one."""
    if loop is None:
        return np.nan, np.nan
    A, B, K = loop
    return _gain_limit(A, B @ K, MAX_GAIN**-0.25), _gain_limit(A, B @ K, MAX_GAIN**0.25)


def _gain_limit(A: np.ndarray, BK: np.ndarray, step: float) -> float:
    """Return the last stable gain of `x+ = (A + g BK) x` from 1 to `step**4`, to 1 %."""

    def stable(g: float) -> bool:
        return bool(np.abs(np.linalg.eigvals(A + g * BK)).max() < 1)

    stable_gain, unstable_gain = 1.0, step
    for _ in range(4):
        if not stable(unstable_gain):
            break
        stable_gain, unstable_gain = unstable_gain, unstable_gain * step
    else:
        return stable_gain
    while abs(np.log(unstable_gain / stable_gain)) > 0.01:
        middle = float(np.sqrt(stable_gain * unstable_gain))
        stable_gain, unstable_gain = (middle, unstable_gain) if stable(middle) else (stable_gain, middle)
    return stable_gain


@dataclasses.dataclass(frozen=True)
class Margins:
    """Delay and gain margin of the loop at equilibrium, for all commands alike."""

    delay_margin: float  # s, largest additional delay
    gain_margin: tuple[float, float]  # smallest and largest gain
    max_delay_tested: float  # s

    def describe(self) -> str:
        """Describe both margins in a sentence."""
        delay = f"{1e3 * self.delay_margin:.3g} ms" + (" or more" if self.delay_margin >= self.max_delay_tested else "")
        return f"delay margin {delay}, gain margin {format_gain_margin(self.gain_margin)}"


def format_gain_margin(gain: tuple[float, float]) -> str:
    """Format a gain margin as a range."""
    smallest, largest = gain
    low = f"{smallest:.2g}" + (" or less" if smallest <= 1.001 / MAX_GAIN else "")
    high = f"{largest:.3g}" + (" or more" if largest >= MAX_GAIN / 1.001 else "")
    return f"{low} to {high}"


MAX_DELAY = 0.05  # s, largest delay that is tested


def stability_margins(x: LoopStateTree, M: np.ndarray, dt: float) -> Margins:
    """Compute delay and gain margin; raises a ValueError as `delay_margin`.

    Args:
        x: Equilibrium of the loop.
        M: Jacobian of one tick at x.
        dt: Control period [s].

    Returns:
        Both margins.
    """
    max_ticks = round(MAX_DELAY / dt)
    with threadpool_limits(1):  # the matrices are small
        loop = _command_loop(x, M)
        return Margins(
            delay_margin=_delay_margin(loop, max_ticks) * dt,
            gain_margin=_gain_margin(loop),
            max_delay_tested=max_ticks * dt,
        )


def with_input_delay(x: LoopStateTree, M: np.ndarray, ticks: int) -> np.ndarray:
    """Return the Jacobian of the loop with commands delayed by whole ticks; raises a ValueError as `delay_margin`."""
    return _append_delay(M, *_input_matrices(x, M), ticks)


NEGLIGIBLE_SENSITIVITY = 1e-7  # relative to the largest sensitivity of the commands to a state


def _input_matrices(x: LoopStateTree, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the input matrix B of the commands, and the rows K of M that compute the commands.

    Args:
        x: Equilibrium of the loop.
        M: Jacobian of one tick at x.

    Returns:
        `(B, K)`.

    Raises:
        ValueError: If the controller state does not determine every command independently.
    """
    command, world = _rows_of(x, COMMAND), _rows_of(x, r"\.world\..*")
    state, K = np.setdiff1d(np.arange(len(M)), world), M[command]
    # M is accurate to about 1e-10; a command that hardly any state changes, such as a squeeze force, has no column in B
    inverse = np.linalg.pinv(K[:, state], rcond=NEGLIGIBLE_SENSITIVITY)
    if np.linalg.norm(K - K[:, state] @ (inverse @ K), 2) > 10 * NEGLIGIBLE_SENSITIVITY * np.linalg.norm(K, 2):
        raise ValueError("the controller state does not determine every command independently")
    B = np.zeros((len(M), len(command)))
    B[world] = M[np.ix_(world, state)] @ inverse
    return B, K


def _append_delay(M: np.ndarray, B: np.ndarray, K: np.ndarray, ticks: int) -> np.ndarray:
    """Append a queue of commands: `x+ = (M - B K) x + B u_1`, `u_k+ = u_(k+1)`, and `K x` as the last element."""
    if ticks == 0:
        return M
    n, m = B.shape
    extended = np.eye(n + m * ticks, k=m)
    extended[:n] = 0.0
    extended[:n, :n], extended[:n, n : n + m], extended[-m:, :n] = M - B @ K, B, K
    return extended


def _rows_of(x: LoopStateTree, pattern: str) -> np.ndarray:
    """Return the coordinates of the loop states whose path matches a regular expression."""
    indices = _unravel(x, np.arange(sum(math.prod(shape) for _, shape in _shapes(x))))
    return np.concatenate([indices[key].ravel() for key in sorted(indices) if re.fullmatch(pattern, key)])


def equilibrium_and_jacobian(experiment: flight.Experiment, state: State) -> tuple[LoopStateTree, np.ndarray]:
    """Compute the equilibrium of the loop near a state and the Jacobian of one tick there, on the host.

    The reference is held at its first pose, at rest. Plant parameters are the true ones, controller parameters the
    nominal ones. Sensors are exact and sampled at every tick, and there are no disturbances. The equilibrium can
    therefore differ from the reference, for example for a payload that is heavier than its nominal model. Newton's
    method solves `x = map(x)`; its Jacobian is recomputed only if an iteration reduces the residual by less than a
    factor of 10.
    Finite differences use the compiled `simulator.rollout`, so no additional program is compiled. If Newton's method
    fails, it is restarted from the loop state after a simulation of `SETTLING_TIME`.

    Args:
        experiment: Definition of the flight.
        state: Initial guess of the team state.

    Returns:
        The equilibrium and the Jacobian.

    Raises:
        ValueError: If no equilibrium is found near the state.
    """
    setup, loop, noise = _undisturbed_loop(experiment, state)
    result = _newton_equilibrium(setup, loop, noise) or _newton_equilibrium(
        setup, _simulate_settling(setup, loop, noise), noise
    )
    if result is None:
        raise ValueError("the loop has no equilibrium near the start of its reference")
    return result


def _newton_equilibrium(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise
) -> tuple[LoopStateTree, np.ndarray] | None:
    """Find equilibrium and Jacobian by Newton's method from a loop state; None if it does not converge."""
    jacobian, previous = None, np.inf
    for _ in range(MAX_NEWTON_ITERATIONS):
        signals.raise_if_interrupted()
        residual = _residual(setup, loop, noise)
        if np.abs(residual).max() <= EQUILIBRIUM_TOLERANCE:
            return _select_states(loop), _finite_difference_jacobian(setup, loop, noise)
        if not np.isfinite(residual).all():
            break
        if jacobian is None or np.abs(residual).max() > previous / 10:
            displaced = _evaluate_around(setup, loop, noise, 1)
            jacobian = (displaced - residual).T / DIFFERENCE_STEP  # first order in the step suffices for the search
        if not np.isfinite(jacobian).all():
            break
        previous = np.abs(residual).max()
        step = np.linalg.lstsq(np.eye(len(residual)) - jacobian, residual)[0]
        moved = _displace(_select_states(loop), step[None])
        loop = _insert_states(loop, {key: jax.device_put(np.asarray(leaf)[0]) for key, leaf in moved.items()})
    return None


def _simulate_settling(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise
) -> simulator.LoopState:
    """Simulate for `SETTLING_TIME`; resetting the clock every 0.05 s holds the reference near its start."""
    ticks = max(1, round(0.05 / float(setup.dt)))
    for _ in range(round(SETTLING_TIME / float(setup.dt)) // ticks):
        end, _ = simulator.rollout(setup, loop, noise, jnp.asarray(ticks))
        loop = dataclasses.replace(end, tick=loop.tick, termination=loop.termination)
    return loop


def _undisturbed_loop(
    experiment: flight.Experiment, state: State
) -> tuple[simulator.LoopConfig, simulator.LoopState, WorldNoise]:
    """Return configuration, state and noise of the loop without disturbances and limits, with the clock at zero.

    The state is taken after one tick and as many further ticks as the largest sensor delay. Kalman filters of a
    residual corrector have their steady-state covariances: those of the least label noise, as sensors are exact. An
    allocator with limits iterates to rounding accuracy. Agents are healthy, and the leader's commands arrive at once.
    """
    if isinstance(allocator := getattr(experiment.controller, "allocator", None), ConstrainedAllocator):
        exact = dataclasses.replace(experiment.controller, allocator=allocator.converged())
        experiment = dataclasses.replace(experiment, controller=exact)
    if isinstance(onboard := experiment.controller, LeaderFollowerController):
        healthy = dataclasses.replace(onboard, command_link=None, effectiveness_filter=None, contact_monitor=None)
        if isinstance(healthy.estimator, ComplementaryFilter):  # exact readings can repeat
            estimator = dataclasses.replace(healthy.estimator, detects_tip_failures=False)
            healthy = dataclasses.replace(healthy, estimator=estimator)
        at_rest = _pose_at_rest(onboard.reference)
        experiment = dataclasses.replace(experiment, controller=dataclasses.replace(healthy, reference=at_rest))
    experiment = dataclasses.replace(experiment, world=_without_disturbances(experiment.world))
    ticks = flight.ticks_per_chunk(experiment)
    drawn = jax.eval_shape(lambda world, key: world.sample_noise(key, ticks), experiment.world, jax.random.key(0))
    noise = jax.tree.map(_zeros_like, drawn)
    start = simulator.reset(experiment.loop_config, state)
    max_delay = max(
        (sensor.delay for sensor in experiment.world.sensor_models if isinstance(sensor, sensors.Intermittent)),
        default=0,
    )
    end, _ = simulator.rollout(experiment.loop_config, start, noise, jnp.asarray(1 + max_delay))
    corrector = getattr(end.controller, "corrector", None)
    filter_ = getattr(experiment.controller, "residual_corrector", None)
    if isinstance(filter_, kalman_correction.ResidualKalmanFilter):
        corrector = filter_.steady_state(corrector, experiment.loop_config.dt)
        end = dataclasses.replace(end, controller=dataclasses.replace(end.controller, corrector=corrector))
    return experiment.loop_config, dataclasses.replace(end, tick=start.tick, termination=start.termination), noise


def _pose_at_rest(reference: ReferenceTrajectory) -> ReferenceTrajectory:
    """Return the first pose of a reference that starts in motion, at rest; a loop in motion has no equilibrium."""
    d = reference.evaluate(jnp.zeros(()))
    if max(float(jnp.abs(rate).max()) for rate in (d.v, d.a, d.omega, d.omega_dot)) <= MAX_START_RATE:
        return reference
    knots, constant = jnp.array([0.0, 1.0]), jnp.zeros((1, 8, 3))
    return PoseSpline(
        position=PiecewisePolynomial(knots=knots, coefficients=constant.at[0, 0].set(d.p)),
        attitude=RotationLegs(phi=PiecewisePolynomial(knots=knots, coefficients=constant), R=d.R[None]),
    )


def predict_growth_rate(
    experiment: flight.Experiment, state: State, x: LoopStateTree, M: np.ndarray, mode: int = 0
) -> float:
    """Predict the growth rate of a mode of an experiment near a known equilibrium, to first order.

    The derivative is `z' = w^H M' v`, with right and left eigenvectors v and w normalized to `w^H v = 1`. It requires
    four ticks instead of the hundreds for all of M'.

    Args:
        experiment: Changed experiment.
        state: Initial guess of its team state.
        x: Equilibrium of the original loop.
        M: Jacobian of the original loop at x.
        mode: Index of the mode, 0 for the slowest one.

    Returns:
        The growth rate [1/s].
    """
    values, left, right = linalg.eig(M, left=True)
    k = np.argsort(-np.abs(values))[mode]
    v, w = right[:, k], left[:, k].conj()
    derivative = directional_derivative(experiment, state, x, v)
    return float(np.log(np.abs(w @ derivative / (w @ v))) / experiment.dt)


def directional_derivative(experiment: flight.Experiment, state: State, x: LoopStateTree, v: np.ndarray) -> np.ndarray:
    """Compute `M' v`, the change of a loop state by one tick of a changed loop, from four ticks.

    Args:
        experiment: Changed experiment.
        state: Initial guess of its team state.
        x: Equilibrium of the original loop.
        v: Complex direction in the coordinates of x.

    Returns:
        The complex product.
    """
    setup, loop, noise = _undisturbed_loop(experiment, state)
    loop = _insert_states(loop, x)
    parts = np.stack([v.real, v.imag])
    displaced = _displace(x, jnp.asarray(DIFFERENCE_STEP * np.concatenate([parts, -parts])))
    changed = _after_one_tick(setup, loop, noise, displaced)
    derivative = (changed[:2] - changed[2:]) / (2 * DIFFERENCE_STEP)
    return derivative[0] + 1j * derivative[1]


@dataclasses.dataclass(frozen=True)
class VariedLoop:
    """Fastest growing mode of a loop with a common gain of all commands, or with delayed commands."""

    gain: float  # common gain of all commands
    ticks: int  # delay
    growth: float  # 1/s
    dt: float  # s, control period
    right: np.ndarray  # eigenvector; the elements after those of the loop are the queue of commands
    left: np.ndarray  # with `left @ right = 1`
    B: np.ndarray  # input matrix of the commands
    command: np.ndarray  # rows of the applied command

    def predict_growth(self, Mv: np.ndarray) -> float:
        """Predict the growth rate of the mode for other controller gains, to first order.

        Args:
            Mv: Product of the changed Jacobian and the loop part of the eigenvector (`directional_derivative`).

        Returns:
            Growth rate [1/s].
        """
        n, m = self.B.shape
        commands, queue = Mv[self.command], self.right[n:]
        if self.ticks == 0:
            after = Mv + (self.gain - 1) * self.B @ commands
        else:
            after = np.concatenate([Mv - self.B @ commands + self.B @ queue[:m], queue[m:], commands])
        return float(np.log(np.abs(self.left @ after)) / self.dt)


def vary_loop(x: LoopStateTree, M: np.ndarray, dt: float, gain: float = 1.0, ticks: int = 0) -> VariedLoop:
    """Compute the fastest growing mode with another gain of all commands, or with delayed commands.

    Args:
        x: Equilibrium of the loop.
        M: Jacobian of one tick at x.
        dt: Control period [s].
        gain: Common gain of all commands; 1 with a delay.
        ticks: Delay of all commands.

    Returns:
        The mode; errors are raised as by `delay_margin`.
    """
    B, K = _input_matrices(x, M)
    values, left, right = linalg.eig(_append_delay(M + (gain - 1) * B @ K, B, K, ticks), left=True)
    k = int(np.argmax(np.abs(values)))
    v, w = right[:, k], left[:, k].conj()
    command = _rows_of(x, COMMAND)
    return VariedLoop(gain, ticks, float(np.log(np.abs(values[k])) / dt), dt, v, w / (w @ v), B, command)


def rest_displacement(
    experiment: flight.Experiment, state: State, x: LoopStateTree, M: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute how far the disturbances of an experiment move the payload at rest, to first order.

    `d = (I - M)^-1 (f(x) - x)` with one tick f of the loop with the disturbances at time zero.

    Args:
        experiment: Experiment with its disturbances.
        state: Initial guess of its team state.
        x: Equilibrium of the loop without disturbances.
        M: Jacobian of one tick at x.

    Returns:
        Displacement [m, world] and rotation vector [rad, payload frame] of the payload.
    """
    setup, loop, noise = _undisturbed_loop(experiment, state)
    world = dataclasses.replace(setup.world, disturbance_scale=experiment.world.disturbance_scale)
    disturbed = dataclasses.replace(setup, world=world)
    residual = _residual(disturbed, _insert_states(loop, x), noise)
    moved = np.linalg.lstsq(np.eye(len(M)) - M, residual)[0]
    return tuple(moved[_rows_of(x, rf"\.world\.state\.payload\.{part}")] for part in "pR")


def step_jacobian(experiment: flight.Experiment, state: State, x: LoopStateTree) -> np.ndarray:
    """Compute the Jacobian of one tick of an experiment at the equilibrium x of a similar loop.

    Args:
        experiment: Changed experiment.
        state: Initial guess of its team state.
        x: Equilibrium of a similar loop.

    Returns:
        The Jacobian.
    """
    setup, loop, noise = _undisturbed_loop(experiment, state)
    return _finite_difference_jacobian(setup, _insert_states(loop, x), noise)


def _finite_difference_jacobian(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise
) -> np.ndarray:
    """Compute the Jacobian of one tick by `(8 (f_1 - f_-1) - (f_2 - f_-2)) / (12 h)`, with f_k at k steps h."""
    forward, backward, forward_2, backward_2 = (_evaluate_around(setup, loop, noise, k) for k in (1, -1, 2, -2))
    return ((8 * (forward - backward) - (forward_2 - backward_2)) / (12 * DIFFERENCE_STEP)).T


def _evaluate_around(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise, steps: int
) -> np.ndarray:
    """Evaluate one tick with each coordinate in turn displaced by multiples of `DIFFERENCE_STEP`, one row each."""
    x = _select_states(loop)
    n = sum(math.prod(shape) for _, shape in _shapes(x))
    return _after_one_tick(setup, loop, noise, _displace(x, DIFFERENCE_STEP * steps * np.eye(n)))


def _after_one_tick(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise, points: LoopStateTree
) -> np.ndarray:
    """Return the states one tick after each of the given ones, in coordinates around the present state of the loop."""
    return np.asarray(_coordinates(_select_states(loop), _map_one_tick(setup, loop, noise, points)))


@jax.jit
def _map_one_tick(
    setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise, points: LoopStateTree
) -> LoopStateTree:
    """Return the states one tick after each of the given ones."""

    def advance(point: LoopStateTree) -> LoopStateTree:
        end, _ = simulator.rollout(setup, _insert_states(loop, point), noise, jnp.asarray(1))
        after = dict(_leaves(end))
        return {key: after[key] for key in point}

    return jax.lax.map(advance, points)


def _residual(setup: simulator.LoopConfig, loop: simulator.LoopState, noise: WorldNoise) -> np.ndarray:
    """Return the change of the loop state by one tick, in coordinates around the present one."""
    x, end = _select_states(loop), dict(_leaves(simulator.rollout(setup, loop, noise, jnp.asarray(1))[0]))
    return np.asarray(_coordinates(x, {key: np.asarray(end[key])[None] for key in x}))[0]


def _without_disturbances(world: SimulatedWorld) -> SimulatedWorld:
    """Return the world without disturbances and faults, and with ideal sensors sampled at every tick."""
    zero_noise = jax.tree.map(_zeros_like, world.sensors)
    return dataclasses.replace(
        world,
        disturbance_scale=_zeros_like(world.disturbance_scale),
        sensors=dataclasses.replace(zero_noise, tip_force_bandwidth=world.sensors.tip_force_bandwidth),
        tip_force_bias=jax.tree.map(_zeros_like, world.tip_force_bias),
        sensor_models=tuple(map(_ideal_sensor, world.sensor_models)),
        faults=None,
    )


def _zeros_like(x: jax.Array | jax.ShapeDtypeStruct) -> jax.Array:
    """Return zeros from the host, without a program for each shape."""
    return jax.device_put(np.zeros(x.shape, x.dtype))


def _ideal_sensor(sensor: sensors.SensorModel) -> sensors.SensorModel:
    """Return a sensor without dropouts and drift, sampled at every tick, because the clock of the loop is held."""
    zero = jnp.zeros(())
    match sensor:
        case sensors.Intermittent():
            return dataclasses.replace(
                sensor, sample_period=zero, dropout_probability=zero, failure_time=jnp.full((), jnp.inf)
            )
        case sensor_faults.ReadingFault():
            return dataclasses.replace(sensor, start=jnp.full((), jnp.inf))
        case sensors.BiasRandomWalk():
            return dataclasses.replace(sensor, random_walk_density=zero, initial_bias_std=zero)
        case _:
            return sensor


# Local coordinates: rotation vectors in the body frame for attitudes, differences for all other states ----------------


def _shapes(x: LoopStateTree) -> list[tuple[bool, tuple[int, ...]]]:
    """Return for every leaf whether it is an attitude, and the shape of its coordinates."""
    leaves = [(key.endswith(".R"), x[key].shape) for key in sorted(x)]
    return [(attitude, shape[:-1] if attitude else shape) for attitude, shape in leaves]


def _unravel(x: LoopStateTree, d: Any) -> dict[str, Any]:
    """Split a row of coordinates into the leaves that they change."""
    shapes = [shape for _, shape in _shapes(x)]
    ends = np.cumsum([0] + [math.prod(shape) for shape in shapes])
    parts = [d[a:b].reshape(shape) for (a, b), shape in zip(itertools.pairwise(ends), shapes, strict=True)]
    return jax.tree.unflatten(jax.tree.structure(x), parts)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _displace(x: LoopStateTree, d: Array) -> LoopStateTree:
    """Apply rows of local coordinates to a state; attitudes by `R exp(theta)`."""
    is_attitude = jax.tree.unflatten(jax.tree.structure(x), [attitude for attitude, _ in _shapes(x)])
    return jax.tree.map(
        lambda attitude, a, b: matmul(a, so3.exp(b)) if attitude else a + b, is_attitude, x, _unravel(x, d)
    )


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _coordinates(x: LoopStateTree, y: LoopStateTree) -> Array:
    """Return local coordinates of y around x, to first order."""
    pairs = zip(_shapes(x), jax.tree.leaves(x), jax.tree.leaves(y), strict=True)
    parts = [so3.vee(matmul(jnp.swapaxes(a, -1, -2), b)) if attitude else b - a for (attitude, _), a, b in pairs]
    return jnp.concatenate([part.ravel() for part in parts])


# States that one tick passes to the next ------------------------------------------------------------------------------


def _select_states(loop: simulator.LoopState) -> LoopStateTree:
    """Select the states that influence the plant in later ticks.

    Recorded data are excluded, with the label filters of training samples. Labels are excluded without a residual
    corrector. The residuals compensated in the last period act only without tip readings; sensors are exact here.
    Warm starts of an allocation within limits are excluded: its multipliers need not be unique, so they may persist.

    Args:
        loop: Loop state.

    Returns:
        The floating-point leaves by path.
    """
    unused = LABELS if getattr(loop.controller, "corrector", None) is None else LABEL_FILTERS
    excluded = "|".join((LEARNING_STATES, SENSORS, WARM_STARTS, SECOND_ORDER_STATES, unused))
    return {
        key: leaf
        for key, leaf in _leaves(loop)
        if jnp.issubdtype(leaf.dtype, jnp.floating) and not re.search(excluded, key)
    }


def _insert_states(loop: simulator.LoopState, x: LoopStateTree) -> simulator.LoopState:
    """Replace the selected states of a loop."""
    return jax.tree.unflatten(jax.tree.structure(loop), [x.get(key, leaf) for key, leaf in _leaves(loop)])


def _leaves(loop: simulator.LoopState) -> list[tuple[str, Array]]:
    """Return all leaves of a loop with their paths."""
    return [(jax.tree_util.keystr(path), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(loop)]
