"""Variables of a flight log: dimensions, unit, frame and meaning, and their relation to the records of a flight.

Each variable has one unit. Records contain wrenches as six numbers and all joints of the team on one axis. A log
therefore splits a wrench into force and moment, and joint signals into revolute and prismatic joints. `stack_parts` and
`all_joints` return the form of the records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr


class SignalSpec(NamedTuple):
    """Metadata of a logged variable; `dims` follow the time dimension."""

    dims: tuple[str, ...]  # dimensions after the time
    units: str  # as parsed by `pint`; 1 if dimensionless
    frame: str  # reference frame of the components
    long_name: str  # meaning


AXES = ("x", "y", "z")
QUATERNION = ("w", "x", "y", "z")
WRENCH = ("F_x", "F_y", "F_z", "tau_x", "tau_y", "tau_z")
ACCELERATION = ("v_dot_x", "v_dot_y", "v_dot_z", "omega_dot_x", "omega_dot_y", "omega_dot_z")

ROTATION_DIMS = ("axis", "body_axis")
LOAD, AGENT, JOINT, PRISMATIC_JOINT, CONTACT = (
    ("axis",),
    ("agent",),
    ("joint",),
    ("prismatic_joint",),
    ("contact", "axis"),
)
AGENT_VECTOR_DIMS = ("agent", "axis")
ANGLE, RATE, TORQUE = ("rad", "m"), ("rad/s", "m/s"), ("N m", "N")
NEWTON, ONE = ("N", "N m"), ("1", "1")


def _wrench(name: str, units: tuple[str, str], long_name: str) -> dict[str, SignalSpec]:
    """Return the force and the moment variable of a payload wrench."""
    return {
        f"{name}_force": SignalSpec(LOAD, units[0], "world", f"{long_name}, force"),
        f"{name}_moment": SignalSpec(LOAD, units[1], "payload", f"{long_name}, moment"),
    }


def _joints(name: str, units: tuple[str, str], long_name: str) -> dict[str, SignalSpec]:
    """Return the variables of revolute and of prismatic joints."""
    return {
        name: SignalSpec(JOINT, units[0], "joint", f"{long_name}, revolute joints"),
        f"{name}_prismatic": SignalSpec(PRISMATIC_JOINT, units[1], "joint", f"{long_name}, prismatic joints"),
    }


SIGNALS = {
    "p": SignalSpec(LOAD, "m", "world", "payload position p_L"),
    "v": SignalSpec(LOAD, "m/s", "world", "payload velocity v_L"),
    "R_L": SignalSpec(ROTATION_DIMS, "1", "payload to world", "payload attitude R_L"),
    "q_L": SignalSpec(("quaternion",), "1", "payload to world", "payload attitude R_L as unit quaternion"),
    "omega_L": SignalSpec(LOAD, "rad/s", "payload", "payload angular velocity omega_L"),
    "a_L": SignalSpec(LOAD, "m/s^2", "world", "payload acceleration dv_L/dt"),
    "alpha_L": SignalSpec(LOAD, "rad/s^2", "payload", "payload angular acceleration domega_L/dt"),
    "p_d": SignalSpec(LOAD, "m", "world", "reference position p_L,d"),
    "e_p": SignalSpec(LOAD, "m", "world", "position error e_p = p_L - p_L,d"),
    "e_v": SignalSpec(LOAD, "m/s", "world", "velocity error e_v"),
    "e_R": SignalSpec(LOAD, "1", "payload", "attitude error e_R"),
    "e_omega": SignalSpec(LOAD, "rad/s", "payload", "angular velocity error e_omega"),
    "Psi": SignalSpec((), "1", "none", "attitude error function Psi = tr(I - R_d^T R_L)/2"),
    "R": SignalSpec(("agent", *ROTATION_DIMS), "1", "base to world", "base attitude R_j"),
    "q": SignalSpec(("agent", "quaternion"), "1", "base to world", "base attitude R_j as unit quaternion"),
    "x": SignalSpec(AGENT_VECTOR_DIMS, "m", "world", "center of mass of an agent x_j"),
    "p_base": SignalSpec(AGENT_VECTOR_DIMS, "m", "world", "position of the base origin of an agent"),
    "omega": SignalSpec(AGENT_VECTOR_DIMS, "rad/s", "base", "base angular velocity omega_j"),
    "v_agent": SignalSpec(AGENT_VECTOR_DIMS, "m/s", "world", "velocity of the center of mass dx_j/dt"),
    **_joints("r", ANGLE, "joint position r"),
    **_joints("r_dot", RATE, "joint rate dr/dt"),
    "u": SignalSpec(AGENT, "N", "along the base's z axis", "thrust u_j, as applied"),
    "tau": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "body torque tau_j, as applied"),
    **_joints("tau_r", TORQUE, "joint torque or force tau_r, as applied"),
    "thrust_saturated": SignalSpec(AGENT, "1", "none", "1 if the thrust is at its limit, otherwise 0"),
    "lam": SignalSpec(CONTACT, "N", "world", "contact force on the payload lambda_app"),
    "lam_cmd": SignalSpec(CONTACT, "N", "world", "commanded contact force lambda_cmd"),
    "lam_hat": SignalSpec(CONTACT, "N", "world", "estimated contact force lambda_hat"),
    "R_L_hat": SignalSpec(
        ROTATION_DIMS, "1", "payload to world", "estimated payload attitude, used by the force allocation"
    ),
    **_wrench("W_d", NEWTON, "desired payload wrench W_d"),
    **_wrench("delta_W", NEWTON, "wrench mismatch Delta W = G lambda_app - W_d, with contact moments"),
    "eta": SignalSpec(("eta_index",), "N", "coordinates in the kernel of G", "internal-force input eta"),
    **_wrench("f_L", NEWTON, "true payload residual: wrench that the nominal model does not explain"),
    **_wrench("f_L_hat", NEWTON, "predicted payload residual"),
    "f_x": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "true residual force on an agent"),
    "f_w": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "true residual moment on an agent"),
    **_joints("f_r", TORQUE, "true residual joint torque or force"),
    "f_x_hat": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "predicted residual force on an agent"),
    "f_w_hat": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "predicted residual moment on an agent"),
    **_joints("f_r_hat", TORQUE, "predicted residual joint torque or force"),
    "Phi": SignalSpec((), "m", "none", "largest constraint violation |Phi|"),
    "Phi_dot": SignalSpec((), "m/s", "none", "largest constraint rate |dPhi/dt|"),
    "min_delassus_singular_value": SignalSpec(AGENT, "1/kg", "none", "smallest singular value of A_j M_j^-1 A_j^T"),
    "lam_std": SignalSpec(CONTACT, "N", "world", "standard deviation of the estimated contact force"),
    **_wrench("delta_W_hat", NEWTON, "estimated wrench mismatch G lambda_hat - W_d"),
    **_wrench("delta_W_std", NEWTON, "standard deviation of the estimated wrench mismatch"),
    **_wrench("correction_L", NEWTON, "correction of the payload residual, as applied"),
    "correction_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "correction of the residual force on an agent, as applied"
    ),
    **_wrench("correction_std_L", NEWTON, "standard deviation of the corrected payload residual"),
    "correction_std_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "standard deviation of the corrected residual force on an agent"
    ),
    **_wrench("correction_weight_L", ONE, "applied share of the estimated error of the payload model"),
    "correction_weight_x": SignalSpec(
        AGENT_VECTOR_DIMS, "1", "world", "applied share of the estimated error of the agent force model"
    ),
    **_wrench("label_L", NEWTON, "label of the payload before the label filter"),
    "label_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "label of the residual force on an agent before the label filter"
    ),
    **_wrench("model_prediction_L", NEWTON, "payload residual predicted by the model without correction"),
    "model_prediction_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "residual force on an agent predicted by the model without correction"
    ),
    "label_valid": SignalSpec((), "1", "none", "1 in periods with recent tip force readings, otherwise 0"),
    "correction_nis": SignalSpec((), "1", "none", "normalized innovation squared of the correction, mean of outputs"),
    "slack_roll_pitch": SignalSpec((), "N", "none", "roll and pitch moment not achieved, divided by its lever"),
    "slack_z": SignalSpec((), "N", "none", "vertical force on the team that is not achieved"),
    "slack_xy": SignalSpec((), "N", "none", "horizontal force on the team that is not achieved"),
    "slack_yaw": SignalSpec((), "N", "none", "yaw moment not achieved, divided by its lever"),
    "allocation_primal": SignalSpec((), "N", "none", "primal residual of the allocation"),
    "allocation_dual": SignalSpec((), "N", "none", "dual residual of the allocation"),
    "tilt_limited": SignalSpec(AGENT, "1", "none", "1 if the allocated thrust is at the tilt limit, otherwise 0"),
    "thrust_limited": SignalSpec(AGENT, "1", "none", "1 if the allocated thrust is at a limit, otherwise 0"),
    "friction_limited": SignalSpec(
        ("contact",), "1", "none", "1 if the allocated force is at the friction cone, otherwise 0"
    ),
    "force_limited": SignalSpec(("contact",), "1", "none", "1 if the allocated force is at a limit, otherwise 0"),
    "contact_moment": SignalSpec(CONTACT, "N m", "payload", "moment of a contact on the payload"),
    "effectiveness": SignalSpec(AGENT, "1", "none", "rotor effectiveness of an agent that the controller compensates"),
}
"""Variables on the axis `time`: the signals of `StepRecord`, quaternions and base positions.

Variables from `lam_std` to `delta_W_std_moment` exist for contact forces without tip force sensors, those from
`correction_L_force` to `correction_nis` for controllers with a residual corrector, and those after them for allocators
with limits. Quaternions are continuous in time: their sign does not change between two ticks.
"""

UNCERTAINTY_SIGNALS = {
    **_wrench("sigma_f_L", NEWTON, "posterior standard deviation of the payload residual"),
    "sigma_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "posterior standard deviation of the residual force on an agent"
    ),
    "sigma_f_w": SignalSpec(
        AGENT_VECTOR_DIMS, "N m", "base", "posterior standard deviation of the residual moment on an agent"
    ),
    **_joints("sigma_f_r", TORQUE, "posterior standard deviation of the residual joint torque or force"),
    "sigma_L": SignalSpec(
        (),
        "N",
        "none",
        "posterior standard deviation of the payload residual, norm over forces and moments; moments divided by 1 m",
    ),
    "sigma_L_force": SignalSpec((), "N", "none", "posterior standard deviation of the payload residual force, norm"),
    "sigma_L_moment": SignalSpec(
        (), "N m", "none", "posterior standard deviation of the payload residual moment, norm"
    ),
    "sigma_A": SignalSpec(
        (),
        "N",
        "none",
        "posterior standard deviation of the residuals, norm over all outputs, sum over agents; moments divided by 1 m",
    ),
    "sigma_A_force": SignalSpec(
        (), "N", "none", "posterior standard deviation of the residual forces on the agents, norm, sum over agents"
    ),
    "sigma_A_moment": SignalSpec(
        (),
        "N m",
        "none",
        "posterior standard deviation of moments and joint torques, norm, sum over agents; prismatic joints times 1 m",
    ),
    **_wrench("label_bias_std_f_L", NEWTON, "standard deviation of the bias of the payload labels"),
    "label_bias_std_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "standard deviation of the bias of the force labels of an agent"
    ),
    "label_bias_std_f_w": SignalSpec(
        AGENT_VECTOR_DIMS,
        "N m",
        "base",
        "standard deviation of the bias of the moment labels of an agent",
    ),
    **_joints("label_bias_std_f_r", TORQUE, "standard deviation of the bias of the joint torque labels"),
    **_wrench("predictive_std_f_L", NEWTON, "predictive standard deviation of the payload residual"),
    "predictive_std_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "predictive standard deviation of the residual force on an agent"
    ),
    **_wrench("rho_f_L", NEWTON, "error bound of the predicted payload residual, by component"),
    "rho_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "error bound of the predicted residual force on an agent, by component"
    ),
    "rho_f_w": SignalSpec(
        AGENT_VECTOR_DIMS, "N m", "base", "error bound of the predicted residual moment on an agent, by component"
    ),
    **_joints("rho_f_r", TORQUE, "error bound of the predicted residual joint torque or force"),
    "rho_bar_L": SignalSpec(
        (),
        "N",
        "none",
        "error bound of the predicted payload residual, norm over forces and moments; moments divided by 1 m",
    ),
    "rho_bar_L_force": SignalSpec((), "N", "none", "error bound of the predicted payload residual force, norm"),
    "rho_bar_L_moment": SignalSpec((), "N m", "none", "error bound of the predicted payload residual moment, norm"),
    "rho_bar_j": SignalSpec(
        AGENT,
        "N",
        "none",
        "error bound of the predicted residual of an agent, norm over all outputs; moments divided by 1 m",
    ),
    "rho_bar_j_force": SignalSpec(AGENT, "N", "none", "error bound of the predicted residual force on an agent, norm"),
    "rho_bar_j_moment": SignalSpec(
        AGENT,
        "N m",
        "none",
        "error bound of the predicted moment and joint torques of an agent, norm; prismatic joints times 1 m",
    ),
}
"""Variables on the coarser axis `time_sigma`: posterior, label bias, predictive standard deviation and error bounds.

Norms of a body add newtons and newton meters, as in the paper. Error bounds are infinite where data contradict the
assumptions of the bound.
"""

QUATERNIONS = {"q_L": "R_L", "q": "R"}
"""Quaternion variables, and the rotation matrices of the same attitude."""

SPECS = SIGNALS | UNCERTAINTY_SIGNALS
"""All variables by name."""


def _parts(name: str) -> tuple[str, str]:
    """Return the names of the linear and the angular variable of a signal with six components."""
    return ("a_L", "alpha_L") if name == "a_L" else (f"{name}_force", f"{name}_moment")


def has_parts(name: str) -> bool:
    """Return whether a signal of six components is split: a payload wrench, or the payload acceleration `a_L`."""
    return name == "a_L" or (name not in SPECS and f"{name}_force" in SPECS)


def split_signal(name: str, values: np.ndarray, prismatic: np.ndarray) -> dict[str, np.ndarray]:
    """Split a signal of the records into variables with one unit each.

    Args:
        name: Field of `StepRecord`, or uncertainty signal with all outputs.
        values: Values, time first.
        prismatic: Whether each joint is prismatic, in team order.

    Returns:
        Values by variable; joint variables of a type of joint that the team lacks are omitted.
    """
    if has_parts(name):
        return dict(zip(_parts(name), (values[:, :3], values[:, 3:]), strict=True))
    if f"{name}_prismatic" not in SPECS:
        return {name: values}
    by_type = {name: values[:, ~prismatic], f"{name}_prismatic": values[:, prismatic]}
    return {variable: x for variable, x in by_type.items() if x.shape[1]}


def variables(time: str, signals: Mapping[str, np.ndarray], prismatic: np.ndarray) -> dict[str, xr.Variable]:
    """Return the variables of signals on one time axis, with unit, frame and description, in the order of `SPECS`.

    Args:
        time: Name of the time dimension.
        signals: Values by the names of `split_signal`, time first.
        prismatic: Whether each joint is prismatic, in team order.
    """
    values: dict[str, np.ndarray] = {}
    for name, x in signals.items():
        values |= split_signal(name, x, prismatic)
    found = {}
    for name, spec in SPECS.items():
        if name in values:
            attrs = {"units": spec.units, "frame": spec.frame, "long_name": spec.long_name}
            found[name] = xr.Variable((time, *spec.dims), values[name], attrs)
    return found


def label_coordinates(names: Mapping[str, Sequence[str]]) -> dict[str, xr.Variable]:
    """Return the coordinates with the names along each dimension.

    Args:
        names: Names by dimension; those of axes and quaternions are added.
    """
    names = {**names, "axis": AXES, "body_axis": AXES, "quaternion": QUATERNION}
    return {dim: xr.Variable(dim, np.array(list(labels), dtype=object)) for dim, labels in names.items()}


def time_coordinate(dim: str, t: np.ndarray) -> xr.Variable:
    """Return a time coordinate.

    Args:
        dim: `time`, or `time_sigma` for the uncertainty signals.
        t: Times since the start of the flight [s].
    """
    subject = "time" if dim == "time" else "time of uncertainty signals"
    return xr.Variable(dim, t, {"units": "s", "axis": "T", "long_name": f"{subject} since the start"})


def joint_coordinates(joints: np.ndarray, prismatic: np.ndarray) -> dict[str, xr.Variable]:
    """Return the coordinates of the joint variables: names by type of joint, and their places in team order.

    Args:
        joints: Joint names in team order.
        prismatic: Whether each joint is prismatic.
    """
    coordinates = {}
    for dims, selected in ((JOINT, ~prismatic), (PRISMATIC_JOINT, prismatic)):
        if selected.any():
            (dim,) = dims
            order = {"units": "1", "long_name": "place among all joints of the team, from 0"}
            coordinates[dim] = xr.Variable(dims, joints[selected])
            coordinates[f"{dim}_order"] = xr.Variable(dims, np.flatnonzero(selected), order)
    return coordinates


def stack_parts(ds: xr.Dataset, name: str) -> xr.DataArray:
    """Return a wrench signal, or the payload acceleration, with six components on one axis.

    The first three components are the force or linear acceleration [N or m/s^2, world]. The last three are the moment
    or angular acceleration [N m or rad/s^2, payload frame].

    Args:
        ds: Log.
        name: Signal without suffix, for example ``f_L`` for `f_L_force` and `f_L_moment`, or ``a_L``.

    Returns:
        Array `(time, 6)` with the coordinate `component`.

    Raises:
        KeyError: If the log has no such signal.
    """
    linear, angular = (ds[part] for part in _parts(name))
    time = linear.dims[0]
    labels = ACCELERATION if name == "a_L" else WRENCH
    values = np.concatenate([linear.values, angular.values], axis=1)
    return xr.DataArray(values, {time: ds[time], "component": list(labels)}, (time, "component"), name)


def all_joints(ds: xr.Dataset, name: str) -> xr.DataArray:
    """Return a joint signal of all joints in team order, revolute and prismatic ones on one axis.

    Args:
        ds: Log.
        name: Signal of the revolute joints, for example ``r``.

    Returns:
        Array `(time, joint)`: [rad, rad/s or N m] for revolute and [m, m/s or N] for prismatic joints. It has no
        columns if the team has no joints.

    Raises:
        KeyError: If there is not a joint signal of this name.
    """
    if f"{name}_prismatic" not in SPECS:
        raise KeyError(f"{name} is not a joint signal")
    time = "time" if name in SIGNALS else "time_sigma"
    found = [(ds[part], dim) for part, (dim,) in ((name, JOINT), (f"{name}_prismatic", PRISMATIC_JOINT)) if part in ds]
    values = np.concatenate([np.zeros((ds.sizes[time], 0)), *(x.values for x, _ in found)], axis=1)
    names = np.concatenate([np.array([], dtype=object), *(ds[dim].values for _, dim in found)])
    order = np.argsort(np.concatenate([np.array([], dtype=int), *(ds[f"{dim}_order"].values for _, dim in found)]))
    return xr.DataArray(values[:, order], {time: ds[time], "joint": names[order]}, (time, "joint"), name)
