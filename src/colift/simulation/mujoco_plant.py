"""MuJoCo as the plant: what `dynamics` answers, by another engine (the extra `mujoco`).

The model is the one that `mjcf` writes, so whoever loads the exported file has this plant. MuJoCo places a base by its
origin, we place an agent by its centre of mass; MuJoCo's own kinematics convert. Thrust and torques are the model's
actuators. Of a residual, `f_x` pulls on every body with its share of the mass, which is a force on the centre of mass,
and `(f_w, f_r)` act on the base's turning and the joints.
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
from colift.simulation.contact_dynamics import Acceleration, AgentAcceleration

try:
    import mujoco
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("MuJoCo is not installed: pip install 'colift[mujoco]'", name="mujoco") from error

SUBSTEPS = 4  # of a control period of 2 ms (docs/decisions/0025)
DISABLED_FLAGS = (  # inputs are as given, a result depends on no call before, and what is not finite is not replaced
    mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL,
    mujoco.mjtDisableBit.mjDSBL_WARMSTART,
    mujoco.mjtDisableBit.mjDSBL_AUTORESET,
)


@pytree
class MujocoPlant:
    """A team in MuJoCo as the plant of a world, in the place of `dynamics.Rigid`; made by `plant`.

    Its methods are pure and may be traced; MuJoCo runs on the host, one call at a time. The team that they are given
    says how parts stand in a state; its numbers are those that MuJoCo was told when the plant was made.
    """

    substeps: int = static()
    host: MujocoSession = static()

    def forward_dynamics(
        self, team: Team, state: State, inputs: TeamInputs, f: ResidualForces
    ) -> tuple[Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """Accelerations and contact forces, as `dynamics.accelerate` but for the softness of the contacts."""
        like = tuple(
            AgentAcceleration(v_dot=q.v, xi_dot=jnp.concatenate([q.omega, q.r_dot], axis=1)) for q in state.agents
        )
        contacts = tuple(group.contact_position for group in team.agent_groups)
        results = [jnp.zeros(6), *_join(like), *_join(contacts)]
        a_L, v_dot, xi_dot, lam = _ask(self.host.forward_dynamics, results, state, inputs, f)
        return Acceleration(agents=_part(like, [v_dot, xi_dot]), payload=a_L), _part(contacts, [lam])

    def step(
        self, team: Team, state: State, inputs: TeamInputs, residual: ResidualFunctionType, dt: Float[Array, ""]
    ) -> State:
        """The state after dt, s; inputs are held over it, the residual over each of the substeps.

        residual: of a state and of the time since the step began, s.
        """
        h = dt / self.substeps

        def one(k: Int[Array, ""], state: State) -> State:
            load, kind = jax.tree.flatten(state.payload)
            after = _ask(self.host.step, _state_rows(state), state, inputs, residual(state, k.astype(h.dtype) * h), h)
            return State(agents=_part(state.agents, after[: -len(load)]), payload=kind.unflatten(after[-len(load) :]))

        return jax.lax.fori_loop(0, self.substeps, one, state)


def mujoco_plant(
    team: Team, state: State, dt: float = 2e-3, substeps: int = SUBSTEPS, softness: mjcf.ContactSoftness | None = None
) -> MujocoPlant:
    """A team in MuJoCo, to be stepped by dt, s; z is any of its states. By default as rigid as the substep allows.

    Raises ValueError for less than one substep, and as MuJoCo does for a team that it refuses.
    """
    if substeps < 1:
        raise ValueError(f"substeps = {substeps}: must be at least 1")
    h = dt / substeps
    text = mjcf.to_mjcf(team, state, timestep=h, softness=softness or mjcf.stiffest_contact(h))
    return MujocoPlant(substeps=substeps, host=MujocoSession(team, text))


# Between PyTrees and rows of numbers --------------------------------------------------------------------------------


def _ask(
    answer: Callable[..., Sequence[np.ndarray]],
    results: Sequence[Array],
    state: State,
    inputs: TeamInputs,
    f: ResidualForces,
    *more: Array,
) -> list[Array]:
    """What the host answers, `results` being arrays like its own; all in one row, as a call costs by the array."""
    requested = [*_rows(state, inputs, f), *more]
    ends, size = np.cumsum([x.size for x in requested])[:-1], sum(x.size for x in results)

    def flat(row: Array | np.ndarray) -> np.ndarray:
        if not np.isfinite(row).all():  # MuJoCo would write a log file
            return np.full(size, np.nan)
        return np.concatenate([x.ravel() for x in answer(*np.split(np.asarray(row), ends))])

    shape = jax.ShapeDtypeStruct((size,), float)
    row = jnp.concatenate([x.reshape(-1) for x in requested])
    return _cut(jax.pure_callback(flat, shape, row, vmap_method="sequential"), results)


def _rows(state: State, inputs: TeamInputs, f: ResidualForces) -> list[Array]:
    """What the host is told, as `Host._set` takes it."""
    return [*_state_rows(state), *_join(inputs), *_join(f.agents), *jax.tree.leaves(f.payload)]


def _state_rows(state: State) -> list[Array]:
    return [*_join(state.agents), *jax.tree.leaves(state.payload)]


def _join(groups: Sequence[Any]) -> list[Array]:
    """Every field of all groups in one row."""
    fields = zip(*map(jax.tree.leaves, groups), strict=True)
    return [jnp.concatenate([x.reshape(-1) for x in field]) for field in fields]


def _part(groups: Sequence[Any], rows: Sequence[Array]) -> tuple[Any, ...]:
    """The inverse of `_join`: rows cut into groups like these."""
    fields = zip(*map(jax.tree.leaves, groups), strict=True)
    leaves = zip(*(_cut(row, field) for row, field in zip(rows, fields, strict=True)), strict=True)
    return tuple(jax.tree.structure(group).unflatten(own) for group, own in zip(groups, leaves, strict=True))


def _cut(row: Array, like: Sequence[Array]) -> list[Array]:
    """One row cut into arrays like these."""
    parts = jnp.split(row, np.cumsum([x.size for x in like])[:-1])
    return [part.reshape(x.shape) for part, x in zip(parts, like, strict=True)]


# On the host ----------------------------------------------------------------------------------------------------------


class MujocoSession:
    """MuJoCo's model, where it keeps what, and room to compute in; agents, joints and contacts in team order."""

    def __init__(self, team: Team, text: str) -> None:
        self.model = m = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(m)
        self.turn = threading.Lock()  # two calls of one program need not wait for each other
        for flag in DISABLED_FLAGS:
            m.opt.disableflags |= flag
        names, joints = agent_names(team), mjcf.joint_names(team)
        place = {m.joint(j).name: (m.jnt_qposadr[j], m.jnt_dofadr[j]) for j in range(m.njnt)}
        self.load_q, self.load_v = place["payload"]
        self.base = np.array([m.body(name).id for name in names])
        self.base_q, self.base_v = np.array([place[name] for name in names]).T
        self.joint_q, self.joint_v = np.array([place[name] for name in joints], int).reshape(-1, 2).T
        self.thrust = np.array([m.actuator(f"{name} thrust").id for name in names])
        self.torque = np.array([m.actuator(f"{name} torque {axis}").id for name in names for axis in "xyz"])
        self.motor = np.array([m.actuator(name).id for name in joints], int)
        turning = self.base_v[:, None] + [3, 4, 5]
        counts = [
            group.tree.joints for size, group in zip(team.sizes, team.agent_groups, strict=True) for _ in range(size)
        ]
        of_joints = np.split(self.joint_v, np.cumsum(counts)[:-1])
        self.xi = np.concatenate([x for part in zip(turning, of_joints, strict=True) for x in part])
        self.turning = turning.ravel()
        owns = m.body_rootid == self.base[:, None]
        self.mass = m.body_subtreemass[self.base]
        self.share = (owns * m.body_mass / self.mass[:, None]).T
        self.holds = owns[:, m.site_bodyid[m.eq_obj2id]].astype(float)

    def forward_dynamics(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """`a_L, v_dot, xi_dot, lam` of a state under inputs and a residual, each in a row.

        An agent's centre of mass follows from Newton: `m v_dot = m a_g + R e3 u + f_x - sum lam`.
        """
        with self.turn:
            self._set(*rows)
            mujoco.mj_forward(self.model, self.data)
            qacc, lam = self.data.qacc, self.data.efc_force.reshape(-1, 3).copy()
            thrust = self.data.ctrl[self.thrust][:, None] * self.data.xmat[self.base].reshape(-1, 3, 3)[:, :, 2]
            force = thrust + rows[13].reshape(-1, 3) - self.holds @ lam
            v_dot = self.model.opt.gravity + force / self.mass[:, None]
            return qacc[self.load_v : self.load_v + 6].copy(), v_dot.ravel(), qacc[self.xi], lam.ravel()

    def step(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """The state, in rows, after one step of the length that comes last, s."""
        with self.turn:
            self.model.opt.timestep = rows[-1].item()
            self._set(*rows[:-1])
            mujoco.mj_step(self.model, self.data)
            return self._state()

    def _set(self, *rows: np.ndarray) -> None:
        """A state `R, x, r, omega, v, r_dot, R_L, p, omega_L, v_L`, inputs `u, tau, tau_r`, `f_x, f_w, f_r, F, tau`."""
        d, (*state, u, tau, tau_r, f_x, f_w, f_r, F, torque) = self.data, rows
        self._place(*state)
        d.ctrl[self.thrust], d.ctrl[self.torque], d.ctrl[self.motor] = u, tau, tau_r
        d.xfrc_applied[:, :3] = self.share @ f_x.reshape(-1, 3)
        d.qfrc_applied[self.turning], d.qfrc_applied[self.joint_v] = f_w, f_r
        d.qfrc_applied[self.load_v : self.load_v + 6] = [*F, *torque]

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
        """MuJoCo's coordinates: first with all bases' origins at rest at zero, then moved by what their agents lack."""
        d, q, w = self.data, self.load_q, self.load_v
        d.qpos[q : q + 7] = [*p, *_quaternion(R_L)]
        d.qvel[w : w + 6] = [*v_L, *omega_L]
        for at, attitude in zip(self.base_q, R.reshape(-1, 9), strict=True):
            d.qpos[at : at + 7] = [0, 0, 0, *_quaternion(attitude)]
        origin, speed = self.base_q[:, None] + [0, 1, 2], self.base_v[:, None] + [0, 1, 2]
        d.qvel[speed] = 0
        d.qpos[self.joint_q], d.qvel[self.joint_v], d.qvel[self.turning] = r, r_dot, omega
        self._move()
        d.qpos[origin] = x.reshape(-1, 3) - d.subtree_com[self.base]
        d.qvel[speed] = v.reshape(-1, 3) - d.subtree_linvel[self.base]

    def _move(self) -> None:
        """MuJoCo's kinematics: attitudes, centres of mass and their velocities."""
        for part in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_subtreeVel):
            part(self.model, self.data)

    def _state(self) -> tuple[np.ndarray, ...]:
        """The inverse of `_place`."""
        self._move()
        d, q, w = self.data, self.load_q, self.load_v
        load = d.xmat[self.model.body("payload").id].reshape(3, 3).copy()
        agents = (d.xmat[self.base], d.subtree_com[self.base], d.qpos[self.joint_q])
        rates = (d.qvel[self.turning], d.subtree_linvel[self.base], d.qvel[self.joint_v])
        return (
            *map(np.ravel, agents + rates),
            load,
            d.qpos[q : q + 3].copy(),
            d.qvel[w + 3 : w + 6].copy(),
            d.qvel[w : w + 3].copy(),
        )


def _quaternion(R: np.ndarray) -> np.ndarray:
    """`(w, x, y, z)` of a rotation matrix."""
    q = np.empty(4)
    mujoco.mju_mat2Quat(q, np.ravel(R))
    return q
