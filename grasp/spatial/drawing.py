"""Drawings of grasps in space: a panel for each, the shape from above one side in the fingers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp.arrays import FloatArray
from grasp.push.figures.drawing import Canvas
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import EndEffector
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.three_finger.hand import ThreeFingerHand

__all__ = ["candidates_svg"]


_TILT, _TURN = np.deg2rad(30.0), np.deg2rad(-35.0)
_MAX_FACES, _MAX_POINTS = 1500, 2500
_LIGHT = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
_COLUMNS, _STEM_M = 3, 0.02
# Corners of a box's faces, counter-clockwise from outside; corner k has the bits of x, y, z.
_FACES = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1],
                   [4, 5, 7, 6]])  # fmt: skip

Shaded = list[tuple[FloatArray, str]]


def candidates_svg(
    candidates: Sequence[GraspCandidate],
    gripper: EndEffector,
    shape: Mesh | FloatArray,
    count: int = 6,
) -> str:
    """Return an SVG document with a panel for each of the best grasps, greener the more confident.

    Parameters
    ----------
    candidates
        Best first, in the frame of the shape; z is drawn upwards.
    shape
        A mesh, or points (n, 3), m.
    """
    drawn = list(candidates[:count])
    body = shape.vertices if isinstance(shape, Mesh) else np.asarray(shape, dtype=np.float64)
    whole = np.vstack([body, *(_fork(c, gripper) for c in drawn)])
    flat = _seen(whole if len(whole) else np.zeros((1, 3)))[:, :2]
    low, size = flat.min(axis=0), np.ptp(flat, axis=0)
    cell = 1.05 * size + 0.12 * float(size.max()) + 1e-6
    rows, columns = -(-max(len(drawn), 1) // _COLUMNS), min(_COLUMNS, max(len(drawn), 1))
    canvas = Canvas(low, low + cell * (columns, rows), 300 * columns + 48)
    painted = _faces(shape) if isinstance(shape, Mesh) else _dots(body)
    panels: list[GraspCandidate | None] = [*drawn] or [None]
    for k, candidate in enumerate(panels):
        corner = cell * (k % _COLUMNS, rows - 1 - k // _COLUMNS)
        _panel(canvas, corner, painted, candidate, gripper)
        caption = "no grasp" if candidate is None else _caption(k + 1, candidate)
        canvas.text(low + corner + (0.5 * size[0], size[1] + 0.06 * size.max()), caption, size=12)
    return canvas.svg()


def _caption(rank: int, candidate: GraspCandidate) -> str:
    sure = candidate.scores.get("confidence", 0.0)
    return f"{rank}: s_G {sure:.2f}, {1000 * candidate.width:.0f} mm"


def _panel(
    canvas: Canvas,
    corner: FloatArray,
    shape: Shaded,
    candidate: GraspCandidate | None,
    gripper: EndEffector,
) -> None:
    """Draw what of the gripper is behind the shape, the shape, then the rest of the gripper."""
    behind: Shaded = []
    ahead: Shaded = []
    if candidate is not None:
        middle = float(_seen(candidate.centre[None])[0, 2])
        for finger in _fingers(candidate, gripper):
            depth = float(np.mean([ring[:, 2].mean() for ring, _ in finger]))
            (behind if depth < middle else ahead).extend(finger)
        bar = _seen(_fork(candidate, gripper))
        (behind if bar[:, 2].mean() < middle else ahead).append((bar, _colour(candidate, 1.0)))
    for pieces in (behind, shape, ahead):
        for ring, colour in pieces:
            at = ring[:, :2] + corner
            if len(ring) == 1:
                canvas.dot(at, colour, 1.2)
            elif len(ring) > 4:
                canvas.line(at, colour, 2.5)
            else:
                canvas.polygon(at, colour, colour, 0.6)


def _colour(candidate: GraspCandidate, light: float) -> str:
    share = float(np.clip(candidate.scores.get("confidence", 0.0), 0.0, 1.0))
    red, green, blue = (light * v for v in (220 * (1 - share), 60 + 120 * share, 60))
    return f"rgb({round(red)},{round(green)},{round(blue)})"


def _seen(points: FloatArray) -> FloatArray:
    """Return points (n, 3) as right, up and towards the eye."""
    c, s = np.cos(_TURN), np.sin(_TURN)
    x = c * points[:, 0] - s * points[:, 1]
    y = s * points[:, 0] + c * points[:, 1]
    up = y * np.sin(_TILT) + points[:, 2] * np.cos(_TILT)
    near = points[:, 2] * np.sin(_TILT) - y * np.cos(_TILT)
    return np.stack([x, up, near], axis=1)


def _fork(candidate: GraspCandidate, gripper: EndEffector) -> FloatArray:
    """Return the bar between the fingers and the stem behind it as one line (5, 3)."""
    fingers = gripper.boxes(2 * _half(candidate))[:2]
    half, root = float(fingers[..., 0].max()), float(fingers[..., 2].min())
    local = np.array([(-half, 0, root), (0, 0, root), (0, 0, root - _STEM_M), (0, 0, root),
                      (half, 0, root)])  # fmt: skip
    pose = candidate.frame_from_gripper
    return np.asarray(local @ pose[:3, :3].T + pose[:3, 3])


def _half(candidate: GraspCandidate) -> float:
    return (candidate.width if candidate.opening is None else candidate.opening) / 2


def _fingers(candidate: GraspCandidate, gripper: EndEffector) -> list[Shaded]:
    """Return the faces towards the eye of the open fingers, far ones first."""
    pose, faces = candidate.frame_from_gripper, list[Shaded]()
    fingers = 3 if isinstance(gripper, ThreeFingerHand) else 2
    for low, high in gripper.boxes(2 * _half(candidate))[:fingers]:
        bits = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
        corners = _seen(np.where(bits, high, low) @ pose[:3, :3].T + pose[:3, 3])
        rings = [corners[face] for face in _FACES]
        turns = [np.cross(r[1] - r[0], r[2] - r[0]) for r in rings]
        facing = [(r, t[2] / np.linalg.norm(t)) for r, t in zip(rings, turns, strict=True)]
        shown = [(r, _colour(candidate, 0.6 + 0.4 * f)) for r, f in facing if f > 0]
        faces.append(sorted(shown, key=lambda entry: float(entry[0][:, 2].mean())))
    return faces


def _dots(points: FloatArray) -> Shaded:
    """Return points as they are seen, far ones first and lighter."""
    if len(points) == 0:
        return []
    shown = _seen(points[:: max(len(points) // _MAX_POINTS, 1)])
    order = np.argsort(shown[:, 2], kind="stable")
    far, near = shown[order[0], 2], shown[order[-1], 2]
    tones = np.round(175 - 110 * (shown[:, 2] - far) / max(near - far, 1e-9)).astype(int).tolist()
    return [(shown[k : k + 1], f"rgb({tones[k]},{tones[k]},{tones[k]})") for k in order.tolist()]


def _faces(mesh: Mesh) -> Shaded:
    """Return the faces that look towards the eye, far ones first; of a fine mesh, dots."""
    eye = np.linalg.inv(_seen(np.eye(3)).T)[:, 2]
    front = np.flatnonzero(mesh.normals @ eye > 0)
    if len(front) > _MAX_FACES:
        points, face = mesh.sample(2 * _MAX_POINTS, np.random.default_rng(0))
        return _dots(points[mesh.normals[face] @ eye > 0])
    corners = _seen(mesh.vertices[mesh.faces[front]].reshape(-1, 3)).reshape(-1, 3, 3)
    tones = 150 + 90 * np.maximum(mesh.normals[front] @ _LIGHT, 0.0)
    greys = [f"rgb({tone},{tone},{tone})" for tone in np.round(tones).astype(int).tolist()]
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable").tolist()
    return [(corners[k], greys[k]) for k in order]
