"""Checks of a robot that was read: sizes, limits and followers that cannot be meant as written.

They look at numbers alone and take no time, so that a wrong unit is named before any search begins.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rtask.errors import RobotError
from simulate.robots.description import Floats, Joint, Link, Shape
from simulate.robots.mass import estimated_inertial
from simulate.robots.mesh_cover import mesh_box, shape_corners

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
_TIMES_GYRATION, _LEAST_GYRATION = 20.0, 0.003
"""Radius of gyration of a link over its longest side. Of a solid it is about a third; a tenth of a
link's side is seen at motors, a thousandth is another unit (g mm2), as is thirty times (kg cm2)."""
_WIDEST_M = 2.0
_TIMES_OUTSIDE = 3.0
"""So many sides away from its own shape, a centre of mass is another link's, or in another unit."""
_TINY_M = 1e-3
"""Longest side of a link that is a speck: metres read as millimetres."""
_FLAT_M = 1e-6
_TIMES_OTHERS = 5.0
"""So many times as long as all others of its chain, an origin is in another unit."""
_STRONGEST, _WEAKEST, _SLOWEST = 5000.0, 1e-3, 1e-3
"""N m or N, and rad/s or m/s: the joints of robots that weigh tons stay below the first."""
_LEAST_SHARED = 0.05
"""Share of its way that a follower has within its own limits, at least."""
_FASTEST_RAD_S, _ENDLESS_RAD_S = 60.0, (100.0, 1000.0)
"""Legs turn at 52 rad/s, arms slower; from 100 on, whole powers of ten mean that nobody knows."""
_LONGEST_SLIDE_M = 10.0
_TIMES_AWAY, _TIMES_SIZE = 2.0, 1.5
"""So many times the reach from its joint, a shape or a centre of mass is in another unit, and so
many times as large a moving link: in centimetres or inches."""
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
        # Whole numbers beyond one turn are degrees: 7.85 rad are written with their fractions.
        is_whole = joint.lower == round(joint.lower) and joint.upper == round(joint.upper)
        doubtful = _TURNED_RAD if is_whole else _TURNS_RAD
        if joint.kind == "revolute" and doubtful < farthest <= _ENDLESS_RAD:
            lower, upper = math.radians(joint.lower), math.radians(joint.upper)
            yield (
                f"joint {joint.name!r} turns from {joint.lower:g} to {joint.upper:g} rad: "
                f"degrees?; taken as it stands (in rad, these would be {lower:.3g} and {upper:.3g})"
            )


def doubtful_turns(joints: Iterable[Joint]) -> Iterator[str]:
    """Yield a sentence for each joint whose origin is turned as if by degrees."""
    for joint in joints:
        if any(_is_turned_by_degrees(angle) for angle in joint.pose.rpy):
            shown = " ".join(f"{angle:g}" for angle in joint.pose.rpy)
            yield f"joint {joint.name!r} has the rpy {shown} rad: degrees?; taken as it stands"


def _is_turned_by_degrees(angle: float) -> bool:
    """Tell whether an angle of an origin is beyond a turn, or whole and beyond half a turn."""
    return abs(angle) > _TURNED_RAD or (abs(angle) > math.pi and angle == round(angle))


def doubtful_motions(joints: Sequence[Joint]) -> Iterator[str]:
    """Yield a sentence for each joint that cannot move, or is said to move as no joint does."""
    by_name = {joint.name: joint for joint in joints}
    strong = [joint for joint in joints if joint.kind != "fixed" and joint.effort > _STRONGEST]
    if strong:
        others = f" (and {len(strong) - 1} more)" if len(strong) > 1 else ""
        yield (
            f"joint {strong[0].name!r}{others} has an effort of {strong[0].effort:g} "
            f"{'N m' if strong[0].kind == 'revolute' else 'N'}: thousandths?; taken as it stands"
        )
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
        yield from _doubtful_strength(joint)
        if joint.mimic is not None:
            yield from _doubtful_following(joint, by_name.get(joint.mimic[0]))


def _doubtful_strength(joint: Joint) -> Iterator[str]:
    where, turns = f"joint {joint.name!r}", joint.kind == "revolute"
    unit = "N m" if turns else "N"
    if 0 < joint.effort < _WEAKEST:
        yield f"{where} has an effort of {joint.effort:g} {unit}, which moves nothing"
    if 0 < joint.velocity < _SLOWEST:
        speed = f"{joint.velocity:g} {'rad/s' if turns else 'm/s'}"
        yield f"{where} moves at {speed}, and so takes many minutes for its range"


def _doubtful_following(joint: Joint, source: Joint | None) -> Iterator[str]:
    assert joint.mimic is not None
    where, factor = f"joint {joint.name!r}", joint.mimic[1]
    if factor == 0:
        yield f"{where} follows {joint.mimic[0]!r} by a multiplier of 0: it stands still"
    if joint.kind == "revolute" and abs(joint.mimic_offset) > _TURNED_RAD:
        yield f"{where} follows with an offset of {joint.mimic_offset:g} rad: degrees?"
        return
    span = joint.upper - joint.lower
    if source is None or factor == 0 or span <= 0:
        return
    ends = sorted(factor * end + joint.mimic_offset for end in (source.lower, source.upper))
    shared = min(ends[1], joint.upper) - max(ends[0], joint.lower)
    if shared <= _LEAST_SHARED * min(ends[1] - ends[0], span):
        yield (
            f"{where} follows {source.name!r} from {ends[0]:.3g} to {ends[1]:.3g}, outside of its "
            f"limits {joint.lower:g} .. {joint.upper:g}: another sign of multiplier or offset?"
        )
    elif _TIMES_REACH * span < abs(factor) * (source.upper - source.lower):
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
    moved: set[str] = set()
    for joint in joints:  # parents come first
        if joint.kind != "fixed" or joint.parent in moved:
            moved.add(joint.child)
    yield from _doubtful_offsets(joints)
    for link in links:
        yield from _doubtful_place(link, far, reach)
        if any(max(map(abs, shape.pose.rpy)) > _TURNED_RAD for shape in link.shapes):
            yield f"link {link.name!r} has a shape turned by more than a turn: degrees?"
        yield from _doubtful_size(link, reach, link.name in moved)


def _doubtful_place(link: Link, far: float, reach: float) -> Iterator[str]:
    box = _box_of(link)
    away = 0.0 if box is None else float(np.linalg.norm(np.clip(0.0, *box)))
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


def _doubtful_size(link: Link, reach: float, moves: bool) -> Iterator[str]:
    sides = [_sides(shape) for shape in link.shapes]
    size = max((longest for _, longest in sides), default=0.0)
    limit = max(_TIMES_REACH * reach, _LARGE_M)
    if moves and max(_TIMES_SIZE * reach, _LARGE_M) < size <= limit:
        yield (
            f"link {link.name!r} is {size:.3g} m large on a robot that spans {reach:.2g} m: "
            "centimetres or inches?; taken as it stands"
        )
    # A floor is wide and flat; what is large every way holds the robot inside.
    thickness = max((shortest for shortest, _ in sides), default=0.0)
    if not moves and thickness > limit:
        yield (
            f"link {link.name!r}, which does not move, is {size:.3g} m large on a robot that spans "
            f"{reach:.2g} m: millimetres?; taken as it stands"
        )
    if moves and size > 0 and thickness <= _FLAT_M:
        yield f"link {link.name!r} has a shape without thickness; taken as it stands"
    if moves and 0 < size < _TINY_M:
        yield (
            f"link {link.name!r} is {1000 * size:.2g} mm large on a robot that spans {reach:.2g} "
            "m: a scale too much?; taken as it stands"
        )


def _doubtful_offsets(joints: Sequence[Joint]) -> Iterator[str]:
    """Yield a sentence for each joint that lies, or slides, far beyond the rest of its chain."""
    by_child = {joint.child: joint for joint in joints}
    steps = {j.child: float(np.linalg.norm(j.pose.xyz)) for j in joints}
    for joint in joints:
        chain = list(_chain_to(joint, by_child))
        moving = sum(j.kind != "fixed" for j in chain)
        others = sum(steps[j.child] for j in chain)
        below = max((steps[j.child] for j in joints if j.parent == joint.child), default=0.0)
        rest = max(others + below, _LARGE_M / _TIMES_OTHERS)
        if moving and steps[joint.child] > _TIMES_OTHERS * rest:
            yield (
                f"joint {joint.name!r} lies {steps[joint.child]:.3g} m from its parent, all others "
                f"of its chain {others:.2g} m together: another unit?; taken as it stands"
            )
        slides = joint.upper - joint.lower if joint.kind == "prismatic" else 0.0
        # Slides of a base or a gantry come first, and are as long as a room.
        if moving > 1 and _LARGE_M < slides <= _LONGEST_SLIDE_M and 0 < others < slides:
            yield (
                f"joint {joint.name!r} slides by {slides:.3g} m at the end of an arm of "
                f"{others:.2g} m: another unit?; taken as it stands"
            )


def _chain_to(joint: Joint, by_child: Mapping[str, Joint]) -> Iterator[Joint]:
    """Yield the joints before one, as far as no ring is closed."""
    seen = {joint.child}
    at = by_child.get(joint.parent)
    while at is not None and at.child not in seen:
        seen.add(at.child)
        yield at
        at = by_child.get(at.parent)


def doubtful_masses(links: Iterable[Link]) -> Iterator[str]:
    """Yield a sentence for each link whose mass or inertia is that of no body of its shape."""
    for link in links:
        if link.inertial.mass <= 0 or not link.shapes:
            continue
        yield from _doubtful_inertia(link)
        if link.inertial.mass < _HEAVY_KG:
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


def _doubtful_inertia(link: Link) -> Iterator[str]:
    box = _box_of(link)
    if box is None:
        return
    low, high = box
    side = float((high - low).max())
    moment = float(np.linalg.eigvalsh(link.inertial.tensor)[-1])
    gyration = math.sqrt(max(moment, 0.0) / link.inertial.mass)
    is_placeholder = moment > 0 and math.log10(moment).is_integer()
    is_meant = _LEAST_GYRATION * side < gyration < _TIMES_GYRATION * side
    if moment > 0 and side < _WIDEST_M and not is_placeholder and not is_meant:
        unit = "g mm2" if gyration < side else "kg cm2"
        yield (
            f"link {link.name!r} has moments of inertia of {moment:.3g} kg m2 at "
            f"{link.inertial.mass:g} kg, as of a body {1000 * gyration:.2g} mm about its middle, "
            f"with a shape of {1000 * side:.0f} mm: {unit}?; taken as it stands"
        )
    centre = np.array(link.inertial.centre)
    outside = float(np.linalg.norm(np.maximum(np.maximum(low - centre, centre - high), 0)))
    if outside > _TIMES_OUTSIDE * side:
        yield (
            f"link {link.name!r} has its centre of mass {outside:.3g} m outside of its shape, "
            f"which is {side:.2g} m large; taken as it stands"
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
        (link.name, max((_sides(shape)[1] for shape in link.shapes), default=0.0))
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
        if _sides(shape)[1] <= limit:
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


def _sides(shape: Shape) -> tuple[float, float]:
    """Return the shortest and the longest side of a shape, m; zeros where no mesh can be read."""
    if shape.kind == "mesh":
        try:
            low, high = mesh_box(shape.path, shape.size)
        except RobotError:  # a mesh that cannot be read is named elsewhere
            return 0.0, 0.0
        sides = tuple((high - low).tolist())
    elif shape.kind == "box":
        sides = shape.size
    else:
        length = shape.size[1] if shape.kind == "cylinder" else 2 * shape.size[0]
        sides = 2 * shape.size[0], length
    return min(sides), max(sides)


def _box_of(link: Link) -> tuple[Floats, Floats] | None:
    """Return the lowest and the highest corner (3,) m of a link's shapes, in its frame."""
    corners = []
    for shape in link.shapes:
        try:
            corners.append(shape_corners(shape))
        except RobotError:  # a mesh that cannot be read is named elsewhere
            return None
    if not corners:
        return None
    stacked = np.concatenate(corners)
    return stacked.min(axis=0), stacked.max(axis=0)
