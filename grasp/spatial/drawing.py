"""Drawings of grasps in space: the shape from above one side, grippers as forks around it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasp.push.drawing import Canvas
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.mesh import Mesh

__all__ = ["candidates_svg"]

FloatArray = NDArray[np.float64]

_TILT, _TURN = np.deg2rad(30.0), np.deg2rad(-35.0)
_MOST_FACES, _MOST_POINTS = 4000, 3000
_LIGHT = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])


def candidates_svg(
    candidates: Sequence[GraspCandidate],
    gripper: ParallelGripper,
    shape: Mesh | FloatArray,
    count: int = 12,
    title: str = "best grasps",
) -> str:
    """Return an SVG document of a shape with its best grasps, greener the more confident.

    Parameters
    ----------
    candidates
        Best first, in the frame of the shape; z is drawn upwards.
    shape
        A mesh, or points (n, 3), m.
    """
    drawn = list(candidates[:count])
    forks = [_fork(candidate, gripper) for candidate in drawn]
    body = shape.vertices if isinstance(shape, Mesh) else np.asarray(shape, dtype=np.float64)
    flat = _seen(np.vstack([body, *forks]) if len(body) else np.zeros((1, 3)))[:, :2]
    margin = 0.05 * float(np.ptp(flat, axis=0).max()) + 1e-6
    canvas = Canvas(flat.min(axis=0) - margin, flat.max(axis=0) + margin, title=title)
    if isinstance(shape, Mesh):
        _faces(canvas, shape)
    else:
        step = max(len(body) // _MOST_POINTS, 1)
        for point in _seen(body[::step])[:, :2]:
            canvas.dot(point, "#888", 1.2)
    for candidate, fork in list(zip(drawn, forks, strict=True))[::-1]:
        share = float(np.clip(candidate.scores.get("confidence", 0.0), 0.0, 1.0))
        colour = f"rgb({round(220 * (1 - share))},{round(50 + 110 * share)},60)"
        canvas.line(_seen(fork)[:, :2], colour, 2.0)
    return canvas.svg()


def _seen(points: FloatArray) -> FloatArray:
    """Return points (n, 3) as right, up and towards the eye."""
    c, s = np.cos(_TURN), np.sin(_TURN)
    x = c * points[:, 0] - s * points[:, 1]
    y = s * points[:, 0] + c * points[:, 1]
    up = y * np.sin(_TILT) + points[:, 2] * np.cos(_TILT)
    near = points[:, 2] * np.sin(_TILT) - y * np.cos(_TILT)
    return np.stack([x, up, near], axis=1)


def _fork(candidate: GraspCandidate, gripper: ParallelGripper) -> FloatArray:
    """Return the open gripper as one line (6, 3): tip, root, palm and back."""
    half = (candidate.opening or candidate.width) / 2
    tip, root = gripper.fingertip, gripper.fingertip - gripper.finger_length
    local = np.array(
        [(-half, 0, tip), (-half, 0, root), (0, 0, root), (0, 0, root - 0.02), (0, 0, root),
         (half, 0, root), (half, 0, tip)]
    )  # fmt: skip
    pose = candidate.frame_from_gripper
    return np.asarray(local @ pose[:3, :3].T + pose[:3, 3])


def _faces(canvas: Canvas, mesh: Mesh) -> None:
    """Draw the faces that look towards the eye, far ones first."""
    eye = np.linalg.inv(_seen(np.eye(3)).T)[:, 2]
    front = np.flatnonzero(mesh.normals @ eye > 0)
    if len(front) > _MOST_FACES:
        front = front[np.argsort(-mesh.areas[front], kind="stable")[:_MOST_FACES]]
    corners = _seen(mesh.vertices[mesh.faces[front]].reshape(-1, 3)).reshape(-1, 3, 3)
    for k in np.argsort(corners[:, :, 2].mean(axis=1)).tolist():
        tone = round(150 + 90 * max(float(mesh.normals[front[k]] @ _LIGHT), 0.0))
        grey = f"rgb({tone},{tone},{tone})"
        canvas.polygon(corners[k, :, :2], grey, grey, 0.6, 1.0)
