"""Commits as events for people: the event of a commit about many objects."""

from __future__ import annotations

from typing import Any

import ontology
import rtask
from endpoint.activity import commits
from endpoint.activity.calls import call_event
from endpoint.follow.events import event as sse
from rtask.engine.engine import Call
from rtask.errors import UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Change


def test_a_commit_of_many_objects_tells_of_some_and_looks_up_no_more_names(monkeypatch):
    heard: list[Change] = []
    looked_up: list[Any] = []
    own = commits.name_of
    monkeypatch.setattr(commits, "name_of", lambda kb, one: looked_up.append(one) or own(kb, one))
    facts = [
        f'<urn:o/{k}> <{ontology.NS}objectId> "nao-1/{k}" ; <{ontology.NS}name> "cup {k}" .'
        for k in range(2 * commits.MAX_LISTED)
    ]
    with rtask.open(":memory:", plain=True) as kb:
        kb.on_commit(heard.append)
        kb.update(f"INSERT DATA {{ {' '.join(facts)} }}")
        told = commits.commit_events(kb, heard[0])
    assert len(told) == len(looked_up) == commits.MAX_LISTED
    assert {one.kind for one in told} == {"wrote"}
    assert told[0].words.startswith("told the graph of cup ")
    assert told[-1].words == f"and {commits.MAX_LISTED + 1} more in one commit"


def test_an_outcome_without_a_task_names_the_object_by_its_most_specific_kind():
    heard: list[Change] = []
    with rtask.open(":memory:", base="urn:lab/") as kb:
        kb.on_commit(heard.append)
        kb.update(
            f"""PREFIX rt: <{ontology.NS}> INSERT DATA {{
            <urn:lab/object/1> a rt:Mug ; rt:objectId "lab/1" ; rt:hasGrasp <urn:lab/grasp/1> .
            <urn:lab/attempt/1> a rt:GraspAttempt ; rt:executesGrasp <urn:lab/grasp/1> ;
              rt:hasOutcome <urn:lab/outcome/1> .
            <urn:lab/outcome/1> rt:success true . }}""",
            "nao-1",
        )
        told = {one.kind: one for one in commits.commit_events(kb, heard[-1])}
    assert told["outcome"].words == "held an unnamed mug"
    assert told["outcome"].object == "urn:lab/object/1"


def test_a_commit_that_tells_nothing_else_is_told_by_its_note():
    heard: list[Change] = []
    with rtask.open(":memory:", plain=True) as kb:
        kb.on_commit(heard.append)
        for note in ("tidy up", ""):
            with kb.transaction(agent="ann", note=note) as tx:
                tx.add("urn:a", "urn:p", f"b{note}")
        noted, bare = (commits.commit_events(kb, change)[0] for change in heard)
    assert (noted.words, noted.detail) == ("changed the graph: tidy up", "1 statement")
    assert (bare.words, bare.detail) == ("changed 1 statement", "")


def test_a_refusal_that_repeats_half_of_a_surrogate_pair_can_be_shown():
    call = Call(1, "recall_grasps", Access("nao-1", "robot"), error=UsageError("no \ud800"))
    told = call_event(call)
    assert told.words == "was refused: no ?"
    assert told.words.encode()


def test_an_event_is_sent_whatever_text_it_holds():
    assert sse("activity", {"words": "no \ud800"}).endswith(b'data: {"words":"no \\ud800"}\n\n')
