"""Preflight check of a scenario: mass, thrust, grasp, slowest mode, delay and gain margin.

Each check returns a `Finding` with values, a message, and advice if the check failed.

See Also:
    colift.analysis.remedies: the changes that the advice proposes.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence

import jax.numpy as jnp
import numpy as np

from colift.analysis import (
    bound_axes,
    bound_axis_checks,
    hover_allocation,
    joint_limits,
    learning_benefit,
    loop_checks,
    reference_checks,
    reference_loads,
    remedies,
    thrust_loss,
)
from colift.analysis.findings import Finding, Level, PreflightReport, failure
from colift.closed_loop import flight
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import State
from colift.onboard.control import bound_tips, label_feedback
from colift.scenario import (
    Scenario,
    ScenarioError,
    controllers,
    experiment,
    gain_limits,
    initial_states,
    structure,
    team,
    termination,
)

MAX_UNTRACKED_TILT_DEG = 1.0  # tilt of a reference that counts as level
MAX_GRASP_CONDITION = 30.0  # of the grasp matrix with moments divided by the RMS distance of the contacts
MAX_LINEARIZED_JOINTS = 8  # of an agent; the time of compilation grows with them, with 10 to 100 s
MAX_BUILT_JOINTS = 16  # of an agent; the equations of a larger one take more than a minute to compile
SAMPLE_TIMES = 400  # times on the reference at which the required thrust is evaluated
WEAK_THRUST_MARGIN = 0.2  # share of the largest thrust below which the remaining thrust is weak


def run_preflight(
    settings: Scenario,
    progress: Callable[[str], None] = lambda _what: None,
    thrust_margin: float = termination.HOVER_THRUST_MARGIN,
    search: bool = True,
    report: Callable[[Finding], None] = lambda _finding: None,
) -> PreflightReport:
    r"""Build a scenario, linearize its sampled loop at equilibrium, and check both.

    A scenario that cannot be built yields a finding with the reason.

    Args:
        settings: Scenario.
        progress: Function called with a description of the progress.
        thrust_margin: Share of an agent's largest thrust that must remain in hover and on the reference.
        search: Whether to search for advice that requires further linearizations.
        report: Function called with each finding as soon as it is known.

    Returns:
        The findings.

    Example:
        ::

            report = run_preflight(colift.load_scenario("paper"))
            print("\n".join(report.format_report()))
    """
    truth, nominal = team.team(settings)
    found, budget = _Findings(report), remedies.SearchBudget.for_team(settings)
    found.add([_mass(settings, truth, nominal)])
    if errors := structure.structural_errors(settings, truth):
        message = "; ".join(error.message for error in errors)
        found.add([failure("build", message, {}, *(error.advice for error in errors))])
        return PreflightReport(settings.name, tuple(found.items))
    found.add([_contacts(settings, truth)])
    largest = max(len(settings.agent_types[agent.type].joints) for agent in settings.agents)
    try:
        if largest > MAX_BUILT_JOINTS:
            found.add(_unbuilt(settings, truth, nominal, largest, thrust_margin))
            return PreflightReport(settings.name, tuple(found.items))
        progress("team")
        c1 = experiment.make_experiment(settings, "C1")
        _check_built(found, settings, c1, "C1", progress, thrust_margin, budget if search else None)
    except ScenarioError as error:
        advice = remedies.advice_for_rejection(settings, str(error), progress, budget)
        found.items = found.items[:2]  # mass and contacts
        found.add([failure("build", str(error), {}, *advice)])
    return PreflightReport(settings.name, tuple(found.items))


def check_experiment(
    settings: Scenario,
    case_experiment: flight.Experiment,
    case: str,
    progress: Callable[[str], None] = lambda _what: None,
    thrust_margin: float = termination.HOVER_THRUST_MARGIN,
    search: bool = True,
) -> tuple[PreflightReport, loop_checks.LoopAnalysis | None]:
    """Check a scenario whose experiment has been built.

    Args:
        settings: Scenario.
        case_experiment: Experiment of the case whose loop is linearized.
        case: Identifier of this case.
        progress: Function called with a description of the progress.
        thrust_margin: Share of an agent's largest thrust that must remain in hover and on the reference.
        search: Whether to search for advice that requires further linearizations.

    Returns:
        The findings, and the linearized loop; None if it has no equilibrium or is not evaluated.
    """
    truth, nominal = team.team(settings)
    found = _Findings(lambda _finding: None)
    found.add([_mass(settings, truth, nominal), _contacts(settings, truth)])
    budget = remedies.SearchBudget.for_team(settings) if search else None
    loop = _check_built(found, settings, case_experiment, case, progress, thrust_margin, budget)
    return PreflightReport(settings.name, tuple(found.items)), loop


@dataclasses.dataclass
class _Findings:
    """Findings in the order of their computation, each of which is reported once."""

    report: Callable[[Finding], None]
    items: list[Finding] = dataclasses.field(default_factory=list)

    def add(self, findings: Iterable[Finding]) -> None:
        """Append findings as they are computed."""
        for finding in findings:
            self.items.append(finding)
            self.report(finding)


def _check_built(
    found: _Findings,
    settings: Scenario,
    case_experiment: flight.Experiment,
    case: str,
    progress: Callable[[str], None],
    thrust_margin: float,
    search: remedies.SearchBudget | None,
) -> loop_checks.LoopAnalysis | None:
    """Append the findings on a team that can be built, and on its loop; see `check_experiment`."""
    truth, nominal = team.team(settings)
    z = initial_states.equilibrium_state(settings, truth)
    if impossible := tuple(hover_allocation.check_allocation(settings, case_experiment.controller, z)):
        found.add(impossible)
        return None
    found.add([_thrust(settings, case_experiment, z, thrust_margin)])
    for findings in (
        *([] if truth.is_rigid_assembly else [thrust_loss.check_losses(settings, truth, z)]),
        _reference(settings, truth),
        _joints(settings, truth, z),
        _limits(settings, z),
        _labels(settings, nominal),
        _learnable(settings, case_experiment, z),
        _bound_axes(settings, case_experiment, z),
    ):
        found.add(findings)
    largest = max(len(settings.agent_types[agent.type].joints) for agent in settings.agents)
    if largest > MAX_LINEARIZED_JOINTS:
        message = f"not evaluated: the linearization for an agent with {largest} joints takes minutes"
        advice = f"use agents with at most {MAX_LINEARIZED_JOINTS} joints, or simulate the team with `colift study`"
        found.add([Finding("slowest mode", message, {"stable": None}, (advice,), Level.weak)])
        return None
    progress("linearization at equilibrium")
    try:
        loop = loop_checks.analyze_loop(case_experiment, z)
    except ValueError as error:
        advice = "reduce control.K_p and control.agent_k_R by half and repeat the check"
        found.add([failure("equilibrium", str(error), {}, advice)])
        return None
    found.add(_loop_findings(settings, case_experiment, case, z, loop, progress, search, tuple(found.items)))
    return loop


def _loop_findings(
    settings: Scenario,
    case_experiment: flight.Experiment,
    case: str,
    state: State,
    loop: loop_checks.LoopAnalysis,
    progress: Callable[[str], None],
    search: remedies.SearchBudget | None,
    before: Sequence[Finding],
) -> Iterator[Finding]:
    """Check the linearized loop: determine the levels of all findings, then search for advice."""
    findings = [
        loop_checks.check_mode(settings, loop, progress, None),
        *loop_checks.check_learned_mode(settings, case, progress),
    ]
    if loop.modes.stable:
        findings += [
            *loop_checks.check_posture(settings, loop.modes, progress, None),
            *loop_checks.check_margins(settings, loop, progress, None),
            loop_checks.check_disturbances(settings, case_experiment, state, loop),
        ]
    advised: dict[str, Finding] = {}
    if search is not None and any(finding.level is not Level.passed for finding in findings):
        verdict = PreflightReport(settings.name, (*before, *findings)).format_verdict()
        progress(f"{verdict.partition(': ')[2]}; search for advice")
        searched = [loop_checks.check_mode(settings, loop, progress, search)]
        if loop.modes.stable:
            searched += loop_checks.check_posture(settings, loop.modes, progress, search)
            searched += loop_checks.check_margins(settings, loop, progress, search)
        advised = {finding.subject: finding for finding in searched}
    for finding in findings:
        yield advised.get(finding.subject, finding)


def _mass(settings: Scenario, truth: Team, nominal: Team) -> Finding:
    """Report masses and the ratio of maximum thrust to weight."""
    names = team.agent_names(settings)
    agents = dict(zip(names, np.concatenate([group.mass.sum(1) for group in truth.agent_groups]).tolist(), strict=True))
    payload_mass, nominal_mass = float(truth.payload.mass), float(nominal.payload.mass)
    total, thrust = (
        payload_mass + sum(agents.values()),
        float(sum(np.asarray(group.thrust_max).sum() for group in truth.agent_groups)),
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
    if truth.is_rigid_assembly:
        text = f"{len(c)} rigid grips of vehicles without joints: the team is one rigid body, which tilts to accelerate"
        return Finding("contacts", text, {"rigid_assembly": True})
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
        Level.failed if advice else Level.passed,
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
        level = Level.failed if advice else Level.passed
        yield Finding("joints", message, {"condition_number": conditions}, tuple(advice), level)


def _limits(settings: Scenario, state: State) -> Iterator[Finding]:
    """Check the nominal and equilibrium positions of joints against their limits."""
    equilibrium = np.concatenate([np.asarray(group.r).ravel() for group in state.agents])
    sentences, advice = joint_limits.position_violations(settings, equilibrium)
    if sentences:
        yield failure("joint limits", "; ".join(sentences), {"violations": list(sentences)}, *advice)


def _thrust(settings: Scenario, case_experiment: flight.Experiment, state: State, margin: float) -> Finding:
    """Check that a share of the thrust remains in hover and on the reference; weak below `WEAK_THRUST_MARGIN`."""
    names, world = team.agent_names(settings), case_experiment.world
    available = np.concatenate([group.thrust_max for group in world.team.agent_groups])
    t = np.linspace(0.0, case_experiment.duration, SAMPLE_TIMES)
    hover = termination.true_hover_thrust(settings, world.team, case_experiment.controller, world.disturbances)
    reference_thrust = reference_loads.thrust_profile(case_experiment, state, t)
    required = {"hover": hover, "reference": reference_thrust.max(0)}
    margins = {phase: 1 - thrust / available for phase, thrust in required.items()}
    smallest = {phase: int(np.argmin(values)) for phase, values in margins.items()}
    values = {phase: float(margins[phase][k]) for phase, k in smallest.items()}
    worst_time = float(t[int(np.argmax(reference_thrust[:, smallest["reference"]]))])
    worst = min(values.values())
    level = Level.failed if worst < margin else Level.weak if worst < WEAK_THRUST_MARGIN else Level.passed
    limit = margin if level is Level.failed else max(margin, WEAK_THRUST_MARGIN)
    advice = [
        _thrust_advice(settings, phase, smallest[phase], required[phase], available, limit)
        + (_slower(settings) if phase == "reference" and values["hover"] >= limit else "")
        for phase in required
        if values[phase] < limit
    ]
    first, second = smallest.values()
    return Finding(
        "thrust",
        f"smallest margin in hover {values['hover']:.1%} of {available[first]:.4g} N "
        f"({names[first]}), on the reference {values['reference']:.1%} ({names[second]}, "
        f"at {worst_time:.3g} s)",
        {
            "hover_thrust_N": dict(zip(names, hover.tolist(), strict=True)),
            "max_reference_thrust_N": dict(zip(names, required["reference"].tolist(), strict=True)),
            "thrust_max_N": dict(zip(names, available.tolist(), strict=True)),
        },
        tuple(advice),
        level,
    )


def _thrust_advice(
    settings: Scenario, phase: str, k: int, required: np.ndarray, available: np.ndarray, margin: float
) -> str:
    """Propose changes that increase the thrust margin of the agent k in a phase."""
    name = team.agent_names(settings)[k]
    agent_type = next(agent.type for agent in settings.agents if agent.name == name)
    proposal = f"{phase}: raise agent_types.{agent_type}.thrust_max_N to {required[k] / (1 - margin):.3g} or more"
    if required.sum() < (1 - margin) * available.sum():
        return (
            f"{proposal}, or move the contacts of {name} away from the payload's center of mass, so that the others "
            "carry more"
        )
    return f"{proposal}, lower payload.mass_kg, or add an agent"  # the total thrust is too small


def _slower(settings: Scenario) -> str:
    """Propose a slower reference."""
    if settings.reference.kind == "lissajous":
        return f", or use {reference_checks.slower_reference(settings)}"
    return ", or use a slower reference"


def _unbuilt(settings: Scenario, truth: Team, nominal: Team, largest: int, margin: float) -> Iterator[Finding]:
    """Report the thrust in hover from the allocation alone, and that nothing else is evaluated."""
    names = team.agent_names(settings)
    available = np.concatenate([group.thrust_max for group in truth.agent_groups])
    weight = -float(truth.payload.mass) * np.append(truth.gravity, np.zeros(3))
    allocation, _ = controllers.allocation(settings, nominal)
    lam = jnp.asarray(np.asarray(allocation.right_inverse) @ weight + np.asarray(allocation.offset)).reshape(-1, 3)
    shares = np.concatenate([
        np.asarray(lam_group.sum(1)) - group.mass.sum(1)[:, None] * truth.gravity[None]
        for group, lam_group in zip(truth.agent_groups, grasp.split_contacts(truth, lam), strict=True)
    ])  # fmt: skip
    required = np.linalg.norm(shares, axis=1)
    k = int(np.argmin(1 - required / available))
    worst = float(1 - required[k] / available[k])
    level = Level.failed if worst < margin else Level.weak if worst < WEAK_THRUST_MARGIN else Level.passed
    limit = margin if level is Level.failed else max(margin, WEAK_THRUST_MARGIN)
    yield Finding(
        "thrust",
        f"smallest margin in hover without disturbances {worst:.1%} of {available[k]:.4g} N ({names[k]})",
        {"hover_thrust_N": dict(zip(names, required.tolist(), strict=True))},
        () if worst >= limit else (_thrust_advice(settings, "hover", k, required, available, limit),),
        level,
    )
    yield Finding(
        "slowest mode",
        f"not evaluated: the equations of an agent with {largest} joints take more than a minute to compile",
        {"stable": None},
        (f"use agents with at most {MAX_LINEARIZED_JOINTS} joints, or freeze joints of the vehicle",),
        Level.weak,
    )


def _bound_axes(settings: Scenario, case_experiment: flight.Experiment, state: State) -> Iterator[Finding]:
    """Report the bound axes of the agents, and check the gains that they limit.

    There is no finding without weight, or if the team is one rigid body.
    """
    world, names = case_experiment.world, team.agent_names(settings)
    if not np.any(settings.gravity_mps2) or world.team.is_rigid_assembly:
        return
    thrust = termination.undisturbed_hover_thrust(world.team, case_experiment.controller, state)
    axes = bound_axes.bound_axes(world.team, state, thrust, names)
    if not axes:
        return
    torques = termination.disturbance_torques(world.team, world.disturbances, state)
    yield from bound_axis_checks.check_bound_axes(settings, axes, torques)
    zero = bound_tips.yaw_zero(controllers.agents_in_hover(settings, world.team))
    yield from bound_axis_checks.check_yaw_gains(settings, world.team, state, axes, zero)
    limits = gain_limits.translation_limits(settings, world.team)
    yield from bound_axis_checks.check_translation_gains(settings, limits)


def _reference(settings: Scenario, truth: Team) -> Iterator[Finding]:
    """Check overshoot and acceleration of a reference through poses."""
    if (found := reference_checks.check_reference(settings, truth)) is not None:
        level = Level.failed if found.advice else Level.passed
        yield Finding("reference", found.message, found.values, found.advice, level)
    if truth.is_rigid_assembly and (tilt := reference_checks.largest_tilt(settings)) > MAX_UNTRACKED_TILT_DEG:
        yield Finding(
            "attitude",
            f"the reference tilts by up to {tilt:.3g} deg; a team that is one rigid body does not track this, "
            "because its attitude follows from the accelerations",
            {"largest_tilt_deg": tilt},
            ("use a level reference, or vehicles with joints",),
            Level.weak,
        )


def _learnable(settings: Scenario, experiment: flight.Experiment, state: State) -> Iterator[Finding]:
    """Report label errors that exceed the residual forces; not evaluated with random residuals."""
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
