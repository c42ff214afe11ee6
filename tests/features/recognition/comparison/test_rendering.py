"""Another camera's rendering of colours is no other print; a sibling's other colours are."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.comparison.confidence import print_score
from features.recognition.comparison.evidence import PrintEvidence
from features.recognition.comparison.rendering import rendered_gap

Image = NDArray[np.uint8]


def vivid(image: Image) -> Image:
    """Render colours as a phone does that saturates them by nearly half."""
    lab = np.asarray(cv2.cvtColor((image / 255).astype(np.float32), cv2.COLOR_RGB2LAB))
    lab[..., 1:] *= 1.45
    rgb = np.clip(np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2RGB)), 0, 1)
    return np.asarray(255 * rgb, np.uint8)


def other_colours(print_: Image) -> Image:
    """Return the print with red and green swapped in its upper half."""
    changed, half = print_.copy(), len(print_) // 2
    lab = np.asarray(cv2.cvtColor(print_, cv2.COLOR_RGB2LAB))
    lab[..., 1] = 255 - lab[..., 1]
    changed[:half] = np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2RGB))[:half]
    return changed


def muted(print_: Image) -> Image:
    """Return a print whose colours leave room for a camera that saturates them."""
    grey = print_.mean(axis=2, keepdims=True)
    return np.asarray(0.45 * print_ + 0.55 * grey, np.uint8)


@pytest.fixture
def phone(photograph_print):
    """Describe a print as a phone with vivid colours shows it."""

    def described(print_: Image) -> ViewFeatures:
        shot = photograph_print(print_, yaw=0.3, tilt=0.2, distance=0.15, seed=3)
        return describe_view(vivid(shot.image), shot.mask)

    return described


@pytest.mark.slow
def test_a_cover_stored_by_its_scan_is_recognised_in_the_colours_of_a_phone(
    phone, print_image
) -> None:
    cover = muted(print_image(0))
    index = RecognitionIndex()
    for name, print_ in (("cover", cover), ("else", muted(print_image(5)))):
        index.add(name, name, "class:cover", describe_view(print_, np.ones(cover.shape[:2], bool)))
    recogniser = Recogniser(index)
    seen = phone(cover)
    (printed,) = [
        found.printed.evidence
        for found in recogniser.gather(seen, index.snapshot())
        if found.printed is not None
        and index.snapshot().object_iris[found.object_number] == "cover"
    ]
    assert printed.colour_contradiction > 0.06  # as they are, the colours differ
    assert recogniser.recognise(seen).accepts("cover")
    assert not recogniser.recognise(phone(other_colours(cover))).accepted
    assert not recogniser.recognise(replace(seen, is_mask_guessed=True)).accepted


def test_turned_hues_and_another_saturation_leave_no_gap() -> None:
    there = np.random.default_rng(1).normal(0, 25, (12, 12, 2)).astype(np.float32)
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    every = np.ones((12, 12), bool)
    here = (1.3 * there @ turn.T + 4).astype(np.float32)
    gap = rendered_gap(here, there, every)
    assert gap is not None
    assert gap.max() < 3
    here[:5] *= -1  # a sibling: other colours in less than half of it
    gap = rendered_gap(here, there, every)
    assert gap is not None
    assert np.median(gap[:5]) > 15
    assert np.median(gap[5:]) < 3


def test_few_agreeing_cells_say_nothing_of_the_camera() -> None:
    cells = np.zeros((12, 12, 2), np.float32)
    assert rendered_gap(cells, cells, np.eye(12, k=3, dtype=bool)) is None


_PART = PrintEvidence(
    60, 0.2, 3.0, 0.8, 0.9, 0.0, 0.5, 50, 0.6, 0.5, supported=1.0, agreeing=1.0,
    correlation=0.8, seen=0.4, verified=4,
)  # fmt: skip


def test_a_part_that_agrees_well_decides_with_a_doubt_under_a_mask_alone() -> None:
    whole = print_score(replace(_PART, extent=0.25))
    assert 0.85 < print_score(_PART) < whole
    assert print_score(_PART, is_mask_guessed=True) <= 0
    assert print_score(replace(_PART, extent=0.15)) <= 0
    assert print_score(replace(_PART, median=0.7)) <= 0
