"""Tables of campaigns on a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from colift.analysis.study_metrics import STUDY_METRICS, Metric

if TYPE_CHECKING:
    import pandas as pd

    from colift.campaigns.spec import LoadedCampaign
    from colift.campaigns.statistics import Comparison, Fraction, Interval

SETTING_PREFIX = "settings."
"""Prefix of the columns of the varied settings."""


def flight_table(rows: pd.DataFrame, name: str) -> Table:
    """Return one line per flight.

    Args:
        rows: Rows of a campaign.
        name: Name of the campaign.
    """
    metrics = [metric for metric in STUDY_METRICS if metric.key in rows]
    settings = [column for column in rows if str(column).startswith(SETTING_PREFIX)]
    table = _table(name, ["sample\n", "case\n", *(f"{column.removeprefix(SETTING_PREFIX)}\n" for column in settings)])
    for metric in metrics:
        table.add_column(f"{metric.heading}\n{metric.unit}", justify="right", no_wrap=True)
    table.add_column("end\n", no_wrap=True)
    for row in rows.to_dict("records"):
        cells = [str(row["sample"]), str(row["case"]), *(_setting(row[column]) for column in settings)]
        cells += [metric.format(_number(row[metric.key])) for metric in metrics]
        table.add_row(*cells, str(row["termination_reason"]) or "complete")
    return table


def comparison_table(found: Sequence[Comparison], name: str) -> Table:
    """Return medians and ratios of all metrics and cases.

    Args:
        found: Comparisons.
        name: Name of the campaign.
    """
    table = _table(f"{name}: medians with 95 % intervals", ["metric", "case"])
    reference = found[0].reference if found else ""
    for heading in ("n", "median", "95 %", f"ratio to {reference}", "95 %", "p (Holm)"):
        table.add_column(heading, justify="right", no_wrap=True)
    by_key = {metric.key: metric for metric in STUDY_METRICS}
    for each in found:
        metric = by_key[each.metric]
        ratio = ("", "") if each.case == each.reference else (_digits(each.ratio.value), _limits(each.ratio))
        p = "" if math.isnan(each.p_value) else f"{each.p_value:.2g}"
        median = metric.format(each.median.value)
        title = f"{metric.heading} {metric.unit}"
        table.add_row(title, each.case, str(each.samples), median, _scaled_limits(each.median, metric), *ratio, p)
    return table


def fraction_table(fractions: Sequence[Fraction]) -> Table:
    """Return fractions of flights with their intervals.

    Args:
        fractions: Fractions.
    """
    table = _table("fractions of the flights", ["statement"])
    for heading in ("flights", "of", "fraction", "95 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    for each in fractions:
        table.add_row(
            each.meaning, str(each.count), str(each.total), _digits(each.interval.value), _limits(each.interval)
        )
    return table


def sobol_table(rows: pd.DataFrame, campaign: LoadedCampaign) -> Table:
    """Return the Sobol indices of the position error, by case and setting.

    Args:
        rows: Rows of a campaign with the design `saltelli`.
        campaign: Specification with its scenario.
    """
    from colift.campaigns import statistics

    table = _table("Sobol indices of the position error", ["case", "setting"])
    for heading in ("first order", "total"):
        table.add_column(heading, justify="right", no_wrap=True)
    for case, selected in rows.groupby("case", sort=False):
        found = statistics.sobol_indices(selected, statistics.ERROR_METRIC, tuple(campaign.spec.vary))
        if found.empty:
            table.add_row(str(case), "some flights are missing or ended early", "", "")
        for setting, first, total in zip(found.index, found["first"], found["total"], strict=True):
            table.add_row(str(case), str(setting), f"{first:.2f}", f"{total:.2f}")
    return table


def _table(title: str, headings: Sequence[str]) -> Table:
    """Return an empty table with columns of text."""
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in headings:
        table.add_column(heading, no_wrap=True)
    return table


def _number(value: Any) -> float | None:
    """Return a cell as a number; None if it is none."""
    return float(value) if isinstance(value, int | float) else None


def _setting(value: Any) -> str:
    """Format a setting."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _digits(value: float) -> str:
    """Format a ratio or a fraction."""
    return "none" if math.isnan(value) else f"{value:.3g}"


def _limits(interval: Interval) -> str:
    """Format the limits of an interval."""
    return f"{_digits(interval.low)} to {_digits(interval.high)}"


def _scaled_limits(interval: Interval, metric: Metric) -> str:
    """Format the limits of an interval in the unit of a metric."""
    return f"{metric.format(interval.low)} to {metric.format(interval.high)}"
