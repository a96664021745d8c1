"""Upgrade of logs of older schemas.

Schema 2 renamed variables and attributes of schema 1. Schema 3 has one unit for each variable: it splits wrenches into
force and moment, and joint signals into revolute and prismatic joints. It adds quaternions and base positions. Schema 4
contains the signals of the residual corrector in place of those of the innovation filter.
"""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from colift.closed_loop import log_signals, pose_signals

SCHEMA = 4
"""Schema of the logs that this version writes."""
VARIABLES_OF_SCHEMA_1 = {
    "x_dot": "v_agent",
    "saturated": "thrust_saturated",
    "singular": "min_delassus_singular_value",
    "r_L": "correction_L",
    "r_x": "correction_x",
    **{f"bias_f_{output}": f"label_bias_std_f_{output}" for output in "Lxwr"},
    **{f"deviation_f_{output}": f"predictive_std_f_{output}" for output in "Lxwr"},
}
VARIABLES_OF_SCHEMA_3 = {
    "innovation_L": "correction_L",
    "innovation_L_force": "correction_L_force",
    "innovation_L_moment": "correction_L_moment",
    "innovation_x": "correction_x",
}
"""Signals of the innovation filter, in logs of schema 2 and 3, to the signals of the same meaning."""
DROPPED = (
    *("model_gain_", "delay_error_", "correction_error_", "trust_", "late_", "left_"),
    *("correction_weight", "labels_available", "fresh", "comes"),
)
"""Begin of the names of signals of the innovation filter that have no present meaning."""
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
LIMITS = {
    "distance_m": "max_position_error_m",
    "height_m": "min_height_m",
    "attitude_deg": "max_attitude_error_deg",
    "tilt_deg": "max_tilt_deg",
    "saturation_s": "max_saturation_time_s",
    "grip": "min_grasp_ratio",
    "thrust_margin": "hover_thrust_margin",
    "grip_1pkg": "min_delassus_singular_value_1pkg",
}
"""Former to present names of termination limits, in logs and in `summary.json`."""
ATTRIBUTES_OF_SCHEMA_2 = {
    "rho_norm": "rho_rkhs_norm",
    "settings": "settings_digest",
    **{f"limit_{old}": f"limit_{new}" for old, new in LIMITS.items()},
}


def upgrade(ds: xr.Dataset) -> xr.Dataset:
    """Upgrade a log to the present schema.

    The types of the joints are read from the scenario in the log. Without a scenario all joints are taken as revolute.
    Base positions depend on the parameters of the team, which a log does not contain; they are absent.
    `colift.analysis.poses.base_positions` computes them. Signals of the innovation filter without a present meaning are
    dropped; the attribute `history` names them.

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
    dropped = [str(name) for name in ds.data_vars if schema <= 3 and str(name).startswith(DROPPED)]
    ds = ds.drop_vars(dropped).rename({old: new for old, new in VARIABLES_OF_SCHEMA_3.items() if old in ds})
    upgraded = _described(ds) if schema == 3 else _split_units(ds)
    done = f"upgraded from schema {schema}" + (f" without {', '.join(sorted(dropped))}" if dropped else "")
    history = "; ".join(filter(None, (str(ds.attrs.get("history", "")), done)))
    attrs = {ATTRIBUTES_OF_SCHEMA_2.get(name, name): value for name, value in ds.attrs.items()}
    upgraded.attrs = attrs | {"Conventions": "CF-1.11", "schema": SCHEMA, "history": history}
    return upgraded


def _described(ds: xr.Dataset) -> xr.Dataset:
    """Return a log of schema 3 with the present descriptions of renamed variables."""
    described = ds.copy()
    for name in set(VARIABLES_OF_SCHEMA_3.values()) & set(map(str, ds.data_vars)):
        spec = log_signals.SPECS[name]
        described[name].attrs |= {"units": spec.units, "frame": spec.frame, "long_name": spec.long_name}
    return described


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
