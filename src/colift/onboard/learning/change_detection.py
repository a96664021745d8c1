"""Detection of abrupt changes of the residual by Bayes factors.

At a model update, two hypotheses are compared for the new samples of a body: no abrupt change, or a change point at one
of several times since the last update. The likelihoods are those of the new samples given the earlier ones. All
functions run on the host.

See Also:
    colift.gp.time_variation: covariance of the change at a change point.
    docs/learning: equations.

References:
    Willsky, Jones, *A generalized likelihood ratio approach to the detection and estimation of jumps in linear
    systems*, IEEE TAC 1976. Rasmussen, Williams, *Gaussian Processes for Machine Learning*, 2006, Section 5.2.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from colift import gp
from colift.onboard.learning import features, model_update, residual_model, semiparametric

NUM_CANDIDATES = 5
"""Number of times of an update interval that are tested as change points."""


def detect_changes(
    model: residual_model.ResidualModel,
    samples: model_update.SamplesByBody,
    fitted: model_update.Fits,
    mean_prior: semiparametric.MeanPrior,
    variations: semiparametric.Variations,
    last_sample_time: float,
) -> dict[features.BodyKey, model_update.Variation]:
    """Add a change point to every body whose new samples support one.

    Args:
        model: Residual model with the hyperparameters.
        samples: Earlier and new samples by body.
        fitted: Hyperparameter fits; bodies without one are left out.
        mean_prior: Prior of the mean parameters.
        variations: Changes of the residual with time, by body.
        last_sample_time: Time of the last sample of the previous update [s]; later samples are new.

    Returns:
        The changes of the bodies with a new change point.
    """
    tested = [
        body
        for body, (_, _, t) in samples.items()
        if body in fitted and (t > last_sample_time).any() and (t <= last_sample_time).any()
    ]

    def test(body: features.BodyKey) -> float | None:
        times, log_factors = log_bayes_factors(
            model, body, samples[body], mean_prior, variations[body], last_sample_time
        )
        best = int(np.argmax(log_factors))
        # no change and a change at any of the times have equal prior probabilities
        return float(times[best]) if log_factors[best] > np.log(len(times)) else None

    found = model_update.parallel_map(test, tested)
    return {
        body: dataclasses.replace(variations[body], times=(*variations[body].times, time))
        for body, time in found.items()
        if time is not None
    }


def log_bayes_factors(
    model: residual_model.ResidualModel,
    body: features.BodyKey,
    samples: model_update.Samples,
    mean_prior: semiparametric.MeanPrior,
    variation: model_update.Variation,
    last_sample_time: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the log Bayes factors of change points against no change.

    Let ``e`` and ``S`` be the innovations of the new samples of an output and their covariance, given the earlier
    samples. A change point adds ``C`` to ``S`` for samples after it: the covariance of the change of parameters and of
    ``f``. The log Bayes factor is the sum over outputs of ``log N(e; 0, S + C) - log N(e; 0, S)``.

    Args:
        model: Residual model with the hyperparameters.
        body: Key of the body.
        samples: Earlier and new samples of the body.
        mean_prior: Prior of the mean parameters.
        variation: Earlier changes of the residual of the body.
        last_sample_time: Time of the last sample of the previous update [s]; later samples are new.

    Returns:
        Candidate times [s] and their log Bayes factors.
    """
    (x, Y, t), payload = samples, isinstance(body, str)
    new, hyper = t > last_sample_time, residual_model.get_model(model, body).hyper
    prior = mean_prior.payload if payload else mean_prior.agents
    Z, Phi = features.compute_features(model.features, body, x), semiparametric.mean_regressors(x, payload)
    of_time = semiparametric.time_variation(t, float(t.max()), variation, payload)
    D = of_time.covariance(Z, Phi, prior, hyper, variation.rate)
    B = of_time.parameter_covariance(Phi, prior)
    recent = t[new]
    times = recent[:: -(-len(recent) // NUM_CANDIDATES)]
    after = (recent[None] >= times[:, None]).astype(float)
    both_after = after[:, :, None] * after[:, None]
    log_factors = np.zeros(len(times))
    for i in range(Phi.shape[1]):
        K = gp.function_covariance(Z, hyper, i)
        change = (gp.JUMP_SHARE * K + B[i])[np.ix_(new, new)]
        scaled = Phi[:, i] * prior
        K = K + scaled @ scaled.T + D[i]
        K.flat[:: len(K) + 1] += float(hyper.noise_variance[i])
        cross = K[np.ix_(~new, new)]
        explained = cho_solve(cho_factor(K[np.ix_(~new, ~new)], lower=True), np.column_stack([cross, Y[~new, i]]))
        S = K[np.ix_(new, new)] - cross.T @ explained[:, :-1]
        e = Y[new, i] - cross.T @ explained[:, -1]
        log_likelihoods = _log_densities(e, np.concatenate([S[None], S + both_after * change]))
        log_factors += log_likelihoods[1:] - log_likelihoods[0]
    return times, log_factors


def _log_densities(e: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Return ``log N(e; 0, S)`` for several covariances, without the constant term."""
    L = np.linalg.cholesky(S)
    z = np.linalg.solve(L, np.broadcast_to(e[:, None], (len(S), len(e), 1)))[..., 0]
    return -0.5 * (z * z).sum(-1) - np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum(-1)
