"""Flights as they are seen: what is drawn of a team at each time, and what it looks like.

What moves comes from the log, by the model's own kinematics; what does not, from the scenario that the log holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from colift.analysis.poses import desired_attitude, poses_by_group
from colift.closed_loop import log
from colift.math import so3
from colift.math.linalg import matvec
from colift.models import aerial_manipulator, mjcf
from colift.models.parameters import AerialManipulator, Team
from colift.scenario import Scenario
from colift.scenario.team import agent_names, contact_names

MAX_FRAME_RATE = 30.0  # 1/s, at most, of what is drawn
MIN_LINK_LENGTH = 1e-3  # m, the shortest link that is drawn
MAX_ARROW_LENGTH = 0.9  # length of the longest arrow of its kind, in sizes of the team


# What moves -----------------------------------------------------------------------------------------------------------


def frame_rows(ds: xr.Dataset) -> np.ndarray:
    """Which rows of a log are drawn: some `FRAMES` a second, and the last, of those before a pose is not finite."""
    poses = [ds[name].values.reshape(ds.sizes["time"], -1) for name in ("p", "R_L", "p_d", "x", "R", "r")]
    broken = ~np.isfinite(np.concatenate(poses, axis=1)).all(axis=1)
    return subsample(ds.time.values[: int(broken.argmax()) if broken.any() else None])


def subsample(t: np.ndarray) -> np.ndarray:
    """Which of some times are drawn, some `FRAMES` a second, the first and the last among them."""
    step = stride(t[1] - t[0]) if len(t) > 1 else 1
    return np.unique([*range(0, len(t), step), max(len(t) - 1, 0)])[: len(t)]


def stride(period: float) -> int:
    """Of how many rows, `period` s apart, one is drawn."""
    return max(1, round(1 / MAX_FRAME_RATE / period))


def to_json_times(t: Any) -> list[float]:
    """Times as JSON has them."""
    return [round(float(each), 6) for each in t]


def frames(ds: xr.Dataset, team: Team) -> dict[str, np.ndarray]:
    """What the scene shows at every drawn row, by name; time leads.

    p, p_d (3) m: payload and reference; q, q_d (4): their attitudes as quaternions (w, x, y, z), to the world. base,
    base_q (agents, 3 and 4): origin and attitude of the bases. nodes (nodes, 3) m, world: of each agent its base,
    joints and tips. u (agents) N; lam (contacts, 3) N, world, on the payload; disturbance (3) N, world, on the payload:
    all but contacts and gravity that its acceleration shows.
    """
    return poses(ds.isel(time=frame_rows(ds)), team)


def poses(at: xr.Dataset, team: Team) -> dict[str, np.ndarray]:
    """The same as `frames` at every row of a log."""
    base, nodes = [], []
    for group, R, x, r in poses_by_group(at, team):
        points = np.asarray(_points(group, R, x, r))
        base.append(points[:, :, 0])
        nodes.append(points.reshape(len(points), -1, 3))
    R_d = desired_attitude(jnp.asarray(at.R_L.values), jnp.asarray(at.e_R.values), jnp.asarray(at.Psi.values))
    pull = float(team.payload.mass) * (at.a_L.values[:, :3] - np.asarray(team.gravity))
    return {
        "p": at.p.values,
        "q": np.asarray(_quaternion(jnp.asarray(at.R_L.values))),
        "p_d": at.p_d.values,
        "q_d": np.asarray(_quaternion(R_d)),
        "base": np.concatenate(base, axis=1),
        "base_q": np.asarray(_quaternion(jnp.asarray(at.R.values))),
        "nodes": np.concatenate(nodes, axis=1),
        "u": at.u.values,
        "lam": at.lam.values,
        "disturbance": pull - at.lam.values.sum(axis=1),
    }


@jax.jit
def _points(
    group: AerialManipulator,
    R: Float[Array, "time agents 3 3"],
    x: Float[Array, "time agents 3"],
    r: Float[Array, "time agents n_r"],
) -> Float[Array, "time agents nodes 3"]:
    """Base origin, joints and tips in the world, m."""

    def one(agent: AerialManipulator, R: Float[Array, "3 3"], x: Float[Array, "3"], r: Float[Array, "n_r"]) -> Array:
        moved = aerial_manipulator.forward_kinematics(agent, r).joint_origin[agent.tree.joints + 1 :]
        from_base = jnp.concatenate([jnp.zeros((1, 3)), moved]) - aerial_manipulator.center_of_mass(agent, r)[None]
        return x[None] + matvec(R[None], from_base)

    return jax.vmap(jax.vmap(one), in_axes=(None, 0, 0, 0))(group, R, x, r)


_quaternion = jax.jit(so3.quaternion)


def plot_signals(ds: xr.Dataset) -> dict[str, np.ndarray]:
    """What the plots show besides: e_p (1) m, angle (1) deg between payload and reference, sigma (2) N.

    sigma is at its own times: the force parts of `sigma_L` and `sigma_A`.
    """
    few = ds.isel(time_sigma=subsample(ds.time_sigma.values))
    sigma = np.stack([few.sigma_L_force.values, few.sigma_A_force.values], axis=1)
    return error_signals(ds.isel(time=frame_rows(ds))) | {"sigma": sigma}


def error_signals(at: xr.Dataset) -> dict[str, np.ndarray]:
    """e_p and angle, as `curves` has them, at every row of a log."""
    angle = np.arctan2(np.linalg.norm(at.e_R.values, axis=1), 1 - at.Psi.values)
    return {
        "e_p": np.linalg.norm(at.e_p.values, axis=1)[:, None],
        "angle": np.rad2deg(angle)[:, None],
    }


def event_markers(ds: xr.Dataset) -> dict[str, Any]:
    """What a case does when, in s: updates of its models, the end of learning, spans of internal forces and of limits.

    `at_limit` holds, of each agent that met its thrust limit, the spans in which it did; learning that goes on beyond
    T_end has no end.
    """
    t, (updates, end) = ds.time.values, log.update_times(ds)
    met = {str(name): _spans(t, ds.saturated.sel(agent=name).values > 0) for name in ds.agent.values}
    return {
        "updates": updates,
        "learning_end": end,
        "internal": _spans(t, np.linalg.norm(ds.eta.values, axis=1) > 0),
        "at_limit": {name: spans for name, spans in met.items() if spans},
    }


def _spans(t: np.ndarray, active: np.ndarray) -> list[list[float]]:
    """First and last time of every stretch in which something is active; stretches closer than a frame are one."""
    at = t[active]
    if not at.size:
        return []
    cuts = np.flatnonzero(np.diff(at) > 1 / MAX_FRAME_RATE)
    return [to_json_times([a, b]) for a, b in zip(at[[0, *(cuts + 1)]], at[[*cuts, -1]], strict=True)]


# What does not --------------------------------------------------------------------------------------------------------


def team_geometry(team: Team, told: Scenario) -> dict[str, Any]:
    """The team as the scene draws it: boxes of the bodies' inertia, rotors at their corners, links between nodes."""
    half, axes = mjcf.inertia_box(float(team.payload.mass), np.asarray(team.payload.inertia))
    names, contacts = agent_names(told), iter(contact_names(told))
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
        short = float(span[:2].min())
        shape["agents"].append(
            {
                "name": name,
                "rotors_m": [np.asarray(each, dtype=float).tolist() for each in rotors],
                "rotor_radius_m": 0.6 * short,
                "span_m": short,
            }
        )
        shape["nodes"] += ["base", *["joint"] * tree.joints, *["tip"] * tree.arms]
        ends = [(parent, agent.joint_position[k], k + 1) for k, parent in enumerate(tree.parents)]
        ends += [(body, agent.tip_position[b], tree.joints + 1 + b) for b, body in enumerate(tree.tip_bodies)]
        slides = (False, *tree.prismatic)
        for b, at in enumerate(agent.contact_position):
            shape["contacts"].append(
                {
                    "name": next(contacts),
                    "agent": len(shape["agents"]) - 1,
                    "arm": b,
                    "node": start + tree.joints + 1 + b,
                    "at_m": at.tolist(),
                    "on_box_m": (axes @ np.clip(axes.T @ at, -half, half)).tolist(),
                }
            )
        shape["links"] += [
            [start + body, start + node]
            for body, end, node in ends
            if np.linalg.norm(end) > MIN_LINK_LENGTH or (node < len(slides) and slides[node])
        ]
    far = [np.linalg.norm(half), *(np.linalg.norm(contact["at_m"]) for contact in shape["contacts"])]
    return shape | {"size_m": float(max(far) + max(agent["span_m"] for agent in shape["agents"]))}


def _agents(team: Team) -> Iterator[AerialManipulator]:
    """Every agent alone, in team order, as NumPy arrays."""
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        for j in range(size):
            yield jax.tree.map(lambda leaf, j=j: np.asarray(leaf)[j], group)


def ground_height(moving: Mapping[str, dict[str, np.ndarray]]) -> float:
    """Height of the ground, m: 0, or a whole metre below whatever is lower."""
    lowest = min(float(x[..., 2].min()) for tracks in moving.values() for x in (tracks["nodes"], tracks["p"]))
    return float(min(0, math.floor(lowest)))


def arrow_scales(moving: Mapping[str, dict[str, np.ndarray]], size: float) -> dict[str, float]:
    """Newtons a metre of each kind of arrow: 1, 2 or 5 times a power of ten, with which the longest fit the team."""
    found = {}
    for kind, track in {"thrust": "u", "contact": "lam", "disturbance": "disturbance"}.items():
        forces = [np.abs(x[track]) if kind == "thrust" else np.linalg.norm(x[track], axis=-1) for x in moving.values()]
        norms = np.concatenate([force.ravel() for force in forces])
        most = float(np.quantile(norms[np.isfinite(norms)], 0.99)) / (MAX_ARROW_LENGTH * size)
        power = 10.0 ** math.floor(math.log10(max(most, 1e-3)))
        found[kind] = next(power * digit for digit in (1, 2, 5, 10) if power * digit >= max(most, 1e-3))
    return found
