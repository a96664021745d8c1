"""Statistics of a campaign: paired comparison of its cases, fractions of flights, and Sobol indices.

The flights of one sample have equal settings and noise in all cases (common random numbers), so that cases are
compared sample by sample.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import warnings
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy import stats

RESAMPLES = 2000
"""Number of bootstrap samples of an interval."""
MIN_SAMPLES = 3
"""Smallest number of samples of an interval."""
CONFIDENCE = 0.95
"""Confidence of all intervals."""
ERROR_METRIC = "e_p_rms_m"
"""Metric of the orderings."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """Estimate with its confidence interval.

    Attributes:
        value: Estimate.
        low: Lower limit; NaN if there are too few samples.
        high: Upper limit.
    """

    value: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Fraction:
    """Number of flights with a property, with the interval of Clopper and Pearson.

    Attributes:
        meaning: Property.
        count: Number of flights with it.
        total: Number of flights.
        interval: Fraction with its confidence interval.
    """

    meaning: str
    count: int
    total: int
    interval: Interval


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Metric of a case beside that of the reference case, over the samples that are complete in both.

    Attributes:
        metric: Metric.
        case: Case.
        reference: Reference case.
        samples: Number of pairs.
        median: Median of the case.
        ratio: Median of the ratios of case and reference.
        p_value: Wilcoxon signed-rank test, corrected by Holm's method over all comparisons; NaN with too few samples.
    """

    metric: str
    case: str
    reference: str
    samples: int
    median: Interval
    ratio: Interval
    p_value: float


def median_interval(values: np.ndarray) -> Interval:
    """Return the median with its BCa bootstrap interval (Efron 1987).

    Args:
        values: Finite values.
    """
    if not len(values):
        return Interval(math.nan, math.nan, math.nan)
    value = float(np.median(values))
    if len(values) < MIN_SAMPLES:
        return Interval(value, math.nan, math.nan)
    if np.ptp(values) == 0:
        return Interval(value, value, value)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # few equal values: the limits are then not a number
        found = stats.bootstrap(
            (values,),
            np.median,
            n_resamples=RESAMPLES,
            batch=max(1, 2_000_000 // len(values)),
            confidence_level=CONFIDENCE,
            method="BCa",
            rng=np.random.default_rng(0),
        ).confidence_interval
    return Interval(value, float(found.low), float(found.high))


def fraction(meaning: str, holds: Sequence[bool] | np.ndarray) -> Fraction:
    """Return the fraction of flights with a property (Clopper and Pearson 1934).

    Args:
        meaning: Property.
        holds: Whether each flight has it.
    """
    count, total = int(np.sum(holds)), len(holds)
    if not total:
        return Fraction(meaning, 0, 0, Interval(math.nan, 0.0, 1.0))
    found = stats.binomtest(count, total).proportion_ci(CONFIDENCE, method="exact")
    return Fraction(meaning, count, total, Interval(count / total, float(found.low), float(found.high)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct p-values for their number (Holm 1979); NaN stays and does not count.

    Args:
        p_values: Uncorrected p-values.

    Returns:
        Corrected p-values in the same order.
    """
    tested = sorted((p, k) for k, p in enumerate(p_values) if not math.isnan(p))
    corrected, largest = list(p_values), 0.0
    for rank, (p, k) in enumerate(tested):
        largest = max(largest, min(1.0, (len(tested) - rank) * p))
        corrected[k] = largest
    return corrected


def mean_half_width(values: Sequence[float], confidence: float) -> float:
    """Return the half-width of the confidence interval of a mean (Student's t); infinite for fewer than 3 values.

    Args:
        values: Values; those that are not finite are omitted.
        confidence: Confidence.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if len(finite) < MIN_SAMPLES:
        return math.inf
    return float(stats.t.ppf(0.5 + confidence / 2, len(finite) - 1) * finite.std(ddof=1) / math.sqrt(len(finite)))


def by_sample(table: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Return a metric by sample (rows) and case (columns); NaN for flights that are missing or ended early.

    Args:
        table: Rows of a campaign.
        metric: Column of the metric.
    """
    complete = table[table["complete"].astype(bool)]
    if metric not in table:
        return pd.DataFrame(index=table["sample"].unique(), columns=table["case"].unique(), dtype=float)
    values = complete.pivot(index="sample", columns="case", values=metric).astype(float)
    return values.reindex(index=table["sample"].unique(), columns=table["case"].unique())


def compare_cases(table: pd.DataFrame, metrics: Sequence[str]) -> tuple[Comparison, ...]:
    """Compare all cases with the first one, sample by sample.

    Args:
        table: Rows of a campaign; the first row is of the reference case.
        metrics: Columns to compare.

    Returns:
        Comparisons by metric and case; those of the reference case have the ratio 1.
    """
    found = [_compare(table, metric, case) for metric in metrics for case in table["case"].unique()]
    corrected = holm([each.p_value for each in found])
    return tuple(dataclasses.replace(each, p_value=p) for each, p in zip(found, corrected, strict=True))


def _compare(table: pd.DataFrame, metric: str, case: str) -> Comparison:
    """Compare a case with the first one; the p-value is not corrected."""
    values, reference = by_sample(table, metric), table["case"].iloc[0]
    x, y = values[case].to_numpy(), values[reference].to_numpy()
    paired = np.isfinite(x) & np.isfinite(y)
    x, y = x[paired], y[paired]
    ratios = np.divide(x, y, out=np.full(len(x), np.nan), where=y != 0)
    p = math.nan
    if case != reference and len(x) >= MIN_SAMPLES:
        p = float(stats.wilcoxon(x, y).pvalue) if np.any(x != y) else 1.0
    ratio = median_interval(ratios[np.isfinite(ratios)])
    return Comparison(metric, case, reference, len(x), median_interval(x), ratio, p)


def complete_flights(table: pd.DataFrame) -> tuple[Fraction, ...]:
    """Return the fraction of complete flights of each case.

    Args:
        table: Rows of a campaign.
    """
    return tuple(
        fraction(f"{case} is complete", rows["complete"].astype(bool).to_numpy())
        for case, rows in table.groupby("case", sort=False)
    )


def orderings(table: pd.DataFrame, metric: str = ERROR_METRIC) -> tuple[Fraction, ...]:
    """Return the fractions of samples in which each case has a smaller error than the case before it.

    The error of a flight that ended early is infinite.

    Args:
        table: Rows of a campaign.
        metric: Column of the error.

    Returns:
        Fractions for neighbors, such as C2 < C1, and for the whole chain, such as C3 < C2 < C1.
    """
    values, cases = by_sample(table, metric), list(table["case"].unique())
    complete = table.pivot(index="sample", columns="case", values="complete").reindex(columns=cases)
    present = complete.notna().all(axis=1)
    errors = values[cases].fillna(math.inf)[present.reindex(values.index)].to_numpy()
    smaller = errors[:, 1:] < errors[:, :-1]
    pairs = [fraction(f"{b} < {a}", smaller[:, k]) for k, (a, b) in enumerate(itertools.pairwise(cases))]
    chain = [fraction(" < ".join(reversed(cases)), smaller.all(axis=1))] if len(cases) > 2 else []
    return (*pairs, *chain)


def claims(table: pd.DataFrame) -> tuple[Fraction, ...]:
    """Return the fractions of flights in which the statements of the paper on uncertainty hold, by case.

    Args:
        table: Rows of a campaign.

    Returns:
        Fractions for the correlation of standard deviation and error, and for the error bounds.
    """
    found = []
    for case, rows in table[table["complete"].astype(bool)].groupby("case", sort=False):
        correlated = _numbers(rows, "correlation.sigma_L_e_p.run")
        if len(correlated):
            found.append(fraction(f"{case}: σ_L and |e_p| are correlated positively", correlated > 0))
        violated = _numbers(rows, "error_bound.payload.violation_rate.total")
        if len(violated):
            found.append(fraction(f"{case}: the bound of the payload's residual is never exceeded", violated == 0))
        names = [name for name in rows if str(name).startswith("miscoverage.payload.rate.")]
        rates = rows[names].astype(float).mean(axis=1).dropna().to_numpy() if names else np.zeros(0)
        if len(rates):
            found.append(fraction(f"{case}: at least 95 % of the residuals are in their intervals", rates <= 0.05))
    return tuple(found)


def _numbers(rows: pd.DataFrame, name: str) -> np.ndarray:
    """Return the finite values of a column; none if there is no such column."""
    return rows[name].astype(float).dropna().to_numpy() if name in rows else np.zeros(0)


def sobol_indices(table: pd.DataFrame, metric: str, settings: Sequence[str]) -> pd.DataFrame:
    """Return the Sobol indices of a metric (Saltelli et al. 2010).

    Args:
        table: Rows of one case of a campaign with the design `saltelli`.
        metric: Column of the metric.
        settings: Varied settings in the order of the specification.

    Returns:
        Columns `first` and `total` by setting; empty if a flight is missing or ended early.
    """
    d = len(settings)
    values = table.sort_values("sample")[metric].to_numpy(dtype=float)
    n = len(values) // (d + 2)
    if n < 2 or n & (n - 1) or n * (d + 2) != len(values) or not np.isfinite(values).all():
        return pd.DataFrame(columns=["first", "total"])
    blocks = values.reshape(d + 2, 1, n)
    found = stats.sobol_indices(func={"f_A": blocks[0], "f_B": blocks[1], "f_AB": blocks[2:]}, n=n)
    return pd.DataFrame({"first": found.first_order.ravel(), "total": found.total_order.ravel()}, index=list(settings))
