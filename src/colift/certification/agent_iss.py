"""What the agents make of unknown forces: the constants of Assumption 5 (ass:agent_layer_iss), computed.

Static part: exact algebra of the rigid grasp, at any state. Dynamic part: peak gains of the linearized loop.
Derivation: `docs/certificate.md`, "Interface of the agents".
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from colift.certification import peak_gain
from colift.closed_loop import linearization
from colift.closed_loop.linearization import LinearizedLoop
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import AgentInput, State
from colift.simulation import contact_dynamics

Matrix = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class AgentIss:
    """`|delta_W| <= alpha e^{-gamma (t - t_k)} |x(t_k)| + sum_b kappa_b sup |f~_b| + vartheta`, force and moment apart.

    The paper's transient starts from `e_lambda(t_k)`, which does not determine it; the loop's state x does (in the
    coordinates of `response.Response.basis`). Its sum has no payload term; `kappa[:, 0]` is that term.
    """

    alpha: Matrix  # (2,) N and N m, for a state of size 1
    gamma: float  # 1/s, 0.9 of the slowest mode's rate
    kappa: Matrix  # (2, bodies) N and N m; of |f~_b| in N and N m together, payload first
    vartheta: Matrix  # (2,) N and N m: what is left without unknown forces
    static: Matrix  # (2, bodies) gains of the exact algebra, at rest


@jax.jit
def algebraic_gain(team: Team, state: State) -> tuple[Float[Array, "6 inputs"], Float[Array, "6 inputs"]]:
    """`(D, K)`: `(a, alpha) - (a_cmd, alpha_cmd) = D f~`, `delta_W = K f~` at z, f~ flat as in `colift.closed_loop.linearization`.

    f~ is what commands do not compensate: unknown forces less their estimates, and the thrust that points elsewhere,
    `-(I - b b^T) f_des` on the agent's centre of mass, `b` its third axis. Exact for any state on the grasp, as the
    plant is linear in forces: `D_L = (M_L + M_A)^-1`, `K_L = -M_A (M_L + M_A)^-1`, M_A the agents' inertia as felt at
    the payload.
    """
    still = tuple(
        AgentInput(u=jnp.zeros(size), tau=jnp.zeros((size, 3)), tau_r=jnp.zeros((size, group.tree.joints)))
        for size, group in zip(team.sizes, team.agent_groups, strict=True)
    )

    def caused(f: Float[Array, " inputs"]) -> Float[Array, "12"]:
        a, lam = contact_dynamics.forward_dynamics(team, state, still, linearization.unflatten(team, f))
        W = grasp.payload_wrench(grasp.contact_points(team), state.payload.R, grasp.stack_contacts(lam))
        return jnp.concatenate([a.payload, W.F, W.tau])

    J = jax.jacfwd(caused)(jnp.zeros(linearization.body_columns(team)[-1].stop))
    return J[:6], J[6:]


def agent_iss_constants(linear: LinearizedLoop, vartheta: Matrix) -> AgentIss:
    """The constants from the linearized loop; `vartheta` (N, N m) is measured, see `colift.certification.certificate`."""
    rows = linear.output_rows("delta_W")
    C, D = linear.C[rows], linear.D[rows]
    halves = [slice(0, 3), slice(3, 6)]
    gamma = -0.9 * float(np.linalg.eigvals(linear.A).real.max())
    kappa = np.zeros((2, len(linear.bodies)))
    fixed = np.zeros_like(kappa)
    for h, half in enumerate(halves):
        for b, columns in enumerate(linear.bodies):
            n = columns.stop - columns.start
            kappa[h, b] = peak_gain.peak_gain_continuous(
                linear.A, linear.B[:, columns], C[half], D[half, columns], [n], [1.0]
            ).bound
            fixed[h, b] = np.linalg.norm(D[half, columns], 2)
    return AgentIss(
        alpha=np.array([_peak(linear.A, C[half], gamma) for half in halves]),
        gamma=gamma,
        kappa=kappa,
        vartheta=np.asarray(vartheta),
        static=fixed,
    )


def _peak(A: Matrix, C: Matrix, gamma: float) -> float:
    """An upper bound of `sup_t |C e^{M t}|`, `M = A + gamma`, close to it.

    From samples a tenth of the fastest mode's time apart, until it has died out. Between two of them the norm is at
    most the greater one plus `h^2 / 8 sup |H''|`, where `H'' = C e^{M t} M^2 e^{M s}`, `|e^{M s}| <= e^{|M| h}`.
    """
    M = A + gamma * np.eye(len(A))
    values, vectors = np.linalg.eig(A)
    step, values = 0.1 / np.abs(values).max(), values + gamma
    left, right = C @ vectors, np.linalg.inv(vectors)
    bend, greatest = step**2 / 8 * np.exp(step * np.linalg.norm(M, 2)) * M @ M, 0.0
    times = np.arange(0.0, -12 / values.real.max(), step)
    for some in np.array_split(times, 1 + len(times) // 1000):
        H = ((left * np.exp(some[:, None] * values)[:, None]) @ right).real
        sizes = np.linalg.norm(H, 2, axis=(1, 2)) + np.linalg.norm(H @ bend, 2, axis=(1, 2))
        greatest = max(greatest, float(sizes.max()))
    return greatest * (1 + peak_gain.ROUNDING)
