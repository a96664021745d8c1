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
class Renewals:
    """Oracles that go on: newer samples every so often; where the world has changed, the older ones amended.

    Of all samples so far those are kept that tell most, the newer ones rather (`learn.kept`).

    As long as labels correct it, a model from before the change does better than one of few new samples, and flies on.
    Once they are silent the new samples speak where the team has been again.
    """

    times: tuple[float, ...]  # s
    surprise: float  # mean of `place.surprise` above which a body's world has changed, over what is usual for it
    settle: float  # s after the first sample that surprises, until which those that come speak of no world
    enough: int  # samples after a change for a new model; until then what surprises is the same change
    age: float  # s, after which the noise of a sample counts twice when it is decided which are kept
    mean: semiparametric.Mean  # of what maps hold beside GPs of the place


@dataclasses.dataclass(frozen=True)
class Identify:
    """What parametric identification assumes."""

    noise: np.ndarray  # (6,) deviation of the payload's labels, N and N m
    prior: np.ndarray  # (10,) deviation of each rigid-body parameter
    believed: Payload  # of which a tenth is always left


@dataclasses.dataclass(frozen=True)
class Regress:
    """What regression on `learn.basis` assumes."""

    ridge: tuple[float, float]  # beside the sum of squared label errors, of squared weights: forces, all other outputs


@dataclasses.dataclass(frozen=True)
class Update:
    """What one update learned."""

    t: float  # s, when its samples were taken
    ready: float  # s, from when on it flew
    n: dict[str, int]  # samples: of the payload, of all agents together
    fits: model_update.Fits
    theta: np.ndarray  # (10,)
    changed: tuple[features.Body, ...] = ()  # whose older samples are amended from now on
    misfits: tuple[features.Body, ...] = ()  # whose are gone, and whose hyperparameters and means are fitted anew
    doubts: semiparametric.Doubts = dataclasses.field(default_factory=dict)
    failed: str = ""  # why the oracle before it stays


class School:
    """What is learned on the ground in one flight: the last fits, and what was known before the world changed."""

    def __init__(
        self, training: model_update.Training | None, identify: Identify | Regress | None, renewals: Renewals | None
    ) -> None:
        self.training, self.identify, self.renewals = training, identify, renewals
        self.fits: model_update.Fits = {}
        self.changes: dict[features.Body, model_update.Change] = {}
        self.usual: dict[features.Body, list[float]] = {}  # means of `place.surprise` that were no change
        self.covariances: dict[features.Body, np.ndarray] = {}  # of means
        self.doubts: semiparametric.Doubts = {}
        self.waiting: set[features.Body] = set()  # those that have seen too little since for a new model
        self.misfits: tuple[features.Body, ...] = ()  # those whose first model since does not fit
        self.last = 0.0  # s, of the newest sample that an oracle has seen
        self.data: recorder.Recorded | None = None  # kept of all samples until then, where learning goes on

    def teach(
        self, oracle: residual_model.Oracle, recorded: recorder.Recorded, t: float, fit: bool
    ) -> tuple[residual_model.Oracle, Update]:
        """The oracle of what was recorded until t, s: GPs, with hyperparameters fitted or kept, or parameters.

        Where a fit fails the oracle stays as it was, and the update says why.
        """
        failed, changed, before = "", (), self._memory()
        try:
            if isinstance(self.identify, Regress):
                oracle = ridge_regression.regress(oracle, recorded, self.identify.ridge)
            elif self.identify is not None:
                n_L, given = int(recorded.payload.n), self.identify
                X, Y = np.asarray(recorded.payload.X)[:n_L], np.asarray(recorded.payload.Y)[:n_L]
                K = given.noise[:, None, None] ** 2 * np.eye(n_L)
                theta, _ = identification.identify(identification.inertial(X), Y, K, given.prior)
                oracle = dataclasses.replace(oracle, theta=jnp.asarray(identification.possible(theta, given.believed)))
            elif self.renewals is not None:
                changed = self._look(oracle, recorded, self.renewals)
                oracle = self._renew(oracle, recorded, self.renewals, t, fit)
            else:
                oracle, self.fits = model_update.teach(oracle, recorded, self.training, self.fits)
            self.last = max(self.last, recorded.newest())
        except (ValueError, np.linalg.LinAlgError) as error:
            failed, changed = f"what was learned at t = {t:.3f} s is not used: {error}", ()
            vars(self).update(before)
            log.warning("%s", failed)
        seen = self.data or recorded
        n = {"payload": int(seen.payload.n), "agents": sum(int(data.n.sum()) for data in seen.agents)}
        update = Update(
            t=t,
            ready=t,
            n=n,
            fits=self.fits,
            theta=np.asarray(oracle.theta),
            changed=changed,
            misfits=self.misfits,
            doubts=self.doubts,
            failed=failed,
        )
        return oracle, update

    def _memory(self) -> dict[str, Any]:
        """What it knows, for the case that it learns nothing; copies of what is changed in place."""
        usual = {body: [*of] for body, of in self.usual.items()}
        copies = {"usual": usual, "changes": {**self.changes}, "covariances": {**self.covariances}}
        return vars(self) | copies | {"misfits": ()}

    def _renew(
        self, oracle: residual_model.Oracle, recorded: recorder.Recorded, given: Renewals, t: float, fit: bool
    ) -> residual_model.Oracle:
        """The oracle with what has been said since the last look; the same one where that is nothing new."""
        said, waited = recorded.newest() > self.last, self.waiting
        self.waiting = self.waiting if said else set()
        if not said and not waited:
            return oracle
        before = jax.tree.map(jnp.zeros_like, recorded) if self.data is None else self.data
        data = model_update.kept(oracle, before, recorded, self.last, t, given.age, self.changes)
        data = self._over(data, fit)
        if "payload" in self.changes:
            oracle = semiparametric.heavier(oracle, self.changes["payload"], data, given.mean)
        bodies = [body for body in (model_update.raw(data) if fit else self.misfits) if body not in self.changes]
        if bodies and self.training is not None:
            oracle, self.fits, new = semiparametric.teach(
                oracle, data, self.training, given.mean, self.fits, bodies, self.changes, self.waiting
            )
            self.covariances |= new
        else:
            oracle = model_update.renew(oracle, data, self.changes, self.waiting)
        self.doubts = semiparametric.doubts(oracle, data, self.covariances, self.changes)
        self.data = data
        return oracle

    def _over(self, data: recorder.Recorded, fit: bool) -> recorder.Recorded:
        """The samples without those of before changes that are over: of misfits, and where none is left at a fit."""
        seen = model_update.raw(data)
        alone = {body for body, change in self.changes.items() if seen[body][2].min() >= change.since} - self.waiting
        over = {*self.misfits, *(alone if fit else ())}
        since = {body: self.changes[body].since for body in self.misfits}
        self.changes = {body: change for body, change in self.changes.items() if body not in over}
        return model_update.since(data, since) if since else data

    def _look(
        self, oracle: residual_model.Oracle, recorded: recorder.Recorded, given: Renewals
    ) -> tuple[features.Body, ...]:
        """The bodies for which the world has changed since the last look, each noted with the first that said so.

        While a model of before a change waits it is not asked. When there are enough for a new one that one is, held
        against its own samples, each left out: where these surprise as much as the newest do it is no other world but
        a misfit, whose hyperparameters and mean are to be fitted anew, of samples since.
        """
        found, misfits, seen = [], [], model_update.raw(self.data or recorded)
        since = {body: int((seen[body][2] >= change.since).sum()) for body, change in self.changes.items()}
        few = {body for body, n in since.items() if n < given.enough}
        new = self.waiting - few
        asked = model_update.renew(oracle, self.data, self.changes, few) if new and self.data is not None else oracle

        def most(before: list[float]) -> float:
            return given.surprise * max(1.0, float(np.median(before))) if before else np.inf

        for body, (t, off) in semiparametric.surprise(asked, recorded, self.doubts, self.last).items():
            model, score = residual_model.of_body(asked, body), float(off.mean())
            if body in few or int(model.n) < given.enough / 3:  # it knows no world yet
                continue
            usual = self.usual.setdefault(body, [])
            before = [model_update.left_out(model, since[body])] if body in new else usual
            if score > most(before):
                self.changes[body] = model_update.changed(
                    asked, body, float(t[np.argmax(off > most(before))]) + given.settle
                )
                found.append(body)
            elif score > most(usual) and self.training is not None:
                misfits.append(body)
            else:
                usual.append(score)
        self.misfits, self.waiting = tuple(misfits), few | set(found)
        return tuple(found)
