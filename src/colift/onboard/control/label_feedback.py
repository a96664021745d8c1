"""Stability limit of the feedback from an agent's labels to its attitude.

Encoder rates pass a low-pass filter; base and tip readings do not. Encoders determine only those joint motions that do
not move the tips (`state_estimator.joint_rates`). If the payload has no gyroscope, they determine all joint motions.
While an agent rotates about its tips, such joints can move. During the filter lag the label then contains the inertial
force of the arms. The controller compensates this apparent residual by a change of attitude, which closes a feedback
loop. Above a gain of 1 the loop can be unstable. The rate of the labels is therefore attenuated.

See Also:
    docs/decisions/0052-stability-limits-of-residual-compensation: derivation and measured results.
"""

from __future__ import annotations

import jax
import numpy as np
from jaxtyping import Array, Float

from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.onboard.control import redundancy, tracking
from colift.onboard.estimation import nav_filter, state_estimator

FREQUENCY_GRID = np.geomspace(1.0, 1e3, 400)
"""Frequencies at which the loop gain is evaluated [rad/s]."""


def label_loop_gain(
    agent: AerialManipulator,
    nominal_posture: Float[Array, "n_r"],
    gains: tracking.Gains,
    filters: nav_filter.FilterBandwidths,
    force: float,
    *,
    encoders_alone: bool = False,
) -> float:
    """Compute the largest gain from an agent's angular acceleration through its labels back to it.

    `gamma = max_w |mu / |f| s F(s) (1 - F_j(s)) s k_w / (s + k_w)|` at `s = i w`. Here `mu = |m B_r G|` is the force in
    the label per angular acceleration, with the part G of the joint motion of `posture_tilt_jacobian` that encoders
    determine. `F` are the label filters, `F_j` is the joint filter, and `f` is the thrust that the attitude aligns.

    Args:
        agent: Nominal parameters of one agent.
        nominal_posture: Joint positions [rad or m].
        gains: Feedback gains.
        filters: Bandwidths of the onboard filters.
        force: Magnitude of the thrust `|f|` [N].
        encoders_alone: Whether all joint rates come from the encoders.

    Returns:
        The gain. Below 1 the loop is stable; from 1 on stability is not guaranteed. Infinite for zero thrust, and for
        a posture with straight arms, where the joint motion is not determined.
    """
    p, share, tilt = _posture_motion(agent, nominal_posture)
    G = np.asarray(tilt) if encoders_alone else np.asarray(share) @ np.asarray(tilt)
    com_motion = np.asarray(p.J_base)[:, 3:] @ G
    if not np.isfinite(com_motion).all():
        return np.inf
    mu = float(p.mass) * float(np.linalg.norm(com_motion, 2))
    s, k_omega = 1j * FREQUENCY_GRID, float(gains.agent_k_omega)
    label_response = (
        _low_pass(s, filters.label) ** 2 * _low_pass(s, filters.tip_force) * (1 - _low_pass(s, filters.joint) ** 2)
    )
    peak = float(np.abs(s * label_response * s * k_omega / (s + k_omega)).max())
    return mu * peak / force if force else np.inf


@jax.jit
def _posture_motion(
    agent: AerialManipulator, r: Float[Array, "n_r"]
) -> tuple[aerial_manipulator.CentroidalModel, Float[Array, "n_r n_r"], Float[Array, "n_r 3"]]:
    """Return centroidal model, `state_estimator.encoder_share` and `redundancy.posture_tilt_jacobian` of an agent."""
    g = aerial_manipulator.forward_kinematics(agent, r)
    p = aerial_manipulator.centroidal_model(agent, g)
    return p, state_estimator.encoder_share(agent, g), redundancy.posture_tilt_jacobian(agent, p)


def rate_attenuation(gamma: float) -> float:
    """Return the share of its label rates that an agent uses: 1 up to a gain of 0.5, 0 from a gain of 1.

    Args:
        gamma: Label loop gain of the agent.
    """
    return float(np.clip(2 - 2 * gamma, 0.0, 1.0))


def _low_pass(s: np.ndarray, corner: Float[Array, ""]) -> np.ndarray:
    """Return the response of a first-order low-pass filter at s [rad/s]; corner in Hz."""
    return 1 / (1 + s / (2 * np.pi * float(corner)))
