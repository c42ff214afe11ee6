"""Path data and basic shapes of SVG as pieces (SVG 2, chapters 9 and 10)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from grasp.push.inputs.curves import Piece, bezier, ellipse_arc, line

__all__ = ["basic_shape", "numbers", "path_pieces"]

_TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def numbers(text: str) -> list[float]:
    """Return the numbers of an attribute.

    >>> numbers("1,-.5.25e1")
    [1.0, -0.5, 2.5]
    """
    values = [float(v) for v in re.findall(_NUMBER, text)]
    if not all(map(math.isfinite, values)):
        raise ValueError(f"numbers out of range: {text[:40]!r}")
    return values


def basic_shape(name: str, points: str, number: Callable[[str], float]) -> list[list[Piece]]:
    """Return the outline of a basic shape (SVG 2, 10), none for other elements.

    Parameters
    ----------
    number
        Gives an attribute in user units, NaN where there is none.
    """
    if name in ("polygon", "polyline"):
        values = numbers(points)
        corners = [complex(x, y) for x, y in zip(values[::2], values[1::2], strict=False)]
        return [[line(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]]
    if name in ("circle", "ellipse"):
        radii = ("r", "r") if name == "circle" else ("rx", "ry")
        rx, ry = (_given(number(k)) for k in radii)
        centre = complex(_given(number("cx")), _given(number("cy")))
        return [[ellipse_arc(centre, complex(rx), 1j * ry, 0.0, 2 * math.pi)]]
    if name == "rect":
        return [_rectangle(number)]
    return []


def _given(value: float, otherwise: float = 0.0) -> float:
    return otherwise if math.isnan(value) else value


def _rectangle(number: Callable[[str], float]) -> list[Piece]:
    x, y, w, h = (_given(number(k)) for k in ("x", "y", "width", "height"))
    rx, ry = number("rx"), number("ry")
    # One radius stands for both where the other is missing (SVG 2, 7.4).
    rx, ry = _given(rx, _given(ry)), _given(ry, _given(rx))
    rx, ry = min(rx, w / 2), min(ry, h / 2)
    at = complex(x, y)
    if rx <= 0 or ry <= 0:
        corners = [at, at + w, at + complex(w, h), at + 1j * h]
        return [line(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    pieces: list[Piece] = []
    # Clockwise from the top right corner, as y points down.
    centres = [complex(w - rx, ry), complex(w - rx, h - ry), complex(rx, h - ry), complex(rx, ry)]
    end = at + complex(rx, 0)
    for k, centre in enumerate(centres):
        first = (k - 1) * math.pi / 2
        start = at + centre + complex(rx * math.cos(first), ry * math.sin(first))
        pieces.append(line(end, start))
        pieces.append(ellipse_arc(at + centre, complex(rx), 1j * ry, first, math.pi / 2))
        last = first + math.pi / 2
        end = at + centre + complex(rx * math.cos(last), ry * math.sin(last))
    return pieces


def path_pieces(d: str) -> list[list[Piece]]:
    """Return the subpaths of path data (SVG 2, 9.3).

    Raises
    ------
    ValueError
        When a command has too few numbers.
    """
    subpaths: list[list[Piece]] = [[]]
    at = handle = start = 0j
    last = ""
    for letter, rest in re.findall(r"([MmLlHhVvCcSsQqTtAaZz])([^MmLlHhVvCcSsQqTtAaZz]*)", d):
        command, relative = letter.upper(), letter.islower()
        for k, group in enumerate(_groups(letter, rest)):
            origin = at if relative else 0j
            # What comes behind it without a move starts where the closed path did (SVG 2, 9.3.4).
            if command == "Z":
                subpaths[-1].append(line(at, start))
                subpaths.append([])
                at = start
            # Further pairs behind a move are lines (SVG 2, 9.3.3).
            elif command == "M" and k == 0:
                at = start = origin + complex(*group)
                subpaths.append([])
            elif command == "A":
                end = origin + complex(group[5], group[6])
                subpaths[-1].append(_arc(at, end, group))
                at = end
            elif command in "CSQT":
                pairs = [origin + complex(*group[i : i + 2]) for i in range(0, len(group), 2)]
                if command in "ST":
                    # Only after a curve of the same degree is the handle mirrored, else the point
                    # itself is it (SVG 2, 9.3.6).
                    smooth = last in ("CS" if command == "S" else "QT")
                    pairs.insert(0, 2 * at - handle if smooth else at)
                subpaths[-1].append(bezier([at, *pairs]))
                handle, at = pairs[-2], pairs[-1]
            else:
                end = _line_end(command, group, at, relative)
                subpaths[-1].append(line(at, end))
                at = end
            last = command
    return [pieces for pieces in subpaths if pieces]


def _groups(letter: str, rest: str) -> list[list[float]]:
    takes = _TAKES[letter.upper()]
    if not takes:
        return [[]]
    values = _arc_numbers(rest) if takes == 7 else numbers(rest)
    if not values or len(values) % takes:
        raise ValueError(f"path data: {letter} takes {takes} numbers, got {len(values) % takes}")
    return [values[i : i + takes] for i in range(0, len(values), takes)]


def _arc_numbers(text: str) -> list[float]:
    """Return an arc's numbers; its flags need no space between them (``a1 1 0 01 2 0``)."""
    out: list[float] = []
    at = 0
    while True:
        pattern = r"[01]" if len(out) % 7 in (3, 4) else _NUMBER
        match = re.compile(r"[\s,]*(" + pattern + ")").match(text, at)
        if not match:
            return out
        out.append(float(match.group(1)))
        at = match.end()


def _line_end(command: str, group: list[float], at: complex, relative: bool) -> complex:
    if command == "H":
        return complex(group[0] + (at.real if relative else 0.0), at.imag)
    if command == "V":
        return complex(at.real, group[0] + (at.imag if relative else 0.0))
    return complex(*group) + (at if relative else 0j)


def _arc(start: complex, end: complex, group: list[float]) -> Piece:
    """Return an elliptical arc between two points (SVG 2, B.2.4)."""
    rx, ry, angle = abs(group[0]), abs(group[1]), math.radians(group[2])
    if rx == 0 or ry == 0 or start == end:
        return line(start, end)
    turn = complex(math.cos(angle), math.sin(angle))
    half = (start - end) / 2 / turn
    x, y = half.real / rx, half.imag / ry
    # Radii that do not reach from end to end are enlarged until they do (SVG 2, 9.5.1).
    grow = math.sqrt(max(1.0, x * x + y * y))
    rx, ry, x, y = rx * grow, ry * grow, x / grow, y / grow
    # Rounding makes it negative where the radii just reach.
    size = math.sqrt(max(0.0, 1.0 / (x * x + y * y) - 1.0))
    if bool(group[3]) == bool(group[4]):
        size = -size
    cx, cy = size * y, -size * x
    first = math.atan2(y - cy, x - cx)
    sweep = math.atan2(-y - cy, -x - cx) - first
    if group[4] and sweep < 0:
        sweep += 2 * math.pi
    elif not group[4] and sweep > 0:
        sweep -= 2 * math.pi
    middle = (start + end) / 2 + complex(cx * rx, cy * ry) * turn
    return ellipse_arc(middle, rx * turn, 1j * ry * turn, first, sweep)
