"""Transfer of frozen residual models, learned on one path, to other conditions.

All models use the data of one flight of C3 on `paper` with preview, until its last update:

- `full`: the Gaussian processes of the paper.
- `relevant`: without the features of each output whose length-scale exceeds `MAX_LENGTHSCALE_RATIO` standard
  deviations of the data; hyperparameters are fitted again.
- `place`: the model of `adaptive` (`colift.onboard.learning.semiparametric`). It has a parametric mean of mass, first
  moments, drag and thrust bias. Forces and the payload's moment have Gaussian processes of the position only.
- `rigid`: this mean, and the paper's Gaussian processes of the remainder.
- `field`: like `place`, with one spatial force field for all bodies. Its covariance for bodies b and c is
  `(g_b g_c + o_b^2 [b = c]) k(x, z)`.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from scipy.optimize import minimize

from colift import gp, scenario
from colift.analysis import metrics
from colift.closed_loop import flight, signals, simulator, termination
from colift.onboard.control import preview
from colift.onboard.learning import (
    identification,
    mean_functions,
    model_update,
    recorder,
    residual_model,
    semiparametric,
)
from colift.onboard.learning.features import BodyKey, compute_features
from colift.onboard.learning.online_learner import OnlineLearner
from colift.scenario import Scenario, controllers, experiment, priors
from evidence import collect

WIND = "disturbances.{}.mean_wind_mps=[-0.8, 1.6, 0]"
HEAVIER = ("payload.mass_kg=1.8", "payload.inertia_kgm2=[0.048, 0.18, 0.216]")
CONDITIONS: dict[str, tuple[str, ...]] = {
    "home": (),
    "wind": (WIND.format(0), WIND.format(4)),  # the mean turned by 90 degrees
    "speed": ("reference.period_s=3.3333333333333335",),
    "larger": ("reference.amplitude_m=[0.96, 0.72, 0.36]",),
    "moved": ("reference.center_m=[0.3, 0, 2]",),
    "backwards": ("reference.phase_deg=[180, 90, 150]",),  # sin(-w t + phase) is sin(w t + 180 - phase)
    "payload": HEAVIER,
    "weighed": (*HEAVIER, "nominal.payload={mass_kg: 1.5, inertia_kgm2: [0.038, 0.15, 0.186]}"),  # known mass step
    "attitude": ("reference.rotation_amplitude_deg=[8, 8, 12]", "reference.rotation_period_s=[4, 5, 6]"),
}
MODELS = ("full", "relevant", "rigid", "place", "field")
CASES = (
    "true_residual",
    "label_feedback",
    *MODELS,
    "full with labels",
    "place with labels",
)  # the last two: with correction as in gp_label_feedback
SEEDS = range(3)
MAX_LENGTHSCALE_RATIO = 10.0


def settings(condition: str, seed: int) -> Scenario:
    """Return the paper's scenario in another condition, with preview."""
    preview_step = f"control.preview_step_s={preview.PREVIEW_STEP}"
    return scenario.load_scenario("paper", [preview_step, *CONDITIONS[condition], f"seed={seed}"])


@dataclasses.dataclass(frozen=True)
class TrainingFlight:
    """Result of a flight: residual model of the last update, its data and its fits."""

    model: residual_model.ResidualModel
    dataset: recorder.RecorderState
    fits: model_update.Fits
    training: model_update.FitOptions  # of the paper's GPs
    position_options: model_update.FitOptions
    mean: semiparametric.MeanPrior


def simulate_frozen(
    frozen: flight.Experiment, until: float, loop: simulator.LoopState, model: residual_model.ResidualModel
) -> tuple[Any, Any]:
    """Simulate with a frozen residual model until a time [s]; return the loop state and the records."""
    setup = dataclasses.replace(
        frozen.loop_config, controller=dataclasses.replace(frozen.controller, residual_model=model)
    )
    chunk, key, logged = (
        flight.ticks_per_chunk(frozen),
        jax.random.fold_in(jax.random.key(frozen.seed), 2),
        [],
    )
    done, ticks = int(loop.tick), round(until / frozen.dt)
    while done < ticks and not int(loop.termination):
        noise = DRAW(frozen.world, jax.random.fold_in(key, done), chunk)
        loop, rows = simulator.rollout(setup, loop, noise, jnp.asarray(min(chunk, ticks - done)))
        logged.append(jax.tree.map(lambda x, n=int(loop.tick) - done: np.asarray(x)[:n], rows))
        done = int(loop.tick)
    return loop, jax.tree.map(lambda *x: np.concatenate(x), *logged)


DRAW = jax.jit(lambda world, key, ticks: world.sample_noise(key, ticks), static_argnums=2)


@functools.cache
def training_flight(seed: int) -> TrainingFlight:
    """Simulate C3 in nominal conditions until its last update."""
    scenario_settings = settings("home", seed)
    c3 = experiment.make_experiment(scenario_settings, "C3")
    learner, model = (
        OnlineLearner(c3.fit_options, c3.identification, c3.online_updates),
        c3.controller.residual_model,
    )
    loop = simulator.reset(c3.loop_config, c3.initial_state)
    for t in c3.update_times:
        loop, _ = simulate_frozen(c3, t, loop, model)
        model, _ = learner.update(model, loop.controller.recorder, t, fit=True)
    assert c3.fit_options is not None
    model = dataclasses.replace(
        model, mean_function=mean_functions.zero_drag_thrust(c3.controller.team.sizes)
    )  # one program for all
    position_options = priors.position_only_options(scenario_settings, c3.controller.team)
    assert position_options is not None
    return TrainingFlight(
        model=model,
        dataset=loop.controller.recorder,
        fits=learner.fits,
        training=c3.fit_options,
        position_options=position_options,
        mean=priors.mean_prior(scenario_settings, c3.controller.team),
    )


@dataclasses.dataclass(frozen=True)
class ModelWithUncertainty:
    """Residual model, and the uncertainty of its mean by body."""

    model: residual_model.ResidualModel
    uncertainties: semiparametric.MeanUncertainties = dataclasses.field(default_factory=dict)


@functools.cache
def fit_model(model: str, seed: int) -> ModelWithUncertainty:
    """Return the residual model of a kind, fitted to the samples of C3."""
    flight_data = training_flight(seed)
    match model:
        case "full":
            return ModelWithUncertainty(flight_data.model)
        case "relevant":
            return ModelWithUncertainty(fit_relevant(flight_data))
        case "place":
            return fit_place(flight_data)
        case "rigid":
            return fit_rigid(flight_data)
        case _:
            return fit_field(flight_data)


def bodies(flight_data: TrainingFlight) -> Iterator[tuple[BodyKey, np.ndarray, np.ndarray]]:
    """Yield raw samples and labels of every body, the payload first."""
    for body, (X, Y, _) in model_update.samples_by_body(flight_data.dataset).items():
        yield body, X, Y


def features_of(flight_data: TrainingFlight, body: BodyKey, X: np.ndarray) -> np.ndarray:
    """Return the paper's features of a body's samples."""
    return compute_features(flight_data.model.features, body, X)


def with_models(
    fitted: residual_model.ResidualModel, models: dict[BodyKey, gp.GPPosterior], **replacements: Any
) -> residual_model.ResidualModel:
    """Return the residual model with other GPs of all bodies."""
    groups = []
    for i, group in enumerate(fitted.agents):
        each = [models[i, j] for j in range(len(group.num_points))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    return dataclasses.replace(fitted, payload=models["payload"], agents=tuple(groups), **replacements)


def fit_relevant(flight_data: TrainingFlight) -> residual_model.ResidualModel:
    """Return the model with the relevant features of each output only, with refitted hyperparameters."""
    models = {}
    for body, X, Y in bodies(flight_data):
        Z, before, stated = (
            features_of(flight_data, body, X),
            flight_data.fits[body],
            flight_data.training.prior_for(body),
        )
        hyper = before.hyper
        for i, scale in enumerate(before.lengthscales):
            kept = np.flatnonzero(scale < max(MAX_LENGTHSCALE_RATIO, 1.001 * scale.min()))
            fit = gp.fit(
                Z[:, kept],
                Y[:, i : i + 1],
                hyperprior=dataclasses.replace(stated, median=single_output(stated.median, i, kept)),
                start=single_output(hyper, i, kept),
                restarts=flight_data.training.restarts,
                max_iterations=flight_data.training.max_iterations,
            )
            hyper = dataclasses.replace(
                hyper,
                signal_variance=hyper.signal_variance.at[i].set(fit.hyper.signal_variance[0]),
                lengthscales=hyper.lengthscales.at[i]
                .set(gp.INACTIVE_LENGTHSCALE)
                .at[i, kept]
                .set(fit.hyper.lengthscales[0]),
                noise_variance=hyper.noise_variance.at[i].set(fit.hyper.noise_variance[0]),
            )
        models[body] = gp.condition(Z, Y, hyper, flight_data.model.payload.capacity)
    return with_models(flight_data.model, models)


def single_output(hyper: gp.Hyperparameters, i: int, kept: np.ndarray) -> gp.Hyperparameters:
    """Return one output's hyperparameters over some features."""
    one = slice(i, i + 1)
    return gp.Hyperparameters(
        kernel=hyper.kernel,
        signal_variance=hyper.signal_variance[one],
        lengthscales=hyper.lengthscales[one, kept],
        noise_variance=hyper.noise_variance[one],
        constant_mean=hyper.constant_mean[one],
    )


@dataclasses.dataclass(frozen=True)
class Block:
    """Vectors of several bodies that share one spatial GP and a mean that is linear in parameters."""

    x: np.ndarray  # (n, 3) m, world
    body: np.ndarray  # (n,)
    Y: np.ndarray  # (n, 3) N or N m
    Phi: np.ndarray  # (n, 3, parameters)
    deviation: np.ndarray  # (bodies,) stated, of the field and of noise
    noise: np.ndarray  # (bodies,)
    shared: bool

    @property
    def median(self) -> np.ndarray:
        """Return logarithms of length-scale, individual standard deviations, noise and gains of the prior."""
        gains = [np.log(self.deviation)] if self.shared else []
        return np.concatenate([[0.0], np.log(self.deviation), np.log(self.noise), *gains])

    def covariance(self, log: Any) -> tuple[Any, Any, Any]:
        """Return length-scale, covariance of bodies and noise variances."""
        n = len(self.deviation)
        value = jnp.exp(log)
        own, noise, gain = value[1 : 1 + n], value[1 + n : 1 + 2 * n], value[1 + 2 * n :]
        B = jnp.diag(own**2)
        return value[0], B + jnp.outer(gain, gain) if self.shared else B, noise**2

    def whitened(self, log: Any) -> tuple[Any, Any]:
        """Return `C^-1 [Y, Phi]`, (n, 3, 1 + parameters), and the Cholesky factor C."""
        length, B, noise = self.covariance(log)
        d = (self.x[:, None] - self.x[None]) / length
        K = B[self.body[:, None], self.body[None]] * jnp.exp(-(d * d).sum(-1) / 2) + jnp.diag(noise[self.body])
        C, n = jnp.linalg.cholesky(K), len(self.x)
        right = np.concatenate([self.Y[:, :, None], self.Phi], axis=2)
        return solve_triangular(C, right.reshape(n, -1), lower=True).reshape(right.shape), C


class BlockFit(NamedTuple):
    """Estimates of blocks that share parameters."""

    logs: list[np.ndarray]  # by block
    parameters: np.ndarray
    covariance: np.ndarray  # of them


def fit_blocks(blocks: Sequence[Block], prior: np.ndarray, factor: float) -> BlockFit:
    """Return the hyperparameters of each block at the posterior mode, and the shared parameters."""
    cuts = np.cumsum([len(block.median) for block in blocks])[:-1]
    median = np.concatenate([block.median for block in blocks])

    def normal(log: Any) -> tuple[Any, Any, Any, Any]:
        A, b, square, pivots = jnp.diag(1 / prior**2), jnp.zeros(len(prior)), 0.0, 0.0
        for block, own in zip(blocks, jnp.split(log, cuts), strict=True):
            W, C = block.whitened(own)
            y, F = W[:, :, 0].reshape(-1), W[:, :, 1:].reshape(-1, len(prior))
            A, b, square = A + F.T @ F, b + F.T @ y, square + y @ y
            pivots = pivots + 3 * jnp.log(jnp.diag(C)).sum()
        return A, b, square, pivots

    def cost(log: Any) -> Any:
        A, b, square, pivots = normal(log)
        L = jnp.linalg.cholesky(A)
        u, off = solve_triangular(L, b, lower=True), (log - median) / np.log(factor)
        return 0.5 * (square - u @ u + off @ off) + pivots + jnp.log(jnp.diag(L)).sum()

    value = jax.jit(jax.value_and_grad(cost))
    found = minimize(lambda log: tuple(np.asarray(x, float) for x in value(log)), median, jac=True, method="L-BFGS-B")
    A, b, _, _ = normal(jnp.asarray(found.x))
    covariance = np.linalg.inv(np.asarray(A))
    return BlockFit(np.split(found.x, cuts), covariance @ np.asarray(b), covariance)


PLACE = {True: slice(0, 3), False: slice(9, 12)}  # of features: the payload's, an agent's


def fit_place(flight_data: TrainingFlight) -> ModelWithUncertainty:
    """Return the model of `adaptive` for these data."""
    fitted, _, _ = semiparametric.fit(
        flight_data.model, flight_data.dataset, flight_data.position_options, flight_data.mean, {}
    )
    end = flight_data.dataset.latest_time()
    fitted, covariances = semiparametric.condition(fitted, flight_data.dataset, flight_data.mean, end)
    return ModelWithUncertainty(fitted, semiparametric.mean_uncertainties(fitted, flight_data.dataset, covariances))


def mean_basis(flight_data: TrainingFlight, body: BodyKey, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the basis of a body's mean `(n, 3 or 6, parameters)` and the prior standard deviation of its
    parameters.
    """
    payload = isinstance(body, str)
    return semiparametric.mean_regressors(X, payload), flight_data.mean.payload if payload else flight_data.mean.agents


Member = tuple[BodyKey, np.ndarray, np.ndarray]
FORCE, MOMENT = slice(0, 3), slice(3, 6)


def fit_field(flight_data: TrainingFlight) -> ModelWithUncertainty:
    """Return the mean and spatial GPs, with the forces of all bodies in one field."""
    members, fitted = list(bodies(flight_data)), flight_data.model
    models: dict[BodyKey, gp.GPPosterior] = {}
    uncertainties: dict[BodyKey, semiparametric.MeanUncertainty] = {}
    means = [mean_basis(flight_data, body, X) for body, X, _ in members]
    first = np.cumsum([0, *(len(prior) for _, prior in means)])
    own = [slice(a, b) for a, b in itertools.pairwise(first)]
    Phis = [
        np.pad(Phi, ((0, 0), (0, 0), (at.start, first[-1] - at.stop))) for (Phi, _), at in zip(means, own, strict=True)
    ]
    blocks = [make_block(flight_data, members, Phis, FORCE), make_block(flight_data, members[:1], Phis, MOMENT)]
    found = fit_blocks(blocks, np.concatenate([prior for _, prior in means]), flight_data.training.payload.scale_factor)
    for k, (body, X, Y) in enumerate(members):
        beta = found.parameters[own[k]]
        hyper = with_block_hyperparameters(
            flight_data.fits[body].hyper, body, FORCE, blocks[0].covariance(found.logs[0]), k
        )
        if body == "payload":
            hyper = with_block_hyperparameters(hyper, body, MOMENT, blocks[1].covariance(found.logs[1]), 0)
        fitted = semiparametric.set_mean_parameters(fitted, body, beta, flight_data.mean.nominal_payload)
        constants = beta[8 if body == "payload" else 2 :]
        hyper = dataclasses.replace(hyper, constant_mean=hyper.constant_mean.at[: len(constants)].set(constants))
        rest = Y - parametric_mean(fitted, body, X)
        model = gp.condition(features_of(flight_data, body, X), rest, hyper, flight_data.model.payload.capacity)
        models[body], weighted = joint_posterior(model, weighted_regressors(model, Phis[k]), body, k, blocks[0], found)
        uncertainties[body] = semiparametric.MeanUncertainty(weighted_regressors=weighted, covariance=found.covariance)
    return ModelWithUncertainty(with_models(fitted, models), uncertainties)


def make_block(
    flight_data: TrainingFlight, members: Sequence[Member], Phis: Sequence[np.ndarray], outputs: slice
) -> Block:
    """Return the same three outputs of several bodies."""
    stated = [flight_data.training.prior_for(body).median for body, _, _ in members]
    deviation, noise = (
        np.sqrt([np.asarray(getattr(hyper, name))[outputs.start] for hyper in stated])
        for name in ("signal_variance", "noise_variance")
    )
    return Block(
        x=np.concatenate([X[:, PLACE[body == "payload"]] for body, X, _ in members]),
        body=np.concatenate([np.full(len(X), k) for k, (_, X, _) in enumerate(members)]),
        Y=np.concatenate([Y[:, outputs] for _, _, Y in members]),
        Phi=np.concatenate([Phi[:, outputs] for Phi, _ in zip(Phis, members, strict=False)]),
        deviation=deviation,
        noise=noise,
        shared=len(members) > 1,
    )


def with_block_hyperparameters(
    hyper: gp.Hyperparameters, body: BodyKey, outputs: slice, covariance: tuple[Any, Any, Any], k: int
) -> gp.Hyperparameters:
    """Return hyperparameters of a body with three outputs replaced by those of the k-th body of a block."""
    length, B, noise = covariance
    scale = (
        hyper.lengthscales.at[outputs].set(gp.INACTIVE_LENGTHSCALE).at[outputs, PLACE[body == "payload"]].set(length)
    )
    return dataclasses.replace(
        hyper,
        signal_variance=hyper.signal_variance.at[outputs].set(B[k, k]),
        lengthscales=scale,
        noise_variance=hyper.noise_variance.at[outputs].set(noise[k]),
    )


def weighted_regressors(model: gp.GPPosterior, Phi: np.ndarray) -> np.ndarray:
    """Return `K_i^-1 Phi_i` of the outputs of Phi: (outputs, points, parameters)."""
    W = np.asarray(model.inverse_cholesky)[: Phi.shape[1], : len(Phi), : len(Phi)]
    return np.stack([w.T @ (w @ Phi[:, i]) for i, w in enumerate(W)])


def joint_posterior(
    own: gp.GPPosterior, weighted: np.ndarray, body: BodyKey, k: int, block: Block, found: BlockFit
) -> tuple[gp.GPPosterior, np.ndarray]:
    """Return a body's GP and `weighted_regressors`, with forces of all bodies weighted by their covariance."""
    N, (m, D) = len(block.x), own.hyper.lengthscales.shape
    mine = np.flatnonzero(block.body == k)
    n, B = len(mine), np.asarray(block.covariance(found.logs[0])[1])
    inverse, weight = np.linalg.inv(np.asarray(block.whitened(found.logs[0])[1])), B[k, block.body] / B[k, k]
    X, Y, W, alpha = np.zeros((N, D)), np.zeros((N, m)), np.zeros((m, N, N)), np.zeros((m, N))
    X[:, PLACE[body == "payload"]] = block.x
    X[mine], Y[mine], alpha[:, mine] = np.asarray(own.X)[:n], np.asarray(own.Y)[:n], np.asarray(own.alpha)[:, :n]
    W[:, mine[:, None], mine] = np.asarray(own.inverse_cholesky)[:, :n, :n]
    W[:3] = inverse * weight
    alpha[:3] = ((block.Y - block.Phi @ found.parameters).T @ inverse.T @ inverse) * weight
    replacements = np.zeros((len(weighted), N, weighted.shape[2]))
    replacements[:, mine] = weighted
    replacements[:3] = [(inverse.T @ (inverse @ block.Phi[:, i])) * weight[:, None] for i in range(3)]
    model = gp.GPPosterior(
        hyper=own.hyper,
        X=jnp.asarray(X),
        Y=jnp.asarray(Y),
        num_points=jnp.asarray(N),
        inverse_cholesky=jnp.asarray(W),
        alpha=jnp.asarray(alpha),
    )
    return model, replacements


def fit_rigid(flight_data: TrainingFlight) -> ModelWithUncertainty:
    """Return the mean of `place`, and the paper's GPs of the remainder."""
    base = fit_place(flight_data).model
    models: dict[BodyKey, gp.GPPosterior] = {}
    uncertainties: dict[BodyKey, semiparametric.MeanUncertainty] = {}
    for body, X, Y in bodies(flight_data):
        rest, Z = Y - parametric_mean(base, body, X), features_of(flight_data, body, X)
        fit = gp.fit(
            Z,
            rest,
            hyperprior=flight_data.training.prior_for(body),
            restarts=flight_data.training.restarts,
            max_iterations=flight_data.training.max_iterations,
        )
        models[body] = gp.condition(Z, rest, fit.hyper, flight_data.model.payload.capacity)
        Phi, prior = mean_basis(flight_data, body, X)
        weighted = weighted_regressors(models[body], Phi)
        A = sum((Phi[:, i].T @ weighted[i] for i in range(Phi.shape[1])), np.diag(1 / prior**2))
        uncertainties[body] = semiparametric.MeanUncertainty(weighted_regressors=weighted, covariance=np.linalg.inv(A))
    return ModelWithUncertainty(with_models(base, models), uncertainties)


def parametric_mean(fitted: residual_model.ResidualModel, body: BodyKey, X: np.ndarray) -> np.ndarray:
    """Evaluate the parametric mean of a residual model at the raw samples of a body."""
    learned, x = fitted.mean_function, jnp.asarray(X)
    assert learned is not None
    if isinstance(body, str):
        inertial = jax.vmap(
            lambda x: (
                identification.inertial_regressor(identification.payload_state_from_input(x), x[18:21], x[21:24])
                @ fitted.inertial_parameters
            )
        )(x)
        return np.asarray(jax.vmap(learned.payload_mean)(x) + inertial)
    i, j = body
    size = len(fitted.agents[i].num_points)
    return np.asarray(
        jax.vmap(lambda one: learned.agent_means(i, jnp.broadcast_to(one[None], (size, *one.shape)))[j])(x)
    )


def make_frozen_experiment(case: str, condition: str, seed: int) -> flight.Experiment:
    """Return the experiment of a case in a condition; a frozen model is not updated."""
    flight_data = settings(condition, seed)
    if case in ("true_residual", "label_feedback"):
        return experiment.make_experiment(flight_data, case)
    model, _, labels = case.partition(" with ")
    case_experiment = experiment.make_experiment(flight_data, "C1")
    controller = dataclasses.replace(case_experiment.controller, residual_model=fit_model(model, seed).model)
    if labels:
        corrector = controllers.label_low_pass(flight_data, controller.team)
        controller = controllers.with_residual_corrector(flight_data, controller, corrector)
    return dataclasses.replace(case_experiment, controller=controller)


DENSITY_STRIDE = 50  # ticks between two states at which densities are taken


def simulate_item(item: str) -> dict[str, Any]:
    """Return errors of position [m] and of predictions [N, N m] over the second half, and densities [nats per output].

    The density is that of the true residual under the predicted distribution of a label at the true state. Its variance
    includes posterior, mean parameters, noise and tip force bias. In cases with labels it is that of the model alone.
    """
    case, condition, seed = item.split(": ")
    case_experiment = make_frozen_experiment(case, condition, int(seed))
    loop, rows = simulate_frozen(
        case_experiment,
        case_experiment.duration,
        simulator.reset(case_experiment.loop_config, case_experiment.initial_state),
        case_experiment.controller.residual_model,
    )
    stopped, rows = (
        termination.TerminationCause(int(loop.termination)).name if int(loop.termination) else "",
        metrics.second_half(rows),
    )
    found: dict[str, Any] = {"termination_reason": stopped, "e_p_rms_m": metrics.rms_norm(rows.e_p)}
    if case != "true_residual" and not stopped:
        e_L, e_x = rows.f_L_hat - rows.f_L, rows.f_x_hat - rows.f_x
        found |= {
            "payload_force_error_N": metrics.rms_norm(e_L[:, :3]),
            "payload_moment_error_Nm": metrics.rms_norm(e_L[:, 3:]),
            "agents_force_error_N": float(np.sqrt((e_x**2).sum(2).mean())),
            "team_force_error_N": metrics.rms_norm(e_L[:, :3] + e_x.sum(1)),
        }
    if case not in ("true_residual", "label_feedback") and not stopped:
        bias = settings(condition, int(seed)).sensors.tip_force_bias_N
        learned = fit_model(case.partition(" with ")[0], int(seed))
        found |= negative_log_densities(
            case_experiment, learned, jax.tree.map(lambda x: x[::DENSITY_STRIDE], rows), bias
        )
    return found


def negative_log_densities(
    case_experiment: flight.Experiment, learned: ModelWithUncertainty, rows: signals.StepRecord, bias: float
) -> dict[str, float]:
    """Return mean negative log densities of the true residual: payload forces, payload moments, agent forces."""
    team, (x, agents) = case_experiment.controller.team, signals.model_inputs(case_experiment.world.team, rows)
    a = rows.a_L - np.concatenate([np.asarray(team.gravity), np.zeros(3)])
    c = np.concatenate([np.asarray(group.contact_position).reshape(-1, 3) for group in team.agent_groups])
    by_bias = bias**2 * np.concatenate([np.full(3, len(c)), ((c**2).sum(1, keepdims=True) - c**2).sum(0)])
    load = negative_log_density(
        learned, "payload", learned.model.payload, np.concatenate([x, a], axis=1), np.asarray(rows.f_L), by_bias
    )
    forces, first = [], 0
    for i, (group, X) in enumerate(zip(team.agent_groups, agents, strict=True)):
        by_bias = np.full(3, bias**2 * group.tree.arms)
        for j in range(X.shape[1]):
            model = jax.tree.map(lambda x, j=j: x[j], learned.model.agents[i])
            forces.append(
                negative_log_density(learned, (i, j), model, X[:, j], np.asarray(rows.f_x)[:, first + j], by_bias)
            )
        first += X.shape[1]
    return {
        "payload_force_nll_nats": float(load[:, :3].mean()),
        "payload_moment_nll_nats": float(load[:, 3:].mean()),
        "agents_force_nll_nats": float(np.mean(forces)),
    }


def negative_log_density(
    learned: ModelWithUncertainty, body: BodyKey, model: gp.GPPosterior, X: np.ndarray, f: np.ndarray, bias: np.ndarray
) -> np.ndarray:
    """Return `-log N(f; mean, variance)` of the first outputs of a body [nats], by time and output."""
    features, m = learned.model.features, f.shape[1]
    Z = features.payload(jnp.asarray(X)) if body == "payload" else features.agent(jnp.asarray(X))
    mean, variance = (np.asarray(x)[:, :m] for x in gp.predict(model, Z))
    variance = variance + np.asarray(model.hyper.noise_variance)[:m] + bias
    if body in learned.uncertainties:
        uncertainty, Phi = learned.uncertainties[body], semiparametric.mean_regressors(X, body == "payload")
        many, before = len(uncertainty.covariance), list(learned.uncertainties).index(body)
        if Phi.shape[2] < many:  # of one field, with the parameters of all bodies
            at = 14 + 5 * (before - 1) if before else 0
            Phi = np.pad(Phi, ((0, 0), (0, 0), (at, many - at - Phi.shape[2])))
        variance = variance + semiparametric.mean_variance(model, uncertainty, np.asarray(Z), Phi)[:, :m]
    off = f - mean - parametric_mean(learned.model, body, X)[:, :m]
    return 0.5 * (off**2 / variance + np.log(2 * np.pi * variance))


def main() -> bool:
    """Print the table; one frozen model must have at most twice the error of `true_residual` in unchanged
    environments.
    """
    order = [(seed, case) for part in (CASES[:-2], CASES[-2:]) for seed in SEEDS for case in part]
    items = [f"{case}: {condition}: {seed}" for seed, case in order for condition in CONDITIONS]
    found = collect("generalization", items, simulate_item)

    def each(name: str, case: str, condition: str) -> np.ndarray:
        values = [found[f"{case}: {condition}: {seed}"].get(name) for seed in SEEDS]
        return np.array([np.nan if value is None else value for value in values])

    for condition in CONDITIONS:
        print(condition)
        learned = each("e_p_rms_m", "true_residual", condition)
        for case in CASES:
            e = each("e_p_rms_m", case, condition)
            errors = " ".join(f"{np.median(each(name, case, condition)):6.2f}" for name in QUANTITIES)
            seeds = ", ".join(f"{1e3 * x:.1f}" for x in e)
            print(f"  {case:18} e_p {seeds} mm, {np.median(e / learned):.1f} times true_residual; {errors}")
    same = [c for c in CONDITIONS if c not in ("wind", "payload")]
    worst = {
        m: max(np.median(each("e_p_rms_m", m, c) / each("e_p_rms_m", "true_residual", c)) for c in same) for m in MODELS
    }
    print(
        "largest median ratio to true_residual: " + ", ".join(f"{model} {ratio:.1f}" for model, ratio in worst.items())
    )
    return min(worst.values()) <= 2


QUANTITIES = (
    *("payload_force_error_N", "payload_moment_error_Nm", "agents_force_error_N", "team_force_error_N"),
    *("payload_force_nll_nats", "payload_moment_nll_nats", "agents_force_nll_nats"),
)

if __name__ == "__main__":
    main()
