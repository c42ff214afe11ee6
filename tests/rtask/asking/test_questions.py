"""Questions in words: understood by words and names, answered with query, table and sentence."""

from __future__ import annotations

import datetime as dt

import pytest

import rtask
from rtask.asking.questions import answer
from rtask.asking.questions.answering import CLEARLY, MAX_ROWS
from rtask.asking.questions.catalogue import questions
from rtask.asking.questions.filling import filled_query
from rtask.asking.questions.mentions import find_mentions
from rtask.errors import UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.sparql.syntax import check_query

NOW = dt.datetime(2026, 1, 1, 12, tzinfo=dt.UTC)


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ("Where is the mug?", "cq22", "Mug is at 0.5, 0, 0.8 in camera_depth_optical_frame"),
        ("where are the mugs now", "cq22", "Mug is at 0.5, 0, 0.8 in camera_depth_optical_frame"),
        ("something to write with", "cq24", "Pen is something to write"),
        ("which robot can hold pens?", "cq03", "Nao can grasp pen; pr2 can grasp pen."),
        ("why did nao refuse the mug?", "cq21", "Nao refused mug: the pose confidence 0.4"),
        ("wich boxes are there?", "cq04", "Boxes: box."),
        ("how many boxes are there?", "cq04", "1 known. Boxes: box."),
        ("how often did nao fail?", "eq01", "Nao tried 3 times, 0 held, 3 failed."),
        ("how many robots can hold the mug?", "cq03", "1 known. Pr2 can grasp mug."),
        ("red pens", "cq25", "Pen is red; pen is blue"),
        ("which things are slippery?", "cq25", "Mug is slippery; mug is white"),
        ("what colour is the mug?", "cq25", "Mug is white"),
        ("how heavy is the mug?", "cq27", "Mug weighs 0.3 kg"),
        ("how wide is the pen?", "cq28", "Pen, a hand must open 0.01 m"),
        ("which hand does nao have?", "cq29", "Nao has nao_hand, which opens 0.05 m"),
        ("what do robots believe about the mug?", "eq21", "Mug: "),
        ("a heavy tool", "cq25", "The graph states nothing that answers this"),
        ("Where is <https://w3id.org/rtask-kg/kb/sample/mug>?", "cq22", "Https://"),
    ],
)
def test_the_nearest_question_is_answered(
    kb: KnowledgeBase, text: str, key: str, said: str
) -> None:
    found = answer(kb, text, now=NOW)
    assert (found.key, found.nearest[0].key) == (key, key)
    for clause in said.lower().rstrip(".").split("; "):  # the query states no order of its rows
        assert clause in found.sentence.lower()
    check_query(found.sparql)


_CALLED = """PREFIX rt: <https://w3id.org/rtask-kg/ns#>
INSERT DATA {
  <urn:nao> a rt:Nao ; rt:name "nao-1" . <urn:panda> a rt:ManipulatorRobot ; rt:name "panda-1" .
  <urn:5> a rt:Box ; rt:name "carton-5" .
  <urn:6> a rt:ManipulableObject ; rt:name "carton-6" .
  <urn:7> a rt:ManipulableObject ; rt:name "carton opener" .
  <urn:t1> rt:handles <urn:5> ; rt:through <urn:a1> .
  <urn:a1> a rt:GraspAttempt ; rt:performedBy <urn:panda> ; rt:hasOutcome <urn:o1> .
  <urn:o1> rt:success true ; rt:hasReason rt:reason_ok .
  <urn:t2> rt:handles <urn:6> ; rt:through <urn:a2>, <urn:a3>, <urn:a4> .
  <urn:a2> a rt:GraspAttempt ; rt:performedBy <urn:nao> ; rt:hasOutcome <urn:o2> .
  <urn:o2> rt:success false ; rt:hasReason rt:reason_missed .
  <urn:a3> a rt:GraspAttempt ; rt:performedBy <urn:nao> ; rt:hasOutcome <urn:o3> .
  <urn:o3> rt:success false ; rt:hasReason rt:reason_crushed .
  <urn:a4> a rt:GraspAttempt ; rt:performedBy <urn:nao> ; rt:hasOutcome <urn:o4> .
  <urn:o4> rt:success true ; rt:hasReason rt:reason_ok .
  <urn:t3> rt:handles <urn:7> ; rt:through <urn:a5> .
  <urn:a5> a rt:GraspAttempt ; rt:performedBy <urn:panda> ; rt:hasOutcome <urn:o5> .
  <urn:o5> rt:success false ; rt:hasReason rt:reason_missed .
}"""


def test_what_is_called_a_kind_belongs_to_it_in_a_question() -> None:
    """Of carton-6 nobody stated that it is a carton; a carton opener is none."""
    with rtask.open(":memory:", reason=False) as kb:
        kb.update(_CALLED)
        failing = answer(kb, "which robot fails at cartons, and why?")
        listed = answer(kb, "which cartons are there?")
        where = answer(kb, "where are the cartons?")
    assert failing.key == "eq25"
    said, _, reasons = failing.sentence.rstrip(".").partition(": ")
    assert said == "Nao-1 failed at carton-6 in 2 of 3 attempts"
    assert sorted(reasons.split(", ")) == ["crushed", "missed"]  # a set has no order
    assert listed.sentence == (
        "Cartons: carton-5. Called so, but not known to be of that kind: carton-6."
    )
    assert where.filled["object"][0] == "cartons"
    assert "<urn:6>" in where.sparql
    assert "<urn:7>" not in where.sparql


_SHARED = """PREFIX rt: <https://w3id.org/rtask-kg/ns#>
PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX time: <http://www.w3.org/2006/time#>
PREFIX cora: <http://purl.org/ieee1872-owl/cora-bare#>
INSERT DATA {
  <urn:nao> a cora:Robot ; rt:name "nao-1" .
  <urn:panda> a cora:Robot ; rt:name "panda-1" .
  <urn:5> a rt:ManipulableObject ; rt:name "carton-5" .
  <urn:5/thing-ab12> a rt:ManipulableObject ; rt:exemplarOf <urn:5> .
  <urn:box> a rt:SupportSurface ; rt:name "left box" .
  <urn:g1> a rt:GraspConfiguration ; rt:gripperType "nao_hand" .
  <urn:g2> a rt:GraspConfiguration ; rt:gripperType "panda_hand" ; prov:wasDerivedFrom <urn:g1> .
  <urn:t1> rt:handles <urn:5> ; rt:through <urn:a1> .
  <urn:a1> a rt:GraspAttempt ; rt:performedBy <urn:nao> ; rt:executesGrasp <urn:g1> ;
    prov:endedAtTime "2026-01-01T08:00:00Z"^^xsd:dateTime ; rt:hasOutcome <urn:o1> .
  <urn:o1> rt:success true .
  <urn:t2> rt:handles <urn:5> ; rt:through <urn:a2> .
  <urn:a2> a rt:GraspAttempt ; rt:performedBy <urn:panda> ; rt:executesGrasp <urn:g2> ;
    prov:endedAtTime "2026-01-01T09:00:00Z"^^xsd:dateTime ; rt:hasOutcome <urn:o2> .
  <urn:o2> rt:success false .
  <urn:p> rt:placementOf <urn:5/thing-ab12> ; rt:placedIn <urn:box> ;
    prov:wasAttributedTo <urn:nao> ; time:hasBeginning <urn:b> ; time:hasEnd <urn:e> .
  <urn:b> time:inXSDDateTimeStamp "2025-12-30T08:00:00Z"^^xsd:dateTimeStamp .
  <urn:e> time:inXSDDateTimeStamp "2026-01-01T10:30:00Z"^^xsd:dateTimeStamp .
}"""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("what did panda-1 learn from nao-1?", "Panda-1 grasped carton-5 as nao-1 had: not"),
        ("who moved carton-5 last?", "Panda-1 grasped carton-5 last, 2026-01-01 09:00:00Z: not"),
        ("how did a nao grasp carton-5?", "Nao-1 grasped carton-5 by nao_hand: held."),
        (
            "where was carton-5 yesterday?",
            "Carton-5 (ab12) was in or on left box from 2025-12-30 08:00:00Z "
            "until 2026-01-01 10:30:00Z, says nao-1.",
        ),
        ("where was carton-5 in the last hour?", "The graph states nothing that answers this"),
        ("what was in the left box today?", "Carton-5 (ab12) was in or on left box"),
    ],
)  # fmt: skip
def test_questions_about_what_robots_share_and_moved(text: str, said: str) -> None:
    with rtask.open(":memory:", reason=False) as kb:
        kb.update("PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>\n" + _SHARED)
        found = answer(kb, text, now=NOW)
    assert found.sentence.startswith(said), (found.key, found.sentence)


def test_two_robots_of_one_question_are_both_told(kb: KnowledgeBase) -> None:
    filled = answer(kb, "what did nao learn from pr2?", now=NOW).filled
    assert (filled["robot"][0], filled["robot 2"][0]) == ("nao", "pr2")


@pytest.mark.parametrize(
    ("text", "key", "count"),
    [
        ("how many cartons are there?", "cq04", 1),
        ("number of boxes", "cq04", 1),
        ("how many objects have never been held?", "eq12", 2),
        ("which objects have never been held?", "eq12", None),
    ],
)
def test_a_question_that_counts_is_answered_with_a_number(
    text: str, key: str, count: int | None
) -> None:
    with rtask.open(":memory:", reason=False) as kb:
        kb.update(
            _CALLED + "; DELETE DATA { <urn:o4> <https://w3id.org/rtask-kg/ns#success> true }"
        )
        found = answer(kb, text)
    assert (found.key, found.count) == (key, count)
    assert found.to_dict()["count"] == count


def test_more_things_than_rows_are_shown_are_counted_by_the_graph() -> None:
    with rtask.open(":memory:", reason=False) as kb:
        boxes = " ".join(f"<urn:{n}> a rt:Box ." for n in range(MAX_ROWS + 7))
        kb.update(f"PREFIX rt: <https://w3id.org/rtask-kg/ns#> INSERT DATA {{ {boxes} }}")
        found = answer(kb, "how many boxes are there?")
    assert (found.count, len(found.rows)) == (MAX_ROWS + 7, MAX_ROWS)
    assert found.sentence.startswith(f"{MAX_ROWS + 7} known. Boxes: ")


@pytest.mark.parametrize("text", ["how many sensors are there?", "how many kilos can pr2 lift?"])
def test_what_cannot_be_counted_gets_no_other_answer(kb: KnowledgeBase, text: str) -> None:
    found = answer(kb, text)
    assert not found.is_understood
    assert "cannot be counted here" in found.sentence


def test_what_is_as_near_to_two_questions_is_not_answered_with_one_of_them(
    kb: KnowledgeBase,
) -> None:
    found = answer(kb, "what is known of grasps?")
    first, second = found.nearest[:2]
    assert first.likeness - second.likeness < CLEARLY
    assert not found.is_understood
    assert (
        found.sentence == f"That can mean: {first.question} Or: {second.question} Ask one of them."
    )
    assert answer(kb, second.question).key == second.key


def test_a_name_restricts_the_answer_and_is_shown(kb: KnowledgeBase) -> None:
    everyone = answer(kb, "which robot can grasp which object?")
    nao = answer(kb, "which object can nao grasp?")
    assert len(nao.rows) < len(everyone.rows)
    assert {row.value("r") for row in nao.rows} == {nao.filled["robot"][1][0].strip("<>")}
    assert "robot: nao" in nao.understood


def test_a_time_restricts_the_answer(kb: KnowledgeBase) -> None:
    found = answer(kb, "what happened in the last two hours?", now=NOW)
    assert '?ended >= "2026-01-01T10:00:00+00:00"^^xsd:dateTime' in found.sparql


def test_a_name_that_nothing_has_is_not_answered_about_everything(kb: KnowledgeBase) -> None:
    found = answer(kb, "where is the teapot?")
    assert not found.is_understood
    assert found.sentence.startswith("Nothing in the graph is called 'teapot'")
    found = answer(kb, 'which robot knows "the tea pot" from its own sensors?')
    assert "'the tea pot'" in found.sentence


def test_a_word_of_names_stands_for_all_that_have_it(kb: KnowledgeBase) -> None:
    found = answer(kb, "where are the kettles?")
    assert found.filled["object"] == ("kettles", ("<urn:lab/object/10>",))
    assert "object: kettles" in answer(kb, "which robot fails at the kettles, and why?").understood
    assert not answer(kb, "where are the ettles?").is_understood


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("which colour does pr2 have?", "is not about 'pr2'"),
        ("where is Ann?", "Nothing in the graph is called 'Ann'"),
    ],
)
def test_a_name_without_a_place_gets_no_answer_about_others(
    kb: KnowledgeBase, text: str, said: str
) -> None:
    found = answer(kb, text)
    assert said in found.sentence
    assert not found.is_understood


def test_words_without_a_place_are_named(kb: KnowledgeBase) -> None:
    found = answer(kb, "which robots are manipulators today?")
    assert found.sentence.endswith("Not considered: today.")


def test_what_is_near_no_question_lists_the_nearest(kb: KnowledgeBase) -> None:
    found = answer(kb, "do you like opera?")
    assert not found.is_understood
    assert len(found.nearest) == 3
    assert found.to_dict()["question"] is None


def test_nothing_stated_is_not_said_to_be_so(kb: KnowledgeBase) -> None:
    found = answer(kb, "why does the pen slip?")
    assert found.sentence == "The graph states nothing that answers this; that does not mean no."


@pytest.mark.parametrize("text", [" ", "why " * 300])
def test_a_question_has_a_length(kb: KnowledgeBase, text: str) -> None:
    with pytest.raises(UsageError, match="1 to 1000 characters"):
        answer(kb, text)


def test_no_word_of_a_long_question_is_left_out_in_silence(kb: KnowledgeBase) -> None:
    with pytest.raises(UsageError, match="at most 60 words, not 64"):
        answer(kb, "so " * 60 + "where is the mug")


@pytest.mark.parametrize(
    "text",
    ['where is "x\\" } } #"?', "where is <urn:x> } DROP ALL", "where is '''\"\"\" } DROP mug ?x"],
)
def test_text_in_a_question_never_becomes_query(kb: KnowledgeBase, text: str) -> None:
    assert "DROP" not in answer(kb, text).sparql


def test_each_query_stands_without_what_it_was_written_for(kb: KnowledgeBase) -> None:
    for question in questions():
        text = filled_query(question, [])
        check_query(text)
        assert "kb/sample" not in text
        assert kb.query(text) is not None


def test_more_names_than_are_looked_at_are_said(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "Which grasps has the mug?"
    assert "looked at" not in answer(kb, text).sentence
    monkeypatch.setattr("rtask.asking.questions.mentions.MAX_MENTIONS", 1)
    cut = find_mentions(kb.select, ["twin", "panda-1"], "urn:lab/")
    assert all(item.is_cut for item in cut)
    assert "were looked at: more may answer this" in answer(kb, text).sentence
    missing = answer(kb, "where is the teapot now, says nao or rover?")
    assert not missing.is_understood
    assert missing.sentence.startswith("Whether anything is called 'teapot' is not known")
