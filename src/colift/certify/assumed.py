"""What a result of a flight rests on and does not show, by name: with any such name it is assumed, never certified.

`band.Stated` has what bounds of the prediction error rest on; here is what a flight adds. What each name means, and
what would cover it: `docs/certificate.md`, "What is assumed".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Float

from colift import disturbance, fly, sensor, simulate
from colift.model import Team

FIRST_ORDER = "first order"
TRANSIENT = "transient at the update"
NOISE = "sensor noise"
SAMPLED = "sampled estimator"
SATURATION = "saturation"
MEAN = "posterior mean"

DECAYED = 1e-3  # share of a deviation at the update, from which on it counts as gone
NEAR = 0.1  # share of the thrust limit


def word(names: Collection[str]) -> str:
    """What a result that rests on these may be called."""
    return "assumed" if names else "certified"


def of_certificate(
    plan: simulate.Plan, thrusts: Sequence[Float[np.ndarray, "ticks agents"]], transient: float
) -> tuple[str, ...]:
    """What the radii of a flight rest on beside the bound of the prediction error.

    thrusts: N, of the flight and of its twin, from the last update on, where what radii are computed from begins;
    transient: the share that the loop's slowest mode leaves of a deviation at that update until errors count.

    The loop is linearized (always assumed), without sampling and filters (always); noise is in the twin as this run
    drew it; nothing keeps other runs in the tube from a limit that these are near.
    """
    limited = any(near_limit(plan.pilot.team, u) for u in thrusts)
    return (
        FIRST_ORDER,
        *([TRANSIENT] if transient > DECAYED else []),
        *([NOISE] if noisy(plan.world.sensors) else []),
        SAMPLED,
        *([SATURATION] if limited else []),
        *_invariance(plan),
    )


def of_radii(plan: simulate.Plan) -> tuple[str, ...]:
    """What the radii `rho_bar` about the flown `f_hat` rest on.

    A band is about the posterior mean at the true state. What flies is the mean at the estimated one, and of some
    rivals (an observer, identified parameters, a residual that is told) no posterior mean at all.
    """
    rival = plan.identify is not None or not isinstance(plan.pilot.predictor, fly.Learned)
    return (
        *plan.stated.assumed,
        *([NOISE] if noisy(plan.world.sensors) else []),
        SAMPLED,
        *([MEAN] if rival else []),
        *_invariance(plan),
    )


def noisy(sensors: sensor.Sensors) -> bool:
    """Whether any reading of a flying team is off the truth; the calibration rig's errors are the labels' own."""
    other = {"tip_force_bandwidth"}
    return any(float(getattr(sensors, x.name)) != 0 for x in dataclasses.fields(sensors) if x.name not in other)


def near_limit(team: Team, u: Float[np.ndarray, "ticks agents"]) -> bool:
    """Whether any thrust (N) is nearer to zero or to its limit than the share `NEAR` of that limit."""
    limit = np.concatenate([np.asarray(group.thrust_max) for group in team.groups])
    return bool((np.minimum(u, limit - u) < NEAR * limit).any())


def _invariance(plan: simulate.Plan) -> tuple[str, ...]:
    return tuple(f"time invariance of {name}" for name in disturbance.varying(plan.world.sources))
