"""Closes the loop: truth, sensors, flight software, log; and the updates of the learned models at times t_k."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from colift.math import so3
from colift.math.pytree import pytree
from colift.models import grasp, inverse_dynamics
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentInput, AgentState, GeneralizedForce, ResidualForces, State, TeamInputs, Wrench
from colift.onboard import interfaces
from colift.onboard.learning import residual_correction
from colift.simulation import contact_dynamics
from colift.simulation.world import GroundTruth

Scalar = Float[Array, ""]


@pytree
class StepRecord:
    """What the log keeps of one tick; agents, joints and contacts of all groups in a row."""

    t: Float[Array, "*time"]
    p: Float[Array, "*time 3"]
    v: Float[Array, "*time 3"]
    R_L: Float[Array, "*time 3 3"]
    omega_L: Float[Array, "*time 3"]
    a_L: Float[Array, "*time 6"]
    p_d: Float[Array, "*time 3"]
    e_p: Float[Array, "*time 3"]
    e_v: Float[Array, "*time 3"]
    e_R: Float[Array, "*time 3"]
    e_omega: Float[Array, "*time 3"]
    Psi: Float[Array, "*time"]
    R: Float[Array, "*time agents 3 3"]
    x: Float[Array, "*time agents 3"]
    omega: Float[Array, "*time agents 3"]
    v_agent: Float[Array, "*time agents 3"]
    r: Float[Array, "*time joints"]
    r_dot: Float[Array, "*time joints"]
    u: Float[Array, "*time agents"]
    tau: Float[Array, "*time agents 3"]
    tau_r: Float[Array, "*time joints"]
    thrust_saturated: Bool[Array, "*time agents"]
    lam: Float[Array, "*time contacts 3"]
    lam_cmd: Float[Array, "*time contacts 3"]
    lam_hat: Float[Array, "*time contacts 3"]
    R_L_hat: Float[Array, "*time 3 3"]
    W_d: Float[Array, "*time 6"]
    delta_W: Float[Array, "*time 6"]
    eta: Float[Array, "*time eta"]
    f_L: Float[Array, "*time 6"]
    f_L_hat: Float[Array, "*time 6"]
    f_x: Float[Array, "*time agents 3"]
    f_w: Float[Array, "*time agents 3"]
    f_r: Float[Array, "*time joints"]
    f_x_hat: Float[Array, "*time agents 3"]
    f_w_hat: Float[Array, "*time agents 3"]
    f_r_hat: Float[Array, "*time joints"]
    Phi: Float[Array, "*time"]
    Phi_dot: Float[Array, "*time"]
    min_delassus_singular_value: Float[Array, "*time agents"]
    # of pilots that listen to labels
    innovation_L: Float[Array, "*time 6"] | None = None
    innovation_x: Float[Array, "*time agents 3"] | None = None
    model_gain_L: Float[Array, "*time 6"] | None = None
    model_gain_x: Float[Array, "*time agents 3"] | None = None
    delay_error_L: Float[Array, "*time 6"] | None = None
    delay_error_x: Float[Array, "*time agents 3"] | None = None
    correction_error_L: Float[Array, "*time 6"] | None = None
    correction_error_x: Float[Array, "*time agents 3"] | None = None
    correction_weight: Float[Array, "*time"] | None = None
    labels_available: Float[Array, "*time"] | None = None


def true_residual(
    nominal: Team, team_state: State, a: contact_dynamics.Acceleration, lam: tuple, inputs: TeamInputs
) -> ResidualForces:
    """What the nominal equations leave over when the truth accelerates by `a`: the labels without any error.

    It is `f_uk` itself where the parameters are right, and holds the mass and inertia mismatch where they are not.
    """
    q, g = team_state.payload, nominal.gravity
    W = grasp.payload_wrench(grasp.contact_points(nominal), q.R, grasp.stack_contacts(lam))
    known = inverse_dynamics.payload_inverse_dynamics(nominal.payload, a.payload[:3] - g, a.payload[3:], q.omega)
    agents = tuple(
        jax.vmap(_agent_residual, in_axes=(0, 0, 0, 0, 0, None))(group, state, acc, part, u, g)
        for group, state, acc, part, u in zip(
            nominal.agent_groups, team_state.agents, a.agents, lam, inputs, strict=True
        )
    )
    return ResidualForces(agents=agents, payload=Wrench(F=known.F - W.F, tau=known.tau - W.tau))


def _agent_residual(
    agent: AerialManipulator,
    q: AgentState,
    a: contact_dynamics.AgentAcceleration,
    lam: Float[Array, "arms 3"],
    u: AgentInput,
    gravity: Float[Array, "3"],
) -> GeneralizedForce:
    force, Q, thrust = inverse_dynamics.agent_inverse_dynamics(agent, q, a.v_dot - gravity, a.xi_dot, lam)
    Q = Q - jnp.concatenate([u.tau, u.tau_r]) - u.u * thrust
    return GeneralizedForce(f_x=force - u.u * q.R[:, 2], f_w=Q[:3], f_r=Q[3:])


def _row(team: Team, nominal: Team, t: Scalar, truth: GroundTruth, decided: interfaces.Telemetry) -> StepRecord:
    z, a, inputs = truth.state, truth.acceleration, truth.inputs
    q, d = z.payload, decided.setpoint
    force = grasp.stack_contacts(truth.lam)
    # the mismatch at the attitude the allocator used, so that delta_W = G e_lam holds exactly
    W = grasp.payload_wrench(grasp.contact_points(nominal), decided.estimate.payload.R, force)
    f = true_residual(nominal, z, a, truth.lam, inputs)
    f_hat = decided.f_hat
    vec = lambda W: jnp.concatenate([W.F, W.tau])  # noqa: E731
    agents = lambda parts: jnp.concatenate(list(parts))  # noqa: E731
    joints = lambda parts: jnp.concatenate([x.reshape(-1) for x in parts])  # noqa: E731
    return StepRecord(
        t=t,
        p=q.p,
        v=q.v,
        R_L=q.R,
        omega_L=q.omega,
        a_L=a.payload,
        p_d=d.p,
        e_p=q.p - d.p,
        e_v=q.v - d.v,
        e_R=so3.e_R(q.R, d.R),
        e_omega=so3.e_omega(q.R, q.omega, d.R, d.omega),
        Psi=so3.attitude_error_function(q.R, d.R),
        R=agents(s.R for s in z.agents),
        x=agents(s.x for s in z.agents),
        omega=agents(s.omega for s in z.agents),
        v_agent=agents(s.v for s in z.agents),
        r=joints(s.r for s in z.agents),
        r_dot=joints(s.r_dot for s in z.agents),
        u=agents(u.u for u in inputs),
        tau=agents(u.tau for u in inputs),
        tau_r=joints(u.tau_r for u in inputs),
        thrust_saturated=agents(decided.saturated),
        lam=force,
        lam_cmd=decided.lam_cmd,
        lam_hat=grasp.stack_contacts(decided.estimate.lam),
        R_L_hat=decided.estimate.payload.R,
        W_d=vec(decided.W_d),
        delta_W=vec(W) - vec(decided.W_d),
        eta=decided.eta,
        f_L=vec(f.payload),
        f_L_hat=vec(f_hat.payload),
        f_x=agents(x.f_x for x in f.agents),
        f_w=agents(x.f_w for x in f.agents),
        f_r=joints(x.f_r for x in f.agents),
        f_x_hat=agents(x.f_x for x in f_hat.agents),
        f_w_hat=agents(x.f_w for x in f_hat.agents),
        f_r_hat=joints(x.f_r for x in f_hat.agents),
        Phi=jnp.abs(grasp.constraint_residual(team, z)).max(),
        Phi_dot=jnp.abs(grasp.constraint_rate(team, z)).max(),
        min_delassus_singular_value=grasp.min_delassus_singular_value(team, z),
        **({} if (innovation := decided.innovation) is None else _news(innovation)),
    )


def _news(innovation: residual_correction.Innovation) -> dict[str, Array]:
    def parts(of: ResidualForces) -> tuple[Array, Array]:
        return jnp.concatenate([of.payload.F, of.payload.tau]), jnp.concatenate([agent.f_x for agent in of.agents])

    told = {
        "r": innovation.r,
        "trust": innovation.model_gain,
        "late": innovation.delay_error_rms,
        "left": innovation.correction_error_rms,
    }
    split = {f"{name}_{body}": x for name, of in told.items() for body, x in zip("Lx", parts(of), strict=True)}
    return split | {"fresh": innovation.correction_weight, "comes": innovation.labels_available}


def model_inputs(team: Team, rows: StepRecord) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """The learned maps' inputs at the true states of a flight: `(time, 18)`, and `(time, agents, inputs)` by group."""
    time = len(rows.t)
    agents, first, joint = [], 0, 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        one, many = slice(first, first + size), slice(joint, joint + size * group.tree.joints)
        r, r_dot = (a[:, many].reshape(time, size, -1) for a in (rows.r, rows.r_dot))
        R, x, omega, v = (a[:, one] for a in (rows.R, rows.x, rows.omega, rows.v_agent))
        agents.append(np.concatenate([R.reshape(time, size, 9), x, r, omega, v, r_dot], axis=2))
        first, joint = one.stop, many.stop
    payload = np.concatenate([rows.p, rows.v, rows.R_L.reshape(time, 9), rows.omega_L], axis=1)
    return payload, tuple(agents)


DERIVED_SIGNALS = ("a_L", "lam", "delta_W", "f_L", "f_x", "f_w", "f_r")  # what follows from everything else in a tick


def _admittance(team: Team, r: np.ndarray, agent: int) -> np.ndarray:
    """Of one agent, counted through the groups, as are the joints of all agents in r."""
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        joints = group.tree.joints
        if agent < size:
            own = jnp.asarray(r[agent * joints : (agent + 1) * joints])
            return np.asarray(grasp.delassus_matrix(jax.tree.map(lambda x, j=agent: x[j], group), own))
        agent, r = agent - size, r[size * joints :]
    raise IndexError(f"agent {agent} beyond the team")
