"""Generated covers and boxes, photographed by phones that render colours in their own ways.

Artwork is painted from a seed: a picture of soft shapes, a title, small print, and marks that many
packages share (a rating, a disc's logo). A *scan* of a cover is flat and evenly lit. A *phone* has
a white balance, a colour matrix, a tone curve, sharpening, noise and JPEG of its own, and stands
before the thing in some light, with a lens that distorts a little. Boxes carry artwork on six
sides, of which the front is theirs alone and the sides share colours and the name.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Phone", "artwork", "box_faces", "photograph_box", "photograph_cover", "scan"]

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
COVER = 360, 510
"""Width and height of a cover, px."""
PHOTO = 640, 480
_LETTERS = list("ABCDEFGHIKLMNOPRSTUVWY")
_FONTS = (0, 2, 3, 4, 6, 7)


def _word(rng: np.random.Generator, least: int = 4, most: int = 9) -> str:
    return "".join(rng.choice(_LETTERS, int(rng.integers(least, most))))


def _soft_noise(rng: np.random.Generator, width: int, height: int) -> NDArray[np.float32]:
    """Return values in 0..1 that vary on several scales."""
    total = np.zeros((height, width), np.float32)
    for cells, weight in ((3, 1.0), (8, 0.6), (24, 0.3), (70, 0.12)):
        coarse = rng.random((cells, cells)).astype(np.float32)
        total += np.float32(weight) * np.asarray(
            cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.float32
        )
    low, high = float(total.min()), float(total.max())
    return np.asarray((total - low) / (high - low), np.float32)


def _picture(
    rng: np.random.Generator, palette: NDArray[np.float64], width: int, height: int
) -> Image:
    """Return soft colours with shaded figures before them."""
    tone, mix = _soft_noise(rng, width, height), _soft_noise(rng, width, height)
    weight = mix[..., None]
    image = tone[..., None] * (weight * palette[0] + (1 - weight) * palette[1]) * 1.2
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    for _ in range(int(rng.integers(2, 7))):
        centre = rng.uniform((0, 0.15 * height), (width, 0.9 * height))
        axes = rng.uniform(0.06, 0.28, 2) * min(width, height)
        turn = rng.uniform(0, np.pi)
        spin = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        away = np.linalg.norm((grid - centre) @ spin.T / axes, axis=-1)
        shade = 0.55 + 0.45 * ((grid - centre) @ rng.normal(0, 1, 2)) / (2 * axes.max())
        texture = 0.7 + 0.6 * _soft_noise(rng, width, height)
        colour = palette[rng.integers(2, len(palette))]
        inside = (np.clip((1 - away) * 8, 0, 1))[..., None]
        image = (1 - inside) * image + inside * (shade * texture)[..., None] * colour
    return np.asarray(np.clip(image, 0, 255), np.uint8).copy()


def artwork(seed: int, width: int = COVER[0], height: int = COVER[1], brand: int = -1) -> Image:
    """Paint a cover: a picture, a title, small print and marks; a brand lends name and colours."""
    rng = np.random.default_rng([21, seed])
    paint = np.random.default_rng([22, brand if brand >= 0 else seed])
    palette = paint.integers(15, 256, (6, 3)).astype(np.float64)
    name, name_font = _word(paint), int(paint.choice(_FONTS))
    image = _picture(rng, palette, width, height)
    if rng.random() < 0.5:  # a band, as covers have at the top or along the spine
        colour = palette[rng.integers(6)].tolist()
        if rng.random() < 0.5:
            image[: int(rng.uniform(0.05, 0.16) * height)] = colour
        else:
            image[:, : int(rng.uniform(0.05, 0.12) * width)] = colour
    side = min(width, height)
    title = name if brand >= 0 else _word(rng)
    for line, word in enumerate((title, _word(rng)) if rng.random() < 0.7 else (title,)):
        scale = rng.uniform(0.55, 0.95) * width / (18.0 * len(word))
        font = name_font if line == 0 else int(rng.choice(_FONTS))
        place = int(rng.uniform(0.03, 0.2) * width), int(rng.uniform(0.12, 0.9) * height)
        ink = (255, 255, 255) if rng.random() < 0.5 else palette[rng.integers(6)].tolist()
        thick = max(1, round(scale * rng.uniform(1.0, 2.6)))
        cv2.putText(image, word, place, font, scale, (20, 20, 20), thick + 2, cv2.LINE_AA)
        cv2.putText(image, word, place, font, scale, ink, thick, cv2.LINE_AA)
    bottom = int(rng.uniform(0.8, 0.9) * height)
    for line in range(int(rng.integers(2, 5))):
        text = " ".join(_word(rng, 2, 10) for _ in range(7))
        place = int(0.04 * width), bottom + line * max(round(0.026 * side), 9)
        cv2.putText(image, text, place, 0, side / 1100, (225, 225, 215), 1, cv2.LINE_AA)
    _mark(image, (0.9, 0.95), 0.05 * side, int(rng.integers(3)))
    if rng.random() < 0.6:
        _mark(image, (0.1, 0.06), 0.045 * side, 3)
    return image


def _mark(image: Image, at: tuple[float, float], radius: float, kind: int) -> None:
    """Draw one of the marks that many packages carry."""
    height, width = image.shape[:2]
    centre, size = (int(at[0] * width), int(at[1] * height)), max(int(radius), 5)
    inks = ((40, 90, 200), (200, 160, 20), (190, 30, 40), (235, 235, 235))
    cv2.circle(image, centre, size, inks[kind], -1, cv2.LINE_AA)
    cv2.circle(image, centre, size, (10, 10, 10), 1, cv2.LINE_AA)
    text = ("12", "16", "18", "DVD")[kind]
    place = centre[0] - int(0.7 * size), centre[1] + size // 3
    ink = (10, 10, 10) if kind == 3 else (255, 255, 255)
    cv2.putText(image, text, place, 0, size / (30.0 if kind == 3 else 20.0), ink, 1, cv2.LINE_AA)


@dataclass(frozen=True, eq=False)
class Phone:
    """A camera that renders colours in its own way.

    Parameters
    ----------
    gains : (3,) float64
        White balance that is left, of red, green and blue.
    matrix : (3, 3) float64
        Of the colours: saturation and crosstalk.
    gamma, contrast
        Of the tone curve.
    blur_px, sharpening, noise
        Of the lens, the processing and the sensor, the last of 255.
    distortion
        First radial coefficient.
    quality
        Of the JPEG.
    """

    gains: NDArray[np.float64]
    matrix: NDArray[np.float64]
    gamma: float
    contrast: float
    blur_px: float
    sharpening: float
    noise: float
    distortion: float
    quality: int

    @classmethod
    def of(cls, model: int) -> Phone:
        """Return a model of phone."""
        rng = np.random.default_rng([23, model])
        saturation = rng.uniform(0.6, 1.35)
        grey = np.array([0.3, 0.59, 0.11])
        matrix = saturation * np.eye(3) + (1 - saturation) * np.tile(grey, (3, 1))
        crosstalk = rng.normal(0, 0.035, (3, 3))
        matrix = matrix + crosstalk - np.diag(crosstalk.sum(axis=1))
        return cls(
            gains=np.array([rng.uniform(0.82, 1.2), 1.0, rng.uniform(0.72, 1.25)]),
            matrix=matrix,
            gamma=rng.uniform(0.75, 1.3),
            contrast=rng.uniform(0.0, 0.6),
            blur_px=rng.uniform(0.5, 1.9),
            sharpening=rng.uniform(0.0, 1.0),
            noise=rng.uniform(2.0, 7.0),
            distortion=rng.uniform(-0.06, 0.04),
            quality=int(rng.integers(62, 92)),
        )

    def render(self, light: NDArray[np.float64], rng: np.random.Generator) -> Image:
        """Return the photograph of radiance (h, w, 3) in 0..1."""
        height, width = light.shape[:2]
        size = float(max(height, width))
        camera = np.array([[size, 0, width / 2], [0, size, height / 2], [0, 0, 1]])
        bent = cv2.undistort(
            light, camera, np.array([self.distortion, 0, 0, 0]), newCameraMatrix=camera
        )
        lens = cv2.GaussianBlur(bent, (0, 0), self.blur_px)
        mixed = np.clip((lens * self.gains) @ self.matrix.T, 0, 1)
        mixed = np.clip(mixed + rng.normal(0, self.noise / 255, mixed.shape), 0, 1)
        curve = mixed**self.gamma
        curve = (1 - self.contrast) * curve + self.contrast * curve * curve * (3 - 2 * curve)
        soft = cv2.GaussianBlur(curve, (0, 0), 1.2)
        sharp = np.clip(curve + self.sharpening * (curve - soft), 0, 1)
        data = (255 * sharp + 0.5).astype(np.uint8)
        jpeg = cv2.imencode(".jpg", data[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.quality])[1]
        return np.ascontiguousarray(np.asarray(cv2.imdecode(jpeg, 1), np.uint8)[..., ::-1])


def scan(print_: Image) -> Image:
    """Return the scan of a cover: even light, little noise, JPEG."""
    jpeg = cv2.imencode(".jpg", print_[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    return np.ascontiguousarray(np.asarray(cv2.imdecode(jpeg, 1), np.uint8)[..., ::-1])


def photograph_cover(print_: Image, phone: Phone, rng: np.random.Generator) -> tuple[Image, Mask]:
    """Return a phone's photograph of a cover on a desk, and the cover's mask."""
    wide, high = PHOTO if rng.random() < 0.4 else PHOTO[::-1]
    height, width = print_.shape[:2]
    fill = rng.uniform(0.5, 0.97) * min(wide / width, high / height)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * np.array(
        [width / 2, height / 2, 0]
    )
    pose = _rotation(rng.uniform(-0.45, 0.45), rng.uniform(-0.45, 0.45), rng.normal(0, 0.12))
    shift = rng.normal(0, 0.03, 2) * (wide, high)
    seen = _projected(corners @ pose.T * fill, wide, high) + shift
    desk = _desk(rng, wide, high)
    light, mask = _laid_over(desk, print_, seen, 1.0)
    return phone.render(light * _illumination(rng, wide, high), rng), mask


def box_faces(seed: int, brand: int = -1) -> tuple[NDArray[np.float64], list[Image]]:
    """Return the sides of a box, m, and the artwork of its six faces: front, back, sides, lids."""
    rng = np.random.default_rng([24, seed])
    size = np.array([rng.uniform(0.08, 0.2), rng.uniform(0.1, 0.26), rng.uniform(0.03, 0.1)])
    maker = brand if brand >= 0 else seed + 100_000
    scale = 2000.0
    w, h, d = (max(int(side * scale), 60) for side in size)
    shapes = ((w, h), (w, h), (d, h), (d, h), (w, d), (w, d))
    faces = [
        artwork(7 * seed + k if k < 2 else 7 * seed + 2 + k // 2, *shape, brand=maker)
        for k, shape in enumerate(shapes)
    ]
    return size, faces


def photograph_box(
    size: NDArray[np.float64], faces: list[Image], phone: Phone, rng: np.random.Generator
) -> tuple[Image, Mask]:
    """Return a photograph of a box in some pose that shows its front, and the mask of its outline.

    The front is turned by up to 55 degrees, the camera looks down by up to 45, and the box may
    stand, lean or lie on a side.
    """
    wide, high = PHOTO
    x, y, z = size / 2
    corners = {
        0: [(-x, -y, -z), (x, -y, -z), (x, y, -z), (-x, y, -z)],
        1: [(x, -y, z), (-x, -y, z), (-x, y, z), (x, y, z)],
        2: [(x, -y, -z), (x, -y, z), (x, y, z), (x, y, -z)],
        3: [(-x, -y, z), (-x, -y, -z), (-x, y, -z), (-x, y, z)],
        4: [(-x, -y, z), (x, -y, z), (x, -y, -z), (-x, -y, -z)],
        5: [(-x, y, -z), (x, y, -z), (x, y, z), (-x, y, z)],
    }
    turn = rng.choice([0.0, 0.0, np.pi / 2, -np.pi / 2, np.pi]) + rng.normal(0, 0.15)
    pose = _rotation(rng.uniform(-0.8, 0.2), rng.uniform(-0.95, 0.95), turn)
    side = rng.uniform(0.25, 0.75) * high / float(size.max())
    lamp = rng.normal(0, 1, 3) + np.array([0, -1.0, -1.5])
    lamp /= np.linalg.norm(lamp)
    light = _desk(rng, wide, high)
    mask = np.zeros((high, wide), bool)
    shift = rng.normal(0, 0.04, 2) * (wide, high)
    for k, face in corners.items():
        space = np.array(face) @ pose.T * side
        normal = np.cross(space[1] - space[0], space[3] - space[0])
        towards = space.mean(axis=0) + np.array([0, 0, 2.2 * high])
        if normal @ towards < 0:
            continue
        brightness = 0.5 + 0.6 * max(float(-normal @ lamp / np.linalg.norm(normal)), 0.0)
        seen = _projected(space, wide, high) + shift
        light, part = _laid_over(light, faces[k], seen, brightness)
        mask |= part
    return phone.render(light * _illumination(rng, wide, high), rng), mask


def _rotation(tilt: float, yaw: float, turn: float) -> NDArray[np.float64]:
    flat, upright = cv2.Rodrigues(np.array([0, 0, turn]))[0], cv2.Rodrigues(np.array([0, yaw, 0]))
    nod = cv2.Rodrigues(np.array([tilt, 0, 0]))[0]
    return np.asarray(nod @ upright[0] @ flat, np.float64)


def _projected(space: NDArray[np.float64], wide: int, high: int) -> NDArray[np.float64]:
    """Return the places (n, 2), px, of points (n, 3) about the middle of the picture, px."""
    depth = 1 + space[:, 2:] / (2.2 * high)
    seen: NDArray[np.float64] = space[:, :2] / depth + np.array([wide, high]) / 2
    return seen


def _desk(rng: np.random.Generator, wide: int, high: int) -> NDArray[np.float64]:
    palette = rng.integers(30, 220, (2, 3)).astype(np.float64)
    weight = _soft_noise(rng, wide, high)[..., None]
    grain = rng.normal(0, 6, (high, wide, 1))
    return np.asarray((weight * palette[0] + (1 - weight) * palette[1] + grain) / 255)


def _laid_over(
    light: NDArray[np.float64], print_: Image, seen: NDArray[np.float64], brightness: float
) -> tuple[NDArray[np.float64], Mask]:
    """Return the radiance with a print over it, and the pixels that the print covers."""
    height, width = print_.shape[:2]
    high, wide = light.shape[:2]
    source = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) - 0.5
    # Drawn twice as large and averaged: a camera's pixel is an area, not a point.
    warp = cv2.getPerspectiveTransform(source, (2 * seen + 0.5).astype(np.float32))
    double = (2 * wide, 2 * high)
    large = cv2.warpPerspective(print_, warp, double, flags=cv2.INTER_AREA)
    full = np.full((height, width), 255, np.uint8)
    cover = cv2.resize(
        cv2.warpPerspective(full, warp, double), (wide, high), interpolation=cv2.INTER_AREA
    )
    small = np.asarray(cv2.resize(large, (wide, high), interpolation=cv2.INTER_AREA), np.float64)
    share = (np.asarray(cover, np.float64) / 255)[..., None]
    return (1 - share) * light + brightness * small / 255, np.asarray(cover) > 127


def _illumination(rng: np.random.Generator, wide: int, high: int) -> NDArray[np.float64]:
    """Return the light (h, w, 3): a gradient, a tint that changes over it, and seldom a shine."""
    x, y = np.meshgrid(np.linspace(-1, 1, wide), np.linspace(-1, 1, high))
    slope = rng.normal(0, 0.18, 2)
    level = rng.uniform(0.6, 1.0) * np.clip(1 + slope[0] * x + slope[1] * y, 0.3, 1.6)
    tint = 1 + rng.normal(0, 0.05, 3) * x[..., None]
    light = level[..., None] * tint
    if rng.random() < 0.3:  # a lamp on the film around it
        at, width = rng.uniform(-0.8, 0.8, 2), rng.uniform(0.1, 0.3)
        shine = np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / width**2)
        light += rng.uniform(0.2, 0.9) * shine[..., None]
    return np.asarray(light)
