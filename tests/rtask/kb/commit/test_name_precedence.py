"""Who minted a name goes first, whatever others have stated of it before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from pyoxigraph import NamedNode, Quad

import rtask
from rtask.cli.doctor import _set_aside
from rtask.errors import ForbiddenError, InconsistentError
from rtask.kb.commit import budget
from rtask.kb.commit.foreign import precedence
from rtask.kb.commit.foreign.precedence import MAX_RECORDED
from rtask.kb.commit.quarantine import Quarantined
from rtask.knowledge_base import KnowledgeBase
from tests.contested_names import AXIOMS, BASE, CONTRADICTED, ME, MERGED, PREFIXES

SAME_AS = NamedNode("http://www.w3.org/2002/07/owl#sameAs")


@dataclass(frozen=True)
class Lab:
    """A stranger and an owner of names, new to a graph that all tests share."""

    kb: KnowledgeBase
    stranger: str
    owner: str

    def insert(self, statements: str, agent: str | None) -> rtask.Commit:
        return self.kb.update(self.text(f"INSERT DATA {{ {statements} }}"), agent)

    def text(self, update: str) -> str:
        names = {"my": self.stranger, "its": self.owner}
        own = "".join(f"PREFIX {p}: <{BASE}robot/{name}/> " for p, name in names.items())
        return PREFIXES + own + update.replace(ME, f"<{BASE}robot/{self.owner}>")

    def of(self, name: str) -> set[Quad]:
        return set(self.kb.store.quads_for_pattern(None, None, None, self.kb.graphs.agent(name)))

    def set_aside(self) -> list[Quarantined]:
        graph = self.kb.graphs.agent(self.stranger)
        return [held for held in self.kb.quarantined() if held.quad.graph_name == graph]

    def assert_sound(self) -> None:
        inference = self.kb._writer.committer.inference
        assert inference is not None
        assert inference.closure().contradictions() == []


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base=BASE) as opened:
        axioms = f"INSERT DATA {{ GRAPH <urn:lab/axioms> {{ {AXIOMS} }} }}"
        opened.update(PREFIXES + axioms)
        yield opened
        inference = opened._writer.committer.inference
        assert inference is not None
        missing, surplus = inference.difference()
        assert (list(missing), surplus) == ([], [])


@pytest.fixture
def lab(kb: KnowledgeBase) -> Lab:
    return Lab(kb, f"nao-{kb.seq}a", f"nao-{kb.seq}b")


@pytest.mark.parametrize("kind", CONTRADICTED)
def test_the_owner_is_stored_and_what_contradicts_it_is_set_aside(lab: Lab, kind: str) -> None:
    theirs, own = CONTRADICTED[kind]
    lab.insert(theirs, lab.stranger)
    before = lab.of(lab.stranger)
    done = lab.insert(own, lab.owner)
    gone = before - lab.of(lab.stranger)
    assert gone
    assert lab.stranger in (done.remark or "")
    assert {held.quad for held in lab.set_aside()} == gone
    assert all(f"{lab.owner} " in held.reason for held in lab.set_aside())
    assert len(lab.of(lab.owner)) == own.count(" . ") + own.count(" ; ") + 1
    with pytest.raises(ForbiddenError) as refused:
        lab.insert(theirs, lab.stranger)
    assert refused.value.details["statement"] in str(refused.value)
    assert refused.value.details.get("owner", lab.owner) == lab.owner
    assert "in quarantine" in (lab.insert("<urn:x> rdfs:label 'x'", lab.stranger).remark or "")
    lab.assert_sound()


@pytest.mark.parametrize("kind", MERGED)
def test_no_name_of_the_owner_is_merged_by_what_others_stated(lab: Lab, kind: str) -> None:
    theirs, own = MERGED[kind]
    lab.insert(theirs, lab.stranger)
    lab.insert(own, lab.owner)
    assert not [
        quad
        for quad in lab.kb.store.quads_for_pattern(None, SAME_AS, None, lab.kb.graphs.inferred)
        if lab.owner in str(quad)
    ]
    assert lab.set_aside()
    with pytest.raises(ForbiddenError):
        lab.insert(theirs, lab.stranger)
    lab.assert_sound()


def test_what_robots_say_of_each_other_stays_where_it_contradicts_nothing(
    lab: Lab,
) -> None:
    lab.insert(f"its:cup a rt:Mug ; rdfs:comment 'seen' . {ME} a cora:Robot", lab.stranger)
    done = lab.insert("its:cup a rt:Mug ; rdfs:label 'cup'", lab.owner)
    assert (done.removed, done.remark, lab.set_aside()) == (0, None, [])


def test_nobody_is_set_aside_by_claiming_a_name_of_another_as_well(lab: Lab) -> None:
    lab.insert("its:o a rt:Mug . <urn:o> a rt:Mug . its:f rdfs:seeAlso my:b", lab.owner)
    before = lab.of(lab.owner)
    for attack in (
        "my:r rdfs:range rt:Grasp . my:b my:r its:o",
        "my:r rdfs:range rt:Grasp . my:b my:r <urn:o>",
        "its:o a rt:Grasp",
        "<urn:o> a rt:Grasp",
    ):
        with pytest.raises((ForbiddenError, InconsistentError)):
            lab.insert(attack, lab.stranger)
    assert lab.of(lab.owner) == before


def test_an_id_that_begins_with_a_name_is_that_names_to_give(lab: Lab) -> None:
    ours = f"{lab.owner}/cup"
    assert lab.insert(f"my:a a rt:Mug ; rt:objectId '{ours}'", lab.stranger).remark is None
    stored = lab.insert(f"its:cup a rt:Mug ; rt:objectId '{ours}'", lab.owner)
    assert f'"{ours}" of {lab.stranger}' in (stored.remark or "")
    [held] = lab.set_aside()
    assert held.quad.object.value == ours  # type: ignore[union-attr]
    assert "in quarantine" in (lab.insert("my:a rdfs:label 'a'", lab.stranger).remark or "")
    for again in ("my:a", "my:b"):
        with pytest.raises(ForbiddenError, match="another object has that id"):
            lab.insert(f"{again} a rt:Mug ; rt:objectId '{ours}'", lab.stranger)
    assert not lab.kb.query(lab.text("ASK { my:a owl:sameAs its:cup }"))
    # The name decides, not the order: what its owner has given nobody can claim afterwards.
    lab.insert(f"its:jug a rt:Mug ; rt:objectId '{lab.owner}/jug'", lab.owner)
    with pytest.raises(ForbiddenError, match="another object has that id"):
        lab.insert(f"my:c a rt:Mug ; rt:objectId '{lab.owner}/jug'", lab.stranger)
    lab.assert_sound()


def test_an_operator_goes_first_before_a_stranger_but_not_before_the_owner(
    lab: Lab,
) -> None:
    lab.insert("its:a lab:num 1", lab.stranger)
    assert lab.insert("its:a lab:num 2", None).remark
    lab.insert("its:b lab:num 1", lab.owner)
    with pytest.raises(InconsistentError):
        lab.insert("its:b lab:num 2", None)


def test_statements_of_whoever_has_the_right_stay(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    committer = lab.kb.writer.committer
    monkeypatch.setattr(committer, "has_schema", lambda name: name == lab.stranger)
    lab.insert("its:a lab:num 1", lab.stranger)
    with pytest.raises(InconsistentError):
        lab.insert("its:a lab:num 2", lab.owner)


def test_a_thousand_reasons_do_not_keep_the_owner_out(lab: Lab) -> None:
    size = MAX_RECORDED + 100
    for start in range(0, size, 100):
        many = " ".join(
            f"my:p{i} rdfs:range rt:Grasp . my:s{i} my:p{i} its:c ."
            for i in range(start, start + 100)
        )
        lab.insert(many, lab.stranger)
    done = lab.insert("its:c a rt:Mug", lab.owner)
    assert done.removed == size
    assert len(lab.set_aside()) == MAX_RECORDED
    lab.assert_sound()


def test_it_is_so_where_a_trial_finds_the_contradiction(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("_FIRST_FIRINGS", "_FIRST_FIRINGS_EACH", "_FIRST_DERIVED", "_FIRST_DERIVED_EACH"):
        monkeypatch.setattr(budget, name, 0)
    lab.insert("its:c lab:d my:b . its:a lab:num 1", lab.stranger)
    lab.insert("its:c a rt:Mug . its:a lab:num 2", lab.owner)
    assert len(lab.set_aside()) == 2
    with pytest.raises(ForbiddenError, match=f"{lab.owner}, who minted the name"):
        lab.insert("its:c lab:d my:b", lab.stranger)
    lab.assert_sound()


def test_a_proof_that_is_not_found_does_not_protect_the_stranger(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    support = precedence.support_of
    monkeypatch.setattr("reasoner.contradictions.PROOF_BUDGET", 1)
    axioms = "my:r rdfs:range rt:Grasp . my:q rdfs:subPropertyOf my:r"
    lab.insert(f"{axioms} . my:b my:q its:c", lab.stranger)
    found: list[Any] = []

    def record(clash: Any) -> Any:
        found.append(clash.is_proven)
        return support(clash)

    monkeypatch.setattr("rtask.kb.commit.committer.support_of", record)
    lab.insert("its:c a rt:Mug", lab.owner)
    assert found[0] is False
    assert len(lab.set_aside()) == 1


def test_the_operator_lists_releases_and_undoes(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        lab = Lab(kb, "nao-1", "nao-2")
        lab.insert(f"{ME} rt:serialNumber 'fake'", lab.stranger)
        done = lab.insert(f"{ME} rt:serialNumber 'X1'", lab.owner)
    finding = _set_aside(tmp_path / "kb")
    assert "1 statements of nao-1" in finding.detail
    assert "nao-2 states" in finding.detail
    with rtask.open(tmp_path / "kb") as kb:
        lab = Lab(kb, "nao-1", "nao-2")
        with pytest.raises(InconsistentError):
            kb.release()
        kb.revert(done.seq)
        assert (lab.set_aside(), len(lab.of(lab.stranger))) == ([], 1)
        lab.insert(f"{ME} rt:serialNumber 'X1'", lab.owner)
        kb.update(lab.text(f"DELETE DATA {{ {ME} rt:serialNumber 'X1' }}"), lab.owner)
        kb.release()
        assert (lab.set_aside(), len(lab.of(lab.stranger))) == ([], 1)


def test_a_policy_of_quarantine_lets_the_owner_go_first_as_well() -> None:
    with rtask.open(":memory:", base=BASE, on_inconsistency="quarantine") as kb:
        lab = Lab(kb, "nao-1", "nao-2")
        lab.insert(f"{ME} rt:serialNumber 'fake'", lab.stranger)
        done = lab.insert(f"{ME} rt:serialNumber 'X1'", lab.owner)
        assert (done.quarantined, len(lab.set_aside())) == (0, 1)
        assert lab.insert(f"{ME} rt:serialNumber 'fake'", lab.stranger).quarantined == 1
        assert len({held.node for held in lab.set_aside()}) == 2
