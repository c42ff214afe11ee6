"""Checks of a URDF's text: what a reader of URDF passes over, though its writer meant something.

A misspelt attribute, a second ``<origin>`` or a joint without a parent leave no trace in what is
read: the default stands, or the first one, or nothing. Only the text itself can tell.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from difflib import get_close_matches

__all__ = ["without_namespaces", "writing_doubts"]

_ATTRIBUTES = {
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "mimic": ("joint", "multiplier", "offset"),
    "parent": ("link",),
    "child": ("link",),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "mesh": ("filename", "scale"),
}
"""Of https://wiki.ros.org/urdf/XML. Makers add others of their own, which mean nothing here."""
_CHILDREN = {
    "joint": ("origin", "parent", "child", "axis", "limit", "mimic", "dynamics"),
    "link": ("inertial", "visual", "collision"),
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material"),
    "collision": ("origin", "geometry"),
    **dict.fromkeys(("origin", "axis", "limit", "mimic", "mass", "inertia"), ()),
}
"""Elements that a reader looks for in others."""
_TAGS = {tag for tags in _CHILDREN.values() for tag in tags} - {"material"}
"""Those that mean something elsewhere than where they stand; a colour at a shape means nothing."""
_ALIKE, _TAGS_ALIKE = 0.6, 0.75
_ONCE = ("origin", "axis", "limit", "mimic", "parent", "child", "inertial", "mass", "inertia")
"""Elements that a link, joint, shape or inertial has once at most; readers take the first."""
_SOFT_SHARE = 0.9


def without_namespaces(tree: ET.Element) -> ET.Element:
    """Return the document, changed in place, with every tag as URDF knows it.

    Examples
    --------
    >>> without_namespaces(ET.fromstring('<robot xmlns="http://ros.org"><link/></robot>'))[0].tag
    'link'
    """
    for element in tree.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    return tree


def writing_doubts(tree: ET.Element) -> Iterator[str]:
    """Yield a sentence for each thing that is written and would be passed over.

    Parameters
    ----------
    tree
        The element ``robot``.

    Examples
    --------
    >>> joint = '<joint name="elbow"><origin xzy="0 0 1"/><parent link="a"/></joint>'
    >>> list(writing_doubts(ET.fromstring(f"<robot>{joint}</robot>")))
    ["joint 'elbow' has an <origin> with 'xzy' and without 'xyz': misspelt?"]
    """
    for owner in (*tree.findall("link"), *tree.findall("joint")):
        where = f"{owner.tag} {owner.get('name', '')!r}"
        if not owner.get("name"):
            yield f"a {owner.tag} has no name"
        for element in owner.iter():
            yield from _misspelt(where, element)
            yield from _misplaced(where, element)
            yield from _repeated(where, element)
    for other in tree.iter("robot"):
        if other is not tree:
            yield f"<robot name={other.get('name')!r}> inside: left out"
    yield from _unfelt_base(tree)
    for joint in tree.findall("joint"):
        yield from _lost_joint(joint)
        yield from _half_limits(joint)
        yield from _soft_limits(joint)


def _misspelt(where: str, element: ET.Element) -> Iterator[str]:
    absent = [key for key in _ATTRIBUTES.get(str(element.tag), ()) if key not in element.attrib]
    for name in element.attrib if absent else ():
        meant = get_close_matches(name, absent, 1, _ALIKE)
        if meant and name not in _ATTRIBUTES[str(element.tag)]:
            yield (
                f"{where} has an <{element.tag}> with {name!r} and without {meant[0]!r}: misspelt?"
            )


def _misplaced(where: str, element: ET.Element) -> Iterator[str]:
    """Yield a sentence for each element, or attribute, that stands where nobody looks for it."""
    allowed = _CHILDREN.get(str(element.tag))
    if allowed is None:
        return
    for name in element.attrib:
        if name in _TAGS and name in allowed:
            yield f"{where} has an attribute {name!r}, which URDF has as an element: passed over"
    tags = [str(child.tag) for child in element]
    absent = [tag for tag in allowed if tag not in tags]
    for tag in tags:
        if tag in allowed:
            continue
        meant = get_close_matches(tag.lower(), absent, 1, _TAGS_ALIKE)
        if tag in _TAGS:
            yield f"{where} has <{tag}> in <{element.tag}>, where URDF has none: passed over"
        elif meant:
            yield f"{where} has <{tag}> and no <{meant[0]}>: misspelt?"


def _repeated(where: str, element: ET.Element) -> Iterator[str]:
    for tag in _ONCE:
        count = len(element.findall(tag))
        if count > 1:
            yield f"{where} has {count} <{tag}>; the first is taken"


def _unfelt_base(tree: ET.Element) -> Iterator[str]:
    """Yield a sentence if the links that stand still are seen, and none has a collision shape."""
    still = {child.get("link") for joint in tree.findall("joint") for child in joint.iter("child")}
    links = {link.get("name"): link for link in tree.findall("link")}
    base = [name for name in links if name not in still]
    for name in base:  # grows as links fixed to it are found
        for joint in tree.findall("joint"):
            parent, child = joint.find("parent"), joint.find("child")
            if joint.get("type") == "fixed" and parent is not None and child is not None:
                ahead = child.get("link")
                if parent.get("link") == name and ahead in links and ahead not in base:
                    base.append(ahead)
    seen = [str(name) for name in base if links[name].find("visual") is not None]
    if seen and not any(links[name].find("collision") is not None for name in base):
        yield (
            f"link {seen[0]!r} stands still, and neither it nor what is fixed to it has a "
            "collision shape: nothing keeps an arm off it"
        )


def _lost_joint(joint: ET.Element) -> Iterator[str]:
    if joint.find("parent") is None and joint.find("child") is not None:
        yield f"joint {joint.get('name')!r} has no parent; left out"


def _half_limits(joint: ET.Element) -> Iterator[str]:
    limit = joint.find("limit")
    if limit is None or joint.get("type") not in ("revolute", "prismatic"):
        return
    stated = [key for key in ("lower", "upper") if key in limit.attrib]
    if len(stated) == 1:
        other = "upper" if stated == ["lower"] else "lower"
        yield (
            f"joint {joint.get('name')!r} states {stated[0]} and no {other} limit; the other is 0, "
            "as URDF has it"
        )


def _soft_limits(joint: ET.Element) -> Iterator[str]:
    """Yield a sentence where a controller stops a joint well before the limits that are read."""
    limit, safety = joint.find("limit"), joint.find("safety_controller")
    if limit is None or safety is None:
        return
    hard = [_value(limit, key) for key in ("lower", "upper")]
    soft = [_value(safety, f"soft_{key}_limit") for key in ("lower", "upper")]
    # Both at 0, as left out, is not a range: the controller then keeps to the hard limits.
    if soft[0] < soft[1] and soft[1] - soft[0] < _SOFT_SHARE * (hard[1] - hard[0]):
        yield (
            f"joint {joint.get('name')!r} is kept within {soft[0]:g} .. {soft[1]:g} by its "
            f"safety_controller; its limits {hard[0]:g} .. {hard[1]:g} are taken"
        )


def _value(element: ET.Element, key: str) -> float:
    try:
        return float(element.get(key, "0"))
    except ValueError:  # named by the reader
        return math.nan
