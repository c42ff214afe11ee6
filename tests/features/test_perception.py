"""Objects on a table in the frame of a robot's base."""

from __future__ import annotations

import numpy as np

from features.geometry import Frame, Intrinsics
from features.perception import perceive

CAMERA = Intrinsics.from_fov(640, 480, 1.2)
HEIGHT_M = 0.3
LEVEL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, HEIGHT_M], [0, 0, 0, 1]])


def test_one_upright_face_does_not_hide_the_other_objects() -> None:
    """A level camera sees the front of a block, exactly a plane, and a slanted roof beside it."""
    v, u = np.mgrid[:480, :640]
    x, y = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    depth = np.where(y > 0, HEIGHT_M / np.maximum(y, 1e-9), 0)
    depth[depth > 1.5] = 0
    standing = (depth == 0) | (depth > 0.6)
    face = (abs(0.6 * x) < 0.04) & (0.6 * y > HEIGHT_M - 0.1) & standing
    roof = 0.7 - 0.5 * (HEIGHT_M - 0.7 * y)
    on_roof = (abs(0.6 * x + 0.2) < 0.04) & (0.6 * y > HEIGHT_M - 0.1) & standing & (roof < depth)
    depth = np.select([face, on_roof], [0.6, roof], depth)
    seen = Frame(depth.astype(np.float32), CAMERA, np.full((480, 640, 3), 120, np.uint8))
    found = perceive(seen, LEVEL)
    assert found.status == "ok"
    assert [round(float(one.position[1]), 1) for one in found.objects] == [0.2]
