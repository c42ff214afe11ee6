"""What robots ask at a copy of the graph: answered there, stored once where the graph is."""

from __future__ import annotations

import json

import pytest

from rtask.engine import Engine
from rtask.engine.records.asked import record_of
from rtask.errors import UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri
from tests.processes import wait_until


@pytest.fixture
def copy(kb, engine):
    """Return an engine that passes records on, and what it has passed on, as JSON."""
    passed_on = []
    with Engine(kb) as made:
        made.context.be_copy(
            lambda record, author: passed_on.append((json.dumps(record), author)), quiet_s=0.0
        )
        yield made, passed_on


@pytest.fixture
def store(engine):
    """Return a function that stores records as the writer does, and returns how many commits."""

    def of(passed_on):
        before = engine.kb.seq
        for text, author in passed_on:
            record_of(json.loads(text)).store(engine.context, author)
        return engine.kb.seq - before

    return of


def test_a_place_seen_at_a_copy_is_stored_once_with_the_time_when_it_was_seen(
    kb, robots, bench, copy, store
):
    here, passed_on = copy
    first, nao = robots("nao-1"), robots("nao-2")
    thing = first.insert(bench.sight(bench.BOX), name="box")["objects"][0]["object"]
    wait_until(lambda: len(here.index) == 1)
    before = kb.seq
    nao.engine = here
    seen = {**bench.sight(bench.BOX), "stamp": {"secs": 1_700_000_000, "nsecs": 0}}
    answer = nao.recognise(seen)
    assert answer["object"] == thing
    assert kb.seq == before, "a copy stores nothing"
    kinds = [json.loads(text)["kind"] for text, _ in passed_on]
    assert sorted(kinds) == ["decision", "place"]
    assert {author for _, author in passed_on} == {Access("nao-2", "robot")}
    assert store(passed_on) == 1
    estimate = iri(next(r["estimate"] for r in (json.loads(t) for t, _ in passed_on)
                        if r["kind"] == "place"))  # fmt: skip
    [pose] = [quad.object for quad in kb.match(estimate, RT.estimatedPose)]
    [at] = [quad.object.value for quad in kb.match(pose, RT.atTime)]
    assert at.startswith("2023-11-14T22:13:20")
    assert store(passed_on) == 0, "it arrived before"
    passed_on.clear()
    nao.recognise(seen)
    assert [json.loads(text)["kind"] for text, _ in passed_on] == ["decision"], "known by now"


def test_a_refusal_at_a_copy_has_one_iri_however_often_it_is_asked_for_and_arrives(
    kb, robots, bench, copy, store
):
    here, passed_on = copy
    nao = robots("nao-1")
    nao.insert(bench.sight(bench.BOX), name="box")
    wait_until(lambda: len(here.index) == 1)
    nao.engine = here
    ask = {"decide": True, "min_identity": 1.0, "min_grasp": 1.0, "propose": False}
    refusals = {nao.recognise(bench.sight(bench.BOX), **ask)["decision"]["refusal"] for _ in "ab"}
    assert len(refusals) == 1, "it changed nothing to ask again"
    [refusal] = refusals
    assert not kb.match(iri(refusal), None, None), "a copy stores nothing"
    only = [one for one in passed_on if json.loads(one[0])["kind"] == "refusal"]
    assert store(only) == 2, "the second one renews the time and the task of the first"
    assert store(only) == 0, "both arrived before"
    stored = nao.log[-1]["task_id"]
    assert [q.object.value for q in kb.match(iri(refusal), RT.requestId)] == [stored]


@pytest.mark.parametrize(
    "given",
    [
        {"kind": "triples"},
        {"kind": "decision"},
        {"kind": "place", "estimate": "urn:e", "object": "urn:o", "robot": "urn:r", "frame_id": "b",
         "frame_from_object": [1.0], "confidence": 1.0, "is_round": False, "seen_at": "now"},
    ],
)  # fmt: skip
def test_what_is_no_record_is_refused_in_words(given):
    with pytest.raises(UsageError):
        record_of(given)
