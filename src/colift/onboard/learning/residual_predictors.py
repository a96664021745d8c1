"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.filters import blend
from colift.math.pytree import pytree
from colift.models import inverse_dynamics
from colift.models.parameters import Team
from colift.models.state import Residual, State, with_wrench
from colift.onboard.control import tracking
from colift.onboard.interfaces import Now, Predictor
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]


# The paper's parts, and those of the rivals ---------------------------------------------------------------------------


@pytree
class Learned:
    """`f_hat`: the frozen oracles at the estimated state, the parametric part at the commanded acceleration."""

    def begin(self, team: Team) -> Any:
        """Nothing is remembered."""
        return ()

    def observe(self, memory: Any, oracle: residual_model.Oracle, now: Now) -> Any:
        """Nothing is remembered."""
        return memory

    def predict(self, memory: Any, oracle: residual_model.Oracle, now: Now, to: tracking.Command) -> Residual:
        """`f_hat_L = mean_L(q_L) + Y(q_L, a, alpha) theta`, `f_hat_j = mean_j(q_j)`."""
        q_hat = now.q_hat
        return residual_model.prediction(oracle, q_hat.payload, q_hat.agents, to.a - now.team.gravity, to.alpha)


@pytree
class Observed:
    """Another predictor with a wrench observer added: a low-pass of what the last command did not explain.

    `d = m_L (v_dot - a_g) - F_d`, `J w_dot + w x J w - tau_d`: residual and realization error in one.
    """

    predictor: Predictor
    bandwidth: Float[Array, "2"]  # Hz, of the force and of the moment

    def begin(self, team: Team) -> Any:
        """What is observed, and the other's memory."""
        return jnp.zeros(6), self.predictor.begin(team)

    def observe(self, memory: Any, oracle: residual_model.Oracle, now: Now) -> Any:
        """`d+ = d + b (d_now - d)`."""
        d, of_other = memory
        q, a = now.q_hat.payload, now.q_hat.a_L
        W = inverse_dynamics.payload(now.team.payload, a[:3] - now.team.gravity, a[3:], q.omega)
        left = jnp.concatenate([W.F - now.W.F, W.tau - now.W.tau])
        # before the first tick there was no command to explain anything
        d = d + now.ticks * jnp.repeat(blend(self.bandwidth, now.clock.dt), 3) * (left - d)
        return d, self.predictor.observe(of_other, oracle, now)

    def predict(self, memory: Any, oracle: residual_model.Oracle, now: Now, to: tracking.Command) -> Residual:
        """The other's prediction, and what is observed on the payload."""
        d, of_other = memory
        return with_wrench(self.predictor.predict(of_other, oracle, now, to), d)


@pytree
class Corrected:
    """Another predictor as far as labels go along with it, and what they say beyond.

    `m + alpha (f_hat - m) + r + (w lead + s) r'`, s ahead of now: m the mean as late as labels, alpha how much of its
    changes they make as well, r' the rate of the label less alpha m, w how much of such rates came true before. Of an
    agent r' is the part that it may follow without hearing itself (`colift.onboard.control.label_feedback`).
    """

    predictor: Predictor
    lead: Scalar  # s, for the delay of labels
    heeded: tuple[Float[Array, "agents"], ...]  # 0 to 1, by group

    def begin(self, team: Team) -> Any:
        """The other's memory."""
        return self.predictor.begin(team)

    def observe(self, memory: Any, oracle: residual_model.Oracle, now: Now) -> Any:
        """The other's memory."""
        return self.predictor.observe(memory, oracle, now)

    def predict(self, memory: Any, oracle: residual_model.Oracle, now: Now, to: tracking.Command) -> Residual:
        """The sum of both. Raises ValueError where the pilot does not listen."""
        if now.news is None:
            raise ValueError("this predictor needs a pilot that listens: `LeaderFollower.listener`")
        f = self.predictor.predict(memory, oracle, now, to)
        news, s = now.news, now.clock.t - now.news.t

        def corrected(f: Array, m: Array, alpha: Array, r: Array, rate: Array, w: Array) -> Array:
            return m + alpha * (f - m) + r + (w * self.lead + s) * rate

        agents = zip(news.rate.agents, self.heeded, strict=True)
        heeded = tuple(jax.tree.map(functools.partial(jnp.multiply, c[:, None]), of) for of, c in agents)
        rate = dataclasses.replace(news.rate, agents=heeded)
        return jax.tree.map(corrected, f, news.mean, news.trust, news.r, rate, news.ahead)


@pytree
class Known:
    """The residual as a function that is known exactly, which no team has: what a study measures learners by."""

    function: Callable[[State, tracking.Command, Scalar], Residual]  # of state, acceleration and time, s; a PyTree

    def begin(self, team: Team) -> Any:
        """Nothing is remembered."""
        return ()

    def observe(self, memory: Any, oracle: residual_model.Oracle, now: Now) -> Any:
        """Nothing is remembered."""
        return memory

    def predict(self, memory: Any, oracle: residual_model.Oracle, now: Now, to: tracking.Command) -> Residual:
        """The function at the estimated state and the commanded acceleration."""
        z = State(agents=now.q_hat.agents, payload=now.q_hat.payload)
        return self.function(z, to, now.clock.t)
