"""Statistics of campaigns against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.stats import qmc

from colift.campaigns import sampling, statistics


def rows(errors: dict[str, list[float]]) -> pd.DataFrame:
    """Return the table of a campaign; an error of infinity is a flight that ended early."""
    found = [
        {"sample": k, "case": case, "complete": math.isfinite(value), "e_p_rms_m": value if value < math.inf else 1.0}
        for k in range(len(next(iter(errors.values()))))
        for case, value in zip(errors, (series[k] for series in errors.values()), strict=True)
    ]
    return pd.DataFrame(found)


def test_orderings_count_flights_that_ended_early_as_infinite():
    inf = math.inf
    table = rows({"C1": [3.0, 3.0, inf, inf, 1.0], "C2": [2.0, 2.0, 2.0, inf, 2.0], "C3": [1.0, 2.5, 1.0, 1.0, 3.0]})
    found = {each.meaning: (each.count, each.total) for each in statistics.orderings(table)}
    assert found == {"C2 < C1": (3, 5), "C3 < C2": (3, 5), "C3 < C2 < C1": (2, 5)}
    complete = {each.meaning: each.count for each in statistics.complete_flights(table)}
    assert complete == {"C1 is complete": 3, "C2 is complete": 4, "C3 is complete": 5}


def test_fraction_has_the_exact_binomial_interval():
    """The limits of Clopper and Pearson are quantiles of beta distributions."""
    found = statistics.fraction("", [True] * 7 + [False] * 3).interval
    assert found.value == 0.7
    assert found.low == pytest.approx(stats.beta.ppf(0.025, 7, 4))
    assert found.high == pytest.approx(stats.beta.ppf(0.975, 8, 3))


def test_holm_corrects_for_the_number_of_tests():
    assert statistics.holm([0.01, 0.04, 0.03, math.nan]) == pytest.approx([0.03, 0.06, 0.06, math.nan], nan_ok=True)
    assert statistics.holm([0.5, 0.9]) == [1.0, 1.0]


def test_paired_ratio_removes_the_common_variation():
    """The error of each sample varies by a factor of 50; the second case has 0.8 times the error of the first."""
    generator = np.random.default_rng(3)
    common = np.exp(generator.uniform(0, 4, 60))
    second = 0.8 * common * np.exp(0.02 * generator.standard_normal(60))
    reference, other = statistics.compare_cases(rows({"C1": common.tolist(), "C2": second.tolist()}), ["e_p_rms_m"])
    assert reference.ratio == statistics.Interval(1.0, 1.0, 1.0)
    assert math.isnan(reference.p_value)
    assert other.samples == 60
    assert 0.78 < other.ratio.low < 0.8 < other.ratio.high < 0.82
    assert other.median.high / other.median.low > 1.5
    assert other.p_value == pytest.approx(stats.wilcoxon(common, second).pvalue)


def test_comparison_uses_samples_that_both_cases_complete():
    inf = math.inf
    _, other = statistics.compare_cases(rows({"C1": [1.0, 2.0, inf, 4.0], "C2": [1.0, 1.0, 1.0, inf]}), ["e_p_rms_m"])
    assert other.samples == 2
    assert other.ratio.value == 0.75
    assert math.isnan(other.ratio.low)
    assert math.isnan(other.p_value)


def test_interval_of_a_median_contains_it():
    values = np.random.default_rng(0).exponential(size=200)
    found = statistics.median_interval(values)
    assert found.low < np.median(values) < found.high
    assert found.low < math.log(2) < found.high
    assert found == statistics.median_interval(values)


def test_half_width_of_a_mean_is_that_of_student():
    values = [1.0, 2.0, 4.0, math.nan]
    low, high = stats.t.interval(0.9, 2, np.mean(values[:3]), stats.sem(values[:3]))
    assert statistics.mean_half_width(values, 0.9) == pytest.approx((high - low) / 2)
    assert statistics.mean_half_width([1.0, 2.0], 0.9) == math.inf


def test_sobol_indices_of_a_sum():
    """The variance of x + 2 y, uniform and independent, is divided as 1 to 4."""
    points = sampling._saltelli(qmc.Sobol(4, rng=np.random.default_rng(0)).random_base2(10))
    table = pd.DataFrame({"sample": np.arange(len(points)), "e_p_rms_m": points @ np.array([1.0, 2.0])})
    found = statistics.sobol_indices(table, "e_p_rms_m", ("x", "y"))
    assert found.to_numpy() == pytest.approx(np.array([[0.2, 0.2], [0.8, 0.8]]), abs=0.01)
    assert statistics.sobol_indices(table.iloc[1:], "e_p_rms_m", ("x", "y")).empty


def test_claims_of_the_paper_are_fractions():
    table = rows({"C3": [1.0, 1.0, 1.0]}).assign(
        **{
            "correlation.sigma_L_e_p.run": [0.5, -0.1, 0.2],
            "error_bound.payload.violation_rate.total": [0.0, 0.0, 0.1],
            "miscoverage.payload.rate.0": [0.0, 0.1, 0.02],
            "miscoverage.payload.rate.1": [0.0, 0.1, 0.02],
        }
    )
    assert [each.count for each in statistics.claims(table)] == [2, 2, 2]
