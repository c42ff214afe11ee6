"""Covers by a second generator, which shares nothing with ``generated_packages.py`` of recognition.

Constants were chosen on covers of the first: other letters, other art and other cameras argue
against them. Art is a landscape, cells of glass, a motif that repeats, a halftone, or flat colour
with large type, in outline fonts. The camera has a heavy vignette, a lamp's glare, a rolling
shutter while the hand moves, and two encodings of a messenger, the first of a smaller picture.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import cKDTree

__all__ = ["other_artwork", "photograph_other_cover"]

Picture = NDArray[np.uint8]
WIDE, HIGH = 400, 560
_WORDS = (
    "the", "of", "a", "river", "night", "house", "silent", "winter", "return", "last", "summer",
    "stone", "garden", "long", "road", "blue", "city", "letters", "from", "island", "under",
    "glass", "north", "wolf", "paper", "moon", "second", "war", "mother", "salt", "water", "king",
    "ash",
)  # fmt: skip
_FONTS = sorted(
    path
    for path in (Path(mpl.get_data_path()) / "fonts" / "ttf").glob("*.ttf")
    if path.name.startswith(("DejaVuS", "STIXGeneral"))
)


def other_artwork(seed: int) -> Picture:
    """Return the front of a cover (560, 400, 3)."""
    rng = np.random.default_rng([41, seed])
    kinds = (_landscape, _glass, _motif, _halftone, _flat)
    image = Image.fromarray(kinds[int(rng.integers(len(kinds)))](rng))
    draw = ImageDraw.Draw(image)
    light = (250, 246, 232) if np.asarray(image).mean() < 130 else (20, 18, 30)
    top = rng.uniform(0.04, 0.6) * HIGH
    for _ in range(int(rng.integers(1, 4))):
        line = " ".join(rng.choice(_WORDS, int(rng.integers(1, 4)))).upper()
        size = int(rng.uniform(0.06, 0.15) * HIGH)
        font = ImageFont.truetype(str(rng.choice(_FONTS)), size)
        length = draw.textlength(line, font=font)
        if length > 0.9 * WIDE:
            size = int(size * 0.9 * WIDE / length)
            font = font.font_variant(size=max(size, 9))
        draw.text((0.05 * WIDE, top), line, fill=light, font=font)
        top += 1.2 * size
    small = ImageFont.truetype(str(rng.choice(_FONTS)), 12)
    for k in range(int(rng.integers(1, 5))):
        text = " ".join(rng.choice(_WORDS, 9))
        draw.text((0.06 * WIDE, (0.87 + 0.028 * k) * HIGH), text, fill=light, font=small)
    return np.asarray(image, np.uint8).copy()


def _palette(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return colours (count, 3) of neighbouring hues, and one from across."""
    hue = rng.uniform(0, 180) + np.append(rng.normal(0, 14, count - 1), 90)
    hsv = np.stack([hue % 180, rng.uniform(40, 220, count), rng.uniform(60, 250, count)], axis=1)
    return cv2.cvtColor(hsv[None].astype(np.uint8), cv2.COLOR_HSV2RGB)[0].astype(np.float64)


def _fractal(rng: np.random.Generator, slope: float) -> NDArray[np.float64]:
    """Return noise (560, 400) in 0..1 whose spectrum falls by a power, as photographs' do."""
    down, across = np.fft.fftfreq(HIGH)[:, None], np.fft.rfftfreq(WIDE)[None]
    power = np.maximum(np.hypot(down, across), 1 / HIGH) ** -slope
    phase = np.exp(2j * np.pi * rng.random(power.shape))
    values = np.fft.irfft2(power * phase, (HIGH, WIDE))
    low, high = np.quantile(values, [0.01, 0.99])
    return np.clip((values - low) / (high - low), 0, 1)


def _landscape(rng: np.random.Generator) -> Picture:
    sky, haze, near = _palette(rng, 3)
    rows = np.linspace(0, 1, HIGH)[:, None, None]
    image = sky * (1 - rows) + haze * rows + 50 * (_fractal(rng, 1.8)[..., None] - 0.5)
    at = np.arange(WIDE)
    for depth in np.linspace(0.35, 0.85, int(rng.integers(3, 7))):
        ridge = _fractal(rng, 1.6)[int(rng.integers(HIGH))]
        below = np.arange(HIGH)[:, None] > (depth + 0.22 * (ridge[at] - 0.5)) * HIGH
        ground = ((1 - depth) * haze + depth * near) * (0.55 + 0.7 * _fractal(rng, 1.2)[..., None])
        image = np.where(below[..., None], ground, image)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def _glass(rng: np.random.Generator) -> Picture:
    seeds = rng.uniform((0, 0), (WIDE, HIGH), (int(rng.integers(30, 160)), 2))
    grid = np.stack(np.meshgrid(np.arange(WIDE), np.arange(HIGH)), axis=-1)
    distances, cells = cKDTree(seeds).query(grid, k=2)
    colours = _palette(rng, 7)[rng.integers(7, size=len(seeds))]
    image = colours[cells[..., 0]] * (0.7 + 0.5 * _fractal(rng, 1.5)[..., None])
    image[distances[..., 1] - distances[..., 0] < 3] = 25
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def _motif(rng: np.random.Generator) -> Picture:
    step = int(rng.integers(36, 80))
    paper, *inks = _palette(rng, 4)
    tile = np.tile(paper, (step, step, 1)).astype(np.uint8)
    for ink in inks:
        points = rng.uniform(0.05, 0.95, (int(rng.integers(3, 6)), 2)) * step
        cv2.fillConvexPoly(tile, cv2.convexHull(points.astype(np.int32)), ink.tolist(), cv2.LINE_AA)
    image = np.tile(tile, (-(-HIGH // step), -(-WIDE // step), 1))[:HIGH, :WIDE].copy()
    centre = int(WIDE * rng.uniform(0.3, 0.7)), int(HIGH * rng.uniform(0.4, 0.7))
    cv2.circle(image, centre, int(rng.uniform(0.15, 0.3) * WIDE), inks[0].tolist(), -1, cv2.LINE_AA)
    return image


def _halftone(rng: np.random.Generator) -> Picture:
    step = int(rng.integers(6, 11))
    tone = cv2.GaussianBlur(_fractal(rng, 2.0), (0, 0), step)
    down, across = np.mgrid[:HIGH, :WIDE] % step - step / 2 + 0.5
    ink = np.hypot(down, across) < 0.75 * step * np.sqrt(tone)
    paper, dots = _palette(rng, 2)
    return np.asarray(np.where(ink[..., None], dots, paper), np.uint8)


def _flat(rng: np.random.Generator) -> Picture:
    first, second, third = _palette(rng, 3)
    image = np.tile(first, (HIGH, WIDE, 1))
    image[int(rng.uniform(0.3, 0.8) * HIGH) :] = second
    x = rng.uniform(0.2, 0.8) * WIDE
    image[:, int(x) : int(x + rng.uniform(0.03, 0.2) * WIDE)] = third
    image += 14 * (_fractal(rng, 1.0)[..., None] - 0.5)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def photograph_other_cover(
    print_: Picture, rng: np.random.Generator
) -> tuple[Picture, NDArray[np.bool_]]:
    """Return a phone's photograph (h, w, 3) of a cover, and the cover's mask (h, w)."""
    wide, high = (480, 640) if rng.random() < 0.7 else (640, 480)
    height, width = print_.shape[:2]
    fill = rng.uniform(0.5, 0.9) * min(wide / width, high / height)
    half = np.array([width, height]) * fill / 2
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    turn = rng.normal(0, 0.15)
    turned = square @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    # The camera leans: far corners draw together.
    lean = 1 + (square / half.max()) @ rng.uniform(-0.28, 0.28, 2)
    seen = turned / lean[:, None] + np.array([wide, high]) / 2 + rng.normal(0, 8, 2)
    source = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    warp = cv2.getPerspectiveTransform(source, seen.astype(np.float32))
    table = (
        _palette(rng, 1)[0] * (0.6 + 0.5 * cv2.resize(_fractal(rng, 1.3), (wide, high)))[..., None]
    )
    soft = cv2.GaussianBlur(print_, (0, 0), 0.45 / min(fill, 1.0))
    laid = cv2.warpPerspective(soft, warp, (wide, high), flags=cv2.INTER_LINEAR)
    mask = cv2.warpPerspective(np.full((height, width), 255, np.uint8), warp, (wide, high)) > 127
    image = np.where(mask[..., None], laid, np.clip(table, 0, 255)).astype(np.float64) / 255
    light = np.clip(image, 0, 1) ** 2.2 * _lamps(rng, wide, high)
    moved = _rolled(light, rng)
    return _sent(np.clip(moved, 0, 1) ** (1 / 2.2), rng), mask


def _lamps(rng: np.random.Generator, wide: int, high: int) -> NDArray[np.float64]:
    """Return the light (h, w, 3): a warm or cool lamp, a heavy vignette, a streak of glare."""
    x, y = np.meshgrid(np.linspace(-1, 1, wide), np.linspace(-1, 1, high))
    vignette = (1 + rng.uniform(0.1, 0.6) * (x**2 + y**2)) ** -2
    warmth = 2.0 ** rng.uniform(-0.45, 0.45)
    lamp = rng.uniform(0.5, 1.2) * np.array([warmth, 1.0, 1 / warmth])
    light = vignette[..., None] * lamp
    if rng.random() < 0.5:
        slope, at, thick = rng.uniform(-1, 1), rng.uniform(-0.7, 0.7), rng.uniform(0.04, 0.12)
        glare = np.exp(-(((y - slope * x - at) / thick) ** 2))
        light += rng.uniform(0.3, 1.5) * glare[..., None]
    return np.asarray(light)


def _rolled(light: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return radiance as a rolling shutter sees it: lower rows later, and each smeared."""
    high, wide = light.shape[:2]
    drift = rng.normal(0, 3.0)
    u, v = np.meshgrid(np.arange(wide, dtype=np.float32), np.arange(high, dtype=np.float32))
    sheared = cv2.remap(
        light, u + np.float32(drift) * (v / high - np.float32(0.5)), v, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    length = int(rng.integers(1, 5))
    kernel = np.zeros((9, 9))
    angle = rng.uniform(0, np.pi)
    for t in np.linspace(-length / 2, length / 2, 17):
        kernel[round(4 + t * np.sin(angle)), round(4 + t * np.cos(angle))] += 1
    return np.asarray(cv2.filter2D(sheared, -1, kernel / kernel.sum()), np.float64)


def _sent(image: NDArray[np.float64], rng: np.random.Generator) -> Picture:
    """Return a picture after its camera's encoding and a messenger's, of another size."""
    grain = rng.normal(0, rng.uniform(0.005, 0.025), image.shape)
    data = (255 * np.clip(image + grain, 0, 1)).astype(np.uint8)
    high, wide = data.shape[:2]
    small = rng.uniform(0.6, 1.0)
    for scale, quality in ((small, int(rng.integers(40, 70))), (1.0, int(rng.integers(60, 85)))):
        size = (round(wide * scale), round(high * scale))
        data = np.asarray(cv2.resize(data, size, interpolation=cv2.INTER_AREA), np.uint8)
        jpeg = cv2.imencode(".jpg", data, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        data = np.asarray(cv2.imdecode(jpeg, 1), np.uint8)
    return np.asarray(cv2.resize(data, (wide, high), interpolation=cv2.INTER_CUBIC), np.uint8)
