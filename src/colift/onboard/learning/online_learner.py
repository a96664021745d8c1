"""Online updates of residual models: schedule of fits, change detection and refits.

An online learner is called at the update times of a simulated flight. It returns the residual model to use until the
next update. It also detects changes of the residual and starts a new model of the affected body.

See Also:
    colift.closed_loop.flight: calls of the learner and activation of the new model.
    docs/learning: equations, and a flow chart of an update.
"""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift.models.parameters import Payload
from colift.onboard.learning import (
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
    """Options for periodic model updates and change-point handling.

    After a change point, the previous model is offset and stays in use until enough new samples exist. It predicts
    better than a model of few samples as long as labels correct it.

    Attributes:
        times: Update times [s].
        nis_threshold: Factor by which the mean normalized innovation squared (NIS) of a body must exceed its usual
            value for a change to be declared. The factor is relative because absolute thresholds miss changes of some
            bodies or detect false ones (docs/decisions/0060).
        transient_time: Time after the first sample above the threshold for which samples are discarded [s].
        min_samples: Number of samples since a change point that a new model requires.
        forgetting_time: Age at which the noise variance of a sample is doubled in the sample selection [s].
        mean_prior: Prior of the mean parameters.
    """

    times: tuple[float, ...]
    mean_prior: semiparametric.MeanPrior
    nis_threshold: float = 3.0
    transient_time: float = 0.5
    min_samples: int = 150
    forgetting_time: float = 20.0


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
        change_points: Bodies for which this update declared a change.
        refitted: Bodies whose older samples were discarded and whose hyperparameters and means were fitted again.
        mean_uncertainties: Mean uncertainties by body.
        error_message: Reason for which the previous model stays in use; empty if the update succeeded.
    """

    t: float
    activation_time: float
    num_samples: dict[str, int]
    fits: model_update.Fits
    theta: np.ndarray
    change_points: tuple[features.BodyKey, ...] = ()
    refitted: tuple[features.BodyKey, ...] = ()
    mean_uncertainties: semiparametric.MeanUncertainties = dataclasses.field(default_factory=dict)
    error_message: str = ""


class OnlineLearner:
    """Residual models of one simulated flight, updated from the recorded samples.

    Attributes:
        fit_options: Options of the hyperparameter fit; None keeps all hyperparameters.
        identification: Options of a parametric identification or a ridge regression in place of Gaussian processes.
        online_updates: Options for periodic updates; None for updates at fixed times without change detection.
        fits: Last hyperparameter fits by body.
        change_points: Last change points by body.
        nis_history: Mean NIS of the previous updates that declared no change, by body.
        covariances: Posterior covariances of the mean parameters, by body.
        mean_uncertainties: Mean uncertainties by body.
        pending: Bodies with too few samples since their change point for a new model.
        misspecified: Bodies whose first model since a change point does not fit its own samples.
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
        self.change_points: dict[features.BodyKey, model_update.ChangePoint] = {}
        self.nis_history: dict[features.BodyKey, list[float]] = {}
        self.covariances: dict[features.BodyKey, np.ndarray] = {}
        self.mean_uncertainties: semiparametric.MeanUncertainties = {}
        self.pending: set[features.BodyKey] = set()
        self.misspecified: tuple[features.BodyKey, ...] = ()
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
        error_message, changed, before = "", (), self._snapshot()
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
                changed = self._detect_changes(model, recorder_state, self.online_updates)
                model = self._update_periodically(model, recorder_state, self.online_updates, t, fit)
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
            change_points=changed,
            refitted=self.misspecified,
            mean_uncertainties=self.mean_uncertainties,
            error_message=error_message,
        )
        return model, update

    def _snapshot(self) -> dict[str, Any]:
        """Return the attributes to restore after a failed update, with copies of those that change in place."""
        history = {body: [*values] for body, values in self.nis_history.items()}
        copies = {
            "nis_history": history,
            "change_points": {**self.change_points},
            "covariances": {**self.covariances},
        }
        return vars(self) | copies | {"misspecified": ()}

    def _update_periodically(
        self,
        model: residual_model.ResidualModel,
        recorder_state: recorder.RecorderState,
        options: OnlineUpdateOptions,
        t: float,
        fit: bool,
    ) -> residual_model.ResidualModel:
        """Condition the model on selected samples, and fit it if required.

        Returns:
            The updated model; the same model if there are neither new samples nor pending bodies.
        """
        has_new_samples, pending = recorder_state.latest_time() > self.last_sample_time, self.pending
        self.pending = self.pending if has_new_samples else set()
        if not has_new_samples and not pending:
            return model
        previous = jax.tree.map(jnp.zeros_like, recorder_state) if self.data is None else self.data
        data = model_update.select_samples(
            model, previous, recorder_state, self.last_sample_time, t, options.forgetting_time, self.change_points
        )
        data = self._close_change_points(data, fit)
        if "payload" in self.change_points:
            model = semiparametric.update_inertial_mean(model, self.change_points["payload"], data, options.mean_prior)
        bodies = [
            body
            for body in (model_update.samples_by_body(data) if fit else self.misspecified)
            if body not in self.change_points
        ]
        if bodies and self.fit_options is not None:
            model, self.fits, covariances = semiparametric.fit(
                model, data, self.fit_options, options.mean_prior, self.fits, bodies, self.change_points, self.pending
            )
            self.covariances |= covariances
        else:
            model = model_update.condition(model, data, self.change_points, self.pending)
        self.mean_uncertainties = semiparametric.mean_uncertainties(model, data, self.covariances, self.change_points)
        self.data = data
        return model

    def _close_change_points(self, data: recorder.RecorderState, fit: bool) -> recorder.RecorderState:
        """Remove the change points of misspecified bodies and, at a fit, those without older samples.

        Returns:
            The samples without those of misspecified bodies before their change point.
        """
        samples = model_update.samples_by_body(data)
        only_new = {
            body for body, change in self.change_points.items() if samples[body][2].min() >= change.time
        } - self.pending
        closed = {*self.misspecified, *(only_new if fit else ())}
        start = {body: self.change_points[body].time for body in self.misspecified}
        self.change_points = {body: change for body, change in self.change_points.items() if body not in closed}
        return model_update.drop_before(data, start) if start else data

    def _detect_changes(
        self,
        model: residual_model.ResidualModel,
        recorder_state: recorder.RecorderState,
        options: OnlineUpdateOptions,
    ) -> tuple[features.BodyKey, ...]:
        """Compare new samples with the model and declare changes.

        A pending body is not tested. When it has enough samples for a new model, this model is tested against its own
        samples by leave-one-out errors. If these are as large as the errors of the newest samples, the body is
        misspecified and no change is declared.

        Returns:
            The bodies for which a change is declared.
        """
        changed, misspecified = [], []
        samples = model_update.samples_by_body(self.data or recorder_state)
        num_since = {body: int((samples[body][2] >= change.time).sum()) for body, change in self.change_points.items()}
        too_few = {body for body, n in num_since.items() if n < options.min_samples}
        first_model = self.pending - too_few  # bodies with their first model since the change
        tested = (
            model_update.condition(model, self.data, self.change_points, too_few)
            if first_model and self.data is not None
            else model
        )

        def limit(previous_nis: list[float]) -> float:
            return options.nis_threshold * max(1.0, float(np.median(previous_nis))) if previous_nis else np.inf

        for body, (t, nis) in semiparametric.normalized_innovation_squared(
            tested, recorder_state, self.mean_uncertainties, self.last_sample_time
        ).items():
            posterior, mean_nis = residual_model.get_model(tested, body), float(nis.mean())
            if body in too_few or int(posterior.num_points) < options.min_samples / 3:  # no reliable model yet
                continue
            history = self.nis_history.setdefault(body, [])
            reference_nis = (
                [model_update.loo_normalized_error(posterior, num_since[body])] if body in first_model else history
            )
            if mean_nis > limit(reference_nis):
                self.change_points[body] = model_update.make_change_point(
                    tested, body, float(t[np.argmax(nis > limit(reference_nis))]) + options.transient_time
                )
                changed.append(body)
            elif mean_nis > limit(history) and self.fit_options is not None:
                misspecified.append(body)
            else:
                history.append(mean_nis)
        self.misspecified, self.pending = tuple(misspecified), too_few | set(changed)
        return tuple(changed)
