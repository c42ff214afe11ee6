"""The sentence of an answer says what would help, where a doubt is left."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from features.recognition.recogniser import Match, Recognition
from rtask.engine.perception.identity import settle, verdict

MUG = "https://example.org/lab/object/1"
KNOWN: Any = SimpleNamespace(objects={MUG: SimpleNamespace(label="mug")})


def _doubt(is_relit: bool, *, ask_again: bool = True) -> Recognition:
    look = {"inliers": 0, "views": (), "appearance": 0.8, "size_ok": True, "query_from_view": None}
    match = Match(MUG, "class:mug", 0.6, view_iri="view:1", is_in_other_light=is_relit, **look)
    return Recognition("single", False, (match,), ask_again=ask_again)


@pytest.mark.parametrize(
    ("is_relit", "sentence"),
    [
        (False, "may be mug; another view may decide"),
        (True, "may be mug in another light; a view stored in this light may decide"),
    ],
)
def test_a_doubt_names_what_may_decide(is_relit: bool, sentence: str) -> None:
    assert verdict(_doubt(is_relit), KNOWN) == sentence


def test_an_object_is_not_called_unlike_views_that_were_left_out() -> None:
    nothing = Recognition("null", False)
    assert verdict(nothing, KNOWN) == "resembles no stored object"
    left_out = (
        "resembles no object compared; not decided: 2 views that share its print were left out"
    )
    assert verdict(replace(nothing, views_untried=2), KNOWN) == left_out


def test_what_resembles_nothing_much_may_not_be_the_nearest() -> None:
    nearest = replace(_doubt(False, ask_again=False), outcome="null")
    assert verdict(nearest, KNOWN) == "resembles no stored object much; the nearest is mug"


def test_a_picture_that_shows_too_little_is_named_where_nothing_was_accepted() -> None:
    dark = np.full((40, 60, 3), 20, np.uint8)
    night: Any = SimpleNamespace(frame=SimpleNamespace(rgb=dark, doubts=()))
    said = verdict(Recognition("null", False), KNOWN, night)
    assert said.endswith("; the picture is dark; the picture has no colours")
    sure = replace(_doubt(False), accepted=True)
    assert verdict(sure, KNOWN, night) == "is mug"
    night.frame.doubts = ("it holds 2 pictures, of which the first is read",)
    assert verdict(sure, KNOWN, night).startswith("is mug; it holds 2 pictures")


def test_what_no_look_would_decide_says_nothing_of_the_light() -> None:
    assert verdict(_doubt(True, ask_again=False), KNOWN) == "may be mug"


def test_another_thing_in_the_picture_is_named_and_forgotten_with_the_first_match() -> None:
    cup = "https://example.org/lab/object/2"
    known: Any = SimpleNamespace(objects={**KNOWN.objects, cup: SimpleNamespace(label="cup")})
    first = _doubt(False).matches[0]
    both = (first, replace(first, object_iri=cup, confidence=0.1, beside="to the right"))
    answer = Recognition("single", True, both)
    said = "is mug; also looks like cup, to the right: give a box or mask of one of them"
    assert verdict(answer, known) == said
    nothing: Any = SimpleNamespace()
    only_cup: Any = SimpleNamespace(objects={cup: SimpleNamespace(label="cup", size=None)})
    settled = settle(answer, only_cup, nothing, nothing)
    assert "also" not in verdict(settled, only_cup)
