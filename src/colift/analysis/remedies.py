"""Changes of a scenario that remedy the findings of the preflight check.

Each function proposes changes, evaluates them with the linearized closed loop of case C1, and returns those that
improve the finding, as sentences with the option to type. All searches of a check share a `SearchBudget`.

See Also:
    colift.analysis.preflight: the findings.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np

from colift.analysis import headings, joint_limits, stability
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import State
from colift.scenario import (
    Scenario,
    ScenarioError,
    controllers,
    experiment,
    gain_limits,
    initial_states,
    team,
)

MAX_JACOBIAN_CONDITION = 100.0  # of an agent's grasp Jacobian, one tenth of the limit of `grasp.check_controllability`
SEARCH_EFFORT = 480  # candidates of all searches of a check, times the joints of the team
MIN_DECAY_RATE = 0.3
"""Decay rate of the slowest mode below which the loop is weak [1/s]."""
MAX_CANDIDATES = 2  # changes that are evaluated in full, of those that are best to first order
MIN_IMPROVEMENT = 0.2  # of the growth rate of a loop with scaled or delayed commands, relative to the present one
GAINS = ("K_p", "K_v", "k_R", "k_omega", "agent_k_R", "agent_k_omega")  # gains of the agents last

T = TypeVar("T")
ScenarioChange = headings.ScenarioChange


class SearchBudget:
    """Number of candidates that all searches of one check share.

    The time of a candidate grows with the number of joints, so that the searches for a large team would take minutes.
    A number of candidates, in contrast to a time, yields the same advice on every machine.

    Attributes:
        candidates: Number of candidates at the start of the check.
        exhausted: True if a candidate was omitted.
    """

    def __init__(self, candidates: int) -> None:
        self.candidates = candidates
        self.exhausted = False
        self._evaluated = 0

    @classmethod
    def for_team(cls, settings: Scenario) -> SearchBudget:
        """Return the budget of a scenario: `SEARCH_EFFORT` over the number of joints, at least one candidate."""
        joints = sum(len(settings.agent_types[agent.type].joints) for agent in settings.agents)
        return cls(max(1, SEARCH_EFFORT // max(1, joints)))

    def within(self, candidates: Iterable[T]) -> Iterator[T]:
        """Iterate over the candidates of a search, the most promising first, until the budget is exhausted."""
        for candidate in candidates:
            if self._evaluated >= self.candidates:
                self.exhausted = True
                return
            self._evaluated += 1
            yield candidate

    @property
    def ended(self) -> str:
        """Advice for a search that the budget ended."""
        return (
            f"the search for changes ended after {self.candidates} candidates: use `colift tune`, which changes gains "
            "together"
        )


def modes_at_equilibrium(settings: Scenario) -> stability.Modes:
    """Compute the modes of case C1 at equilibrium.

    A ScenarioError is raised if the team cannot be built, a ValueError if it has no equilibrium.

    Args:
        settings: Scenario.

    Returns:
        The modes of the sampled loop.
    """
    flight_experiment = experiment.make_experiment(settings, "C1")
    return stability.modes_at_equilibrium(
        flight_experiment, initial_states.equilibrium_state(settings, flight_experiment.world.team)
    )


def margin_changes(
    settings: Scenario,
    x: stability.LoopStateTree,
    loops: Mapping[str, stability.VariedLoop],
    budget: SearchBudget,
) -> dict[str, str]:
    """Find the change of a single gain that stabilizes a loop with delayed or scaled commands most, to first order.

    Args:
        settings: Scenario.
        x: Equilibrium of its loop.
        loops: Loops with delayed or scaled commands, by description.
        budget: Candidates of the check.

    Returns:
        One sentence per description.
    """
    best = {name: (loop.growth, "") for name, loop in loops.items()}
    c1, (truth, nominal) = experiment.make_experiment(settings, "C1"), team.team(settings)
    z = initial_states.equilibrium_state(settings, truth)
    for option, changed in budget.within(gain_changes(settings)):
        controller = controllers.make_controller(changed, nominal)
        controller = dataclasses.replace(controller, recorder=c1.controller.recorder)
        changed_experiment = dataclasses.replace(c1, controller=controller)
        for name, loop in loops.items():
            derivative = stability.directional_derivative(changed_experiment, z, x, loop.right[: len(loop.B)])
            growth = loop.predict_growth(derivative)
            if np.isfinite(growth) and growth < best[name][0] and loop.growth - growth > MIN_IMPROVEMENT * loop.growth:
                best[name] = growth, option
    return {
        name: f"{option} changes the growth rate with {name} from {loops[name].growth:+.3g} to {growth:+.3g} 1/s, to "
        "first order"
        if option
        else budget.ended
        if budget.exhausted
        else f"no change of a single gain lowers the growth rate with {name}; `colift tune` changes them together"
        for name, (growth, option) in best.items()
    }


def delay_margin(settings: Scenario, x: stability.LoopStateTree, M: np.ndarray) -> float:
    """Compute the delay margin [s], at most `stability.MAX_DELAY`.

    Args:
        settings: Scenario, which contains the control rate.
        x: Equilibrium of the loop.
        M: Jacobian of one tick at x.

    Returns:
        The margin; a ValueError is raised as by `stability.delay_margin`.
    """
    return stability.delay_margin(x, M, round(stability.MAX_DELAY * settings.control_Hz)) / settings.control_Hz


def grasp_jacobian_conditions(settings: Scenario, truth: Team, state: State) -> dict[str, float]:
    """Compute the condition number of every agent's grasp Jacobian, by agent name.

    Args:
        settings: Scenario, which contains the names.
        truth: True parameters.
        state: State of the team.

    Returns:
        The condition numbers.
    """
    each = (
        (name, grasp.grasp_jacobian_svd(agent, r)[0])
        for name, agent, r, _ in grasp.iter_agents(truth, state, team.agent_names(settings))
    )
    return {name: float(values[0] / values[-1]) for name, values in each}


def slowest_joint_mode(modes: stability.Modes) -> tuple[float, int] | None:
    """Find the slowest mode that moves joints more than the payload.

    The posture controller determines these modes; the payload gains determine the others.

    Args:
        modes: Modes of the loop.

    Returns:
        Decay rate [1/s] and index of the joint with the largest amplitude; None if there is no such mode.
    """
    is_joint_mode = modes.joints.max(1) > 2 * modes.payload.max(1)
    if not is_joint_mode.any():
        return None
    k = int(np.argmax(is_joint_mode))  # the first one is the slowest
    return float(-modes.eigenvalues[k].real), int(np.argmax(modes.joints[k]))


def advice_for_rejection(
    settings: Scenario, message: str, progress: Callable[[str], None], budget: SearchBudget
) -> tuple[str, ...]:
    """Propose changes that let a rejected scenario be built.

    For straight or folded arms, other distances between the contacts are tried.

    Args:
        settings: Scenario.
        message: Message of the rejection.
        progress: Function called with a description of the progress.
        budget: Candidates of the check.

    Returns:
        Sentences.
    """
    if "grasp Jacobian" in message:
        feasible = []
        for option, changed in budget.within(contact_spacing_changes(settings)):
            progress(f"team with {option}")
            with contextlib.suppress(ScenarioError):
                truth = experiment.make_experiment(changed, "C1").world.team
                feasible.append(
                    (
                        max(
                            grasp_jacobian_conditions(
                                changed, truth, initial_states.equilibrium_state(changed, truth)
                            ).values()
                        ),
                        option,
                    )
                )
        if feasible and min(feasible)[0] < MAX_JACOBIAN_CONDITION:
            return (f"the arms are straight or folded at their contacts; {min(feasible)[1]} bends them",)
        return (
            "none of the tried contact distances yields a regular grasp Jacobian: change the nominal positions "
            "of joints (agent_types: nominal_position_rad), or give arms joints about other axes",
        )
    for phrase, advice in (
        ("cannot hover", "raise agent_types: thrust_max_N, lower payload.mass_kg, or add an agent"),
        ("rank", "move a contact (agents: contact_positions_m) away from the line through the others"),
        ("joints for", "give the agent more joints (agent_types: joints), or fewer arms"),
    ):
        if phrase in message:
            return (advice,)
    return ("see the message above",)


def stabilizing_changes(
    settings: Scenario,
    x: stability.LoopStateTree,
    M: np.ndarray,
    progress: Callable[[str], None],
    budget: SearchBudget,
    mode: int = 0,
) -> tuple[str, ...]:
    """Find the changes that increase the decay rate of a mode most.

    The gains that bound tips permit are tried first (`translation_change`). If the slowest mode decays fast enough with
    them, they are the only advice. Otherwise single gains and headings of planar arms are tried; if none helps, nominal
    joint positions and contact heights. Gains are ranked by the mode itself; all changes are compared by the slowest
    mode.

    Args:
        settings: Scenario.
        x: Equilibrium of its loop.
        M: Jacobian of one tick at x.
        progress: Function called with a description of the progress.
        budget: Candidates of the check.
        mode: Index of the mode, 0 for the slowest one.

    Returns:
        Sentences with option and resulting growth rate.
    """
    present = float(np.log(np.abs(np.linalg.eigvals(M)).max()) * settings.control_Hz)
    truth, _ = team.team(settings)
    turned = headings.heading_changes(settings, truth, initial_states.equilibrium_state(settings, truth))
    permitted = [
        change
        for change in [translation_change(settings, gain_limits.translation_limits(settings, truth))]
        if change[0]
    ]
    for option, changed in budget.within(permitted):
        progress(f"linearization with {option}")
        with contextlib.suppress(ValueError):  # no equilibrium
            rate = modes_at_equilibrium(changed).slowest_eigenvalue[0]
            if rate < min(-MIN_DECAY_RATE, present - 0.02 * abs(present)):
                return (f"{option} yields {rate:+.3g} rad/s",)

    def predict(changed: Scenario) -> float:
        flight_experiment = experiment.make_experiment(changed, "C1")
        z = initial_states.equilibrium_state(changed, flight_experiment.world.team)
        return stability.predict_growth_rate(flight_experiment, z, x, M, mode)

    predictions = [(predict(changed), option, changed) for option, changed in budget.within(gain_changes(settings))]
    gains = sorted(
        (candidate for candidate in predictions if np.isfinite(candidate[0])), key=lambda candidate: candidate[0]
    )[:MAX_CANDIDATES]
    for candidates in (
        [*turned, *(candidate[1:] for candidate in gains)],
        [*nominal_position_changes(settings), *contact_height_changes(settings)],
    ):
        evaluated = []
        for option, changed in budget.within(candidates):
            progress(f"linearization with {option}")
            with contextlib.suppress(ValueError):  # the team cannot be built, or has no equilibrium
                evaluated.append((modes_at_equilibrium(changed).slowest_eigenvalue[0], option))
        better = sorted(candidate for candidate in evaluated if candidate[0] < present - 0.02 * abs(present))[
            :MAX_CANDIDATES
        ]
        if better:
            return tuple(f"{option} yields {rate:+.3g} rad/s" for rate, option in better)
    if budget.exhausted:
        return (budget.ended,)
    return ("none of the tried gains, headings, joint positions and contact heights helps: start from `colift init`",)


def posture_changes(
    settings: Scenario, current: float, joint: str, progress: Callable[[str], None], budget: SearchBudget
) -> tuple[str, ...]:
    """Find changes with which the redundant joints converge faster.

    The function evaluates changes of the posture bandwidth, of the agents' attitude gains, and of the nominal position
    of the slowest joint. It returns changes that yield at least half of the required rate; if there are none, it
    returns changes that increase the present rate.

    Args:
        settings: Scenario.
        current: Present decay rate [1/s].
        joint: Name `agent/joint` of the slowest joint.
        progress: Function called with a description of the progress.
        budget: Candidates of the check.

    Returns:
        Sentences with option and resulting rate.
    """
    sufficient, faster = [], []
    gains, positions = gain_changes(settings, GAINS[-2:]), nominal_position_changes(settings, joint.rpartition("/")[2])
    for option, changed in budget.within([*posture_bandwidth_changes(settings, current), *gains, *positions]):
        progress(f"linearization with {option}")
        required = changed.control.posture_bandwidth
        with contextlib.suppress(ValueError):  # the team cannot be built, or has no equilibrium
            modes = modes_at_equilibrium(changed)
            rate = mode[0] if (mode := slowest_joint_mode(modes)) else required
            if modes.stable and rate > 1.02 * current:
                (sufficient if rate >= required / 2 else faster).append((rate, option))
    best = sorted(sufficient or faster, reverse=True)[:MAX_CANDIDATES]
    advice = tuple(f"{option} yields {rate:.3g} 1/s" for rate, option in best)
    if not advice and budget.exhausted:
        return (budget.ended,)
    return advice or (
        f"none of the tried bandwidths, attitude gains and positions of {joint} helps: start from `colift init`",
    )


def delay_margin_changes(
    settings: Scenario, current: float, progress: Callable[[str], None], budget: SearchBudget
) -> tuple[str, ...]:
    """Find the gains whose reduction increases the delay margin.

    Args:
        settings: Scenario.
        current: Present delay margin [s].
        progress: Function called with a description of the progress.
        budget: Candidates of the check.

    Returns:
        Sentences with option and resulting margin.
    """
    evaluated = []
    for option, changed in budget.within(list(gain_changes(settings))[::2]):
        progress(f"linearization with {option}")
        flight_experiment = experiment.make_experiment(changed, "C1")
        with contextlib.suppress(ValueError):
            x, M = stability.equilibrium_and_jacobian(
                flight_experiment, initial_states.equilibrium_state(changed, flight_experiment.world.team)
            )
            evaluated.append((delay_margin(changed, x, M), option))
    better = sorted((candidate for candidate in evaluated if candidate[0] > current), reverse=True)[:MAX_CANDIDATES]
    advice = tuple(f"{option} yields {margin:.3g} s" for margin, option in better)
    if not advice and budget.exhausted:
        return (budget.ended,)
    return advice or (f"a reduction of single gains does not help: raise control_Hz above {settings.control_Hz:g}",)


def contact_spacing_changes(settings: Scenario) -> Iterator[ScenarioChange]:
    """Yield scenarios with the contacts of every agent scaled about their mean."""
    for factor in (1.5, 2.0, 3.0, 4.0, 0.6):
        agents = []
        for agent in settings.agents:
            c = np.array(agent.contact_positions_m)
            scaled = c.mean(0) + factor * (c - c.mean(0))
            agents.append(agent.model_copy(update={"contact_positions_m": tuple(map(tuple, scaled.round(4).tolist()))}))
        option = " ".join(
            f"--set 'agents.{agent.name}.contact_positions_m={[list(c) for c in agent.contact_positions_m]}'"
            for agent in agents
            if len(agent.contact_positions_m) > 1
        )
        yield option, settings.model_copy(update={"agents": tuple(agents)})


def gain_changes(settings: Scenario, names: Sequence[str] = GAINS) -> Iterator[ScenarioChange]:
    """Yield scenarios with each of some gains reduced and increased."""
    for name in names:
        present = np.array(getattr(settings.control, name))
        for factor in (0.7, 1.4):
            new = [float(f"{x:.3g}") for x in np.atleast_1d(factor * present)]
            yield control_change(settings, name, new if present.shape else new[0])


def translation_change(settings: Scenario, limits: gain_limits.TranslationLimits) -> ScenarioChange:
    """Return the change to the gains that bound tips permit (`gain_limits.TranslationLimits.advise`).

    Args:
        settings: Scenario.
        limits: Limits of the team.

    Returns:
        The change of `K_p`, `K_v` and `agent_k_R`; gains that are low enough are kept.
    """
    advised, present, changed, options = limits.advise(settings.control), settings.control, settings, []
    for name in ("K_p", "K_v"):
        *horizontal, vertical = np.broadcast_to(getattr(present, name), 3).tolist()
        new = [min(x, getattr(advised, name)) for x in horizontal]
        if new != horizontal:
            option, changed = control_change(changed, name, [*new, vertical])
            options.append(option)
    if advised.agent_k_R < present.agent_k_R:
        option, changed = control_change(changed, "agent_k_R", advised.agent_k_R)
        options.append(option)
    return " ".join(options), changed


def posture_bandwidth_changes(settings: Scenario, rate: float) -> Iterator[ScenarioChange]:
    """Yield scenarios with a lower posture bandwidth, or with a positive one if it is zero."""
    required = settings.control.posture_bandwidth
    for value in dict.fromkeys(float(f"{x:.2g}") for x in ((required / 2, rate) if required else (1.0, 3.0))):
        if value > 0:
            yield control_change(settings, "posture_bandwidth", value)


def control_change(settings: Scenario, name: str, value: float | list[float]) -> ScenarioChange:
    """Return the change of one controller setting; equal gains are one number, others are quoted for the shell."""
    control = settings.control.model_copy(update={name: value})
    changed = settings.model_copy(update={"control": control})
    if not isinstance(value, list):
        return f"--set control.{name}={value}", changed
    if len(set(value)) == 1:
        return f"--set control.{name}={value[0]}", changed
    return f"--set 'control.{name}=[{','.join(f'{x:g}' for x in value)}]'", changed


def nominal_position_changes(settings: Scenario, name: str | None = None) -> Iterator[ScenarioChange]:
    """Yield scenarios with the nominal position of a revolute joint changed by 0.2 rad.

    Args:
        settings: Scenario.
        name: Name of the joint; None for all joints.

    Yields:
        The changes.
    """
    for kind, agent_type in settings.agent_types.items():
        for k, joint in enumerate(agent_type.joints):
            if joint.type != "revolute" or name not in (None, joint.name):
                continue
            for step in (-0.2, 0.2):
                value = round(joint.nominal_position_rad + step, 3)
                changed = joint.model_copy(update={"nominal_position_rad": value})
                changed_type = agent_type.model_copy(
                    update={"joints": (*agent_type.joints[:k], changed, *agent_type.joints[k + 1 :])}
                )
                types = settings.agent_types | {kind: changed_type}
                yield (
                    f"--set {joint_limits.nominal_position_path(settings, kind, joint)}={value}",
                    settings.model_copy(update={"agent_types": types}),
                )


def contact_height_changes(settings: Scenario) -> Iterator[ScenarioChange]:
    """Yield scenarios with all contacts moved up and down by 5 cm.

    The height determines whether the agents rotate about points above or below their centers of mass.

    Args:
        settings: Scenario.

    Yields:
        The changes.
    """
    for step in (-0.05, 0.05):
        agents = tuple(
            agent.model_copy(
                update={
                    "contact_positions_m": tuple((x, y, round(h + step, 4)) for x, y, h in agent.contact_positions_m)
                }
            )
            for agent in settings.agents
        )
        option = " ".join(
            f"--set agents.{agent.name}.contact_positions_m.{b}.2={c[2]}"
            for agent in agents
            for b, c in enumerate(agent.contact_positions_m)
        )
        yield option, settings.model_copy(update={"agents": agents})
