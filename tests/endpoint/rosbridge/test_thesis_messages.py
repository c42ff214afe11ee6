"""The four messages of Gatto 2016, 3.2.4, word for word; only the commas are mended."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from rtask.kb.commit.access import Access

Connect = Callable[..., Any]

SEARCH = """
{ "op": "search_object",
  "service": "send_point_cloud",
  "args": "zc5p81H1cO8P+Ksmfdf..." }
"""
INSERT = """
{ "op": "send_new_object",
  "service": "insert",
  "new_object":
  [
    {"new_point_cloud": "zc5p81H1cO8P+Ksmfdf...",
     "X": "0.5", "Y": "2.5", "Z": "1.5", "rad": "0.314"}
  ]
}
"""
UNMENDED = """
{ "op": "search_object"
  "service": "send_point_cloud",
  "args": "zc5p81H1cO8P+Ksmfdf...",
}
"""


def with_a_cloud(message: str) -> str:
    """The printed payload is cut off and decodes to nothing; put another in its place."""
    return message.replace("zc5p81H1cO8P+Ksmfdf...", "cGx5Cg==")


def test_search_object_answers_as_printed_with_numbers_for_strings(connect: Connect) -> None:
    answer = connect().ask(with_a_cloud(SEARCH))
    assert answer["op"] == "search_object_response"
    assert answer["service"] == "query"
    assert answer["result"] is True
    found = answer["similar_objects"]
    assert {name: found[0][name] for name in ("class", "X", "Y", "Z", "rad")} == {
        "class": "1",
        "X": 0.5,
        "Y": 2.5,
        "Z": 1.5,
        "rad": 0.314,
    }


def test_objects_without_a_grasp_are_left_out_of_the_thesis_answer(connect: Connect) -> None:
    found = connect().ask(with_a_cloud(SEARCH))["similar_objects"]
    assert [entry["class"] for entry in found] == ["1"]


def test_the_printed_payload_is_refused_as_no_point_cloud(connect: Connect) -> None:
    assert connect().ask(SEARCH) == {
        "op": "search_object_response",
        "service": "query",
        "result": False,
        "error": "args: not a point cloud (unknown first bytes)",
        "similar_objects": [],
    }


def test_send_new_object_stores_with_the_strings_as_numbers(connect: Connect, engine: Any) -> None:
    answer = connect().ask(with_a_cloud(INSERT))
    assert answer == {
        "op": "send_new_object_response",
        "service": "insert",
        "result": True,
        "stored": 1,
        "objects": [{"object": "urn:object:0", "class": "4", "new": True, "features": 212}],
    }
    (name, args, _) = engine.asked[-1]
    assert name == "insert_object"
    assert args == {"objects": [{"data": "cGx5Cg==", "X": 0.5, "Y": 2.5, "Z": 1.5, "rad": 0.314}]}


def test_a_number_that_is_none_is_named(connect: Connect) -> None:
    message = json.loads(with_a_cloud(INSERT))
    message["new_object"][0]["rad"] = "a third"
    answer = connect().ask(message)
    assert answer["result"] is False
    assert answer["error"] == "new_object[0].rad: 'a third' is not a number"
    assert answer["objects"] == []


def test_an_id_is_echoed_when_one_is_given(connect: Connect) -> None:
    message = {**json.loads(with_a_cloud(SEARCH)), "id": "t-1"}
    assert connect().ask(message)["id"] == "t-1"


def test_the_unmended_text_is_refused_with_line_and_column(connect: Connect) -> None:
    status = connect().ask(UNMENDED)
    assert status["op"] == "status"
    assert "line 3, column 3" in status["msg"]


def test_a_reader_cannot_insert(connect: Connect, engine: Any) -> None:
    answer = connect(Access(None, "reader")).ask(with_a_cloud(INSERT))
    assert answer["result"] is False
    assert "needs scope write" in answer["error"]
    assert engine.asked == []
