"""The ultimate bound of the payload's translation: exact peak-to-peak gains of its error equation.

`e_p' = e_v`, `e_v' = -K_p e_p - K_v e_v + d`, `|d(t)|_2 <= rho` (Eq. err_ev_learning over m_L).

The paper's step from `V' <= -k |(e_v, e_omega)|^2 + ...` to `V' <= -c2 V + ...` is false at `e_v = 0`; nothing of
it is used. The bounds hold from rest at all times, and in the limit from any start; `docs/certificate.md`.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from colift.certification import peak_gain
from colift.certification.peak_gain import Matrix, PeakGain


@dataclasses.dataclass(frozen=True)
class TranslationBound:
    """Ultimate bounds on `|e_p|_2`, m, and `|e_v|_2`, m/s, with the disturbances that reach them."""

    e_p: PeakGain
    e_v: PeakGain


def ultimate_bound(K_p: ArrayLike | float, K_v: ArrayLike | float, rho: float) -> TranslationBound:
    """`limsup |e_p|` and `limsup |e_v|` over all d with `|d(t)|_2 <= rho`, as upper bounds tight to 1e-3.

    `sup over unit u of integral |H(s)^T u| ds` times rho, `H` the impulse response (gain.continuous).
    K_p, K_v: 1/s^2 and 1/s, a number or a symmetric positive definite 3 x 3 matrix; rho: m/s^2.
    Raises ValueError for gains that are not symmetric and positive definite: such a loop may be unstable.
    """
    K_p, K_v = _gain_matrix("K_p", K_p), _gain_matrix("K_v", K_v)
    if not (np.isfinite(rho) and rho >= 0):
        raise ValueError(f"rho = {rho} m/s^2: must be finite and not negative")
    o, eye = np.zeros((3, 3)), np.eye(3)
    A, B = np.block([[o, eye], [-K_p, -K_v]]), np.vstack([o, eye])
    return TranslationBound(
        *(
            _scaled(peak_gain.peak_gain_continuous(A, B, C, None, [3], [1.0]), rho)
            for C in (np.hstack([eye, o]), np.hstack([o, eye]))
        )
    )


def _scaled(unit: PeakGain, rho: float) -> PeakGain:
    """The gain for the bound rho from that for 1, so that rho = 0 has a direction too."""
    return dataclasses.replace(
        unit,
        bound=rho * unit.bound,
        lower_bound=rho * unit.lower_bound,
        contributions=rho * unit.contributions,
        inputs=rho * unit.inputs,
    )


def _gain_matrix(name: str, K: ArrayLike | float) -> Matrix:
    K = np.asarray(K, float)
    K = K * np.eye(3) if K.ndim == 0 else K
    if K.shape != (3, 3) or not np.isfinite(K).all():
        raise ValueError(f"{name} = {K.tolist()}: must be a finite number or 3 x 3 matrix")
    if np.max(np.abs(K - K.T)) > 1e-12 * np.max(np.abs(K)):
        raise ValueError(f"{name} = {K.tolist()}: must be symmetric")
    least = float(np.linalg.eigvalsh(K)[0])
    if least <= 0:
        raise ValueError(f"{name} has the eigenvalue {least:.6g}: must be positive definite, or the loop is unstable")
    return K
