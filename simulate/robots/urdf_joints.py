"""The tree of a URDF's joints: their order, and which moves which."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rtask.errors import RobotError
from simulate.robots.description import Joint, Shape

__all__ = [
    "from_the_root",
    "has_shape_below",
    "last_sources",
    "links_below",
    "with_leading_slides",
]


def last_sources(follows: Mapping[str, str]) -> dict[str, str]:
    """Return the joint that moves each follower, over any that follow in turn.

    Parameters
    ----------
    follows
        Name of the joint that each follower states.

    Examples
    --------
    >>> last_sources({"right": "left", "left": "motor"})
    {'right': 'motor', 'left': 'motor'}
    """
    last: dict[str, str] = {}
    for name in follows:
        at, seen = name, {name}
        while at in follows and follows[at] not in seen:
            at = follows[at]
            seen.add(at)
        last[name] = at
    return last


def with_leading_slides(
    joints: Sequence[Joint], unlimited: Collection[str]
) -> tuple[list[Joint], dict[str, str]]:
    """Return the joints, the first slide that follows a turning joint without limits leading it.

    A motor that turns on and on tells nothing of where a finger ends, and a propeller beside two
    fingers moves none of them. Others that follow the motor follow that slide.

    Parameters
    ----------
    unlimited
        Names of the turning joints that state no limits.

    Returns
    -------
    list, dict
        The joints, and the name of the motor by that of the slide that leads now.
    """
    leads: dict[str, Joint] = {}
    geared: list[Joint] = []
    for joint in joints:
        motor, factor = joint.mimic or ("", 0.0)
        if joint.kind != "prismatic" or motor not in unlimited or not factor:
            geared.append(joint)
            continue
        first = leads.setdefault(motor, joint)
        if first is joint:
            geared.append(replace(joint, mimic=None, mimic_offset=0.0))
            continue
        assert first.mimic is not None
        ratio = factor / first.mimic[1]
        offset = joint.mimic_offset - ratio * first.mimic_offset
        geared.append(replace(joint, mimic=(first.name, ratio), mimic_offset=offset))
    return geared, {joint.name: motor for motor, joint in leads.items()}


def from_the_root(path: Path, root: str, joints: Sequence[Joint]) -> Iterator[Joint]:
    """Yield the joints so that every parent comes before its children, else in the file's order."""
    reached, waiting = {root}, list(joints)
    while waiting:
        later = []
        for joint in waiting:
            if joint.parent not in reached:
                later.append(joint)
                continue
            if joint.child in reached:
                raise RobotError(f"{path}: link {joint.child!r} hangs on two joints")
            reached.add(joint.child)
            yield joint
        if len(later) == len(waiting):
            lost = later[0].name
            raise RobotError(f"{path}: joint {lost!r} hangs on itself, not on the root {root!r}")
        waiting = later


def links_below(
    below: Mapping[str, Sequence[Joint]], link: str, known: frozenset[str] = frozenset()
) -> Iterator[str]:
    """Yield a link and all below it; a ring of joints, which is refused later, ends there."""
    if link in known:
        return
    yield link
    for joint in below.get(link, ()):
        yield from links_below(below, joint.child, known | {link})


def has_shape_below(
    below: Mapping[str, Sequence[Joint]], shapes: Mapping[str, tuple[Shape, ...]], joint: Joint
) -> bool:
    """Return whether a link below a joint has a shape."""
    return any(shapes.get(link) for link in links_below(below, joint.child))
