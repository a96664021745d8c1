"""The campaign `campaigns/paper.yaml`: the study of the paper over 500 samples, cases C1 to C3.

Each item is a sample. Its rows are those of `colift campaign run campaigns/paper.yaml`, reduced to the metrics of the
results page.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd

from colift.campaigns import flights, sampling, spec, statistics
from colift.visualization import campaign_figures
from evidence import ROOT, collect
from evidence.targets import Target, report

RUNS = ("campaigns",)
SPEC = ROOT / "campaigns" / "paper.yaml"
METRICS = ("e_p_rms_m", "e_R_rms", "delta_W_force_rms_N", "e_lam_rms_N", "sigma_L_force_mean_N", "lam_max_N")
OTHERS = (
    *("complete", "termination_reason", "correlation.sigma_L_e_p.run"),
    "error_bound.payload.violation_rate.total",
)
RATES = "miscoverage.payload.rate."


def simulate_item(item: str) -> dict[str, Any]:
    """Return the metrics of each case of a sample."""
    campaign = spec.load_campaign(SPEC)
    planned = tuple(flight for flight in sampling.plan_flights(campaign) if flight.sample == int(item))
    batch = flights.Batch(campaign.settings_json, campaign.file, campaign.spec.duration_s, None, planned)
    return {str(row["case"]): reduced(row) for row in flights.run_batch(batch)}


def reduced(row: flights.Row) -> flights.Row:
    """Return the columns of a row that the results page uses; the rates of all outputs become their mean."""
    rates = [value for name, value in row.items() if name.startswith(RATES) and isinstance(value, float)]
    mean: flights.Row = {f"{RATES}mean": sum(rates) / len(rates)} if rates else {}
    return {name: row.get(name) for name in (*OTHERS, *METRICS)} | mean


def table(found: dict[str, Any]) -> pd.DataFrame:
    """Return the items as rows of a campaign."""
    rows = [{"sample": int(item), "case": case, **row} for item, one in found.items() for case, row in one.items()]
    return pd.DataFrame(rows).sort_values("sample", kind="stable")


def fractions(rows: pd.DataFrame) -> tuple[statistics.Fraction, ...]:
    """Return the fractions of flights that are complete, in order, and consistent with the statements of the paper."""
    return (*statistics.complete_flights(rows), *statistics.orderings(rows), *statistics.claims(rows))


def draw(found: dict[str, Any], path: Path) -> None:
    """Draw the distributions of the position error and of its ratio to C1."""
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder) / "campaign"
        campaign_figures.plot_comparison(statistics.by_sample(table(found), statistics.ERROR_METRIC), drawn)
        shutil.copy(drawn.with_suffix(".png"), path)


def main() -> bool:
    """Print fractions and ratios; all flights must be complete and in the paper's order."""
    samples = spec.load_campaign(SPEC).spec.samples
    rows = table(collect("campaign", map(str, range(samples)), simulate_item))
    for each in statistics.compare_cases(rows, METRICS):
        print(f"{each.metric:22} {each.case}  median {each.median.value:.4g}, ratio {each.ratio.value:.3g}")
    for one in fractions(rows):
        print(f"{one.meaning}: {one.count} of {one.total}")
    order = statistics.orderings(rows)[-1]
    return report(
        [
            Target("flights that end early", float((~rows["complete"].astype(bool)).sum()), most=0),
            Target(f"samples with {order.meaning}", 100 * order.count / order.total, least=100, unit="%"),
        ]
    )


if __name__ == "__main__":
    main()
