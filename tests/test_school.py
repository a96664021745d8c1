"""What is learned on the ground: when a body's world counts as changed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from colift import learn, place, school
from tests.test_learn import TRAINING, both, prior, samples

MEAN = place.Mean(payload=np.ones(14), agents=np.ones(5))
IDENTIFY = school.Identify(noise=np.full(6, 0.1), prior=np.full(10, 0.1))


@pytest.mark.parametrize(("enough", "changed"), [(60, ("payload",)), (150, ())])
def test_what_contradicts_a_model_of_enough_samples_is_another_world(enough, changed):
    """A model of 30 samples is one where 60 are enough, and knows no world yet where 150 are."""
    load, agents = samples(0, 40, 24, 6), samples(1, 40, 24, 9, (2,))
    first = [dataclasses.replace(data, n=data.n - 10) for data in (load, agents)]
    oracle, _ = learn.teach(prior(), both(*first), TRAINING, {})
    given = school.Renewals(times=(), surprise=3.0, settle=0.0, enough=enough, payload=IDENTIFY, mean=MEAN)
    taught = school.School(None, None, given)
    taught.usual = {body: [1.0] for body in ("payload", (0, 0), (0, 1))}
    taught.last = 2.95
    other = dataclasses.replace(load, Y=load.Y.at[30:].add(50.0))
    _, update = taught.teach(oracle, both(other, agents), 4.0, fit=False)
    assert update.changed == changed
    assert update.failed == ""
