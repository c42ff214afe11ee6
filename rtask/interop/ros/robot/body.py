"""The robot's own body in a view: its model (URDF) placed by TF, so that no part is an object.

What the model says to be fixed to the robot, such as the walls of its own bins, is body as well.
After ``robot_body_filter`` of ROS; here the body is taken out of what stands on the table only, so
that a table that is part of the model stays the table.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import JsonObject
from rtask.interop.ros.robot.model import checked_solid
from rtask.interop.ros.robot.surface import Surface, surface_of_text
from rtask.interop.ros.scene.shapes import Floats, Solid

__all__ = ["PADDING_M", "body_of_json", "body_pixels"]

PADDING_M = 0.01
"""How far from a surface of the body a point still belongs to it: joints, calibration and depth
are not exact."""


def body_of_json(shapes: Sequence[JsonObject]) -> list[Solid | Surface]:
    """Return the shapes of a request; poses are base_from_shape.

    One of the kind ``points`` is the surface of a mesh: float32 x, y and z in base64 in ``points``,
    and as its size how far the surface may be from the next of them, m.

    Raises
    ------
    UsageError
        One is none.
    """
    solids: list[Solid | Surface] = []
    for number, shape in enumerate(shapes):
        kind = str(shape.get("kind"))
        try:
            size = tuple(float(value) for value in shape["size"])
            pose = np.array(shape["pose"], dtype=np.float64).reshape(4, 4)
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(f"shape {number} of the body: {error!r}") from error
        what = f"shape {number} of the body"
        if kind == "points":
            placed = checked_solid("sphere", (1.0,), pose, what).pose
            if len(size) != 1:
                raise UsageError(f"{what}: a size of {len(size)} numbers; expected a radius")
            try:
                solids.append(surface_of_text(shape.get("points"), size[0], placed))
            except UsageError as error:
                raise UsageError(f"{what}: {error}") from error
        else:
            solids.append(checked_solid(kind, size, pose, what))
    return solids


def body_pixels(
    points: NDArray[np.floating], base_from_camera: Floats, body: Sequence[Solid | Surface]
) -> NDArray[np.bool_]:
    """Return which points of a view lie on or in the body.

    Parameters
    ----------
    points : (h, w, 3), m
        In the frame of the camera; NaN where nothing was measured.
    base_from_camera : (4, 4)
    body
        Shapes, posed in the base frame.

    Returns
    -------
    (h, w) bool
    """
    flat = points.reshape(-1, 3)
    on_body = np.zeros(len(flat), dtype=bool)
    used = np.flatnonzero(np.isfinite(flat).all(axis=1))
    if not len(used):
        return on_body.reshape(points.shape[:-1])
    low, high = flat[used].min(axis=0), flat[used].max(axis=0)
    for solid in body:
        shape_from_camera = np.linalg.inv(solid.pose) @ base_from_camera
        center, radius = solid.ball()
        camera_from_shape = np.linalg.inv(shape_from_camera)
        middle, reach = camera_from_shape[:3, :3] @ center + camera_from_shape[:3, 3], radius
        reach += PADDING_M
        if (middle + reach < low).any() or (middle - reach > high).any():
            continue
        near = used
        for axis in (2, 0, 1):  # most of a view is far from most shapes
            near = near[np.abs(flat[near, axis] - middle[axis]) <= reach]
        if len(near):
            seen = flat[near].astype(np.float64)
            local = seen @ shape_from_camera[:3, :3].T + shape_from_camera[:3, 3]
            on_body[near[_is_near(solid, local)]] = True
    return on_body.reshape(points.shape[:-1])


def _is_near(shape: Solid | Surface, local: Floats) -> NDArray[np.bool_]:
    """Return which points (n, 3), m, of the shape's own frame belong to it."""
    if isinstance(shape, Solid):
        return shape.distance(local) <= PADDING_M
    from scipy.spatial import cKDTree

    reach = PADDING_M + shape.radius
    apart, _ = cKDTree(shape.points).query(local, distance_upper_bound=reach)
    return np.asarray(np.isfinite(apart))
