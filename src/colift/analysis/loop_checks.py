"""Checks of the linearized closed loop of a scenario: modes, margins, and displacement by constant disturbances.

See Also:
    colift.analysis.stability: linearization.
    colift.analysis.remedies: the changes that the advice proposes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from threadpoolctl import threadpool_limits

from colift.analysis import remedies, stability
from colift.analysis.findings import Finding, Level, failure
from colift.closed_loop import flight
from colift.models.state import State
from colift.scenario import Scenario, experiment, initial_states, team

MAX_TIME_SHARE = 1 / 3
"""Largest time constant of the slowest mode, relative to the duration of the run."""
MIN_DAMPING = 0.1
"""Damping ratio of a payload mode below which the loop is weak."""
MIN_PAYLOAD_SHARE = 0.2
"""Smallest amplitude of the payload, relative to the largest pose amplitude, in a payload mode."""
MIN_DELAY_MARGIN = 0.002
"""Delay margin below which the check fails: typical delay of a bus and a flight controller [s]."""
WEAK_DELAY_MARGIN = 0.010
"""Delay margin below which the loop is weak [s]."""
WEAK_GAIN_MARGIN = (0.7, 1.4)
"""Gains of all commands with which the loop should be stable."""
TURN_DIRECTIONS = ("roll", "pitch", "yaw")  # names of the components of a rotation vector


@dataclasses.dataclass(frozen=True)
class LoopAnalysis:
    """Linearized loop of one case at equilibrium."""

    equilibrium: stability.LoopStateTree  # loop states by path
    step_jacobian: np.ndarray  # of one tick at the equilibrium
    dt: float  # s, control period
    modes: stability.Modes  # at the equilibrium
    margins: stability.Margins | None  # None if the loop is unstable or the margins are not known
    unknown_margins: str = ""  # reason for which the margins of a stable loop are not known


def analyze_loop(case_experiment: flight.Experiment, state: State) -> LoopAnalysis:
    """Linearize the loop of an experiment at equilibrium.

    Args:
        case_experiment: Experiment.
        state: Initial guess of the team state.

    Returns:
        The loop with its modes and margins.

    Raises:
        ValueError: If no equilibrium is found near the state.
    """
    dt, margins, reason = case_experiment.dt, None, ""
    with threadpool_limits(1):  # the matrices are small
        x, M = stability.equilibrium_and_jacobian(case_experiment, state)
        modes = stability.compute_modes(x, M, dt)
        if modes.stable:
            try:
                margins = stability.stability_margins(x, M, dt)
            except ValueError as error:
                reason = str(error)
    return LoopAnalysis(x, M, dt, modes, margins, reason)


# Modes ----------------------------------------------------------------------------------------------------------------


def damping_ratios(modes: stability.Modes) -> np.ndarray:
    """Compute the damping ratio `-Re / |.|` of every mode."""
    return -modes.eigenvalues.real / np.abs(modes.eigenvalues)


def least_damped_payload_mode(modes: stability.Modes) -> int | None:
    """Find the oscillating mode with the smallest damping ratio of those that move the payload; None if none does."""
    moves_payload = modes.payload.max(1) > MIN_PAYLOAD_SHARE
    damping = np.where(moves_payload & (modes.eigenvalues.imag != 0), damping_ratios(modes), np.inf)
    k = int(np.argmin(damping))
    return k if np.isfinite(damping[k]) else None


def mode_weaknesses(modes: stability.Modes, duration: float) -> tuple[str, ...]:
    """Describe why stable modes are weak.

    Args:
        modes: Modes of the loop.
        duration: Duration of the run [s].

    Returns:
        One clause per reason: a slow mode, a hardly damped payload mode; none if the modes are sound.
    """
    reasons, rate = [], -modes.slowest_eigenvalue[0]
    if rate * duration * MAX_TIME_SHARE < 1:
        reasons.append(f"its time constant of {1 / rate:.3g} s exceeds a third of the run of {duration:g} s")
    elif rate < remedies.MIN_DECAY_RATE:
        reasons.append(f"it decays by less than {remedies.MIN_DECAY_RATE:g} 1/s")
    k = least_damped_payload_mode(modes)
    if k is not None and (damping := damping_ratios(modes)[k]) < MIN_DAMPING:
        value = modes.eigenvalues[k]
        reasons.append(f"the payload mode {value.real:+.3g} {abs(value.imag):+.3g}i rad/s has damping {damping:.2g}")
    return tuple(reasons)


def check_mode(
    settings: Scenario, loop: LoopAnalysis, progress: Callable[[str], None], search: remedies.SearchBudget | None
) -> Finding:
    """Check the slowest mode, and the damping of the payload modes.

    Args:
        settings: Scenario.
        loop: Its loop.
        progress: Function called with a description of the progress.
        search: Candidates of the search for advice; None for no search.

    Returns:
        The finding: failed if the mode is unstable, weak by `mode_weaknesses`.
    """
    modes, advice = loop.modes, ()
    weaknesses = mode_weaknesses(modes, settings.duration_s) if modes.stable else ()
    level = Level.failed if not modes.stable else Level.weak if weaknesses else Level.passed
    if search and level is not Level.passed:
        slow = not modes.stable or -modes.slowest_eigenvalue[0] < max(
            remedies.MIN_DECAY_RATE, 1 / (MAX_TIME_SHARE * settings.duration_s)
        )
        k = 0 if slow else least_damped_payload_mode(modes)
        advice = remedies.stabilizing_changes(
            settings, loop.equilibrium, loop.step_jacobian, progress, search, *((k,) if k else ())
        )
    values = {"stable": modes.stable, "eigenvalue_radps": list(modes.slowest_eigenvalue)}
    if (k := least_damped_payload_mode(modes)) is not None:
        values["smallest_payload_damping"] = float(damping_ratios(modes)[k])
    message = "; ".join((_describe_mode(settings, modes), *weaknesses))
    return Finding("slowest mode", message, values, advice, level)


def check_learned_mode(settings: Scenario, case: str, progress: Callable[[str], None]) -> Iterator[Finding]:
    """Check the slowest mode with true parameters in the controller, if they differ from the nominal ones.

    Args:
        settings: Scenario.
        case: Case whose loop is linearized.
        progress: Function called with a description of the progress.

    Yields:
        At most one finding.
    """
    true_parameters = with_true_parameters(settings)
    if true_parameters == settings:
        return
    progress("linearization at equilibrium, true parameters")
    try:
        changed = experiment.make_experiment(true_parameters, case)
        modes = stability.modes_at_equilibrium(
            changed, initial_states.equilibrium_state(true_parameters, changed.world.team)
        )
    except ValueError as error:
        yield failure("learned mode", f"with true parameters: {error}", {}, "see equilibrium")
        return
    weaknesses = mode_weaknesses(modes, settings.duration_s) if modes.stable else ()
    message = f"slowest mode with true parameters {_describe_mode(true_parameters, modes)}"
    yield Finding(
        "learned mode",
        "; ".join((message, *weaknesses)),
        {"stable": modes.stable, "eigenvalue_radps": list(modes.slowest_eigenvalue)},
        () if modes.stable and not weaknesses else ("use `colift tune`, which includes this equilibrium",),
        Level.failed if not modes.stable else Level.weak if weaknesses else Level.passed,
    )


def with_true_parameters(settings: Scenario) -> Scenario:
    """Return the scenario with the true parameters in the controller, as after successful learning."""
    nominal = settings.nominal.model_copy(update={"payload": None, "agent_types": {}})
    return settings.model_copy(update={"nominal": nominal})


def is_redundant(settings: Scenario) -> bool:
    """Return whether an agent has joints that contacts and attitude do not determine, `n_r > 3 n - 3`.

    `control.posture_bandwidth` applies to these joints.

    Args:
        settings: Scenario.

    Returns:
        True if any agent is redundant.
    """
    agent_types = (settings.agent_types[agent.type] for agent in settings.agents)
    return any(len(agent_type.joints) > 3 * len(agent_type.arms) - 3 for agent_type in agent_types)


def check_posture(
    settings: Scenario, modes: stability.Modes, progress: Callable[[str], None], search: remedies.SearchBudget | None
) -> Iterator[Finding]:
    """Check the convergence rate of the redundant joints; the finding is weak below half of the required rate.

    Args:
        settings: Scenario.
        modes: Modes of its loop.
        progress: Function called with a description of the progress.
        search: Candidates of the search for advice; None for no search.

    Yields:
        At most one finding.
    """
    required = settings.control.posture_bandwidth
    if not is_redundant(settings) or (mode := remedies.slowest_joint_mode(modes)) is None:
        return
    rate, joint = mode[0], team.joint_names(settings)[mode[1]]
    slow = rate < required / 2 or required == 0
    yield Finding(
        "posture",
        f"redundant joints converge at {rate:.3g} 1/s, slowest {joint}; control.posture_bandwidth = {required:g}",
        {"convergence_rate_1ps": rate, "posture_bandwidth_1ps": required},
        remedies.posture_changes(settings, rate, joint, progress, search) if slow and search else (),
        Level.weak if slow else Level.passed,
    )


def _rate(modes: stability.Modes) -> str:
    """Format the slowest eigenvalue with the period of its oscillation."""
    real, imaginary = modes.slowest_eigenvalue
    period = f", period {2 * np.pi / abs(imaginary):.3g} s" if abs(imaginary) > 1e-3 else ""
    return f"{real:+.3g} rad/s{period}"


def _describe_mode(settings: Scenario, modes: stability.Modes) -> str:
    """Describe rate, stability and participation of the slowest mode."""
    return f"{_rate(modes)}, {'' if modes.stable else 'unstable, '}moves {mode_participation(settings, modes)}"


def mode_participation(settings: Scenario, modes: stability.Modes, max_entries: int = 3) -> str:
    """Describe the largest amplitudes of the slowest mode: payload, agents' attitudes and joints.

    Args:
        settings: Scenario, which contains the names.
        modes: Modes of the loop.
        max_entries: Largest number of entries.

    Returns:
        Names with amplitudes, largest first.
    """
    payload = [
        *(f"the payload in {axis_name}" for axis_name in TURN_DIRECTIONS),
        *(f"the payload along {axis}" for axis in "xyz"),
    ]
    agents = [f"{name} in {axis_name}" for name in team.agent_names(settings) for axis_name in TURN_DIRECTIONS]
    names = [*payload, *agents, *(f"joint {name}" for name in team.joint_names(settings))]
    shape = np.concatenate([modes.payload[0], modes.attitude[0].ravel(), modes.joints[0]])
    order = [k for k in np.argsort(-shape)[:max_entries] if shape[k] > 0.3 * shape.max()]
    return ", ".join(f"{names[k]} ({shape[k]:.2g})" for k in order)


# Margins and displacement ---------------------------------------------------------------------------------------------


def check_margins(
    settings: Scenario, loop: LoopAnalysis, progress: Callable[[str], None], search: remedies.SearchBudget | None
) -> Iterator[Finding]:
    """Check delay and gain margin of a stable loop.

    Args:
        settings: Scenario.
        loop: Its loop.
        progress: Function called with a description of the progress.
        search: Candidates of the search for advice; None for no search.

    Yields:
        The finding of the delay margin, and that of the gain margin if it is known.
    """
    if loop.margins is None:
        yield Finding("delay margin", f"not known: {loop.unknown_margins}", {"delay_margin_s": None})
        return
    delay, (smallest, largest) = loop.margins.delay_margin, loop.margins.gain_margin
    limits = {}
    if MIN_DELAY_MARGIN <= delay < WEAK_DELAY_MARGIN:
        ticks = round(WEAK_DELAY_MARGIN / loop.dt)
        limits[f"a delay of {WEAK_DELAY_MARGIN:g} s"] = stability.vary_loop(
            loop.equilibrium, loop.step_jacobian, loop.dt, ticks=ticks
        )
    outside = smallest > WEAK_GAIN_MARGIN[0], largest < WEAK_GAIN_MARGIN[1]
    for gain, weak in zip(WEAK_GAIN_MARGIN, outside, strict=True):
        if weak:
            limits[f"{gain:g} times the commands"] = stability.vary_loop(
                loop.equilibrium, loop.step_jacobian, loop.dt, gain
            )
    found = remedies.margin_changes(settings, loop.equilibrium, limits, search) if search and limits else {}
    advice, level = tuple(text for name, text in found.items() if "delay" in name), Level.passed
    if delay < MIN_DELAY_MARGIN:
        level = Level.failed
        advice = remedies.delay_margin_changes(settings, delay, progress, search) if search else ()
    elif delay < WEAK_DELAY_MARGIN:
        level = Level.weak
    at_least = " or more" if delay > stability.MAX_DELAY - 1 / settings.control_Hz else ""
    yield Finding("delay margin", f"{delay:.3g} s{at_least}", {"delay_margin_s": delay}, advice, level)
    yield Finding(
        "gain margin",
        stability.format_gain_margin((smallest, largest)),
        {"gain_margin": [smallest, largest]},
        tuple(text for name, text in found.items() if "delay" not in name),
        Level.weak if any(outside) else Level.passed,
    )


def check_disturbances(
    settings: Scenario, case_experiment: flight.Experiment, state: State, loop: LoopAnalysis
) -> Finding:
    """Report how far the disturbances move the payload at rest; the finding is weak beyond the termination limits.

    Args:
        settings: Scenario.
        case_experiment: Experiment of the loop.
        state: Initial guess of the team state.
        loop: A stable loop.

    Returns:
        The finding.
    """
    p, theta = stability.rest_displacement(case_experiment, state, loop.equilibrium, loop.step_jacobian)
    distance, degrees = float(np.linalg.norm(p)), np.degrees(theta)
    largest = int(np.argmax(np.abs(degrees)))
    limits = settings.termination
    angle = float(np.linalg.norm(degrees))
    advice = []
    if distance > limits.max_position_error_m:
        advice.append(f"raise control.K_p; termination.max_position_error_m = {limits.max_position_error_m:g}")
    if angle > limits.max_attitude_error_deg:
        advice.append(f"raise control.k_R; termination.max_attitude_error_deg = {limits.max_attitude_error_deg:g}")
    return Finding(
        "disturbances",
        f"at rest they move the payload by {1e3 * distance:.3g} mm and {angle:.2g} deg, most in "
        f"{TURN_DIRECTIONS[largest]}, without learning",
        {"displacement_m": p.tolist(), "rotation_deg": degrees.tolist()},
        tuple(advice),
        Level.weak if advice else Level.passed,
    )
