"""Outlines from SVG documents (SVG 2): groups, transforms, units, uses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np

from grasp.arrays import FloatArray
from grasp.push.inputs.curves import Piece, flatten, moved_by
from grasp.push.inputs.svg_path import basic_shape, numbers, path_pieces

__all__ = ["rings_from_svg", "transform_matrix"]

_PX = {"": 1.0, "px": 1.0, "mm": 96 / 25.4, "cm": 960 / 25.4, "q": 24 / 25.4, "in": 96.0,
       "pt": 96 / 72, "pc": 16.0}  # fmt: skip
_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Z]*|%)\s*")
_UNSEEN = frozenset({"defs", "symbol", "clipPath", "mask", "marker", "pattern", "metadata"})
_HREF = "{http://www.w3.org/1999/xlink}href"
_MAX_USES = 100


def rings_from_svg(text: str) -> tuple[list[FloatArray], str]:
    """Return the closed shapes (n, 2) of an SVG document, y upwards, and their unit.

    Transforms, nested groups, viewBox and ``use`` are applied. The unit is that of the document's
    width when it has a viewBox, as drawing programs write it, else "px"; subpaths are closed as
    for filling.

    Raises
    ------
    ValueError
        When it is no SVG, or its path data, transforms or lengths cannot be read.

    Examples
    --------
    >>> rings_from_svg('<svg><rect x="1" y="2" width="3" height="1"/></svg>')[0][0].tolist()
    [[1.0, -2.0], [4.0, -2.0], [4.0, -3.0], [1.0, -3.0], [1.0, -2.0]]
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        # Entities can grow without bound; no drawing program needs them for an outline.
        text = re.sub(r"<!DOCTYPE[^\[>]*>", "", text)
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("SVG with entity declarations is refused")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"no SVG: {error}") from error
    document = _Document(root)
    try:
        subpaths = list(document.subpaths(root, document.view))
    except RecursionError as error:
        raise ValueError("the SVG's elements are nested too deeply") from error
    return flatten(subpaths), document.unit


class _Document:
    """Ids, size and unit of a document."""

    def __init__(self, root: ElementTree.Element) -> None:
        self._ids = {e.get("id"): e for e in root.iter() if e.get("id")}
        self._uses = 0
        width, height = (_LENGTH.fullmatch(root.get(k, "")) for k in ("width", "height"))
        box = numbers(root.get("viewBox", ""))
        self.unit, scale = "px", 1.0
        self._across = (100.0, 100.0)
        if len(box) == 4 and box[2] > 0 and box[3] > 0:
            self._across = (box[2], box[3])
            if width and width.group(2) != "%":
                self.unit = width.group(2).lower() or "px"
                if self.unit not in _PX:
                    raise ValueError(f"the unit {self.unit!r} of the SVG's width is not known")
                scale = float(width.group(1)) / box[2]
                if height and height.group(2).lower() in _PX:
                    # The default of preserveAspectRatio is "meet": one scale, the smaller.
                    tall = float(height.group(1)) * _PX[height.group(2).lower()] / _PX[self.unit]
                    scale = min(scale, tall / box[3])
            if not (math.isfinite(scale) and scale > 0):
                raise ValueError("the SVG's width and height must be positive")
        self.view = np.array([[scale, 0.0, 0.0], [0.0, -scale, 0.0], [0.0, 0.0, 1.0]])

    def subpaths(self, element: ElementTree.Element, outer: FloatArray) -> Iterator[list[Piece]]:
        """Yield the subpaths of an element and what it contains, in the result's frame."""
        name = str(element.tag).rpartition("}")[2]
        if name in _UNSEEN or "display:none" in element.get("style", "").replace(" ", ""):
            return
        if element.get("display") == "none":
            return
        here = outer @ transform_matrix(element.get("transform", ""))
        pieces = path_pieces(element.get("d", "")) if name == "path" else basic_shape(
            name, element.get("points", ""), lambda key: self._length(element, key)
        )  # fmt: skip
        for subpath in pieces:
            yield [(moved_by(curve, here), chords) for curve, chords in subpath]
        if name == "use":
            yield from self._used(element, here)
        for child in element:
            yield from self.subpaths(child, here)

    def _used(self, element: ElementTree.Element, here: FloatArray) -> Iterator[list[Piece]]:
        target = self._ids.get((element.get("href") or element.get(_HREF) or "")[1:])
        if target is None:
            return
        self._uses += 1
        if self._uses > _MAX_USES:
            raise ValueError(f"an SVG with more than {_MAX_USES} uses is refused")
        x, y = (0.0 if math.isnan(v := self._length(element, k)) else v for k in "xy")
        moved = here @ np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
        if str(target.tag).rpartition("}")[2] == "symbol":
            for child in target:
                yield from self.subpaths(child, moved)
        else:
            yield from self.subpaths(target, moved)

    def _length(self, element: ElementTree.Element, key: str) -> float:
        """Return an attribute in user units; NaN when it is missing or automatic."""
        text = element.get(key, "")
        match = _LENGTH.fullmatch(text)
        if not match:
            if text.strip() in ("", "auto"):
                return math.nan
            raise ValueError(f"{key}={text!r} is no length")
        value, unit = float(match.group(1)), match.group(2).lower()
        if unit == "%":
            across = self._across[key in ("y", "cy", "height", "ry")]
            return value * across / 100
        if unit not in _PX:
            raise ValueError(f"the unit of {key}={text!r} is not known")
        return value * _PX[unit]


def transform_matrix(text: str) -> FloatArray:
    """Return the matrix (3, 3) of a transform list (CSS Transforms 1, 8).

    >>> transform_matrix("translate(1 2) scale(3)")[:2].tolist()
    [[3.0, 0.0, 1.0], [0.0, 3.0, 2.0]]
    """
    out = np.eye(3)
    left = re.sub(r"(\w+)\s*\(([^()]*)\)", "", text).strip(" ,\t\r\n")
    if left:
        raise ValueError(f"transform {text!r} cannot be read")
    for name, inside in re.findall(r"(\w+)\s*\(([^()]*)\)", text):
        out = out @ _transform(name, numbers(inside), text)
    return out


def _transform(name: str, v: list[float], text: str) -> FloatArray:
    counts = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3),
              "skewX": (1,), "skewY": (1,)}.get(name, ())  # fmt: skip
    if len(v) not in counts:
        raise ValueError(f"transform {text!r} cannot be read: {name} of {len(v)} numbers")
    a, b, c, d, e, f = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0
    if name == "matrix":
        a, b, c, d, e, f = v
    elif name == "translate":
        e, f = v[0], v[1] if len(v) == 2 else 0.0
    elif name == "scale":
        a, d = v[0], v[-1]
    elif name == "rotate":
        angle = math.radians(v[0])
        a, b, c, d = math.cos(angle), math.sin(angle), -math.sin(angle), math.cos(angle)
        x, y = v[1:] or (0.0, 0.0)
        e, f = x - a * x - c * y, y - b * x - d * y
    elif name == "skewX":
        c = math.tan(math.radians(v[0]))
    else:
        b = math.tan(math.radians(v[0]))
    return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])
