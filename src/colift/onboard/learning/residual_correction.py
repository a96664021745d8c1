"""What labels say beyond what is learned: the innovation, label less mean, and what is left of it when labels stop.

A memory, as a frozen Gaussian process is one, fails where the world has changed, and its deviation does not see that.
The innovation does: `r = F y - F f_hat`, F the filter that labels go through, so that both are equally late.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from colift.math.filters import after, blend, from_the_first
from colift.math.pytree import pytree
from colift.models.parameters import Team
from colift.models.state import Clock, Residual, Wrench, agent_force, no_force
from colift.onboard.estimation.state_estimator import Estimate, Filters, Labelled
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]
T = TypeVar("T")


@pytree
class News:
    """What labels say beyond the oracle, as it is to be used."""

    t: Scalar  # s, when it was so
    r: Residual  # N and N m
    mean: Residual  # N and N m, the oracle's, as late as labels: r + mean is the label
    trust: Residual  # alpha, 0 to 1: how much of what the mean changes labels change as well; 1 where they have stopped
    rate: Residual  # N/s and N m/s, of the label less alpha times the mean
    fresh: Scalar  # 1 while labels come, if now and then; falls to 0 when they stop, and r to its running mean
    ahead: Residual  # w, 0 to 1: how much of the rate is to be trusted for the labels' delay, as it came true before
    comes: Scalar  # 1 while labels come, 0 once they have stopped
    late: Residual  # N and N m, by how much labels are late, and again as old as they are: RMS over their last span
    left: Residual  # N and N m, what labels said of late beyond mean and r: RMS over their last span


def no_news(team: Team, t: Scalar) -> News:
    """Before any label."""
    none = no_force(team)
    whole = jax.tree.map(jnp.ones_like, none)
    return News(
        t=t,
        r=none,
        mean=none,
        trust=whole,
        rate=none,
        fresh=jnp.ones(()),
        ahead=whole,
        comes=jnp.ones(()),
        late=none,
        left=none,
    )


@pytree
class Moved:
    """How labels and the late mean move against themselves behind one filter more, and how alike they do."""

    label: Residual  # behind it
    mean: Residual
    products: Residual  # (N, N m)^2, means over the last span, of both and of the mean's own
    squares: Residual


@pytree
class Foretold:
    """What was to come by the rate of labels, one delay of theirs ago, and how far such things came true."""

    age: Scalar  # s, since then
    known: Scalar  # 0 at first, 1 once labels have come for ten spans and more
    trust: Residual  # alpha, as it was then
    rest: Residual  # the label less alpha times the mean
    rate: Residual  # of that
    products: Residual  # (N, N m)^2, means over ten spans of what came times what was foretold, and of that alone
    squares: Residual


@pytree
class Heard:
    """What a listener keeps between ticks."""

    k: Int[Array, ""]  # of the oracle
    f: Residual  # the mean
    copy: Residual  # behind a copy of the tips' bandwidth
    inner: Residual  # and behind the labels' filter
    outer: Residual
    r: Residual
    before: tuple[Residual, Residual]  # r and the late mean before the last label
    moved: Moved
    foretold: Foretold
    elapsed: Scalar  # s since then
    average: Residual
    gap: Scalar  # s, the longest silence that a label ended, forgotten within ten spans
    age: Scalar  # s, of the last label while they come: mean over ten spans
    late: Residual  # N^2 and (N m)^2
    level: Residual  # N and N m, mean of r over the last span of labels
    said: Residual  # N^2 and (N m)^2, of its square
    fresh: Scalar
    warm: Scalar  # 0 before the first tick, 1 after


@pytree
class Listener:
    """Compares labels with the oracle, tick by tick.

    While labels come, `r` is label less mean, held from one label to the next. When there is none for `hold`, or for
    twice as long as silence has lasted lately, `r` falls within `fade` to what has changed for good: its mean m over
    the last `span`, as far as that is no noise, `m m^2 / (m^2 + 4 v)`, v the oracle's variance of labels. Where another
    oracle takes over, what it says more is taken from r at once, not only when the filter has seen it, and m begins
    anew, at nothing: what has changed for good is in the new oracle, and errors of the one before are not its own.

    A mean that was true at its places need not be true at this time. With d y, d f what label and late mean are off
    the same behind one filter more, `alpha = (1 + n <d y d f> / v) / (1 + n <d f d f> / v)`, within 0 and 1 and n the
    doubt, is how much of the mean's changes labels make as well; means over the last span.

    A rate may be noise. Each delay of labels, while they come, it is held against what they did since: with g the
    label less alpha times the mean, D g what it has become more and d its age times its rate of then,
    `s = n <(D g - h d) d> / (1 - h)` is the square of what came true, h = `exp(-2 pi label delay)` what white noise
    behind two lags foretells of itself, and `w = s / (c (v + n <d d>))`, within 0 and 1 and c the coherence, how much
    of a rate is to be trusted; means over ten spans, from nothing on.
    """

    filters: Filters
    hold: Scalar  # s
    fade: Scalar  # s; inf: r is held
    span: Scalar  # s
    doubt: Scalar  # n: a mean that has moved by less than the variance of labels over n is trusted, a rate is not
    coherence: Scalar  # c, of the square of what rates foretell: the share that comes true where w is 1

    def begin(self, team: Team) -> Heard:
        """Nothing heard yet."""
        none = no_force(team)
        return Heard(
            k=jnp.zeros((), int),
            f=none,
            copy=none,
            inner=none,
            outer=none,
            r=none,
            before=(none, none),
            moved=Moved(label=none, mean=none, products=none, squares=none),
            foretold=Foretold(
                age=jnp.zeros(()), known=jnp.zeros(()), trust=none, rest=none, rate=none, products=none, squares=none
            ),
            elapsed=jnp.ones(()),
            average=none,
            gap=jnp.zeros(()),
            age=jnp.zeros(()),
            late=none,
            level=none,
            said=none,
            fresh=jnp.ones(()),
            warm=jnp.zeros(()),
        )

    def listen(
        self, past: Heard, team: Team, oracle: residual_model.Oracle, q_hat: Estimate, clock: Clock
    ) -> tuple[Heard, News]:
        """The innovation of this tick. Raises ValueError where nothing is labelled."""
        labelled, dt = q_hat.labelled, clock.dt
        if labelled is None:
            raise ValueError("the estimator gives no labels: this pilot cannot listen")
        on, waited = labelled.fresh, labelled.waited
        f = residual_model.prediction(oracle, q_hat.payload, q_hat.agents, q_hat.a_L[:3] - team.gravity, q_hat.a_L[3:])
        past = _taken_over(past, f, oracle.k)
        copy = _low(past.copy, f, from_the_first(past.warm, blend(self.filters.tip_force, dt)))
        b = on * after(blend(self.filters.label, dt), waited / dt)  # stands still where the labels do
        b = from_the_first(past.warm, b)
        inner = _low(past.inner, copy, b)
        outer = _low(past.outer, inner, b)
        y = _label(labelled)
        r = jax.tree.map(jnp.subtract, y, outer)
        b_span = on * -jnp.expm1(-waited / self.span)
        b_mean = from_the_first(past.warm, b_span)
        average = _low(past.average, r, b_mean)
        moved = _moved(past.moved, y, outer, b, past.warm * b_span)
        silent, ended = (1 - on) * waited, on * (waited - dt)
        gap = jnp.maximum(past.gap * jnp.exp(-dt / (10 * self.span)), ended)
        speaking = (silent <= jnp.maximum(self.hold, 2 * gap) + 1e-9).astype(float)
        fresh = past.fresh + -jnp.expm1(-dt / self.fade) * (speaking - past.fresh)
        v = noise(oracle)
        trust = jax.tree.map(lambda c, s, v: 1 + fresh * (self._alpha(c, s, v) - 1), moved.products, moved.squares, v)
        before = _if(on, (past.r, past.outer), past.before)
        elapsed = jnp.where(on > 0, waited, past.elapsed + dt)
        by = past.warm * fresh / elapsed
        rate = jax.tree.map(lambda r, m, r_0, m_0, a: by * (r - r_0 + (1 - a) * (m - m_0)), r, outer, *before, trust)
        delay = self.filters.delay()
        went_on = past.warm * (ended <= jnp.maximum(self.hold, 2 * past.gap) + 1e-9).astype(float)  # until this label
        foretold = self._held_against(past.foretold, y, outer, trust, rate, on, went_on, dt)
        ahead = jax.tree.map(functools.partial(self._ahead, foretold.known), foretold.products, foretold.squares, v)
        lasting = jax.tree.map(lambda m, v: m * m * m / (m * m + 4 * v), average, v)
        used = jax.tree.map(lambda r, left: left + fresh * (r - left), r, lasting)
        # stand still where the labels do
        late = _low(past.late, jax.tree.map(lambda x: (delay * x) * (delay * x), rate), b_span)
        level = _low(past.level, r, b_mean)
        said = _low(past.said, jax.tree.map(jnp.square, r), b_mean)
        age = past.age + speaking * -jnp.expm1(-dt / (10 * self.span)) * (silent - past.age)
        as_old = 1 + age / delay
        left = jax.tree.map(lambda q, m, x: jnp.sqrt(jnp.maximum(q - 2 * x * m + x * x, 0.0)), said, level, used)
        heard = Heard(
            k=oracle.k,
            f=f,
            copy=copy,
            inner=inner,
            outer=outer,
            r=r,
            before=before,
            moved=moved,
            foretold=foretold,
            elapsed=elapsed,
            average=average,
            gap=gap,
            age=age,
            late=late,
            level=level,
            said=said,
            fresh=fresh,
            warm=jnp.ones(()),
        )
        news = News(
            t=clock.t,
            r=used,
            mean=outer,
            trust=trust,
            rate=rate,
            fresh=fresh,
            ahead=ahead,
            comes=speaking,
            late=jax.tree.map(lambda of: as_old * jnp.sqrt(of), late),
            left=left,
        )
        return heard, news

    def _held_against(
        self,
        past: Foretold,
        y: Residual,
        mean: Residual,
        trust: Residual,
        rate: Residual,
        on: Scalar,
        went_on: Scalar,
        dt: Scalar,
    ) -> Foretold:
        """The memory after the label y, against which what was foretold is held once it is as old as labels are late.

        As long as they went on: a rate from before they stopped says nothing of when they come again.
        """
        age = past.age + dt
        due = on * (age > self.filters.delay() - 1e-9).astype(float)
        b = due * went_on * -jnp.expm1(-age / (10 * self.span))
        rest = functools.partial(jax.tree.map, lambda y, m, a: y - a * m, y, mean)
        came = jax.tree.map(jnp.subtract, rest(past.trust), past.rest)
        told = jax.tree.map(lambda r: age * r, past.rate)
        trust, left, rate = _if(due, (trust, rest(trust), rate), (past.trust, past.rest, past.rate))
        return Foretold(
            age=(1 - due) * age,
            known=past.known + b * (1 - past.known),
            trust=trust,
            rest=left,
            rate=rate,
            products=_low(past.products, jax.tree.map(jnp.multiply, came, told), b),
            squares=_low(past.squares, jax.tree.map(jnp.square, told), b),
        )

    def _alpha(self, c: Array, s: Array, v: Array) -> Array:
        return jnp.clip((v + self.doubt * c) / (v + self.doubt * s), 0.0, 1.0)

    def _ahead(self, known: Scalar, c: Array, s: Array, v: Array) -> Array:
        of_noise = jnp.exp(-2 * jnp.pi * self.filters.label * self.filters.delay())
        true = jnp.maximum(0.0, known * self.doubt * (c - of_noise * s)) / (1 - of_noise)
        whole = self.coherence * (v + self.doubt * s)
        return (jnp.minimum(true, whole) + 1e-30) / (whole + 1e-30)  # 1 where no coherence is asked


def _taken_over(past: Heard, f: Residual, k: Int[Array, ""]) -> Heard:
    """The memory as if the oracle k, whose mean now is f, had been there before, but for a constant."""
    more = jax.tree.map(lambda new, old: jnp.where((k != past.k) & (past.warm > 0), new - old, 0.0), f, past.f)
    plus, less = (lambda x: jax.tree.map(jnp.add, x, more)), (lambda x: jax.tree.map(jnp.subtract, x, more))
    trusted = jax.tree.map(jnp.multiply, past.foretold.trust, more)
    return dataclasses.replace(
        past,
        copy=plus(past.copy),
        inner=plus(past.inner),
        outer=plus(past.outer),
        r=less(past.r),
        before=(less(past.before[0]), plus(past.before[1])),
        moved=dataclasses.replace(past.moved, mean=plus(past.moved.mean)),
        foretold=dataclasses.replace(past.foretold, rest=jax.tree.map(jnp.subtract, past.foretold.rest, trusted)),
        average=jax.tree.map(lambda of, m: jnp.where(of != 0, 0.0, m), more, past.average),
    )


def _moved(past: Moved, y: Residual, mean: Residual, b: Scalar, b_span: Scalar) -> Moved:
    """The memory after the label y and the late mean, one filter more with the blend b, means with b_span."""
    label, slow = _low(past.label, y, b), _low(past.mean, mean, b)
    dy, df = (jax.tree.map(jnp.subtract, *each) for each in ((y, label), (mean, slow)))
    return Moved(
        label=label,
        mean=slow,
        products=_low(past.products, jax.tree.map(jnp.multiply, dy, df), b_span),
        squares=_low(past.squares, jax.tree.map(jnp.multiply, df, df), b_span),
    )


def _if(on: Scalar, new: T, old: T) -> T:
    return jax.tree.map(lambda new, old: jnp.where(on > 0, new, old), new, old)


def _low(past: Residual, now: Residual, b: Scalar) -> Residual:
    return jax.tree.map(lambda old, new: old + b * (new - old), past, now)


def _label(labelled: Labelled) -> Residual:
    return _residual(labelled.payload[1], tuple(y for _, y in labelled.agents))


def noise(oracle: residual_model.Oracle) -> Residual:
    """Variance of labels, by output, (N, N m)^2."""
    return _residual(oracle.payload.hyper.noise_variance, tuple(g.hyper.noise_variance for g in oracle.agents))


def _residual(payload: Float[Array, "6"], agents: tuple[Float[Array, "_agents _outputs"], ...]) -> Residual:
    return Residual(
        payload=Wrench(F=payload[:3], tau=payload[3:]),
        agents=tuple(agent_force(y) for y in agents),
    )
