"""Values of a short flight and of transformed PyTrees; as a program it writes them without the test configuration."""

from __future__ import annotations

import dataclasses
import sys

import jax
import jax.numpy as jnp
import numpy as np

from colift import gp
from colift.closed_loop import log
from colift.models import grasp
from tests.support import paper_flights


def values() -> dict[str, np.ndarray]:
    """Return named arrays: a log with one update, and values of transformed PyTrees."""
    return _flight() | _transformed()


def _flight() -> dict[str, np.ndarray]:
    """Simulate C3 for 0.6 s with an update at 0.5 s and unchanged hyperparameters."""
    of = paper_flights.shortened("C3")
    recorder = dataclasses.replace(of.controller.recorder, start=paper_flights.number(0.0))
    of = dataclasses.replace(
        paper_flights.with_controller(of, recorder=recorder), update_times=(0.5,), fit_options=None
    )
    flight = paper_flights.simulate(of, 0.6)
    assert not flight.termination_reason
    assert flight.updates[0].num_samples["payload"] > 3
    names = {
        "agents": paper_flights.NAMES,
        "joints": [f"joint {k}" for k in range(flight.records.r.shape[1])],
        "contacts": [f"contact {k}" for k in range(flight.records.lam.shape[1])],
    }
    logged = log.dataset(flight.records, team=of.world.team, sigma=flight.uncertainty, attrs={}, **names)
    return _named({"log": {name: x.values for name, x in logged.items()}, "oracle": flight.model})


def _transformed() -> dict[str, np.ndarray]:
    """Return PyTrees after vmap, stacking, batching by PyTree axes, compilation, differentiation and flattening."""
    of = paper_flights.paper_experiment("C3")
    z, group = of.initial_state, of.world.team.agent_groups[0]
    _, tree = jax.tree.flatten(of.world)
    rng = np.random.default_rng(0)
    hyper = gp.make_hyperparameters(2.0, [0.5, 1.5], 0.1)
    model = gp.condition(rng.normal(size=(9, 2)), rng.normal(size=(9, 1)), hyper, capacity=12)
    stacked = jax.tree.map(lambda x: jnp.stack([x, 2 * x]), hyper)
    axes = jax.tree.map(lambda _: 0, hyper)

    def mean(hyper: gp.Hyperparameters, x: jax.Array) -> jax.Array:
        return gp.mean(dataclasses.replace(model, hyper=hyper), x)

    x = jnp.array([0.3, -0.2])
    slope = jax.jit(jax.jacfwd(lambda z: grasp.constraint_residual(of.world.team, z)))(z)
    return _named({
        "mapped": jax.tree.map(lambda a, b: a + b, group, group),
        "batched": jax.jit(jax.vmap(mean, in_axes=(axes, None)))(stacked, x),
        "gradient": jax.jit(jax.grad(lambda h: mean(h, x).sum()))(hyper),
        "linear": jax.jvp(lambda h: mean(h, x), (hyper,), (hyper,)),
        "jacobian": slope,
        "again": jax.tree.unflatten(tree, jax.tree.leaves(of.world)),
    })  # fmt: skip


def _named(tree: object) -> dict[str, np.ndarray]:
    return {jax.tree_util.keystr(path): np.asarray(x) for path, x in jax.tree_util.tree_leaves_with_path(tree)}


if __name__ == "__main__":
    found = values()
    assert jax.tree_util.register_dataclass.__module__.startswith("jax.")
    assert not {"tests.conftest", "conftest", "beartype"} & set(sys.modules)
    np.savez(sys.argv[1], **{f"{k} {name}": x for k, (name, x) in enumerate(found.items())})
