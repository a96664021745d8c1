"""Upgrade of logs of older schemas.

Schema 2 renamed variables and attributes of schema 1. Schema 3 has one unit for each variable: it splits wrenches into
force and moment, and joint signals into revolute and prismatic joints. It adds quaternions and base positions.
"""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from colift.closed_loop import log_signals, pose_signals

SCHEMA = 3
"""Schema of the logs that this version writes."""
VARIABLES_OF_SCHEMA_1 = {
    "x_dot": "v_agent",
    "saturated": "thrust_saturated",
    "singular": "min_delassus_singular_value",
    "r_L": "innovation_L",
    "r_x": "innovation_x",
    "trust_L": "model_gain_L",
    "trust_x": "model_gain_x",
    "late_L": "delay_error_L",
    "late_x": "delay_error_x",
    "left_L": "correction_error_L",
    "left_x": "correction_error_x",
    "fresh": "correction_weight",
    "comes": "labels_available",
    **{f"bias_f_{output}": f"label_bias_std_f_{output}" for output in "Lxwr"},
    **{f"deviation_f_{output}": f"predictive_std_f_{output}" for output in "Lxwr"},
}
ATTRIBUTES_OF_SCHEMA_1 = {
    "stopped": "termination_reason",
    "unused": "learning_warnings",
    "world_changed": "change_points",
    "fitted_anew": "refits",
    "update_ready_s": "update_activation_s",
    "update_points_payload": "num_samples_payload",
    "update_points_agents": "num_samples_agents",
    "rho_assumed": "bound_assumptions",
}
ATTRIBUTES_OF_SCHEMA_2 = {
    "rho_norm": "rho_rkhs_norm",
    "settings": "settings_digest",
    "limit_distance_m": "limit_max_position_error_m",
    "limit_height_m": "limit_min_height_m",
    "limit_attitude_deg": "limit_max_attitude_error_deg",
    "limit_tilt_deg": "limit_max_tilt_deg",
    "limit_saturation_s": "limit_max_saturation_time_s",
    "limit_grip": "limit_min_grasp_ratio",
    "limit_thrust_margin": "limit_hover_thrust_margin",
    "limit_grip_1pkg": "limit_min_delassus_singular_value_1pkg",
}


def upgrade(ds: xr.Dataset) -> xr.Dataset:
    """Upgrade a log to the present schema.

    The types of the joints are read from the scenario in the log. Without a scenario all joints are taken as revolute.
    Base positions depend on the parameters of the team, which a log does not contain; they are absent.
    `colift.analysis.poses.base_positions` computes them.

    Args:
        ds: Log of any schema.

    Returns:
        The log itself if it has the present schema; otherwise the upgraded log.

    Raises:
        ValueError: If the schema is newer.
    """
    schema = int(ds.attrs.get("schema", 1))
    if schema > SCHEMA:
        raise ValueError(f"the log has schema {schema}; this version reads schemas 1 to {SCHEMA}: update colift")
    if schema == SCHEMA:
        return ds
    if schema == 1:
        names = {old: new for old, new in VARIABLES_OF_SCHEMA_1.items() if old in ds}
        attrs = {ATTRIBUTES_OF_SCHEMA_1.get(name, name): value for name, value in ds.attrs.items()}
        ds = ds.rename(names).drop_attrs(deep=False).assign_attrs(attrs)
    upgraded = _split_units(ds)
    history = "; ".join(filter(None, (str(ds.attrs.get("history", "")), f"upgraded from schema {schema}")))
    attrs = {ATTRIBUTES_OF_SCHEMA_2.get(name, name): value for name, value in ds.attrs.items()}
    upgraded.attrs = attrs | {"Conventions": "CF-1.11", "schema": SCHEMA, "history": history}
    return upgraded


def _split_units(ds: xr.Dataset) -> xr.Dataset:
    """Convert the variables and coordinates of schema 2 to those of schema 3."""
    prismatic = _prismatic_joints(ds)
    signals = {
        time: {str(name): x.values for name, x in ds.data_vars.items() if x.dims[0] == time}
        for time in ("time", "time_sigma")
    }
    signals["time"] |= {
        q: pose_signals.continuous_quaternions(ds[R].values) for q, R in log_signals.QUATERNIONS.items()
    }
    variables = {}
    for time, values in signals.items():
        variables |= log_signals.variables(time, values, prismatic)
    coordinates = log_signals.label_coordinates({dim: ds[dim].values.tolist() for dim in ("agent", "contact")})
    coordinates |= {dim: log_signals.time_coordinate(dim, ds[dim].values) for dim in signals}
    coordinates |= log_signals.joint_coordinates(ds.joint.values, prismatic)
    return xr.Dataset(variables, coordinates)


def _prismatic_joints(ds: xr.Dataset) -> np.ndarray:
    """Return for each joint of a log of schema 2 whether it is prismatic, according to the scenario in the log."""
    data = json.loads(ds.attrs.get("scenario_json", "{}"))
    types = data.get("agent_types", {})
    names = {
        f"{agent['name']}/{joint['name']}"
        for agent in data.get("agents", ())
        for joint in types[agent["type"]].get("joints", ())
        if joint["type"] == "prismatic"
    }
    return np.array([name in names for name in ds.joint.values], dtype=bool)
