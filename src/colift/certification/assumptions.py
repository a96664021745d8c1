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
from colift.simulation.sensors import Sensors

FIRST_ORDER = "first order"
NOISE = "sensor noise"
SAMPLED = "sampled estimator"
SATURATION = "saturation"
ROUND = "less than a round"
MEAN = "posterior mean"


def word(names: Collection[str]) -> str:
    """What a result that rests on these may be called."""
    return "assumed" if names else "certified"


def of_certificate(plan: flight.Plan, limited: bool, whole: bool) -> tuple[str, ...]:
    """What the radii of a flight rest on beside the bound of the prediction error.

    The loop is linearized along its twin (always assumed); what noise adds to the tube is in no radius. limited: a
    thrust of some run in the tube may be cut off; whole: errors are taken over a whole round of the reference.
    """
    return (
        FIRST_ORDER,
        *([NOISE] if noisy(plan.world.sensors) else []),
        *([SATURATION] if limited else []),
        *([] if whole else [ROUND]),
        *_invariance(plan),
    )


def of_radii(plan: flight.Plan) -> tuple[str, ...]:
    """What the radii `rho_bar` about the flown `f_hat` rest on.

    A band is about the posterior mean at the true state. What flies is the mean at the estimated one, and of some
    rivals (an observer, identified parameters, a residual that is told) no posterior mean at all.
    """
    rival = plan.identify is not None or not isinstance(plan.pilot.predictor, residual_predictors.Learned)
    return (
        *plan.stated.assumed,
        *([NOISE] if noisy(plan.world.sensors) else []),
        SAMPLED,
        *([MEAN] if rival else []),
        *_invariance(plan),
    )


def noisy(sensors: Sensors) -> bool:
    """Whether any reading of a flying team is off the truth; the calibration rig's errors are the labels' own."""
    other = {"tip_force_bandwidth"}
    return any(float(getattr(sensors, x.name)) != 0 for x in dataclasses.fields(sensors) if x.name not in other)


def _invariance(plan: flight.Plan) -> tuple[str, ...]:
    return tuple(f"time invariance of {name}" for name in disturbances.varying(plan.world.sources))
