"""Logs for playback tests: a short flight of the smallest team, simulated once per process, and random ones."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import xarray as xr

from colift import scenario
from colift.closed_loop import log, signals
from colift.closed_loop.flight import run_experiment
from colift.onboard.learning import prediction_uncertainty
from colift.scenario import experiment, team
from tests.support import random_logs as flights
from tests.support import small_team as light

PAPER = scenario.load_scenario("paper")
CASES = {"C1": "no learning", "C3": "payload and agent learning"}


def labelled(
    rows: signals.StepRecord,
    sigma: prediction_uncertainty.PredictionUncertainty,
    settings: scenario.Scenario,
    **attrs: Any,
) -> xr.Dataset:
    """Return a log as a study writes it, with the attributes that pages use."""
    attributes = {
        "termination_reason": "",
        "complete": 1,
        "update_times_s": [],
        "T_end_s": settings.learning.end_s,
        "version": "0.1.0",
    }
    attributes |= {"scenario_json": settings.model_dump_json(exclude_none=True), "run": flights.RUN, "case": "C1"}
    names = (team.agent_names(settings), team.joint_names(settings), team.contact_names(settings))
    named = dict(zip(("agents", "joints", "contacts"), names, strict=True))
    return log.dataset(rows, team=team.team(settings)[0], sigma=sigma, attrs=attributes | attrs, **named)


@functools.cache
def short_flight() -> scenario.Scenario:
    """Return a short flight of the smallest team with one update."""
    learning = light.SAMPLE.learning.model_copy(update={"update_times_s": (0.8,), "end_s": 0.8, "start_s": 0.1})
    return light.settings(learning=learning, duration_s=1.5)


@functools.cache
def two_case_logs() -> dict[str, xr.Dataset]:
    """Return logs of two cases of that flight."""
    found = {}
    for case, one_experiment in experiment.make_experiments(short_flight(), tuple(CASES)).items():
        flight = run_experiment(one_experiment)
        assert not flight.termination_reason
        updates = [update.t for update in flight.updates]
        found[case] = labelled(flight.records, flight.uncertainty, short_flight(), update_times_s=updates, case=case)
    return found


def random_log(shape: flights.Shape = flights.PAPER, settings: scenario.Scenario = PAPER) -> xr.Dataset:
    """Return a random log of the paper's team."""
    rng = np.random.default_rng(8)
    return labelled(flights.rows(rng, shape), flights.sigma(rng, shape), settings)
