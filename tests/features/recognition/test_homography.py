"""How many matches agree on one homography, against truth and against OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from features.recognition.homography import count_agreeing

LEAST, TOLERANCE_PX = 15, 4.0


def matches(rng: np.random.Generator, agreeing: int, astray: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places of 640 x 480 pixels, and where a random view of the plane shows them.

    Those that agree are off by a pixel; those astray lie anywhere.
    """
    size = np.array([640.0, 480.0])
    corners = np.array([[0, 0], [640, 0], [640, 480], [0, 480]], np.float32)
    seen = corners * 0.7 + 80 + rng.uniform(-70, 70, (4, 2)).astype(np.float32)
    mapping = cv2.getPerspectiveTransform(corners, seen)
    source = rng.uniform(0, 1, (agreeing + astray, 2)) * size
    target = cv2.perspectiveTransform(source[:, None], mapping)[:, 0]
    target += rng.normal(0, 1, target.shape)
    target[agreeing:] = rng.uniform(0, 1, (astray, 2)) * size
    order = rng.permutation(len(source))
    return source[order].astype(np.float32), target[order].astype(np.float32)


@pytest.mark.parametrize("astray", [0, 10, 20])
def test_matches_of_a_plane_agree_however_many_lie_elsewhere(astray: int) -> None:
    rng = np.random.default_rng(astray)
    counts = [count_agreeing(*matches(rng, 20, astray), LEAST, TOLERANCE_PX) for _ in range(50)]
    # Noise of a pixel each way leaves all but one in 3,000 within 4; one draw in 1,000 may miss.
    assert min(counts) >= 18
    # Some astray land where the map would put them: each with a chance of 1 in 6,000.
    assert max(counts) <= 20 + (2 if astray else 0)


def test_matches_at_random_do_not_agree() -> None:
    rng = np.random.default_rng(4)
    counts = [count_agreeing(*matches(rng, 0, 30), LEAST, TOLERANCE_PX) for _ in range(50)]
    assert max(counts) < LEAST


def test_it_counts_no_fewer_pairs_than_opencv() -> None:
    rng = np.random.default_rng(6)
    ours = theirs = 0
    for _ in range(60):
        source, target = matches(rng, 17, 15)
        ours += count_agreeing(source, target, LEAST, TOLERANCE_PX) >= LEAST
        agreed = cv2.findHomography(source, target, cv2.USAC_FAST, TOLERANCE_PX)[1]
        theirs += agreed is not None and int(agreed.sum()) >= LEAST
    assert ours >= theirs - 2  # releases of OpenCV draw differently
    assert ours >= 57  # of 60; draws of a noisy map may all be bad


def test_a_mirror_image_does_not_agree() -> None:
    places = np.random.default_rng(7).uniform(0, 400, (30, 2))
    assert count_agreeing(places, places * [-1, 1] + [400, 0], LEAST, TOLERANCE_PX) < LEAST


@pytest.mark.parametrize("places", [np.zeros((30, 2)), np.c_[np.arange(30.0), np.arange(30.0)]])
def test_points_on_a_spot_or_line_are_no_homography(places: np.ndarray) -> None:
    assert count_agreeing(places, places, LEAST, TOLERANCE_PX) == 0


def test_fewer_matches_than_asked_for_cannot_agree() -> None:
    places = np.random.default_rng(8).uniform(0, 400, (14, 2))
    assert count_agreeing(places, places, LEAST, TOLERANCE_PX) == 0


def test_any_four_agree_so_fewer_than_five_are_no_question() -> None:
    with pytest.raises(ValueError, match="least is 4"):
        count_agreeing(np.zeros((9, 2)), np.zeros((9, 2)), 4, TOLERANCE_PX)
