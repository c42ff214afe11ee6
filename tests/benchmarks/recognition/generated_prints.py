"""Generated cartons that come in families: siblings share most of their print.

Prints are painted from a seed (polygons, bars, words) and photographed as flat cards from random
sides, in random light, some of them blurred, all of them through JPEG. No depth: what a colour
camera alone sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.recognition import ViewFeatures, describe_view

__all__ = ["Card", "families", "paint", "photograph", "sibling"]

Image = NDArray[np.uint8]
WIDTH, HEIGHT = 480, 360
_LETTERS = list("ABCDEFGHIKLMNOPRSTUVW")


@dataclass(frozen=True, eq=False)
class Card:
    """A print with its name and that of its family."""

    name: str
    family: str
    print_: Image


def paint(seed: int) -> Image:
    """Paint polygons, bars and words."""
    rng = np.random.default_rng([9, seed])
    palette = rng.integers(0, 256, (5, 3))
    image = np.full((HEIGHT, WIDTH, 3), palette[0], np.uint8)
    left, top = int(rng.integers(0, 200)), int(rng.integers(0, 140))
    for radius in np.sort(rng.uniform(6, 45, 70))[::-1]:
        centre = rng.uniform((left, top), (left + 270, top + 210))
        angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 7))))
        corners = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        colour = palette[rng.integers(5)].tolist()
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], colour, cv2.LINE_AA)
    for _ in range(6):
        word = "".join(rng.choice(_LETTERS, int(rng.integers(4, 9))))
        place = int(rng.integers(5, 260)), int(rng.integers(30, 350))
        font, scale = int(rng.integers(0, 4)), float(rng.uniform(0.8, 2.2))
        colour = rng.integers(0, 255, 3).tolist()
        cv2.putText(image, word, place, font, scale, colour, int(rng.integers(2, 5)), cv2.LINE_AA)
    return image


def sibling(print_: Image, kind: str, seed: int) -> Image:
    """Return another flavour: other print on a half, a quarter or an eighth, or other colours."""
    changed, rng = print_.copy(), np.random.default_rng([3, seed])
    if kind == "colour":
        lab = np.asarray(cv2.cvtColor(print_, cv2.COLOR_RGB2LAB))
        lab[..., 1 + seed % 2] = 255 - lab[..., 1 + seed % 2]
        rows = np.s_[: HEIGHT // 2] if seed % 3 else np.s_[HEIGHT // 2 :]
        changed[rows] = np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2RGB))[rows]
        return changed
    wide, high = {"half": (240, 360), "quarter": (240, 180), "eighth": (160, 130)}[kind]
    x, y = int(rng.integers(0, WIDTH - wide + 1)), int(rng.integers(0, HEIGHT - high + 1))
    inside = np.s_[y : y + high, x : x + wide]
    changed[inside] = paint(seed + 5000)[inside]
    return changed


def families(count: int, seed: int) -> list[Card]:
    """Return three cards each: a print, a sibling of other print, a sibling of other colours."""
    cards = []
    for f in range(count):
        print_, name = paint(seed + f), f"family {f}"
        other = ("half", "quarter", "eighth")[f % 3]
        cards.append(Card(f"{name}, base", name, print_))
        cards.append(Card(f"{name}, {other}", name, sibling(print_, other, seed + f)))
        cards.append(Card(f"{name}, colour", name, sibling(print_, "colour", seed + f)))
    return cards


def photograph(print_: Image, rng: np.random.Generator) -> tuple[Image, NDArray[np.bool_]]:
    """Return a photograph of a card and its mask."""
    side, focal = int(rng.integers(220, 400)), 700.0
    yaw, tilt, turn = rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)
    rotation = np.asarray(cv2.Rodrigues(np.array([tilt, yaw, 0.0]))[0])
    rotation = rotation @ np.asarray(cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0])
    half = np.array([WIDTH, HEIGHT]) / 2
    signs = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    space = (signs * np.append(half, 0)) @ rotation.T * (0.8 * side / WIDTH)
    seen = space[:, :2] / (1 + space[:, 2:] / focal) + side / 2
    source = ((signs[:, :2] + 1) * (half - 0.5)).astype(np.float32)
    # Drawn twice as large and averaged: a camera's pixel is an area, not a point.
    warp = cv2.getPerspectiveTransform(source, (2 * seen).astype(np.float32))
    large = cv2.warpPerspective(print_, warp, (2 * side, 2 * side), borderValue=(120,) * 3)
    cover = cv2.warpPerspective(np.full((HEIGHT, WIDTH), 255, np.uint8), warp, (2 * side, 2 * side))
    small = cv2.resize(large, (side, side), interpolation=cv2.INTER_AREA).astype(np.float64)
    mask = np.asarray(cv2.resize(cover, (side, side), interpolation=cv2.INTER_AREA)) > 127
    gain = rng.uniform(0.7, 1.15) * np.array([rng.uniform(0.9, 1.15), 1, rng.uniform(0.75, 1.1)])
    image = np.clip(small * gain + rng.normal(0, 3, small.shape), 0, 255).astype(np.uint8)
    if rng.random() < 0.4:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.4, 1.4))), np.uint8)
    jpeg = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])[1]
    return np.ascontiguousarray(np.asarray(cv2.imdecode(jpeg, 1), np.uint8)[..., ::-1]), mask


def described(print_: Image, rng: np.random.Generator) -> ViewFeatures:
    """Return the features of a photograph of a card."""
    return describe_view(*photograph(print_, rng))
