"""What labels say beyond what is learned: by a filter written anew, when labels stop, and when an oracle takes over."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

from colift import gp, scenario
from colift.closed_loop import flight
from colift.models.state import ControlClock, PayloadState, ResidualForces, Wrench, zero_residual
from colift.onboard import interfaces
from colift.onboard.control import tracking
from colift.onboard.estimation.state_estimator import FilterBandwidths, StateEstimate, TrainingSample
from colift.onboard.learning import features, residual_correction, residual_model, residual_predictors
from colift.scenario import experiment
from tests.support import small_team as light

DT, TICKS = 0.002, 400
CORNERS = {"complementary": 5.0, "imu_bias": 0.0, "joint": 20.0, "label": 8.0, "tip_force": 50.0}
FILTERS = FilterBandwidths(**{name: jnp.array(hertz) for name, hertz in CORNERS.items()})


@functools.cache
def plan() -> flight.Experiment:
    """A light team's, made when it is first asked for."""
    return experiment.make_experiment(light.settings(), "adaptive")


def blend(hertz: float) -> float:
    return 1 - np.exp(-2 * np.pi * hertz * DT)


def low(x: np.ndarray, hertz: float) -> np.ndarray:
    """A first-order low-pass that begins at its first sample."""
    b = blend(hertz)
    return lfilter([b], [1, b - 1], x, axis=0, zi=(1 - b) * x[:1])[0]


def filtered(x: np.ndarray) -> np.ndarray:
    """Behind the filters that labels go through."""
    return behind_the_labels_filter(low(x, CORNERS["tip_force"]))


def observed(p: Any, y: Any, on: Any, waited: Any) -> StateEstimate:
    """A payload at p whose label is y, agents that have none."""
    load = PayloadState(p=p, v=jnp.zeros(3), R=jnp.eye(3), omega=jnp.zeros(3))
    none = tuple(
        (jnp.zeros((n, 18 + 2 * g.tree.joints)), jnp.zeros((n, 6 + g.tree.joints)))
        for n, g in zip(plan().controller.team.sizes, plan().controller.team.agent_groups, strict=True)
    )
    labelled = TrainingSample(payload=(jnp.zeros(24), y), agents=none, valid=on, sample_interval=waited)
    lam = tuple(jnp.zeros_like(g.contact_position) for g in plan().controller.team.agent_groups)
    return StateEstimate(agents=plan().initial_state.agents, payload=load, a_L=jnp.zeros(6), lam=lam, sample=labelled)


def heard(
    listener: residual_correction.InnovationFilter, oracle: Any, p: np.ndarray, labels: np.ndarray, fresh: np.ndarray
) -> residual_correction.Innovation:
    """The news along a path of the payload, tick by tick; `oracle(k)` is the one of tick k, by its payload's offset."""

    def tick(memory: Any, now: tuple) -> tuple:
        k, *seen = now
        q_hat = observed(*seen)
        return listener.update(memory, team, oracle(k), q_hat, ControlClock(t=k.astype(float) * DT, dt=jnp.array(DT)))

    team = plan().controller.team  # made before anything is traced
    waited, since = np.zeros(len(p)), 0.0
    for k, on in enumerate(fresh):
        waited[k] = since = since + DT
        since *= 1 - on
    steps = tuple(map(jnp.asarray, (np.arange(len(p)), p, labels, np.asarray(fresh, float), waited)))
    return jax.jit(lambda: jax.lax.scan(tick, listener.init(team), steps)[1])()


def listener(
    fade: float = np.inf, span: float = 0.5, hold: float = 0.0, doubt: float = 0.0, coherence: float = 0.0
) -> residual_correction.InnovationFilter:
    given = {
        "decay_time": fade,
        "averaging_time": span,
        "hold_time": hold,
        "variance_ratio": doubt,
        "coherence": coherence,
    }
    return residual_correction.InnovationFilter(filters=FILTERS, **{name: jnp.array(x) for name, x in given.items()})


def variances() -> np.ndarray:
    """Of the payload's labels."""
    v = residual_correction.label_noise_variance(plan().controller.residual_model).payload
    return np.concatenate([v.F, v.tau])


def offset(mean: Any, k: Any = 0) -> residual_model.ResidualModel:
    """An oracle of update k that predicts a constant wrench."""
    hyper = dataclasses.replace(plan().controller.residual_model.payload.hyper, constant_mean=jnp.full(6, mean))
    return dataclasses.replace(
        plan().controller.residual_model,
        payload=dataclasses.replace(plan().controller.residual_model.payload, hyper=hyper),
        update_index=jnp.asarray(k),
    )


def test_the_innovation_is_the_label_less_the_mean_behind():
    """Where labels are the mean behind the same filters nothing is left; else what they have beyond it."""
    rng = np.random.default_rng(0)
    p = np.cumsum(rng.normal(size=(TICKS, 3)), axis=0) * 0.05
    x = np.concatenate([p, np.zeros((TICKS, 3)), np.tile(np.eye(3).ravel(), (TICKS, 1)), np.zeros((TICKS, 9))], axis=1)
    seen = np.asarray(features.payload_features(jnp.asarray(x[::40])))
    hyper, capacity = plan().controller.residual_model.payload.hyper, plan().controller.residual_model.payload.capacity
    model = gp.condition(seen, rng.normal(size=(len(seen), 6)), hyper, capacity)
    taught = dataclasses.replace(plan().controller.residual_model, payload=model)
    W = jax.vmap(residual_model.predict_payload, (None, 0))(taught, jnp.asarray(x))
    f = np.concatenate([W.F, W.tau], axis=1)
    more = rng.normal(size=(TICKS, 6)).cumsum(axis=0) * 0.1
    labels = filtered(f) + more
    news = heard(listener(), lambda _k: taught, p, labels, np.ones(TICKS))
    r = np.concatenate([news.r.payload.F, news.r.payload.tau], axis=1)
    np.testing.assert_allclose(r, more, atol=1e-9)
    rate = np.concatenate([news.rate.payload.F, news.rate.payload.tau], axis=1)
    np.testing.assert_allclose(rate[1:], np.diff(more, axis=0) / DT, atol=1e-6)
    assert not rate[0].any()
    assert np.abs(f - f[0]).max() > 0.1


def test_when_labels_stop_what_is_left_fades_to_its_mean():
    """When labels stop what is left fades to its mean or is held."""
    t = DT * np.arange(TICKS)
    labels = np.tile((3.0 + np.sin(2 * np.pi * t / 0.1))[:, None], (1, 6))
    fresh = t < 0.5
    labels[~fresh] = labels[fresh][-1]  # as the estimator has it: they stand still
    p = np.zeros((TICKS, 3))
    used = lambda news: np.asarray(news.r.payload.F)[:, 0]  # noqa: E731
    np.testing.assert_allclose(
        used(heard(listener(), lambda _k: plan().controller.residual_model, p, labels, fresh)), labels[:, 0], atol=1e-12
    )
    news = heard(listener(fade=0.05, span=0.2), lambda _k: plan().controller.residual_model, p, labels, fresh)
    np.testing.assert_allclose(used(news)[fresh], labels[fresh, 0], atol=1e-12)
    np.testing.assert_allclose(news.correction_weight[fresh], 1.0)
    average, b = labels[0, 0], 1 - np.exp(-DT / 0.2)
    for y in labels[fresh, 0]:
        average += b * (y - average)
    v = np.asarray(plan().controller.residual_model.payload.hyper.noise_variance)[0]
    lasting = average**3 / (average**2 + 4 * v)
    left = np.exp(-DT / 0.05 * (1 + np.arange((~fresh).sum())))
    np.testing.assert_allclose(np.asarray(news.correction_weight)[~fresh], left, rtol=1e-9)
    np.testing.assert_allclose(used(news)[~fresh], lasting + left * (labels[-1, 0] - lasting), rtol=1e-9)


def test_what_another_oracle_says_more_is_taken():
    """Map and innovation together do not notice: their sum stays where labels are."""
    labels, p = np.full((TICKS, 6), 2.0), np.zeros((TICKS, 3))

    def oracle(k: jax.Array) -> residual_model.ResidualModel:
        later = (k >= 200).astype(int)
        return offset(0.5 + later.astype(float), later)

    news = heard(listener(), oracle, p, labels, np.ones(TICKS))
    F = np.asarray(news.r.payload.F)[:, 0]
    np.testing.assert_allclose(F[:200], 1.5, atol=1e-12)
    np.testing.assert_allclose(F[200:], 0.5, atol=1e-12)
    np.testing.assert_allclose(news.rate.payload.F, 0.0, atol=1e-9)


def test_an_estimator_without_labels_cannot_be_listened_to():
    lam = tuple(jnp.zeros_like(g.contact_position) for g in plan().controller.team.agent_groups)
    mute = StateEstimate(
        agents=plan().initial_state.agents, payload=plan().initial_state.payload, a_L=jnp.zeros(6), lam=lam
    )
    with pytest.raises(ValueError, match="provides no labels"):
        listener().update(
            listener().init(plan().controller.team),
            plan().controller.team,
            plan().controller.residual_model,
            mute,
            ControlClock(t=jnp.zeros(()), dt=jnp.array(DT)),
        )


def test_shipped_scenarios_in_which_the_world_changes_are_those():
    """Shipped scenarios in which the world changes are those of the paper but for what they say."""
    paper = scenario.load_scenario("paper").model_dump()
    for name, differs in {
        "payload_added": {"name", "description", "payload_mass_step"},
        "labels_lost": {"name", "description", "sensors"},
        "jets": {"name", "description", "disturbances"},
        "path_leaves": {"name", "description", "duration_s", "reference"},
        "outdoors": {"name", "description", "actuators", "nominal", "disturbances", "sensors", "control"},
    }.items():
        given = scenario.load_scenario(name).model_dump()
        assert {key for key in paper if paper[key] != given[key]} == differs


def test_labels_that_come_now_and_then_are_held_in_between():
    """Nothing fades between labels that are less than `hold` apart; once there are none for longer it does."""
    t = DT * np.arange(TICKS)
    on = (np.arange(TICKS) % 10 == 0) & (t < 0.5)
    last = np.maximum.accumulate(np.where(on, np.arange(TICKS), 0))
    labels = np.tile((1.0 + 2.0 * last / 10 * DT)[:, None], (1, 6))  # a filter that moves on at each label only
    news = heard(
        listener(fade=0.05, hold=0.05), lambda _k: plan().controller.residual_model, np.zeros((TICKS, 3)), labels, on
    )
    until = int(np.flatnonzero(on)[-1] + round(0.05 / DT))
    rate = np.asarray(news.rate.payload.F)[:, 0]
    np.testing.assert_allclose(rate[np.flatnonzero(on)[1:]], 2.0 / 10, rtol=1e-9)  # over the time since the last label
    silent = np.arange(1, 10)
    np.testing.assert_allclose(rate[np.flatnonzero(on)[1] + silent], 0.2 * 10 / (10 + silent), rtol=1e-9)
    assert until + 50 < TICKS
    np.testing.assert_allclose(np.asarray(news.correction_weight)[: until + 1], 1.0)
    np.testing.assert_allclose(np.asarray(news.r.payload.F)[: until + 1, 0], labels[: until + 1, 0], atol=1e-12)
    left = np.exp(-DT / 0.05 * np.arange(1, 51))
    np.testing.assert_allclose(np.asarray(news.correction_weight)[until + 1 : until + 51], left, rtol=1e-9)


def test_silence_that_has_been_as_long_lately_is_no_end():
    """Labels a tenth of a second apart go on for C4, though `hold` is half of that; then twice that is the end."""
    on = (np.arange(TICKS) % 50 == 0) & (np.arange(TICKS) <= 200)
    fresh = np.asarray(
        heard(
            listener(fade=0.01, hold=0.05, span=10.0),
            lambda _k: plan().controller.residual_model,
            np.zeros((TICKS, 3)),
            np.zeros((TICKS, 6)),
            on,
        ).correction_weight
    )
    assert fresh[26:49].min() < 0.5, "the first silence is longer than any before"
    np.testing.assert_allclose(fresh[150:295], 1.0, atol=0.01)
    assert fresh[310] < 0.5


def test_labels_are_late_by_their_delay_times_their_rate():
    t = DT * np.arange(TICKS)
    labels = np.tile((3.0 * t)[:, None], (1, 6))
    news = heard(
        listener(span=0.02), lambda _k: plan().controller.residual_model, np.zeros((TICKS, 3)), labels, np.ones(TICKS)
    )
    delay = 2 / (2 * np.pi * CORNERS["label"]) + 1 / (2 * np.pi * CORNERS["tip_force"])
    np.testing.assert_allclose(np.asarray(news.delay_error_rms.payload.F)[-1], 3.0 * delay, rtol=1e-6)


def corrected(f: np.ndarray) -> residual_correction.Innovation:
    """The news of a listener whose map lacks f, as labels tell it tick by tick."""
    none = offset(0.0)
    return heard(listener(), lambda _k: none, np.zeros((TICKS, 3)), filtered(f), np.ones(TICKS))


@pytest.mark.parametrize("seed", range(3))
def test_what_a_correction_leaves_is_at_most_the_labels_delay(seed):
    """`|f - r| <= D sup|df/dt| + sup|error|` of what a map lacks, twice the first with the lead."""
    rng = np.random.default_rng(seed)
    f = low(low(rng.normal(size=(TICKS, 6)).cumsum(axis=0), rng.uniform(1, 30)), 5.0)
    rate, delay = np.abs(np.diff(f, axis=0)).max(axis=0) / DT, float(FILTERS.label_delay())
    off = 0.01 * rng.uniform(-1, 1, size=f.shape)
    r = six(corrected(f + off).r.payload)
    assert (np.abs(f - r) <= delay * rate + 0.01 + 1e-12).all()
    exact = corrected(f)
    ahead = six(exact.r.payload) + delay * six(exact.rate.payload)
    assert (np.abs(f - ahead) <= 2 * delay * rate + 1e-12).all()


def test_on_a_ramp_a_correction_leaves_the_labels_delay_times():
    """On a ramp a correction leaves the labels delay times the rate."""
    slopes = np.linspace(-2, 2, 6)
    ramp = np.outer(np.arange(TICKS) * DT, slopes)
    left = (ramp - six(corrected(ramp).r.payload))[-1]
    np.testing.assert_allclose(left, (float(FILTERS.label_delay()) - 1.5 * DT) * slopes, rtol=1e-2)


def test_labels_that_come_now_and_then_are_as_late_again_as_they():
    """Of labels every tenth tick the last one is up to nine ticks old, four and a half on average."""
    t = DT * np.arange(TICKS)
    labels = np.tile((3.0 * t)[:, None], (1, 6))
    delay = 2 / (2 * np.pi * CORNERS["label"]) + 1 / (2 * np.pi * CORNERS["tip_force"])

    def late(on: np.ndarray) -> np.ndarray:
        held = labels[np.maximum.accumulate(np.where(on > 0, np.arange(TICKS), 0))]
        news = heard(
            listener(hold=1.0, span=0.005), lambda _k: plan().controller.residual_model, np.zeros((TICKS, 3)), held, on
        )
        return np.asarray(news.delay_error_rms.payload.F)[-10:].mean()

    always, tenth = late(np.ones(TICKS)), late(np.arange(TICKS) % 10 == 0)
    np.testing.assert_allclose(always, 3.0 * delay, rtol=1e-6)
    np.testing.assert_allclose(tenth, 3.0 * (delay + 4.5 * DT), rtol=0.05)


@pytest.mark.parametrize("fade", [0.005, np.inf])
def test_once_labels_stop_what_they_said_beyond_what_is_used(fade):
    """Of labels that swing about nothing: the root of their mean square, or about the one that is held."""
    t = DT * np.arange(TICKS)
    stop = TICKS // 2
    labels = np.tile((0.8 * np.sin(2 * np.pi * 20 * np.minimum(t, t[stop - 1])))[:, None], (1, 6))
    on = np.arange(TICKS) < stop
    oracle = plan().controller.residual_model
    news = heard(listener(fade=fade, span=0.1), lambda _k: oracle, np.zeros((TICKS, 3)), labels, on)
    left, r = (np.asarray(x.payload.F)[:, 0] for x in (news.correction_error_rms, news.r))
    np.testing.assert_array_equal(news.labels_available, on)
    swing, used = 0.8 / np.sqrt(2), r[-1]
    np.testing.assert_allclose(left[-1], np.hypot(swing, used), rtol=0.2)
    np.testing.assert_allclose(left[stop + 50 :], left[-1], rtol=1e-3)


def test_what_has_changed_for_good_is_counted_anew_where_a_body():
    """An oracle that takes in what labels said leaves nothing to keep when they stop; one that does not leaves all."""
    labels, p = np.full((TICKS, 6), 2.0), np.zeros((TICKS, 3))
    on = np.arange(TICKS) < 210
    for taken_in, left in ((2.0, 0.0), (0.0, 2.0)):

        def oracle(k: jax.Array, taken_in: float = taken_in) -> residual_model.ResidualModel:
            later = (k >= 200).astype(int)
            return offset(taken_in * later.astype(float), later)

        news = heard(listener(fade=0.01, span=0.02), oracle, p, labels, on)
        v = np.asarray(plan().controller.residual_model.payload.hyper.noise_variance)[0]
        expected = left**3 / (left**2 + 4 * v)
        np.testing.assert_allclose(np.asarray(news.r.payload.F)[-1, 0], expected, atol=0.01)


class Nothing(residual_predictors.LearnedResidual):
    """A predictor that predicts nothing."""

    def predict(
        self,
        memory: Any,
        oracle: residual_model.ResidualModel,
        now: interfaces.ControlContext,
        to: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Nothing."""
        return zero_residual(now.team)


def predicted(last: residual_correction.Innovation, of: residual_predictors.LearnedResidual) -> Wrench:
    """The payload's residual as it is predicted, the map being another's."""
    pilot = plan().controller
    q_hat = observed(jnp.zeros(3), jnp.zeros(6), jnp.ones(()), jnp.array(DT))
    d, W = pilot.reference.evaluate(last.t), Wrench(F=jnp.zeros(3), tau=jnp.zeros(3))
    clock = ControlClock(t=last.t, dt=jnp.array(DT))
    now = interfaces.ControlContext(
        team=pilot.team,
        clock=clock,
        measurement=None,
        estimate=q_hat,
        setpoint=d,
        last_wrench=W,
        initialized=jnp.ones(()),
        innovation=last,
    )
    to = tracking.AccelerationCommand(a=jnp.zeros(3), alpha=jnp.zeros(3), jerk=jnp.zeros(3))
    heeded = tuple(jnp.ones(size) for size in pilot.team.sizes)
    predictor = residual_predictors.InnovationCorrection(
        base=of, lead_time=FILTERS.label_delay(), rate_attenuation=heeded
    )
    return predictor.predict((), offset(0.0), now, to).payload


def carried(news: residual_correction.Innovation) -> np.ndarray:
    """By what part of the labels' delay each output of the payload is carried ahead."""
    last = jax.tree.map(lambda x: x[-1], news)
    f = predicted(last, Nothing())
    more = np.concatenate([f.F - last.r.payload.F, f.tau - last.r.payload.tau])
    return more / np.concatenate([last.rate.payload.F, last.rate.payload.tau]) / float(FILTERS.label_delay())


def behind_the_labels_filter(x: np.ndarray) -> np.ndarray:
    return low(low(x, CORNERS["label"]), CORNERS["label"])


def foretold(labels: np.ndarray, coherence: float, on: np.ndarray | None = None) -> residual_correction.Innovation:
    """The news of these labels, beyond a map that says nothing."""
    on = np.ones(len(labels)) if on is None else on
    given = listener(doubt=10.0, coherence=coherence)
    return heard(given, lambda _k: offset(0.0), np.zeros((len(labels), 3)), labels, on)


def as_defined(labels: np.ndarray, coherence: float) -> np.ndarray:
    """w, tick by tick, written anew: a rate is held against the label one delay later, then the next one is."""
    v, delay, span = variances(), float(FILTERS.label_delay()), 5.0
    every = int(np.ceil(delay / DT - 1e-6))
    rate, h = np.diff(labels, axis=0, prepend=labels[:1]) / DT, np.exp(-2 * np.pi * CORNERS["label"] * delay)
    c, s, w, then, known = np.zeros(6), np.zeros(6), [], None, 0.0
    for k in range(len(labels)):
        if k > 0 and (k + 1) % every == 0:
            b = 1 - np.exp(-every * DT / span)
            known += b * (1 - known)
            if then is not None:
                told = every * DT * rate[then]
                c, s = c + b * ((labels[k] - labels[then]) * told - c), s + b * (told**2 - s)
            then = k
        w.append(np.clip(known * 10 * (c - h * s) / (1 - h) / (coherence * (v + 10 * s)), 0, 1))
    return np.array(w)


def test_how_much_of_a_rate_is_trusted_is_how_much_of_such_rates():
    """By means written anew. Of a swing it is `sin(omega D) / (omega D)`, less what noise foretells of itself."""
    rng, t = np.random.default_rng(1), DT * np.arange(6000)
    late, h = (
        DT * np.ceil(float(FILTERS.label_delay()) / DT),
        np.exp(-2 * np.pi * CORNERS["label"] * float(FILTERS.label_delay())),
    )
    white = behind_the_labels_filter(rng.normal(size=(len(t), 6)))
    white *= np.sqrt(variances()) / white[500:].std(axis=0)
    swing = lambda hertz: 1e3 * np.sqrt(variances()) * np.sin(2 * np.pi * hertz * t)[:, None]  # noqa: E731
    for labels, hertz in ((swing(0.5), 0.5), (swing(5.0), 5.0), (white, None)):
        w = six(foretold(labels, 1.0).extrapolation_gain.payload)
        np.testing.assert_allclose(w, as_defined(labels, 1.0), atol=1e-9)
        known = 1 - np.exp(-t[-1] / 5)
        came_true = 0.0 if hertz is None else max(0.0, known * (np.sinc(2 * hertz * late) - h) / (1 - h))
        np.testing.assert_allclose(w[-1], came_true, atol=0.08)


def test_a_correction_is_carried_ahead_as_far_as_its_rate():
    """Half of a swing's square may be noise; of who asks for no coherence the whole rate is."""
    rng, t = np.random.default_rng(1), DT * np.arange(3000)
    white = behind_the_labels_filter(rng.normal(size=(len(t), 6)))
    swing = 1e3 * np.sin(2 * np.pi * t)[:, None]
    assert carried(foretold(white, 0.5)).max() < 0.2
    np.testing.assert_allclose(carried(foretold(0 * white + swing, 0.5)), 1, atol=1e-6)
    np.testing.assert_allclose(carried(foretold(white, 0.0)), 1, rtol=1e-9)


def test_labels_that_stop_neither_prove_nor_disprove():
    """Labels that stop neither prove nor disprove what was foretold."""
    t = DT * np.arange(3000)
    labels = np.tile((10 * np.sin(2 * np.pi * 0.5 * np.minimum(t, 4.0)))[:, None], (1, 6))
    w = six(foretold(labels, 1.0, (t < 4.0).astype(float)).extrapolation_gain.payload)
    assert w[1990].min() > 0.5
    np.testing.assert_array_equal(w[2000:], np.broadcast_to(w[2000], w[2000:].shape))


def trusted_across(silence: float, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """w of a swing before labels are silent for so long, s, and at the first that comes again, so much higher."""
    t = DT * np.arange(4000)
    on = (t < 4.0) | (t >= 4.0 + silence)
    last = np.maximum.accumulate(np.where(on, np.arange(len(t)), 0))
    labels = np.tile((10 * np.sin(2 * np.pi * 0.5 * t) + jump * (t > 4.0))[last][:, None], (1, 6))
    given = listener(doubt=10.0, coherence=1.0, fade=0.3, hold=0.2)
    w = six(heard(given, lambda _k: offset(0.0), np.zeros((len(t), 3)), labels, on).extrapolation_gain.payload)
    return w[1999], w[int(np.flatnonzero(on & (t > 4.0))[0])]


@pytest.mark.parametrize("silence", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("jump", [0.0, 100.0])
def test_a_rate_from_before_labels_stopped_is_held_against(silence, jump):
    """However far labels have gone meanwhile, and however short of nothing trust in them has become."""
    before, again = trusted_across(silence, jump)
    assert before.min() > 0.5
    np.testing.assert_array_equal(again, before)


def test_a_pause_that_is_no_end_of_labels_counts():
    before, again = trusted_across(0.1, 100.0)
    assert (np.abs(again - before) > 0.1).all()


def test_another_oracle_is_nothing_that_came_true():
    """What it says more is no movement of what labels say beyond the mean."""
    t = DT * np.arange(3000)
    labels = np.tile((10 * np.sin(2 * np.pi * 0.5 * t))[:, None], (1, 6))

    def oracle(k: jax.Array) -> residual_model.ResidualModel:
        later = (k >= 1520).astype(int)
        return offset(50.0 * later.astype(float), later)

    given, p = listener(doubt=10.0, coherence=1.0), np.zeros((len(t), 3))
    one, other = (heard(given, of, p, labels, np.ones(len(t))) for of in (lambda _k: offset(0.0), oracle))
    np.testing.assert_allclose(six(one.extrapolation_gain.payload), six(other.extrapolation_gain.payload), atol=1e-6)


def moved(
    gain: float, doubt: float, on: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, residual_correction.Innovation]:
    """The payload's late mean along a path, labels that move `gain` times as far and noise, and the news of both."""
    rng = np.random.default_rng(2)
    t = DT * np.arange(2 * TICKS)
    p = np.stack([np.sin(2 * np.pi * t / 0.4), np.cos(2 * np.pi * t / 0.3), 0 * t], axis=1)
    x = np.concatenate([p, 0 * p, np.tile(np.eye(3).ravel(), (len(t), 1)), np.zeros((len(t), 9))], axis=1)
    seen = np.asarray(features.payload_features(jnp.asarray(x[::40])))
    y = 20 * np.sqrt(variances()) * np.stack([p[::40, i % 2] for i in range(6)], axis=1)
    taught = dataclasses.replace(
        plan().controller.residual_model,
        payload=gp.condition(
            seen, y, plan().controller.residual_model.payload.hyper, plan().controller.residual_model.payload.capacity
        ),
    )
    W = jax.vmap(residual_model.predict_payload, (None, 0))(taught, jnp.asarray(x))
    mean = low(low(low(np.concatenate([W.F, W.tau], axis=1), 50.0), 8.0), 8.0)
    labels = 3.0 + gain * mean + 0.1 * np.sqrt(variances()) * rng.normal(size=mean.shape)
    on = np.ones(len(t)) if on is None else on
    labels = labels[np.maximum.accumulate(np.where(on > 0, np.arange(len(t)), 0))]  # they stand still when they stop
    return mean, labels, heard(listener(doubt=doubt, fade=0.01), lambda _k: taught, p, labels, on)


def six(W: Wrench) -> np.ndarray:
    return np.concatenate([W.F, W.tau], axis=1)


def test_the_map_is_trusted_as_far_as_labels_move_with_it():
    """By two means over the last span, written anew; labels that stand still or go the other way leave none of it."""
    for gain in (1.0, 0.4, 0.0, -1.0):
        mean, labels, news = moved(gain, 10.0)
        b = 1 - np.exp(-DT / 0.5)
        dy, df = labels - low(labels, 8.0), mean - low(mean, 8.0)
        products, squares = (lfilter([b], [1, b - 1], df * other, axis=0) for other in (dy, df))
        expected = np.clip((variances() + 10 * products) / (variances() + 10 * squares), 0, 1)
        np.testing.assert_allclose(six(news.model_gain.payload), expected, atol=1e-9)
        np.testing.assert_allclose(expected[-1], max(gain, 0.0), atol=0.05)
        np.testing.assert_allclose(six(news.r.payload) + six(news.filtered_prediction.payload), labels, atol=1e-9)
        rate = np.diff(labels, axis=0) - expected[1:] * np.diff(mean, axis=0)
        np.testing.assert_allclose(six(news.rate.payload)[1:], rate / DT, atol=1e-7)
    assert (six(moved(0.0, 0.0)[2].model_gain.payload) == 1).all(), "who does not doubt trusts"


def test_where_labels_have_stopped_the_map_is_trusted():
    on = (np.arange(2 * TICKS) < 700).astype(float)
    trust = six(moved(0.0, 10.0, on)[2].model_gain.payload)
    assert trust[699].max() < 0.2
    assert trust[-1].min() > 0.999


def test_a_map_that_is_not_trusted_is_not_used():
    """The prediction is label and rate alone where alpha is 0, map and what labels say beyond where it is 1."""

    class Far(Nothing):
        """Predicts seven of everything."""

        def predict(
            self,
            memory: Any,
            oracle: residual_model.ResidualModel,
            now: interfaces.ControlContext,
            to: tracking.AccelerationCommand,
        ) -> ResidualForces:
            """Seven."""
            return jax.tree.map(lambda x: jnp.full_like(x, 7.0), zero_residual(now.team))

    like = zero_residual(plan().controller.team)
    for alpha, expected in ((0.0, 3.0), (0.5, 3.0 + 0.5 * (7 - 2)), (1.0, 7.0 + 1.0)):
        last = dataclasses.replace(
            residual_correction.zero_innovation(plan().controller.team, jnp.zeros(())),
            r=jax.tree.map(jnp.ones_like, like),
            filtered_prediction=jax.tree.map(lambda x: jnp.full_like(x, 2.0), like),
            model_gain=jax.tree.map(lambda x, alpha=alpha: jnp.full_like(x, alpha), like),
        )
        np.testing.assert_allclose(predicted(last, Far()).F, expected, rtol=1e-12)


def test_another_oracle_does_not_change_how_far_the_map():
    """What it says more is no movement of the mean."""
    labels, p = np.full((TICKS, 6), 2.0), np.zeros((TICKS, 3))
    news = heard(
        listener(doubt=1e6),
        lambda k: offset(5.0 * (k >= 200).astype(float), (k >= 200).astype(int)),
        p,
        labels,
        np.ones(TICKS),
    )
    np.testing.assert_allclose(six(news.model_gain.payload), 1.0, atol=1e-9)
    np.testing.assert_allclose(six(news.rate.payload), 0.0, atol=1e-9)
