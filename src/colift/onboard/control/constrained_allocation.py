"""Allocation of contact forces within limits of thrust, tilt and contacts.

Each control period solves one cone program in the contact forces `lam`, in the payload frame. The payload acceleration
`acc = M_L^-1 (G lam - h)` is eliminated, so all matrices depend on masses and contacts only. Blocks of the program:

- thrust of every agent, `t_j = m_j P_j acc + sum_b lam_jb - m_j g - f_hat_j`, in a cone about the vertical between a
  minimum and a maximum, with the acceleration `P_j acc` of its contacts' mean;
- contact force `lam_b` in a friction cone about its normal, between a minimum and a maximum;
- slack `S (acc - acc_cmd)` [N] with mass and inertia of the team, the moment divided by the contacts' lever about its
  axis, with penalties for roll and pitch, then yaw, then z, then x and y.

Deviations from the preferred distribution `lam_0` of a linear allocation cost little. The sum of an agent's contact
forces in the xy plane of the payload costs a hundred times more, because it tilts the agent of a level payload. For
agents with rotors, changes of their yaw torques have the costs of `allocation.rotor_allocation`.

See Also:
    colift.onboard.control.cone_program: the program and its solver.
    docs/decisions/0005-general-force-allocation: reasons for the order of the penalties.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matvec
from colift.math.pytree import constant, pytree
from colift.models import grasp
from colift.models.parameters import Team
from colift.onboard.control import cone_program
from colift.onboard.control.allocation import YawTorques
from colift.onboard.control.allocators import LinearAllocator
from colift.onboard.interfaces import (
    AllocationDemand,
    AllocationReport,
    ContactForceCommand,
    ControlContext,
    PartState,
)

Scalar = Float[Array, ""]

DEVIATION_WEIGHT = 0.1
"""Weight of squared deviations from the preferred contact forces [1/N]."""
LATERAL_WEIGHT = 100.0
"""Weight of an agent's squared sum of forces in the xy plane of the payload, relative to `DEVIATION_WEIGHT`."""
STEP_SIZES = {"thrust": 1.5, "free_contact": 0.2, "limited_contact": 2.0, "force": 0.2, "moment": 20.0}
"""Step sizes of the solver by block; the multipliers of moments and of limited contacts are the largest."""
MIN_LEVER_SHARE = 0.05
"""Least ratio of the levers about the two horizontal axes.

Vertical forces of contacts in one vertical plane have no moment about an axis in this plane, hence no lever.
"""
RATE_RANGE = 0.5
"""Slack, plus change of an agent's horizontal force, at which the rates of the command are no longer used [N].

The rates are those of the command without limits. They serve the direction of the thrust, so they remain nearly valid
where a limit changes only vertical or internal forces.
"""
ACTIVE_TOLERANCE = 1e-2
"""Distance from a limit at which it is reported as active [N]."""
CONVERGED_TOLERANCE, CONVERGED_ITERATIONS = 1e-12, 5000.0
"""Tolerance [N] and iterations of a solution to rounding accuracy."""


@dataclasses.dataclass(frozen=True)
class ContactLimits:
    """Limits of the contact forces on the payload; the payload frame applies.

    Attributes:
        normals: Direction of the pressing force of each contact, unit vectors; None without friction cones.
        friction: Friction coefficient; None for contacts that can pull and shear.
        min_force: Smallest normal force [N]; applies with normals only.
        max_force: Largest norm of a contact force [N]; None for no limit.
    """

    normals: np.ndarray | None = None
    friction: float | None = None
    min_force: float | None = None
    max_force: float | None = None


@pytree
class ConstrainedAllocator:
    """Allocation by a cone program around a linear allocation, whose forces are preferred.

    The maximum thrusts are those of the nominal team, so that a change of them needs no new matrices. In the preview
    the linear allocation is used.
    """

    base: LinearAllocator  # preferred contact forces
    program: cone_program.ConeProgram
    contacts: cone_program.ConeSets  # limits of the contact forces, payload frame
    contact_center: Float[Array, "agents 3"]  # m, mean contact of each agent, payload frame
    mass: Float[Array, " agents"]  # kg
    M_inverse: Float[Array, "6 6"]  # inverse of `M_L = diag(m_L I, J_L)`
    acceleration_map: Float[Array, "6 unknowns"]  # `M_L^-1 G`, payload frame
    slack_map: Float[Array, "6 6"]  # S, from acceleration errors to N
    tan_tilt: Scalar  # tangent of the largest angle between thrust and vertical
    min_thrust_share: Scalar = constant(0.1)  # smallest thrust relative to the largest

    def init(self) -> PartState:
        """Return a cold start."""
        zero = jnp.zeros(self.program.A.shape[0])
        return cone_program.WarmStart(projected=zero, multipliers=zero)

    def converged(self) -> ConstrainedAllocator:
        """Return this allocator with iterations to rounding accuracy, so that its result does not depend on its state.

        Finite differences of the control law require it: with few iterations the error of the solution exceeds them.
        """
        program = dataclasses.replace(
            self.program, tolerance=jnp.asarray(CONVERGED_TOLERANCE), max_iterations=jnp.asarray(CONVERGED_ITERATIONS)
        )
        return dataclasses.replace(self, program=program)

    def allocate(
        self, state: PartState, context: ControlContext, demand: AllocationDemand
    ) -> tuple[ContactForceCommand, PartState]:
        """Compute contact forces within the limits and the acceleration that they achieve; see `Allocator`."""
        preferred, _ = self.base.allocate((), context, demand)
        if context.is_preview:
            return preferred, state
        R = context.estimate.payload.R
        acc_0, b = self._offsets(context, demand)
        sets = self._sets(context)
        x_0 = (preferred.lam @ R).reshape(-1)
        solution = cone_program.solve(self.program, x_0, b, sets, R[2], state)
        lam = solution.x.reshape(-1, 3)
        acc = matvec(self.acceleration_map, solution.x) + acc_0
        change = grasp.split_contacts(context.team, lam @ R.T - preferred.lam)
        horizontal = jnp.concatenate([part.sum(1)[:, :2] for part in change])  # world frame
        moved = jnp.abs(horizontal).max() + jnp.abs(solution.v[-6:]).max()
        share = jnp.maximum(0.0, 1 - moved / RATE_RANGE)
        command = ContactForceCommand(
            lam=lam @ R.T,
            lam_dot=share * preferred.lam_dot,
            eta=self.base.allocation.nullspace.T @ (solution.x - self.base.allocation.offset),
            acceleration=dataclasses.replace(
                demand.acceleration_cmd, a=R @ acc[:3], alpha=acc[3:], jerk=share * demand.acceleration_cmd.jerk
            ),
            report=self._report(solution, sets, R[2]),
        )
        return command, solution.warm_start

    def _offsets(
        self, context: ControlContext, demand: AllocationDemand
    ) -> tuple[Float[Array, "6"], Float[Array, " rows"]]:
        """Return the payload acceleration without contact forces, and the offset of the rows, in the payload frame."""
        team, q, f_hat = context.team, context.estimate.payload, demand.f_hat
        R, w, c = q.R, q.omega, self.contact_center
        gravity = R.T @ team.gravity
        gyroscopic = so3.cross(w, team.payload.inertia @ w)
        free = jnp.concatenate([team.payload.mass * gravity + R.T @ f_hat.payload.F, f_hat.payload.tau - gyroscopic])
        acc_0 = matvec(self.M_inverse, free)
        centripetal = so3.cross(w[None], so3.cross(w[None], c))
        a = acc_0[None, :3] + so3.cross(acc_0[None, 3:], c) + centripetal - gravity[None]
        thrust = self.mass[:, None] * a - jnp.concatenate([f.f_x for f in f_hat.agents]) @ R
        command = jnp.concatenate([R.T @ demand.acceleration_cmd.a, demand.acceleration_cmd.alpha])
        slack = matvec(self.slack_map, acc_0 - command)
        return acc_0, jnp.concatenate([thrust.reshape(-1), jnp.zeros(self.contacts.axis.size), slack])

    def _sets(self, context: ControlContext) -> cone_program.ConeSets:
        """Return the sets of thrusts and contact forces; the vertical is that of the payload frame."""
        most = jnp.concatenate([group.thrust_max for group in context.team.agent_groups])
        maximum = self.contacts.maximum
        if (closed := context.team.closed_contacts) is not None:
            maximum = closed * maximum
        axis = jnp.broadcast_to(context.estimate.payload.R[2], (len(self.mass), 3))
        return cone_program.ConeSets(
            axis=jnp.concatenate([axis, self.contacts.axis]),
            tan=jnp.concatenate([jnp.broadcast_to(self.tan_tilt, most.shape), self.contacts.tan]),
            minimum=jnp.concatenate([self.min_thrust_share * most, self.contacts.minimum]),
            maximum=jnp.concatenate([most, maximum]),
        )

    def _report(
        self, solution: cone_program.Solution, sets: cone_program.ConeSets, up: Float[Array, "3"]
    ) -> AllocationReport:
        """Return slack, residuals and the limits that act."""
        v, slack = solution.v[:-6].reshape(-1, 3), solution.v[-6:].reshape(2, 3)
        along = (slack * up[None]).sum(-1)
        rest = slack - along[:, None] * up[None]
        across = jnp.sqrt((rest * rest).sum(-1))
        z = (v * sets.axis).sum(-1)
        side = v - z[:, None] * sets.axis
        r, norm = jnp.sqrt((side * side).sum(-1)), jnp.sqrt((v * v).sum(-1))
        at_cone = (sets.tan < cone_program.UNLIMITED) & (r > sets.tan * z - ACTIVE_TOLERANCE)
        at_size = (norm > sets.maximum - ACTIVE_TOLERANCE) | (z < sets.minimum + ACTIVE_TOLERANCE)
        agents = len(self.mass)
        return AllocationReport(
            slack=jnp.stack([across[1], jnp.abs(along[0]), across[0], jnp.abs(along[1])]),
            residuals=solution.residuals,
            tilt=at_cone[:agents],
            thrust=at_size[:agents],
            friction=at_cone[agents:],
            force=at_size[agents:] & (sets.maximum[agents:] > 0),  # an open contact is not at a limit
        )


def constrained_allocator(
    team: Team,
    base: LinearAllocator,
    tilt: float,
    limits: ContactLimits,
    max_iterations: int = 100,
    yaw: YawTorques | None = None,
) -> ConstrainedAllocator:
    """Build the allocation within limits; its matrices are computed on the host.

    Args:
        team: Nominal parameters.
        base: Linear allocation, whose forces are preferred.
        tilt: Largest angle between a commanded thrust and the vertical [rad].
        limits: Limits of the contact forces.
        max_iterations: Largest number of iterations in a control period.
        yaw: Yaw torques of the agents, whose changes cost as much as in `rotor_allocation`; None: they cost nothing.

    Returns:
        The allocator.

    Raises:
        ValueError: If the limits contain no normal for each contact where friction or a smallest force is given.
    """
    c, payload = np.asarray(grasp.contact_points(team)), team.payload
    owner = np.repeat(
        np.arange(sum(team.sizes)),
        [g.tree.arms for n, g in zip(team.sizes, team.agent_groups, strict=True) for _ in range(n)],
    )
    mass = np.concatenate([np.asarray(group.mass).sum(1) for group in team.agent_groups])
    center = np.stack([c[owner == j].mean(0) for j in range(len(mass))])
    M_inverse = np.zeros((6, 6))
    M_inverse[:3, :3], M_inverse[3:, 3:] = np.eye(3) / float(payload.mass), np.linalg.inv(np.asarray(payload.inertia))
    acceleration_map = M_inverse @ grasp.payload_frame_grasp_matrix(c)
    slack_map = np.zeros((6, 6))
    slack_map[:3, :3] = (float(payload.mass) + mass.sum()) * np.eye(3)
    inertia = np.asarray(payload.inertia)
    inertia = inertia + sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(mass, center, strict=True))
    slack_map[3:, 3:] = np.linalg.solve(_levers(c), inertia)
    P = np.eye(3 * len(c))
    rows = []
    for j in range(len(mass)):
        total = np.kron(owner == j, np.eye(3))
        P = P + LATERAL_WEIGHT * total[:2].T @ total[:2]
        rows.append(mass[j] * np.hstack([np.eye(3), np.cross(center[j], np.eye(3))]) @ acceleration_map + total)
    if yaw is not None:
        P = P + yaw.thrust_rows().T @ yaw.thrust_rows()
    A = np.vstack([*rows, np.eye(3 * len(c)), slack_map @ acceleration_map])
    is_limited = any(x is not None for x in (limits.friction, limits.min_force, limits.max_force))
    steps = step_sizes(len(mass), len(c), is_limited)
    return ConstrainedAllocator(
        base=base,
        program=cone_program.make_program(A, DEVIATION_WEIGHT * P, cone_program.Penalties(), steps, max_iterations),
        contacts=_contact_sets(len(c), limits),
        contact_center=jnp.asarray(center),
        mass=jnp.asarray(mass),
        M_inverse=jnp.asarray(M_inverse),
        acceleration_map=jnp.asarray(acceleration_map),
        slack_map=jnp.asarray(slack_map),
        tan_tilt=jnp.asarray(np.tan(tilt)),
    )


def step_sizes(agents: int, contacts: int, is_limited: bool) -> np.ndarray:
    """Return the step sizes of the blocks `(agents + contacts + 2,)`.

    Contact forces without limits have multipliers at open contacts only, so their step size is smaller.

    Args:
        agents: Number of agents.
        contacts: Number of contacts.
        is_limited: Whether contact forces have limits.
    """
    contact = STEP_SIZES["limited_contact" if is_limited else "free_contact"]
    sizes = [STEP_SIZES["thrust"], contact, STEP_SIZES["force"], STEP_SIZES["moment"]]
    return np.repeat(sizes, [agents, contacts, 1, 1])


def _levers(c: np.ndarray) -> np.ndarray:
    """Return the levers of vertical forces about the horizontal axes, and of horizontal forces about the vertical [m].

    `L^2 = 2 mean(a a^T)` with the moments `a = (y, -x)` of unit forces, and the root mean square radius for the
    vertical. Levers of contacts on a circle are its radius. A narrow team has a short lever about its long axis: a
    moment about this axis costs more thrust, so its slack must cost more.

    Args:
        c: Contact points [m, payload frame].
    """
    a = np.stack([c[:, 1], -c[:, 0]], axis=1)
    values, axes = np.linalg.eigh(2 * (a[:, :, None] * a[:, None]).mean(0))
    levers = np.sqrt(np.maximum(values, 0.0))
    L = np.zeros((3, 3))
    L[:2, :2] = axes @ np.diag(np.maximum(levers, MIN_LEVER_SHARE * levers.max())) @ axes.T
    L[2, 2] = np.sqrt(np.square(a).sum(1).mean())
    return L


def _contact_sets(contacts: int, limits: ContactLimits) -> cone_program.ConeSets:
    """Return the sets of the contact forces."""
    normals = limits.normals
    if normals is None:
        if limits.friction is not None or limits.min_force is not None:
            raise ValueError("a friction coefficient or a smallest force requires the normal of each contact")
        normals = np.tile([0.0, 0.0, 1.0], (contacts, 1))
    if normals.shape != (contacts, 3):
        raise ValueError(f"{len(normals)} normals for {contacts} contacts")
    minimum = limits.min_force if limits.friction is None else limits.min_force or 0.0
    fill = {
        name: jnp.full(contacts, default if value is None else float(value))
        for name, value, default in (
            ("tan", limits.friction, cone_program.UNLIMITED),
            ("minimum", minimum, -cone_program.UNLIMITED),
            ("maximum", limits.max_force, cone_program.UNLIMITED),
        )
    }
    return cone_program.ConeSets(axis=jnp.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True)), **fill)
