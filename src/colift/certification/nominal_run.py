"""Nominal trajectory of a run, the parts that a certificate supports, and the time window of ultimate errors.

The nominal trajectory is the run with the same initial state and the same residual models, replaced at the same times,
in a world whose residuals are the models' means. Its errors are the nominal errors: those without prediction error.

See Also:
    docs/certificate.md: Theorem and derivation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from fractions import Fraction
from math import gcd, lcm
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from colift.certification import assumptions, linearized_trajectory
from colift.certification.linearized_trajectory import LinearizedTrajectory
from colift.closed_loop import signals
from colift.closed_loop.flight import Experiment, FlightResult, ModelInterval
from colift.gp import SquaredExponential
from colift.onboard import controller
from colift.onboard.control import agent_controllers, allocators, payload_controllers
from colift.onboard.estimation import contact_forces, state_estimator
from colift.onboard.learning import features, residual_model, residual_predictors
from colift.simulation import actuators, contact_dynamics, sensors
from colift.simulation.world import SimulatedWorld
from colift.trajectories import lissajous

Matrix = NDArray[np.float64]

ERRORS = ("e_p", "e_v", "e_R", "e_omega")  # tracking errors of position, velocity, attitude and angular velocity


@dataclasses.dataclass(frozen=True)
class EvaluationGrid:
    """Times at which errors count as ultimate.

    Attributes:
        nodes: Nodes of the linearized closed loop.
        window: Ticks of the window.
        full_period: True if the window covers a full period of the reference.
    """

    nodes: NDArray[np.intp]
    window: slice
    full_period: bool


def check_supported(experiment: Experiment) -> None:
    """Check that the equations of the certificate hold for all parts of an experiment.

    Supported parts are the paper's payload controller, learned residual models, and the built-in allocators, agent
    controllers and plant. Actuators and sensors with internal states are not supported.

    Args:
        experiment: Experiment of the run.

    Raises:
        ValueError: If a part is not supported; the message contains all of them.
    """
    onboard_controller, world = experiment.controller, experiment.world
    model = getattr(onboard_controller, "residual_model", None)
    supported = {
        "controller": (onboard_controller, (controller.LeaderFollowerController,)),
        "payload controller": (
            getattr(onboard_controller, "payload_controller", None),
            (payload_controllers.GeometricTracking,),
        ),
        "features": (getattr(model, "features", None), (features.DefaultFeatures,)),
        "kernel": (model and model.payload.hyper.kernel, (SquaredExponential,)),
        "residual predictor": (
            getattr(onboard_controller, "residual_predictor", None),
            (residual_predictors.LearnedResidual,),
        ),
        "allocator": (getattr(onboard_controller, "allocator", None), (allocators.LinearAllocator,)),
        "agent controller": (
            getattr(onboard_controller, "agent_controller", None),
            (agent_controllers.ThrustVectoringController,),
        ),
        "estimator": (getattr(onboard_controller, "estimator", None), (state_estimator.ComplementaryFilter,)),
        "contact forces": (
            getattr(getattr(onboard_controller, "estimator", None), "contact_forces", None),
            (contact_forces.TipSensors,),
        ),
        "payload filter": (
            getattr(getattr(onboard_controller, "estimator", None), "payload_filter", None),
            (type(None),),
        ),
        "world": (world, (SimulatedWorld,)),
        "plant": (getattr(world, "plant", None), (contact_dynamics.RigidContactPlant,)),
        "actuators": (getattr(world, "actuators", None), (actuators.IdealActuators,)),
        "mass step": (getattr(world, "mass_step", None), (type(None),)),
        "faults": (getattr(world, "faults", None), (type(None),)),
        **{
            f"sensor {k}": (one, (sensors.CalibrationRig,)) for k, one in enumerate(getattr(world, "sensor_models", ()))
        },
    }
    other = [f"{name} {type(part).__name__}" for name, (part, types) in supported.items() if type(part) not in types]
    if other:
        raise ValueError(f"no certificate: its equations do not hold for {', '.join(other)}")


def nominal_experiment(experiment: Experiment, truth: residual_model.ResidualModel) -> Experiment:
    """Return the experiment in a world with given residuals and the nominal plant; no samples are recorded.

    Args:
        experiment: Experiment of the run.
        truth: Residual model whose means are the residuals of the world.

    Returns:
        Experiment without online learning.
    """
    no, estimator = jnp.asarray(False), experiment.controller.estimator
    recorder = dataclasses.replace(experiment.controller.recorder, payload=no, agents=no)
    if isinstance(estimator, state_estimator.ComplementaryFilter):  # readings without noise can repeat
        estimator = dataclasses.replace(estimator, detects_tip_failures=False)
    none = tuple(() for _ in experiment.world.disturbances.agents)
    rest = jax.tree.map(jnp.zeros_like, experiment.world.disturbances.joints)
    smooth = tuple(dataclasses.replace(f, speed=jnp.ones_like(f.speed)) for f in rest)
    sources = dataclasses.replace(
        experiment.world.disturbances,
        payload=(),
        agents=none,
        joints=smooth,
        state_functions=(residual_model.ResidualFunction(model=truth),),
    )
    return dataclasses.replace(
        experiment,
        world=dataclasses.replace(experiment.world, team=experiment.controller.team, disturbances=sources),
        controller=dataclasses.replace(experiment.controller, recorder=recorder, estimator=estimator),
        update_times=(),
    )


def nominal_trajectory(
    experiment: Experiment, flight: FlightResult, schedule: Sequence[ModelInterval]
) -> LinearizedTrajectory:
    """Simulate the nominal trajectory of a run with learning, and linearize the closed loop along it.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run.
        schedule: All residual models of the run, from `on_model` of `run_experiment`.

    Returns:
        Closed loop linearized along the nominal trajectory.

    Raises:
        ValueError: If a part is not supported, the run stopped early or has no model update, or the nominal trajectory
            reaches a termination limit.
    """
    check_supported(experiment)
    if flight.termination_reason:
        raise ValueError(f"no certificate: the flight stopped: {flight.termination_reason}")
    if not flight.updates:
        raise ValueError("no certificate: the flight has no model update")
    try:
        return linearized_trajectory.linearize_along(
            nominal_experiment(experiment, flight.model),
            schedule,
            with_noise=assumptions.has_sensor_noise(experiment.world.sensors),
        )
    except linearized_trajectory.TerminatedEarly as error:
        raise ValueError(f"no certificate: {error}") from None


def evaluation_grid(experiment: Experiment, flight: FlightResult, loop: LinearizedTrajectory) -> EvaluationGrid:
    """Return the times at which errors count as ultimate.

    They are the last period of the reference, if it begins at least half a period after the last update. Otherwise they
    are the second half of the time after the last update.

    Args:
        experiment: Experiment of the run.
        flight: Simulated run.
        loop: Closed loop linearized along the nominal trajectory.

    Returns:
        Nodes and ticks of the window.
    """
    ticks, last = len(flight.records.t), round(flight.updates[-1].activation_time / experiment.dt)
    period = _period(experiment.controller.reference)
    first = ticks if period is None else ticks - round(period / experiment.dt)
    full_period = period is not None and first - last >= round(period / experiment.dt) // 2
    first = first if full_period else (last + ticks) // 2
    return EvaluationGrid(nodes=np.flatnonzero(loop.nodes >= first), window=slice(first, None), full_period=full_period)


def _period(path: Any) -> float | None:
    """Return the period of a reference [s], None if it is not periodic or not known."""
    if not isinstance(path, lissajous.Lissajous):
        return None
    pairs = (path.amplitude, path.period), (path.rotation_amplitude, path.rotation_period)
    moving = [float(T) for size, period in pairs for T in np.asarray(period)[np.asarray(size) != 0]]
    periods = [Fraction(T).limit_denominator(1000) for T in moving]
    together = lcm(*(T.numerator for T in periods))
    return together / gcd(*(T.denominator for T in periods)) if periods else None


def error_components(records: signals.StepRecord) -> Matrix:
    """Return the components of all errors in the order of `ERRORS`.

    Args:
        records: Records of a run.

    Returns:
        `(times, 12)` [m, m/s, 1, rad/s].
    """
    return np.concatenate([np.asarray(getattr(records, error), dtype=float) for error in ERRORS], axis=1)
