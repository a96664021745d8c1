"""Calibration of the agents' residual models by a flight without payload.

Without payload the contact forces are zero, so the labels of the agents are their residuals. The models of these
residuals are the priors of estimates of the contact forces without tip force sensors.

See Also:
    colift.onboard.estimation.contact_forces: estimates that use the priors.
    colift.onboard.control.free_flight: controller of the flight.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from colift.closed_loop import flight, simulator
from colift.models.state import flatten_agent_force
from colift.onboard.controller import LeaderFollowerController
from colift.onboard.estimation import contact_forces, state_estimator
from colift.onboard.learning import residual_model, semiparametric
from colift.onboard.learning.recorder import RecorderState

FITTED_SHARE = 2 / 3  # share of the flight before the samples that determine the standard deviations
NOISE_STREAM = 3  # stream of random numbers that differs from that of the flight with payload


class CalibrationResult(NamedTuple):
    """Priors of the residuals of the agents.

    Attributes:
        prior: Residual model of the agents.
        error_std: Standard deviations of its errors by group, RMS over samples that were not fitted [N, N m].
    """

    prior: residual_model.ResidualModel
    error_std: tuple[np.ndarray, ...]


@dataclasses.dataclass(frozen=True)
class CalibrationFlight:
    """Flight of the agents without payload, and the fit of their residual models; implements `flight.Calibration`.

    Attributes:
        experiment: Experiment with open contacts, a `FreeFlightController`, the contact forces `FreeFlight`, and a
            `DataRecorder` of the agents.
        mean_prior: Prior of the mean parameters of the models.
        min_std: Least standard deviations of the errors by group [N, N m]; positive, since weights are their inverses.
    """

    experiment: flight.Experiment
    mean_prior: semiparametric.MeanPrior
    min_std: tuple[np.ndarray, ...]

    @functools.cached_property
    def result(self) -> CalibrationResult:
        """Priors of the residuals; the flight is simulated at the first use."""
        early, late = self._simulate()
        held_out = self._errors(self._fit(early), late, early.latest_time())
        return CalibrationResult(
            prior=self._fit(late),
            error_std=tuple(
                np.maximum(np.sqrt((e**2).mean((0, 1))), least) for e, least in zip(held_out, self.min_std, strict=True)
            ),
        )

    def _errors(
        self, model: residual_model.ResidualModel, samples: RecorderState, start: float
    ) -> tuple[np.ndarray, ...]:
        """Return labels minus predictions `(agents, samples, outputs)` by group, of samples after a time."""
        later = np.asarray(samples.agents[0].t[0]) > start
        x = tuple(jnp.asarray(np.asarray(group.X)[:, later]) for group in samples.agents)
        predicted = jax.vmap(lambda x: residual_model.predict_agents(model, x), in_axes=1, out_axes=1)(x)
        return tuple(
            np.asarray(group.Y)[:, later] - np.asarray(flatten_agent_force(f))
            for group, f in zip(samples.agents, predicted, strict=True)
        )

    def calibrated(self, controller: LeaderFollowerController) -> LeaderFollowerController:
        """Return a controller whose estimates of contact forces use the priors.

        Args:
            controller: Controller with a `ResidualPriorEstimator`.

        Returns:
            The controller.
        """
        found, estimator = self.result, controller.estimator
        assert isinstance(estimator, state_estimator.ComplementaryFilter)
        assert isinstance(estimator.contact_forces, contact_forces.ResidualPriorEstimator)
        forces = dataclasses.replace(
            estimator.contact_forces,
            prior=found.prior,
            agent_information=tuple(jnp.asarray(np.diag(std**-2)) for std in found.error_std),
        )
        return dataclasses.replace(controller, estimator=dataclasses.replace(estimator, contact_forces=forces))

    def _simulate(self) -> tuple[RecorderState, RecorderState]:
        """Return the samples recorded before `FITTED_SHARE` of the flight, and all samples."""
        setup, experiment = self.experiment.loop_config, self.experiment
        ticks, chunk = round(experiment.duration / experiment.dt), flight.ticks_per_chunk(experiment)
        key = jax.random.fold_in(jax.random.key(experiment.seed), NOISE_STREAM)
        loop, early = simulator.reset(setup, experiment.initial_state), None
        for start in range(0, ticks, chunk):
            if early is None and start >= FITTED_SHARE * ticks:
                early = loop.controller.recorder
            noise = flight.draw_noise(experiment.world, jax.random.fold_in(key, start), chunk)
            loop, _ = simulator.rollout(setup, loop, noise, jnp.asarray(min(chunk, ticks - start)))
            if int(loop.termination):
                raise ValueError(f"the calibration flight ended at t = {int(loop.tick) * experiment.dt:.3f} s")
        assert early is not None
        return early, loop.controller.recorder

    def _fit(self, samples: RecorderState) -> residual_model.ResidualModel:
        """Return the residual model for recorded samples."""
        model, options = self.experiment.controller.residual_model, self.experiment.fit_options
        if options is not None:
            model, _, _ = semiparametric.fit(model, samples, options, self.mean_prior, {})
        return semiparametric.condition(model, samples, self.mean_prior, samples.latest_time())[0]
