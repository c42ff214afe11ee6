"""Two objects with one print are reported as such, and neither is accepted."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.comparison import twins as twins_module

Image = NDArray[np.uint8]


@pytest.fixture
def see(photograph_print):
    """Describe a print as a colour camera sees it, sharp or not."""

    def described(print_: Image, yaw: float, seed: int, blur: float = 0.0) -> ViewFeatures:
        shot = photograph_print(print_, yaw=yaw, tilt=0.2 + yaw / 2, distance=0.15, seed=seed)
        image = shot.image
        if blur:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), blur), np.uint8)
        return describe_view(image, shot.mask)

    return described


@pytest.fixture
def twins(see, print_image) -> Recogniser:
    """Print 1 under two names, one of them seen badly; print 2; and a sibling of print 1."""
    sibling = print_image(1).copy()
    sibling[180:, 240:] = print_image(3)[180:, 240:]
    index = RecognitionIndex()
    index.add("sharp", "a", "c", see(print_image(1), 0.1, seed=1))
    index.add("dim", "b", "c", see(print_image(1), 0.5, seed=2, blur=2.0))
    index.add("other", "d", "c", see(print_image(2), 0.1, seed=3))
    index.add("sibling", "e", "c", see(sibling, 0.1, seed=4))
    return Recogniser(index)


def test_one_print_under_two_names_is_told_and_a_sibling_is_not(twins):
    assert twins.same_print("sharp") == ("b",)
    assert twins.same_print("dim") == ("a",)
    assert twins.same_print("other") == ()
    assert twins.same_print("sibling") == ()
    assert twins.same_print("not stored") == ()


def test_sight_does_not_decide_between_two_names_of_one_print(twins, see, print_image):
    answer = twins.recognise(see(print_image(1), 0.1, seed=5))
    # Both are named; the sibling, seen more sharply than "b", may come between them.
    assert {"a", "b"} <= {match.object_iri for match in answer.matches}
    assert not answer.accepted
    assert answer.outcome == "multiple"
    twins.index.remove("dim")
    assert twins.recognise(see(print_image(1), 0.1, seed=5)).accepts("a")


def test_twins_that_become_one_object_are_recognised_again(twins, see, print_image):
    twins.index.relabel("dim", "a", "c")
    assert twins.same_print("sharp") == ()
    assert twins.recognise(see(print_image(1), 0.1, seed=5)).accepts("a")


def test_what_two_siblings_share_makes_no_twins_of_them_but_is_not_decided(see, print_image):
    sibling = print_image(1).copy()
    sibling[:, 240:] = print_image(3)[:, 240:]
    index = RecognitionIndex()
    for name, print_ in (("a", print_image(1)), ("b", sibling)):
        index.add(f"{name} whole", name, "c", see(print_, 0.1, seed=1))
        index.add(f"{name} turned", name, "c", see(print_, 0.4, seed=2))
        index.add(f"{name} shared", name, "c", see(print_[:, :240], 0.1, seed=3))
    recogniser = Recogniser(index)
    assert recogniser.same_print("a shared") == recogniser.same_print("b shared") == ()
    assert recogniser.recognise(see(print_image(1), 0.2, seed=4)).accepts("a")
    shared = recogniser.recognise(see(print_image(1)[:, :240], 0.0, seed=5))
    assert not shared.accepted


def test_a_twin_is_told_among_many_views_of_siblings_that_match_better(see, print_image):
    index = RecognitionIndex()
    index.add("sharp", "a", "c", see(print_image(1), 0.1, seed=1))
    index.add("dim", "twin", "c", see(print_image(1), 0.5, seed=2, blur=2.5))
    for k in range(4):
        sibling = print_image(1).copy()
        sibling[120 * (k % 3) : 120 * (k % 3) + 120, 320:] = print_image(5 + k)[:120, :160]
        for turn in range(3):
            view = see(sibling, 0.1 + 0.02 * turn, seed=10 * k + turn + 3)
            index.add(f"sibling {k}, view {turn}", f"sibling {k}", "c", view)
    assert Recogniser(index).same_print("sharp") == ("twin",)


def test_what_differs_between_its_matches_is_not_looked_at_again(
    tmp_path, see, print_image, monkeypatch
):
    sibling = print_image(1).copy()
    sibling[100:260, 150:330] = print_image(3)[100:260, 150:330]
    looks = []
    compare = twins_module.compare_pictures
    monkeypatch.setattr(
        twins_module, "compare_pictures", lambda *at: looks.append(at) or compare(*at)
    )
    with RecognitionIndex(tmp_path) as index:
        index.add("sharp", "a", "c", see(print_image(1), 0.1, seed=1))
        index.add("sibling", "b", "c", see(sibling, 0.1, seed=2))
        assert Recogniser(index).same_print("sharp") == ()
    assert len(looks) == 1
    with RecognitionIndex(tmp_path) as index:
        recogniser = Recogniser(index)
        assert recogniser.same_print("sharp") == ()
        assert len(looks) == 1
        index.add("sibling", "b", "c", see(print_image(1), 0.3, seed=3))  # replaced by a twin
        assert recogniser.same_print("sharp") == ("b",)
