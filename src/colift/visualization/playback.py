"""Playback page: one HTML file that animates logged flights in a browser without network access.

The module `scene` provides the data. The script `playback.js` draws them; it is built from the folder `playback` of the
repository (docs/playback.md).
"""

from __future__ import annotations

import base64
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
from colift.visualization import html_page, scene

PAGE_FILE = "playback.html"
ARROWS = {
    "thrust": "thrust",
    "contact": "contact force on the payload",
    "disturbance": "disturbance force on the payload",
}
CONTENT_SECURITY_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"


def write(out: Path, cases: Mapping[str, str]) -> Path:
    """Write the playback page of a study to the folder of its logs.

    Logs that cannot be used raise `ValueError`, as in `log.load_flights` and `build_page`. A folder that cannot be
    written, or that another process writes to, raises `OSError`.

    Args:
        out: Folder of the study.
        cases: Description of each case.

    Returns:
        Path of the page, `out/playback.html`.
    """
    run, flights = log.load_flights(out, cases)
    text = build_page(flights, cases)
    with run_directory.stage_run_directory(out, run, (PAGE_FILE,)) as folder:
        atomic_write.write_atomic(folder.path / PAGE_FILE, text.encode())
    return out / PAGE_FILE


def build_page(flights: Mapping[str, xr.Dataset], cases: Mapping[str, str]) -> str:
    """Build the playback page of flights of one team.

    A log without a valid scenario raises `ValueError`.

    Args:
        flights: Log of each case.
        cases: Description of each case.

    Returns:
        HTML that contains script, styles and data.
    """
    return page_html(page_data(flights, cases))


def page_data(flights: Mapping[str, xr.Dataset], cases: Mapping[str, str]) -> dict[str, Any]:
    """Return the data of the playback page as values for JSON.

    A log without a valid scenario raises `ValueError`.

    Args:
        flights: Log of each case.
        cases: Description of each case.

    Returns:
        Geometry of the team, scales, and the signals and events of each case.
    """
    first = next(iter(flights.values()))
    settings = poses.scenario_of_log(first)
    team, _ = team_module.team(settings)
    shape = scene.team_geometry(team, settings)
    tracks_by_case = {case: scene.frames(ds, team) for case, ds in flights.items()}
    scales = scene.arrow_scales(tracks_by_case, shape["size_m"])
    return {
        "scenario": settings.name,
        "seed": settings.seed,
        "version": first.attrs["version"],
        "run": first.attrs["run"],
        "shape": shape,
        "ground_m": scene.ground_height(tracks_by_case),
        "arrows": {kind: {"label": ARROWS[kind], "N_per_m": x} for kind, x in scales.items()},
        "cases": [
            {
                "name": case,
                "label": cases[case],
                "stopped": str(ds.attrs["termination_reason"]),
                "t": scene.to_json_times(ds.time.values[scene.frame_rows(ds)]),
                "t_sigma": scene.to_json_times(ds.time_sigma.values[scene.subsample(ds.time_sigma.values)]),
                "marks": scene.event_markers(ds, settings.faults),
                "tracks": {
                    name: encode_array(x) for name, x in (tracks_by_case[case] | scene.plot_signals(ds)).items()
                },
            }
            for case, ds in flights.items()
        ],
    }


def page_html(data: Mapping[str, Any], policy: str = CONTENT_SECURITY_POLICY) -> str:
    """Return the HTML text of a playback page.

    Args:
        data: Data of the page, as `page_data` returns them.
        policy: Content security policy, which restricts the requests of the page.

    Returns:
        HTML text.
    """
    script = (resources.files("colift.visualization") / "playback.js").read_text(encoding="utf-8")
    names = ", ".join(case["name"] for case in data["cases"])
    content = (
        f'<script type="application/json" id="flights">{_json_for_html(data)}</script>\n<script>\n{script}</script>'
    )
    return html_page.document(f"{data['scenario']}: {names}", content, policy, style="")


def encode_array(x: np.ndarray) -> dict[str, Any]:
    """Return an array as values for JSON: its shape, and its numbers as little-endian float32 in base64."""
    return {"shape": list(x.shape), "float32": base64.b64encode(np.asarray(x, dtype="<f4").tobytes()).decode()}


def _json_for_html(value: Any) -> str:
    """Return strict JSON for a script element; it contains no `<`, so that no name can close the element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
