"""Random residuals from the reproducing kernel Hilbert space of a certificate."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift import gp
from colift.models import state
from colift.models.parameters import Team
from colift.models.state import PayloadState, ResidualForces, State, Wrench, split_agent_force
from colift.onboard.learning import residual_model
from colift.onboard.learning.features import Features
from colift.scenario import priors, schema, trajectories
from colift.scenario.errors import ScenarioError
from colift.trajectories import base


def sample_residuals(
    settings: schema.Scenario, truth: Team, state: State, num_centers: int = 30, center_std: float = 0.2
) -> tuple[residual_model.ResidualModel, ResidualForces] | None:
    """Draw residuals `f = sum_k w_k k(z_k, .)` with a given norm, `|f|^2 = w^T K w`, as posterior means.

    The centers `z_k` are random displacements from states of the team along the reference, with the orientations and
    joint positions of the given state. Outputs whose variation is too small are drawn again.

    The default displacement of the payload's 20 features has a length of 0.2 sqrt(20) = 0.9 length-scales. The kernel
    of a center is then exp(-0.4) = 0.67 at its state of the reference, and functions also vary beside the reference.

    Args:
        settings: Scenario.
        truth: True parameters.
        state: State of the team on the constraint manifold.
        num_centers: Number of kernel functions in the sum.
        center_std: Standard deviation of the displacements of the centers from the reference, in length-scales.

    Returns:
        Residual model, and standard deviation of each output along the reference; None if the scenario has no section
        `random_residual`.

    Raises:
        ScenarioError: If an output varies too little after `MAX_ATTEMPTS` draws.
    """
    given = settings.random_residual
    if given is None:
        return None
    rng, again = (np.random.default_rng((settings.seed, k)) for k in (4, 5))
    moves = settings.reference
    assert not isinstance(moves, schema.Plugin), "`cross_checks` rejects it"
    match moves:
        case schema.Lissajous():
            moving = moves.ramp_time_s
        case schema.Waypoints():
            moving = moves.poses[0].time_s
        case schema.Sampled():
            moving = max(moves.start_s, 0.0)
    zero = priors.prior_model(settings, truth)
    center_features, path_features = (
        _team_features(trajectories.make_reference(settings), zero.features, state, jnp.asarray(t))
        for t in (
            rng.uniform(moving, settings.duration_s, num_centers),
            np.linspace(moving, settings.duration_s, 400),
        )
    )

    def one(hyper: gp.Hyperparameters, X: Array, path: Array) -> tuple[gp.GPPosterior, np.ndarray]:
        X = np.asarray(X) + center_std * rng.normal(size=X.shape) * np.asarray(hyper.lengthscales)[0]
        w = rng.normal(size=(len(hyper.signal_variance), len(X)))
        for _ in range(MAX_ATTEMPTS):
            scaled = w * (given.rkhs_norm / np.asarray(gp.rkhs_norm(gp.from_expansion(hyper, X, w))))[:, None]
            model = gp.from_expansion(hyper, X, scaled, max(len(X), settings.learning.max_samples))
            values = np.asarray(_means(model, path))
            too_small = np.ptp(values, axis=0) / 2 < given.min_variation * np.sqrt(hyper.signal_variance)
            if not too_small.any():
                return model, values.std(0)
            w[too_small] = again.normal(size=(too_small.sum(), len(X)))
        raise ScenarioError(
            f"{settings.name}: random_residual.min_variation: after {MAX_ATTEMPTS} draws an output still varied "
            f"by less than {given.min_variation:g} signal deviations along the reference; lower it, "
            "or choose shorter length-scales or a longer reference"
        )

    payload, of_payload = one(zero.payload.hyper, center_features[0], path_features[0])
    agents, of_agents = [], []
    for group, x, x_along in zip(zero.agents, center_features[1], path_features[1], strict=True):
        each = [
            one(jax.tree.map(lambda leaf, j=j: leaf[j], group.hyper), x[:, j], x_along[:, j]) for j in range(x.shape[1])
        ]
        agents.append(jax.tree.map(lambda *leaf: jnp.stack(leaf), *(model for model, _ in each)))
        of_agents.append(split_agent_force(jnp.asarray([std for _, std in each])))
    W = jnp.asarray(of_payload)
    return (
        dataclasses.replace(zero, payload=payload, agents=tuple(agents)),
        ResidualForces(agents=tuple(of_agents), payload=Wrench(F=W[:3], tau=W[3:])),
    )


MAX_ATTEMPTS = 1000  # draws before an error is raised
_means = jax.jit(jax.vmap(gp.mean, (None, 0)))


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, None, 0))
def _team_features(
    path: base.ReferenceTrajectory, features: Features, team_state: State, t: Array
) -> tuple[Array, tuple[Array, ...]]:
    """Return features of payload and agents for the team in translation along the reference."""
    d = path.evaluate(t)
    shift = d.p - team_state.payload.p
    load = PayloadState(p=d.p, R=d.R, v=d.v, omega=jnp.zeros(3))
    agents = tuple(
        features.agent(
            jax.vmap(state.flatten_agent_state)(
                dataclasses.replace(q, x=q.x + shift[None], v=jnp.tile(d.v, (len(q.x), 1)))
            )
        )
        for q in team_state.agents
    )
    return features.payload(state.flatten_payload_state(load, jnp.zeros(6))), agents
