"""Pairs of fingertips that open and close: which two oppose each other, and at which joint values.

The finger joints are moved between their limits, together with those that follow them (mimic). The
pair whose tips come closest together and part farthest is the one that grasps.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simulate.motion.collision import link_poses
from simulate.robots.description import Floats, Joint, RobotDescription
from simulate.robots.mesh_cover import shape_points

__all__ = [
    "Closing",
    "best_pair",
    "finger_source",
    "followed",
    "link_cloud",
    "neutral",
    "points_of",
    "subtree",
]

_COUPLED = 6
"""Free joints of a hand whose limits are tried in all combinations."""
_MAX_IN_FINGER = 5
"""Free joints of one finger that are tried; those beyond stay at their middle."""
_LEVELS = (0.0, 0.5, 1.0)
_STEPS = 21
_NEARLY = 0.6
"""Share of the widest distance that fingers closing as one must fall below."""
_MIN_STROKE_M = 0.008
_OPPOSED = -0.8
"""Cosine of the angle between the motions of two tips that move against each other, at most."""
_TRIPLE = 0.75
"""Share of the longest finger that the third must have to count as its equal."""


@dataclass(frozen=True)
class Closing:
    """How two fingertips close.

    Parameters
    ----------
    tips
        The two links.
    joints
        Finger joints that the values are for, parents before children.
    closed, opened
        Value of each, rad or m.
    is_triple
        Whether the tips belong to three equal fingers that close about an axis: no pair of jaws.
    """

    tips: tuple[str, str]
    joints: tuple[Joint, ...]
    closed: Mapping[str, float]
    opened: Mapping[str, float]
    is_triple: bool = False


@dataclass(frozen=True)
class _Tip:
    """Outermost link of a branch: its joints, its reach from the palm (m), its middle (3,) m."""

    link: str
    joints: tuple[Joint, ...]
    reach: float
    middle: Floats


def subtree(below: Mapping[str, Sequence[Joint]], joint: Joint) -> Iterator[Joint]:
    """Yield a joint and all below it, parents first."""
    yield joint
    for child in below.get(joint.child, []):
        yield from subtree(below, child)


def neutral(joint: Joint) -> float:
    """Return the middle of a joint's range, rad or m."""
    return (joint.lower + joint.upper) / 2


def finger_source(joint: Joint, fingers: Sequence[Joint]) -> Joint | None:
    """Return the finger joint that a joint follows; None if it moves by itself."""
    if joint.mimic is None:
        return None
    return next((finger for finger in fingers if finger.name == joint.mimic[0]), None)


def followed(fingers: Sequence[Joint], chosen: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every finger joint, those that follow another included."""
    values = dict(chosen)
    for _ in fingers:  # a joint may follow one that follows in turn
        for joint in fingers:
            if joint.name not in chosen and joint.mimic is not None:
                source, factor = joint.mimic
                value = factor * values.get(source, 0.0) + joint.mimic_offset
                values[joint.name] = min(max(value, joint.lower), joint.upper)
    return values


def link_cloud(robot: RobotDescription, link: str) -> Floats:
    """Return points (n, 3) m on the shapes of a link, in its own frame."""
    parts = [shape_points(shape) for shape in robot.link(link).shapes]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def points_of(robot: RobotDescription, link: str, wrist_from_link: Floats) -> Floats:
    """Return points (n, 3) m on the shapes of a link, in the wrist frame."""
    points = link_cloud(robot, link)
    return np.asarray(points @ wrist_from_link[:3, :3].T + wrist_from_link[:3, 3])


def best_pair(
    robot: RobotDescription, wrist: str, branches: Sequence[Sequence[Joint]]
) -> Closing | None:
    """Return how the two best opposed fingers on a link close; None if none open and close.

    Parameters
    ----------
    robot
        Without fixed joints.
    wrist
        Link that carries the fingers.
    branches
        Joints of each finger, parents before children.
    """
    tips = [tip for branch in branches if (tip := _tip(robot, wrist, branch)) is not None]
    if len(tips) < 2:
        return None
    fingers = [joint for branch in branches for joint in branch]
    free = [joint for joint in fingers if finger_source(joint, fingers) is None]
    if not free:
        return None
    longest = max(tip.reach for tip in tips)
    rated = []
    motions = _Motions(wrist, fingers, tips, len(free) <= _COUPLED)
    for a, b in itertools.combinations(range(len(tips)), 2):
        near, wide, closed, opened = motions.ends(a, b)
        if wide - near >= _MIN_STROKE_M:
            share = min(tips[a].reach, tips[b].reach) / longest
            rated.append(((wide - 2 * near) * share, a, b, closed, opened))
    if not rated:
        return None
    _, a, b, closed, opened = max(rated, key=lambda row: row[0])
    used = (*tips[a].joints, *tips[b].joints)
    needed = {joint.name for joint in used}
    for joint in fingers[::-1]:  # a joint that drives another may be on a third branch
        if any(joint.name == (j.mimic or ("",))[0] for j in fingers if j.name in needed):
            needed.add(joint.name)
    for _ in fingers:  # and others may be geared to these, as in a linkage
        needed |= {joint.name for joint in fingers if (joint.mimic or ("",))[0] in needed}
    closed, opened = followed(fingers, closed), followed(fingers, opened)
    equal = [tip for tip in tips if tip.reach >= _TRIPLE * longest]
    return Closing(
        (tips[a].link, tips[b].link),
        tuple(joint for joint in fingers if joint.name in needed),
        closed,
        opened,
        len(equal) == 3 and _is_about_an_axis(wrist, fingers, equal, closed, opened),
    )


def _tip(robot: RobotDescription, wrist: str, branch: Sequence[Joint]) -> _Tip | None:
    """Return the link of a branch that reaches farthest; None if no link of it has a shape.

    From the branch's first joint: fingers that hang from a frame far above bend back towards it.
    """
    poses = link_poses(wrist, branch, {joint.name: neutral(joint) for joint in branch})
    start = poses[branch[0].child][:3, 3]
    shaped = {
        joint.child: points
        for joint in branch
        if len(points := points_of(robot, joint.child, poses[joint.child]))
    }
    if not shaped:
        return None
    link = max(shaped, key=lambda name: np.linalg.norm(shaped[name] - start, axis=1).max())
    reach = max(float(np.linalg.norm(points, axis=1).max()) for points in shaped.values())
    by_child = {joint.child: joint for joint in branch}
    path: list[Joint] = []
    while link != wrist and (not path or path[-1].parent != wrist):
        path.append(by_child[path[-1].parent if path else link])
    return _Tip(link, tuple(path[::-1]), reach, link_cloud(robot, link).mean(axis=0))


class _Motions:
    """Middles of the tips in the postures tried.

    Parameters
    ----------
    wrist, fingers, tips
        Of the hand.
    coupled
        Try all fingers together, because few joints move them; else each finger by itself.
    """

    def __init__(
        self, wrist: str, fingers: Sequence[Joint], tips: Sequence[_Tip], coupled: bool
    ) -> None:
        self._coupled = coupled
        self._wrist, self._fingers, self._tips = wrist, fingers, tips
        self._tables: list[tuple[list[dict[str, float]], Floats]] = []
        if coupled:
            free = [joint for joint in fingers if finger_source(joint, fingers) is None]
            postures = [
                followed(fingers, _at(free, levels))
                for levels in itertools.product((0.0, 1.0), repeat=len(free))
            ]
            middles = [_middles(wrist, fingers, tips, values) for values in postures]
            self._tables = [(postures, np.array([m[i] for m in middles])) for i in range(len(tips))]
            return
        for tip in tips:
            own = [joint for joint in tip.joints if finger_source(joint, tip.joints) is None]
            moved, still = own[-_MAX_IN_FINGER:], own[:-_MAX_IN_FINGER]
            middle = {joint.name: neutral(joint) for joint in still}
            postures = [
                followed(tip.joints, middle | _at(moved, levels))
                for levels in itertools.product(_LEVELS, repeat=len(moved))
            ]
            table = [_middles(wrist, tip.joints, [tip], values)[0] for values in postures]
            self._tables.append((postures, np.array(table)))

    def ends(self, a: int, b: int) -> tuple[float, float, dict[str, float], dict[str, float]]:
        """Return the least and the largest distance (m) of two tips, and the values there."""
        (first, here), (second, there) = self._tables[a], self._tables[b]
        if self._coupled:
            apart = np.linalg.norm(here - there, axis=1)
            i, j = int(np.argmin(apart)), int(np.argmax(apart))
            near, closed = self._together(a, b, first[j])
            if near > _NEARLY * float(apart[j]) and apart[i] < near:
                near, closed = float(apart[i]), first[i]
            return near, float(apart[j]), closed, first[j]
        apart = np.linalg.norm(here[:, None] - there[None], axis=2)
        i, j = divmod(int(np.argmin(apart)), len(there))
        k, m = divmod(int(np.argmax(apart)), len(there))
        return float(apart[i, j]), float(apart[k, m]), first[i] | second[j], first[k] | second[m]

    def _together(
        self, a: int, b: int, opened: Mapping[str, float]
    ) -> tuple[float, dict[str, float]]:
        """Return the least distance (m) of two tips while all joints close as one, and the values.

        Fingers that could swing past each other meet on the way, not at their limits.
        """
        free = [joint for joint in self._fingers if finger_source(joint, self._fingers) is None]
        tips = [self._tips[a], self._tips[b]]
        tried = []
        for share in np.linspace(0.0, 1.0, _STEPS):
            chosen = {
                joint.name: (1 - float(share)) * opened[joint.name]
                + float(share) * _other_end(joint, opened)
                for joint in free
            }
            values = followed(self._fingers, chosen)
            first, second = _middles(self._wrist, self._fingers, tips, values)
            tried.append((float(np.linalg.norm(first - second)), values))
        return min(tried, key=lambda row: row[0])


def _other_end(joint: Joint, values: Mapping[str, float]) -> float:
    return joint.lower if values[joint.name] == joint.upper else joint.upper


def _at(joints: Sequence[Joint], levels: Sequence[float]) -> dict[str, float]:
    return {
        joint.name: joint.lower + level * (joint.upper - joint.lower)
        for joint, level in zip(joints, levels, strict=True)
    }


def _middles(
    wrist: str, joints: Sequence[Joint], tips: Sequence[_Tip], values: Mapping[str, float]
) -> list[Floats]:
    poses = link_poses(wrist, joints, values)
    return [poses[tip.link][:3, :3] @ tip.middle + poses[tip.link][:3, 3] for tip in tips]


def _is_about_an_axis(
    wrist: str,
    fingers: Sequence[Joint],
    tips: Sequence[_Tip],
    closed: Mapping[str, float],
    opened: Mapping[str, float],
) -> bool:
    """Tell whether no two of three tips move against each other: they close about an axis."""
    ends = [
        followed(fingers, {j.name: neutral(j) for j in fingers if j.mimic is None} | dict(values))
        for values in (closed, opened)
    ]
    near, wide = (np.array(_middles(wrist, fingers, tips, values)) for values in ends)
    outwards = near.mean(axis=0)
    outwards = outwards / max(float(np.linalg.norm(outwards)), 1e-9)
    moved = wide - near
    moved = moved - (moved @ outwards)[:, None] * outwards
    lengths = np.linalg.norm(moved, axis=1)
    if lengths.min() < _MIN_STROKE_M / 4:  # one of them stands still
        return False
    ways = moved / lengths[:, None]
    return bool((ways @ ways.T).min() > _OPPOSED)
