"""The copied knowledge bases that other tests begin with are what opening one gives."""

from __future__ import annotations

import os

import pytest
from pyoxigraph import NamedNode, Quad

import rtask
from rtask.knowledge_base import KnowledgeBase
from tests import opened

_BASE = "https://example.org/kb/"
_TIMES = ("startedAtTime", "endedAtTime")
_CHANGE = """
PREFIX owl: <http://www.w3.org/2002/07/owl#>
INSERT DATA { <urn:a> a <https://w3id.org/rtask#Grasp> . <urn:b> owl:sameAs <urn:c> }
"""


def _quads(kb: KnowledgeBase) -> set[Quad]:
    """Return what a knowledge base holds, but for the times of the commit that made it."""
    return {
        quad
        for quad in kb.store.quads_for_pattern(None, None, None, None)
        if not quad.predicate.value.endswith(_TIMES)
    }


def _open(monkeypatch: pytest.MonkeyPatch, as_in: str, reason: bool) -> KnowledgeBase:
    monkeypatch.setitem(os.environ, "PYTEST_CURRENT_TEST", as_in)
    kb = rtask.open(":memory:", base=_BASE, reason=reason)
    assert isinstance(kb, KnowledgeBase)
    return kb


@pytest.mark.parametrize("reason", [True, False])
def test_a_copy_is_what_opening_gives_and_takes_changes_the_same_way(
    monkeypatch: pytest.MonkeyPatch, reason: bool
) -> None:
    copies: list[object] = []
    real = opened.open_copied
    monkeypatch.setattr(opened, "open_copied", lambda *of: copies.append(of) or real(*of))
    with (
        _open(monkeypatch, "tests/rtask/kb/", reason) as made,
        _open(monkeypatch, "tests/rtask/", reason) as copy,
        _open(monkeypatch, "tests/rtask/", reason) as other,
    ):
        assert len(copies) == 2
        untouched = _quads(other)
        assert _quads(copy) == _quads(made)
        for kb in (made, copy):
            kb.update(_CHANGE)
        assert _quads(copy) == _quads(made)
        assert copy.seq == made.seq == 2
        assert not copy.verify()
        assert _quads(other) == untouched, "a change reached another copy"
        if reason:
            grasp, grasped = NamedNode("urn:a"), NamedNode("https://w3id.org/rtask#Grasp")
            assert copy.match(grasp, None, grasped)
            assert not other.match(grasp, None, None)
