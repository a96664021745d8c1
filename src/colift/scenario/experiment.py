"""Experiment of each case of a scenario."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift import gp
from colift.closed_loop import flight, part_checks
from colift.math.pytree import pytree
from colift.models import inverse_dynamics
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State, Wrench, zero_residual
from colift.onboard.control import payload_controllers
from colift.onboard.control.tracking import AccelerationCommand
from colift.onboard.learning import (
    mean_functions,
    online_learner,
    residual_model,
    residual_predictors,
    ridge_regression,
)
from colift.scenario import (
    Scenario,
    ScenarioError,
    assumptions,
    calibration,
    controllers,
    disturbances,
    initial_states,
    priors,
    random_residuals,
    team,
    termination,
)
from colift.scenario import world as world_module
from colift.scenario.cases import AGENT_LEARNING_CASES, LEARNING_CASES, case_id
from colift.scenario.conversion import check_plugin
from colift.simulation import disturbances as disturbances_module
from colift.simulation.world import SimulatedWorld

Scalar = Float[Array, ""]


def make_experiment(settings: Scenario, case: str) -> flight.Experiment:
    """Return the experiment of one case of a scenario; raises as `make_experiments`."""
    return make_experiments(settings, (case,))[case_id(case)]


def make_experiments(settings: Scenario, cases: Sequence[str]) -> dict[str, flight.Experiment]:
    """Return experiments that differ in their case only: initial state, disturbances and noise are equal.

    Args:
        settings: Scenario.
        cases: Identifiers of the cases.

    Returns:
        Experiment by case.

    Raises:
        ScenarioError: If a grasp, an allocation or an initial state is impossible, if the team cannot hover, if a
            user-defined part does not fit its interface, or if a disturbance has an internal state in case
            `true_residual`.
        KeyError: If there is no such case.
    """
    cases = [case_id(case) for case in cases]
    truth, nominal = team.team(settings)
    given, z = settings.learning, initial_states.initial_state(settings, truth)
    drawn, error, sources = (
        random_residuals.sample_residuals(settings, truth, z),
        _zero_residual(truth),
        disturbances.make_disturbances(settings),
    )
    if drawn is not None:
        function, deviation = drawn
        sources = dataclasses.replace(sources, state_functions=(residual_model.ResidualFunction(model=function),))
        if (share := given.rig_label_error) is not None:
            error = jax.tree.map(lambda f: share * f, deviation)
    controller = controllers.make_controller(settings, nominal)
    c1 = flight.Experiment(
        world=world_module.make_world(settings, truth, z, sources, error),
        controller=controller,
        agent_names=team.agent_names(settings),
        contact_names=team.contact_names(settings),
        termination_limits=termination.make_termination_limits(settings, truth, z),
        dt=1 / settings.control_Hz,
        initial_state=z,
        duration=settings.duration_s,
        update_times=(),
        fit_options=priors.fit_options(settings, nominal),
        identification=None,
        bound_assumptions=assumptions.bound_assumptions(settings, nominal, error),
        label_biases=assumptions.label_bias_model(settings),
        seed=settings.seed,
        fit_latency=None if given.fit_latency == "measured" else given.fit_latency,
    )
    c1 = dataclasses.replace(c1, calibration=calibration.make_calibration(settings, c1))
    check_plugin(part_checks.check_parts, c1)
    termination.true_hover_thrust(settings, truth, controller, sources)
    return {case: _case_experiment(case, c1, settings) for case in cases}


_zero_residual = jax.jit(zero_residual)


def _identification_options(settings: Scenario, team: Team) -> online_learner.IdentificationOptions:
    """Return the options of the identification of inertial parameters."""
    tuning, noise = settings.baselines, settings.learning.payload.noise_std
    prior = [tuning.mass_prior_std_kg, *[tuning.first_moment_prior_std_kgm] * 3, *[tuning.inertia_prior_std_kgm2] * 6]
    return online_learner.IdentificationOptions(
        label_std=np.array([noise.force_N] * 3 + [noise.moment_Nm] * 3),
        prior_std=np.array(prior),
        nominal_payload=team.payload,
    )


def _case_experiment(case: str, c1: flight.Experiment, settings: Scenario) -> flight.Experiment:
    """Return the experiment of a case, from the experiment of case C1."""
    tuning, given = settings.baselines, settings.learning
    learned, agents = case in LEARNING_CASES, case in AGENT_LEARNING_CASES
    controller = c1.controller
    recorder = dataclasses.replace(controller.recorder, payload=jnp.asarray(learned), agents=jnp.asarray(agents))
    controller = dataclasses.replace(controller, recorder=recorder)
    match case:
        case "integral":
            K_i, k_R = jnp.asarray(tuning.position_integral_gain), controllers.gains(settings, controller.team).k_R
            k_i = tuning.attitude_integral_gain * (k_R / k_R.max()) ** 1.5  # 1/s^3: for yaw with its lower bandwidth
            controller = dataclasses.replace(
                controller,
                payload_controller=payload_controllers.IntegralAction(
                    base=controller.payload_controller, K_i=K_i, k_i=k_i
                ),
            )
        case "disturbance_observer":
            observer = residual_predictors.DisturbanceObserver(
                base=controller.residual_predictor, bandwidth=jnp.asarray(tuning.dob_Hz)
            )
            controller = dataclasses.replace(controller, residual_predictor=observer)
        case "true_residual":
            if stateful := disturbances_module.stateful_names(c1.world.disturbances):
                raise ScenarioError(
                    f"{settings.name}: case true_residual evaluates residuals as functions of state and time; "
                    f"these disturbances have an internal state: {', '.join(stateful)}"
                )
            controller = controllers.with_preview(controller)
            true_residual = TrueResidualFunction(world=c1.world, nominal=controller.team)
            controller = dataclasses.replace(
                controller, residual_predictor=residual_predictors.TrueResidual(function=true_residual)
            )
        case "regression":
            controller = controllers.with_preview(controller)
            no_samples = controller.recorder.init(controller.team, controller.residual_model)
            controller = dataclasses.replace(
                controller,
                residual_model=ridge_regression.fit_ridge(controller.residual_model, no_samples, tuning.ridge_alpha),
            )
        case "label_feedback" | "gp_label_feedback":
            corrector = controllers.label_low_pass(settings, controller.team)
            controller = controllers.with_residual_corrector(settings, controllers.with_preview(controller), corrector)
        case "adaptive":
            corrector = controllers.residual_kalman_filter(settings, controller.team)
            controller = controllers.with_residual_corrector(settings, controllers.with_preview(controller), corrector)
    experiment = dataclasses.replace(
        c1,
        controller=controller,
        update_times=given.update_times_s if learned else (),
        identification={
            "parametric": _identification_options(settings, controller.team),
            "regression": online_learner.RidgeOptions(ridge=tuning.ridge_alpha),
        }.get(case),
    )
    return _with_online_updates(experiment, settings) if case == "adaptive" else experiment


def _with_online_updates(experiment: flight.Experiment, settings: Scenario) -> flight.Experiment:
    """Return the experiment with periodic model updates and refits, and position-only models with parametric means."""
    given = settings.learning
    first, last = given.update_times_s[0], given.update_times_s[-1]
    times = np.arange(first, settings.duration_s, given.update_period_s)[1:]
    fits = np.arange(last, settings.duration_s, given.refit_period_s)[1:]
    recorder = dataclasses.replace(
        experiment.controller.recorder, end=jnp.asarray(np.inf), selection_policy=gp.sliding_window
    )
    model = dataclasses.replace(
        experiment.controller.residual_model,
        mean_function=mean_functions.zero_drag_thrust(experiment.controller.team.sizes),
    )
    return dataclasses.replace(
        experiment,
        controller=dataclasses.replace(experiment.controller, recorder=recorder, residual_model=model),
        update_times=(*experiment.update_times, *fits.tolist()),
        fit_options=priors.position_only_options(settings, experiment.controller.team),
        online_updates=online_learner.OnlineUpdateOptions(
            times=tuple(times.tolist()),
            mean_prior=priors.mean_prior(settings, experiment.controller.team),
        ),
    )


@pytree
class TrueResidualFunction:
    """Residuals of a world as a function of state and time; its disturbances have no internal state."""

    world: SimulatedWorld  # simulated world
    nominal: Team  # nominal parameters of the controller

    def __call__(self, state: State, acceleration_cmd: AccelerationCommand, t: Scalar) -> ResidualForces:
        """Return the residuals of the nominal equations.

        Args:
            state: True state.
            acceleration_cmd: Acceleration of the payload.
            t: Time [s].

        Returns:
            Residual forces.
        """
        f = self.world.disturbance_forces(state, t, disturbances_module.init(self.world.disturbances, self.world.team))
        g = self.nominal.gravity
        W, N = (
            inverse_dynamics.payload_inverse_dynamics(
                team.payload, acceleration_cmd.a - g, acceleration_cmd.alpha, state.payload.omega
            )
            for team in (self.world.team_at(t), self.nominal)
        )
        W = Wrench(F=f.payload.F + N.F - W.F, tau=f.payload.tau + N.tau - W.tau)
        return dataclasses.replace(f, payload=W)
