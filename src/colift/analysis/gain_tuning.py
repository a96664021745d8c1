"""Gains by gradients of the sampled loop's modes and of a flight: what disturbs is to die out soon and to move little.

The loop to first order (`modes.monodromy`) has its eigenvalues, and these have derivatives with the gains; a linear
program within a trust region says which step makes the slowest faster, also where commands come late. From there the
same steps make smaller how far contacts are off in a flight that learns nothing, over how fast the slowest mode decays.
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

from colift.analysis import metrics, preflight, stability
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment
from colift.models import grasp
from colift.models.state import State
from colift.scenario import Scenario, ScenarioError, experiment, initial_states, parse, termination, with_control
from colift.scenario import to_yaml as every_setting
from colift.simulation import disturbances

GAINS = ("K_p", "K_v", "k_R", "k_omega", "agent_k_R", "agent_k_omega", "posture_bandwidth")
# What is chosen, as logarithms: frequency and damping of the payload's position, of its attitude, of agents' attitudes,
# and the posture's rate: `K_p = w^2`, `K_v = 2 d w`. A frequency moves both poles of a pair alike, also if they meet.
TUNED_GAINS = np.array([
    [2, 0, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0, 0],
    [0, 0, 0, 0, 2, 0, 0], [0, 0, 0, 0, 1, 1, 0], [0, 0, 0, 0, 0, 0, 1],
])  # fmt: skip
DAMPING = np.array([False, True] * 3 + [False])
DESIGN_DELAY = 0.004  # s, twice what `check` asks for; with commands that late, modes are to die out as fast
MAX_GAIN_RATIO = math.log(2)  # of what is chosen from where it began
STEP = 1e-3  # of such a logarithm, for the derivative of a matrix that is known to some 1e-10
REGION, LEAST_REGION = 0.3, 0.03  # of logarithms: the first trust region, and the one at which the search ends
MAX_LINEARIZATIONS = 80  # looked at before any is flown, and as many for whoever is compared with
MAX_SIMULATIONS = 40  # likewise
NUM_EIGENVALUES = 60  # eigenvalues that a step looks at


@dataclasses.dataclass(frozen=True)
class LoopDesign:
    """What is known of a scenario's gains without a flight."""

    settings: Scenario
    experiment: Experiment
    initial_state: State
    equilibrium: stability.LoopStateTree
    step_jacobian: np.ndarray
    with_learned_parameters: LoopDesign | None = (
        None  # where bodies that are believed otherwise are known: it rests in another pose
    )

    @property
    def delay_ticks(self) -> int:
        """How many ticks `LATE` is, rounded up."""
        return math.ceil(DESIGN_DELAY * self.settings.control_Hz - 1e-9)

    def jacobians(self, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The loop's derivative and the one with late commands, for a derivative M near this loop's."""
        return M, stability.with_input_delay(self.equilibrium, M, self.delay_ticks)

    @property
    def cost(self) -> float:
        """1/s, the growth of the slowest mode of all, which is to be as negative as can be."""
        own = (
            max(math.log(np.abs(np.linalg.eigvals(A)).max()) for A in self.jacobians(self.step_jacobian))
            / self.experiment.dt
        )
        return max(own, self.with_learned_parameters.cost) if self.with_learned_parameters else own


@dataclasses.dataclass(frozen=True)
class FlightCost:
    """A loop that decays, and how far off contacts are in its flight."""

    loop: LoopDesign
    error: float  # m

    @property
    def cost(self) -> float:
        """m s, the error over how fast the slowest mode decays: a percent of one is worth a percent of the other."""
        return self.error / -self.loop.cost


class EvaluationBudget(NamedTuple):
    """How many loops were looked at, and how many of them flown."""

    linearizations: int
    simulations: int


def linearize_scenario(settings: Scenario) -> LoopDesign:
    """The loop of a scenario at its rests. Raises ScenarioError as `study.plan`, ValueError where it finds no rest."""
    right = preflight.with_true_parameters(settings)
    return dataclasses.replace(
        _at_rest(settings), with_learned_parameters=_at_rest(right) if right != settings else None
    )


def _at_rest(settings: Scenario) -> LoopDesign:
    flight_experiment = experiment.make_experiment(settings, "C1")
    z = initial_states.equilibrium_state(settings, flight_experiment.world.team)
    return LoopDesign(settings, flight_experiment, z, *stability.equilibrium_and_jacobian(flight_experiment, z))


def tunable_gains(settings: Scenario) -> tuple[str, ...]:
    """The gains that there are to choose: the posture's only where an agent has joints beyond need."""
    beyond = preflight.is_redundant(settings) and settings.control.posture_bandwidth > 0
    return GAINS if beyond else GAINS[:-1]


def scale_gains(settings: Scenario, steps: np.ndarray, digits: int = 3) -> Scenario:
    """Settings with gains so many logarithms of `CHOSEN` from what they are, written with so many digits."""
    change: dict[str, Any] = {}
    free = len(tunable_gains(settings))
    for name, step in zip(tunable_gains(settings), TUNED_GAINS[:free, :free] @ steps, strict=True):
        context = getattr(settings.control, name)
        new = [float(f"{math.exp(step) * each:.{digits}g}") for each in np.atleast_1d(context)]
        change[name] = tuple(new) if np.ndim(context) else new[0]
    return settings.model_copy(update={"control": settings.control.model_copy(update=change)})


def tune(
    settings: Scenario,
    progress: Callable[[str], None] = lambda _what: None,
    better: Callable[[LoopDesign], None] = lambda _loop: None,
) -> tuple[LoopDesign, LoopDesign, EvaluationBudget]:
    """The loop as it is, the one with the gains that were found, and what that took.

    `better` is handed the best loop so far, again and again: what is left to whoever ends the search early.

    First `Loop.cost` is made small, which needs no flight, then, from there or from the start, whichever flies at less,
    `Flown.cost`: both in the logarithms of frequencies and dampings, within `room`. Where neither flies the fastest
    loop is returned. Raises as `loop`.
    """
    progress("its loop at rest")
    first = linearize_scenario(settings)
    bounds = search_bounds(first)
    free = len(bounds[0])

    def at(steps: np.ndarray) -> LoopDesign | None:
        with contextlib.suppress(ValueError, ScenarioError):  # no rest with these
            return linearize_scenario(scale_gains(settings, steps))
        return None

    def flown_at(steps: np.ndarray) -> FlightCost | None:
        tried = at(steps)
        found = None if tried is None else simulate_cost(tried)
        return found if isinstance(found, FlightCost) else None

    def decays(best: LoopDesign, used: int) -> None:
        better(best)
        progress(f"slowest mode {best.cost:+.3g} 1/s, {used} of at most {MAX_LINEARIZATIONS} loops looked at")

    def flies(best: FlightCost, used: int) -> None:
        better(best.loop)
        progress(f"error over decay {best.cost:.3g} m s, {used} of at most {MAX_SIMULATIONS} flown")

    none, second = np.zeros(free), DAMPING[:free]
    fastest, where, loops = minimize(first, at, _slopes, none, bounds, second, MAX_LINEARIZATIONS, decays)
    begun = [
        (each, steps)
        for each, steps in ((simulate_cost(first), none), (simulate_cost(fastest), where))
        if isinstance(each, FlightCost)
    ]
    if not begun:
        return first, fastest, EvaluationBudget(loops, 2)
    cheapest, where = min(begun, key=lambda each: each[0].cost)
    best, _, flights = minimize(cheapest, flown_at, _flown_slopes, where, bounds, second, MAX_SIMULATIONS - 1, flies)
    return first, best.loop, EvaluationBudget(loops + flights - 1, flights + 1)


@runtime_checkable
class Objective(Protocol):
    """What `descend` makes small."""

    @property
    def cost(self) -> float: ...


C = TypeVar("C", bound=Objective)
Slopes = tuple[np.ndarray, np.ndarray]
"""Costs of which the greatest counts, and their derivatives, a row each."""


def minimize(
    first: C,
    at: Callable[[np.ndarray], C | None],
    slopes: Callable[[C], Slopes],
    start: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    second: np.ndarray,
    most: int,
    progress: Callable[[C, int], None] = lambda _best, _used: None,
) -> tuple[C, np.ndarray, int]:
    """From start, where `first` is, to what costs least within bounds; `at` is None where there is nothing.

    Sequential linear programs: least t with `c_i + (d c_i / d s) s <= t`, `|s| <= region`; a step that helps is taken
    and widens the region. Where one does not, what is `second` is held, as slopes in dampings are of no use where poles
    meet; then the region is narrowed. One looked at counts one, its slopes one for each of what they are the slopes in,
    and there are no more than `most`.
    """
    low, high = bounds
    best, here, region, used, known = first, start, REGION, 1, None
    while region > LEAST_REGION and used + 2 + (len(low) if known is None else 0) <= most:
        if known is None:
            progress(best, used)
            known = slopes(best)
            used += len(low)
        for moves in (np.full(len(low), True), ~second):
            least, greatest = np.maximum(low - here, -region), np.minimum(high - here, region)
            step = _step(*known, np.where(moves, least, 0.0), np.where(moves, greatest, 0.0))
            tried = at(here + step)
            used += 1
            if tried is not None and tried.cost < best.cost - 0.005 * abs(best.cost):
                best, here, region, known = tried, here + step, min(1.5 * region, 1.0), None
                break
        else:
            region /= 3
    return best, here, used


def simulate_cost(of: LoopDesign) -> FlightCost | str:
    """The loop in its flight, or why there is nothing to say of it: it grows, stops, or meets a limit of thrust."""
    if of.cost >= 0:
        return "grows"
    flight = run_experiment(of.experiment)
    if flight.termination_reason:
        return "lost"
    return "saturated" if flight.records.thrust_saturated.any() else FlightCost(of, _error(flight, of.experiment))


def _error(flight: FlightResult, experiment: Experiment) -> float:
    half = metrics.second_half(flight.records)
    e_p, e_R, R_L, contacts = map(
        np.asarray, (half.e_p, half.e_R, half.R_L, grasp.contact_points(experiment.controller.team))
    )
    return contact_displacement_rms(e_p, e_R, R_L, contacts)


def contact_displacement_rms(e_p: np.ndarray, e_R: np.ndarray, R_L: np.ndarray, contacts: np.ndarray) -> float:
    """RMS over time and contacts c of `|e_p + R_L (e_R x c)|`, m: how far they are off, to first order in attitude."""
    turned = np.einsum("tij,tcj->tci", R_L, np.cross(e_R[:, None], contacts))
    return float(np.sqrt(np.square(e_p[:, None] + turned).sum(-1).mean()))


def _moved(of: Scenario) -> list[Scenario]:
    """`STEP` further in each of what is chosen."""
    return [scale_gains(of, STEP * e, digits=15) for e in np.eye(len(tunable_gains(of)))]


def _slopes(of: LoopDesign) -> Slopes:
    """Of the slowest modes by the logarithms of the gains, by differences at the rest of the loop as it is."""
    moved = [
        of.jacobians(stability.step_jacobian(experiment.make_experiment(near, "C1"), of.initial_state, of.equilibrium))
        for near in _moved(of.settings)
    ]
    parts = [
        decay_rates(M, [each[k] for each in moved], of.experiment.dt)
        for k, M in enumerate(of.jacobians(of.step_jacobian))
    ]
    parts += [_slopes(of.with_learned_parameters)] if of.with_learned_parameters else []
    return np.concatenate([rate for rate, _ in parts]), np.concatenate([slope for _, slope in parts])


def _flown_slopes(of: FlightCost) -> Slopes:
    """Of `e / -lambda_i`: the error's by differences of flights from the same start, in the same noise.

    Where a flight so near is lost the error's slope is not known, and taken for none.
    """
    rates, slopes = _slopes(of.loop)
    by_error = np.zeros(slopes.shape[1])
    for k, near in enumerate(_moved(of.loop.settings)):
        flight_experiment = dataclasses.replace(
            experiment.make_experiment(near, "C1"), initial_state=of.loop.experiment.initial_state
        )
        flight = run_experiment(flight_experiment)
        if not flight.termination_reason:
            by_error[k] = math.log(_error(flight, flight_experiment) / of.error) / STEP
    costs = of.error / -rates
    return costs, costs[:, None] * (by_error + slopes / -rates[:, None])


def decay_rates(M: np.ndarray, moved: Sequence[np.ndarray], dt: float) -> Slopes:
    """Of the slowest eigenvalues of a tick of dt, s: `log |z| / dt`, and how it changes to `moved`, each `STEP` away.

    `z' = w^H M' v / w^H v` with the right and left vectors v, w.
    """
    values, left, right = linalg.eig(M, left=True)
    order = np.argsort(-np.abs(values))[:NUM_EIGENVALUES]
    order = order[np.abs(values[order]) > stability.DEADBEAT_THRESHOLD]
    values, w, v = values[order], left[:, order].conj(), right[:, order]
    turned = [(w * ((A - M) @ v)).sum(0) / ((w * v).sum(0) * values) for A in moved]
    return np.log(np.abs(values)) / dt, np.real(np.stack(turned, axis=1)) / (STEP * dt)


def _step(costs: np.ndarray, slopes: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step within bounds after which, to first order, the greatest cost is least."""
    free = slopes.shape[1]
    sums = np.hstack([slopes, -np.ones((len(costs), 1))])
    bounds = [*zip(low, high, strict=True), (None, None)]
    found = linprog(np.r_[np.zeros(free), 1.0], A_ub=sums, b_ub=-costs, bounds=bounds)
    return found.equilibrium[:free] if found.success else np.zeros(free)


def search_bounds(of: LoopDesign) -> tuple[np.ndarray, np.ndarray]:
    """From where on and how far each of what is chosen may go, as logarithms: `FARTHEST`, but for two.

    `K_p` stays below what the start's error and `termination.hover_thrust_margin` leave of the thrust. The posture is what joints
    beyond need are to reach, as its user states it: it is not raised, unless the loop grows as it is.
    """
    free = len(tunable_gains(of.settings))
    low, high = np.full(free, -MAX_GAIN_RATIO), np.full(free, MAX_GAIN_RATIO)
    high[0] = min(high[0], _most_stiffness(of))
    if free == len(GAINS) and of.cost < 0:
        high[-1] = 0.0
    return low, high


def _most_stiffness(of: LoopDesign) -> float:
    """How much higher, as a logarithm, the position's frequency may be: the start's error asks for thrust."""
    error = float(np.linalg.norm(of.settings.initial_state.position_error_m))
    experiment = of.experiment
    hover = termination.true_hover_thrust(
        of.settings, experiment.world.team, experiment.controller, experiment.world.disturbances
    )
    have = np.concatenate([group.thrust_max for group in experiment.world.team.agent_groups])
    left = float(((1 - of.settings.termination.hover_thrust_margin) * have / hover).min()) - 1
    requested = max(of.settings.control.K_p) * error / max(float(np.linalg.norm(of.settings.gravity_mps2)), 1e-9)
    return math.log(max(left / requested, 1.0)) / 2 if requested > 0 else MAX_GAIN_RATIO


# What is said of it ---------------------------------------------------------------------------------------------------


def summary_values(of: LoopDesign) -> dict[str, float | str]:
    """Slowest mode, late modes, delay and thrust margins, how far what is unknown holds a payload off under C1, and how
    far off contacts are in its flight, m, or what `flown` says of it.
    """
    truth, nominal = of.experiment.world.team, of.experiment.controller.team
    try:
        ticks = stability.delay_margin(
            of.equilibrium, of.step_jacobian, round(stability.MAX_DELAY * of.settings.control_Hz)
        )
    except ValueError:
        ticks = -1
    hover = termination.true_hover_thrust(
        of.settings, truth, of.experiment.controller, of.experiment.world.disturbances
    )
    have = np.concatenate([group.thrust_max for group in truth.agent_groups])
    f = disturbances.initial_forces(of.experiment.world.disturbances, truth, of.initial_state)
    total = lambda team: float(team.payload.mass + sum(group.mass.sum() for group in team.agent_groups))  # noqa: E731
    force = np.asarray(f.payload.F) + sum(np.asarray(part.f_x).sum(0) for part in f.agents)
    force = force + (total(truth) - total(nominal)) * np.asarray(truth.gravity)
    on_time, late = (
        math.log(np.abs(np.linalg.eigvals(A)).max()) / of.experiment.dt for A in of.jacobians(of.step_jacobian)
    )
    return {
        "slowest_mode_1ps": on_time,
        "slowest_mode_late_1ps": late,
        "slowest_mode_learned_1ps": of.with_learned_parameters.cost
        if of.with_learned_parameters
        else max(on_time, late),
        "delay_margin_s": ticks * of.experiment.dt,
        "thrust_margin": float((1 - hover / have).min()),
        "displacement_C1_m": in_flight.error if isinstance(in_flight := simulate_cost(of), FlightCost) else in_flight,
        "e_p_C1_m": float(np.linalg.norm(force / np.array(of.settings.control.K_p))) / total(nominal),
    }


def to_yaml(tuned: Scenario, written: str | None, file: str) -> str:
    """The scenario with its gains for a file of that name: as it is `written`, comments kept, where that says the same.

    Otherwise, as where nothing is written or a setting was changed, with every setting.
    """
    if written is not None:
        with contextlib.suppress(ScenarioError):
            gains = {name: getattr(tuned.control, name) for name in tunable_gains(tuned)}
            kept = with_control(written, gains)
            if parse(kept, file) == tuned:
                return kept
    return every_setting(tuned)


def format_report(
    before: LoopDesign, after: LoopDesign, old: Mapping[str, Any], new: Mapping[str, Any], spent: EvaluationBudget
) -> list[str]:
    """Both and their `numbers` side by side, as a person reads them, then the gains."""
    said = [f"{'':44} {'before':>10} {'after':>10}"]
    for label, key, scale, spec in (
        ("slowest mode, 1/s", "slowest_mode_1ps", 1, "+.3g"),
        (f"the same, commands {1e3 * DESIGN_DELAY:g} ms late, 1/s", "slowest_mode_late_1ps", 1, "+.3g"),
        ("the slower of both, bodies learned, 1/s", "slowest_mode_learned_1ps", 1, "+.3g"),
        ("delay margin, ms", "delay_margin_s", 1e3, ".3g"),
        ("thrust left at hover, %", "thrust_margin", 100, ".3g"),
        ("e_p under C1 by what is unknown, mm", "e_p_C1_m", 1e3, ".3g"),
        ("contacts off in its flight, mm", "displacement_C1_m", 1e3, ".3g"),
    ):
        each = [x if isinstance(x := of[key], str) else format(scale * x, spec) for of in (old, new)]
        said.append(f"{label:44} {each[0]:>10} {each[1]:>10}")
    for name in tunable_gains(before.settings):
        then, context = (getattr(each.settings.control, name) for each in (before, after))
        said.append(f"{'control.' + name:44} {_shown(then):>10} {_shown(context):>10}")
    return [*said, f"{spent.linearizations} loops looked at, {spent.simulations} flown"]


def _shown(gain: Any) -> str:
    values = list(dict.fromkeys(gain)) if isinstance(gain, tuple) else [gain]
    return f"{values[0]:g}" if len(values) == 1 else "/".join(f"{x:g}" for x in gain)
