"""What a robot stores is data, and never the schema of others."""

from __future__ import annotations

import datetime as dt
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, parse

import rtask
from rtask.errors import (
    ConflictError,
    ForbiddenError,
    InconsistentError,
    QueueFullError,
    StoreError,
    UnknownTermError,
    UsageError,
)
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Request
from rtask.kb.commit.schema_right import stored_axioms
from rtask.kb.maintenance.backup import restore
from rtask.kb.proposals import register
from rtask.kb.proposals.register import LIFETIME, MAX_OPEN, Proposals
from rtask.knowledge_base import KnowledgeBase

PREFIXES = (
    "PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> "
    "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
    "PREFIX owl: <http://www.w3.org/2002/07/owl#> "
    "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
)
BASE = "https://example.org/lab/"
OWN, OTHER = f"PREFIX my: <{BASE}robot/nao-1/> ", f"PREFIX its: <{BASE}robot/nao-2/> "
HOSTILE = (
    "rt:Mug owl:disjointWith rt:ManipulableObject",
    "rt:Mug rdfs:subClassOf owl:Nothing",
    "rt:Mug rdfs:subClassOf my:Hand",
    "my:Mug owl:equivalentClass rt:Mug",
    "my:M rdfs:subClassOf owl:TransitiveProperty",
    "my:p rdfs:subPropertyOf owl:sameAs",
    "my:p rdfs:domain owl:FunctionalProperty",
    "my:p a owl:FunctionalProperty",
    "its:p a owl:SymmetricProperty",
    "rt:hasOutcome a owl:IrreflexiveProperty",
    "rt:Mug a rdfs:Datatype",
    "its:thing owl:sameAs my:thing",
    "its:thing owl:differentFrom its:mug",
    "its:mug a owl:Nothing",
    "my:U owl:unionOf (rt:Mug rt:Hand)",
    "my:p owl:propertyChainAxiom (rt:hasOutcome rt:hasFeature)",
    "my:R owl:onProperty rt:hasFeature ; owl:someValuesFrom owl:Thing ; rdfs:subClassOf rt:Robot",
    "[] rdfs:subClassOf rt:Robot",
    "[] a owl:NegativePropertyAssertion ; owl:sourceIndividual its:mug",
    "[] a owl:AllDifferent ; owl:distinctMembers (its:mug its:thing)",
    "rdf:type rdfs:subPropertyOf my:p",
    "rdfs:subClassOf a owl:SymmetricProperty",
)
HARMLESS = (
    "my:M rdfs:subClassOf rt:Mug ; a owl:Class ; rdfs:label 'mug of mine'",
    "my:t a owl:TransitiveProperty ; rdfs:range rt:Mug . my:a my:t my:b . my:b my:t my:c",
    "my:A owl:disjointWith my:B",
    "my:x owl:sameAs my:y",
    "its:mug rdfs:comment 'seen by me' ; a rt:Mug",
    "my:path rt:via (its:mug my:x)",
    "<urn:l1> a rdf:List ; rdf:first its:mug ; rdf:rest <urn:l2> . <urn:l2> rdf:rest rdf:nil",
    "its:mug rdf:value 1 ; rdf:_1 my:x ; rdfs:member my:y ; rdfs:seeAlso <urn:page>",
    "[] a rdf:Statement ; rdf:subject its:mug ; rdf:predicate rt:mass ; rdf:object 1",
    "[] a rdf:Bag ; rdf:_1 its:mug . [] a rdf:Seq . [] a rdf:Alt . [] a rdfs:Container",
    "[] a owl:Axiom ; owl:annotatedSource its:mug ; rdfs:comment 'seen twice'@en",
    "<urn:doc> a owl:Ontology ; owl:versionInfo '1' ; owl:imports <urn:other>",
    "its:mug a owl:NamedIndividual, owl:Thing ; rdfs:label 'Becher'@de",
)


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base=BASE) as opened:
        yield opened


def insert(kb: KnowledgeBase, statements: str, agent: str = "nao-1", **options) -> rtask.Commit:
    text = f"{PREFIXES}{OWN}{OTHER}INSERT DATA {{ {statements} }}"
    return kb.update(text, agent=None if "access" in options else agent, **options)


@pytest.mark.parametrize("statement", HOSTILE)
def test_an_axiom_that_reaches_terms_of_others_needs_the_right(
    kb: KnowledgeBase, statement: str
) -> None:
    seq = kb.seq
    with pytest.raises(ForbiddenError) as refused:
        insert(kb, statement)
    assert refused.value.details["right"] == "schema"
    assert refused.value.details["statement"] in str(refused.value)
    assert kb.seq == seq


@pytest.mark.parametrize(
    "statement",
    [
        "rt:mass a rt:Robot",
        "rt:Mug rt:name 'not a mug'",
        "rt:Mug rdfs:label 'not a mug'",
        "rt:colour_red a rt:Robot",
        "<http://purl.org/ieee1872-owl/cora-bare#Robot> rt:note 'mine'",
        "<https://w3id.org/rtask-kg/onto/grasp> rdfs:comment 'mine'",
        "owl:Class a rt:Robot",
        "rdf:nil rt:note 'mine'",
    ],
)
def test_what_is_said_about_a_term_of_an_ontology_needs_the_right(
    kb: KnowledgeBase, statement: str
) -> None:
    with pytest.raises(ForbiddenError, match=r"term of the schema|an axiom") as refused:
        insert(kb, statement)
    assert refused.value.details["right"] == "schema"
    assert refused.value.details["statement"] in str(refused.value)


def test_the_id_of_one_object_is_given_to_no_other() -> None:
    with rtask.open(":memory:", base=BASE) as kb:
        insert(kb, "my:mug a rt:Mug ; rt:objectId 'nao-1/1'")
        insert(kb, "my:mug rt:objectId 'nao-1/1'", agent="nao-2")  # the same object
        for robot, statement in (
            ("nao-2", "its:mug a rt:Mug ; rt:objectId 'nao-1/1'"),
            ("nao-1", "my:other rt:objectId 'nao-1/1'"),
            ("nao-2", "its:a a rt:Mug ; rt:objectId 'nao-2/1' . its:b rt:objectId 'nao-2/1'"),
        ):
            with pytest.raises(ForbiddenError, match="another object has that id") as refused:
                insert(kb, statement, agent=robot)
            assert refused.value.details["right"] == "schema"
        load = [Quad(NamedNode("urn:x"), NamedNode("https://w3id.org/rtask-kg/ns#objectId"),
                     Literal("nao-1/1"), kb.graphs.agent("nao-2"))]  # fmt: skip
        with pytest.raises(ForbiddenError, match="another object has that id"):
            kb.bulk_add(load, kb.graphs.agent("nao-2"), Request(kb.access("nao-2")))
        insert(kb, "its:mug a rt:Mug ; rt:objectId 'nao-2/1'", agent="nao-2")
        text = (
            f"{PREFIXES}{OTHER}DELETE DATA {{ its:mug rt:objectId 'nao-2/1' }} ; "
            "INSERT DATA { its:cup a rt:Mug ; rt:objectId 'nao-2/1' }"
        )
        assert kb.update(text, agent="nao-2")
        text = f"{PREFIXES}{OWN}INSERT DATA {{ <urn:same> a rt:Mug ; rt:objectId 'nao-1/1' }}"
        assert "both stand" in (kb.update(text).remark or "")
        assert not kb.query(f"{PREFIXES}{OWN}ASK {{ my:mug owl:sameAs <urn:same> }}")
        insert(kb, "my:mug owl:sameAs <urn:same>", access=Access())
        assert kb.query(f"{PREFIXES}{OWN}ASK {{ <urn:same> owl:sameAs my:mug }}")


def test_terms_of_ontologies_are_those_of_the_ontologies_there_now() -> None:
    graph = "https://example.org/site"
    with rtask.open(":memory:", base=BASE) as kb:
        insert(kb, "<urn:Shelf> rt:note 'new'")
        site = (
            f"{PREFIXES.replace('PREFIX', chr(10) + 'PREFIX')}\n<{graph}> a owl:Ontology . "
            "<urn:Shelf> a owl:Class . <urn:room> a <urn:Shelf>, owl:NamedIndividual ."
        )
        kb.load(site.encode(), "turtle")
        with pytest.raises(ForbiddenError, match="Shelf"):
            insert(kb, "<urn:Shelf> rt:note 'again'")
        insert(kb, "<urn:room> rt:note 'swept'")
        kb.update(f"DROP GRAPH <{graph}>")
        insert(kb, "<urn:Shelf> rt:note 'gone'")


@pytest.mark.parametrize("statement", HARMLESS)
def test_data_and_axioms_about_own_terms_need_no_right(kb: KnowledgeBase, statement: str) -> None:
    assert insert(kb, statement).added > 0


def test_a_term_that_another_uses_is_not_only_its_makers_any_more(kb: KnowledgeBase) -> None:
    insert(kb, "my:Shared a owl:Class")
    insert(kb, "its:bowl a my:Shared", agent="nao-2")
    with pytest.raises(ForbiddenError, match="Shared"):
        insert(kb, "my:Shared rdfs:subClassOf rt:Mug")


def test_cells_of_lists_are_data_unless_an_axiom_has_the_list(kb: KnowledgeBase) -> None:
    axioms = "<urn:U> owl:unionOf <urn:c1> . <urn:c1> rdf:first rt:Mug ; rdf:rest <urn:c2> . "
    insert(kb, axioms + "<urn:c2> rdf:first rt:Hand ; rdf:rest rdf:nil", access=Access())
    for cell in ("<urn:c1>", "<urn:c2>"):
        with pytest.raises(ForbiddenError, match="rdf-syntax-ns#first"):
            insert(kb, f"{cell} rdf:first rt:Pen")
    insert(kb, "<urn:c0> rdf:first rt:Pen ; rdf:rest <urn:c1>")


def test_blank_nodes_of_axioms_are_out_of_reach_of_others(kb: KnowledgeBase) -> None:
    axiom = "<urn:W> owl:unionOf (rt:Mug) ; rdfs:subClassOf [ owl:onProperty rt:mass ]"
    insert(kb, axiom, access=Access())
    for part, where in (
        ("?b rdf:first rt:Pen", "<urn:W> owl:unionOf ?b"),
        ("?b owl:someValuesFrom my:X", "<urn:W> rdfs:subClassOf ?b"),
    ):
        text = f"{PREFIXES}{OWN}INSERT {{ {part} }} WHERE {{ {where} FILTER(isBlank(?b)) }}"
        with pytest.raises(ForbiddenError, match="right schema"):
            kb.update(text, agent="nao-1")


def test_a_robot_loads_a_large_file_with_terms_of_its_own_and_lists(kb: KnowledgeBase) -> None:
    own, graph = f"{BASE}robot/nao-1/", kb.graphs.agent("nao-1")
    lines = (f"<{own}L> a owl:Class .", f"<{own}l> rdf:first <{own}L> ; rdf:rest rdf:nil .")
    text = PREFIXES.replace("PREFIX", "\nPREFIX") + "\n".join(lines)
    quads = [Quad(t.subject, t.predicate, t.object, graph)
             for t in parse(text.encode(), format=RdfFormat.TURTLE)]  # fmt: skip
    request = Request(kb.access("nao-1"))
    late = kb._writer.committer.late
    assert late is not None
    while not late.is_behind:  # the notes of a commit wait unless the graph was just read
        insert(kb, f"<urn:before> <urn:seq> {kb.seq}")
    kb.bulk_add(quads, graph, request)
    assert all(quad in kb.store for quad in quads)
    foreign = Quad(quads[0].subject, quads[1].predicate, quads[0].object, graph)
    axiom = Quad(NamedNode("urn:F"), quads[0].predicate, quads[0].object, graph)
    with pytest.raises(ForbiddenError, match="urn:F"):
        kb.bulk_add([foreign, axiom], graph, request)


def test_a_robot_with_the_right_and_an_operator_state_axioms(kb: KnowledgeBase) -> None:
    for access in (Access("nao-3", "robot", frozenset(("schema",))), Access()):
        assert insert(kb, f"<urn:{access.role}> rdfs:subClassOf rt:Mug", access=access).added == 1
    assert [
        str(q.subject)
        for name, q in stored_axioms(kb.store, kb.graphs, kb.catalogue.declared())
        if name == "nao-3"
    ] == ["<urn:robot>"]


@pytest.mark.parametrize(
    "axiom", ["rt:Mug owl:disjointWith <urn:Vase>", "<urn:Vase> rdfs:subClassOf owl:Nothing"]
)
def test_a_contradiction_is_charged_to_the_author_of_the_axiom(axiom: str) -> None:
    with rtask.open(":memory:", base=BASE) as kb:
        insert(kb, axiom, access=Access("nao-3", "robot", frozenset(("schema",))))
        with pytest.raises(InconsistentError, match="charged to nao-3") as refused:
            insert(kb, "<urn:v> a rt:Mug, <urn:Vase>")
        assert refused.value.details["charged_to"] == ["nao-3"]
        with pytest.raises(InconsistentError) as refused:
            insert(kb, "<urn:v> a owl:Thing ; rt:mass 'heavy'")
        assert refused.value.details["charged_to"] == []


def test_many_hostile_axioms_hinder_and_reclassify_nobody(kb: KnowledgeBase) -> None:
    for number in range(200):
        with pytest.raises(ForbiddenError):
            insert(kb, f"{HOSTILE[number % len(HOSTILE)]} . my:n{number} rdfs:label 'n'")
    for robot in "abcde":
        insert(kb, f"<{BASE}mug-{robot}> a rt:Mug ; rt:name 'mug'", agent=f"robot-{robot}")
        mug = NamedNode(f"{BASE}mug-{robot}")
        found = kb.match(mug, NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type"))
        assert not any("Robot" in str(quad.object) or "Hand" in str(quad.object) for quad in found)


@pytest.mark.deep
def test_axioms_drawn_at_random_hinder_and_reclassify_nobody() -> None:
    draw = random.Random(33)
    terms = (
        *(
            "rt:Mug",
            "rt:ManipulableObject",
            "rt:PlanarGrasp",
            "rt:Robot",
            "owl:Thing",
            "owl:Nothing",
        ),
        *("rt:graspOf", "rt:name", "rt:mass", "rdf:type", "owl:sameAs", "rdfs:subClassOf"),
        *("my:A", "my:B", "my:p", "my:q", "its:mug-a", "its:mug-b", "owl:FunctionalProperty"),
        *("owl:SymmetricProperty", "owl:TransitiveProperty", "owl:IrreflexiveProperty"),
    )
    properties = (
        *("rdfs:subClassOf", "rdfs:subPropertyOf", "rdfs:domain", "rdfs:range", "rdf:type"),
        *("owl:disjointWith", "owl:equivalentClass", "owl:equivalentProperty", "owl:inverseOf"),
        *("owl:sameAs", "owl:differentFrom", "owl:propertyDisjointWith", "owl:complementOf"),
    )

    def types_of_mugs(kb: KnowledgeBase) -> list[set[str]]:
        for robot in "abcde":
            mug = f"its:mug-{robot}"
            grasp = f"[] rt:graspOf {mug}"
            insert(
                kb, f"{mug} a rt:Mug ; rt:name 'm' ; rt:mass 3e-1 . {grasp}", agent=f"robot-{robot}"
            )
        kind = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
        mugs = [NamedNode(f"{BASE}robot/nao-2/mug-{robot}") for robot in "abcde"]
        return [{str(quad.object) for quad in kb.match(mug, kind)} for mug in mugs]

    refused = 0
    with rtask.open(":memory:", base=BASE) as clean, rtask.open(":memory:", base=BASE) as hostile:
        for _ in range(200):
            subject, verb, value = (draw.choice(kind) for kind in (terms, properties, terms))
            if subject.startswith("its:") and verb == "rdf:type":
                continue  # what kind of thing a thing is, anybody may say: data, no axiom
            axiom = f"{subject} {verb} {value}"
            try:
                insert(hostile, axiom)
            except ForbiddenError:
                refused += 1
            except InconsistentError:
                continue
        assert refused > 100
        assert types_of_mugs(hostile) == types_of_mugs(clean)


def test_a_refused_change_is_kept_as_a_proposal_where_that_is_set(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        kb.proposes_axioms = True
        with pytest.raises(ForbiddenError, match="kept as proposal 1") as refused:
            insert(kb, "rt:Mug rdfs:subClassOf <urn:Vessel> . my:n rdfs:label 'n'")
        assert refused.value.details["proposal"] == 1
        found = kb.proposals.get(1)
        assert (found.author, found.rests_on, found.state) == ("nao-1", kb.seq, "proposed")
        insert(kb, "<urn:m> a rt:Mug")
        vessel = (NamedNode("urn:m"), None, NamedNode("urn:Vessel"))
        assert not kb.match(*vessel)
        with pytest.raises(ForbiddenError, match="right schema"):
            kb.adopt(1, access=Access("nao-1", "robot"))
        commit = kb.adopt(1)
        assert kb.match(*vessel)
        assert (kb.proposals.get(1).state, kb.proposals.get(1).commit) == ("adopted", commit.seq)
        with pytest.raises(ConflictError, match="adopted already"):
            kb.adopt(1)
        insert_refused(kb, "rt:Pen rdfs:subClassOf <urn:Tool>")
        kb.backup(tmp_path / "backup")
    with rtask.open(tmp_path / "kb", mode="r") as kb:
        assert [one.number for one in kb.proposals.find("adopted")] == [1]
    restore(tmp_path / "backup", tmp_path / "restored")
    with rtask.open(tmp_path / "restored") as kb:
        assert [one.state for one in kb.proposals.find()] == ["adopted", "proposed"]
        assert kb.adopt(2).added == 1


def test_an_axiom_is_refused_as_one_where_no_more_proposals_are_kept(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(register, "MAX_OPEN", 1)
    kb.proposes_axioms = True
    insert_refused(kb, "rt:Pen rdfs:subClassOf <urn:Tool>")
    with pytest.raises(ForbiddenError, match=r"right schema.* not kept .* 1 open proposals") as no:
        insert(kb, "rt:Mug rdfs:subClassOf <urn:Vessel>")
    assert no.value.details["right"] == "schema"
    assert "proposal" not in no.value.details


def insert_refused(kb: KnowledgeBase, statements: str) -> None:
    with pytest.raises(ForbiddenError):
        insert(kb, statements)


def test_reading_proposals_makes_no_file_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    assert Proposals(tmp_path).find() == []
    assert not list(tmp_path.iterdir())
    (tmp_path / "proposals.sqlite").write_bytes(b"no database, but text " * 100)
    with pytest.raises(StoreError, match=r"proposals\.sqlite cannot be used"):
        Proposals(tmp_path).find()


def test_a_proposal_that_the_present_state_contradicts_stays_open(kb: KnowledgeBase) -> None:
    graph = kb.graphs.shared
    gone = Quad(NamedNode("urn:gone"), NamedNode("urn:p"), NamedNode("urn:o"), graph)
    number = kb.propose([], [gone], author="ann", reason="it is wrong").number
    with pytest.raises(ConflictError, match="there no more"):
        kb.adopt(number)
    assert kb.proposals.get(number).is_open
    assert kb.proposals.refuse(number, "ben", "no").decided_by == "ben"


def test_an_author_has_a_bounded_number_of_open_proposals_and_they_expire() -> None:
    now = [dt.datetime(2026, 1, 1, tzinfo=dt.UTC)]
    register = Proposals(None, lambda: now[0])
    quad = Quad(NamedNode("urn:s"), NamedNode("urn:p"), NamedNode("urn:o"), NamedNode("urn:g"))
    for _ in range(MAX_OPEN):
        register.add([quad], [], "nao-1", 1)
    with pytest.raises(QueueFullError, match="100 open proposals"):
        register.add([quad], [], "nao-1", 1)
    assert register.add([quad], [], "nao-2", 1).is_open
    now[0] += LIFETIME + dt.timedelta(seconds=1)
    assert register.add([quad], [], "nao-1", 1).is_open
    assert len(register.find("expired")) == MAX_OPEN + 1
    with pytest.raises(ConflictError, match="expired"):
        register.refuse(1, "ann")
    with pytest.raises(UnknownTermError):
        register.get(999)
    with pytest.raises(UsageError, match="changes nothing"):
        register.add([], [], "nao-1", 1)
    register.close()
