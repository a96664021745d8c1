"""One aerial manipulator: kinematics, mass matrices, momenta, contact Jacobians.

Everything is expressed in the base frame and relative to the base origin, or, where the paper's reduced
coordinates ask for it, relative to the instantaneous centre of mass `s(r)`. Nothing here depends on the
attitude R: that is why the couplings of Eq. M0_partition are functions of r alone (docs/errata.md, row 3).
Functions take one agent; `jax.vmap` maps them over a group.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matmul, matvec, transpose
from colift.math.pytree import pytree
from colift.models.parameters import AerialManipulator, KinematicTree
from colift.models.state import AgentState

E3 = np.array([0.0, 0.0, 1.0])


@pytree
class ForwardKinematics:
    """Where the bodies, joints and tips are, and how they move with the joints; base frame, base origin.

    Points are stacked: centres of mass of the bodies, origins of the jointed bodies (on their axes), tips.
    """

    rotation: Float[Array, "bodies 3 3"]  # body to base
    joint_axis: Float[Array, "n_r 3"]  # unit vectors
    joint_origin: Float[Array, "points 3"]  # m
    J_point: Float[Array, "points n_r 3"]  # d point / d r
    J_omega: Float[Array, "bodies n_r 3"]  # body rate relative to the base, per joint rate


@jax.jit
def forward_kinematics(agent: AerialManipulator, r: Float[Array, "n_r"]) -> ForwardKinematics:
    """Forward kinematics and point Jacobians: `d x / d r_k = a_k x (x - o_k)`, or `a_k` where joint k slides."""
    tree, bodies = agent.tree, agent.tree.joints + 1
    slides = np.array(tree.prismatic, dtype=float)
    turn = matmul(agent.joint_rotation, so3.from_axis_angle(agent.joint_axis, r * (1 - slides)))
    shift = agent.joint_position + matvec(agent.joint_rotation, agent.joint_axis * (r * slides)[:, None])
    joint = jnp.concatenate([turn, shift[:, :, None]], axis=2)
    frames = [jnp.eye(3, 4)]  # [rotation, origin] of each body
    for k, parent in enumerate(tree.parents):
        up = frames[parent]
        frames.append(matmul(up[:, :3], joint[k]) + up[:, 3:] * np.eye(1, 4, 3))
    frame = jnp.stack(frames)
    rotation, origin = frame[:, :, :3], frame[:, :, 3]
    carrier = np.array([*range(bodies), *tree.tip_bodies])
    placed = origin[carrier] + matvec(rotation[carrier], jnp.concatenate([agent.com, agent.tip_position]))
    point = jnp.concatenate([placed[:bodies], origin[1:], placed[bodies:]])
    axis = matvec(rotation[1:], agent.joint_axis)  # a joint does not turn its own axis
    turns, slid = _moved(tree)
    lever = point[:, None] - origin[None, 1:]
    return ForwardKinematics(
        rotation=rotation,
        joint_axis=axis,
        joint_origin=point,
        J_point=so3.cross(axis[None], lever) * turns + axis[None] * slid,
        J_omega=axis[None] * turns[:bodies],
    )


def _moved(tree: KinematicTree) -> tuple[np.ndarray, np.ndarray]:
    """Zero-one `(points, n_r, 1)`: whether joint k turns, and whether it slides, the point."""
    bodies = [*range(tree.joints + 1), *range(1, tree.joints + 1), *tree.tip_bodies]
    moved = tree.ancestors[bodies].astype(float)[:, :, None]
    slides = np.array(tree.prismatic, dtype=float)[None, :, None]
    return moved * (1 - slides), moved * slides


@pytree
class CentroidalModel:
    """The agent in the paper's coordinates (x, xi), `xi = (omega, r_dot)`: Eq. nom_kin_coup.

    A point at `rho` from the centre of mass moves, in the base frame, with `R^T x_dot + B xi`,
    `B = [-hat(rho), d rho / d r]`; a force F (base frame) there pulls on (mu, nu) with `B^T F`.
    """

    mass: Float[Array, ""]  # kg, m
    M_bar: Float[Array, "xi xi"]
    J_base: Float[Array, "3 xi"]  # B of the base origin, rho = -s(r)
    J_com: Float[Array, "bodies 3 xi"]  # B of the bodies' centres of mass
    J_angular: Float[Array, "bodies 3 xi"]  # body rates, base frame, per xi
    inertia: Float[Array, "bodies 3 3"]  # kg m^2, base frame
    tip_from_com: Float[Array, "arms 3"]  # m, tips from the centre of mass
    J_tip: Float[Array, "arms 3 xi"]  # B of the tips: R^T times the contact Jacobian
    com_from_base: Float[Array, "3"]  # m, centre of mass from the base origin


@jax.jit
def centroidal_model(agent: AerialManipulator, g: ForwardKinematics) -> CentroidalModel:
    """`M_bar = sum_i m_i B_i^T B_i + W_i^T I_i W_i`: the reduced mass matrix, without the paper's Schur complement.

    `B_i` are point Jacobians relative to the centre of mass and `W_i` body rates, so the translation has
    already been eliminated (Eq. vbar_def); a test compares with `M_rr - M_rv M_vv^-1 M_vr` of Eq. M0_partition.
    """
    bodies = agent.tree.joints + 1
    m = agent.mass
    mass = m.sum()
    s = (m[:, None] * g.joint_origin[:bodies]).sum(0) / mass
    ds = (m[:, None, None] * g.J_point[:bodies]).sum(0) / mass
    rho = g.joint_origin - s[None]
    B = jnp.concatenate([-so3.hat(rho), transpose(g.J_point - ds[None])], axis=2)
    spin = jnp.concatenate([so3.identity((bodies,)), transpose(g.J_omega)], axis=2)
    inertia = matmul(matmul(g.rotation, agent.inertia), transpose(g.rotation))
    com = B[:bodies]
    turning = matmul(inertia, spin)
    terms = (m[:, None, None] * com)[..., None, :] * com[..., None] + spin[..., None] * turning[..., None, :]
    M_bar = terms.sum((0, 1))
    return CentroidalModel(
        mass=mass,
        M_bar=M_bar,
        J_base=jnp.concatenate([so3.hat(s), -ds.T], axis=1),
        J_com=com,
        J_angular=spin,
        inertia=inertia,
        tip_from_com=rho[bodies + agent.tree.joints :],
        J_tip=B[bodies + agent.tree.joints :],
        com_from_base=s,
    )


@jax.jit
def bias_forces(
    agent: AerialManipulator,
    g: ForwardKinematics,
    q: CentroidalModel,
    omega: Float[Array, "3"],
    r_dot: Float[Array, "n_r"],
) -> tuple[Float[Array, "xi"], Float[Array, "arms 3"]]:
    """Velocity products: `h` of `M_bar xi_dot + h = Q`, and the tips' accelerations `kappa` at `xi_dot = 0`.

    `h = sum_i B_i^T m_i a_i + W_i^T (I_i alpha_i + w_i x I_i w_i)` with the accelerations `a_i, alpha_i` at
    `xi_dot = 0` (Kane); `kappa` is relative to the centre of mass. Base frame.
    """
    tree = agent.tree
    bodies = tree.joints + 1
    turns, slid = _moved(tree)
    rates = r_dot[None, :, None]
    w = omega[None] + (g.J_omega * rates).sum(1)
    point_dot = so3.cross(omega[None], g.joint_origin) + (g.J_point * rates).sum(1)
    axis_dot = so3.cross(w[np.array(tree.parents, dtype=int)], g.joint_axis)
    joint, joint_dot = g.joint_origin[bodies : bodies + tree.joints], point_dot[bodies : bodies + tree.joints]
    lever, lever_dot = g.joint_origin[:, None] - joint[None], point_dot[:, None] - joint_dot[None]
    J_dot = (
        turns * (so3.cross(axis_dot[None], lever) + so3.cross(g.joint_axis[None], lever_dot)) + slid * axis_dot[None]
    )
    a = so3.cross(omega[None], point_dot) + (J_dot * rates).sum(1)
    alpha = (turns[:bodies] * axis_dot[None] * rates).sum(1)
    moment = matvec(q.inertia, alpha) + so3.cross(w, matvec(q.inertia, w))
    m = agent.mass[:, None]
    h = (q.J_com * (m * a[:bodies])[:, :, None]).sum((0, 1)) + (q.J_angular * moment[:, :, None]).sum((0, 1))
    a_com = (m * a[:bodies]).sum(0) / q.mass
    return h, a[bodies + tree.joints :] - a_com[None]


def momenta(agent: AerialManipulator, r: Float[Array, "n_r"], xi: Float[Array, "xi"]) -> Float[Array, "xi"]:
    """`(mu, nu) = M_bar(r) xi` (Eq. nom_kin_coup), kg m^2/s."""
    return matvec(centroidal_model(agent, forward_kinematics(agent, r)).M_bar, xi)


@jax.jit
def momentum_drift(agent: AerialManipulator, r: Float[Array, "n_r"], xi: Float[Array, "xi"]) -> Float[Array, "xi"]:
    """`(mu x omega, 1/2 xi^T dM_bar xi)`: how the momenta change without forces (Eq. nom_momentum)."""

    def twice_energy(r: Float[Array, "n_r"]) -> Float[Array, ""]:
        return (xi * momenta(agent, r, xi)).sum()

    return jnp.concatenate([so3.cross(momenta(agent, r, xi)[:3], xi[:3]), jax.grad(twice_energy)(r) / 2])


def tip_positions(agent: AerialManipulator, state: AgentState) -> Float[Array, "arms 3"]:
    """Contact points in the world, `p_b = x + R rho_b(r)` (Eq. dae_constraints)."""
    rho = centroidal_model(agent, forward_kinematics(agent, state.r)).tip_from_com
    return state.x[None] + matvec(state.R[None], rho)


def center_of_mass(agent: AerialManipulator, r: Float[Array, "n_r"]) -> Float[Array, "3"]:
    """`s(r)`: centre of mass from the base origin, base frame, m."""
    g = forward_kinematics(agent, r)
    return (agent.mass[:, None] * g.joint_origin[: agent.tree.joints + 1]).sum(0) / agent.mass.sum()
