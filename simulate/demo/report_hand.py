"""Drawing of a hand at a product, as the report of a demo shows it: to scale, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["HATCH", "draw_hands", "hand_data"]

HATCH = (
    '<svg width="0" height="0" style="position:absolute" aria-hidden="true"><defs>'
    '<pattern id="hatch" width="6" height="6" patternUnits="userSpaceOnUse" '
    'patternTransform="rotate(45)"><path d="M0 0V6" stroke="#b3123f" stroke-width="3"/>'
    "</pattern></defs></svg>"
)
"""Fill of the part of a product that breaks; a page needs it once."""

_MM = 1000.0
_FINGER_MM = (9.0, 16.0)
_SEEN_MM = (66.0, 44.0)
"""Half of what the drawing shows, along the product and across it; more if that is larger."""
_DEFAULT_WIDTH_M = 0.03


def hand_data(hand: Mapping[str, Any]) -> str:
    """Return a hand's place for the page's script: x, y, mm, angle, degrees, opening, mm.

    SVG's y axis points down, hence the signs.
    """
    x, y = hand["along_m"] * _MM, 0.0 - hand["across_m"] * _MM
    return f"{x:.1f} {y:.1f} {-math.degrees(hand['angle']):.1f} {hand['opening_m'] * _MM:.1f}"


def draw_hands(hidden: Mapping[str, Any], attempts: Sequence[Mapping[str, Any]]) -> str:
    """Return a drawing of the product with the hand of each attempt; empty if none got there.

    The hand of the first attempt is solid, and the page's script moves it; of each attempt, a mark
    shows where the hand closed.

    Parameters
    ----------
    hidden
        As :func:`simulate.agent.hand_place.describe_product` returns it.
    attempts
        With ``hand``, as :class:`simulate.agent.hand_place.HandPlace`, and ``held``.
    """
    there = [attempt for attempt in attempts if attempt.get("hand")]
    if not there:
        return ""
    width = max(there[0]["hand"].get("width_m", _DEFAULT_WIDTH_M) * _MM, 4.0)
    length = hidden["length_m"] * _MM
    reach = max(a["hand"]["opening_m"] for a in there) * _MM / 2 + _FINGER_MM[0] + 4
    half_x, half_y = max(_SEEN_MM[0], length / 2 + 12), max(_SEEN_MM[1], reach)
    parts = [
        f'<svg class="hands" viewBox="{-half_x:.0f} {-half_y:.0f} {2 * half_x:.0f} '
        f'{2 * half_y:.0f}" role="img" aria-label="{_words(hidden)}">',
        _box("product", -length / 2, -width / 2, length, width),
    ]
    if hidden.get("weak_m"):
        start, end = (edge * _MM for edge in hidden["weak_m"])
        parts.append(_box("weak", start, -width / 2, end - start, width))
    if hidden.get("mass_m"):
        parts.append(f'<circle class="mass" cx="{hidden["mass_m"] * _MM:.1f}" cy="0" r="5"/>')
    parts += [_mark(attempt["hand"], attempt["held"]) for attempt in there]
    return "".join([*parts, _hand(there[0]["hand"]), "</svg>"])


def _words(hidden: Mapping[str, Any]) -> str:
    secret = ""
    if hidden.get("weak_m"):
        secret = "; the hatched part breaks when it is pressed"
    elif hidden.get("mass_m"):
        secret = "; the dot is its centre of mass"
    return f"The hand at the product, to scale{secret}"


def _box(kind: str, x: float, y: float, width: float, height: float) -> str:
    return (
        f'<rect class="{kind}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" '
        f'height="{height:.1f}" rx="2"/>'
    )


def _mark(hand: Mapping[str, Any], held: bool) -> str:
    x, y, angle, _ = hand_data(hand).split()
    return (
        f'<line class="mark {"good" if held else "bad"}" x1="-5" x2="5" y1="0" y2="0" '
        f'transform="translate({x} {y}) rotate({angle})"/>'
    )


def _hand(hand: Mapping[str, Any]) -> str:
    """Return the hand: two solid fingers, and a palm that one sees through."""
    x, y, angle, opening = hand_data(hand).split()
    thick, wide = _FINGER_MM
    fingers = "".join(
        f'<g class="finger" data-side="{side}" '
        f'style="transform:translate({side * float(opening) / 2:.1f}px,0)">'
        f"{_box('', 0 if side > 0 else -thick, -wide / 2, thick, wide)}</g>"
        for side in (-1, 1)
    )
    span = float(opening) + 2 * thick
    palm = _box("palm", -span / 2, -wide / 4, span, wide / 2)
    return (
        f'<g class="hand" style="transform:translate({x}px,{y}px) rotate({angle}deg)">'
        f"{palm}{fingers}</g>"
    )
