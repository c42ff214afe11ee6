"""No data of one robot make an individual of others the same as another."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from pyoxigraph import Literal, NamedNode, Quad

import rtask
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Request
from rtask.knowledge_base import KnowledgeBase

RT = "https://w3id.org/rtask-kg/ns#"
CORA = "http://purl.org/ieee1872-owl/cora-bare#"
BASE = "urn:lab/"
PREFIXES = (
    f"PREFIX rt: <{RT}> PREFIX cora: <{CORA}> PREFIX owl: <http://www.w3.org/2002/07/owl#> "
    f"PREFIX my: <{BASE}robot/nao-1/> PREFIX its: <{BASE}robot/nao-2/> "
)
ITS = """
    its:robot a cora:Robot ; rt:serialNumber "S1" .
    its:blob a rt:Blob ; rt:sha256 "0a" .
    its:data a rt:Dataset ; rt:qualifiedName "q/d" .
    its:service a rt:Service ; rt:qualifiedName "q/s" ; rt:version "1" .
    its:seen rt:bestMatch its:image .
    its:call rt:calledMethod its:method .
    its:other rt:name "another method" .
"""
MERGING = {
    "key": 'my:r a cora:Robot ; rt:serialNumber "S1"',
    "key of a name of no namespace": 'rt:serialNumber "S1" ; a cora:Robot',
    "key of a blank node": '[] a cora:Robot ; rt:serialNumber "S1"',
    "key by the range of a property": 'my:x rt:hasBlob my:b . my:b rt:sha256 "0a"',
    "key of datasets": 'my:d a rt:Dataset ; rt:qualifiedName "q/d"',
    "key of two properties": 'my:s a rt:Service ; rt:version "1" ; rt:qualifiedName "q/s"',
    "functional, of others": "its:seen rt:bestMatch my:image",
    "functional, two of others": "my:call rt:calledMethod its:method, its:other",
    "functional, one of others": "my:call rt:calledMethod my:method, its:method",
}
HARMLESS = (
    "my:seen rt:bestMatch my:one, my:two",
    'my:s a rt:Service ; rt:version "2" ; rt:qualifiedName "q/s"',
    'my:d a rt:Service ; rt:version "1" ; rt:qualifiedName "q/d"',
    'my:r a cora:Robot ; rt:serialNumber "S2" . my:r2 a cora:Robot ; rt:serialNumber "S2"',
    'its:robot rt:serialNumber "S1" ; rt:name "seen by me"',
)


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base=BASE) as opened:
        insert(opened, ITS, "nao-2")
        yield opened


def insert(kb: KnowledgeBase, statements: str, agent: str, **options) -> rtask.Commit:
    return kb.update(f"{PREFIXES}INSERT DATA {{ {statements} }}", agent=agent, **options)


@pytest.mark.parametrize("kind", MERGING)
def test_what_makes_an_individual_of_others_another_needs_the_right(
    kb: KnowledgeBase, kind: str
) -> None:
    statements = MERGING[kind]
    if kind.endswith("no namespace"):
        statements = f"<urn:x> {statements}"
    seq = kb.seq
    with pytest.raises(ForbiddenError, match="are the same, and others use them") as refused:
        insert(kb, statements, "nao-1")
    details = refused.value.details
    assert details["right"] == "schema"
    assert details["statement"] in str(refused.value)
    assert any(name in str(refused.value) for name in details["same"])
    assert kb.seq == seq


def test_the_value_that_both_have_is_named(kb: KnowledgeBase) -> None:
    with pytest.raises(ForbiddenError) as refused:
        insert(kb, MERGING["key"], "nao-1")
    assert refused.value.details["statement"] == (f'<{BASE}robot/nao-1/r> <{RT}serialNumber> "S1"')
    assert f"<{BASE}robot/nao-2/robot> has that as well" in str(refused.value)


@pytest.mark.parametrize("statements", HARMLESS)
def test_own_individuals_and_other_values_need_no_right(kb: KnowledgeBase, statements: str) -> None:
    assert insert(kb, statements, "nao-1").added


def test_an_operator_and_a_robot_with_the_right_may_do_so() -> None:
    with rtask.open(":memory:", base=BASE) as kb:
        insert(kb, ITS, "nao-2")
        text = f"{PREFIXES}INSERT DATA {{ {MERGING['key']} }}"
        access = Access("nao-1", "robot", frozenset({"schema"}))
        with pytest.raises(ForbiddenError):
            kb.update(text, access=Access("nao-1", "robot"))
        assert kb.update(text, access=access).added
        assert kb.query(f"{PREFIXES}ASK {{ its:robot owl:sameAs my:r }}")


def test_a_bulk_load_that_does_so_is_withdrawn(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        insert(kb, ITS, "nao-2")
        insert(kb, 'my:r rt:serialNumber "S0"', "nao-1")
        home, mine = kb.graphs.agent("nao-1"), f"{BASE}robot/nao-1/"
        has, a = (
            NamedNode(RT + "serialNumber"),
            NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type"),
        )
        load = [
            Quad(NamedNode(mine + "r"), has, Literal("S0"), home),
            Quad(NamedNode(mine + "q"), a, NamedNode(CORA + "Robot"), home),
            Quad(NamedNode(mine + "q"), has, Literal("S1"), home),
        ]
        before = set(kb.match(None, None, None, None))
        request = Request(kb.access("nao-1"))
        with pytest.raises(ForbiddenError, match="has that as well"):
            kb.bulk_add(load, home, request)
        assert set(kb.match(None, None, None, None)) == before
        assert kb.bulk_add(load[:2], home, request) > 0
    with rtask.open(tmp_path / "kb") as kb:
        assert not kb.query(f"{PREFIXES}ASK {{ my:q rt:serialNumber ?any }}")
        assert kb.query(f"{PREFIXES}ASK {{ my:q a cora:Robot }}")


def test_what_a_killed_load_would_have_been_refused_for_is_set_aside_at_the_next_opening(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class KilledError(BaseException):
        pass

    def kill(*_: object) -> None:
        raise KilledError

    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        insert(kb, ITS, "nao-2")
        home, mine = kb.graphs.agent("nao-1"), f"{BASE}robot/nao-1/"
        has = NamedNode(RT + "serialNumber")
        a = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
        robots = [Quad(NamedNode(mine + name), a, NamedNode(CORA + "Robot"), home) for name in "qr"]
        key = Quad(NamedNode(mine + "q"), has, Literal("S1"), home)
        request = Request(kb.access("nao-1"))
        with monkeypatch.context() as patched:
            patched.setattr("rtask.kb.commit.bulk._require_identity", kill)
            with pytest.raises(KilledError):
                kb.bulk_add([*robots, key], home, request)
    assert (tmp_path / "kb" / "loading.json").exists()
    with rtask.open(tmp_path / "kb") as kb:
        assert not kb.query(f"{PREFIXES}ASK {{ ?x owl:sameAs ?y FILTER(?x != ?y) }}")
        assert kb.query(f"{PREFIXES}ASK {{ my:r a cora:Robot }}")
        assert key in {held.quad for held in kb.quarantined()}
        assert kb.verify() == []
    assert not (tmp_path / "kb" / "loading.json").exists()
