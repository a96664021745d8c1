"""Random logs of older schemas.

Those of schemas 1 to 3 have signals of an innovation filter. Those of schemas 1 and 2 have a wrench on one axis, all
joints on one axis, and no quaternions.
"""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import xarray as xr

from colift.closed_loop import log, log_checks, log_upgrade
from colift.closed_loop.signals import StepRecord
from colift.onboard.learning.prediction_uncertainty import PredictionUncertainty
from tests.support import random_logs as flights

WRENCH = ("F_x", "F_y", "F_z", "tau_x", "tau_y", "tau_z")
ACCELERATION = ("v_dot_x", "v_dot_y", "v_dot_z", "omega_dot_x", "omega_dot_y", "omega_dot_z")
DIMS = {"agents": "agent", "joints": "joint", "contacts": "contact", "eta": "eta_index"}


INNOVATION = {"correction_L": "innovation_L", "correction_x": "innovation_x"}
INNOVATION |= {
    f"{new}_{part}": f"{old}_{part}" for new, old in list(INNOVATION.items()) for part in ("force", "moment")
}
"""Present to former names of the correction."""


def schema_3(ds: xr.Dataset) -> xr.Dataset:
    """The log of today with the signals of an innovation filter."""
    old = ds.drop_vars([name for name in ds if str(name).startswith(log_checks.CORRECTOR)])
    old = old.rename({new: name for new, name in INNOVATION.items() if new in ds})
    return old.assign(model_gain_x=ds.f_x.variable, correction_weight=ds.Phi.variable).assign_attrs(schema=3)


def schema_2(rows: StepRecord, sigma: PredictionUncertainty, shape: flights.Shape, **attrs: object) -> xr.Dataset:
    """The log of a flight as version 0.2.0.dev wrote it."""
    found = {}
    for field in dataclasses.fields(rows):
        if field.name != "t" and not field.name.startswith(log_checks.CORRECTOR):
            stated = flights.field_axes(field.name)[1:]
            dims = [DIMS.get(axis, axis) for axis in stated]
            dims = ["acceleration" if field.name == "a_L" else "wrench" if dim == "6" else dim for dim in dims]
            if dims.count("3") == 2:
                dims[dims.index("3")] = "axis"
                dims[dims.index("3")] = "body_axis"
            dims = ["axis" if dim == "3" else dim for dim in dims]
            name = INNOVATION.get(field.name, field.name)
            found[name] = (("time", *dims), getattr(rows, field.name), {"units": "N (F), N m (tau)"})
    found |= {"model_gain_x": found["f_x"], "correction_weight": found["Phi"]}
    payload, force = log.predictive_std(rows, sigma)
    found |= {"predictive_std_f_L": (("time_sigma", "wrench"), payload)}
    found |= {"predictive_std_f_x": (("time_sigma", "agent", "axis"), force)}
    for name, load, groups in (
        ("sigma", sigma.payload_std, sigma.agent_std),
        ("label_bias_std", sigma.payload_label_bias, sigma.agent_label_bias),
        ("rho", sigma.payload_radius, sigma.agent_radius),
    ):
        found[f"{name}_f_L"] = (("time_sigma", "wrench"), load)
        agents = [group[:, j] for group in groups for j in range(group.shape[1])]
        found[f"{name}_f_x"] = (("time_sigma", "agent", "axis"), np.stack([x[:, :3] for x in agents], axis=1))
        found[f"{name}_f_w"] = (("time_sigma", "agent", "axis"), np.stack([x[:, 3:6] for x in agents], axis=1))
        found[f"{name}_f_r"] = (("time_sigma", "joint"), np.concatenate([x[:, 6:] for x in agents], axis=1))
    for name, x in log.uncertainty_norms(sigma).items():
        found[name] = (("time_sigma", "agent")[: x.ndim], x)
    names = {DIMS[plural]: labels for plural, labels in shape.names.items()}
    names |= {"axis": list("xyz"), "body_axis": list("xyz"), "wrench": WRENCH, "acceleration": ACCELERATION}
    coords = {dim: (dim, np.array(list(labels), dtype=object)) for dim, labels in names.items()}
    return xr.Dataset(found, coords | {"time": rows.t, "time_sigma": sigma.t}, {"schema": 2} | attrs)


def schema_1(ds: xr.Dataset) -> xr.Dataset:
    """The same log of schema 2 with the names of schema 1."""
    names = {new: name for name, new in log_upgrade.VARIABLES_OF_SCHEMA_1.items()}
    names |= {"innovation_L": "r_L", "innovation_x": "r_x", "model_gain_x": "trust_x", "correction_weight": "fresh"}
    old = ds.rename({new: name for new, name in names.items() if new in ds})
    names = {new: name for name, new in log_upgrade.ATTRIBUTES_OF_SCHEMA_1.items()}
    old.attrs = {names.get(name, name): value for name, value in ds.attrs.items() if name != "schema"}
    return old


def scenario_json(shape: flights.Shape) -> str:
    """Return the scenario of a log, which contains the types of joints."""
    types, agents = {}, []
    for group, (size, joints, _) in zip(shape.team.agent_groups, shape.groups, strict=True):
        slides = group.tree.prismatic
        kinds = [{"name": f"joint{k}", "type": "prismatic" if slides[k] else "revolute"} for k in range(joints)]
        for _ in range(size):
            name = f"agent{len(agents)}"
            types[name] = {"joints": kinds} if kinds else {}
            agents.append({"name": name, "type": name})
    return json.dumps({"agent_types": types, "agents": agents})
