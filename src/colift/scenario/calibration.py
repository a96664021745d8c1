"""Calibration flight of a scenario."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from colift.closed_loop import calibration, flight, termination
from colift.models.parameters import Team
from colift.onboard.control import free_flight
from colift.onboard.controller import LeaderFollowerController
from colift.onboard.estimation import contact_forces, state_estimator
from colift.onboard.learning import mean_functions, model_update, recorder, semiparametric
from colift.scenario import controllers, initial_states, priors, schema, trajectories
from colift.scenario.conversion import array
from colift.scenario.errors import ScenarioError
from colift.simulation import contact_dynamics
from colift.simulation.faults import Faults, LinkFault
from colift.simulation.sensor_faults import ReadingFault

JOINT_AMPLITUDE = (0.15, 0.01)  # rad and m, amplitude of revolute and prismatic joints
JOINT_FREQUENCIES = (0.3, 0.7)  # Hz, frequencies of the first and of the last joint of an agent


def make_calibration(settings: schema.Scenario, experiment: flight.Experiment) -> calibration.CalibrationFlight | None:
    """Return the calibration flight of a scenario; None without one.

    Agents, disturbances of the agents, sensors and actuators are those of the flight with payload. Contacts are open,
    the payload is on the ground, and there are no faults.

    Args:
        settings: Scenario.
        experiment: Experiment of case C1.

    Returns:
        The calibration flight.

    Raises:
        ScenarioError: If the state estimator is user-defined.
    """
    given = settings.contact_forces
    if isinstance(given, schema.TipSensors) or given.calibration_s == 0:
        return None
    if settings.plugins.estimator is not None:
        raise ScenarioError(
            f"{settings.name}: contact_forces.calibration_s: not possible with plugins.estimator; set it to 0"
        )
    world, controller = experiment.world, experiment.controller
    released = Faults(
        release_time=tuple(jnp.zeros(group.contact_position.shape[:2]) for group in world.team.agent_groups)
    )
    world = dataclasses.replace(
        world,
        plant=contact_dynamics.RigidContactPlant(),
        faults=released,
        sensor_models=tuple(each for each in world.sensor_models if not isinstance(each, ReadingFault | LinkFault)),
        mass_step=None,
        payload_on_ground=True,
    )
    noise = settings.learning.agents.noise_std
    free = dataclasses.replace(
        experiment,
        world=world,
        controller=_free_flight(settings, controller),
        termination_limits=_no_limits(experiment.termination_limits),
        duration=given.calibration_s,
        fit_options=_fit_options(settings, controller.team),
    )
    return calibration.CalibrationFlight(
        experiment=free,
        mean_prior=priors.mean_prior(settings, controller.team),
        min_std=tuple(  # without noise and disturbances all errors are zero
            1e-3
            * np.array([*[noise.force_N] * 3, *[noise.moment_Nm] * 3, *[noise.joint_torque_Nm] * group.tree.joints])
            for group in controller.team.agent_groups
        ),
    )


def _fit_options(settings: schema.Scenario, nominal: Team) -> model_update.FitOptions | None:
    """Return the options of the fits: `priors.position_only_options`, with few features of the joint torques."""
    options, features = priors.position_only_options(settings, nominal), priors.features(settings)
    if options is None:
        return None
    agents = tuple(
        semiparametric.joint_torque_prior(hyperprior, features.agent_names(group.tree.joints))
        for hyperprior, group in zip(options.agents, nominal.agent_groups, strict=True)
    )
    return dataclasses.replace(options, agents=agents)


def _free_flight(settings: schema.Scenario, controller: LeaderFollowerController) -> LeaderFollowerController:
    """Return the controller of the calibration flight, which records samples of the agents."""
    team, given, estimator = controller.team, settings.contact_forces, controller.estimator
    z = initial_states.state_at_rest(settings, team)  # without initial errors: the path is that of the flight
    assert not isinstance(given, schema.TipSensors)
    assert isinstance(estimator, state_estimator.ComplementaryFilter)
    capacity = controller.residual_model.payload.capacity
    amplitude, frequency = [], []
    for group, q in zip(team.agent_groups, z.agents, strict=True):
        kinds = np.array([JOINT_AMPLITUDE[prismatic] for prismatic in group.tree.prismatic])
        amplitude.append(array(np.broadcast_to(kinds, q.r.shape)))
        frequency.append(array(np.broadcast_to(np.linspace(*JOINT_FREQUENCIES, group.tree.joints), q.r.shape)))
    start = trajectories.setpoint(controller.reference, array(0.0)).p
    agents = free_flight.FreeFlightController(
        gains=controllers.gains(settings, team),
        yaw=trajectories.headings(settings),
        offset=tuple(q.x - start[None] for q in z.agents),
        r=tuple(q.r for q in z.agents),
        amplitude=tuple(amplitude),
        frequency=tuple(frequency),
    )
    return dataclasses.replace(
        controller,
        estimator=dataclasses.replace(estimator, contact_forces=contact_forces.FreeFlight()),
        agent_controller=agents,
        effectiveness_filter=None,
        contact_monitor=None,
        command_link=None,
        preview_step=None,
        residual_model=dataclasses.replace(
            controller.residual_model, mean_function=mean_functions.zero_drag_thrust(team.sizes)
        ),
        recorder=recorder.DataRecorder(
            sample_period=array(max(1 / settings.learning.sample_Hz, given.calibration_s / capacity)),
            start=array(settings.learning.start_s),
            end=array(np.inf),
            agents=jnp.array(True),
            payload=jnp.array(False),
        ),
    )


def _no_limits(limits: termination.TerminationLimits) -> termination.TerminationLimits:
    """Return termination limits that no flight exceeds."""
    unlimited = jax.tree.map(lambda x: jnp.full_like(x, jnp.inf), limits)
    return dataclasses.replace(
        unlimited, min_delassus=jnp.full_like(limits.min_delassus, -jnp.inf), min_height=jnp.asarray(-jnp.inf)
    )
