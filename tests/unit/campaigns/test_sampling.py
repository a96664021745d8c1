"""Samples of a campaign: reproducible, extended without a change of the former ones."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from colift.campaigns import sampling, spec
from colift.scenario.cases import PAPER_CASES
from tests.support import campaigns

D = len(campaigns.VARIED)


def load(folder: Path, **changes: Any) -> spec.LoadedCampaign:
    return spec.load_campaign(campaigns.write(folder, **changes))


def values(planned: tuple[sampling.PlannedFlight, ...]) -> np.ndarray:
    return np.array([[value for _, value in flight.settings] for flight in planned])


@pytest.mark.parametrize("kind", ["sobol", "random"])
def test_samples_are_reproducible_and_extend(kind: str, tmp_path: Path):
    few, many = (sampling.plan_flights(load(tmp_path, sampling=kind, samples=n)) for n in (12, 40))
    assert few == sampling.plan_flights(load(tmp_path, sampling=kind, samples=12))
    assert many[:12] == few
    assert len({flight.id for flight in many}) == 40
    other = sampling.plan_flights(load(tmp_path, sampling=kind, samples=12, sampling_seed=1))
    assert not {flight.id for flight in other} & {flight.id for flight in few}


def test_samples_have_the_stated_distributions(tmp_path: Path):
    mass, K_p, position = values(sampling.plan_flights(load(tmp_path, samples=256))).T
    assert 1.4 <= mass.min() < 1.41
    assert 1.59 < mass.max() <= 1.6
    assert K_p.min() >= 4
    assert K_p.max() <= 6
    assert np.median(K_p) == pytest.approx(np.sqrt(24), rel=0.01)
    assert position.mean() == pytest.approx(0, abs=1e-3)
    assert position.std() == pytest.approx(0.05, rel=0.05)


def test_cases_of_a_sample_have_equal_settings_and_seed(tmp_path: Path):
    planned = sampling.plan_flights(load(tmp_path, cases=["c1", "C2", "C3"], samples=4))
    for k in range(4):
        group = planned[3 * k : 3 * k + 3]
        assert [flight.case for flight in group] == list(PAPER_CASES)
        assert len({(flight.sample, flight.seed, flight.settings) for flight in group}) == 1
    assert [flight.seed for flight in planned[::3]] == [0, 1, 2, 3]


def test_grids_and_seeds_are_combined(tmp_path: Path):
    vary = {"control.K_p": [4.0, 5.0], "control.K_v": [4, 4.5, 5]}
    planned = sampling.plan_flights(load(tmp_path, vary=vary, samples=1, seeds=[3, 9]))
    assert len(planned) == 12
    assert [flight.sample for flight in planned] == list(range(12))
    assert {flight.seed for flight in planned} == {3, 9}
    assert len({flight.settings for flight in planned}) == 6


def test_saltelli_exchanges_one_setting_at_a_time(tmp_path: Path):
    planned = sampling.plan_flights(load(tmp_path, sampling="saltelli", samples=8))
    A, B, *mixed = values(planned).reshape(D + 2, 8, D)
    for k, AB in enumerate(mixed):
        assert np.array_equal(AB[:, k], B[:, k])
        assert np.array_equal(np.delete(AB, k, axis=1), np.delete(A, k, axis=1))
    assert len({flight.seed for flight in planned}) == 1


def test_id_depends_on_what_changes_a_flight(tmp_path: Path):
    base = load(tmp_path, samples=1)
    longer = dataclasses.replace(base, spec=base.spec.model_copy(update={"duration_s": 0.3}))
    heavier = load(tmp_path, samples=1, overrides={"payload.inertia_kgm2": [0.05, 0.15, 0.18]})
    renamed = dataclasses.replace(base, name="other")
    ids = [sampling.plan_flights(each)[0].id for each in (base, longer, heavier, renamed)]
    assert len(set(ids)) == 3
    assert ids[0] == ids[3]
