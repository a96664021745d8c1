"""Priors of a scenario: residual models before any data, and options of the hyperparameter fits."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift import gp
from colift.models.parameters import Team
from colift.onboard.learning import model_update, residual_model, semiparametric
from colift.onboard.learning.features import DefaultFeatures, Features
from colift.scenario import schema
from colift.scenario.conversion import array, build_plugin, once
from colift.scenario.errors import ScenarioError


def features(settings: schema.Scenario) -> Features:
    """Return the features of the Gaussian processes; ScenarioError for invalid user-defined features."""
    given = settings.plugins.features
    return DefaultFeatures() if given is None else build_plugin(given, "plugins.features", Features)


def kernel(settings: schema.Scenario) -> gp.Kernel:
    """Return the kernel of all models; ScenarioError for an invalid user-defined kernel."""
    given = settings.plugins.kernel
    return gp.SquaredExponential() if given is None else build_plugin(given, "plugins.kernel", gp.Kernel)


def prior_model(settings: schema.Scenario, nominal: Team) -> residual_model.ResidualModel:
    """Return the residual model before any data: zero mean, with the prior standard deviations of the scenario.

    Args:
        settings: Scenario.
        nominal: Nominal parameters.

    Returns:
        Prior residual model.

    Raises:
        ScenarioError: If the noise is too small, relative to the signal, for the largest number of samples.
    """
    learning, feature_map, covariance = settings.learning, features(settings), kernel(settings)

    def prior(name: str, features: Sequence[str], copies: int | None = None) -> gp.GPPosterior:
        try:
            return _prior(getattr(learning, name), tuple(features), covariance, learning.max_samples, copies)
        except ValueError as error:
            raise ScenarioError(f"{settings.name}: learning.{name}: {error}") from None

    return residual_model.ResidualModel(
        features=feature_map,
        payload=prior("payload", feature_map.payload_names()),
        agents=tuple(
            prior("agents", feature_map.agent_names(group.tree.joints), size)
            for size, group in zip(nominal.sizes, nominal.agent_groups, strict=True)
        ),
        inertial_parameters=array(np.zeros(10)),
    )


@once
def _prior(
    given: schema.GPPrior, features: tuple[str, ...], kernel: gp.Kernel, capacity: int, copies: int | None
) -> gp.GPPosterior:
    """Return the prior of one model, or of equal models with a leading axis; all experiments share its arrays."""
    one = gp.prior(_hyper(given, features, kernel), capacity)
    if copies is None:
        return one
    return jax.tree.map(lambda x: jax.device_put(np.broadcast_to(x, (copies, *x.shape))), one)


def fit_options(settings: schema.Scenario, nominal: Team) -> model_update.FitOptions | None:
    """Return the options of the hyperparameter fits around the priors; None for fixed hyperparameters."""
    given = settings.learning
    if given.hyperparameters == "fixed":
        return None
    feature_map, covariance = features(settings), kernel(settings)

    return model_update.FitOptions(
        payload=_hyperprior(given.payload, tuple(feature_map.payload_names()), covariance),
        agents=tuple(
            _hyperprior(given.agents, tuple(feature_map.agent_names(group.tree.joints)), covariance)
            for group in nominal.agent_groups
        ),
    )


@once
def _hyperprior(given: schema.GPPrior, features: tuple[str, ...], kernel: gp.Kernel) -> gp.HyperPrior:
    """Return the prior of the hyperparameters of one model."""
    return gp.HyperPrior(_hyper(given, features, kernel))


def position_only_options(settings: schema.Scenario, nominal: Team) -> model_update.FitOptions | None:
    """Return the options of fits of models that depend on position only; a parametric mean covers the rest."""
    fits, feature_map = fit_options(settings, nominal), features(settings)
    if fits is None:
        return None
    groups = zip(fits.agents, nominal.agent_groups, strict=True)
    return dataclasses.replace(
        fits,
        payload=semiparametric.position_only_prior(fits.payload, feature_map.payload_names(), payload=True),
        agents=tuple(
            semiparametric.position_only_prior(hyperprior, feature_map.agent_names(group.tree.joints), payload=False)
            for hyperprior, group in groups
        ),
    )


def mean_prior(
    settings: schema.Scenario,
    nominal: Team,
    drag_std: float = 0.5,
    drag_lever_std: float = 0.4,
    thrust_bias_std: float = 2.0,
    constant_std_ratio: float = 3.0,
) -> semiparametric.MeanPrior:
    """Return the prior of the mean parameters of the models that depend on position only.

    Args:
        settings: Scenario; mass and first moments have the standard deviations of its section `baselines`.
        nominal: Nominal parameters.
        drag_std: Standard deviation of the drag coefficient of each body [N s/m].
        drag_lever_std: Standard deviation of the lever of the payload's drag [m].
        thrust_bias_std: Standard deviation of the thrust bias of an agent [N].
        constant_std_ratio: Standard deviation of a constant force or moment, divided by the signal's.

    Returns:
        The prior standard deviations.
    """
    parameters = settings.baselines
    load, agent = settings.learning.payload.signal_std, settings.learning.agents.signal_std
    drag, constant = drag_std, constant_std_ratio
    return semiparametric.MeanPrior(
        payload=np.array(
            [
                parameters.mass_prior_std_kg,
                *[parameters.first_moment_prior_std_kgm] * 3,
                drag,
                *[drag * drag_lever_std] * 3,
            ]
            + [constant * load.force_N] * 3
            + [constant * load.moment_Nm] * 3
        ),
        agents=np.array([drag, thrust_bias_std, *[constant * agent.force_N] * 3]),
        nominal_payload=nominal.payload,
    )


def residual_std(
    settings: schema.Scenario, nominal: Team
) -> tuple[Float[Array, "6"], tuple[Float[Array, "_outputs"], ...]]:
    """Return the standard deviations of the residuals in hover before any data.

    They combine the signal's standard deviation with those of the mean parameters (`mean_prior`): a constant force or
    moment, the payload's mass and first moments times gravity, and the thrust bias of an agent.

    Args:
        settings: Scenario.
        nominal: Nominal parameters.

    Returns:
        Standard deviations of the payload's residual, and of the agents' residuals by group [N, N m].
    """
    prior, g = mean_prior(settings, nominal), float(jnp.linalg.norm(nominal.gravity))
    load, agent = settings.learning.payload.signal_std, settings.learning.agents.signal_std
    force = np.sqrt(load.force_N**2 + prior.payload[8:11] ** 2 + np.array([0, 0, prior.payload[0] * g]) ** 2)
    moment = np.sqrt(load.moment_Nm**2 + prior.payload[11:14] ** 2 + (prior.payload[1:4] * g) ** 2)
    agent_force = np.sqrt(agent.force_N**2 + prior.agents[2:5] ** 2 + np.array([0, 0, prior.agents[1]]) ** 2)
    return array([*force, *moment]), tuple(
        array([*agent_force, *[agent.moment_Nm] * 3, *[agent.joint_torque_Nm] * group.tree.joints])
        for group in nominal.agent_groups
    )


def _hyper(given: schema.GPPrior, features: Sequence[str], kernel: gp.Kernel) -> gp.Hyperparameters:
    """Return hyperparameters of forces, moments and joint torques from the stated standard deviations."""
    signal = [given.signal_std.force_N, given.signal_std.moment_Nm]
    noise = [given.noise_std.force_N, given.noise_std.moment_Nm]
    counts = [3, 3]
    if isinstance(given, schema.AgentGPPrior):
        signal.append(given.signal_std.joint_torque_Nm)
        noise.append(given.noise_std.joint_torque_Nm)
        counts.append(sum(name.startswith("r_dot") for name in features))
    rates = [name.startswith(("omega", "|omega|", "r_dot")) for name in features]
    lengthscales = np.where(rates, given.rate_lengthscale, given.lengthscale)
    return gp.make_hyperparameters(
        signal_variance=np.repeat(signal, counts) ** 2,
        lengthscales=np.tile(lengthscales, (sum(counts), 1)),
        noise_variance=np.repeat(noise, counts) ** 2,
        kernel=kernel,
    )
