"""Cartons that differ in one word, and a stand-in for a reader that finds words in their pixels."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from features.words.word import Word

__all__ = ["FLAVOURS", "StandInReader", "carton", "photograph"]

FLAVOURS = ("VANILJ", "NATURELL")
_WIDTH, _HEIGHT = 300, 220
_LABEL = (70, 96, 160, 28)
"""Left, top, width and height of the field with the flavour."""


def label(text: str) -> NDArray[np.uint8]:
    """Return a field with a word, black on white, (h, w) uint8."""
    _, _, width, height = _LABEL
    field = np.full((height, width), 255, np.uint8)
    cv2.putText(field, text, (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.75, 0, 2, cv2.LINE_AA)
    return field


def carton(flavour: str, brand: int = 0) -> NDArray[np.uint8]:
    """Return the front of a carton: the artwork of its brand, and a word."""
    rng = np.random.default_rng([7, brand])
    palette = rng.integers(0, 256, (5, 3))
    image = np.full((_HEIGHT, _WIDTH, 3), palette[0], np.uint8)
    for radius in np.sort(rng.uniform(4, 26, 260))[::-1]:
        centre = rng.uniform((0, 0), (_WIDTH, _HEIGHT))
        angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 7))))
        corners = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        colour = palette[rng.integers(5)].tolist()
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], colour, cv2.LINE_AA)
    if flavour:
        left, top, width, height = _LABEL
        image[top : top + height, left : left + width] = label(flavour)[..., None]
    return image


def photograph(front: NDArray[np.uint8], seed: int) -> tuple[NDArray[np.uint8], list[int]]:
    """Return a photograph of a carton on a grey desk, and the box around it."""
    rng = np.random.default_rng([13, seed])
    left, top = rng.integers(20, 60, 2).tolist()
    image = np.full((_HEIGHT + 80, _WIDTH + 80, 3), 120, np.uint8)
    image[top : top + _HEIGHT, left : left + _WIDTH] = front
    noisy = image + rng.normal(0, 2, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), [left, top, _WIDTH, _HEIGHT]


class StandInReader:
    """Finds the labels of the cartons in a picture, as a reader of print would.

    Parameters
    ----------
    score
        Confidence of what it reads.
    """

    name = "stand-in 1"

    def __init__(self, score: float = 0.97, words: Sequence[str] = FLAVOURS) -> None:
        self.score = score
        self.words = words
        self.pictures = 0

    def read(self, rgb: NDArray[np.uint8]) -> list[Word]:
        """Return each label that the picture shows."""
        self.pictures += 1
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        found = []
        for text in self.words:
            field = label(text)
            if grey.shape[0] < field.shape[0] or grey.shape[1] < field.shape[1]:
                continue
            _, best, _, place = cv2.minMaxLoc(cv2.matchTemplate(grey, field, cv2.TM_CCOEFF_NORMED))
            if best > 0.9:
                height, width = field.shape
                centre = (place[0] + width / 2, place[1] + height / 2)
                found.append(Word(text, self.score, centre, float(width), float(height), 0.0))
        return found
