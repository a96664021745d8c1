"""From settings to the values that a run starts from: teams, sources, sensors, what flies, the start.

Agents whose types share a structure form one group, in the order of the file; a team's agents and contacts are
counted group by group, and so are the names that this module gives.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift import (
    actuator,
    allocate,
    band,
    control,
    deviation,
    disturbance,
    dynamics,
    estimate,
    fly,
    gp,
    grasp,
    innovation,
    lag,
    learn,
    limits,
    model,
    reference,
    sensor,
    so3,
)
from colift import agent as ag
from colift.gp.bounds import Assumption
from colift.linalg import mul
from colift.model import (
    Agent,
    AgentState,
    Payload,
    PayloadState,
    Residual,
    State,
    Team,
    Tree,
    Wrench,
    agent_force,
    stack,
)
from colift.scenario import settings as s
from colift.scenario.mistake import ScenarioError
from colift.scenario.references import bodies
from colift.world import Added, Plant, Simulated

EYE = np.eye(3)


def team(settings: s.Settings) -> tuple[Team, Team]:
    """`(truth, nominal)`: the same structures, with the numbers of the plant and those the controller believes."""
    believed = settings.nominal
    kinds = {name: _as_believed(kind, believed.agent_types.get(name)) for name, kind in settings.agent_types.items()}
    return (
        _team(settings, settings.agent_types, settings.payload),
        _team(settings, kinds, believed.payload or settings.payload),
    )


def groups(settings: s.Settings) -> list[list[s.Agent]]:
    """Agents of one structure together, in the order of the file."""
    found: dict[Tree, list[s.Agent]] = {}
    for agent in settings.agents:
        found.setdefault(_tree(settings.agent_types[agent.type]), []).append(agent)
    return list(found.values())


def kinds(settings: s.Settings) -> dict[str, Agent]:
    """The agent of each type that the true team has, by the type's name; contacts of the first such agent."""
    first = {agent.type: agent for agent in reversed(settings.agents)}
    return {name: _agent(kind, first[name]) for name, kind in settings.agent_types.items() if name in first}


def agent_names(settings: s.Settings) -> tuple[str, ...]:
    """One name an agent, in team order."""
    return tuple(agent.name for group in groups(settings) for agent in group)


def contact_names(settings: s.Settings) -> tuple[str, ...]:
    """`agent/arm` of every contact, in team order."""
    kinds = settings.agent_types
    return tuple(
        f"{agent.name}/{arm.name}" for group in groups(settings) for agent in group for arm in kinds[agent.type].arms
    )


def joint_names(settings: s.Settings) -> tuple[str, ...]:
    """`agent/joint` of every joint, in team order."""
    kinds = settings.agent_types
    return tuple(
        f"{agent.name}/{joint.name}"
        for group in groups(settings)
        for agent in group
        for joint in kinds[agent.type].joints
    )


def _team(settings: s.Settings, kinds: dict[str, s.AgentType], payload: s.Payload) -> Team:
    return Team(
        groups=tuple(stack([_agent(kinds[a.type], a) for a in group]) for group in groups(settings)),
        payload=Payload(mass=_array(payload.mass_kg), inertia=_array(payload.inertia_kgm2)),
        gravity=_array(settings.gravity_mps2),
    )


def _as_believed(kind: s.AgentType, nominal: s.NominalAgentType | None) -> s.AgentType:
    if nominal is None:
        return kind
    joints = tuple(j.model_copy(update={"body": nominal.joints.get(j.name, j.body)}) for j in kind.joints)
    return kind.model_copy(update={"base": nominal.base or kind.base, "joints": joints})


def _tree(kind: s.AgentType) -> Tree:
    index = {name: i for i, name in enumerate(bodies(kind.model_dump()))}
    return Tree(
        parents=tuple(index[joint.parent] for joint in kind.joints),
        prismatic=tuple(joint.type == "prismatic" for joint in kind.joints),
        tips=tuple(index[arm.joint] for arm in kind.arms),
    )


def _agent(kind: s.AgentType, agent: s.Agent) -> Agent:
    parts = [kind.base, *(joint.body for joint in kind.joints)]
    axes = np.array([joint.axis for joint in kind.joints]).reshape(-1, 3)
    return Agent(
        tree=_tree(kind),
        mass=_array([body.mass_kg for body in parts]),
        com=_array([body.com_m for body in parts]),
        inertia=_array([body.inertia_kgm2 for body in parts]),
        joint_position=_rows([joint.position_m for joint in kind.joints]),
        joint_rotation=_array([_rpy(joint.rpy_deg) for joint in kind.joints]).reshape(-1, 3, 3),
        joint_axis=jnp.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True)),
        tip=_rows([arm.tip_m for arm in kind.arms]),
        contact=_rows(agent.contacts_m),
        thrust_max=_array(kind.thrust_max_N),
    )


def _array(given: object) -> Array:
    """Numbers as float64; `jnp.asarray` alone would make a weakly typed value of a Python float."""
    return jnp.asarray(np.array(given, dtype=float))


def _rows(vectors: Iterable[s.Vector]) -> Array:
    return _array(list(vectors)).reshape(-1, 3)


def _rpy(deg: s.Vector) -> Array:
    """`R_z(yaw) R_y(pitch) R_x(roll)`."""
    return _turned(jnp.deg2rad(_array(deg)))


@jax.jit
def _turned(angles: Array) -> Array:
    roll, pitch, yaw = jax.vmap(so3.exp)(jnp.diag(angles))
    return mul(yaw, mul(pitch, roll))


# The truth ----------------------------------------------------------------------------------------------------------


def disturbances(settings: s.Settings) -> disturbance.Disturbances:
    """The sources of the truth, mounted."""
    teams = groups(settings)
    laws = _laws(settings)
    return disturbance.Disturbances(
        payload=tuple(
            disturbance.Mount(name=source.name, law=_law(source), point=_array(source.point_m))
            for source in laws
            if source.acts_on == "payload"
        ),
        agents=tuple(tuple(mount for source in laws for mount in _mounts(settings, source, group)) for group in teams),
        joints=tuple(_friction(settings, group) for group in teams),
    )


def _laws(settings: s.Settings) -> list[s.Law]:
    return [source for source in settings.disturbances if not isinstance(source, s.JointFriction)]


def _mounts(settings: s.Settings, source: s.Law, group: list[s.Agent]) -> Iterator[disturbance.AgentMount]:
    """A source on a group: one mount for each body index that its body has in the types of the group."""
    carriers: dict[int, list[float]] = {}
    for k, agent in enumerate(group):
        if source.acts_on in ("agents", agent.name):
            body = bodies(settings.agent_types[agent.type].model_dump()).index(source.body)
            carriers.setdefault(body, [0.0] * len(group))[k] = 1.0
    law = jax.tree.map(lambda x: jnp.asarray(np.broadcast_to(x, (len(group), *x.shape))), _law(source))
    for body, active in carriers.items():
        point = _array([source.point_m] * len(group))
        yield disturbance.AgentMount(body=body, name=source.name, law=law, point=point, active=_array(active))


def _friction(settings: s.Settings, group: list[s.Agent]) -> disturbance.JointFriction:
    rubbing = [source for source in settings.disturbances if isinstance(source, s.JointFriction)]
    joints = len(settings.agent_types[group[0].type].joints)
    table = np.tile([0.0, 0.0, 1.0], (len(group), 1))  # no friction; the speed then has no effect
    for k, agent in enumerate(group):
        for source in rubbing:
            if source.acts_on in ("agents", agent.name):
                table[k] = source.viscous_Nms, source.coulomb_Nm, source.speed_radps
    viscous, coulomb, speed = (jnp.asarray(np.tile(column[:, None], (1, joints))) for column in table.T)
    return disturbance.JointFriction(viscous=viscous, coulomb=coulomb, speed=speed)


def _law(source: s.Law) -> disturbance.Law:
    return LAWS[type(source)](source)


def _wind(source: s.Wind) -> disturbance.Wind | disturbance.Weather:
    wind = disturbance.Wind(
        linear=_array(source.linear_Nspm),
        quadratic=_array(source.quadratic_Ns2pm2),
        mean=_array(source.mean_mps),
        gust=_rows(gust.amplitude_mps for gust in source.gusts),
        wave=_rows(gust.wave_radpm for gust in source.gusts),
        phase=jnp.deg2rad(_array([gust.phase_deg for gust in source.gusts])),
    )
    if source.turn is None and all(gust.period_s is None for gust in source.gusts):
        return wind
    turn = s.Turn(angle_deg=0.0, start_s=0.0) if source.turn is None else source.turn
    return disturbance.Weather(
        wind=wind,
        rate=_array([0.0 if gust.period_s is None else 2 * np.pi / gust.period_s for gust in source.gusts]),
        angle=jnp.deg2rad(_array(turn.angle_deg)),
        start=_array(turn.start_s),
        over=_array(turn.over_s),
    )


LAWS: dict[type, Callable[..., disturbance.Law]] = {
    s.Constant: lambda x: disturbance.Constant(force=_array(x.force_N), torque=_array(x.torque_Nm)),
    s.Wind: _wind,
    s.Tether: lambda x: disturbance.Tether(
        anchor=_array(x.anchor_m), stiffness=_array(x.stiffness_Npm), length=_array(x.length_m)
    ),
    s.Jet: lambda x: disturbance.Jet(force=_array(x.force_N), center=_array(x.center_m), width=_array(x.width_m)),
    s.RotorBias: lambda x: disturbance.RotorBias(thrust=_array(x.thrust_N), torque=_array(x.torque_Nm)),
    s.OwnLaw: lambda x: _own(x, f"disturbances: {x.name}", disturbance.Law),
}


def drawn(settings: s.Settings, truth: Team, z: State) -> tuple[learn.Oracle, Residual] | None:
    """Residuals of known norm, as posterior means, and the deviation of each over the reference; None if not asked.

    `f = sum_k w_k k(z_k, .)`, `|f|^2 = w^T K w`. z is any state of the team on its grasp: the centres are where the
    team would be if it moved along the reference as it stands in z, each a little off.
    """
    given = settings.drawn
    if given is None:
        return None
    rng = np.random.default_rng((settings.seed, 4))
    moves = settings.reference
    assert not isinstance(moves, s.Own), "scenario.references refuses it"
    moving = moves.ramp_s if isinstance(moves, s.Lissajous) else moves.poses[0].t_s
    zero = prior(settings, truth)
    where, along = (
        _carried(path(settings), zero.features, z, jnp.asarray(t))
        for t in (
            rng.uniform(moving, settings.duration_s, given.centers),
            np.linspace(moving, settings.duration_s, 400),
        )
    )

    def one(hyper: gp.Hyper, X: Array, path: Array) -> tuple[gp.GP, np.ndarray]:
        X = np.asarray(X) + given.spread * rng.normal(size=X.shape) * np.asarray(hyper.lengthscales)[0]
        w = rng.normal(size=(len(hyper.signal_variance), len(X)))
        w = w * (given.norm / np.asarray(gp.norm(gp.expansion(hyper, X, w))))[:, None]
        model = gp.expansion(hyper, X, w, max(len(X), settings.learning.capacity))
        return model, np.asarray(_means(model, path)).std(0)

    payload, of_payload = one(zero.payload.hyper, where[0], along[0])
    agents, of_agents = [], []
    for group, x, x_along in zip(zero.agents, where[1], along[1], strict=True):
        each = [
            one(jax.tree.map(lambda leaf, j=j: leaf[j], group.hyper), x[:, j], x_along[:, j]) for j in range(x.shape[1])
        ]
        agents.append(jax.tree.map(lambda *leaf: jnp.stack(leaf), *(model for model, _ in each)))
        of_agents.append(agent_force(jnp.asarray([std for _, std in each])))
    W = jnp.asarray(of_payload)
    return (
        dataclasses.replace(zero, payload=payload, agents=tuple(agents)),
        Residual(agents=tuple(of_agents), payload=Wrench(F=W[:3], tau=W[3:])),
    )


_means = jax.jit(jax.vmap(gp.mean, (None, 0)))


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, None, 0))
def _carried(
    path: reference.Reference, features: learn.Features, z: State, t: Array
) -> tuple[Array, tuple[Array, ...]]:
    """Features of the payload and of agents as if the team of z moved along the reference without turning."""
    d = path.at(t)
    shift = d.p - z.payload.p
    load = PayloadState(p=d.p, R=d.R, v=d.v, omega=jnp.zeros(3))
    agents = tuple(
        features.agent(
            jax.vmap(model.flat_agent)(dataclasses.replace(q, x=q.x + shift[None], v=jnp.tile(d.v, (len(q.x), 1))))
        )
        for q in z.agents
    )
    return features.payload(model.flat_payload(load, jnp.zeros(6))), agents


def world(settings: s.Settings, truth: Team, z: State, sources: disturbance.Disturbances, rig: Residual) -> Simulated:
    """The truth that the team meets from z on; rig: largest error of the calibration rig's labels, where it is asked.

    Raises ScenarioError for a part of one's own that is none, and where MuJoCo is asked for and not installed.
    """
    seen = sensors(settings)
    then = tuple(_reading(x, f"sensors.then.{i}", settings) for i, x in enumerate(settings.sensors.then))
    ours = Simulated(
        team=truth,
        plant=dynamics.Rigid(),
        sources=sources,
        acting=jnp.asarray(1.0),
        actuators=actuator.Ideal(),
        sensors=seen,
        lam_bias=sensor.bias(truth, seen, jax.random.fold_in(jax.random.key(settings.seed), 1)),
        extra=(*then, sensor.Rig(error=rig)) if settings.learning.samples == "rig" else then,
        added=None if settings.added is None else _added(settings.added),
    )
    return dataclasses.replace(ours, actuators=_actuators(settings, ours), plant=_plant(settings, ours, z))


def _added(given: s.Added) -> Added:
    return Added(mass=_array(given.mass_kg), start=_array(given.start_s), over=_array(given.over_s))


def _plant(settings: s.Settings, ours: Simulated, z: State) -> Plant:
    given = settings.plant
    if isinstance(given, s.Own):
        return _own(given, "plant", Plant, ours)
    if isinstance(given, s.Rigid):
        return dynamics.Rigid()
    try:
        from colift import engine  # MuJoCo is an extra
    except ModuleNotFoundError as error:
        raise ScenarioError(f"{settings.name}: plant: {error}") from None
    return engine.plant(ours.team, z, 1 / settings.control_Hz, given.substeps)


def _reading(given: s.Intermittent | s.Drifting | s.Own, where: str, settings: s.Settings) -> sensor.Extra:
    match given:
        case s.Intermittent():
            return sensor.Intermittent(
                of=given.of,
                every=_array(1 / given.rate_Hz),
                loss=_array(given.loss),
                until=_array(np.inf if given.until_s is None else given.until_s),
                delay=round(given.delay_s * settings.control_Hz),
            )
        case s.Drifting():
            return sensor.Drifting(of=given.of, rate=_array(given.rate), start=_array(given.start))
    return _own(given, where, sensor.Extra)


def _actuators(settings: s.Settings, ours: Simulated) -> actuator.Ideal:
    given = settings.actuators
    if isinstance(given, s.Own):
        return _own(given, "actuators", actuator.Ideal, ours)
    if isinstance(given, s.Ideal):
        return actuator.Ideal()
    return actuator.Motors(
        lag=_lag(given, settings), limits=tuple(_limit(given, group.thrust_max) for group in ours.team.groups)
    )


def _lag(given: s.Lag, settings: s.Settings) -> lag.Lag:
    return lag.Lag(bandwidth=_array(given.bandwidth_Hz), delay=round(given.delay_s * settings.control_Hz))


def _limit(given: s.Motors, thrust_max: Array) -> actuator.Limit:
    if given.rotors is not None:
        ring = given.rotors
        return actuator.rotors(ring.count, ring.arm_m, ring.yaw_m, thrust_max / ring.count)
    most = np.inf if given.torque_max_Nm is None else given.torque_max_Nm
    return actuator.Box(thrust_max=thrust_max, torque_max=_array([most] * len(thrust_max)))


def _own(given: s.Part, where: str, kind: type[P], *joins: Any) -> P:
    """What a part of one's own builds, its numbers as arrays. Raises ScenarioError where it is not of that kind."""
    build = getattr(given.settings, "build")  # noqa: B009  `own.settings` has seen that it is there
    made = jax.tree.map(lambda x: x if isinstance(x, jax.Array) else jnp.asarray(np.asarray(x)), build(*joins))
    if not isinstance(made, kind):
        raise ScenarioError(
            f"{where}: {given.part} built a value of type {type(made).__name__}, "
            f"which is no {kind.__module__}.{kind.__name__} (docs/change_a_part.md)"
        )
    return made


P = TypeVar("P")


def sensors(settings: s.Settings) -> sensor.Sensors:
    """Noise of the sensors, in SI."""
    given = settings.sensors
    return sensor.Sensors(
        position=_array(given.position_m),
        attitude=jnp.deg2rad(_array(given.attitude_deg)),
        velocity=_array(given.velocity_mps),
        body_rate=_array(given.body_rate_radps),
        accelerometer=_array(given.accelerometer_mps2),
        joint=jnp.deg2rad(_array(given.joint_deg)),
        tip_force=_array(given.tip_force_N),
        tip_force_bias=_array(given.tip_force_bias_N),
        tip_force_bandwidth=_array(given.tip_force_bandwidth_Hz),
    )


def start(settings: s.Settings, truth: Team) -> State:
    """The first state: the payload off its reference as stated, every agent over its contacts, on the manifold.

    Raises ScenarioError where no such state is near, with what remains, and for a body that is not physical or a grasp
    that is redundant, singular or beyond control there.
    """
    given, d = settings.start, _setpoint(path(settings), jnp.zeros(()))
    load = PayloadState(
        p=d.p + _array(given.position_error_m),
        R=_off(d.R, jnp.deg2rad(_array(given.attitude_error_deg))),
        v=_array(given.velocity_mps),
        omega=_array(given.body_rate_radps),
    )
    agents = tuple(
        _over_contacts(group, yaw, r, load)
        for group, yaw, r in zip(truth.groups, heading(settings), rest(settings), strict=True)
    )
    names = agent_names(settings)
    try:
        z = dynamics.consistent(truth, State(agents=agents, payload=load), names)
        model.check(truth, names)
        grasp.check(truth, z, names)
        grasp.check_control(truth, z, names)
    except ValueError as error:
        raise ScenarioError(f"{settings.name}: {error}") from None
    return z


_setpoint = jax.jit(lambda path, t: path.at(t))
_off = jax.jit(lambda R, theta: mul(R, so3.exp(theta)))


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, 0, 0, None))
def _over_contacts(agent: Agent, yaw: Array, r: Array, load: PayloadState) -> AgentState:
    """Agents at rest, each with its tips, on average, where they belong."""
    R = so3.exp(yaw * jnp.asarray(EYE[2]))
    tips = ag.geometry(agent, r).point[-agent.tree.arms :]
    base = load.p + (agent.contact @ load.R.T - tips @ R.T).mean(0)
    zero = jnp.zeros(3)
    x = base + R @ ag.center_of_mass(agent, r)
    return AgentState(R=R, x=x, r=r, omega=zero, v=zero, r_dot=jnp.zeros_like(r))


def at_rest(settings: s.Settings, team: Team) -> State:
    """The payload on its reference and everything at rest; raises as `start`."""
    return start(settings.model_copy(update={"start": s.Start()}), team)


def bounds(settings: s.Settings, truth: Team, z: State) -> limits.Limits:
    """What the flight from z may not exceed."""
    given = settings.limits
    return limits.Limits(
        grip=given.grip * _grip(truth, z),
        distance=_array(given.distance_m),
        height=_array(-np.inf if given.height_m is None else given.height_m),
        attitude=_limit_rad(given.attitude_deg),
        tilt=_limit_rad(given.tilt_deg),
        saturation=_array(given.saturation_s),
    )


_grip = jax.jit(grasp.grip)


def _limit_rad(deg: float) -> Array:
    """180 deg is no limit: an angle that is computed may exceed pi by rounding."""
    return _array(np.inf if deg == 180 else np.deg2rad(deg))


def hover(
    settings: s.Settings, truth: Team, flying: fly.LeaderFollower, sources: disturbance.Disturbances
) -> np.ndarray:
    """`(agents,)` thrust that hovering on the reference takes in truth, N, with or without internal forces, the larger.

    Raises ScenarioError where it is more than the agents have.
    """
    z, given = at_rest(settings, truth), settings.allocation.internal
    f, moments = _acting(sources, truth, z), [0.0] if given is None else [0.0, (given.start_s + given.end_s) / 2]
    need = np.max([_hovering(truth, flying, z, f, _array(t)) for t in moments], axis=0)
    have = np.concatenate([group.thrust_max for group in truth.groups])
    names = agent_names(settings)
    short = [
        f"{name} needs {u:.4g} N of {most:.4g} N" for name, u, most in zip(names, need, have, strict=True) if u > most
    ]
    if short:
        raise ScenarioError(
            f"{settings.name}: the team cannot hover on its reference: {', '.join(short)} (agent_types: thrust_max_N); "
            f"all agents together need {need.sum():.4g} N and have {have.sum():.4g} N"
        )
    return need


_acting = jax.jit(disturbance.at_start)


@jax.jit
def _hovering(truth: Team, flying: fly.LeaderFollower, z: State, f: Residual, t: Array) -> Array:
    """`(agents,)` thrust at rest, N, with the internal forces of time t, s."""
    W = Wrench(F=-truth.payload.mass * truth.gravity - f.payload.F, tau=-f.payload.tau)
    steady = Wrench(F=jnp.zeros(3), tau=jnp.zeros(3))
    forces = flying.allocator.allocate(fly.known(flying, z, jnp.zeros(6), t), W, steady)
    return limits.hover(truth, forces.lam, f)


# What flies ---------------------------------------------------------------------------------------------------------


def heading(settings: s.Settings) -> tuple[Array, ...]:
    """Heading of every agent, rad, by group."""
    return tuple(jnp.deg2rad(_array([agent.yaw_deg for agent in group])) for group in groups(settings))


def rest(settings: s.Settings) -> tuple[Array, ...]:
    """Joint positions at rest, rad or m, by group."""
    kinds = settings.agent_types
    return tuple(
        _array(
            [[j.rest_rad if isinstance(j, s.Revolute) else j.rest_m for j in kinds[a.type].joints] for a in group]
        ).reshape(len(group), -1)
        for group in groups(settings)
    )


def path(settings: s.Settings) -> reference.Reference:
    """The payload's reference."""
    given = settings.reference
    if isinstance(given, s.Own):
        return _own(given, "reference", reference.Reference)
    if isinstance(given, s.Waypoints):
        turns = _unwound([np.asarray(so3.log(_rpy(pose.rpy_deg))) for pose in given.poses])
        return reference.waypoints(
            np.array([pose.t_s for pose in given.poses]), np.array([pose.p_m for pose in given.poses]), turns
        )
    loop = reference.Lissajous(
        center=_array(given.center_m),
        amplitude=_array(given.amplitude_m),
        period=_array(given.period_s),
        phase=jnp.deg2rad(_array(given.phase_deg)),
        ramp=_array(given.ramp_s),
        R=_rpy(given.rpy_deg),
        swing=jnp.deg2rad(_array(given.swing_deg)),
        swing_period=_array(given.swing_period_s),
        swing_phase=jnp.deg2rad(_array(given.swing_phase_deg)),
    )
    if (off := given.leaves) is None:
        return loop
    return reference.Leaving(
        path=loop,
        shift=_array(off.shift_m),
        start=_array(off.start_s),
        over=_array(off.over_s),
        swing=jnp.deg2rad(_array(off.swing_deg)),
        swing_start=_array(off.swing_start_s),
        swing_period=_array(off.swing_period_s),
    )


def _unwound(theta: list[np.ndarray]) -> np.ndarray:
    """Rotation vectors of the same rotations, each the nearest to the one before, up to one turn away."""
    out = [theta[0]]
    for now in theta[1:]:
        angle = np.linalg.norm(now)
        axis = now / angle if angle > 0 else np.zeros(3)
        out.append(min((now + 2 * np.pi * k * axis for k in (-1, 0, 1)), key=lambda x: np.linalg.norm(x - out[-1])))
    return np.array(out)


def gains(settings: s.Settings) -> control.Gains:
    """Feedback gains."""
    given = settings.control
    return control.Gains(
        K_p=jnp.diag(_array(given.K_p)),
        K_v=jnp.diag(_array(given.K_v)),
        k_R=_array(given.k_R),
        k_omega=_array(given.k_omega),
        agent_k_R=_array(given.agent_k_R),
        agent_k_omega=_array(given.agent_k_omega),
        posture=_array(given.posture),
    )


def allocation(settings: s.Settings, nominal: Team) -> tuple[allocate.Allocation, fly.Internal]:
    """The allocation, and the internal forces it is asked for.

    Raises ScenarioError for a grasp or a leader block of rank below 6, and for internal forces that this
    allocation cannot give.
    """
    given = settings.allocation
    c = np.asarray(grasp.contacts(nominal))
    index = {name: i for i, name in enumerate(contact_names(settings))}
    try:
        if isinstance(given, s.LeaderFollower):
            offset = None if given.lam_f0_N is None else np.array(given.lam_f0_N)
            plan = allocate.leader_follower(c, [index[name] for name in given.leader_contacts], offset)
        else:
            plan = allocate.balanced(c)
        return plan, _internal(given.internal, plan, c, index)
    except ValueError as error:
        numbered = ", ".join(f"{i} {name}" for name, i in index.items())
        raise ScenarioError(f"{settings.name}: allocation: {error} (contacts: {numbered})") from None


def _internal(
    given: s.Internal | None, plan: allocate.Allocation, c: np.ndarray, index: dict[str, int]
) -> fly.Internal:
    if given is None:
        eta, times = np.zeros(plan.kernel.shape[1]), (0.0, 0.0, 1.0)
    else:
        pairs = [(index[a], index[b], newton) for a, b, newton in given.pairs]
        eta, times = allocate.internal(plan, allocate.squeeze(c, pairs)), (given.start_s, given.end_s, given.ramp_s)
    start, end, ramp = (_array(t) for t in times)
    return fly.Internal(eta=jnp.asarray(eta), start=start, end=end, ramp=ramp)


def pilot(settings: s.Settings, nominal: Team) -> fly.LeaderFollower:
    """Everything the team takes along in case C1: no data are recorded, nothing is known.

    Raises ScenarioError as `allocation`, and for a part of one's own that is none.
    """
    plan, internal = allocation(settings, nominal)
    learning, gain = settings.learning, gains(settings)
    recorder = learn.FromRig if learning.samples == "rig" else learn.Recorder
    ahead = settings.control.look_ahead_s
    realizer = fly.Aligned if ahead is None else fly.Anticipating
    ours = fly.LeaderFollower(
        team=nominal,
        path=path(settings),
        estimator=estimate.Estimator(
            filters=_filters(settings),
            patience=_array(settings.innovation.patience_s),
        ),
        recorder=recorder(
            every=_array(1 / learning.sample_Hz),
            start=_array(learning.start_s),
            end=_array(learning.end_s),
            payload=jnp.array(False),
            agents=jnp.array(False),
        ),
        oracle=prior(settings, nominal),
        predictor=fly.Learned(),
        leader=fly.Geometric(gains=gain),
        allocator=fly.Linear(allocation=plan, internal=internal),
        realizer=realizer(gains=gain, heading=heading(settings), rest=rest(settings)),
        drive=_drive(settings),
        look_ahead=None if ahead is None else _array(ahead),
    )
    theirs = {
        name: _own(part, f"parts.{name}", kind, ours)
        for name, kind in PILOT_PARTS.items()
        if (part := getattr(settings.parts, name)) is not None
    }
    return dataclasses.replace(ours, **theirs)


def ahead(settings: s.Settings, flying: fly.LeaderFollower) -> fly.LeaderFollower:
    """The same, looking ahead where it did not."""
    if flying.look_ahead is not None or type(flying.realizer) is not fly.Aligned:
        return flying
    mine = {field.name: getattr(flying.realizer, field.name) for field in dataclasses.fields(flying.realizer)}
    step = _array(settings.innovation.look_ahead_s)
    return dataclasses.replace(flying, realizer=fly.Anticipating(**mine), look_ahead=step)


def listening(settings: s.Settings, flying: fly.LeaderFollower, held: bool) -> fly.LeaderFollower:
    """The same with its predictions corrected by labels; when labels stop, the correction is held, or fades."""
    given = settings.innovation
    listener = innovation.Listener(
        filters=_filters(settings),
        hold=_array(given.hold_s),
        fade=_array(np.inf if held else given.fade_s),
        span=_array(given.span_s),
    )
    predictor = fly.Corrected(predictor=flying.predictor, lead=_array(given.lead_s))
    return dataclasses.replace(flying, listener=listener, predictor=predictor)


def _filters(settings: s.Settings) -> estimate.Filters:
    return estimate.Filters(
        fusion=_array(settings.control.fusion_Hz),
        bias=_array(settings.control.bias_Hz),
        joint=_array(settings.control.joint_filter_Hz),
        label=_array(settings.learning.filter_Hz),
        tip_force=_array(settings.sensors.tip_force_bandwidth_Hz),
    )


def _drive(settings: s.Settings) -> fly.Drive:
    believed = settings.nominal.actuators
    if believed is None:
        return fly.Direct()
    return fly.Hastened(lag=_lag(believed, settings), haste=_array(settings.control.haste))


PILOT_PARTS: dict[str, type] = {
    "leader": fly.Leader,
    "allocator": fly.Allocator,
    "realizer": fly.Realizer,
    "estimator": fly.Estimator,
    "predictor": fly.Predictor,
}


def features(settings: s.Settings) -> learn.Features:
    """What GPs see of a sample. Raises ScenarioError for features of one's own that are none."""
    given = settings.parts.features
    return learn.Plain() if given is None else _own(given, "parts.features", learn.Features)


def kernel(settings: s.Settings) -> gp.Kernel:
    """Of all models, the payload's and the agents'. Raises ScenarioError for one of one's own that is none."""
    given = settings.parts.kernel
    return gp.SquaredExponential() if given is None else _own(given, "parts.kernel", gp.Kernel)


def prior(settings: s.Settings, nominal: Team) -> learn.Oracle:
    """The oracle before any data: it predicts zero, with the deviations that the scenario states.

    Raises ScenarioError for noise that is too small beside the signal for that many points.
    """
    learning, seen, of = settings.learning, features(settings), kernel(settings)

    def before(name: str, features: Sequence[str]) -> gp.GP:
        try:
            return gp.prior(_hyper(getattr(learning, name), features, of), learning.capacity)
        except ValueError as error:
            raise ScenarioError(f"{settings.name}: learning.{name}: {error}") from None

    return learn.Oracle(
        features=seen,
        payload=before("payload", seen.payload_names()),
        agents=tuple(
            jax.tree.map(
                lambda x, size=size: jnp.asarray(np.broadcast_to(x, (size, *x.shape))),
                before("agents", seen.agent_names(group.tree.joints)),
            )
            for size, group in zip(nominal.sizes, nominal.groups, strict=True)
        ),
        theta=jnp.zeros(10),
    )


def training(settings: s.Settings, nominal: Team) -> learn.Training | None:
    """How fits are made: about the priors of `prior`, within the scenario's bounds; None where they stay as stated."""
    given = settings.learning
    if given.hyperparameters == "stated":
        return None
    (least, greatest), seen, of = given.lengthscale_bounds, features(settings), kernel(settings)

    def belief(stated: s.Prior, features: Sequence[str]) -> gp.Belief:
        return gp.Belief(_hyper(stated, features, of), factor=given.prior_factor, least=least, greatest=greatest)

    return learn.Training(
        payload=belief(given.payload, seen.payload_names()),
        agents=tuple(belief(given.agents, seen.agent_names(group.tree.joints)) for group in nominal.groups),
        restarts=given.restarts,
        max_iterations=given.max_iterations,
    )


def _hyper(given: s.Prior, features: Sequence[str], kernel: gp.Kernel) -> gp.Hyper:
    """Forces, moments, then joints: variances from the stated deviations, length-scales of rates and of the rest."""
    signal, noise, counts = [given.force_N, given.moment_Nm], [given.force_noise_N, given.moment_noise_Nm], [3, 3]
    if isinstance(given, s.AgentPrior):
        joints = sum(name.startswith("r_dot") for name in features)
        signal, noise, counts = [*signal, given.joint_Nm], [*noise, given.joint_noise_Nm], [3, 3, joints]
    rates = [name.startswith(("omega", "|omega|", "r_dot")) for name in features]
    lengthscales = np.where(rates, given.rate_lengthscale, given.lengthscale)
    return gp.hyperparameters(
        signal_variance=np.repeat(signal, counts) ** 2,
        lengthscales=np.tile(lengthscales, (sum(counts), 1)),
        noise_variance=np.repeat(noise, counts) ** 2,
        kernel=kernel,
    )


def stated(settings: s.Settings, nominal: Team, rig: Residual) -> band.Stated:
    """What the scenario states of the unknown functions and of their labels, and what of it is true by construction.

    `rig` is the calibration rig's largest error. Raises ScenarioError for a label error that is not positive.
    """
    given, learning = settings.certificate, settings.learning
    payload = _label_errors(given.payload, learning.payload, 0)
    agents = [
        np.tile(_label_errors(given.agents, learning.agents, group.tree.joints), (size, 1))
        for size, group in zip(nominal.sizes, nominal.groups, strict=True)
    ]
    within = False
    if learning.samples == "rig":
        of_payload = np.concatenate([rig.payload.F, rig.payload.tau])
        of_agents = [np.concatenate([e.f_x, e.f_w, e.f_r], axis=1) for e in rig.agents]
        payload = of_payload if given.payload is None else payload
        agents = of_agents if given.agents is None else agents
        within = all((a >= b).all() for a, b in zip([payload, *agents], [of_payload, *of_agents], strict=True))
    try:
        return band.Stated(
            bound=given.bound,
            confidence=given.confidence,
            norm=given.norm,
            payload=payload,
            agents=tuple(agents),
            met=_met(settings, within),
        )
    except ValueError as error:
        raise ScenarioError(f"{settings.name}: certificate: {error}") from None


def biases(settings: s.Settings) -> deviation.Biases:
    """What the sensors' data sheets state of constant and wandering errors of what labels are made of."""
    tips = deviation.Walk(start=settings.sensors.tip_force_bias_N)
    found = {"agents.lam": tips, "payload.a": deviation.Walk(), "agents.a": deviation.Walk()}
    for each in settings.sensors.then:
        if isinstance(each, s.Drifting):
            for name in found.keys() & set(each.of):
                found[name] += deviation.Walk(start=each.start, rate=each.rate)
    return deviation.Biases(tips=found["agents.lam"], payload=found["payload.a"], agents=found["agents.a"])


def _met(settings: s.Settings, within: bool) -> frozenset[Assumption]:
    """What the scenario makes true by construction of what bounds need; what is not here is assumed.

    within: whether no label errs by more than is stated, which only a calibration rig can promise.
    """
    given, learning = settings.certificate, settings.learning
    rig, fixed = learning.samples == "rig", learning.hyperparameters == "stated"
    drawn = settings.drawn is not None and settings.drawn.norm <= given.norm
    alone = not settings.disturbances and settings.nominal == s.Nominal()
    holds = {
        Assumption.NORM: drawn and fixed and alone,  # nothing is unknown but functions of that norm for that kernel
        Assumption.BOUNDED: within,
        Assumption.WITHIN_MODEL: within,  # `band.companion` takes v from eps
        Assumption.ZERO_MEAN: rig,
        Assumption.INDEPENDENT: rig,
        Assumption.PREDICTABLE: rig,
        Assumption.STATED: fixed,
        Assumption.HORIZON: True,  # a data set is as large as it will ever be when it is full
    }
    return frozenset(assumption for assumption, true in holds.items() if true)


def _label_errors(given: s.LabelError | None, prior: s.Prior, joints: int) -> np.ndarray:
    """`(6 + joints,)` as stated, or three of the prior's deviations of label noise."""
    source = [3 * prior.force_noise_N, 3 * prior.moment_noise_Nm] if given is None else [given.force_N, given.moment_Nm]
    if isinstance(given, s.AgentLabelError):
        source.append(given.joint_Nm)
    elif isinstance(prior, s.AgentPrior):
        source.append(3 * prior.joint_noise_Nm)
    return np.repeat(source, [3, 3, joints][: len(source)])
