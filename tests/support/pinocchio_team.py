"""The whole team as one Pinocchio model with dense linear algebra, as a reference for the plant.

It shares no code with `colift`: kinematics, mass matrix and bias are Pinocchio's, the contacts are solved as one
KKT system. Coordinates are Pinocchio's (base origin, velocities in the body frame); conversions use its center of mass.
"""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from colift.models.parameters import KinematicTree, Team
from colift.models.state import AgentInput, ResidualForces, State


def take(group: object, j: int) -> SimpleNamespace:
    """Return the fields of agent j of a group as NumPy arrays."""
    given = {field.name: getattr(group, field.name) for field in dataclasses.fields(group)}
    fields = {name: x for name, x in given.items() if x is not None}
    return SimpleNamespace(**{k: x if isinstance(x, KinematicTree) else np.asarray(x)[j] for k, x in fields.items()})


def add_agent(model: pin.Model, agent: SimpleNamespace, name: str) -> list[int]:
    """Append an agent depth-first, as Pinocchio requires, and return the frames of its tips."""
    tree = agent.tree
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
    model.appendBodyToJoint(base, _inertia(agent, 0), pin.SE3.Identity())
    body = {0: base}

    def grow(parent: int) -> None:
        for k in (k for k, p in enumerate(tree.parents) if p == parent):
            kind = pin.JointModelPrismaticUnaligned if tree.prismatic[k] else pin.JointModelRevoluteUnaligned
            placement = pin.SE3(np.array(agent.joint_rotation[k]), np.array(agent.joint_position[k]))
            body[k + 1] = model.addJoint(body[parent], kind(np.array(agent.joint_axis[k])), placement, f"{name} {k}")
            model.appendBodyToJoint(body[k + 1], _inertia(agent, k + 1), pin.SE3.Identity())
            grow(k + 1)

    grow(0)
    return [
        model.addFrame(
            pin.Frame(
                f"{name} tip {b}",
                body[i],
                0,
                pin.SE3(np.eye(3), np.array(agent.tip_position[b])),
                pin.FrameType.OP_FRAME,
            )
        )
        for b, i in enumerate(tree.tip_bodies)
    ]


def _inertia(agent: SimpleNamespace, i: int) -> pin.Inertia:
    return pin.Inertia(float(agent.mass[i]), np.array(agent.com[i]), np.array(agent.inertia[i]))


class FreeAgent:
    """One agent in Pinocchio, with the map between its coordinates and those of colift."""

    def __init__(self, agent: SimpleNamespace) -> None:
        self.model = pin.Model()
        self.tips = add_agent(self.model, agent, "agent")
        self.data = self.model.createData()
        joints = range(agent.tree.joints)
        self.index = np.array([self.model.joints[self.model.getJointId(f"agent {k}")].idx_v - 6 for k in joints], int)

    def coordinates(self, state: SimpleNamespace) -> tuple[np.ndarray, np.ndarray]:
        """Return Pinocchio's `(q, v)` at a state of colift."""
        R, r, r_dot = np.array(state.R), np.zeros(len(self.index)), np.zeros(len(self.index))
        r[self.index], r_dot[self.index] = state.r, state.r_dot
        quaternion = Rotation.from_matrix(R).as_quat()
        q = np.concatenate([np.zeros(3), quaternion, r])
        v = np.concatenate([np.zeros(3), state.omega, r_dot])
        x = pin.centerOfMass(self.model, self.data, q, v)
        q[:3] = np.array(state.x) - x
        v[:3] = R.T @ (np.array(state.v) - self.data.vcom[0])
        return q, v

    def to_colift(self, v: np.ndarray) -> np.ndarray:
        """Convert Pinocchio's velocity coordinates, or their rate, to `(omega, r_dot)` in the order of colift."""
        return np.concatenate([v[3:6], v[6:][self.index]])

    def from_colift(self, xi: np.ndarray) -> np.ndarray:
        """Convert a force on `(mu, nu)`, or `(omega, r_dot)` at a fixed base origin, to Pinocchio's coordinates."""
        r = np.zeros(len(self.index))
        r[self.index] = xi[3:]
        return np.concatenate([np.zeros(3), xi[:3], r])


@dataclasses.dataclass
class Solution:
    """Accelerations and contact forces in the coordinates of colift."""

    v_dot: list[np.ndarray]  # one an agent
    xi_dot: list[np.ndarray]
    payload: np.ndarray  # (v_dot world, omega_dot body)
    lam: np.ndarray  # (contacts, 3)
    moments: np.ndarray  # (directions,), moments at the contacts, in the order of `PinocchioTeam.axes`
    singular: np.ndarray  # of A M^-1 A^T, descending, 1/kg

    @property
    def condition(self) -> float:
        """Condition number of A M^-1 A^T."""
        return float(self.singular[0] / self.singular[-1])


class PinocchioTeam:
    """A team as one model: bases and payload with free-flyer joints, contacts by a dense KKT system."""

    def __init__(self, team: Team) -> None:
        self.team = team
        self.agents = [
            take(group, j) for group, size in zip(team.agent_groups, team.sizes, strict=True) for j in range(size)
        ]
        self.free = [FreeAgent(agent) for agent in self.agents]
        self.model = pin.Model()
        self.tips = [f for j, agent in enumerate(self.agents) for f in add_agent(self.model, agent, f"agent {j}")]
        load = self.model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "payload")
        J = pin.Inertia(float(team.payload.mass), np.zeros(3), np.array(team.payload.inertia))
        self.model.appendBodyToJoint(load, J, pin.SE3.Identity())
        self.model.gravity.linear = np.array(team.gravity)
        self.contacts = [
            self.model.addFrame(
                pin.Frame(f"contact {i}", load, 0, pin.SE3(np.eye(3), np.array(c)), pin.FrameType.OP_FRAME)
            )
            for i, c in enumerate(np.concatenate([np.array(agent.contact_position) for agent in self.agents]))
        ]
        self.axes: list[tuple[int, int, np.ndarray]] = []  # tip frame, contact frame, axis in the payload frame
        tip = 0
        for agent in self.agents:
            for b, axis in zip(agent.tree.moment_arms, getattr(agent, "moment_axis", ()), strict=True):
                self.axes.append((self.tips[tip + b], self.contacts[tip + b], np.array(axis)))
            tip += agent.tree.arms
        self.data = self.model.createData()
        ends = np.cumsum([free.model.nv for free in self.free])
        self.parts = [slice(end - free.model.nv, end) for end, free in zip(ends, self.free, strict=True)]

    def states(self, z: State) -> list[SimpleNamespace]:
        """Return the states of the agents as a list."""
        return [take(a, j) for a, size in zip(z.agents, self.team.sizes, strict=True) for j in range(size)]

    def coordinates(self, z: State) -> tuple[np.ndarray, np.ndarray]:
        """Return `(q, v)` of the whole model."""
        q, v = zip(*(f.coordinates(a) for f, a in zip(self.free, self.states(z), strict=True)), strict=True)
        load, R = z.payload, np.array(z.payload.R)
        q_L = np.concatenate([load.p, Rotation.from_matrix(R).as_quat()])
        return np.concatenate([*q, q_L]), np.concatenate([*v, R.T @ np.array(load.v), load.omega])

    def state(self, z: State, v: np.ndarray) -> State:
        """Return the state z with its velocities replaced by those of Pinocchio's coordinates."""
        q, _ = self.coordinates(z)
        groups, j, at = [], 0, 0
        for a, size in zip(z.agents, self.team.sizes, strict=True):
            xi, v_com = [], []
            for free in self.free[j : j + size]:
                part = v[self.parts[j]]
                pin.centerOfMass(free.model, free.data, q[at : at + free.model.nq], part)
                xi.append(free.to_colift(part))
                v_com.append(free.data.vcom[0].copy())
                j, at = j + 1, at + free.model.nq
            xi = np.array(xi)
            groups.append(
                dataclasses.replace(
                    a, omega=jnp.array(xi[:, :3]), r_dot=jnp.array(xi[:, 3:]), v=jnp.array(np.array(v_com))
                )
            )
        load = dataclasses.replace(z.payload, v=jnp.array(np.array(z.payload.R) @ v[-6:-3]), omega=jnp.array(v[-3:]))
        return State(agents=tuple(groups), payload=load)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return `A`: velocities of the tips relative to the payload's contacts, in the world frame.

        Rows of moments follow: relative angular velocities along their axes.
        """
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        J = lambda f: pin.getFrameJacobian(self.model, self.data, f, pin.LOCAL_WORLD_ALIGNED)  # noqa: E731
        forces = [J(a)[:3] - J(b)[:3] for a, b in zip(self.tips, self.contacts, strict=True)]
        moments = [self._axis(b, axis)[None] @ (J(a)[3:] - J(b)[3:]) for a, b, axis in self.axes]
        return np.concatenate([*forces, *moments])

    def _axis(self, contact: int, axis: np.ndarray) -> np.ndarray:
        """Return an axis of the payload in the world frame."""
        return self.data.oMf[contact].rotation @ axis

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the dense mass matrix."""
        M = pin.crba(self.model, self.data, q)
        return np.triu(M) + np.triu(M, 1).T

    def constraint_residual(self, z: State) -> np.ndarray:
        """Return `Phi`, one row per contact."""
        pin.framesForwardKinematics(self.model, self.data, self.coordinates(z)[0])
        at = lambda f: self.data.oMf[f].translation  # noqa: E731
        return np.array([at(a) - at(b) for a, b in zip(self.tips, self.contacts, strict=True)])

    def on_grasp(self, z: State) -> tuple[Team, State]:
        """Return the team with contacts at the tips of z, and z with the nearest admissible velocities."""
        pin.framesForwardKinematics(self.model, self.data, self.coordinates(z)[0])
        points = np.array([self.data.oMf[f].translation for f in self.tips])
        c = (points - np.array(z.payload.p)) @ np.array(z.payload.R)
        counts = [g.contact_position.shape[0] * g.contact_position.shape[1] for g in self.team.agent_groups]
        cuts = np.split(c, np.cumsum(counts)[:-1])
        R = np.array([np.array(z.payload.R).T @ self.data.oMf[f].rotation for f in self.tips])
        grips = np.split(R, np.cumsum([g.contact_position.shape[0] * g.tree.arms for g in self.team.agent_groups])[:-1])
        groups = tuple(
            dataclasses.replace(
                g,
                contact_position=jnp.array(part.reshape(g.contact_position.shape)),
                grip_rotation=jnp.array(grip.reshape(-1, g.tree.arms, 3, 3))
                if "rigid" in g.tree.contact_types
                else None,
            )
            for g, part, grip in zip(self.team.agent_groups, cuts, grips, strict=True)
        )
        team = dataclasses.replace(self.team, agent_groups=groups)
        other = PinocchioTeam(team)
        q, v = other.coordinates(z)
        A = other.jacobian(q)
        return team, other.state(z, v - np.linalg.pinv(A) @ (A @ v))

    def solve_kkt(self, z: State, inputs: tuple[AgentInput, ...], f: ResidualForces) -> Solution:
        """Return accelerations and contact forces: `[M A^T; A 0] [a; lam] = [tau - nle; -A_dot v]`."""
        q, v = self.coordinates(z)
        A = self.jacobian(q)
        M = self.mass_matrix(q)
        nle = pin.nonLinearEffects(self.model, self.data, q, v).copy()
        pin.forwardKinematics(self.model, self.data, q, v, np.zeros(self.model.nv))

        def acc(frame: int) -> pin.Motion:
            return pin.getFrameClassicalAcceleration(self.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED)

        def omega(frame: int) -> np.ndarray:
            return pin.getFrameVelocity(self.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED).angular

        drift = [acc(a).linear - acc(b).linear for a, b in zip(self.tips, self.contacts, strict=True)]
        for a, b, axis in self.axes:
            n = self._axis(b, axis)
            n_dot = np.cross(omega(b), n)
            drift.append([n @ (acc(a).angular - acc(b).angular) + n_dot @ (omega(a) - omega(b))])
        drift = np.concatenate(drift)
        tau = self.force(q, z, inputs, f)
        K = np.block([[M, A.T], [A, np.zeros((len(A), len(A)))]])
        b = np.concatenate([tau - nle, -drift])
        solution = np.linalg.solve(K, b)
        solution += np.linalg.solve(K, (b - np.longdouble(K) @ np.longdouble(solution)).astype(float))
        a, lam = np.split(solution, [self.model.nv])
        v_dot, xi_dot, at = [], [], 0
        for free, part in zip(self.free, self.parts, strict=True):
            pin.centerOfMass(free.model, free.data, q[at : at + free.model.nq], v[part], a[part])
            at += free.model.nq
            v_dot.append(free.data.acom[0].copy())
            xi_dot.append(free.to_colift(a[part]))
        classical = a[-6:-3] + np.cross(v[-3:], v[-6:-3])
        return Solution(
            v_dot=v_dot,
            xi_dot=xi_dot,
            payload=np.concatenate([np.array(z.payload.R) @ classical, a[-3:]]),
            lam=lam[: 3 * len(self.tips)].reshape(-1, 3),
            moments=lam[3 * len(self.tips) :],
            singular=np.linalg.svd(A @ np.linalg.solve(M, A.T), compute_uv=False),
        )

    def force(self, q: np.ndarray, z: State, inputs: tuple[AgentInput, ...], f: ResidualForces) -> np.ndarray:
        """Return generalized forces in Pinocchio's coordinates, by virtual power."""
        tau, at, j = [], 0, 0
        for u, f_g, size in zip(inputs, f.agents, self.team.sizes, strict=True):
            for i in range(size):
                free, u_i, f_i = self.free[j], take(u, i), take(f_g, i)
                part = q[at : at + free.model.nq]
                at, j = at + free.model.nq, j + 1
                J_com = pin.jacobianCenterOfMass(free.model, free.data, part)
                own = free.from_colift(np.concatenate([u_i.tau + f_i.f_w, u_i.tau_r + f_i.f_r]))
                own[2] += u_i.u
                tau.append(own + J_com.T @ f_i.f_x)
        R = np.array(z.payload.R)
        return np.concatenate([*tau, R.T @ np.array(f.payload.F), np.array(f.payload.tau)])

    def energy(self, z: State) -> tuple[float, float]:
        """Return kinetic and potential energy [J]."""
        q, v = self.coordinates(z)
        kinetic = pin.computeKineticEnergy(self.model, self.data, q, v)
        return float(kinetic), float(pin.computePotentialEnergy(self.model, self.data, q))

    def momentum(self, z: State) -> np.ndarray:
        """Return linear momentum and angular momentum about the world origin."""
        h = pin.computeCentroidalMomentum(self.model, self.data, *self.coordinates(z))
        return np.concatenate([h.linear, h.angular + np.cross(self.data.com[0], h.linear)])
