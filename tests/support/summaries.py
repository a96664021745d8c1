"""Content of `summary.json` for tests of pages that read it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.support import random_logs as flights

SUMMARY = {
    "scenario": "sample",
    "seed": 1,
    "schema": 2,
    "version": "0.2.0",
    "settings_digest": "abc",
    "plant": "rigid",
    "run": flights.RUN,
    "command": "colift study 'my team.yaml' --seed 1",
    "versions": {"python": "3.11.0", "jax": "0.10.1"},
    "slowest_mode": {"stable": True, "description": "-0.9 rad/s", "eigenvalue_radps": []},
    "stability_margins": {"delay_margin_s": 0.014, "gain_margin": [0.4, 1.5], "description": "delay margin 14 ms"},
    "warnings": [],
    "error_bound_assumptions": {"unproven_assumptions": []},
}


def metrics(**changed: Any) -> dict[str, Any]:
    """Metrics of a case without problem, as in a summary."""
    body = {"violation_rate": {"force": 0.0, "moment": 0.0}}
    keys = ("e_p_rms_m", "e_R_rms", "Psi_mean", "delta_W_force_rms_N", "delta_W_moment_rms_Nm", "e_lam_rms_N")
    numbers = dict.fromkeys(
        (*keys, "sigma_L_force_mean_N", "sigma_A_force_mean_N", "lam_max_N", "thrust_max_N"), 0.00123
    )
    stated = {"complete": True, "termination_reason": "", "warnings": [], "saturated_ticks": 0}
    return numbers | stated | {"error_bound": {"payload": body, "agents": [body]}} | changed


def written(out: Path, cases: dict[str, Any], **changed: Any) -> None:
    """Write a summary to a folder."""
    (out / "summary.json").write_text(json.dumps(SUMMARY | {"cases": cases} | changed))
