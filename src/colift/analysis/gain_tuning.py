"""Gain tuning by gradients of the closed-loop modes and of the tracking error in simulation.

First, sequential linear programs within a trust region maximize the decay rate of the slowest mode, with and without a
delay of the commands. The eigenvalues of the sampled loop (`stability.step_jacobian`) have derivatives with respect to
the gains. From there, the same method minimizes the displacement of the contacts in a simulated flight without
learning, divided by the decay rate.

See Also:
    colift.analysis.stability: modes and margins of the sampled loop.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from scipy import linalg
from scipy.optimize import linprog

from colift.analysis import loop_checks, metrics, stability
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.models import grasp
from colift.models.state import State
from colift.scenario import Scenario, ScenarioError, experiment, initial_states, parse, termination, with_control
from colift.scenario import to_yaml as every_setting
from colift.simulation import disturbances

GAINS = ("K_p", "K_v", "k_R", "k_omega", "agent_k_R", "agent_k_omega", "posture_bandwidth")
"""Settings of `control` that are tuned."""
# Exponents of the gains in the tuned parameters: frequency w and damping d of payload position, payload attitude and
# agent attitudes, and the posture bandwidth; for example `K_p = w^2`, `K_v = 2 d w`. A change of the frequency moves
# both poles of a pair alike, also where they coincide.
TUNED_GAINS = np.array([
    [2, 0, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0, 0],
    [0, 0, 0, 0, 2, 0, 0], [0, 0, 0, 0, 1, 1, 0], [0, 0, 0, 0, 0, 0, 1],
])  # fmt: skip
DAMPING = np.array([False, True] * 3 + [False])  # whether a tuned parameter is a damping
DESIGN_DELAY = 0.004  # s, twice the delay margin that the preflight check requires
MAX_GAIN_RATIO = math.log(2)  # largest change of a tuned parameter, as a logarithm
DIFFERENCE_STEP = 1e-3  # of a logarithm, for finite differences of Jacobians with an accuracy of about 1e-10
INITIAL_TRUST_REGION, MIN_TRUST_REGION = 0.3, 0.03  # initial and final trust region, as logarithms
MAX_LINEARIZATIONS = 80  # budget of the first stage; comparisons with other methods use the same budget
MAX_SIMULATIONS = 40  # budget of the second stage
NUM_EIGENVALUES = 60  # slowest eigenvalues in each linear program


@dataclasses.dataclass(frozen=True)
class LoopDesign:
    """Closed loop of a scenario at equilibrium, with its Jacobian.

    Attributes:
        settings: Scenario with the gains.
        experiment: Experiment of case C1.
        initial_state: Initial guess of the equilibrium.
        equilibrium: Equilibrium of the sampled loop.
        step_jacobian: Jacobian of one tick there.
        with_learned_parameters: The same loop with true parameters in the controller, which has a different
            equilibrium; None if all nominal parameters are true.
    """

    settings: Scenario
    experiment: Experiment
    initial_state: State
    equilibrium: stability.LoopStateTree
    step_jacobian: np.ndarray
    with_learned_parameters: LoopDesign | None = None

    @property
    def delay_ticks(self) -> int:
        """`DESIGN_DELAY` in ticks, rounded up."""
        return math.ceil(DESIGN_DELAY * self.settings.control_Hz - 1e-9)

    def jacobians(self, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the Jacobian M of a similar loop, and that of the same loop with the design delay."""
        return M, stability.with_input_delay(self.equilibrium, M, self.delay_ticks)

    @property
    def cost(self) -> float:
        """Growth rate of the slowest mode of all loops [1/s], which is to be minimized."""
        nominal_cost = (
            max(math.log(np.abs(np.linalg.eigvals(A)).max()) for A in self.jacobians(self.step_jacobian))
            / self.experiment.dt
        )
        return max(nominal_cost, self.with_learned_parameters.cost) if self.with_learned_parameters else nominal_cost


@dataclasses.dataclass(frozen=True)
class FlightCost:
    """Stable loop with its displacement of the contacts in simulation."""

    loop: LoopDesign  # loop of the simulated flight
    error: float  # m, RMS displacement of the contacts

    @property
    def cost(self) -> float:
        """Displacement divided by the decay rate [m s]; equal relative changes of both have equal weight."""
        return self.error / -self.loop.cost


class EvaluationBudget(NamedTuple):
    """Number of linearizations and of simulated flights."""

    linearizations: int  # number of linearizations
    simulations: int  # number of simulated flights


def linearize_scenario(settings: Scenario) -> LoopDesign:
    """Linearize the closed loop of a scenario at its equilibria.

    A ScenarioError is raised as by `make_experiment`, a ValueError if there is no equilibrium.

    Args:
        settings: Scenario.

    Returns:
        The loop, also with true parameters in the controller if they differ from the nominal ones.
    """
    true_parameters = loop_checks.with_true_parameters(settings)
    return dataclasses.replace(
        _linearize_at_equilibrium(settings),
        with_learned_parameters=_linearize_at_equilibrium(true_parameters) if true_parameters != settings else None,
    )


def _linearize_at_equilibrium(settings: Scenario) -> LoopDesign:
    """Linearize the loop of a scenario at the equilibrium near its reference."""
    flight_experiment = experiment.make_experiment(settings, "C1")
    z = initial_states.equilibrium_state(settings, flight_experiment.world.team)
    return LoopDesign(settings, flight_experiment, z, *stability.equilibrium_and_jacobian(flight_experiment, z))


def tunable_gains(settings: Scenario) -> tuple[str, ...]:
    """Return the names of the gains to tune; the posture bandwidth only for agents with redundant joints."""
    redundant = loop_checks.is_redundant(settings) and settings.control.posture_bandwidth > 0
    return GAINS if redundant else GAINS[:-1]


def scale_gains(settings: Scenario, steps: np.ndarray, digits: int = 3) -> Scenario:
    """Return the scenario with scaled gains.

    Args:
        settings: Scenario.
        steps: Changes of the tuned parameters, as logarithms in the order of the columns of `TUNED_GAINS`.
        digits: Number of significant digits of the gains.

    Returns:
        The changed scenario.
    """
    gains: dict[str, Any] = {}
    n = len(tunable_gains(settings))
    for name, step in zip(tunable_gains(settings), TUNED_GAINS[:n, :n] @ steps, strict=True):
        old = getattr(settings.control, name)
        new = [float(f"{math.exp(step) * each:.{digits}g}") for each in np.atleast_1d(old)]
        gains[name] = tuple(new) if np.ndim(old) else new[0]
    return settings.model_copy(update={"control": settings.control.model_copy(update=gains)})


def tune(
    settings: Scenario,
    progress: Callable[[str], None] = lambda _what: None,
    on_improvement: Callable[[LoopDesign], None] = lambda _loop: None,
) -> tuple[LoopDesign, LoopDesign, EvaluationBudget]:
    """Tune the gains of a scenario.

    The first stage minimizes `LoopDesign.cost` by linearizations alone. The second stage minimizes `FlightCost.cost`,
    from the result of the first stage or from the initial gains, whichever has the lower cost. Both are restricted to
    `search_bounds`. If neither can be simulated without saturation, the result of the first stage is returned. Raises a
    ScenarioError or ValueError as `linearize_scenario`.

    Args:
        settings: Scenario.
        progress: Function called with a description of the progress.
        on_improvement: Function called with each improved loop, so that an interrupted search has a result.

    Returns:
        The initial loop, the tuned loop, and the evaluations used.

    Example:
        ::

            first, best, used = gain_tuning.tune(colift.load_scenario("paper"), progress=print)
            print(best.settings.control.K_p)
    """
    progress("linearization at equilibrium")
    first = linearize_scenario(settings)
    bounds = search_bounds(first)
    n = len(bounds[0])

    def linearize_at(steps: np.ndarray) -> LoopDesign | None:
        with contextlib.suppress(ValueError, ScenarioError):  # no equilibrium with these gains
            return linearize_scenario(scale_gains(settings, steps))
        return None

    def simulate_at(steps: np.ndarray) -> FlightCost | None:
        loop = linearize_at(steps)
        cost = None if loop is None else simulate_cost(loop)
        return cost if isinstance(cost, FlightCost) else None

    def report_linearization(best: LoopDesign, used: int) -> None:
        on_improvement(best)
        progress(f"slowest mode {best.cost:+.3g} 1/s, {used} of at most {MAX_LINEARIZATIONS} linearizations")

    def report_simulation(best: FlightCost, used: int) -> None:
        on_improvement(best.loop)
        progress(f"displacement / decay rate {best.cost:.3g} m s, {used} of at most {MAX_SIMULATIONS} simulations")

    origin, is_damping = np.zeros(n), DAMPING[:n]
    fastest, steps_best, loops = minimize(
        first, linearize_at, _mode_gradients, origin, bounds, is_damping, MAX_LINEARIZATIONS, report_linearization
    )
    candidates = [
        (candidate, steps)
        for candidate, steps in ((simulate_cost(first), origin), (simulate_cost(fastest), steps_best))
        if isinstance(candidate, FlightCost)
    ]
    if not candidates:
        return first, fastest, EvaluationBudget(loops, 2)
    cheapest, steps_best = min(candidates, key=lambda candidate: candidate[0].cost)
    best, _, flights = minimize(
        cheapest, simulate_at, _flight_gradients, steps_best, bounds, is_damping, MAX_SIMULATIONS - 1, report_simulation
    )
    return first, best.loop, EvaluationBudget(loops + flights - 1, flights + 1)


@runtime_checkable
class Objective(Protocol):
    """Design with a cost that `minimize` reduces."""

    @property
    def cost(self) -> float:
        """Value to be minimized."""
        ...


DesignT = TypeVar("DesignT", bound=Objective)
ValuesAndGradients = tuple[np.ndarray, np.ndarray]
"""Costs whose maximum is minimized, and their derivatives, one row each."""


def minimize(
    first: DesignT,
    evaluate: Callable[[np.ndarray], DesignT | None],
    gradients: Callable[[DesignT], ValuesAndGradients],
    start: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    is_damping: np.ndarray,
    max_evaluations: int,
    progress: Callable[[DesignT, int], None] = lambda _best, _used: None,
) -> tuple[DesignT, np.ndarray, int]:
    """Minimize the largest cost by sequential linear programs within a trust region.

    Each program finds the smallest t with `c_i + (d c_i / d s) s <= t` and `|s| <= region`. An improving step is
    accepted and the region enlarged. Otherwise the damping parameters are held constant, because gradients with respect
    to damping are unreliable where two poles coincide. If this does not help either, the region is reduced. One
    evaluation counts 1, a gradient counts the number of parameters.

    Args:
        first: Design at the start.
        evaluate: Function that returns the design at given parameters; None if it does not exist there.
        gradients: Function that returns costs and gradients of a design.
        start: Initial parameters.
        bounds: Lower and upper bounds of the parameters.
        is_damping: Mask of the damping parameters.
        max_evaluations: Largest number of evaluations.
        progress: Function called with the best design and the evaluations used.

    Returns:
        The best design, its parameters, and the number of evaluations.
    """
    low, high = bounds
    best, parameters, region, used, gradient = first, start, INITIAL_TRUST_REGION, 1, None
    while region > MIN_TRUST_REGION and used + 2 + (len(low) if gradient is None else 0) <= max_evaluations:
        if gradient is None:
            progress(best, used)
            gradient = gradients(best)
            used += len(low)
        for free in (np.full(len(low), True), ~is_damping):
            lower, upper = np.maximum(low - parameters, -region), np.minimum(high - parameters, region)
            step = _linear_program_step(*gradient, np.where(free, lower, 0.0), np.where(free, upper, 0.0))
            candidate = evaluate(parameters + step)
            used += 1
            if candidate is not None and candidate.cost < best.cost - 0.005 * abs(best.cost):
                best, parameters, region, gradient = candidate, parameters + step, min(1.5 * region, 1.0), None
                break
        else:
            region /= 3
    return best, parameters, used


def simulate_cost(loop: LoopDesign) -> FlightCost | str:
    """Simulate the flight of a loop and compute its cost.

    Args:
        loop: Closed loop.

    Returns:
        The cost, or the reason for which there is none: "grows" (unstable loop), "lost" (early termination) or
        "saturated".
    """
    if loop.cost >= 0:
        return "grows"
    flight = run_experiment(loop.experiment)
    if flight.termination_reason:
        return "lost"
    if flight.records.thrust_saturated.any():
        return "saturated"
    return FlightCost(loop, _displacement(flight, loop.experiment))


def _displacement(flight: FlightResult, experiment: Experiment) -> float:
    """Compute the displacement of the contacts over the second half of a flight."""
    half = metrics.second_half(flight.records)
    e_p, e_R, R_L, contacts = map(
        np.asarray, (half.e_p, half.e_R, half.R_L, grasp.contact_points(experiment.controller.team))
    )
    return contact_displacement_rms(e_p, e_R, R_L, contacts)


def contact_displacement_rms(e_p: np.ndarray, e_R: np.ndarray, R_L: np.ndarray, contacts: np.ndarray) -> float:
    """Compute the RMS over time and contacts c of `|e_p + R_L (e_R x c)|`, to first order in the attitude error.

    Args:
        e_p: Position error, time first [m, world].
        e_R: Attitude error, time first [payload frame].
        R_L: Payload attitude, time first.
        contacts: Contact positions [m, payload frame].

    Returns:
        The RMS displacement [m].
    """
    rotational = np.einsum("tij,tcj->tci", R_L, np.cross(e_R[:, None], contacts))
    return float(np.sqrt(np.square(e_p[:, None] + rotational).sum(-1).mean()))


def _perturbed_scenarios(settings: Scenario) -> list[Scenario]:
    """Return the scenario with each tuned parameter increased by `DIFFERENCE_STEP`."""
    return [scale_gains(settings, DIFFERENCE_STEP * e, digits=15) for e in np.eye(len(tunable_gains(settings)))]


def _mode_gradients(loop: LoopDesign) -> ValuesAndGradients:
    """Compute growth rates of the slowest modes and their gradients, by differences at the present equilibrium."""
    perturbed = [
        loop.jacobians(
            stability.step_jacobian(experiment.make_experiment(settings, "C1"), loop.initial_state, loop.equilibrium)
        )
        for settings in _perturbed_scenarios(loop.settings)
    ]
    parts = [
        growth_rates(M, [jacobians[k] for jacobians in perturbed], loop.experiment.dt)
        for k, M in enumerate(loop.jacobians(loop.step_jacobian))
    ]
    parts += [_mode_gradients(loop.with_learned_parameters)] if loop.with_learned_parameters else []
    return np.concatenate([rate for rate, _ in parts]), np.concatenate([slope for _, slope in parts])


def _flight_gradients(cost: FlightCost) -> ValuesAndGradients:
    """Compute the costs `e / -lambda_i` and their gradients; those of the error by simulations with the same noise.

    The gradient of the error is taken as zero for a flight that ends early.

    Args:
        cost: Loop with its cost.

    Returns:
        Costs and gradients.
    """
    rates, slopes = _mode_gradients(cost.loop)
    error_gradient = np.zeros(slopes.shape[1])
    for k, settings in enumerate(_perturbed_scenarios(cost.loop.settings)):
        flight_experiment = dataclasses.replace(
            experiment.make_experiment(settings, "C1"), initial_state=cost.loop.experiment.initial_state
        )
        flight = run_experiment(flight_experiment)
        if not flight.termination_reason:
            error_gradient[k] = math.log(_displacement(flight, flight_experiment) / cost.error) / DIFFERENCE_STEP
    costs = cost.error / -rates
    return costs, costs[:, None] * (error_gradient + slopes / -rates[:, None])


def growth_rates(M: np.ndarray, perturbed: Sequence[np.ndarray], dt: float) -> ValuesAndGradients:
    """Compute the growth rates `log |z| / dt` of the slowest eigenvalues and their derivatives.

    The derivative of an eigenvalue is `z' = w^H M' v / w^H v`, with right and left eigenvectors v and w.

    Args:
        M: Jacobian of one tick.
        perturbed: Jacobians with each parameter increased by `DIFFERENCE_STEP`.
        dt: Control period [s].

    Returns:
        Growth rates [1/s], slowest first, and their derivatives.
    """
    values, left, right = linalg.eig(M, left=True)
    order = np.argsort(-np.abs(values))[:NUM_EIGENVALUES]
    order = order[np.abs(values[order]) > stability.DEADBEAT_THRESHOLD]
    values, w, v = values[order], left[:, order].conj(), right[:, order]
    derivatives = [(w * ((A - M) @ v)).sum(0) / ((w * v).sum(0) * values) for A in perturbed]
    return np.log(np.abs(values)) / dt, np.real(np.stack(derivatives, axis=1)) / (DIFFERENCE_STEP * dt)


def _linear_program_step(costs: np.ndarray, slopes: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the step within bounds that minimizes the largest cost to first order; zero if there is none."""
    n = slopes.shape[1]
    constraints = np.hstack([slopes, -np.ones((len(costs), 1))])
    bounds = [*zip(low, high, strict=True), (None, None)]
    solution = linprog(np.r_[np.zeros(n), 1.0], A_ub=constraints, b_ub=-costs, bounds=bounds)
    return solution.x[:n] if solution.success else np.zeros(n)


def search_bounds(loop: LoopDesign) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds of the tuned parameters relative to their present values, as logarithms.

    All bounds are `MAX_GAIN_RATIO`, with two exceptions. `K_p` is limited by the thrust that remains for the initial
    position error above `scenario.termination.HOVER_THRUST_MARGIN`. The posture bandwidth is not increased unless the
    loop is unstable, because it is a requirement of the scenario.

    Args:
        loop: Closed loop at the start.

    Returns:
        Lower and upper bounds.
    """
    n = len(tunable_gains(loop.settings))
    low, high = np.full(n, -MAX_GAIN_RATIO), np.full(n, MAX_GAIN_RATIO)
    high[0] = min(high[0], _max_frequency_ratio(loop))
    if n == len(GAINS) and loop.cost < 0:
        high[-1] = 0.0
    return low, high


def _max_frequency_ratio(loop: LoopDesign) -> float:
    """Return the largest logarithm of the position frequency for which the initial error leaves thrust in reserve."""
    error = float(np.linalg.norm(loop.settings.initial_state.position_error_m))
    experiment = loop.experiment
    hover = termination.true_hover_thrust(
        loop.settings, experiment.world.team, experiment.controller, experiment.world.disturbances
    )
    available = np.concatenate([group.thrust_max for group in experiment.world.team.agent_groups])
    margin = float(((1 - termination.HOVER_THRUST_MARGIN) * available / hover).min()) - 1
    requested = max(loop.settings.control.K_p) * error / max(float(np.linalg.norm(loop.settings.gravity_mps2)), 1e-9)
    return math.log(max(margin / requested, 1.0)) / 2 if requested > 0 else MAX_GAIN_RATIO


# Reports --------------------------------------------------------------------------------------------------------------


def summary_values(loop: LoopDesign) -> dict[str, float | str]:
    """Compute the values that compare two sets of gains.

    The values are growth rates of the slowest modes, delay and thrust margin, the static position error of case C1
    under the disturbances, and the displacement of the contacts in simulation or the reason for which there is none.

    Args:
        loop: Closed loop.

    Returns:
        Values by name, with units in the names.
    """
    truth, nominal = loop.experiment.world.team, loop.experiment.controller.team
    try:
        ticks = stability.delay_margin(
            loop.equilibrium, loop.step_jacobian, round(stability.MAX_DELAY * loop.settings.control_Hz)
        )
    except ValueError:
        ticks = -1
    hover = termination.true_hover_thrust(
        loop.settings, truth, loop.experiment.controller, loop.experiment.world.disturbances
    )
    available = np.concatenate([group.thrust_max for group in truth.agent_groups])
    f = disturbances.initial_forces(loop.experiment.world.disturbances, truth, loop.initial_state)
    total = lambda team: float(team.payload.mass + sum(group.mass.sum() for group in team.agent_groups))  # noqa: E731
    force = np.asarray(f.payload.F) + sum(np.asarray(part.f_x).sum(0) for part in f.agents)
    force = force + (total(truth) - total(nominal)) * np.asarray(truth.gravity)
    on_time, delayed = (
        math.log(np.abs(np.linalg.eigvals(A)).max()) / loop.experiment.dt for A in loop.jacobians(loop.step_jacobian)
    )
    return {
        "slowest_mode_1ps": on_time,
        "slowest_mode_delayed_1ps": delayed,
        "slowest_mode_true_parameters_1ps": loop.with_learned_parameters.cost
        if loop.with_learned_parameters
        else max(on_time, delayed),
        "delay_margin_s": ticks * loop.experiment.dt,
        "thrust_margin": float((1 - hover / available).min()),
        "contact_displacement_C1_m": cost.error if isinstance(cost := simulate_cost(loop), FlightCost) else cost,
        "static_e_p_C1_m": float(np.linalg.norm(force / np.array(loop.settings.control.K_p))) / total(nominal),
    }


def to_yaml(tuned: Scenario, original: str | None, file: str) -> str:
    """Write a scenario with tuned gains as YAML.

    Comments are kept if the given text describes the same scenario apart from the gains. Otherwise, every setting is
    written.

    Args:
        tuned: Scenario with tuned gains.
        original: Text of the original file, if any.
        file: Name of the file, for messages.

    Returns:
        The text of the scenario file.
    """
    if original is not None:
        with contextlib.suppress(ScenarioError):
            gains = {name: getattr(tuned.control, name) for name in tunable_gains(tuned)}
            text = with_control(original, gains)
            if parse(text, file) == tuned:
                return text
    return every_setting(tuned)


def format_report(
    before: LoopDesign, after: LoopDesign, old: Mapping[str, Any], new: Mapping[str, Any], budget: EvaluationBudget
) -> list[str]:
    """Format loops before and after tuning side by side, with their gains.

    Args:
        before: Loop with the original gains.
        after: Loop with the tuned gains.
        old: `summary_values` of the original loop.
        new: `summary_values` of the tuned loop.
        budget: Evaluations used.

    Returns:
        Lines of text.
    """
    lines = [f"{'':44} {'before':>10} {'after':>10}"]
    for label, key, scale, spec in (
        ("slowest mode, 1/s", "slowest_mode_1ps", 1, "+.3g"),
        (f"slowest mode with {1e3 * DESIGN_DELAY:g} ms delay, 1/s", "slowest_mode_delayed_1ps", 1, "+.3g"),
        ("slower of both, true parameters, 1/s", "slowest_mode_true_parameters_1ps", 1, "+.3g"),
        ("delay margin, ms", "delay_margin_s", 1e3, ".3g"),
        ("thrust margin in hover, %", "thrust_margin", 100, ".3g"),
        ("static position error of C1, mm", "static_e_p_C1_m", 1e3, ".3g"),
        ("contact displacement in simulation, mm", "contact_displacement_C1_m", 1e3, ".3g"),
    ):
        cells = [x if isinstance(x := values[key], str) else format(scale * x, spec) for values in (old, new)]
        lines.append(f"{label:44} {cells[0]:>10} {cells[1]:>10}")
    for name in tunable_gains(before.settings):
        gain_before, gain_after = (getattr(loop.settings.control, name) for loop in (before, after))
        lines.append(f"{'control.' + name:44} {_format_gain(gain_before):>10} {_format_gain(gain_after):>10}")
    return [*lines, f"{budget.linearizations} linearizations, {budget.simulations} simulations"]


def _format_gain(gain: Any) -> str:
    """Format a gain; a vector with equal entries as one number."""
    values = list(dict.fromkeys(gain)) if isinstance(gain, tuple) else [gain]
    return f"{values[0]:g}" if len(values) == 1 else "/".join(f"{x:g}" for x in gain)
