"""Changes of waypoints that keep their path near the poses and within the thrust of the team.

One change is proposed for all faults of a path. The times and poses that it states are evaluated before.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.scenario import schema
from colift.trajectories import minimum_snap, pose_spline

MAX_OVERSHOOT = 0.2  # of the side of the box of the poses
MIN_OVERSHOOT = 0.01  # m
SAMPLES_PER_LEG = 33  # times in each leg
TABLE_SAMPLES = 4000  # times on a smoothing spline
MIN_TABLE_POSES = 20  # poses from which `kind: sampled` is proposed, and no more poses
MAX_SHOWN_LEGS = 6  # legs that a message lists
MAX_ADDED_POSES = 8  # poses that a message proposes to add
TRIED_INTERVALS = 25  # factors of a duration that a search evaluates
TRIED_COMBINATIONS = 4  # least durations that are combined with more poses
MAX_FACTOR = 100.0  # of a duration
MAX_TURN = 170.0  # deg, of a leg between added poses


@dataclasses.dataclass(frozen=True)
class Faults:
    """Faults of a path through waypoints.

    Attributes:
        t: Time of the largest fault [s].
        overshoot: Whether the path leaves the box of its poses.
        excess: Whether it exceeds the thrust.
        turning: Whether the rotation is the reason.
        maximum: Largest acceleration of the team [m/s^2].
        duration: Duration of the simulation [s].
    """

    t: float
    overshoot: bool
    excess: bool
    turning: bool
    maximum: float
    duration: float


Change = tuple[str, schema.Waypoints | None]
"""Sentence and changed waypoints; None for a table that was evaluated."""
Works = Callable[[schema.Waypoints], bool]
"""Evaluation of waypoints: true if they have no fault."""


def remedy(waypoints: schema.Waypoints, faults: Faults, works: Works) -> str:
    """Search a change that removes all faults.

    Args:
        waypoints: Waypoints.
        faults: Their faults.
        works: Evaluation of changed waypoints.

    Returns:
        The change, as a part of a sentence.
    """
    path = _Path(waypoints, faults)
    if faults.overshoot:
        changes = itertools.chain(
            path.longer_legs(), path.table(), path.more_poses(waypoints.poses), path.other_poses()
        )
    else:
        changes = itertools.chain(path.table(), path.longer_leg(), path.longer(), path.longer_legs())
    for sentence, changed in changes:
        if changed is None or works(changed):
            return sentence
    if faults.overshoot:
        return "use a table of the whole path with kind: sampled, because no change of times or few more poses suffices"
    return "give all legs more time (reference.poses: time_s)"


def remedy_with_turns(waypoints: schema.Waypoints, faults: Faults, works: Works) -> str:
    """Search poses that remove all faults and make every leg turn by the stated angles; empty if there are none."""
    poses = list(waypoints.poses)
    for k in reversed(range(len(poses) - 1)):
        pieces = turn_pieces(waypoints, k)
        shares = np.arange(1, pieces) / pieces
        poses[k + 1 : k + 1] = [_between(poses[k], poses[k + 1], share, shorter=False) for share in shares]
    changes = _Path(waypoints, faults).more_poses(tuple(poses))
    return next((sentence for sentence, changed in changes if changed is not None and works(changed)), "")


def turn_pieces(waypoints: schema.Waypoints, k: int) -> int:
    """Return the least number of legs that turn by the stated angles of leg k; 1 if they are those that are flown.

    A stated change of over 180 degrees is a fault if the angle about its axis covers a turn or more in all poses.
    """
    angles = np.array([pose.rpy_deg for pose in waypoints.poses])
    change = np.abs(angles[k + 1] - angles[k])[np.ptp(angles, axis=0) >= 360]
    return int(change.max() // MAX_TURN) + 1 if len(change) and change.max() > 180 else 1


def excess(p: np.ndarray, path: np.ndarray) -> float:
    """Return the largest overshoot of a path relative to the side of the box of the points."""
    side, low, high = np.ptp(p, axis=0), p.min(0), p.max(0)
    return float((np.maximum(low - path, path - high) / np.maximum(side, MIN_OVERSHOOT / MAX_OVERSHOOT)).max())


def rounded_up(x: float) -> str:
    """Format a number with two digits, not below it."""
    scale = 10.0 ** (np.floor(np.log10(x)) - 1)
    return f"{np.ceil(x / scale - 1e-9) * scale:.3g}"


class _Path:
    """Waypoints and the changes of them."""

    def __init__(self, waypoints: schema.Waypoints, faults: Faults) -> None:
        self.waypoints, self.faults = waypoints, faults
        self.times = np.array([pose.time_s for pose in waypoints.poses])
        self.p = np.array([pose.position_m for pose in waypoints.poses])
        self.T = np.diff(self.times)
        self.leg = int(np.clip(np.searchsorted(self.times, faults.t, side="right") - 1, 0, len(self.T) - 1))
        self.maximum = faults.maximum if faults.excess and not faults.turning else np.inf

    def longer_legs(self) -> Iterator[Change]:
        """Propose a least duration of all legs."""
        leasts = np.geomspace(self.T.min(), self.T.max(), TRIED_INTERVALS)[1:]
        equal = self.times[0] + self.T.max() * np.arange(len(self.times))
        if self.faults.excess and excess(self.p, _snap_path(equal, self.p, 0)) <= MAX_OVERSHOOT:
            leasts = np.append(leasts, self.T.max() * np.geomspace(1, MAX_FACTOR, TRIED_INTERVALS)[1:])
        for least in dict.fromkeys(map(rounded_up, leasts)):
            shorter = np.flatnonzero(float(least) > self.T)
            if len(shorter) == 0:
                continue
            longer = np.concatenate([[0.0], np.cumsum(np.maximum(self.T, float(least)))])
            sentence = f"give {_legs(shorter)} at least {least} s"
            yield from self._timed(sentence, self.times[0] + longer)

    def longer_leg(self) -> Iterator[Change]:
        """Propose a longer duration of the leg with the fault."""
        for factor in np.geomspace(1.1, MAX_FACTOR, TRIED_INTERVALS):
            duration = rounded_up(factor * self.T[self.leg])
            later = np.where(np.arange(len(self.times)) > self.leg, float(duration) - self.T[self.leg], 0.0)
            yield from self._timed(f"give leg {self.leg + 1} {duration} s", self.times + later)

    def longer(self) -> Iterator[Change]:
        """Propose a slower motion."""
        for factor in map(rounded_up, np.geomspace(1.1, MAX_FACTOR, TRIED_INTERVALS)):
            yield from self._timed(f"multiply all times by {factor}", float(factor) * self.times)

    def table(self) -> Iterator[Change]:
        """Propose a smoothing spline through the same poses."""
        if self.faults.turning or not (self.faults.overshoot or len(self.times) >= MIN_TABLE_POSES):
            return
        from colift.trajectories import smoothing_spline  # here, because SciPy's splines take long to import

        fit = smoothing_spline.fit_samples(self.times, self.p, np.broadcast_to(np.eye(3), (len(self.p), 3, 3)))
        at = jnp.linspace(self.times[0], self.times[-1], TABLE_SAMPLES)
        path, peak = np.asarray(_positions(smoothing_spline.pose_spline(fit.knots), at)), fit.choices[-1][1]
        if excess(self.p, path) > MAX_OVERSHOOT or peak >= self.maximum:
            return
        if self.faults.overshoot:
            yield "kind: sampled with these poses as a table stays near the box", None
        else:
            yield f"kind: sampled with these poses as a table keeps the start velocity and needs {peak:.3g} m/s²", None

    def more_poses(self, poses: tuple[schema.Pose, ...]) -> Iterator[Change]:
        """Propose poses in the middle of the legs about the largest overshoot, in addition to `poses`."""
        if len(poses) >= MIN_TABLE_POSES:
            return
        while len(poses) <= len(self.waypoints.poses) + MAX_ADDED_POSES:
            new = [pose for pose in poses if pose not in self.waypoints.poses]
            if new and self._near(poses):
                listed = _joined([_yaml(pose) for pose in new])
                sentence = f"add the pose{'s' * (len(new) > 1)} {listed} (reference.poses)"
                yield sentence, schema.Waypoints(kind="waypoints", poses=poses)
            poses = _with_middle(poses)

    def other_poses(self) -> Iterator[Change]:
        """Propose longer legs together with more poses."""
        for least in np.geomspace(self.T.max(), self.T.min(), TRIED_COMBINATIONS):
            longer = np.concatenate([[0.0], np.cumsum(np.maximum(self.T, least))])
            slow = schema.Waypoints(kind="waypoints", poses=self._at(self.times[0] + longer))
            for _, changed in _Path(slow, self.faults).more_poses(slow.poses):
                if changed is not None:
                    listed = _joined([_yaml(pose) for pose in changed.poses])
                    end = self._longer_simulation(changed.poses[-1].time_s)
                    yield f"replace the poses by {listed} (reference.poses{end})", changed

    def _at(self, times: np.ndarray) -> tuple[schema.Pose, ...]:
        """Return the poses at other times."""
        return tuple(
            pose.model_copy(update={"time_s": float(f"{t:.6g}")})
            for pose, t in zip(self.waypoints.poses, times, strict=True)
        )

    def _longer_simulation(self, end: float) -> str:
        """Return the duration of the simulation for a path that ends later."""
        late = end > max(self.faults.duration, self.times[-1])
        return f"; duration_s: {end:g} for the whole path" if late else ""

    def _near(self, poses: Sequence[schema.Pose]) -> bool:
        """Return whether the path through poses stays near them and within the acceleration."""
        times, p = _arrays(poses)
        near = excess(self.p, _snap_path(times, p, 0)) <= MAX_OVERSHOOT
        return near and bool(np.linalg.norm(_snap_path(times, p, 2), axis=1).max() < self.maximum)

    def _timed(self, sentence: str, times: np.ndarray) -> Iterator[Change]:
        """Propose other times, if the path stays near the poses and within the acceleration."""
        poses = self._at(times)
        times = np.array([pose.time_s for pose in poses])
        if (np.diff(times) < self.T - 1e-4).any() or not self._near(poses):
            return
        stated = f"time_s {', '.join(f'{t:g}' for t in times)}" if len(times) <= MAX_SHOWN_LEGS + 1 else "time_s"
        changed = schema.Waypoints(kind="waypoints", poses=poses)
        yield f"{sentence} (reference.poses: {stated}{self._longer_simulation(times[-1])})", changed


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _positions(path: pose_spline.PoseSpline, t: Array) -> Array:
    return path.evaluate(t).p


def _with_middle(poses: tuple[schema.Pose, ...]) -> tuple[schema.Pose, ...]:
    """Add the pose in the middle of a leg that reduces the overshoot most, next to the largest overshoot."""
    times, p = _arrays(poses)
    path = _snap_path(times, p, 0).reshape(len(times) - 1, -1, 3)
    worst = int(np.argmax([excess(p, leg) for leg in path]))
    tried = []
    for k in range(max(worst - 1, 0), min(worst + 2, len(path))):
        middle = _between(poses[k], poses[k + 1], 0.5, shorter=True)
        changed = (*poses[: k + 1], middle, *poses[k + 1 :])
        tried.append((excess(p, _snap_path(*_arrays(changed), 0)), k, changed))
    return min(tried)[2]


def _between(a: schema.Pose, b: schema.Pose, share: float, *, shorter: bool) -> schema.Pose:
    """Return a pose between two others, turned by the shorter way or by the stated angles."""
    turn = np.array(b.rpy_deg) - a.rpy_deg
    turn = (turn + 180) % 360 - 180 if shorter else turn
    position = a.position_m + share * np.subtract(b.position_m, a.position_m)
    rpy = a.rpy_deg + share * turn
    return schema.Pose.model_validate(
        {
            "time_s": float(f"{a.time_s + share * (b.time_s - a.time_s):.9g}"),
            "position_m": [float(f"{x:.4g}") for x in position],
            "rpy_deg": [float(f"{x:.4g}") for x in rpy],
        }
    )


def _arrays(poses: Sequence[schema.Pose]) -> tuple[np.ndarray, np.ndarray]:
    """Return times and positions."""
    return np.array([pose.time_s for pose in poses]), np.array([pose.position_m for pose in poses])


def _snap_path(times: np.ndarray, p: np.ndarray, order: int) -> np.ndarray:
    """Evaluate a derivative of the minimum-snap path in every leg."""
    c, T = minimum_snap.minimum_snap_coefficients(times, p), np.diff(times)
    c = np.moveaxis(np.polynomial.polynomial.polyder(np.moveaxis(c, 1, 0), order), 0, 1)
    powers = (T[:, None] * np.linspace(0, 1, SAMPLES_PER_LEG))[:, :, None] ** np.arange(c.shape[1])
    return (powers @ c).reshape(-1, 3)


def _yaml(pose: schema.Pose) -> str:
    """Format a pose as in a scenario."""
    position, angles = (", ".join(f"{x:g}" for x in values) for values in (pose.position_m, pose.rpy_deg))
    turned = f", rpy_deg: [{angles}]" if any(pose.rpy_deg) else ""
    return f"{{time_s: {pose.time_s:g}, position_m: [{position}]{turned}}}"


def _legs(numbers: np.ndarray) -> str:
    shown = [str(k + 1) for k in numbers[:MAX_SHOWN_LEGS]]
    if len(numbers) > MAX_SHOWN_LEGS:
        return f"legs {', '.join(shown)} and {len(numbers) - MAX_SHOWN_LEGS} more"
    return f"leg{'s' * (len(shown) > 1)} {_joined(shown)}"


def _joined(parts: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
