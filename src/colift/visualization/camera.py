"""Orthographic cameras: direction of view and projection onto the image plane."""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """Direction of an orthographic projection, with an upright image plane.

    Attributes:
        direction: Unit vector towards the camera, world frame.
        right: Unit vector to the right in the image, horizontal in the world frame.
        up: Unit vector upwards in the image, world frame.
    """

    direction: np.ndarray
    right: np.ndarray
    up: np.ndarray

    @classmethod
    def from_direction(cls, direction: np.ndarray, azimuth: float | None = None) -> Camera:
        """Return the camera in a direction from the scene.

        Args:
            direction: Vector towards the camera, world frame.
            azimuth: Angle of its horizontal part from the x axis [rad]; default: as given by the vector.
        """
        direction = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
        if azimuth is None:
            right = np.cross([0.0, 0.0, 1.0], direction)
            right /= np.linalg.norm(right)
        else:
            right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        return cls(direction, right, np.cross(direction, right))

    @classmethod
    def from_angles(cls, azimuth_deg: float, elevation_deg: float) -> Camera:
        """Return the camera with an azimuth from the x axis and an elevation above the horizon [deg]."""
        azimuth, elevation = np.deg2rad([azimuth_deg, elevation_deg])
        horizontal = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        direction = np.cos(elevation) * horizontal + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
        return cls.from_direction(direction, azimuth)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project points of the world onto the image plane.

        Args:
            points: Points, world frame [m]; the last axis has three components.

        Returns:
            Coordinates to the right and up [m].
        """
        return np.stack([points @ self.right, points @ self.up], axis=-1)

    def on_plane(self, points: np.ndarray, height: float) -> np.ndarray:
        """Return the points of a horizontal plane that are projected to the same points of the image.

        Args:
            points: Points, world frame [m].
            height: Height of the plane, world frame [m].

        Raises:
            ValueError: If the plane is projected onto a line.
        """
        if abs(self.direction[2]) < MIN_SLOPE:
            raise ValueError("the direction of view is horizontal")
        return points - ((points[..., 2] - height) / self.direction[2])[..., None] * self.direction


MIN_SLOPE = 0.05
"""Sine of the elevation below which a horizontal plane is drawn as a line."""
OBLIQUE = Camera.from_direction(np.array([0.75, -1.5, 0.62]))
"""Camera of the playback page."""
VIEWS = {
    "oblique": OBLIQUE,
    "front": Camera.from_angles(0.0, 0.0),
    "side": Camera.from_angles(-90.0, 0.0),
    "top": Camera.from_angles(-90.0, 90.0),
}
"""Cameras by name; the front view looks along the negative x axis, the side view along the y axis."""


def parse_view(text: str) -> Camera:
    """Return the camera of a name in `VIEWS`, or of azimuth and elevation such as ``30,20`` [deg].

    Args:
        text: Name or two numbers.

    Returns:
        The camera.

    Raises:
        ValueError: If the text is neither, or if the elevation is not from -90 to 90.
    """
    if text in VIEWS:
        return VIEWS[text]
    try:
        azimuth, elevation = (float(each) for each in text.split(","))
    except ValueError:
        azimuth = elevation = np.nan
    if not (np.isfinite(azimuth) and abs(elevation) <= 90):
        raise ValueError(f"view {text}: must be {', '.join(VIEWS)}, or AZIMUTH,ELEVATION in degrees, such as 30,20")
    return Camera.from_angles(azimuth, elevation)
