"""``rtask ask`` and ``rtask feedback`` over a folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.cli import main

Run = Callable[..., tuple[int, str, str]]

pytestmark = pytest.mark.slow

FACTS = f"""
PREFIX rt: <{ontology.NS}> PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX cora: <{ontology.PREFIXES["cora"]}> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
INSERT DATA {{
  <urn:lab/robot/nao-1> a cora:Robot ; rt:name "nao-1" ; rt:hasEndEffector <urn:lab/hand> .
  <urn:lab/hand> a rt:Hand ; rt:gripperType "nao" ; rt:name "hand" ; rt:minOpening 0e0 ;
    rt:maxOpening 0.05e0 ; rt:maxPayload 0.3e0 .
  <urn:lab/object/1> a rt:Can ; rt:objectId "lab/1" ; rt:name "cola" ; rt:graspWidth 0.04e0 ;
    rt:mass 0.2e0 ; rt:hasGrasp <urn:lab/grasp/1> .
  <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao" ; rt:graspQuality 0.8e0 .
  <urn:lab/task/1> a rt:Grasp ; rt:handles <urn:lab/object/1> ; rt:through <urn:lab/attempt/1> .
  <urn:lab/attempt/1> a rt:GraspAttempt ; rt:performedBy <urn:lab/robot/nao-1> ;
    rt:activates <urn:lab/hand> ; rt:executesGrasp <urn:lab/grasp/1> ; rt:requestId "urn:task:1" ;
    rt:hasOutcome <urn:lab/outcome/1> ; prov:endedAtTime "2026-01-01T10:00:00Z"^^xsd:dateTime .
  <urn:lab/outcome/1> a rt:GraspOutcome ; rt:success true ; rt:hasReason rt:reason_ok ;
    rt:hasFeedback <urn:lab/feedback/1> .
  <urn:lab/feedback/1> a rt:PhysicsFeedback ; rt:verdict true .
}}"""


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    folder = tmp_path / "kb"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(FACTS, "nao-1")

    def call(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as caught:
            main([*arguments, "--data", str(folder)])
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return call


def test_a_wish_is_answered_with_the_proof_or_with_reasons(run: Run) -> None:
    wish = ("ask", "something", "to", "drink", "from", "--agent", "nao-1")
    code, out, _ = run(*wish, "--object", "urn:lab/object/1")
    assert code == 0
    assert out.startswith("cola  urn:lab/object/1\ncola is something to drink from")
    assert "rule:canGrasp" in out
    code, out, err = run(*wish)
    assert (code, out) == (1, "")
    assert "not_seen: something to drink from: nothing of that is seen" in err


def test_a_wish_without_a_hand_is_a_question_about_all_objects(run: Run) -> None:
    code, out, err = run("ask", "something", "to", "hold", "things")
    assert code == 1
    assert out.startswith("The graph states nothing that answers this; that does not mean no.")
    assert "understood: What is there to hold things" in err
    assert run("update", FACTS.replace("a rt:Can", "rt:hasFunction rt:drinkFrom"))[0] == 0
    code, out, _ = run("ask", "something", "to", "drink", "from")
    assert code == 0
    assert out.startswith("Cola is something to drink from, and nao-1 can hold it.")
    assert "PREFIX rt:" in out
    found = json.loads(run("ask", "where", "is", "the", "cola?", "--json")[1])
    assert found["filled"]["object"] == {"words": "cola", "terms": ["<urn:lab/object/1>"]}


def test_a_number_says_where_to_see_what_it_rests_on(run: Run) -> None:
    err = run("ask", "how often did each robot succeed in grasping?")[2]
    assert "why: rtask feedback --robot urn:lab/robot/nao-1 --data " in err
    assert "why:" not in run("ask", "where", "is", "the", "cola?")[2]


def test_a_question_that_is_none_of_the_ontology_s_names_the_nearest(run: Run) -> None:
    code, out, err = run("ask", "will", "it", "rain", "tomorrow?")
    assert (code, out) == (1, "")
    assert err.startswith("None of the questions is near to that. The nearest are: ")
    assert "called 'weather'" in run("ask", "what", "is", "the", "weather", "like?")[2]
    assert "called 'teapot'" in run("ask", "where", "is", "the", "teapot?")[2]


def test_a_wish_for_an_object_in_view_needs_a_hand(run: Run) -> None:
    code, _, err = run("ask", "a", "cup", "--object", "cola")
    assert code == 2
    assert "--agent ROBOT, or --gripper NAME" in err


def test_people_judge_by_the_command_line(run: Run) -> None:
    assert "counts: held" in run("feedback")[1]
    correct = ("feedback", "urn:task:1", "--correct", "held=false,reason=slip_lift")
    code, out, err = run(*correct, "--agent", "ann")
    assert code == 0
    assert "0 say that it held, 1 that it did not: it counts as a failure" in out
    assert "held 0 of 1 times" in out
    assert "why: rtask feedback --with-grasp urn:lab/grasp/1 --data " in err
    shown = run("feedback", "--with-grasp", "kb:grasp/1")[1]
    assert shown.startswith("0 of 1 held: nao-1 0 of 1\n")
    assert "disputed" in run("feedback", "urn:task:1", "--confirm", "--agent", "bob")[1]
    assert "counts: disputed" in run("feedback")[1]


def test_a_failed_attempt_is_listed_in_words_and_by_its_code_for_programs(run: Run) -> None:
    failed = FACTS.replace("/1>", "/2>").replace("urn:task:1", "urn:task:2")
    failed = failed.replace("success true", "success false").replace("reason_ok", "reason_ik")
    assert run("update", failed)[0] == 0
    assert "the hand could not reach it" in run("feedback")[1]
    codes = [row["code"] for row in json.loads(run("feedback", "--json")[1])]
    assert sorted(codes) == ["ik", "ok"]


def test_what_cannot_be_meant_is_refused(run: Run) -> None:
    code, _, err = run("feedback", "urn:task:2", "--confirm")
    assert code != 0
    assert "unknown task_id 'urn:task:2'; did you mean 'urn:task:1'?" in err
    assert "--correct helt=no: held=true" in run("feedback", "urn:t", "--correct", "helt=no")[2]
    assert "which attempt?" in run("feedback", "--confirm")[2]
    assert "is enough" in run("feedback", "urn:t", "--confirm", "--correct", "held=true")[2]
