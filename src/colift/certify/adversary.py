"""The worst unknown that norm and data allow: what no certificate from the same assumptions can be below."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from colift import gp, learn, simulate
from colift.certify import reach, variation
from colift.certify.certificate import Certificate, bodies
from colift.certify.reach import Body, Matrix
from colift.certify.variation import Variation
from colift.gp import recovery

EVERY = 4  # nodes between samples of the path in the functional that the adversary makes great


def adversary(
    plan: simulate.Plan, flight: simulate.Flight, loop: Variation, found: Certificate, rows: simulate.Row
) -> learn.Oracle:
    """Unknown forces that keep norm and data, and make e_p great when and where its bound is greatest.

    Of all consistent functions, each output takes one that makes `d . e_p(t)` greatest along the path of `rows`, t and
    d from the certificate's bound. To be flown by `certificate.under`. Raises as `gp.recovery.recover`.
    """
    at = int(np.argmin(np.abs(loop.t - found.when)))
    L = np.einsum("tmki,m->ki", variation.weights(loop, loop.of("e_p"), [at]), found.direction)[: at + 1]
    starts = np.arange(0, at + 1, EVERY)
    L, path = np.add.reduceat(L, starts), loop.nodes[np.minimum(starts + EVERY // 2, at)]
    models = [_extreme(body, L) for body in bodies(plan, flight, rows, path, "energy")]
    groups, first = [], 1
    for size in plan.pilot.team.sizes:
        groups.append(jax.tree.map(lambda *leaf: jnp.stack(leaf), *models[first : first + size]))
        first += size
    return learn.Oracle(payload=models[0], agents=tuple(groups), theta=jnp.zeros(10))


def _extreme(body: Body, L: Matrix) -> gp.GP:
    """For each output the consistent function of greatest contribution, as a posterior mean; L: (path, inputs)."""
    n, x = int(body.model.n), body.x
    X, Y = np.asarray(body.model.X)[:n], np.asarray(body.model.Y)[:n]
    weights = np.empty((len(body.beta), n + len(x)))
    for i in range(len(body.beta)):
        allowed = recovery.consistent(X, Y, body.model.hyper, i, body.norm, float(body.eps[i]))
        w = L[:, body.columns.start + i]
        C = reach.correlation(body.model, i, x, x)
        best = recovery.greatest(allowed, allowed.correlations(x) @ w, float(w @ C @ w))
        weights[i] = np.concatenate([best.weights[:-1], best.weights[-1] * w])
    hyper = dataclasses.replace(body.model.hyper, noise_variance=1e-3 * body.model.hyper.signal_variance)
    return gp.expansion(hyper, np.concatenate([X, x]), weights)
