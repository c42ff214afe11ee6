"""Picture of what a robot of the lab without dynamics sees: places as boxes, things as discs."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import local_name

__all__ = ["draw_places"]

_WIDTH_PX, _ROW_PX, _RADIUS_PX = 320, 56, 14
_MAX_DISCS = 9
_WHITE, _GREY, _BLACK = (255, 255, 255), (235, 235, 230), (40, 40, 40)


def draw_places(there: Mapping[str, Sequence[str]]) -> bytes:
    """Return a PNG with a row for each place: its name, and a disc for each thing.

    A thing has the same colour in all pictures.

    Parameters
    ----------
    there
        IRIs of the things, by that of the place or hand.
    """
    shape = (max(_ROW_PX * len(there), 1), _WIDTH_PX, 3)
    image: NDArray[np.uint8] = np.full(shape, _WHITE, dtype=np.uint8)
    for row, (place, items) in enumerate(there.items()):
        top = row * _ROW_PX
        cv2.rectangle(image, (4, top + 4), (_WIDTH_PX - 5, top + _ROW_PX - 5), _GREY, -1)
        name = "/".join(place.rstrip("/").split("/")[-2:]) if "/hand" in place else place
        _write(image, local_name(name), (10, top + 18))
        for column, item in enumerate(items[:_MAX_DISCS]):
            centre = (24 + column * 34, top + 38)
            cv2.circle(image, centre, _RADIUS_PX - 2, _colour(item), -1, cv2.LINE_AA)
            _write(image, local_name(item)[-2:], (centre[0] - 6, centre[1] + 4))
    return bytes(cv2.imencode(".png", image)[1])


def _write(image: NDArray[np.uint8], text: str, at: tuple[int, int]) -> None:
    cv2.putText(image, text[:40], at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _BLACK, 1, cv2.LINE_AA)


def _colour(item: str) -> tuple[int, int, int]:
    """Return a light colour, blue, green, red, made of an IRI."""
    blue, green, red = hashlib.sha256(item.encode()).digest()[:3]
    return 128 + blue // 2, 128 + green // 2, 128 + red // 2
