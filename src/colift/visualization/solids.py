"""Faces of simple solids in an orthographic projection: boxes, rods, discs, balls and arrows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.colors import to_rgb

from colift.visualization import scene
from colift.visualization.camera import Camera

LIGHT_DIRECTION = np.array([0.3, -0.4, 0.86])
PATCHES_PER_EDGE = 6
"""Patches along an edge of a box; the depth order is determined per patch."""
UNIT_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 24)), np.sin(np.linspace(0, 2 * np.pi, 24))], axis=-1)

Face = tuple[float, np.ndarray, tuple[float, ...]]
"""Depth towards the camera [m], projected corners ``(n, 2)`` [m], color."""


def box(camera: Camera, center: np.ndarray, R: np.ndarray, half: np.ndarray, color: str) -> Iterator[Face]:
    """Return the visible faces of a box in patches; faces towards the light are lighter."""
    for axis in range(3):
        sign = 1.0 if R[:, axis] @ camera.direction > 0 else -1.0
        normal = sign * R[:, axis]
        first, second = (half[(axis + n) % 3] * R[:, (axis + n) % 3] / PATCHES_PER_EDGE for n in (1, 2))
        light = 0.72 + 0.28 * max(0.0, float(normal @ LIGHT_DIRECTION))
        paint = tuple(light * c for c in to_rgb(color))
        for a, b in np.ndindex(PATCHES_PER_EDGE, PATCHES_PER_EDGE):
            middle = (
                center
                + half[axis] * normal
                + (2 * a + 1 - PATCHES_PER_EDGE) * first
                + (2 * b + 1 - PATCHES_PER_EDGE) * second
            )
            corners = np.array(
                [middle + first + second, middle + first - second, middle - first - second, middle - first + second]
            )
            yield float(middle @ camera.direction), camera.project(corners), paint


def rod(camera: Camera, start: np.ndarray, end: np.ndarray, radius: float, color: str) -> Face:
    """Return a rod as a rectangle in the image plane."""
    a, b = camera.project(start), camera.project(end)
    along = b - a
    side = radius * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    return (
        float((start + end) @ camera.direction / 2),
        np.array([a + side, b + side, b - side, a - side]),
        to_rgb(color),
    )


def disc(camera: Camera, center: np.ndarray, R: np.ndarray, radius: float, color: str) -> Face:
    """Return the disc of a rotor."""
    rim = center + radius * UNIT_CIRCLE @ R[:, :2].T
    return float(center @ camera.direction), camera.project(rim), (*to_rgb(color), 0.25)


def ball(camera: Camera, center: np.ndarray, radius: float, color: str) -> Face:
    """Return a ball as a circle in the image plane."""
    return float(center @ camera.direction) + radius, camera.project(center) + radius * UNIT_CIRCLE, to_rgb(color)


def arrow(
    camera: Camera, start: np.ndarray, along: np.ndarray, radius: float, color: str, on_top: bool = False
) -> Iterator[Face]:
    """Return shaft and head of an arrow; `on_top` draws it over all other faces."""
    length = float(np.linalg.norm(along))
    if length < scene.MIN_LINK_LENGTH:
        return
    head = min(7 * radius, length)
    head_start, tip = start + (1 - head / length) * along, start + along
    a, b = camera.project(head_start), camera.project(tip)
    side = 0.4 * head * np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.hypot(*(b - a))), 1e-9)
    depth, shaft, paint = rod(camera, start, head_start, radius, color)
    near = np.inf if on_top else depth + 2 * radius
    yield near, shaft, paint
    yield near, np.array([a + side, b, a - side]), paint
