"""MuJoCo as the plant of a simulated world (extra `mujoco`).

The model is the one that `colift.models.mjcf` exports, so the exported file reproduces this plant. MuJoCo locates a
base by its origin, colift an agent by its center of mass; MuJoCo's kinematics convert between both. Thrust and torques
are actuators of the model. A residual force `f_x` is distributed over the bodies of an agent in proportion to their
mass, which equals a force at the center of mass. `(f_w, f_r)` act on the base rotation and on the joints.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from colift.math.pytree import pytree, static
from colift.models import mjcf
from colift.models.parameters import Team, agent_names
from colift.models.state import ResidualForces, ResidualFunctionType, State, TeamInputs
from colift.runtime import extras
from colift.simulation.contact_dynamics import Acceleration, AgentAcceleration

try:
    import mujoco
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(f"MuJoCo is not installed: {extras.install_command('mujoco')}", name="mujoco") from error

SUBSTEPS = 4  # MuJoCo steps in a control period of 2 ms (docs/decisions/0025)
DISABLED_FLAGS = (  # no clipping of inputs, no dependence on previous calls, no replacement of non-finite values
    mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL,
    mujoco.mjtDisableBit.mjDSBL_WARMSTART,
    mujoco.mjtDisableBit.mjDSBL_AUTORESET,
)


@pytree
class MujocoPlant:
    """Plant that delegates the dynamics to MuJoCo; created by `mujoco_plant`.

    Implements `colift.simulation.world.Plant`, like `colift.simulation.contact_dynamics.RigidContactPlant`. The methods
    are pure and can be traced; MuJoCo runs on the host, one call at a time. The `team` argument of the methods
    determines the array layout alone: MuJoCo uses the parameters from the creation of the plant.

    Attributes:
        substeps: Number of MuJoCo steps in one step of the plant.
        session: MuJoCo model and data on the host.
    """

    substeps: int = static()
    session: MujocoSession = static()

    def forward_dynamics(
        self, team: Team, state: State, inputs: TeamInputs, f: ResidualForces
    ) -> tuple[Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """Compute accelerations and contact forces with the compliant contacts of MuJoCo.

        Args:
            team: Team that determines the array layout.
            state: State of the team.
            inputs: Thrusts, body torques and joint torques, by group.
            f: Unmodelled forces on agents and payload.

        Returns:
            Accelerations, and contact forces on the payload [N, world] by group.
        """
        templates = tuple(
            AgentAcceleration(v_dot=q.v, xi_dot=jnp.concatenate([q.omega, q.r_dot], axis=1)) for q in state.agents
        )
        contacts = tuple(group.contact_position for group in team.agent_groups)
        results = [jnp.zeros(6), *_join_groups(templates), *_join_groups(contacts)]
        a_L, v_dot, xi_dot, lam = _call_host(self.session.forward_dynamics, results, state, inputs, f)
        return Acceleration(agents=_split_groups(templates, [v_dot, xi_dot]), payload=a_L), _split_groups(
            contacts, [lam]
        )

    def step(
        self, team: Team, state: State, inputs: TeamInputs, residual: ResidualFunctionType, dt: Float[Array, ""]
    ) -> State:
        """Integrate over one step; inputs are constant over the step, the residual over each substep.

        Args:
            team: Team that determines the array layout.
            state: State at the start of the step.
            inputs: Inputs, constant over the step.
            residual: Unmodelled forces as a function of the state and of the time since the step began [s].
            dt: Step length [s].

        Returns:
            The state at the end of the step.
        """
        h = dt / self.substeps

        def substep(k: Int[Array, ""], state: State) -> State:
            payload_leaves, payload_structure = jax.tree.flatten(state.payload)
            rows = _call_host(
                self.session.step, _state_rows(state), state, inputs, residual(state, k.astype(h.dtype) * h), h
            )
            return State(
                agents=_split_groups(state.agents, rows[: -len(payload_leaves)]),
                payload=payload_structure.unflatten(rows[-len(payload_leaves) :]),
            )

        return jax.lax.fori_loop(0, self.substeps, substep, state)


def mujoco_plant(
    team: Team, state: State, dt: float = 2e-3, substeps: int = SUBSTEPS, softness: mjcf.ContactSoftness | None = None
) -> MujocoPlant:
    """Create a MuJoCo plant for a team.

    Args:
        team: True parameters.
        state: Any state of the team; it determines the layout of the model.
        dt: Step length [s].
        substeps: Number of MuJoCo steps per step, at least 1.
        softness: Contact compliance; default: the stiffest contacts that the substep allows.

    Returns:
        The plant.

    Raises:
        ValueError: If `substeps` is below 1, or if MuJoCo rejects the model.
    """
    if substeps < 1:
        raise ValueError(f"substeps = {substeps}: must be at least 1")
    h = dt / substeps
    text = mjcf.to_mjcf(team, state, timestep=h, softness=softness or mjcf.stiffest_contact(h))
    return MujocoPlant(substeps=substeps, session=MujocoSession(team, text))


# Conversion between PyTrees and flat rows ----------------------------------------------------------------------------


def _call_host(
    function: Callable[..., Sequence[np.ndarray]],
    results: Sequence[Array],
    state: State,
    inputs: TeamInputs,
    f: ResidualForces,
    *extra: Array,
) -> list[Array]:
    """Call a host function from traced code and return arrays shaped like `results`.

    All arguments are passed in one row, because the cost of a callback grows with the number of arrays.

    Args:
        function: Host function of rows that returns rows.
        results: Arrays with the shapes of the results.
        state: State of the team.
        inputs: Inputs, by group.
        f: Unmodelled forces.
        *extra: Further arguments.

    Returns:
        The results.
    """
    arguments = [*_rows(state, inputs, f), *extra]
    ends, size = np.cumsum([x.size for x in arguments])[:-1], sum(x.size for x in results)

    def flat(row: Array | np.ndarray) -> np.ndarray:
        if not np.isfinite(row).all():  # MuJoCo writes a log file for such inputs
            return np.full(size, np.nan)
        return np.concatenate([x.ravel() for x in function(*np.split(np.asarray(row), ends))])

    shape = jax.ShapeDtypeStruct((size,), float)
    row = jnp.concatenate([x.reshape(-1) for x in arguments])
    return _split_row(jax.pure_callback(flat, shape, row, vmap_method="sequential"), results)


def _rows(state: State, inputs: TeamInputs, f: ResidualForces) -> list[Array]:
    """Return the arguments of `MujocoSession._set` as rows."""
    return [*_state_rows(state), *_join_groups(inputs), *_join_groups(f.agents), *jax.tree.leaves(f.payload)]


def _state_rows(state: State) -> list[Array]:
    """Return the state as rows."""
    return [*_join_groups(state.agents), *jax.tree.leaves(state.payload)]


def _join_groups(groups: Sequence[Any]) -> list[Array]:
    """Concatenate every field over all groups into one row."""
    fields = zip(*map(jax.tree.leaves, groups), strict=True)
    return [jnp.concatenate([x.reshape(-1) for x in field]) for field in fields]


def _split_groups(templates: Sequence[Any], rows: Sequence[Array]) -> tuple[Any, ...]:
    """Split rows into groups shaped like the given ones; inverse of `_join_groups`."""
    fields = zip(*map(jax.tree.leaves, templates), strict=True)
    leaves = zip(*(_split_row(row, field) for row, field in zip(rows, fields, strict=True)), strict=True)
    return tuple(
        jax.tree.structure(template).unflatten(group_leaves)
        for template, group_leaves in zip(templates, leaves, strict=True)
    )


def _split_row(row: Array, templates: Sequence[Array]) -> list[Array]:
    """Split one row into arrays shaped like the given ones."""
    parts = jnp.split(row, np.cumsum([x.size for x in templates])[:-1])
    return [part.reshape(x.shape) for part, x in zip(parts, templates, strict=True)]


# MuJoCo on the host ---------------------------------------------------------------------------------------------------


class MujocoSession:
    """MuJoCo model and data with index tables; agents, joints and contacts are in team order."""

    def __init__(self, team: Team, text: str) -> None:
        """Compile a model and build the index tables.

        Args:
            team: Team that the model describes.
            text: Model in MJCF.
        """
        self.model = m = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(m)
        self.lock = threading.Lock()  # concurrent callbacks of one program share the data
        for flag in DISABLED_FLAGS:
            m.opt.disableflags |= flag
        names, joints = agent_names(team), mjcf.joint_names(team)
        addresses = {m.joint(j).name: (m.jnt_qposadr[j], m.jnt_dofadr[j]) for j in range(m.njnt)}
        self.payload_q, self.payload_v = addresses["payload"]
        self.base = np.array([m.body(name).id for name in names])
        self.base_q, self.base_v = np.array([addresses[name] for name in names]).T
        self.joint_q, self.joint_v = np.array([addresses[name] for name in joints], int).reshape(-1, 2).T
        self.thrust = np.array([m.actuator(f"{name} thrust").id for name in names])
        self.torque = np.array([m.actuator(f"{name} torque {axis}").id for name in names for axis in "xyz"])
        self.joint_motor = np.array([m.actuator(name).id for name in joints], int)
        rotation_v = self.base_v[:, None] + [3, 4, 5]
        joint_counts = [
            group.tree.joints for size, group in zip(team.sizes, team.agent_groups, strict=True) for _ in range(size)
        ]
        joint_dofs = np.split(self.joint_v, np.cumsum(joint_counts)[:-1])
        self.xi_dofs = np.concatenate([x for part in zip(rotation_v, joint_dofs, strict=True) for x in part])
        self.rotation_v = rotation_v.ravel()
        is_own = m.body_rootid == self.base[:, None]
        self.mass = m.body_subtreemass[self.base]
        self.share = (is_own * m.body_mass / self.mass[:, None]).T
        self.grasp_map = is_own[:, m.site_bodyid[m.eq_obj2id]].astype(float)

    def forward_dynamics(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Compute `a_L, v_dot, xi_dot, lam`, each as a row.

        The acceleration of an agent's center of mass follows from Newton's law:
        `m v_dot = m a_g + R e3 u + f_x - sum lam`.

        Args:
            *rows: State, inputs and residual, as `_set` expects them.

        Returns:
            Payload acceleration, center of mass accelerations, `xi_dot` of all agents, and contact forces [N, world].
        """
        with self.lock:
            self._set(*rows)
            mujoco.mj_forward(self.model, self.data)
            qacc, lam = self.data.qacc, self.data.efc_force.reshape(-1, 3).copy()
            thrust = self.data.ctrl[self.thrust][:, None] * self.data.xmat[self.base].reshape(-1, 3, 3)[:, :, 2]
            force = thrust + rows[13].reshape(-1, 3) - self.grasp_map @ lam
            v_dot = self.model.opt.gravity + force / self.mass[:, None]
            return qacc[self.payload_v : self.payload_v + 6].copy(), v_dot.ravel(), qacc[self.xi_dofs], lam.ravel()

    def step(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Perform one MuJoCo step; the last row is the step length [s]. Return the state as rows."""
        with self.lock:
            self.model.opt.timestep = rows[-1].item()
            self._set(*rows[:-1])
            mujoco.mj_step(self.model, self.data)
            return self._state()

    def _set(self, *rows: np.ndarray) -> None:
        """Set state, inputs and residual.

        The rows are `R, x, r, omega, v, r_dot, R_L, p, omega_L, v_L`, then `u, tau, tau_r`, then
        `f_x, f_w, f_r, F, tau`.
        """
        d, (*state, u, tau, tau_r, f_x, f_w, f_r, F, torque) = self.data, rows
        self._place(*state)
        d.ctrl[self.thrust], d.ctrl[self.torque], d.ctrl[self.joint_motor] = u, tau, tau_r
        d.xfrc_applied[:, :3] = self.share @ f_x.reshape(-1, 3)
        d.qfrc_applied[self.rotation_v], d.qfrc_applied[self.joint_v] = f_w, f_r
        d.qfrc_applied[self.payload_v : self.payload_v + 6] = [*F, *torque]

    def _place(
        self,
        R: np.ndarray,
        x: np.ndarray,
        r: np.ndarray,
        omega: np.ndarray,
        v: np.ndarray,
        r_dot: np.ndarray,
        R_L: np.ndarray,
        p: np.ndarray,
        omega_L: np.ndarray,
        v_L: np.ndarray,
    ) -> None:
        """Set MuJoCo's coordinates: base origins at rest at zero, then shifted to the centers of mass."""
        d, q, w = self.data, self.payload_q, self.payload_v
        d.qpos[q : q + 7] = [*p, *_quaternion(R_L)]
        d.qvel[w : w + 6] = [*v_L, *omega_L]
        for address, attitude in zip(self.base_q, R.reshape(-1, 9), strict=True):
            d.qpos[address : address + 7] = [0, 0, 0, *_quaternion(attitude)]
        origin, speed = self.base_q[:, None] + [0, 1, 2], self.base_v[:, None] + [0, 1, 2]
        d.qvel[speed] = 0
        d.qpos[self.joint_q], d.qvel[self.joint_v], d.qvel[self.rotation_v] = r, r_dot, omega
        self._update_kinematics()
        d.qpos[origin] = x.reshape(-1, 3) - d.subtree_com[self.base]
        d.qvel[speed] = v.reshape(-1, 3) - d.subtree_linvel[self.base]

    def _update_kinematics(self) -> None:
        """Update MuJoCo's kinematics: attitudes, centers of mass and their velocities."""
        for update in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_subtreeVel):
            update(self.model, self.data)

    def _state(self) -> tuple[np.ndarray, ...]:
        """Return the state as rows; inverse of `_place`."""
        self._update_kinematics()
        d, q, w = self.data, self.payload_q, self.payload_v
        payload_attitude = d.xmat[self.model.body("payload").id].reshape(3, 3).copy()
        agents = (d.xmat[self.base], d.subtree_com[self.base], d.qpos[self.joint_q])
        rates = (d.qvel[self.rotation_v], d.subtree_linvel[self.base], d.qvel[self.joint_v])
        return (
            *map(np.ravel, agents + rates),
            payload_attitude,
            d.qpos[q : q + 3].copy(),
            d.qvel[w + 3 : w + 6].copy(),
            d.qvel[w : w + 3].copy(),
        )


def _quaternion(R: np.ndarray) -> np.ndarray:
    """Return the unit quaternion `(w, x, y, z)` of a rotation matrix."""
    q = np.empty(4)
    mujoco.mju_mat2Quat(q, np.ravel(R))
    return q
