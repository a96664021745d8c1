"""Rows of flights: equal to single flights to rounding, and with the reason of an early end."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

import colift
from colift.campaigns import driver, spec
from colift.closed_loop import log
from colift.scenario import SUFFIXES
from tests.support import campaigns

SHIPPED = sorted((Path(__file__).parents[3] / "campaigns").glob("*.yaml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_campaign_is_valid(path: Path):
    assert path.suffix in SUFFIXES
    assert driver.plan_flights(spec.load_campaign(path))


def test_row_has_the_metrics_of_the_single_flight(tmp_path: Path):
    path, out = campaigns.write(tmp_path, samples=3, keep="signals"), tmp_path / "out"
    campaigns.run(path, out, campaigns.InlineEngine())
    row = campaigns.numbers(path, out)[2]
    campaign = spec.load_campaign(path)
    planned = driver.plan_flights(campaign)[2]
    scenario = colift.load_scenario(campaign.file, overrides=dict(planned.settings) | {"seed": planned.seed})
    experiment = dataclasses.replace(colift.make_experiment(scenario, "C1"), duration=0.2)
    flight = colift.run_experiment(experiment)
    assert row["id"] == planned.id
    assert row["complete"]
    for name in ("e_p_rms_m", "e_R_rms", "lam_max_N", "thrust_max_N", "sigma_L_mean"):
        assert row[name] == pytest.approx(flight.metrics[name], rel=1e-9)
    assert row["miscoverage.payload.rate.0"] == flight.metrics["miscoverage"]["payload"]["rate"][0]
    (signals,) = [file for file in (out / "signals").iterdir() if planned.id.startswith(file.stem)]
    assert log.load(signals).sizes["time"] == len(flight.records.t)


def test_flights_that_end_early_have_a_reason(tmp_path: Path):
    """A payload of 60 kg cannot be carried, and a payload that starts with 5 m/s moves too far away."""
    path = campaigns.write(
        tmp_path,
        samples=1,
        overrides={"termination.max_position_error_m": 0.5},
        vary={"payload.mass_kg": [1.5, 60.0], "initial_state.velocity_mps.0": [0.0, 5.0]},
    )
    campaigns.run(path, tmp_path / "out", campaigns.InlineEngine())
    reasons = [row["termination_reason"] for row in campaigns.numbers(path, tmp_path / "out")]
    assert reasons[0] == ""
    assert "max_position_error_m" in reasons[1] or "reference" in reasons[1]
    assert all(reason.startswith("refused: ") for reason in reasons[2:])
