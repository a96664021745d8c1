"""Maps that know what a body is: a mean of mass, drag and rotors' thrust, and GPs of the place for the rest (host).

A GP of all that is measured says what its prior says as soon as the team is somewhere else, faster or otherwise turned.
Here the forces of all bodies and the payload's moment are `y = Phi(x) beta + f(p) + noise`: Phi `beside` the GPs what a
body's mass, its first moments, drag and thrust do (`learn.regressor`, `learn.Air`), f a GP of the place p alone, as a
field of wind is. An agent's moments and joints keep GPs of all its features.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial.distance import cdist

from colift import gp
from colift.models.parameters import Payload
from colift.onboard.learning import features, identification, mean_functions, model_update, recorder, residual_model

BLOCKS = {True: ((0, 1, 2), (3, 4, 5)), False: ((0, 1, 2),)}  # outputs that share hyperparameters: payload's, agent's
ROWS = 128  # samples whose regressors are computed at once, or twice as many, ..: few shapes, few programs
PLACE = {"p_x", "p_y", "p_z", "x_x", "x_y", "x_z"}  # features


@dataclasses.dataclass(frozen=True)
class Mean:
    """Prior deviations of what a mean holds, and the payload as it is believed to be, of which a tenth is left."""

    payload: np.ndarray  # (14,) mass, kg, first moments, kg m, drag, N s/m, its lever's, N s, constants, N and N m
    agents: np.ndarray  # (5,) drag, N s/m, thrust, N, constants, N
    believed: Payload


@dataclasses.dataclass(frozen=True)
class Unsure:
    """Of a body's mean, what its error does to predictions."""

    told: np.ndarray  # (outputs, points, parameters), `K_i^-1 Phi_i` of the model's points
    covariance: np.ndarray  # of the parameters


Doubts = Mapping[features.Body, Unsure]
"""Of every body with a mean of its own; one whose world has changed keeps its mean as if it were known."""


def of_place(belief: gp.Belief, names: Sequence[str], payload: bool) -> gp.Belief:
    """A belief in which forces, and a payload's moment, look at the place alone.

    Features of one's own without a place among their names stay as they are.
    """
    elsewhere = np.array([name not in PLACE for name in names])
    if elsewhere.all():
        return belief
    rows, columns = np.concatenate(BLOCKS[payload]), np.flatnonzero(elsewhere)
    scale = belief.median.lengthscales.at[np.ix_(rows, columns)].set(gp.UNSEEN)
    return dataclasses.replace(belief, median=dataclasses.replace(belief.median, lengthscales=scale))


def teach(
    oracle: residual_model.Oracle,
    recorded: recorder.Recorded,
    training: model_update.Training,
    mean: Mean,
    last: model_update.Fits,
    bodies: Collection[features.Body],
    changes: model_update.Changes = MappingProxyType({}),
    waiting: Collection[features.Body] = (),
) -> tuple[residual_model.Oracle, model_update.Fits, dict[features.Body, np.ndarray]]:
    """The oracle on the data so far, means and hyperparameters of bodies fitted anew, with the means' covariances.

    None of those is to be one whose world has changed, as what is left of before is no data for a mean. All others are
    renewed. Host.
    """
    found = {body: (x, Y) for body, (x, Y, _) in model_update.raw(recorded).items() if len(x) > 1 and body in bodies}
    learned = model_update.side_by_side(
        lambda body: _fit(oracle, body, *found[body], training, mean, last.get(body)), found
    )
    models = {}
    for body, (fit, beta, _) in learned.items():
        oracle = with_mean(oracle, body, beta, mean.believed)
        models[body] = dataclasses.replace(residual_model.of_body(oracle, body), hyper=fit.hyper)
    fits = {**last, **{body: fit for body, (fit, _, _) in learned.items()}}
    taught = model_update.renew(residual_model.with_bodies(oracle, models), recorded, changes, waiting)
    taught = dataclasses.replace(taught, k=oracle.k + 1)  # one update
    return taught, fits, {body: covariance for body, (_, _, covariance) in learned.items()}


def doubts(
    oracle: residual_model.Oracle,
    recorded: recorder.Recorded,
    covariances: Mapping[features.Body, np.ndarray],
    changes: model_update.Changes,
) -> Doubts:
    """What errors of means do to predictions of an oracle that was renewed on these data (host)."""
    found, samples = {}, model_update.raw(recorded)
    for body in covariances.keys() - changes.keys():
        model, Phi = residual_model.of_body(oracle, body), regressors(samples[body][0], isinstance(body, str))
        W = np.asarray(model.W)[: Phi.shape[1], : len(Phi), : len(Phi)]
        told = np.stack([w.T @ (w @ Phi[:, i]) for i, w in enumerate(W)])
        found[body] = Unsure(told=told, covariance=covariances[body])
    return found


def doubt(model: gp.GP, unsure: Unsure, Z: np.ndarray, Phi: np.ndarray) -> np.ndarray:
    """Variance that the mean's error adds, (samples, outputs): `g C g^T`, `g_i = phi_i - k_i^T K_i^-1 Phi_i` (host).

    Rasmussen and Williams 2006, Eq. 2.42.
    """
    h, n = model.hyper, unsure.told.shape[1]
    out = np.zeros((len(Z), len(h.signal_variance)))
    for i, told in enumerate(unsure.told):
        r2 = cdist(
            Z / np.asarray(h.lengthscales)[i], np.asarray(model.X)[:n] / np.asarray(h.lengthscales)[i], "sqeuclidean"
        )
        k = float(h.signal_variance[i]) * h.kernel.on_host(r2)[0]
        g = Phi[:, i] - k @ told
        out[:, i] = np.einsum("np,pq,nq->n", g, unsure.covariance, g, optimize=True)
    return out


def heavier(
    oracle: residual_model.Oracle, change: model_update.Change, recorded: recorder.Recorded, mean: Mean
) -> residual_model.Oracle:
    """The oracle with what a payload whose world has changed has more of mass and first moments than before (host).

    A GP cannot hold that where the team has not been: it goes with the acceleration. What else labels since then say
    beyond the model from before is a function of what that one looks at, and noise.
    """
    before = dataclasses.replace(oracle, theta=change.theta)
    x, _, t = model_update.raw(recorded)["payload"]
    Z, Y, _ = model_update.samples(before, recorded, {"payload": change})["payload"]
    theta = np.array(change.theta)
    if len(Y):
        Phi, K = regressors(x[t >= change.since], payload=True)[:, :, :4], gp.grams(Z, change.model.hyper)
        more, _ = identification.identify(Phi, Y - residual_model.told(change.model, Z)[0], K, mean.payload[:4])
        theta[:4] += more
    return dataclasses.replace(oracle, theta=jnp.asarray(identification.possible(theta, mean.believed)))


def surprise(
    oracle: residual_model.Oracle, recorded: recorder.Recorded, doubts: Doubts, after: float
) -> dict[features.Body, tuple[np.ndarray, np.ndarray]]:
    """Of every body that has been taught, times of its samples since `after`, s, and how far each lies off (host).

    The mean over outputs of `(y - mean)^2 / (variance + noise_variance)`: about 1 where the model holds. Where no data
    were near, the variance is large, and nothing surprises.
    """
    found, raw = {}, model_update.raw(recorded)
    for body, (Z, Y, t) in model_update.samples(oracle, recorded).items():
        model, new = residual_model.of_body(oracle, body), t > after + 1e-9
        if int(model.n) and new.any():
            mean, variance = residual_model.told(model, Z[new])
            if body in doubts:
                Phi = regressors(raw[body][0][new], isinstance(body, str))
                variance = variance + doubt(model, doubts[body], Z[new], Phi)
            off = (Y[new] - mean) ** 2 / (variance + np.asarray(model.hyper.noise_variance))
            found[body] = t[new], off.mean(1)
    return found


def _fit(
    oracle: residual_model.Oracle,
    body: features.Body,
    x: np.ndarray,
    Y: np.ndarray,
    training: model_update.Training,
    mean: Mean,
    before: gp.Fit | None,
) -> tuple[gp.Fit, np.ndarray, np.ndarray]:
    """A body's hyperparameters, what its mean holds, and the covariance of that."""
    Z, belief, payload = features.features(oracle.features, body, x), training.of(body), isinstance(body, str)
    m, blocks = Y.shape[1], BLOCKS[payload]
    held = len(blocks) * 3
    Phi = regressors(x, payload)
    found = gp.fit_parametric(
        Z,
        Y[:, :held],
        Phi,
        mean.payload if payload else mean.agents,
        blocks,
        belief,
        start=None if before is None else before.hyper,
        max_iterations=training.max_iterations,
    )
    hyper = dataclasses.replace(found.hyper, offset=jnp.asarray(found.theta[-held:]))
    scale = np.asarray(found.hyper.lengthscales) / gp.spread(Z)
    fit = gp.Fit(
        hyper=hyper,
        log_likelihood=found.log_likelihood,
        lengthscales=scale,
        at_lower=np.zeros(scale.shape, bool),
        at_upper=np.zeros(scale.shape, bool),
        evaluations=found.evaluations,
        converged=np.full(held, found.converged),
    )
    if m == held:
        return fit, found.theta, found.covariance
    rest = slice(held, m)
    more = gp.fit(
        Z,
        Y[:, rest],
        belief=dataclasses.replace(belief, median=gp.of_outputs(belief.median, rest)),
        start=None if before is None else gp.of_outputs(before.hyper, rest),
        restarts=0 if before else training.restarts,
        max_iterations=training.max_iterations,
    )
    return gp.both(fit, more), found.theta, found.covariance


def regressors(x: np.ndarray, payload: bool) -> np.ndarray:
    """`Phi(x)`, (samples, 6 or 3, parameters): what each parameter of a mean does at a body's samples."""
    full = np.pad(x, ((0, -len(x) % ROWS), (0, 0)))
    return np.asarray((_of_payload if payload else _of_agent)(jnp.asarray(full)))[: len(x)]


@jax.jit
def _of_payload(x: Float[Array, "samples 24"]) -> Float[Array, "samples 6 14"]:
    def one(x: Float[Array, "24"]) -> Float[Array, "6 14"]:
        inertial = identification.regressor(identification.state_of(x), x[18:21], x[21:24])[:, :4]
        air = jax.jacfwd(lambda b: mean_functions.Air(payload=b, agents=()).on_payload(x))(jnp.zeros(4))
        return jnp.concatenate([inertial, air, jnp.eye(6)], axis=1)

    return jax.vmap(one)(x)


@jax.jit
def _of_agent(x: Float[Array, "samples inputs"]) -> Float[Array, "samples 3 5"]:
    def one(x: Float[Array, "inputs"]) -> Float[Array, "3 5"]:
        air = lambda b: mean_functions.Air(payload=jnp.zeros(4), agents=(b[None],)).on_agents(0, x[None])[0, :3]  # noqa: E731
        return jnp.concatenate([jax.jacfwd(air)(jnp.zeros(2)), jnp.eye(3)], axis=1)

    return jax.vmap(one)(x)


def with_mean(
    oracle: residual_model.Oracle, body: features.Body, beta: np.ndarray, believed: Payload
) -> residual_model.Oracle:
    """The oracle with what a body's mean holds, but for its constants, which are the GP's offset."""
    air = oracle.known
    assert isinstance(air, mean_functions.Air)
    if isinstance(body, str):
        theta = jnp.asarray(identification.possible(np.concatenate([beta[:4], np.zeros(6)]), believed))
        return dataclasses.replace(oracle, theta=theta, known=dataclasses.replace(air, payload=jnp.asarray(beta[4:8])))
    i, j = body
    agents = (*air.agents[:i], air.agents[i].at[j].set(beta[:2]), *air.agents[i + 1 :])
    return dataclasses.replace(oracle, known=dataclasses.replace(air, agents=agents))
