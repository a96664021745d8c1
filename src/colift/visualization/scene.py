"""Drawing data of a flight for playback pages, images and videos.

Poses and forces are taken from the log; the forward kinematics of the model give the positions of joints and tips. The
geometry of the team is taken from the scenario that the log contains.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from colift.analysis.poses import base_positions, desired_attitude
from colift.closed_loop import log, pose_signals
from colift.math import so3
from colift.math.linalg import matvec
from colift.models import aerial_manipulator, mjcf
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import State
from colift.scenario import Scenario
from colift.scenario.schema import Fault
from colift.scenario.team import agent_names, contact_names
from colift.trajectories.base import PayloadSetpoint

MAX_FRAME_RATE = 30.0  # 1/s, upper limit of the rate of drawn rows
MIN_LINK_LENGTH = 1e-3  # m, length of the shortest drawn link
MAX_ARROW_LENGTH = 0.9  # team sizes, length of the longest arrow of each kind


# Signals --------------------------------------------------------------------------------------------------------------


def frame_rows(ds: xr.Dataset) -> np.ndarray:
    """Return the indices of the drawn rows of a log, at most `MAX_FRAME_RATE` per second, including the last row.

    Rows from the first pose that is not finite on are omitted.

    Args:
        ds: Log.

    Returns:
        Row indices in ascending order.
    """
    poses = [ds[name].values.reshape(ds.sizes["time"], -1) for name in ("p", "R_L", "p_d", "x", "R")]
    not_finite = ~np.isfinite(np.concatenate([*poses, log.all_joints(ds, "r").values], axis=1)).all(axis=1)
    return subsample(ds.time.values[: int(not_finite.argmax()) if not_finite.any() else None])


def subsample(t: np.ndarray) -> np.ndarray:
    """Return the indices of the drawn times, at most `MAX_FRAME_RATE` per second, including the first and the last.

    Args:
        t: Equidistant times [s].

    Returns:
        Indices in ascending order.
    """
    step = stride(t[1] - t[0]) if len(t) > 1 else 1
    return np.unique([*range(0, len(t), step), max(len(t) - 1, 0)])[: len(t)]


def stride(period: float) -> int:
    """Return the number of rows from one drawn row to the next.

    Args:
        period: Time between two rows [s].

    Returns:
        The number of rows, at least 1.
    """
    return max(1, round(1 / MAX_FRAME_RATE / period))


def to_json_times(t: Any) -> list[float]:
    """Return times as numbers for JSON, rounded to 1e-6 s."""
    return [round(float(each), 6) for each in t]


def frames(ds: xr.Dataset, team: Team) -> dict[str, np.ndarray]:
    """Return the signals of the scene at the drawn rows; the first axis is time.

    Positions are in the world frame [m], attitudes are quaternions (w, x, y, z) from body to world frame.

    - `p`, `q`: pose of the payload.
    - `p_d`, `q_d`: reference pose.
    - `base`, `base_q`: origin and attitude of each base.
    - `nodes`: base, joints and tips of each agent.
    - `u`: thrust of each agent [N].
    - `lam`: contact forces on the payload, world frame [N].
    - `disturbance`: `m_L (a_L - g) - sum lam`, the force on the payload besides contacts and gravity, world frame [N].

    Args:
        ds: Log.
        team: True parameters of the team.

    Returns:
        Signals by name.
    """
    return poses(ds.isel(time=frame_rows(ds)), team)


def poses(ds: xr.Dataset, team: Team) -> dict[str, np.ndarray]:
    """Return the signals of `frames` at all rows of a log.

    Args:
        ds: Log.
        team: True parameters of the team.

    Returns:
        Signals by name.
    """
    base = base_positions(ds, team)
    R_d = desired_attitude(jnp.asarray(ds.R_L.values), jnp.asarray(ds.e_R.values), jnp.asarray(ds.Psi.values))
    non_gravity = float(team.payload.mass) * (ds.a_L.values - np.asarray(team.gravity))
    return {
        "p": ds.p.values,
        "q": ds.q_L.values,
        "p_d": ds.p_d.values,
        "q_d": np.asarray(_quaternion(R_d)),
        "base": base,
        "base_q": ds.q.values,
        "nodes": _nodes(team, base, ds.R.values, log.all_joints(ds, "r").values),
        "u": ds.u.values,
        "lam": ds.lam.values,
        "disturbance": non_gravity - ds.lam.values.sum(axis=1),
    }


def state_poses(team: Team, state: State, setpoint: PayloadSetpoint) -> dict[str, np.ndarray]:
    """Return the poses of `frames` for one state of the team, with one row.

    Args:
        team: True parameters of the team.
        state: State of the team.
        setpoint: Reference pose at the same time.

    Returns:
        Signals by name, without forces.
    """
    R, x = (np.concatenate([np.asarray(getattr(group, name)) for group in state.agents])[None] for name in ("R", "x"))
    r = np.concatenate([np.asarray(group.r).ravel() for group in state.agents])[None]
    base = pose_signals.base_positions(team, R, x, r)
    return {
        "p": np.asarray(state.payload.p)[None],
        "q": np.asarray(_quaternion(state.payload.R))[None],
        "p_d": np.asarray(setpoint.p)[None],
        "q_d": np.asarray(_quaternion(setpoint.R))[None],
        "base": base,
        "base_q": np.asarray(_quaternion(jnp.asarray(R))),
        "nodes": _nodes(team, base, R, r),
    }


def _nodes(team: Team, base: np.ndarray, R: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Compute the positions of base origin, joints and tips of all agents in the world frame [m]; time first."""
    nodes, agent, joint = [], 0, 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        agents, joints = slice(agent, agent + size), slice(joint, joint + size * group.tree.joints)
        own = r[:, joints].reshape(len(r), size, group.tree.joints)
        points = np.asarray(_points(group, *map(jnp.asarray, (R[:, agents], base[:, agents], own))))
        nodes.append(points.reshape(len(points), -1, 3))
        agent, joint = agents.stop, joints.stop
    return np.concatenate(nodes, axis=1)


@jax.jit
def _points(
    group: AerialManipulator,
    R: Float[Array, "time agents 3 3"],
    p_base: Float[Array, "time agents 3"],
    r: Float[Array, "time agents n_r"],
) -> Float[Array, "time agents nodes 3"]:
    """Compute the positions of base origin, joints and tips in the world frame [m]."""

    def agent_points(
        agent: AerialManipulator, R: Float[Array, "3 3"], p_base: Float[Array, "3"], r: Float[Array, "n_r"]
    ) -> Array:
        joints_and_tips = aerial_manipulator.forward_kinematics(agent, r).points[agent.tree.joints + 1 :]
        return p_base[None] + matvec(R[None], jnp.concatenate([jnp.zeros((1, 3)), joints_and_tips]))

    return jax.vmap(jax.vmap(agent_points), in_axes=(None, 0, 0, 0))(group, R, p_base, r)


_quaternion = jax.jit(so3.quaternion)


def plot_signals(ds: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the signals of the plots: those of `error_signals` at the drawn rows, and `sigma`.

    `sigma` contains the force parts of `sigma_L` and `sigma_A` [N] at the drawn times of the uncertainty signals.

    Args:
        ds: Log.

    Returns:
        Signals by name; the first axis is time.
    """
    few = ds.isel(time_sigma=subsample(ds.time_sigma.values))
    sigma = np.stack([few.sigma_L_force.values, few.sigma_A_force.values], axis=1)
    return error_signals(ds.isel(time=frame_rows(ds))) | {"sigma": sigma}


def error_signals(ds: xr.Dataset) -> dict[str, np.ndarray]:
    """Compute the errors and residual forces of the payload at all rows of a log.

    - `e_p`: norm of the position error [m].
    - `angle`: rotation angle to the reference [deg].
    - `residual`, `residual_hat`: true and predicted residual force on the payload [N].

    Args:
        ds: Log.

    Returns:
        Signals by name; the first axis is time.
    """
    angle = np.arctan2(np.linalg.norm(ds.e_R.values, axis=1), 1 - ds.Psi.values)
    return {
        "e_p": np.linalg.norm(ds.e_p.values, axis=1)[:, None],
        "angle": np.rad2deg(angle)[:, None],
        "residual": ds.f_L_force.values,
        "residual_hat": ds.f_L_hat_force.values,
    }


def event_markers(ds: xr.Dataset, faults: Sequence[Fault] = ()) -> dict[str, Any]:
    """Return the events of a flight with their times [s].

    - `updates`: times of the model updates.
    - `learning_end`: end of learning, or None if learning continues beyond `T_end`.
    - `internal`: spans of internal forces.
    - `at_limit`: for each agent that reached its thrust limit, the spans at the limit.
    - `faults`: text and span of each fault that acted.

    Args:
        ds: Log.
        faults: Faults of the scenario.

    Returns:
        Events by name, as values for JSON.
    """
    t, (updates, end) = ds.time.values, log.update_times(ds)
    limited = {str(name): _spans(t, ds.thrust_saturated.sel(agent=name).values > 0) for name in ds.agent.values}
    return {
        "updates": updates,
        "learning_end": end,
        "internal": _spans(t, np.linalg.norm(ds.eta.values, axis=1) > 0),
        "at_limit": {name: spans for name, spans in limited.items() if spans},
        "faults": [
            {"text": fault.describe(), "span": to_json_times([fault.start_s, min(fault.last_time, t[-1])])}
            for fault in faults
            if fault.start_s <= t[-1]
        ],
    }


def join_markers(earlier: dict[str, Any], later: dict[str, Any]) -> dict[str, Any]:
    """Return the events of a flight from those of two consecutive parts.

    Args:
        earlier: Result of `event_markers` for the flight until the later part.
        later: Result of `event_markers` for the later part.

    Returns:
        Events of both parts; the later part contains all updates and faults until its end.
    """
    at_limit = {
        name: _join_spans(earlier["at_limit"].get(name, []), later["at_limit"].get(name, []))
        for name in (earlier["at_limit"] | later["at_limit"])
    }
    return later | {"internal": _join_spans(earlier["internal"], later["internal"]), "at_limit": at_limit}


def _join_spans(earlier: list[list[float]], later: list[list[float]]) -> list[list[float]]:
    """Return the spans of two consecutive parts; spans less than a frame apart are merged."""
    if not (earlier and later) or later[0][0] - earlier[-1][1] > 1 / MAX_FRAME_RATE:
        return [*earlier, *later]
    return [*earlier[:-1], [earlier[-1][0], later[0][1]], *later[1:]]


def _spans(t: np.ndarray, active: np.ndarray) -> list[list[float]]:
    """Return first and last time of each active span; spans less than a frame apart are merged."""
    times = t[active]
    if not times.size:
        return []
    cuts = np.flatnonzero(np.diff(times) > 1 / MAX_FRAME_RATE)
    return [to_json_times([a, b]) for a, b in zip(times[[0, *(cuts + 1)]], times[[*cuts, -1]], strict=True)]


# Geometry -------------------------------------------------------------------------------------------------------------


def team_geometry(team: Team, settings: Scenario) -> dict[str, Any]:
    """Return the geometry of the team as values for JSON.

    Bodies are boxes with the mass and inertia of payload and bases. Rotors are at the corners of a base. Links connect
    the nodes of `frames`. `size_m` is the size of the team.

    Args:
        team: True parameters of the team.
        settings: Scenario, for the names of agents and contacts.

    Returns:
        Entries `payload`, `agents`, `contacts`, `nodes`, `links` and `size_m`; lengths in m, body frames.
    """
    half, axes = mjcf.inertia_box(float(team.payload.mass), np.asarray(team.payload.inertia))
    names, contacts = agent_names(settings), iter(contact_names(settings))
    shape: dict[str, Any] = {
        "payload": {"half_m": half.tolist(), "axes_wxyz": np.asarray(_quaternion(jnp.asarray(axes))).tolist()},
        "agents": [],
        "contacts": [],
        "nodes": [],
        "links": [],
    }
    for name, agent in zip(names, _agents(team), strict=True):
        tree, start = agent.tree, len(shape["nodes"])
        span, body = mjcf.inertia_box(agent.mass[0], agent.inertia[0])
        span = np.abs(body @ span)
        rotors = [agent.com[0] + span * [x, y, 1] for x, y in mjcf.ROTORS]
        width = float(span[:2].min())
        shape["agents"].append(
            {
                "name": name,
                "rotors_m": [np.asarray(each, dtype=float).tolist() for each in rotors],
                "rotor_radius_m": 0.6 * width,
                "span_m": width,
            }
        )
        shape["nodes"] += ["base", *["joint"] * tree.joints, *["tip"] * tree.arms]
        ends = [(parent, agent.joint_position[k], k + 1) for k, parent in enumerate(tree.parents)]
        ends += [(body, agent.tip_position[b], tree.joints + 1 + b) for b, body in enumerate(tree.tip_bodies)]
        prismatic = (False, *tree.prismatic)
        for b, position in enumerate(agent.contact_position):
            shape["contacts"].append(
                {
                    "name": next(contacts),
                    "agent": len(shape["agents"]) - 1,
                    "arm": b,
                    "node": start + tree.joints + 1 + b,
                    "at_m": position.tolist(),
                    "on_box_m": (axes @ np.clip(axes.T @ position, -half, half)).tolist(),
                }
            )
        shape["links"] += [
            [start + body, start + node]
            for body, end, node in ends
            if np.linalg.norm(end) > MIN_LINK_LENGTH or (node < len(prismatic) and prismatic[node])
        ]
    distances = [np.linalg.norm(half), *(np.linalg.norm(contact["at_m"]) for contact in shape["contacts"])]
    return shape | {"size_m": float(max(distances) + max(agent["span_m"] for agent in shape["agents"]))}


def _agents(team: Team) -> Iterator[AerialManipulator]:
    """Return the parameters of each agent in team order as NumPy arrays."""
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        for j in range(size):
            yield jax.tree.map(lambda leaf, j=j: np.asarray(leaf)[j], group)


def ground_height(tracks_by_case: Mapping[str, dict[str, np.ndarray]]) -> float:
    """Return the height of the ground, world frame [m]: 0, or the next whole meter below the lowest point.

    Args:
        tracks_by_case: Signals of `frames` for each case.

    Returns:
        The height.
    """
    lowest = min(float(x[..., 2].min()) for tracks in tracks_by_case.values() for x in (tracks["nodes"], tracks["p"]))
    return float(min(0, math.floor(lowest)))


def arrow_scales(tracks_by_case: Mapping[str, dict[str, np.ndarray]], length: float) -> dict[str, float]:
    """Return the force per arrow length of each kind of arrow [N/m].

    The value is 1, 2 or 5 times a power of ten; 99 % of the arrows are at most `MAX_ARROW_LENGTH` team sizes long.

    Args:
        tracks_by_case: Signals of `frames` for each case.
        length: Size of the team [m].

    Returns:
        Scales by the kinds `thrust`, `contact` and `disturbance`.
    """
    scales = {}
    for kind, track in {"thrust": "u", "contact": "lam", "disturbance": "disturbance"}.items():
        forces = [
            np.abs(x[track]) if kind == "thrust" else np.linalg.norm(x[track], axis=-1) for x in tracks_by_case.values()
        ]
        norms = np.concatenate([force.ravel() for force in forces])
        required = float(np.quantile(norms[np.isfinite(norms)], 0.99)) / (MAX_ARROW_LENGTH * length)
        power = 10.0 ** math.floor(math.log10(max(required, 1e-3)))
        scales[kind] = next(power * digit for digit in (1, 2, 5, 10) if power * digit >= max(required, 1e-3))
    return scales
