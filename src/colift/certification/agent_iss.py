"""Constants of the agents' input-to-state stability, Assumption 5 (ass:agent_layer_iss).

The static gains follow from the algebra of the rigid grasp and hold at any state. The dynamic gains are peak gains of
the linearized closed loop.

See Also:
    docs/certificate.md: "Input-to-state stability of the agents".
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
    """Constants of `|delta_W| <= alpha e^{-gamma (t - t_k)} |x(t_k)| + sum_b kappa_b sup |f~_b| + vartheta`.

    Rows are force [N] and moment [N m]. The paper's transient starts from `e_lambda(t_k)`, which does not determine it.
    The closed loop's state x does; its coordinates are those of `LinearizedLoop.basis`. The paper's sum has no payload
    term, which is `kappa[:, 0]` here.

    Attributes:
        alpha: Transient gains, `(2,)` [N, N m], for a state of unit norm.
        gamma: Decay rate, 0.9 times the rate of the slowest mode [1/s].
        kappa: Gains of `|f~_b|` (forces in N and moments in N m together), `(2, bodies)`, payload first.
        vartheta: Mismatch without residual, `(2,)` [N, N m].
        static: Gains of the rigid-grasp algebra at rest, `(2, bodies)`.
    """

    alpha: Matrix
    gamma: float
    kappa: Matrix
    vartheta: Matrix
    static: Matrix


@jax.jit
def algebraic_gain(team: Team, state: State) -> tuple[Float[Array, "6 inputs"], Float[Array, "6 inputs"]]:
    """Compute `(D, K)` with `(a, alpha) - (a_cmd, alpha_cmd) = D f~` and `delta_W = K f~` at a state.

    f~ contains the forces that the commands do not compensate, in the order of `closed_loop.linearization`. These are
    the prediction error of the residuals, and the misaligned thrust `-(I - b b^T) f_des` at each agent's center of
    mass, with its third axis b. The result is exact for every state of the rigid grasp, since the plant is linear in
    forces: `D_L = (M_L + M_A)^-1`, `K_L = -M_A (M_L + M_A)^-1`, with the agents' inertia M_A reflected to the payload.

    Args:
        team: Parameters of the team.
        state: State of the plant.

    Returns:
        D [1/kg, 1/(kg m^2)] and K.
    """
    zero_inputs = tuple(
        AgentInput(u=jnp.zeros(size), tau=jnp.zeros((size, 3)), tau_r=jnp.zeros((size, group.tree.joints)))
        for size, group in zip(team.sizes, team.agent_groups, strict=True)
    )

    def response(f: Float[Array, " inputs"]) -> Float[Array, "12"]:
        a, lam = contact_dynamics.forward_dynamics(team, state, zero_inputs, linearization.unflatten(team, f))
        W = grasp.payload_wrench(grasp.contact_points(team), state.payload.R, grasp.stack_contacts(lam))
        return jnp.concatenate([a.payload, W.F, W.tau])

    J = jax.jacfwd(response)(jnp.zeros(linearization.body_columns(team)[-1].stop))
    return J[:6], J[6:]


def agent_iss_constants(linear: LinearizedLoop, vartheta: Matrix) -> AgentIss:
    """Compute the constants of Assumption 5 from the linearized closed loop.

    Args:
        linear: Closed loop linearized at rest.
        vartheta: Mismatch without residual, `(2,)` [N, N m]; see `conservatism.nominal_mismatch`.

    Returns:
        Constants of the bound.
    """
    rows = linear.output_rows("delta_W")
    C, D = linear.C[rows], linear.D[rows]
    halves = [slice(0, 3), slice(3, 6)]
    gamma = -0.9 * float(np.linalg.eigvals(linear.A).real.max())
    kappa = np.zeros((2, len(linear.bodies)))
    static = np.zeros_like(kappa)
    for h, half in enumerate(halves):
        for b, columns in enumerate(linear.bodies):
            n = columns.stop - columns.start
            kappa[h, b] = peak_gain.peak_gain_continuous(
                linear.A, linear.B[:, columns], C[half], D[half, columns], [n], [1.0]
            ).bound
            static[h, b] = np.linalg.norm(D[half, columns], 2)
    return AgentIss(
        alpha=np.array([_peak_norm(linear.A, C[half], gamma) for half in halves]),
        gamma=gamma,
        kappa=kappa,
        vartheta=np.asarray(vartheta),
        static=static,
    )


def _peak_norm(A: Matrix, C: Matrix, gamma: float) -> float:
    """Return a tight upper bound of `sup_t |C e^{M t}|` with `M = A + gamma`.

    The samples are 0.1 times the period of the fastest mode apart and end when the response has decayed. Between two
    samples the norm is at most the larger one plus `h^2 / 8 sup |H''|`, where `H'' = C e^{M t} M^2 e^{M s}` and
    `|e^{M s}| <= e^{|M| h}`.
    """
    M = A + gamma * np.eye(len(A))
    values, vectors = np.linalg.eig(A)
    step, values = 0.1 / np.abs(values).max(), values + gamma
    left, right = C @ vectors, np.linalg.inv(vectors)
    curvature, greatest = step**2 / 8 * np.exp(step * np.linalg.norm(M, 2)) * M @ M, 0.0
    times = np.arange(0.0, -12 / values.real.max(), step)
    for chunk in np.array_split(times, 1 + len(times) // 1000):
        H = ((left * np.exp(chunk[:, None] * values)[:, None]) @ right).real
        sizes = np.linalg.norm(H, 2, axis=(1, 2)) + np.linalg.norm(H @ curvature, 2, axis=(1, 2))
        greatest = max(greatest, float(sizes.max()))
    return greatest * (1 + peak_gain.ROUNDING)
