"""No data of one robot make an individual of others the same as another."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, Quad

import rtask
from rtask.cli.doctor import _contested
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Request
from rtask.kb.commit.foreign.claims import contested_keys
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
    its:robot2 a cora:Robot ; rt:serialNumber "S2" .
    its:robot3 a cora:Robot ; rt:serialNumber "S3" .
    its:blob a rt:Blob ; rt:sha256 "0a" .
    its:data a rt:Dataset ; rt:qualifiedName "q/d" .
    its:service a rt:Service ; rt:qualifiedName "q/s" ; rt:version "1" .
    its:seen rt:bestMatch its:image .
    its:call rt:calledMethod its:method .
    its:other rt:name "another method" .
    <urn:its> a cora:Robot ; rt:serialNumber "S9" .
"""
CONTESTED = {
    "of robots": 'my:r a cora:Robot ; rt:serialNumber "S1"',
    "of a name of no namespace": '<urn:z> rt:serialNumber "S2" ; a cora:Robot',
    "of a blank node": '[] a cora:Robot ; rt:serialNumber "S3"',
    "by the range of a property": 'my:x rt:hasBlob my:b . my:b rt:sha256 "0a"',
    "of datasets": 'my:d a rt:Dataset ; rt:qualifiedName "q/d"',
    "of two properties": 'my:s a rt:Service ; rt:version "1" ; rt:qualifiedName "q/s"',
}
"""Keys of things that others have named."""
MERGING = {
    "key of names of no namespace": '<urn:x> rt:serialNumber "S9" ; a cora:Robot',
    "functional, of others": "its:seen rt:bestMatch my:image",
    "functional, two of others": "my:call rt:calledMethod its:method, its:other",
    "functional, one of others": "my:call rt:calledMethod my:method, its:method",
}
HARMLESS = (
    "my:seen rt:bestMatch my:one, my:two",
    'my:s a rt:Service ; rt:version "2" ; rt:qualifiedName "q/s"',
    'my:d a rt:Service ; rt:version "1" ; rt:qualifiedName "q/d"',
    'my:r a cora:Robot ; rt:serialNumber "S4" . my:r2 a cora:Robot ; rt:serialNumber "S4"',
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
    seq = kb.seq
    with pytest.raises(ForbiddenError, match="are the same, and others use them") as refused:
        insert(kb, MERGING[kind], "nao-1")
    details = refused.value.details
    assert details["right"] == "schema"
    assert details["statement"] in str(refused.value)
    assert any(name in str(refused.value) for name in details["same"])
    assert kb.seq == seq


def test_the_value_that_both_have_is_named(kb: KnowledgeBase) -> None:
    with pytest.raises(ForbiddenError) as refused:
        insert(kb, MERGING["key of names of no namespace"], "nao-1")
    assert refused.value.details["statement"] == f'<urn:x> <{RT}serialNumber> "S9"'
    assert "<urn:its> has that as well" in str(refused.value)


@pytest.mark.parametrize("first", ["nao-1", "nao-2"])
def test_a_key_that_two_robots_claim_makes_nothing_one_and_stops_neither(first: str) -> None:
    texts = {"nao-1": [*CONTESTED.values()], "nao-2": [ITS]}
    second = next(name for name in texts if name != first)
    with rtask.open(":memory:", base=BASE) as kb:
        for text in texts[first]:
            assert insert(kb, text, first).remark is None
        for text in texts[second]:
            told = insert(kb, text, second).remark
            assert told is not None
            assert "both stand" in told
        assert not kb.query(f"{PREFIXES}ASK {{ ?x owl:sameAs ?y FILTER(?x != ?y) }}")
        assert not kb.quarantined()
        claims = contested_keys(kb.store, kb.graphs)
        assert len(claims) == len(CONTESTED)
        assert all("nao-2" in claim.owners for claim in claims)
        assert kb.verify() == []
        insert(kb, "its:new rt:name 'goes on'", "nao-2")
        insert(kb, "my:new rt:name 'goes on'", "nao-1")
        for claim in claims:
            if isinstance(claim.first, NamedNode) and isinstance(claim.second, NamedNode):
                text = f"INSERT DATA {{ {claim.first} owl:sameAs {claim.second} }}"
                kb.update(PREFIXES + text)
        [left] = contested_keys(kb.store, kb.graphs)
        assert BlankNode in (type(left.first), type(left.second))


def test_what_an_operator_states_to_be_one_decides_for_keys_in_any_order() -> None:
    """A class of names of two owners is one, by a key, with the names of either."""
    with rtask.open(":memory:", base=BASE) as kb:
        for n, order in enumerate(itertools.permutations(("robots", "keys", "same"))):
            texts = {
                "robots": f"my:a{n} a cora:Robot . its:b{n} a cora:Robot ; rt:serialNumber '{n}'",
                "keys": f"my:c{n} a cora:Robot ; rt:serialNumber '{n}'",
                "same": f"my:a{n} owl:sameAs its:b{n}",
            }
            for name in order:
                kb.update(f"{PREFIXES}INSERT DATA {{ {texts[name]} }}")
            assert kb.query(f"{PREFIXES}ASK {{ its:b{n} owl:sameAs my:c{n} }}"), order
            assert n or kb.verify() == []
            kb.update(f"{PREFIXES}DELETE DATA {{ {texts['same']} }}")
            assert not kb.query(f"{PREFIXES}ASK {{ ?x owl:sameAs ?y FILTER(?x != ?y) }}"), order
        assert kb.verify() == []


@pytest.mark.parametrize("statements", HARMLESS)
def test_own_individuals_and_other_values_need_no_right(kb: KnowledgeBase, statements: str) -> None:
    assert insert(kb, statements, "nao-1").added


def test_an_operator_and_a_robot_with_the_right_may_do_so() -> None:
    with rtask.open(":memory:", base=BASE) as kb:
        insert(kb, ITS, "nao-2")
        text = f"{PREFIXES}INSERT DATA {{ {MERGING['functional, of others']} }}"
        access = Access("nao-1", "robot", frozenset({"schema"}))
        with pytest.raises(ForbiddenError):
            kb.update(text, access=Access("nao-1", "robot"))
        assert kb.update(text, access=access).added
        assert kb.query(f"{PREFIXES}ASK {{ its:image owl:sameAs my:image }}")


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
            Quad(NamedNode("urn:q"), a, NamedNode(CORA + "Robot"), home),
            Quad(NamedNode("urn:q"), has, Literal("S9"), home),
        ]
        before = set(kb.match(None, None, None, None))
        request = Request(kb.access("nao-1"))
        with pytest.raises(ForbiddenError, match="has that as well"):
            kb.bulk_add(load, home, request)
        assert set(kb.match(None, None, None, None)) == before
        assert kb.bulk_add(load[:2], home, request).derived > 0
    with rtask.open(tmp_path / "kb") as kb:
        assert not kb.query(f"{PREFIXES}ASK {{ <urn:q> rt:serialNumber ?any }}")
        assert kb.query(f"{PREFIXES}ASK {{ <urn:q> a cora:Robot }}")
        insert(kb, CONTESTED["of robots"].replace("my:r", "my:z"), "nao-1")
    finding = _contested(tmp_path / "kb")
    assert (finding.state, finding.detail[:11]) == ("note", "1 contested")
    assert "serialNumber" in finding.detail


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
        names = (NamedNode("urn:q"), NamedNode(mine + "r"))
        robots = [Quad(name, a, NamedNode(CORA + "Robot"), home) for name in names]
        key = Quad(names[0], has, Literal("S9"), home)
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


def test_whoever_makes_two_things_one_is_told() -> None:
    with rtask.open(":memory:", base=BASE) as kb:

        def remark(statements: str, agent: str | None = None) -> str | None:
            return kb.update(f"{PREFIXES}INSERT DATA {{ {statements} }}", agent).remark

        assert remark("<urn:a> a rt:Mug ; rt:objectId 'lab/1'") is None
        told = remark("<urn:b> a rt:Mug ; rt:objectId 'lab/1' ; rt:mass 0.2e0")
        assert told is not None
        assert "<urn:b> and <urn:a> are one thing from now on" in told
        assert f'as both have <{RT}objectId> "lab/1"' in told
        assert remark("<urn:b> rt:name 'cup'") is None  # told once
        told = remark("<urn:seen> rt:bestMatch <urn:c>, <urn:e>")
        assert told is not None
        assert "are one thing from now on:" in told  # not by a key: no value in common
        assert remark("<urn:d> owl:sameAs <urn:a>") is None  # that is what was stated
        own = "my:r a cora:Robot ; rt:serialNumber 'S4' . my:r2 a cora:Robot ; rt:serialNumber 'S4'"
        assert "are one thing from now on, as both have" in (remark(own, "nao-1") or "")


_CUPS = "".join(f'<urn:c{i}> <{RT}objectId> "lab/{i}" .\n' for i in range(600)).encode()
_TWICE = f'<urn:d1> <{RT}objectId> "lab/1" .\n<urn:d2> <{RT}objectId> "lab/2" .\n'.encode()


@pytest.mark.parametrize("others", [_CUPS[:400].rpartition(b"\n")[0] + b"\n", _CUPS])
def test_a_load_tells_which_of_its_things_are_one(others: bytes) -> None:
    with rtask.open(":memory:", base=BASE) as kb:
        report = kb.load(_TWICE + others, format="nt")
        [told] = report.warnings
        assert f'one thing from now on, as both have <{RT}objectId> "lab/' in told
        assert "So are 1 more pairs" in told
        assert kb.load(b'<urn:f> <urn:p> "1" .', format="nt").warnings == []


def test_a_bulk_load_tells_which_things_are_one(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 1)
    said = f'<urn:bulk1> <{RT}objectId> "bulk/1" .\n<urn:bulk2> <{RT}objectId> "bulk/1" .\n'
    [told] = kb.load(said.encode(), format="nt").warnings
    assert f'one thing from now on, as both have <{RT}objectId> "bulk/1"' in told
