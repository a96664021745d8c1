"""Generated flights of all cases, for tests of figures."""

from __future__ import annotations

import numpy as np
import xarray as xr

from colift.scenario.cases import BASELINES, PAPER_CASES
from tests.support import playback_logs as played
from tests.support import random_logs as flights

LONG = flights.PAPER._replace(time=400, period=0.05)  # 20 s
CASES = ("C1", "C2", "C3")
RIVALS = ("integral", "disturbance_observer", "parametric", "true_residual")
TOLD = PAPER_CASES | BASELINES


def cases() -> dict[str, xr.Dataset]:
    """Return generated flights of the paper's cases and all baselines."""
    rng = np.random.default_rng(3)
    attributes = {"scenario_json": played.PAPER.model_dump_json(exclude_none=True)}
    learned = {"update_times_s": [2.5, 4.5, 6.5, 8.5, 10.0], "T_end_s": 10.0}
    unlearned = {"update_times_s": [], "T_end_s": 10.0}
    found = {
        name: flights.dataset(
            rng, LONG, case=name, **attributes, **(learned if name in ("C2", "C3", "parametric") else unlearned)
        )
        for name in (*CASES, *RIVALS)
    }
    for ds in found.values():
        ds.eta[:] = ds.eta * ((ds.time >= 8) & (ds.time <= 14))
    return found
