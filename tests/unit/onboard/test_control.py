"""Tests of control: exact realization of contact forces on random teams against the coupled plant, and attitude
setpoints.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from colift.math import so3
from colift.models import aerial_manipulator, grasp
from colift.models.parameters import KinematicTree, Team
from colift.models.state import GeneralizedForce, PayloadState, ResidualForces, State, Wrench
from colift.onboard.control import attitude as attitude_module
from colift.onboard.control import preview, realization, redundancy, setpoints, tracking
from colift.simulation import contact_dynamics
from colift.trajectories import base
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam

# each agent with at least 3n - 3 joints; all but the second structure hold redundant ones
STRUCTURES = [
    ((teams.SEVEN, 1),),
    ((teams.WAIST_TWO_ARMS, 2),),
    ((teams.SLIDING_ARM, 2), (teams.SLIDING_ARMS, 1)),
    ((teams.WAIST_TWO_ARMS, 1), (teams.CHAIN, 1), (teams.SEVEN, 1)),
]
GAINS = tracking.Gains(
    K_p=jnp.diag(jnp.array([5.0, 6, 7])),
    K_v=jnp.diag(jnp.array([4.0, 5, 6])),
    k_R=jnp.array([60.0, 60.0, 12.0]),
    k_omega=jnp.array([14.0, 14.0, 5.0]),
    jerk_feedback=jnp.array(0.8),
    agent_k_R=jnp.array(25.0),
    agent_k_omega=jnp.array(8.0),
    posture_bandwidth=jnp.array(2.0),
)
ROUNDING = 1e-7  # redundant joints have weights of 1e-4 to 1e2, which costs six digits
accelerate = jax.jit(contact_dynamics.forward_dynamics)
attitude = jax.jit(attitude_module.attitude_from_thrust)


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, None, None, 0, None, None, 0, 0))
def realize(agent, gains, gravity, q, load, to, share, f):
    """Agent controller of the paper with its attitude setpoint; the commanded contact forces count as provided."""
    turn = attitude_module.thrust_attitude_setpoint(agent, gravity, load, to, share, f)
    return realization.agent_inputs(agent, gains, gravity, q, load, to, share, f, turn, jnp.zeros(3), None)


@dataclasses.dataclass
class Task:
    """A team on its grasp, its setpoints, and the residuals that the controller compensates."""

    team: Team
    z: State
    to: tracking.AccelerationCommand
    shares: tuple[setpoints.AgentSetpoint, ...]
    f: ResidualForces


def task(seed: int, structure: tuple) -> Task:
    """Random contact forces on a moving team, and the payload acceleration that follows from them."""
    rng = np.random.default_rng(seed)
    team, z = PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))
    unlimited = tuple(dataclasses.replace(g, thrust_max=jnp.full_like(g.thrust_max, 1e6)) for g in team.agent_groups)
    team = dataclasses.replace(team, agent_groups=unlimited)
    draw = lambda *shape: jnp.array(rng.normal(size=shape))  # noqa: E731
    shares, forces = [], []
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        n, n_r = group.tree.arms, group.tree.joints
        lam = 5 * draw(size, n, 3)
        shares.append(
            setpoints.AgentSetpoint(lam=lam, lam_dot=draw(size, n, 3), yaw=draw(size), nominal_posture=draw(size, n_r))
        )
        forces.append(GeneralizedForce(f_x=draw(size, 3), f_w=0.1 * draw(size, 3), f_r=0.1 * draw(size, n_r)))
    load = Wrench(F=draw(3), tau=0.1 * draw(3))
    # Newton and Euler for the payload, in plain NumPy
    R, w, J = (np.asarray(x) for x in (z.payload.R, z.payload.omega, team.payload.inertia))
    lam = np.concatenate([np.asarray(s.lam).reshape(-1, 3) for s in shares])
    moment = np.cross(np.asarray(grasp.contact_points(team)), lam @ R).sum(0) + load.tau - np.cross(w, J @ w)
    to = tracking.AccelerationCommand(
        a=team.gravity + (jnp.array(lam.sum(0)) + load.F) / team.payload.mass,
        alpha=jnp.array(np.linalg.solve(J, moment)),
        jerk=draw(3),
        alpha_dot=draw(3),
    )
    return Task(team=team, z=z, to=to, shares=tuple(shares), f=ResidualForces(agents=tuple(forces), payload=load))


def commands(problem: Task, gains: tracking.Gains = GAINS) -> tuple:
    """Return the inputs of all agents."""
    team, z = problem.team, problem.z
    return tuple(
        realize(group, gains, team.gravity, q, z.payload, problem.to, share, f)
        for group, q, share, f in zip(team.agent_groups, z.agents, problem.shares, problem.f.agents, strict=True)
    )


def with_lateral_forces(problem: Task, d: list[np.ndarray]) -> ResidualForces:
    """Return the residuals plus lateral forces d along the base's x and y axes, two per agent."""
    agents = tuple(
        dataclasses.replace(f, f_x=f.f_x + jnp.einsum("jik,jk->ji", q.R[:, :, :2], jnp.array(part)))
        for f, q, part in zip(problem.f.agents, problem.z.agents, d, strict=True)
    )
    return dataclasses.replace(problem.f, agents=agents)


def solve_aligned(problem: Task, inputs: tuple) -> tuple[contact_dynamics.Acceleration, np.ndarray, np.ndarray]:
    """Return motion, contact force error and lateral forces that align the thrusts with their attitude setpoints.

    An aligned thrust needs none. Contact forces are affine in them, so least squares finds those that come
    nearest to the command; that they reach it is what the tests claim.
    """
    sizes = problem.team.sizes
    count = 2 * sum(sizes)

    def lam(d: np.ndarray) -> np.ndarray:
        parts = np.split(d.reshape(-1, 2), np.cumsum(sizes)[:-1])
        return np.asarray(
            grasp.stack_contacts(accelerate(problem.team, problem.z, inputs, with_lateral_forces(problem, parts))[1])
        ).ravel()

    required = np.asarray(grasp.stack_contacts(tuple(share.lam for share in problem.shares))).ravel()
    zero = lam(np.zeros(count))
    A = np.stack([lam(e) - zero for e in np.eye(count)], axis=1)
    d = np.linalg.lstsq(A, required - zero, rcond=None)[0]
    d += np.linalg.lstsq(A, required - lam(d), rcond=None)[0]  # correction of rounding errors
    a, _ = accelerate(
        problem.team, problem.z, inputs, with_lateral_forces(problem, np.split(d.reshape(-1, 2), np.cumsum(sizes)[:-1]))
    )
    return a, lam(d) - required, d


def agents_of(values: tuple) -> list:
    """Return the agents of all groups as a list."""
    return [jax.tree.map(lambda x, j=j: x[j], group) for group in values for j in range(len(jax.tree.leaves(group)[0]))]


CASES = [pytest.param(seed, structure, id=f"{i}-{seed}") for i, structure in enumerate(STRUCTURES) for seed in (1, 2)]


@pytest.mark.parametrize(("seed", "structure"), CASES)
def test_aligned_thrust_realizes_forces_and_motion(seed, structure):
    """With aligned thrust, contact forces and payload motion are as commanded."""
    problem = task(seed, structure)
    a, force_error, d = solve_aligned(problem, commands(problem))
    assert np.abs(d).max() > 0.1  # without lateral forces the thrusts are not aligned
    assert np.abs(force_error).max() < ROUNDING
    np.testing.assert_allclose(a.payload, jnp.concatenate([problem.to.a, problem.to.alpha]), atol=ROUNDING)


@pytest.mark.parametrize(("seed", "structure"), CASES)
def test_thrust_is_the_required_force_along_body_z(seed, structure):
    """Thrust is the component of the required force along the body z axis."""
    problem = task(seed, structure)
    inputs = commands(problem)
    a, _, d = solve_aligned(problem, inputs)
    v_dot = np.concatenate([np.asarray(x.v_dot) for x in a.agents])
    parts = (
        agents_of(problem.team.agent_groups),
        agents_of(problem.z.agents),
        agents_of(problem.shares),
        agents_of(problem.f.agents),
        agents_of(inputs),
    )
    for j, (agent, q, share, f, u) in enumerate(zip(*parts, strict=True)):
        force = float(agent.mass.sum()) * (v_dot[j] - problem.team.gravity) + share.lam.sum(0) - f.f_x
        np.testing.assert_allclose(q.R.T @ force, [*d[2 * j : 2 * j + 2], u.u], atol=ROUNDING)


@pytest.mark.parametrize(("seed", "structure"), CASES)
def test_agents_follow_the_attitude_law(seed, structure):
    problem = task(seed, structure)
    a, _, _ = solve_aligned(
        problem, commands(problem, dataclasses.replace(GAINS, posture_bandwidth=jnp.array(0.0)))
    )  # without tilt
    turned = np.concatenate([np.asarray(x.xi_dot)[:, :3] for x in a.agents])
    k_R, k_w, h = float(GAINS.agent_k_R), float(GAINS.agent_k_omega), 1e-5
    parts = zip(
        agents_of(problem.team.agent_groups),
        agents_of(problem.z.agents),
        agents_of(problem.shares),
        agents_of(problem.f.agents),
        strict=True,
    )
    for j, (agent, q, share, f) in enumerate(parts):
        m, c = agent.mass.sum(), np.asarray(agent.contact_position)

        def f_dir(s, m=m, c=c, share=share, f=f):
            lam = share.lam + s * share.lam_dot
            a = contact_accelerations(problem.z.payload, problem.to, c, s).mean(0)
            return jnp.asarray(m * (a - problem.team.gravity) + lam.sum(0) - f.f_x)

        R, R_d = np.asarray(q.R), np.asarray(attitude(f_dir(0.0), share.yaw))
        R_d_dot = (attitude(f_dir(h), share.yaw) - attitude(f_dir(-h), share.yaw)) / (2 * h)
        omega_d = vee(R_d.T @ np.asarray(R_d_dot))
        expected = -k_R * vee(R_d.T @ R) - k_w * (q.omega - R.T @ R_d @ omega_d)
        np.testing.assert_allclose(turned[j], expected, atol=1e-6)


def contact_accelerations(q: PayloadState, to: tracking.AccelerationCommand, c: np.ndarray, s: float) -> np.ndarray:
    """Return accelerations of points c after s seconds of the commanded motion, in plain NumPy and SciPy [m/s^2]."""
    w, alpha, alpha_dot = (np.asarray(x) for x in (q.omega, to.alpha, to.alpha_dot))
    R = np.asarray(q.R) @ Rotation.from_rotvec(s * w + s**2 / 2 * alpha).as_matrix()
    w, alpha = w + s * alpha, alpha + s * alpha_dot
    return np.asarray(to.a + s * to.jerk) + (np.cross(alpha, c) + np.cross(w, np.cross(w, c))) @ R.T


def vee(A: np.ndarray) -> np.ndarray:
    """Return the vector of the skew-symmetric part."""
    return np.array([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]]) / 2


@pytest.mark.parametrize("seed", [1, 2])
def test_redundant_joints_follow_the_thrust_direction(seed):
    """With one arm and any attitude no lateral force is missing."""
    problem = task(seed, STRUCTURES[3])
    _, force_error, d = solve_aligned(problem, commands(problem))
    assert np.abs(d[2:4]).max() < 0.02 * np.abs(d).max()  # the chain; the other agents' arms leave a joint at most
    assert np.abs(force_error).max() < ROUNDING


ONE_ARM = ((teams.CHAIN, 1), (teams.RIGID, 2))


@pytest.mark.parametrize("seed", [1, 2])
def test_posture_tilt_accelerates_the_center_of_mass(seed):
    """At rest with joints off their posture: `m x_dd` perpendicular to the thrust equals that of fixed tips."""
    rng = np.random.default_rng(seed)
    agent = jax.tree.map(lambda x: x[0], teams.team(rng, ONE_ARM).agent_groups[0])
    q = teams.agent_state(rng, teams.CHAIN, speed=0.0)
    zero, g = jnp.zeros(3), jnp.array([0.0, 0, -9.81])
    to = tracking.AccelerationCommand(a=zero, alpha=zero, jerk=zero)
    off = 0.2 * rng.normal(size=3)
    share = setpoints.AgentSetpoint(
        lam=jnp.zeros((1, 3)), lam_dot=jnp.zeros((1, 3)), yaw=jnp.array(0.4), nominal_posture=q.r - jnp.asarray(off)
    )
    none = GeneralizedForce(f_x=zero, f_w=zero, f_r=zero)
    turn = attitude_module.thrust_attitude_setpoint(agent, g, teams.payload_state(rng, speed=0.0), to, share, none)
    q = dataclasses.replace(q, R=turn.R)
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
    tilted, _ = redundancy.posture_control(agent, GAINS, g, q, to.a, share, none, p, turn)
    r_dd = -(float(GAINS.posture_bandwidth) ** 2) * off
    lift = -np.asarray(turn.R) @ np.asarray(p.J_tip)[0, :, 3:] @ r_dd  # m/s^2; the tip stays
    f = lift - np.asarray(g)
    np.testing.assert_allclose(tilted.R[:, 2], f / np.linalg.norm(f), atol=0.01 * np.linalg.norm(lift) / 9.81)
    assert np.linalg.norm(np.cross(tilted.R[:, 2], turn.R[:, 2])) > 1e-3


LONG_CHAIN = KinematicTree(parents=tuple(range(7)), prismatic=(False,) * 7, tip_bodies=(7,))


@pytest.mark.parametrize("seed", [1, 2])
def test_uncontrolled_joint_acceleration(seed):
    """Torques `H z` with `B z = 0` accelerate the joints by z; torques of forces at the tips do not."""
    problem = task(seed, ((LONG_CHAIN, 1), (teams.RIGID, 2)))
    agent, q = (jax.tree.map(lambda x: x[0], groups[0]) for groups in (problem.team.agent_groups, problem.z.agents))
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
    B, H = np.asarray(p.J_tip)[0, :, 3:], np.asarray(p.M_bar)[3:, 3:]
    z, c = np.linalg.svd(B)[2][3:].T @ np.random.default_rng(seed).normal(size=4), np.array([0.3, -0.2, 0.1])
    acceleration_of = lambda f_r: np.asarray(redundancy.uncontrolled_joint_acceleration(agent, p, jnp.asarray(f_r)))  # noqa: E731
    np.testing.assert_allclose(acceleration_of(H @ z + B.T @ c), z, atol=1e-8)
    np.testing.assert_allclose(B @ acceleration_of(np.ones(7)), 0, atol=1e-8)
    _, force_error, _ = solve_aligned(problem, commands(problem))
    assert np.abs(force_error).max() < ROUNDING


def test_uncontrolled_joints_of_a_planar_arm():
    """Four joints about one axis: the tip cannot leave a plane, so B has a row of zeros."""
    rng = np.random.default_rng(0)
    planar = KinematicTree(parents=(0, 1, 2, 3), prismatic=(False,) * 4, tip_bodies=(4,))
    agent = jax.tree.map(lambda x: x[0], teams.team(rng, ((planar, 1), (teams.RIGID, 2))).agent_groups[0])
    turned, axes = jnp.tile(jnp.eye(3), (4, 1, 1)), jnp.tile(jnp.array([0.0, 1, 0]), (4, 1))
    agent = dataclasses.replace(agent, joint_rotation=turned, joint_axis=axes)
    p = aerial_manipulator.centroidal_model(
        agent, aerial_manipulator.forward_kinematics(agent, jnp.array([0.4, -0.7, 0.5, 0.3]))
    )
    B, H = np.asarray(p.J_tip)[0, :, 3:], np.asarray(p.M_bar)[3:, 3:]
    assert np.abs(B[1]).max() < 1e-15
    z = np.linalg.svd(B)[2][2:].T @ np.array([1.0, -2.0])
    np.testing.assert_allclose(redundancy.uncontrolled_joint_acceleration(agent, p, jnp.asarray(H @ z)), z, atol=1e-8)


# Payload controller ---------------------------------------------------------------------------------------------------


@dataclasses.dataclass
class MovingSetpoint:
    """A moving payload, a setpoint with another motion, and the evolution of both."""

    q: PayloadState
    a: jax.Array  # m/s^2, of the payload
    d: base.PayloadSetpoint

    def after(self, h: float, alpha: jax.Array) -> tuple[PayloadState, base.PayloadSetpoint]:
        """Return both after h seconds to second order; alpha is the payload's angular acceleration [rad/s^2]."""
        q, d = self.q, self.d
        turned = so3.exp(h * q.omega + h * h / 2 * alpha)
        return (
            PayloadState(
                R=q.R @ turned, p=q.p + h * q.v + h * h / 2 * self.a, omega=q.omega + h * alpha, v=q.v + h * self.a
            ),
            dataclasses.replace(
                d,
                p=d.p + h * d.v + h * h / 2 * d.a,
                v=d.v + h * d.a + h * h / 2 * d.j,
                a=d.a + h * d.j,
                R=d.R @ so3.exp(h * d.omega + h * h / 2 * d.omega_dot),
                omega=d.omega + h * d.omega_dot,
            ),
        )


def moving_setpoint(seed: int) -> MovingSetpoint:
    """Return random numbers of order one for all quantities."""
    rng = np.random.default_rng(seed)
    v = lambda: jnp.array(rng.normal(size=3))  # noqa: E731
    R = lambda: so3.exp(v())  # noqa: E731
    d = base.PayloadSetpoint(p=v(), v=v(), a=v(), j=v(), R=R(), omega=v(), omega_dot=v())
    return MovingSetpoint(q=PayloadState(R=R(), p=v(), omega=v(), v=v()), a=v(), d=d)


command = jax.jit(tracking.tracking_acceleration)


@pytest.mark.parametrize("seed", range(5))
def test_commanded_acceleration_gives_the_error_dynamics(seed):
    """Eq. pl_cl_eom with omega_d and its rate: `e_w_dot = -k_R e_R - k_w e_w`, by differences."""
    of, h = moving_setpoint(seed), 1e-5
    alpha = command(GAINS, of.q, of.a, of.d).alpha
    ends = []
    for s in (h, -h):
        q, d = of.after(s, alpha)
        ends.append(np.asarray(so3.e_omega(q.R, q.omega, d.R, d.omega)))
    e_R, e_w = so3.e_R(of.q.R, of.d.R), so3.e_omega(of.q.R, of.q.omega, of.d.R, of.d.omega)
    expected = -GAINS.k_R * e_R - GAINS.k_omega * e_w
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * h), expected, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_the_jerk_is_the_rate_of_the_commanded_acceleration(seed):
    """With the full feedback of the measured acceleration; a smaller share leaves out the rest of this term."""
    of, h = moving_setpoint(seed), 1e-4
    gains = dataclasses.replace(GAINS, jerk_feedback=jnp.ones(()))
    to = command(gains, of.q, of.a, of.d)
    ends = [np.asarray(command(gains, q, of.a, d).a) for q, d in (of.after(s, to.alpha) for s in (h, -h))]
    np.testing.assert_allclose(to.jerk, (ends[0] - ends[1]) / (2 * h), atol=1e-6)
    e_v, e_a = of.q.v - of.d.v, of.a - of.d.a
    assert np.abs(GAINS.K_p @ e_v).min() > 1e-3  # each term counts
    assert np.abs(GAINS.K_v @ e_a).min() > 1e-3
    left_out = (1 - GAINS.jerk_feedback) * (GAINS.K_v @ e_a)
    np.testing.assert_allclose(command(GAINS, of.q, of.a, of.d).jerk, to.jerk + left_out, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_desired_wrench_gives_the_commanded_acceleration(seed):
    """Newton and Euler in plain NumPy under the wrench and the residual that it compensates."""
    rng, of = np.random.default_rng(seed), moving_setpoint(seed)
    team = teams.team(rng, STRUCTURES[1])
    f = Wrench(F=jnp.array(rng.normal(size=3)), tau=jnp.array(rng.normal(size=3)))
    to = command(GAINS, of.q, of.a, of.d)
    W = tracking.desired_wrench(team.payload, team.gravity, of.q, to, f)
    J, w = np.asarray(team.payload.inertia), np.asarray(of.q.omega)
    a = (np.asarray(W.F) + f.F) / float(team.payload.mass) + team.gravity
    alpha = np.linalg.solve(J, np.asarray(W.tau) + f.tau - np.cross(w, J @ w))
    np.testing.assert_allclose(a, to.a, atol=1e-9)
    np.testing.assert_allclose(alpha, to.alpha, atol=1e-9 * np.linalg.cond(J))


@pytest.mark.parametrize("seed", range(3))
def test_point_jerk_is_the_rate_of_the_point_acceleration(seed):
    """Points of a payload whose command changes by `jerk` and `alpha_dot`, by differences in NumPy and SciPy."""
    rng, q, h = np.random.default_rng(seed), moving_setpoint(seed).q, 1e-4
    v = lambda: jnp.array(rng.normal(size=3))  # noqa: E731
    to = tracking.AccelerationCommand(a=v(), alpha=v(), jerk=v(), alpha_dot=v())
    c = rng.normal(size=(4, 3))
    now, ahead, behind = (contact_accelerations(q, to, c, s) for s in (0.0, h, -h))
    np.testing.assert_allclose(tracking.point_acceleration(q, to, jnp.asarray(c)), now, atol=1e-12)
    np.testing.assert_allclose(tracking.point_jerk(q, to, jnp.asarray(c)), (ahead - behind) / (2 * h), atol=1e-6)
    neglected = tracking.point_jerk(q, dataclasses.replace(to, alpha_dot=None), jnp.asarray(c))
    np.testing.assert_array_equal(neglected, np.tile(to.jerk, (4, 1)))


@pytest.mark.parametrize("seed", range(3))
def test_wrench_rate_is_the_rate_of_the_desired_wrench(seed):
    """The payload moves by the command, whose rates are `jerk` and `alpha_dot`; the residual is constant."""
    rng, q, h = np.random.default_rng(seed), moving_setpoint(seed).q, 1e-4
    payload = teams.team(rng, STRUCTURES[1]).payload
    v = lambda: jnp.array(rng.normal(size=3))  # noqa: E731
    to, f, gravity = (
        tracking.AccelerationCommand(a=v(), alpha=v(), jerk=v(), alpha_dot=v()),
        Wrench(F=v(), tau=v()),
        v(),
    )

    def wrench(s: float) -> Wrench:
        command = dataclasses.replace(to, a=to.a + s * to.jerk, alpha=to.alpha + s * to.alpha_dot)
        omega = q.omega + s * to.alpha + s**2 / 2 * to.alpha_dot
        return tracking.desired_wrench(payload, gravity, dataclasses.replace(q, omega=omega), command, f)

    rate, ahead, behind = tracking.desired_wrench_rate(payload, q, to), wrench(h), wrench(-h)
    np.testing.assert_allclose(rate.F, (ahead.F - behind.F) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(rate.tau, (ahead.tau - behind.tau) / (2 * h), atol=1e-6)
    assert not np.any(tracking.desired_wrench_rate(payload, q, dataclasses.replace(to, alpha_dot=None)).tau)


@pytest.mark.parametrize("seed", range(3))
def test_angular_jerk_is_that_of_the_reference(seed):
    """On the reference `alpha_dot` is the rate of alpha; elsewhere it is that of the reference in the payload frame."""
    of, h = moving_setpoint(seed), 1e-4
    omega_ddot = jnp.array(np.random.default_rng(seed).normal(size=3))

    def on_reference(s: float) -> tracking.AccelerationCommand:
        d = of.after(s, jnp.zeros(3))[1]
        rates = {"omega": s * s / 2 * omega_ddot, "omega_dot": s * omega_ddot, "omega_ddot": omega_ddot}
        now = {name: rate + (0 if name == "omega_ddot" else getattr(d, name)) for name, rate in rates.items()}
        d = dataclasses.replace(d, **now)
        return command(GAINS, PayloadState(R=d.R, p=d.p, omega=d.omega, v=d.v), d.a, d)

    rate = (on_reference(h).alpha - on_reference(-h).alpha) / (2 * h)
    np.testing.assert_allclose(on_reference(0.0).alpha_dot, rate, atol=1e-6)
    off = command(GAINS, of.q, of.a, dataclasses.replace(of.d, omega_ddot=omega_ddot))
    np.testing.assert_allclose(of.q.R @ off.alpha_dot, of.d.R @ omega_ddot, atol=1e-12)
    assert command(GAINS, of.q, of.a, of.d).alpha_dot is None


vectors = st.tuples(*[st.floats(-20, 20)] * 3).map(np.array)


@given(f=vectors.filter(lambda f: np.linalg.norm(f) > 0.1), heading=st.floats(-4, 4))
def test_attitude_has_its_third_axis_along_the_force(f, heading):
    """The attitude is a rotation matrix with its third axis along the force."""
    ahead = np.array([np.cos(heading), np.sin(heading), 0])
    if np.linalg.norm(np.cross(f, ahead)) < 1e-3 * np.linalg.norm(f):
        return  # yaw is undefined for a thrust along it
    R = np.asarray(attitude(jnp.array(f), jnp.array(heading)))
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    np.testing.assert_allclose(R[:, 2], f / np.linalg.norm(f), atol=1e-12)
    assert abs(R[:, 1] @ ahead) < 1e-12
    assert R[:, 0] @ ahead > 0


@given(f=vectors.filter(lambda f: f[2] > 1), heading=st.floats(-4, 4))
def test_the_attitude_has_finite_gradients(f, heading):
    J = gradient(jnp.array(f), jnp.array(heading))
    assert np.isfinite(J).all()
    along = np.einsum("ijk,k->ij", J, f)  # a longer force is the same attitude
    np.testing.assert_allclose(along, 0, atol=1e-9)


gradient = jax.jit(jax.jacfwd(attitude_module.attitude_from_thrust))


# Preview --------------------------------------------------------------------------------------------------------------


@given(st.integers(0, 10**6))
def test_attitude_rates_equal_finite_differences(seed):
    rng = np.random.default_rng(seed)
    f = np.array([0.0, 0.0, 20.0]) + rng.normal(size=3), 5 * rng.normal(size=3), 20 * rng.normal(size=3)
    heading, h = jnp.array(rng.normal()), 1e-3
    turn = attitude_module.attitude_trajectory(jnp.stack([jnp.asarray(x) for x in f]), heading)
    R = [
        np.asarray(attitude_module.attitude_from_thrust(jnp.asarray(f[0] + s * f[1] + s**2 * f[2] / 2), heading))
        for s in (-h, 0, h)
    ]
    np.testing.assert_allclose(turn.R, R[1], atol=1e-14)
    turned = [np.asarray(so3.vee(jnp.asarray(b.T @ a))) for a, b in zip(R, R[::-1], strict=True)]
    np.testing.assert_allclose(turn.omega, -turned[0] / (2 * h), atol=1e-4)
    ahead, behind = (Rotation.from_matrix(R[1].T @ x).as_rotvec() for x in (R[2], R[0]))
    np.testing.assert_allclose(turn.omega_dot, (ahead + behind) / h**2, atol=1e-3)


@settings(max_examples=8)
@given(st.integers(0, 10**6))
def test_preview_rates_of_a_single_body(seed):
    """A single body that holds the payload at its center of mass, which its rotation does not move."""
    rng = np.random.default_rng(seed)
    structure = ((KinematicTree(parents=(), prismatic=(), tip_bodies=(0,)), 1),)
    team, z = teams.team(rng, structure), teams.free_state(rng, structure)
    body = jax.tree.map(lambda x: x[0], team.agent_groups[0])
    body = dataclasses.replace(body, tip_position=body.com[:1], contact_position=jnp.zeros((1, 3)))
    q = jax.tree.map(lambda x: x[0], z.agents[0])
    step, c = 0.03, rng.normal(size=(5, 3)) * np.array([1, 1, 1, 2, 6])[:, None] + [[0, 0, 20], *[[0, 0, 0]] * 4]
    at = step * preview.PREVIEW_NODES
    f = sum(c[k] * at[:, None] ** k for k in range(5))  # required force over the preview, N
    required = np.asarray(body.mass).sum() * (rng.normal(size=(5, 3)) - np.asarray(team.gravity))
    still = dataclasses.replace(z.payload, omega=jnp.zeros(3))
    load = jax.tree.map(lambda x: jnp.broadcast_to(x, (5, *x.shape)), still)
    a = required / float(body.mass.sum()) + np.asarray(team.gravity)
    to = jax.vmap(lambda a: tracking.AccelerationCommand(a=a, alpha=jnp.zeros(3), jerk=jnp.zeros(3)))(jnp.asarray(a))
    none = GeneralizedForce(f_x=jnp.zeros(3), f_w=jnp.zeros(3), f_r=jnp.zeros(0))
    share = setpoints.AgentSetpoint(
        lam=jnp.asarray((f - required)[2:3]),
        lam_dot=jnp.zeros((1, 3)),
        yaw=jnp.array(0.3),
        nominal_posture=jnp.zeros(0),
    )
    ahead = preview.AgentPreview(step=jnp.array(step), payload=load, acceleration_cmd=to, f=jnp.asarray(f))
    now = jax.tree.map(lambda x: x[2], to)
    turn = preview.preview_attitude_setpoint(body, team.gravity, q, z.payload, now, share, none, ahead)
    expected = attitude_module.attitude_trajectory(jnp.asarray(np.stack([c[0], c[1], 2 * c[2]])), share.yaw)
    for name in ("R", "omega", "omega_dot"):
        np.testing.assert_allclose(getattr(turn, name), getattr(expected, name), atol=1e-7, err_msg=name)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_contacts_bear_the_thrust_that_a_limit_withholds(structure):
    """With limited thrust the torques are those for contact forces without the missing thrust, by inverse dynamics."""
    problem = task(0, structure)
    team, z, missing = problem.team, problem.z, 1.5

    def limited(agent, q, share, f):
        g = aerial_manipulator.forward_kinematics(agent, q.r)
        p = aerial_manipulator.centroidal_model(agent, g)
        h, _ = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
        xi_dot = jnp.arange(3.0 + agent.tree.joints)
        compute = functools.partial(
            realization.inputs_for_acceleration, p, h, q, problem.to.a - team.gravity, xi_dot, f_hat=f
        )
        requested = compute(lam=share.lam)
        at_limit = dataclasses.replace(agent, thrust_max=requested.u - missing)
        found = realization.with_torques_for_limited_thrust(at_limit, p, requested)
        return requested, found, compute(lam=share.lam - missing * q.R[None, :, 2] / agent.tree.arms)

    for group, q, share, f in zip(team.agent_groups, z.agents, problem.shares, problem.f.agents, strict=True):
        requested, found, expected = jax.jit(jax.vmap(limited))(group, q, share, f)
        np.testing.assert_array_equal(found.u, requested.u)  # the limit itself follows later
        np.testing.assert_allclose(expected.u, requested.u - missing, atol=1e-12)
        np.testing.assert_allclose(found.tau, expected.tau, atol=1e-12)
        np.testing.assert_allclose(found.tau_r, expected.tau_r, atol=1e-12)
        assert np.abs(found.tau_r - requested.tau_r).max() > 0.01
