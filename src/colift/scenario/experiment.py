"""The paper's study: the cases C1, C2, C3 and their rivals, and the plan of each for a scenario."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift import gp
from colift.closed_loop import flight
from colift.math.pytree import pytree
from colift.models import inverse_dynamics
from colift.models.parameters import Team
from colift.models.state import Residual, State, Wrench, no_force
from colift.onboard.control import payload_controllers
from colift.onboard.control.tracking import Command
from colift.onboard.learning import (
    mean_functions,
    online_learner,
    residual_model,
    residual_predictors,
    ridge_regression,
)
from colift.scenario import (
    ScenarioError,
    Settings,
    assumptions,
    controllers,
    disturbances,
    initial_states,
    priors,
    random_residuals,
    team,
    termination,
)
from colift.scenario import world as world_module
from colift.simulation import disturbances as disturbances_module
from colift.simulation.world import Simulated

Scalar = Float[Array, ""]
CASES = {
    "C1": "no learning",
    "C2": "payload learning",
    "C3": "payload and agent learning",
}
BEYOND = {"C4": "C3 that goes on learning, and reacts"}
BASELINES = {
    "I": "C1 with integral action",
    "DOB": "C1 with a wrench observer",
    "P": "parametric identification only",
    "O": "residuals known exactly",
    "F": "filtered labels, no memory",
    "R": "regression on a stated basis",
    "H": "C3 and filtered labels",
}
ALL = CASES | BEYOND | BASELINES


def plan(settings: Settings, case: str) -> flight.Plan:
    """One case of a scenario, ready to fly; raises as `plans` does."""
    return plans(settings, (case,))[case]


def plans(settings: Settings, cases: Sequence[str]) -> dict[str, flight.Plan]:
    """Cases of a scenario, ready to fly from the same start under the same disturbances and noise.

    Raises ScenarioError for a grasp, an allocation or a start that cannot be, for a team that cannot hover and for O
    where a law remembers; KeyError for an unknown case.
    """
    for case in cases:
        if case not in ALL:
            raise KeyError(f"case {case!r}: one of {', '.join(ALL)}")
    truth, nominal = team.team(settings)
    given, z = settings.learning, initial_states.start(settings, truth)
    drawn, error, sources = (
        random_residuals.drawn(settings, truth, z),
        no_force(truth),
        disturbances.disturbances(settings),
    )
    if drawn is not None:
        function, deviation = drawn
        sources = dataclasses.replace(sources, functions=(residual_model.Function(oracle=function),))
        error = jax.tree.map(lambda f: given.rig_error * f, deviation)
    pilot = controllers.pilot(settings, nominal)
    termination.hover(settings, truth, pilot, sources)
    c1 = flight.Plan(
        world=world_module.world(settings, truth, z, sources, error),
        pilot=pilot,
        agents=team.agent_names(settings),
        limits=termination.bounds(settings, truth, z),
        dt=1 / settings.control_Hz,
        z=z,
        duration=settings.duration_s,
        updates=(),
        training=priors.training(settings, nominal),
        identify=None,
        stated=assumptions.stated(settings, nominal, error),
        biases=assumptions.biases(settings),
        seed=settings.seed,
        latency=None if given.fit_latency == "measured" else given.fit_latency,
    )
    return {case: _as(case, c1, settings) for case in cases}


def _as(case: str, c1: flight.Plan, settings: Settings) -> flight.Plan:
    """C1 with what another case has in its place or in addition."""
    rival, given = settings.baselines, settings.learning
    learns, agents = case in ("C2", "C3", "P", "R", "H", "C4"), case in ("C3", "R", "H", "C4")
    pilot = c1.pilot
    ridge = rival.ridge, rival.ridge_moment or rival.ridge
    recorder = dataclasses.replace(pilot.recorder, payload=jnp.asarray(learns), agents=jnp.asarray(agents))
    pilot = dataclasses.replace(pilot, recorder=recorder)
    match case:
        case "I":
            K_i, k_i = jnp.asarray(rival.K_i), jnp.asarray(rival.k_i)
            pilot = dataclasses.replace(
                pilot, leader=payload_controllers.Integral(leader=pilot.leader, K_i=K_i, k_i=k_i)
            )
        case "DOB":
            bandwidth = jnp.asarray((rival.observer_Hz, rival.observer_moment_Hz or rival.observer_Hz))
            observer = residual_predictors.Observed(predictor=pilot.predictor, bandwidth=bandwidth)
            pilot = dataclasses.replace(pilot, predictor=observer)
        case "O":
            if remembering := disturbances_module.remembering(c1.world.sources):
                raise ScenarioError(
                    f"{settings.name}: case O knows residuals as functions of state and time; "
                    f"these laws remember what was before: {', '.join(remembering)}"
                )
            pilot = controllers.ahead(settings, pilot)
            truly = Truly(world=c1.world, nominal=pilot.team)
            pilot = dataclasses.replace(pilot, predictor=residual_predictors.Known(function=truly))
        case "R":
            pilot = controllers.ahead(settings, pilot)
            nothing = pilot.recorder.begin(pilot.team, pilot.oracle)
            pilot = dataclasses.replace(pilot, oracle=ridge_regression.regress(pilot.oracle, nothing, ridge))
        case "F" | "H" | "C4":
            pilot = controllers.listening(settings, controllers.ahead(settings, pilot), held=case != "C4")
    prior = np.array([rival.mass_kg, *[rival.first_moment_kgm] * 3, *[rival.inertia_kgm2] * 6])
    noise = np.array([given.payload.force_noise_N] * 3 + [given.payload.moment_noise_Nm] * 3)
    parameters = online_learner.Identify(noise=noise, prior=prior, believed=pilot.team.payload)
    made = dataclasses.replace(
        c1,
        pilot=pilot,
        updates=given.update_times_s if learns else (),
        identify={"P": parameters, "R": online_learner.Regress(ridge=ridge)}.get(case),
    )
    return _going_on(made, settings) if case == "C4" else made


def _going_on(plan: flight.Plan, settings: Settings) -> flight.Plan:
    """The plan with learning that does not end: maps of the place, renewed, and fitted anew, every so often."""
    given = settings.innovation
    first, last = settings.learning.update_times_s[0], settings.learning.update_times_s[-1]
    times = np.arange(first, settings.duration_s, given.renew_s)[1:]
    fits = np.arange(last, settings.duration_s, given.refit_s)[1:]
    recorder = dataclasses.replace(plan.pilot.recorder, end=jnp.asarray(np.inf), policy=gp.first_in_first_out)
    oracle = dataclasses.replace(plan.pilot.oracle, known=mean_functions.no_air(plan.pilot.team.sizes))
    return dataclasses.replace(
        plan,
        pilot=dataclasses.replace(plan.pilot, recorder=recorder, oracle=oracle),
        updates=(*plan.updates, *fits.tolist()),
        training=priors.of_place(settings, plan.pilot.team),
        renewals=online_learner.Renewals(
            times=tuple(times.tolist()),
            surprise=given.surprise,
            settle=given.settle_s,
            enough=min(given.enough, settings.learning.capacity),
            age=given.age_s,
            mean=priors.mean(settings, plan.pilot.team),
        ),
    )


@pytree
class Truly:
    """The unknown forces of a world as a function: its sources, which remember nothing, and its payload's mass."""

    world: Simulated
    nominal: Team

    def __call__(self, z: State, to: Command, t: Scalar) -> Residual:
        """What the nominal equations leave over at the state z, for a payload that accelerates so, at time t, s."""
        f = self.world.unknown(z, t, disturbances_module.begin(self.world.sources, self.world.team))
        g = self.nominal.gravity
        W, N = (
            inverse_dynamics.payload(team.payload, to.a - g, to.alpha, z.payload.omega)
            for team in (self.world.at(t), self.nominal)
        )
        W = Wrench(F=f.payload.F + N.F - W.F, tau=f.payload.tau + N.tau - W.tau)
        return dataclasses.replace(f, payload=W)
