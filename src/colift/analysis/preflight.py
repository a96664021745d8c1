"""Whether a scenario is sound before it is flown, and what to change where it is not.

Mass, thrust, grasp, slowest mode, delay and gain margin: each a `Finding` with its numbers, a sentence, and advice
where it is bad.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.analysis import stability
from colift.closed_loop import flight
from colift.math import so3
from colift.math.linalg import matmul, transpose
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import PayloadState, State, Wrench
from colift.onboard import controller
from colift.onboard.control import label_feedback
from colift.scenario import Scenario, ScenarioError, controllers, experiment, initial_states, team, termination
from colift.simulation import disturbances

MAX_GRASP_CONDITION = 30.0  # of the grasp matrix, moments over the contacts' distance: a lever of a thirtieth of that
MAX_JACOBIAN_CONDITION = 100.0  # of an agent's grasp Jacobian, a tenth of what is refused: 0.05 rad from straight down
MIN_DELAY_MARGIN = 0.002  # s; a bus and a flight controller take that much
MAX_CANDIDATES = 2  # changes of gains that are tried in full, of those that are best to first order
SAMPLE_TIMES = 400  # of the reference at which thrust is asked for


@dataclasses.dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    subject: str  # a word
    message: str  # a sentence, with units
    values: dict[str, Any]  # the same, for programs; units in the names
    advice: tuple[str, ...] = ()  # what to change; there is some exactly where it is bad


@dataclasses.dataclass(frozen=True)
class PreflightReport:
    """All that was found; `findings` is short where the team cannot be built or held still."""

    scenario: str
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing is bad."""
        return not any(found.advice for found in self.findings)

    @property
    def summary(self) -> dict[str, Any]:
        """As `--json` prints it."""
        found = {
            each.subject: {"bad": bool(each.advice), "says": each.message, "advice": list(each.advice), **each.values}
            for each in self.findings
        }
        return {"scenario": self.scenario, "sound": self.passed, **found}

    def format_report(self) -> list[str]:
        """As a person reads it: a line a finding, what to change below those that are bad, the verdict last."""
        lines = []
        for found in self.findings:
            lines.append(f"{found.subject:9} {found.message}")
            lines += [f"{'':9} change: {change}" for change in found.advice]
        bad = [found.subject for found in self.findings if found.advice]
        return [*lines, f"{self.scenario}: {'bad: ' + ', '.join(bad) if bad else 'sound'}"]


def run_preflight(settings: Scenario, progress: Callable[[str], None] = lambda _what: None) -> PreflightReport:
    """Build a scenario, linearize its sampled loop at rest, and judge both; what cannot be built is a finding too."""
    truth, nominal = team.team(settings)
    found = [_mass(settings, truth, nominal)]
    try:
        found.append(_contacts(settings, truth))
        progress("the team")
        flight_experiment = experiment.make_experiment(settings, "C1")
        z = initial_states.equilibrium_state(settings, truth)
        found += [_thrust(settings, flight_experiment, z), *_joints(settings, truth, z), *_labels(settings, nominal)]
    except ScenarioError as error:
        # of a refusal the sentence is its own advice: it names what is at fault, and what is needed
        return PreflightReport(
            settings.name, (*found, Finding("refused", str(error), {}, _mend(settings, str(error), progress)))
        )
    progress("its loop at rest")
    try:
        x, M = stability.equilibrium_and_jacobian(flight_experiment, z)
    except ValueError as error:
        unknown = Finding("rest", str(error), {}, ("lower control.K_p and control.agent_k_R by half and check again",))
        return PreflightReport(settings.name, (*found, unknown))
    at_rest = stability.compute_modes(x, M, flight_experiment.dt)
    mode = Finding(
        "mode",
        f"slowest {_rate(at_rest)}, {'' if at_rest.stable else 'unstable, '}moves {mode_participation(settings, at_rest)}",
        {"stable": at_rest.stable, "rad_s": list(at_rest.slowest_eigenvalue)},
        () if at_rest.stable else _steadier(settings, x, M, progress),
    )
    late = (*_posture(settings, at_rest, progress), _delay(settings, x, M, progress)) if at_rest.stable else ()
    gain = _gain(x, M) if at_rest.stable else ()
    return PreflightReport(settings.name, (*found, mode, *_once_learned(settings, progress), *late, *gain))


def with_true_parameters(settings: Scenario) -> Scenario:
    """The scenario whose controller believes of bodies what is true, as one that has learned them flies."""
    right = settings.nominal.model_copy(update={"payload": None, "agent_types": {}})
    return settings.model_copy(update={"nominal": right})


def _once_learned(settings: Scenario, progress: Callable[[str], None]) -> Iterator[Finding]:
    """The slowest mode where it rests once bodies are learned, higher and in another pose, if they have to be."""
    right = with_true_parameters(settings)
    if right == settings:
        return
    progress("its loop at rest, bodies learned")
    try:
        found = _at_rest(right)
    except ValueError as error:
        yield Finding("learned", f"where bodies are known: {error}", {}, ("see rest",))
        return
    yield Finding(
        "learned",
        f"where bodies are known the slowest {_rate(found)}, {'' if found.stable else 'unstable, '}moves "
        f"{mode_participation(right, found)}",
        {"stable": found.stable, "rad_s": list(found.slowest_eigenvalue)},
        () if found.stable else ("let `colift tune` choose the gains: it looks at this rest as well",),
    )


def is_redundant(settings: Scenario) -> bool:
    """Whether contacts and attitude leave an agent joints that `control.posture` has to bring back, `n_r > 3 n - 3`."""
    kinds = (settings.agent_types[agent.type] for agent in settings.agents)
    return any(len(kind.joints) > 3 * len(kind.arms) - 3 for kind in kinds)


def _posture(settings: Scenario, found: stability.Modes, progress: Callable[[str], None]) -> Iterator[Finding]:
    """How fast joints beyond need return; bad below half of what is stated."""
    stated = settings.control.posture_bandwidth
    if not is_redundant(settings) or (slow := _returns(found)) is None:
        return
    rate, joint = slow[0], team.joint_names(settings)[slow[1]]
    yield Finding(
        "posture",
        f"joints beyond need return at {rate:.3g} 1/s, slowest {joint}; control.posture = {stated:g}",
        {"rate_1ps": rate, "stated_1ps": stated},
        _quicker(settings, rate, joint, progress) if rate < stated / 2 or stated == 0 else (),
    )


def _returns(found: stability.Modes) -> tuple[float, int] | None:
    """Rate, 1/s, and joint of the slowest mode that moves joints more than the payload, whose own modes gains make."""
    own = found.joints.max(1) > 2 * found.payload.max(1)
    if not own.any():
        return None
    k = int(np.argmax(own))  # modes are slowest first
    return float(-found.eigenvalues[k].real), int(np.argmax(found.joints[k]))


def _mend(settings: Scenario, refusal: str, progress: Callable[[str], None]) -> tuple[str, ...]:
    """What helps against a refusal; where arms are straight or folded, contacts with which the team can be built."""
    if "grasp Jacobian" in refusal:
        bent = []
        for typed, changed in _apart(settings):
            progress(f"the team with {typed}")
            with contextlib.suppress(ScenarioError):
                team = experiment.make_experiment(changed, "C1").world.team
                bent.append(
                    (max(_conditions(changed, team, initial_states.equilibrium_state(changed, team)).values()), typed)
                )
        if bent and min(bent)[0] < MAX_JACOBIAN_CONDITION:
            return (f"arms are straight or folded over the contacts that they hold; {min(bent)[1]} bends them",)
        return (
            "no contacts that were tried, nearer together or farther apart, let arms follow the payload: turn the rest "
            "of joints (agent_types: rest_rad), or give arms joints about other axes",
        )
    for words, change in (
        ("cannot hover", "raise agent_types: thrust_max_N, lower payload.mass_kg, or add an agent"),
        ("rank", "move a contact (agents: contact_positions_m) away from the line through the others"),
        ("joints for", "give the agent more joints (agent_types: joints), or fewer arms"),
    ):
        if words in refusal:
            return (change,)
    return ("see the sentence before",)


def _apart(settings: Scenario) -> Iterator[Change]:
    """Every agent's contacts farther apart, or nearer together, about their middle."""
    for factor in (1.5, 2.0, 3.0, 4.0, 0.6):
        agents = []
        for agent in settings.agents:
            c = np.array(agent.contact_positions_m)
            moved = c.mean(0) + factor * (c - c.mean(0))
            agents.append(agent.model_copy(update={"contact_positions_m": tuple(map(tuple, moved.round(4).tolist()))}))
        typed = " ".join(
            f"--set 'agents.{agent.name}.contacts_m={[list(c) for c in agent.contact_positions_m]}'"
            for agent in agents
            if len(agent.contact_positions_m) > 1
        )
        yield typed, settings.model_copy(update={"agents": tuple(agents)})


def _mass(settings: Scenario, truth: Team, nominal: Team) -> Finding:
    names = team.agent_names(settings)
    agents = dict(zip(names, np.concatenate([group.mass.sum(1) for group in truth.agent_groups]).tolist(), strict=True))
    load, nominal_model = float(truth.payload.mass), float(nominal.payload.mass)
    total, thrust = load + sum(agents.values()), float(sum(group.thrust_max.sum() for group in truth.agent_groups))
    weight = total * float(np.linalg.norm(truth.gravity))
    said = f"payload {load:.4g} kg{f' (believed {nominal_model:.4g} kg)' if nominal_model != load else ''}"
    for mass, alike in itertools.groupby(names, key=lambda name: f"{agents[name]:.4g}"):
        first, *others = alike
        said += (
            f", {len(others) + 1} agents from {first} to {others[-1]} of {mass} kg each"
            if len(others) > 1
            else "".join(f", {name} {mass} kg" for name in (first, *others))
        )
    lift = f"; all thrust is {thrust / weight:.3g} times the weight" if weight else ""
    return Finding(
        "mass",
        f"{total:.4g} kg: {said}{lift}",
        {
            "total_kg": total,
            "payload_kg": load,
            "believed_kg": nominal_model,
            "agents_kg": agents,
            "thrust_max_N": thrust,
        },
    )


def _contacts(settings: Scenario, truth: Team) -> Finding:
    """The grasp matrix: whether every wrench can be given, and how much worse the worst than the best."""
    c, names = np.asarray(grasp.contact_points(truth)), team.contact_names(settings)
    length = max(float(np.sqrt((c**2).sum(1).mean())), 1e-9)
    values = grasp.grasp_matrix_singular_values(truth, length)
    rank, condition = int((values[0] < 1e6 * values).sum()), float(values[0] / max(values[-1], 1e-300))
    advice: tuple[str, ...] = ()
    if rank < 6 or condition > MAX_GRASP_CONDITION:
        line = np.linalg.svd(c - c.mean(0))[2][0]
        far = int(np.argmax(np.linalg.norm(np.cross(c - c.mean(0), line), axis=1)))
        advice = (
            f"contacts lie almost on one line along ({', '.join(f'{x:.2f}' for x in line)}): "
            f"move {names[far]} away from it (agents: contact_positions_m), or add an agent beside it",
        )
    return Finding(
        "contacts",
        f"grasp matrix of {len(c)} contacts has rank {rank} of 6, condition {condition:.3g}",
        {"rank": rank, "condition": condition},
        advice,
    )


def _joints(settings: Scenario, truth: Team, state: State) -> Iterator[Finding]:
    """Every agent's grasp Jacobian at rest: whether its joints can follow the payload; nothing for single bodies."""
    conditions, advice = _conditions(settings, truth, state), []
    kinds = {agent.name: agent.type for agent in settings.agents}
    for name, agent, r, _ in grasp.iter_agents(truth, state, team.agent_names(settings)):
        if conditions[name] > MAX_JACOBIAN_CONDITION and len(r):
            k = int(np.argmax(grasp.grasp_jacobian_svd(agent, r)[1]))
            joint = settings.agent_types[kinds[name]].joints[k].name
            advice.append(
                f"{name}: turn the rest of joint {joint} away from {float(r[k]):.3g} "
                f"(agent_types.{kinds[name]}.joints.{k}.rest_rad, of a type from URDF .rest_rad.{joint}), or move the "
                "contact that it holds"
            )
    if any(len(settings.agent_types[kind].joints) for kind in kinds.values()):
        worst = max(conditions, key=lambda name: conditions[name])
        said = f"grasp Jacobians at rest have condition {conditions[worst]:.3g} at most ({worst})"
        yield Finding("joints", said, {"condition": conditions}, tuple(advice))


def _conditions(settings: Scenario, truth: Team, state: State) -> dict[str, float]:
    """Of every agent's grasp Jacobian, by name."""
    each = (
        (name, grasp.grasp_jacobian_svd(agent, r)[0])
        for name, agent, r, _ in grasp.iter_agents(truth, state, team.agent_names(settings))
    )
    return {name: float(values[0] / values[-1]) for name, values in each}


def _thrust(settings: Scenario, experiment: flight.Experiment, state: State) -> Finding:
    """What hovering and the reference take of every agent's thrust; bad where `termination.hover_thrust_margin` is not left."""
    names, margin = team.agent_names(settings), settings.termination.hover_thrust_margin
    have = np.concatenate([group.thrust_max for group in experiment.world.team.agent_groups])
    t = np.linspace(0.0, experiment.duration, SAMPLE_TIMES)
    hover = termination.true_hover_thrust(
        settings, experiment.world.team, experiment.controller, experiment.world.disturbances
    )
    path = thrust_profile(experiment, state, t)
    left = [1 - hover / have, 1 - path.max(0) / have]
    least = [int(np.argmin(each)) for each in left]
    when = float(t[int(np.argmax(path[:, least[1]]))])
    hovers, advice = left[0][least[0]] >= margin, []
    for k, where in enumerate(("hover", "reference")):
        if left[k][least[k]] < margin:
            name, requested = names[least[k]], hover if k == 0 else path.max(0)
            kind = next(agent.type for agent in settings.agents if agent.name == name)
            change = (
                f"{where}: raise agent_types.{kind}.thrust_max_N to {requested[least[k]] / (1 - margin):.3g} or more"
            )
            if requested.sum() < (1 - margin) * have.sum():
                change += f", or move the contacts of {name} away from the payload's centre of mass: others carry more"
            else:  # no other has any to spare
                change += ", lower payload.mass_kg, or add an agent"
            if k == 1 and hovers:
                change += ", or fly a slower or smaller reference (reference.period_s, amplitude_m)"
            advice.append(change)
    return Finding(
        "thrust",
        f"hover leaves {left[0][least[0]]:.1%} of {names[least[0]]}'s {have[least[0]]:.4g} N, the reference "
        f"{left[1][least[1]]:.1%} of {names[least[1]]}'s at {when:.3g} s",
        {
            "hover_N": dict(zip(names, hover.tolist(), strict=True)),
            "reference_N": dict(zip(names, path.max(0).tolist(), strict=True)),
            "thrust_max_N": dict(zip(names, have.tolist(), strict=True)),
        },
        tuple(advice),
    )


def thrust_profile(experiment: flight.Experiment, state: State, t: np.ndarray) -> np.ndarray:
    """`(times, agents)` thrust that the reference takes in truth at times t, s, N.

    As if the team at rest in z were carried along: the payload on its reference, every agent moving with its contacts,
    without what joints, attitudes and errors add.
    """
    return np.asarray(
        _along(experiment.world.team, experiment.controller, experiment.world.disturbances, state, jnp.asarray(t))
    )


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, None, None, 0))
def _along(
    team: Team,
    flying: controller.LeaderFollowerController,
    sources: disturbances.DisturbanceSet,
    state: State,
    t: Array,
) -> Float[Array, "agents"]:
    d, g, load = flying.reference.evaluate(t), team.gravity, team.payload
    spin = so3.hat(d.omega)
    swing = matmul(d.R, so3.hat(d.omega_dot) + matmul(spin, spin))
    agents, accelerations = [], []
    for group, q in zip(team.agent_groups, state.agents, strict=True):
        c = group.contact_position.mean(1)
        shift = (d.p - state.payload.p)[None] + c @ transpose(d.R - state.payload.R)
        agents.append(dataclasses.replace(q, x=q.x + shift, v=d.v[None] + c @ transpose(matmul(d.R, spin))))
        accelerations.append(d.a[None] + c @ transpose(swing))
    moved = State(agents=tuple(agents), payload=PayloadState(p=d.p, R=d.R, v=d.v, omega=d.omega))
    f = disturbances.initial_forces(sources, team, moved)
    spun = load.inertia @ d.omega_dot + so3.cross(d.omega, load.inertia @ d.omega)
    W = Wrench(F=load.mass * (d.a - g) - f.payload.F, tau=spun - f.payload.tau)
    steady = Wrench(F=jnp.zeros(3), tau=jnp.zeros(3))
    lam = flying.allocator.allocate(controller.context_at(flying, moved, jnp.zeros(6), t), W, steady).lam
    parts = zip(team.agent_groups, grasp.split_contacts(team, lam), accelerations, f.agents, strict=True)
    need = [
        force.sum(1) + group.mass.sum(1, keepdims=True) * (a - g[None]) - part.f_x for group, force, a, part in parts
    ]
    return jnp.linalg.norm(jnp.concatenate(need), axis=1)


def _rate(found: stability.Modes) -> str:
    real, imaginary = found.slowest_eigenvalue
    swings = f", a turn in {2 * np.pi / abs(imaginary):.3g} s" if abs(imaginary) > 1e-3 else ""
    return f"{real:+.3g} rad/s{swings}"


TURN_DIRECTIONS = ("roll", "pitch", "yaw")


def mode_participation(settings: Scenario, found: stability.Modes, most: int = 3) -> str:
    """What the slowest mode moves, largest first: the payload, agents' attitudes, joints, each with its share."""
    load = [*(f"the payload in {turn}" for turn in TURN_DIRECTIONS), *(f"the payload along {axis}" for axis in "xyz")]
    agents = [f"{name} in {turn}" for name in team.agent_names(settings) for turn in TURN_DIRECTIONS]
    names = [*load, *agents, *(f"joint {name}" for name in team.joint_names(settings))]
    shape = np.concatenate([found.payload[0], found.attitude[0].ravel(), found.joints[0]])
    order = [k for k in np.argsort(-shape)[:most] if shape[k] > 0.3 * shape.max()]
    return ", ".join(f"{names[k]} ({shape[k]:.2g})" for k in order)


def _delay(settings: Scenario, x: stability.LoopStateTree, M: np.ndarray, progress: Callable[[str], None]) -> Finding:
    """How much later commands may come; bad below `DELAY_LEAST`."""
    try:
        margin = _margin(settings, x, M)
    except ValueError as error:
        return Finding("delay", f"how much later commands may come is not known: {error}", {"margin_s": None})
    said = f"commands may come {margin:.3g} s later" + (
        " or more" if margin > stability.MAX_DELAY - 1 / settings.control_Hz else ""
    )
    return Finding(
        "delay", said, {"margin_s": margin}, _patient(settings, margin, progress) if margin < MIN_DELAY_MARGIN else ()
    )


def _margin(settings: Scenario, x: stability.LoopStateTree, M: np.ndarray) -> float:
    """The delay margin, s, sought up to `DELAY_MOST`."""
    return stability.delay_margin(x, M, round(stability.MAX_DELAY * settings.control_Hz)) / settings.control_Hz


def _labels(settings: Scenario, nominal: Team) -> Iterator[Finding]:
    """Where agents hear themselves too strongly to follow all of the rate of their labels."""
    gains = dict(
        zip(team.agent_names(settings), itertools.chain(*controllers.label_loop_gains(settings, nominal)), strict=True)
    )
    loudest = max(gains, key=lambda name: gains[name])
    if (part := label_feedback.rate_attenuation(gains[loudest])) < 1:
        if np.isfinite(gains[loudest]):
            hears = f"hears {gains[loudest]:.2g} of its own motion"
        elif np.any(settings.gravity_mps2):
            hears = "has straight arms where its joints are stated to rest, and what it hears of itself is not known"
        else:
            hears = "has no weight, so that its thrust may turn any way"
        yield Finding(
            "labels",
            f"{loudest} {hears}: F, H and C4 follow {f'{100 * part:.2g}%' if part else 'none'} of its labels' rate, "
            "and gusts later",
            {"gain": {name: gain if np.isfinite(gain) else None for name, gain in gains.items()}},
        )


def _gain(x: stability.LoopStateTree, M: np.ndarray) -> Iterator[Finding]:
    """How many times as strong commands may be, where that is known."""
    try:
        gain = stability.gain_margin(x, M)
    except ValueError:  # `_delay` has said why
        return
    yield Finding(
        "gain",
        f"commands may be {stability.format_gain_margin(gain)}",
        dict(zip(("least", "greatest"), gain, strict=True)),
    )


# What to change -------------------------------------------------------------------------------------------------------

Change = tuple[str, Scenario]
"""What to type (`--set control.K_v=3`), and what becomes of the settings."""


def _at_rest(settings: Scenario) -> stability.Modes:
    """The modes under C1. Raises ValueError where there is no such team, or it has no rest."""
    flight_experiment = experiment.make_experiment(settings, "C1")
    return stability.modes_at_equilibrium(
        flight_experiment, initial_states.equilibrium_state(settings, flight_experiment.world.team)
    )


def _steadier(
    settings: Scenario, x: stability.LoopStateTree, M: np.ndarray, progress: Callable[[str], None]
) -> tuple[str, ...]:
    """The single changes that steady the slowest mode most: gains, and where none does, joints and contacts."""
    context = float(np.log(np.abs(np.linalg.eigvals(M)).max()) * settings.control_Hz)

    def guess(changed: Scenario) -> float:
        flight_experiment = experiment.make_experiment(changed, "C1")
        return stability.predict_growth_rate(
            flight_experiment, initial_states.equilibrium_state(changed, flight_experiment.world.team), x, M
        )

    guesses = [(guess(changed), typed, changed) for typed, changed in _gains(settings)]
    gains = sorted((each for each in guesses if np.isfinite(each[0])), key=lambda each: each[0])[:MAX_CANDIDATES]
    for candidates in ([each[1:] for each in gains], [*_rests(settings), *_heights(settings)]):
        tried = []
        for typed, changed in candidates:
            progress(f"its loop with {typed}")
            with contextlib.suppress(ValueError):  # no such team, or no rest
                tried.append((_at_rest(changed).slowest_eigenvalue[0], typed))
        better = sorted(each for each in tried if each[0] < context - 0.02 * abs(context))[:MAX_CANDIDATES]
        if better:
            return tuple(f"{typed} makes it {rate:+.3g} rad/s" for rate, typed in better)
    return ("no single gain, joint or height of contacts that was tried steadies it: begin from `colift init`",)


def _quicker(settings: Scenario, context: float, joint: str, progress: Callable[[str], None]) -> tuple[str, ...]:
    """The changes with which joints beyond need return at half of what is stated, or else sooner than now.

    Tried: the posture, the agents' attitude gains, and the rest of the joint that is slowest.
    """
    enough, sooner = [], []
    gains, rests = _gains(settings, GAINS[-2:]), _rests(settings, joint.rpartition("/")[2])
    for typed, changed in [*_postures(settings, context), *gains, *rests]:
        progress(f"its loop with {typed}")
        stated = changed.control.posture_bandwidth
        with contextlib.suppress(ValueError):  # no such team, or no rest
            found = _at_rest(changed)
            rate = slow[0] if (slow := _returns(found)) else stated
            if found.stable and rate > 1.02 * context:
                (enough if rate >= stated / 2 else sooner).append((rate, typed))
    best = sorted(enough or sooner, reverse=True)[:MAX_CANDIDATES]
    said = tuple(f"{typed} makes it {rate:.3g} 1/s" for rate, typed in best)
    return said or (f"no posture, attitude gain or rest of {joint} that was tried helps: begin from `colift init`",)


def _postures(settings: Scenario, context: float) -> Iterator[Change]:
    """What is stated, lowered to half and to what is had, or stated where it is not."""
    stated = settings.control.posture_bandwidth
    for value in dict.fromkeys(float(f"{x:.2g}") for x in ((stated / 2, context) if stated else (1.0, 3.0))):
        if value > 0:
            yield _controlled(settings, "posture_bandwidth", value)


def _patient(settings: Scenario, context: float, progress: Callable[[str], None]) -> tuple[str, ...]:
    """The gains which, lowered, let commands come later."""
    tried = []
    for typed, changed in list(_gains(settings))[::2]:
        progress(f"its loop with {typed}")
        flight_experiment = experiment.make_experiment(changed, "C1")
        with contextlib.suppress(ValueError):
            x, M = stability.equilibrium_and_jacobian(
                flight_experiment, initial_states.equilibrium_state(changed, flight_experiment.world.team)
            )
            tried.append((_margin(changed, x, M), typed))
    better = sorted((each for each in tried if each[0] > context), reverse=True)[:MAX_CANDIDATES]
    said = tuple(f"{typed} makes it {margin:.3g} s" for margin, typed in better)
    return said or (f"no single gain that was lowered helps; raise control_Hz above {settings.control_Hz:g}",)


GAINS = ("K_p", "K_v", "k_R", "k_omega", "agent_k_R", "agent_k_omega")  # the agents' last


def _gains(settings: Scenario, names: Sequence[str] = GAINS) -> Iterator[Change]:
    """Every one of some gains lower and higher."""
    for name in names:
        context = np.array(getattr(settings.control, name))
        for factor in (0.7, 1.4):
            new = [float(f"{x:.3g}") for x in np.atleast_1d(factor * context)]
            yield _controlled(settings, name, new if context.shape else new[0])


def _controlled(settings: Scenario, name: str, value: float | list[float]) -> Change:
    """Another value of one setting of the controller."""
    control = settings.control.model_copy(update={name: value})
    return f"--set control.{name}={value}", settings.model_copy(update={"control": control})


def _rests(settings: Scenario, name: str | None = None) -> Iterator[Change]:
    """Every joint that turns, or those of a name, at rest 0.2 rad either way."""
    for kind, given in settings.agent_types.items():
        for k, joint in enumerate(given.joints):
            if joint.type != "revolute" or name not in (None, joint.name):
                continue
            for step in (-0.2, 0.2):
                value = round(joint.nominal_position_rad + step, 3)
                turned = joint.model_copy(update={"nominal_position_rad": value})
                other = given.model_copy(update={"joints": (*given.joints[:k], turned, *given.joints[k + 1 :])})
                types = settings.agent_types | {kind: other}
                yield (
                    f"--set agent_types.{kind}.joints.{joint.name}.nominal_position_rad={value} "
                    f"(of a type from URDF agent_types.{kind}.nominal_position_rad.{joint.name}={value})",
                    settings.model_copy(update={"agent_types": types}),
                )


def _heights(settings: Scenario) -> Iterator[Change]:
    """All contacts 5 cm lower and higher: where agents turn about points above or below their centres of mass."""
    for step in (-0.05, 0.05):
        agents = tuple(
            agent.model_copy(
                update={"contact_positions_m": tuple((x, y, round(h + step, 4)) for x, y, h in agent.contact_positions_m)}
            )
            for agent in settings.agents
        )
        typed = " ".join(
            f"--set agents.{agent.name}.contact_positions_m.{b}.2={c[2]}"
            for agent in agents
            for b, c in enumerate(agent.contact_positions_m)
        )
        yield typed, settings.model_copy(update={"agents": agents})
