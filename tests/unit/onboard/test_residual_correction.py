"""Tests of the innovation filter against an independent implementation, without labels, and at model replacements."""

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
def light_experiment() -> flight.Experiment:
    """Return the experiment of the smallest team, built on first use."""
    return experiment.make_experiment(light.settings(), "adaptive")


def blend(hertz: float) -> float:
    return 1 - np.exp(-2 * np.pi * hertz * DT)


def low_pass(x: np.ndarray, hertz: float) -> np.ndarray:
    """First-order low-pass that starts at its first sample."""
    b = blend(hertz)
    return lfilter([b], [1, b - 1], x, axis=0, zi=(1 - b) * x[:1])[0]


def filtered_label(x: np.ndarray) -> np.ndarray:
    """Apply the filters of labels."""
    return behind_the_labels_filter(low_pass(x, CORNERS["tip_force"]))


def estimate_with_label(p: Any, y: Any, on: Any, intervals: Any) -> StateEstimate:
    """Return an estimate with a payload at p and its label y; agents have no labels."""
    load = PayloadState(p=p, v=jnp.zeros(3), R=jnp.eye(3), omega=jnp.zeros(3))
    none = tuple(
        (jnp.zeros((n, 18 + 2 * g.tree.joints)), jnp.zeros((n, 6 + g.tree.joints)))
        for n, g in zip(
            light_experiment().controller.team.sizes, light_experiment().controller.team.agent_groups, strict=True
        )
    )
    labelled = TrainingSample(payload=(jnp.zeros(24), y), agents=none, valid=on, sample_interval=intervals)
    lam = tuple(jnp.zeros_like(g.contact_position) for g in light_experiment().controller.team.agent_groups)
    return StateEstimate(
        agents=light_experiment().initial_state.agents, payload=load, a_L=jnp.zeros(6), lam=lam, sample=labelled
    )


def innovations(
    innovation_filter: residual_correction.InnovationFilter,
    model: Any,
    p: np.ndarray,
    labels: np.ndarray,
    available: np.ndarray,
) -> residual_correction.Innovation:
    """Return the innovations along a payload path; `oracle(k)` is the model at step k."""

    def step(state: Any, context: tuple) -> tuple:
        k, *inputs = context
        q_hat = estimate_with_label(*inputs)
        return innovation_filter.update(
            state, team, model(k), q_hat, ControlClock(t=k.astype(float) * DT, dt=jnp.array(DT))
        )

    team = light_experiment().controller.team  # made before anything is traced
    intervals, since = np.zeros(len(p)), 0.0
    for k, on in enumerate(available):
        intervals[k] = since = since + DT
        since *= 1 - on
    steps = tuple(map(jnp.asarray, (np.arange(len(p)), p, labels, np.asarray(available, float), intervals)))
    return jax.jit(lambda: jax.lax.scan(step, innovation_filter.init(team), steps)[1])()


def make_filter(
    decay_time: float = np.inf,
    averaging_time: float = 0.5,
    hold_time: float = 0.0,
    variance_ratio: float = 0.0,
    coherence: float = 0.0,
) -> residual_correction.InnovationFilter:
    options = {
        "decay_time": decay_time,
        "averaging_time": averaging_time,
        "hold_time": hold_time,
        "variance_ratio": variance_ratio,
        "coherence": coherence,
    }
    return residual_correction.InnovationFilter(filters=FILTERS, **{name: jnp.array(x) for name, x in options.items()})


def payload_label_variances() -> np.ndarray:
    """Return the noise variances of the payload's labels."""
    v = residual_correction.label_noise_variance(light_experiment().controller.residual_model).payload
    return np.concatenate([v.F, v.tau])


def constant_model(mean: Any, k: Any = 0) -> residual_model.ResidualModel:
    """Return the model of update k that predicts a constant wrench."""
    hyper = dataclasses.replace(
        light_experiment().controller.residual_model.payload.hyper, constant_mean=jnp.full(6, mean)
    )
    return dataclasses.replace(
        light_experiment().controller.residual_model,
        payload=dataclasses.replace(light_experiment().controller.residual_model.payload, hyper=hyper),
        update_index=jnp.asarray(k),
    )


def test_innovation_is_label_minus_filtered_mean():
    """If labels equal the filtered mean the innovation is zero; otherwise it is the difference."""
    rng = np.random.default_rng(0)
    p = np.cumsum(rng.normal(size=(TICKS, 3)), axis=0) * 0.05
    x = np.concatenate([p, np.zeros((TICKS, 3)), np.tile(np.eye(3).ravel(), (TICKS, 1)), np.zeros((TICKS, 9))], axis=1)
    inputs = np.asarray(features.payload_features(jnp.asarray(x[::40])))
    hyper, capacity = (
        light_experiment().controller.residual_model.payload.hyper,
        light_experiment().controller.residual_model.payload.capacity,
    )
    model = gp.condition(inputs, rng.normal(size=(len(inputs), 6)), hyper, capacity)
    trained = dataclasses.replace(light_experiment().controller.residual_model, payload=model)
    W = jax.vmap(residual_model.predict_payload, (None, 0))(trained, jnp.asarray(x))
    f = np.concatenate([W.F, W.tau], axis=1)
    more = rng.normal(size=(TICKS, 6)).cumsum(axis=0) * 0.1
    labels = filtered_label(f) + more
    innovation = innovations(make_filter(), lambda _k: trained, p, labels, np.ones(TICKS))
    r = np.concatenate([innovation.r.payload.F, innovation.r.payload.tau], axis=1)
    np.testing.assert_allclose(r, more, atol=1e-9)
    rate = np.concatenate([innovation.rate.payload.F, innovation.rate.payload.tau], axis=1)
    np.testing.assert_allclose(rate[1:], np.diff(more, axis=0) / DT, atol=1e-6)
    assert not rate[0].any()
    assert np.abs(f - f[0]).max() > 0.1


def test_correction_decays_to_its_mean_without_labels():
    """Without labels the correction decays to its mean, or is held."""
    t = DT * np.arange(TICKS)
    labels = np.tile((3.0 + np.sin(2 * np.pi * t / 0.1))[:, None], (1, 6))
    available = t < 0.5
    labels[~available] = labels[available][-1]  # as in the estimator: constant
    p = np.zeros((TICKS, 3))
    used = lambda innovation: np.asarray(innovation.r.payload.F)[:, 0]  # noqa: E731
    np.testing.assert_allclose(
        used(innovations(make_filter(), lambda _k: light_experiment().controller.residual_model, p, labels, available)),
        labels[:, 0],
        atol=1e-12,
    )
    innovation = innovations(
        make_filter(decay_time=0.05, averaging_time=0.2),
        lambda _k: light_experiment().controller.residual_model,
        p,
        labels,
        available,
    )
    np.testing.assert_allclose(used(innovation)[available], labels[available, 0], atol=1e-12)
    np.testing.assert_allclose(innovation.correction_weight[available], 1.0)
    average, b = labels[0, 0], 1 - np.exp(-DT / 0.2)
    for y in labels[available, 0]:
        average += b * (y - average)
    v = np.asarray(light_experiment().controller.residual_model.payload.hyper.noise_variance)[0]
    lasting = average**3 / (average**2 + 4 * v)
    remaining = np.exp(-DT / 0.05 * (1 + np.arange((~available).sum())))
    np.testing.assert_allclose(np.asarray(innovation.correction_weight)[~available], remaining, rtol=1e-9)
    np.testing.assert_allclose(used(innovation)[~available], lasting + remaining * (labels[-1, 0] - lasting), rtol=1e-9)


def test_model_replacement_is_bumpless():
    """Prediction and innovation together stay at the labels."""
    labels, p = np.full((TICKS, 6), 2.0), np.zeros((TICKS, 3))

    def model(k: jax.Array) -> residual_model.ResidualModel:
        later = (k >= 200).astype(int)
        return constant_model(0.5 + later.astype(float), later)

    innovation = innovations(make_filter(), model, p, labels, np.ones(TICKS))
    F = np.asarray(innovation.r.payload.F)[:, 0]
    np.testing.assert_allclose(F[:200], 1.5, atol=1e-12)
    np.testing.assert_allclose(F[200:], 0.5, atol=1e-12)
    np.testing.assert_allclose(innovation.rate.payload.F, 0.0, atol=1e-9)


def test_estimator_without_labels_is_refused():
    lam = tuple(jnp.zeros_like(g.contact_position) for g in light_experiment().controller.team.agent_groups)
    without_labels = StateEstimate(
        agents=light_experiment().initial_state.agents,
        payload=light_experiment().initial_state.payload,
        a_L=jnp.zeros(6),
        lam=lam,
    )
    with pytest.raises(ValueError, match="provides no labels"):
        make_filter().update(
            make_filter().init(light_experiment().controller.team),
            light_experiment().controller.team,
            light_experiment().controller.residual_model,
            without_labels,
            ControlClock(t=jnp.zeros(()), dt=jnp.array(DT)),
        )


def test_changed_scenarios_differ_only_as_stated():
    """Shipped scenarios with changes differ from the paper's only in the stated sections."""
    paper = scenario.load_scenario("paper").model_dump()
    for name, differs in {
        "payload_added": {"name", "description", "payload_mass_step"},
        "labels_lost": {"name", "description", "sensors"},
        "jets": {"name", "description", "disturbances"},
        "path_leaves": {"name", "description", "duration_s", "reference"},
        "outdoors": {"name", "description", "actuators", "nominal", "disturbances", "sensors", "control"},
    }.items():
        options = scenario.load_scenario(name).model_dump()
        assert {key for key in paper if paper[key] != options[key]} == differs


def test_sparse_labels_are_held():
    """The correction is constant between labels less than `hold_time` apart and decays after longer gaps."""
    t = DT * np.arange(TICKS)
    on = (np.arange(TICKS) % 10 == 0) & (t < 0.5)
    last = np.maximum.accumulate(np.where(on, np.arange(TICKS), 0))
    labels = np.tile((1.0 + 2.0 * last / 10 * DT)[:, None], (1, 6))  # the filter changes at labels only
    innovation = innovations(
        make_filter(decay_time=0.05, hold_time=0.05),
        lambda _k: light_experiment().controller.residual_model,
        np.zeros((TICKS, 3)),
        labels,
        on,
    )
    until = int(np.flatnonzero(on)[-1] + round(0.05 / DT))
    rate = np.asarray(innovation.rate.payload.F)[:, 0]
    np.testing.assert_allclose(rate[np.flatnonzero(on)[1:]], 2.0 / 10, rtol=1e-9)  # over the time since the last label
    steps_since_label = np.arange(1, 10)
    np.testing.assert_allclose(
        rate[np.flatnonzero(on)[1] + steps_since_label], 0.2 * 10 / (10 + steps_since_label), rtol=1e-9
    )
    assert until + 50 < TICKS
    np.testing.assert_allclose(np.asarray(innovation.correction_weight)[: until + 1], 1.0)
    np.testing.assert_allclose(np.asarray(innovation.r.payload.F)[: until + 1, 0], labels[: until + 1, 0], atol=1e-12)
    remaining = np.exp(-DT / 0.05 * np.arange(1, 51))
    np.testing.assert_allclose(np.asarray(innovation.correction_weight)[until + 1 : until + 51], remaining, rtol=1e-9)


def test_recent_gaps_extend_the_hold_time():
    """Labels 0.1 s apart do not count as lost although the hold time is half of that; a gap of twice that length
    does.
    """
    on = (np.arange(TICKS) % 50 == 0) & (np.arange(TICKS) <= 200)
    available = np.asarray(
        innovations(
            make_filter(decay_time=0.01, hold_time=0.05, averaging_time=10.0),
            lambda _k: light_experiment().controller.residual_model,
            np.zeros((TICKS, 3)),
            np.zeros((TICKS, 6)),
            on,
        ).correction_weight
    )
    assert available[26:49].min() < 0.5, "the first gap is longer than any earlier one"
    np.testing.assert_allclose(available[150:295], 1.0, atol=0.01)
    assert available[310] < 0.5


def test_delay_error_is_delay_times_rate():
    t = DT * np.arange(TICKS)
    labels = np.tile((3.0 * t)[:, None], (1, 6))
    innovation = innovations(
        make_filter(averaging_time=0.02),
        lambda _k: light_experiment().controller.residual_model,
        np.zeros((TICKS, 3)),
        labels,
        np.ones(TICKS),
    )
    delay = 2 / (2 * np.pi * CORNERS["label"]) + 1 / (2 * np.pi * CORNERS["tip_force"])
    np.testing.assert_allclose(np.asarray(innovation.delay_error_rms.payload.F)[-1], 3.0 * delay, rtol=1e-6)


def zero_model_innovations(f: np.ndarray) -> residual_correction.Innovation:
    """Return the innovations of a zero model for the labels of f."""
    none = constant_model(0.0)
    return innovations(make_filter(), lambda _k: none, np.zeros((TICKS, 3)), filtered_label(f), np.ones(TICKS))


@pytest.mark.parametrize("seed", range(3))
def test_correction_error_is_bounded_by_the_label_delay(seed):
    """`|f - r| <= D sup|df/dt| + sup|error|`; with the lead twice the first term."""
    rng = np.random.default_rng(seed)
    f = low_pass(low_pass(rng.normal(size=(TICKS, 6)).cumsum(axis=0), rng.uniform(1, 30)), 5.0)
    rate, delay = np.abs(np.diff(f, axis=0)).max(axis=0) / DT, float(FILTERS.label_delay())
    off = 0.01 * rng.uniform(-1, 1, size=f.shape)
    r = six(zero_model_innovations(f + off).r.payload)
    assert (np.abs(f - r) <= delay * rate + 0.01 + 1e-12).all()
    exact = zero_model_innovations(f)
    ahead = six(exact.r.payload) + delay * six(exact.rate.payload)
    assert (np.abs(f - ahead) <= 2 * delay * rate + 1e-12).all()


def test_correction_error_on_a_ramp():
    """On a ramp the correction error is the label delay times the rate."""
    slopes = np.linspace(-2, 2, 6)
    ramp = np.outer(np.arange(TICKS) * DT, slopes)
    remaining = (ramp - six(zero_model_innovations(ramp).r.payload))[-1]
    np.testing.assert_allclose(remaining, (float(FILTERS.label_delay()) - 1.5 * DT) * slopes, rtol=1e-2)


def test_sparse_labels_add_their_mean_age_to_the_delay():
    """With a label every tenth step the last label is up to nine steps old, 4.5 on average."""
    t = DT * np.arange(TICKS)
    labels = np.tile((3.0 * t)[:, None], (1, 6))
    delay = 2 / (2 * np.pi * CORNERS["label"]) + 1 / (2 * np.pi * CORNERS["tip_force"])

    def late(on: np.ndarray) -> np.ndarray:
        held = labels[np.maximum.accumulate(np.where(on > 0, np.arange(TICKS), 0))]
        innovation = innovations(
            make_filter(hold_time=1.0, averaging_time=0.005),
            lambda _k: light_experiment().controller.residual_model,
            np.zeros((TICKS, 3)),
            held,
            on,
        )
        return np.asarray(innovation.delay_error_rms.payload.F)[-10:].mean()

    always, tenth = late(np.ones(TICKS)), late(np.arange(TICKS) % 10 == 0)
    np.testing.assert_allclose(always, 3.0 * delay, rtol=1e-6)
    np.testing.assert_allclose(tenth, 3.0 * (delay + 4.5 * DT), rtol=0.05)


@pytest.mark.parametrize("decay_time", [0.005, np.inf])
def test_correction_error_after_labels_stop(decay_time):
    """For labels that oscillate about zero: the root of their mean square, or about the held value."""
    t = DT * np.arange(TICKS)
    stop = TICKS // 2
    labels = np.tile((0.8 * np.sin(2 * np.pi * 20 * np.minimum(t, t[stop - 1])))[:, None], (1, 6))
    on = np.arange(TICKS) < stop
    model = light_experiment().controller.residual_model
    innovation = innovations(
        make_filter(decay_time=decay_time, averaging_time=0.1), lambda _k: model, np.zeros((TICKS, 3)), labels, on
    )
    remaining, r = (np.asarray(x.payload.F)[:, 0] for x in (innovation.correction_error_rms, innovation.r))
    np.testing.assert_array_equal(innovation.labels_available, on)
    swing, used = 0.8 / np.sqrt(2), r[-1]
    np.testing.assert_allclose(remaining[-1], np.hypot(swing, used), rtol=0.2)
    np.testing.assert_allclose(remaining[stop + 50 :], remaining[-1], rtol=1e-3)


def test_lasting_innovation_restarts_at_a_new_model():
    """A new model that contains the labels leaves no correction when labels stop; another model leaves all of it."""
    labels, p = np.full((TICKS, 6), 2.0), np.zeros((TICKS, 3))
    on = np.arange(TICKS) < 210
    for taken_in, remaining in ((2.0, 0.0), (0.0, 2.0)):

        def model(k: jax.Array, taken_in: float = taken_in) -> residual_model.ResidualModel:
            later = (k >= 200).astype(int)
            return constant_model(taken_in * later.astype(float), later)

        innovation = innovations(make_filter(decay_time=0.01, averaging_time=0.02), model, p, labels, on)
        v = np.asarray(light_experiment().controller.residual_model.payload.hyper.noise_variance)[0]
        expected = remaining**3 / (remaining**2 + 4 * v)
        np.testing.assert_allclose(np.asarray(innovation.r.payload.F)[-1, 0], expected, atol=0.01)


class ZeroPredictor(residual_predictors.LearnedResidual):
    """Predictor that predicts zero."""

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: interfaces.ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Return zero."""
        return zero_residual(context.team)


def predict_payload(last: residual_correction.Innovation, of: residual_predictors.LearnedResidual) -> Wrench:
    """Return the predicted payload residual for another base predictor."""
    controller = light_experiment().controller
    q_hat = estimate_with_label(jnp.zeros(3), jnp.zeros(6), jnp.ones(()), jnp.array(DT))
    d, W = controller.reference.evaluate(last.t), Wrench(F=jnp.zeros(3), tau=jnp.zeros(3))
    clock = ControlClock(t=last.t, dt=jnp.array(DT))
    context = interfaces.ControlContext(
        team=controller.team,
        clock=clock,
        measurement=None,
        estimate=q_hat,
        setpoint=d,
        last_wrench=W,
        initialized=jnp.ones(()),
        innovation=last,
    )
    acceleration_cmd = tracking.AccelerationCommand(a=jnp.zeros(3), alpha=jnp.zeros(3), jerk=jnp.zeros(3))
    attenuation = tuple(jnp.ones(size) for size in controller.team.sizes)
    predictor = residual_predictors.InnovationCorrection(
        base=of, lead_time=FILTERS.label_delay(), rate_attenuation=attenuation
    )
    return predictor.predict((), constant_model(0.0), context, acceleration_cmd).payload


def extrapolated_share(innovation: residual_correction.Innovation) -> np.ndarray:
    """Return the share of the label delay by which each payload output is extrapolated."""
    last = jax.tree.map(lambda x: x[-1], innovation)
    f = predict_payload(last, ZeroPredictor())
    more = np.concatenate([f.F - last.r.payload.F, f.tau - last.r.payload.tau])
    return more / np.concatenate([last.rate.payload.F, last.rate.payload.tau]) / float(FILTERS.label_delay())


def behind_the_labels_filter(x: np.ndarray) -> np.ndarray:
    return low_pass(low_pass(x, CORNERS["label"]), CORNERS["label"])


def innovations_of_labels(
    labels: np.ndarray, coherence: float, on: np.ndarray | None = None
) -> residual_correction.Innovation:
    """Return the innovations of these labels relative to a zero model."""
    on = np.ones(len(labels)) if on is None else on
    options = make_filter(variance_ratio=10.0, coherence=coherence)
    return innovations(options, lambda _k: constant_model(0.0), np.zeros((len(labels), 3)), labels, on)


def extrapolation_gain_by_definition(labels: np.ndarray, coherence: float) -> np.ndarray:
    """Return w by definition: a rate is compared with the label one delay later, then the next one is."""
    v, delay, averaging_time = payload_label_variances(), float(FILTERS.label_delay()), 5.0
    every = int(np.ceil(delay / DT - 1e-6))
    rate, h = np.diff(labels, axis=0, prepend=labels[:1]) / DT, np.exp(-2 * np.pi * CORNERS["label"] * delay)
    c, s, w, index, weight = np.zeros(6), np.zeros(6), [], None, 0.0
    for k in range(len(labels)):
        if k > 0 and (k + 1) % every == 0:
            b = 1 - np.exp(-every * DT / averaging_time)
            weight += b * (1 - weight)
            if index is not None:
                predicted_change = every * DT * rate[index]
                c, s = c + b * ((labels[k] - labels[index]) * predicted_change - c), s + b * (predicted_change**2 - s)
            index = k
        w.append(np.clip(weight * 10 * (c - h * s) / (1 - h) / (coherence * (v + 10 * s)), 0, 1))
    return np.array(w)


def test_extrapolation_gain_is_the_confirmed_share():
    """By independent running means; for a sine it is `sin(omega D) / (omega D)`, minus the share that noise
    confirms.
    """
    rng, t = np.random.default_rng(1), DT * np.arange(6000)
    late, h = (
        DT * np.ceil(float(FILTERS.label_delay()) / DT),
        np.exp(-2 * np.pi * CORNERS["label"] * float(FILTERS.label_delay())),
    )
    white = behind_the_labels_filter(rng.normal(size=(len(t), 6)))
    white *= np.sqrt(payload_label_variances()) / white[500:].std(axis=0)
    swing = lambda hertz: 1e3 * np.sqrt(payload_label_variances()) * np.sin(2 * np.pi * hertz * t)[:, None]  # noqa: E731
    for labels, hertz in ((swing(0.5), 0.5), (swing(5.0), 5.0), (white, None)):
        w = six(innovations_of_labels(labels, 1.0).extrapolation_gain.payload)
        np.testing.assert_allclose(w, extrapolation_gain_by_definition(labels, 1.0), atol=1e-9)
        weight = 1 - np.exp(-t[-1] / 5)
        confirmed = 0.0 if hertz is None else max(0.0, weight * (np.sinc(2 * hertz * late) - h) / (1 - h))
        np.testing.assert_allclose(w[-1], confirmed, atol=0.08)


def test_correction_is_extrapolated_by_the_confirmed_share():
    """Half of a sine's square may be noise; with coherence 0 the whole rate is used."""
    rng, t = np.random.default_rng(1), DT * np.arange(3000)
    white = behind_the_labels_filter(rng.normal(size=(len(t), 6)))
    swing = 1e3 * np.sin(2 * np.pi * t)[:, None]
    assert extrapolated_share(innovations_of_labels(white, 0.5)).max() < 0.2
    np.testing.assert_allclose(extrapolated_share(innovations_of_labels(0 * white + swing, 0.5)), 1, atol=1e-6)
    np.testing.assert_allclose(extrapolated_share(innovations_of_labels(white, 0.0)), 1, rtol=1e-9)


def test_extrapolation_gain_is_constant_without_labels():
    """Without labels the gain does not change."""
    t = DT * np.arange(3000)
    labels = np.tile((10 * np.sin(2 * np.pi * 0.5 * np.minimum(t, 4.0)))[:, None], (1, 6))
    w = six(innovations_of_labels(labels, 1.0, (t < 4.0).astype(float)).extrapolation_gain.payload)
    assert w[1990].min() > 0.5
    np.testing.assert_array_equal(w[2000:], np.broadcast_to(w[2000], w[2000:].shape))


def gain_across_gap(gap: float, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Return w of a sine before a gap of labels and at the first label after it, which is higher by a jump."""
    t = DT * np.arange(4000)
    on = (t < 4.0) | (t >= 4.0 + gap)
    last = np.maximum.accumulate(np.where(on, np.arange(len(t)), 0))
    labels = np.tile((10 * np.sin(2 * np.pi * 0.5 * t) + jump * (t > 4.0))[last][:, None], (1, 6))
    options = make_filter(variance_ratio=10.0, coherence=1.0, decay_time=0.3, hold_time=0.2)
    w = six(
        innovations(
            options, lambda _k: constant_model(0.0), np.zeros((len(t), 3)), labels, on
        ).extrapolation_gain.payload
    )
    return w[1999], w[int(np.flatnonzero(on & (t > 4.0))[0])]


@pytest.mark.parametrize("gap", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("jump", [0.0, 100.0])
def test_rates_before_a_gap_are_not_compared_after_it(gap, jump):
    """For any jump of the labels during the gap, also after the gain has decayed."""
    before, again = gain_across_gap(gap, jump)
    assert before.min() > 0.5
    np.testing.assert_array_equal(again, before)


def test_rates_before_a_short_gap_are_compared():
    before, again = gain_across_gap(0.1, 100.0)
    assert (np.abs(again - before) > 0.1).all()


def test_model_replacement_does_not_change_the_gain():
    """The difference of the models is no change of the innovation."""
    t = DT * np.arange(3000)
    labels = np.tile((10 * np.sin(2 * np.pi * 0.5 * t))[:, None], (1, 6))

    def model(k: jax.Array) -> residual_model.ResidualModel:
        later = (k >= 1520).astype(int)
        return constant_model(50.0 * later.astype(float), later)

    options, p = make_filter(variance_ratio=10.0, coherence=1.0), np.zeros((len(t), 3))
    one, other = (
        innovations(options, of, p, labels, np.ones(len(t))) for of in (lambda _k: constant_model(0.0), model)
    )
    np.testing.assert_allclose(six(one.extrapolation_gain.payload), six(other.extrapolation_gain.payload), atol=1e-6)


def labels_with_gain(
    gain: float, variance_ratio: float, on: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, residual_correction.Innovation]:
    """Return the filtered mean along a path, labels with `gain` times its changes plus noise, and the innovations."""
    rng = np.random.default_rng(2)
    t = DT * np.arange(2 * TICKS)
    p = np.stack([np.sin(2 * np.pi * t / 0.4), np.cos(2 * np.pi * t / 0.3), 0 * t], axis=1)
    x = np.concatenate([p, 0 * p, np.tile(np.eye(3).ravel(), (len(t), 1)), np.zeros((len(t), 9))], axis=1)
    inputs = np.asarray(features.payload_features(jnp.asarray(x[::40])))
    y = 20 * np.sqrt(payload_label_variances()) * np.stack([p[::40, i % 2] for i in range(6)], axis=1)
    trained = dataclasses.replace(
        light_experiment().controller.residual_model,
        payload=gp.condition(
            inputs,
            y,
            light_experiment().controller.residual_model.payload.hyper,
            light_experiment().controller.residual_model.payload.capacity,
        ),
    )
    W = jax.vmap(residual_model.predict_payload, (None, 0))(trained, jnp.asarray(x))
    mean = low_pass(low_pass(low_pass(np.concatenate([W.F, W.tau], axis=1), 50.0), 8.0), 8.0)
    labels = 3.0 + gain * mean + 0.1 * np.sqrt(payload_label_variances()) * rng.normal(size=mean.shape)
    on = np.ones(len(t)) if on is None else on
    labels = labels[np.maximum.accumulate(np.where(on > 0, np.arange(len(t)), 0))]  # constant without labels
    return (
        mean,
        labels,
        innovations(make_filter(variance_ratio=variance_ratio, decay_time=0.01), lambda _k: trained, p, labels, on),
    )


def six(W: Wrench) -> np.ndarray:
    return np.concatenate([W.F, W.tau], axis=1)


def test_model_gain_is_the_share_confirmed_by_labels():
    """By two independent running means; for labels that are constant or move in the opposite direction it is zero."""
    for gain in (1.0, 0.4, 0.0, -1.0):
        mean, labels, innovation = labels_with_gain(gain, 10.0)
        b = 1 - np.exp(-DT / 0.5)
        dy, df = labels - low_pass(labels, 8.0), mean - low_pass(mean, 8.0)
        products, squares = (lfilter([b], [1, b - 1], df * other, axis=0) for other in (dy, df))
        expected = np.clip(
            (payload_label_variances() + 10 * products) / (payload_label_variances() + 10 * squares), 0, 1
        )
        np.testing.assert_allclose(six(innovation.model_gain.payload), expected, atol=1e-9)
        np.testing.assert_allclose(expected[-1], max(gain, 0.0), atol=0.05)
        np.testing.assert_allclose(
            six(innovation.r.payload) + six(innovation.filtered_prediction.payload), labels, atol=1e-9
        )
        rate = np.diff(labels, axis=0) - expected[1:] * np.diff(mean, axis=0)
        np.testing.assert_allclose(six(innovation.rate.payload)[1:], rate / DT, atol=1e-7)
    assert (six(labels_with_gain(0.0, 0.0)[2].model_gain.payload) == 1).all(), (
        "without variance ratio the model gain is one"
    )


def test_model_gain_is_one_without_labels():
    on = (np.arange(2 * TICKS) < 700).astype(float)
    gain = six(labels_with_gain(0.0, 10.0, on)[2].model_gain.payload)
    assert gain[699].max() < 0.2
    assert gain[-1].min() > 0.999


def test_prediction_weights_model_and_label():
    """The prediction is label plus rate for alpha 0, and model plus innovation for alpha 1."""

    class Far(ZeroPredictor):
        """Predictor that predicts seven for all outputs."""

        def predict(
            self,
            state: Any,
            model: residual_model.ResidualModel,
            context: interfaces.ControlContext,
            acceleration_cmd: tracking.AccelerationCommand,
        ) -> ResidualForces:
            """Return seven."""
            return jax.tree.map(lambda x: jnp.full_like(x, 7.0), zero_residual(context.team))

    like = zero_residual(light_experiment().controller.team)
    for alpha, expected in ((0.0, 3.0), (0.5, 3.0 + 0.5 * (7 - 2)), (1.0, 7.0 + 1.0)):
        last = dataclasses.replace(
            residual_correction.zero_innovation(light_experiment().controller.team, jnp.zeros(())),
            r=jax.tree.map(jnp.ones_like, like),
            filtered_prediction=jax.tree.map(lambda x: jnp.full_like(x, 2.0), like),
            model_gain=jax.tree.map(lambda x, alpha=alpha: jnp.full_like(x, alpha), like),
        )
        np.testing.assert_allclose(predict_payload(last, Far()).F, expected, rtol=1e-12)


def test_model_replacement_does_not_change_model_gain():
    """The difference of the models is no change of the mean."""
    labels, p = np.full((TICKS, 6), 2.0), np.zeros((TICKS, 3))
    innovation = innovations(
        make_filter(variance_ratio=1e6),
        lambda k: constant_model(5.0 * (k >= 200).astype(float), (k >= 200).astype(int)),
        p,
        labels,
        np.ones(TICKS),
    )
    np.testing.assert_allclose(six(innovation.model_gain.payload), 1.0, atol=1e-9)
    np.testing.assert_allclose(six(innovation.rate.payload), 0.0, atol=1e-9)
