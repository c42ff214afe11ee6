"""Checks of a robot that was read: sizes, limits and followers that cannot be meant as written.

They look at numbers alone and take no time, so that a wrong unit is named before any search begins.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rtask.errors import RobotError
from simulate.robots.description import Joint, Link, Shape
from simulate.robots.mass import estimated_inertial
from simulate.robots.mesh_cover import mesh_box

__all__ = [
    "Oversized",
    "doubtful_limits",
    "doubtful_masses",
    "doubtful_motions",
    "doubtful_places",
    "doubtful_turns",
    "lost_sources",
    "oversized",
    "with_scale",
]

_TURNS_RAD = 4 * math.pi
"""Beyond two turns to either side, a limit is rather one in degrees."""
_ENDLESS_RAD = 1000.0
"""Beyond that, writers mean that there is no limit."""
_TURNED_RAD = 2 * math.pi + 0.01
_TIMES_WATER, _HEAVY_KG = 100.0, 1.0
"""The densest metal is 23 times as heavy as water; simplified shapes are smaller than the links."""
_FASTEST_RAD_S, _ENDLESS_RAD_S = 60.0, (100.0, 1000.0)
"""Legs turn at 52 rad/s, arms slower; from 100 on, whole powers of ten mean that nobody knows."""
_LONGEST_SLIDE_M = 10.0
_TIMES_AWAY, _TIMES_SIZE = 2.0, 3.0
"""So many times the reach from its joint, a shape or a centre of mass is in another unit, and so
many times as large a moving link: in centimetres."""
_TIMES_REACH = 20.0
_LARGE_M = 1.0
_LONGEST_M = 30.0
"""Span of the joints of a robot, m: beyond that they are hardly in metres."""


@dataclass(frozen=True)
class Oversized:
    """A link whose shape is far larger than the robot.

    Parameters
    ----------
    link
        Its name.
    size_m, reach_m
        Longest side of the shape, and the span of the robot's joints.
    """

    link: str
    size_m: float
    reach_m: float

    def __str__(self) -> str:
        return (
            f"link {self.link!r} is {self.size_m:.3g} m large on a robot that spans "
            f"{self.reach_m:.2g} m: millimetres? --scale 0.001 reads such shapes so"
        )


def doubtful_limits(joints: Iterable[Joint]) -> Iterator[str]:
    """Yield a sentence for each turning joint whose limits look like degrees.

    Examples
    --------
    >>> from simulate.robots.description import Pose
    >>> elbow = Joint("elbow", "a", "b", Pose(), kind="revolute", lower=-143, upper=143)
    >>> [says] = doubtful_limits([elbow])
    >>> says.partition(";")[0]
    "joint 'elbow' turns from -143 to 143 rad: degrees?"
    """
    for joint in joints:
        farthest = max(abs(joint.lower), abs(joint.upper))
        if joint.kind == "revolute" and _TURNS_RAD < farthest <= _ENDLESS_RAD:
            lower, upper = math.radians(joint.lower), math.radians(joint.upper)
            yield (
                f"joint {joint.name!r} turns from {joint.lower:g} to {joint.upper:g} rad: "
                f"degrees?; taken as it stands (in rad, these would be {lower:.3g} and {upper:.3g})"
            )


def doubtful_turns(joints: Iterable[Joint]) -> Iterator[str]:
    """Yield a sentence for each joint whose origin is turned as if by degrees."""
    for joint in joints:
        if max(map(abs, joint.pose.rpy)) > _TURNED_RAD:
            shown = " ".join(f"{angle:g}" for angle in joint.pose.rpy)
            yield f"joint {joint.name!r} has the rpy {shown} rad: degrees?; taken as it stands"


def doubtful_motions(joints: Sequence[Joint]) -> Iterator[str]:
    """Yield a sentence for each joint that cannot move, or is said to move as no joint does."""
    by_name = {joint.name: joint for joint in joints}
    for joint in joints:
        if joint.kind == "fixed":
            continue
        where = f"joint {joint.name!r}"
        if joint.lower == joint.upper:
            yield f"{where} has the limits {joint.lower:g} .. {joint.upper:g}: it cannot move"
        elif joint.kind == "prismatic" and joint.upper - joint.lower > _LONGEST_SLIDE_M:
            yield (
                f"{where} slides from {joint.lower:g} to {joint.upper:g} m: millimetres?; taken as "
                "it stands"
            )
        is_usual = _FASTEST_RAD_S < joint.velocity < max(_ENDLESS_RAD_S)
        if joint.kind == "revolute" and is_usual and joint.velocity not in _ENDLESS_RAD_S:
            yield (
                f"{where} turns at {joint.velocity:g} rad/s: degrees? (that would be "
                f"{math.radians(joint.velocity):.3g}); taken as it stands"
            )
        if joint.mimic is not None:
            yield from _doubtful_following(joint, by_name.get(joint.mimic[0]))


def _doubtful_following(joint: Joint, source: Joint | None) -> Iterator[str]:
    assert joint.mimic is not None
    where, factor = f"joint {joint.name!r}", joint.mimic[1]
    if factor == 0:
        yield f"{where} follows {joint.mimic[0]!r} by a multiplier of 0: it stands still"
    if joint.kind == "revolute" and abs(joint.mimic_offset) > _TURNED_RAD:
        yield f"{where} follows with an offset of {joint.mimic_offset:g} rad: degrees?"
    span = joint.upper - joint.lower
    if source is not None and 0 < _TIMES_REACH * span < abs(factor) * (source.upper - source.lower):
        yield (
            f"{where} follows {source.name!r} by a multiplier of {factor:g}, which leads far out "
            f"of its limits {joint.lower:g} .. {joint.upper:g}: another unit?"
        )


def doubtful_places(links: Iterable[Link], joints: Sequence[Joint]) -> Iterator[str]:
    """Yield a sentence for each link whose shape or mass lies as if in another unit."""
    links = list(links)
    reach = _reach(links, joints)
    if reach <= 0:
        return
    far = max(_TIMES_AWAY * reach, _LARGE_M)
    moved = {joint.child for joint in joints if joint.kind != "fixed"}
    for link in links:
        away = max((float(np.linalg.norm(shape.pose.xyz)) for shape in link.shapes), default=0.0)
        if away > far:
            yield (
                f"link {link.name!r} has its shape {away:.3g} m beside it, on a robot that spans "
                f"{reach:.2g} m: another unit?; taken as it stands"
            )
        off = float(np.linalg.norm(link.inertial.centre))
        if link.inertial.mass > 0 and off > far:
            yield (
                f"link {link.name!r} has its centre of mass {off:.3g} m beside it, on a robot that "
                f"spans {reach:.2g} m: another unit?; taken as it stands"
            )
        if any(max(map(abs, shape.pose.rpy)) > _TURNED_RAD for shape in link.shapes):
            yield f"link {link.name!r} has a shape turned by more than a turn: degrees?"
        size = max((_longest_side(shape) for shape in link.shapes), default=0.0)
        if link.name in moved and max(_TIMES_SIZE * reach, _LARGE_M) < size <= max(
            _TIMES_REACH * reach, _LARGE_M
        ):
            yield (
                f"link {link.name!r} is {size:.3g} m large on a robot that spans {reach:.2g} m: "
                "centimetres?; taken as it stands"
            )


def doubtful_masses(links: Iterable[Link]) -> Iterator[str]:
    """Yield a sentence for each link that weighs far more than any metal of its shape."""
    for link in links:
        if link.inertial.mass < _HEAVY_KG or not link.shapes:
            continue
        try:
            water = estimated_inertial(link.shapes).mass
        except RobotError:  # a mesh that cannot be read is named elsewhere
            continue
        if link.inertial.mass > _TIMES_WATER * water:
            yield (
                f"link {link.name!r} weighs {link.inertial.mass:g} kg, {water:.2g} kg if its shape "
                "were of water: grams?; taken as it stands"
            )


def lost_sources(joints: Sequence[Joint]) -> dict[str, str]:
    """Return why joints cannot follow the one that they mimic, by name of the joint."""
    by_name = {joint.name: joint for joint in joints}
    reasons: dict[str, str] = {}
    for joint in joints:
        if joint.mimic is None or joint.kind == "fixed":
            continue
        source = by_name.get(joint.mimic[0])
        if source is None:
            reasons[joint.name] = f"follows {joint.mimic[0]!r}, which is no joint of the file"
        elif source.kind == "fixed":
            reasons[joint.name] = f"follows {source.name!r}, which does not move"
        elif _is_ring(joint, by_name):
            reasons[joint.name] = f"follows {source.name!r}, which follows it in turn"
    return reasons


def _is_ring(joint: Joint, by_name: Mapping[str, Joint]) -> bool:
    seen: set[str] = set()
    at: Joint | None = joint
    while at is not None and at.mimic is not None:
        if at.name in seen:
            return True
        seen.add(at.name)
        at = by_name.get(at.mimic[0])
    return False


def oversized(links: Iterable[Link], joints: Sequence[Joint]) -> list[Oversized]:
    """Return the moving links that are at least 20 times as large as the span of all joints.

    Raises
    ------
    RobotError
        The joints themselves span more than any robot.
    """
    links = list(links)
    reach = _reach(links, joints)
    if reach > _LONGEST_M:
        raise RobotError(
            f"the joints span {reach:.3g} m: a URDF states lengths in m; are these millimetres?"
        )
    if reach <= 0:
        return []
    moved = {joint.child for joint in joints if joint.kind != "fixed"}
    for joint in joints:  # parents come first
        if joint.parent in moved:
            moved.add(joint.child)
    limit = max(_TIMES_REACH * reach, _LARGE_M)
    sizes = [
        (link.name, max((_longest_side(shape) for shape in link.shapes), default=0.0))
        for link in links
        if link.name in moved
    ]
    return [Oversized(name, size, reach) for name, size in sizes if size > limit]


def with_scale(links: Sequence[Link], joints: Sequence[Joint], scale: float) -> tuple[Link, ...]:
    """Return the links with every shape multiplied that is far larger than the robot.

    Raises
    ------
    RobotError
        ``scale`` is not a positive number, or no shape is so large.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise RobotError(f"a scale is a positive number, got {scale:g}")
    if not oversized(links, joints):
        raise RobotError("--scale is for shapes far larger than the robot; there are none")
    limit = max(_TIMES_REACH * _reach(links, joints), _LARGE_M)

    def scaled(shape: Shape) -> Shape:
        if _longest_side(shape) <= limit:
            return shape
        return replace(shape, size=tuple(scale * side for side in shape.size))

    return tuple(replace(link, shapes=tuple(map(scaled, link.shapes))) for link in links)


def _reach(links: Iterable[Link], joints: Sequence[Joint]) -> float:
    """Return the length of the longest chain, m: offsets of its joints and ways of sliding ones.

    The ways by which a base drives or floats, joints before the first link with a shape, are no
    lengths of the robot.
    """
    shaped = {link.name for link in links if link.shapes}
    spans: dict[str, float] = {}
    solid: set[str] = set()
    for joint in joints:  # parents come first
        if joint.parent in shaped or joint.parent in solid:
            solid.add(joint.child)
        step = float(np.linalg.norm(joint.pose.xyz))
        if joint.kind == "prismatic" and joint.child in solid:
            step += joint.upper - joint.lower
        spans[joint.child] = spans.get(joint.parent, 0.0) + step
    return max(spans.values(), default=0.0)


def _longest_side(shape: Shape) -> float:
    if shape.kind == "mesh":
        try:
            low, high = mesh_box(shape.path, shape.size)
        except RobotError:
            return 0.0
        return float((high - low).max())
    if shape.kind == "box":
        return max(shape.size)
    radius = 2 * shape.size[0]
    return max(radius, shape.size[1]) if shape.kind == "cylinder" else radius
