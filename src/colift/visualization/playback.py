"""Flights as one page that plays them, which needs no network.

What it shows is `scene`'s; `playback.js`, which draws it, is built from the folder `playback` of the sources
(docs/playback.md).
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from colift.analysis import poses
from colift.closed_loop import log
from colift.runtime import atomic_write, run_directory
from colift.scenario import team as team_module
from colift.visualization import scene

PAGE = "view.html"
ARROWS = {
    "thrust": "thrust",
    "contact": "contact force on the payload",
    "disturbance": "disturbance force on the payload",
}
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"


def write(out: Path, cases: Mapping[str, str]) -> Path:
    """Write the page of the flights of a folder, `out/view.html`; return its path. `cases`: names, and what they are.

    Raises ValueError as `log.flights`, OSError where the page cannot be written or another process writes there.
    """
    run, found = log.load_flights(out, cases)
    text = build_page(found, cases)
    with run_directory.lock_run_directory(out, run, (PAGE,)):
        atomic_write.write_atomic(out / PAGE, text.encode())
    return out / PAGE


def build_page(flights: Mapping[str, xr.Dataset], cases: Mapping[str, str]) -> str:
    """The page of some flights of one team: HTML with script, styles and numbers inside.

    Raises ValueError for a log that does not hold its scenario.
    """
    return page_html(page_data(flights, cases))


def page_data(flights: Mapping[str, xr.Dataset], cases: Mapping[str, str]) -> dict[str, Any]:
    """What the page's script reads, as JSON may have it; raises as `page`."""
    first = next(iter(flights.values()))
    told = poses.scenario_of_log(first)
    team, _ = team_module.team(told)
    shape = scene.team_geometry(team, told)
    moving = {case: scene.frames(ds, team) for case, ds in flights.items()}
    scales = scene.arrow_scales(moving, shape["size_m"])
    return {
        "scenario": told.name,
        "seed": told.seed,
        "version": first.attrs["version"],
        "run": first.attrs["run"],
        "shape": shape,
        "ground_m": scene.ground_height(moving),
        "arrows": {kind: {"label": ARROWS[kind], "N_per_m": x} for kind, x in scales.items()},
        "cases": [
            {
                "name": case,
                "label": cases[case],
                "stopped": str(ds.attrs["stopped"]),
                "t": scene.to_json_times(ds.time.values[scene.frame_rows(ds)]),
                "t_sigma": scene.to_json_times(ds.time_sigma.values[scene.subsample(ds.time_sigma.values)]),
                "marks": scene.event_markers(ds),
                "tracks": {name: encode_array(x) for name, x in (moving[case] | scene.plot_signals(ds)).items()},
            }
            for case, ds in flights.items()
        ],
    }


def page_html(written: Mapping[str, Any], policy: str = POLICY) -> str:
    """The page as HTML; `policy`: what a browser lets it ask for."""
    script = (resources.files("colift.visualization") / "playback.js").read_text(encoding="utf-8")
    names = ", ".join(case["name"] for case in written["cases"])
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<title>{html.escape(written['scenario'])}: {names}</title>\n</head>\n<body>\n"
        f'<script type="application/json" id="flights">{_within_html(written)}</script>\n'
        f"<script>\n{script}</script>\n</body>\n</html>\n"
    )


def encode_array(x: np.ndarray) -> dict[str, Any]:
    """An array as JSON: its shape, and its numbers as little-endian float32 in base64."""
    return {"shape": list(x.shape), "float32": base64.b64encode(np.asarray(x, dtype="<f4").tobytes()).decode()}


def _within_html(value: Any) -> str:
    """Strict JSON that no name in it can end early."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
