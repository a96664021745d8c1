"""Ultimate bound of the payload's translation error by exact peak-to-peak gains.

`e_p' = e_v`, `e_v' = -K_p e_p - K_v e_v + d`, `|d(t)|_2 <= rho` (Eq. err_ev_learning divided by m_L).

The paper's step from `V' <= -k |(e_v, e_omega)|^2 + ...` to `V' <= -c2 V + ...` is incorrect at `e_v = 0` and is not
used. The bounds hold at all times from zero error, and in the limit from any initial state.

See Also:
    docs/certificate.md: Derivation, section "Translation".
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from colift.certification import peak_gain
from colift.certification.peak_gain import Matrix, PeakGain


@dataclasses.dataclass(frozen=True)
class TranslationBound:
    """Ultimate bounds of the translation error with their worst-case disturbances.

    Attributes:
        e_p: Bound of `|e_p|_2` [m].
        e_v: Bound of `|e_v|_2` [m/s].
    """

    e_p: PeakGain
    e_v: PeakGain


def ultimate_bound(K_p: ArrayLike | float, K_v: ArrayLike | float, rho: float) -> TranslationBound:
    """Compute upper bounds of `limsup |e_p|` and `limsup |e_v|` over all d with `|d(t)|_2 <= rho`, tight to 1e-3.

    The bound is rho times the supremum over unit u of `integral |H(s)^T u| ds`, with the impulse response `H`; see
    `peak_gain_continuous`. Gains must be symmetric and positive definite, else a ValueError is raised.

    Args:
        K_p: Position gain over the mass, a number or a 3 x 3 matrix [1/s^2].
        K_v: Velocity gain over the mass, a number or a 3 x 3 matrix [1/s].
        rho: Bound of the disturbance [m/s^2].

    Returns:
        Bounds of position and velocity error.

    Raises:
        ValueError: If rho is negative or not finite.
    """
    K_p, K_v = _gain_matrix("K_p", K_p), _gain_matrix("K_v", K_v)
    if not (np.isfinite(rho) and rho >= 0):
        raise ValueError(f"rho = {rho} m/s^2: must be finite and at least 0")
    o, eye = np.zeros((3, 3)), np.eye(3)
    A, B = np.block([[o, eye], [-K_p, -K_v]]), np.vstack([o, eye])
    return TranslationBound(
        *(
            _scaled(peak_gain.peak_gain_continuous(A, B, C, None, [3], [1.0]), rho)
            for C in (np.hstack([eye, o]), np.hstack([o, eye]))
        )
    )


def _scaled(unit: PeakGain, rho: float) -> PeakGain:
    """Scale the gain for rho = 1, so that rho = 0 has a direction as well."""
    return dataclasses.replace(
        unit,
        bound=rho * unit.bound,
        lower_bound=rho * unit.lower_bound,
        contributions=rho * unit.contributions,
        inputs=rho * unit.inputs,
    )


def _gain_matrix(name: str, K: ArrayLike | float) -> Matrix:
    """Return a gain as a matrix; raise ValueError unless it is symmetric and positive definite."""
    K = np.asarray(K, float)
    K = K * np.eye(3) if K.ndim == 0 else K
    if K.shape != (3, 3) or not np.isfinite(K).all():
        raise ValueError(f"{name} = {K.tolist()}: must be a finite number or 3 x 3 matrix")
    if np.max(np.abs(K - K.T)) > 1e-12 * np.max(np.abs(K)):
        raise ValueError(f"{name} = {K.tolist()}: must be symmetric")
    least = float(np.linalg.eigvalsh(K)[0])
    if least <= 0:
        raise ValueError(f"{name} has the eigenvalue {least:.6g}: must be positive definite for a stable loop")
    return K
