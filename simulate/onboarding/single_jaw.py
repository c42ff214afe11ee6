"""Hands with a single moving jaw: the other one is part of the link that carries it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from simulate.motion.collision import link_poses
from simulate.onboarding.closing import link_cloud, points_of
from simulate.robots.description import Floats, Joint, RobotDescription
from simulate.robots.jaw_shapes import is_coarse, shape_surface
from simulate.robots.mesh_cover import shape_points

__all__ = ["SingleJaw", "single_jaw"]

_MIN_STROKE_M = 0.008
_WIDEST_RAD = 0.8
"""Turn of a jaw from closed that counts as open; beyond it, its face looks away."""
_OFF_AXIS_M = 0.012
"""Distance of a jaw's middle from its axis below which it turns in place, as a wrist does."""
_ALONG, _MAX_ALONG = 0.4, 1.6
"""Shares of the jaw's length between which the fixed jaw lies beyond the hinge."""
_BESIDE_M = 0.04
"""Farthest that a point of the fixed jaw lies from the jaw's middle along the axis of the hinge."""
_CLOSE = 0.5
"""Largest share of its length that the jaw's tip is away from the fixed one when closed."""
_FEWEST = 3
_BETWEEN = 6
_LONG, _MAX_LEAN = 2.0, 0.9
"""Length over breadth from which a jaw tells where it points; how far that may be from the way
from the hinge to its middle, rad."""


@dataclass(frozen=True)
class SingleJaw:
    """A jaw that closes on one which stands still.

    Parameters
    ----------
    joint
        That moves it.
    closed, opened
        Values of the joint, rad or m.
    approach, closing
        Unit axes (3,) in the wrist frame; closing points from the fixed jaw to the other.
    fixed : (n, 3)
        Points of the fixed jaw, m, wrist frame.
    """

    joint: Joint
    closed: float
    opened: float
    approach: Floats
    closing: Floats
    fixed: Floats


def single_jaw(robot: RobotDescription, wrist: str, joint: Joint) -> SingleJaw | None:
    """Return the jaw that a joint moves against its parent link, or None if it moves none.

    Parameters
    ----------
    robot
        Without fixed joints.
    wrist
        Link that carries the jaw, and of which the fixed jaw is part.
    joint
        A joint on it.
    """
    palm, jaw = link_cloud(robot, wrist), link_cloud(robot, joint.child)
    if not (len(palm) and len(jaw)) or joint.parent != wrist:
        return None
    measure = _sliding if joint.kind == "prismatic" else _turning
    return measure(robot, wrist, joint, palm)


def _turning(robot: RobotDescription, wrist: str, joint: Joint, palm: Floats) -> SingleJaw | None:
    hinge = joint.pose.matrix
    axis = hinge[:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
    arms = palm - hinge[:3, 3]
    best: tuple[float, SingleJaw] | None = None
    for closed, other in ((joint.lower, joint.upper), (joint.upper, joint.lower)):
        opened = closed + float(np.clip(other - closed, -_WIDEST_RAD, _WIDEST_RAD))
        here = _jaw(robot, wrist, joint, closed) - hinge[:3, 3]
        there = _jaw(robot, wrist, joint, opened) - hinge[:3, 3]
        out = _middle(here)
        out = out - (out @ axis) * axis
        if np.linalg.norm(out) < _OFF_AXIS_M:
            continue
        approach = out / np.linalg.norm(out)
        if approach @ hinge[:3, 3] < -_OFF_AXIS_M:  # it folds back onto the arm
            continue
        closing = np.cross(axis, approach)
        closing = closing * np.sign((_middle(there) - _middle(here)) @ closing)
        length = float((here @ approach).max())
        fixed = _outer(arms, (approach, axis), out, length)
        if len(fixed) < _FEWEST:
            continue
        tip = here[here @ approach >= _ALONG * length]
        gap = float(np.median(tip @ closing) - np.median(fixed @ closing))
        if gap < -_CLOSE * length or gap > _CLOSE * length:
            continue
        jaws = _filled(robot, wrist), _filled(robot, joint.child, _pose_of(wrist, joint, closed))
        still, moving = (
            _outer(points - hinge[:3, 3], (approach, axis), out, length) for points in jaws
        )
        approach, closing = _between((still, moving), approach, closing)
        made = SingleJaw(joint, closed, opened, approach, closing, fixed + hinge[:3, 3])
        if best is None or abs(gap) < best[0]:
            best = (abs(gap), made)
    return best[1] if best is not None else None


def _sliding(robot: RobotDescription, wrist: str, joint: Joint, palm: Floats) -> SingleJaw | None:
    if joint.upper - joint.lower < _MIN_STROKE_M:
        return None
    axis = joint.pose.matrix[:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
    middle = _jaw(robot, wrist, joint, (joint.lower + joint.upper) / 2)
    out = _middle(middle) - _middle(palm)
    out = out - (out @ axis) * axis
    if np.linalg.norm(out) < 1e-3:
        return None
    approach = out / np.linalg.norm(out)
    across = np.cross(approach, axis)
    reach = float((middle @ approach).max())
    start = float((middle @ approach).min())
    level = float(np.median(middle @ across))
    is_level = (palm @ approach >= start + _ALONG * (reach - start)) & (
        np.abs(palm @ across - level) <= _BESIDE_M
    )
    fixed = palm[is_level]
    if len(fixed) < _FEWEST:
        return None
    away = np.sign(_middle(middle) @ axis - float(np.median(fixed @ axis)))
    if not away:
        return None
    closed, opened = (joint.lower, joint.upper) if away > 0 else (joint.upper, joint.lower)
    return SingleJaw(joint, closed, opened, approach, away * axis, fixed)


def _outer(points: Floats, axes: tuple[Floats, Floats], middle: Floats, length: float) -> Floats:
    """Return those points (n, 3) of a jaw, from the hinge, that lie beyond it.

    Parameters
    ----------
    axes
        Approach, and that of the hinge: unit (3,).
    middle : (3,)
        Of the moving jaw, m.
    length
        Of the moving jaw, m.
    """
    approach, axis = axes
    ahead, beside = points @ approach, np.abs((points - middle) @ axis)
    is_ahead = (ahead >= _ALONG * length) & (ahead <= _MAX_ALONG * length)
    return np.asarray(points[is_ahead & (beside <= _BESIDE_M)])


def _between(
    jaws: tuple[Floats, Floats], approach: Floats, closing: Floats
) -> tuple[Floats, Floats]:
    """Return approach and closing (3,) such that objects come in midway between two closed jaws.

    The way from the hinge to a jaw's middle is neither jaw's: on a hinge that lies aside of both it
    was 29 degrees off.

    Parameters
    ----------
    jaws : two of (n, 3)
        Points of the outer parts of the fixed and of the moving jaw, m.
    """
    leans = [_lean(points, approach, closing) for points in jaws]
    if None in leans:
        return approach, closing
    lean = float(np.mean([lean for lean in leans if lean is not None]))
    ahead = np.cos(lean) * approach + np.sin(lean) * closing
    return ahead, np.cos(lean) * closing - np.sin(lean) * approach


def _lean(points: Floats, approach: Floats, closing: Floats) -> float | None:
    """Return how a jaw points off the approach, rad, towards closing; None if it is not long.

    By the area of its outline in the plane of both, since vertices crowd where a mesh is fine.
    """
    try:
        hull = ConvexHull(np.stack([points @ approach, points @ closing], axis=1))
    except (QhullError, ValueError):
        return None
    outline = hull.points[hull.vertices]
    corners = np.stack([outline, np.roll(outline, -1, axis=0)])
    middle = outline.mean(axis=0)
    # Triangles about the middle: the integral of x x^T over each, by its corners and their sum.
    first, second = corners - middle
    areas = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    sums = first + second
    moments = sum(
        (areas[:, None, None] / 24 * (v[:, :, None] * v[:, None, :])).sum(axis=0)
        for v in (first, second, sums)
    )
    centre = (areas[:, None] * sums).sum(axis=0) / (3 * areas.sum())
    spread, ways = np.linalg.eigh(moments - areas.sum() / 2 * np.outer(centre, centre))
    lean = float(np.arctan(ways[1, 1] / ways[0, 1])) if ways[0, 1] else np.pi / 2
    is_long = spread[1] > _LONG**2 * max(float(spread[0]), 0.0)
    return lean if is_long and abs(lean) <= _MAX_LEAN else None


def _filled(robot: RobotDescription, link: str, wrist_from_link: Floats | None = None) -> Floats:
    """Return points (n, 3) m on the shapes of a link, also between the corners of a plain one.

    Of a bar that begins at the palm, corners alone would show the far end only; a convex part of a
    few triangles is such a bar, too.
    """
    clouds = [link_cloud(robot, link)]
    for shape in robot.link(link).shapes:
        if shape.kind == "mesh":
            if is_coarse(shape):
                clouds.append(shape_surface(shape))
        else:
            corners = shape_points(shape)
            shares = np.linspace(0.0, 1.0, _BETWEEN)[:, None, None]
            clouds.append((corners + shares * (corners[:, None] - corners)[:, None]).reshape(-1, 3))
    points, pose = np.concatenate(clouds), np.eye(4) if wrist_from_link is None else wrist_from_link
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _middle(points: Floats) -> Floats:
    """Return the middle (3,) of the extents of points (n, 3).

    Their mean would lie where a mesh is fine: a jaw of a few large triangles with the motor that
    turns it in its link seemed to turn in place.
    """
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


def _jaw(robot: RobotDescription, wrist: str, joint: Joint, value: float) -> Floats:
    """Return the points (n, 3) m of the jaw at a joint value, wrist frame."""
    return points_of(robot, joint.child, _pose_of(wrist, joint, value))


def _pose_of(wrist: str, joint: Joint, value: float) -> Floats:
    """Return wrist_from_link (4, 4) of what a joint moves, at a value, rad or m."""
    return link_poses(wrist, [joint], {joint.name: value})[joint.child]
