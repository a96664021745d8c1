"""What is learned on the ground while a team flies: models of what was recorded, again and again, in place of the last.

`simulate` asks a school at the times of a plan, and swaps in what it gives once that is ready.
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
    """Oracles that go on: newer samples every so often; where the world has changed, the older ones amended.

    Of all samples so far those are kept that tell most, the newer ones rather (`learn.kept`).

    As long as labels correct it, a model from before the change does better than one of few new samples, and flies on.
    Once they are silent the new samples speak where the team has been again.
    """

    times: tuple[float, ...]  # s
    nis_threshold: float  # mean of `place.surprise` above which a body's world has changed, over what is usual for it
    transient_time: float  # s after the first sample that surprises, until which those that come speak of no world
    min_samples: int  # samples after a change for a new model; until then what surprises is the same change
    forgetting_time: float  # s, after which the noise of a sample counts twice when it is decided which are kept
    mean: semiparametric.MeanPrior  # of what maps hold beside GPs of the place


@dataclasses.dataclass(frozen=True)
class IdentificationOptions:
    """What parametric identification assumes."""

    label_std: np.ndarray  # (6,) deviation of the payload's labels, N and N m
    prior_std: np.ndarray  # (10,) deviation of each rigid-body parameter
    nominal_payload: Payload  # of which a tenth is always left


@dataclasses.dataclass(frozen=True)
class RidgeOptions:
    """What regression on `learn.basis` assumes."""

    ridge: tuple[float, float]  # beside the sum of squared label errors, of squared weights: forces, all other outputs


@dataclasses.dataclass(frozen=True)
class ModelUpdate:
    """What one update learned."""

    t: float  # s, when its samples were taken
    activation_time: float  # s, from when on it flew
    num_samples: dict[str, int]  # samples: of the payload, of all agents together
    fits: model_update.Fits
    theta: np.ndarray  # (10,)
    change_points: tuple[features.BodyKey, ...] = ()  # whose older samples are amended from now on
    refitted: tuple[features.BodyKey, ...] = ()  # whose are gone, and whose hyperparameters and means are fitted anew
    mean_uncertainties: semiparametric.MeanUncertainties = dataclasses.field(default_factory=dict)
    error_message: str = ""  # why the oracle before it stays


class OnlineLearner:
    """What is learned on the ground in one flight: the last fits, and what was known before the world changed."""

    def __init__(
        self,
        training: model_update.FitOptions | None,
        identify: IdentificationOptions | RidgeOptions | None,
        renewals: OnlineUpdateOptions | None,
    ) -> None:
        self.training, self.identify, self.renewals = training, identify, renewals
        self.fits: model_update.Fits = {}
        self.changes: dict[features.BodyKey, model_update.ChangePoint] = {}
        self.usual: dict[features.BodyKey, list[float]] = {}  # means of `place.surprise` that were no change
        self.covariances: dict[features.BodyKey, np.ndarray] = {}  # of means
        self.doubts: semiparametric.MeanUncertainties = {}
        self.waiting: set[features.BodyKey] = set()  # those that have seen too little since for a new model
        self.misfits: tuple[features.BodyKey, ...] = ()  # those whose first model since does not fit
        self.last = 0.0  # s, of the newest sample that an oracle has seen
        self.data: recorder.RecorderState | None = None  # kept of all samples until then, where learning goes on

    def update(
        self, model: residual_model.ResidualModel, recorder_state: recorder.RecorderState, t: float, fit: bool
    ) -> tuple[residual_model.ResidualModel, ModelUpdate]:
        """The oracle of what was recorded until t, s: GPs, with hyperparameters fitted or kept, or parameters.

        Where a fit fails the oracle stays as it was, and the update says why.
        """
        failed, changed, before = "", (), self._memory()
        try:
            if isinstance(self.identify, RidgeOptions):
                model = ridge_regression.fit_ridge(model, recorder_state, self.identify.ridge)
            elif self.identify is not None:
                n_L, given = int(recorder_state.payload.n), self.identify
                X, Y = np.asarray(recorder_state.payload.X)[:n_L], np.asarray(recorder_state.payload.Y)[:n_L]
                K = given.label_std[:, None, None] ** 2 * np.eye(n_L)
                theta, _ = identification.identify_parameters(
                    identification.inertial_regressors(X), Y, K, given.prior_std
                )
                model = dataclasses.replace(
                    model,
                    inertial_parameters=jnp.asarray(
                        identification.enforce_physical_consistency(theta, given.nominal_payload)
                    ),
                )
            elif self.renewals is not None:
                changed = self._look(model, recorder_state, self.renewals)
                model = self._renew(model, recorder_state, self.renewals, t, fit)
            else:
                model, self.fits = model_update.fit(model, recorder_state, self.training, self.fits)
            self.last = max(self.last, recorder_state.latest_time())
        except (ValueError, np.linalg.LinAlgError) as error:
            failed, changed = f"what was learned at t = {t:.3f} s is not used: {error}", ()
            vars(self).update(before)
            log.warning("%s", failed)
        seen = self.data or recorder_state
        n = {"payload": int(seen.payload.n), "agents": sum(int(data.n.sum()) for data in seen.agents)}
        update = ModelUpdate(
            t=t,
            activation_time=t,
            num_samples=n,
            fits=self.fits,
            theta=np.asarray(model.inertial_parameters),
            change_points=changed,
            refitted=self.misfits,
            mean_uncertainties=self.doubts,
            error_message=failed,
        )
        return model, update

    def _memory(self) -> dict[str, Any]:
        """What it knows, for the case that it learns nothing; copies of what is changed in place."""
        usual = {body: [*of] for body, of in self.usual.items()}
        copies = {"usual": usual, "changes": {**self.changes}, "covariances": {**self.covariances}}
        return vars(self) | copies | {"misfits": ()}

    def _renew(
        self,
        model: residual_model.ResidualModel,
        recorder_state: recorder.RecorderState,
        given: OnlineUpdateOptions,
        t: float,
        fit: bool,
    ) -> residual_model.ResidualModel:
        """The oracle with what has been said since the last look; the same one where that is nothing new."""
        said, waited = recorder_state.latest_time() > self.last, self.waiting
        self.waiting = self.waiting if said else set()
        if not said and not waited:
            return model
        before = jax.tree.map(jnp.zeros_like, recorder_state) if self.data is None else self.data
        data = model_update.select_samples(
            model, before, recorder_state, self.last, t, given.forgetting_time, self.changes
        )
        data = self._over(data, fit)
        if "payload" in self.changes:
            model = semiparametric.update_inertial_mean(model, self.changes["payload"], data, given.mean)
        bodies = [
            body for body in (model_update.samples_by_body(data) if fit else self.misfits) if body not in self.changes
        ]
        if bodies and self.training is not None:
            model, self.fits, new = semiparametric.fit(
                model, data, self.training, given.mean, self.fits, bodies, self.changes, self.waiting
            )
            self.covariances |= new
        else:
            model = model_update.condition(model, data, self.changes, self.waiting)
        self.doubts = semiparametric.mean_uncertainties(model, data, self.covariances, self.changes)
        self.data = data
        return model

    def _over(self, data: recorder.RecorderState, fit: bool) -> recorder.RecorderState:
        """The samples without those of before changes that are over: of misfits, and where none is left at a fit."""
        seen = model_update.samples_by_body(data)
        alone = {body for body, change in self.changes.items() if seen[body][2].min() >= change.time} - self.waiting
        over = {*self.misfits, *(alone if fit else ())}
        since = {body: self.changes[body].time for body in self.misfits}
        self.changes = {body: change for body, change in self.changes.items() if body not in over}
        return model_update.drop_before(data, since) if since else data

    def _look(
        self, oracle: residual_model.ResidualModel, recorder_state: recorder.RecorderState, given: OnlineUpdateOptions
    ) -> tuple[features.BodyKey, ...]:
        """The bodies for which the world has changed since the last look, each noted with the first that said so.

        While a model of before a change waits it is not asked. When there are enough for a new one that one is, held
        against its own samples, each left out: where these surprise as much as the newest do it is no other world but
        a misfit, whose hyperparameters and mean are to be fitted anew, of samples since.
        """
        found, misfits, seen = [], [], model_update.samples_by_body(self.data or recorder_state)
        since = {body: int((seen[body][2] >= change.time).sum()) for body, change in self.changes.items()}
        few = {body for body, n in since.items() if n < given.min_samples}
        new = self.waiting - few
        requested = (
            model_update.condition(oracle, self.data, self.changes, few) if new and self.data is not None else oracle
        )

        def most(before: list[float]) -> float:
            return given.nis_threshold * max(1.0, float(np.median(before))) if before else np.inf

        for body, (t, off) in semiparametric.normalized_innovation_squared(
            requested, recorder_state, self.doubts, self.last
        ).items():
            model, score = residual_model.get_model(requested, body), float(off.mean())
            if body in few or int(model.num_points) < given.min_samples / 3:  # it knows no world yet
                continue
            usual = self.usual.setdefault(body, [])
            before = [model_update.loo_normalized_error(model, since[body])] if body in new else usual
            if score > most(before):
                self.changes[body] = model_update.make_change_point(
                    requested, body, float(t[np.argmax(off > most(before))]) + given.transient_time
                )
                found.append(body)
            elif score > most(usual) and self.training is not None:
                misfits.append(body)
            else:
                usual.append(score)
        self.misfits, self.waiting = tuple(misfits), few | set(found)
        return tuple(found)
