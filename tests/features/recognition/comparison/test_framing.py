"""What surrounds an object that a picture shows whole is no part of it that is missing."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from features.recognition import describe_view
from features.recognition.comparison.alignment import align_views
from features.recognition.comparison.confidence import has_same_colours, print_score
from features.recognition.comparison.difference import Comparison, compare_pictures
from features.recognition.comparison.evidence import PrintEvidence
from features.recognition.views.picture import ViewPicture


def laid_over(print_: np.ndarray, left: int) -> Comparison:
    """Compare a print with a picture of 900 x 700 px that shows it from a column on."""
    desk = np.full((700, 900, 3), 120, np.uint8)
    shown = print_[:, max(-left, 0) : 900 - left]
    desk[150 : 150 + len(print_), max(left, 0) : max(left, 0) + shown.shape[1]] = shown
    query, view = (describe_view(image, np.ones(image.shape[:2], bool)) for image in (desk, print_))
    found = align_views(query, view, query.side_px)
    assert found is not None
    pictures = (ViewPicture.from_bytes(each.picture) for each in (query, view))
    places = query.keypoints[found.query_rows, :2]
    return compare_pictures(*pictures, found.query_from_view, places)


def test_a_print_that_is_small_in_its_picture_has_its_own_extent(print_image) -> None:
    small = cv2.resize(print_image(0), (320, 240), interpolation=cv2.INTER_AREA)
    whole = laid_over(small, 300)
    assert whole.framed_extent > 1.8 * whole.extent > 0
    # Of one that is cut, what is missing may be what a sibling differs in.
    assert laid_over(small, -150).framed_extent == 0


FRAMED = PrintEvidence(
    60, 0.2, 3.0, 0.8, 0.9, 0.0, 0.5, 50, 0.6, 0.5, lead=2.0, rendered_contradiction=0.0,
    framed_extent=0.5,
)  # fmt: skip


@pytest.mark.parametrize("change", [{"verified": 2}, {"unlike": 1}])
def test_the_frame_counts_for_the_only_view_of_an_object(change: dict[str, int]) -> None:
    bare = replace(FRAMED, framed_extent=0.0)
    assert print_score(FRAMED) > print_score(bare) + 3
    assert has_same_colours(FRAMED)
    assert not has_same_colours(bare)
    # A mask that was guessed says nothing of what it leaves out, and other views say it better.
    assert print_score(FRAMED, is_mask_guessed=True) == print_score(bare, is_mask_guessed=True)
    assert print_score(replace(FRAMED, **change)) == print_score(replace(bare, **change))
