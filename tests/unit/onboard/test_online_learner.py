"""What is learned on the ground: when a body's world counts as changed."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from colift import gp
from colift.models.parameters import Payload
from colift.onboard.learning import features, identification, model_update, online_learner, semiparametric
from tests.unit.onboard.test_residual_model import CAPACITY, TRAINING, both, prior, samples

BELIEVED = Payload(mass=jnp.ones(()), inertia=jnp.eye(3))
MEAN = semiparametric.MeanPrior(payload=np.ones(14), agents=np.ones(5), nominal_payload=BELIEVED)


def going_on(enough: int) -> online_learner.OnlineLearner:
    """Of a flight whose learning does not end."""
    given = online_learner.OnlineUpdateOptions(times=(), transient_time=0.0, min_samples=enough, mean_prior=MEAN)
    return online_learner.OnlineLearner(None, None, given)


@pytest.mark.parametrize(("enough", "changed"), [(60, ("payload",)), (150, ())])
def test_what_contradicts_a_model_of_enough_samples_is_another(enough, changed):
    """A model of 30 samples is one where 60 are enough, and knows no world yet where 150 are."""
    load, agents = samples(0, 40, 24, 6), samples(1, 40, 24, 9, (2,))
    first = [dataclasses.replace(data, n=data.n - 10) for data in (load, agents)]
    oracle, _ = model_update.fit(prior(), both(*first), TRAINING, {})
    taught = going_on(enough)
    taught.nis_history = {body: [1.0] for body in ("payload", (0, 0), (0, 1))}
    taught.last_sample_time = 2.95
    other = dataclasses.replace(load, Y=load.Y.at[30:].add(50.0))
    _, update = taught.update(oracle, both(other, agents), 4.0, fit=False)
    assert update.change_points == changed
    assert update.error_message == ""


def early() -> tuple[gp.Dataset, gp.Dataset]:
    """40 samples of a payload and of two agents, from 0.1 s on."""
    each = samples(0, 40, 24, 6), samples(1, 40, 24, 9, (2,))
    load, agents = (dataclasses.replace(data, t=data.t + 0.1) for data in each)
    return first(load, 40), first(agents, 40)


def first(data: gp.Dataset, n: int) -> gp.Dataset:
    """The first n samples; as in flight, rows that are not in use have no time."""
    t = np.where(np.arange(data.t.shape[-1]) < n, data.t, 0.0)
    return dataclasses.replace(data, t=jnp.asarray(t), n=jnp.full(data.n.shape, n))


def later(data: gp.Dataset, by: float) -> gp.Dataset:
    """The same samples, so many seconds later."""
    return first(dataclasses.replace(data, t=data.t + by), int(data.n.max()))


def test_what_was_learned_once_is_known_when_its_samples():
    """Three budgets of samples, each elsewhere: the recorder holds the last alone."""
    taught = going_on(1000)
    load, agents = early()
    oracle, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    asked = features.payload_features(load.X[:40:4])
    before = gp.predict(oracle.payload, asked)
    oracle, update = taught.update(oracle, both(load, agents), 4.0, fit=False)
    assert update.num_samples == {"payload": 40, "agents": 80}
    for k in (1, 2):
        hover = [jnp.broadcast_to(x[k][None], x.shape) for x in (load.X, load.Y)]
        newest = dataclasses.replace(later(load, 10.0 * k), X=hover[0], Y=hover[1])
        oracle, update = taught.update(oracle, both(newest, agents), 10.0 * k + 4, fit=False)
    assert update.num_samples["payload"] == CAPACITY
    after = gp.predict(oracle.payload, asked)
    np.testing.assert_allclose(after[0], before[0], atol=0.05)
    assert float(after[1].max()) < 3 * float(before[1].max())


def test_where_learning_fails_nothing_is_lost(monkeypatch):
    """The oracle stays as it was, the update says why, and the next look finds and learns what this one could not."""
    taught, (load, agents) = going_on(1000), early()
    oracle, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    taught.online_updates = dataclasses.replace(taught.online_updates, min_samples=60)
    taught.nis_history = {body: [1.0] for body in ("payload", (0, 0), (0, 1))}
    other = both(dataclasses.replace(load, Y=load.Y + 50.0), agents)
    with monkeypatch.context() as patch:
        patch.setattr(model_update, "condition", lambda *_: (_ for _ in ()).throw(ValueError("no factor")))
        same, update = taught.update(oracle, other, 4.0, fit=False)
    assert same is oracle
    assert "no factor" in update.error_message
    assert update.change_points == update.refitted == ()
    assert not taught.change_points
    assert taught.nis_history["payload"] == [1.0]
    _, update = taught.update(oracle, other, 5.0, fit=False)
    assert update.error_message == ""
    assert update.change_points == ("payload",)
    assert update.num_samples == {"payload": 40, "agents": 80}


def test_a_sample_of_the_very_tick_of_a_look_is_seen_by_the_next():
    """What is recorded at that tick comes after the look, with its time."""
    taught, (load, agents) = going_on(1000), early()
    oracle, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    at = float(load.t[39])
    taught.update(oracle, both(first(load, 39), first(agents, 39)), at, fit=False)
    _, update = taught.update(oracle, both(load, agents), at + 1, fit=False)
    assert update.num_samples == {"payload": 40, "agents": 80}


def test_a_change_is_not_over_while_a_model_of_before_waits():
    taught, (load, agents) = going_on(60), early()
    oracle, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    taught.update(oracle, both(load, agents), 4.2, fit=False)
    taught.change_points, taught.pending = (
        {"payload": model_update.make_change_point(oracle, "payload", 4.3)},
        {"payload"},
    )
    after = both(later(load, 10.0), later(agents, 10.0))
    taught.update(oracle, after, 15.0, fit=True)
    assert "payload" in taught.change_points
    taught.update(oracle, after, 16.0, fit=False)


@pytest.mark.parametrize(("since", "over"), [(2.0, True), (3.5, False)])
def test_a_change_is_over_at_a_fit_once_no_sample_of_before(since, over):
    """Of 80 samples 48 stay: 61 are of after 2 s, 46 of after 3.5 s."""
    taught, (load, agents) = going_on(20), early()
    oracle, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    taught.change_points = {"payload": model_update.make_change_point(oracle, "payload", since)}
    taught.update(oracle, both(load, agents), 5.0, fit=False)
    assert "payload" in taught.change_points
    taught.update(oracle, both(later(load, 4.0), agents), 9.0, fit=True)
    assert ("payload" not in taught.change_points) == over


@pytest.mark.parametrize("misfit", [True, False])
def test_a_model_that_waits_is_not_asked_and_a_new_one_is_held(misfit, monkeypatch):
    """What contradicts it is another world at 4 s, and nothing at 8 s, while the model of before waits for enough.

    Labels that jump from sample to sample, which no model of these length-scales fits, are a misfit at 12 s; where
    they are smooth and go elsewhere at 12 s that is another world again.
    """
    fitted = []
    monkeypatch.setattr(semiparametric, "fit", lambda oracle, *given: fitted.append(given[4]) or (oracle, {}, {}))
    taught = going_on(45)
    taught.fit_options = TRAINING
    taught.nis_history = {body: [1.0] for body in ("payload", (0, 0), (0, 1))}
    load, agents = early()
    oracle, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    taught.data, taught.last_sample_time = both(load, agents), 4.0
    jumps = 50.0 * (-1.0) ** np.arange(CAPACITY)[:, None] * np.ones(6)

    def more(k):
        """Of the k-th four seconds; of the second only some, so that there are too few."""
        off = jumps if misfit else np.full((CAPACITY, 6), -80.0 if k == 3 else 50.0)
        late = dataclasses.replace(later(load, 4.0 * k), Y=load.Y + jnp.asarray(off))
        return both(first(late, 20 if k == 2 else 40), first(agents, 0))

    oracle, update = taught.update(oracle, more(1), 8.0, fit=False)
    assert update.change_points == ("payload",)
    assert taught.pending == {"payload"}
    assert oracle.payload.num_points == 40  # the model of before
    oracle, update = taught.update(oracle, more(2), 12.0, fit=False)
    assert update.change_points == update.refitted == ()
    assert taught.pending == {"payload"}
    oracle, update = taught.update(oracle, more(3), 16.0, fit=False)
    assert update.change_points == (() if misfit else ("payload",))
    assert update.refitted == (("payload",) if misfit else ())
    assert ("payload" in taught.change_points) != misfit
    assert fitted == ([["payload"]] if misfit else [])
    if misfit:
        assert model_update.samples_by_body(taught.data)["payload"][2].min() > 4.0  # what is left of before is gone


def test_what_surprises_long_after_a_change_is_another_one():
    taught = going_on(30)
    taught.nis_history = {body: [1.0] for body in ("payload", (0, 0), (0, 1))}
    load, agents = early()
    oracle, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    taught.data, taught.last_sample_time = both(load, agents), 4.0
    taught.change_points = {"payload": model_update.make_change_point(oracle, "payload", 0.05)}
    late = dataclasses.replace(later(load, 4.0), Y=load.Y + 50.0)
    _, update = taught.update(oracle, both(late, agents), 8.0, fit=False)
    assert update.change_points == ("payload",)
    assert taught.change_points["payload"].time > 4.0


def test_parameters_that_leave_no_body_are_not_believed():
    """Labels that ask for more inertia than there is: as much of it goes as a tenth allows, and mass stays as told."""
    load, agents = samples(0, 40, 24, 6), samples(1, 40, 24, 9, (2,))
    theta = np.array([0.2, 0, 0, 0, 2.0, 0, 0, 0, 0, 0])
    Y = jnp.asarray(identification.inertial_regressors(np.asarray(load.X)) @ theta)
    given = online_learner.IdentificationOptions(
        label_std=np.full(6, 0.01), prior_std=np.full(10, 1.0), nominal_payload=BELIEVED
    )
    taught, _ = online_learner.OnlineLearner(None, given, None).update(
        prior(), both(dataclasses.replace(load, Y=Y), agents), 4.0, True
    )
    np.testing.assert_allclose(taught.inertial_parameters[0], 0.2, atol=0.01)
    np.testing.assert_allclose(taught.inertial_parameters[4], 0.9, atol=0.01)
