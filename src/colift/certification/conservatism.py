"""Decomposition of the conservatism of a bound of the position error into causes.

See Also:
    docs/certificate.md: Meaning of each row, section "Sources of conservatism".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from colift.certification import linearized_trajectory, nominal_run, reachability, translation_bound
from colift.certification.agent_iss import AgentIss
from colift.certification.body_models import body_models
from colift.certification.certificate import Certificate
from colift.certification.linearized_trajectory import LinearizedTrajectory
from colift.closed_loop.flight import Experiment, FlightResult

Matrix = NDArray[np.float64]


def nominal_mismatch(experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory) -> Matrix:
    """Compute `sup |delta_W|` of the nominal trajectory, the mismatch without prediction error (vartheta).

    Args:
        experiment: Experiment of the run.
        flight: Simulated run.
        loop: Closed loop linearized along the nominal trajectory.

    Returns:
        Force and moment, `(2,)` [N, N m].
    """
    window = nominal_run.evaluation_grid(experiment, flight, loop).window
    return np.linalg.norm(loop.records.delta_W[window].reshape(-1, 2, 3), axis=2).max(0)


def conservatism_breakdown(
    experiment: Experiment,
    flight: FlightResult,
    loop: LinearizedTrajectory,
    agent_layer: AgentIss,
    certificate: Certificate,
) -> dict[str, float]:
    """Compute bounds of e_p under successively better reasoning.

    The ratio of two neighbors is the conservatism of one cause.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run.
        loop: Closed loop linearized along the nominal trajectory.
        agent_layer: Constants of Assumption 5.
        certificate: Certificate of the run.

    Returns:
        Bounds of e_p by method, then the observed and the nominal error [m].
    """
    grid = nominal_run.evaluation_grid(experiment, flight, loop)
    L = linearized_trajectory.adjoint_weights(loop, loop.output_rows("e_p"), grid.nodes)
    payload_controller: Any = experiment.controller.payload_controller  # certificates require gains
    gains, nominal = (
        payload_controller.gains,
        certificate.nominal_error["e_p"] + 3**0.5 * certificate.noise_response["e_p"],
    )
    unit = translation_bound.ultimate_bound(np.asarray(gains.K_p), np.asarray(gains.K_v), 1.0).e_p.bound

    def added(rho: Matrix) -> float:
        """Return the bound by `(rho_L + sum kappa rho) / m_L` and the translation gain, as in the paper."""
        sizes = [float(np.linalg.norm(rho[columns])) for columns in loop.bodies]
        force = np.linalg.norm(rho[:3]) + agent_layer.kappa[0] @ sizes
        return float(unit * force / float(experiment.controller.team.payload.mass) + nominal)

    rho = _max_errors(experiment, flight, loop, "energy")
    together = float(np.linalg.norm(np.abs(L).sum(2) @ rho, axis=1).max()) if np.isfinite(rho).all() else float("inf")
    out = {
        "sum of norms, Srinivas bound": added(_max_errors(experiment, flight, loop, "srinivas")),
        "sum of norms, energy bound": added(rho),
        "linearized loop, energy bound": together + nominal,
    }
    for name in ("energy", "recovery"):
        if name in certificate.ultimate_bounds:
            out[f"{name}, a priori"] = certificate.ultimate_bounds[name].a_priori["e_p"]
            out[f"{name}, a posteriori"] = certificate.ultimate_bounds[name].a_posteriori["e_p"]
    return out | {"observed": certificate.observed["e_p"], "nominal error": certificate.nominal_error["e_p"]}


def _max_errors(experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory, bound: str) -> Matrix:
    """Return the largest error bound of each output along the run [N, N m]."""
    bodies = body_models(experiment, flight, loop.records, loop.nodes, bound)
    return np.concatenate([reachability.max_error(body).max(0) for body in bodies])
