"""Two stored things in one picture: one comes first, and the other is said to lie beside it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from features.recognition import Recogniser, RecognitionIndex, describe_view, fuse
from features.recognition.recogniser import Match, Recognition
from tests.features.recognition.conftest import photograph, print_of

Picture = NDArray[np.uint8]


def _recogniser(prints: list[Picture]) -> Recogniser:
    index = RecognitionIndex()
    for number, texture in enumerate(prints):
        shot = photograph(texture, seed=number)
        view = describe_view(shot.image, shot.mask)
        index.add(f"view:{number}", f"object:{number}", "class:card", view)
    return Recogniser(index)


def _asked(recogniser: Recogniser, picture: Picture) -> Recognition:
    return recogniser.recognise(describe_view(picture, np.ones(picture.shape[:2], bool)))


@pytest.fixture(scope="module")
def prints() -> list[Picture]:
    return [print_of(seed) for seed in range(3)]


@pytest.mark.parametrize(
    ("axis", "places"), [(1, ("to the right", "to the left")), (0, ("below", "above"))]
)
def test_the_other_thing_is_named_with_its_side(
    prints: list[Picture], axis: int, places: tuple[str, str]
) -> None:
    recogniser = _recogniser(prints)
    shots = [photograph(prints[k], yaw=0.2, seed=20 + k).image for k in range(2)]
    answer = _asked(recogniser, np.concatenate(shots, axis=axis))
    first = answer.matches[0]
    assert first.object_iri in ("object:0", "object:1")
    assert first.beside == ""
    beside = {match.object_iri: match.beside for match in answer.matches[1:] if match.beside}
    other, place = (1, places[0]) if first.object_iri == "object:0" else (0, places[1])
    assert beside == {f"object:{other}": place}


def test_a_single_thing_has_none_beside_it_though_another_shares_half_of_its_print(
    prints: list[Picture],
) -> None:
    sibling = prints[0].copy()
    sibling[:, 240:] = prints[2][:, 240:]
    recogniser = _recogniser([prints[0], sibling])
    answer = _asked(recogniser, photograph(prints[0], yaw=0.2, seed=20).image)
    assert len(answer.matches) == 2  # the sibling is in the answer, in the same place
    assert [match.beside for match in answer.matches] == ["", ""]


def test_of_several_looks_the_side_is_that_of_the_first_with_the_same_object_in_front() -> None:
    def look(first: str, second: str, beside: str) -> Recognition:
        kept = {"views": (), "appearance": 0.9, "size_ok": None, "query_from_view": None}
        matches = (
            Match(first, "class:card", 0.9, 40, view_iri="view:1", **kept),
            Match(second, "class:card", 0.2, 30, view_iri="view:2", beside=beside, **kept),
        )
        return Recognition("single", True, matches)

    same = fuse([look("a", "b", "above"), look("a", "b", "to the left")])
    assert [match.beside for match in same.matches] == ["", "above"]
    changed = fuse([look("b", "a", "above"), look("a", "b", ""), look("a", "c", "below")])
    assert changed.matches[0].object_iri == "a"
    assert not any(match.beside for match in changed.matches)
