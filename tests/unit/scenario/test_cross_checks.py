"""Tests of the sizes that validation predicts against those of a run."""

import re

import numpy as np
import pytest

from colift import scenario
from colift.closed_loop import signals
from colift.scenario import priors, team
from colift.scenario.cross_checks import log_size, model_outputs
from tests.support.varied_scenarios import mixed


@pytest.mark.parametrize("name", ["paper", "mixed"])
def test_predicted_log_size_is_an_upper_bound(name):
    s = mixed() if name == "mixed" else scenario.load_scenario(name)
    agents, contacts = len(s.agents), len(team.contact_names(s))
    joints = len(team.joint_names(s))
    sizes = {"time": 1, "agents": agents, "joints": joints, "contacts": contacts, "eta": 3 * contacts - 6}
    shapes = [re.findall(r"\w+", re.findall("'(.*)'", part)[0]) for part in signals.StepRecord.__annotations__.values()]
    logged = sum(np.prod([sizes[word] if word in sizes else int(word) for word in shape]) for shape in shapes)
    assert 0.8 * log_size(s.model_dump()) < logged <= log_size(s.model_dump())


def test_predicted_number_of_outputs_is_exact():
    """Validation predicts the number of model outputs."""
    s = mixed().model_copy(update={"learning": mixed().learning.model_copy(update={"max_samples": 3})})
    prior_model = priors.prior_model(s, team.team(s)[1])
    W = [prior_model.payload.inverse_cholesky, *(model.inverse_cholesky for model in prior_model.agents)]
    assert sum(matrices.size for matrices in W) == 3**2 * model_outputs(s.model_dump())
