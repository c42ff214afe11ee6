"""Where the mask is a guess, one stored view that shows the common part does not decide alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from features.codec import decode, encode_frame
from features.imaging.photo import Photo
from features.imaging.selection import frame_of_photo
from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.comparison.all_views import agreement_of_views

pytestmark = pytest.mark.slow

COMMON_ROWS = 285
"""Of a print of 360 x 480 px: what two flavours share."""
HAND = (255, 0, 255)


@pytest.fixture(scope="module")
def flavours(print_image, photograph_print):
    """Return a store of one flavour, in one view its own part hidden, and a query of each."""
    vanilla, strawberry = print_image(21), print_image(22)
    strawberry[:COMMON_ROWS] = vanilla[:COMMON_ROWS]
    covered = vanilla.copy()
    covered[COMMON_ROWS:] = HAND

    def view(print_, side: int) -> ViewFeatures:
        how = {"yaw": 0.25 * side - 0.3, "tilt": 0.15 + 0.1 * side, "distance": 0.15, "seed": side}
        shot = photograph_print(print_, **how)
        is_hand = np.abs(shot.image.astype(int) - HAND).max(axis=2) < 40
        return describe_view(shot.image, shot.mask & ~is_hand)

    index = RecognitionIndex()
    for side in range(4):
        index.add(f"view:{side}", "vanilla", "carton", view(vanilla, side))
    index.add("view:covered", "vanilla", "carton", view(covered, 2))
    index.save()
    own, sibling = (replace(view(p, 2), is_mask_guessed=True) for p in (vanilla, strawberry))
    return Recogniser(index), own, sibling


def test_the_sibling_of_a_partly_covered_view_agrees_less_with_all(flavours) -> None:
    recogniser, own, sibling = flavours
    snapshot = recogniser.index.snapshot()
    shares = [agreement_of_views(q, snapshot, recogniser._facts, 0) for q in (own, sibling)]
    assert None not in shares
    # A fifth of the print is another one, and four views of five show it: .05 is half of that.
    assert shares[0] > 0.9
    assert shares[1] < shares[0] - 0.05


def test_only_a_guessed_mask_lets_all_views_speak(flavours) -> None:
    recogniser, own, sibling = flavours
    odds = {}
    for name, query in (("own", own), ("sibling", sibling)):
        for is_guessed in (False, True):
            asked = replace(query, is_mask_guessed=is_guessed)
            first = recogniser.gather(asked, recogniser.index.snapshot())[0]
            odds[name, is_guessed] = first.evidence.print_odds
    assert odds["own", True] != odds["own", False]
    assert odds["sibling", True] < odds["sibling", False]
    assert recogniser.recognise(own).accepted


def test_the_guess_is_kept_from_the_photograph_to_the_server(flavours) -> None:
    _, own, _ = flavours
    assert ViewFeatures.from_bytes(own.to_bytes()).is_mask_guessed
    given = replace(own, is_mask_guessed=False)
    assert not ViewFeatures.from_bytes(given.to_bytes()).is_mask_guessed
    rgb = np.full((40, 40, 3), 90, np.uint8)
    rgb[12:28, 12:28] = 200
    photo = Photo(rgb, (40, 40))
    guessed = frame_of_photo(photo)
    assert guessed.is_mask_guessed
    assert decode(encode_frame(guessed)).is_mask_guessed
    assert not decode(encode_frame(replace(guessed, is_mask_guessed=False))).is_mask_guessed
    assert not frame_of_photo(photo, box=[10, 10, 20, 20]).is_mask_guessed
    assert not frame_of_photo(photo, labels=np.ones((40, 40), np.int32)).is_mask_guessed
