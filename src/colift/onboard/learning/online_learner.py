"""Online updates of residual models: schedule of fits, sample selection and change detection.

An online learner is called at the update times of a simulated flight. It returns the residual model to use until the
next update.

See Also:
    colift.closed_loop.flight: calls of the learner and activation of the new model.
    docs/learning: equations.
"""

from __future__ import annotations

import dataclasses
import logging

import jax
import jax.numpy as jnp
import numpy as np

from colift.models.parameters import Payload
from colift.onboard.learning import (
    change_detection,
    features,
    identification,
    model_update,
    recorder,
    residual_model,
    ridge_regression,
    semiparametric,
)

log = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class OnlineUpdateOptions:
    """Options for periodic model updates.

    Attributes:
        times: Update times [s].
        mean_prior: Prior of the mean parameters.
    """

    times: tuple[float, ...]
    mean_prior: semiparametric.MeanPrior


@dataclasses.dataclass(frozen=True)
class IdentificationOptions:
    """Options of the parametric identification (case `parametric`).

    Attributes:
        label_std: Standard deviations (6,) of the payload labels [N, N m].
        prior_std: Prior standard deviations (10,) of the rigid-body parameters.
        nominal_payload: Nominal payload, which limits the identified parameters.
    """

    label_std: np.ndarray
    prior_std: np.ndarray
    nominal_payload: Payload


@dataclasses.dataclass(frozen=True)
class RidgeOptions:
    """Options of the ridge regression (case `regression`).

    Attributes:
        ridge: Regularization of the weights of forces, and of the weights of all other outputs.
    """

    ridge: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class ModelUpdate:
    """Result of one model update, for the log.

    Attributes:
        t: Time of the last sample that the update may use [s].
        activation_time: Time from which the updated model is in use [s].
        num_samples: Number of samples of the payload, and of all agents together.
        fits: Last hyperparameter fits by body.
        theta: Inertial parameters (10,) of the model.
        update_index: Index of the model, as in `ResidualModel`; the previous one if no model was computed.
        change_points: Bodies with a new change point.
        error_message: Reason for which the previous model stays in use; empty if the update succeeded.
    """

    t: float
    activation_time: float
    num_samples: dict[str, int]
    fits: model_update.Fits
    theta: np.ndarray
    update_index: int
    change_points: tuple[features.BodyKey, ...] = ()
    error_message: str = ""


class OnlineLearner:
    """Residual models of one simulated flight, updated from the recorded samples.

    Attributes:
        fit_options: Options of the hyperparameter fit; None keeps all hyperparameters.
        identification: Options of a parametric identification or a ridge regression in place of Gaussian processes.
        online_updates: Options for periodic updates; None for updates at fixed times without change detection.
        fits: Last hyperparameter fits by body.
        variations: Changes of the residual with time, by body.
        mean_uncertainties: Mean uncertainties by body.
        last_sample_time: Time of the last sample that an update has used [s].
        data: Samples selected until then; None before the first periodic update.

    Example:
        ::

            learner = OnlineLearner(fit_options, None, None)
            model, update = learner.update(model, recorder_state, t=10.0, fit=True)
    """

    def __init__(
        self,
        fit_options: model_update.FitOptions | None,
        identification: IdentificationOptions | RidgeOptions | None,
        online_updates: OnlineUpdateOptions | None,
    ) -> None:
        """Create a learner without samples.

        Args:
            fit_options: Options of the hyperparameter fit.
            identification: Options of a parametric model in place of Gaussian processes.
            online_updates: Options for periodic updates.
        """
        self.fit_options, self.identification, self.online_updates = fit_options, identification, online_updates
        self.fits: model_update.Fits = {}
        self.variations: semiparametric.Variations = {}
        self.mean_uncertainties: semiparametric.MeanUncertainties = {}
        self.last_sample_time = 0.0
        self.data: recorder.RecorderState | None = None

    def update(
        self, model: residual_model.ResidualModel, recorder_state: recorder.RecorderState, t: float, fit: bool
    ) -> tuple[residual_model.ResidualModel, ModelUpdate]:
        """Update the residual model with the recorded samples.

        If a computation fails, the previous model is returned and a warning is logged.

        Args:
            model: Residual model in use.
            recorder_state: Recorded samples.
            t: Time of the update [s].
            fit: Whether a periodic update fits hyperparameters.

        Returns:
            The residual model and a description of the update.
        """
        error_message, changed, before = "", (), {**vars(self)}
        try:
            if isinstance(self.identification, RidgeOptions):
                model = ridge_regression.fit_ridge(model, recorder_state, self.identification.ridge)
            elif self.identification is not None:
                n_L, options = int(recorder_state.payload.n), self.identification
                X, Y = np.asarray(recorder_state.payload.X)[:n_L], np.asarray(recorder_state.payload.Y)[:n_L]
                K = options.label_std[:, None, None] ** 2 * np.eye(n_L)
                theta, _ = identification.identify_parameters(
                    identification.inertial_regressors(X), Y, K, options.prior_std
                )
                theta = identification.enforce_physical_consistency(theta, options.nominal_payload)
                model = dataclasses.replace(model, inertial_parameters=jnp.asarray(theta))
            elif self.online_updates is not None:
                model, changed = self._update_periodically(model, recorder_state, self.online_updates, fit)
            else:
                model, self.fits = model_update.fit(model, recorder_state, self.fit_options, self.fits)
            self.last_sample_time = max(self.last_sample_time, recorder_state.latest_time())
        except (ValueError, np.linalg.LinAlgError) as error:
            error_message, changed = f"model update at t = {t:.3f} s failed, previous model stays in use: {error}", ()
            vars(self).update(before)
            log.warning("%s", error_message)
        data = self.data or recorder_state
        num_samples = {"payload": int(data.payload.n), "agents": sum(int(group.n.sum()) for group in data.agents)}
        update = ModelUpdate(
            t=t,
            activation_time=t,
            num_samples=num_samples,
            fits=self.fits,
            theta=np.asarray(model.inertial_parameters),
            update_index=int(model.update_index),
            change_points=changed,
            error_message=error_message,
        )
        return model, update

    def _update_periodically(
        self,
        model: residual_model.ResidualModel,
        recorder_state: recorder.RecorderState,
        options: OnlineUpdateOptions,
        fit: bool,
    ) -> tuple[residual_model.ResidualModel, tuple[features.BodyKey, ...]]:
        """Detect changes, select samples, fit the hyperparameters if required, and condition the model.

        Returns:
            The updated model and the bodies with a new change point; the same model if there are no new samples.
        """
        end = recorder_state.latest_time()
        if end <= self.last_sample_time:
            return model, ()
        previous = jax.tree.map(jnp.zeros_like, recorder_state) if self.data is None else self.data
        samples = model_update.merge_samples(previous, recorder_state, self.last_sample_time)
        none = model_update.Variation(rate=options.mean_prior.median_rate)
        variations = {body: self.variations.get(body, none) for body in samples}
        found = change_detection.detect_changes(
            model, samples, self.fits, options.mean_prior, variations, self.last_sample_time
        )
        variations |= found
        data = model_update.select_samples(model, samples, previous, end, variations)
        if fit and self.fit_options is not None:
            model, self.fits, variations = semiparametric.fit(
                model, data, self.fit_options, options.mean_prior, self.fits, variations
            )
        model, covariances = semiparametric.condition(model, data, options.mean_prior, end, variations)
        self.mean_uncertainties = semiparametric.mean_uncertainties(model, data, covariances)
        self.data, self.variations = data, variations
        return model, tuple(found)
