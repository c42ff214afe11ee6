"""Commits as events for people: what is told of many objects at once."""

from __future__ import annotations

from typing import Any

import ontology
import rtask
from endpoint.activity import commits
from rtask.kb.commit.commit import Change


def test_a_commit_of_many_objects_tells_of_some_and_looks_up_no_more_names(monkeypatch):
    heard: list[Change] = []
    looked_up: list[Any] = []
    own = commits.name_of
    monkeypatch.setattr(commits, "name_of", lambda kb, one: looked_up.append(one) or own(kb, one))
    facts = [
        f'<urn:o/{k}> <{ontology.NS}objectId> "nao-1/{k}" ; <{ontology.NS}name> "cup {k}" .'
        for k in range(2 * commits.MAX_TOLD)
    ]
    with rtask.open(":memory:", plain=True) as kb:
        kb.on_commit(heard.append)
        kb.update(f"INSERT DATA {{ {' '.join(facts)} }}")
        told = commits.commit_events(kb, heard[0])
    assert len(told) == len(looked_up) == commits.MAX_TOLD
    assert {one.kind for one in told} == {"wrote"}
    assert told[0].words.startswith("told the graph of cup ")
