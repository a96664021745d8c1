"""One free aerial manipulator in MuJoCo, as a reference for mass matrix and bias forces."""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation


class MujocoAgent:
    """A free joint and a tree of hinges and slides; generalized velocity `(v_o world, omega body, r_dot)`."""

    def __init__(self, agent: SimpleNamespace, gravity: np.ndarray) -> None:
        tree, spec = agent.tree, mujoco.MjSpec()
        spec.option.gravity = gravity
        bodies = [spec.worldbody.add_body(name="base")]
        bodies[0].add_freejoint()
        for k, parent in enumerate(tree.parents):
            quaternion = Rotation.from_matrix(agent.joint_rotation[k]).as_quat(scalar_first=True)
            body = bodies[parent].add_body(name=f"body {k + 1}", pos=agent.joint_position[k], quat=quaternion)
            kind = mujoco.mjtJoint.mjJNT_SLIDE if tree.prismatic[k] else mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=f"joint {k}", type=kind, axis=agent.joint_axis[k])
            bodies.append(body)
        for i, body in enumerate(bodies):
            J = agent.inertia[i]
            body.explicitinertial, body.mass, body.ipos = True, agent.mass[i], agent.com[i]
            body.fullinertia = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        names = [f"joint {k}" for k in range(tree.joints)]
        self.place = np.array([self.model.joint(name).qposadr[0] for name in names], int)
        self.rate = np.array([self.model.joint(name).dofadr[0] for name in names], int)
        self.xi = np.array([3, 4, 5, *self.rate])

    def set(self, state: SimpleNamespace) -> None:
        """Set a state of colift; position and velocity of the base are zero, since no result depends on them."""
        self.data.qpos[:3] = 0
        self.data.qpos[3:7] = Rotation.from_matrix(state.R).as_quat(scalar_first=True)
        self.data.qpos[self.place] = state.r
        self.data.qvel[:3] = 0
        self.data.qvel[3:6] = state.omega
        self.data.qvel[self.rate] = state.r_dot
        mujoco.mj_forward(self.model, self.data)

    def mass_matrix(self) -> np.ndarray:
        """In the order (v_o, omega, r_dot)."""
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        order = np.array([0, 1, 2, *self.xi])
        return M[np.ix_(order, order)]

    def xi_dot(self, Q: np.ndarray) -> np.ndarray:
        """`(omega_dot, r_ddot)` under a force Q on (mu, nu), which does no work on the base origin."""
        self.data.qfrc_applied[:] = 0
        self.data.qfrc_applied[self.xi] = Q
        mujoco.mj_forward(self.model, self.data)
        return self.data.qacc[self.xi].copy()
