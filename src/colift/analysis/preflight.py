"""Preflight check of a scenario: mass, thrust, grasp, slowest mode, delay and gain margin.

Each check returns a `Finding` with values, a message, and advice if the check failed.

See Also:
    colift.analysis.remedies: the changes that the advice proposes.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from colift.analysis import joint_limits, learning_benefit, reference_checks, reference_loads, remedies, stability
from colift.closed_loop import flight
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import State
from colift.onboard.control import label_feedback
from colift.scenario import (
    Scenario,
    ScenarioError,
    controllers,
    experiment,
    initial_states,
    structure,
    team,
    termination,
)

MAX_GRASP_CONDITION = 30.0  # of the grasp matrix with moments divided by the RMS distance of the contacts
MIN_DELAY_MARGIN = 0.002  # s, typical delay of a bus and a flight controller
MAX_LINEARIZED_JOINTS = 10  # of an agent; the time of compilation grows with them
SAMPLE_TIMES = 400  # times on the reference at which the required thrust is evaluated


@dataclasses.dataclass(frozen=True)
class Finding:
    """Result of one check."""

    subject: str  # what was checked
    message: str  # one sentence with values and units
    values: dict[str, Any]  # the values by name, with units in the names
    advice: tuple[str, ...] = ()  # proposed changes; empty if and only if the check passed


@dataclasses.dataclass(frozen=True)
class PreflightReport:
    """All findings of a scenario; few if the team cannot be built or has no equilibrium."""

    scenario: str
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> bool:
        """True if no check failed."""
        return not any(found.advice for found in self.findings)

    @property
    def summary(self) -> dict[str, Any]:
        """Result and findings as printed by `check --json`; a key of `checks` is the subject of a finding."""
        checks = {
            finding.subject.replace(" ", "_"): {
                "passed": not finding.advice,
                "message": finding.message,
                "advice": list(finding.advice),
                **finding.values,
            }
            for finding in self.findings
        }
        return {"scenario": self.scenario, "passed": self.passed, "checks": checks}

    def format_report(self) -> list[str]:
        """Format the findings for the terminal: one line each, advice below failed ones, the result last."""
        lines, width = [], max(len(finding.subject) for finding in self.findings)
        for finding in self.findings:
            lines.append(f"{finding.subject:{width}}  {finding.message}")
            lines += [f"{'':{width}}  advice: {advice}" for advice in finding.advice]
        failed = [finding.subject for finding in self.findings if finding.advice]
        return [*lines, f"{self.scenario}: {'failed: ' + ', '.join(failed) if failed else 'passed'}"]


def run_preflight(
    settings: Scenario,
    progress: Callable[[str], None] = lambda _what: None,
    thrust_margin: float = termination.HOVER_THRUST_MARGIN,
) -> PreflightReport:
    r"""Build a scenario, linearize its sampled loop at equilibrium, and check both.

    A scenario that cannot be built yields a finding with the reason.

    Args:
        settings: Scenario.
        progress: Function called with a description of the progress.
        thrust_margin: Share of an agent's largest thrust that must remain in hover and on the reference.

    Returns:
        The findings.

    Example:
        ::

            report = run_preflight(colift.load_scenario("paper"))
            print("\n".join(report.format_report()))
    """
    truth, nominal = team.team(settings)
    findings = [_mass(settings, truth, nominal)]
    if errors := structure.structural_errors(settings, truth):
        refused = Finding(
            "build", "; ".join(error.message for error in errors), {}, tuple(error.advice for error in errors)
        )
        return PreflightReport(settings.name, (*findings, refused))
    try:
        findings.append(_contacts(settings, truth))
        progress("team")
        flight_experiment = experiment.make_experiment(settings, "C1")
        z = initial_states.equilibrium_state(settings, truth)
        findings.append(_thrust(settings, flight_experiment, z, thrust_margin))
        findings += [*_reference(settings, truth)]
        findings += [*_joints(settings, truth, z), *_limits(settings, z), *_labels(settings, nominal)]
        findings += _learnable(settings, flight_experiment, z)
    except ScenarioError as error:
        return PreflightReport(
            settings.name,
            (
                *findings,
                Finding("build", str(error), {}, remedies.advice_for_rejection(settings, str(error), progress)),
            ),
        )
    largest = max(len(settings.agent_types[agent.type].joints) for agent in settings.agents)
    if largest > MAX_LINEARIZED_JOINTS:
        message = f"not evaluated: the linearization for an agent with {largest} joints takes minutes"
        advice = f"use agents with at most {MAX_LINEARIZED_JOINTS} joints, or simulate the team with `colift study`"
        return PreflightReport(
            settings.name, (*findings, Finding("slowest mode", message, {"stable": None}, (advice,)))
        )
    progress("linearization at equilibrium")
    try:
        x, M = stability.equilibrium_and_jacobian(flight_experiment, z)
    except ValueError as error:
        no_equilibrium = Finding(
            "equilibrium", str(error), {}, ("reduce control.K_p and control.agent_k_R by half and repeat the check",)
        )
        return PreflightReport(settings.name, (*findings, no_equilibrium))
    modes = stability.compute_modes(x, M, flight_experiment.dt)
    mode_finding = Finding(
        "slowest mode",
        _describe_mode(settings, modes),
        {"stable": modes.stable, "eigenvalue_radps": list(modes.slowest_eigenvalue)},
        () if modes.stable else remedies.stabilizing_changes(settings, x, M, progress),
    )
    delay = (*_posture(settings, modes, progress), _delay(settings, x, M, progress)) if modes.stable else ()
    gain_findings = _gain(x, M) if modes.stable else ()
    return PreflightReport(
        settings.name, (*findings, mode_finding, *_learned_mode(settings, progress), *delay, *gain_findings)
    )


def with_true_parameters(settings: Scenario) -> Scenario:
    """Return the scenario with the true parameters in the controller, as after successful learning."""
    nominal = settings.nominal.model_copy(update={"payload": None, "agent_types": {}})
    return settings.model_copy(update={"nominal": nominal})


def _learned_mode(settings: Scenario, progress: Callable[[str], None]) -> Iterator[Finding]:
    """Check the slowest mode with true parameters in the controller, if they differ from the nominal ones."""
    true_parameters = with_true_parameters(settings)
    if true_parameters == settings:
        return
    progress("linearization at equilibrium, true parameters")
    try:
        modes = remedies.modes_at_equilibrium(true_parameters)
    except ValueError as error:
        yield Finding("learned mode", f"with true parameters: {error}", {}, ("see equilibrium",))
        return
    yield Finding(
        "learned mode",
        f"slowest mode with true parameters {_describe_mode(true_parameters, modes)}",
        {"stable": modes.stable, "eigenvalue_radps": list(modes.slowest_eigenvalue)},
        () if modes.stable else ("use `colift tune`, which includes this equilibrium",),
    )


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


def _posture(settings: Scenario, modes: stability.Modes, progress: Callable[[str], None]) -> Iterator[Finding]:
    """Check the convergence rate of the redundant joints; it fails below half of the required rate."""
    required = settings.control.posture_bandwidth
    if not is_redundant(settings) or (mode := remedies.slowest_joint_mode(modes)) is None:
        return
    rate, joint = mode[0], team.joint_names(settings)[mode[1]]
    yield Finding(
        "posture",
        f"redundant joints converge at {rate:.3g} 1/s, slowest {joint}; control.posture_bandwidth = {required:g}",
        {"convergence_rate_1ps": rate, "posture_bandwidth_1ps": required},
        remedies.posture_changes(settings, rate, joint, progress) if rate < required / 2 or required == 0 else (),
    )


def _mass(settings: Scenario, truth: Team, nominal: Team) -> Finding:
    """Report masses and the ratio of maximum thrust to weight."""
    names = team.agent_names(settings)
    agents = dict(zip(names, np.concatenate([group.mass.sum(1) for group in truth.agent_groups]).tolist(), strict=True))
    payload_mass, nominal_mass = float(truth.payload.mass), float(nominal.payload.mass)
    total, thrust = (
        payload_mass + sum(agents.values()),
        float(sum(group.thrust_max.sum() for group in truth.agent_groups)),
    )
    weight = total * float(np.linalg.norm(truth.gravity))
    nominal_note = f" (nominal {nominal_mass:.4g} kg)" if nominal_mass != payload_mass else ""
    description = f"payload {payload_mass:.4g} kg{nominal_note}"
    for mass, names_alike in itertools.groupby(names, key=lambda name: f"{agents[name]:.4g}"):
        first, *others = names_alike
        description += (
            f", {len(others) + 1} agents from {first} to {others[-1]} of {mass} kg each"
            if len(others) > 1
            else "".join(f", {name} {mass} kg" for name in (first, *others))
        )
    lift = f"; maximum thrust {thrust / weight:.3g} times the weight" if weight else ""
    return Finding(
        "mass",
        f"{total:.4g} kg: {description}{lift}",
        {
            "total_kg": total,
            "payload_kg": payload_mass,
            "nominal_payload_kg": nominal_mass,
            "agents_kg": agents,
            "thrust_max_N": thrust,
        },
    )


def _contacts(settings: Scenario, truth: Team) -> Finding:
    """Check rank and condition number of the grasp matrix."""
    c, names = np.asarray(grasp.contact_points(truth)), team.contact_names(settings)
    length = max(float(np.sqrt((c**2).sum(1).mean())), 1e-9)
    values = grasp.grasp_matrix_singular_values(truth, length)
    rank, condition = int((values[0] < 1e6 * values).sum()), float(values[0] / max(values[-1], 1e-300))
    advice: tuple[str, ...] = ()
    if rank < 6 or condition > MAX_GRASP_CONDITION:
        line = np.linalg.svd(c - c.mean(0))[2][0]
        farthest = int(np.argmax(np.linalg.norm(np.cross(c - c.mean(0), line), axis=1)))
        advice = (
            f"the contacts are nearly collinear along ({', '.join(f'{x:.2f}' for x in line)}): "
            f"move {names[farthest]} away from this line (agents: contact_positions_m), or add an agent beside it",
        )
    return Finding(
        "contacts",
        f"grasp matrix of {len(c)} contacts has rank {rank} of 6, condition {condition:.3g}",
        {"rank": rank, "condition_number": condition},
        advice,
    )


def _joints(settings: Scenario, truth: Team, state: State) -> Iterator[Finding]:
    """Check every agent's grasp Jacobian at equilibrium; no finding for agents without joints."""
    conditions, advice = remedies.grasp_jacobian_conditions(settings, truth, state), []
    agent_types = {agent.name: agent.type for agent in settings.agents}
    for name, agent, r, _ in grasp.iter_agents(truth, state, team.agent_names(settings)):
        if conditions[name] > remedies.MAX_JACOBIAN_CONDITION and len(r):
            k = int(np.argmax(grasp.grasp_jacobian_svd(agent, r)[1]))
            joint = settings.agent_types[agent_types[name]].joints[k]
            advice.append(
                f"{name}: move the nominal position of joint {joint.name} away from {float(r[k]):.3g} "
                f"({joint_limits.nominal_position_path(settings, agent_types[name], joint)}), or move its contact"
            )
    if any(len(settings.agent_types[agent_type].joints) for agent_type in agent_types.values()):
        worst = max(conditions, key=lambda name: conditions[name])
        message = f"largest condition number of the grasp Jacobians {conditions[worst]:.3g} ({worst})"
        yield Finding("joints", message, {"condition_number": conditions}, tuple(advice))


def _limits(settings: Scenario, state: State) -> Iterator[Finding]:
    """Check the nominal and equilibrium positions of joints against their limits."""
    equilibrium = np.concatenate([np.asarray(group.r).ravel() for group in state.agents])
    sentences, advice = joint_limits.position_violations(settings, equilibrium)
    if sentences:
        yield Finding("joint limits", "; ".join(sentences), {"violations": list(sentences)}, advice)


def _thrust(settings: Scenario, experiment: flight.Experiment, state: State, margin: float) -> Finding:
    """Check that a share of the thrust remains in hover and on the reference."""
    names = team.agent_names(settings)
    available = np.concatenate([group.thrust_max for group in experiment.world.team.agent_groups])
    t = np.linspace(0.0, experiment.duration, SAMPLE_TIMES)
    hover = termination.true_hover_thrust(
        settings, experiment.world.team, experiment.controller, experiment.world.disturbances
    )
    reference_thrust = reference_loads.thrust_profile(experiment, state, t)
    margins = [1 - hover / available, 1 - reference_thrust.max(0) / available]
    smallest = [int(np.argmin(values)) for values in margins]
    worst_time = float(t[int(np.argmax(reference_thrust[:, smallest[1]]))])
    hover_ok, advice = margins[0][smallest[0]] >= margin, []
    for k, phase in enumerate(("hover", "reference")):
        if margins[k][smallest[k]] < margin:
            name, required = names[smallest[k]], hover if k == 0 else reference_thrust.max(0)
            agent_type = next(agent.type for agent in settings.agents if agent.name == name)
            thrust_max = required[smallest[k]] / (1 - margin)
            proposal = f"{phase}: raise agent_types.{agent_type}.thrust_max_N to {thrust_max:.3g} or more"
            if required.sum() < (1 - margin) * available.sum():
                proposal += (
                    f", or move the contacts of {name} away from the payload's center of mass, so that the others "
                    "carry more"
                )
            else:  # the total thrust is too small
                proposal += ", lower payload.mass_kg, or add an agent"
            if k == 1 and hover_ok and settings.reference.kind == "lissajous":
                proposal += f", or use {reference_checks.slower_reference(settings)}"
            elif k == 1 and hover_ok:
                proposal += ", or use a slower reference"
            advice.append(proposal)
    return Finding(
        "thrust",
        f"smallest margin in hover {margins[0][smallest[0]]:.1%} of {available[smallest[0]]:.4g} N "
        f"({names[smallest[0]]}), on the reference {margins[1][smallest[1]]:.1%} ({names[smallest[1]]}, "
        f"at {worst_time:.3g} s)",
        {
            "hover_thrust_N": dict(zip(names, hover.tolist(), strict=True)),
            "max_reference_thrust_N": dict(zip(names, reference_thrust.max(0).tolist(), strict=True)),
            "thrust_max_N": dict(zip(names, available.tolist(), strict=True)),
        },
        tuple(advice),
    )


def _reference(settings: Scenario, truth: Team) -> Iterator[Finding]:
    """Check overshoot and acceleration of a reference through poses."""
    if (found := reference_checks.check_reference(settings, truth)) is not None:
        yield Finding("reference", found.message, found.values, found.advice)


def _learnable(settings: Scenario, experiment: flight.Experiment, state: State) -> Iterator[Finding]:
    """Report label errors that exceed what is to be learned; not evaluated with random residuals."""
    if settings.random_residual is not None:
        return
    world = experiment.world
    t = np.linspace(0.0, experiment.duration, SAMPLE_TIMES)
    payload, agents = reference_loads.residual_forces(experiment, state, t)
    names = team.agent_names(settings)
    found = learning_benefit.label_quality(settings, world.team, names, payload, agents)
    if message := learning_benefit.describe_exceeded(found):
        values = {
            each.name: {"residual_N": each.residual, "bias_N": each.bias, "noise_N": each.noise} for each in found
        }
        yield Finding("learning", message, {"label_errors": values})


def _rate(modes: stability.Modes) -> str:
    """Format the slowest eigenvalue with the period of its oscillation."""
    real, imaginary = modes.slowest_eigenvalue
    period = f", period {2 * np.pi / abs(imaginary):.3g} s" if abs(imaginary) > 1e-3 else ""
    return f"{real:+.3g} rad/s{period}"


def _describe_mode(settings: Scenario, modes: stability.Modes) -> str:
    """Describe rate, stability and participation of the slowest mode."""
    return f"{_rate(modes)}, {'' if modes.stable else 'unstable, '}moves {mode_participation(settings, modes)}"


TURN_DIRECTIONS = ("roll", "pitch", "yaw")


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


def _delay(settings: Scenario, x: stability.LoopStateTree, M: np.ndarray, progress: Callable[[str], None]) -> Finding:
    """Check the delay margin; it fails below `MIN_DELAY_MARGIN`."""
    try:
        margin = remedies.delay_margin(settings, x, M)
    except ValueError as error:
        return Finding("delay margin", f"not known: {error}", {"delay_margin_s": None})
    message = f"{margin:.3g} s" + (" or more" if margin > stability.MAX_DELAY - 1 / settings.control_Hz else "")
    return Finding(
        "delay margin",
        message,
        {"delay_margin_s": margin},
        remedies.delay_margin_changes(settings, margin, progress) if margin < MIN_DELAY_MARGIN else (),
    )


def _labels(settings: Scenario, nominal: Team) -> Iterator[Finding]:
    """Report agents whose label loop gain limits the use of their label rates."""
    gains = dict(
        zip(team.agent_names(settings), itertools.chain(*controllers.label_loop_gains(settings, nominal)), strict=True)
    )
    largest = max(gains, key=lambda name: gains[name])
    if (attenuation := label_feedback.rate_attenuation(gains[largest])) < 1:
        if np.isfinite(gains[largest]):
            reason = f"has a label loop gain of {gains[largest]:.2g}"
        elif np.any(settings.gravity_mps2):
            reason = "has straight arms at its nominal joint positions, so that its label loop gain is not known"
        else:
            reason = "has no weight, so that its thrust direction is not determined"
        share = f"{100 * attenuation:.2g}%" if attenuation else "none"
        yield Finding(
            "label loop gain",
            f"{largest} {reason}: cases with label feedback use {share} of its label rates and respond later to gusts",
            {"label_loop_gain": {name: gain if np.isfinite(gain) else None for name, gain in gains.items()}},
        )


def _gain(x: stability.LoopStateTree, M: np.ndarray) -> Iterator[Finding]:
    """Report the gain margin, if it is known."""
    try:
        gain = stability.gain_margin(x, M)
    except ValueError:  # `_delay` reports the reason
        return
    yield Finding(
        "gain margin",
        stability.format_gain_margin(gain),
        {"gain_margin": list(gain)},
    )
