"""Linearization of the continuous closed loop at rest, from unmodelled forces to the payload errors.

The nominal parameters equal the true ones, the sensors are ideal and the reference is constant. The state is restricted
to the constraint manifold, so it has two coordinates for each free velocity of the team.

See Also:
    colift.analysis.stability: eigenvalues of the sampled loop with filters and delays.
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
"""Outputs of `LinearizedLoop.C` and their sizes.

`e_*` are tracking errors, `a` and `alpha` are payload accelerations minus the commanded ones [m/s^2, rad/s^2], and
`delta_W` is the wrench mismatch [N, N m].
"""


@dataclasses.dataclass(frozen=True)
class LinearizedLoop:
    """Linear closed loop `x_dot = A x + B f~`, `y = C x + D f~` with residual errors f~ and outputs y as in `OUTPUTS`.

    The input f~ contains the unmodelled forces that the controller does not compensate.
    """

    A: np.ndarray  # (states, states) 1/s
    B: np.ndarray  # (states, inputs)
    C: np.ndarray  # (outputs, states)
    D: np.ndarray  # (outputs, inputs)
    basis: np.ndarray  # (coordinates, states), orthonormal; maps x to a flat `contact_dynamics.StateTangent`
    bodies: tuple[slice, ...]  # input columns of the payload, then of each agent in team order

    def output_rows(self, output: str) -> slice:
        """Return the rows of an output of `OUTPUTS` in C and D."""
        names = list(OUTPUTS)
        first = sum(OUTPUTS[name] for name in names[: names.index(output)])
        return slice(first, first + OUTPUTS[output])


def flatten(f: ResidualForces) -> Float[Array, " inputs"]:
    """Flatten a residual: payload wrench, then `(f_x, f_w, f_r)` of each agent in team order."""
    agents = [jnp.concatenate([group.f_x, group.f_w, group.f_r], axis=1).reshape(-1) for group in f.agents]
    return jnp.concatenate([f.payload.F, f.payload.tau, *agents])


def unflatten(team: Team, f: Float[Array, " inputs"]) -> ResidualForces:
    """Restore a residual from a flat row; inverse of `flatten`.

    Args:
        team: Team that determines the layout.
        f: Flat residual.

    Returns:
        The residual of agents and payload.
    """
    agents, first = [], 6
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        n = 6 + group.tree.joints
        rows = f[first : first + size * n].reshape(size, n)
        agents.append(split_agent_force(rows))
        first += size * n
    return ResidualForces(agents=tuple(agents), payload=Wrench(F=f[:3], tau=f[3:6]))


def body_columns(team: Team) -> tuple[slice, ...]:
    """Return the columns of a flat residual that belong to the payload, then to each agent.

    Args:
        team: Team that determines the layout.

    Returns:
        One slice per body.
    """
    ends = [0, 6]
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        ends += [ends[-1] + (6 + group.tree.joints) * (k + 1) for k in range(size)]
    return tuple(slice(a, b) for a, b in itertools.pairwise(ends))


RESIDUAL_SIGNALS = ("f_L", "f_x", "f_w", "f_r")
"""Logged signals of a residual: payload wrench, then forces, moments and joint torques of all agents."""


def group_by_body(
    joints: Sequence[int], f_L: np.ndarray, f_x: np.ndarray, f_w: np.ndarray, f_r: np.ndarray
) -> list[np.ndarray]:
    """Group logged residuals by body.

    Args:
        joints: Number of joints of each agent.
        f_L: Payload residual, time first [N, N m].
        f_x: Forces on the agents, time first [N].
        f_w: Moments on the agents, time first [N m].
        f_r: Joint torques of all agents in team order, time first [N m or N].

    Returns:
        Arrays `(times, 6)` of the payload and `(times, 6 + n)` of each agent with n joints.
    """
    ends = itertools.pairwise(np.cumsum([0, *joints]).tolist())
    agents = (np.concatenate([f_x[:, j], f_w[:, j], f_r[:, a:b]], axis=1) for j, (a, b) in enumerate(ends))
    return [f_L, *agents]


def linearize(onboard_controller: controller.LeaderFollowerController, state: State) -> LinearizedLoop:
    """Linearize the closed loop at an equilibrium on the constraint manifold, on the host.

    The result is `A = T^T J T`, where T is a basis of the directions that keep Phi and Phi_dot at zero. The control law
    uses the measured acceleration, which depends on the command: `a = a(z, a, f~)` is solved to first order. The input
    f~ is the residual minus its prediction if the residual predictor of the controller returns zero.

    Args:
        onboard_controller: Controller whose parameters are taken as true.
        state: State at rest on the constraint manifold.

    Returns:
        The linear closed loop.
    """
    J, C = (np.asarray(x) for x in _jacobians(onboard_controller, state))
    n = C.shape[1]
    rates, a, y = J[:n], J[n : n + 6], J[n + 6 :]
    free = np.r_[0:n, n + 6 : J.shape[1]]  # every column except those of the measured acceleration
    response = np.linalg.solve(np.eye(6) - a[:, n : n + 6], a[:, free])
    rates, y = (part[:, free] + part[:, n : n + 6] @ response for part in (rates, y))
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
    """Compute the Jacobians of the loop and of the constraints in local coordinates.

    The first is that of (rate, payload acceleration, outputs) with respect to (state, measured acceleration, f~), the
    second that of (Phi, Phi_dot) with respect to the state. Columns are computed one at a time, because a batch of
    directions takes about three times as long to compile.

    Args:
        onboard_controller: Controller whose parameters are taken as true.
        state: Base point.

    Returns:
        Both Jacobians.
    """
    team = onboard_controller.team
    zero, unravel = ravel_pytree(contact_dynamics.zero_tangent(state))
    f, zero_acceleration, t = flatten(zero_residual(team)), jnp.zeros(6), jnp.zeros(())
    d = onboard_controller.reference.evaluate(t)
    part_states = onboard_controller.init_control_law()

    def loop(y: jax.Array) -> jax.Array:
        shift, a, f = jnp.split(y, [len(zero), len(zero) + 6])
        tangent = unravel(shift)
        displaced = contact_dynamics.retract(state, tangent)
        context = controller.context_at(onboard_controller, displaced, a, t)
        inputs, _, telemetry = onboard_controller.control_law(part_states, context)
        acceleration, lam = contact_dynamics.forward_dynamics(team, displaced, inputs, unflatten(team, f))
        q, a_L = displaced.payload, acceleration.payload
        acceleration_cmd, _ = onboard_controller.payload_controller.compute(part_states.payload_controller, context)
        W = grasp.payload_wrench(grasp.contact_points(team), q.R, grasp.stack_contacts(lam))
        errors = [q.p - d.p, q.v - d.v, so3.e_R(q.R, d.R), so3.e_omega(q.R, q.omega, d.R, d.omega)]
        deviations = [
            a_L[:3] - acceleration_cmd.a,
            a_L[3:] - acceleration_cmd.alpha,
            W.F - telemetry.W_d.F,
            W.tau - telemetry.W_d.tau,
        ]
        return jnp.concatenate(
            [
                ravel_pytree(contact_dynamics.tangent_rate(displaced, tangent, acceleration))[0],
                a_L,
                *errors,
                *deviations,
            ]
        )

    def constraint(d: jax.Array) -> jax.Array:
        displaced = contact_dynamics.retract(state, unravel(d))
        return jnp.concatenate(
            [grasp.constraint_residual(team, displaced).reshape(-1), grasp.constraint_rate(team, displaced).reshape(-1)]
        )

    y = jnp.concatenate([zero, zero_acceleration, f])
    J = jax.lax.map(lambda e: jax.jvp(loop, (y,), (e,))[1], jnp.eye(len(y)))
    C = jax.lax.map(lambda e: jax.jvp(constraint, (zero,), (e,))[1], jnp.eye(len(zero)))
    return J.T, C.T
