"""A view of a table with two printed boxes, computed by casting rays."""

from __future__ import annotations

import numpy as np

from features.geometry import Frame, Intrinsics, look_at

INTRINSICS = Intrinsics(320, 240, 300.0, 300.0, 159.5, 119.5)
BASE_FROM_CAMERA = look_at(np.array([0.0, 0.0, 0.62]), np.array([0.28, 0.0, 0.27]))
_TABLE = 0.27
# Middle of the footprint and sides, m.
_BOXES = (((0.27, 0.09), (0.05, 0.07, 0.08)), ((0.30, -0.09), (0.07, 0.05, 0.06)))


def view() -> Frame:
    """Return the view, optical frame of the camera."""
    rng = np.random.default_rng(3)
    v, u = np.mgrid[0 : INTRINSICS.height, 0 : INTRINSICS.width]
    camera = INTRINSICS
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    rays = np.stack([x, y, np.ones(u.shape)], axis=-1)
    eye, along = BASE_FROM_CAMERA[:3, 3], rays @ BASE_FROM_CAMERA[:3, :3].T
    depth = (_TABLE - eye[2]) / along[..., 2]
    rgb = np.full((*u.shape, 3), 150, np.uint8)
    for place, size in _BOXES:
        half = np.array(size) / 2
        middle = np.array([*place, _TABLE + half[2]])
        near, far = ((middle + sign * half - eye) / along for sign in (-1, 1))
        enters = np.minimum(near, far).max(axis=-1)
        hit = (enters < np.maximum(near, far).min(axis=-1)) & (enters < depth)
        print_ = rng.integers(0, 255, (24, 24, 24, 3), np.uint8)
        cell = ((eye + enters[..., None] * along - middle + half) / (2 * half) * 23.9).clip(0, 23)
        i, j, k = (cell[..., n].astype(int) for n in range(3))
        rgb[hit], depth[hit] = print_[i, j, k][hit], enters[hit]
    return Frame(depth.astype(np.float32), INTRINSICS, rgb=rgb, frame_id="camera_optical")


def urdf_of(*links: str, size: str = "0.05 0.07 0.08") -> str:
    """Return a model with a box, as large as the first of the view, in each of some links."""
    shape = f'<collision><geometry><box size="{size}"/></geometry></collision>'
    parts = "".join(f"<link name='{name}'>{shape}</link>" for name in links)
    return f"<robot name='r'>{parts}</robot>"
