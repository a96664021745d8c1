"""Tests of the comparison of flights at rotor limits."""

from __future__ import annotations

import pytest

from evidence import rotor_limits


def flight(error: float | None, end: float = 12.0) -> dict:
    return {"e_p_rms_m": error, "end_s": end, "attitude_deg": 1.0, "termination_reason": "" if error else "ended"}


@pytest.mark.parametrize(
    ("smaller", "larger", "worse"),
    [
        (flight(0.002), flight(0.001), False),
        (flight(0.001), flight(0.00104), False),
        (flight(0.001), flight(0.0011), True),
        (flight(None, 5.0), flight(0.5), False),
        (flight(0.5), flight(None, 11.0), True),
        (flight(None, 5.0), flight(None, 6.0), False),
        (flight(None, 6.0), flight(None, 5.0), True),
    ],
)
def test_an_error_must_not_increase_with_the_limit(smaller, larger, worse):
    assert rotor_limits.worse(smaller, larger) == worse
    of = {"C1 30 301": smaller, "C1 31 301": larger, "C1 29.5 302": larger}
    assert rotor_limits.increases(of, "C1") == (worse, 1)


def test_a_coarse_grid_of_the_first_seed_comes_first():
    items = rotor_limits.items()
    assert items[:2] == ["C1 29 301", "C1 30 301"]
    assert len(items) == len(set(items)) == 3 * (43 * 5 + 2 * 20 + 5)


def test_the_need_of_least_squares_limits_a_constrained_flight(monkeypatch):
    """Both flights of an item have the constrained allocation, except that of the need."""
    flown = []
    monkeypatch.setattr(rotor_limits, "fly", lambda *arguments: flown.append(arguments))
    monkeypatch.setattr(rotor_limits, "rotor_need", lambda _: 40.0)
    monkeypatch.setattr(rotor_limits, "found", lambda _: {"attitude_deg": 11.0})
    for kind, allocation in rotor_limits.NEEDS.items():
        flown.clear()
        item = f"C3 {kind} 301"
        result = rotor_limits.simulate_item(item)
        assert flown == [("C3", 50.0, 301, 3.0, allocation), ("C3", 38.0, 301, 1000.0)]
        assert result["need_N"] == 40.0
        (target,) = [x for x in rotor_limits.targets({item: result}) if x.note == "0 of 1 flights"]
        assert target.description.endswith("of least squares") == (kind == "least_squares")


@pytest.mark.parametrize("case", ["C1", "adaptive"])
def test_in_a_dip_all_agents_have_90_percent_of_the_rotor_need(monkeypatch, case):
    made = []
    monkeypatch.setattr(rotor_limits, "fly", lambda *_: None)
    monkeypatch.setattr(rotor_limits, "rotor_need", lambda _: 30.0)
    monkeypatch.setattr(rotor_limits.experiment, "make_experiment", lambda *arguments: made.append(arguments))
    monkeypatch.setattr(rotor_limits, "run_experiment", lambda _: None)
    monkeypatch.setattr(rotor_limits.limits, "found", lambda _: {"before_m": 0.001})
    assert rotor_limits.simulate_item(f"{case} dip 302") == {"before_m": 0.001, "need_N": 30.0}
    ((settings, flown),) = made
    assert (flown, settings.seed, settings.duration_s) == (case, 302, 20.0)
    assert settings.control.position_error_bound_m is None
    assert [(f.who, f.start_s, f.end_s) for f in settings.faults] == [("front", 12.0, 15.0), ("rear", 12.0, 15.0)]
    assert [f.to for f in settings.faults] == pytest.approx([0.9 * 30 / 50] * 2)
