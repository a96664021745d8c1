"""The closed loop around rest on the grasp, to first order: from unknown forces to the payload's errors.

Rest, nominal = truth, ideal sensors, reference held at its start. The loop moves on the grasp, so its state has two
coordinates for each of the team's free velocities.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from colift.math import so3
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State, Wrench, split_agent_force, zero_residual
from colift.onboard import controller
from colift.simulation import contact_dynamics

OUTPUTS = {"e_p": 3, "e_v": 3, "e_R": 3, "e_omega": 3, "a": 3, "alpha": 3, "delta_W": 6}
"""Rows of `Response.C`: tracking errors, payload acceleration less the commanded one (m/s^2, rad/s^2), mismatch."""


@dataclasses.dataclass(frozen=True)
class LinearizedLoop:
    """`x_dot = A x + B f~`, `y = C x + D f~`: f~ the unknown forces that are not compensated, y as in `OUTPUTS`."""

    A: np.ndarray  # (states, states) 1/s
    B: np.ndarray  # (states, inputs)
    C: np.ndarray  # (outputs, states)
    D: np.ndarray  # (outputs, inputs)
    basis: np.ndarray  # (coordinates, states), orthonormal: the states as a raveled `dynamics.Shift`
    bodies: tuple[slice, ...]  # columns of the payload's residual, then of each agent's, in team order

    def output_rows(self, output: str) -> slice:
        """Where an output of `OUTPUTS` stands in C and D."""
        names = list(OUTPUTS)
        first = sum(OUTPUTS[name] for name in names[: names.index(output)])
        return slice(first, first + OUTPUTS[output])


def flatten(f: ResidualForces) -> Float[Array, " inputs"]:
    """A residual as a row: the payload's wrench, then `(f_x, f_w, f_r)` of each agent, in team order."""
    agents = [jnp.concatenate([part.f_x, part.f_w, part.f_r], axis=1).reshape(-1) for part in f.agents]
    return jnp.concatenate([f.payload.F, f.payload.tau, *agents])


def unflatten(team: Team, f: Float[Array, " inputs"]) -> ResidualForces:
    """The inverse of `flatten`."""
    agents, first = [], 6
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        n = 6 + group.tree.joints
        part = f[first : first + size * n].reshape(size, n)
        agents.append(split_agent_force(part))
        first += size * n
    return ResidualForces(agents=tuple(agents), payload=Wrench(F=f[:3], tau=f[3:6]))


def body_columns(team: Team) -> tuple[slice, ...]:
    """Columns of a flat residual that belong to the payload, then to each agent."""
    ends = [0, 6]
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        ends += [ends[-1] + (6 + group.tree.joints) * (k + 1) for k in range(size)]
    return tuple(slice(a, b) for a, b in itertools.pairwise(ends))


RESIDUAL_SIGNALS = ("f_L", "f_x", "f_w", "f_r")
"""How a residual is logged: the payload's, then of all agents, the joints of each behind those of the one before."""


def group_by_body(
    joints: Sequence[int], f_L: np.ndarray, f_x: np.ndarray, f_w: np.ndarray, f_r: np.ndarray
) -> list[np.ndarray]:
    """Residuals along a flight, logged as `PARTS`, of the payload and of each agent, `(times, 6)` and `(times, 6 + n)`.

    joints: n of each agent.
    """
    ends = itertools.pairwise(np.cumsum([0, *joints]).tolist())
    agents = (np.concatenate([f_x[:, j], f_w[:, j], f_r[:, a:b]], axis=1) for j, (a, b) in enumerate(ends))
    return [f_L, *agents]


def linearize(onboard_controller: controller.LeaderFollowerController, state: State) -> LinearizedLoop:
    """The loop's response around z, on the grasp and at rest; on the host.

    `A = T^T J T` with T a basis of the directions that keep Phi and Phi_dot. The measured acceleration that the
    control law uses is the one it causes: `a = a(z, a, f~)` is solved to first order. For forces that an oracle
    compensates, give the pilot one that predicts zero: f~ is what is left.
    """
    J, C = (np.asarray(x) for x in _jacobians(onboard_controller, state))
    n = C.shape[1]
    rates, a, y = J[:n], J[n : n + 6], J[n + 6 :]
    free = np.r_[0:n, n + 6 : J.shape[1]]  # every column but the measured acceleration's
    caused = np.linalg.solve(np.eye(6) - a[:, n : n + 6], a[:, free])
    rates, y = (part[:, free] + part[:, n : n + 6] @ caused for part in (rates, y))
    _, singular, Vt = np.linalg.svd(C)
    T = Vt[int((singular > 1e-9 * singular[0]).sum()) :].T
    return LinearizedLoop(
        A=T.T @ rates[:, :n] @ T,
        B=T.T @ rates[:, n:],
        C=y[:, :n] @ T,
        D=y[:, n:],
        basis=T,
        bodies=body_columns(onboard_controller.team),
    )


@jax.jit
def _jacobians(onboard_controller: controller.LeaderFollowerController, state: State) -> tuple[jax.Array, jax.Array]:
    """Of (rate, payload acceleration, outputs) by (z, measured a, f~), and of (Phi, Phi_dot) by z; local coordinates.

    One column at a time: a batch of directions would take three times as long to compile.
    """
    team = onboard_controller.team
    zero, unravel = ravel_pytree(contact_dynamics.zero_tangent(state))
    f, none, t = flatten(zero_residual(team)), jnp.zeros(6), jnp.zeros(())
    d = onboard_controller.reference.evaluate(t)
    memories = onboard_controller.payload_controller.init(), onboard_controller.residual_predictor.init(team)

    def loop(y: jax.Array) -> jax.Array:
        shift, a, f = jnp.split(y, [len(zero), len(zero) + 6])
        moved = unravel(shift)
        at = contact_dynamics.retract(state, moved)
        context = controller.context_at(onboard_controller, at, a, t)
        inputs, _, decided = onboard_controller.control_law(*memories, context)
        acceleration, lam = contact_dynamics.forward_dynamics(team, at, inputs, unflatten(team, f))
        q, a_L = at.payload, acceleration.payload
        to, _ = onboard_controller.payload_controller.compute(memories[0], context)
        W = grasp.payload_wrench(grasp.contact_points(team), q.R, grasp.stack_contacts(lam))
        errors = [q.p - d.p, q.v - d.v, so3.e_R(q.R, d.R), so3.e_omega(q.R, q.omega, d.R, d.omega)]
        missed = [a_L[:3] - to.a, a_L[3:] - to.alpha, W.F - decided.W_d.F, W.tau - decided.W_d.tau]
        return jnp.concatenate(
            [ravel_pytree(contact_dynamics.tangent_rate(at, moved, acceleration))[0], a_L, *errors, *missed]
        )

    def constraint(d: jax.Array) -> jax.Array:
        at = contact_dynamics.retract(state, unravel(d))
        return jnp.concatenate(
            [grasp.constraint_residual(team, at).reshape(-1), grasp.constraint_rate(team, at).reshape(-1)]
        )

    y = jnp.concatenate([zero, none, f])
    J = jax.lax.map(lambda e: jax.jvp(loop, (y,), (e,))[1], jnp.eye(len(y)))
    C = jax.lax.map(lambda e: jax.jvp(constraint, (zero,), (e,))[1], jnp.eye(len(zero)))
    return J.T, C.T
