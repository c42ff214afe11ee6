"""The image of Object M with its contour and the grasps that were carried out (Fig. 3.21)."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simulate.robots.description import Floats
from simulate.study.pushes.plug import chosen, first_contact, to_pixels
from simulate.study.pushes.trial import planned

__all__ = ["draw_pushes"]

_SCALE, _CROP_PX = 2, 150
_CONTOUR = (40, 200, 240)
_COLOURS = ((60, 170, 40), (220, 130, 30), (40, 40, 220))
_TAIL_M = 0.015


def draw_pushes(path: Path, seed: int, preset: str) -> None:
    """Write a PNG: for each grasp the contour, the first jaw and the direction of its push."""
    plan, pixels, jaw, stroke = planned(seed, preset)
    middle = to_pixels(plan.part.centroid[None])[0]
    low = np.rint(middle).astype(int) - _CROP_PX
    large = np.repeat(np.repeat(pixels[..., ::-1], _SCALE, axis=0), _SCALE, axis=1)
    panels = []
    for number, index in enumerate(chosen(plan, jaw, stroke)):
        image = large.copy()
        _lines(image, plan.part.vertices, _CONTOUR, closed=True)
        along = plan.grasps.approaches[index]
        face = plan.grasps.jaw(index, jaw) + first_contact(plan, index, jaw) * along
        back = face.mean(axis=0) - _TAIL_M * along
        _lines(image, face, _COLOURS[number], thick=6)
        _lines(image, np.stack([back, face.mean(axis=0)]), _COLOURS[number], thick=2)
        size = 2 * _CROP_PX * _SCALE
        x, y = (low * _SCALE).tolist()
        panel = np.ascontiguousarray(image[y : y + size, x : x + size])
        caption = f"{number + 1}: Q = {100 * plan.analysis.quality[index]:.1f}"
        cv2.putText(panel, caption, (16, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.0, (255, 255, 255), 2,
                    cv2.LINE_AA)  # fmt: skip
        panels.append(panel)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.hstack(panels))


def _lines(
    image: NDArray[np.uint8], points: Floats, colour: tuple[int, int, int], *, thick: int = 2,
    closed: bool = False,
) -> None:  # fmt: skip
    places = np.rint(_SCALE * to_pixels(points)).astype(np.int32)
    cv2.polylines(image, [places], closed, colour, thick, cv2.LINE_AA)
