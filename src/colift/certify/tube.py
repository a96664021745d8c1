"""How far the run's states may be from those the path was taken at, and what that adds: the fixed point of S_X.

The unknown is bounded along one path; the run takes another, near it, because of the unknown. With `|f~(q) - f~(q')|
<= K |phi(q) - phi(q')|`, K from the norm and phi the features in length-scales, and Gamma the peak gains from f~ to
phi, the distances nu obey `nu <= Gamma (rho + K nu)`. Where `Gamma K` contracts, that is a bound; else there is none.
Derivation: `docs/certificate.md`, "The tube".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from colift import gp
from colift.certify.reach import Body
from colift.model import Team
from colift.response import Response

Matrix = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Tube:
    """The tube around the path: distances in features, and what f~ may differ by for it."""

    distance: Matrix  # (bodies,), length-scales
    difference: Matrix  # (inputs,), of f~ between path and run, N and N m
    contraction: float  # spectral radius of Gamma K, below 1


def features(response: Response, team: Team, lengthscales: Sequence[Matrix]) -> list[Matrix]:
    """`dphi / d state` of each body in length-scales: the payload's 20 features, then each agent's, in team order.

    Both speeds count as the vector they are the norm of, which is never less. lengthscales: the smallest of any output,
    `(features,)` for each body.
    """
    shifts, first = [], 0
    for size, group in zip(team.sizes, team.groups, strict=True):
        n = 12 + 2 * group.tree.joints
        shifts += [response.basis[first + k * n : first + (k + 1) * n] for k in range(size)]
        first += size * n
    load = response.basis[first : first + 12]
    turn = _turned()
    p, theta, omega, v = load[3:6], load[:3], load[6:9], load[9:12]
    rows = [np.vstack([p, v, turn @ theta, omega, v, omega])]
    scale = [np.r_[lengthscales[0][:18], np.full(3, lengthscales[0][18]), np.full(3, lengthscales[0][19])]]
    for shift, ls in zip(shifts, lengthscales[1:], strict=True):
        rows.append(np.vstack([turn @ shift[:3], shift[3:]]))
        scale.append(ls)
    return [row / ls[:, None] for row, ls in zip(rows, scale, strict=True)]


def _turned() -> Matrix:
    """`d vec(R) / d theta` at `R = I`, row by row of R; any R leaves its size."""
    E = np.zeros((9, 3))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        E[3 * i + j, k], E[3 * j + i, k] = -1.0, 1.0
    return E


def roughness(body: Body) -> Matrix:
    """`K = beta sqrt(signal_variance)`: `|f~(x) - f~(x')| <= K |x - x'|` in length-scales, for each output.

    `k(x, x) - 2 k(x, x') + k(x', x') <= signal_variance |x - x'|^2`, and a posterior covariance is below the prior's;
    the companion's mean m differs from the compensated one mu by a function whose norm is added to beta.
    """
    s = np.asarray(body.model.hyper.signal_variance)
    return (body.beta + _between(body)) * np.sqrt(s)


def _between(body: Body) -> Matrix:
    """Norm of the companion's mean less the compensated one, an upper bound in the prior's space."""
    difference = dataclasses.replace(body.companion, alpha=body.companion.alpha - _aligned(body))
    return np.asarray(gp.norm(difference))


def _aligned(body: Body) -> Matrix:
    n, capacity = int(body.model.n), body.companion.capacity
    alpha = np.asarray(body.model.alpha)[:, :n]
    return np.pad(alpha, ((0, 0), (0, capacity - n)))


def fixed_point(gains: Matrix, rho: Matrix, rough: Matrix, bodies: Sequence[slice]) -> Tube:
    """`nu = Gamma (rho + K nu)`.

    gains: Gamma, (bodies, inputs), `integral |dphi_b e^{A s} B_j| ds`; rho: (inputs,), the greatest `|f~|` on the path;
    rough: K, (inputs,). Raises ValueError where it does not contract: then no tube holds the run.
    """
    owner = np.zeros((len(rho), len(bodies)))
    for b, columns in enumerate(bodies):
        owner[columns, b] = 1.0
    loop = gains @ (rough[:, None] * owner)
    contraction = float(np.abs(np.linalg.eigvals(loop)).max())
    if contraction >= 1:
        raise ValueError(
            f"no tube holds the run: the unknown may vary so fast that it feeds itself, by a factor of "
            f"{contraction:.3g} (must be below 1); state a smaller norm or longer length-scales, or raise the gains"
        )
    nu = np.linalg.solve(np.eye(len(loop)) - loop, gains @ rho)
    return Tube(distance=np.asarray(nu, float), difference=rough * (owner @ nu), contraction=contraction)
