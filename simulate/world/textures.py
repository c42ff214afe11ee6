"""Printed looks for simulated products: emblem, brand words, small print, coloured areas.

A look is made from a seed and is the same wherever the product is sold: two robots that hold
``can-17`` see the same print. One *panel* is painted per kind of surface and the mesh repeats it
around the object, as labels on real cans repeat, so that an object turned by any yaw still shows
print that was seen before. Contrast sits at several scales (1 to 12 mm), because a head camera at
0.3 m sees about 1.5 px per mm.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["PX_PER_M", "Look", "make_look", "paint_panel"]

PX_PER_M = 4000.0
"""Resolution of a print: 4 px per mm, about 2.5 times what the head camera resolves."""

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

_SYLLABLES = "ba bo da du fe fi ga go ka ki la lo ma mo na ni pa po ra ri sa so ta ti va vo za zu"
_MM = PX_PER_M / 1000.0
_SHIFT = 4  # cv2 draws with sub-pixel positions given in 1/16 px


@dataclass(frozen=True)
class Look:
    """Elements of the print of one product.

    Parameters
    ----------
    seed
        Of every random choice below and of the panels.
    ground, second
        Colours of the large areas, RGB.
    dark, light, accent
        Colours of emblem, words and small shapes, RGB.
    word
        Brand, in capitals.
    emblem
        ``(k, 2)`` float outline in [-1, 1], without symmetry, so that its orientation is visible.
    frame_corners
        Of the frame around the emblem: 4 = square ... 24 = round.
    layout
        0 = bands, 1 = diagonal, 2 = waves, 3 = blocks: the large areas.
    """

    seed: int
    ground: Colour
    second: Colour
    dark: Colour
    light: Colour
    accent: Colour
    word: str
    emblem: NDArray[np.float64]
    frame_corners: int
    layout: int


def make_look(seed: int) -> Look:
    """Return the look of a seed; the same seed gives the same look.

    Examples
    --------
    >>> make_look(17).word == make_look(17).word
    True
    """
    rng = np.random.default_rng([0x100C, seed])
    hue = float(rng.random())
    hues = [hue, (hue + rng.uniform(0.25, 0.75)) % 1.0, (hue + rng.uniform(0.1, 0.9)) % 1.0]
    light_ground = bool(rng.random() < 0.55)
    ground = _hsv(hues[0], rng.uniform(0.25, 0.8), rng.uniform(0.75, 1.0))
    second = _hsv(hues[1], rng.uniform(0.6, 1.0), rng.uniform(0.25, 0.5))
    if not light_ground:
        ground, second = second, ground
    syllables = _SYLLABLES.split()
    word = "".join(rng.choice(syllables) for _ in range(int(rng.integers(2, 4)))).upper()
    corners = int(rng.integers(5, 10))
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners)) + np.arange(corners) * 0.05
    radius = rng.uniform(0.35, 1.0, corners)
    return Look(
        seed=seed,
        ground=ground,
        second=second,
        dark=_hsv(hues[1], rng.uniform(0.5, 1.0), rng.uniform(0.04, 0.2)),
        light=_hsv(hues[2], rng.uniform(0.0, 0.2), rng.uniform(0.92, 1.0)),
        accent=_hsv(hues[2], rng.uniform(0.8, 1.0), rng.uniform(0.5, 1.0)),
        word=word,
        emblem=np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1),
        frame_corners=int(rng.choice([4, 5, 6, 24])),
        layout=int(rng.integers(4)),
    )


def paint_panel(look: Look, name: str, width_m: float, height_m: float) -> Image:
    """Paint one panel of a look; its left and right edges fit together.

    Parameters
    ----------
    look
        From :func:`make_look`.
    name
        Name of the surface (``"side"``, ``"lid"`` ...): other surfaces, other small print.
    width_m, height_m
        Size of the panel on the object, m.

    Returns
    -------
    (h, w, 3) uint8 RGB
        At :data:`PX_PER_M`, at least 8 px a side.
    """
    if not (width_m > 0 and height_m > 0):
        raise ValueError(f"a panel needs a positive size in m, got {width_m} x {height_m}")
    width, height = (max(8, round(side * PX_PER_M)) for side in (width_m, height_m))
    rng = np.random.default_rng([0x9A11, look.seed, *name.encode()])
    image = np.empty((height, width, 3), np.uint8)
    _paint_areas(image, look, rng)
    _paint_confetti(image, look, rng)
    _paint_small_print(image, look, rng)
    _paint_emblems(image, look, rng)
    _paint_words(image, look, rng)
    # A print has no steps finer than its raster; this also keeps the renderer from aliasing.
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7), dtype=np.uint8)


def _hsv(hue: float, saturation: float, value: float) -> Colour:
    red, green, blue = colorsys.hsv_to_rgb(hue, float(saturation), float(value))
    return round(255 * red), round(255 * green), round(255 * blue)


def _fill(
    image: Image,
    corners: NDArray[np.float64],
    colour: Colour,
    at: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Fill a polygon (k, 2) px moved by ``at``, repeated one panel width to either side."""
    for shift in (-image.shape[1], 0, image.shape[1]):
        offset = np.array([at[0] + shift, at[1]])
        moved = np.round((corners + offset) * 2**_SHIFT).astype(np.int32)
        cv2.fillPoly(image, [moved], colour, cv2.LINE_AA, _SHIFT)


def _disc(radius: float, corners: int = 20) -> NDArray[np.float64]:
    angle = np.arange(corners) * 2 * np.pi / corners
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _rectangle(width: float, height: float) -> NDArray[np.float64]:
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])


def _paint_areas(image: Image, look: Look, rng: np.random.Generator) -> None:
    height, width = image.shape[:2]
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    phase = 2 * np.pi * u / width + rng.uniform(0, 2 * np.pi)
    split = height * rng.uniform(0.3, 0.7)
    if look.layout == 0:
        second = (v > split) & (v < split + 0.35 * height)
    elif look.layout == 1:
        # A triangle wave, not a ramp: a ramp would break at the seam.
        second = v > split + 0.6 * height * (np.abs(phase / np.pi % 2 - 1) - 0.5)
    elif look.layout == 2:
        second = v > split + 0.2 * height * np.sin(phase)
    else:
        second = (np.sin(phase) > 0) ^ (v < split)
    image[:] = np.where(second[..., None], look.second, look.ground)


def _paint_confetti(image: Image, look: Look, rng: np.random.Generator) -> None:
    """Scatter rectangles, triangles, discs and bars of 1 to 6 mm, large ones first."""
    height, width = image.shape[:2]
    colours = (look.dark, look.light, look.accent, look.ground, look.second)
    area_mm2 = width * height / _MM**2
    sizes_mm = np.sort(1.2 + 4.8 * rng.random(max(6, int(area_mm2 / 11.0))) ** 2)[::-1]
    for size_mm in sizes_mm:
        centre = (float(rng.uniform(0, width)), float(rng.uniform(0, height)))
        half = 0.5 * float(size_mm) * _MM
        kind = int(rng.integers(4))
        if kind == 0:
            corners = _disc(half)
        elif kind == 1:
            corners = np.array([[-1, -0.7], [1, -0.4], [-0.1, 1]]) * half * 1.2
        else:
            aspect = rng.uniform(0.5, 1.0) if kind == 2 else rng.uniform(0.2, 0.4)
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (half * 1.1, half * aspect)
        angle = rng.uniform(0, 2 * np.pi)
        rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        near = image[min(int(centre[1]), height - 1), min(int(centre[0]), width - 1)]
        _fill(image, corners @ rotation, _contrasting(colours, near, rng), centre)


def _contrasting(
    colours: tuple[Colour, ...], near: NDArray[np.uint8], rng: np.random.Generator
) -> Colour:
    """Choose a colour at least 60 grey levels away: keypoints are found in grey images."""
    weights = np.array([0.299, 0.587, 0.114])
    steps = np.abs(np.array(colours) @ weights - near @ weights)
    far = [c for c, step in zip(colours, steps, strict=True) if step >= 60]
    return far[int(rng.integers(len(far)))] if far else colours[int(np.argmax(steps))]


def _paint_small_print(image: Image, look: Look, rng: np.random.Generator) -> None:
    """Paint a label plate with rows of dashes and a bar code, where there is room."""
    height, width = image.shape[:2]
    if min(height, width) < 16 * _MM:
        return
    plate_w, plate_h = 0.42 * width, min(0.3 * height, 12 * _MM)
    left, top = rng.uniform(0, width - plate_w), rng.uniform(0, height - plate_h)
    _fill(image, _rectangle(plate_w, plate_h), look.light, (left, top))
    x = left + _MM
    while x < left + 0.45 * plate_w:
        bar = rng.uniform(0.4, 1.5) * _MM
        _fill(image, _rectangle(bar, plate_h - 2 * _MM), look.dark, (x, top + _MM))
        x += bar + rng.uniform(0.6, 1.5) * _MM
    for y in np.arange(top + _MM, top + plate_h - _MM, 2.0 * _MM):
        x = left + 0.5 * plate_w
        while x < left + plate_w - 2 * _MM:
            dash = min(rng.uniform(0.8, 4.0) * _MM, left + plate_w - _MM - x)
            _fill(image, _rectangle(dash, _MM), look.dark, (x, float(y)))
            x += dash + 0.9 * _MM


def _paint_emblems(image: Image, look: Look, rng: np.random.Generator) -> None:
    """Paint the emblem once large and, on long panels, again further on."""
    height, width = image.shape[:2]
    radius = min(0.36 * min(width, height), 8 * _MM)
    copies = max(1, min(3, round(max(width, height) / (6 * radius))))
    corners = look.frame_corners
    first_angle = rng.uniform(0, 2 * np.pi)
    for k in range(copies):
        along = (k + 0.5) / copies
        centre = (
            (along * width, rng.uniform(0.4, 0.6) * height)
            if width > height
            else (rng.uniform(0.4, 0.6) * width, along * height)
        )
        angle = first_angle if k == 0 else rng.uniform(0, 2 * np.pi)
        rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        for share, colour in ((1.0, look.light), (0.9, look.dark), (0.78, look.light)):
            _fill(image, _disc(share * radius, corners) @ rotation, colour, centre)
        outline = look.emblem @ rotation
        _fill(image, outline * (0.72 * radius), look.accent, centre)
        _fill(image, outline * (0.36 * radius), look.dark, centre)
        eye = outline[0] * (0.4 * radius)
        _fill(image, _disc(0.14 * radius, 10) + eye, look.light, centre)


def _paint_words(image: Image, look: Look, rng: np.random.Generator) -> None:
    """Write the brand along the longer side, on a plate of the opposite brightness."""
    height, width = image.shape[:2]
    upright = height > 1.25 * width
    canvas = np.rot90(image).copy() if upright else image
    rows, columns = canvas.shape[:2]
    if min(rows, columns) < 9 * _MM:
        return
    scale = cv2.getTextSize(look.word, cv2.FONT_HERSHEY_DUPLEX, 1.0, 2)[0]
    factor = min(0.8 * columns / scale[0], 0.22 * rows / scale[1], 5.5 * _MM / scale[1])
    thickness = max(2, round(factor * 3.5))
    (text_w, text_h), _ = cv2.getTextSize(look.word, cv2.FONT_HERSHEY_DUPLEX, factor, thickness)
    left = int(rng.uniform(0.02, 0.98) * max(columns - text_w, 1))
    base = int(rows * (0.24 if rng.random() < 0.5 else 0.93))
    pad = round(0.8 * _MM)
    plate, ink = (look.light, look.dark) if rng.random() < 0.5 else (look.dark, look.light)
    cv2.rectangle(
        canvas, (left - pad, base - text_h - pad), (left + text_w + pad, base + pad), plate, -1
    )
    cv2.putText(
        canvas,
        look.word,
        (left, base),
        cv2.FONT_HERSHEY_DUPLEX,
        factor,
        ink,
        thickness,
        cv2.LINE_AA,
    )
    if upright:
        image[:] = np.rot90(canvas, -1)
