"""Tightness of the ultimate bounds of the translation: disturbances that attain them, and textbook constants.

Random gains of every kind: under-, critically and over-damped; isotropic, diagonal, and with different axes.
"""

from __future__ import annotations

import numpy as np

from colift.certification import translation_bound
from colift.certification.peak_gain import Matrix
from evidence import collect

DRAWS = 40  # gains of each kind
DAMPINGS = ("under", "critical", "over")
MIXINGS = ("isotropic", "diagonal", "same axes", "other axes")
TARGET = 1.01  # largest ratio of bound and attained error


def gains(seed: int, damping: str, mixing: str) -> tuple[Matrix, Matrix]:
    """Return symmetric positive definite `K_p`, `K_v` of one kind: natural frequencies 1.5 to 4 rad/s, damping 0.2
    to 1.6.
    """
    rng = np.random.default_rng(seed)
    w = np.full(3, rng.uniform(1.5, 4)) if mixing == "isotropic" else rng.uniform(1.5, 4, 3)
    zeta = {"under": rng.uniform(0.2, 0.9), "critical": 1.0, "over": rng.uniform(1.1, 1.6)}[damping]
    P, Q = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    if mixing in ("isotropic", "diagonal"):
        P = Q = np.eye(3)
    if mixing == "same axes":
        Q = P
    K_p, K_v = P @ np.diag(w**2) @ P.T, Q @ np.diag(2 * zeta * w) @ Q.T
    return (K_p + K_p.T) / 2, (K_v + K_v.T) / 2


def textbook(K_p: Matrix, K_v: Matrix) -> float:
    """`|e_p| <= sqrt(p_max / p_min) sqrt(1 + c^2) rho / q_min` for rho = 1, with the best c and unit of time.

    The paper's V with the cross term `c e_p . e_v` that makes it strict: `p_min |x|^2 <= V <= p_max |x|^2`,
    `V' <= -q_min |x|^2 + sqrt(1 + c^2) rho |x|`, `x = (e_p, e_v)`, each constant an eigenvalue (Khalil, Nonlinear
    Systems, section 9.2).
    """
    best, eye, k = np.inf, np.eye(3), np.linalg.eigvalsh(K_p)
    for w in np.geomspace(k[0] ** 0.5 / 2, 2 * k[-1] ** 0.5, 12):  # the unit of time is 1 / w
        A, B = K_p / w**2, K_v / w
        for c in np.geomspace(0.03, 0.97, 30) * np.linalg.eigvalsh(B)[0]:
            p = np.linalg.eigvalsh(np.block([[A + c * B, c * eye], [c * eye, eye]]) / 2)
            q = np.linalg.eigvalsh(np.block([[c * A, 0 * eye], [0 * eye, B - c * eye]]))
            if p[0] > 0 and q[0] > 0:
                best = min(best, float(np.sqrt(p[-1] / p[0]) * np.sqrt(1 + c * c) / q[0] / w**2))
    return best


def compare(damping: str, mixing: str) -> dict[str, float]:
    """Return the largest bound over attained error, and the ratio of textbook constants and the bound for `|e_p|`."""
    reached, looser = [], []
    for seed in range(DRAWS):
        K_p, K_v = gains(seed, damping, mixing)
        bound = translation_bound.ultimate_bound(K_p, K_v, 1.0)
        reached.append(max(peak.bound / peak.lower_bound for peak in (bound.e_p, bound.e_v)))
        looser.append(textbook(K_p, K_v) / bound.e_p.bound)
    low, middle, high = np.quantile(looser, [0.0, 0.5, 1.0])
    return {
        "bound_over_attained": float(max(reached)),
        "textbook_over_bound_min": float(low),
        "textbook_over_bound_median": float(middle),
        "textbook_over_bound_max": float(high),
    }


CASES = {f"{damping}, {mixing}": (damping, mixing) for damping in DAMPINGS for mixing in MIXINGS}


def compare_item(item: str) -> dict[str, float]:
    """Return the comparison of a damping and a mixing of the axes."""
    return compare(*CASES[item])


def main() -> bool:
    """Every bound must be at most TARGET times the attained error, and textbook constants must be larger."""
    table = collect("translation", CASES, compare_item)
    for name in CASES:
        print(f"{name:22}", "  ".join(f"{what} {ratio:.4f}" for what, ratio in table[name].items()))
    return all(
        1 <= table[name]["bound_over_attained"] <= TARGET and table[name]["textbook_over_bound_min"] > 1
        for name in CASES
    )


if __name__ == "__main__":
    main()
