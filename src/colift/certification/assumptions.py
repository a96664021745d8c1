"""Names of the assumptions that a result of a run requires but does not show.

A result with any such name is reported as assumed, never as certified. `BoundAssumptions` lists the assumptions of the
bound of the prediction error; this module adds those of a run.

See Also:
    docs/certificate.md: Meaning of each name, section "Assumptions".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from colift.closed_loop import flight
from colift.onboard.learning import residual_predictors
from colift.simulation import disturbances
from colift.simulation.sensors import SensorNoise

FIRST_ORDER = "first order"  # the bounds hold for the linearized closed loop
NOISE = "sensor noise"  # the effect of sensor noise is not bounded
SAMPLED = "sampled estimator"  # the bounds hold at the true state
SATURATION = "saturation"  # a thrust may saturate
PERIODICITY = "less than a period"  # errors are evaluated over less than a period of the reference
MEAN = "posterior mean"  # the prediction is not a posterior mean


def status_label(names: Collection[str]) -> str:
    """Return the status of a result with the given assumptions.

    Args:
        names: Names of the assumptions that are not shown.

    Returns:
        "assumed" or "certified".
    """
    return "assumed" if names else "certified"


def certificate_assumptions(experiment: flight.Experiment, may_saturate: bool, full_period: bool) -> tuple[str, ...]:
    """Return the assumptions of the bounds of a run, in addition to those of the bound of the prediction error.

    The linearization along the nominal trajectory is always assumed. The effect of noise on the tube is in no bound.

    Args:
        experiment: Experiment of the run.
        may_saturate: True if a thrust of some run in the tube may saturate.
        full_period: True if errors are evaluated over a full period of the reference.

    Returns:
        Names of the assumptions.
    """
    return (
        FIRST_ORDER,
        *([NOISE] if has_sensor_noise(experiment.world.sensors) else []),
        *([SATURATION] if may_saturate else []),
        *([] if full_period else [PERIODICITY]),
        *_time_invariance(experiment),
    )


def logged_bound_assumptions(experiment: flight.Experiment) -> tuple[str, ...]:
    """Return the assumptions of the logged error bounds `rho_bar` about the prediction `f_hat`.

    A bound concerns the posterior mean at the true state. The controller uses the mean at the estimated state. In some
    cases (disturbance observer, identified parameters, true residual) the prediction is not a posterior mean.

    Args:
        experiment: Experiment of the run.

    Returns:
        Names of the assumptions.
    """
    not_posterior_mean = experiment.identification is not None or not isinstance(
        experiment.controller.residual_predictor, residual_predictors.LearnedResidual
    )
    return (
        *experiment.bound_assumptions.assumed,
        *([NOISE] if has_sensor_noise(experiment.world.sensors) else []),
        SAMPLED,
        *([MEAN] if not_posterior_mean else []),
        *_time_invariance(experiment),
    )


def has_sensor_noise(sensors: SensorNoise) -> bool:
    """Return whether any sensor reading of the team has noise or bias; errors of the calibration rig are label errors.

    Args:
        sensors: Standard deviations of the sensors.

    Returns:
        True if a standard deviation is not zero.
    """
    not_noise = {"tip_force_bandwidth"}
    return any(float(getattr(sensors, x.name)) != 0 for x in dataclasses.fields(sensors) if x.name not in not_noise)


def _time_invariance(experiment: flight.Experiment) -> tuple[str, ...]:
    """Return the assumption of time invariance of each active source that depends on time."""
    return tuple(
        f"time invariance of {name}" for name in disturbances.time_varying_names(experiment.world.disturbances)
    )
