"""One line an event, in plain words and with the names of the products."""

from __future__ import annotations

from typing import Any

import pytest

from simulate.demo.console import Console

MET = {"event": "recognised", "object": 4, "title": "carton-7", "recognised": "", "label": "",
       "confidence": 0.1}  # fmt: skip
TRIED = {
    "event": "attempt", "object": 4, "title": "carton-7", "number": 2, "source": "candidate",
    "physical": True, "held": True, "placed": True, "reason": "ok", "place_reason": "ok",
}  # fmt: skip


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (MET, "meets carton-7, which its graph does not know"),
        (
            {**MET, "recognised": "urn:o:1", "label": "carton-7", "confidence": 0.97},
            "recognises carton-7 (97 % sure)",
        ),
        (
            {**MET, "recognised": "urn:o:2", "label": "carton-9", "confidence": 0.8},
            "takes carton-7 for carton-9 (80 % sure)",
        ),
        (TRIED, "carton-7, attempt 2, grasp proposed from its shape: held and put into its box"),
        (
            {**TRIED, "source": "memory", "placed": False, "place_reason": "slip_transport"},
            "carton-7, attempt 2, remembered grasp: held, but it slipped out on the way",
        ),
        (
            {**TRIED, "held": False, "placed": False, "reason": "crushed", "place_reason": ""},
            "carton-7, attempt 2, grasp proposed from its shape: failed, it gave way under the "
            "fingers",
        ),
        (
            {**TRIED, "physical": False, "held": False, "reason": "ik", "place_reason": ""},
            "carton-7, attempt 2, grasp proposed from its shape: not tried, the hand could not "
            "reach it",
        ),
        (
            {"event": "missing", "object": 4, "title": "object 4", "last_seen": [0.1, 0.2]},
            "object 4 is gone; it was last seen at 0.10, 0.20 m",
        ),
        (
            {"event": "push", "object": 4, "title": "rod-1", "reason": "ok"},
            "pushes rod-1, which it cannot grasp as it lies",
        ),
        (
            {"event": "push", "object": 4, "title": "rod-1", "reason": "tracking"},
            "could not push rod-1, the arm left its planned path",
        ),
        (
            {"event": "found", "object": 4, "title": "rod-1", "where": "in the box"},
            "rod-1 is in the box",
        ),
    ],
)
def test_an_event_is_one_line_in_words(
    event: dict[str, Any], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Console(results=False).event("nao-2", event)
    assert capsys.readouterr().err == f"  nao-2: {said}\n"


def test_what_nobody_watches_for_is_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    Console(results=False).event("nao-2", {"event": "look", "side": "left"})
    assert capsys.readouterr().err == ""
