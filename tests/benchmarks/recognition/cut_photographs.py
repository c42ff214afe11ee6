"""Adapter of ``evaluate.py`` beside a collection of photographs: objects cut out by colour.

The protocol gives every photograph a mask by rule. Here GrabCut (``features.imaging.foreground``)
looks for the object inside that mask's box instead, as ``rtask recognise photo.jpg --box`` does; a
mask of the whole photograph stands for none, as in ``rtask recognise photo.jpg``.
"""

from __future__ import annotations

import time
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from features.imaging.foreground import find_foreground
from features.recognition import (
    Recogniser,
    RecognitionIndex,
    ViewFeatures,
    describe_view,
    warm_up,
)

__all__ = ["Cut", "CutByBestView"]

_REPORTED = 50
"""Queries between two lines about the progress: to cut takes longer than to recognise."""


class Cut:
    """Recogniser with the interface that ``evaluate.py`` expects."""

    def __init__(self) -> None:
        warm_up()
        self._cut, self._asked, self._seconds = 0, 0, 0.0
        self.start()

    def start(self) -> None:
        """Begin with an empty store."""
        self._index = RecognitionIndex()
        self._recogniser: Recogniser | None = None

    def describe(self, rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> ViewFeatures:
        """Describe what is cut out of a photograph."""
        box = None if mask.all() else cv2.boundingRect(mask.astype(np.uint8))
        start = time.process_time()
        found = find_foreground(rgb, box)
        self._seconds += time.process_time() - start
        self._cut += 1
        return replace(describe_view(rgb, found), is_mask_guessed=box is None)

    def add(self, name: str, described: ViewFeatures) -> None:
        """Store a view."""
        self._index.add(f"view:{len(self._index)}", name, "class:carton", described)

    def ask(self, described: ViewFeatures) -> tuple[str | None, float, bool]:
        """Return the name of the first answer, its confidence, and whether it was accepted."""
        if self._recogniser is None:
            self._index.save()
            self._recogniser = Recogniser(self._index)
        self._asked += 1
        if self._asked % _REPORTED == 0:
            share = 1e3 * self._seconds / self._cut
            print(f"asked {self._asked}; {self._cut} cut out, {share:.0f} ms CPU each")
        answer = self._recogniser.recognise(described)
        if not answer.matches:
            return None, 0.0, False
        return answer.matches[0].object_iri, answer.matches[0].confidence, answer.accepted


class CutByBestView(Cut):
    """The same, decided by the view of an object that agrees best, whatever its others say."""

    def describe(self, rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> ViewFeatures:
        """Describe what is cut out of a photograph, as if somebody had cut it out."""
        return replace(super().describe(rgb, mask), is_mask_guessed=False)
