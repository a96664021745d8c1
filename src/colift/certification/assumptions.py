"""What a result of a flight rests on and does not show, by name: with any such name it is assumed, never certified.

`band.Stated` has what bounds of the prediction error rest on; here is what a flight adds. What each name means, and
what would cover it: `docs/certificate.md`, "What is assumed".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from colift.closed_loop import flight
from colift.onboard.learning import residual_predictors
from colift.simulation import disturbances
from colift.simulation.sensors import SensorNoise

FIRST_ORDER = "first order"
NOISE = "sensor noise"
SAMPLED = "sampled estimator"
SATURATION = "saturation"
PERIODICITY = "less than a round"
MEAN = "posterior mean"


def status_label(names: Collection[str]) -> str:
    """What a result that rests on these may be called."""
    return "assumed" if names else "certified"


def certificate_assumptions(experiment: flight.Experiment, limited: bool, whole: bool) -> tuple[str, ...]:
    """What the radii of a flight rest on beside the bound of the prediction error.

    The loop is linearized along its twin (always assumed); what noise adds to the tube is in no radius. limited: a
    thrust of some run in the tube may be cut off; whole: errors are taken over a whole round of the reference.
    """
    return (
        FIRST_ORDER,
        *([NOISE] if has_sensor_noise(experiment.world.sensors) else []),
        *([SATURATION] if limited else []),
        *([] if whole else [PERIODICITY]),
        *_invariance(experiment),
    )


def radius_assumptions(experiment: flight.Experiment) -> tuple[str, ...]:
    """What the radii `rho_bar` about the flown `f_hat` rest on.

    A band is about the posterior mean at the true state. What flies is the mean at the estimated one, and of some
    rivals (an observer, identified parameters, a residual that is told) no posterior mean at all.
    """
    rival = experiment.identification is not None or not isinstance(
        experiment.controller.residual_predictor, residual_predictors.LearnedResidual
    )
    return (
        *experiment.bound_assumptions.assumed,
        *([NOISE] if has_sensor_noise(experiment.world.sensors) else []),
        SAMPLED,
        *([MEAN] if rival else []),
        *_invariance(experiment),
    )


def has_sensor_noise(sensors: SensorNoise) -> bool:
    """Whether any reading of a flying team is off the truth; the calibration rig's errors are the labels' own."""
    other = {"tip_force_bandwidth"}
    return any(float(getattr(sensors, x.name)) != 0 for x in dataclasses.fields(sensors) if x.name not in other)


def _invariance(experiment: flight.Experiment) -> tuple[str, ...]:
    return tuple(
        f"time invariance of {name}" for name in disturbances.time_varying_names(experiment.world.disturbances)
    )
