"""Scenario, base positions and reference attitudes from the log of a flight."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from colift.closed_loop import log, pose_signals
from colift.math import so3
from colift.math.linalg import transpose
from colift.models.parameters import Team
from colift.scenario import Scenario, ScenarioError, plugins
from colift.scenario import team as team_names
from colift.scenario.migration import migrate_data


def scenario_of_log(ds: xr.Dataset) -> Scenario:
    """Return the scenario that is stored in a log, without the plugins of the user.

    A log can come from an untrusted source, and loading a plugin executes its module. Therefore no plugin is loaded:
    disturbances and sensor models that are plugins are omitted, actuators and physics have their defaults, and a
    reference is replaced by its first position. A plugin in any other place is an error.

    Args:
        ds: Dataset of a flight.

    Returns:
        The scenario, migrated to the present schema.

    Raises:
        ValueError: If the log contains no scenario that this version can read.
    """
    try:
        data = json.loads(ds.attrs["scenario_json"])
        data = _without_plugins(migrate_data(data, strict=False), ds)
        with plugins.refuse_imports():
            settings = Scenario.model_validate_json(json.dumps(data))
        _check_team(settings, ds)
        return settings
    except KeyError:
        raise ValueError(
            f"the log {ds.attrs.get('case', '')} of run {ds.attrs.get('run', 'unknown')} contains no scenario; it was "
            "written by an earlier version of colift: run colift study again"
        ) from None
    except (ScenarioError, ValueError, TypeError, AttributeError) as error:
        first = str(error).splitlines()[0]
        file = f"{ds.encoding['source']}: " if "source" in ds.encoding else ""
        raise ValueError(
            f"{file}this version of colift cannot read the scenario in the log ({first}): run colift study again"
        ) from None


def _check_team(settings: Scenario, ds: xr.Dataset) -> None:
    """Raise ValueError if the team of the scenario has another number of agents, joints or contacts than the log."""
    if "agent" not in ds.sizes:  # a part of a log
        return
    joints = ds.sizes.get("joint", 0) + ds.sizes.get("prismatic_joint", 0)
    for what, names, number in (
        ("agents", team_names.agent_names(settings), ds.sizes["agent"]),
        ("joints", team_names.joint_names(settings), joints),
        ("contacts", team_names.contact_names(settings), ds.sizes["contact"]),
    ):
        if len(names) != number:
            raise ValueError(f"it has {len(names)} {what}, the log {number}")


def plugin_classes(ds: xr.Dataset) -> list[str]:
    """Return the plugins of the scenario in a log as `module:Name`, sorted; `scenario_of_log` omits them.

    Args:
        ds: Dataset of a flight.
    """
    return sorted(set(_class_paths(json.loads(ds.attrs["scenario_json"]))))


def _class_paths(value: Any) -> Iterator[str]:
    """Yield all entries `class_path`, in schema 1 `part`, of nested data."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if key in ("class_path", "part") and isinstance(entry, str):
                yield entry
            yield from _class_paths(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _class_paths(entry)


def _without_plugins(data: dict[str, Any], ds: xr.Dataset) -> dict[str, Any]:
    """Return the data of a scenario without the sections that name a plugin."""
    named = lambda section: isinstance(section, dict) and "class_path" in section  # noqa: E731
    kept = {key: value for key, value in data.items() if key != "plugins"}
    if isinstance(disturbances := data.get("disturbances"), list):
        kept["disturbances"] = [each for each in disturbances if not named(each)]
    if isinstance(sensors := data.get("sensors"), dict) and isinstance(sensors.get("models"), list):
        kept["sensors"] = sensors | {"models": [each for each in sensors["models"] if not named(each)]}
    for key in ("actuators", "physics"):
        if named(data.get(key)):
            del kept[key]
    if named(data.get("reference")):
        hover = [float(x) for x in ds.p_d.values[0]]
        still = {"amplitude_m": [0.0, 0.0, 0.0], "period_s": 1.0, "ramp_time_s": 1.0}
        kept["reference"] = {"kind": "lissajous", "center_m": hover, **still}
    return kept


def base_positions(ds: xr.Dataset, team: Team) -> np.ndarray:
    """Return the positions of the base origins `p_base`; they are computed for logs of schemas 1 and 2.

    Args:
        ds: Log.
        team: True parameters of the team.

    Returns:
        Positions by time and agent [m, world].
    """
    if "p_base" in ds:
        return ds.p_base.values
    return pose_signals.base_positions(team, ds.R.values, ds.x.values, log.all_joints(ds, "r").values)


@jax.jit
def desired_attitude(
    R: Float[Array, "time 3 3"], e_R: Float[Array, "time 3"], Psi: Float[Array, "time"]
) -> Float[Array, "time 3 3"]:
    """Compute the desired attitude from attitude, attitude error and error function.

    The result is `R_d = R Q^T` with `Q = R_d^T R = I + hat(e_R) + hat(e_R)^2 / (2 - Psi)`, from Rodrigues' formula.

    Args:
        R: Payload attitude, body to world.
        e_R: Attitude error.
        Psi: Attitude error function `tr(I - R_d^T R) / 2`.

    Returns:
        Desired attitude, body to world.
    """
    skew = so3.hat(e_R)
    weight = 1 / jnp.maximum(2 - Psi, 1e-12)
    return R @ transpose(so3.identity((len(Psi),)) + skew + weight[:, None, None] * (skew @ skew))
