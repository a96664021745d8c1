"""How strongly an agent hears its own motion in its labels, and what that leaves of their rate.

Joint rates pass a filter, base and tips do not. While an agent turns about its tips its joints fold, so for the time of
that filter a label has the arms' inertia in it as a force that is none. Where attitudes follow labels that closes a
loop, which long or heavy arms make unstable within a few ticks. Derivation: decision 52.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Array, Float

from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.onboard.control import redundancy, tracking
from colift.onboard.estimation.state_estimator import FilterBandwidths

FREQUENCY_GRID = np.geomspace(1.0, 1e3, 400)  # rad/s, in which the loop's gain is sought


def label_loop_gain(
    agent: AerialManipulator, rest: Float[Array, "n_r"], gains: tracking.Gains, filters: FilterBandwidths, force: float
) -> float:
    """The greatest gain from an agent's angular acceleration through its labels back to it.

    `gamma = max_w |mu / |f| s F(s) (1 - F_j(s)) s k_w / (s + k_w)|` at `s = i w`, with `mu = ||m B_r G||` the force in
    the label by angular acceleration, `r_dd = G w_dot` as joints fold (`control.folded`), F the filters of labels, F_j
    that of joints, and f the thrust whose direction follows, N. At 1 and above nothing says that the loop is stable;
    infinite where there is no weight, and any force is the direction, and where arms are straight at rest, so that
    nothing says how joints fold.
    """
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, rest))
    folds = np.asarray(p.J_base)[:, 3:] @ np.asarray(redundancy.posture_tilt_jacobian(agent, p))
    if not np.isfinite(folds).all():
        return np.inf
    mu = float(p.mass) * float(np.linalg.norm(folds, 2))
    s, k_omega = 1j * FREQUENCY_GRID, float(gains.agent_k_omega)
    innovation_state = _low(s, filters.label) ** 2 * _low(s, filters.tip_force) * (1 - _low(s, filters.joint) ** 2)
    peak = float(np.abs(s * innovation_state * s * k_omega / (s + k_omega)).max())
    return mu * peak / force if force else np.inf


def rate_attenuation(gamma: float) -> float:
    """What part of its labels' rate an agent may follow: all up to a gain of a half, nothing from one on."""
    return float(np.clip(2 - 2 * gamma, 0.0, 1.0))


def _low(s: np.ndarray, corner: Float[Array, ""]) -> np.ndarray:
    """A first-order low-pass, corner in Hz."""
    return 1 / (1 + s / (2 * np.pi * float(corner)))
